"""The public calls of the package with valid arguments, and what may be given in place of one by mistake."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import precision_pin as pp
from precision_pin.analyses.calibration.design import stations_of
from precision_pin.analyses.calibration.forecast import simulate_readings
from precision_pin.base.errors import PrecisionPinError
from precision_pin.robot.chain import Chain
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.statistics import Specification
from precision_pin.terms.term import JointValue

POSE = [0.1, 0.2, 0.3, 0.4]


def anything(*arguments: Any, **options: Any) -> None:
    """Take anything and give nothing."""


class Strange:
    """Knows nothing and can do nothing."""

    def __repr__(self) -> str:
        return "<Strange>"


MISTAKES: dict[str, Any] = {
    "nothing": None,
    "true": True,
    "minus one": -1,
    "zero": 0,
    "one half": 0.5,
    "large": 10**400,
    "nan": float("nan"),
    "infinity": float("inf"),
    "complex": 1j,
    "word": "nonsense",
    "digits": "3",
    "empty text": "",
    "bytes": b"3",
    "empty list": [],
    "empty tuple": (),
    "empty mapping": {},
    "list of words": ["nonsense", "x"],
    "list of nothing": [None],
    "ragged": [[1.0], [2.0, 3.0]],
    "unknown key": {"nonsense": 1.0},
    "set": {1.0},
    "array of three axes": np.zeros((2, 3, 4)),
    "array of nan": np.full(4, np.nan),
    "array of text": np.array(["a", "b"]),
    "array of objects": np.array([object(), object()]),
    "strange": Strange(),
    "type": int,
    "function": anything,
}
"""What stands where something else belongs."""


@dataclass(frozen=True)
class Call:
    """A public call with valid arguments.

    ``fine`` names the mistakes that are none: by argument, those that have a documented meaning.
    """

    name: str
    function: Callable[..., Any]
    arguments: dict[str, Any]
    fine: dict[str, str]
    words: dict[str, str]

    def run(self, **changed: Any) -> Any:
        """Call with some arguments changed; returns what is made, an iterator's items too."""
        given = {**self.arguments, **changed}
        parameters = inspect.signature(self.function).parameters.values()
        several = [entry.name for entry in parameters if entry.kind is entry.VAR_POSITIONAL]
        first = [
            given.pop(entry.name)
            for entry in parameters
            if entry.kind is entry.POSITIONAL_ONLY or (several and entry.kind is entry.POSITIONAL_OR_KEYWORD)
        ]
        for name in several:
            given_last = given.pop(name)
            first += given_last if isinstance(given_last, list | tuple) else [given_last]
        made = self.function(*first, **given)
        return list(made) if inspect.isgenerator(made) else made


@dataclass(frozen=True)
class Outcome:
    """What became of a mistake."""

    call: str
    argument: str
    mistake: str
    kind: str
    text: str


def outcome(call: Call, argument: str, mistake: str) -> Outcome:
    """Make a mistake and see."""
    try:
        made = call.run(**{argument: MISTAKES[mistake]})
    except PrecisionPinError as error:
        text = str(error)
        word = call.words.get(argument, argument)
        kind = "several lines" if "\n" in text else "refused" if named(word, text) else "not named"
        return Outcome(call.name, argument, mistake, kind, text)
    except Exception as error:  # noqa: BLE001 - that is what is looked for
        return Outcome(call.name, argument, mistake, type(error).__name__, str(error))
    fine = mistake in call.fine.get(argument, "").split(", ")
    return Outcome(call.name, argument, mistake, "fine" if fine else "accepted", repr(made)[:100])


def named(word: str, text: str) -> bool:
    """Whether a message says of which argument it is."""
    text = text.lower()
    return any(
        one.lower() in text
        for choice in word.split("|")
        for one in (choice, choice.replace("_", " "), choice.replace("_", "-"))
    )


WHOLE = ""
NUMBER = "zero, one half, minus one"
POSITIVE = "one half"
NOT_NEGATIVE = "zero, one half"
OPTIONAL = "nothing"
WAY = Path(__file__).with_name("way.csv")
UR_FILE, UR_ARM = (Path(__file__).with_name(name) for name in ("ur3.calibration.conf", "ur3.urdf"))
FILE = "path|file|3|nonsense"
POSE_FINE = "nothing"
SEVERAL = "nothing, list of nothing"
APPROACH_FINE = "nothing, empty list, empty tuple, empty mapping"
NO_SPECIFICATION = "empty list, empty tuple"


