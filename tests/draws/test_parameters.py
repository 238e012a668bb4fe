"""Formulas: values against plain Python, gradients against the complex step, limits and sharing."""

import cmath
import math
import pickle
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from precision_pin.base.errors import InputError, InternalError
from precision_pin.draws.expressions import (
    Component,
    Constant,
    Expression,
    Operation,
    Operator,
    Program,
    cos,
    sin,
    sqrt,
)

INDEX = {"a": 0, "b": 1, "c": 2}
A, B, C = (Component(name) for name in INDEX)

# each formula written for our expressions and, by the same text, for complex numbers
FORMULAS: list[tuple[Callable[..., Any], Callable[..., Any]]] = [
    (lambda a, b, c: a + b - c, lambda a, b, c: a + b - c),
    (lambda a, b, c: 2 + a, lambda a, b, c: 2 + a),
    (lambda a, b, c: 2 - a, lambda a, b, c: 2 - a),
    (lambda a, b, c: 3 * a * b, lambda a, b, c: 3 * a * b),
    (lambda a, b, c: a / b / 2, lambda a, b, c: a / b / 2),
    (lambda a, b, c: 1 / (a * c), lambda a, b, c: 1 / (a * c)),
    (lambda a, b, c: -a, lambda a, b, c: -a),
    (lambda a, b, c: a**4 - b**4, lambda a, b, c: a**4 - b**4),
    (lambda a, b, c: c**-1.5, lambda a, b, c: c**-1.5),
    (lambda a, b, c: (a - b) ** 3, lambda a, b, c: (a - b) ** 3),
    (lambda a, b, c: a**0 + b**1, lambda a, b, c: 1 + b),
    (lambda a, b, c: sqrt(a * a + b * b), lambda a, b, c: cmath.sqrt(a * a + b * b)),
    (lambda a, b, c: sin(a) * cos(b) + sin(c) ** 2, lambda a, b, c: cmath.sin(a) * cmath.cos(b) + cmath.sin(c) ** 2),
    # second moment of area of a tube, and the flexibility that follows
    (lambda a, b, c: math.pi / 64 * (b**4 - a**4), lambda a, b, c: math.pi / 64 * (b**4 - a**4)),
    (lambda a, b, c: 1 / (c * (math.pi / 64 * (b**4 - a**4))), lambda a, b, c: 1 / (c * (math.pi / 64 * (b**4 - a**4)))),
]  # fmt: skip
POINTS = np.array([[0.7, 1.3, 2.1], [0.2, 0.9, 0.4], [1.1, 3.0, 5.0]]).T


@pytest.mark.parametrize(("ours", "plain"), FORMULAS)
def test_value_against_plain_arithmetic(ours: Any, plain: Any) -> None:
    seen = Program.compile([ours(A, B, C)], INDEX).evaluate(POINTS)
    expected = [plain(*point).real for point in POINTS.T.tolist()]
    np.testing.assert_allclose(seen, [expected], rtol=1e-15)


def gradient(program: Program, point: list[float]) -> NDArray[np.float64]:
    rows = program.gradient(point)
    return np.array([[slopes.get(k, 0.0) for k in range(program.components)] for slopes in rows])


@pytest.mark.parametrize(("ours", "plain"), FORMULAS)
def test_gradient_against_the_complex_step(ours: Any, plain: Any) -> None:
    program = Program.compile([ours(A, B, C)], INDEX)
    for point in POINTS.T.tolist():
        expected = []
        for k in range(3):
            moved = [complex(value) for value in point]
            moved[k] += 1e-30j
            expected.append(complex(plain(*moved)).imag / 1e-30)
        np.testing.assert_allclose(gradient(program, point), [expected], rtol=2e-14, atol=1e-15)


def test_several_parameters_of_several_samples() -> None:
    program = Program.compile([A * B, C, Constant(2.5), A * B], INDEX)
    seen = program.evaluate(POINTS)
    np.testing.assert_array_equal(seen, [POINTS[0] * POINTS[1], POINTS[2], np.full(3, 2.5), POINTS[0] * POINTS[1]])
    np.testing.assert_array_equal(gradient(program, [2.0, 3.0, 5.0]), [[3, 2, 0], [0, 0, 1], [0, 0, 0], [3, 2, 0]])


@pytest.mark.parametrize("samples", [0, 1, 7])
def test_shapes_where_nothing_is_random(samples: int) -> None:
    # an arm that only sags has no parameter at all
    assert Program.compile([], INDEX).evaluate(np.ones((3, samples))).shape == (0, samples)
    assert Program.compile([], {}).evaluate(np.ones((0, samples))).shape == (0, samples)
    assert Program.compile([Constant(1.0)], {}).evaluate(np.ones((0, samples))).shape == (1, samples)
    assert Program.compile([], INDEX).gradient(np.ones(3)) == ()
    assert Program.compile([Constant(1.0)], {}).gradient(np.ones(0)) == ({},)


