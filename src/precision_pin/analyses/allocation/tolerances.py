"""A tolerance to choose: its cost as a function of its width or grade, and its contribution to the first-order error."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from decimal import ROUND_FLOOR, Context, Decimal
from typing import Final

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.supports import Supports
from precision_pin.base import units
from precision_pin.base.arguments import shown
from precision_pin.base.arrays import Array, Fixed
from precision_pin.base.errors import InputError
from precision_pin.draws.correlation import BlockCovariance
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import tangents
from precision_pin.sheet.drawing_tolerances import grade_width

# unit of each number of a cost, in terms of the tolerance's unit; empty for a pure number
_UNITS: Final[Mapping[str, tuple[str, ...]]] = {
    "reciprocal": ("{}",),
    "squared": ("{}^2",),
    "power": ("{}^k", ""),
    "exponential": ("", "1/{}"),
    "logarithmic": ("", "{}"),
}
_LISTS: Final = ("grades", "iso286")
# largest exponent k of a power cost
_MOST_POWER: Final = 100.0
# larger numbers, in SI, overflow in slopes and ratios of costs
_LARGEST: Final = 1e50


@dataclass(frozen=True)
class Cost:
    """A cost that decreases with the tolerance t (SI) and is convex in t and t².

    Attributes:
        kind: ``reciprocal`` c/t, ``squared`` c/t², ``power`` b t^(-k), ``exponential`` b exp(-c t), ``logarithmic`` c
            ln(t_max/t).
        numbers: Its one or two positive numbers, SI.
    """

    kind: str
    numbers: tuple[float, ...]

    def at(self, t: Array) -> Array:
        """Return the cost of tolerances."""
        scale = self.numbers[0]
        if self.kind == "exponential":
            return scale * np.exp(-self.numbers[1] * t)
        if self.kind == "logarithmic":
            return scale * np.log(self.numbers[1] / t)
        return scale * t**-self._power

    def slope(self, t: Array) -> Array:
        """Return the derivative with respect to the tolerance, which is negative."""
        scale = self.numbers[0]
        if self.kind == "exponential":
            return -scale * self.numbers[1] * np.exp(-self.numbers[1] * t)
        if self.kind == "logarithmic":
            return -scale / t
        return -scale * self._power * t ** (-self._power - 1)

    @property
    def _power(self) -> float:
        return {"reciprocal": 1.0, "squared": 2.0}.get(self.kind) or self.numbers[1]


@dataclass(frozen=True, eq=False)
class Grades(Fixed):
    """Available tolerances (SI; narrowest first), their names, such as ``IT7`` or empty, and prices ``(g,)``."""

    names: tuple[str, ...]
    widths: Array
    prices: Array

    def at(self, t: Array) -> Array:
        """Return the price of the widest grade that is not wider than each tolerance, else of the narrowest."""
        return np.asarray(self.prices[self._places(t)])

    def slope(self, t: Array) -> Array:
        """Return zeros: between two grades the price is constant."""
        return np.zeros_like(t)

    def name_of(self, t: float) -> str:
        """Return the name of a tolerance's grade; empty if it is none."""
        place = int(self._places(np.array(t)))
        return self.names[place] if np.isclose(self.widths[place], t, rtol=1e-9, atol=0) else ""

    def _places(self, t: Array) -> Array:
        return np.maximum(np.searchsorted(self.widths, t * (1 + 1e-9), side="right") - 1, 0)


