"""Cheapest tolerances against closed forms, another optimiser, enumeration of grades, and the table of ISO 286 by its formula."""

import itertools
import json
import os
import re
from functools import cache

import numpy as np
import pytest
from scipy import optimize, stats

import precision_pin as pp
from analyses.test_allocation_truth import model_of
from precision_pin.analyses.allocation import problem, tolerances
from precision_pin.analyses.allocation.allocate import MEAN
from precision_pin.analyses.allocation.convex_program import without_solver_lines
from precision_pin.analyses.allocation.problem import alternatives, read_problem
from precision_pin.analyses.allocation.table import allocation_table
from precision_pin.analyses.first_order import norm_quantile_slopes
from precision_pin.analyses.number_law import NormalNorm
from precision_pin.base import units
from precision_pin.draws.laws import laws_of_sheets
from precision_pin.sheet import reader
from precision_pin.sources import catalogue
from support.plain_robot import joint, link, random_arm, robot
from support.refusals import check_refused

HALF = np.array([0.1e-3, 0.2e-3, 0.05e-3])


COSTS = np.array([1.0, 4.0, 9.0])


def slide_model(folder, axes="xyz", law="uniform", mean="0 mm"):
    """Return a tip with three offsets, each of its own tolerance."""
    laws = {f"a{k}": {law: f"{1e3 * half:g} mm"} for k, half in enumerate(HALF)}
    laws["a0"] |= {"mean": mean}
    sources = [{"along": f"{axis} of joint1", "parameters": [f"a{k}"]} for k, axis in enumerate(axes)]
    return model_of(folder, laws, sources)


RECIPROCAL = [({"reciprocal": cost}, lambda t, cost=cost: cost / t) for cost in COSTS.tolist()]


def _problem(costs, specs, law="uniform", **more):
    own = [{key: by[k] for key, by in more.items() if k in by} for k in range(len(costs))]
    entries = [{"path": f"parameters.a{k}.{law}", "cost": cost, **own[k]} for k, (cost, _) in enumerate(costs)]
    return {"tolerances": entries, "specs": specs}


@pytest.mark.parametrize("worst_case", [False, True])
def test_what_stands_in_the_way_is_named(tmp_path, worst_case):
    """A constant 0.2 mm, 0.05 mm of the chosen tolerance at its least, 0.2 mm of one that is not to be chosen."""
    spec = {"worst_case": "0.4 mm"} if worst_case else {"rms": "0.21 mm"}
    chosen = [{"path": f"parameters.a{k}.uniform", "cost": {"reciprocal": 1}, "min": "0.03 mm"} for k in (0, 2)]
    model = slide_model(tmp_path, "xxx", mean="0.2 mm")
    result = pp.allocate(model, {"tolerances": chosen, "specs": [spec]})
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
def test_tolerances_come_back_to_what_the_samples_need(tmp_path):
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
    assert (bare.margin_cost, bare.limits[1].aimed, bare.met) == (None, pytest.approx(0.99), True)


def test_what_no_tolerance_is_and_a_group_without_a_common_value_are_refused(tmp_path):
    problem = {"tolerances": [{"path": "parameters.a0.mean", "cost": {"reciprocal": 1}}], "specs": ["1 mm"]}
    check_refused(("changes the mean", pp.allocate, slide_model(tmp_path, mean="0.05 mm"), problem))
    bounds = {"max": {0: "0.1 mm"}, "min": {1: "0.2 mm"}}
    apart = _problem(RECIPROCAL[:2], [{"rms": "1 mm"}], group={0: "g", 1: "g"}, **bounds)
    check_refused(("group g", pp.allocate, slide_model(tmp_path), apart))
    first, second = [["0.1 mm", 5], ["0.2 mm", 2]], [["0.05 mm", 9], ["0.1 mm", 4], ["0.3 mm", 1]]
    costs = [({"grades": first}, abs), ({"grades": second}, abs), ({"reciprocal": "1 mm"}, abs)]
    problem = _problem(costs, [{"rms": "1 mm"}], group=dict.fromkeys(range(3), "g"))
    result = pp.allocate(slide_model(tmp_path), problem)
    assert (result.after, result.cost) == (pytest.approx([1e-4] * 3), pytest.approx(5 + 4 + 10))
    second.remove(["0.1 mm", 4])
    check_refused(("group g", pp.allocate, slide_model(tmp_path), problem))


