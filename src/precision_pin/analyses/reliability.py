"""The probability that the error stays inside a limit, down to where plain sampling sees nothing.

Plain sampling, FORM, importance sampling and subset simulation answer the same question on the exact model; where they
contradict each other, the result says so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from precision_pin import kernel
from precision_pin.analyses.design_points import FARTHEST, DesignPoint, Form, Margin, form
from precision_pin.analyses.heading import Heading, Pose, PoseHeading, listed_poses
from precision_pin.analyses.rare_events import (
    LARGEST_VARIATION,
    Estimate,
    importance_sampling,
    subset_simulation,
)
from precision_pin.analyses.reliability_result import (
    LikelyFailure,
    PoseReliability,
    ReliabilityResult,
    SpecificationReliability,
)
from precision_pin.errors import Finding, InputError
from precision_pin.laws import Circle, Disc
from precision_pin.laws.law import cumulative
from precision_pin.model import ErrorModel, PoseModel
from precision_pin.run import Progress, monte_carlo
from precision_pin.space import Space
from precision_pin.statistics import Specification, SpecificationResult, clopper_pearson, quantity_values

__all__ = ["from_normals", "reliability"]

Array = NDArray[np.float64]

IMPORTANCE_SAMPLES: Final = 20_000
SUBSET_SAMPLES: Final = 2_000
"""In each level of each replicate."""

ENOUGH_VARIATION: Final = 0.1
"""With a smaller coefficient of variation, plain sampling decides alone."""

LISTED: Final = 3
"""How many design points are told in full."""

_NORM_STARTS: Final = np.array([n for n in np.ndindex(3, 3, 3) if n != (1, 1, 1)], dtype=float).T - 1.0
"""The 26 directions to faces, edges and corners of a cube."""

_REPEATS: Final = 4
_ASIDE: Final = 0.3


def reliability(
    error_model: ErrorModel,
    specifications: Sequence[Specification],
    poses: Pose | Sequence[Pose] = None,
    /,
    *,
    seed: int = 0,
    samples: int = 100_000,
    confidence: float = 0.95,
    findings: Sequence[Finding] = (),
    progress: Progress | None = None,
) -> ReliabilityResult:
    """Return the probability that the exact model's error keeps each specification, by several methods.

    Parameters
    ----------
    error_model
        Chain, draws and sources.
    specifications
        Limits of position, attitude or a component; see :func:`precision_pin.specification`.
    poses
        A pose (a name, joint values, or None for the model's first) or a list of such.
    seed, samples, confidence
        Of plain sampling; seed and confidence of the other methods too.
    findings
        Warnings to carry along, such as those of the sheet.
    progress
        Told how many plain samples have been added since it was last called.

    Raises
    ------
    InputError
        No specification, a wrong pose, seed, number of samples or confidence, or errors too large to compute with.
    """
    if not specifications:
        raise InputError("no specification is given; state at least one, such as '0.5 mm @ 99.73 %'")
    found, warnings = [], [str(finding) for finding in findings]
    for pose in listed_poses(poses):
        analysis = monte_carlo(
            error_model, pose, samples=samples, seed=seed, specifications=specifications, confidence=confidence,
            progress=progress,
        )  # fmt: skip
        warnings += [line for line in analysis.warnings if line not in warnings]
        at = error_model.at(pose)
        layout = kernel.compile_table(at)
        results = [
            _of_specification(at, layout, specification, counted, samples, seed, confidence)
            for specification, counted in zip(specifications, analysis.summary.specifications, strict=True)
        ]
        found.append(PoseReliability(PoseHeading.of(error_model, pose, at), tuple(results)))
    return ReliabilityResult(
        Heading.of(error_model, seed), int(samples), float(confidence), tuple(found), tuple(warnings)
    )


def from_normals(space: Space, normals: Array) -> Array:
    """Return component values ``(d, N)`` of independent standard normal numbers ``(d, N)``; the law stays what it is.

    A number is F⁻¹(Φ(u)), of correlated draws after mixing. A disc's point lies in the direction of its two numbers, at
    r √(1 - exp(-|u|²/2)): smoother than polar coordinates one by one, which tear at an angle. A circle's angle is
    4πΦ(u₁), so that every angle is met within 0.7 of the middle. Beyond ±8.2, numbers are taken there.
    """
    u = np.clip(np.asarray(normals, dtype=float), -FARTHEST, FARTHEST)
    x: Array = np.empty_like(u)
    scores = u.copy()
    for correlation in space.correlations:
        rows = [space.index[name] for name in correlation.names]
        scores[rows] = np.clip(correlation.mix(u[rows]), -FARTHEST, FARTHEST)
    for draw, columns in zip(space.draws, space.slices, strict=True):
        match draw.law:
            case Disc(radius=radius):
                length = np.hypot(*normals[columns])
                unit = np.divide(normals[columns], length, out=np.zeros_like(x[columns]), where=length > 0)
                x[columns] = radius * np.sqrt(-np.expm1(-(length**2) / 2)) * unit
            case Circle(radius=radius):
                turn = 4 * np.pi * cumulative(scores[columns][1])
                x[columns] = radius * np.array([np.cos(turn), np.sin(turn)])
            case law:
                x[columns] = law.at_scores(scores[columns])
    return x


def _margin(at: PoseModel, layout: kernel.CompiledTable, specification: Specification) -> Margin:
    """Return what is left up to the limit, in limits, for standard normal numbers."""

    def margin(normals: Array) -> Array:
        errors = kernel.errors_at(layout, "exact", from_normals(at.space, normals))
        value: Array = 1 - np.abs(quantity_values(errors)[specification.row]) / specification.limit
        return value

    return margin


def _starts(at: PoseModel, specification: Specification) -> list[Array]:
    """Return where the search begins: the tangent's steepest ways out, from all sides, two standard deviations away."""
    rows = slice(0, 3) if specification.quantity.startswith("position") else slice(3, 6)
    part = specification.quantity.rpartition(".")[2]
    directions = (
        _NORM_STARTS if part == "norm" else np.tile(np.eye(3)[:, ["xyz".index(part)]] * [[1.0, -1.0]], _REPEATS)
    )
    spread = np.sqrt(np.diag(at.space.covariance))
    ways = (at.jacobian[rows] * spread).T @ directions
    lengths = np.linalg.norm(ways, axis=0)
    # a little aside of the middle, where a gradient may vanish by symmetry
    aside = _ASIDE * np.random.Generator(np.random.Philox(0)).standard_normal(ways.shape)
    out = 2 * np.divide(ways, lengths, out=np.zeros_like(ways), where=lengths > 0)
    return list((out + aside).T)


def _of_specification(
    at: PoseModel,
    layout: kernel.CompiledTable,
    specification: Specification,
    counted: SpecificationResult,
    samples: int,
    seed: int,
    confidence: float,
) -> SpecificationReliability:
    margin = _margin(at, layout, specification)
    inside = round(counted.probability * samples)
    plain = plain_estimate(samples - inside, samples, confidence)
    estimates, starts = [plain], _starts(at, specification)
    if at.space.size:
        subset, failures = subset_simulation(
            margin, at.space.size, seed=seed, samples=SUBSET_SAMPLES, confidence=confidence
        )
        # failures lie wherever there are any, and lead to design points that no symmetry tells of
        starts += list(failures.T)
        estimates.append(subset)
    searched = form(margin, at.space.size, starts)
    if searched.points:
        shifted = importance_sampling(
            margin, at.space.size, searched.points, seed=seed, samples=IMPORTANCE_SAMPLES, confidence=confidence
        )
        estimates.insert(1, shifted)
    contradictions = disagreements(estimates, searched)
    best, resolved = chosen(estimates)
    return SpecificationReliability(
        specification=specification,
        estimates=tuple(estimates),
        best=best,
        resolved=resolved,
        form=searched,
        failures=tuple(_told(at, layout, point) for point in searched.points[:LISTED]),
        disagreements=contradictions,
    )


def plain_estimate(failures: int, samples: int, confidence: float) -> Estimate:
    """Return plain sampling's estimate with its Clopper-Pearson interval."""
    share = failures / samples
    variation = math.sqrt((1 - share) / failures) if failures else math.inf
    enough = variation <= LARGEST_VARIATION
    note = "" if enough else f"not resolved: {failures} failures among {samples:,} samples"
    interval = clopper_pearson(failures, samples, confidence)
    return Estimate("sampling", share, interval, variation, samples, enough, note)


def chosen(estimates: Sequence[Estimate]) -> tuple[Estimate, bool]:
    """Return the estimate to go by, and whether it is resolved.

    Plain sampling where it varies by at most a tenth; else the surest of the resolved ones, provided that they do not
    contradict each other or the samples; else plain sampling again, whose interval always holds.
    """
    plain = estimates[0]
    if plain.variation <= ENOUGH_VARIATION:
        return plain, True
    candidates = [estimate for estimate in estimates if estimate.resolved]
    if not candidates or any(not _agree(a, b) for a in (plain, *candidates) for b in candidates):
        return plain, False
    return min(candidates, key=lambda estimate: estimate.variation), True


def disagreements(estimates: Sequence[Estimate], searched: Form) -> tuple[str, ...]:
    """Return which resolved estimates contradict each other, and where FORM lies outside plain sampling's or the best."""
    lines = []
    checked = [estimate for estimate in estimates if estimate.resolved or estimate.method == "sampling"]
    for k, one in enumerate(checked):
        for other in checked[k + 1 :]:
            if not _agree(one, other):
                lines.append(
                    f"{one.method} ({_range(one.interval)}) and {other.method} ({_range(other.interval)}) disagree"
                )
    best, resolved = chosen(estimates)
    span = searched.range
    if resolved and span is None:
        lines.append(f"FORM found no failure within {FARTHEST} standard deviations, {best.method} did")
    elif span is not None and (span[0] > best.interval[1] or span[1] < best.interval[0]):
        which = f"FORM ({span[0]:.3g})" if span[0] == span[1] else f"FORM ({_range(span)} for all its design points)"
        lines.append(
            f"{which} lies outside the interval of {best.method} ({_range(best.interval)}): the failure surface is curved"
        )
    return tuple(lines)


def _agree(one: Estimate, other: Estimate) -> bool:
    """Return whether two estimates differ by at most three standard errors of their difference.

    Where one has none, because no failure was met, their intervals must overlap.
    """
    if one.probability and other.probability:
        error = math.hypot(one.probability * one.variation, other.probability * other.variation)
        return abs(one.probability - other.probability) <= 3 * error
    return one.interval[0] <= other.interval[1] and other.interval[0] <= one.interval[1]


def _range(interval: tuple[float, float]) -> str:
    return f"{interval[0]:.3g} to {interval[1]:.3g}"


def _told(at: PoseModel, layout: kernel.CompiledTable, point: DesignPoint) -> LikelyFailure:
    """Return a design point in the terms of the model: parameters, error, importance of each draw."""
    x = from_normals(at.space, point.u[:, None])
    groups = {draw.name: draw.name for draw in at.space.draws}
    for correlation in at.space.correlations:
        groups |= dict.fromkeys(correlation.names, " + ".join(correlation.names))
    shares: dict[str, float] = {}
    for draw, columns in zip(at.space.draws, at.space.slices, strict=True):
        name = groups[draw.name]
        shares[name] = shares.get(name, 0.0) + float(point.importance[columns].sum())
    return LikelyFailure(
        beta=point.beta,
        probability=point.probability,
        parameters=dict(zip(at.space.components, map(float, x[:, 0]), strict=True)),
        error=kernel.errors_at(layout, "exact", x)[:, 0],
        importance=dict(sorted(shares.items(), key=lambda entry: -entry[1])),
    )
