"""Probability that the error stays inside a limit, including failures too rare for plain sampling.

Plain sampling, FORM, importance sampling and subset simulation estimate the same probability with the exact model.
Contradictions between them are reported in the result.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Final, Literal

import numpy as np

from precision_pin.analyses.provenance import PoseLabel, Poses, Provenance, check_request
from precision_pin.analyses.reliability.estimates import Estimate, in_words, plain_estimate
from precision_pin.analyses.reliability.form import DesignPoint, Stratum
from precision_pin.analyses.reliability.importance import RareEvents, rare_events
from precision_pin.analyses.result import Result, list_warnings
from precision_pin.base.arrays import Array, Keys, Record
from precision_pin.base.errors import Finding, InputError, UnknownNameError, warns_at_end
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.model.error_model import ErrorModel, takes_datum
from precision_pin.model.pose_model import PoseModel
from precision_pin.render.columns import Column
from precision_pin.render.tables import absolute, bounded
from precision_pin.sampling import Progress, monte_carlo
from precision_pin.sampling.table import demanded
from precision_pin.statistics import (
    NO_GROUNDS,
    Grounds,
    Specification,
    SpecificationResult,
    Verdict,
    judge,
)
from precision_pin.statistics.plan import Specifications, listed_specifications, sizes_of

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]


METHOD_COLUMNS: Final = (
    Column(lambda row: f"  {row.method}", text=""),
    Column("method", report="method"),
    Column("probability", "{:.3g}".format, text="P(failure)", report="probability of failure"),
    Column("interval", in_words, text="interval", report="interval"),
    Column(lambda row: (row.probability, row.interval), frame="failure", has_interval=True),
    Column(
        "variation", lambda share: f"{100 * share:.2g} %" if math.isfinite(share) else "-", "c.o.v.", frame="variation"
    ),
    Column("evaluations", "{:,}".format, "evaluations", report="evaluations", frame="evaluations"),
    Column("resolved", frame="resolved"),
    Column("note", text="", report="", is_words=True),
)
"""Columns of the table of methods."""


@dataclass(frozen=True, eq=False)
class LikelyFailure(Record):
    """Design point in terms of the model's parameters.

    Attributes:
        beta, probability: Reliability index and Φ(-β).
        parameters: Value of each component at the point, SI.
        error: ``(6,)`` exact error at the point, m and rad.
        importance: Fraction of β² of each draw (correlated draws together), in descending order.
    """

    KEYS: ClassVar[Keys] = ("beta", "probability", "parameters", "error=parts", "importance")

    beta: float
    probability: float
    parameters: Mapping[str, float]
    error: Array
    importance: Mapping[str, float]

    @property
    def parts(self) -> dict[str, Array]:
        """Error of position and attitude."""
        return {"position": self.error[:3], "attitude": self.error[3:]}


@dataclass(frozen=True, eq=False, kw_only=True)
class SpecificationReliability(RareEvents, Record):
    """Reliability for one specification at one pose.

    Attributes:
        failures: The nearest design points in terms of the model's parameters.
        grounds: Why it cannot be judged, and what is taken as exact.
    """

    KEYS: ClassVar[Keys] = (
        *("quantity=specification.quantity", "limit=specification.limit", "required=specification.required"),
        *("probability", "interval", "met", "verdict", "*grounds", "resolved", "reason=reason?", "failure"),
        *("methods=estimates", "form=form_entry", "strata=parts", "unexamined=strata.remainder", "disagreements"),
    )

    specification: Specification
    failures: tuple[LikelyFailure, ...]
    varies: bool = True
    grounds: Grounds = NO_GROUNDS

    @property
    def disagreements(self) -> tuple[str, ...]:
        """Contradictions and remarks."""
        return (*self.contradictions, *self.remarks)

    @property
    def comments(self) -> tuple[str, ...]:
        """Differences between the methods, one line each, starting with the consequence for the verdict."""
        means = "the verdict is the same by every method"
        if len(self._verdicts()) > 1:
            means = "the verdict differs between the methods; the samples' interval, which is always valid, decides"
        unused = (f"the samples decide; {self.reason}",) if self.resolved and self.reason else ()
        return (*(f"{means}; {line}" for line in self.contradictions), *unused, *self.remarks)

    @property
    def probability(self) -> float:
        """Probability that the error stays inside the limit."""
        return 1 - self.best.probability

    @property
    def interval(self) -> tuple[float, float]:
        """Interval of :attr:`probability`."""
        low, high = self.best.interval
        return 1 - high, 1 - low

    @property
    def verdict(self) -> Verdict:
        """Verdict by the best estimate's interval, as :attr:`precision_pin.statistics.SpecificationResult.verdict`."""
        return "not judged" if self.grounds.not_judged else self._judge(self.best)

    @property
    def said(self) -> str:
        """The verdict in capitals, with the reason why there is none, or with what it takes as exact."""
        return self.grounds.said(self.verdict)

    def _judge(self, estimate: Estimate) -> Verdict:
        low, high = estimate.interval
        tolerated = 1 - self.specification.required
        return judge(holds=high <= tolerated, fails=low > tolerated, varies=self.varies)

    def _verdicts(self) -> set[Verdict]:
        return {self._judge(e) for e in (self.best, *(e for e in self.estimates if e.resolved))}

    @property
    def met(self) -> bool:
        """True if the verdict is ``"met"``."""
        return self.verdict == "met"

    def demand(self, quantity: str) -> str:
        """Return the specification as text, with the given name of its quantity."""
        of = self.specification
        return f"{bounded(of.quantity, of.limit, ' ', 10, quantity)} @ {100 * of.required:.10g} %"

    @property
    def name(self) -> str:
        """Name in data frames."""
        return self.demand(self.specification.quantity)

    @property
    def nearest(self) -> DesignPoint | None:
        """The nearest design point; ``None`` if none was found."""
        return next(iter(self.form.points), None)

    @property
    def failure(self) -> dict[str, Any]:
        """Probability of failure by the best estimate, as in the JSON."""
        return {"probability": self.best.probability, "interval": self.best.interval, "method": self.best.method}

    @property
    def form_entry(self) -> dict[str, Any]:
        """FORM as in the JSON."""
        return {
            "probability": self.form.probability,
            "range": self.form.range,
            "design_points": len(self.form.points),
            "starts": self.form.starts,
            "points": self.failures,
        }

    @property
    def parts(self) -> list[dict[str, Any]]:
        """Strata as in the JSON."""
        return [
            {"probability": part.probability, "rare": part.rare, "combinations": len(part.combinations)}
            for part in self.strata.parts
        ]


