"""Mean and covariance of the exact error with far fewer samples than plain sampling needs.

Two methods can be combined. *Control variate* (Hammersley and Handscomb, Monte Carlo Methods, 1964, chapter 5): mean
and covariance are known for a polynomial close to the exact error, the tangent with products of two numbers. Only the
difference of the exact model from it is sampled, on the same random numbers
(:mod:`precision_pin.analyses.moments.moments_control`). *Randomised quasi-Monte Carlo* (Owen, 1995): scrambled Sobol
points instead of random ones.

Samples form 32 independent replicates. With t the polynomial minus its mean, y the exact error minus that mean, g = y -
t, C the polynomial's covariance, and a bar for the mean over a replicate,

    mean       mean of the polynomial + average of ḡ
    covariance C + average of (t gᵀ + g tᵀ + g gᵀ)‾ - average over a ≠ b of (ȳ_a ȳ_bᵀ - t̄_a t̄_bᵀ)

The coefficient of the control is one: the polynomial is so close that an estimated coefficient would gain nothing and
make the estimate biased. The products of means of *different* replicates keep the covariance unbiased for Sobol points,
which depend on one another inside a replicate. Without control t is zero. Standard errors come from the jackknife
over replicates; intervals are Student's with 31 degrees of freedom, wider where the replicates are skewed
(:mod:`precision_pin.analyses.replicates`; L'Ecuyer, Nakayama, Owen and Tuffin, Winter Simulation Conference 2023, on
nets). An estimate that depends on tails or rare values beyond the samples is not resolved.

The closed form needs no samples, only derivatives at the means. Let the components be an affine map of numbers ζ with
mean 0 and covariance I, and f_k, f_kl, … the derivatives of the exact error with respect to ζ at 0. The Taylor series
gives (GUM, JCGM 100:2008, 5.1.2 note, continued to the fourth order)

    E f   = f + Σ f_kk/2 + Σ f_kkk s_k/6 + [Σ f_kkkk q_k + Σ_(k≠l) 3 f_kkll κ_kl]/24 + …
    Cov f = Σ f_k f_kᵀ + sym Σ f_k f_kkᵀ s_k/2
            + [Σ f_kk f_kkᵀ (q_k - 1) + Σ_(k≠l) (f_kk f_llᵀ (κ_kl - 1) + 2 f_kl f_klᵀ κ_kl)]/4
            + sym Σ f_k (f_kkk q_k + Σ_(l≠k) 3 f_kll κ_kl)ᵀ/6 + …

where sym A = A + Aᵀ, s_k = E ζ_k³, q_k = E ζ_k⁴ and κ_kl = E ζ_k² ζ_l²; all other moments up to the fourth must vanish.
First derivatives are the tangent's; higher ones are differences of exact errors at ½ and 1 standard deviation.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Final, Literal, NamedTuple, cast, get_args

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.moments.moments_control import STEP, Control, ErrorAround, Uncorrelated, thin
from precision_pin.analyses.provenance import Pose, PoseLabel, Poses, Provenance, check_request
from precision_pin.analyses.replicates import REPLICATES, Estimates, Marginals, jackknife, law_breaks, round_up_samples
from precision_pin.analyses.result import Result, answer_of, list_warnings, subject
from precision_pin.base.arguments import check_name
from precision_pin.base.arrays import Array, Keys, Record
from precision_pin.base.errors import Finding, InputError, add, warns_at_end
from precision_pin.base.progress import steps_to
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.model.equilibrium import fixed_sides, turnover_findings
from precision_pin.model.error_model import ErrorModel, takes_datum
from precision_pin.model.pose_model import PoseModel
from precision_pin.render.columns import QUANTITY, Column, text_lines
from precision_pin.render.tables import milli, plus_minus, symbol, unit
from precision_pin.sampling import Progress
from precision_pin.sampling.one_pose import model_at_pose
from precision_pin.sampling.verdict_grounds import exact_findings_at
from precision_pin.statistics import COMPONENTS, NORMS, QUANTITIES, Plan

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]


Method = Literal["control", "sobol", "sobol-control", "plain", "closed"]

ASSUMPTIONS: Final = (
    "exact model: the displaced chain multiplied out; the closed form is its expansion about the means",
    "a standard deviation's interval follows from that of its variance; intervals are for each number by itself",
    "null: not resolved (too few samples for tails or rare values of the laws), or not part of the method",
)

_WORDS: Final[dict[str, str]] = {
    "control": "random samples, a polynomial as control variate",
    "sobol": "32 scrambles of a Sobol net",
    "sobol-control": "32 scrambles of a Sobol net, a polynomial as control variate",
    "plain": "random samples",
    "closed": "closed form",
}


@dataclass(frozen=True, eq=False)
class Measured(Record):
    """Numbers of any shape, NaN if not resolved, with standard errors and half-widths of intervals, if sampled."""

    value: Array
    standard_error: Array | None = None
    half_width: Array | None = None

    def interval(self, *index: int) -> tuple[float, float] | None:
        """Return the interval of one of the numbers; ``None`` for a closed form and where not resolved."""
        if self.half_width is None or not np.isfinite(self.half_width[index]):
            return None
        middle, half = float(self.value[index]), float(self.half_width[index])
        return middle - half, middle + half


@dataclass(frozen=True, eq=False)
class Remainder(Record):
    """Range of validity of a closed form.

    Attributes:
        order: Order of the last terms, in powers of the spread: 4, or 2 where moments of the draws are unknown. The
            first omitted terms are of the next order; with symmetric laws, of the next even order.
        last_mean: ``(6,)`` terms of the mean beyond second order (at order 2: the second), a measure of those omitted,
            not a bound.
        last_covariance: ``(6, 6)`` terms of the covariance beyond J Σ Jᵀ; ``None`` at order 2.
    """

    order: int
    last_mean: Array
    last_covariance: Array | None


@dataclass(frozen=True, eq=False)
class PoseMoments(Record):
    """Moments at one pose, base axes.

    Attributes:
        nominal: ``(6,)`` error with every component at its mean.
        mean: ``(6,)`` mean of ``[d; δ]``, m and rad.
        covariance: ``(6, 6)`` covariance of ``[d; δ]``.
        norm_mean, norm_variance: ``(2,)`` mean and variance of |d| and |δ|, m and rad; ``None`` for a closed form.
        remainder: Measure of the terms that a closed form omits; ``None`` for samples.
        first_order_mean, first_order_covariance: ``(6,)`` mean and ``(6, 6)`` covariance of the first-order model.
        warnings: One line each.
    """

    KEYS: ClassVar[Keys] = (
        *("pose", "nominal", "mean", "std", "covariance", "bias", "first_order"),
        *("norm_mean", "norm_std", "norm_variance", "remainder", "warnings"),
    )

    pose: PoseLabel
    nominal: Array
    mean: Measured
    covariance: Measured
    norm_mean: Measured | None
    norm_variance: Measured | None
    remainder: Remainder | None
    first_order_mean: Array
    first_order_covariance: Array
    warnings: tuple[str, ...]

    @property
    def bias(self) -> Measured:
        """Mean of the exact error minus that of the first-order model, ``(6,)``."""
        return Measured(self.mean.value - self.first_order_mean, self.mean.standard_error, self.mean.half_width)

    @property
    def first_order_std(self) -> Array:
        """Standard deviations of the first-order model, ``(6,)``."""
        return np.asarray(np.sqrt(np.maximum(np.diagonal(self.first_order_covariance), 0.0)))

    @property
    def first_order(self) -> dict[str, Array]:
        """Mean, standard deviations and covariance of the first-order model."""
        return {"mean": self.first_order_mean, "std": self.first_order_std, "covariance": self.first_order_covariance}

    @property
    def variance(self) -> Measured:
        """Diagonal of the covariance, ``(6,)``."""
        covariance = self.covariance
        return Measured(
            np.diagonal(covariance.value).copy(),
            None if covariance.standard_error is None else np.diagonal(covariance.standard_error).copy(),
            None if covariance.half_width is None else np.diagonal(covariance.half_width).copy(),
        )

    @property
    def std(self) -> Measured:
        """Standard deviations of the components, ``(6,)``."""
        return deviations(self.variance)

    @property
    def norm_std(self) -> Measured | None:
        """Standard deviations of |d| and |δ|, ``(2,)``."""
        return None if self.norm_variance is None else deviations(self.norm_variance)


_Entry = tuple[float, tuple[float, float] | None] | None


class Moments(NamedTuple):
    """Moments of a quantity, m or rad, each with its interval; what only components have is None for a norm."""

    quantity: str
    mean: _Entry
    std: _Entry
    bias: _Entry = None
    first: float | None = None

    @property
    def ratio(self) -> float | None:
        """Exact standard deviation over that of the first order."""
        return self.std[0] / self.first if self.std and self.first and np.isfinite(self.std[0]) else None


def cell(entry: _Entry) -> str:
    """Return a number in mm or mrad with the half-width of its interval, as text."""
    if entry is None:
        return "-"
    value, interval = entry
    if np.isnan(value):
        return "-"
    half = 0.0 if interval is None else (interval[1] - interval[0]) / 2
    # digits below a picometre are meaningless
    return plus_minus(1e3 * value, 1e3 * half, decimals=9)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class MomentsResult(Result):
    """Mean and covariance of the exact error at one or several poses, computed by ``method``."""

    schema: ClassVar[str] = "precision-pin/moments/1"
    KEYS: ClassVar[Keys] = (
        *("*head", "model", "method", "samples", "confidence"),
        *("assumptions", "warnings", "findings", "poses"),
    )
    model: ClassVar[str] = "exact"

    COLUMNS: ClassVar = (
        *QUANTITY,
        Column("mean", cell, text="mean", notebook="mean", report="mean", frame="mean", has_interval=True),
        Column("bias", cell, text="bias", report="bias"),
        Column("std", cell, "std", "standard deviation", "standard deviation", "std", has_interval=True),
        Column("first", milli, report="standard deviation, first order"),
        Column("ratio", "{:.6g}".format, text="/ first order", report="exact / first order"),
    )

    method: Method
    poses: tuple[PoseMoments, ...]

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Assumptions of the numbers, one sentence each."""
        return ASSUMPTIONS

    def to_pandas(self) -> pandas.DataFrame:
        """Return the result as a data frame, m and rad, NaN where not available: a row for each pose and quantity.

        The columns are ``mean`` and ``std``, each with ``_lower`` and ``_upper``. ``attrs`` gives the settings.
        """
        return self._frame()

    def rows(self, pose: PoseMoments) -> list[Moments]:
        """Return the moments of the eight quantities."""

        def entry(measured: Measured | None, index: int) -> _Entry:
            return None if measured is None else (float(measured.value[index]), measured.interval(index))

        rows: dict[int, list[Any]] = {
            row: [entry(pose.norm_mean, index), entry(pose.norm_std, index)] for index, row in enumerate(NORMS)
        }
        for index, row in enumerate(COMPONENTS):
            rows[row] = [entry(estimates, index) for estimates in (pose.mean, pose.std, pose.bias)]
            rows[row].append(float(pose.first_order_std[index]))
        return [Moments(quantity, *rows[row]) for row, quantity in enumerate(QUANTITIES)]

    @property
    def summary(self) -> str:
        """Text of `repr`."""
        return f"poses {len(self.poses)}, {self.method}, {self.samples:,} samples, seed {self.provenance.seed}"

    def _title(self) -> str:
        return "Moments of the error"

    def _notes(self) -> list[str]:
        return [f"{self.how}; exact model, base axes, statics {self.provenance.statics}"]

    @property
    def how(self) -> str:
        """Method of computation and meaning of ±, as text."""
        if self.method == "closed":
            orders = sorted({pose.remainder.order for pose in self.poses if pose.remainder is not None})
            return f"{_WORDS[self.method]} up to order {' and '.join(map(str, orders))} in the spread"
        return (
            f"{_WORDS[self.method]}: {self.samples:,} in all, seed {self.provenance.seed}; ± half of an interval at "
            f"{100 * self.confidence:g} % confidence, - not resolved"
        )


