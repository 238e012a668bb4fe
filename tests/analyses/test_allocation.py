"""Cheapest tolerances against closed forms, another optimiser, enumeration of grades, and the table of ISO 286 by its formula."""

from __future__ import annotations

import itertools
import json
import os
import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy import optimize, stats

import precision_pin as pp
from precision_pin.analyses.allocation import problem
from precision_pin.analyses.allocation.allocate import MEAN
from precision_pin.analyses.allocation.convex_program import (
    Limit,
    Programme,
    Solution,
    solve,
    without_solver_lines,
)
from precision_pin.analyses.allocation.problem import beside, read_problem
from precision_pin.analyses.allocation.table import allocation_table
from precision_pin.analyses.allocation.tolerances import (
    GRADES,
    SIZES,
    Grades,
    NoScaleError,
    contributions,
    grade_width,
    read_cost,
)
from precision_pin.analyses.exact_law.number_law import NormalNorm
from precision_pin.analyses.map.first_order import norm_quantile_slopes
from precision_pin.base import units
from precision_pin.base.errors import InputError
from precision_pin.draws.laws import laws_of_sheets
from precision_pin.robot.chain import Chain
from precision_pin.sheet import reader
from precision_pin.sources import catalogue
from support.plain_robot import joint, link, robot

URDF = """<robot name="slide"><link name="base"/><link name="tip"/>
<joint name="joint1" type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>"""


HALF = np.array([0.1e-3, 0.2e-3, 0.05e-3])


COSTS = np.array([1.0, 4.0, 9.0])


def slide_model(
    folder: Path, axes: str = "xyz", law: str = "uniform", mean: str = "0 mm", poses: dict[str, str] | None = None
) -> pp.ErrorModel:
    """Return a tip with three offsets, each of its own tolerance."""
    (folder / "slide.urdf").write_text(URDF, encoding="utf-8")
    lengths = [f"{1e3 * half:g} mm" for half in HALF]
    return pp.ErrorModel.from_dict(
        {
            "precision-pin": 1,
            "robot": "slide.urdf",
            "poses": poses or {"home": "0 deg"},
            "parameters": {
                f"a{k}": {law: length, **({"mean": mean} if k == 0 else {})} for k, length in enumerate(lengths)
            },
            "sources": [
                {"length": {"frame": "tip", "along": f"{axis} of joint1", "parameters": [f"a{k}"]}}
                for k, axis in enumerate(axes)
            ],
        },
        folder,
    )


RECIPROCAL: Costs = [({"reciprocal": cost}, lambda t, cost=cost: cost / t) for cost in COSTS.tolist()]


def _problem(costs: Costs, specs: list[object], law: str = "uniform", **more: dict[int, str]) -> dict[str, object]:
    entries = [
        {"path": f"parameters.a{k}.{law}", "cost": cost, **{key: by[k] for key, by in more.items() if k in by}}
        for k, (cost, _) in enumerate(costs)
    ]
    return {"tolerances": entries, "specs": specs}


@pytest.mark.parametrize("worst_case", [False, True])
def test_what_stands_in_the_way_is_named(tmp_path: Path, worst_case: bool) -> None:
    """A constant 0.2 mm, 0.05 mm of the chosen tolerance at its least, 0.2 mm of one that is not to be chosen."""
    spec = {"worst_case": "0.4 mm"} if worst_case else {"rms": "0.21 mm"}
    tolerances = [{"path": f"parameters.a{k}.uniform", "cost": {"reciprocal": 1}, "min": "0.03 mm"} for k in (0, 2)]
    model = slide_model(tmp_path, "xxx", mean="0.2 mm")
    result = pp.allocate(model, {"tolerances": tolerances, "specs": [spec]})
    assert (result.feasible, result.met) == (False, False)
    assert result.after == pytest.approx([0.03e-3] * 2)
    by_name = {one.source: one for one in result.parts.sources}
    root = 1 if worst_case else np.sqrt(3)
    own = [by_name[f"length[tip]{k}"] for k in ("", "#2", "#3")]
    assert by_name[MEAN].after == pytest.approx(0.2e-3)
    assert sorted(one.before for one in own) == pytest.approx(sorted(HALF / root))
    assert sorted(one.after for one in own) == pytest.approx(np.array([0.03, 0.03, 0.2]) * 1e-3 / root)
    assert [one.is_chosen for one in result.parts.sources].count(False) == 2
    table = allocation_table(result)
    least = 1e3 * (0.2e-3 + 0.26e-3 if worst_case else np.hypot(0.2e-3, np.sqrt((2 * 0.03**2 + 0.2**2) / 3) * 1e-3))
    limit = "worst case position 0.4" if worst_case else "root mean square position.norm 0.21"
    assert table.startswith(f"no allocation can meet {limit} mm: with every tolerance at its least it is {least:.3g}")
    assert "in the way: constant part 0.2 mm (no tolerance; compensate or calibrate removes it), length[tip]" in table
    assert "(not chosen)" in table


