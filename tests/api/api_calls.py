"""The public calls of the package with valid arguments, and what may be given in place of one by mistake."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import precision_pin as pp
from precision_pin import Chain, PrecisionPinError
from precision_pin.analyses.readings import simulate_readings, stations_of
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sheet import read
from precision_pin.statistics import Specification
from precision_pin.terms.term import JointValue

POSE = [0.1, 0.2, 0.3, 0.4]


def anything(*arguments, **options):
    """Take anything and give nothing."""


class Strange:
    """Knows nothing and can do nothing."""

    def __repr__(self):
        return "<Strange>"


MISTAKES = {
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

    def run(self, **changed):
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


def outcome(call, argument, mistake):
    """Make a mistake and see: what became of it, and the message."""
    try:
        made = call.run(**{argument: MISTAKES[mistake]})
    except PrecisionPinError as error:
        text = str(error)
        word = call.words.get(argument, argument)
        return "several lines" if "\n" in text else "refused" if named(word, text) else "not named", text
    except Exception as error:  # noqa: BLE001 - that is what is looked for
        return type(error).__name__, str(error)
    return "fine" if mistake in call.fine.get(argument, "").split(", ") else "accepted", repr(made)[:100]


def named(word, text):
    """Whether a message says of which argument it is."""
    text = text.lower()
    return any(
        one.lower() in text
        for choice in word.split("|")
        for one in (choice, choice.replace("_", " "), choice.replace("_", "-"))
    )


NUMBER = "zero, one half, minus one"
POSITIVE = "one half"
NOT_NEGATIVE = "zero, one half"
OPTIONAL = "nothing"
EMPTY = "empty list"
SEVERAL = "nothing, list of nothing"
TEXT = "word, digits, empty text"
WAY = Path(__file__).with_name("way.csv")
UR_FILE, UR_ARM = (Path(__file__).with_name(name) for name in ("ur3.calibration.conf", "ur3.urdf"))
JOINT_OR_POSE = "joint|pose"
WORDS = {
    "q": JOINT_OR_POSE, "pose": JOINT_OR_POSE, "poses": JOINT_OR_POSE, "other": JOINT_OR_POSE, "relative_to": JOINT_OR_POSE,
    "at": JOINT_OR_POSE, "candidates": JOINT_OR_POSE, "approach": "approach|joint", "approaches": "approach|joint",
    "reference": "joint", "until": "until|target", "files": "file", "error_model": "ErrorModel", "draws": "draw|parameter",
    "model": "model|ErrorModel",
    "specifications": "specification", "path": "path|file|3|nonsense", "tip": "link", "base": "link", "locked": "lock",
    "std": "standard deviation",
}  # fmt: skip
"""What a message calls an argument, where it is not by its name."""
FINE = {
    "seed": "zero", "confidence": POSITIVE, "specifications": EMPTY, "findings": EMPTY, "until": EMPTY, "threads": OPTIONAL,
    "progress": "nothing, true, function", "keep_samples": "true", "reference": OPTIONAL, "relative_to": OPTIONAL,
    "approach": "nothing, empty list, empty mapping", "locked": "nothing, empty mapping", "k": POSITIVE,
    "coupled": "empty mapping", "datum": f"{OPTIONAL}, {EMPTY}",
    "correlations": EMPTY, "kinds": EMPTY, "mean": NUMBER, "half_width": NOT_NEGATIVE, "radius": NOT_NEGATIVE,
}  # fmt: skip
"""The mistakes that are none, wherever an argument has this name."""
NOT_TRIED = {
    # handed on to what monte_carlo tries; of the package's own making
    "executor", "everywhere", "files", "journal", "processes", "resume", "tasks_under_way", "tell", "only",
    "bounds", "for_samples", "k", "limits", "names", "quantities", "value",
}  # fmt: skip
"""Arguments that are left at their defaults, where a call does not give them."""


def call(
    function,
    words=None,
    label="",
    /,
    *,
    fine=None,
    **given,
):
    """Return a call: an argument that is not given has its default, and is tried with mistakes as well."""
    parameters = inspect.signature(function).parameters.values()
    defaults = {
        one.name: one.default for one in parameters if one.default is not one.empty and one.name not in NOT_TRIED
    }
    arguments = defaults | given
    known = {name: FINE[name] for name in arguments if name in FINE}
    return Call(label or function.__qualname__, function, arguments, known | (fine or {}), WORDS | (words or {}))


def _calibration_calls():
    arm = small_model()
    tracker = pp.Measurement(target=(0.05, 0.03, 0.02))
    poses = np.random.default_rng(0).uniform(-2, 2, (4, 5))
    tips = simulate_readings(stations_of(arm, poses, tracker), tracker, arm, seed=5)[:, :, 0]
    words = {
        "model": "ErrorModel|calibrate",
        "count": "number",
        "data": "data|readings|path|file|nonsense|3|does not exist",
    }
    words |= {"robots": "robots|data|readings|path|nonsense", "file": "path|file|3|nonsense|factory calibration"}
    fine, at = {"at": OPTIONAL}, np.array(POSE)[:, None]
    yield call(pp.forecast_calibration, words, model=arm, poses=poses, measurement=tracker, at=at, fine=fine)
    yield call(pp.plan_calibration, words, model=arm, candidates=poses, count=2, measurement=tracker, at=at, fine=fine)
    prior = {"prior": "true"}
    yield call(
        pp.calibrate, words, model=arm, data=(poses[:, :2], tips[:2]), measurement=tracker, at=at, fine=fine | prior
    )
    yield call(pp.identifiability, words, model=arm, poses=poses, measurement=tracker)
    yield call(pp.population, words, model=arm, robots=[(poses, tips)] * 2, measurement=tracker)
    yield call(pp.ur_calibration, words, file=UR_FILE, robot=Chain.from_urdf(UR_ARM))
    yield call(pp.every_frame, chain=arm.chain)
    yield call(
        pp.Measurement, {"base": "base", "std": "std|standard deviation"},
        kind="pose", std=1e-5, target=(0.1, 0.0, 0.0), base="free", attitude_std=1e-4, anchor=(0.0, 0.0, 0.0),
        visible_from=(1.0, 0.0, 0.0), facing=(0.0, 0.0, 1.0), cone=1.0,
        fine={
            "std": POSITIVE, "target_known": "true", "attitude_std": "nothing, one half", "cone": POSITIVE, "facing": OPTIONAL,
            "plane": OPTIONAL, "sockets": EMPTY, "load": f"nothing, {EMPTY}", "columns": "empty text", "std_known": "true",
            "target_name": TEXT, "base_name": TEXT, "stands_at": OPTIONAL, "sight": OPTIONAL,
            "drift": OPTIONAL,
        },
    )  # fmt: skip


@cache
def model():
    """Return the paper's arm."""
    return pp.ErrorModel.load(PAPER_SHEET)


