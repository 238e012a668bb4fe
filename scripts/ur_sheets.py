"""How far off are UR robots, by the factory calibrations of others? Sheets and URDFs of three types, and robots left out.

Usage: python ur_sheets.py FOLDER [OUT]

FOLDER has files as the ROS driver's ur_calibration writes them, TYPE-ANYTHING.yaml with TYPE such as ur5e, one for each robot.
They are in public repositories, such as Jaron-G/ur10e_gripper, thinclab/ur3e_irl_project, pablotrelis/haptic_ur5e and others
named in src/precision_pin/robots/ur3e.errors.yaml. OUT (this folder if left out) gets the URDFs, the sheets and the picture.
"""

import itertools
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy import stats

import precision_pin as pp
from precision_pin.analyses.calibration.population import FactoryCalibration
from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.base.files import write_text
from precision_pin.robot.ur_kinematics import MODELS, nominal_ur
from precision_pin.sources import Frame

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
END = "forearm_end"
PLACES = (
    ("shoulder_lift_joint", "x y rx ry"),
    ("elbow_joint", "x y rx ry"),
    (END, "x y rx ry"),
    ("wrist_2_joint", "x y rx ry"),
    ("wrist_3_joint", "x y rx ry"),
    ("tool0", "z"),
)
"""Errors that move the axes and the flange: all that a factory calibration has, each once."""
NUMBERS = tuple((place, name) for place, names in PLACES for name in names.split())
ZEROS = {
    ("shoulder_lift_joint", "ry"),
    ("elbow_joint", "y"),
    (END, "y"),
    ("wrist_2_joint", "ry"),
    ("wrist_3_joint", "ry"),
}
"""Those that act as zeros of joints, which the factory sets: up to 0.01 mrad and 0.006 mm of e-Series."""
KEPT = np.array([number not in ZEROS for number in NUMBERS])
POSES = {
    "ready": (0, -90, 90, -90, -90, 0),
    "stretched": (0, -10, 20, -100, -90, 0),
    "folded": (0, -120, 140, -110, -90, 0),
}
RANDOM = 100
"""Random poses over which a robot's error is taken; joint values uniform within ± 180 degrees."""
ROBOTS, SAMPLES, DRAWS = 2000, 100_000, 3000
"""Robots of a forecast beside one left out, of the forecast in the head of a sheet; draws of the posterior."""
SHIPPED = ("UR3e", "UR5e", "UR10e")


@dataclass(frozen=True)
class Unit:
    """A robot of a type: its errors (21,), m and rad, and its tip's distance from nominal at the random poses (P,), m."""

    kind: str
    errors: Array
    distances: Array


@dataclass(frozen=True)
class Law:
    """Normal law of each kept error of a type, (16,) each: mean and standard deviation, m and rad."""

    mean: Array
    std: Array


# robots --------------------------------------------------------------------------------------------------------------

# kg, and mm in the Denavit-Hartenberg frame behind each joint, as the maker publishes them
MASSES: Mapping[str, Sequence[tuple[float, ...]]] = {
    "UR3e": ((1.98, 0, -20, 0), (3.4445, 130, 0, 115.7), (1.437, 50, 0, 23.8), (0.871, 0, 0, 10), (0.805, 0, 0, 10),
             (0.261, 0, 0, -20)),
    "UR5e": ((3.761, 0, -25.61, 1.93), (8.058, 212.5, 0, 113.36), (2.846, 150, 0, 26.5), (1.37, 0, -1.8, 16.34),
             (1.3, 0, 1.8, 16.34), (0.365, 0, 0, -1.159)),
    "UR10e": ((7.369, 21, 0, 27), (13.051, 380, 0, 158), (3.989, 240, 0, 68), (2.1, 0, 7, 18), (1.98, 0, 7, 18),
              (0.615, 0, 0, -26)),
}  # fmt: skip
ALPHA = np.radians([90, 0, 0, 90, -90, 0])


