"""An allocation as text for a terminal."""

from __future__ import annotations

from precision_pin.analyses.allocation.allocation_result import AllocatedLimit, AllocationResult
from precision_pin.display.tables import resting_on
from precision_pin.display.text_table import aligned
from precision_pin.visible import shortened, visible

__all__ = ["allocation_table"]

_MOST_LETTERS = 36


def allocation_table(result: AllocationResult) -> str:
    """Return the verdict and the cost, the limits, then a row for each tolerance."""
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
            f"{visible(of.robot)}: {visible(of.base)} to {visible(of.tip)}, {len(result.poses)} poses",
            "",
            _verdict(result),
            *(_limit(one) for one in result.limits),
            "",
            *aligned(rows),
            *resting_on(of.assumed, of.sources),
        ]
    )


def _verdict(result: AllocationResult) -> str:
    if not result.feasible:
        return "no tolerances within their bounds keep the limits; below are the narrowest ones"
    gap = result.gap
    certified = "how far above the least is not known" if gap is None else f"at most {100 * gap:.2g} % above the least"
    if gap is not None and not result.is_proven:
        certified += " (not proven)"
    met = "" if result.met else "; NOT MET by the samples"
    return f"cost {result.cost:.6g}, before {result.cost_before:.6g}; {certified}{met}"


def _limit(one: AllocatedLimit) -> str:
    unit = "mm" if one.quantity.startswith("position") else "mrad"
    price = "" if one.shadow_price is None else f", {one.shadow_price / 1e3:.4g} saved for each {unit} more"
    if one.interval is None or one.required is None or one.probability is None:
        what = {"rms": "root mean square", "worst_case": "worst case"}[one.kind]
        return (
            f"{one.quantity} {what} {1e3 * one.first_order:.4g} of {1e3 * one.limit:.4g} {unit} at "
            f"{visible(one.worst_pose)}, first order{price}"
        )
    low, high = (100 * end for end in one.interval)
    return (
        f"{one.quantity} within {1e3 * one.limit:.4g} {unit}: {100 * one.probability:.2f} % ({low:.2f} to {high:.2f} %) of "
        f"{100 * one.required:.4g} %\n  at the worst pose {visible(one.worst_pose)}: {'met' if one.met else 'NOT MET'}{price}"
    )