@pytest.mark.slow
def test_tolerances_come_back_to_what_the_samples_need(tmp_path: Path) -> None:
    """Of three uniform errors the quantile is below that of normal ones: the first choice is too dear and is corrected."""
    problem = _problem(RECIPROCAL, ["0.3 mm @ 95 %"])
    result = pp.allocate(slide_model(tmp_path), problem)
    # a second limit that is kept by far is no reason to try again
    problem["specs"].append("2 mm @ 99 %")
    bare = pp.allocate(slide_model(tmp_path), problem, for_samples=0)
    one = result.limits[0]
    assert one.met
    assert one.aimed < 0.95
    # the margin: 100,000 samples need 95.137 % inside, and 95 of 100 such runs of a share of 95.25 % have as many
    least = stats.binom.isf(0.025, 100_000, 0.95) + 1
    wanted = 0.95 + one.margin
    assert stats.binom.sf(least - 1, 100_000, wanted) == pytest.approx(0.95, abs=1e-6)
    assert wanted <= one.interval[0] <= wanted + 0.002
    assert 0.95 <= bare.limits[0].interval[0] <= 0.952
    # by another way: what the tolerances without a margin cost less
    assert result.margin_cost == pytest.approx(result.cost - bare.cost, abs=0.01 * bare.cost)
    assert bare.margin_cost is None
    assert bare.limits[1].aimed == pytest.approx(0.99)
    assert bare.met


def test_what_no_tolerance_is_and_a_group_without_a_common_value_are_refused(tmp_path: Path) -> None:
    problem = {"tolerances": [{"path": "parameters.a0.mean", "cost": {"reciprocal": 1}}], "specs": ["1 mm"]}
    with pytest.raises(InputError, match="changes the mean"):
        pp.allocate(slide_model(tmp_path, mean="0.05 mm"), problem)
    bounds = {"max": {0: "0.1 mm"}, "min": {1: "0.2 mm"}}
    with pytest.raises(InputError, match="group g"):
        pp.allocate(
            slide_model(tmp_path), _problem(RECIPROCAL[:2], [{"rms": "1 mm"}], group={0: "g", 1: "g"}, **bounds)
        )
    first, second = [["0.1 mm", 5], ["0.2 mm", 2]], [["0.05 mm", 9], ["0.1 mm", 4], ["0.3 mm", 1]]
    costs: Costs = [({"grades": first}, abs), ({"grades": second}, abs), ({"reciprocal": "1 mm"}, abs)]
    problem = _problem(costs, [{"rms": "1 mm"}], group=dict.fromkeys(range(3), "g"))
    result = pp.allocate(slide_model(tmp_path), problem)
    assert result.after == pytest.approx([1e-4] * 3)
    assert result.cost == pytest.approx(5 + 4 + 10)
    second.remove(["0.1 mm", 4])
    with pytest.raises(InputError, match="group g"):
        pp.allocate(slide_model(tmp_path), problem)


