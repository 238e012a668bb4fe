"""Result of an error budget."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from precision_pin.analyses.provenance import PoseLabel
from precision_pin.analyses.result import Result, name_pose
from precision_pin.analyses.shares import VECTORS, Shares, SourceShare
from precision_pin.base.arrays import Keys
from precision_pin.base.errors import UnknownNameError
from precision_pin.render.html import Table
from precision_pin.render.tables import data_frame, interval_columns, number, plus_minus
from precision_pin.statistics import QUANTITIES
from precision_pin.statistics.intervals import Estimate

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]


@dataclass(frozen=True)
class Halved:
    """Effect of halving one draw's tolerance: new values, and the change of the quantile with the same random numbers.

    Attributes:
        std: Standard deviations, m and rad, closed form; for position and attitude the root of the trace.
        quantile: Quantile by ``position.norm`` and ``attitude.norm``, m and rad; ``None`` where not resolved.
    """

    std: Mapping[str, float]
    quantile: Mapping[str, Estimate | None]
    change: Mapping[str, Estimate | None]


@dataclass(frozen=True)
class DrawShare:
    """Contribution of one draw.

    Attributes:
        unbounded: True if its reach is infinite in some component and was cut at ``k`` standard deviations.
        share: Share of the variance, closed form; Shapley effects for correlated draws.
        components: Shares of the single numbers of a draw of several, by name.
        reach: Half-width of the range that it causes in each component, first order, m and rad.
        worst_case: Share of the sum of the reaches of all draws.
        halved: Effect of halving its tolerance.
        words, tolerance: Description of the draw and of its tolerance, as text.
    """

    name: str
    scope: str
    unbounded: bool
    share: Shares
    components: Mapping[str, Shares]
    reach: Mapping[str, float]
    worst_case: Shares
    halved: Halved
    words: str
    tolerance: str


@dataclass(frozen=True)
class Group:
    """Sobol indices of a draw, or of several draws that are correlated with one another.

    Attributes:
        draws: Names of the draws.
        share: Share of the variance, closed form.
        first, total: Indices of the exact model by quantity; ``None`` where it does not vary or is not resolved.
        nonlinear: Quantities whose index differs from the closed form by over one percentage point beyond the interval.
    """

    draws: tuple[str, ...]
    share: Shares
    first: Mapping[str, Estimate | None]
    total: Mapping[str, Estimate | None]
    nonlinear: tuple[str, ...]


@dataclass(frozen=True)
class PlaceShare:
    """Share of a joint or a chain link."""

    name: str
    share: Shares


@dataclass(frozen=True)
class Sums:
    """Sums of the shares of one quantity, as a check.

    Attributes:
        closed: Sum of the closed-form shares: 1 to rounding.
        first: Sum of the first-order indices: 1 if the exact model has no interactions, less otherwise.
        std: Standard deviation of the tangent model, m or rad.
        variance: Sampled variance of the exact model; ``None`` where not resolved.
    """

    closed: float | None
    first: Estimate | None
    std: float | None
    variance: Estimate | None


@dataclass(frozen=True)
class PoseBudget:
    """Error budget at one pose.

    Attributes:
        nominal: Error with every parameter at its mean, ``[d; δ]``.
        std: Standard deviations of the tangent model, m and rad.
        quantile: Quantile of |d| and |δ| of the exact model; ``None`` where not resolved.
        reach: Half-width of the range of every component, first order.
        draws, groups, sources, places: Shares of draws, correlated groups, sources, and joints and links.
        sums: Sums of the shares, by quantity.
        warnings: One line each.
    """

    pose: PoseLabel
    nominal: tuple[float, ...]
    std: Mapping[str, float]
    quantile: Mapping[str, Estimate | None]
    reach: Mapping[str, float]
    draws: tuple[DrawShare, ...]
    groups: tuple[Group, ...]
    sources: tuple[SourceShare, ...]
    places: tuple[PlaceShare, ...]
    sums: Mapping[str, Sums]
    warnings: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the entry of ``poses`` in the JSON; null where a quantity does not vary or is not resolved."""
        return dataclasses.asdict(self) | {"pose": self.pose.to_dict()}

    @property
    def ranked(self) -> tuple[DrawShare, ...]:
        """Draws in descending order of their share of position; draws with equal shares keep their order."""
        return tuple(sorted(self.draws, key=lambda draw: -round(draw.share.get("position") or 0.0, 9)))

    def draw(self, name: str) -> DrawShare:
        """Return the entry of a draw."""
        return next(line for line in self.draws if line.name == name)

    def group(self, name: str) -> Group:
        """Return the group of a draw."""
        return next(line for line in self.groups if name in line.draws)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class BudgetResult(Result):
    """Error budgets; ``k`` cuts unbounded laws (standard deviations), ``marked`` is the quantiles' probability."""

    schema: ClassVar[str] = "precision-pin/budget/1"
    KEYS: ClassVar[Keys] = (
        *("*head", "samples", "confidence", "k", "bound_at=k", "marked"),
        *("assumptions", "warnings", "findings", "poses"),
    )

    ASSUMPTIONS: ClassVar[tuple[str, ...]] = (
        "share: closed form, tangent model at the means; of position and attitude: share of the trace of the covariance",
        "share of correlated draws or components, and of a source or joint in them: Shapley effects of the linear model",
        "first, total: Sobol indices of the exact model; intervals are for each number by itself",
        "a draw that several sources use has its own line among the sources",
        "joints and links: negative where a number that acts at several of them has opposite effects there",
        "worst_case: share of the half-width of the first-order range of a component; unbounded laws reach k deviations",
        "null: does not vary, or is not resolved (too few points for tails or rare values of the laws, a jump at the quantile)",
        "halved: the draw's deviation from its mean is halved, all else unchanged; std in closed form, quantile sampled",
    )

    k: float
    marked: float
    poses: tuple[PoseBudget, ...]

    def to_pandas(self, lines: Literal["draws", "sources", "places"] = "draws") -> pandas.DataFrame:
        """Return a data frame, m and rad, NaN where not available: a row for each pose, line and quantity.

        The quantities are position, attitude, position.norm … attitude.z. Draws have the columns ``share``; ``first``
        and ``total`` (Sobol indices of uncorrelated draws) with ``…_lower`` and ``…_upper``; ``reach`` and
        ``worst_case``; ``halved_std``; and for norms ``halved_quantile`` and ``halved_change`` with their intervals.
        Sources and places (joints and links) have a ``share``. ``attrs`` gives the settings.

        Args:
            lines: Kind of rows: ``"draws"``, ``"sources"`` or ``"places"``.

        Raises:
            UnknownNameError: There is no such kind.
        """
        if lines not in ("draws", "sources", "places"):
            raise UnknownNameError("table of a budget", lines, ("draws", "sources", "places"))
        rows_of = _draw_rows if lines == "draws" else lambda pose: _share_rows(getattr(pose, lines))
        rows = [
            ((label, *key), columns)
            for label, pose in zip(self.labels, self.poses, strict=True)
            for key, columns in rows_of(pose)
        ]
        return data_frame(["pose", lines.removesuffix("s"), "quantity"], rows, self.attributes())

    @property
    def summary(self) -> str:
        """Text of `repr` after the arm."""
        draws = len(self.poses[0].draws)
        return f"poses {len(self.poses)}, draws {draws}, {self.samples:,} points, seed {self.provenance.seed}"

    def _title(self) -> str:
        return "Error budget"

    def _table(self, pose: PoseBudget) -> Table:
        columns = (
            *("draw", "per", "d: share [%]", "S1 [%]", "ST [%]", "δ: share [%]", "ST [%]"),
            f"halved: {100 * self.marked:g} % of |d| [mm]",
        )
        return Table(columns, [_cells(pose, draw) for draw in pose.ranked], _pose_heading(pose, self.marked), words=2)

    def _notes(self) -> list[str]:
        return [
            "share: of the variance, closed form, first order; S1, ST: first-order and total index of the exact model, "
            "%; halved: what halving this tolerance alone changes",
            f"{self.samples:,} points a set, seed {self.provenance.seed}, statics {self.provenance.statics}; ± half of an "
            f"interval at {100 * self.confidence:g} % confidence",
        ]