def urdf(kind: str) -> str:
    """Return the nominal robot as a URDF: joints as in the ROS driver's description, axes z, and a frame at the forearm's end."""
    joints = nominal_ur(kind).joints
    steps = [joints[0], *(se3.inverse(one) @ other for one, other in itertools.pairwise(joints))]
    thick = 0.02 + 0.05 * abs(MODELS[kind][1])
    lines = [
        f"<!-- {kind}: the Denavit-Hartenberg parameters, masses and centres of mass that Universal Robots publishes, written by",
        "     scripts/ur_sheets.py. Shapes are for drawing only, and no inertias are published. -->",
        f'<robot name="{kind.lower()}">',
        '  <link name="base"/>',
    ]
    for k, step in enumerate(steps):
        parent, name, reach = "base" if k == 0 else f"{LINKS[k - 1]}_link", f"{LINKS[k]}_link", 0.0
        if k == 3:
            lines += [
                f'  <link name="{END}"/>',
                _joint(f"{END}_joint", "fixed", parent, END, se3.translation([step[0, 3], 0, 0])),
            ]
            parent, step = END, se3.translation([0, 0, step[2, 3]])
        lines.append(f'  <link name="{name}">')
        if k in (1, 2):
            reach = MODELS[kind][k]
            beside = 0.0 if k == 2 else MODELS[kind][3]
            lines.append(_cylinder(f"{reach / 2:.5g} 0 {beside:.5g}", "0 1.5707963267948966 0", thick, abs(reach)))
        # along the axis: a column, two housings as long as the arm is wide, three wrists
        end, radius = ((-MODELS[kind][0], 1.2), (MODELS[kind][3], 1.1), (MODELS[kind][3], 1.1), *3 * [(0, 0.9)])[k]
        lines.append(_cylinder(f"0 0 {end / 2:.5g}", "0 0 0", radius * thick, abs(end) + 2 * thick))
        if kind in MASSES:
            mass, *centre = MASSES[kind][k]
            place = np.array([reach, 0, 0]) + se3.exp_rotation(np.array([ALPHA[k], 0, 0])) @ np.array(centre) / 1e3
            lines.append(
                f'    <inertial><origin xyz="{_text(place)}"/><mass value="{mass}"/>'
                '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>'
            )
        lines += ["  </link>", _joint(f"{JOINTS[k]}_joint", "revolute", parent, name, step)]
    lines += ['  <link name="tool0"/>', _joint("flange", "fixed", "wrist_3_link", "tool0", np.eye(4)), "</robot>"]
    return "\n".join(lines) + "\n"


def _cylinder(place: str, turn: str, radius: float, length: float) -> str:
    shape = f'<cylinder radius="{radius:.3g}" length="{length:.5g}"/>'
    return f'    <visual><origin xyz="{place}" rpy="{turn}"/><geometry>{shape}</geometry></visual>'


def _joint(name: str, kind: str, parent: str, child: str, placement: Array) -> str:
    turn = f' rpy="{np.arctan2(placement[2, 1], placement[2, 2]):.17g} 0 0"' if kind == "revolute" else ""
    moves = '<axis xyz="0 0 1"/><limit lower="-6.2832" upper="6.2832" effort="1" velocity="3.14"/>' if turn else ""
    return (
        f'  <joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{_text(placement[:3, 3])}"{turn}/>{moves}</joint>'
    )


def _text(numbers: Array) -> str:
    return " ".join(f"{float(number):.10g}" for number in np.where(np.abs(numbers) < 1e-12, 0, numbers))


# their errors --------------------------------------------------------------------------------------------------------