@pytest.mark.slow
def test_a_calibrated_sheet_leaves_what_differs_from_visit_to_visit_to_be_chosen(tmp_path: Path) -> None:
    """By hand: σ² = limit² - Σ s², s what the readings left of the others, which are refused but without the calibration."""
    left = np.array([0.01e-3, 0.02e-3, 0.02e-3])
    names = ["a0", "a1", "a2"]
    known = {"names": names, "mean": dict.fromkeys(names, 0.0), "covariance": np.diag(left**2).tolist()}
    (tmp_path / "a.json").write_text(json.dumps({"schema": "precision-pin/calibration/1", "posterior": known}))
    data = dict(slide_model(tmp_path).sheet.contents.text.data)
    law = {"normal": {"std": "0.1 mm"}, "scope": "visit"}
    visit = {"length": {"frame": "tip", "along": "x of joint1", "parameters": law}}
    data |= {"sources": [*data["sources"], visit], "calibrated": "a.json"}
    model = pp.ErrorModel.from_dict(data, tmp_path)
    chosen = [{"path": "length[tip]#2.parameters.normal.std", "cost": {"reciprocal": 1}}]
    found = pp.allocate(model, {"tolerances": chosen, "rms": "0.05 mm"})
    assert found.after[0] == pytest.approx(np.sqrt(0.05e-3**2 - (left**2).sum()), rel=1e-6)
    others = _problem(RECIPROCAL, [{"rms": "0.3 mm"}])
    # as check says beforehand
    calibrated = pp.ErrorModel.from_dict({**data, "allocate": others}, tmp_path)
    with pytest.raises(pp.InputError, match=r"a0\.uniform is a tolerance of numbers .* --set calibrated=none"):
        problem.check_problem(calibrated, problem.read_problem(calibrated, None))
    # without it they are chosen; nothing is taken as exact by that
    again = pp.allocate(model.with_({"calibrated": "none"}), others)
    assert again.cost == pytest.approx(least_of_rms(np.sqrt(0.3e-3**2 - 0.1e-3**2)), rel=1e-6)
    assert [one for one in again.findings if one.code == "W_TAKEN_AS_EXACT"] == []


def least_of_rms(limit: float) -> float:
    """Return the least cost of three reciprocal ones under a root mean square: in closed form."""
    return float((COSTS ** (2 / 3) * (1 / 3) ** (1 / 3)).sum() ** 1.5 / limit)


@pytest.mark.slow
def test_front_is_the_closed_form_at_every_limit(tmp_path: Path) -> None:
    """The least cost under a root mean square is inverse to the limit while no bound is reached."""
    result = pp.allocate(slide_model(tmp_path), _problem(RECIPROCAL, [{"rms": "0.3 mm"}]), pareto=7)
    least = least_of_rms(0.3e-3)
    assert (result.cost, result.lower_bound) == pytest.approx((least, least), rel=1e-6)
    assert result.limits[0].shadow_price == pytest.approx(least / 0.3e-3, rel=1e-5)
    assert result.met
    assert [one.factor for one in result.front] == pytest.approx(np.geomspace(1 / 3, 3, 7))
    for one in result.front:
        assert (one.cost, one.lower_bound) == pytest.approx((least / one.factor, least / one.factor), rel=1e-6)
        assert np.sqrt((one.tolerances**2).sum() / 3) == pytest.approx(0.3e-3 * one.factor, rel=1e-6)
    assert len(result.to_dict()["pareto"]) == 7


@pytest.mark.slow
def test_what_only_the_first_order_refuses_is_found(tmp_path: Path) -> None:
    """One uniform error of 0.1 mm is never beyond 0.1 mm; a normal one of its variance is in 8 % of the cases."""
    model = slide_model(tmp_path)
    tolerance = {"path": "parameters.a0.uniform", "cost": {"reciprocal": 1}, "min": "0.1 mm", "max": "0.2 mm"}
    result = pp.allocate(model, {"tolerances": [tolerance], "specs": ["x 0.1 mm @ 95 %"]})
    assert result.feasible
    assert result.met
    # 95 % of a uniform error of 0.1053 mm are within 0.1 mm
    assert 0.1e-3 < result.after[0] <= 0.1e-3 / 0.95


ARM = robot(
    link("base"), link("one", mass=1.0), link("tip", mass=1.0),
    joint("joint1", "revolute", "base", "one", axis=(0, 0, 1)),
    joint("joint2", "revolute", "one", "tip", (0.4, 0, 0), axis=(0, 1, 0)),
)  # fmt: skip