@cache
def small_model():
    """Return the paper's arm with errors of two joints only, for calls that take long with all errors."""
    arm = model()
    space = pp.Space((pp.Draw("a", pp.Normal(1e-3)), pp.Draw("b", pp.Uniform(1e-3))))
    offsets = [
        pp.sources.JointOffset(joint=joint, offset=name)
        for joint, name in zip(arm.chain.joint_names, ("a", "b"), strict=False)
    ]
    return pp.ErrorModel(arm.chain, space, offsets, dict(arm.poses))


@cache
def calls():
    """Return every public call."""
    return (
        *_sampling_calls(),
        *_datum_calls(),
        *_page_calls(),
        *_pose_calls(),
        *_analysis_calls(),
        *_calibration_calls(),
        *_model_calls(),
        *_law_calls(),
        *_mcpc_calls(),
        *_result_calls(),
    )


TWO_POSES = np.tile(np.array(POSE)[:, None], 2)


def _sampling_calls():
    arm, small = model(), small_model()
    saving = {"resume": False, "files": {}, "tell": None}
    fine = {"files": "nothing, empty mapping", "tell": "nothing, function"}
    yield call(
        pp.monte_carlo, error_model=arm, q=POSE, samples=64, specifications=[Specification("position.x", 1e-3, 0.9)],
        processes=None, executor=None, tasks_under_way=None, journal=None, **saving,
        fine={
            "q": OPTIONAL, "processes": OPTIONAL, "executor": OPTIONAL, "tasks_under_way": OPTIONAL,
            "journal": "nothing, word, digits", **fine,
        },
    )  # fmt: skip
    yield call(pp.relative, error_model=small, pose=POSE, other=[0.0, 0.1, 0.2, 0.3], samples=64,
               fine={"pose": OPTIONAL, "other": OPTIONAL})  # fmt: skip
    yield call(pp.sample_poses, error_model=small, poses=TWO_POSES, samples=64, everywhere=False, **saving,
               fine={"everywhere": "true", **fine})  # fmt: skip
    yield call(lambda pose, approach: small.at(pp.ApproachedPose(pose, approach)), {}, "ApproachedPose",
               pose=POSE, approach={"joint1": "+"},
               fine={"pose": OPTIONAL, "approach": f"{EMPTY}, empty mapping"})  # fmt: skip
    yield call(pp.sample_approaches, error_model=small, pose=POSE, approaches=["joint1 +", "joint1 -"], robots=3, cycles=2,
               target=(0.0, 0.0, 0.1), fine={"pose": OPTIONAL, "number": "zero", "first": "zero"})  # fmt: skip
    yield call(pp.map_poses, model=small, poses=TWO_POSES, samples=64, verify=1,
               fine={"samples": OPTIONAL, "verify": "zero"})  # fmt: skip
    yield call(pp.path_law, error_model=small, poses=TWO_POSES, samples=100, fine={"probability": POSITIVE})
    yield call(pp.compare, models=[small, small], poses=POSE, samples=64, fine={"poses": SEVERAL})


