"""Formulas: values against plain Python, gradients against the complex step, limits and sharing."""

import cmath
import itertools
import math
import pickle
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from precision_pin import InputError
from precision_pin.base.errors import InternalError
from precision_pin.draws import expressions
from precision_pin.draws.expressions import Component, Constant, Expression, Operation, Operator, Program, sqrt

INDEX = {"a": 0, "b": 1, "c": 2}
A, B, C = (Component(name) for name in INDEX)

FORMULAS: list[Callable[..., Any]] = [
    lambda a, b, c, f: a + b - c,
    lambda a, b, c, f: 2 + a,
    lambda a, b, c, f: 2 - a,
    lambda a, b, c, f: 3 * a * b,
    lambda a, b, c, f: a / b / 2,
    lambda a, b, c, f: 1 / (a * c),
    lambda a, b, c, f: -a,
    lambda a, b, c, f: a**4 - b**4,
    lambda a, b, c, f: c**-1.5,
    lambda a, b, c, f: (a - b) ** 3,
    lambda a, b, c, f: a**0 + b**1,
    lambda a, b, c, f: f.sqrt(a * a + b * b),
    lambda a, b, c, f: f.sin(a) * f.cos(b) + f.sin(c) ** 2,
    # second moment of area of a tube, and the flexibility that follows
    lambda a, b, c, f: 1 / (c * (math.pi / 64 * (b**4 - a**4))),
]
"""Each for our expressions and, by the same text, for complex numbers; ``f`` has the functions of either."""
POINTS = np.array([[0.7, 1.3, 2.1], [0.2, 0.9, 0.4], [1.1, 3.0, 5.0]]).T


def gradient(program: Program, point: list[float]) -> NDArray[np.float64]:
    rows = program.gradient(point)
    return np.array([[slopes.get(k, 0.0) for k in range(program.components)] for slopes in rows])


@pytest.mark.parametrize("formula", FORMULAS)
def test_value_against_plain_arithmetic_and_gradient_against_the_complex_step(formula: Any) -> None:
    program = Program.compile([formula(A, B, C, expressions)], INDEX)
    expected = [complex(formula(*point, cmath)).real for point in POINTS.T.tolist()]
    np.testing.assert_allclose(program.evaluate(POINTS), [expected], rtol=1e-15)
    for point in POINTS.T.tolist():
        moved = [[complex(value, 1e-30 * (j == k)) for j, value in enumerate(point)] for k in range(3)]
        slopes = [complex(formula(*one, cmath)).imag / 1e-30 for one in moved]
        np.testing.assert_allclose(gradient(program, point), [slopes], rtol=2e-14, atol=1e-15)


def test_several_parameters_of_several_samples() -> None:
    program = Program.compile([A * B, C, Constant(2.5), A * B], INDEX)
    seen = program.evaluate(POINTS)
    np.testing.assert_array_equal(seen, [POINTS[0] * POINTS[1], POINTS[2], np.full(3, 2.5), POINTS[0] * POINTS[1]])
    np.testing.assert_array_equal(gradient(program, [2.0, 3.0, 5.0]), [[3, 2, 0], [0, 0, 1], [0, 0, 0], [3, 2, 0]])
    # an arm that only sags has no parameter at all
    for samples in (0, 1, 7):
        assert Program.compile([], INDEX).evaluate(np.ones((3, samples))).shape == (0, samples)
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


def test_operator_numbers_are_the_interface_of_the_kernel() -> None:
    names = ["ADD", "SUBTRACT", "MULTIPLY", "DIVIDE", "POWER", "SQRT", "SIN", "COS", "SIGN"]
    assert [(operator.name, operator.value) for operator in Operator] == [(name, k) for k, name in enumerate(names)]


def chain_of(operations: int) -> Expression:
    result: Expression = A
    for k in range(operations):
        result = result + float(k + 1)
    return result


def test_256_operations_of_each_parameter_are_allowed_in_depth_and_in_breadth_and_257_are_not() -> None:
    def sum_of(parts: list[Expression]) -> Expression:
        return parts[0] if len(parts) == 1 else sum_of(parts[::2]) + sum_of(parts[1::2])

    program = Program.compile([chain_of(256), B * C], INDEX)
    assert len(program.operations) == 257
    assert program.evaluate(np.zeros((3, 1)))[0, 0] == 256 * 257 / 2
    assert len(Program.compile([sum_of([A * float(k + 2) for k in range(128)])], INDEX).operations) == 255
    for formula in (chain_of(257), chain_of(5000), sum_of([A * float(k + 2) for k in range(129)])):
        with pytest.raises(InputError, match="at most 256") as caught:
            Program.compile([formula], INDEX)
        assert "\n" not in str(caught.value)


def test_a_part_used_often_counts_once_and_takes_no_time() -> None:
    start = time.perf_counter()
    doubled: Expression = A
    for _ in range(32):
        doubled = doubled + doubled
    assert Program.compile([doubled], INDEX).evaluate(np.ones((3, 1)))[0, 0] == 2.0**32
    assert time.perf_counter() - start < 1


def test_equal_formulas_are_equal_and_survive_pickling() -> None:
    one = 1 / (A * B)
    for other in (1 / (A * B), pickle.loads(pickle.dumps(one))):
        assert (other, hash(other), {one: "kept"}[other]) == (one, hash(one), "kept")
    assert one != 1 / (B * A)
    assert isinstance(one, Operation)


def test_a_formula_that_fails_for_one_sample_says_why() -> None:
    x = np.array([[1.0, 0.0, 2.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]])
    for formula, reason in (
        (1 / A, "divi"),
        (A**-1, "divi"),
        (sqrt(A - 1), "invalid"),
        ((A - 1) ** 0.5, "invalid"),
        ((B * 1e200) ** 4, "overflow"),
        (B / Constant(0.0), "divi"),
    ):
        with pytest.raises(InputError, match=rf"^[^\n]*{reason}[^\n]*distribution[^\n]*$"):
            Program.compile([formula], INDEX).evaluate(x)


def test_gradients_at_zero_and_those_that_are_infinite() -> None:
    for formula in (sqrt(A), A**0.5, A**1.0 + sqrt(A)):
        with pytest.raises(InputError, match="no finite derivative"):
            Program.compile([formula], INDEX).gradient([0.0, 1.0, 1.0])
    for formula, expected in ((A**0, 0.0), (A**1, 1.0), (A**2, 0.0), (sqrt(Constant(0.0) * 1) + A, 1.0)):
        assert gradient(Program.compile([formula], INDEX), [0.0, 1.0, 1.0])[0, 0] == expected


def test_what_cannot_stand_in_a_formula() -> None:
    for number, use in itertools.product((math.nan, math.inf), (Expression.__add__, Expression.__pow__)):
        with pytest.raises(InputError):
            use(A, number)
    with pytest.raises(InternalError, match="'z'"):
        Program.compile([A * Component("z")], INDEX)
