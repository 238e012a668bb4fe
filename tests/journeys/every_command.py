"""Every command that takes a sheet, with arguments that let it end soon."""

from __future__ import annotations

from precision_pin.cli.commands import list_commands

READERS: dict[str, tuple[str, ...]] = {
    "analyze": ("--samples", "200"),
    "budget": ("--samples", "1024"),
    "worst-case": (),
    "exact-law": (),
    "reliability": ("--spec", "5 mm @ 90 %"),
    "moments": (),
    "iso9283": ("--robots", "20", "--cycles", "2"),
    "check": (),
    "mcpc": (),
    "view": ("--samples", "20", "--out", "view.html"),
    "report": ("--samples", "200", "--out", "report.html"),
    "export": ("--out", "built"),
    "calibrate": ("--forecast", "--random", "5"),
    "simulate": ("--out", "simulated.csv"),
    "map": ("--all-poses", "--verify", "0"),
    "path": ("--all-poses", "--samples", "100"),
    "compare": ("--samples", "200", "--set", "statics=equilibrium"),
    "compensate": ("--all-poses",),
    "allocate": (),
}
"""Arguments beside the sheet; ``allocate`` needs its key in the sheet."""
WITHOUT_SHEET = {"init", "explain", "schema", "doctor"}
ANSWERS = {"reliability", "compensate", "allocate"}
"""Commands whose exit code 1 is an answer: a limit missed, a pose without a correction."""

assert set(list_commands()) == set(READERS) | WITHOUT_SHEET


def codes(command: str) -> tuple[int, ...]:
    """Return the exit codes of a command that has read its files."""
    return (0, 1) if command in ANSWERS else (0,)
