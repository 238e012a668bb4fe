"""Terminal table of an allocation."""

from __future__ import annotations

from typing import Final

from precision_pin.analyses.allocation.allocate import MEAN, AllocatedLimit, AllocationResult, SourcePart
from precision_pin.base.errors import shortened, visible
from precision_pin.base.units import LENGTH
from precision_pin.render.tables import resting_on, unit
from precision_pin.render.text_table import aligned

_MOST_LETTERS: Final = 36
_MOST_NAMED: Final = 3
_MOST_LINES: Final = 12
_NO_GAP: Final = 1e-9
_WORDS: Final = {"quantile": "", "rms": "root mean square ", "worst_case": "worst case "}


def allocation_table(result: AllocationResult) -> str:
    """Return verdict and cost, the limits, a row for each tolerance, and the error's sources before and after."""
    of, parts, front = result.provenance, result.parts, front_rows(result)
    largest = part_rows(result)
    hidden = parts.shares()[len(largest) - 1 :]
    more = [f"and {len(hidden)} more, {100 * sum(hidden):.1f} %"] if hidden else []
    return "\n".join(
        [
            *verdict_lines(result),
            f"{visible(of.robot)}: {visible(of.base)} to {visible(of.tip)}, {pose_count(result)}",
            "",
            *limit_lines(result),
            "",
            *aligned(tolerance_rows(result)),
            "",
            parts_in_words(result),
            *aligned(largest),
            *more,
            *(["", front_in_words(result), *aligned(front)] if len(front) > 1 else []),
            *resting_on(of.assumed, of.sources, of.origins, of.origins_at),
        ]
    )


def tolerance_rows(result: AllocationResult) -> list[list[str]]:
    """Return a heading, then a row for each tolerance."""
    rows = [["tolerance", "before", "after", "cost", "held by"]]
    columns = (result.after.tolist(), result.costs.tolist(), result.shadow_prices.tolist())
    for one, after, cost, price in zip(result.tolerances, *columns, strict=True):
        before = one.number(one.before)
        held = "max" if after >= one.high * (1 - 1e-7) else "min" if after <= one.low * (1 + 1e-7) else "-"
        if held != "-" and price:
            held += f", {abs(price) / 1e3:.3g} per {'mm' if one.unit in LENGTH.units else 'mrad'}"
        if one.grades is not None:
            held = f"grade {one.grade(after)}".rstrip()
        number, written = one.number(after).split(" ", 1)
        path = shortened(visible(one.path), _MOST_LETTERS)
        rows.append([path, before, f"{float(number):.4g} {written}", f"{cost:.4g}", held])
    return rows


def verdict_lines(result: AllocationResult) -> list[str]:
    """Return the cost and its gap to the least, or the limit that no allocation can meet and the obstacles."""
    if not result.feasible:
        one = result.tightest
        # narrower is not always better: a wide error may bring back robots that a rare value moves just beyond the
        # limit
        is_shown = one.required is None or result.bound_basis == "samples"
        none = "no allocation can meet" if is_shown else "no allocation was found that meets"
        return [
            f"{none} {_in_words(one)}: with every tolerance at its least {_reached(one)};",
            f"  in the way: {_obstacles(result)}",
        ]
    cost, grounds = f"cost {result.cost:.6g}, before {result.cost_before:.6g}", result.grounds
    if grounds.not_judged:
        return [f"{cost}; {grounds.said('not judged')}"]
    if not result.met:
        verdicts = [one.verdict for one in result.limits if not one.met]
        return [f"{cost}; {('not met' if 'not met' in verdicts else verdicts[0]).upper()} by the samples"]
    met = f"; {grounds.said('met')}" if grounds.exact else ""
    return [f"{cost}; {_above_least(result)}{met}", *_margin(result)]


def _margin(result: AllocationResult) -> list[str]:
    """Return purpose and cost of the margin; nothing without one."""
    given = [one for one in result.limits if one.required is not None]
    if not given or not result.for_samples:
        return []
    shown = f"{result.for_samples:,} samples"
    if not all(one.margin for one in given):
        return [f"  kept without a margin: {shown} may leave it UNDECIDED"]
    named = ", ".join(f"{100 * ((one.required or 0.0) + one.margin):.5g} %" for one in given)
    price = result.margin_cost
    costs = "" if price is None else f"; the margin costs {price:.3g}, which counts as above the least"
    return [f"  chosen for {named}, so that {shown} show it{costs}"]