@pytest.mark.slow
def test_a_calibrated_sheet_leaves_what_differs_from_visit_to_visit_to_be_chosen(tmp_path):
    """By hand: σ² = limit² - Σ s², s what the readings left of the others, which are refused but without the calibration."""
    left = np.array([0.01e-3, 0.02e-3, 0.02e-3])
    names = ["a0", "a1", "a2"]
    known = {"names": names, "mean": dict.fromkeys(names, 0.0), "covariance": np.diag(left**2).tolist()}
    nominal = slide_model(tmp_path)
    of = {"schema": "precision-pin/calibration/1", "posterior": known, "kinematics": nominal.chain.kinematics}
    (tmp_path / "a.json").write_text(json.dumps(of))
    data = dict(nominal.sheet.contents.text.data)
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


def least_of_rms(limit):
    """Return the least cost of three reciprocal ones under a root mean square: in closed form."""
    return float((COSTS ** (2 / 3) * (1 / 3) ** (1 / 3)).sum() ** 1.5 / limit)


@pytest.mark.slow
def test_front_is_the_closed_form_at_every_limit(tmp_path):
    """The least cost under a root mean square is inverse to the limit while no bound is reached."""
    result = pp.allocate(slide_model(tmp_path), _problem(RECIPROCAL, [{"rms": "0.3 mm"}]), pareto=7)
    least = least_of_rms(0.3e-3)
    assert (result.cost, result.lower_bound) == pytest.approx((least, least), rel=1e-6)
    assert result.limits[0].shadow_price == pytest.approx(least / 0.3e-3, rel=1e-5)
    assert (result.met, result.bound_basis) == (True, "proof")
    assert [one.factor for one in result.front] == pytest.approx(np.geomspace(1 / 3, 3, 7))
    for one in result.front:
        assert (one.cost, one.lower_bound) == pytest.approx((least / one.factor, least / one.factor), rel=1e-6)
        assert np.sqrt((one.tolerances**2).sum() / 3) == pytest.approx(0.3e-3 * one.factor, rel=1e-6)
    assert len(result.to_dict()["pareto"]) == 7


@pytest.mark.slow
def test_what_only_the_first_order_refuses_is_found(tmp_path):
    """One uniform error of 0.1 mm is never beyond 0.1 mm; a normal one of its variance is in 8 % of the cases."""
    model = slide_model(tmp_path)
    tolerance = {"path": "parameters.a0.uniform", "cost": {"reciprocal": 1}, "min": "0.1 mm", "max": "0.2 mm"}
    result = pp.allocate(model, {"tolerances": [tolerance], "specs": ["x 0.1 mm @ 95 %"]})
    assert (result.feasible, result.met) == (True, True)
    # 95 % of a uniform error of 0.1053 mm are within 0.1 mm
    assert 0.1e-3 < result.after[0] <= 0.1e-3 / 0.95


SLIDE = robot(link("base"), link("tip"), joint("joint1", "prismatic", "base", "tip", axis=(0, 0, 1)))
SCALES = {"compliance": 98.1, "mass": 9.81e-6, "lead_error": 0.5}
"""Slopes of the height at half a metre, SI: 10 kg on 1 µm/N, and the way."""


