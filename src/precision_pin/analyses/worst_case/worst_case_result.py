"""Result of a worst case at one or several poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Final, final

import numpy as np

from precision_pin.analyses.provenance import PoseLabel
from precision_pin.analyses.result import Result, name_pose
from precision_pin.analyses.worst_case.largest_norm import Farthest
from precision_pin.base.arrays import Array
from precision_pin.base.record import Keys, Record
from precision_pin.render.notebook import Table
from precision_pin.render.tables import milli, symbol, unit
from precision_pin.statistics import QUANTITIES, Distribution
from precision_pin.statistics.digits import round_end

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]

SEEN_LEVEL: Final = 0.9973
"""Probability of the sampled quantile that is shown with the bound."""

BENT: Final = 1e-3
"""Share of the bound by which the exact model may exceed it without a warning."""

_ROUNDING: Final = 1e-14


@final
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


@final
@dataclass(frozen=True)
class ComponentBound:
    """Bounds of a component of the first-order model (m or rad), and the smallest and largest sampled value."""

    quantity: str
    low: float
    high: float
    seen: tuple[float, float]


@final
@dataclass(frozen=True, eq=False)
class ExactMaximum(Record):
    """Largest error of the exact model found by local search, a lower bound of the maximum.

    Attributes:
        norm, error: |d| or |δ| (m, rad) and the whole error ``(6,)``.
        parameters: Values of all components at this error, SI.
        starts: Number of starting points of the search.
    """

    norm: float
    error: Array
    parameters: Mapping[str, float]
    starts: int


@final
@dataclass(frozen=True, eq=False)
class NormBound(Record):
    """Worst case of |d| or |δ|.

    Attributes:
        quantity: ``"position.norm"`` or ``"attitude.norm"``.
        first_order: Largest norm of the first-order model, and the direction of that error.
        nominal: Contribution of the error at the means, u·e0 along that direction u (m, rad).
        contributions: Contribution of each draw, h(Jᵀu), in descending order; with ``nominal`` their sum is the worst
            case.
        parameters: Values of the components at the worst case, SI.
        exact_error: ``(6,)`` error of the exact model at these values.
        exact_norm: Norm of this error.
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

    @property
    def exceeded(self) -> bool:
        """True if the exact model exceeds the first-order bound by more than a thousandth."""
        return self.found.norm > self.first_order.upper * (1 + BENT) + _ROUNDING

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
            "quantile": {SEEN_LEVEL: self.seen.quantile(SEEN_LEVEL)},
            "quantile_interval": {SEEN_LEVEL: self.seen.quantile_interval(SEEN_LEVEL)},
        }


@final
@dataclass(frozen=True, eq=False)
class PoseWorstCase(Record):
    """Worst case at one pose.

    Attributes:
        pose: Name and joint values of the pose.
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
        return {one.quantity: {"first_order": (one.low, one.high), "seen": one.seen} for one in self.components}


@final
@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class WorstCaseResult(Result):
    """Worst case at one or several poses, with samples of the exact model for comparison.

    Attributes:
        k: Number of standard deviations at which unbounded laws are cut.
        cut: Draws whose laws were cut.
        draws: Number of draws.
    """

    schema: ClassVar[str] = "precision-pin/worst-case/1"
    KEYS: ClassVar[Keys] = (
        *("*head", "samples", "model", "confidence", "k", "cut", "assumptions", "warnings", "findings", "poses"),
    )
    model: ClassVar[str] = "exact"

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
        """Return where unbounded laws are cut, with these names of them."""
        if not self.cut:
            return "every law is bounded"
        return f"unbounded laws are cut at k = {self.k:g} standard deviations, beyond which samples may lie: {names}"

    def to_pandas(self) -> pandas.DataFrame:
        """Return the result as a data frame, m and rad, NaN where not available: a row for each pose and quantity.

        ``low`` and ``high`` are the bounds of the first-order model (a norm has no ``low``), and ``attained`` is the largest
        norm that is proven to be reached. ``exact_there`` is the norm of the exact model at the same parameters,
        ``exact_found`` the largest norm found by the search (norms only). ``seen_min`` and ``seen_max`` are the smallest and
        largest sampled values. ``attrs`` gives the settings.
        """
        return self._frame("quantity", lambda pose: _rows(pose).items())

    @property
    def summary(self) -> str:
        """What `repr` says of it."""
        largest = max(pose.position.first_order.upper for pose in self.poses)
        return (
            f"poses {len(self.poses)}, draws {self.draws}, first-order |d| at most {1e3 * largest:.4g} mm, "
            f"seed {self.provenance.seed}"
        )

    def _title(self) -> str:
        return "Worst case"

    def _table(self, pose: PoseWorstCase) -> Table:
        columns = ("", "unit", "first order, from", "to", "exact, found", "smallest seen", "largest seen")
        rows = []
        for name, row in _rows(pose).items():
            ends = bound_milli(row["low"], up=False), bound_milli(row["high"], up=True)
            seen = (milli(row[field]) for field in ("exact_found", "seen_min", "seen_max"))
            rows.append([symbol(name), unit(name), *ends, *seen])
        return Table(columns, rows, name_pose(pose.pose), words=2)

    def _notes(self) -> list[str]:
        of = self.provenance
        return [
            *self.assumptions,
            f"seen: among {self.samples:,} samples, seed {of.seed}, exact model, statics {of.statics}; base axes",
        ]


def bound_milli(value: float, *, up: bool, digits: int = 6) -> str:
    """Return a bound in mm or mrad as text, rounded outwards; ``-`` for none."""
    text = milli(value, digits)
    if text == "-" or (float(text) >= 1e3 * value if up else float(text) <= 1e3 * value):
        return text
    return f"{round_end(1e3 * value, digits, up=up):.{digits}g}"


def _rows(pose: PoseWorstCase) -> dict[str, dict[str, float]]:
    """Return the figures of every quantity, norms before their components."""
    rows = {
        bound.quantity: {
            "low": np.nan,
            "high": bound.first_order.upper,
            "attained": bound.first_order.lower,
            "exact_there": bound.exact_norm,
            "exact_found": bound.found.norm,
            "seen_min": bound.seen.min,
            "seen_max": bound.seen.max,
        }
        for bound in (pose.position, pose.attitude)
    }
    nothing = dict.fromkeys(("attained", "exact_there", "exact_found"), np.nan)
    for one in pose.components:
        low, high = one.seen
        rows[one.quantity] = {"low": one.low, "high": one.high, **nothing, "seen_min": low, "seen_max": high}
    return {quantity: rows[quantity] for quantity in QUANTITIES}