ANGLE = "±0.1 mrad"


STATED: list[dict[str, object]] = [
    {"joint_offset": {"joint": "joint2", "offset": ANGLE}},
    {"joint_offset": {"joint": "joint2", "offset": "1 mrad"}},
    {"length": {"joint": "joint2", "along": "x of joint1", "parameters": ["a", "±0.1 mm", {"normal": "0.1 mm"}]}},
    {"axis_install": {"joint": "joint2", "radius": "0.1 mm", "span": "100 mm"}},
    {"backlash": {"joint": "joint2", "backlash": "0.1 mrad", "band": "1 N*m"}},
    {"beam": {"link": "one", "EI": {"uniform": "1 N*m^2", "mean": "500 N*m^2"}, "GI": "400 N*m^2"}},
    {"bearing_stiffness": {"joint": "joint2", "tilt": {"uniform": "10 N*m/rad", "mean": "1e5 N*m/rad"}}},
    {"clearance": {"joint": "joint2", "diametral": "0.02 mm", "span": "50 mm", "direction": "random"}},
    {"covariance": {"frame": "tip", "std": ["0.1 mm", "0.1 mm", "0.1 mm", "0.1 mrad", "0.1 mrad", "0.1 mrad"]}},
    {"encoder": {"joint": "joint2", "amplitude": ANGLE, "offset": ANGLE}},
    {"frame": {"frame": "tip", "x": "d.x", "y": "d.y", "rz": {"triangular": "0.1 mrad"}}},
    {"joint_compliance": {"joint": "joint2", "compliance": {"uniform": "1e-6 rad/(N*m)", "mean": "1e-5 rad/(N*m)"}}},
    {"levelling": {"rx": ANGLE, "ry": {"arcsine": "0.1 mrad"}}},
    {"mcpc": {"link": "one", "alpha": ANGLE, "x": "1 ± 0.1 mm"}},
    {"mounting": {"at": "tool", "z": "±0.1 mm", "rx": "0.2 mrad"}},
    {"payload": {"at": "tip", "mass": "1 ± 0.1 kg", "com": ["±1 mm", "0 mm", "10 mm"]}},
    {"thermal": {"link": "one", "expansion": "12 ± 1 ppm/K", "temperature_change": "±5 K"}},
    {"transmission": {"joint": "joint2", "amplitude": [ANGLE, "0.1 mrad"], "order": [1, 2]}},
]  # fmt: skip


def _spelled() -> Iterator[dict[str, object]]:
    """Yield a length with each law of a sheet; as a parameter, with what may stand beside its key."""
    for spelled in ("±0.1 mm", "1 ± 0.1 mm", "1 mm +/- 0.1 mm", "0.1 mm"):
        yield {"frame": {"frame": "tip", "x": spelled}}
    for law in laws_of_sheets().values():
        one = dict(law.form.example)
        beside = one | {option.key: option.example for option in law.form.options} | {"scope": "unit"}
        several = not isinstance(next(iter(one.values())), str) and law.form.key in ("joint_normal", "rows")
        if law.form.key in ("disc", "circle") or several:
            yield {"frame": {"frame": "tip", "x": "p.x" if not several else "p.0"}, "p": beside}
        else:
            yield {"frame": {"frame": "tip", "x": one}}
            yield {"frame": {"frame": "tip", "x": "p"}, "p": beside}


def _nodes(path: str, value: object) -> Iterator[str]:
    """Yield the path of a value and of everything below it."""
    yield path
    for key, one in value.items() if isinstance(value, dict) else ():
        yield from _nodes(f"{path}.{key}", one)
    for k, one in enumerate(value) if isinstance(value, list) else ():
        yield from _nodes(f"{path}[{k}]", one)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")