def deviations(variance: Measured) -> Measured:
    """Return standard deviations with intervals from the intervals of the variances."""
    value = np.sqrt(np.maximum(variance.value, 0.0))
    if variance.standard_error is None or variance.half_width is None:
        return Measured(value)
    low, high = (np.sqrt(np.maximum(variance.value + sign * variance.half_width, 0.0)) for sign in (-1.0, 1.0))
    safe = np.where(value > 0, value, 1.0)
    error = np.where(value > 0, variance.standard_error / (2 * safe), np.sqrt(variance.standard_error))
    return Measured(value, error, np.maximum(high - value, value - low))


SMALLEST, LARGEST = 5, 19
"""Exponents of the numbers of samples in a replicate, 2⁵ to 2¹⁹."""

PILOT: Final = 1024
"""Separate samples for the regression of the norms on the control."""

MOST_NUMBERS: Final = 21_201
"""Largest number of dimensions of scipy's Sobol net."""

_BLOCK: Final = 8192  # points of a net evaluated together
_BITS: Final = 30  # of each coordinate; half a unit of the last bit is added, so that no point is 0
_VECTORS: Final = (slice(0, 3), slice(3, 6))
_TRIANGLE: Final = np.triu_indices(3)
_ROUNDING: Final = 1e-14  # spread (m, rad) that counts as rounding


