"""The command ``precision-pin``. Each command is one file, imported only when it runs."""

from __future__ import annotations

import gc
import sys

# the first module imported: it imports nothing slow
from precision_pin.base import interrupts

__all__ = ["main"]


def main() -> None:
    """Run the command line and end the process with its exit code; handles the ending signals until then."""
    interrupts.take_over()
    # the default of 700 runs the collector so often among the objects of a large sheet that it takes a seventh of the
    # time
    gc.set_threshold(50_000, 20, 20)
    from precision_pin.cli.program import run

    code = run()
    interrupts.end()
    sys.exit(code)