@pytest.mark.parametrize("every", ["kind", "law"])
def test_every_path_is_taken_or_refused_with_one_that_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, every: str
) -> None:
    """Every kind of source and every law: the short path, the setting, what is below it, and the parameter that it names."""
    (tmp_path / "arm.urdf").write_text(ARM, encoding="utf-8")
    assert {next(iter(one)) for one in STATED} | {"table"} == set(catalogue())
    wrong, taken, named = [], 0, 0
    # the same arm a thousand times: read once
    chain = Chain.from_urdf(tmp_path / "arm.urdf", tip="tip")
    monkeypatch.setattr(reader, "read_chain", lambda *_: chain)
    monkeypatch.setattr(problem, "_can_be_chosen", cache(problem._can_be_chosen))
    for stated in STATED if every == "kind" else _spelled():
        (kind, settings), *parameter = stated.items()
        named_laws = {"a": {"uniform": "0.1 mm"}, "d": {"disc": "0.1 mm"}, **dict(parameter)}
        model = pp.ErrorModel.from_dict(
            {
                "precision-pin": 1, "robot": "arm.urdf", "poses": {"home": "20 40 deg"},
                "parameters": named_laws, "sources": [{kind: settings}],
            },
            tmp_path,
        )  # fmt: skip
        label = model.labels[0]
        assert isinstance(settings, dict)
        used = [name for name in named_laws if re.search(rf"['\[ ]{name}['.]", str(settings))]
        paths = [label, kind, *(node for key, one in settings.items() for node in _nodes(f"{label}.{key}", one))]
        paths += [node for name in used for node in _nodes(f"parameters.{name}", named_laws[name])]
        refused: dict[str, str] = {}
        said = {path: _refusal(model, path, refused) for path in paths}
        for path, message in said.items():
            working = re.search(r".*(?:tolerances?|equal): (\S.*)|.*; (\S.*) can be chosen$", message)
            listed = re.split(", | or ", working[1] or working[2]) if working else []
            listed = [one for one in listed if one in said]
            taken += not message
            named += bool(listed)
            if any(said[one] for one in listed):
                wrong.append(f"{stated}: {path}: {message}: but {[said[one] for one in listed]}")
            if message and not listed and any(not said[one] for one in paths):
                wrong.append(f"{stated}: {path}: {message}: but {[one for one in paths if not said[one]]} is taken")
    print(taken, named)
    assert wrong == []
    assert min(taken, named) > 40


def _refusal(model: pp.ErrorModel, path: str, known: dict[str, str]) -> str:
    """Return the message with which a path is refused, empty for one that is taken; ``known`` are those of tolerances."""
    try:
        task = read_problem(model, {"tolerances": [{"path": path, "cost": {"reciprocal": 1}}], "rms": "1 mm"})
    except InputError as error:
        return str(error)
    meant = task.tolerances[0].path
    if meant not in known:
        try:
            contributions(model, task.tolerances, task.poses, worst_case=False, advance=lambda _: None)
            known[meant] = ""
        except NoScaleError as error:
            known[meant] = f"{error}{beside(model, error.path)}"
    return known[meant]


Costs = list[tuple[dict[str, object], Callable[[float], float]]]


MIXED: Costs = [
    ({"exponential": [8, "9 1/mm"]}, lambda t: 8 * np.exp(-9e3 * t)),
    ({"logarithmic": [3, "1 mm"]}, lambda t: 3 * np.log(1e-3 / t)),
    ({"power": ["0.02 mm^1.5", 1.5]}, lambda t: 0.02 * (1e-3 / t) ** 1.5),
]


SQUARED: Costs = [
    ({"squared": "0.01 mm^2"}, lambda t: 0.01 * (1e-3 / t) ** 2),
    ({"reciprocal": "0.3 mm"}, lambda t: 0.3e-3 / t),
    ({"exponential": [5, "6 1/mm"]}, lambda t: 5 * np.exp(-6e3 * t)),
]