@dataclass(frozen=True, eq=False)
class PoseReliability(Record):
    """Reliability for all specifications at one pose."""

    KEYS: ClassVar[Keys] = ("pose", "spec=specifications")

    pose: PoseLabel
    specifications: tuple[SpecificationReliability, ...]


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ReliabilityResult(Result):
    """Reliability at one or several poses; ``samples`` is the number of plain samples."""

    schema: ClassVar[str] = "precision-pin/reliability/1"
    KEYS: ClassVar[Keys] = ("*head", "model", "samples", "confidence", "assumptions", "warnings", "findings", "poses")
    model: ClassVar[str] = "exact"
    ASSUMPTIONS: ClassVar[tuple[str, ...]] = (
        "exact model: the displaced chain multiplied out",
        "FORM and importance sampling in independent standard normal numbers; discs without polar angles",
    )

    COLUMNS: ClassVar = (
        Column(lambda row: row.demand(absolute(row.specification.quantity)), notebook="specification"),
        Column("specification", demanded, report="specification"),
        Column("specification.quantity", frame="quantity"),
        Column("specification.limit", frame="limit"),
        Column("specification.required", frame="required"),
        Column(lambda row: (row.probability, row.interval), frame="probability", has_interval=True),
        Column(lambda row: (row.best.probability, row.best.interval), frame="failure", has_interval=True),
        Column(
            lambda row: f"{row.best.probability:.3g}" if row.resolved else "not resolved",
            notebook="P(failure)", report="probability of failure",
        ),
        Column("best.interval", in_words, notebook="interval", report="interval"),
        Column("met", frame="met"),
        Column("verdict", frame="verdict"),
        Column("resolved", frame="resolved"),
        Column("best.method", notebook="by", report="by", frame="method", is_words=True),
        Column("nearest.probability", "{:.3g}".format, notebook="FORM"),
        Column("form.probability", frame="form"),
        Column("nearest.beta", "{:.4g}".format, notebook="β", frame="beta"),
        Column(lambda row: row.verdict if row.met else row.verdict.upper(), notebook="", report="verdict", is_words=True),
    )  # fmt: skip

    poses: tuple[PoseReliability, ...]

    @property
    def met(self) -> bool:
        """True if every specification is met at every pose."""
        return all(entry.met for pose in self.poses for entry in pose.specifications)

    def to_pandas(self, lines: Literal["specifications", "methods"] = "specifications") -> pandas.DataFrame:
        """Return the result as a data frame, m and rad: a row for each pose and specification, or method.

        Specifications have the columns ``quantity``, ``limit``, ``required``; ``probability`` (of keeping the limit)
        and ``failure`` (of exceeding it) with ``…_lower`` and ``…_upper``; ``met``, ``verdict``, ``resolved``,
        ``method``; and ``form`` and ``beta`` of the nearest design point. Methods have ``failure``, ``variation``,
        ``evaluations`` and ``resolved``. ``attrs`` gives the settings.

        Args:
            lines: Kind of rows: ``"specifications"`` or ``"methods"``.

        Raises:
            UnknownNameError: There is no such kind.
        """
        if lines not in ("specifications", "methods"):
            raise UnknownNameError("table of a reliability analysis", lines, ("specifications", "methods"))
        if lines == "specifications":
            return self._frame(
                ("specification",), rows=lambda pose: (((spec.name,), spec) for spec in pose.specifications)
            )
        return self._frame(
            ("specification", "method"), METHOD_COLUMNS,
            lambda pose: (((spec.name, row.method), row) for spec in pose.specifications for row in spec.estimates),
        )  # fmt: skip

    def rows(self, pose: PoseReliability) -> tuple[SpecificationReliability, ...]:
        """Return the specifications."""
        return pose.specifications

    @property
    def summary(self) -> str:
        """Text of `repr` after the arm."""
        demands = [entry for pose in self.poses for entry in pose.specifications]
        return (
            f"{sum(entry.met for entry in demands)} of {len(demands)} specifications met, {self.samples:,} samples, "
            f"seed {self.provenance.seed}"
        )

    def _title(self) -> str:
        return "Reliability"

    def _notes(self) -> list[str]:
        of = self.provenance
        comments = [line for pose in self.poses for entry in pose.specifications for line in entry.comments]
        return [
            f"exact model, {self.samples:,} plain samples, seed {of.seed}, statics {of.statics}; intervals at "
            f"{100 * self.confidence:g} % confidence; β: distance of the nearest design point",
            *comments,
            *of.resting_lines,
        ]