@dataclass(frozen=True)
class Tolerance:
    """A tolerance to choose.

    Attributes:
        path: Path in the sheet.
        sign, unit: Text before its number, up to a ±, and after it.
        before, low, high: Its value in the sheet and its bounds, SI.
        group: Tolerances of one group are equal; empty without one.
    """

    path: str
    sign: str
    unit: str
    before: float
    low: float
    high: float
    cost: Cost | Grades
    group: str

    @property
    def grades(self) -> Array | None:
        """Available tolerances within the bounds, narrowest first; ``None`` where any value is."""
        if not isinstance(self.cost, Grades):
            return None
        widths = self.cost.widths
        return widths[(widths >= self.low * (1 - 1e-9)) & (widths <= self.high * (1 + 1e-9))]

    def grade(self, value: float) -> str:
        """Return the name of a value's grade; empty if it has none."""
        return self.cost.name_of(value) if isinstance(self.cost, Grades) else ""

    @property
    def quantity(self) -> units.Quantity:
        """Its quantity, which its unit selects."""
        return units.quantity_of(self.unit)

    def number(self, value: float, digits: int = 9) -> str:
        """Return a value with its unit."""
        return f"{value / self.quantity.units[self.unit]:.{digits}g} {self.unit}".rstrip()

    def rounded(self, value: float, unit: str) -> str:
        """Return a value as a sheet writes it, rounded down to four digits, so that every limit is still kept.

        It differs by less than 0.1 %, less than the interval of a quantile of 100,000 samples. ``unit`` is that of its
        kind, used unless a number without unit stands before the value.
        """
        unit = self.unit if any(map(str.isdigit, self.sign)) else unit
        number = Decimal(f"{value / self.quantity.units[unit]:.9g}")
        return f"{self.sign}{Context(prec=4, rounding=ROUND_FLOOR).plus(number):f} {unit}"

    def written(self, value: float) -> str:
        """Return a value as the sheet writes it."""
        return self.sign + self.number(value)


@contextmanager
def prefix_errors(where: str, kind: type[InputError] = InputError) -> Iterator[None]:
    """Prefix the message of an error with its place."""
    try:
        yield
    except InputError as error:
        raise kind(f"{where}: {error.findings[0].message}") from None


def read_cost(cost: object, where: str, quantity: units.Quantity, key: str) -> Cost | Grades:
    """Return the cost that a mapping of one kind to its numbers, or its grades, states.

    Args:
        where: Prefix of messages.
        quantity: Quantity of the tolerance, as written.
        key: Last key of its path: a ``diameter`` is as wide as a grade, others half as wide; ``std`` is no width.

    Raises:
        InputError: Another kind, numbers that are not positive, a wrong unit, or no grades.
    """
    if not isinstance(cost, Mapping) or len(cost) != 1 or next(iter(cost)) not in (*_UNITS, *_LISTS):
        raise InputError(
            f"{where}: a cost is one of {', '.join((*_UNITS, *_LISTS))} with its numbers, got {shown(cost)}"
        )
    kind, numbers = next(iter(cost.items()))
    if kind in _LISTS:
        return _read_grades(kind, numbers, where, quantity, key)
    terms = list(numbers) if isinstance(numbers, list | tuple) else [numbers]
    if len(terms) != len(_UNITS[kind]):
        raise InputError(f"{where}: the cost {kind} has {len(_UNITS[kind])} numbers, got {shown(numbers)}")
    values = [
        _number(term, "", where, quantity) if not unit else 0.0 for term, unit in zip(terms, _UNITS[kind], strict=True)
    ]
    power = f"{values[-1]:g}"
    if kind == "power" and values[-1] > _MOST_POWER:
        raise InputError(f"{where}: the power of a cost is at most {_MOST_POWER:g}, got {shown(terms[1])}")
    si_values = [
        _number(term, unit.replace("k", power), where, quantity) if unit else value
        for term, unit, value in zip(terms, _UNITS[kind], values, strict=True)
    ]
    return Cost(kind, tuple(si_values))