def _least(costs: Costs, excess: Callable[[np.ndarray], np.ndarray], bounds: list[tuple[float, float]]) -> float:
    """Return the least cost in tenths of millimetres, by an interior-point method with differences."""
    found = optimize.minimize(
        lambda x: float(sum(cost(t) for (_, cost), t in zip(costs, x * 1e-4, strict=True))),
        0.3 * np.array(bounds).min(axis=1) / 1e-4 + 0.1,
        bounds=[(low / 1e-4, high / 1e-4) for low, high in bounds],
        constraints=optimize.NonlinearConstraint(lambda x: excess(x * 1e-4), -np.inf, 0),
        method="trust-constr",
        options={"maxiter": 2000, "gtol": 1e-9, "xtol": 1e-11},
    )
    assert excess(found.x * 1e-4).max() < 1e-6
    return float(found.fun)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:delta_grad == 0.0")
def test_root_mean_square_of_three_kinds_of_cost(tmp_path: Path) -> None:
    result = pp.allocate(slide_model(tmp_path), _problem(MIXED, [{"rms": "0.12 mm"}]))
    bounds = [(half / 100, min(100 * half, 1e-3) if k == 1 else 100 * half) for k, half in enumerate(HALF)]
    least = _least(MIXED, lambda t: np.array([(t**2).sum() / 3 / 0.12e-3**2 - 1]), bounds)
    assert result.cost == pytest.approx(least, rel=1e-5)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:delta_grad == 0.0")
def test_worst_case_with_a_bound_and_a_mean(tmp_path: Path) -> None:
    model = slide_model(tmp_path, "xxx", mean="0.05 mm")
    result, wider = (
        pp.allocate(model, _problem(SQUARED, [{"worst_case": "0.4 mm"}], max={1: f"{most} mm"}))
        for most in ("0.12", "0.12001")
    )
    bounds = [(HALF[0] / 100, 100 * HALF[0]), (HALF[1] / 100, 0.12e-3), (HALF[2] / 100, 100 * HALF[2])]
    least = _least(SQUARED, lambda t: np.array([(t.sum() + 0.05e-3) / 0.4e-3 - 1]), bounds)
    assert result.cost == pytest.approx(least, rel=1e-5)
    assert result.after[1] == pytest.approx(0.12e-3)
    assert result.shadow_prices[1] > 0
    assert result.cost - wider.cost == pytest.approx(1e-8 * result.shadow_prices[1], rel=1e-3)
    assert f"max, {result.shadow_prices[1] / 1e3:.3g} per mm" in allocation_table(result)
    assert result.gap < 1e-6


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:delta_grad == 0.0")
def test_several_limits_with_a_group_and_a_lock(tmp_path: Path) -> None:
    specs: list[object] = ["0.3 mm @ 95 %", {"rms": "0.16 mm"}, {"worst_case": "0.25 mm"}]
    group = {0: "g", 2: "g"}
    problem = _problem(SQUARED, specs, "normal", group=group, min={1: "0.1 mm"}, max={1: "0.1 mm"})
    result = pp.allocate(slide_model(tmp_path, "xyx", law="normal"), problem)
    aimed = result.limits[0].aimed

    def excess(x: np.ndarray) -> np.ndarray:
        t = np.array([x[0], 0.1e-3, x[0]])
        variances = np.array([t[0] ** 2 + t[2] ** 2, t[1] ** 2, 0.0]) / 9
        inside = NormalNorm(np.zeros(3), np.diag(variances)).cumulative(np.array([0.3e-3]))[0]
        return np.array([aimed - inside, np.sqrt(variances.sum()) / 0.16e-3 - 1, (t[0] + t[2]) / 0.25e-3 - 1])

    widest = optimize.brentq(lambda t: excess(np.array([t])).max(), 1e-6, 1e-3)
    least = sum(cost(t) for (_, cost), t in zip(SQUARED, (widest, 0.1e-3, widest), strict=True))
    assert result.after == pytest.approx([widest, 0.1e-3, widest], rel=1e-5)
    assert result.cost == pytest.approx(least, rel=1e-5)


@pytest.mark.slow
def test_of_a_low_probability_no_bound_is_claimed(tmp_path: Path) -> None:
    result = pp.allocate(slide_model(tmp_path, law="normal"), _problem(MIXED, ["0.15 mm @ 60 %"], law="normal"))
    assert result.lower_bound is None
    assert result.met
    assert "how far above the least is not known" in allocation_table(result)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")
