"""Result of the moments analysis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final, Literal, final

import numpy as np

from precision_pin.analyses.provenance import PoseLabel
from precision_pin.analyses.result import Result, name_pose
from precision_pin.base.arrays import Array
from precision_pin.base.record import Keys, Record
from precision_pin.render.notebook import Table
from precision_pin.render.tables import (
    data_frame,
    interval_columns,
    plus_minus,
    symbol,
    unit,
)
from precision_pin.statistics import COMPONENTS, NORMS, QUANTITIES

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


@final
@dataclass(frozen=True, eq=False)
class Measured(Record):
    """Numbers with their standard errors.

    Attributes:
        value: Values of any shape; m, rad and products of these; NaN where the samples do not resolve them.
        standard_error: Standard error of each value; ``None`` for a closed form.
        half_width: Half-width of each interval; ``None`` for a closed form.
    """

    value: Array
    standard_error: Array | None = None
    half_width: Array | None = None

    def interval(self, *index: int) -> tuple[float, float] | None:
        """Return the interval of one of the numbers; ``None`` for a closed form and where not resolved."""
        if self.half_width is None or not np.isfinite(self.half_width[index]):
            return None
        middle, half = float(self.value[index]), float(self.half_width[index])
        return middle - half, middle + half


@final
@dataclass(frozen=True, eq=False)
class Remainder(Record):
    """Range of validity of a closed form.

    Attributes:
        order: Order of the last terms, in powers of the spread: 4, or 2 where moments of the draws are unknown. The
            first omitted terms are of the next order; with symmetric laws, of the next even order.
        last_mean: ``(6,)`` terms of the mean beyond the second order (at order 2: those of the second), a measure of
            the omitted terms, not a bound.
        last_covariance: ``(6, 6)`` terms of the covariance beyond J Σ Jᵀ; ``None`` at order 2.
    """

    order: int
    last_mean: Array
    last_covariance: Array | None


@final
@dataclass(frozen=True, eq=False)
class PoseMoments(Record):
    """Moments at one pose, base axes.

    Attributes:
        pose: Name and joint values of the pose.
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
        result: Array = np.sqrt(np.maximum(np.diagonal(self.first_order_covariance), 0.0))
        return result

    @property
    def first_order(self) -> dict[str, Array]:
        """Mean, standard deviations and covariance of the first-order model."""
        return {"mean": self.first_order_mean, "std": self.first_order_std, "covariance": self.first_order_covariance}

    @property
    def variance(self) -> Measured:
        """Diagonal of the covariance, ``(6,)``."""
        whole = self.covariance
        return Measured(
            np.diagonal(whole.value).copy(),
            None if whole.standard_error is None else np.diagonal(whole.standard_error).copy(),
            None if whole.half_width is None else np.diagonal(whole.half_width).copy(),
        )

    @property
    def std(self) -> Measured:
        """Standard deviations of the components, ``(6,)``."""
        return deviations(self.variance)

    @property
    def norm_std(self) -> Measured | None:
        """Standard deviations of |d| and |δ|, ``(2,)``."""
        return None if self.norm_variance is None else deviations(self.norm_variance)


@final
@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class MomentsResult(Result):
    """Mean and covariance of the exact error at one or several poses.

    Attributes:
        method: Method of computation; a closed form needs no samples.
    """

    schema: ClassVar[str] = "precision-pin/moments/1"
    KEYS: ClassVar[Keys] = (
        "*head",
        "model",
        "method",
        "samples",
        "confidence",
        "assumptions",
        "warnings",
        "findings",
        "poses",
    )
    model: ClassVar[str] = "exact"

    method: Method
    poses: tuple[PoseMoments, ...]

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Assumptions of the numbers, one sentence each."""
        return ASSUMPTIONS

    def to_pandas(self) -> pandas.DataFrame:
        """Return the result as a data frame, m and rad, NaN where not available: a row for each pose and quantity.

        The columns are ``mean`` and ``std``, each with ``_lower`` and ``_upper``. ``attrs`` gives the settings.

        Raises:
            InputError: pandas is not installed.
        """
        rows = [
            (
                (label, quantity),
                {
                    key: number
                    for name, entry in zip(("mean", "std"), entries(pose, row), strict=True)
                    for key, number in interval_columns(name, *(entry or (None, None))).items()
                },
            )
            for label, pose in zip(self.labels, self.poses, strict=True)
            for row, quantity in enumerate(QUANTITIES)
        ]
        return data_frame(["pose", "quantity"], rows, self.attributes())

    @property
    def summary(self) -> str:
        """What `repr` says of it."""
        return f"poses {len(self.poses)}, {self.method}, {self.samples:,} samples, seed {self.provenance.seed}"

    def _title(self) -> str:
        return "Moments of the error"

    def _table(self, pose: PoseMoments) -> Table:
        rows = [
            [symbol(quantity), unit(quantity), *(cell(entry) for entry in entries(pose, row))]
            for row, quantity in enumerate(QUANTITIES)
        ]
        return Table(("", "unit", "mean", "standard deviation"), rows, name_pose(pose.pose), words=2)

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
    """Return standard deviations with intervals that follow from those of the variances."""
    value = np.sqrt(np.maximum(variance.value, 0.0))
    if variance.standard_error is None or variance.half_width is None:
        return Measured(value)
    low, high = (np.sqrt(np.maximum(variance.value + sign * variance.half_width, 0.0)) for sign in (-1.0, 1.0))
    safe = np.where(value > 0, value, 1.0)
    error = np.where(value > 0, variance.standard_error / (2 * safe), np.sqrt(variance.standard_error))
    return Measured(value, error, np.maximum(high - value, value - low))


_Entry = tuple[float, tuple[float, float] | None] | None


def entries(pose: PoseMoments, row: int) -> tuple[_Entry, _Entry]:
    """Return mean and standard deviation of a quantity, by its row of the eight, each with its interval."""
    if row in NORMS:
        index = NORMS.index(row)
        pair: tuple[Measured | None, Measured | None] = (pose.norm_mean, pose.norm_std)
    else:
        index = COMPONENTS.index(row)
        pair = (pose.mean, pose.std)
    mean, std = (None if one is None else (float(one.value[index]), one.interval(index)) for one in pair)
    return mean, std


def cell(entry: _Entry) -> str:
    """Return a number in mm or mrad with the half-width of its interval, as text."""
    if entry is None:
        return "-"
    value, interval = entry
    if np.isnan(value):
        return "-"
    half = 0.0 if interval is None else (interval[1] - interval[0]) / 2
    # digits below a picometre are of no use
    return plus_minus(1e3 * value, 1e3 * half, decimals=9)
