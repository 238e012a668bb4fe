"""Several error models side by side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Final, final

from precision_pin.analyses.compare.paired import Difference
from precision_pin.analyses.provenance import PoseLabel
from precision_pin.analyses.result import Outcome
from precision_pin.base.record import Keys, Record
from precision_pin.render.notebook import Table, rendered
from precision_pin.render.tables import milli
from precision_pin.sampling.result import MonteCarloResult
from precision_pin.sheet.differences import SheetDifference
from precision_pin.statistics import QUANTITIES, Specification

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEVELS: Final = (0.5, 0.95, 0.9973)
"""Probabilities of the quantiles that are compared."""


@final
@dataclass(frozen=True)
class Paired(Record):
    """Differences of a model to the first, the same robots in both, m and rad.

    Attributes:
        means: Difference of the mean of each of the eight quantities.
        quantiles: That of their quantiles, by quantity and probability.
        shares: That of the share of robots inside each specification.
    """

    KEYS: ClassVar[Keys] = ("mean=means", "quantile=quantiles", "probability=shares")

    means: Mapping[str, Difference]
    quantiles: Mapping[str, Mapping[float, Difference]]
    shares: tuple[Difference, ...]


@final
@dataclass(frozen=True)
class PoseComparison:
    """The models at one pose.

    Attributes:
        label: The pose.
        laws: Sampled law of each model.
        differences: Of each model but the first to the first.
        variances: Part of each line of sources in the variance of the position, to first order, m², of each model.
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


@final
@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ComparisonResult(Outcome):
    """Laws of several models, sampled with the same robots, and their differences to the first.

    Attributes:
        names: Names of the models.
        samples, model, confidence: Robots; ``"exact"`` or ``"linear"``; confidence of every interval.
        poses: The models at each pose.
        sheet_differences: What each sheet but the first has otherwise than the first.
        specifications: Limits that are judged.
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
        """Return the number of the pose with the largest 95 % quantile of |d| of a model."""
        sizes = [_within(pose.laws[rank]) for pose in self.poses]
        return sizes.index(max(sizes))

    def plot(self) -> Figure:
        """Draw the laws of |d| and |δ| of all models at the worst pose of the first."""
        drawn: Figure = self._output("figure:figure")(self)
        return drawn

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
            name: [{"path": one.path, "before": one.before, "after": one.after} for one in changes]
            for name, changes in zip(self.names[1:], self.sheet_differences, strict=True)
        }

    def __repr__(self) -> str:
        return f"<ComparisonResult of {', '.join(self.names)}: {len(self.poses)} poses, {self.samples:,} robots>"

    def _repr_html_(self) -> str:
        """Return the notebook view: quantiles of |d| and |δ| of every model, mm and mrad."""
        rows = []
        for pose in self.poses:
            for name, law in zip(self.names, pose.laws, strict=True):
                cells = [
                    milli(distribution.quantile(level))
                    for distribution in (law.position.norm, law.attitude.norm)
                    for level in (0.5, 0.95)
                ]
                rows.append([pose.label.name, name, *cells])
        columns = ["pose", "model", "|d| median [mm]", "95 %", "|δ| median [mrad]", "95 %"]
        note = f"{self.samples:,} robots, the same in all models, seed {self.provenance.seed}, {self.model} model"
        return rendered(f"{' against '.join(self.names)}", [Table(columns, rows)], [note, *self.warnings])


def _within(law: MonteCarloResult) -> float:
    value = law.position.norm.quantile(0.95)
    return -1.0 if value is None else value


def _law(law: MonteCarloResult) -> dict[str, Any]:
    """Return the law of a model as the JSON of an analysis has it."""
    whole = law.to_dict()
    kept = ("nominal", *(name.partition(".")[0] for name in QUANTITIES), "spec")
    return {key: whole[key] for key in dict.fromkeys(kept) if key in whole}