def _calibration_calls(call: Callable[..., Call]) -> Iterator[Call]:
    arm = small_model()
    tracker = pp.Measurement(target=(0.05, 0.03, 0.02))
    poses = np.random.default_rng(0).uniform(-2, 2, (4, 5))
    tips = simulate_readings(stations_of(arm, poses, tracker), tracker, arm, seed=5)[:, :, 0]
    words = {
        "model": "ErrorModel|calibrate",
        "at": "pose|joint",
        "poses": "pose|joint",
        "candidates": "pose|joint",
        "count": "number",
    }
    words |= {"data": "data|readings|path|file|nonsense|3|does not exist"}
    fine = {"at": "nothing", "findings": "empty list, empty tuple"}
    given = {"measurement": tracker, "at": np.array(POSE)[:, None], "findings": []}
    yield call("forecast_calibration", pp.forecast_calibration, {"model": arm, "poses": poses, **given}, words, **fine)
    yield call("plan_calibration", pp.plan_calibration,
               {"model": arm, "candidates": poses, "count": 2, **given, "criterion": "task", "seed": 3, "progress": None}, words,
               **fine, seed="zero", progress="nothing, true, function, type")  # fmt: skip
    yield call(
        "calibrate",
        pp.calibrate,
        {"model": arm, "data": (poses, tips), **given, "prior": True},
        words,
        **fine,
        prior="true",
    )
    yield call("identifiability", pp.identifiability, {"model": arm, "poses": poses, "measurement": tracker}, words)
    yield call(
        "population",
        pp.population,
        {"model": arm, "robots": [(poses, tips), (poses, tips)], "measurement": tracker, "means": "sheet", "confidence": 0.9,
         "findings": [], "progress": None},
        words | {"robots": "robots|data|readings|path|nonsense"},
        findings="empty list, empty tuple",
        confidence="one half",
        progress="nothing, true, function, type",
    )  # fmt: skip
    yield call(
        "ur_calibration",
        pp.ur_calibration,
        {"file": UR_FILE, "robot": Chain.from_urdf(UR_ARM)},
        {"file": f"{FILE}|factory calibration"},
    )
    yield call("every_frame", pp.every_frame, {"chain": arm.chain})
    yield call(
        "Measurement", pp.Measurement,
        {
            "kind": "pose", "std": 1e-5, "target": (0.1, 0.0, 0.0), "base": "free", "target_known": True,
            "attitude_std": 1e-4, "anchor": (0.0, 0.0, 0.0), "plane": None, "sockets": (), "load": None,
            "visible_from": (1.0, 0.0, 0.0), "facing": (0.0, 0.0, 1.0), "cone": 1.0,
        },
        {"std": "standard deviation"}, std=POSITIVE, target_known="true", attitude_std="nothing, one half",
        cone="one half", facing="nothing", plane="nothing", sockets="empty list, empty tuple",
        load="nothing, empty list, empty tuple",
    )  # fmt: skip


@cache
def model() -> pp.ErrorModel:
    """Return the paper's arm."""
    return pp.ErrorModel.load(PAPER_SHEET)


@cache
def small_model() -> pp.ErrorModel:
    """Return the paper's arm with errors of two joints only, for calls that take long with all errors."""
    arm = model()
    space = pp.Space((pp.Draw("a", pp.Normal(1e-3)), pp.Draw("b", pp.Uniform(1e-3))))
    offsets = [
        pp.sources.JointOffset(joint=joint, offset=name)
        for joint, name in zip(arm.chain.joint_names, ("a", "b"), strict=False)
    ]
    return pp.ErrorModel(arm.chain, space, offsets, dict(arm.poses))