def _datum_calls():
    small, poses = small_model(), [[0.1, 0.2, 0.3, 0.4], [0.5, -0.2, 0.4, 0.1], [-0.5, 0.3, 0.8, -0.4]]
    touches = {"touch": f"{NOT_NEGATIVE}, empty mapping"}
    words = {"std": "noise", "touch": "noise|touch", "x": JOINT_OR_POSE}
    yield call(lambda poses, std, point: small.against(pp.Datum.best_fit(poses, std, point=point)), words, "Datum.best_fit",
               poses=poses, std=1e-5, point=np.full(3, 0.05), fine={"std": NOT_NEGATIVE, "point": OPTIONAL})  # fmt: skip
    yield call(lambda pose, touch: small.against(pp.Datum.taught(pose, touch)), words, "Datum.taught", pose=POSE, touch=1e-5,
               fine=touches | {"pose": OPTIONAL})  # fmt: skip
    yield call(lambda x, touch: small.against(pp.Datum.three_points(poses[0], x, poses[2], touch)), words, "Datum.three_points",
               x=poses[1], touch=1e-5, fine=touches | {"x": OPTIONAL})  # fmt: skip


def _page_calls():
    small, read_model = small_model(), pp.ErrorModel.load(PAPER_SHEET)
    several = {"poses": SEVERAL}
    yield call(pp.view, error_model=small, poses=POSE, samples=20, fine=several)
    yield call(
        pp.report, error_model=read_model, poses=POSE, samples=64, is_full=False, fine=several | {"is_full": "true"}
    )
    yield call(pp.simulate, {"poses": "pose|joint"}, model=small, poses=TWO_POSES, measurement=pp.Measurement(std=1e-5), unit=3,
               cycles=2, fine={"unit": "zero"})  # fmt: skip
    yield call(lambda model, pose, **numbers: pp.export(model, "built", pose, **numbers), {}, "export",
               model=read_model, pose=POSE, units=1, first=0, seed=0,
               fine={"pose": OPTIONAL, "first": "zero", "seed": "zero"})  # fmt: skip
    yield call(pp.init, {"robot": "robot|file"}, robot=read_model.chain.robot.file, tip="tool", base=None, calibration=False,
               fine={"tip": OPTIONAL, "base": OPTIONAL, "calibration": "true"})  # fmt: skip


