"""Terminal table of an allocation."""

from __future__ import annotations

from typing import Final

from precision_pin.analyses.allocation.allocate import MEAN, AllocatedLimit, AllocationResult, SourcePart
from precision_pin.base.errors import shortened, visible
from precision_pin.render.tables import unit
from precision_pin.render.text_table import aligned, limited

# maximum number of letters of a path or source
_MOST_LETTERS: Final = 36
# maximum number of random parts named as obstacles
_MOST_NAMED: Final = 3
# maximum number of sources in the table
_MOST_LINES: Final = 12
# gap that counts as rounding
_NO_GAP: Final = 1e-9
_WORDS: Final = {"quantile": "", "rms": "root mean square ", "worst_case": "worst case "}


def allocation_table(result: AllocationResult) -> str:
    """Return verdict and cost, the limits, a row for each tolerance, and the error's sources before and after."""
    of, parts, front = result.provenance, result.parts, front_rows(result)
    largest = part_rows(result)
    hidden = parts.shares()[len(largest) - 1 :]
    others = [f"and {len(hidden)} more, {100 * sum(hidden):.1f} %: --all"] if hidden else []
    return "\n".join(
        [
            *verdict_lines(result),
            f"{visible(of.arm)}, {pose_count(result)}",
            "",
            *limit_lines(result),
            "",
            *aligned(tolerance_rows(result)),
            "",
            parts_in_words(result),
            *aligned(largest),
            *others,
            *(["", front_in_words(result), *aligned(front)] if len(front) > 1 else []),
            *of.resting_lines,
        ]
    )


def tolerance_rows(result: AllocationResult) -> list[list[str]]:
    """Return a heading, then a row for each tolerance."""
    rows = [["tolerance", "before", "after", "cost", "held by"]]
    columns = (result.after.tolist(), result.costs.tolist(), result.shadow_prices.tolist())
    for tol, after, cost, price in zip(result.tolerances, *columns, strict=True):
        before = tol.number(tol.before)
        holder = "max" if after >= tol.high * (1 - 1e-7) else "min" if after <= tol.low * (1 + 1e-7) else "-"
        if holder != "-" and price:
            holder += f", {abs(price) * tol.quantity.units[tol.unit]:.3g} per {tol.unit or 1}"
        if tol.grades is not None:
            holder = f"grade {tol.grade(after)}".rstrip()
        path = shortened(visible(tol.path), _MOST_LETTERS)
        rows.append([path, before, tol.number(after, 4), f"{cost:.4g}", holder])
    return rows


def verdict_lines(result: AllocationResult) -> list[str]:
    """Return the cost and its gap to the least, or the limit that no allocation can meet and the obstacles."""
    if not result.feasible:
        limit = result.tightest
        # narrower is not always better: a wide error may bring back robots that a rare value moves just beyond the
        # limit
        is_shown = limit.required is None or result.bound_basis == "samples"
        lead = "no allocation can meet" if is_shown else "no allocation was found that meets"
        return [
            f"{lead} {_in_words(limit)}: with every tolerance at its least {_reached(limit)};",
            f"  in the way: {_obstacles(result)}",
        ]
    cost, grounds = f"cost {result.cost:.6g}, before {result.cost_before:.6g}", result.grounds
    if grounds.not_judged:
        return [f"{cost}; {grounds.said('not judged')}"]
    if not result.met:
        verdicts = [limit.verdict for limit in result.limits if not limit.met]
        return [f"{cost}; {('not met' if 'not met' in verdicts else verdicts[0]).upper()} by the samples"]
    met = f"; {grounds.said('met')}" if grounds.exact else ""
    return [f"{cost}; {_above_least(result)}{met}", *_margin(result)]


def _margin(result: AllocationResult) -> list[str]:
    """Return purpose and cost of the margin; nothing without one."""
    specs = [spec for spec in result.limits if spec.required is not None]
    if not specs or not result.for_samples:
        return []
    text = f"{result.for_samples:,} samples"
    if not all(spec.margin for spec in specs):
        return [f"  kept without a margin: {text} may leave it UNDECIDED"]
    named = ", ".join(f"{100 * ((spec.required or 0.0) + spec.margin):.5g} %" for spec in specs)
    price = result.margin_cost
    costs = "" if price is None else f"; the margin costs {price:.3g}, which counts as above the least"
    return [f"  chosen for {named}, so that {text} show it{costs}"]