def _number(text: object, form: str, where: str, quantity: units.Quantity) -> float:
    """Return a positive number in SI; ``form`` is its unit in terms of the tolerance's. Without a unit it is in SI."""
    with prefix_errors(where):
        numbers, unit = units.split(str(text))
    factors = {_unit(form, name): _factor(form, factor) for name, factor in quantity.units.items()} if form else {}
    if unit and unit not in factors:
        expected = f"a unit such as {_unit(form, quantity.written or quantity.si)}" if form else "no unit"
        raise InputError(f"{where}: this number of a cost has {expected}, got {shown(text)}")
    value = numbers[0] * (factors[unit] if unit else 1.0)
    if len(numbers) != 1 or not 1 / _LARGEST <= value <= _LARGEST:
        raise InputError(f"{where}: a number of a cost must be positive, up to {_LARGEST:g} in SI, got {shown(text)}")
    return float(value)


def _unit(form: str, name: str) -> str:
    """Return the unit of a form; a compound unit is put in brackets: ``(mm/m)^2``."""
    return form.format(f"({name})" if form != "{}" and re.search(r"[*/^]", name) else name)


def _factor(form: str, factor: float) -> float:
    if form.startswith("1/"):
        return 1 / factor
    return float(factor ** float(form.partition("^")[2] or 1))


def _read_grades(kind: str, spec: object, where: str, quantity: units.Quantity, key: str) -> Grades:
    """Return the grades of a list ``[[tolerance, price], …]``, or of ISO 286: a half-width is half of a grade's width."""
    if kind == "grades":
        if not isinstance(spec, list | tuple) or not all(
            isinstance(entry, list | tuple) and len(entry) == 2 for entry in spec
        ):
            raise InputError(f"{where}: grades are a list of [tolerance, price], got {shown(spec)}")
        entries = [("", _width(width, where, quantity), _price(price, where)) for width, price in spec]
    elif key == "std":
        raise InputError(f"{where}: grades of ISO 286 limit widths, but this is a standard deviation; list its grades")
    elif quantity != units.LENGTH:
        raise InputError(f"{where}: grades of ISO 286 are lengths, not of the quantity {quantity.name}")
    elif not isinstance(spec, Mapping) or set(spec) != {"size", "prices"} or not isinstance(spec["prices"], Mapping):
        raise InputError(f"{where}: iso286 has a size and prices by grade, got {shown(spec)}")
    else:
        size, factor = _width(spec["size"], where, quantity), 1.0 if key == "diameter" else 0.5
        with prefix_errors(where):
            entries = [
                (str(name), grade_width(str(name), size) * factor, _price(price, where))
                for name, price in spec["prices"].items()
            ]
    if not entries:
        raise InputError(f"{where}: there are no grades to choose from")
    names, sizes, prices = zip(*sorted(entries, key=lambda entry: entry[1]), strict=True)
    widths = np.array(sizes)
    if (np.diff(widths) <= 1e-9 * widths[1:]).any():
        raise InputError(f"{where}: two grades have the same tolerance")
    return Grades(names, widths, np.array(prices))


def _width(text: object, where: str, quantity: units.Quantity) -> float:
    with prefix_errors(where):
        value = units.parse(str(text), quantity)
    if not value > 0:
        raise InputError(f"{where}: a tolerance and a size must be positive, got {shown(text)}")
    return value


def _price(text: object, where: str) -> float:
    try:
        value = float(str(text))
    except ValueError:
        value = np.nan
    if not 0 <= value <= _LARGEST:
        raise InputError(f"{where}: a price is a number from 0 to {_LARGEST:g}, got {shown(text)}")
    return value


# factors on the tolerances to find their contributions, and to check them; a wider one might reach a stiffness of zero
_HALF: Final = 0.5
_QUARTER: Final = 0.25
# relative error of a contribution, by the largest, above which it does not scale with its tolerance
_RELATIVE: Final = 1e-6
# slope, relative to the largest, that counts as rounding
_ROUNDING: Final = 1e-12
# standard deviations at which the worst case of a normal law ends
_WIDTH: Final = 3.0
# samples to check whether a law keeps its shape
_SHAPES: Final = 64


