"""Parameters: components of draws and formulas of them.

An :class:`Expression` is written with ordinary arithmetic (``1 / stiffness``, ``diameter**4``); a :class:`Program`
turns a set of them into one list of operations for all engines.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError, InternalError

Slopes = dict[int, float]
"""Derivatives by the component's column."""

MOST_OPERATIONS: Final = 256
"""Maximum number of operations in a parameter's formula, such as the sum of all loads on a joint.

Each operation costs time in every sample; longer formulas come from sums over hundreds of parts by mistake.
"""


class Operator(IntEnum):
    """Operations of formulas; their numbers are part of the compiled kernel's interface."""

    ADD = 0
    SUBTRACT = 1
    MULTIPLY = 2
    DIVIDE = 3
    POWER = 4
    SQRT = 5
    SIN = 6
    COS = 7
    SIGN = 8


class Expression:
    """A value that may be random: a component of a draw, a constant or an operation on these."""

    def __add__(self, other: Expression | float) -> Expression:
        return Operation(Operator.ADD, (self, _expression(other)))

    def __radd__(self, other: float) -> Expression:
        return _expression(other) + self

    def __sub__(self, other: Expression | float) -> Expression:
        return Operation(Operator.SUBTRACT, (self, _expression(other)))

    def __rsub__(self, other: float) -> Expression:
        return _expression(other) - self

    def __mul__(self, other: Expression | float) -> Expression:
        return Operation(Operator.MULTIPLY, (self, _expression(other)))

    def __rmul__(self, other: float) -> Expression:
        return _expression(other) * self

    def __truediv__(self, other: Expression | float) -> Expression:
        return Operation(Operator.DIVIDE, (self, _expression(other)))

    def __rtruediv__(self, other: float) -> Expression:
        return _expression(other) / self

    def __pow__(self, exponent: float) -> Expression:
        return Operation(Operator.POWER, (self, Constant(float(exponent))))

    def __neg__(self) -> Expression:
        return 0.0 - self


@dataclass(frozen=True)
class Component(Expression):
    """A component of a draw, by its name: ``a1``, ``axis_install[joint2].A.x``."""

    name: str


@dataclass(frozen=True)
class Constant(Expression):
    """A fixed number inside a formula."""

    value: float

    def __post_init__(self) -> None:
        if not math.isfinite(self.value):
            raise InputError(f"a formula contains {self.value}; its numbers must be finite")


@dataclass(frozen=True)
class Operation(Expression):
    """An operator applied to one or two expressions; the exponent of a power is constant.

    Attributes:
        depth: Operations on the longest path from the result down to a component or constant.
    """

    operator: Operator
    arguments: tuple[Expression, ...]
    depth: int = field(init=False, repr=False, compare=False)
    _hash: int = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        depths = [argument.depth for argument in self.arguments if isinstance(argument, Operation)]
        object.__setattr__(self, "depth", 1 + max(depths, default=0))
        # stored: parts are shared, and hashing them repeatedly would take time exponential in the depth
        object.__setattr__(self, "_hash", hash((self.operator, self.arguments)))

    def __hash__(self) -> int:
        return self._hash

    def __eq__(self, other: object) -> bool:
        """Return whether another formula is an equal tree; shared parts are compared once."""
        if not isinstance(other, Operation):
            return NotImplemented
        if self.depth == 1 == other.depth:  # most of them
            return self.operator == other.operator and self.arguments == other.arguments
        waiting: list[tuple[Expression, Expression]] = [(self, other)]
        compared: set[tuple[int, int]] = set()
        while waiting:
            a, b = waiting.pop()
            if a is b or (id(a), id(b)) in compared:
                continue
            compared.add((id(a), id(b)))
            if not (isinstance(a, Operation) and isinstance(b, Operation)):
                if a != b:
                    return False
                continue
            if hash(a) != hash(b) or a.operator != b.operator or len(a.arguments) != len(b.arguments):
                return False
            waiting += zip(a.arguments, b.arguments, strict=True)
        return True

    def __reduce__(self) -> tuple[type[Operation], tuple[Operator, tuple[Expression, ...]]]:
        # without the stored hash, which differs from process to process
        return Operation, (self.operator, self.arguments)