def vertical_slide(folder, **changes):
    """Return a slide that carries a payload, with tolerances of its compliance, the mass and the lead."""
    (folder / "slide.urdf").write_text(SLIDE, encoding="utf-8")
    stated = {"compliance": "1 ± 0.1 um/N", "mass": "10 ± 1 kg", "lead_error": "±0.02 mm/m", **changes}
    sources = [
        {"joint_compliance": {"joint": "joint1", "compliance": stated["compliance"]}},
        {"payload": {"at": "tip", "mass": stated["mass"]}},
        {"transmission": {"joint": "joint1", "lead_error": stated["lead_error"]}},
    ]
    given = {"precision-pin": 1, "robot": "slide.urdf", "poses": {"up": "500 mm"}, "sources": sources}
    return pp.ErrorModel.from_dict(given, folder)


PATHS = ("joint_compliance[joint1].compliance", "payload[tip].mass", "transmission[joint1].lead_error")


def test_any_quantity_with_a_scale_is_allocated(tmp_path):
    """Σ c/t under a root mean square is least at (Σ (c a)^⅔)^1.5 / limit, a the slope / √3, the mean sag 98 µm taken off."""
    units_of = ("um/N", "kg", "mm/m")
    costs = {
        path: {"reciprocal": f"{cost} {unit}"} for path, cost, unit in zip(PATHS, (0.2, 3, 0.05), units_of, strict=True)
    }
    entries = [{"path": path, "cost": cost} for path, cost in costs.items()]
    model = vertical_slide(tmp_path)
    result = pp.allocate(model, {"tolerances": entries, "rms": "0.1 mm"})
    prices, slopes = np.array([0.2e-6, 3, 0.05e-3]), np.array(list(SCALES.values())) / np.sqrt(3)
    limit = np.sqrt(0.1e-3**2 - 98.1e-6**2)
    weights = (prices * slopes) ** (2 / 3)
    assert result.cost == pytest.approx(weights.sum() ** 1.5 / limit, rel=1e-6)
    chosen = limit * np.sqrt(weights / weights.sum()) / slopes
    assert result.after == pytest.approx(chosen, rel=1e-4)
    assert [entry["unit"] for entry in result.to_dict()["tolerances"]] == ["m/N", "kg", "m/m"]
    shown = [f"{value:.4g} {unit}" for value, unit in zip(chosen * [1e6, 1, 1e3], units_of, strict=True)]
    assert all(text in allocation_table(result) for text in shown)
    texts = [result.changes[path] for path in PATHS]
    assert all(text.endswith(f" {unit}") for text, unit in zip(texts, units_of, strict=True))
    # the sheet with them keeps the limit exactly
    again = pp.allocate(model.with_(result.changes), {"tolerances": entries, "rms": "0.1 mm"})
    assert again.cost_before == pytest.approx(result.cost, rel=1e-6)


def test_a_tolerance_goes_no_further_than_the_model_admits(tmp_path):
    """A mass of 10 ± 6 kg may become 10 ± 10 kg, and neither the double nor a hundred times of it."""
    model = vertical_slide(tmp_path, mass="10 ± 6 kg")
    entry = {"path": PATHS[1], "cost": {"reciprocal": "1 kg"}}
    result = pp.allocate(model, {"tolerances": [entry], "rms": "5 mm"})
    assert 9.98 < result.after[0] <= 10
    check_refused(
        ("10.5 kg is too wide: mass", pp.allocate, model, {"tolerances": [entry | {"max": "10.5 kg"}], "rms": "5 mm"})
    )


def test_units_of_costs_of_compound_quantities():
    for kind, numbers, quantity, at in (
        ("squared", "4 (mm/m)^2", units.RELATIVE_LENGTH, 4.0),
        ("exponential", [5, "1 1/(mm/m)"], units.RELATIVE_LENGTH, 5 / np.e),
        ("reciprocal", "1 %", units.RATIO, 10.0),
        ("reciprocal", 0.01, units.RATIO, 10.0),
    ):
        cost = tolerances.read_cost({kind: numbers}, "here", quantity, "uniform")
        assert float(cost.at(np.array(1e-3))) == pytest.approx(at)
    wrong = {"squared": "4 mm^2"}
    check_refused((r"such as \(m/m\)\^2", tolerances.read_cost, wrong, "here", units.RELATIVE_LENGTH, "uniform"))