class NoScaleError(InputError):
    """The error is not proportional to the tolerance at ``path``."""

    def __init__(self, path: str, reason: str) -> None:
        super().__init__(f"allocate: {reason}")
        self.path = path


@dataclass(frozen=True, eq=False)
class Contributions(Fixed):
    """First-order error at P poses: ``mean + unchosen z + Σ t_i effect_i z``, z the components in standard deviations.

    Attributes:
        mean: Error at the means ``(6, P)``.
        covariance, by_tolerance: Fixed covariance ``(6, 6, P)``, and that of each tolerance of 1 (SI) ``(n, 6, 6,
            P)``.
        pairs, by_pair: Numbers of two tolerances with correlated draws, n for the unchosen rest, ``(m, 2)``; the
            contribution of their product to the covariance, ``(m, 6, 6, P)``.
        reach, reach_by_tolerance: Largest deviations of the components, ``(6, P)`` and ``(n, 6, P)``.
        effects, unchosen: Slopes of the error by the components that each tolerance moves, columns ``(c,)`` and ``(6, c,
            P)``; and those of the unchosen rest.
    """

    mean: Array
    covariance: Array
    by_tolerance: Array
    pairs: NDArray[np.intp]
    by_pair: Array
    reach: Array
    reach_by_tolerance: Array
    effects: tuple[ToleranceEffect, ...]
    unchosen: ToleranceEffect


@dataclass(frozen=True, eq=False)
class _Errors:
    """First-order error of a model: mean ``(6, P)``, slopes by deviation ``(6, d, P)``, deviations ``(d,)``."""

    mean: Array
    slopes: Array
    reach: Array
    deviations: Array
    correlation: BlockCovariance
    numbers: Array
    """A few samples of the components, in standard deviations from their means."""


def contributions(
    model: ErrorModel,
    tolerances: Sequence[Tolerance],
    poses: Sequence[str],
    *,
    worst_case: bool,
    advance: Callable[[int], None],
) -> Contributions:
    """Return the parts of the first-order error at named poses; ``advance`` is called with 1 for each tolerance.

    Each tolerance is halved, and all are quartered together: the error must be proportional, and nothing else may change.

    Raises:
        InputError: A tolerance whose part is not proportional, or that changes the mean or other tolerances' parts.
    """
    base = _errors(model, poses, worst_case)
    scale = max(float(np.abs(base.slopes).max(initial=0.0)), 1e-300)
    size = max(float(np.abs(base.mean).max(initial=0.0)), scale)
    parts, reaches = [], []
    for tol in tolerances:
        narrow = _scaled_errors(model, [tol], _HALF, poses, worst_case)
        if narrow.slopes.shape != base.slopes.shape:
            raise NoScaleError(tol.path, f"{tol.path} changes which numbers are drawn; only a tolerance can be chosen")
        if np.abs(narrow.mean - base.mean).max() > _RELATIVE * size:
            raise NoScaleError(tol.path, f"{tol.path} changes the mean of the error and cannot be chosen")
        part = _without_rounding((narrow.slopes - base.slopes) / (_HALF - 1), scale)
        if not part.any() and np.array_equal(narrow.deviations, base.deviations):
            raise NoScaleError(tol.path, f"{tol.path} changes neither a law nor the error and cannot be chosen")
        parts.append(part)
        reaches.append((narrow.reach - base.reach) / (_HALF - 1))
        advance(1)
    largest = max(float(base.reach.max(initial=0.0)), 1e-300)
    # narrowing all at once shows whether any part is not proportional, narrowing one shows which
    narrowed = _scaled_errors(model, tolerances, _QUARTER, poses, worst_case)
    if not _is_proportional(narrowed, base, np.sum(parts, axis=0), scale):
        for tol, part in zip(tolerances, parts, strict=True):
            extent = max(float(np.abs(part).max(initial=0.0)), 1e-300)
            if not _is_proportional(_scaled_errors(model, [tol], _QUARTER, poses, worst_case), base, part, extent):
                reason = f"the error does not scale with {tol.path}; its law has other numbers, or it is no tolerance"
                raise NoScaleError(tol.path, reason)
        raise InputError("allocate: tolerances change one random number together; choose one of them")
    unchosen = _without_rounding(base.slopes - sum(parts), scale)
    values = np.array([tol.before for tol in tolerances])
    effects = tuple(ToleranceEffect.of(part / value) for part, value in zip(parts, values.tolist(), strict=True))
    pairs, by_pair = _products([*effects, ToleranceEffect.of(unchosen)], base.correlation)
    if _differs(narrowed.reach, base.reach + (_QUARTER - 1) * sum(reaches), _RELATIVE * largest):
        for tol, reached in zip(tolerances, reaches, strict=True):
            single = _scaled_errors(model, [tol], _QUARTER, poses, worst_case).reach
            if _differs(single, base.reach + (_QUARTER - 1) * reached, _RELATIVE * largest) and not len(pairs):
                raise InputError(f"allocate: the largest deviation does not scale with {tol.path}")
        paths = [*(tol.path for tol in tolerances), "what is not chosen"]
        named = [paths[k] for k in pairs[:1].ravel().tolist()]
        raise InputError(
            f"allocate: worst_case: {' and '.join(named)} are correlated, so that their largest deviations do not add; "
            "limit rms or a quantile instead, or remove the correlation from the sheet"
        )
    spreads = (effect.spread(base.deviations.size) for effect in effects)
    return Contributions(
        mean=base.mean,
        covariance=_covariance(unchosen, unchosen, base.correlation),
        by_tolerance=np.stack([_covariance(slopes, slopes, base.correlation) for slopes in spreads]),
        pairs=pairs,
        by_pair=by_pair,
        reach=np.maximum(base.reach - sum(reaches), 0.0),
        reach_by_tolerance=np.stack(reaches) / values[:, None, None],
        effects=effects,
        unchosen=ToleranceEffect.of(unchosen),
    )


