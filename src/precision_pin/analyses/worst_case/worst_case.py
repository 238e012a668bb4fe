"""Worst case: the largest pose error if all draws take their worst values at once.

The first-order model e0 + J (x - x̄) has a certified upper bound, a search of the exact model gives a lower bound.

The supports of the draws are bounded convex bodies about their means. The support function of a body K is h(w) = max w·x
over x in K. The maximiser x, the support point, is the gradient of h (Rockafellar, Convex Analysis, 1970, corollary
23.5.3). Unbounded laws are cut at k standard deviations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from precision_pin.analyses.provenance import Pose, PoseLabel, Poses, Provenance, check_request
from precision_pin.analyses.result import Result, list_warnings
from precision_pin.analyses.supports import Supports
from precision_pin.base.arrays import Array, Fixed, Keys, Record
from precision_pin.base.errors import Finding, InputError, warns_at_end
from precision_pin.base.written_units import WrittenUnit
from precision_pin.kernel import sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.model.equilibrium import side_variants, turnover_findings
from precision_pin.model.error_model import ErrorModel, takes_datum
from precision_pin.model.pose_model import PoseModel
from precision_pin.render.columns import QUANTITY, Column
from precision_pin.render.tables import milli
from precision_pin.sampling import Progress, check_samples, monte_carlo
from precision_pin.statistics import QUANTITIES, Distribution
from precision_pin.statistics.intervals import round_end

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]

SEEN_LEVEL: Final = 0.9973
"""Probability of the sampled quantile that is shown with the bound."""

BENT: Final = 1e-3
"""Relative excess of the exact model over the bound that causes no warning."""

_ROUNDING: Final = 1e-14  # error (m, rad) that counts as rounding


@dataclass(frozen=True)
class Contribution:
    """Contribution of a draw to the worst first-order error of a norm.

    Attributes:
        draw: Name of the draw; names of correlated normal draws are joined by commas.
        components: Names of its numbers.
        value: Contribution, m or rad; not negative if the mean lies within the range of the draw.
        at: Values of its numbers at the worst case, with suitable units.
    """

    draw: str
    components: tuple[str, ...]
    value: float
    at: str


@dataclass(frozen=True)
class ComponentBound:
    """Bounds of a component of the first-order model (m or rad), and the smallest and largest sampled value."""

    quantity: str
    low: float
    high: float
    seen: tuple[float, float]
    # entries of |d| and |δ| only
    first_order: ClassVar = None
    exact_norm: ClassVar = None
    found: ClassVar = None

    @property
    def seen_ends(self) -> tuple[float, float]:
        """Smallest and largest sampled value."""
        return self.seen


@dataclass(frozen=True, eq=False)
class ExactMaximum(Record):
    """Largest error of the exact model found by local search, a lower bound of the maximum.

    Attributes:
        norm, error: |d| or |δ| (m, rad) and the whole error ``(6,)``.
        parameters, starts: Values of all components there, SI; number of starting points.
    """

    norm: float
    error: Array
    parameters: Mapping[str, float]
    starts: int


@dataclass(frozen=True, eq=False)
class NormBound(Record):
    """Worst case of |d| or |δ|.

    Attributes:
        quantity: ``"position.norm"`` or ``"attitude.norm"``.
        first_order: Largest norm of the first-order model, and the direction of that error.
        nominal: Contribution of the error at the means, u·e0 along that direction u (m, rad).
        contributions: Contribution of each draw, h(Jᵀu), largest first; with ``nominal`` they sum to the worst case.
        parameters: Values of the components at the worst case, SI.
        exact_error, exact_norm: ``(6,)`` error of the exact model at these values, and its norm.
        found: Largest error of the exact model found by the search.
        seen: Distribution of the samples; its ``max`` is the largest sampled value.
    """

    KEYS: ClassVar[Keys] = ("first_order=bound", "exact_there", "exact_found", "seen=sampled")

    quantity: str
    first_order: Farthest
    nominal: float
    contributions: tuple[Contribution, ...]
    parameters: Mapping[str, float]
    exact_error: Array
    exact_norm: float
    found: ExactMaximum
    seen: Distribution
    low: ClassVar = None

    @property
    def exceeded(self) -> bool:
        """Whether the exact model exceeds the first-order bound by more than a thousandth."""
        return self.found.norm > self.first_order.upper * (1 + BENT) + _ROUNDING

    @property
    def high(self) -> float:
        """The bound."""
        return self.first_order.upper

    @property
    def seen_ends(self) -> tuple[float, float]:
        """Smallest and largest sampled value."""
        return self.seen.min, self.seen.max

    @property
    def bound(self) -> dict[str, Any]:
        """Worst case of the first-order model, as in the JSON."""
        return {
            **{name: getattr(self.first_order, name) for name in ("lower", "upper", "certified", "cells", "direction")},
            "nominal": self.nominal,
            "contributions": {entry.draw: entry.value for entry in self.contributions},
            "parameters": self.parameters,
        }

    @property
    def exact_there(self) -> dict[str, Any]:
        """Error of the exact model at these parameters, as in the JSON."""
        return {"norm": self.exact_norm, "error": self.exact_error}

    @property
    def exact_found(self) -> dict[str, Any]:
        """Largest error that the search found, as in the JSON."""
        return self.found.to_dict() | {"exceeds_first_order": self.exceeded}

    @property
    def sampled(self) -> dict[str, Any]:
        """Samples, as in the JSON."""
        return {
            "max": self.seen.max,
            "quantile": {SEEN_LEVEL: self.seen.resolved_quantile(SEEN_LEVEL)},
            "quantile_interval": {SEEN_LEVEL: self.seen.quantile_interval(SEEN_LEVEL)},
        }


@dataclass(frozen=True, eq=False)
class PoseWorstCase(Record):
    """Worst case at one pose.

    Attributes:
        error_at_means: ``(6,)`` error at the means, e0.
        components: Bounds of the six components of the error.
        position, attitude: Worst cases of |d| and |δ|.
    """

    KEYS: ClassVar[Keys] = ("pose", "nominal", "components=bounds", "position", "attitude")

    pose: PoseLabel
    error_at_means: Array
    components: tuple[ComponentBound, ...]
    position: NormBound
    attitude: NormBound

    @property
    def nominal(self) -> dict[str, Array]:
        """Error of position and attitude at the means."""
        return {"position": self.error_at_means[:3], "attitude": self.error_at_means[3:]}

    @property
    def bounds(self) -> dict[str, Any]:
        """Bounds of the components, as in the JSON."""
        return {part.quantity: {"first_order": (part.low, part.high), "seen": part.seen} for part in self.components}


def bound_milli(value: float, *, up: bool = True, digits: int = 6) -> str:
    """Return a bound in mm or mrad as text, rounded outwards; ``-`` for none."""
    text = milli(value, digits)
    if text == "-" or (float(text) >= 1e3 * value if up else float(text) <= 1e3 * value):
        return text
    return f"{round_end(1e3 * value, digits, up=up):.{digits}g}"


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class WorstCaseResult(Result):
    """Worst case at one or several poses; ``cut`` are the draws whose laws were cut at ``k`` standard deviations."""

    schema: ClassVar[str] = "precision-pin/worst-case/1"
    KEYS: ClassVar[Keys] = (
        *("*head", "samples", "model", "confidence", "k", "cut", "assumptions", "warnings", "findings", "poses"),
    )
    model: ClassVar[str] = "exact"
    COLUMNS: ClassVar = (
        *QUANTITY,
        Column(
            "low",
            partial(bound_milli, up=False),
            "lowest, first order",
            "first order, from",
            "lowest, first order",
            "low",
        ),
        Column("high", bound_milli, "highest", "to", "highest, first order", "high"),
        Column("first_order.lower", frame="attained"),
        Column("exact_norm", frame="exact_there"),
        Column("found.norm", milli, notebook="exact, found", frame="exact_found"),
        Column(lambda entry: entry.seen_ends[0], milli, "smallest seen", "smallest seen", "smallest seen", "seen_min"),
        Column(lambda entry: entry.seen_ends[1], milli, "largest seen", "largest seen", "largest seen", "seen_max"),
    )

    k: float
    cut: tuple[str, ...]
    draws: int
    poses: tuple[PoseWorstCase, ...]

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Assumptions of the numbers, one sentence each."""
        return (
            "the bound is that of the first-order model about the means; the exact model may go beyond it",
            "the exact maximum is the largest that a local search found, a lower bound of the largest there is",
            self.say_cut(", ".join(self.cut)),
        )

    def say_cut(self, names: str) -> str:
        """Return where unbounded laws are cut, with the given names of them."""
        if not self.cut:
            return "every law is bounded"
        return f"unbounded laws are cut at k = {self.k:g} standard deviations, beyond which samples may lie: {names}"

    def to_pandas(self) -> pandas.DataFrame:
        """Return the result as a data frame, m and rad, NaN where not available: a row for each pose and quantity.

        ``low`` and ``high`` are the bounds of the first-order model (a norm has no ``low``), and ``attained`` is the
        largest norm that is proven to be reached. ``exact_there`` is the norm of the exact model at the same
        parameters, ``exact_found`` the largest norm found by the search (norms only). ``seen_min`` and ``seen_max`` are
        the smallest and largest sampled values. ``attrs`` gives the settings.
        """
        return self._frame()

    def rows(self, pose: PoseWorstCase) -> list[NormBound | ComponentBound]:
        """Return the bounds of the eight quantities."""
        bounds: list[NormBound | ComponentBound] = [pose.position, pose.attitude, *pose.components]
        return sorted(bounds, key=lambda bound: QUANTITIES.index(bound.quantity))

    @property
    def summary(self) -> str:
        """Text of `repr` after the arm."""
        largest = max(pose.position.first_order.upper for pose in self.poses)
        return (
            f"poses {len(self.poses)}, draws {self.draws}, first-order |d| at most {1e3 * largest:.4g} mm, "
            f"seed {self.provenance.seed}"
        )

    def _title(self) -> str:
        return "Worst case"

    def _notes(self) -> list[str]:
        run = self.provenance
        return [
            *self.assumptions,
            f"seen: among {self.samples:,} samples, seed {run.seed}, exact model, statics {run.statics}; base axes",
        ]