_SLOPES: Final[Mapping[Operator, Callable[[float, float, float, float, float], float]]] = {
    Operator.ADD: lambda a, b, result, da, db: da + db,
    Operator.SUBTRACT: lambda a, b, result, da, db: da - db,
    Operator.MULTIPLY: lambda a, b, result, da, db: b * da + a * db,
    Operator.DIVIDE: lambda a, b, result, da, db: (da - result * db) / b,
    Operator.POWER: lambda a, b, result, da, db: (b * a ** (b - 1) if b else 0.0) * da,
    Operator.SQRT: lambda a, b, result, da, db: 1 / (2 * result) * da,
    Operator.SIN: lambda a, b, result, da, db: math.cos(a) * da,
    Operator.COS: lambda a, b, result, da, db: -math.sin(a) * da,
    Operator.SIGN: lambda a, b, result, da, db: 0.0,
}
"""Derivative of an operation's result by a component, from its arguments, its result and their derivatives."""
# the functions of numpy that the compiled loops reproduce; `sign` is 1 at zero, where numpy's is 0
_RESULTS: Final[Mapping[Operator, Callable[[Array, Array], Array]]] = {
    Operator.ADD: np.add,
    Operator.SUBTRACT: np.subtract,
    Operator.MULTIPLY: np.multiply,
    Operator.DIVIDE: np.divide,
    Operator.POWER: np.power,
    Operator.SQRT: lambda a, _: np.sqrt(a),
    Operator.SIN: lambda a, _: np.sin(a),
    Operator.COS: lambda a, _: np.cos(a),
    Operator.SIGN: lambda a, _: np.where(a >= 0, 1.0, -1.0),
}


Value = Expression | float
"""Value of a source's setting: a number, or an expression if it is random."""


def sqrt(argument: Expression) -> Expression:
    """Return the square root as an expression."""
    return Operation(Operator.SQRT, (argument,))


def sin(argument: Expression) -> Expression:
    """Return the sine (rad) as an expression."""
    return Operation(Operator.SIN, (argument,))


def cos(argument: Expression) -> Expression:
    """Return the cosine (rad) as an expression."""
    return Operation(Operator.COS, (argument,))


def sign(argument: Expression) -> Expression:
    """Return 1 where an expression is zero or positive, else -1; its derivative counts as zero."""
    return Operation(Operator.SIGN, (argument,))


def _expression(value: Expression | float) -> Expression:
    return value if isinstance(value, Expression) else Constant(float(value))