ANGLE = "±0.1 mrad"


STATED = [
    {"joint_offset": {"joint": "joint2", "offset": ANGLE}},
    {"joint_offset": {"joint": "joint2", "offset": "1 mrad"}},
    {"length": {"joint": "joint2", "along": "x of joint1", "parameters": ["a", "±0.1 mm", {"normal": "0.1 mm"}]}},
    {"axis_install": {"joint": "joint2", "radius": "0.1 mm", "span": "100 mm"}},
    {"backlash": {"joint": "joint2", "backlash": "0.1 mrad", "band": "1 N*m"}},
    {"beam": {"link": "link1", "EI": {"uniform": "1 N*m^2", "mean": "500 N*m^2"}, "GI": "400 N*m^2"}},
    {"bearing_stiffness": {"joint": "joint2", "tilt": {"uniform": "10 N*m/rad", "mean": "1e5 N*m/rad"}}},
    {"clearance": {"joint": "joint2", "diametral": "0.02 mm", "span": "50 mm", "direction": "random"}},
    {"covariance": {"frame": "tool", "std": ["0.1 mm", "0.1 mm", "0.1 mm", "0.1 mrad", "0.1 mrad", "0.1 mrad"]}},
    {"encoder": {"joint": "joint2", "amplitude": ANGLE, "offset": ANGLE}},
    {"force": {"at": "tool", "force": ["0 N", {"normal": "5 N"}, "-50 N"]}},
    {"force": {"at": "tool", "magnitude": {"uniform": "1 N", "mean": "9 N"}, "direction": "any"}},
    {"frame": {"frame": "tool", "x": "d.x", "y": "d.y", "rz": {"triangular": "0.1 mrad"}}},
    {"guide": {"joint": "joint3", "EYX": "10 ± 2 um", "EAX": "50 urad", "length": "1 m"}},
    {"joint_compliance": {"joint": "joint2", "compliance": {"uniform": "1e-6 rad/(N*m)", "mean": "1e-5 rad/(N*m)"}}},
    {"levelling": {"rx": ANGLE, "ry": {"arcsine": "0.1 mrad"}}},
    {"mcpc": {"link": "link1", "alpha": ANGLE, "x": "1 ± 0.1 mm"}},
    {"mounting": {"at": "tool", "z": "±0.1 mm", "rx": "0.2 mrad"}},
    {"payload": {"at": "tool", "mass": "1 ± 0.1 kg", "com": ["±1 mm", "0 mm", "10 mm"]}},
    {"run_out": {"joint": "joint2", "radial": "10 ± 2 um", "axial": "5 um", "order": 2}},
    {"servo": {"joint": "joint2", "stiffness": "50 ± 5 N*m/rad", "friction": {"uniform": "0.1 N*m", "mean": "0.4 N*m"}}},
    {"strut": {"from": {"link": "base"}, "to": {"link": "tool"}, "push": "300 ± 10 N", "rate": "2 N/mm", "at_length": "1 m"}},
    {"thermal": {"link": "link1", "expansion": "12 ± 1 ppm/K", "temperature_change": "±5 K"}},
    {"transmission": {"joint": "joint2", "amplitude": [ANGLE, "0.1 mrad"], "order": [1, 2]}},
    {"transmission": {"joint": "joint2", "stiffness": {"uniform": "10 N*m/rad", "mean": "1e5 N*m/rad"}}},
]  # fmt: skip


def _spelled():
    """Yield a length with each law of a sheet; as a parameter, with what may stand beside its key."""
    for spelled in ("±0.1 mm", "1 ± 0.1 mm", "1 mm +/- 0.1 mm", "0.1 mm"):
        yield {"frame": {"frame": "tool", "x": spelled}}
    for law in laws_of_sheets().values():
        one = dict(law.form.example)
        beside = (
            one
            | {option.key: option.example for option in law.form.options if option.key not in ("cpk", "size")}
            | {"scope": "unit"}
        )
        several = not isinstance(next(iter(one.values())), str) and law.form.key in ("joint_normal", "rows")
        if law.form.key in ("disc", "circle", "sphere") or several:
            yield {"frame": {"frame": "tool", "x": "p.x" if not several else "p.0"}, "p": beside}
        else:
            yield {"frame": {"frame": "tool", "x": one}}
            yield {"frame": {"frame": "tool", "x": "p"}, "p": beside}


