"""Result of the exact laws of a model."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.exact_law.number_law import NumberLaw
from precision_pin.analyses.provenance import PoseLabel
from precision_pin.analyses.result import Result, name_pose
from precision_pin.base.arrays import Array
from precision_pin.base.record import Keys, Record, encode
from precision_pin.render.notebook import Table
from precision_pin.render.tables import MOST_POSES, milli, number, symbol, unit
from precision_pin.statistics.digits import round_end

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]

LEVELS: Final = (0.00135, 0.01, 0.05, 0.5, 0.95, 0.99, 0.9973, 0.99865)

LEVELS_SHOWN: Final = (0.00135, 0.05, 0.5, 0.95, 0.9973, 0.99865)
"""Quantiles of the tables; the notebook has no room for the last."""
_CURVE: Final = 241


@final
@dataclass(frozen=True, eq=False)
class Agreement(Record):
    """Distance between samples of the tangent model and the exact law.

    Attributes:
        samples: Number of samples.
        distance: Kolmogorov distance: the largest difference of the two cumulative laws, rounded up by at most
            ``slack``.
        band: Bound of the distance at the stated confidence: √(ln(2/α)/2N) (Dvoretzky, Kiefer and Wolfowitz 1956;
            Massart 1990).
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
        """The same in words."""
        return "within the band" if self.agrees else "BEYOND THE BAND"


@final
@dataclass(frozen=True, eq=False)
class ExactLaw:
    """Law of one quantity.

    Attributes:
        quantity: ``position.x`` … ``attitude.z`` or a norm; m or rad, base axes.
        law: Object with ``cumulative``, ``density`` and ``quantile``; ``None`` if the law is not available.
        reason: Reason why the law is not available.
        mean, std: Mean and standard deviation; ``None`` for a norm that is not available.
        contributors: Number of contributing draws; all normal draws count as one.
        error: Bound of the error of every cumulative probability, at a number within rounding of the argument.
        quantiles, quantile_errors: Quantiles at :data:`LEVELS`, and the error bound of each.
        agreement: Agreement with samples of the tangent model.
    """

    quantity: str
    law: NumberLaw | None
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
        x = np.linspace(low, high, _CURVE)
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


@final
@dataclass(frozen=True, eq=False)
class PoseLaws(Record):
    """Laws at one pose.

    Attributes:
        pose: Name and joint values of the pose.
        laws: Laws of the eight quantities, by name.
        warnings: Quantities whose exact model does not follow the first-order law, one line each.
    """

    pose: PoseLabel
    laws: dict[str, ExactLaw]
    warnings: tuple[str, ...] = ()


@final
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

    poses: tuple[PoseLaws, ...]

    @property
    def agrees(self) -> bool:
        """True if every law agrees with its samples."""
        laws = [law for pose in self.poses for law in pose.laws.values()]
        return all(law.agreement.agrees for law in laws if law.agreement is not None)

    def to_pandas(self) -> pandas.DataFrame:
        """Return the result as a data frame, m and rad, NaN where not available: a row for each pose and quantity.

        The columns are ``mean``, ``std``, ``contributors``, ``cumulative_error``; ``quantile_0.95``, … with ``…_error``, its
        error bound; and ``distance`` and ``band`` of the agreement with samples. ``attrs`` gives the settings.
        """
        return self._frame("quantity", lambda pose: ((name, _columns(law)) for name, law in pose.laws.items()))

    @property
    def summary(self) -> str:
        """What `repr` says of it."""
        laws = [law for pose in self.poses for law in pose.laws.values()]
        known = sum(law.law is not None for law in laws)
        return (
            f"poses {len(self.poses)}, {known} of {len(laws)} laws known, "
            f"{'in agreement' if self.agrees else 'NOT in agreement'} with {self.samples:,} samples, "
            f"seed {self.provenance.seed}"
        )

    def _title(self) -> str:
        return "Exact law of the first-order model"

    def _table(self, pose: PoseLaws) -> Table:
        levels = (f"{100 * level:g} %" for level in LEVELS_SHOWN[:-1])
        columns = ("", "unit", "mean", "std", *levels, "draws", "error of F", "samples")
        return Table(columns, [_cells(law) for law in pose.laws.values()], name_pose(pose.pose), words=2)

    def _notes(self) -> list[str]:
        of, shown = self.provenance, self.poses[:MOST_POSES]
        return [
            *dict.fromkeys(line for pose in shown for line in missing(pose.laws.values())),
            f"error of F: bound of the error of every cumulative probability; compared with {self.samples:,} samples of "
            f"the same model, seed {of.seed}, at {100 * self.confidence:g} % confidence; statics {of.statics}",
        ]


def _columns(law: ExactLaw) -> dict[str, float]:
    known, found = law.law is not None, law.agreement
    row = {"mean": number(law.mean), "std": number(law.std), "contributors": law.contributors}
    row["cumulative_error"] = law.error if known else math.nan
    for rank, level in enumerate(LEVELS):
        row[f"quantile_{level}"] = law.quantiles[rank] if known else math.nan
        row[f"quantile_{level}_error"] = law.quantile_errors[rank] if known else math.nan
    return row | {"distance": number(found and found.distance), "band": number(found and found.band)}


def _cells(law: ExactLaw) -> list[str]:
    """Return a row of the table in a notebook."""
    cells = [symbol(law.quantity), unit(law.quantity), milli(law.mean), milli(law.std)]
    quantiles = {level: milli(*known) for level, known in law.shown_quantiles(6).items()}
    cells += [quantiles.get(level, "-") for level in LEVELS_SHOWN[:-1]]
    if law.law is None or law.agreement is None:
        return [*cells, "-", "-", "-"]
    return [*cells, str(law.contributors), bound_text(law.error), law.agreement.said]


def missing(laws: Iterable[ExactLaw]) -> list[str]:
    """Return a line for each law that is not available, with the reason."""
    return [f"{symbol(law.quantity)}: {law.reason}" for law in laws if law.law is None]


def bound_text(bound: float) -> str:
    """Return a bound with one digit, rounded up."""
    return "0" if bound <= 0 else f"{round_end(bound, 1, up=True):.0e}"


def quantile_digits(value: float, error: float, digits: int) -> int:
    """Return the number of certain digits of a quantile, at most ``digits``."""
    if not value or not error:
        return digits
    return max(1, min(digits, math.floor(math.log10(abs(value))) - math.ceil(math.log10(2 * error)) + 1))
