"""The command ``precision-pin``. Each command is one file, imported only when it runs."""

from __future__ import annotations

import gc
import sys

# the first module that the program imports: it imports nothing that takes time
from precision_pin.base import interrupts

__all__ = ["EXIT_INPUT", "EXIT_INTERNAL", "EXIT_SPEC", "main"]

EXIT_SPEC, EXIT_INPUT, EXIT_INTERNAL = 1, 2, 3
"""A signal that ends the program gives 128 + its number."""


def main() -> None:
    """Run the command line and end the process, with the exit code of the contract.

    The signals that end a program belong to this function from here to the end of the process.
    """
    interrupts.take_over()
    # the default of 700 looks for garbage so often among the objects of a large sheet that it takes a seventh of the time
    gc.set_threshold(50_000, 20, 20)
    from precision_pin.cli.program import run

    code = run()
    interrupts.end()
    sys.exit(code)
