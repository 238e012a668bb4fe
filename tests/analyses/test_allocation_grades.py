"""Tolerances in grades against exhaustive enumeration, and the table of ISO 286 against its own formula."""

from __future__ import annotations

import itertools
import os
from pathlib import Path

import numpy as np
import pytest
from scipy import optimize

import precision_pin as pp
from analyses.test_allocation import slide_model
from precision_pin.analyses.allocation.convex_program import Limit, Programme, Solution
from precision_pin.analyses.allocation.costs import GRADES, SIZES, Grades, grade_width, read_cost
from precision_pin.analyses.allocation.grades import solve_with_grades, without_solver_lines
from precision_pin.analyses.exact_law.number_law import NormalNorm
from precision_pin.analyses.map.normal_norms import norm_quantiles, principal_axes
from precision_pin.base import units
from precision_pin.base.errors import InputError

MULTIPLES = {"IT5": 7, "IT6": 10, "IT7": 16, "IT8": 25, "IT9": 40, "IT10": 64, "IT11": 100, "IT12": 160}


@pytest.mark.parametrize("grade", GRADES)
def test_table_is_the_formula_rounded(grade: str) -> None:
    """ISO 286-1: i = 0.45 D^(1/3) + 0.001 D up to 500 mm, I = 0.004 D + 2.1 above, D the geometric mean of the step."""
    edges = np.array([1, *SIZES], dtype=float)
    size = np.sqrt(edges[:-1] * edges[1:])
    unit = np.where(edges[1:] <= 500, 0.45 * np.cbrt(size) + 0.001 * size, 0.004 * size + 2.1)
    # rounded to preferred numbers, in the first step upwards by up to 16 %
    first, *others = np.array(GRADES[grade]) / (MULTIPLES[grade] * unit)
    assert 1 <= first <= 1.16
    assert others == pytest.approx(np.ones(len(others)), abs=0.1)
    # every fifth grade is ten times as wide
    if grade in ("IT6", "IT7"):
        assert np.array(GRADES[f"IT{int(grade[2:]) + 5}"]) == pytest.approx(10 * np.array(GRADES[grade]), rel=0.07)


def test_steps_end_with_their_size() -> None:
    assert grade_width("IT7", 0.08) == pytest.approx(30e-6)
    assert grade_width("IT7", 0.0800001) == pytest.approx(35e-6)
    assert grade_width("IT6", 0.5) == pytest.approx(40e-6)
    assert grade_width("IT12", 0.001) == pytest.approx(100e-6)
    for size in (0.0, 3.2):
        with pytest.raises(InputError, match="3150 mm"):
            grade_width("IT7", size)
    with pytest.raises(InputError, match="did you mean 'IT7'"):
        grade_width("IT77", 0.1)


def _random(seed: int, kind: str, size: int, poses: int, means: float = 0.0) -> tuple[list[Grades], list[Limit]]:
    """Return grades with prices that fall, and a limit that about half of the choices keep."""
    rng = np.random.default_rng(seed)
    grades = []
    for _ in range(size):
        widths = np.sort(rng.uniform(0.05, 1.0, 4)) * 1e-3
        grades.append(
            Grades(("",) * 4, widths, np.round(rng.uniform(0.5, 2) * (1e-3 / widths) ** rng.uniform(0.5, 1.5), 2))
        )
    ways = rng.normal(size=(size, 3, poses))
    mean = rng.normal(size=(3, poses)) * means * 1e-3
    if kind == "worst_case":
        parts, fixed = np.abs(ways)[:, :, None], np.zeros((3, 1, poses))
    else:
        parts = np.einsum("nip,njp->nijp", ways, ways) / 3
        fixed = np.zeros((3, 3, poses)) + np.eye(3)[:, :, None] * 1e-9
    middle = np.array([one.widths[1:3].mean() for one in grades])
    open_ended = Limit(kind, 1.0, 0.95, (0, 1, 2), mean, fixed, parts)
    return grades, [Limit(kind, float(open_ended.measure(middle[:, None]).max()), 0.95, (0, 1, 2), mean, fixed, parts)]