def test_a_tolerance_without_effect_is_the_widest(tmp_path: Path) -> None:
    """Nothing of the sheet turns the tip, so that a limit of the attitude leaves every tolerance at its widest."""
    result = pp.allocate(slide_model(tmp_path), _problem(SQUARED, ["1 mrad @ 99 %", {"rms": "1 mrad"}]))
    assert result.after == pytest.approx(100 * HALF)
    # no robot differs from another in its attitude: there is nothing to judge by samples, and a first order of zero is kept
    assert [one.verdict for one in result.limits] == ["nothing to judge", "met"]


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


def test_steps_end_with_their_size() -> None:
    widths = [grade_width(*of) for of in (("IT7", 0.08), ("IT7", 0.0800001), ("IT6", 0.5), ("IT12", 0.001))]
    assert widths == pytest.approx([30e-6, 35e-6, 40e-6, 100e-6])
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


def _programme(grades: list[Grades], limits: list[Limit]) -> Programme:
    ends = (np.array([one.widths[k] for one in grades]) for k in (0, -1))
    return Programme([[one] for one in grades], *ends, limits)


def _solve(grades: list[Grades], limits: list[Limit], seconds: float = 60.0) -> Solution:
    return solve(_programme(grades, limits), [one.widths for one in grades], seconds, lambda _: None)


@pytest.mark.parametrize("kinds", [("rms",), ("worst_case",), ("quantile",), ("rms", "worst_case")])
def test_cheapest_grades_are_those_of_enumeration(kinds: tuple[str, ...]) -> None:
    found = [_random(1, kind, 5, 2, means=0.3) for kind in kinds]
    grades, limits = found[0][0], [limit for _, (limit,) in found]
    found = _solve(grades, limits)
    tried = np.array(list(itertools.product(*(one.widths for one in grades)))).T
    kept = np.all([one.measure(tried).max(axis=1) <= one.limit for one in limits], axis=0)
    cost = sum(one.at(t) for one, t in zip(grades, tried, strict=True))
    least = float(np.asarray(cost)[kept].min())
    assert 0 < kept.sum() < len(kept)
    assert found.cost == pytest.approx(least, rel=1e-9)
    assert found.lower_bound == pytest.approx(least, rel=1e-5)
    assert found.lower_bound <= least * (1 + 1e-9)  # type: ignore[operator]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "spec", "mean"), [("uniform", {"rms": "0.3 mm"}, 0.0), ("normal", "0.3 mm @ 95 %", 0.25)]
)
def test_grades_beside_any_tolerance_are_those_of_enumeration(
    tmp_path: Path, law: str, spec: object, mean: float
) -> None:
    """Two tolerances in grades, of one group with equal ones, and one without; the last is chosen by another optimiser."""
    rows = [["0.04 mm", 90], ["0.1 mm", 40], ["0.2 mm", 18]]
    prices = [{float(width.split()[0]) * 1e-3: price for width, price in rows}] * 2
    costs: Costs = [({"grades": rows}, abs), ({"grades": rows[::-1]}, abs), ({"reciprocal": "9 mm"}, abs)]
    model, rounds = slide_model(tmp_path, law=law, mean=f"{mean} mm"), []
    result = pp.allocate(model, _problem(costs, [spec], law), progress=rounds.append)
    aimed = result.limits[0].aimed
    # it ends where rounding keeps the bounds apart
    assert len(rounds) < 60

    def excess(t: tuple[float, ...], probability: float) -> float:
        if aimed is None:
            return float(np.sqrt((np.array(t) ** 2).sum() / 3) / 0.3e-3 - 1)
        law = NormalNorm(np.array([1e-3 * mean, 0, 0]), np.diag((np.array(t) / 3) ** 2))
        return probability - float(law.cumulative(np.array([0.3e-3]))[0])

    def least(probability: float) -> float:
        found = np.inf
        for first, second in itertools.product(prices[0], prices[1]):
            if excess((first, second, 1e-6), probability) < 0:
                widest = optimize.brentq(lambda t: excess((first, second, t), probability), 1e-6, 1e-2)  # noqa: B023
                found = min(found, prices[0][first] + prices[1][second] + 9e-3 / min(widest, 5e-3))
        return float(found)

    # what is aimed at is met, and the bound is that of what is asked for
    assert result.cost == pytest.approx(least(aimed or 0.0), rel=1e-6)
    assert (1 - 1e-5 if aimed is None else 0.98) * least(0.95) < result.lower_bound <= least(0.95) * (1 + 1e-9)
    assert result.met
    assert result.bound_basis == ("proof" if aimed is None else "normal law")