@dataclass(frozen=True, eq=False)
class ToleranceEffect(Fixed):
    """Columns ``(c,)`` of components, and the slopes of the error by them in standard deviations, ``(6, c, P)``."""

    columns: NDArray[np.intp]
    slopes: Array

    @classmethod
    def of(cls, slopes: Array) -> ToleranceEffect:
        """Return the nonzero columns of slopes ``(6, d, P)``."""
        largest = np.abs(slopes).max(axis=(0, 2), initial=0.0)
        columns = np.flatnonzero(largest)
        return cls(columns, slopes[:, columns])

    def times(self, numbers: Array, pose: int, rows: Sequence[int]) -> Array:
        """Return rows of the error ``(r, N)`` at a pose for components in standard deviations ``(d, N)``."""
        return np.asarray(self.slopes[list(rows), :, pose] @ numbers[self.columns])

    def spread(self, size: int) -> Array:
        """Return the slopes by all components, ``(6, d, P)``."""
        slopes = np.zeros((6, size, self.slopes.shape[2]))
        slopes[:, self.columns] = self.slopes
        return slopes


def _products(effects: Sequence[ToleranceEffect], correlation: BlockCovariance) -> tuple[NDArray[np.intp], Array]:
    """Return the pairs whose draws are correlated, and the contributions of their products to the covariance."""
    blocks = [
        set(columns.tolist())
        for columns, matrix in correlation.blocks
        if _differs(matrix, np.diag(np.diag(matrix)), 1e-12)
    ]
    columns_of = [set(first.columns.tolist()) for first in effects]
    pairs, parts = [], []
    for i, j in itertools.combinations(range(len(effects)), 2):
        if columns_of[i] & columns_of[j] or any(block & columns_of[i] and block & columns_of[j] for block in blocks):
            first, second = (effects[k].spread(correlation.variances.size) for k in (i, j))
            crossed = _covariance(first, second, correlation)
            part = crossed + crossed.transpose(1, 0, 2)
            if part.any():
                pairs.append((i, j))
                parts.append(part)
    shape = (0, 6, 6, effects[0].slopes.shape[2])
    return np.array(pairs, dtype=np.intp).reshape(-1, 2), np.stack(parts) if parts else np.zeros(shape)


