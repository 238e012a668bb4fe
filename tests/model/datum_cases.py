"""Arms, datums and figures of errors against datums, from an independent simulation of robots one by one.

``datum_cases.json`` holds 40 cases of 20 procedures: a UR5, one with biased errors, one with errors ten times as large, and
the paper's arm without loads. Each robot carried out its procedure with its own errors, 200,000 robots a case. SI units;
upper triangles of covariances; a few robots with their draws.
"""

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.draws.draw import Scope
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.robot.datums import Datum
from precision_pin.robot.examples import PAPER_SHEET

CASES: dict[str, Any] = json.loads(Path(__file__).with_suffix(".json").read_text(encoding="utf-8"))
PROCEDURES: dict[str, Any] = CASES["procedures"]
TASK = "T1"
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
AXES = ("x", "y", "z", "rx", "ry", "rz")


@cache
def arm(name: str) -> ErrorModel:
    """Return the model of an arm: ``ur5``, ``ur5bias``, ``ur5x10`` or ``paper``."""
    of = "paper" if name == "paper" else "ur5"
    poses = {pose: " ".join(map(repr, q)) + " rad" for pose, q in CASES["poses"][of].items()}
    sheet = {"precision-pin": 1, "gravity": "none", "poses": poses}
    if of == "paper":
        return ErrorModel.from_dict({**sheet, **_paper()}, PAPER_SHEET.parent)
    return ErrorModel.from_dict({**sheet, **_ur5(10 if name == "ur5x10" else 1, biased=name == "ur5bias")})


def _ur5(times: int, *, biased: bool) -> dict[str, object]:
    def normal(std: float, unit: str) -> dict[str, object]:
        return {"normal": {"std": f"{times * std!r} {unit}"}}

    def frame(shift: float) -> dict[str, Any]:
        return {axis: normal(*((shift, "mm") if k < 3 else (0.5, "mrad"))) for k, axis in enumerate(AXES)}

    names = [f"{joint}_joint" for joint in JOINTS]
    frames = [{"joint": name, **frame(0.2)} for name in names] + [{"frame": "tool0", **frame(0.3)}]
    offsets = [{"joint": name, "offset": normal(0.5, "mrad")} for name in names]
    repeated = [{"joint": name, "offset": {**normal(20, "urad"), "scope": "visit"}} for name in names]
    if biased:
        frames[3]["x"]["mean"], frames[6]["z"]["mean"] = "0.5 mm", "0.4 mm"
        offsets[1]["offset"]["mean"], offsets[2]["offset"]["mean"] = "1.5 mrad", "-1 mrad"
    sources = [
        *({"frame": entry} for entry in frames[:6]),
        *({"joint_offset": entry} for entry in (*offsets, *repeated)),
        {"frame": frames[6]},
    ]
    settings = {"robot": "example:ur5", "tip": "tool0", "target": "30 -20 150 mm", "keep_out": "none"}
    accepted = {"accept": {"W_MASS_ZERO": "ee_link, base and tool0 are frames"}}
    return {**settings, **accepted, "sources": sources}


def _paper() -> dict[str, object]:
    lengths = {"a1": 0.05, "a2": 0.25, "a3": 0.05, "a4": 0.25, "a5": 0.05}
    joints = [f"joint{k}" for k in range(1, 5)]
    visit = {"normal": {"std": "20 urad"}, "scope": "visit"}
    sources = [
        {"length": {"joint": "joint2", "along": "z of joint1", "parameters": ["a1"]}},
        {"length": {"joint": "joint3", "along": "x of joint2", "parameters": ["a2"]}},
        {"length": {"joint": "joint4", "along": "x of joint3", "parameters": ["a4"]}},
        {"length": {"frame": "tool", "along": "-z of joint4", "parameters": ["a1", "a3", "a5"]}},
        *({"axis_install": {"joint": name, "radius": "0.1 mm", "span": "100 mm"}} for name in joints),
        *({"joint_offset": {"joint": name, "offset": visit}} for name in joints),
    ]
    parameters = {name: {"uniform": f"{half} mm"} for name, half in lengths.items()}
    return {"robot": "4dof.urdf", "tip": "tool", "parameters": parameters, "sources": sources}


def datum(procedure: str, noise: tuple[float, float] | None = None) -> Datum:
    """Return the datum of a procedure with a noise of position and attitude (default: that of its last case)."""
    entry = PROCEDURES[procedure]
    kind, poses = entry["kind"], entry["poses"]
    # robots of a camera without noise were simulated with that of its weights
    shift, turn = noise or (entry["cases"][-1]["noise"] if any(entry["cases"][-1]["noise"]) else entry["weights"])
    if kind == "best_fit":
        return Datum.best_fit(poses, shift)
    if kind == "taught":
        return Datum.taught(*poses, {"std": shift, "attitude": turn})
    if kind == "three_points":
        return Datum.three_points(*poses, shift)
    if kind == "tool_pivot":
        return Datum.tool_pivot(poses, shift)
    settings = {name: np.array(place) for name, place in CASES["places"][kind].items()}
    settings |= {"on": "tool0", "noise": (shift, turn), "weights": entry["weights"]}
    return Datum.hand_eye(poses, entry["view"], **settings) if "view" in entry else Datum.eye_to_hand(poses, **settings)


@cache
def at_task(procedure: str, noise: tuple[float, float] | None = None) -> tuple[ErrorModel, PoseModel]:
    """Return the model of a procedure with some noise, and its model at the task."""
    model = arm(PROCEDURES[procedure]["arm"]).against(datum(procedure, noise))
    return model, model.at(TASK)


def draws_of(model: ErrorModel, entry: dict[str, Any]) -> Array:
    """Return the components ``(d,)`` of a robot of the file, for a model with one datum."""
    arm_space, index = model.bare.space, model.space.index
    names = {scope: [n for d in arm_space.draws if d.scope is scope for n in d.components] for scope in Scope}
    (found,) = model.datums
    values = dict(zip(names[Scope.UNIT], entry["unit"], strict=True))
    values |= zip(names[Scope.VISIT], entry["visit_at_task"], strict=True)
    for number, visit in enumerate(entry.get("visits", ()), 1):
        values |= {f"{found.label}.{number} {n}": v for n, v in zip(names[Scope.VISIT], visit, strict=True)}
    for (name, _), noise in zip(found.noise, entry.get("noise", ()), strict=False):
        values |= {f"{found.label}.{name} {axis}": v for axis, v in zip(AXES, noise, strict=False)}
    x = np.zeros(model.space.size)
    for name, value in values.items():
        # draws of noise along an axis without noise do not exist
        if name in index or (value and not name.startswith(found.label)):
            x[index[name]] = value
    return x


def symmetric(triangle: list[float]) -> Array:
    """Return the matrix of an upper triangle."""
    size = int(np.sqrt(2 * len(triangle)))
    matrix = np.zeros((size, size))
    matrix[np.triu_indices(size)] = triangle
    return matrix + np.triu(matrix, 1).T