@pytest.mark.slow
def test_iso_grades_have_half_of_their_width(tmp_path: Path) -> None:
    prices = {"IT6": 12, "IT7": 7, "IT9": 3}
    costs: Costs = [({"iso286": {"size": "80 mm", "prices": prices}}, abs)] * 3
    # half widths are 9.5, 15 and 37 µm: one of 9.5 is as good as none, so that 9.5 + 9.5 + 9.5 is all that 30 µm hold
    result = pp.allocate(slide_model(tmp_path, "xxx"), _problem(costs, [{"worst_case": "0.03 mm"}]))
    assert result.after == pytest.approx([9.5e-6] * 3)
    assert result.cost == pytest.approx(36)
    assert [one["grade"] for one in result.to_dict()["tolerances"]] == ["IT6"] * 3
    result = pp.allocate(slide_model(tmp_path, "xxx"), _problem(costs, [{"worst_case": "0.035 mm"}]))
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
def test_a_choice_that_is_cut_short_is_the_best_so_far_with_its_gap() -> None:
    grades, limits = _random(7, "quantile", 12, 2)
    found, whole = (_solve(grades, limits, seconds) for seconds in (1e-9, 60.0))
    assert _programme(grades, limits).exceeded(found.t).max() <= 0
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
        ({"grades": [["0 mm", 1]]}, "positive"),
        ({"iso286": {"size": "80 mm"}}, "size and prices"),
        ({"iso286": {"size": "80 mm", "prices": {"IT2": 1}}}, "no ISO 286 grade named 'IT2'"),
        ({"squared": "1 mm"}, r"unit such as mm\^2"),
        ({"exponential": ["1 mm", "2 1/mm"]}, "no unit"),
        ({"power": [1, 1000]}, "at most 100"),
    ],
)
def test_wrong_cost_is_one_line(tmp_path: Path, cost: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        pp.allocate(slide_model(tmp_path), _problem([(cost, abs)], [{"rms": "1 mm"}]))


def test_units_of_costs(tmp_path: Path) -> None:
    for cost, at in (
        ({"squared": "0.01 mm^2"}, 1.0),
        ({"squared": 1e-8}, 1.0),
        ({"power": ["0.001 mm^3", 3]}, 1.0),
        ({"exponential": [5, "10 1/mm"]}, 5 / np.e),
        ({"logarithmic": [2, "0.2 mm"]}, 2 * np.log(2)),
    ):
        problem = _problem([(cost, abs)], [{"rms": "1 mm"}], min={0: "0.1 mm"}, max={0: "0.1 mm"})
        assert pp.allocate(slide_model(tmp_path), problem).cost == pytest.approx(at)


@pytest.mark.fast(1)
@pytest.mark.parametrize(("rank", "length"), [(1, 0.5), (2, 4.0), (3, 0.0), (3, 4.0)])
def test_slopes_of_quantiles_are_differences(rank: int, length: float) -> None:
    """Along changes within the range of the covariance, and for full rank in any direction."""
    rng = np.random.default_rng(10 * rank + int(length))
    root = rng.normal(size=(3, rank))
    mean = root @ rng.normal(size=rank)
    mean *= length / np.linalg.norm(mean)
    covariance, change, step = root @ root.T, rng.normal(size=(rank, rank)), 1e-4
    change = root @ (change + change.T) @ root.T
    least, here, most = (NormalNorm(mean, covariance + by * change).quantile(0.95) for by in (-step, 0, step))
    slopes = norm_quantile_slopes(mean[:, None], covariance[:, :, None], np.array([here]))[:, :, 0]
    assert float((slopes * change).sum()) == pytest.approx((most - least) / (2 * step), rel=1e-5)