def _nodes(path, value):
    """Yield the path of a value and of everything below it."""
    yield path
    for key, one in value.items() if isinstance(value, dict) else ():
        yield from _nodes(f"{path}.{key}", one)
    for k, one in enumerate(value) if isinstance(value, list) else ():
        yield from _nodes(f"{path}[{k}]", one)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")
def test_every_path_is_taken_or_refused_with_one_that_is(tmp_path, monkeypatch):
    """Every kind of source and every law: the short path, the setting, what is below it, and the parameter that it names."""
    (tmp_path / "arm.urdf").write_text(random_arm(3, joints=3, prismatic=(3,)), encoding="utf-8")
    assert {next(iter(one)) for one in STATED} | {"table"} == set(catalogue())
    wrong, taken, named = [], 0, 0
    # the same arm a thousand times: read once
    chain = pp.Chain.from_urdf(tmp_path / "arm.urdf", tip="tool")
    monkeypatch.setattr(reader, "read_chain", lambda *_: chain)
    monkeypatch.setattr(problem, "_can_be_chosen", cache(problem._can_be_chosen))
    for stated in [*STATED, *_spelled()]:
        (kind, settings), *parameter = stated.items()
        named_laws = {"a": {"uniform": "0.1 mm"}, "d": {"disc": "0.1 mm"}, **dict(parameter)}
        model = pp.ErrorModel.from_dict(
            {
                "precision-pin": 1, "robot": "arm.urdf", "poses": {"home": ["20 deg", "40 deg", "10 mm"]},
                "parameters": named_laws, "sources": [{kind: settings}],
            },
            tmp_path,
        )  # fmt: skip
        label = model.labels[0]
        used = [name for name in named_laws if re.search(rf"['\[ ]{name}['.]", str(settings))]
        paths = [label, kind, *(node for key, one in settings.items() for node in _nodes(f"{label}.{key}", one))]
        paths += [node for name in used for node in _nodes(f"parameters.{name}", named_laws[name])]
        refused = {}
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
    assert wrong == []
    assert min(taken, named) > 80


def _refusal(model, path, known):
    """Return the message with which a path is refused, empty for one that is taken; ``known`` are those of tolerances."""
    try:
        task = read_problem(model, {"tolerances": [{"path": path, "cost": {"reciprocal": 1}}], "rms": "1 mm"})
    except pp.InputError as error:
        return str(error)
    meant = task.tolerances[0].path
    if meant not in known:
        try:
            tolerances.contributions(model, task.tolerances, task.poses, worst_case=False, advance=lambda _: None)
            known[meant] = ""
        except tolerances.NoScaleError as error:
            known[meant] = f"{error}{alternatives(model, error.path)}"
    return known[meant]


MIXED = [
    ({"exponential": [8, "9 1/mm"]}, lambda t: 8 * np.exp(-9e3 * t)),
    ({"logarithmic": [3, "1 mm"]}, lambda t: 3 * np.log(1e-3 / t)),
    ({"power": ["0.02 mm^1.5", 1.5]}, lambda t: 0.02 * (1e-3 / t) ** 1.5),
]