def _pose_calls():
    chain = model().chain
    yield call(pp.inverse_kinematics, {"wanted": "wanted pose"},
               chain=chain, wanted=chain.at(POSE).pose, task="axis", reference=POSE)  # fmt: skip
    yield call(
        pp.joint_grid, {"values": "values|joint"}, chain=chain, values={name: [0.0, 0.5] for name in chain.joint_names}
    )
    yield call(
        pp.box_places, dict.fromkeys("xyz", "values"), x=[0.3, 0.4], y=[0.0], z=0.2, fine=dict.fromkeys("xyz", NUMBER)
    )
    yield call(pp.plane_places,
               {"u": "direction u", "v": "direction v", "along_u": "values of u", "along_v": "values of v"},
               origin=[0.3, 0.0, 0.2], u=[1.0, 0.0, 0.0], v=[0.0, 0.0, 1.0], along_u=[0.0, 0.1], along_v=[0.0],
               fine={"along_u": NUMBER, "along_v": NUMBER})  # fmt: skip
    yield call(pp.place_grid, chain=chain, places=np.array([[0.3], [0.0], [0.2]]), orientations=pp.Orientation.free(),
               branches="all", reference=POSE)  # fmt: skip
    yield call(pp.random_poses, {"count": "number of poses"}, chain=chain, count=3, box=[[0, 1]] * 3,
               fine={"box": OPTIONAL, "orientations": OPTIONAL})  # fmt: skip
    yield call(lambda path, chain, most: pp.read_trajectory(path, chain, most), {}, "read_trajectory",
               path=WAY, chain=chain, most=10)  # fmt: skip
    yield call(pp.read_trajectory(WAY, chain).refined, time_step=0.5, angle_step=0.1, most=100,
               fine={"time_step": "nothing, one half", "angle_step": "nothing, one half", "length_step": OPTIONAL})  # fmt: skip
    yield call(
        pp.Orientation.given, {"rotation": "orientation"}, rotation=np.eye(3), label="upright", fine={"label": TEXT}
    )
    yield call(pp.Orientation.along, direction=(0.0, 0.0, -1.0), angles=4, fine={"angles": OPTIONAL})


def _analysis_calls():
    arm, small = model(), small_model()
    problem = {
        "tolerances": [{"path": "axis_install[joint1].radius", "cost": {"reciprocal": 1.0}}], "specs": [{"rms": "1 m"}]
    }  # fmt: skip
    yield call(pp.allocate, {"problem": "problem|allocate", "pareto": "points of the front"},
               model=arm, problem=problem, seconds=9.0, pareto=2, fine={"seconds": POSITIVE, "pareto": "zero"})  # fmt: skip
    yield call(pp.compensate, model=small, poses=np.array(POSE)[:, None], mode="pose", weights=np.ones(6))
    yield call(pp.pose_covariance, model=small, poses=TWO_POSES)
    several = {"poses": SEVERAL}
    yield call(pp.reliability, model=small, specifications="200 mm @ 99 %", poses=POSE, samples=64,
               fine=several | {"specifications": ""})  # fmt: skip
    yield call(pp.stiffness, {"robots": "robots"}, model=arm, poses=POSE, rated="100 N", axes=[1.0, 0.0, 0.0], goal="1 m/N",
               robots=5, fine=several | {"rated": f"{OPTIONAL}, {POSITIVE}", "goal": f"{OPTIONAL}, {POSITIVE}"})  # fmt: skip
    yield call(pp.worst_case, model=small, poses=POSE, samples=64, k=3.0, fine=several)
    yield call(pp.moments, model=small, poses=POSE, samples=1024, method="plain", fine=several)
    yield call(pp.budget, model=small, poses=POSE, samples=1024, k=3.0, fine=several)
    yield call(pp.exact_law, model=small, poses=POSE, samples=100, fine=several)
    yield call(pp.iso9283, {"robots": "robot", "cycles": "cycle"}, model=_visiting(small), poses=[POSE] * 2, cycles=2,
               robots=5, target=[0.0, 0.0, 0.1], load=1.0, specifications=["RP 1 mm"],
               fine={"target": OPTIONAL, "load": NOT_NEGATIVE})  # fmt: skip
    yield call(pp.iso9283_of, commanded=np.zeros(6), attained=np.zeros((2, 6)))
    yield call(pp.iso9283_distance, {"commanded_pair": "commanded", "attained_pair": "attained"},
               commanded_pair=np.zeros((2, 6)), attained_pair=np.zeros((2, 2, 6)))  # fmt: skip
    yield call(pp.specification, {"text": "specification"}, text="0.5 mm @ 95 %")
    yield call(Specification, {"required": "probability"}, quantity="position.x", limit=1e-3, required=0.9,
               fine={"limit": POSITIVE, "required": POSITIVE})  # fmt: skip


