"""Results as tables: numbers with their intervals, data frames and datasets."""

from __future__ import annotations

import importlib
import json
import math
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from precision_pin.base.errors import InputError
from precision_pin.statistics.limits import LIMITED
from precision_pin.statistics.plan import QUANTITIES, is_joint

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]
    import xarray

MOST_POSES: Final = 3
"""Poses of a result that a notebook shows; a line below counts the others."""

UNITS: Final = {"position": "m", "attitude": "rad"}
"""Units of numbers in data frames and datasets."""

ROUNDING: Final = 1e-14
"""Errors (m, rad) below this are rounding."""

MISSING: Final = "–"
"""What the report writes for a missing number; the terminal has ``-``."""

_DIGITS: Final = 6


# text --------------------------------------------------------------------------------------------


def symbol(quantity: str) -> str:
    """Return the symbol of a quantity in tables: ``|d|``, ``dx``, … for ``position.norm``, ``position.x``, …."""
    if quantity not in QUANTITIES:
        return absolute(quantity)
    vector, _, part = quantity.partition(".")
    letter = "d" if vector == "position" else "δ"
    return f"|{letter}|" if part == "norm" else f"{letter}{part}"


def absolute(quantity: str) -> str:
    """Return the symbol of a quantity's size, which a specification limits: ``|d|``, ``lateral``, …."""
    return LIMITED[quantity].symbol if quantity in LIMITED else quantity


def bounded(quantity: str, limit: float, relation: str = " ≤ ", digits: int = _DIGITS, name: str = "") -> str:
    """Return a limited quantity as text, such as ``|d| ≤ 0.5 mm``; of several limits at once their own text."""
    if is_joint(quantity):
        return quantity
    return f"{name or absolute(quantity)}{relation}{1e3 * limit:.{digits}g} {unit(quantity)}"


def unit(quantity: str) -> str:
    """Return the unit in which a table shows a quantity; ``‰`` of the limits for several at once."""
    return "‰" if is_joint(quantity) else "mm" if quantity.startswith("position") else "mrad"


def quantity_label(quantity: str) -> str:
    """Return symbol and unit, as on an axis or row: ``|d| [mm]``, …."""
    return f"{symbol(quantity)} [{unit(quantity)}]"


def milli(value: float | None, digits: int = _DIGITS) -> str:
    """Return a number of m or rad in mm or mrad, to so many digits; ``-`` for None or NaN."""
    if value is None or math.isnan(value):
        return "-"
    return f"{0.0 if abs(value) < ROUNDING else 1e3 * value:.{digits}g}"


def percent(share: float | None) -> str:
    """Return a fraction in per cent, two decimals; ``-`` for None."""
    return "-" if share is None else f"{round(100 * share, 2) + 0.0:.2f}"


def shown(cell: Any) -> Any:
    """Return a cell of a terminal table as the report writes it."""
    return MISSING if cell == "-" else cell


def plus_minus(value: float | None, half_width: float | None, *, decimals: int = 12, signed: bool = False) -> str:
    """Return ``value ± half-width`` with two digits of the half-width; ``-`` where not resolved.

    The half-width is rounded up and covers the rounding of the value, so the printed interval contains the true one.
    ``decimals`` limits the digits behind the point; ``signed`` gives a positive value its sign.
    """
    if value is None or half_width is None or not math.isfinite(half_width):
        return "-"
    if half_width == 0:
        return f"{value + 0.0:.{_DIGITS}g}"
    place = max(math.floor(math.log10(half_width)) - 1, -decimals)
    # the allowance keeps 0.12, which is not exact in binary, from being rounded up to 0.13
    rounded = round(value, -place)
    above = math.ceil((half_width + abs(rounded - value)) / 10.0**place * (1 - 1e-12)) * 10.0**place
    digits = max(0, -place)
    return f"{rounded + 0.0:{'+' if signed else ''}.{digits}f} ± {above:.{digits}f}"


def plain(value: float, decimals: int = 9) -> str:
    """Return a number in full except for rounding noise."""
    return f"{round(value, decimals) + 0.0:.9g}"


def joint_value(joint: str, value: float, *, slides: bool) -> str:
    """Return a joint value (rad or m) as text in full: mm if the joint slides, else degrees."""
    return f"{joint} {plain(1e3 * value)} mm" if slides else f"{joint} {plain(math.degrees(value))}°"


def joint_text(
    q: Mapping[str, float],
    sliding_joints: Collection[str],
    approach: Mapping[str, str] | None = None,
    *,
    is_named: bool = True,
) -> str:
    """Return joint values by name (if ``is_named``), with ``(+)`` or ``(-)`` where the last motion is known."""
    signs = {joint: f" ({sign})" for joint, sign in (approach or {}).items()}
    return ", ".join(
        joint_value(joint if is_named else "", value, slides=joint in sliding_joints).lstrip() + signs.get(joint, "")
        for joint, value in q.items()
    )


