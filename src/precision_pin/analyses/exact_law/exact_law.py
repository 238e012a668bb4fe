"""Exact law of the first-order model, including the tails, without sampling.

A component of the tangent model ``e0 + J (x - mean)`` is a sum of independent numbers, one for each draw; its law
follows from their characteristic functions (:mod:`precision_pin.analyses.number_law`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses import number_law
from precision_pin.analyses.provenance import Pose, PoseLabel, Poses, Provenance, check_request
from precision_pin.analyses.result import Result, answer_of, list_warnings, subject
from precision_pin.base.arguments import check_memory, check_whole
from precision_pin.base.arrays import Array, Keys, Record, encode
from precision_pin.base.errors import Finding, InputError, add, one_line, warns_at_end
from precision_pin.base.progress import steps_to
from precision_pin.draws.laws import Law
from precision_pin.draws.laws.projection import Projection
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.model.equilibrium import turnover_findings
from precision_pin.model.error_model import ErrorModel, takes_datum
from precision_pin.model.pose_model import PoseModel
from precision_pin.render.columns import QUANTITY, Column, text_lines
from precision_pin.render.tables import MOST_POSES, ROUNDING, milli, symbol
from precision_pin.sampling import Progress
from precision_pin.statistics import QUANTITIES, quantity_values
from precision_pin.statistics.intervals import bound_text

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]


LEVELS: Final = (0.00135, 0.01, 0.05, 0.5, 0.95, 0.99, 0.9973, 0.99865)

LEVELS_SHOWN: Final = (0.00135, 0.05, 0.5, 0.95, 0.9973, 0.99865)
"""Quantiles of the tables; the notebook has no room for the last."""


@final
@dataclass(frozen=True, eq=False)
class Agreement(Record):
    """Distance between samples of the tangent model and the exact law.

    Attributes:
        distance: Kolmogorov distance: largest difference of the cumulative laws, rounded up by at most ``slack``.
        band: Bound of the distance: √(ln(2/α)/2N) (Dvoretzky, Kiefer and Wolfowitz 1956; Massart 1990).
        confidence: Confidence 1 - α.
        slack: Largest excess of the stated distance.
        edges, counts: Histogram of the samples.
    """

    KEYS: ClassVar[Keys] = ("samples", "distance", "band", "confidence", "agrees")

    samples: int
    distance: float
    band: float
    confidence: float
    slack: float
    edges: Array
    counts: NDArray[np.intp]

    @property
    def agrees(self) -> bool:
        """True if the distance is within the band."""
        return self.distance - self.slack <= self.band

    @property
    def said(self) -> str:
        """The same as text."""
        return "within the band" if self.agrees else "BEYOND THE BAND"


@dataclass(frozen=True, eq=False)
class ExactLaw:
    """Law of one quantity.

    Attributes:
        quantity: ``position.x`` … ``attitude.z`` or a norm; m or rad, base axes.
        law: Object with ``cumulative``, ``density`` and ``quantile``; ``None`` if the law is not available.
        reason: Why the law is not available.
        mean, std: Mean and standard deviation; ``None`` for a norm that is not available.
        contributors: Number of contributing draws; all normal draws count as one.
        error: Bound of the error of every cumulative probability, at a number within rounding of the argument.
        quantiles, quantile_errors: Quantiles at :data:`LEVELS`, and the error bound of each.
        agreement: Agreement with samples of the tangent model.
    """

    quantity: str
    law: number_law.NumberLaw | None
    reason: str = ""
    mean: float | None = None
    std: float | None = None
    contributors: int = 0
    error: float = 0.0
    quantiles: tuple[float, ...] = ()
    quantile_errors: tuple[float, ...] = ()
    agreement: Agreement | None = None

    @property
    def curve(self) -> tuple[Array, Array, Array]:
        """Values from 4.5 standard deviations below the mean to 4.5 above, with density and cumulative law."""
        if self.law is None or self.mean is None or self.std is None:
            return np.zeros(0), np.zeros(0), np.zeros(0)
        low = max(self.mean - 4.5 * self.std, self.law.low)
        high = min(self.mean + 4.5 * self.std, self.law.high)
        x = np.linspace(low, high, 241)
        return x, self.law.density(x), self.law.cumulative(x)

    def shown_quantiles(self, digits: int) -> dict[float, tuple[float, int]]:
        """Return the quantiles by level, each with its number of certain digits, at most ``digits``."""
        return {
            level: (value, quantile_digits(value, error, digits))
            for level, value, error in zip(LEVELS, self.quantiles, self.quantile_errors, strict=False)
        }

    def to_dict(self) -> dict[str, Any]:
        """Return the entry of ``laws`` in the JSON, SI units; null where not available."""
        result: dict[str, Any] = {
            "mean": self.mean,
            "std": self.std,
            "contributors": self.contributors,
            "method": None if self.law is None else self.law.method,
            "not_available": self.reason or None,
        }
        if self.law is None or self.agreement is None:
            return result
        x, density, cumulative = self.curve
        return result | {
            "support": [self.law.low, self.law.high],
            "cumulative_error": self.error,
            "quantiles": {f"{p:g}": value for p, value in zip(LEVELS, self.quantiles, strict=True)},
            "quantile_error": {f"{p:g}": encode(error) for p, error in zip(LEVELS, self.quantile_errors, strict=True)},
            "agreement": self.agreement.to_dict(),
            "curve": encode({"value": x, "density": density, "cumulative": cumulative}),
        }


def _quantile_columns(level: float) -> list[Column]:
    """Return the columns of a quantile: to a millionth of the spread in the terminal, to six digits elsewhere."""
    rank, is_shown = LEVELS.index(level), level in LEVELS_SHOWN
    head, brief = f"{100 * level:g} %" if is_shown else None, f"{100 * level:.5g} %" if is_shown else None

    def certain(law: ExactLaw) -> str | None:
        quantile = law.shown_quantiles(12).get(level)
        return quantile and _milli(quantile[0], law.std or 0.0, quantile[1])

    return [
        Column(certain, text=head),
        Column(
            lambda law: law.shown_quantiles(6).get(level),
            lambda quantile: milli(*quantile),
            notebook=head if level != LEVELS_SHOWN[-1] else None,
            report=brief,
        ),
        Column(lambda law: law.law and law.quantiles[rank], frame=f"quantile_{level}"),
        Column(lambda law: law.law and law.quantile_errors[rank], frame=f"quantile_{level}_error"),
    ]


def _milli(value: float, std: float, most_digits: int = 12) -> str:
    """Return the value in thousandths, to a millionth of the spread, to at least seven and at most ``most`` digits."""
    if abs(value) <= ROUNDING:
        return "0"
    digits = 7 if std <= ROUNDING else min(12, max(7, math.ceil(math.log10(abs(value) / std) + 6)))
    return f"{1e3 * value:.{min(digits, most_digits)}g}"


LAW_COLUMNS: Final = (
    *QUANTITY,
    Column(lambda law: _milli(law.mean, law.std), text="mean"),
    Column(lambda law: _milli(law.std, law.std), text="std"),
    Column("mean", milli, notebook="mean", report="mean", frame="mean"),
    Column("std", milli, notebook="std", report="std", frame="std"),
    Column("contributors", frame="contributors"),
    Column(lambda law: law.law and law.error, frame="cumulative_error"),
    *(column for level in LEVELS for column in _quantile_columns(level)),
)
"""Columns of the table of moments and quantiles."""
METHOD_COLUMNS: Final = (
    Column("quantity", symbol, text="", report=""),
    Column("law.method", text="method", report="method", is_words=True),
    Column(lambda law: law.law and law.contributors, str, "draws", "draws", "draws"),
    Column(lambda law: law.law and law.error, bound_text, "error of F", "error of F", "error bound of F"),
    Column("agreement.distance", "{:.5f}".format, "distance", report="Kolmogorov distance", frame="distance"),
    Column("agreement.band", "{:.5f}".format, "band", report="band", frame="band"),
    Column("agreement.said", str, "samples", "samples", "samples", is_words=True),
)
"""Columns of the table of accuracy and agreement with samples."""


@dataclass(frozen=True, eq=False)
class PoseLaws(Record):
    """Laws of the eight quantities at one pose.

    Attributes:
        warnings: Quantities whose exact model does not follow the first-order law, one line each.
    """

    pose: PoseLabel
    laws: dict[str, ExactLaw]
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ExactLawResult(Result):
    """Exact laws at one or several poses; samples and confidence are those of the agreement."""

    schema: ClassVar[str] = "precision-pin/exact-law/1"
    KEYS: ClassVar[Keys] = ("*head", "model", "samples", "confidence", "assumptions", "warnings", "findings", "poses")
    model: ClassVar[str] = "tangent"
    ASSUMPTIONS: ClassVar[tuple[str, ...]] = (
        "first-order (tangent) model at the means of the draws",
        "the norm is available where all draws that matter are normal",
    )

    COLUMNS: ClassVar = (*LAW_COLUMNS, *METHOD_COLUMNS)

    poses: tuple[PoseLaws, ...]

    @property
    def agrees(self) -> bool:
        """True if every law agrees with its samples."""
        laws = [law for pose in self.poses for law in pose.laws.values()]
        return all(law.agreement.agrees for law in laws if law.agreement is not None)

    def to_pandas(self) -> pandas.DataFrame:
        """Return the result as a data frame, m and rad, NaN where not available: a row for each pose and quantity.

        The columns are ``mean``, ``std``, ``contributors``, ``cumulative_error``; ``quantile_0.95``, … with
        ``…_error``, its error bound; and ``distance`` and ``band`` of the samples. ``attrs`` gives the settings.
        """
        return self._frame()

    def rows(self, pose: PoseLaws) -> list[ExactLaw]:
        """Return the laws of the eight quantities."""
        return list(pose.laws.values())

    @property
    def summary(self) -> str:
        """Text of `repr` after the arm."""
        laws = [law for pose in self.poses for law in pose.laws.values()]
        count = sum(law.law is not None for law in laws)
        return (
            f"poses {len(self.poses)}, {count} of {len(laws)} laws known, "
            f"{'in agreement' if self.agrees else 'NOT in agreement'} with {self.samples:,} samples, "
            f"seed {self.provenance.seed}"
        )

    def _title(self) -> str:
        return "Exact law of the first-order model"

    def _notes(self) -> list[str]:
        run, poses = self.provenance, self.poses[:MOST_POSES]
        return [
            *dict.fromkeys(line for pose in poses for line in missing(pose.laws.values())),
            f"error of F: bound of the error of every cumulative probability; compared with {self.samples:,} samples of "
            f"the same model, seed {run.seed}, at {100 * self.confidence:g} % confidence; statics {run.statics}",
        ]


def missing(laws: Iterable[ExactLaw]) -> list[str]:
    """Return a line for each law that is not available, with the reason."""
    return [f"{symbol(law.quantity)}: {law.reason}" for law in laws if law.law is None]


def quantile_digits(value: float, error: float, digits: int) -> int:
    """Return the number of certain digits of a quantile, at most ``digits``."""
    if not value or not error:
        return digits
    return max(1, min(digits, math.floor(math.log10(abs(value))) - math.ceil(math.log10(2 * error)) + 1))


LARGEST_ERROR: Final = 1e-6
"""Largest certified error of the cumulative probabilities for which a law is given."""

MOST_SAMPLES: Final = 10_000_000


# samples drawn between two steps of the progress
_AT_ONCE: Final = 2**16

_NEGLIGIBLE: Final = 1e-12  # fraction of the standard deviation below which a part is omitted
_BINS: Final = 60  # of the comparison's histogram
_EFFORT: Final = 2e7  # evaluation cost of a law for the comparison; sets how many samples are compared
_NORMS: Final = {"position.norm": slice(0, 3), "attitude.norm": slice(3, 6)}


@warns_at_end
@takes_datum
def exact_law(
    model: ErrorModel,
    poses: Poses = None,
    *,
    seed: int = 0,
    samples: int = 100_000,
    confidence: float = 0.999,
    findings: Sequence[Finding] = (),
    progress: Progress | bool | None = None,
) -> ExactLawResult:
    """Return the law of every component of the first-order model, and of the norms where all draws are normal.

    Args:
        model: Chain, draws and sources.
        poses: A pose (name, joint values, or None for the first) or a list of poses.
        seed, samples, confidence: Seed, number and confidence of tangent-model samples for comparison.
        findings: Warnings to include in the result, such as those of the sheet.
        progress: Called with the samples drawn, then compared, since its last call; ``True`` shows a bar.

    Raises:
        InputError: A wrong pose, seed, number of samples or confidence; draws that are correlated and not normal.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> x = pp.exact_law(model, samples=1000).poses[0].laws["position.x"]
        >>> print(round(1e3 * x.law.quantile(0.9973), 4))
        14.7045
    """
    pose_list, findings = check_request(
        model, poses, seed=seed, confidence=confidence, findings=findings, progress=progress
    )
    check_whole("the number of samples", samples, 100, MOST_SAMPLES)
    _check_copulas(model.space)
    count = int(samples)
    with steps_to(progress, count_steps(model.space, len(pose_list), count)) as step:
        deviations = _deviations(model.space, seed, count, step)
        entries = []
        for pose in pose_list:
            entries.append(_at_pose(model, pose, deviations, confidence))
            step(count)
    return ExactLawResult(
        provenance=Provenance.of(model, seed),
        samples=count,
        confidence=float(confidence),
        poses=tuple(entries),
        findings=findings,
        warnings=list_warnings(findings, (line for entry in entries for line in entry.warnings)),
    )


def count_steps(space: Space, poses: int, samples: int, **options: object) -> int:
    """Return the number of progress steps: samples are drawn once, and compared at each pose."""
    del space, options
    return samples * (1 + poses)


def _deviations(space: Space, seed: int, count: int, step: Callable[[int], None]) -> Array:
    check_memory(
        8.0 * (space.size + 16) * count, f"comparing {count:,} samples of {space.size:,} numbers", "ask for fewer"
    )
    result = np.empty((space.size, count))
    for first in range(0, count, _AT_ONCE):
        part = slice(first, min(first + _AT_ONCE, count))
        result[:, part] = space.sample(seed, first, part.stop - first)
        step(part.stop - first)
    result -= space.mean[:, None]
    return result


def _at_pose(error_model: ErrorModel, pose: Pose, deviations: Array, confidence: float) -> PoseLaws:
    model = error_model.at(pose)
    error, jacobian = model.tangent
    samples = error[:, None] + jacobian @ deviations
    laws: dict[str, ExactLaw] = {}
    row = 0
    for name in QUANTITIES:
        if name in _NORMS:
            laws[name] = _norm(model, name, samples, confidence)
        else:
            laws[name] = _component(model.space, name, float(error[row]), jacobian[row], samples[row], confidence)
            row += 1
    # number of samples that are also evaluated with the exact model
    warnings = (*map(str, turnover_findings(model)), *_find_nonlinear(model, laws, deviations[:, :10_000]))
    add(warnings)
    return PoseLaws(PoseLabel.of(error_model, pose, model), laws, warnings)


def _find_nonlinear(model: PoseModel, laws: dict[str, ExactLaw], deviations: Array) -> tuple[str, ...]:
    """Return a warning for each quantity whose law clearly differs from the law of the exact model."""
    try:
        errors = sampler.errors_at(sampler.to_arrays(model), "exact", model.space.mean[:, None] + deviations)
    except InputError as error:
        return (f"the exact model could not be compared: {error.findings[0].message}",)
    lines = []
    for values, (name, law) in zip(quantity_values(errors), laws.items(), strict=True):
        if law.law is not None and law.std is not None:
            # confidence at which a deviation of the exact model from the law is reported
            agreement = agreement_of(law.law, np.sort(values), 1 - 1e-6, law.std, _EFFORT / 10)
            if not agreement.agrees:
                lines.append(
                    f"{symbol(name)}: {values.size:,} samples of the exact model lie {agreement.distance:.2g} from this law, "
                    f"chance explains {agreement.band:.2g}; the model is nonlinear within the tolerances, use analyze"
                )
        elif law.std == 0 and float(values.std()) > ROUNDING:
            lines.append(f"{symbol(name)}: does not vary at first order, but does in the exact model; use analyze")
    return tuple(lines)


def _check_copulas(space: Space) -> None:
    laws = {draw.name: draw.law for draw in space.draws}
    for correlation in space.correlations:
        for name in correlation.names:
            if not laws[name].is_normal:
                raise InputError(
                    f"{name!r} is correlated ({', '.join(correlation.names)}) and not normal: exact laws need normal or "
                    "independent draws; use analyze, or make all draws of the correlation normal"
                )


@dataclass(frozen=True, eq=False)
class _Share:
    """Contribution of a draw that is not normal to a component, with its weights."""

    law: Law
    weights: Array
    std: float
    part: Projection | None

    @property
    def ends(self) -> tuple[float, float]:
        """Lower and upper end."""
        if self.part is not None:
            return self.part.ends
        middle = float(self.weights @ self.law.mean_vector)
        return -self.law.support(-self.weights) - middle, self.law.support(self.weights) - middle

    @property
    def summand(self) -> number_law.Summand:
        """Bounds for the series; for a user-defined law the only known bound of |φ| is 1."""
        part = self.part
        if part is not None:
            return number_law.Summand(
                part.within, part.is_bounded, part.envelope, part.characteristic, part.characteristic_error
            )
        interval = self.ends
        return number_law.Summand(lambda score: interval, True, np.ones_like, self._characteristic, _UNKNOWN_ERROR)

    def _characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        """Return E exp(i ω w·(x - mean))."""
        phase = np.exp(-1j * frequency * float(self.weights @ self.law.mean_vector))
        return self.law.characteristic(self.weights[:, None] * frequency) * phase


def _component(space: Space, quantity: str, mean: float, weights: Array, samples: Array, confidence: float) -> ExactLaw:
    normal = np.zeros(space.size, dtype=bool)
    shares = []
    for draw, columns in zip(space.draws, space.slices, strict=True):
        if draw.law.is_normal:
            normal[columns] = True
            continue
        direction = weights[columns]
        std = math.sqrt(max(float(direction @ draw.law.covariance @ direction), 0.0))
        if std > 0:
            shares.append(_Share(draw.law, direction, std, draw.law.projection(direction)))
    bell = np.where(normal, weights, 0.0)
    bell_std = math.sqrt(max(float(space.block_covariance.variances_of(bell[None])[0]), 0.0))
    total = math.hypot(bell_std, *(share.std for share in shares))
    if total <= ROUNDING:
        return ExactLaw(quantity, None, "does not vary at first order", mean=mean, std=0.0)
    spread_shares = [share for share in shares if share.std > _NEGLIGIBLE * total]
    left_out = sum(share.std for share in shares if share.std <= _NEGLIGIBLE * total)
    if bell_std <= _NEGLIGIBLE * total:
        left_out, bell_std = left_out + bell_std, 0.0
    contributors = len(spread_shares) + (bell_std > 0)
    law = _law_of(mean, spread_shares, bell_std)
    # an omitted number changes the cumulative law by at most the density times its size, a few standard deviations
    error = math.inf if isinstance(law, str) else law.error + 10 * left_out / total
    if isinstance(law, str) or error > LARGEST_ERROR:
        reason = law if isinstance(law, str) else _UNCERTIFIED
        return ExactLaw(quantity, None, reason, mean=mean, std=total, contributors=contributors)
    exact = ExactLaw(quantity, law, mean=mean, std=total, contributors=contributors, error=error)
    return _with_samples(exact, samples, confidence)


_UNCERTIFIED: Final = "not certified: too few of its draws have a density (values with a probability of their own)"
_TOO_MANY: Final = (
    "not certified: {terms:,} terms leave an error of {error:.0e} in the cumulative law, more than {largest:g}; the draws "
    "combine wide tails with a characteristic function that decreases slowly"
)
_UNKNOWN_ERROR: Final = 1e-13  # assumed for characteristic functions without an error bound of their own


def _law_of(mean: float, shares: Sequence[_Share], bell_std: float) -> number_law.NumberLaw | str:
    if not shares:
        return number_law.NormalLaw(mean, bell_std)
    parts = [share.part for share in shares if share.part is not None]
    if not bell_std and len(parts) == len(shares) <= 2:
        if len(parts) == 1:
            return number_law.SingleLaw(mean, parts[0])
        pair = number_law.ConvolvedLaw.of(mean, *parts)
        if pair.pieces <= number_law.MOST_PIECES:
            return pair
    low, high = (sum(share.ends[side] for share in shares) for side in (0, 1))
    if not math.isfinite(low) or not math.isfinite(high):
        return "a law defined outside precision-pin has no bounds"

    series = number_law.certified_series(mean, bell_std, [share.summand for share in shares], LARGEST_ERROR)
    if isinstance(series, number_law.SeriesLaw):
        return series
    if math.isinf(series):
        return _UNCERTIFIED
    return _TOO_MANY.format(terms=number_law.MOST_TERMS, error=series, largest=LARGEST_ERROR)


def _norm(model: PoseModel, quantity: str, samples: Array, confidence: float) -> ExactLaw:
    rows = _NORMS[quantity]
    error, jacobian = model.tangent
    covariance = model.covariance[rows, rows]
    total = math.sqrt(max(float(np.trace(covariance)), 0.0))
    if total <= ROUNDING:
        size = float(np.linalg.norm(error[rows]))
        return ExactLaw(quantity, None, "does not vary at first order", mean=size, std=0.0)
    non_normal = [
        draw.name
        for draw, columns in zip(model.space.draws, model.space.slices, strict=True)
        if not draw.law.is_normal
        and float(np.trace(jacobian[rows, columns] @ draw.law.covariance @ jacobian[rows, columns].T))
        > (_NEGLIGIBLE * total) ** 2
    ]
    if non_normal:
        names = ", ".join(non_normal[:2]) + (f" and {len(non_normal) - 2} more" if len(non_normal) > 2 else "")
        return ExactLaw(quantity, None, f"not available: only of normal draws, and these are not: {names}")
    law = number_law.NormalNorm(error[rows], covariance)
    mean, std = law.moments
    exact = ExactLaw(quantity, law, mean=mean, std=std, contributors=1, error=law.error)
    return _with_samples(exact, np.linalg.norm(samples[rows], axis=0), confidence)


def _with_samples(exact: ExactLaw, samples: Array, confidence: float) -> ExactLaw:
    assert exact.law is not None
    assert exact.std is not None
    quantiles = tuple(exact.law.quantile(p) for p in LEVELS)
    bounds = number_law.quantile_bounds(exact.law, np.array(LEVELS), np.array(quantiles))
    agreement = agreement_of(exact.law, np.sort(samples), confidence, exact.std)
    return replace(exact, quantiles=quantiles, quantile_errors=tuple(bounds.tolist()), agreement=agreement)


def agreement_of(
    law: number_law.NumberLaw, rising: Array, confidence: float, std: float, effort: float = _EFFORT
) -> Agreement:
    """Return the distance of sorted samples ``(N,)`` from a law with this standard deviation.

    Only every m-th sample is compared, with m chosen by the evaluation time of the law. Both cumulative laws are
    monotone, so that the distance between two compared samples is larger by at most m/N.
    """
    count = rising.size
    step = max(1, math.ceil(2 * count * law.cost / effort))
    ranks = np.unique(np.append(np.arange(0, count, step), count - 1))
    x = rising[ranks]
    # at a value with a finite probability, samples deviate by rounding; compare on both sides of it
    shift = 1e-9 * std
    upper, lower = law.cumulative(x + shift), law.cumulative(x - shift)
    right = np.searchsorted(rising, x, side="right") / count
    left = np.searchsorted(rising, x, side="left") / count
    slack = (step - 1) / count
    distance = float(max((right - upper).max(), (lower - left).max(), 0.0)) + slack
    counts, edges = np.histogram(rising, bins=_BINS)
    band = math.sqrt(math.log(2 / (1 - confidence)) / (2 * count))
    return Agreement(count, distance, band, confidence, slack, edges, counts)


def table(result: ExactLawResult) -> str:
    """Return mean, spread and quantiles of every component in mm and mrad, their accuracy, and the comparison."""
    provenance = result.provenance
    sizes = [
        max((law.std or 0.0 for law in entry.laws.values() if law.quantity.startswith("position.")), default=0.0)
        for entry in result.poses
    ]
    blocks = [answer_of([entry.pose for entry in result.poses], sizes, [*map(_answer, result.poses)])]
    for entry in result.poses:
        laws = [law for law in entry.laws.values() if law.agreement]
        lines = [
            subject(provenance, entry.pose),
            f"exact law of the first-order model, statics {provenance.statics}; errors in base axes",
            "",
            *text_lines(LAW_COLUMNS, (law for law in entry.laws.values() if law.std is not None)),
            "",
            *(text_lines(METHOD_COLUMNS, laws) if laws else []),
            *map(one_line, (*missing(entry.laws.values()), *entry.warnings)),
        ]
        blocks.append("\n".join(lines))
    blocks.append(
        f"compared with {result.samples:,} samples of the same model, seed {provenance.seed}: the Kolmogorov distance stays "
        f"below the band at {100 * result.confidence:g} % confidence"
    )
    return "\n\n".join(blocks)


def _answer(entry: PoseLaws) -> str:
    """Return the ends between which 99.73 % of the robots lie, for each component of the position."""
    parts = []
    for law in entry.laws.values():
        quantiles = law.shown_quantiles(12)
        if law.quantity.startswith("position.") and not law.quantity.endswith("norm") and quantiles:
            low, high = (f"{1e3 * quantiles[level][0]:.4g}" for level in (LEVELS_SHOWN[0], LEVELS_SHOWN[-1]))
            parts.append(f"{symbol(law.quantity)} {low} to {high}")
    return f"99.73 % of robots: {', '.join(parts)} mm" if parts else "no law is known"