def frame_model(chain: pp.Chain, law: Law | None = None) -> pp.ErrorModel:
    """Return the model of the errors at their places: the kept ones with a law, or all with a spread of 1 mm and 1 mrad."""
    given = iter(zip(law.mean, law.std, strict=True)) if law is not None else None
    sources = []
    for place, names in PLACES:
        settings = {}
        for name in names.split():
            if given is None:
                settings[name] = pp.Normal(1e-3)
            elif (place, name) not in ZEROS:
                mean, std = next(given)
                settings[name] = pp.Normal(float(std), mean=float(mean))
        kind = "joint" if place.endswith("joint") else "frame"
        sources.append(Frame(**{kind: place, **settings}))
    return pp.ErrorModel(chain, pp.Space(), sources)


def kinds_of(folder: Path) -> dict[Path, str]:
    """Return the files of a folder, and the type that each name begins with; end where there are none, or of another type."""
    known = {kind.lower().replace(" ", ""): kind for kind in MODELS if kind in FOUND_IN}
    found = {path: path.name.partition("-")[0] for path in sorted(folder.glob("*.yaml"))}
    for path, kind in found.items():
        if kind not in known:
            sys.exit(f"{path}: the name must begin with a type and a hyphen, one of {', '.join(known)}")
    if not found:
        sys.exit(
            f"{folder} has no calibration of a robot: files TYPE-ANYTHING.yaml with TYPE one of {', '.join(known)}"
        )
    return {path: known[kind] for path, kind in found.items()}


def read_units(folder: Path, chains: Mapping[str, pp.Chain]) -> list[Unit]:
    """Return the robots of a folder, each once."""
    units: list[Unit] = []
    for path, kind in kinds_of(folder).items():
        unit = fitted(kind, frame_model(chains[kind]), pp.ur_calibration(path, chains[kind]))
        if any(one.kind == kind and np.abs(one.errors - unit.errors).max() < 1e-6 for one in units):
            print(f"{path.name}: the same robot as another file, left out")
        else:
            units.append(unit)
    return units


def fitted(kind: str, model: pp.ErrorModel, found: FactoryCalibration) -> Unit:
    """Return the errors that make the nominal robot the calibrated one, by Gauss-Newton at random poses."""
    q = random_poses()
    at = [model.at(column) for column in q[:12]]
    wanted = np.concatenate(
        [_moved(one.posture.pose, found.predict(column)) for one, column in zip(at, q, strict=False)]
    )
    errors = np.zeros(len(NUMBERS))
    slopes = np.concatenate([one.jacobian for one in at])
    for _ in range(4):
        left = wanted - np.concatenate([one.exact(errors[:, None])[:, 0] for one in at])
        errors += np.linalg.lstsq(slopes, left, rcond=None)[0]
    if np.abs(left).max() > 2e-4:
        raise SystemExit(f"{found.file}: its axes are not those of a {kind} with small errors")
    moved = [_moved(model.at(column).posture.pose, found.predict(column)) for column in q]
    return Unit(kind, errors, np.linalg.norm(np.array(moved)[:, :3], axis=1))


def _moved(nominal: Array, built: Array) -> Array:
    turn = se3.log_rotation(built[:3, :3] @ nominal[:3, :3].T)
    return np.concatenate([built[:3, 3] - nominal[:3, 3], turn])


def random_poses() -> Array:
    return np.random.default_rng(0).uniform(-np.pi, np.pi, (RANDOM, 6))