@warns_at_end
@takes_datum
def moments(
    model: ErrorModel,
    poses: Poses = None,
    *,
    samples: int = 65_536,
    seed: int = 0,
    method: Method = "control",
    confidence: float = 0.95,
    findings: Sequence[Finding] = (),
    progress: Progress | bool | None = None,
) -> MomentsResult:
    """Return mean and covariance of the exact error, and mean and variance of its norms, with their errors.

    Args:
        model: Chain, draws and sources.
        poses: A pose (name, joint values, or None for the first) or a list of poses.
        samples: Number of samples at each pose, rounded up to 32 replicates of a power of two from 32 to 2¹⁹.
        seed: 64-bit seed. The random samples are units 0, 1, … as in :func:`precision_pin.monte_carlo`.
        method: ``"control"``: random samples, with the tangent and the most important products as control variate.
            ``"sobol"``: scrambled Sobol points, with the inverse of every law. ``"sobol-control"``: both. ``"plain"``:
            random samples only. ``"closed"``: no samples, but Taylor terms up to the fourth order in the spread, see
            :mod:`precision_pin.analyses.moments.moments`.
        confidence: Confidence of each single interval.
        findings: Warnings to include in the result, such as those of the sheet.
        progress: Function called with the number of samples added since its last call; ``True`` shows a bar.

    Raises:
        InputError: A wrong argument; errors too large to compute with; too many random numbers for a Sobol net.
        UnknownNameError: There is no such method.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> pose = pp.moments(model, method="closed").poses[0]
        >>> print((1e3 * pose.mean.value[:3]).round(3))
        [  7.692  28.344 -22.123]
    """
    pose_list, findings = check_request(
        model, poses, seed=seed, confidence=confidence, findings=findings, progress=progress
    )
    check_name("method", method, get_args(Method))
    size, rounding = round_up_total(samples)
    if method == "closed":
        size, rounding = 0, []
    add(rounding)
    if method.startswith("sobol") and model.space.size > MOST_NUMBERS:
        raise InputError(
            f"the model has {model.space.size:,} random numbers, a Sobol net at most {MOST_NUMBERS:,} dimensions; "
            "use method 'control'"
        )
    with steps_to(progress, count_steps(model.space, len(pose_list), size, method)) as step:
        settings = (method, size // REPLICATES, int(seed), confidence, step)
        entries = tuple(_at_pose(model, pose, *settings) for pose in pose_list)
    return MomentsResult(
        provenance=Provenance.of(model, seed),
        method=method,
        samples=size,
        confidence=float(confidence),
        poses=entries,
        findings=findings,
        warnings=list_warnings(
            findings, (*map(str, rounding), *(line for entry in entries for line in entry.warnings))
        ),
    )


def count_steps(space: Space, poses: int, samples: int, method: Method, **options: object) -> int:
    """Return the number of progress steps of the moments."""
    del space, options
    return 0 if method == "closed" else round_up_total(samples)[0] * poses


round_up_total: Final = partial(round_up_samples, smallest=SMALLEST, largest=LARGEST)
"""Return the number of samples of all replicates, and a warning if it was rounded up."""


def _at_pose(
    error_model: ErrorModel, pose: Pose, method: Method, count: int, seed: int, confidence: float, step: Progress
) -> PoseMoments:
    model = model_at_pose(error_model, pose)
    nominal, covariance = model.error_at_means, model.covariance
    plan = Plan.from_moments(nominal, covariance)
    norm_mean = norm_variance = remainder = None
    if method == "closed":
        # differences of exact errors would run across the jump of a side
        *closed, remainder = _closed_moments(fixed_sides(model))
        mean, covariance_found = map(Measured, closed)
    else:
        sampled = _Sampled(model, plan.centre[list(NORMS)], method, count, seed, step)
        mean, covariance_found, norm_mean, norm_variance = sampled.estimates(confidence)
    findings = (
        *model.findings("exact"), *error_model.statics_findings(model), *turnover_findings(model),
        *exact_findings_at(error_model, model),
    )  # fmt: skip
    return PoseMoments(
        pose=PoseLabel.of(error_model, pose, model),
        nominal=nominal.copy(),
        mean=mean,
        covariance=covariance_found,
        norm_mean=norm_mean,
        norm_variance=norm_variance,
        remainder=remainder,
        first_order_mean=model.tangent[0].copy(),
        first_order_covariance=covariance.copy(),
        warnings=tuple(map(str, findings)),
    )


class _Sampled:
    """Mean products of the rows 1, control t (6, if any), g or y (6) and centred norms (2) of every replicate."""

    def __init__(self, at: PoseModel, centre: Array, method: Method, count: int, seed: int, step: Progress) -> None:
        self._at = at
        self._layout = sampler.to_arrays(at)
        self._centre = centre
        self._count = count
        self._seed = seed
        self._net = method.startswith("sobol")
        self._control = Control.of(at) if method.endswith("control") else None
        size = 15 if self._control else 9
        totals = np.zeros((REPLICATES, size, size))
        for replicate in range(REPLICATES):
            for x, errors in self._blocks(replicate):
                rows = self._rows(x, errors)
                totals[replicate] += _gram(rows)
                step(errors.shape[1])
        self._products = totals / count
        self._norm_slopes = self._regress_norms(self._control) if self._control else np.zeros((2, 2, 9))

    def estimates(self, confidence: float) -> tuple[Measured, Measured, Measured, Measured]:
        """Return mean ``(6,)``, covariance ``(6, 6)``, mean and variance of the norms ``(2,)``."""
        raw = jackknife(self._statistic, confidence)
        raw = self._resolve(raw, confidence)
        pieces = [
            Measured(*(part.reshape(shape) for part in parts))
            for shape, *parts in zip(
                ((6,), (6, 6), (2,), (2,)),
                *(np.split(array, (6, 42, 44)) for array in (raw.value, raw.standard_error, raw.half_width)),
                strict=True,
            )
        ]
        return cast("tuple[Measured, Measured, Measured, Measured]", tuple(pieces))

    def _resolve(self, estimates: Estimates, confidence: float) -> Estimates:
        """Return the estimates ``(46,)`` with intervals that allow for the tails, NaN where they are not resolved."""
        space, values = self._at.space, estimates.value
        if not space.size:
            return estimates
        nodes = Marginals.of(space.size, self._count, is_net=self._net, breaks=law_breaks(space))
        marginals, rows = nodes.evaluate(self._rows_of)
        remainders, norms = marginals.subtract_means(rows[-8:-2]), rows[-2:]
        squares = remainders[:, None] * remainders
        if self._control:
            tangent = rows[1:7]
            products = tangent[:, None] * tangent
            crossed = tangent[:, None] * remainders
            squares = squares + crossed + crossed.swapaxes(0, 1)
            controls = _controls(tangent.T, np.moveaxis(products, 2, 0) - self._control.covariance)
            norms = norms - np.einsum("vc,mvc->vm", self._norm_slopes[:, 0], controls)
            deviations = np.einsum("vc,mvc->vm", self._norm_slopes[:, 1], controls)
        else:
            deviations = np.zeros_like(norms)
        # contributions to the variance of a norm are squares about its mean
        about = (rows[-2:] ** 2 - deviations) - 2 * (values[42:44] - self._centre)[:, None] * norms
        contributions = np.concatenate([remainders, squares.reshape(36, -1), norms, about])
        variances = np.maximum(np.concatenate([values[6:42:7], values[44:]]), 0.0)
        std = np.sqrt(variances)
        scale = np.concatenate([std[:6], np.outer(std[:6], std[:6]).ravel(), std[6:], variances[6:]])
        return marginals.resolve(estimates, contributions, scale, confidence)

    def _rows_of(self, uniforms: Array) -> Array:
        """Return the rows at uniform numbers ``(d, N)``."""
        x = self._at.space.inverse(uniforms)
        return self._rows(x, sampler.errors_at(self._layout, "exact", x))

    def _statistic(self, is_used: NDArray[np.bool_]) -> Array:
        products = self._products[is_used]
        sums = products[:, 0]
        remainders, norms = sums[:, -8:-2], sums[:, -2:]
        mean = (self._control.mean if self._control else self._at.error_at_means) + remainders.mean(axis=0)
        covariance = products[:, -8:-2, -8:-2].mean(axis=0)
        squares = products[:, [-2, -1], [-2, -1]]
        if self._control:
            tangent = sums[:, 1:7]
            mixed = products[:, 1:7, -8:-2].mean(axis=0)
            covariance = covariance + mixed + mixed.T + self._control.covariance
            covariance = covariance - _average_cross_products(tangent + remainders) + _average_cross_products(tangent)
            deviations = _controls(tangent, products[:, 1:7, 1:7] - self._control.covariance)
            # the known deviations of a replicate's t and t tᵀ from their means correct the norms and their squares
            norms = norms - np.einsum("vc,rvc->rv", self._norm_slopes[:, 0], deviations)
            squares = squares - np.einsum("vc,rvc->rv", self._norm_slopes[:, 1], deviations)
        else:
            covariance = covariance - _average_cross_products(remainders)
        covariance = (covariance + covariance.T) / 2
        variance = squares.mean(axis=0) - np.diagonal(_average_cross_products(norms))
        return np.concatenate([mean, covariance.ravel(), self._centre + norms.mean(axis=0), variance])

    def _regress_norms(self, control: Control) -> Array:
        """Return the slopes of the norms and their squares to t and t tᵀ, ``(2 vectors, 2, 9)``.

        The regression uses separate samples: coefficients from the samples themselves would bias the estimate.
        """
        x = sampler.sample(self._layout, self._seed, REPLICATES * self._count, PILOT)
        rows = self._rows(x, sampler.errors_at(self._layout, "exact", x))
        tangent, norms = rows[1:7].T, rows[-2:]
        controls = _controls(tangent, tangent[:, :, None] * tangent[:, None, :] - control.covariance)
        result = np.zeros((2, 2, 9))
        for vector, norm in enumerate(norms):
            spread = controls[:, vector].std(axis=0)
            # t and t tᵀ are scaled to unit spread; spreads that are rounding are left out
            smallest = np.repeat([_ROUNDING, _ROUNDING**2], (3, 6))
            scale = np.where(spread > smallest, spread, np.inf)
            design = np.column_stack([np.ones(PILOT), controls[:, vector] / scale])
            targets = np.column_stack([norm, norm**2])
            solution = np.linalg.lstsq(design, targets, rcond=1e-9)[0]
            result[vector] = solution[1:].T / scale
        return result

    def _blocks(self, replicate: int) -> Iterator[tuple[Array | None, Array]]:
        """Yield components and errors, ``(d, N)`` and ``(6, N)``; no components where they are not needed."""
        size = self._at.space.size
        points = self._points(replicate) if self._net and size else None
        for first in range(0, self._count, _BLOCK):
            count = min(_BLOCK, self._count - first)
            unit = replicate * self._count + first
            if points is not None:
                x = self._at.space.inverse(next(points))
            elif self._control:
                x = sampler.sample(self._layout, self._seed, unit, count)
            else:
                yield None, sampler.errors(self._layout, "exact", self._seed, unit, count)
                continue
            yield x, sampler.errors_at(self._layout, "exact", x)

    def _points(self, replicate: int) -> Iterator[Array]:
        """Yield the points of one scramble, ``(d, N)`` inside (0, 1)."""
        # imported here, because it takes half a second and only these methods need it
        from scipy.stats import qmc

        # seed is accepted by every scipy since 1.14; the newer keyword rng is not
        generator = np.random.default_rng([self._seed, replicate])
        net = qmc.Sobol(self._at.space.size, scramble=True, bits=_BITS, seed=generator)
        while True:
            points = net.random(min(_BLOCK, self._count)).T + 0.5**_BITS / 2
            yield np.ascontiguousarray(points)

    def _rows(self, x: Array | None, errors: Array) -> Array:
        """Return the rows whose products are averaged, ``(9 or 15, N)``."""
        rows = np.empty((15 if self._control else 9, errors.shape[1]))
        rows[0] = 1.0
        np.subtract(errors, self._at.error_at_means[:, None], out=rows[-8:-2])
        if self._control and x is not None:
            rows[1:7] = self._control.deviations(x)
            rows[-8:-2] -= rows[1:7] + (self._control.mean - self._at.error_at_means)[:, None]
        for row, vector in enumerate(_VECTORS, start=-2):
            rows[row] = np.sqrt((errors[vector] ** 2).sum(axis=0)) - self._centre[row]
        return rows


def _average_cross_products(means: Array) -> Array:
    """Return the average of m_a m_bᵀ over a ≠ b, ``(k, k)``, for ``(R, k)``: an unbiased estimate of E m (E m)ᵀ."""
    count = len(means)
    total = means.sum(axis=0)
    return np.asarray((np.outer(total, total) - means.T @ means) / (count * (count - 1)))


def _gram(rows: Array) -> Array:
    result = np.zeros((len(rows), len(rows)))
    for columns in thin(rows.shape[1], result.size):
        result += rows[:, columns] @ rows[:, columns].T
    return result


def _controls(means: Array, d: Array) -> Array:
    """Return t and t tᵀ minus its mean for both vectors, ``(R, 2, 9)``, from ``(R, 6)`` and ``(R, 6, 6)``."""
    parts = [
        np.concatenate([means[:, rows], d[:, rows, rows][:, _TRIANGLE[0], _TRIANGLE[1]]], axis=1) for rows in _VECTORS
    ]
    return np.stack(parts, axis=1)


def _closed_moments(at: PoseModel) -> tuple[Array, Array, Remainder]:
    """Return mean ``(6,)`` and covariance ``(6, 6)`` of the exact error at a pose from the truncated series."""
    numbers = Uncorrelated.of(at.space)
    exact = ErrorAround(at)
    middle = exact.at(np.zeros((at.space.size, 1)))[:, 0]
    near = [exact.at(sign * STEP * numbers.columns) for sign in (1, -1)]
    far = [exact.at(sign * 2 * STEP * numbers.columns) for sign in (1, -1)]
    # five points, because the error of three points would be of the fourth order
    second = (16 * (near[0] + near[1]) - (far[0] + far[1]) - 30 * middle[:, None]) / (12 * STEP**2)
    curved = second.sum(axis=1) / 2
    if not numbers.known.all():
        return middle + curved, at.covariance.copy(), Remainder(2, curved, None)
    first = at.jacobian @ numbers.columns
    third = (far[0] - 2 * near[0] + 2 * near[1] - far[1]) / (2 * STEP**3)
    fourth = (far[0] - 4 * near[0] + 6 * middle[:, None] - 4 * near[1] + far[1]) / STEP**4
    skewness, kurtosis = numbers.third, numbers.fourth
    pairs = numbers.pairs - 1
    np.fill_diagonal(pairs, kurtosis - 1)
    last_mean = third @ skewness / 6 + fourth @ kurtosis / 24
    second_order = second @ pairs @ second.T / 4
    slopes = third * kurtosis
    for k in range(numbers.size - 1):
        higher = np.arange(k + 1, numbers.size)
        step, steps = STEP * numbers.columns[:, [k]], STEP * numbers.columns[:, higher]
        corner_errors = exact.at(np.concatenate([step + steps, step - steps, -step + steps, -step - steps], axis=1))
        pp, pm, mp, mm = np.split(corner_errors, 4, axis=1)
        plus, minus = near[0][:, [k]], near[1][:, [k]]
        mixed = (pp - pm - mp + mm) / (4 * STEP**2)
        weight = numbers.pairs[k, higher]
        # each pair is visited once, not in both orders
        second_order += (mixed * weight) @ mixed.T
        slopes[:, k] += 3 * (((pp + pm - 2 * plus) - (mp + mm - 2 * minus)) / (2 * STEP**3)) @ weight
        bend = (pp + mp - 2 * near[0][:, higher]) - (pm + mm - 2 * near[1][:, higher])
        slopes[:, higher] += 3 * weight * bend / (2 * STEP**3)
        edge_sum = plus + minus + near[0][:, higher] + near[1][:, higher]
        last_mean += ((pp + pm + mp + mm - 2 * edge_sum + 4 * middle[:, None]) / STEP**4) @ weight / 4
    products = first @ (second * skewness / 2 + slopes / 6).T
    second_order += products + products.T
    second_order = (second_order + second_order.T) / 2
    return middle + curved + last_mean, at.covariance + second_order, Remainder(4, last_mean, second_order)


def table(result: MomentsResult) -> str:
    """Return mean, bias and standard deviation of every quantity at every pose, mm and mrad, and to first order."""
    sizes = [float(np.linalg.norm(pose.first_order_std[:3])) for pose in result.poses]
    blocks = [
        answer_of([pose.pose for pose in result.poses], sizes, [_answer(result.rows(pose)) for pose in result.poses])
    ]
    for pose in result.poses:
        method = f"{result.how}; statics {result.provenance.statics}; errors in base axes"
        lines = text_lines(result.COLUMNS, result.rows(pose))
        blocks.append("\n".join([subject(result.provenance, pose.pose), method, "", *lines]))
    blocks.append("bias: mean of the exact model less that of the first order; / first order: ratio of the stds")
    return "\n\n".join(blocks)


def _answer(rows: Sequence[Moments]) -> str:
    parts = []
    for moments in (rows[k] for k in NORMS):
        si = unit(moments.quantity)
        parts.append(f"{symbol(moments.quantity)} mean {cell(moments.mean)} {si}, std {cell(moments.std)} {si}")
    return "; ".join(parts)