@dataclass(frozen=True)
class Program:
    """Parameters as one list of operations over registers.

    Registers hold the d components, then the constants, then the result of each operation in turn.

    Attributes:
        components: d, the number of components.
        operations: ``(operator, left register, right register)``; both are the same for an operator of one argument.
        outputs: The register of each parameter.
    """

    components: int
    constants: tuple[float, ...]
    operations: tuple[tuple[Operator, int, int], ...]
    outputs: tuple[int, ...]

    @classmethod
    def compile(cls, parameters: Sequence[Expression], component_index: Mapping[str, int]) -> Program:
        """Return the program that computes the parameters; common parts are computed once.

        Raises InputError if a parameter needs more than 256 operations, or names a component that does not exist.
        """
        distinct: dict[Expression, None] = {}
        for parameter in parameters:
            if isinstance(parameter, Operation) and parameter.depth > MOST_OPERATIONS:
                raise InputError(
                    f"a parameter's formula takes {parameter.depth} operations or more, "
                    f"at most {MOST_OPERATIONS} are allowed"
                )
            parts = _parts(parameter)
            count = sum(isinstance(part, Operation) for part in parts)
            if count > MOST_OPERATIONS:
                raise InputError(
                    f"a parameter's formula takes {count} operations, at most {MOST_OPERATIONS} are allowed"
                )
            distinct.update(parts)
        constants = [part for part in distinct if isinstance(part, Constant)]
        register: dict[Expression, int] = {part: len(component_index) + k for k, part in enumerate(constants)}
        steps: list[tuple[Operator, int, int]] = []
        for part in distinct:
            if isinstance(part, Component):
                if part.name not in component_index:
                    raise InternalError(f"a term uses the component {part.name!r}, which no draw provides")
                register[part] = component_index[part.name]
            elif isinstance(part, Operation):
                # its arguments stand before it
                inputs = [register[argument] for argument in part.arguments]
                register[part] = len(component_index) + len(constants) + len(steps)
                steps.append((part.operator, inputs[0], inputs[-1]))
        return cls(
            len(component_index),
            tuple(part.value for part in constants),
            tuple(steps),
            tuple(register[parameter] for parameter in parameters),
        )

    def evaluate(self, x: ArrayLike) -> Array:
        """Return the parameters ``(P, N)`` for component values ``(d, N)``."""
        points = np.asarray(x, dtype=float)
        values = self._registers(points)
        return np.array([values[k] for k in self.outputs]).reshape(len(self.outputs), points.shape[1])

    def gradient(self, x: ArrayLike) -> tuple[Slopes, ...]:
        """Return the derivatives of the P parameters at one point ``(d,)``, by component; missing ones are zero.

        Raises InputError if a formula has no value or no finite derivative there.
        """
        values = self._registers(np.asarray(x, dtype=float)[:, None])
        slopes: list[Slopes] = [{k: 1.0} for k in range(self.components)]
        slopes += [{} for _ in self.constants]
        for step, (operator, left, right) in enumerate(self.operations):
            a, b = float(values[left][0]), float(values[right][0])
            result = float(values[self.components + len(self.constants) + step][0])
            da, db = slopes[left], slopes[right]
            columns = dict.fromkeys((*da, *db)) if any(da.values()) or any(db.values()) else ()
            try:
                slopes.append({k: _SLOPES[operator](a, b, result, da.get(k, 0.0), db.get(k, 0.0)) for k in columns})
            except (ZeroDivisionError, OverflowError):
                raise InputError(
                    f"a parameter's formula has no finite derivative at its parameters' means "
                    f"({operator.name.lower()} of {a:g})"
                ) from None
        return tuple(slopes[k] for k in self.outputs)

    def _registers(self, x: Array) -> list[Array]:
        values = list(x) + [np.full(x.shape[1], constant) for constant in self.constants]
        for operator, left, right in self.operations:
            with np.errstate(divide="raise", invalid="raise", over="raise"):
                try:
                    values.append(_RESULTS[operator](values[left], values[right]))
                except FloatingPointError as error:
                    raise InputError(
                        f"a parameter's formula fails for some sample ({error}); "
                        "the distribution of a divisor must exclude zero"
                    ) from error
        return values


def component_names(expression: Expression) -> set[str]:
    """Return the names of the components in an expression."""
    return {part.name for part in _parts(expression) if isinstance(part, Component)}


def operations(expression: Expression) -> int:
    """Return the number of operations in an expression; shared parts count once."""
    return sum(isinstance(part, Operation) for part in _parts(expression))


def signs_of(expressions: Sequence[Expression]) -> list[Expression]:
    """Return every sign operation in some expressions, each once."""
    return [part for part in _parts(*expressions) if _is_sign(part)]


def fix_signs(expression: Expression, values: Mapping[Expression, float]) -> Expression:
    """Return an expression with its signs replaced by numbers."""
    replacements: dict[Expression, Expression] = {}
    for part in _parts(expression):
        replacements[part] = Constant(values[part]) if _is_sign(part) else part
        if isinstance(part, Operation) and not _is_sign(part):
            replacements[part] = Operation(part.operator, tuple(replacements[argument] for argument in part.arguments))
    return replacements[expression]


def renamed(expression: Expression, names: Mapping[str, str]) -> Expression:
    """Return an expression with other components: those in ``names`` under their new names."""
    copies: dict[Expression, Expression] = {}
    for part in _parts(expression):
        copies[part] = Component(names.get(part.name, part.name)) if isinstance(part, Component) else part
        if isinstance(part, Operation):
            copies[part] = Operation(part.operator, tuple(copies[argument] for argument in part.arguments))
    return copies[expression]


def _is_sign(part: Expression) -> bool:
    return isinstance(part, Operation) and part.operator is Operator.SIGN


def _parts(*expressions: Expression, parts: dict[Expression, None] | None = None) -> dict[Expression, None]:
    """Return expressions and all their parts, each once, arguments before their users; added to ``parts`` if given."""
    parts = {} if parts is None else parts
    for expression in expressions:
        if expression not in parts:
            _parts(*(expression.arguments if isinstance(expression, Operation) else ()), parts=parts)
            parts[expression] = None
    return parts