def test_common_parts_are_computed_once() -> None:
    section = A**4 - B**4
    program = Program.compile([1 / (C * section), section * 2, (A**4 - B**4) * 2], INDEX)
    # A^4, B^4, their difference, times C, 1 over it, the difference times 2
    assert len(program.operations) == 6
    assert program.outputs[1] == program.outputs[2]
    assert sorted(program.constants) == [1, 2, 4]


def test_arguments_stand_before_what_uses_them() -> None:
    program = Program.compile([sin(A * B + C) / sqrt(C), A * B], INDEX)
    start = len(INDEX) + len(program.constants)
    for step, (_, left, right) in enumerate(program.operations):
        assert 0 <= left < start + step
        assert 0 <= right < start + step


def test_operator_numbers_are_the_interface_of_the_kernel() -> None:
    names = ["ADD", "SUBTRACT", "MULTIPLY", "DIVIDE", "POWER", "SQRT", "SIN", "COS", "SIGN"]
    assert [(operator.name, operator.value) for operator in Operator] == [(name, k) for k, name in enumerate(names)]


def chain_of(operations: int) -> Expression:
    result: Expression = A
    for k in range(operations):
        result = result + float(k + 1)
    return result


def test_256_operations_are_allowed_and_257_are_not() -> None:
    program = Program.compile([chain_of(256)], INDEX)
    assert len(program.operations) == 256
    assert program.evaluate(np.zeros((3, 1)))[0, 0] == 256 * 257 / 2
    with pytest.raises(InputError, match="at most 256"):
        Program.compile([chain_of(257)], INDEX)


def test_operations_are_counted_in_breadth_too() -> None:
    def sum_of(parts: list[Expression]) -> Expression:
        return parts[0] if len(parts) == 1 else sum_of(parts[::2]) + sum_of(parts[1::2])

    parts: list[Expression] = [A * float(k + 2) for k in range(128)]
    assert len(Program.compile([sum_of(parts)], INDEX).operations) == 255
    with pytest.raises(InputError, match="at most 256"):
        Program.compile([sum_of([A * float(k + 2) for k in range(129)])], INDEX)


def test_the_limit_holds_for_each_parameter_not_for_all_together() -> None:
    program = Program.compile([chain_of(32), B * C], INDEX)
    assert len(program.operations) == 33


def test_a_part_used_often_counts_once_and_takes_no_time() -> None:
    start = time.perf_counter()
    doubled: Expression = A
    for _ in range(32):
        doubled = doubled + doubled
    assert Program.compile([doubled], INDEX).evaluate(np.ones((3, 1)))[0, 0] == 2.0**32
    assert time.perf_counter() - start < 1


def test_a_formula_of_thousands_of_operations_is_refused_in_one_line() -> None:
    with pytest.raises(InputError, match="at most 256") as caught:
        Program.compile([chain_of(5000)], INDEX)
    assert "\n" not in str(caught.value)


def test_equal_formulas_are_equal_and_survive_pickling() -> None:
    one, other = 1 / (A * B), 1 / (A * B)
    assert one == other
    assert hash(one) == hash(other)
    again = pickle.loads(pickle.dumps(one))
    assert again == one
    assert hash(again) == hash(one)
    assert {one: "kept"}[again] == "kept"
    assert one != 1 / (B * A)
    assert isinstance(one, Operation)


@pytest.mark.parametrize(
    ("formula", "reason"),
    [
        (lambda: 1 / A, "divi"),
        (lambda: A**-1, "divi"),
        (lambda: sqrt(A - 1), "invalid"),
        (lambda: (A - 1) ** 0.5, "invalid"),
        (lambda: (B * 1e200) ** 4, "overflow"),
        (lambda: B / Constant(0.0), "divi"),
    ],
)
def test_a_formula_that_fails_for_one_sample_says_why(formula: Any, reason: str) -> None:
    x = np.array([[1.0, 0.0, 2.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]])
    with pytest.raises(InputError, match=reason) as caught:
        Program.compile([formula()], INDEX).evaluate(x)
    assert "law" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("formula", [lambda: sqrt(A), lambda: A**0.5, lambda: A**1.0 + sqrt(A)])
def test_a_gradient_that_is_infinite_is_refused(formula: Any) -> None:
    with pytest.raises(InputError, match="no finite derivative"):
        Program.compile([formula()], INDEX).gradient([0.0, 1.0, 1.0])


@pytest.mark.parametrize(
    ("formula", "expected"),
    [(lambda: A**0, 0.0), (lambda: A**1, 1.0), (lambda: A**2, 0.0), (lambda: sqrt(Constant(0.0) * 1) + A, 1.0)],
)
def test_gradients_at_zero(formula: Any, expected: float) -> None:
    assert gradient(Program.compile([formula()], INDEX), [0.0, 1.0, 1.0])[0, 0] == expected


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_not_finite_cannot_stand_in_a_formula(number: float) -> None:
    with pytest.raises(InputError):
        A + number
    with pytest.raises(InputError):
        A**number


def test_a_component_that_no_draw_provides_is_an_internal_error() -> None:
    with pytest.raises(InternalError, match="'z'"):
        Program.compile([A * Component("z")], INDEX)