@pytest.mark.slow
def test_worst_case_with_a_bound_and_a_mean(tmp_path):
    model = slide_model(tmp_path, "xxx", mean="0.05 mm")
    asked = (_problem(MIXED, [{"worst_case": "0.4 mm"}], max={1: f"{most} mm"}) for most in ("0.12", "0.12001"))
    result, wider = (pp.allocate(model, one) for one in asked)
    # in tenths of millimetres
    found = optimize.minimize(
        lambda x: sum(cost(t) for (_, cost), t in zip(MIXED, x * 1e-4, strict=True)),
        np.ones(3),
        bounds=[(0.01, 10), (0.02, 1.2), (0.005, 5)],
        constraints={"type": "eq", "fun": lambda x: x.sum() - 3.5},
        tol=1e-12,
    )
    assert (result.cost, result.after[1]) == (pytest.approx(found.fun, rel=1e-6), pytest.approx(0.12e-3))
    assert result.shadow_prices[1] > 0
    assert result.cost - wider.cost == pytest.approx(1e-8 * result.shadow_prices[1], rel=1e-3)
    assert f"max, {result.shadow_prices[1] / 1e3:.3g} per mm" in allocation_table(result)
    assert result.gap < 1e-6


@pytest.mark.slow
def test_several_limits_with_a_group_and_a_lock(tmp_path):
    specs = ["0.3 mm @ 95 %", {"rms": "0.16 mm"}, {"worst_case": "0.25 mm"}]
    group = {0: "g", 2: "g"}
    problem = _problem(MIXED, specs, "normal", group=group, min={1: "0.1 mm"}, max={1: "0.1 mm"})
    result = pp.allocate(slide_model(tmp_path, "xyx", law="normal"), problem)
    aimed = result.limits[0].aimed

    def excess(x):
        t = np.array([x[0], 0.1e-3, x[0]])
        variances = np.array([t[0] ** 2 + t[2] ** 2, t[1] ** 2, 0.0]) / 9
        inside = NormalNorm(np.zeros(3), np.diag(variances)).cumulative(np.array([0.3e-3]))[0]
        return np.array([aimed - inside, np.sqrt(variances.sum()) / 0.16e-3 - 1, (t[0] + t[2]) / 0.25e-3 - 1])

    widest = optimize.brentq(lambda t: excess(np.array([t])).max(), 1e-6, 1e-3)
    least = sum(cost(t) for (_, cost), t in zip(MIXED, (widest, 0.1e-3, widest), strict=True))
    assert result.after == pytest.approx([widest, 0.1e-3, widest], rel=1e-5)
    assert result.cost == pytest.approx(least, rel=1e-5)


@pytest.mark.slow
def test_of_a_low_probability_no_bound_is_claimed(tmp_path):
    result = pp.allocate(slide_model(tmp_path, law="normal"), _problem(MIXED, ["0.15 mm @ 60 %"], law="normal"))
    assert (result.lower_bound, result.met) == (None, True)
    assert "how far above the least is not known" in allocation_table(result)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")
def test_a_tolerance_without_effect_is_the_widest(tmp_path):
    """Nothing of the sheet turns the tip, so that a limit of the attitude leaves every tolerance at its widest."""
    result = pp.allocate(slide_model(tmp_path), _problem(RECIPROCAL, ["1 mrad @ 99 %", {"rms": "1 mrad"}]))
    assert result.after == pytest.approx(100 * HALF)
    # no robot differs from another in its attitude: there is nothing to judge by samples, and a first order of zero is kept
    assert [one.verdict for one in result.limits] == ["nothing to judge", "met"]