def calls() -> Iterator[Call]:
    """Yield every public call."""
    arm, small = model(), small_model()
    chain, space = arm.chain, arm.space
    at = arm.at()
    x = space.sample(0, 0, 3)

    def call(
        label: str,
        function: Callable[..., Any],
        arguments: dict[str, Any],
        words: dict[str, str] | None = None,
        /,
        **fine: str,
    ) -> Call:
        return Call(label, function, arguments, fine, words or {})

    pose_words = {
        "q": "joint|pose",
        "poses": "pose|joint",
        "error_model": "ErrorModel",
        "specifications": "specification",
    }
    sampled = {"seed": 3, "samples": 64, "confidence": 0.9}
    sampled_fine = {"seed": "zero", "samples": WHOLE, "confidence": POSITIVE}
    yield call(
        "monte_carlo",
        pp.monte_carlo,
        {
            "error_model": arm, "q": POSE, "approach": None, **sampled, "model": "exact",
            "specifications": [Specification("position.x", 1e-3, 0.9)],
            "until": [], "keep_samples": False, "findings": [], "threads": 1, "processes": None, "executor": None,
            "tasks_under_way": None, "journal": None, "resume": False, "files": {}, "progress": None, "tell": None,
        },
        pose_words | {"journal": "journal", "files": "file", "until": "until|target", "approach": "approach|joint"},
        q=POSE_FINE, approach=APPROACH_FINE, **sampled_fine, specifications=NO_SPECIFICATION, until="empty list, empty tuple",
        keep_samples="true", findings="empty list, empty tuple", threads=OPTIONAL, processes=OPTIONAL, executor=OPTIONAL,
        tasks_under_way=OPTIONAL, journal="nothing, word, digits", resume=WHOLE, files="nothing, empty mapping",
        progress="nothing, true, function, type", tell="nothing, function, type",
    )  # fmt: skip
    yield call(
        "relative",
        pp.relative,
        {
            "error_model": arm, "pose": POSE, "other": [0.0, 0.1, 0.2, 0.3], **sampled, "model": "exact", "specifications": [],
            "keep_samples": False, "findings": [], "threads": 1, "progress": None,
        },
        pose_words | {"pose": "pose|joint", "other": "pose|joint"},
        pose=POSE_FINE, other=POSE_FINE, **sampled_fine, specifications=NO_SPECIFICATION, keep_samples="true",
        findings="empty list, empty tuple", threads=OPTIONAL, progress="nothing, true, function, type",
    )  # fmt: skip
    yield call(
        "sample_poses",
        pp.sample_poses,
        {
            "error_model": arm, "q": np.tile(np.array(POSE)[:, None], 2), "approach": None, **sampled, "model": "exact",
            "specifications": [], "findings": [], "threads": 1, "progress": None,
        },
        pose_words | {"q": "pose|joint", "approach": "approach|joint"},
        approach=APPROACH_FINE, **sampled_fine, specifications=NO_SPECIFICATION, findings="empty list, empty tuple",
        threads=OPTIONAL, progress="nothing, true, function, type",
    )  # fmt: skip
    yield call(
        "ApproachedPose",
        lambda pose, approach: arm.at(pp.ApproachedPose(pose, approach)),
        {"pose": POSE, "approach": {"joint1": "+"}},
        {"pose": "joint|pose", "approach": "approach|joint"},
        pose=POSE_FINE, approach=APPROACH_FINE.removeprefix("nothing, "),
    )  # fmt: skip
    yield call(
        "sample_approaches",
        pp.sample_approaches,
        {
            "error_model": arm, "pose": POSE, "approaches": ["joint1 +", "joint1 -"], "robots": 3, "cycles": 2, "seed": 0,
            "model": "exact", "target": (0.0, 0.0, 0.1), "number": 0, "first": 0,
        },
        {"error_model": "ErrorModel", "pose": "joint|pose", "approaches": "approach|joint", "number": "number"},
        pose=POSE_FINE, robots=WHOLE, cycles=WHOLE, seed="zero", number="zero", first="zero",
    )  # fmt: skip
    yield call(
        "map_poses",
        pp.map_poses,
        {
            "error_model": arm, "poses": np.tile(np.array(POSE)[:, None], 2), **sampled, "relative_to": None,
            "specifications": [], "verify": 1, "findings": [], "threads": 1, "progress": None,
        },
        pose_words | {"poses": "pose|joint", "relative_to": "pose|joint"},
        **sampled_fine | {"samples": OPTIONAL}, relative_to=POSE_FINE, verify="zero", specifications=NO_SPECIFICATION,
        findings="empty list, empty tuple", threads=OPTIONAL, progress="nothing, true, function, type",
    )  # fmt: skip
    yield call(
        "path_law",
        pp.path_law,
        {
            "error_model": arm, "poses": np.tile(np.array(POSE)[:, None], 2), "samples": 100, "seed": 0, "probability": 0.95,
            "model": "exact", "specifications": [], "confidence": 0.95, "findings": [], "threads": 1, "progress": None,
        },
        pose_words | {"poses": "pose|joint"},
        **sampled_fine, probability="one half", specifications=NO_SPECIFICATION, findings="empty list, empty tuple",
        threads=OPTIONAL, progress="nothing, true, function, type",
    )  # fmt: skip
    yield call(
        "compare",
        pp.compare,
        {
            "models": [arm, arm], "poses": POSE, **sampled, "specifications": [], "findings": [], "threads": 1,
            "progress": None,
        },
        pose_words | {"poses": "pose|joint"},
        **sampled_fine, poses=SEVERAL, specifications=NO_SPECIFICATION, findings="empty list, empty tuple",
        threads=OPTIONAL, progress="nothing, true, function, type",
    )  # fmt: skip
    yield call(
        "inverse_kinematics",
        pp.inverse_kinematics,
        {
            "chain": chain, "wanted": at.posture.pose, "task": "axis", "tool_axis": (1.0, 0.0, 0.0), "reference": POSE,
            "progress": None,
        },
        {"wanted": "wanted pose", "reference": "joint"},
        reference=OPTIONAL, progress="nothing, true, function, type",
    )  # fmt: skip
    yield call("joint_grid", pp.joint_grid, {"chain": chain, "values": {name: [0.0, 0.5] for name in chain.joint_names}},
               {"values": "values|joint"})  # fmt: skip
    yield call("box_places", pp.box_places, {"x": [0.3, 0.4], "y": [0.0], "z": 0.2}, dict.fromkeys("xyz", "values"),
               x=NUMBER, y=NUMBER, z=NUMBER)  # fmt: skip
    yield call(
        "plane_places",
        pp.plane_places,
        {"origin": [0.3, 0.0, 0.2], "u": [1.0, 0.0, 0.0], "v": [0.0, 0.0, 1.0], "along_u": [0.0, 0.1], "along_v": [0.0]},
        {"u": "direction u", "v": "direction v", "along_u": "values of u", "along_v": "values of v"},
        along_u=NUMBER, along_v=NUMBER,
    )  # fmt: skip
    yield call(
        "place_grid",
        pp.place_grid,
        {
            "chain": chain, "places": np.array([[0.3], [0.0], [0.2]]), "orientations": pp.Orientation.free(),
            "branches": "all", "reference": POSE, "progress": None,
        },
        {"reference": "joint"},
        reference=OPTIONAL, progress="nothing, true, function, type",
    )  # fmt: skip
    yield call(
        "random_poses",
        pp.random_poses,
        {"chain": chain, "count": 3, "seed": 1, "box": [[0, 1], [0, 1], [0, 1]], "orientations": None, "progress": None},
        {"count": "number of poses"},
        seed="zero", box=OPTIONAL, orientations=OPTIONAL, progress="nothing, true, function, type",
    )  # fmt: skip
    yield call(
        "read_trajectory", pp.read_trajectory, {"path": WAY, "chain": chain, "most": 10}, {"path": FILE, "most": "most"}
    )
    way = pp.read_trajectory(WAY, chain)
    yield call(
        "Trajectory.refined", way.refined, {"time_step": 0.5, "angle_step": 0.1, "length_step": None, "most": 100},
        time_step="nothing, one half", angle_step="nothing, one half", length_step=OPTIONAL,
    )  # fmt: skip
    yield call("Orientation.given", pp.Orientation.given, {"rotation": np.eye(3), "label": "upright"},
               {"rotation": "orientation"}, label="word, digits, empty text")  # fmt: skip
    yield call("Orientation.along", pp.Orientation.along,
               {"direction": (0.0, 0.0, -1.0), "angles": 4, "tool_axis": (1.0, 0.0, 0.0)}, angles=OPTIONAL)  # fmt: skip
    chosen = {"path": "axis_install[joint1].radius", "cost": {"reciprocal": 1.0}}
    yield call(
        "allocate",
        pp.allocate,
        {
            "error_model": arm,
            "problem": {"tolerances": [chosen], "specs": [{"rms": "1 m"}]}, "seed": 0, "seconds": 9.0, "pareto": 2,
            "findings": [], "progress": None,
        },
        {"error_model": "ErrorModel", "problem": "problem|allocate", "pareto": "points of the front"},
        seed="zero", seconds="one half", pareto="zero", findings="empty list, empty tuple",
        progress="nothing, true, function, type",
    )  # fmt: skip
    yield call(
        "compensate",
        pp.compensate,
        {
            "error_model": arm, "poses": np.array(POSE)[:, None], "mode": "pose", "weights": np.ones(6), "findings": [],
            "progress": None,
        },
        pose_words | {"poses": "pose|joint"},
        findings="empty list, empty tuple", progress="nothing, true, function, type",
    )  # fmt: skip
    yield from _calibration_calls(call)
    yield call("pose_covariance", pp.pose_covariance, {"error_model": arm, "poses": np.tile(np.array(POSE)[:, None], 2)},
               pose_words | {"poses": "pose|joint"})  # fmt: skip
    yield call(
        "reliability",
        pp.reliability,
        {"error_model": small, "specifications": "200 mm @ 99 %", "poses": POSE, "findings": [], "progress": None, **sampled},
        pose_words,
        poses=SEVERAL, **sampled_fine, findings="empty list, empty tuple", progress="nothing, true, function, type",
    )  # fmt: skip
    yield call(
        "worst_case",
        pp.worst_case,
        {"error_model": small, "poses": POSE, **sampled, "k": 3.0, "findings": [], "progress": None},
        pose_words,
        poses=SEVERAL, **sampled_fine, k=POSITIVE, findings="empty list, empty tuple", progress="nothing, true, function, type",
    )  # fmt: skip
    yield call(
        "moments",
        pp.moments,
        {
            "error_model": small, "poses": POSE, "seed": 1, "samples": 1024, "method": "plain", "confidence": 0.9,
            "findings": [], "progress": None,
        },
        pose_words,
        poses=SEVERAL, **sampled_fine, findings="empty list, empty tuple", progress="nothing, true, function, type",
    )  # fmt: skip
    yield call(
        "budget",
        pp.budget,
        {
            "error_model": small, "poses": POSE, "seed": 1, "samples": 1024, "confidence": 0.9, "k": 3.0, "bound_at": None,
            "findings": [], "progress": None,
        },
        pose_words,
        poses=SEVERAL, **sampled_fine, k=POSITIVE, bound_at="nothing, one half", findings="empty list, empty tuple",
        progress="nothing, true, function, type",
    )  # fmt: skip
    yield call(
        "exact_law",
        pp.exact_law,
        {"error_model": small, "poses": POSE, "seed": 1, "samples": 100, "confidence": 0.9, "findings": [], "progress": None},
        pose_words,
        poses=SEVERAL, **sampled_fine, findings="empty list, empty tuple", progress="nothing, true, function, type",
    )  # fmt: skip
    yield call(
        "iso9283",
        pp.iso9283,
        {
            "error_model": _visiting(arm), "poses": [POSE] * 2, "cycles": 2, "robots": 5, "seed": 3, "target": [0.0, 0.0, 0.1],
            "load": 1.0,
            "fit_base": False, "specifications": ["RP 1 mm"], "confidence": 0.9, "findings": [], "threads": 1, "progress": None,
        },
        pose_words | {"robots": "robot", "cycles": "cycle", "target": "target"},
        seed="zero", target=OPTIONAL, load=NOT_NEGATIVE, specifications=NO_SPECIFICATION, confidence=POSITIVE,
        findings="empty list, empty tuple", threads=OPTIONAL, progress="nothing, true, function, type",
    )  # fmt: skip
    yield call(
        "iso9283_of", pp.iso9283_of, {"commanded": np.zeros(6), "attained": np.zeros((2, 6))},
    )  # fmt: skip
    yield call(
        "iso9283_distance", pp.iso9283_distance,
        {"commanded_pair": np.zeros((2, 6)), "attained_pair": np.zeros((2, 2, 6))},
        {"commanded_pair": "commanded", "attained_pair": "attained"},
    )  # fmt: skip
    yield call("specification", pp.specification, {"text": "0.5 mm @ 95 %"}, {"text": "specification"})
    yield call(
        "Specification", Specification, {"quantity": "position.x", "limit": 1e-3, "required": 0.9},
        {"required": "probability"}, limit=POSITIVE, required=POSITIVE,
    )  # fmt: skip
    yield call("Chain.at", chain.at, {"q": POSE}, {"q": "joint"})
    yield call("Chain.configuration", chain.configuration, {"q": POSE}, {"q": "joint"})
    yield call("Chain.at_many", chain.at_many, {"q": np.zeros((4, 3))}, {"q": "joint|pose"})
    yield call("Chain.joint_index", chain.joint_index, {"name": "joint1"}, {"name": "joint"})
    yield call("Chain.link_frame", chain.link_frame, {"name": chain.tip}, {"name": "link"})
    yield call("Chain.frame_place", chain.frame_place, {"name": chain.tip}, {"name": "link"})
    for name in ("end", "seat", "runs_backwards"):
        yield call(f"Chain.{name}", getattr(chain, name), {"link": 4}, link="zero")
    yield call("Chain.axis_alignment", chain.axis_alignment, {"joint": 3}, joint="zero")
    for name in ("direction_of", "torque_on"):
        yield call(f"Posture.{name}", getattr(chain.at(POSE), name), {"joint": 3}, joint="zero")
    yield call(
        "Chain.with_payload", chain.with_payload, {"mass": 1.0, "centre": [0.0, 0.0, 0.1], "at": chain.tip},
        {"centre": "centre", "at": "link"}, mass=NOT_NEGATIVE, at=OPTIONAL,
    )  # fmt: skip
    yield call("Chain.with_target", chain.with_target, {"point": [0.0, 0.0, 0.1]}, {"point": "target"})
    urdf = chain.robot.file
    yield call(
        "Chain.from_urdf",
        pp.Chain.from_urdf,
        {"path": urdf, "tip": chain.tip, "base": chain.base, "gravity": [0, 0, -9.81], "locked": {}},
        {"tip": "link", "base": "link", "locked": "lock", "path": FILE},
        tip=OPTIONAL, base=OPTIONAL, locked="nothing, empty mapping",
    )  # fmt: skip
    yield call(
        "Chain.from_robot",
        pp.Chain.from_robot,
        {"robot": chain.robot, "tip": chain.tip, "base": chain.base, "gravity": [0, 0, -9.81], "locked": {}},
        {"tip": "link", "base": "link", "locked": "lock"},
        tip=OPTIONAL, base=OPTIONAL, locked="nothing, empty mapping",
    )  # fmt: skip
    yield call(
        "ErrorModel",
        pp.ErrorModel,
        {"chain": chain, "space": space, "sources": arm.sources, "poses": {"home": POSE}, "statics": "nominal"},
        {"sources": "source", "poses": "pose|joint"},
        sources="empty list, empty tuple", poses="nothing, empty mapping",
    )  # fmt: skip
    yield call("ErrorModel.load", pp.ErrorModel.load, {"path": PAPER_SHEET, "kinds": ()}, {"kinds": "kind", "path": FILE},
               kinds="empty list, empty tuple")  # fmt: skip
    yield call("ErrorModel.from_sheet", pp.ErrorModel.from_sheet, {"sheet": _sheet()})
    yield call("ErrorModel.at", arm.at, {"q": POSE, "approach": None}, {"q": "joint|pose", "approach": "approach|joint"},
               q=POSE_FINE, approach=APPROACH_FINE)  # fmt: skip
    yield call("ErrorModel.configuration", arm.configuration, {"q": POSE}, {"q": "joint|pose"}, q=POSE_FINE)
    yield call("ErrorModel.at_many", arm.at_many, {"q": np.zeros((4, 2))}, {"q": "joint|pose"})
    yield call("PoseModel.linear", at.linear, {"x": x})
    yield call("PoseModel.exact", at.exact, {"x": x})
    yield call("Space", pp.Space, {"draws": (pp.Draw("a", pp.Uniform(1.0)), pp.Draw("b", pp.Uniform(1.0))),
                                   "correlations": (pp.Correlation.pair("a", "b", 0.5),)},
               {"draws": "draw|parameter", "correlations": "correlation"}, correlations="empty list, empty tuple")  # fmt: skip
    yield call("Space.sample", space.sample, {"seed": 0, "first": 0, "count": 2, "pose": 0, "visit": 0}, None,
               seed="zero", first="zero", count="zero", pose="zero", visit="zero")  # fmt: skip
    yield call("Space.inverse", space.inverse, {"uniforms": np.full((space.size, 2), 0.5)})
    yield call("Space.parameter", space.parameter, {"name": space.components[0]}, {"name": "parameter"})
    yield call("Space.including", space.including, {"draws": [pp.Draw("new", pp.Uniform(1.0))]}, {"draws": "draw"},
               draws="empty list, empty tuple")  # fmt: skip
    yield call("Draw", pp.Draw, {"name": "a", "law": pp.Uniform(1.0), "scope": pp.Scope.UNIT},
               name="word, digits, empty text")  # fmt: skip
    yield call("Correlation", pp.Correlation, {"names": ("a", "b"), "matrix": ((1.0, 0.5), (0.5, 1.0))},
               {"names": "correlation", "matrix": "correlation"}, names="list of words, array of text")  # fmt: skip
    yield call("Correlation.pair", pp.Correlation.pair, {"first": "a", "second": "b", "correlation": 0.5},
               {"first": "correlation", "second": "correlation"}, correlation="one half, zero",
               first="word, digits, empty text", second="word, digits, empty text")  # fmt: skip
    for law, arguments, fine in (
        (pp.Fixed, {"mean": 1.0}, {"mean": NUMBER}),
        (pp.Uniform, {"half_width": 1.0, "mean": 0.0}, {"half_width": NOT_NEGATIVE, "mean": NUMBER}),
        (pp.Triangular, {"half_width": 1.0, "mean": 0.0}, {"half_width": NOT_NEGATIVE, "mean": NUMBER}),
        (pp.Arcsine, {"half_width": 1.0, "mean": 0.0}, {"half_width": NOT_NEGATIVE, "mean": NUMBER}),
        (pp.Normal, {"std": 1.0, "mean": 0.0}, {"std": NOT_NEGATIVE, "mean": NUMBER}),
        (pp.Normal.from_half_width, {"half_width": 1.0, "mean": 0.0, "k": 3.0},
         {"half_width": NOT_NEGATIVE, "mean": NUMBER, "k": POSITIVE}),
        (pp.TruncatedNormal, {"std": 1.0, "mean": 0.0, "k": 3.0}, {"std": NOT_NEGATIVE, "mean": NUMBER, "k": POSITIVE}),
        (pp.Lognormal, {"std": 0.5, "mean": 1.0}, {"std": NOT_NEGATIVE, "mean": POSITIVE}),
        (pp.TwoPoint, {"half_width": 1.0, "centre": 0.0, "probability": 0.5},
         {"half_width": NOT_NEGATIVE, "centre": NUMBER, "probability": POSITIVE}),
        (pp.Circle, {"radius": 1.0}, {"radius": NOT_NEGATIVE}),
        (pp.Disc, {"radius": 1.0}, {"radius": NOT_NEGATIVE}),
        (pp.JointNormal, {"matrix": ((1.0, 0.0), (0.0, 1.0)), "centre": (0.0, 0.0)}, {"centre": "empty list, empty tuple"}),
        (pp.Empirical, {"quantiles": ((0.0, 0.0), (1.0, 1.0))}, {}),
        (pp.Empirical.from_samples, {"samples": [0.0, 1.0, 3.0]}, {"samples": "set"}),
        (pp.Rows, {"table": ((0.0, 1.0), (1.0, 2.0)), "names": ("a", "b")},
         {"names": "empty list, empty tuple, list of words, array of text"}),
    ):  # fmt: skip
        words = {
            "std": "standard deviation", "matrix": "covariance", "centre": "mean" if law is pp.JointNormal else "centre",
            "quantiles": "empirical", "samples": "sample", "table": "rows", "names": "names",
            "mean": "fixed" if law is pp.Fixed else "mean",
        }  # fmt: skip
        yield call(law.__qualname__, law, arguments, words, **fine)
    yield call("Term", pp.Term, {"target": JointValue(0), "twist": np.ones(1), "factors": (), "loaded": False},
               {"target": "target", "factors": "factor"}, factors="empty list, empty tuple", loaded="true")  # fmt: skip
    yield call("Term.of", pp.Term.of,
               {"target": JointValue(0), "twist": [1.0], "values": [space.parameter("a1")], "loaded": False},
               {"values": "factor"}, twist=NUMBER, values=f"{NUMBER}, empty list, empty tuple", loaded="true")  # fmt: skip
    arm_mcpc = pp.mcpc.from_chain(chain)
    yield call("mcpc.from_chain", pp.mcpc.from_chain, {"chain": chain})
    yield call("mcpc.parameter_errors", pp.mcpc.parameter_errors,
               {"mcpc": arm_mcpc, "displacements": np.zeros((5, 6)), "chart": "complete"})  # fmt: skip
    yield call(
        "mcpc.frame_displacements", pp.mcpc.frame_displacements, {"mcpc": arm_mcpc, "parameter_errors": np.zeros(26)}
    )
    yield call("mcpc.joint_placements", pp.mcpc.joint_placements, {"mcpc": arm_mcpc})
    for name in ("forward_kinematics", "jacobian", "jacobian_base", "propagation"):
        yield call(f"Mcpc.{name}", getattr(arm_mcpc, name), {"q": POSE}, {"q": "joint values"})
    for name in ("link_pose", "joint_pose", "link_matrix"):
        yield call(f"Mcpc.{name}", getattr(arm_mcpc, name), {"link": 4}, link="zero")
    yield call("Mcpc.perturbed", arm_mcpc.perturbed, {"parameter_errors": np.zeros(26)})
    poses = pp.sample_poses(arm, [next(iter(arm.poses)), POSE], samples=64)
    yield call("PosesResult.between", poses.between, {"one": 0, "other": 1}, {"one": "pose", "other": "pose"},
               one="zero", other="zero")  # fmt: skip
    yield call("PosesResult.pose", poses.pose, {"name": "paper"}, {"name": "pose"})
    analysis = pp.monte_carlo(arm, POSE, samples=1000)
    norm = analysis.position.norm
    for method in ("quantile", "quantile_interval", "quantile_error"):
        yield call(f"Distribution.{method}", getattr(norm, method), {"p": 0.5}, {"p": "probability"}, p=POSITIVE)
    yield call(
        "Distribution.tolerance_bounds",
        norm.tolerance_bounds,
        {"content": 0.95},
        {"content": "probability"},
        content=POSITIVE,
    )
    yield call(
        "Distribution.interval",
        norm.interval,
        {"statistic": "mean"},
        {"statistic": "quantile|statistic"},
        statistic=POSITIVE,
    )
    yield call(
        "Distribution.half_width",
        norm.half_width,
        {"statistic": "mean"},
        {"statistic": "quantile|statistic"},
        statistic=POSITIVE,
    )
    yield call("Distribution.cdf", norm.cdf, {"value": 0.1}, {}, value=NUMBER)
    yield call(
        "Distribution.cumulative",
        norm.cumulative,
        {"values": [0.1]},
        {},
        values=f"{NUMBER}, empty list, empty tuple, array of three axes",
    )
    yield call("Distribution.probability_inside", norm.probability_inside, {"limit": 0.1}, {}, limit=NUMBER)
    yield call("Distribution.histogram", norm.histogram, {"bars": 3}, {}, bars=OPTIONAL)
    yield call("Summary.distribution", analysis.summary.distribution, {"quantity": "position.x"})
    yield call("progress", _shown, {"total": 3, "what": "sampling", "delay": 0.7, "unit": "samples"}, {},
               total="zero", what="word, digits, empty text", delay=NOT_NEGATIVE, unit="word, digits, empty text")  # fmt: skip


def _visiting(arm: pp.ErrorModel) -> pp.ErrorModel:
    """Return the arm with a joint that comes to another place at every visit."""
    again = pp.Draw("again", pp.Normal(1e-4), pp.Scope.VISIT)
    source = pp.sources.JointOffset(joint=arm.chain.joint_names[0], offset="again")
    return pp.ErrorModel(arm.chain, arm.space.including([again]), [*arm.sources, source])


def _sheet() -> Any:
    from precision_pin.sheet import read

    return read(PAPER_SHEET)


def _shown(total: int, what: str, delay: float, unit: str) -> None:
    with pp.progress(total, what, delay=delay, unit=unit) as advance:
        advance(1)