def _solve(grades: list[Grades], limits: list[Limit]) -> Solution:
    programme = Programme(
        [[one] for one in grades],
        np.array([one.widths[0] for one in grades]),
        np.array([one.widths[-1] for one in grades]),
        limits,
    )
    found = solve_with_grades(programme, [one.widths for one in grades], 60.0, lambda _: None)
    assert found is not None
    return found


@pytest.mark.fast(4)
@pytest.mark.parametrize("kind", ["rms", "worst_case", "quantile"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_cheapest_grades_are_those_of_enumeration(kind: str, seed: int) -> None:
    grades, limits = _random(seed, kind, 5, 2, means=0.3)
    found = _solve(grades, limits)
    tried = np.array(list(itertools.product(*(one.widths for one in grades)))).T
    kept = np.all([one.measure(tried).max(axis=1) <= one.limit for one in limits], axis=0)
    cost = sum(one.at(t) for one, t in zip(grades, tried, strict=True))
    least = float(np.asarray(cost)[kept].min())
    assert 0 < kept.sum() < len(kept)
    assert found.cost == pytest.approx(least, rel=1e-9)
    assert found.lower_bound == pytest.approx(least, rel=1e-5)
    assert found.lower_bound <= least * (1 + 1e-9)  # type: ignore[operator]


def test_several_limits_at_once() -> None:
    grades, [first] = _random(4, "rms", 5, 3)
    _, [second] = _random(4, "worst_case", 5, 3)
    found = _solve(grades, [first, second])
    tried = np.array(list(itertools.product(*(one.widths for one in grades)))).T
    kept = np.all([one.measure(tried).max(axis=1) <= one.limit for one in (first, second)], axis=0)
    cost = np.asarray(sum(one.at(t) for one, t in zip(grades, tried, strict=True)))
    assert found.cost == pytest.approx(float(cost[kept].min()), rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "spec", "mean"),
    [("uniform", {"rms": "0.3 mm"}, 0.0), ("normal", "0.3 mm @ 95 %", 0.0), ("normal", "0.3 mm @ 95 %", 0.25)],
)
def test_grades_beside_any_tolerance_are_those_of_enumeration(
    tmp_path: Path, law: str, spec: object, mean: float
) -> None:
    """Two tolerances in grades, of one group with equal ones, and one without; the last is chosen by another optimiser."""
    rows = [["0.04 mm", 90], ["0.1 mm", 40], ["0.2 mm", 18]]
    prices = [{float(width.split()[0]) * 1e-3: price for width, price in rows}] * 2
    problem = {
        "tolerances": [
            {"path": f"parameters.a0.{law}", "cost": {"grades": rows}},
            {"path": f"parameters.a1.{law}", "cost": {"grades": rows[::-1]}},
            {"path": f"parameters.a2.{law}", "cost": {"reciprocal": "9 mm"}},
        ],
        "specs": [spec],
    }
    model, rounds = slide_model(tmp_path, law=law, mean=f"{mean} mm"), []
    result = pp.allocate(model, problem, progress=rounds.append)
    aimed = result.limits[0].aimed
    # it ends where rounding keeps the bounds apart
    assert len(rounds) < 60

    def excess(t: tuple[float, ...], probability: float) -> float:
        if aimed is None:
            return float(np.sqrt((np.array(t) ** 2).sum() / 3) / 0.3e-3 - 1)
        inside = NormalNorm(np.array([1e-3 * mean, 0, 0]), np.diag((np.array(t) / 3) ** 2)).cumulative(
            np.array([0.3e-3])
        )
        return probability - float(inside[0])

    def least(probability: float) -> float:
        found = np.inf
        for first, second in itertools.product(prices[0], prices[1]):
            if excess((first, second, 1e-6), probability) < 0:
                widest = optimize.brentq(lambda t: excess((first, second, t), probability), 1e-6, 1e-2)  # noqa: B023
                found = min(found, prices[0][first] + prices[1][second] + 9e-3 / min(widest, 5e-3))
        return float(found)

    # what is aimed at is met, and the bound is that of what is asked for
    assert result.cost == pytest.approx(least(aimed or 0.0), rel=1e-6)
    assert result.lower_bound is not None
    assert (1 - 1e-5 if aimed is None else 0.98) * least(0.95) < result.lower_bound <= least(0.95) * (1 + 1e-9)
    assert result.met
    assert result.bound_basis == ("proof" if aimed is None else "normal law")


@pytest.mark.slow
def test_iso_grades_have_half_of_their_width(tmp_path: Path) -> None:
    prices = {"IT6": 12, "IT7": 7, "IT9": 3}
    problem = {
        "tolerances": [
            {"path": f"parameters.a{k}.uniform", "cost": {"iso286": {"size": "80 mm", "prices": prices}}}
            for k in range(3)
        ],
        "specs": [{"worst_case": "0.03 mm"}],
    }
    result = pp.allocate(slide_model(tmp_path, "xxx"), problem)
    # half widths are 9.5, 15 and 37 µm: one of 9.5 is as good as none, so that 9.5 + 9.5 + 9.5 is all that 30 µm hold
    assert result.after == pytest.approx([9.5e-6] * 3)
    assert result.cost == pytest.approx(36)
    assert [one["grade"] for one in result.to_dict()["tolerances"]] == ["IT6"] * 3
    problem["specs"] = [{"worst_case": "0.035 mm"}]
    result = pp.allocate(slide_model(tmp_path, "xxx"), problem)
    assert sorted(result.after) == pytest.approx([9.5e-6, 9.5e-6, 15e-6])
    assert result.lower_bound == pytest.approx(31)


def test_a_diameter_is_as_wide_as_its_grade_and_a_deviation_is_none() -> None:
    given = {"iso286": {"size": "80 mm", "prices": {"IT7": 1}}}
    for key, width in (("diameter", 30e-6), ("radius", 15e-6), ("uniform", 15e-6)):
        cost = read_cost(given, "here", units.LENGTH, key)
        assert isinstance(cost, Grades)
        assert cost.widths == pytest.approx([width])
    with pytest.raises(InputError, match="standard deviation"):
        read_cost(given, "here", units.LENGTH, "std")


@pytest.mark.slow
def test_group_of_grades_has_one_value(tmp_path: Path) -> None:
    first, second = [["0.1 mm", 5], ["0.2 mm", 2]], [["0.05 mm", 9], ["0.1 mm", 4], ["0.3 mm", 1]]
    problem = {
        "tolerances": [
            {"path": "parameters.a0.uniform", "cost": {"grades": first}, "group": "g"},
            {"path": "parameters.a1.uniform", "cost": {"grades": second}, "group": "g"},
            {"path": "parameters.a2.uniform", "cost": {"reciprocal": "1 mm"}, "group": "g"},
        ],
        "specs": [{"rms": "1 mm"}],
    }
    result = pp.allocate(slide_model(tmp_path), problem)
    assert result.after == pytest.approx([1e-4] * 3)
    assert result.cost == pytest.approx(5 + 4 + 10)
    second.remove(["0.1 mm", 4])
    with pytest.raises(InputError, match="group g"):
        pp.allocate(slide_model(tmp_path), problem)


@pytest.mark.slow
def test_a_choice_that_is_cut_short_is_the_best_so_far_with_its_gap() -> None:
    grades, limits = _random(7, "quantile", 16, 2)
    programme = Programme(
        [[one] for one in grades],
        np.array([one.widths[0] for one in grades]),
        np.array([one.widths[-1] for one in grades]),
        limits,
    )
    found = solve_with_grades(programme, [one.widths for one in grades], 1e-9, lambda _: None)
    assert found is not None
    assert found.lower_bound is not None
    assert programme.exceeded(found.t).max() <= 0
    whole = solve_with_grades(programme, [one.widths for one in grades], 60.0, lambda _: None)
    assert whole is not None
    assert found.lower_bound <= whole.lower_bound * (1 + 1e-9)  # type: ignore[operator]
    assert whole.cost <= found.cost < 1.2 * whole.cost


def test_nothing_but_the_line_of_the_solver_is_lost(capfd: pytest.CaptureFixture[str]) -> None:
    print("before")
    with without_solver_lines():
        os.write(1, b"HighsMipSolverData::transformNewIntegerFeasibleSolution tmpSolver.run();\n")
        print("inside")
    print("after")
    assert capfd.readouterr().out == "before\ninside\nafter\n"


@pytest.mark.parametrize(
    ("cost", "words"),
    [
        ({"grades": []}, "no grades"),
        ({"grades": [["0.1 mm"]]}, "list of"),
        ({"grades": [["0.1 mm", 1], ["100 um", 2]]}, "same tolerance"),
        ({"grades": [["0.1 mm", -1]]}, "price"),
        ({"grades": [["0.1 mrad", 1]]}, "unit of length"),
        ({"grades": [["0 mm", 1]]}, "positive"),
        ({"iso286": {"size": "80 mm"}}, "size and prices"),
        ({"iso286": {"size": "4 m", "prices": {"IT7": 1}}}, "3150 mm"),
        ({"iso286": {"size": "80 mm", "prices": {"IT2": 1}}}, "no ISO 286 grade named 'IT2'"),
        ({"reciprocal": "1 mrad"}, "unit such as mm"),
        ({"squared": "1 mm"}, r"unit such as mm\^2"),
        ({"exponential": ["1 mm", "2 1/mm"]}, "no unit"),
        ({"power": [1, 1000]}, "at most 100"),
    ],
)
def test_wrong_cost_is_one_line(tmp_path: Path, cost: object, words: str) -> None:
    problem = {"tolerances": [{"path": "parameters.a0.uniform", "cost": cost}], "specs": [{"rms": "1 mm"}]}
    with pytest.raises(InputError, match=words):
        pp.allocate(slide_model(tmp_path), problem)


@pytest.mark.parametrize(
    ("cost", "at"),
    [
        ({"squared": "0.01 mm^2"}, 1.0),
        ({"squared": 1e-8}, 1.0),
        ({"power": ["0.001 mm^3", 3]}, 1.0),
        ({"exponential": [5, "10 1/mm"]}, 5 / np.e),
        ({"logarithmic": [2, "0.2 mm"]}, 2 * np.log(2)),
    ],
)
def test_units_of_costs(tmp_path: Path, cost: object, at: float) -> None:
    problem = {
        "tolerances": [{"path": "parameters.a0.uniform", "cost": cost, "min": "0.1 mm", "max": "0.1 mm"}],
        "specs": [{"rms": "1 mm"}],
    }
    assert pp.allocate(slide_model(tmp_path), problem).cost == pytest.approx(at)


@pytest.mark.parametrize(("probability", "is_convex"), [(0.5, False), (0.92, True), (0.95, True), (0.999, True)])
def test_variances_that_keep_a_quantile_form_a_convex_set(probability: float, is_convex: bool) -> None:
    """What the lower bound of a quantile rests on, for a norm without mean: between two matrices on the edge all keep it."""
    rng = np.random.default_rng(5)
    count = 400
    columns = rng.normal(size=(2, count, 3, 3)) * 10 ** rng.uniform(-1.5, 0.5, size=(2, count, 1, 3))
    edges = []
    for matrices in np.einsum("wnij,wnkj->wikn", columns, columns):
        radii = norm_quantiles(*principal_axes(np.zeros((3, count)), matrices), probability)
        edges.append(matrices / radii**2)
    share = rng.uniform(size=count)
    between = share * edges[0] + (1 - share) * edges[1]
    radii = norm_quantiles(*principal_axes(np.zeros((3, count)), between), probability)
    assert (radii.max() <= 1 + 2e-5) == is_convex
