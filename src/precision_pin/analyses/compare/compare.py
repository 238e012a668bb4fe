"""Comparison of several error models: draws with the same name get the same random numbers in all of them."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc

from precision_pin.analyses.first_order import first_order
from precision_pin.analyses.provenance import PoseLabel, Poses, Provenance, listed_poses
from precision_pin.analyses.result import Outcome
from precision_pin.analyses.shares import source_lines
from precision_pin.base.arguments import check_instance, check_items, check_memory, check_whole
from precision_pin.base.arrays import Array, Keys, Record
from precision_pin.base.errors import Finding, InputError, shortened, shown, visible, warns_at_end
from precision_pin.base.progress import check_progress, steps_to
from precision_pin.draws import lazy_special
from precision_pin.draws.draw import Draw
from precision_pin.draws.space import check_seed
from precision_pin.model.error_model import ErrorModel, takes_datum
from precision_pin.model.pose_model import PoseModel
from precision_pin.render.html import Table, rendered
from precision_pin.render.tables import milli, symbol
from precision_pin.render.text_table import aligned, limited, remainder
from precision_pin.sampling import Progress, monte_carlo
from precision_pin.sampling.blocks import first_order_skewness
from precision_pin.sampling.result import MonteCarloResult
from precision_pin.sampling.table import demanded, verdict_line
from precision_pin.sheet.reader import SheetDifference, sheet_differences
from precision_pin.statistics import (
    COMPONENTS,
    NORMS,
    QUANTITIES,
    Specification,
    check_confidence,
    clopper_pearson,
    format_inside,
    quantile_ranks,
)
from precision_pin.statistics.intervals import Moments, format_interval
from precision_pin.statistics.limits import are_inside
from precision_pin.statistics.plan import Specifications, listed_specifications

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_CELLS: Final = 48
"""Largest number of intervals examined for the first quantile."""


@dataclass(frozen=True)
class Difference(Record):
    """The other minus the first, in the unit of what is compared; no interval where the robots are too few."""

    value: float
    interval: tuple[float, float] | None

    @property
    def is_told(self) -> bool:
        """Whether the interval excludes zero."""
        return self.interval is not None and not self.interval[0] <= 0 <= self.interval[1]


def mean_difference(first: Array, other: Array, confidence: float, skewness: float = math.nan) -> Difference:
    """Return the difference of the means of paired samples ``(N,)``, with Hall's interval of the mean difference.

    There is no interval where the samples are too few for ``skewness``, that of the differences by their laws (NaN
    where unknown), or for the observed skewness (:mod:`precision_pin.statistics.intervals`).
    """
    gap = other - first
    value = float(gap.mean())
    deviations = gap - value
    ones = np.ones(gap.size, dtype=np.int64)
    moments = Moments(deviations, ones, float((deviations**2).mean()), gap.size, confidence, (skewness, math.nan))
    interval = moments.mean_interval
    return Difference(value, None if interval is None else (value + interval[0], value + interval[1]))


def quantile_difference(first: Array, other: Array, probability: float, confidence: float) -> Difference:
    """Return the difference of a quantile of paired samples ``(N,)``, with a distribution-free interval.

    Let q₁ and q₂ be the quantiles. A fifth of the allowed error goes to an interval of order statistics for q₁. If b >
    q₂ and a = q₁, robots with the first value at or above a and the other below b are at least as frequent as the
    reverse, since P(x₂ < b) ≥ p ≥ P(x₁ < a). Counts that contradict this by the sign test (McNemar's, exact), with two
    fifths of the error, show q₂ ≥ b; likewise from above. The interval contains b - a for every possible a = q₁. It is
    narrow if the models are alike, and covers more often than stated. ``None`` for too few robots.
    """
    value = float(np.quantile(other, probability) - np.quantile(first, probability))
    error = 1 - confidence
    ranks = quantile_ranks(first.size, probability, 1 - 0.2 * error)
    if ranks is None:
        return Difference(value, None)
    sorted_first, order = np.sort(first), np.argsort(other, kind="stable")
    low, high = ranks[0] - 1, ranks[1] - 1
    cells = np.unique(sorted_first[np.unique(np.linspace(low, high, min(_CELLS, high - low + 1)).astype(int))]).tolist()
    pairs, part = _Pairs(first[order], other[order]), 0.4 * error
    near_pairs = pairs.between(cells[0], cells[-1], pairs.least(cells[0], part), pairs.most(cells[-1], part))
    rank_bounds = [(near_pairs.least(a, part), near_pairs.most(a, part)) for a in cells]
    # between two of these values of q₁ the lower end is at least that at the first, the upper end at most that at the
    # second
    lower = min(below - a for (below, _), a in zip(rank_bounds, [*cells[1:], cells[-1]], strict=True))
    upper = max(above - a for (_, above), a in zip(rank_bounds, [cells[0], *cells[:-1]], strict=True))
    if not math.isfinite(lower) or not math.isfinite(upper):
        return Difference(value, None)
    return Difference(value, (min(float(lower), value), max(float(upper), value)))


class _Pairs:
    """Pairs ``(N,)`` of a first and a second value, sorted by the second."""

    def __init__(self, first: Array, second: Array) -> None:
        self._first, self._second = first, second
        self._values = second.tolist()
        self._below, self._up_to = (np.searchsorted(second, second, side).tolist() for side in ("left", "right"))

    def between(self, low: float, high: float, lowest: float, highest: float) -> _Pairs:
        """Return the pairs that are not outside both ranges on the same side, where neither count includes them."""
        first, second = self._first, self._second
        is_kept = ~((first < low) & (second < lowest)) & ~((first > high) & (second > highest))
        return _Pairs(first[is_kept], second[is_kept])

    def least(self, a: float, error: float) -> float:
        """Return the largest second value shown to be at most q₂ if q₁ is a; -inf if there is none."""
        less_counts = [0, *np.cumsum(self._first < a).tolist()]

        def is_insignificant(rank: int) -> bool:
            index = self._below[rank]
            return not _is_contradicted(less_counts[-1] - less_counts[index], index - less_counts[index], error)

        rank = bisect_left(range(len(self._values)), True, key=is_insignificant)
        return self._values[rank - 1] if rank else -math.inf

    def most(self, a: float, error: float) -> float:
        """Return the smallest second value shown to be at least q₂ if q₁ is a; inf if there is none."""
        more_counts, count = [0, *np.cumsum(self._first > a).tolist()], len(self._values)

        def is_significant(rank: int) -> bool:
            index = self._up_to[rank]
            return _is_contradicted(more_counts[index], count - index - (more_counts[-1] - more_counts[index]), error)

        rank = bisect_left(range(count), True, key=is_significant)
        return self._values[rank] if rank < count else math.inf


def _is_contradicted(count: int, against: int, error: float) -> bool:
    """Return whether the sign test rejects that the second kind is at least as probable as the first."""
    return count > against and float(betainc(count, against + 1, 0.5)) <= error


def share_difference(first: NDArray[np.bool_], other: NDArray[np.bool_], confidence: float) -> Difference:
    """Return the difference of the fractions of true values in paired samples ``(N,)``.

    The interval is the union of two: Bonett and Price (2012), a Wald interval with one robot added to each kind of
    change, too short where a few robots all change the same way; and Zou and Donner (2008), from the Clopper-Pearson
    intervals of both kinds, too short where many change.
    """
    gain_count, loss_count = int((other & ~first).sum()), int((first & ~other).sum())
    count = first.size
    gain, loss = (gain_count + 1) / (count + 2), (loss_count + 1) / (count + 2)
    half = float(lazy_special.ndtri(0.5 + confidence / 2)) * math.sqrt((gain + loss - (gain - loss) ** 2) / (count + 2))
    value = (gain_count - loss_count) / count
    (gain_low, gain_high), (loss_low, loss_high) = (
        (abs(changes / count - bound) for bound in clopper_pearson(changes, count, confidence))
        for changes in (gain_count, loss_count)
    )
    low = min(gain - loss - half, value - math.hypot(gain_low, loss_high))
    high = max(gain - loss + half, value + math.hypot(gain_high, loss_low))
    return Difference(value, (max(low, -1.0), min(high, 1.0)))


LEVELS: Final = (0.5, 0.95, 0.9973)
"""Probabilities of the compared quantiles."""


@dataclass(frozen=True)
class Paired(Record):
    """Differences of a model from the first on the same robots, m and rad.

    Attributes:
        means, quantiles: By quantity; quantiles also by probability.
        shares: Differences of the fraction of robots inside each specification.
    """

    KEYS: ClassVar[Keys] = ("mean=means", "quantile=quantiles", "probability=shares")

    means: Mapping[str, Difference]
    quantiles: Mapping[str, Mapping[float, Difference]]
    shares: tuple[Difference, ...]


@dataclass(frozen=True)
class PoseComparison:
    """The models at one pose.

    Attributes:
        laws, differences: Sampled law of each model; differences of each further model from the first.
        variances: First-order contribution of each line of sources to the variance of the position, m², by model.
    """

    label: PoseLabel
    laws: tuple[MonteCarloResult, ...]
    differences: tuple[Paired, ...]
    variances: tuple[Mapping[str, float], ...]

    def entry(self, names: tuple[str, ...]) -> dict[str, Any]:
        """Return the entry of the JSON, of models with these names."""
        return {
            "pose": self.label,
            "models": {
                name: {**_law(law), "variance": variance}
                for name, law, variance in zip(names, self.laws, self.variances, strict=True)
            },
            "differences": dict(zip(names[1:], self.differences, strict=True)),
        }


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ComparisonResult(Outcome):
    """Laws of several models, sampled with the same robots, and their differences from the first.

    Attributes:
        names: Names of the models.
        samples, model, confidence: Number of robots; ``"exact"`` or ``"linear"``; confidence of every interval.
        poses: The models at each pose.
        sheet_differences: How each further sheet differs from the first.
        specifications: Limits to judge.
    """

    schema: ClassVar[str] = "precision-pin/comparison/1"
    KEYS: ClassVar[Keys] = (
        *("*head", "samples", "model", "confidence", "warnings", "findings", "names"),
        *("met=met_by", "poses=entries", "sheets"),
    )

    names: tuple[str, ...]
    samples: int
    model: str
    confidence: float
    poses: tuple[PoseComparison, ...]
    sheet_differences: tuple[tuple[SheetDifference, ...], ...]
    specifications: tuple[Specification, ...] = ()

    def met(self, name: str) -> bool:
        """Return whether a model meets every specification at every pose; true without any.

        Raises:
            ValueError: No model has this name.
        """
        rank = self.names.index(name)
        return all(result.met for pose in self.poses for result in pose.laws[rank].summary.specifications)

    def worst_pose(self, rank: int = 0) -> int:
        """Return the index of the pose with a model's largest 95 % quantile of |d|."""
        sizes = [_within(pose.laws[rank]) for pose in self.poses]
        return sizes.index(max(sizes))

    def plot(self) -> Figure:
        """Draw the laws of |d| and |δ| of all models at the first model's worst pose."""
        return self._output("figure:figure")(self)

    @property
    def met_by(self) -> dict[str, bool]:
        """Whether each model meets every specification."""
        return {name: self.met(name) for name in self.names}

    @property
    def entries(self) -> list[dict[str, Any]]:
        """The models at each pose, as in the JSON."""
        return [pose.entry(self.names) for pose in self.poses]

    @property
    def sheets(self) -> dict[str, Any]:
        """Differences of the sheets, as in the JSON."""
        return {
            name: [{"path": change.path, "before": change.before, "after": change.after} for change in changes]
            for name, changes in zip(self.names[1:], self.sheet_differences, strict=True)
        }

    def __repr__(self) -> str:
        return f"<ComparisonResult of {', '.join(self.names)}: {len(self.poses)} poses, {self.samples:,} robots>"

    def _repr_html_(self) -> str:
        rows = []
        for pose in self.poses:
            for name, law in zip(self.names, pose.laws, strict=True):
                cells = [
                    milli(distribution.resolved_quantile(level))
                    for distribution in (law.position.norm, law.attitude.norm)
                    for level in (0.5, 0.95)
                ]
                rows.append([pose.label.name, name, *cells])
        columns = ["pose", "model", "|d| median [mm]", "95 %", "|δ| median [mrad]", "95 %"]
        note = f"{self.samples:,} robots, the same in all models, seed {self.provenance.seed}, {self.model} model"
        return rendered(f"{' against '.join(self.names)}", [Table(columns, rows)], [note, *self.warnings])


def _within(law: MonteCarloResult) -> float:
    value = law.position.norm.resolved_quantile(0.95)
    return -1.0 if value is None else value


def _law(law: MonteCarloResult) -> dict[str, Any]:
    entries = law.to_dict()
    keys = ("nominal", *(name.partition(".")[0] for name in QUANTITIES), "spec")
    return {key: entries[key] for key in dict.fromkeys(keys) if key in entries}


SAMPLES: Final = 100_000
MOST_MODELS: Final = 8
MOST_SAMPLES: Final = 10**8

_NONE: Final = Difference(0.0, (0.0, 0.0))
"""Difference of models that do not differ."""


@warns_at_end
@takes_datum
def compare(
    models: Mapping[str, ErrorModel] | Sequence[ErrorModel],
    poses: Poses = None,
    *,
    samples: int = SAMPLES,
    seed: int = 0,
    model: Literal["exact", "linear"] = "exact",
    specifications: Specifications = (),
    confidence: float = 0.95,
    findings: Sequence[Finding] = (),
    threads: int | None = None,
    progress: Progress | bool | None = None,
) -> ComparisonResult:
    """Sample several models with the same robots, and return their laws and the differences from the first.

    A draw, such as ``axis_install[joint2].A`` or a parameter, has the same random numbers in all models that have a
    draw of this name. A difference is therefore due to the models, and its interval is narrow.

    Args:
        models: Two to eight models, by name or as a list (named A, B, …), of arms with the same joints.
        poses: One pose or a list, by the first model's names or as joint values.
        samples: Number of robots.
        seed: 64-bit seed.
        model: ``"exact"`` or ``"linear"``, as for :func:`precision_pin.monte_carlo`.
        specifications: Limits to judge: one or a list, each from :func:`precision_pin.specification` or its text.
        confidence: Confidence of every interval.
        findings: Warnings to include in the result, such as those of the sheets.
        threads: Number of threads, by default one for each core. It does not change the result.
        progress: Function called with the number of samples added since its last call; ``True`` shows a bar.

    Raises:
        InputError: Fewer than two or more than eight models, different joints, a wrong argument, or too little memory.
        UnknownNameError: No such pose or joint.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> finer = model.with_({"axis_install[*].radius": "0.05 mm"})
        >>> result = pp.compare({"now": model, "finer": finer}, specifications="40 mm @ 95 %", samples=10_000)
        >>> print(result.met("now"), result.met("finer"))
        False True
    """
    model_of = _name_models(models)
    check_whole("the number of samples", samples, 1, MOST_SAMPLES)
    check_seed(seed)
    check_confidence(confidence)
    check_progress(progress)
    limits = listed_specifications(specifications)
    findings = check_items("findings", findings, Finding)
    first = next(iter(model_of.values()))
    chosen_poses = listed_poses(poses)
    check_memory(8.0 * 20 * len(model_of) * samples, f"comparing {samples:,} robots", "compare fewer of them")
    comparisons = []
    sample = partial(
        monte_carlo, samples=samples, seed=seed, model=model, specifications=limits, confidence=confidence,
        keep_samples=True, threads=threads,
    )  # fmt: skip
    with steps_to(progress, count_steps(len(model_of), len(chosen_poses), samples)) as step:
        for pose in chosen_poses:
            q = first.configuration(pose)
            laws = [sample(item, q, progress=step) for item in model_of.values()]
            ats = [item.at(q) for item in model_of.values()]
            insides = [_insides(law, at, limits) for law, at in zip(laws, ats, strict=True)]
            pairs = tuple(
                _pair((laws[0], law), (insides[0], inside), confidence, _skewness(ats[0], at))
                for law, at, inside in zip(laws[1:], ats[1:], insides[1:], strict=True)
            )
            comparisons.append(
                PoseComparison(
                    label=PoseLabel.of(first, pose, first.at(q)),
                    laws=tuple(replace(law, errors=None) for law in laws),
                    differences=pairs,
                    variances=tuple(_variances(error_model, q) for error_model in model_of.values()),
                )
            )
    sheets = [error_model.sheet for error_model in model_of.values()]
    changes = tuple(
        () if sheets[0] is None or other is None else sheet_differences(sheets[0], other) for other in sheets[1:]
    )
    warning_lines = [
        f"{name}: {line}"
        for of_pose in comparisons
        for name, law in zip(model_of, of_pose.laws, strict=True)
        for line in law.warnings
    ]
    return ComparisonResult(
        provenance=Provenance.of(first, seed),
        names=tuple(model_of),
        samples=int(samples),
        model=model,
        confidence=confidence,
        poses=tuple(comparisons),
        sheet_differences=changes,
        specifications=limits,
        findings=findings,
        warnings=tuple(dict.fromkeys((*map(str, findings), *warning_lines))),
    )


def count_steps(models: int, poses: int, samples: int) -> int:
    """Return the number of progress steps: a step a sample."""
    return models * poses * samples


def _name_models(models: Mapping[str, ErrorModel] | Sequence[ErrorModel]) -> dict[str, ErrorModel]:
    if isinstance(models, Mapping):
        model_of = dict(models)
    else:
        model_list = check_items("the models", models, ErrorModel)
        model_of = {chr(ord("A") + rank): model for rank, model in enumerate(model_list[: MOST_MODELS + 1])}
    for name, model in model_of.items():
        check_instance(f"models[{name!r}]", model, ErrorModel, "as ErrorModel.load makes it")
    if not 2 <= len(model_of) <= MOST_MODELS:
        raise InputError(f"{len(model_of)} model{'s' * (len(model_of) != 1)}; 2 to {MOST_MODELS} can be compared")
    (name, first), *others = model_of.items()
    for other, model in others:
        if model.chain.joint_names != first.chain.joint_names:
            raise InputError(
                f"{other} has the joints {', '.join(model.chain.joint_names)}, {name} has {', '.join(first.chain.joint_names)}; "
                "only arms with the same joints can be compared"
            )
    return model_of


def _pair(
    laws: tuple[MonteCarloResult, MonteCarloResult],
    insides: tuple[list[NDArray[np.bool_]], list[NDArray[np.bool_]]],
    confidence: float,
    skewness: Array | None,
) -> Paired:
    """Return the differences of two samples of the same robots; ``skewness`` is None if the models do not differ."""
    values = [_quantities(law) for law in laws]
    means, quantiles = {}, {}
    for row, quantity in enumerate(QUANTITIES):
        base, changed = values[0][row], values[1][row]
        if skewness is None and np.array_equal(base, changed):
            means[quantity], quantiles[quantity] = _NONE, dict.fromkeys(LEVELS, _NONE)
            continue
        skew = math.nan if skewness is None else float(skewness[row])
        means[quantity] = mean_difference(base, changed, confidence, skew)
        quantiles[quantity] = {level: quantile_difference(base, changed, level, confidence) for level in LEVELS}
    return Paired(means, quantiles, tuple(share_difference(*pair, confidence) for pair in zip(*insides, strict=True)))


def _insides(law: MonteCarloResult, at: PoseModel, listed: Sequence[Specification]) -> list[NDArray[np.bool_]]:
    """Return which robots keep each specification, ``(N,)`` each."""
    assert law.errors is not None
    return [are_inside(specification.conditions(at.posture.tool_axes), law.errors) for specification in listed]


def _skewness(first: PoseModel, other: PoseModel) -> Array | None:
    """Return the first-order skewness ``(8,)`` of the differences of the same robots' errors; None if there are none.

    A draw of equal name and (scaled) law moves them by the difference of its slopes, any other alone.
    """
    shared = {draw.name: (draw, columns) for draw, columns in zip(first.space.draws, first.space.slices, strict=True)}
    draws: list[Draw] = []
    slopes: list[Array] = []
    for draw, columns in zip(other.space.draws, other.space.slices, strict=True):
        draw_slopes, shared_draw = other.tangent[1][:, columns], shared.get(draw.name)
        draws.append(draw)
        if shared_draw is not None and (scale := _scale(shared_draw[0], draw)) is not None:
            draw_slopes = draw_slopes - first.tangent[1][:, shared_draw[1]] * scale
            del shared[draw.name]
        slopes.append(draw_slopes)
    draws += [draw for draw, _ in shared.values()]
    slopes += [-first.tangent[1][:, columns] for _, columns in shared.values()]
    all_slopes = np.concatenate([np.zeros((6, 0)), *slopes], axis=1)
    varies = np.concatenate([np.zeros(0), *(np.diag(draw.covariance) > 0 for draw in draws)]) > 0
    if not all_slopes[:, varies].any():
        return None
    skewness = first_order_skewness(draws, all_slopes)[:, 0]
    # the difference of norms is, to first order, a component of the difference
    skewness[list(NORMS)] = skewness[list(COMPONENTS)].reshape(2, 3).max(axis=1)
    return skewness


def _scale(first: Draw, other: Draw) -> float | None:
    """Return the ratio of the widths of two laws that differ only in scale and mean; None for other laws."""
    if first.law == other.law:
        return 1.0
    if type(first.law) is not type(other.law) or first.law.size != other.law.size:
        return None
    variances, other_variances = np.diag(first.covariance), np.diag(other.covariance)
    if not (variances > 0).all() or not (other_variances > 0).all():
        return None
    ratios = np.sqrt(variances / other_variances)
    shapes = [(law.cumulants(), np.diag(law.covariance)) for law in (first.law, other.law)]
    scaled = [None if c is None else c / v ** np.array([[1], [1.5], [2], [3]]) for c, v in shapes]
    if (scaled[0] is None) != (scaled[1] is None) or not np.allclose(ratios, ratios[0], rtol=1e-9):
        return None
    is_alike = scaled[0] is None or scaled[1] is None or np.allclose(scaled[0], scaled[1], rtol=1e-6)
    return float(ratios[0]) if is_alike else None


def _quantities(law: MonteCarloResult) -> Array:
    errors = law.errors
    assert errors is not None
    norms = np.sqrt((errors.reshape(2, 3, -1) ** 2).sum(axis=1))
    return np.concatenate([norms[:1], errors[:3], norms[1:], errors[3:]])


def _variances(model: ErrorModel, q: Array) -> Mapping[str, float]:
    """Return the first-order contribution of each line of sources to the variance of the position, m²."""
    lines = source_lines(model)
    moments = first_order(model, q[:, None], None, lines, None, lambda _: None)
    total = float(np.trace(moments.covariance[:3, :3, 0]))
    return {line.name: total * float(share) for line, share in zip(lines, moments.shares[:, 0], strict=True)}


_SHOWN: Final = (("position.norm", "mm"), ("attitude.norm", "mrad"))
_MOST_LETTERS: Final = 30  # of a name in a column
_MOST_CHANGES, _MOST_CAUSES = 20, 8  # differences between two sheets, and sources, listed


def comparison_table(result: ComparisonResult) -> str:
    """Return which model is better and by how much, then laws, verdicts, causes, and the differences of the sheets."""
    run = result.provenance
    lines = [
        *(headline(result, rank) for rank in range(1, len(result.names))),
        *_verdicts(result),
        "",
        f"{visible(run.arm)}",
        f"{result.samples:,} robots, the same in all, seed {run.seed}, {result.model} model",
        f"intervals and digits at {result.confidence:.0%} confidence; differences: to {shown(result.names[0])}",
    ]
    for pose in result.poses:
        lines += ["", *_pose(result, pose)]
    for name, changes in zip(result.names[1:], result.sheet_differences, strict=True):
        other = f" has otherwise than {shown(result.names[0])}:" if changes else ": the same sheet"
        lines += ["", f"{shown(name)}{other}"]
        rows = [
            [f"  {shortened(visible(change.path), 50)}", _value(change.before), "->", _value(change.after)]
            for change in changes[: limited(_MOST_CHANGES)]
        ]
        lines += aligned(rows) if rows else []
        lines += [f"  {line}" for line in remainder(len(changes) - len(rows))]
    return "\n".join([*lines, *run.resting_lines])


def headline(result: ComparisonResult, rank: int) -> str:
    """Return a sentence that compares a model with the first at the first model's worst pose."""
    pose = result.poses[result.worst_pose()]
    change = pose.differences[rank - 1].quantiles["position.norm"][0.95]
    first, other = (_quantile(pose.laws[k], "position.norm", 0.95) for k in (0, rank))
    names = shown(result.names[0]), shown(result.names[rank])
    place = f" at the worst pose {shown(pose.label.name)}" if len(result.poses) > 1 else ""
    phrase = f"95 % of robots within |d| {other} mm instead of {first}{place}"
    if change.interval is None:
        return f"{names[1]} against {names[0]}: {phrase}; the robots are too few to tell the difference"
    if change.value == 0 and change.interval == (0.0, 0.0):
        return f"{names[1]} and {names[0]} do not differ in |d|{place}: 95 % of robots within {first} mm"
    if not change.is_told:
        return f"{names[1]} is not told from {names[0]}: {phrase}, difference {_format_signed(change)} mm"
    word = "better" if change.value < 0 else "worse"
    return f"{names[1]} is {word} than {names[0]}: {phrase}, {_format_signed(change)} mm"


def _verdicts(result: ComparisonResult) -> list[str]:
    """Return a line for each specification, model and pose where it is judged; with several poses only those missed."""
    lines = []
    for rank, name in enumerate(result.names):
        for pose in result.poses:
            for number, limit in enumerate(pose.laws[rank].summary.specifications):
                place = f" at {shown(pose.label.name or 'the pose')}" if len(result.poses) > 1 else ""
                change = "" if rank == 0 else f", {_points(pose.differences[rank - 1].shares[number])}"
                verdict = verdict_line(f"spec {demanded(limit)}", limit, "{share} % inside, {low} to {high} %")
                lines.append(f"{shown(name)}: {verdict}{place}{change}")
    return lines


def _points(change: Difference) -> str:
    if change.interval is None:
        return f"change {100 * change.value:+.2g} points"
    low, high = (100 * end for end in change.interval)
    return f"change {100 * change.value:+.3g} points ({low:+.3g} to {high:+.3g})"


def _pose(result: ComparisonResult, pose: PoseComparison) -> list[str]:
    title = [f"pose {shown(pose.label.name)}"] if pose.label.name and len(result.poses) > 1 else []
    heads = [f"{100 * level:.4g} %" for level in LEVELS]
    rows = [["", "", "mean", *heads, *(f"change of {head}" for head in heads[1:])]]
    for quantity, unit in _SHOWN:
        for rank, (name, law) in enumerate(zip(result.names, pose.laws, strict=True)):
            distribution = law.position.norm if quantity.startswith("position") else law.attitude.norm
            cells = [milli(distribution.mean, 4), *(_quantile(law, quantity, level) for level in LEVELS)]
            by_level = pose.differences[rank - 1].quantiles[quantity] if rank else {}
            cells += [_format_signed(by_level[level]) if rank else "" for level in LEVELS[1:]]
            label = f"{symbol(quantity)} {unit}" if rank == 0 else ""
            rows.append([label, shortened(visible(name), _MOST_LETTERS), *cells])
    return [*title, *aligned(rows), "", *_causes(result, pose)]


def _causes(result: ComparisonResult, pose: PoseComparison) -> list[str]:
    """Return the largest lines of sources, by their largest contribution to the variance in any model."""
    names = dict.fromkeys(name for variance in pose.variances for name in variance)
    largest = {name: max(variance.get(name, 0.0) for variance in pose.variances) for name in names}
    ranked = [name for name in sorted(names, key=lambda name: -largest[name]) if largest[name] > 0]
    top_names = ranked[: limited(_MOST_CAUSES)]
    head = ["variance of the position, mm²", *(shortened(visible(name), _MOST_LETTERS) for name in result.names)]
    rows = [
        [shortened(visible(name), _MOST_LETTERS), *(_variance(variance.get(name)) for variance in pose.variances)]
        for name in top_names
    ]
    total = ["all", *(_variance(sum(variance.values())) for variance in pose.variances)]
    return [*aligned([head, *rows, total]), *remainder(len(ranked) - len(rows), "sources")]


def _variance(value: float | None) -> str:
    return "-" if value is None else f"{1e6 * value:.3g}"


def _quantile(law: MonteCarloResult, quantity: str, level: float) -> str:
    distribution = law.position.norm if quantity.startswith("position") else law.attitude.norm
    value, interval = distribution.resolved_quantile(level), distribution.quantile_interval(level)
    if value is None or interval is None:
        return "-"
    return format_inside(1e3 * value, (1e3 * interval[0], 1e3 * interval[1]), most=5)


def _format_signed(difference: Difference) -> str:
    if difference.interval is None:
        return f"{1e3 * difference.value:+.3g}"
    low, high = format_interval(*difference.interval, 1e3)
    value = format_inside(1e3 * difference.value, (1e3 * difference.interval[0], 1e3 * difference.interval[1]), most=5)
    sign = "+" if difference.value > 0 else ""
    return f"{sign}{value} ({low} to {high})"


def _value(value: str | None) -> str:
    return "-" if value is None else shortened(visible(value), _MOST_LETTERS)
