"""Result of the reliability analysis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal, final

import numpy as np

from precision_pin.analyses.provenance import PoseLabel
from precision_pin.analyses.reliability.estimates import Estimate, in_words
from precision_pin.analyses.reliability.rare_events import RareEvents
from precision_pin.analyses.result import Result, name_pose
from precision_pin.base.arrays import Array
from precision_pin.base.errors import UnknownNameError
from precision_pin.base.record import Keys, Record
from precision_pin.render.notebook import Table
from precision_pin.render.tables import absolute, data_frame, interval_columns, number, resting_on, unit
from precision_pin.statistics import NO_GROUNDS, Grounds, Specification, Verdict, judge

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]


@final
@dataclass(frozen=True, eq=False)
class LikelyFailure(Record):
    """Design point in terms of the model's parameters.

    Attributes:
        beta, probability: Reliability index and Φ(-β).
        parameters: Value of each component at the point, SI.
        error: ``(6,)`` exact error at the point, m and rad.
        importance: Share of each draw (correlated draws together) in β², in descending order; the sum is 1.
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


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class SpecificationReliability(RareEvents, Record):
    """Reliability for one specification at one pose.

    Attributes:
        specification: The specification.
        failures: The nearest design points in terms of the model's parameters.
        varies: True if the quantity differs from robot to robot.
        grounds: What keeps it from being judged, and what it takes as exact.
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
        """Differences between the methods, one line each, beginning with the consequence for the verdict."""
        means = "the verdict is the same by every method"
        if len(self._verdicts()) > 1:
            means = "the verdict differs between the methods; the samples' interval, which is always valid, decides"
        return (*(f"{means}; {line}" for line in self.contradictions), *self.remarks)

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
        """Verdict by the interval of the best estimate, as in :attr:`precision_pin.statistics.SpecificationResult.verdict`."""
        return "not judged" if self.grounds.not_judged else self._judge(self.best)

    @property
    def said(self) -> str:
        """The verdict in capitals, with the reason why there is none, or with what it takes as exact."""
        return self.grounds.said(self.verdict)

    def _judge(self, estimate: Estimate) -> Verdict:
        low, high = estimate.interval
        allowed = 1 - self.specification.required
        return judge(holds=high <= allowed, fails=low > allowed, varies=self.varies)

    def _verdicts(self) -> set[Verdict]:
        """Return the verdicts by the best and by every resolved estimate."""
        return {self._judge(estimate) for estimate in (self.best, *(one for one in self.estimates if one.resolved))}

    @property
    def met(self) -> bool:
        """True if the verdict is ``"met"``."""
        return self.verdict == "met"

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """Probability of failure, its interval, the method that it is by, and the verdict, as text."""
        probability = f"{self.best.probability:.3g}" if self.resolved else "not resolved"
        verdict = self.verdict if self.met else self.verdict.upper()
        return probability, in_words(self.best.interval), self.best.method, verdict

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


@final
@dataclass(frozen=True, eq=False)
class PoseReliability(Record):
    """Reliability for all specifications at one pose."""

    KEYS: ClassVar[Keys] = ("pose", "spec=specifications")

    pose: PoseLabel
    specifications: tuple[SpecificationReliability, ...]


@final
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

    poses: tuple[PoseReliability, ...]

    @property
    def met(self) -> bool:
        """True if every specification is met at every pose."""
        return all(entry.met for pose in self.poses for entry in pose.specifications)

    def to_pandas(self, lines: Literal["specifications", "methods"] = "specifications") -> pandas.DataFrame:
        """Return the result as a data frame, m and rad: a row for each pose and specification, or method.

        Specifications have the columns ``quantity``, ``limit``, ``required``; ``probability`` (of keeping the limit) and
        ``failure`` (of exceeding it) with ``…_lower`` and ``…_upper``; ``met``, ``verdict``, ``resolved``, ``method``; and
        ``form`` and ``beta`` of the nearest design point. Methods have ``failure``, ``variation``, ``evaluations`` and
        ``resolved``. ``attrs`` gives the settings.

        Args:
            lines: Kind of rows: ``"specifications"`` or ``"methods"``.

        Raises:
            UnknownNameError: There is no such kind.
        """
        if lines not in ("specifications", "methods"):
            raise UnknownNameError("table of a reliability analysis", lines, ("specifications", "methods"))
        entries = [
            ((label, _demand(entry.specification, entry.specification.quantity)), entry)
            for label, pose in zip(self.labels, self.poses, strict=True)
            for entry in pose.specifications
        ]
        if lines == "specifications":
            rows = [(key, _columns(entry)) for key, entry in entries]
            return data_frame(["pose", "specification"], rows, self.attributes())
        methods = [((*key, one.method), _method_columns(one)) for key, entry in entries for one in entry.estimates]
        return data_frame(["pose", "specification", "method"], methods, self.attributes())

    @property
    def summary(self) -> str:
        """What `repr` says of it."""
        demands = [entry for pose in self.poses for entry in pose.specifications]
        return (
            f"{sum(entry.met for entry in demands)} of {len(demands)} specifications met, {self.samples:,} samples, "
            f"seed {self.provenance.seed}"
        )

    def _title(self) -> str:
        return "Reliability"

    def _table(self, pose: PoseReliability) -> Table:
        columns = ("specification", "P(failure)", "interval", "by", "FORM", "β", "")
        return Table(columns, [_cells(entry) for entry in pose.specifications], name_pose(pose.pose))

    def _notes(self) -> list[str]:
        of = self.provenance
        comments = [line for pose in self.poses for entry in pose.specifications for line in entry.comments]
        return [
            f"exact model, {self.samples:,} plain samples, seed {of.seed}, statics {of.statics}; intervals at "
            f"{100 * self.confidence:g} % confidence; β: distance of the nearest design point",
            *comments,
            *resting_on(of.assumed, of.sources, of.origins, of.origins_at),
        ]


def _demand(specification: Specification, quantity: str) -> str:
    """Return a specification as text, with this name of its quantity."""
    milli = f"{1e3 * specification.limit:.10g} {unit(specification.quantity)}"
    return f"{quantity} {milli} @ {100 * specification.required:.10g} %"


def _columns(entry: SpecificationReliability) -> dict[str, Any]:
    return {
        "quantity": entry.specification.quantity,
        "limit": entry.specification.limit,
        "required": entry.specification.required,
        **interval_columns("probability", entry.probability, entry.interval),
        **interval_columns("failure", entry.best.probability, entry.best.interval),
        "met": entry.met,
        "verdict": entry.verdict,
        "resolved": entry.resolved,
        "method": entry.best.method,
        "form": number(entry.form.probability),
        "beta": entry.form.points[0].beta if entry.form.points else np.nan,
    }


def _method_columns(estimate: Estimate) -> dict[str, Any]:
    return {
        **interval_columns("failure", estimate.probability, estimate.interval),
        "variation": estimate.variation,
        "evaluations": estimate.evaluations,
        "resolved": estimate.resolved,
    }


def _cells(entry: SpecificationReliability) -> list[str]:
    """Return a row of the table in a notebook."""
    nearest = entry.form.points[0] if entry.form.points else None
    estimate, interval, method, verdict = entry.cells
    form = ("-", "-") if nearest is None else (f"{nearest.probability:.3g}", f"{nearest.beta:.4g}")
    demand = _demand(entry.specification, absolute(entry.specification.quantity))
    return [demand, estimate, interval, method, *form, verdict]