def _above_least(result: AllocationResult) -> str:
    """Return as text how far the cost is above the least, and the basis of that."""
    gap = result.gap
    if gap is None:
        return "how far above the least is not known"
    if result.bound_basis == "samples":
        every = "every cheaper choice of grades fails by the samples"
        return every if gap < _NO_GAP else f"at most {100 * gap:.2g} % above the least by the samples"
    rests = "the least of the first order" if result.bound_basis == "proof" else "the least (bound not proven)"
    # per cent; less is rounding
    return f"at most {max(100 * gap, 1e-4):.2g} % above {rests}"


def pose_count(result: AllocationResult) -> str:
    """Return the number of poses as text."""
    return f"{len(result.poses):,} pose{'s' if len(result.poses) > 1 else ''}"


def _in_words(one: AllocatedLimit) -> str:
    required = "" if one.required is None else f" @ {100 * one.required:.6g} %"
    return f"{_WORDS[one.kind]}{one.quantity} {1e3 * one.limit:.4g} {unit(one.quantity)}{required}"


def _reached(one: AllocatedLimit) -> str:
    reached = (
        f"{share} keep it" if (share := _share(one)) else f"it is {1e3 * one.first_order:.4g} {unit(one.quantity)}"
    )
    return f"{reached} at {visible(one.worst_pose)}"


def _obstacles(result: AllocationResult) -> str:
    """Return the largest parts that remain with every tolerance at its least: the constant, then the random ones."""
    parts = result.parts
    size = unit(parts.quantity)
    scattered = [one for one in parts.sources if one.source != MEAN]
    most = max((one.after for one in scattered), default=0.0)
    mean = [one for one in parts.sources if one.source == MEAN and one.after > most / 2]
    named = [*mean, *(one for one in scattered[:_MOST_NAMED] if one.after > most / 2)]
    words = [
        f"{shortened(visible(one.source), _MOST_LETTERS)} {1e3 * one.after:.3g} {size} ({_state(one)}"
        + ("; compensate or calibrate removes it)" if one.source == MEAN else ")")
        for one in named
    ]
    return ", ".join(words) or "nothing of the first order"


def _state(one: SourcePart) -> str:
    return "no tolerance" if one.source == MEAN else "at its least" if one.is_chosen else "not chosen"


def parts_in_words(result: AllocationResult) -> str:
    """Return meaning and place of the source parts."""
    what = "largest deviation" if result.parts.kind == "worst_case" else "root mean square"
    return f"{what} of {result.parts.quantity} at {visible(result.parts.pose)}, first order"


def part_rows(result: AllocationResult) -> list[list[str]]:
    """Return a heading, then a row for each of the largest parts before and after."""
    parts = result.parts
    size = unit(parts.quantity)
    rows = [["source", f"before [{size}]", f"after [{size}]", "share after", "note"]]
    for one, share in list(zip(parts.sources, parts.shares(), strict=True))[:_MOST_LINES]:
        numbers = f"{1e3 * one.before:.4g}", f"{1e3 * one.after:.4g}", f"{100 * share:.1f} %"
        rows.append([shortened(visible(one.source), _MOST_LETTERS), *numbers, "" if one.is_chosen else _state(one)])
    return rows


def front_in_words(result: AllocationResult) -> str:
    """Return the title of the front."""
    others = ", the others with it" if len(result.limits) > 1 else ""
    return f"cost against accuracy, first order{others}"


def front_rows(result: AllocationResult) -> list[list[str]]:
    """Return a heading, then a row for each point of the front; the limit is the tightest one."""
    one = result.tightest
    rows = [[f"{one.quantity} limit [{unit(one.quantity)}]", "least cost"]]
    return rows + [[f"{1e3 * one.limit * point.factor:.4g}", f"{point.cost:.4g}"] for point in result.front]


def limit_lines(result: AllocationResult) -> list[str]:
    """Return a line or two for each limit."""
    lines = []
    for one in result.limits:
        size, share = unit(one.quantity), _share(one)
        price = f", {one.shadow_price / 1e3:.4g} saved for each {size} more" if one.shadow_price else ""
        lines.append(
            f"{one.quantity} {_WORDS[one.kind]}{1e3 * one.first_order:.4g} of {1e3 * one.limit:.4g} {size} at "
            f"{visible(one.worst_pose)}, first order{price}"
            if one.required is None
            else f"{one.quantity} within {1e3 * one.limit:.4g} {size}: {share} of {100 * one.required:.4g} %\n  at the "
            f"worst pose {visible(one.worst_pose)}: {one.verdict.upper()}{price}"
        )
    return lines


def _share(one: AllocatedLimit) -> str:
    """Return the fraction of the samples inside with its interval; empty for a limit without probability."""
    if one.probability is None or one.interval is None:
        return ""
    low, high = (100 * end for end in one.interval)
    return f"{100 * one.probability:.2f} % ({low:.2f} to {high:.2f} %)"