def laws(values: Array, kinds: Sequence[str]) -> tuple[dict[str, Law], Array]:
    """Return the law of each type for a robot yet to come, and an interval of each error's spread over all types.

    An error of a robot is m + s σ z: m the mean of its type, σ of this error over all types, s of this type over all errors,
    z normal. The means of the types are normal with a mean and a spread of their own. Values ``(robots, errors)`` of robots
    give the posterior of all of them by Gibbs sampling, with priors flat for means, their spread and log σ, and s² an inverse
    χ² of four degrees of freedom. A law has the middle of m, and of σ s the middle with the spread of m added.

    The interval ``(errors, 2)`` is of σ times the middle of s over the robots, 95 %.
    """
    rng = np.random.default_rng(0)
    names = list(dict.fromkeys(kinds))
    of = np.array([names.index(kind) for kind in kinds])
    belongs = np.eye(len(names))[of]
    count, types = belongs.sum(axis=0), len(names)
    robots, errors = values.shape
    scale = np.sqrt((values**2).mean(axis=0))
    x = values / scale
    centre, between, spread, size = np.zeros(errors), np.ones(errors), np.ones(errors), np.ones(types)
    found_mean, found_std, found_spread = [], [], []
    for draw in range(DRAWS + 300):
        of_mean = size[:, None] * spread
        weight = count[:, None] / of_mean + 1 / between
        mean = (belongs.T @ x / of_mean + centre / between) / weight + rng.standard_normal((types, errors)) / np.sqrt(
            weight
        )
        centre = mean.mean(axis=0) + rng.standard_normal(errors) * np.sqrt(between / types)
        between = ((mean - centre) ** 2).sum(axis=0) / rng.chisquare(types - 1, errors)
        squares = (x - mean[of]) ** 2
        spread = (squares / size[of, None]).sum(axis=0) / rng.chisquare(robots, errors)
        size = (4 + belongs.T @ (squares / spread).sum(axis=1)) / rng.chisquare(4 + count * errors)
        if draw >= 300:
            found_mean.append(mean * scale)
            found_std.append(np.sqrt(size[:, None] * spread) * scale)
            found_spread.append(np.sqrt(spread * np.exp(np.log(size[of]).mean())) * scale)
    low, middle, high = np.quantile(found_mean, [0.16, 0.5, 0.84], axis=0)
    std = np.hypot(np.median(found_std, axis=0), (high - low) / 2)
    interval: Array = np.quantile(found_spread, [0.025, 0.975], axis=0).T
    return {name: Law(middle[k], std[k]) for k, name in enumerate(names)}, interval


# forecast and robots left out ----------------------------------------------------------------------------------------


def forecast(chain: pp.Chain, law: Law) -> Array:
    """Return distances of the tip from nominal of sampled robots at the random poses, ``(poses, robots)``, m."""
    model = frame_model(chain, law)
    x = model.space.sample(0, 0, ROBOTS)
    return np.array([np.linalg.norm(model.at(q).exact(x)[:3], axis=0) for q in random_poses()])


@dataclass(frozen=True)
class LeftOut:
    """A robot beside the forecast made from the others: its curve and the forecast's, m, and whether its rms is in the band."""

    unit: Unit
    low: Array
    middle: Array
    high: Array
    share_of_robots: float
    share_of_poses: float

    @property
    def inside(self) -> bool:
        """Whether the unit's rms over the poses lies within 90 % of the forecast robots'."""
        return 0.05 <= self.share_of_robots <= 0.95


def leave_out(units: Sequence[Unit], chains: Mapping[str, pp.Chain]) -> list[LeftOut]:
    """Return each robot beside a forecast that it has no part in."""
    result = []
    for one in units:
        others = [unit for unit in units if unit is not one]
        kinds = [unit.kind for unit in others]
        if one.kind not in kinds:  # the only one of its type
            continue
        law = laws(np.array([unit.errors[KEPT] for unit in others]), kinds)[0][one.kind]
        robots = forecast(chains[one.kind], law)
        rms = np.sqrt((robots**2).mean(axis=0))
        of_poses = (robots < one.distances[:, None]).mean(axis=1)
        low, middle, high = np.quantile(np.sort(robots, axis=0), [0.05, 0.5, 0.95], axis=1)
        share = float((rms < np.sqrt((one.distances**2).mean())).mean())
        result.append(LeftOut(one, low, middle, high, share, float(((of_poses > 0.05) & (of_poses < 0.95)).mean())))
    return result


