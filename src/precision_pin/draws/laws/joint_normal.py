"""The joint normal law of several numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base import units
from precision_pin.base.arguments import check_numbers, check_whole, shown
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.base.units import Quantity
from precision_pin.draws.laws.law import (
    DEVIATIONS,
    KernelRow,
    Law,
    LawOption,
    SheetForm,
    SheetReader,
    deviations,
    take_rows,
)
from precision_pin.draws.laws.projection import FARTHEST_NORMAL, NORMAL_MOMENTS, Moments, triangular_root


@final
@dataclass(frozen=True)
class JointNormal(Law):
    """Several jointly normal numbers.

    Args:
        matrix: Covariance, row by row; symmetric and positive semi-definite.
        centre: Mean, zero if left out.
        bounds: Lowest and highest value of each number (infinite for none), as a calibration leaves them: samples
            beyond are moved to the bound. Mean, covariance and characteristic function are those without bounds.

    Raises:
        InputError: The matrix is not square, not symmetric or not positive semi-definite, or a bound is not a pair.
    """

    variates: ClassVar[Literal["uniform", "normal"]] = "normal"
    is_normal: ClassVar[bool] = True
    form: ClassVar = SheetForm(
        "joint_normal",
        {"joint_normal": {"std": ["0.1 mm", "0.2 mm"]}},
        "several numbers `.0`, `.1`, …, jointly normal; `std` their standard deviations",
        (
            LawOption("mean", "default 0", ["1 mm", "1 mm"]),
            LawOption("correlation", "rows, of joint_normal", [["1", "0.5"], ["0.5", "1"]]),
        ),
        DEVIATIONS,
    )
    matrix: tuple[tuple[float, ...], ...]
    centre: tuple[float, ...] = ()
    bounds: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        covariance = take_rows(self, "matrix", "the (square) covariance of a joint normal law")
        size = len(self.matrix)
        if covariance.shape != (size, size):
            raise InputError("the covariance of a joint normal law must be square")
        centre = check_numbers("the mean of a joint normal law", self.centre, (None,), f"{size} finite numbers")
        if centre.size not in (0, size):
            raise InputError(f"the mean of a joint normal law has {centre.size} numbers, expected {size}")
        object.__setattr__(self, "centre", tuple(centre.tolist()))
        object.__setattr__(self, "bounds", _check_bounds(self.bounds, size))
        scale = np.sqrt(np.maximum(np.diag(covariance), 0))
        slack = 1e-9 * np.outer(scale, scale)
        if (np.abs(covariance - covariance.T) > slack).any():
            raise InputError("the covariance of a joint normal law must be symmetric")
        if (np.abs(covariance) > (1 + 1e-9) * np.outer(scale, scale)).any():
            raise InputError(
                "the covariance of a joint normal law contains a negative variance or a correlation above 1"
            )
        unit = np.where(scale > 0, scale, 1.0)
        lowest = np.linalg.eigvalsh(covariance / np.outer(unit, unit)).min()
        if lowest < -1e-9:
            raise InputError(f"the covariance of a joint normal law has a negative eigenvalue ({lowest:.3g} scaled)")

    @classmethod
    def from_sheet(cls, reader: SheetReader) -> JointNormal:
        value = reader.settings["joint_normal"]
        if (
            not isinstance(value, Mapping)
            or set(value) != {"std"}
            or not isinstance(value["std"], list)
            or not value["std"]
        ):
            raise reader.error(
                ("joint_normal",), "joint_normal takes the standard deviations: joint_normal: {std: [0.1 mm, 0.2 mm]}"
            )
        std = np.array([reader.half_width("joint_normal", "std", k) for k in range(len(value["std"]))])
        centre: tuple[float, ...] = ()
        if "mean" in reader.settings:
            means = reader.settings["mean"]
            if not isinstance(means, list) or len(means) != std.size:
                raise reader.error(
                    ("mean",), f"the mean of this joint_normal must be a list of {std.size} numbers with units"
                )
            centre = tuple(reader.number("mean", k) for k in range(std.size))
        covariance = _correlation(reader, std.size) * np.outer(std, std)
        return cls(tuple(map(tuple, covariance.tolist())), centre)

    @property
    def size(self) -> int:
        return len(self.matrix)

    @property
    def components(self) -> tuple[str, ...]:
        return tuple(f".{k}" for k in range(self.size))

    @property
    def mean_vector(self) -> Array:
        return np.array(self.centre, dtype=float) if self.centre else np.zeros(self.size)

    @property
    def covariance(self) -> Array:
        return np.array(self.matrix, dtype=float)

    @property
    def root(self) -> Array:
        """Lower-triangular L with L Lᵀ the covariance; a dependent component gets a zero column."""
        return triangular_root(self.covariance)

    def sample(self, variates: Array) -> Array:
        """Return mean + L z."""
        value: Array = self.mean_vector[:, None] + self.root @ variates
        if not self.bounds:
            return value
        low, high = np.array(self.bounds).T
        return np.clip(value, low[:, None], high[:, None])

    def support(self, direction: ArrayLike) -> float:
        """Return infinity, or w·mean if the law does not vary along w; with bounds that of their box."""
        w = np.asarray(direction, dtype=float)
        if self.bounds:
            ends = [x * (high if x > 0 else low) for x, (low, high) in zip(w, self.bounds, strict=True) if x]
            return float(sum(ends))
        rounding = 1e-12 * float(np.abs(w) @ np.sqrt(np.diag(self.covariance)))
        return math.inf if np.abs(self.root.T @ w).max() > rounding else float(w @ self.mean_vector)

    def interval(self, number: int) -> tuple[float, float]:
        """Return the number's mean ± 8.6 σ, within its bounds."""
        check_whole("the index of a number of the law", number, 0, self.size - 1)
        mean, reach = float(self.mean_vector[number]), FARTHEST_NORMAL * math.sqrt(self.matrix[number][number])
        low, high = self.bounds[number] if self.bounds else (-math.inf, math.inf)
        return max(mean - reach, low), min(mean + reach, high)

    def ellipsoid(self, k: float) -> Array:
        """Return the ellipsoid (x - mean)ᵀ Σ⁻¹ (x - mean) = k²."""
        return k * self.root

    def standardised_moments(self) -> Moments:
        return NORMAL_MOMENTS

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        covariance = self.covariance
        std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        unit = np.where(std > 0, std, 1.0)
        largest = float(np.abs((covariance / np.outer(unit, unit))[~np.eye(self.size, dtype=bool)]).max(initial=0.0))
        together = f"correlations up to {largest:.3g}" if largest > 1e-12 else "not correlated"
        return f"{self.size} numbers jointly normal, {deviations(self.components, covariance, quantities)}, {together}"

    def kernel_row(self) -> KernelRow:
        """Return the mean, the root of the covariance and any bounds, row by row."""
        root = self.root
        reaches = np.abs(root).sum(axis=1) * FARTHEST_NORMAL
        ends = zip((self.mean_vector - reaches).tolist(), (self.mean_vector + reaches).tolist(), strict=True)
        rows = [self.mean_vector, root]
        if not self.bounds:
            return KernelRow("joint", np.vstack(rows), tuple(ends))
        within = tuple((max(a, low), min(b, high)) for (a, b), (low, high) in zip(ends, self.bounds, strict=True))
        return KernelRow("joint", np.vstack([*rows, np.array(self.bounds).T]), within)

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return exp(i t·mean - tᵀΣt/2)."""
        t = np.asarray(frequency, dtype=float)
        quadratic = np.einsum("i...,ij,j...->...", t, self.covariance, t)
        return np.exp(1j * np.einsum("i,i...->...", self.mean_vector, t) - quadratic / 2)


def _check_bounds(bounds: object, size: int) -> tuple[tuple[float, float], ...]:
    """Return bounds, perhaps infinite, as pairs of floats."""
    if isinstance(bounds, tuple) and not bounds:
        return ()
    what = f"{size} pairs of a lowest and a highest value, or none"
    if not isinstance(bounds, tuple | list) or len(bounds) != size:
        raise InputError(f"the bounds of a joint normal law must be {what}, got {shown(bounds)}")
    pairs = [pair for pair in bounds if isinstance(pair, tuple | list) and len(pair) == 2]
    ends = [end for pair in pairs for end in pair]
    if len(pairs) != size or not all(isinstance(end, float | int) and not math.isnan(end) for end in ends):
        raise InputError(f"the bounds of a joint normal law must be {what}, got {shown(bounds)}")
    if any(low > high for low, high in pairs):
        raise InputError(f"a lower bound of a joint normal law is above the higher one: {shown(bounds)}")
    return tuple((float(low), float(high)) for low, high in pairs)


def _correlation(reader: SheetReader, size: int) -> Array:
    where = ("correlation",)
    rows = reader.settings.get("correlation", np.eye(size).tolist())
    if not isinstance(rows, list) or not all(isinstance(row, list) for row in rows):
        raise reader.error(where, f"correlation must be {size} rows of {size} plain numbers: [[1, …], …]")
    try:
        matrix = np.array([[units.parse(entry, units.RATIO) for entry in row] for row in rows])
    except (InputError, ValueError):  # not numbers, or rows of different lengths
        raise reader.error(where, "correlation must be rows of plain numbers") from None
    if matrix.shape != (size, size) or not (np.diag(matrix) == 1).all() or not (matrix == matrix.T).all():
        raise reader.error(
            where, f"correlation must be {size} rows of {size} numbers, symmetric, with 1 on the diagonal"
        )
    return matrix