def _above_least(result: AllocationResult) -> str:
    """Return the gap of the cost to the least as text, with its basis."""
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


def _in_words(limit: AllocatedLimit) -> str:
    required = "" if limit.required is None else f" @ {100 * limit.required:.6g} %"
    return f"{_WORDS[limit.kind]}{limit.quantity} {1e3 * limit.limit:.4g} {unit(limit.quantity)}{required}"


def _reached(spec: AllocatedLimit) -> str:
    text = (
        f"{share} keep it" if (share := _share(spec)) else f"it is {1e3 * spec.first_order:.4g} {unit(spec.quantity)}"
    )
    return f"{text} at {visible(spec.worst_pose)}"


def _obstacles(result: AllocationResult) -> str:
    """Return the largest parts that remain with the narrowest tolerances: the constant, then the random ones."""
    parts = result.parts
    size = unit(parts.quantity)
    scattered = [part for part in parts.sources if part.source != MEAN]
    maximum = max((part.after for part in scattered), default=0.0)
    mean = [part for part in parts.sources if part.source == MEAN and part.after > maximum / 2]
    named = [*mean, *(part for part in scattered[:_MOST_NAMED] if part.after > maximum / 2)]
    phrases = [
        f"{shortened(visible(part.source), _MOST_LETTERS)} {1e3 * part.after:.3g} {size} ({_state(part)}"
        + ("; compensate or calibrate removes it)" if part.source == MEAN else ")")
        for part in named
    ]
    return ", ".join(phrases) or "nothing of the first order"


def _state(part: SourcePart) -> str:
    return "no tolerance" if part.source == MEAN else "at its least" if part.is_chosen else "not chosen"


def parts_in_words(result: AllocationResult) -> str:
    """Return meaning and place of the source parts."""
    label = "largest deviation" if result.parts.kind == "worst_case" else "root mean square"
    return f"{label} of {result.parts.quantity} at {visible(result.parts.pose)}, first order"


def part_rows(result: AllocationResult) -> list[list[str]]:
    """Return a heading, then a row for each of the largest parts before and after."""
    parts = result.parts
    size = unit(parts.quantity)
    rows = [["source", f"before [{size}]", f"after [{size}]", "share after", "note"]]
    for part, share in list(zip(parts.sources, parts.shares(), strict=True))[: limited(_MOST_LINES)]:
        numbers = f"{1e3 * part.before:.4g}", f"{1e3 * part.after:.4g}", f"{100 * share:.1f} %"
        rows.append([shortened(visible(part.source), _MOST_LETTERS), *numbers, "" if part.is_chosen else _state(part)])
    return rows


def front_in_words(result: AllocationResult) -> str:
    """Return the title of the front."""
    suffix = ", the others with it" if len(result.limits) > 1 else ""
    return f"cost against accuracy, first order{suffix}"


def front_rows(result: AllocationResult) -> list[list[str]]:
    """Return a heading, then a row for each point of the front; the limit is the tightest one."""
    limit = result.tightest
    rows = [[f"{limit.quantity} limit [{unit(limit.quantity)}]", "least cost"]]
    return rows + [[f"{1e3 * limit.limit * point.factor:.4g}", f"{point.cost:.4g}"] for point in result.front]


def limit_lines(result: AllocationResult) -> list[str]:
    """Return a line or two for each limit."""
    lines = []
    for limit in result.limits:
        size, share = unit(limit.quantity), _share(limit)
        price = f", {limit.shadow_price / 1e3:.4g} saved for each {size} more" if limit.shadow_price else ""
        lines.append(
            f"{limit.quantity} {_WORDS[limit.kind]}{1e3 * limit.first_order:.4g} of {1e3 * limit.limit:.4g} {size} at "
            f"{visible(limit.worst_pose)}, first order{price}"
            if limit.required is None
            else f"{limit.quantity} within {1e3 * limit.limit:.4g} {size}: {share} of {100 * limit.required:.4g} %\n  at the "
            f"worst pose {visible(limit.worst_pose)}: {limit.verdict.upper()}{price}"
        )
    return lines


def _share(limit: AllocatedLimit) -> str:
    """Return the fraction of the samples inside with its interval; empty for a limit without probability."""
    if limit.probability is None or limit.interval is None:
        return ""
    low, high = (100 * bound for bound in limit.interval)
    return f"{100 * limit.probability:.2f} % ({low:.2f} to {high:.2f} %)"