def _model_calls():
    arm = model()
    chain, space = arm.chain, arm.space
    at = arm.at()
    yield call(chain.at, {"q": "joint"}, q=POSE)
    yield call(chain.configuration, {"q": "joint"}, q=POSE)
    yield call(chain.at_many, q=np.zeros((4, 3)))
    yield call(chain.joint_index, {"name": "joint"}, name="joint1")
    for find in (chain.link_frame, chain.frame_place):
        yield call(find, {"name": "link"}, name=chain.tip)
    for find in (chain.end, chain.seat, chain.runs_backwards):
        yield call(find, link=4, fine={"link": "zero"})
    for find in (chain.axis_alignment, chain.at(POSE).direction_of, chain.at(POSE).torque_on):
        yield call(find, joint=3, fine={"joint": "zero"})
    yield call(chain.with_payload, {"at": "link"}, mass=1.0, centre=[0.0, 0.0, 0.1], at=chain.tip,
               fine={"mass": NOT_NEGATIVE, "at": OPTIONAL})  # fmt: skip
    yield call(chain.with_target, {"point": "target"}, point=[0.0, 0.0, 0.1])
    ends, optional = {"tip": chain.tip, "base": chain.base}, {"tip": OPTIONAL, "base": OPTIONAL}
    yield call(pp.Chain.from_urdf, path=chain.robot.file, **ends, fine=optional)
    yield call(pp.Chain.from_robot, robot=chain.robot, **ends, fine=optional)
    yield call(pp.ErrorModel, {"sources": "source"}, chain=chain, space=space, sources=arm.sources, poses={"home": POSE},
               fine={"sources": EMPTY, "poses": "nothing, empty mapping"})  # fmt: skip
    yield call(pp.ErrorModel.load, {"kinds": "kind"}, path=PAPER_SHEET)
    yield call(pp.ErrorModel.from_sheet, sheet=read(PAPER_SHEET))
    yield call(arm.at, q=POSE, fine={"q": OPTIONAL})
    yield call(arm.configuration, q=POSE, fine={"q": OPTIONAL})
    yield call(arm.at_many, q=np.zeros((4, 2)))
    for displace in (at.linear, at.exact):
        yield call(displace, x=space.sample(0, 0, 3))
    draws = (pp.Draw("a", pp.Uniform(1.0)), pp.Draw("b", pp.Uniform(1.0)))
    yield call(
        pp.Space, {"correlations": "correlation"}, draws=draws, correlations=(pp.Correlation.pair("a", "b", 0.5),)
    )
    numbers = ("first", "count", "pose", "visit")
    yield call(space.sample, {"pose": "pose"}, seed=0, first=0, count=2, pose=0, fine=dict.fromkeys(numbers, "zero"))
    yield call(space.inverse, uniforms=np.full((space.size, 2), 0.5))
    yield call(space.parameter, {"name": "parameter"}, name=space.components[0])
    yield call(space.including, {"draws": "draw"}, draws=[pp.Draw("new", pp.Uniform(1.0))], fine={"draws": EMPTY})
    yield call(pp.Term, {"factors": "factor"}, target=JointValue(0), twist=np.ones(1),
               fine={"factors": EMPTY, "loaded": "true"})  # fmt: skip
    yield call(pp.Term.of, {"values": "factor"}, target=JointValue(0), twist=[1.0], values=[space.parameter("a1")],
               fine={"twist": NUMBER, "values": f"{NUMBER}, {EMPTY}", "loaded": "true"})  # fmt: skip


def _law_calls():
    names = "list of words, array of text"
    yield call(pp.Draw, name="a", law=pp.Uniform(1.0), names=(), fine={"name": TEXT, "names": EMPTY})
    correlated = {"names": "correlation", "matrix": "correlation"}
    yield call(pp.Correlation, correlated, names=("a", "b"), matrix=((1.0, 0.5), (0.5, 1.0)), fine={"names": names})
    yield call(pp.Correlation.pair, {"first": "correlation", "second": "correlation"}, first="a", second="b", correlation=0.5,
               fine={"correlation": "one half, zero", "first": TEXT, "second": TEXT})  # fmt: skip
    yield call(pp.Fixed, {"mean": "fixed"}, mean=1.0)
    for law in (pp.Uniform, pp.Triangular, pp.Arcsine):
        yield call(law, half_width=1.0)
    yield call(pp.Normal.from_half_width, half_width=1.0, k=3.0)
    yield call(pp.Normal, std=1.0, k=None, fine={"std": NOT_NEGATIVE, "k": f"nothing, {POSITIVE}"})
    yield call(pp.TruncatedNormal, std=1.0, k=3.0, fine={"std": NOT_NEGATIVE})
    yield call(pp.Lognormal, std=0.5, mean=1.0, fine={"std": NOT_NEGATIVE, "mean": POSITIVE})
    yield call(pp.TwoPoint, half_width=1.0, probability=0.5, fine={"centre": NUMBER, "probability": POSITIVE})
    for law in (pp.Circle, pp.Disc, pp.Sphere):
        yield call(law, radius=1.0)
    yield call(pp.JointNormal, {"matrix": "covariance", "centre": "mean"}, matrix=((1.0, 0.0), (0.0, 1.0)), centre=(0.0, 0.0),
               fine={"centre": EMPTY})  # fmt: skip
    yield call(pp.Empirical, {"quantiles": "empirical"}, quantiles=((0.0, 0.0), (1.0, 1.0)))
    yield call(pp.Empirical.from_samples, {"samples": "sample"}, samples=[0.0, 1.0, 3.0], fine={"samples": "set"})
    yield call(pp.Rows, {"table": "rows"}, table=((0.0, 1.0), (1.0, 2.0)), names=("a", "b"),
               fine={"names": f"{EMPTY}, {names}"})  # fmt: skip