@pytest.mark.slow
def test_grades_beside_any_tolerance_are_those_of_enumeration(tmp_path):
    """Two tolerances in grades and one without; the last is chosen by another optimiser."""
    rows = [["0.04 mm", 90], ["0.1 mm", 40], ["0.2 mm", 18]]
    grades = [(float(str(width).split()[0]) * 1e-3, float(price)) for width, price in rows]
    costs = [({"grades": rows}, abs), ({"grades": rows[::-1]}, abs), ({"reciprocal": "9 mm"}, abs)]
    model, rounds = slide_model(tmp_path, law="normal", mean="0.25 mm"), []
    result = pp.allocate(model, _problem(costs, ["0.3 mm @ 95 %"], "normal"), progress=rounds.append)
    # it ends where rounding keeps the bounds apart
    assert len(rounds) < 60

    def excess(t, probability):
        law = NormalNorm(np.array([0.25e-3, 0, 0]), np.diag((np.array(t) / 3) ** 2))
        return probability - float(law.cumulative(np.array([0.3e-3]))[0])

    def least(probability):
        found = np.inf
        for (first, price), (second, other) in itertools.product(grades, repeat=2):
            if excess((first, second, 1e-6), probability) < 0:
                widest = optimize.brentq(lambda t: excess((first, second, t), probability), 1e-6, 1e-2)  # noqa: B023
                found = min(found, price + other + 9e-3 / min(widest, 5e-3))
        return float(found)

    # what is aimed at is met, and the bound is that of what is asked for
    assert result.cost == pytest.approx(least(result.limits[0].aimed), rel=1e-6)
    assert 0.98 < result.lower_bound / least(0.95) <= 1 + 1e-9
    assert (result.met, result.bound_basis) == (True, "normal law")
    # under a root mean square it is proven, and is the cost
    result = pp.allocate(slide_model(tmp_path), _problem(costs, [{"rms": "0.3 mm"}]))
    assert (result.bound_basis, result.lower_bound) == ("proof", pytest.approx(result.cost, rel=1e-5))


@pytest.mark.slow
def test_iso_grades_have_half_of_their_width(tmp_path):
    costs = [({"iso286": {"size": "80 mm", "prices": {"IT6": 12, "IT7": 7, "IT9": 3}}}, abs)] * 3
    # half widths are 9.5, 15 and 37 µm
    result = pp.allocate(slide_model(tmp_path, "xxx"), _problem(costs, [{"worst_case": "0.035 mm"}]))
    assert sorted(result.after) == pytest.approx([9.5e-6, 9.5e-6, 15e-6])
    assert (result.cost, result.lower_bound) == pytest.approx((31, 31))
    assert sorted(one["grade"] for one in result.to_dict()["tolerances"]) == ["IT6", "IT6", "IT7"]


def test_a_diameter_is_as_wide_as_its_grade_and_a_deviation_is_none():
    given = {"iso286": {"size": "80 mm", "prices": {"IT7": 1}}}
    for key, width in (("diameter", 30e-6), ("radius", 15e-6), ("uniform", 15e-6)):
        cost = tolerances.read_cost(given, "here", units.LENGTH, key)
        assert isinstance(cost, tolerances.Grades)
        assert cost.widths == pytest.approx([width])
    check_refused(("standard deviation", tolerances.read_cost, given, "here", units.LENGTH, "std"))


def test_nothing_but_the_line_of_the_solver_is_lost(capfd):
    print("before")
    with without_solver_lines():
        os.write(1, b"HighsMipSolverData::transformNewIntegerFeasibleSolution tmpSolver.run();\n")
        print("inside")
    print("after")
    assert capfd.readouterr().out == "before\ninside\nafter\n"


def test_wrong_cost_is_refused(tmp_path):
    model = slide_model(tmp_path)
    for cost, words in (
        ({"grades": []}, "no grades"),
        ({"grades": [["0.1 mm"]]}, "list of"),
        ({"grades": [["0.1 mm", 1], ["100 um", 2]]}, "same tolerance"),
        ({"grades": [["0.1 mm", -1]]}, "price"),
        ({"grades": [["0 mm", 1]]}, "positive"),
        ({"iso286": {"size": "80 mm"}}, "size and prices"),
        ({"iso286": {"size": "80 mm", "prices": {"IT20": 1}}}, "no ISO 286 grade named 'IT20'"),
        ({"squared": "1 mm"}, r"unit such as mm\^2"),
        ({"exponential": ["1 mm", "2 1/mm"]}, "no unit"),
        ({"power": [1, 1000]}, "at most 100"),
    ):
        check_refused((words, pp.allocate, model, _problem([(cost, abs)], [{"rms": "1 mm"}])))


def test_units_of_costs(tmp_path):
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
def test_slopes_of_quantiles_are_differences(rank, length):
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