MOST_KEPT: Final = 1_000_000
"""Largest number of samples whose largest error is a starting point of the search of the exact model."""

MOST_NUMBERS: Final = 10_000
"""Largest number of random numbers: the time of the search grows with their square."""

_COMPONENTS: Final = tuple(f"{vector}.{axis}" for vector in ("position", "attitude") for axis in "xyz")
_NORMS: Final = {"position.norm": slice(0, 3), "attitude.norm": slice(3, 6)}
_EXCHANGES: Final = 100  # most steps of an ascent
_STEP: Final = 1e-4  # of the central differences, as a fraction of the width of the support
_GAIN: Final = 1e-12  # smallest relative increase of a step that is not rounding
# largest number of components, 8 bytes each, in one evaluation of the exact model
_NUMBERS_AT_ONCE: Final = 2**22


@warns_at_end
@takes_datum
def worst_case(
    model: ErrorModel,
    poses: Poses = None,
    *,
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
    :mod:`precision_pin.analyses.worst_case.worst_case`. Where each robot's load decides the side of a backlash, the
    bound is the largest over all combinations of sides, possible for one robot or not.

    Args:
        model: Chain, draws and sources.
        poses: A pose (name, joint values, or None for the first) or a list of poses.
        seed, samples, confidence: Seed, number and confidence of the samples of the exact model for comparison.
        k: Number of standard deviations at which unbounded laws are cut.
        findings: Warnings to include in the result, such as those of the sheet.
        progress: Function called with the number of samples added since its last call; ``True`` shows a bar.

    Raises:
        InputError: A wrong argument, an unbounded law that cannot be cut, or errors too large to compute with.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> bound = pp.worst_case(model, samples=1000).poses[0].position.first_order
        >>> print(round(1e3 * bound.upper, 1))
        46.6
    """
    pose_list, findings = check_request(
        model, poses, seed=seed, confidence=confidence, findings=findings, progress=progress
    )
    check_samples(samples)
    size = model.space.size
    if size > MOST_NUMBERS:
        raise InputError(
            f"a worst case of {size:,} random numbers needs {2 * size**2:.1g} numbers for each step of its search; "
            f"at most {MOST_NUMBERS:,} random numbers are allowed: merge draws"
        )
    supports = Supports.of(model.space, k)
    sampling = {"samples": samples, "seed": seed, "confidence": confidence, "progress": progress}
    entries = [_at_pose(model, pose, supports, sampling) for pose in pose_list]
    return WorstCaseResult(
        provenance=Provenance.of(model, seed),
        samples=int(samples),
        confidence=confidence,
        k=float(k),
        cut=supports.cut,
        draws=len(model.space.draws),
        poses=tuple(result for result, _ in entries),
        findings=findings,
        warnings=list_warnings(findings, (line for _, lines in entries for line in lines)),
    )


def _at_pose(
    error_model: ErrorModel, q: Pose, supports: Supports, sampling: Mapping[str, Any]
) -> tuple[PoseWorstCase, tuple[str, ...]]:
    analysis = monte_carlo(error_model, q, keep_samples=sampling["samples"] <= MOST_KEPT, **sampling)
    model = error_model.at(q)
    variants = side_variants(model)
    tangents = [variant.tangent for variant in variants]
    lows = np.min([error - supports.heights(-jacobian).sum(axis=0) for error, jacobian in tangents], axis=0)
    highs = np.max([error + supports.heights(jacobian).sum(axis=0) for error, jacobian in tangents], axis=0)
    sampled_laws = [analysis.summary.distribution(quantity) for quantity in _COMPONENTS]
    components = tuple(
        ComponentBound(seen.quantity, low, high, (seen.min, seen.max))
        for seen, low, high in zip(sampled_laws, lows.tolist(), highs.tolist(), strict=True)
    )
    layout = sampler.to_arrays(model)
    norms = []
    for quantity, rows in _NORMS.items():
        worst_sample = None
        if analysis.errors is not None:
            largest = int(np.linalg.norm(analysis.errors[rows], axis=0).argmax())
            worst_sample = model.space.sample(sampling["seed"], largest, 1)[:, 0]
        seen = analysis.summary.distribution(quantity)
        bounds = [_bound(variant, layout, supports, rows, seen, worst_sample) for variant in variants]
        norms.append(max(bounds, key=lambda bound: bound.first_order.upper))
    result = PoseWorstCase(PoseLabel.of(error_model, q, model), model.error_at_means, components, *norms)
    unbounded = turnover_findings(model) if len(variants) == 1 else ()
    return result, (*analysis.warnings, *map(str, unbounded))


def _bound(
    model: PoseModel, layout: SamplerArrays, supports: Supports, rows: slice, seen: Distribution, sample: Array | None
) -> NormBound:
    error, jacobian = model.tangent[0][rows], model.tangent[1][rows]
    bound = farthest_error(error, jacobian, supports)
    weights = bound.direction @ jacobian
    shares = supports.heights(weights[None])[:, 0]
    x = model.space.mean + supports.points(weights[None])[0]
    exact = sampler.errors_at(layout, "exact", x[:, None])[:, 0]
    directions = np.concatenate([bound.direction[None], -bound.direction[None], np.eye(3), -np.eye(3)])
    starts = model.space.mean + supports.points(directions @ jacobian)
    if sample is not None:
        start = sample if not supports.cut else _support_points(layout, supports, rows, sample[None])[0]
        starts = np.concatenate([starts, start[None]])
    place, size = _climb(layout, supports, rows, starts)
    names = model.space.components
    quantities = [quantity for draw in model.space.draws for quantity in draw.known_quantities]
    rounding = _SEARCH_ROUNDING * np.sqrt(model.space.block_covariance.variances)
    values = [
        f"{value:.4g}" if quantity is None else WrittenUnit.suiting(quantity, [value]).short(value)
        for quantity, value in zip(quantities, np.where(np.abs(x) > rounding, x, 0.0).tolist(), strict=True)
    ]
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
    """Return the largest norm of e0 + J (x - x̄) over the supports, for e0 ``(3,)`` and J ``(3, d)``."""

    def heights(directions: Array) -> Array:
        return directions @ error + supports.heights(directions @ jacobian).sum(axis=0)

    def touch(directions: Array) -> Array:
        return error + supports.points(directions @ jacobian) @ jacobian.T

    def bound(direction: Array) -> float:
        centre, roots = error.copy(), []
        for body, columns in zip(supports.bodies, supports.columns, strict=True):
            if body.form is None:
                return np.inf
            middle, root_list = body.form
            centre += jacobian[:, columns] @ middle
            roots += [jacobian[:, columns] @ root for root in root_list]
        return quadratic_bound(centre, roots, direction)

    return farthest(heights, touch, bound)


def _climb(layout: SamplerArrays, supports: Supports, rows: slice, starts: Array) -> tuple[Array, float]:
    """Return the best point ``(d,)``, and |error| there, of local ascents of the exact model from ``(S, d)``.

    Each step moves the draws to their support points along the gradient (Frank-Wolfe with a full step): all of them,
    or, if that gives no increase, the draw with the largest increase. Every point lies in the supports, of any form.
    """
    places, sizes = starts.copy(), _sizes(layout, rows, starts)
    groups = supports.columns
    for _ in range(_EXCHANGES if groups else 0):
        aims = _support_points(layout, supports, rows, places)
        aim_sizes = _sizes(layout, rows, aims)
        is_better = aim_sizes > sizes * (1 + _GAIN)
        places[is_better], sizes[is_better] = aims[is_better], aim_sizes[is_better]
        improved = bool(is_better.any())
        for start in np.flatnonzero(~is_better):
            trial_sizes = np.empty(len(groups))
            for batch in _batches(len(groups), supports.space.size):
                single = np.repeat(places[start][None], batch.size, axis=0)
                for row, group in enumerate(batch.tolist()):
                    single[row, groups[group]] = aims[start, groups[group]]
                trial_sizes[batch] = _sizes(layout, rows, single)
            largest = int(trial_sizes.argmax())
            if trial_sizes[largest] > sizes[start] * (1 + _GAIN):
                places[start, groups[largest]] = aims[start, groups[largest]]
                sizes[start], improved = trial_sizes[largest], True
        if not improved:
            break
    largest = int(sizes.argmax())
    return places[largest], float(sizes[largest])


def _support_points(layout: SamplerArrays, supports: Supports, rows: slice, places: Array) -> Array:
    """Return the points of the supports ``(S, d)`` farthest along the gradient of |error| at points ``(S, d)``."""
    mean = supports.space.mean
    low, high = (mean + side for side in supports.ends)
    # inside the supports, because a formula or a stiffness may be undefined outside
    clipped = np.clip(places, low, high)
    step = _STEP * (high - low)
    upper, lower = np.minimum(clipped + step, high), np.maximum(clipped - step, low)
    sizes = np.empty((2, clipped.size))
    for batch in _batches(clipped.size, mean.size):
        start, column = np.divmod(batch, mean.size)
        for side, values in enumerate((upper, lower)):
            trials = clipped[start]
            trials[np.arange(batch.size), column] = values[start, column]
            sizes[side, batch] = _sizes(layout, rows, trials)
    width = upper - lower
    slopes = np.divide((sizes[0] - sizes[1]).reshape(width.shape), width, out=np.zeros_like(width), where=width > 0)
    return mean + supports.points(slopes)


def _batches(count: int, size: int) -> Iterator[NDArray[np.intp]]:
    """Yield the indices of points with ``size`` components, in batches of limited memory."""
    at_once = max(_NUMBERS_AT_ONCE // max(size, 1), 1)
    for first in range(0, count, at_once):
        yield np.arange(first, min(first + at_once, count))


def _sizes(layout: SamplerArrays, rows: slice, places: Array) -> Array:
    return np.linalg.norm(sampler.errors_at(layout, "exact", places.T)[rows], axis=0)


TOLERANCE: Final = 1e-9
"""Largest relative difference between lower and upper bound of the result."""

MOST_CELLS: Final = 400_000
"""Largest number of triangles; the search then ends with the bounds reached."""

_SEARCH_ROUNDING: Final = 1e-12  # relative rounding error of the search, added to its bounds
_ASCENTS: Final = 500  # most steps of an ascent
_CHUNK: Final = 2**15  # directions evaluated together


@dataclass(frozen=True, eq=False)
class Farthest(Fixed):
    """Bounds of the largest |z| over a body.

    Attributes:
        direction: ``(3,)`` unit vector u to the farthest point found.
        lower, upper: Distance |z| of that point, and upper bound of all distances.
        cells: Number of spherical triangles evaluated; 0 where a bound in closed form was sufficient.
    """

    direction: Array
    lower: float
    upper: float
    cells: int

    @property
    def certified(self) -> bool:
        """Whether the bounds agree to a relative difference of 1e-9."""
        return self.upper <= self.lower * (1 + TOLERANCE)


def farthest(
    heights: Callable[[Array], Array],
    touch: Callable[[Array], Array],
    bound: Callable[[Array], float] = lambda direction: math.inf,
    *,
    most_cells: int = MOST_CELLS,
) -> Farthest:
    """Return the largest distance of a convex body from the origin.

    Args:
        heights: Support function: h(u) ``(N,)`` for directions u ``(N, 3)``.
        touch: Returns points of the body ``(N, 3)``, each the farthest along a direction; for the local ascent only.
        bound: Returns an upper bound of the largest |z|, given the direction of the best point found; infinite where
            unknown. The search is skipped if this bound is tight.
        most_cells: Number of triangles at which the search ends, with the largest bound of the remaining ones.
    """

    def search(directions: Array) -> Array:
        parts = [directions[k : k + _CHUNK] for k in range(0, len(directions), _CHUNK)]
        return np.concatenate([heights(part) for part in parts])

    def ascend(directions: Array) -> tuple[float, Array]:
        place = _ascend(touch, directions)
        return float(heights(place[None])[0]), place

    corners = _sphere()
    longest, direction = ascend(corners[:, 0])
    if longest <= 0:
        return Farthest(direction, 0.0, 0.0, 0)
    threshold = longest * (1 + TOLERANCE - 2 * _SEARCH_ROUNDING)
    ceiling = bound(direction)
    if ceiling <= threshold:
        return Farthest(direction, longest, max(longest, ceiling) * (1 + _SEARCH_ROUNDING), 0)
    values = search(corners.reshape(-1, 3)).reshape(-1, 3)
    discarded, cells = longest, 0
    while True:
        cells += len(corners)
        bounds = values.max(axis=1) / _plane_distance(corners)
        is_open = bounds > longest * (1 + TOLERANCE - 2 * _SEARCH_ROUNDING)
        discarded = max(discarded, float(bounds[~is_open].max(initial=0.0)))
        if not is_open.any() or cells + 4 * is_open.sum() > most_cells:
            upper = max(discarded, float(bounds[is_open].max(initial=0.0)))
            return Farthest(direction, longest, min(upper, ceiling) * (1 + _SEARCH_ROUNDING), cells)
        corners, values = _quarter(corners[is_open], values[is_open], search)
        if values.max() > longest:
            length, place = ascend(corners.reshape(-1, 3)[values.argmax()][None])
            if length > longest:
                longest, direction = length, place


def quadratic_bound(centre: Array, roots: list[Array], direction: Array) -> float:
    """Return an upper bound of max over |u| = 1 of u·centre + Σ |rootᵀ u|, tight for some bodies of high symmetry.

    Each norm is at most |rootᵀ u|²/(2t) + t/2, with equality for the norm t; here t is the norm in ``direction``,
    ``(3,)``. The bound is then the maximum of a quadratic function on the sphere. Its dual, min over λ of λ + ¼ cᵀ(λ -
    Q)⁻¹c, bounds this maximum tightly (Sorensen, SIAM Journal on Numerical Analysis 19, 1982). Roots are ``(3, p)``.
    """
    quadratic, constant = np.zeros((3, 3)), 0.0
    scale = max((float(np.abs(root).max(initial=0.0)) for root in roots), default=0.0)
    for root in roots:
        if not np.abs(root).max(initial=0.0) > 1e-15 * scale:
            constant += math.sqrt(float((root**2).sum()))
            continue
        t = float(np.linalg.norm(root.T @ direction))
        if t <= 1e-9 * scale:
            return math.inf
        quadratic += root @ root.T / (2 * t)
        constant += t / 2
    eigenvalues, vectors = np.linalg.eigh(quadratic)
    squares = (vectors.T @ centre) ** 2
    low = float((eigenvalues + np.sqrt(squares) / 2).max())
    high = float(eigenvalues.max() + math.sqrt(squares.sum()) / 2)
    for _ in range(200):
        middle = (low + high) / 2
        if not low < middle < high:
            break
        if (squares / (middle - eigenvalues) ** 2).sum() > 4:
            low = middle
        else:
            high = middle
    gaps = high - eigenvalues
    terms = np.divide(squares, gaps, out=np.zeros(3), where=gaps > 0)
    return float(constant + high + terms.sum() / 4) if (squares[gaps <= 0] == 0).all() else math.inf


def _ascend(touch: Callable[[Array], Array], directions: Array) -> Array:
    """Return the direction ``(3,)`` of the largest |z| reached by repeated steps to the farthest point along z/|z|.

    |z| never decreases, because the farthest point along z/|z| is at least as far as z.
    """
    longest = 0.0
    place: Array = directions[0]
    for _ in range(_ASCENTS):
        points = touch(directions)
        sizes = np.linalg.norm(points, axis=1)
        largest = int(sizes.argmax())
        if sizes[largest] <= longest * (1 + 1e-15):
            break
        longest, place = float(sizes[largest]), points[largest] / sizes[largest]
        moving = sizes > 0
        directions = points[moving] / sizes[moving, None]
    return place


def _sphere() -> Array:
    """Return spherical triangles that cover the sphere, ``(320, 3, 3)``: an icosahedron's, each in sixteen parts."""
    golden = (1 + math.sqrt(5)) / 2
    corners = np.array([[0, a, b * golden] for a in (-1, 1) for b in (-1, 1)])
    corners = np.concatenate([np.roll(corners, k, axis=1) for k in range(3)]) / math.hypot(1, golden)
    triangles: Array = corners[ConvexHull(corners).simplices]
    for _ in range(2):
        triangles, _ = _quarter(triangles, np.zeros(triangles.shape[:2]), lambda places: np.zeros(len(places)))
    return triangles


def _quarter(corners: Array, values: Array, heights: Callable[[Array], Array]) -> tuple[Array, Array]:
    """Return the triangles divided into four at the midpoints of their sides, and the values at the corners."""
    middles = corners + np.roll(corners, -1, axis=1)
    middles /= np.linalg.norm(middles, axis=2, keepdims=True)
    between = heights(middles.reshape(-1, 3)).reshape(-1, 3)
    (a, b, c), (ab, bc, ca) = np.moveaxis(corners, 1, 0), np.moveaxis(middles, 1, 0)
    (ha, hb, hc), (hab, hbc, hca) = values.T, between.T
    quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    heights_of = [(ha, hab, hca), (hab, hb, hbc), (hca, hbc, hc), (hab, hbc, hca)]
    return (
        np.concatenate([np.stack(quarter, axis=1) for quarter in quarters]),
        np.concatenate([np.stack(value, axis=1) for value in heights_of]),
    )


def _plane_distance(corners: Array) -> Array:
    """Return the distance from the origin of planes through three points of the unit sphere, by triangle sides."""
    sides = corners - np.roll(corners, -1, axis=1)
    squares = (sides**2).sum(axis=2)
    area = (np.cross(sides[:, 0], sides[:, 1]) ** 2).sum(axis=1)
    return np.sqrt(1 - squares.prod(axis=1) / (4 * area))