def _mcpc_calls():
    arm = pp.mcpc.from_chain(model().chain)
    errors = np.zeros(26)
    yield call(pp.mcpc.from_chain, {}, "mcpc.from_chain", chain=model().chain)
    yield call(pp.mcpc.parameter_errors, {}, "mcpc.parameter_errors", mcpc=arm, displacements=np.zeros((5, 6)))
    yield call(pp.mcpc.frame_displacements, {}, "mcpc.frame_displacements", mcpc=arm, parameter_errors=errors)
    yield call(pp.mcpc.joint_placements, {}, "mcpc.joint_placements", mcpc=arm)
    for of_joints in (arm.forward_kinematics, arm.jacobian, arm.jacobian_base, arm.propagation):
        yield call(of_joints, {"q": "joint values"}, q=POSE)
    for of_link in (arm.link_pose, arm.joint_pose, arm.link_matrix):
        yield call(of_link, link=4, fine={"link": "zero"})
    yield call(arm.joint_pose, link=4, value=0.1, fine={"link": "zero", "value": NUMBER})
    yield call(arm.perturbed, parameter_errors=errors)


def _result_calls():
    arm = model()
    poses = pp.sample_poses(arm, [next(iter(arm.poses)), POSE], samples=64)
    yield call(poses.between, {"one": "pose", "other": "pose"}, one=0, other=1, fine={"one": "zero", "other": "zero"})
    yield call(poses.pose, {"name": "pose"}, name="paper")
    analysis = pp.monte_carlo(arm, POSE, samples=1000)
    norm = analysis.position.norm
    for method in (norm.quantile, norm.quantile_interval, norm.quantile_error):
        yield call(method, {"p": "probability"}, p=0.5, fine={"p": POSITIVE})
    yield call(norm.tolerance_bounds, {"content": "probability"}, content=0.95, fine={"content": POSITIVE})
    for method in (norm.interval, norm.half_width):
        yield call(method, {"statistic": "quantile|statistic"}, statistic="mean", fine={"statistic": POSITIVE})
    yield call(norm.cdf, value=0.1, fine={"value": NUMBER})
    yield call(norm.cumulative, values=[0.1], fine={"values": f"{NUMBER}, {EMPTY}, array of three axes"})
    yield call(norm.probability_inside, limit=0.1, fine={"limit": NUMBER})
    yield call(norm.histogram, bars=3, fine={"bars": OPTIONAL})
    yield call(analysis.summary.distribution, quantity="position.x")
    yield call(_shown, {}, "progress", total=3, what="sampling", delay=0.7, unit="samples",
               fine={"total": "zero", "what": TEXT, "delay": NOT_NEGATIVE, "unit": TEXT})  # fmt: skip


def _visiting(arm):
    """Return the arm with a joint that comes to another place at every visit."""
    again = pp.Draw("again", pp.Normal(1e-4), pp.Scope.VISIT)
    source = pp.sources.JointOffset(joint=arm.chain.joint_names[0], offset="again")
    return pp.ErrorModel(arm.chain, arm.space.including([again]), [*arm.sources, source])


def _shown(total, what, delay, unit):
    with pp.progress(total, what, delay=delay, unit=unit) as advance:
        advance(1)