def share_inside(found: Sequence[LeftOut]) -> str:
    """Return how many lie inside, with the Clopper-Pearson interval of 95 %; the robots are the independent units."""
    count, total = sum(one.inside for one in found), len(found)
    low = stats.beta.ppf(0.025, count, total - count + 1) if count else 0.0
    high = stats.beta.ppf(0.975, count + 1, total - count) if count < total else 1.0
    poses = np.mean([one.share_of_poses for one in found])
    return f"{count} of {total} ({100 * low:.0f} to {100 * high:.0f} %), {100 * poses:.0f} % of the poses"


def _side(one: LeftOut) -> str:
    return "" if one.inside else ", better" if one.share_of_robots < 0.05 else ", worse"


def draw(found: Sequence[LeftOut], path: Path) -> None:
    """Draw each robot left out: the distances of its tip over the poses in order, and the forecast's 90 % band."""
    shown = [one for kind in SHIPPED for one in found if one.unit.kind == kind]
    figure, axes = plt.subplots(
        2, max((len(shown) + 1) // 2, 1), figsize=(9, 4.2), sharex=True, sharey=True, squeeze=False
    )
    share = 100 * (np.arange(RANDOM) + 0.5) / RANDOM
    for place, one in zip(axes.flat, shown, strict=False):
        place.fill_between(share, 1e3 * one.low, 1e3 * one.high, color="#4878b0", alpha=0.3, lw=0)
        place.plot(share, 1e3 * one.middle, color="#2a5a94", lw=1)
        place.plot(share, 1e3 * np.sort(one.unit.distances), color="#c03028", lw=1.5)
        place.set_title(f"{one.unit.kind}{_side(one)}", fontsize=9)
    for place in axes.flat[len(shown) :]:
        place.set_axis_off()
    figure.supxlabel("% of random poses with less", fontsize=9)
    figure.supylabel("position error, mm", fontsize=9)
    figure.tight_layout()
    figure.savefig(path, dpi=90)
    plt.close(figure)


# sheets --------------------------------------------------------------------------------------------------------------

FOUND_IN = {
    "UR3e": "cambel/ur3-tools, thinclab/ur3e_irl_project, RIVeR-Lab/gentle_pick_and_place, manu-a-dev/doodlebot",
    "UR5e": "inaki1111/ur5_gra_ros2-main, pablotrelis/haptic_ur5e",
    "UR10e": "SmartFarmingPerenMinor/SFP-TreeCutter, Jaron-G/ur10e_gripper, YongyuLiu03/ur10e_controller, "
    "sibeschu/Scorpion_UR10_Noetic",
    "UR16e": "panin-anan/pcl_processing_ros2",
    "UR3": "cmm-mechatronics-automation/ur3_ros, florent-lamiraux/agimus-demos-ur3-pointing",
    "UR5": "tungkw/ur5_ikfast_build, PickNikRobotics/picknik_ur5_moveit_config",
    "UR10": "IRIS-Lab-UFSC/Teste_ROS2",
}
"""Public GitHub repositories with the calibrations that the shipped sheets are made from."""

ASSUMED = {  # encoder step, bearings, wrist bearings, tubes of upper arm and forearm, payload, repeatability of the data sheet
    "UR3e": ("14 arcsec", "1e5", "2e4", "75 mm", "60 mm", "0.5 kg", "0.03"),
    "UR5e": ("9 arcsec", "2e5", "4e4", "90 mm", "75 mm", "1 kg", "0.03"),
    "UR10e": ("10 arcsec", "4e5", "8e4", "120 mm", "95 mm", "2 kg", "0.05"),
}


def sheet(kind: str, law: Law, units: Sequence[Unit], left: str, head: Mapping[str, str]) -> str:
    """Return the sheet of a type: its measured errors, and assumptions like those of the UR5's sheet."""
    step, bearing, wrist, upper, fore, payload, repeatability = ASSUMED[kind]
    own = [unit for unit in units if unit.kind == kind]
    others = [f"{sum(unit.kind == one for unit in units)} {one}" for one in FOUND_IN if one != kind]
    others = [text for text in others if not text.startswith("0 ")]
    lines = [
        f"# Universal Robots {kind} as delivered, driven with nominal dimensions instead of its own factory calibration.",
        "# Each line below rests on a reference [n] or is an assumption, and says so (assumed: true). Not in the sheet: where",
        "# the base stands. Written by scripts/ur_sheets.py.",
        "#",
        "# forecast, |d| of tool0 by `precision-pin analyze` (exact model, 100,000 samples, seed 0):",
        *(f"#   {pose:<10} {head[pose]}" for pose in POSES),
        f"# {len(own)} units [1] over random poses, each beside a forecast made from the others: inside its 90 % band",
        f"#   {left}.",
        f"# repeatability (ISO 9283, mean + 3 s of the visit-scope draws): forecast {head['repeatability']} mm, data sheet [3] "
        f"{repeatability} mm.",
        "#",
        f"# [1] Factory calibrations of {len(own)} {kind}, as ur_calibration of the Universal Robots ROS driver reads them from",
        "#     a controller, found in public GitHub repositories in 2026:",
        f"#     {FOUND_IN[kind]}.",
        f"# [2] The same of {', '.join(others)}, 2026: see scripts/ur_sheets.py.",
        "#     Spread pooled over all types, up to a factor for each type; means drawn towards those of all types (variance",
        "#     components). A standard deviation has in it what is not known of the mean. Gravity is in the calibrations.",
        f"# [3] Universal Robots, data sheet of the {kind} (an arm of 2018): repeatability {repeatability} mm.",
        "# [4] EN 1999-1-1, 2007: aluminium expands by 23 ppm/K.",
        "precision-pin: 1",
        f"robot: example:{kind.lower()}",
        "tip: tool0",
        "gravity: earth",
        "statics: nominal",
        "poses:",
        *(f"  {pose}: {' '.join(map(str, angles))} deg" for pose, angles in POSES.items()),
        "provenance:",
        f'  frame*: {{measured: "factory calibrations of {len(own)} {kind}, spread pooled over {len(units)} UR robots"}}',
        "",
        "sources:",
        "  # Places and directions of the axes [1], [2]. y of axis 2: its height; of axes 5, 6: places along axes 4, 5.",
        "  # x of axes 3 and 4: lengths of upper arm and forearm; of the others: how far they miss the axis before. rx: twists,",
        "  # ry: tilts. z: the flange along axis 6. The zeros of the joints are within 0.01 mrad in [1].",
    ]
    numbers = iter(zip(law.mean, law.std, strict=True))
    for place, names in PLACES:
        settings = []
        for name in names.split():
            if (place, name) not in ZEROS:
                unit = "mrad" if name.startswith("r") else "mm"
                mean, std = (f"{1e3 * float(value):.2g} {unit}" for value in next(numbers))
                settings.append(f"{name}: {{normal: {{std: {std}}}, mean: {mean}}}")
        where = "joint" if place.endswith("joint") else "frame"
        lines.append(f"  - frame: {{{where}: {place}, {', '.join(settings)}}}")
    joints = [f"{name}_joint" for name in JOINTS]
    lines += [
        "",
        "  # assumption: encoders as in the UR5, with a step that brings the repeatability near that of [3].",
        *(
            f"  - encoder: {{joint: {name}, resolution: {step}, scope: visit, "
            "amplitude: {uniform: 15 arcsec, mean: 30 arcsec}, assumed: true}"
            for name in joints
        ),
        "",
        "  # assumption: bearings against tilting, and tubes of aluminium.",
        *(
            f"  - bearing_stiffness: {{joint: {name}, tilt: {{uniform: {float(value) / 4:g} N*m/rad, mean: {value} N*m/rad}}, "
            "assumed: true}"
            for name, value in zip(joints, 3 * [bearing] + 3 * [wrist], strict=True)
        ),
        *(
            f"  - beam: {{link: {link}_link, section: tube, outer_diameter: {size}, wall: {{uniform: 0.2 mm, mean: 4 mm}}, "
            "material: aluminium, assumed: true}"
            for link, size in (("upper_arm", upper), ("forearm", fore))
        ),
        "",
        "  # assumption: what it carries has its centre 50 mm beyond the flange.",
        f"  - payload: {{at: tool0, mass: {payload}, com: 0 0 50 mm, assumed: true}}",
        "",
        "  # Aluminium [4]; assumption: warmed up by 5 K ± 5 K above the temperature it was calibrated at.",
        "  - thermal: {expansion: 23 ppm/K, temperature_change: {uniform: 5 K, mean: 5 K}, assumed: true}",
    ]
    return "\n".join(lines) + "\n"


def header(model: pp.ErrorModel) -> dict[str, str]:
    """Return the forecast at the named poses and of the repeatability, as the head of a sheet says them."""
    texts, repeats = {}, []
    for pose in POSES:
        norm = pp.monte_carlo(model, pose, samples=SAMPLES).position.norm
        median, most = (1e3 * (norm.quantile(share) or np.nan) for share in (0.5, 0.95))
        texts[pose] = f"median {median:.1f} mm, 95 % {most:.1f} mm"
        jacobian = model.at(pose).jacobian[:3]
        visits = [
            jacobian[:, columns] @ one.law.covariance @ jacobian[:, columns].T
            for one, columns in zip(model.space.draws, model.space.slices, strict=True)
            if one.scope is pp.Scope.VISIT
        ]
        points = np.random.default_rng(0).multivariate_normal(np.zeros(3), sum(visits), 100_000)
        away = np.linalg.norm(points, axis=1)
        repeats.append(1e3 * (away.mean() + 3 * away.std()))
    return {**texts, "repeatability": f"{min(repeats):.2f} to {max(repeats):.2f}"}


def main(folder: Path, out: Path) -> None:
    """Write URDFs, sheets and the picture."""
    kinds_of(folder)
    out.mkdir(parents=True, exist_ok=True)
    chains = {}
    for kind in FOUND_IN:
        path = out / f"{kind.lower()}.urdf"
        write_text(path, urdf(kind))
        chains[kind] = pp.Chain.from_urdf(path, "tool0", "base")
        if kind not in SHIPPED:
            path.unlink()
    units = read_units(folder, chains)
    found = leave_out(units, chains)
    law, spread = laws(np.array([unit.errors[KEPT] for unit in units]), [unit.kind for unit in units])
    for (place, name), (low, high) in zip([one for one in NUMBERS if one not in ZEROS], spread, strict=True):
        print(f"{place} {name}: standard deviation {1e3 * low:.2g} to {1e3 * high:.2g} (mm, mrad; 95 %)")
    for kind in dict.fromkeys(one.unit.kind for one in found):
        print(f"{kind}: {share_inside([one for one in found if one.unit.kind == kind])} inside")
    print(f"all: {share_inside(found)} inside")
    print(f"e-Series: {share_inside([one for one in found if one.unit.kind.endswith('e')])} inside")
    for kind in SHIPPED:
        if kind in law:
            left = share_inside([one for one in found if one.unit.kind == kind])
            path = out / f"{kind.lower()}.errors.yaml"
            write_text(path, sheet(kind, law[kind], units, left, dict.fromkeys((*POSES, "repeatability"), "")))
            write_text(path, sheet(kind, law[kind], units, left, header(pp.ErrorModel.load(path))))
            print(f"wrote {path}")
    draw(found, out / "ur-left-out.png")


if __name__ == "__main__":
    if {"-h", "--help"} & set(sys.argv):
        print(__doc__)
        sys.exit()
    if not 2 <= len(sys.argv) <= 3:
        sys.exit("usage: python ur_sheets.py FOLDER [OUT]")
    main(Path(sys.argv[1]), Path(sys.argv[2] if len(sys.argv) > 2 else "."))