LISTED: Final = 3
"""Number of design points listed in full."""

# directions to the faces, edges and corners of a cube, or to the sides and corners of a square; along one axis four to
# either side, which the offset separates
_STARTS: Final = {
    1: np.tile([[1.0, -1.0]], 4),
    **{k: np.array([n for n in np.ndindex((3,) * k) if n != (1,) * k], dtype=float).T - 1.0 for k in (2, 3)},
}


@warns_at_end
@takes_datum
def reliability(
    model: ErrorModel,
    specifications: Specifications,
    poses: Poses = None,
    *,
    seed: int = 0,
    samples: int = 100_000,
    confidence: float = 0.95,
    findings: Sequence[Finding] = (),
    progress: Progress | bool | None = None,
) -> ReliabilityResult:
    """Return the probability that the exact model's error keeps each specification, by several methods.

    Args:
        model: Chain, draws and sources.
        specifications: Limits to judge, one or a list, each from :func:`precision_pin.specification` or its text.
        poses: A pose (name, joint values, or None for the first) or a list of poses.
        seed, samples, confidence: Seed and confidence of all methods; number of plain samples.
        findings: Warnings to include in the result, such as those of the sheet.
        progress: Function called with the number of plain samples added since its last call; ``True`` shows a bar.

    Raises:
        InputError: No specification, a wrong argument, or errors too large to compute with.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> result = pp.reliability(model, "x 18 mm @ 99.999 %", samples=1000)
        >>> best = result.poses[0].specifications[0].best
        >>> print(best.method, f"{best.probability:.1e}")
        importance sampling 1.6e-06
    """
    places, common = check_request(model, poses, seed=seed, confidence=confidence, findings=findings, progress=progress)
    limits = listed_specifications(specifications)
    if not limits:
        raise InputError("no specification is given; give at least one, such as '0.5 mm @ 99.73 %'")
    entries: list[PoseReliability] = []
    warnings: list[str] = []
    for place in places:
        analysis = monte_carlo(
            model, place, samples=samples, seed=seed, specifications=limits, confidence=confidence,
            findings=findings, progress=progress,
        )  # fmt: skip
        warnings += analysis.warnings
        at = model.at(place)
        layout = sampler.to_arrays(at)
        results = [
            _judge_specification(at, layout, specification, verdict, samples, seed, confidence)
            for specification, verdict in zip(limits, analysis.summary.specifications, strict=True)
        ]
        entries.append(PoseReliability(PoseLabel.of(model, place, at), tuple(results)))
    return ReliabilityResult(
        provenance=Provenance.of(model, seed),
        samples=int(samples),
        confidence=float(confidence),
        poses=tuple(entries),
        findings=common,
        warnings=list_warnings(common, warnings),
    )


