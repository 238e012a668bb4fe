"""Attacks on the package: changed robots, changed sheets, interrupts; see ``python -m fuzzing --help``."""