def resting_on(
    assumed: Sequence[str],
    sources: int,
    origins: Mapping[str, tuple[float, float]] | None = None,
    where: str = "",
    *,
    is_brief: bool = False,
) -> list[str]:
    """Return lines on how much rests on assumptions and where the other numbers come from; empty if neither is stated.

    Args:
        assumed: Labels of the sources marked as assumptions.
        origins: Fraction of the variance of position and attitude by provenance.
        where: Pose of these fractions, if it is not that of the result.
        is_brief: Whether to return one line on the assumptions only.
    """
    lines = []
    shares = {kind: share for kind, share in (origins or {}).items() if max(share) > 0}
    at = f" at {where}" if where else ""
    if assumed:
        kinds = f" ({', '.join(dict.fromkeys(label.partition('[')[0] for label in assumed))})"
        lines.append(
            f"rests on assumptions: {len(assumed):,} of {sources:,} sources are marked as assumed in the sheet"
            f"{'' if is_brief else kinds}"
        )
    if "assumed" in shares:
        position, attitude = map(share_in_words, shares["assumed"])
        head = "they cause" if assumed else "rests on assumptions: they cause"
        lines.append(f"{head} {position} of the variance of the position, {attitude} of the attitude{at}")
    if is_brief:
        return ["; ".join(lines)] if lines else []
    if set(shares) - {"assumed", "not stated"}:
        parts = ", ".join(f"{share_in_words(position)} {kind}" for kind, (position, _) in shares.items())
        lines.append(f"variance of the position by provenance{at}: {parts}")
    return lines


def origins_entry(origins: Mapping[str, tuple[float, float]]) -> dict[str, dict[str, dict[str, float]]]:
    """Return the key ``provenance`` of a result's JSON; empty if the sheet states none."""
    if not origins:
        return {}
    return {
        "provenance": {
            kind: {"position": position, "attitude": attitude} for kind, (position, attitude) in origins.items()
        }
    }


def count_poses(number: int) -> str:
    """Return a number of poses as text: ``1 pose``, ``2 poses``, …."""
    return f"{number:,} pose{'' if number == 1 else 's'}"


def share_in_words(share: float) -> str:
    """Return a share in the variance, rounded to a percent; ``under 1 %`` below half a percent."""
    return "under 1 %" if 0 < share < 0.005 else f"{100 * share:.0f} %"


def pose_labels(names: Sequence[str]) -> list[str]:
    """Return a unique label for each pose: its name, or ``pose 1``, ``pose 2``, …."""
    labels: dict[str, None] = {}
    for rank, name in enumerate(names, start=1):
        label = plain = name or f"pose {rank}"
        repeats = 1
        while label in labels:
            repeats += 1
            label = f"{plain} ({repeats})"
        labels[label] = None
    return list(labels)


# data --------------------------------------------------------------------------------------------


def optional(package: str) -> Any:
    """Import and return an optional package, pandas or xarray."""
    try:
        return importlib.import_module(package)
    except ImportError:
        raise InputError(f"{package} is not installed (pip install 'precision-pin[{package}]')") from None


def number(value: float | None) -> float:
    """Return a number, NaN for None."""
    return math.nan if value is None else value


def interval_columns(name: str, value: float | None, interval: tuple[float, float] | None) -> dict[str, float]:
    """Return the three columns ``name``, ``name_lower``, ``name_upper``; NaN where not resolved."""
    low, high = interval or (None, None)
    return {name: number(value), f"{name}_lower": number(low), f"{name}_upper": number(high)}


def data_frame(
    index: Sequence[str], rows: Sequence[tuple[tuple[str, ...], Mapping[str, Any]]], attributes: Mapping[str, Any]
) -> pandas.DataFrame:
    """Return rows, each with its index and columns, as a data frame whose ``attrs`` are the attributes and units."""
    pandas = optional("pandas")
    keys = [key for key, _ in rows]
    labels = (
        pandas.Index([key[0] for key in keys], name=index[0])
        if len(index) == 1
        else pandas.MultiIndex.from_tuples(keys, names=index)
    )
    frame = pandas.DataFrame([columns for _, columns in rows], index=labels)
    frame.attrs = {**attributes, "units": dict(UNITS)}
    return frame


def dataset(frame: pandas.DataFrame) -> xarray.Dataset:
    """Return a frame whose index is a full grid as a dataset; ``attrs`` become text, as netCDF requires."""
    xarray = optional("xarray")
    result = xarray.Dataset.from_dataframe(frame)
    # in the order of the frame, not sorted
    result = result.sel({str(level): frame.index.unique(level) for level in frame.index.names})
    return result.assign_attrs(described(frame.attrs))


def described(attributes: Mapping[str, Any]) -> dict[str, str]:
    """Return attributes as text: strings unchanged, all else as JSON."""
    return {
        key: value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
        for key, value in attributes.items()
    }
