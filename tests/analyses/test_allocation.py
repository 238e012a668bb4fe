"""Cheapest tolerances against closed forms, another optimiser and fresh samples."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy import optimize, stats

import precision_pin as pp
from precision_pin.analyses.allocation import problem
from precision_pin.analyses.allocation.allocate import MEAN
from precision_pin.analyses.allocation.problem import beside, read_problem
from precision_pin.analyses.allocation.scaling import NoScaleError, contributions
from precision_pin.analyses.allocation.table import allocation_table
from precision_pin.analyses.exact_law.number_law import NormalNorm
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


def _problem(*specs: object, law: str = "uniform", **bounds: str) -> dict[str, object]:
    return {
        "tolerances": [
            {"path": f"parameters.a{k}.{law}", "cost": {"reciprocal": cost}, **bounds} for k, cost in enumerate(COSTS)
        ],
        "specs": list(specs),
    }


def test_root_mean_square_costs_what_the_closed_form_says(tmp_path: Path) -> None:
    limit = 0.3e-3
    result = pp.allocate(slide_model(tmp_path), _problem({"rms": "0.3 mm"}))
    least = float((COSTS ** (2 / 3) * (1 / 3) ** (1 / 3)).sum() ** 1.5 / limit)
    assert result.cost == pytest.approx(least, rel=1e-6)
    assert result.lower_bound == pytest.approx(least, rel=1e-6)
    assert result.limits[0].shadow_price == pytest.approx(least / limit, rel=1e-5)
    assert result.met


def test_worst_case_costs_what_the_closed_form_says(tmp_path: Path) -> None:
    result = pp.allocate(slide_model(tmp_path, "xxx"), _problem({"worst_case": "0.3 mm"}))
    least = float(np.sqrt(COSTS).sum() ** 2 / 0.3e-3)
    assert result.cost == pytest.approx(least, rel=1e-6)
    assert result.lower_bound == pytest.approx(least, rel=1e-6)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:delta_grad == 0.0")
def test_quantile_is_as_cheap_as_another_optimiser_finds_and_shown_by_fresh_samples(tmp_path: Path) -> None:
    model = slide_model(tmp_path, law="normal", mean="0.05 mm")
    result = pp.allocate(model, _problem("0.3 mm @ 95 %", law="normal"))
    one = result.limits[0]
    assert one.aimed is not None

    def excess(x: np.ndarray) -> float:
        law = NormalNorm(np.array([0.05e-3, 0, 0]), np.diag((np.exp(x) / 3) ** 2))
        return one.aimed - float(law.cumulative(np.array([0.3e-3]))[0])  # type: ignore[operator]

    found = optimize.minimize(
        lambda x: float((COSTS * np.exp(-x)).sum()) / 1e5,
        np.log(HALF),
        constraints=optimize.NonlinearConstraint(excess, -np.inf, 0),
        method="trust-constr",
        options={"maxiter": 300, "gtol": 1e-9},
    )
    assert excess(found.x) < 1e-6
    assert result.cost <= 1.001 * 1e5 * found.fun
    assert one.met
    again = pp.sample_poses(
        model.with_(result.changes), ["home"], samples=50_000, seed=77, specifications="0.3 mm @ 95 %"
    )
    assert again.probability[0, 0] == pytest.approx(one.probability, abs=0.004)


def test_limit_below_what_the_narrowest_tolerances_reach_is_infeasible(tmp_path: Path) -> None:
    result = pp.allocate(slide_model(tmp_path), _problem({"rms": "0.01 mm"}, min="0.05 mm"))
    assert not result.feasible
    assert not result.met
    assert result.after == pytest.approx([0.05e-3] * 3)
    assert allocation_table(result).startswith(
        "no allocation can meet root mean square position.norm 0.01 mm: with every tolerance at its least it is 0.05 mm at home;"
    )


@pytest.mark.parametrize("worst_case", [False, True])
def test_what_stands_in_the_way_is_named(tmp_path: Path, worst_case: bool) -> None:
    """A constant 0.2 mm, 0.05 mm of the chosen tolerance at its least, 0.2 mm of one that is not to be chosen."""
    spec = {"worst_case": "0.4 mm"} if worst_case else {"rms": "0.21 mm"}
    tolerances = [{"path": f"parameters.a{k}.uniform", "cost": {"reciprocal": 1}, "min": "0.03 mm"} for k in (0, 2)]
    model = slide_model(tmp_path, "xxx", mean="0.2 mm")
    result = pp.allocate(model, {"tolerances": tolerances, "specs": [spec]})
    assert not result.feasible
    by_name = {one.source: one for one in result.parts.sources}
    root = 1 if worst_case else np.sqrt(3)
    first, second, third = (by_name[name] for name in (f"length[tip]{k}" for k in ("", "#2", "#3")))
    assert by_name[MEAN].after == pytest.approx(0.2e-3)
    assert sorted(one.before for one in (first, second, third)) == pytest.approx(sorted(HALF / root))
    assert sorted(one.after for one in (first, second, third)) == pytest.approx(
        np.array([0.03, 0.03, 0.2]) * 1e-3 / root
    )
    assert [one.is_chosen for one in result.parts.sources].count(False) == 2
    table = allocation_table(result)
    assert "in the way: constant part 0.2 mm (no tolerance; compensate or calibrate removes it), length[tip]" in table
    assert "(not chosen)" in table


@pytest.mark.slow
def test_tolerances_come_back_to_what_the_samples_need(tmp_path: Path) -> None:
    """Of three uniform errors the quantile is below that of normal ones: the first choice is too dear and is corrected."""
    result = pp.allocate(slide_model(tmp_path), _problem("0.3 mm @ 95 %"))
    one = result.limits[0]
    assert one.met
    assert one.aimed is not None
    assert one.aimed < 0.95
    assert one.interval is not None
    # the margin: 100,000 samples need 95.137 % inside, and 95 of 100 such runs of a share of 95.25 % have as many
    least = stats.binom.isf(0.025, 100_000, 0.95) + 1
    wanted = 0.95 + one.margin
    assert stats.binom.sf(least - 1, 100_000, wanted) == pytest.approx(0.95, abs=1e-6)
    assert wanted <= one.interval[0] <= wanted + 0.002
    bare = pp.allocate(slide_model(tmp_path), _problem("0.3 mm @ 95 %"), for_samples=0)
    assert bare.limits[0].interval is not None
    assert 0.95 <= bare.limits[0].interval[0] <= 0.952
    # by another way: what the tolerances without a margin cost less
    assert result.margin_cost == pytest.approx(result.cost - bare.cost, abs=0.01 * bare.cost)
    assert bare.margin_cost is None


def test_mean_is_not_taken_for_a_tolerance(tmp_path: Path) -> None:
    problem = {"tolerances": [{"path": "parameters.a0.mean", "cost": {"reciprocal": 1}}], "specs": ["1 mm"]}
    with pytest.raises(InputError, match="changes the mean"):
        pp.allocate(slide_model(tmp_path, mean="0.05 mm"), problem)


@pytest.mark.slow
def test_a_calibrated_sheet_leaves_what_differs_from_visit_to_visit_to_be_chosen(tmp_path: Path) -> None:
    """By hand: σ² = limit² - Σ s², s what the readings left of the others, which are refused but without the calibration."""
    left = np.array([0.01e-3, 0.02e-3, 0.02e-3])
    names = ["a0", "a1", "a2"]
    known = {"names": names, "mean": dict.fromkeys(names, 0.0), "covariance": np.diag(left**2).tolist()}
    (tmp_path / "a.json").write_text(json.dumps({"schema": "precision-pin/calibration/1", "posterior": known}))
    sheet = slide_model(tmp_path).sheet
    assert sheet is not None
    assert sheet.contents is not None
    data = dict(sheet.contents.text.data)
    visit = {
        "length": {
            "frame": "tip",
            "along": "x of joint1",
            "parameters": {"normal": {"std": "0.1 mm"}, "scope": "visit"},
        }
    }
    model = pp.ErrorModel.from_dict({**data, "sources": [*data["sources"], visit], "calibrated": "a.json"}, tmp_path)
    chosen = [{"path": "length[tip]#2.parameters.normal.std", "cost": {"reciprocal": 1}}]
    found = pp.allocate(model, {"tolerances": chosen, "rms": "0.05 mm"})
    assert found.after[0] == pytest.approx(np.sqrt(0.05e-3**2 - (left**2).sum()), rel=1e-6)
    with pytest.raises(
        pp.InputError, match=r"a0\.uniform is a tolerance of numbers .* --set calibrated=none"
    ) as caught:
        pp.allocate(model, _problem({"rms": "0.3 mm"}))
    assert "\n" not in str(caught.value)
    # as check says beforehand
    asked = {**dict(model.sheet.contents.text.data), "allocate": _problem({"rms": "0.3 mm"})}
    calibrated = pp.ErrorModel.from_dict(asked, tmp_path)
    task = problem.read_problem(calibrated, None)
    with pytest.raises(pp.InputError, match=r"a0\.uniform is a tolerance of numbers .* --set calibrated=none"):
        problem.check_problem(calibrated, task)
    # without it they are chosen; nothing is taken as exact by that
    again = pp.allocate(model.with_({"calibrated": "none"}), _problem({"rms": "0.3 mm"}))
    least = float((COSTS ** (2 / 3) * (1 / 3) ** (1 / 3)).sum() ** 1.5 / np.sqrt(0.3e-3**2 - 0.1e-3**2))
    assert again.cost == pytest.approx(least, rel=1e-6)
    assert [one for one in again.findings if one.code == "W_TAKEN_AS_EXACT"] == []


def test_group_without_a_common_value_is_refused(tmp_path: Path) -> None:
    problem = {
        "tolerances": [
            {"path": "parameters.a0.uniform", "cost": {"reciprocal": 1}, "group": "g", "max": "0.1 mm"},
            {"path": "parameters.a1.uniform", "cost": {"reciprocal": 1}, "group": "g", "min": "0.2 mm"},
        ],
        "specs": [{"rms": "1 mm"}],
    }
    with pytest.raises(InputError, match="group g"):
        pp.allocate(slide_model(tmp_path), problem)


@pytest.mark.slow
def test_front_is_the_closed_form_at_every_limit(tmp_path: Path) -> None:
    """The least cost under a root mean square is inverse to the limit while no bound is reached."""
    result = pp.allocate(slide_model(tmp_path), _problem({"rms": "0.3 mm"}), pareto=7)
    least = float((COSTS ** (2 / 3) * (1 / 3) ** (1 / 3)).sum() ** 1.5 / 0.3e-3)
    assert [one.factor for one in result.front] == pytest.approx(np.geomspace(1 / 3, 3, 7))
    for one in result.front:
        assert one.cost == pytest.approx(least / one.factor, rel=1e-6)
        assert one.lower_bound == pytest.approx(least / one.factor, rel=1e-6)
        assert np.sqrt((one.tolerances**2).sum() / 3) == pytest.approx(0.3e-3 * one.factor, rel=1e-6)
    assert len(result.to_dict()["pareto"]) == 7


@pytest.mark.slow
def test_a_limit_that_holds_nothing_costs_no_rounds(tmp_path: Path) -> None:
    """The second limit is kept by far, which is no reason to try again."""
    specs = ["0.3 mm @ 95 %", "2 mm @ 99 %"]
    one, both = (pp.allocate(slide_model(tmp_path), _problem(*specs[:count]), for_samples=0) for count in (1, 2))
    assert both.after == pytest.approx(one.after)
    assert both.limits[1].aimed == pytest.approx(0.99)
    assert both.met


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
    {"joint_offset": {"joint": "joint2", "offset": {"normal": {"std": "0.1 mrad"}, "mean": "1 mrad"}}},
    {"joint_offset": {"joint": "joint2", "offset": "1 mrad"}},
    {"length": {"joint": "joint2", "along": "x of joint1", "parameters": "a"}},
    {"length": {"joint": "joint2", "along": "x of joint1", "parameters": ["a", "±0.1 mm", {"normal": "0.1 mm"}]}},
    {"axis_install": {"joint": "joint2", "radius": "0.1 mm", "span": "100 mm"}},
    {"axis_install": {"joint": "joint2", "diameter": "0.1 mm", "span": "100 mm", "start": "10 mm"}},
    {"backlash": {"joint": "joint2", "backlash": {"uniform": "0.1 mrad", "mean": "1 mrad"}, "band": "1 N*m"}},
    {"backlash": {"joint": "joint2", "backlash": "0.1 mrad", "band": "1 N*m"}},
    {"beam": {"link": "one", "EI": {"uniform": "1 N*m^2", "mean": "500 N*m^2"}, "GI": "400 N*m^2"}},
    {"beam": {"link": "one", "section": "tube", "material": "steel", "outer_diameter": "40 mm",
              "wall": {"uniform": "0.1 mm", "mean": "3 mm"}}},
    {"bearing_stiffness": {"joint": "joint2", "tilt": {"uniform": "10 N*m/rad", "mean": "1e5 N*m/rad"}}},
    {"clearance": {"joint": "joint2", "diametral": "0.02 mm", "span": "50 mm", "direction": "random"}},
    {"clearance": {"joint": "joint2", "diametral": "0.1 ± 0.02 mm", "span": "50 mm", "direction": "random"}},
    {"covariance": {"frame": "tip", "std": ["0.1 mm", "0.1 mm", "0.1 mm", "0.1 mrad", "0.1 mrad", "0.1 mrad"]}},
    {"encoder": {"joint": "joint2", "resolution": "20 arcsec"}},
    {"encoder": {"joint": "joint2", "amplitude": ANGLE, "offset": ANGLE}},
    {"frame": {"frame": "tip", "x": "±0.1 mm"}},
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
    """Yield a length with each law of a sheet, with and without what may stand beside its key."""
    for spelled in ("±0.1 mm", "1 ± 0.1 mm", "1 mm +/- 0.1 mm", "0.1 mm"):
        yield {"frame": {"frame": "tip", "x": spelled}}
    for law in laws_of_sheets().values():
        one = dict(law.form.example)
        beside = one | {option.key: option.example for option in law.form.options} | {"scope": "unit"}
        several = not isinstance(next(iter(one.values())), str) and law.form.key in ("joint_normal", "rows")
        for spelled in (one, beside):
            if law.form.key in ("disc", "circle") or several:
                yield {"frame": {"frame": "tip", "x": "p.x" if not several else "p.0"}, "p": spelled}
            else:
                yield {"frame": {"frame": "tip", "x": spelled}}
                yield {"frame": {"frame": "tip", "x": "p"}, "p": spelled}


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
    assert min(taken, named) > 50


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
