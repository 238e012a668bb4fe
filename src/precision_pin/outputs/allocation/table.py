"""An allocation as text for a terminal."""

from __future__ import annotations

from typing import Final

from precision_pin.analyses.allocation.allocation_result import AllocatedLimit, AllocationResult
from precision_pin.analyses.allocation.error_parts import MEAN, SourcePart
from precision_pin.display.tables import resting_on
from precision_pin.display.text_table import aligned
from precision_pin.visible import shortened, visible

__all__ = ["allocation_table", "limit_in_words", "obstacles", "pose_count"]

_MOST_LETTERS: Final = 36
_MOST_NAMED: Final = 3
_MOST_LINES: Final = 12
_WORDS: Final = {"quantile": "", "rms": "root mean square ", "worst_case": "worst case "}


def allocation_table(result: AllocationResult) -> str:
    """Return the verdict and the cost, the limits, a row for each tolerance, and the error's sources before and after."""
    of = result.provenance
    rows = [["tolerance", "before", "after", "cost", "held by"]]
    for one, after, cost in zip(result.tolerances, result.after.tolist(), result.costs.tolist(), strict=True):
        before = one.written(one.before).removeprefix("±")
        held = "max" if after >= one.high * (1 - 1e-7) else "min" if after <= one.low * (1 + 1e-7) else "-"
        if one.grades is not None:
            held = f"grade {one.grade(after)}".rstrip()
        number, unit = one.written(after).removeprefix("±").split(" ", 1)
        path = shortened(visible(one.path), _MOST_LETTERS)
        rows.append([path, before, f"{float(number):.4g} {unit}", f"{cost:.4g}", held])
    return "\n".join(
        [
            *_verdict(result),
            f"{visible(of.robot)}: {visible(of.base)} to {visible(of.tip)}, {pose_count(result)}",
            "",
            *(_limit(one) for one in result.limits),
            "",
            *aligned(rows),
            "",
            *_parts(result),
            *_front(result),
            *resting_on(of.assumed, of.sources),
        ]
    )


def _verdict(result: AllocationResult) -> list[str]:
    if not result.feasible:
        one = result.tightest
        return [
            f"no allocation can meet {limit_in_words(one)}: with every tolerance at its least {_reached(one)};",
            f"  in the way: {obstacles(result)}",
        ]
    gap = result.gap
    certified = "how far above the least is not known" if gap is None else f"at most {100 * gap:.2g} % above the least"
    if gap is not None and not result.is_proven:
        certified += " (not proven)"
    met = "" if result.met else "; NOT MET by the samples"
    return [f"cost {result.cost:.6g}, before {result.cost_before:.6g}; {certified}{met}"]


def pose_count(result: AllocationResult) -> str:
    """Return the number of poses in words."""
    return f"{len(result.poses):,} pose{'s' if len(result.poses) > 1 else ''}"


def limit_in_words(one: AllocatedLimit) -> str:
    """Return a limit such as ``position.norm 0.5 mm @ 95 %``."""
    required = "" if one.required is None else f" @ {100 * one.required:.6g} %"
    return f"{_WORDS[one.kind]}{one.quantity} {1e3 * one.limit:.4g} {_unit(one)}{required}"


def _reached(one: AllocatedLimit) -> str:
    if one.probability is None or one.interval is None:
        return f"it is {1e3 * one.first_order:.4g} {_unit(one)} at {visible(one.worst_pose)}"
    low, high = (100 * end for end in one.interval)
    return f"{100 * one.probability:.2f} % ({low:.2f} to {high:.2f} %) keep it at {visible(one.worst_pose)}"


def obstacles(result: AllocationResult) -> str:
    """Return the largest parts that are left with every tolerance at its least: the constant one, then those that scatter."""
    parts = result.parts
    unit = "mm" if parts.quantity.startswith("position") else "mrad"
    scattered = [one for one in parts.sources if one.source != MEAN]
    most = max((one.after for one in scattered), default=0.0)
    mean = [one for one in parts.sources if one.source == MEAN and one.after > most / 2]
    named = [*mean, *(one for one in scattered[:_MOST_NAMED] if one.after > most / 2)]
    words = [
        f"{shortened(visible(one.source), _MOST_LETTERS)} {1e3 * one.after:.3g} {unit} ({_state(one)})" for one in named
    ]
    return ", ".join(words) or "nothing of the first order"


def _state(one: SourcePart) -> str:
    return "no tolerance" if one.source == MEAN else "at its least" if one.is_chosen else "not chosen"


def _parts(result: AllocationResult) -> list[str]:
    """Return the table of the sources before and after."""
    parts = result.parts
    unit = "mm" if parts.quantity.startswith("position") else "mrad"
    what = "largest deviation" if parts.kind == "worst_case" else "root mean square"
    rows = [["source", f"before [{unit}]", f"after [{unit}]", "share after", ""]]
    entries = list(zip(parts.sources, parts.shares(), strict=True))
    rows += [
        [
            shortened(visible(one.source), _MOST_LETTERS),
            f"{1e3 * one.before:.4g}",
            f"{1e3 * one.after:.4g}",
            f"{100 * share:.1f} %",
            "" if one.is_chosen else _state(one),
        ]
        for one, share in entries[:_MOST_LINES]
    ]
    left = sum(share for _, share in entries[_MOST_LINES:])
    more = [f"and {len(entries) - _MOST_LINES} more, {100 * left:.1f} %"] if len(entries) > _MOST_LINES else []
    return [f"{what} of {parts.quantity} at {visible(parts.pose)}, first order", *aligned(rows), *more]


def _front(result: AllocationResult) -> list[str]:
    """Return the table of the front; the limit is the tightest one."""
    if not result.front:
        return []
    one = result.tightest
    rows = [[f"{one.quantity} limit [{_unit(one)}]", "least cost"]]
    rows += [[f"{1e3 * one.limit * point.factor:.4g}", f"{point.cost:.4g}"] for point in result.front]
    others = ", the others with it" if len(result.limits) > 1 else ""
    return ["", f"cost against accuracy, first order{others}", *aligned(rows)]


def _unit(one: AllocatedLimit) -> str:
    return "mm" if one.quantity.startswith("position") else "mrad"


def _limit(one: AllocatedLimit) -> str:
    unit = _unit(one)
    price = f", {one.shadow_price / 1e3:.4g} saved for each {unit} more" if one.shadow_price else ""
    if one.interval is None or one.required is None or one.probability is None:
        return (
            f"{one.quantity} {_WORDS[one.kind]}{1e3 * one.first_order:.4g} of {1e3 * one.limit:.4g} {unit} at "
            f"{visible(one.worst_pose)}, first order{price}"
        )
    low, high = (100 * end for end in one.interval)
    return (
        f"{one.quantity} within {1e3 * one.limit:.4g} {unit}: {100 * one.probability:.2f} % ({low:.2f} to {high:.2f} %) of "
        f"{100 * one.required:.4g} %\n  at the worst pose {visible(one.worst_pose)}: {'met' if one.met else 'NOT MET'}{price}"
    )
