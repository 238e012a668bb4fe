"""Worst case: the largest pose error if all draws take their worst values at once.

The first-order model e = e0 + J (x - x̄) over the supports of the draws has a certified upper bound. A search of the exact
model gives a lower bound. Reads the term table and the tangent only.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.arguments import check_request
from precision_pin.analyses.provenance import Pose, PoseLabel, Poses, Provenance
from precision_pin.analyses.result import list_warnings
from precision_pin.analyses.worst_case.convex_bodies import Supports
from precision_pin.analyses.worst_case.largest_norm import Farthest, farthest, quadratic_bound
from precision_pin.analyses.worst_case.worst_case_result import (
    ComponentBound,
    Contribution,
    ExactMaximum,
    NormBound,
    PoseWorstCase,
    WorstCaseResult,
)
from precision_pin.base.arrays import Array
from precision_pin.base.call_warnings import warns_at_end
from precision_pin.base.errors import Finding, InputError
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.model.statics_findings import side_variants, turnover_findings
from precision_pin.render.display_units import WrittenUnit
from precision_pin.sampling import Progress, check_samples, monte_carlo
from precision_pin.statistics import Distribution

MOST_KEPT: Final = 1_000_000
"""Largest number of samples of which the largest error is a starting point of the search of the exact model."""

MOST_NUMBERS: Final = 10_000
"""Largest number of random numbers: the time of the search grows with their square."""

_COMPONENTS: Final = tuple(f"{vector}.{axis}" for vector in ("position", "attitude") for axis in "xyz")
_NORMS: Final = {"position.norm": slice(0, 3), "attitude.norm": slice(3, 6)}
_EXCHANGES: Final = 100
_STEP: Final = 1e-4
_GAIN: Final = 1e-12
# largest number of components, 8 bytes each, in one evaluation of the exact model
_NUMBERS_AT_ONCE: Final = 2**22


@warns_at_end
def worst_case(
    error_model: ErrorModel,
    /,
    pose: Poses = None,
    *,
    poses: Poses = None,
    q: Poses = None,
    seed: int = 0,
    samples: int = 100_000,
    k: float = 3.0,
    confidence: float = 0.95,
    findings: Sequence[Finding] = (),
    progress: Progress | bool | None = None,
) -> WorstCaseResult:
    """Bound the error of the first-order model over the supports of the draws, and search the exact model.

    A component i lies within e0ᵢ ± h(± Jᵀeᵢ), with h the sum of the draws' support functions. The norm is at most the
    largest u·e0 + h(Jᵀu) over unit vectors u, found globally by branch and bound; see
    :mod:`precision_pin.analyses.worst_case.largest_norm`. Where the load of each robot decides on which side a play is taken
    up, the bound is the largest over all sides, possible for one robot or not.

    Args:
        error_model: Chain, draws and sources.
        pose, poses, q: A pose (a name, joint values, or None for the model's first) or a list of poses. The three
            arguments are synonyms.
        seed, samples, confidence: Seed, number and confidence of the samples of the exact model for comparison.
        k: Number of standard deviations at which unbounded laws are cut.
        findings: Warnings to include in the result, such as those of the sheet.
        progress: Function called with the number of samples added since its last call; ``True`` shows a bar.

    Raises:
        InputError: A wrong pose, seed, k or number of samples, an unbounded law that cannot be cut, or errors too large
            to compute.
    """
    chosen, known = check_request(
        error_model, (poses, q, pose), seed=seed, confidence=confidence, findings=findings, progress=progress
    )
    check_samples(samples)
    size = error_model.space.size
    if size > MOST_NUMBERS:
        raise InputError(
            f"a worst case of {size:,} random numbers needs {2 * size**2:.1g} numbers for each step of its search; "
            f"at most {MOST_NUMBERS:,} random numbers are allowed: merge draws"
        )
    supports = Supports.of(error_model.space, k)
    sampling = {"samples": samples, "seed": seed, "confidence": confidence, "progress": progress}
    found = [_at_pose(error_model, one, supports, sampling) for one in chosen]
    return WorstCaseResult(
        provenance=Provenance.of(error_model, seed),
        samples=int(samples),
        confidence=confidence,
        k=float(k),
        cut=supports.cut,
        draws=len(error_model.space.draws),
        poses=tuple(result for result, _ in found),
        findings=known,
        warnings=list_warnings(known, (line for _, lines in found for line in lines)),
    )


def _at_pose(
    error_model: ErrorModel, q: Pose, supports: Supports, sampling: Mapping[str, Any]
) -> tuple[PoseWorstCase, tuple[str, ...]]:
    analysis = monte_carlo(error_model, q, keep_samples=sampling["samples"] <= MOST_KEPT, **sampling)
    at = error_model.at(q)
    variants = side_variants(at)
    tangents = [variant.tangent for variant in variants]
    lows = np.min([error - supports.heights(-jacobian).sum(axis=0) for error, jacobian in tangents], axis=0)
    highs = np.max([error + supports.heights(jacobian).sum(axis=0) for error, jacobian in tangents], axis=0)
    components = []
    for quantity, low, high in zip(_COMPONENTS, lows.tolist(), highs.tolist(), strict=True):
        seen = analysis.summary.distribution(quantity)
        components.append(ComponentBound(quantity, low, high, (seen.min, seen.max)))
    layout = sampler.to_arrays(at)
    norms = []
    for quantity, rows in _NORMS.items():
        sampled = None
        if analysis.errors is not None:
            largest = int(np.linalg.norm(analysis.errors[rows], axis=0).argmax())
            sampled = at.space.sample(sampling["seed"], largest, 1)[:, 0]
        seen = analysis.summary.distribution(quantity)
        bounds = [_bound(variant, layout, supports, rows, seen, sampled) for variant in variants]
        norms.append(max(bounds, key=lambda bound: bound.first_order.upper))
    result = PoseWorstCase(PoseLabel.of(error_model, q, at), at.error_at_means, tuple(components), *norms)
    unbounded = turnover_findings(at) if len(variants) == 1 else ()
    return result, (*analysis.warnings, *map(str, unbounded))


def _bound(
    at: PoseModel, layout: SamplerArrays, supports: Supports, rows: slice, seen: Distribution, sampled: Array | None
) -> NormBound:
    error, jacobian = at.tangent[0][rows], at.tangent[1][rows]
    bound = farthest_error(error, jacobian, supports)
    weights = bound.direction @ jacobian
    shares = supports.heights(weights[None])[:, 0]
    x = at.space.mean + supports.points(weights[None])[0]
    exact = sampler.errors_at(layout, "exact", x[:, None])[:, 0]
    directions = np.concatenate([bound.direction[None], -bound.direction[None], np.eye(3), -np.eye(3)])
    starts = at.space.mean + supports.points(directions @ jacobian)
    if sampled is not None:
        inside = sampled if not supports.cut else _toward(layout, supports, rows, sampled[None])[0]
        starts = np.concatenate([starts, inside[None]])
    place, size = _climb(layout, supports, rows, starts)
    values, names = _written_values(at.space, x), at.space.components
    contributions = [
        Contribution(name, tuple(names[k] for k in columns), share, ", ".join(values[k] for k in columns))
        for name, columns, share in zip(supports.names, supports.columns, shares.tolist(), strict=True)
    ]
    return NormBound(
        quantity=seen.quantity,
        first_order=bound,
        nominal=float(bound.direction @ error),
        contributions=tuple(sorted(contributions, key=lambda entry: -entry.value)),
        parameters=dict(zip(names, x.tolist(), strict=True)),
        exact_error=exact,
        exact_norm=float(np.linalg.norm(exact[rows])),
        found=ExactMaximum(
            norm=size,
            error=sampler.errors_at(layout, "exact", place[:, None])[:, 0],
            parameters=dict(zip(names, place.tolist(), strict=True)),
            starts=len(starts),
        ),
        seen=seen,
    )


def farthest_error(error: Array, jacobian: Array, supports: Supports) -> Farthest:
    """Return the largest norm of e0 + J (x - x̄) over the supports.

    Args:
        error, jacobian: e0 ``(3,)`` and J ``(3, d)``.
        supports: Supports of the d components.
    """

    def heights(directions: Array) -> Array:
        return directions @ error + supports.heights(directions @ jacobian).sum(axis=0)

    def touch(directions: Array) -> Array:
        return error + supports.points(directions @ jacobian) @ jacobian.T

    def bound(direction: Array) -> float:
        centre, roots = error.copy(), []
        for body, columns in zip(supports.bodies, supports.columns, strict=True):
            if body.form is None:
                return np.inf
            middle, own = body.form
            centre += jacobian[:, columns] @ middle
            roots += [jacobian[:, columns] @ root for root in own]
        return quadratic_bound(centre, roots, direction)

    return farthest(heights, touch, bound)


def _climb(layout: SamplerArrays, supports: Supports, rows: slice, starts: Array) -> tuple[Array, float]:
    """Return the best point ``(d,)``, and |error| there, of local ascents of the exact model from ``(S, d)``.

    Each step moves the draws to their support points along the gradient (Frank-Wolfe with a full step): all of them, or, if
    that gives no increase, the one with the largest increase. Every point lies in the supports, of any form.
    """
    places, sizes = starts.copy(), _sizes(layout, rows, starts)
    groups = supports.columns
    for _ in range(_EXCHANGES if groups else 0):
        aims = _toward(layout, supports, rows, places)
        reached = _sizes(layout, rows, aims)
        better = reached > sizes * (1 + _GAIN)
        places[better], sizes[better] = aims[better], reached[better]
        improved = bool(better.any())
        for start in np.flatnonzero(~better):
            tried = np.empty(len(groups))
            for batch in _batches(len(groups), supports.space.size):
                single = np.repeat(places[start][None], batch.size, axis=0)
                for row, group in enumerate(batch.tolist()):
                    single[row, groups[group]] = aims[start, groups[group]]
                tried[batch] = _sizes(layout, rows, single)
            best = int(tried.argmax())
            if tried[best] > sizes[start] * (1 + _GAIN):
                places[start, groups[best]] = aims[start, groups[best]]
                sizes[start], improved = tried[best], True
        if not improved:
            break
    best = int(sizes.argmax())
    return places[best], float(sizes[best])


def _toward(layout: SamplerArrays, supports: Supports, rows: slice, places: Array) -> Array:
    """Return the points of the supports ``(S, d)`` farthest along the gradient of |error| at points ``(S, d)``."""
    mean = supports.space.mean
    low, high = (mean + end for end in supports.ends)
    # inside the supports, because a formula or a stiffness may be undefined outside
    inside = np.clip(places, low, high)
    step = _STEP * (high - low)
    upper, lower = np.minimum(inside + step, high), np.maximum(inside - step, low)
    sizes = np.empty((2, inside.size))
    for moved in _batches(inside.size, mean.size):
        start, column = np.divmod(moved, mean.size)
        for end, values in enumerate((upper, lower)):
            tried = inside[start]
            tried[np.arange(moved.size), column] = values[start, column]
            sizes[end, moved] = _sizes(layout, rows, tried)
    width = upper - lower
    slopes = np.divide((sizes[0] - sizes[1]).reshape(width.shape), width, out=np.zeros_like(width), where=width > 0)
    return mean + supports.points(slopes)


def _batches(count: int, size: int) -> Iterator[NDArray[np.intp]]:
    """Yield the numbers 0 … count - 1 of points with ``size`` components, in batches of limited memory."""
    at_once = max(_NUMBERS_AT_ONCE // max(size, 1), 1)
    for first in range(0, count, at_once):
        yield np.arange(first, min(first + at_once, count))


def _sizes(layout: SamplerArrays, rows: slice, places: Array) -> Array:
    return np.linalg.norm(sampler.errors_at(layout, "exact", places.T)[rows], axis=0)


def _written_values(space: Space, x: Array) -> list[str]:
    """Return component values with their units; plain numbers where the unit is unknown."""
    quantities = [quantity for draw in space.draws for quantity in draw.known_quantities]
    return [
        f"{value:.4g}" if quantity is None else WrittenUnit.suiting(quantity, [value]).short(value)
        for quantity, value in zip(quantities, x.tolist(), strict=True)
    ]