def _margin(layout: SamplerArrays, specification: Specification, tool_axes: Array) -> Callable[[Array], Array]:
    """Return the margin to the limit, relative to the limit, as a function of component values."""

    def margin(x: Array) -> Array:
        errors = sampler.errors_at(layout, "exact", x)
        return 1 - sizes_of(specification.quantity, errors, tool_axes) / specification.limit

    return margin


def _sides(layout: SamplerArrays, specification: Specification, tool_axes: Array) -> Callable[[Array], Array]:
    """Return the margins ``(sides, N)`` to failures on either side of each axis, defined as in :func:`_margin`.

    A failure is to the side of its largest part. Elsewhere the margin is that of the part along the axis, so that it
    falls all the way to such a failure, also past the middle.
    """
    axes = np.concatenate([of.axes / of.limit for of in specification.conditions(tool_axes)])
    normals = np.concatenate([axes, -axes])

    def margins(x: Array) -> Array:
        errors = sampler.errors_at(layout, "exact", x)
        margin = 1 - sizes_of(specification.quantity, errors, tool_axes) / specification.limit
        along = normals @ errors
        detour = np.maximum(1 - along, along.max(axis=0) - along)
        return np.where(along.argmax(axis=0) == np.arange(len(normals))[:, None], margin, detour)

    return margins


def _facing(at: PoseModel, specification: Specification) -> Space:
    """Return the space with laws whose normal numbers fit rare errors of the tangent."""
    axes = np.concatenate([of.axes / of.limit for of in specification.conditions(at.posture.tool_axes)])
    draws = zip(at.space.draws, at.space.slices, strict=True)
    facing = (replace(draw, law=draw.law.facing(axes @ at.jacobian[:, rows])) for draw, rows in draws)
    return replace(at.space, draws=tuple(facing))


def _starts(at: PoseModel, specification: Specification) -> list[Array]:
    """Return the starting points of the search, two standard deviations along the tangent's steepest directions."""
    spread = np.sqrt(at.space.block_covariance.variances)
    slopes = np.hstack(
        [
            (at.jacobian * spread).T @ of.axes.T @ _STARTS[len(of.axes)]
            for of in specification.conditions(at.posture.tool_axes)
        ]
    )
    lengths = np.linalg.norm(slopes, axis=0)
    # a small random offset, because a gradient may vanish by symmetry
    offset = 0.3 * np.random.Generator(np.random.Philox(0)).standard_normal(slopes.shape)
    scaled = 2 * np.divide(slopes, lengths, out=np.zeros_like(slopes), where=lengths > 0)
    return list((scaled + offset).T)


def _judge_specification(
    at: PoseModel,
    layout: SamplerArrays,
    specification: Specification,
    result: SpecificationResult,
    samples: int,
    seed: int,
    confidence: float,
) -> SpecificationReliability:
    successes = round(result.probability * samples)
    plain = plain_estimate(samples - successes, samples, confidence)
    axes = at.posture.tool_axes
    events = rare_events(
        _facing(at, specification), _margin(layout, specification, axes), _starts(at, specification), plain, seed, confidence,
        _sides(layout, specification, axes),
    )  # fmt: skip
    failures = (_describe_failure(at, layout, point, events.strata.parts) for point in events.form.points[:LISTED])
    return SpecificationReliability(
        **vars(events),
        specification=specification,
        failures=tuple(failures),
        varies=result.varies,
        grounds=result.grounds,
    )


def _describe_failure(
    at: PoseModel, layout: SamplerArrays, point: DesignPoint, strata: Sequence[Stratum]
) -> LikelyFailure:
    x = strata[point.stratum].values(point.u[:, None])
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
        error=sampler.errors_at(layout, "exact", x)[:, 0],
        importance=dict(sorted(shares.items(), key=lambda entry: -entry[1])),
    )