_Rows = Iterator[tuple[tuple[str, str], dict[str, float]]]


def _draw_rows(pose: PoseBudget) -> _Rows:
    for draw in pose.draws:
        group = pose.group(draw.name)
        for quantity in (*VECTORS, *QUANTITIES):
            is_alone = len(group.draws) == 1
            row = {"share": number(draw.share.get(quantity))}
            row |= _estimate_columns("first", group.first.get(quantity) if is_alone else None)
            row |= _estimate_columns("total", group.total.get(quantity) if is_alone else None)
            row["reach"] = number(draw.reach.get(quantity))
            row["worst_case"] = number(draw.worst_case.get(quantity))
            row["halved_std"] = number(draw.halved.std.get(quantity))
            row |= _estimate_columns("halved_quantile", draw.halved.quantile.get(quantity))
            row |= _estimate_columns("halved_change", draw.halved.change.get(quantity))
            yield (draw.name, quantity), row


def _share_rows(lines: Sequence[SourceShare | PlaceShare]) -> _Rows:
    for line in lines:
        for quantity, share in line.share.items():
            yield (line.name, quantity), {"share": number(share)}


def _estimate_columns(name: str, estimate: Estimate | None) -> dict[str, float]:
    return interval_columns(name, estimate and estimate.value, estimate and estimate.interval)


def _cells(pose: PoseBudget, draw: DrawShare) -> list[str]:
    group = pose.group(draw.name)
    shares = {vector: draw.share.get(vector) for vector in VECTORS}
    position, attitude = ("-" if share is None else f"{100 * share + 0.0:.2f}" for share in shares.values())
    indices = [group.first["position"], group.total["position"], group.total["attitude"]]
    first, total, turned = (scaled(index if len(group.draws) == 1 else None, 100) for index in indices)
    halved = scaled(draw.halved.change["position.norm"], 1e3)
    return [draw.name, draw.scope, position, first, total, attitude, turned, halved]


def scaled(estimate: Estimate | None, factor: float, decimals: int = 3, *, signed: bool = False) -> str:
    """Return a scaled estimate as text with half its interval after ±; ``-`` for none."""
    if estimate is None:
        return "-"
    return plus_minus(factor * estimate.value, factor * estimate.half_width, decimals=decimals, signed=signed)


def _pose_heading(pose: PoseBudget, level: float) -> str:
    quantiles = "; ".join(
        f"{100 * level:g} % of {symbol} within {scaled(pose.quantile[f'{vector}.norm'], 1e3)} {unit}"
        for vector, symbol, unit in zip(VECTORS, ("|d|", "|δ|"), ("mm", "mrad"), strict=True)
    )
    return f"{name_pose(pose.pose)}; {quantiles}"
