"""The command ``precision-pin``. Each command is one file, imported only when it runs."""

from __future__ import annotations

import sys
from typing import Final

# this module is the first that the program imports: it imports nothing that takes time
from precision_pin.cli import interrupts

__all__ = ["COMMANDS", "EXIT_INPUT", "EXIT_INTERNAL", "EXIT_SPEC", "main"]

COMMANDS: Final = {
    "analyze": "Sample the pose error of an arm at a pose: statistics, specifications, plots.",
    "budget": "Share of each draw, source and joint in the spread of the error; what a halved tolerance would give.",
    "check": "Check a URDF, or a sheet and its URDF; list every finding.",
    "init": "Write a commented sheet for a URDF, with starting tolerances.",
    "mcpc": "Print the MCPC parameters of a chain.",
    "worst-case": "Bound the pose error if every tolerance does its worst at once.",
    "exact-law": "Compute the law of every component of the first-order error, tails included, without sampling.",
    "reliability": "Probability that a limit is exceeded, by several methods, down to one in ten million and below.",
    "view": "Write a page with the arm and the cloud of sampled end-effector positions in 3-D.",
    "report": "Write everything about a pose into one page: verdict, distributions, causes, bounds, 3-D view.",
    "export": "Write robots as they may be built, each sampled, as URDF files.",
    "schema": "Print the JSON schema of the sheet.",
    "doctor": "Print versions and paths.",
}

EXIT_SPEC, EXIT_INPUT, EXIT_INTERNAL = 1, 2, 3
"""A signal that ends the program gives 128 + its number."""


def main() -> None:
    """Run the command line and end the process, with the exit code of the contract.

    The signals that end a program belong to this function from here to the end of the process.
    """
    interrupts.take_over()
    from precision_pin.cli.program import run

    code = run()
    interrupts.end()
    sys.exit(code)