def _covariance(first: Array, second: Array, correlation: BlockCovariance) -> Array:
    return np.stack(
        [correlation.between(a, b) for a, b in zip(np.moveaxis(first, -1, 0), np.moveaxis(second, -1, 0), strict=True)],
        axis=-1,
    )


def _is_proportional(narrow: _Errors, base: _Errors, part: Array, scale: float) -> bool:
    """Return whether the error changes in proportion to its part, and no other law changes."""
    return (
        not _differs(narrow.slopes, base.slopes + (_QUARTER - 1) * part, _RELATIVE * scale)
        and not _differs(narrow.numbers, base.numbers, 1e-6 * float(np.abs(base.numbers).max(initial=1.0)))
        and not _differs(narrow.mean, base.mean, _RELATIVE * max(float(np.abs(base.mean).max()), scale))
    )


def _scaled_errors(
    model: ErrorModel, tolerances: Sequence[Tolerance], factor: float, poses: Sequence[str], worst_case: bool
) -> _Errors:
    try:
        scaled = changed_model(model, tolerances, np.array([factor * tol.before for tol in tolerances]))
    except InputError as error:
        path = tolerances[0].path
        raise NoScaleError(
            path, f"{path} is no tolerance, or cannot be narrowed: {error.findings[0].message}"
        ) from None
    return _errors(scaled, poses, worst_case)


def _without_rounding(slopes: Array, scale: float) -> Array:
    return np.where(np.abs(slopes) > _ROUNDING * scale, slopes, 0.0)


def _differs(first: Array, second: Array, tolerance: float) -> bool:
    return bool(np.abs(first - second).max(initial=0.0) > tolerance)


def changed_model(model: ErrorModel, tolerances: Sequence[Tolerance], values: Array) -> ErrorModel:
    """Return the model with other tolerances."""
    return model.with_({tol.path: tol.written(width) for tol, width in zip(tolerances, values.tolist(), strict=True)})


def in_deviations(space: Space, seed: int, count: int, pose: int = 0) -> Array:
    """Return samples of the components in standard deviations from their means, ``(d, count)``."""
    deviations = np.sqrt(space.block_covariance.variances)
    offsets = space.sample(seed, 0, count, pose=pose) - space.mean[:, None]
    return np.asarray(offsets / np.where(deviations > 0, deviations, 1.0)[:, None])


def _errors(model: ErrorModel, poses: Sequence[str], worst_case: bool) -> _Errors:
    values, _ = model.configurations(list(poses))
    chunks = list(tangents(model.at_columns(values, model.approaches_of(list(poses), values))))
    mean = np.concatenate([chunk.error for chunk in chunks], axis=1)
    jacobian = np.concatenate([chunk.jacobian for chunk in chunks], axis=2)
    covariance = model.space.block_covariance
    deviations = np.sqrt(covariance.variances)
    units = np.where(deviations > 0, deviations, 1.0)
    correlation = BlockCovariance(
        (deviations > 0).astype(float),
        tuple((columns, block / np.outer(units[columns], units[columns])) for columns, block in covariance.blocks),
    )
    reach = np.zeros(mean.shape)
    if worst_case:
        supports = Supports.of(model.space, _WIDTH)
        slopes = np.moveaxis(jacobian, -1, 0)
        top, bottom = (np.stack([supports.heights(sign * p).sum(axis=0) for p in slopes], axis=-1) for sign in (1, -1))
        reach = np.maximum(top, bottom)
    return _Errors(
        mean, jacobian * deviations[:, None], reach, deviations, correlation, in_deviations(model.space, 0, _SHAPES)
    )
