"""Warnings about the samples of a result: nothing varies, or bins that are too wide."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from precision_pin.base.errors import Finding
from precision_pin.statistics import QUANTITIES, Summary

_COARSE: Final = 0.05
"""Share of the standard deviation above which the bin error of a quantile gives a warning."""
_ROUNDING: Final = 1e-14
"""Errors below this value, m or rad, count as rounding."""


def find_constant_error(summary: Summary, known: Sequence[Finding], where: str) -> list[Finding]:
    """Return a warning where the error does not vary, unless the sheet's findings include it."""
    if any(summary.varying) or any(finding.code in ("W_NO_SOURCES", "W_NOTHING_VARIES") for finding in known):
        return []
    message = f"no source makes the error vary {where}, and no specification can be judged"
    return [Finding("warning", "W_NOTHING_VARIES", message)]


def find_coarse_bins(summary: Summary) -> list[Finding]:
    """Return a warning for each quantity with a quantile in a bin that is too wide for the sampled spread."""
    found = []
    for quantity in QUANTITIES:
        distribution = summary.distribution(quantity)
        allowed = max(_COARSE * (distribution.std or 0.0), _ROUNDING)
        if (distribution.bin_upper - distribution.bin_lower).max() <= allowed:
            continue
        errors = {level: distribution.quantile_error(level) or 0.0 for level in distribution.levels}
        level = max(errors, key=lambda one: errors[one])
        if errors[level] > allowed:
            unit = "m" if quantity.startswith("position") else "rad"
            message = (
                f"the {100 * level:.4g} % quantile of {quantity} is resolved to {errors[level]:.2g} {unit} only, because rare "
                "errors lie far outside the range that the bins were planned for; its interval is widened accordingly"
            )
            found.append(Finding("warning", "W_BINS", message))
    return found
