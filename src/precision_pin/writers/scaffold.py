"""Initial error sheet for any arm: every joint and link by name, with starting tolerances marked as assumptions."""

from __future__ import annotations

import inspect
import math
import os
import re
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arguments import check_flag, check_path
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.draws.laws import laws_of_sheets
from precision_pin.robot import urdf
from precision_pin.robot.chain import Chain
from precision_pin.robot.collision import CollisionCheck, Obstacles
from precision_pin.robot.examples import resolve_robot, shipped_sheet
from precision_pin.robot.inverse_kinematics import spread_points
from precision_pin.robot.urdf import Joint, gripper_joint
from precision_pin.sheet import catalogue
from precision_pin.sheet.schema import ASSUMED
from precision_pin.sheet.settings import law_options
from precision_pin.terms.source import setting_fields

TRIALS: Final = 64
"""Trial poses for a well-conditioned first pose and the load on every joint: some milliseconds, and no more in a sheet."""

WIND_UP: Final = 2e-4
"""Rotation of a revolute joint under its design load, rad: 0.2 mm at a reach of 1 m, the size of the other errors."""

GIVE: Final = 2e-5
"""Displacement of a prismatic joint under its design load, m: the effect of ``WIND_UP`` at a radius of 100 mm."""

LEAST_SHARE: Final = 0.1
"""Minimum design load, as a fraction of the largest of its kind: wrists carry payloads too."""

FREE_SHIFT: Final = 3e-3
"""Standard deviation of a free displacement, as a fraction of the arm's length: castings and assembly stay below 0.1 %."""

FREE_TURN: Final = 10.0
"""Standard deviation of a free rotation or zero, mrad: factory calibrations of UR arms are within 0.1 to 5 mrad."""

FREE_WIND_UP: Final = 2e-3
"""Rotation under the design load by the mean of a free compliance, rad: ten times ``WIND_UP``."""

FREE_GIVE: Final = 2e-4
"""Displacement of a prismatic joint, m: the effect of ``FREE_WIND_UP`` at a radius of 100 mm."""

SHORTEST: Final = 0.5e-3
"""Shortest length with a general tolerance in ISO 2768-1, m."""

_FINE: Final = ((6.0, 0.05), (30.0, 0.1), (120.0, 0.15), (400.0, 0.2), (1000.0, 0.3), (2000.0, 0.5))
"""Upper length and deviation of each range of class f, mm, ISO 2768-1, table 1."""


Lines = list[str]
ANGLE_OFFSET: Final = "0.02 deg"
SLIDE_OFFSET: Final = "0.05 mm"
SEAT_RADIUS: Final = "0.02 mm"
COMPLIANCE_SPREAD: Final = 0.2
"""Starting tolerances; the comments of the sheet give their sources. The spread of a compliance is a guess."""
_ALUMINIUM: Final = (70e9, 26e9)
"""Moduli of elasticity and of shear, Pa."""
_MARK: Final = f"{ASSUMED}: true"
"""Key that marks a source as an assumption."""
_MANY: Final = 12
"""Names in a list of the sheet, or locked joints with a line each; more would hide the rest of the sheet."""
_WIDTH: Final = 110
"""Characters of a comment line, as in the header of a robot as built."""
# text that every YAML reader takes for itself: a name or path, a robot of a collection, but no word of YAML
_PLAIN: Final = re.compile(r"(?:\.{0,2}/)?[A-Za-z_][A-Za-z0-9_./-]*")
_PLAIN_EXAMPLE: Final = re.compile(r"(?:example|robot_descriptions):[A-Za-z0-9_][A-Za-z0-9_.-]*")
_WORDS: Final = frozenset(("true", "false", "yes", "no", "on", "off", "y", "n", "null"))


def general_tolerance(length: float) -> tuple[float, str]:
    """Return the permissible deviation ± (m) of a length (m) and its class, ISO 2768-1, table 1.

    Class f (fine); above 2 m, where it ends, class m (medium), whose ±2 mm for up to 4 m is used beyond too.
    """
    for longest, deviation in _FINE:
        if length * 1e3 <= longest:
            return deviation * 1e-3, "f"
    return 2e-3, "m"


def reach(chain: Chain) -> float:
    """Return the sum of the links' lengths, m; 1 m if they have none."""
    return float(np.linalg.norm(chain.placements[:, :3, 3], axis=1).sum()) or 1.0


def round_125(value: float) -> float:
    """Return the nearest, by ratio, of 1, 2 and 5 times powers of ten to a positive number."""
    power = 10.0 ** math.floor(math.log10(value))
    nearest = min((1.0, 2.0, 5.0, 10.0), key=lambda step: abs(math.log(value / power / step)))
    return float(f"{nearest * power:.0e}")


@dataclass(frozen=True, eq=False)
class Survey:
    """Properties of a chain from T trial poses ``(T, n)`` within the limits.

    ``units`` are the units of each joint's values: deg or m; rad if the limits of a joint coincide, so that its value
    equals them exactly. Among the collision-free trials, ``start`` is the best conditioned, ``far`` the one of the others
    with maximum distance of the tip from the first joint. ``loads`` are the largest torque or force of the weights on
    every joint, N·m or N; ``loadable``: whether a weight beyond the joint can move it in some pose.
    """

    chain: Chain
    trials: Array
    units: tuple[str, ...]
    start: int
    far: int
    loads: Array
    loadable: NDArray[np.bool_]

    @classmethod
    def of(cls, chain: Chain) -> Survey:
        """Evaluate trial poses over the joints' ranges."""
        # the condition of a pose is the smallest singular value of the joint Jacobian, lengths divided by the reach
        ranges = [_trial_range(joint) for joint in chain.joints]
        units = tuple(unit for _, _, unit in ranges)
        trials = _trials(ranges)
        to_si = np.where(np.array(units) == "deg", np.pi / 180, 1.0)
        size = reach(chain)
        columns = np.where(chain.prismatic, size, 1.0)
        rows = np.array([1 / size] * 3 + [1.0] * 3)
        gravity = float(np.linalg.norm(chain.gravity))
        down = chain.gravity / gravity if gravity else np.zeros(3)
        conditions, distances, loads, tilts = [], [], [], []
        for values in trials:
            posture = chain.at(values * to_si)
            scaled = rows[:, None] * posture.joint_jacobian * columns
            # rounded, so that the result does not depend on the last bits of a machine
            conditions.append(round(float(np.linalg.svd(scaled, compute_uv=False)[-1]), 6))
            distances.append(round(float(np.linalg.norm(posture.pose[:3, 3] - posture.joint_poses[0][:3, 3])), 6))
            loads.append(np.abs(posture.load_torque))
            along = np.abs(posture.joint_axes @ down)
            across = np.linalg.norm(np.cross(posture.joint_axes, down), axis=1)
            tilts.append(np.where(chain.prismatic, along, across))
        free = CollisionCheck(chain, chain.obstacles or Obstacles()).free(np.ascontiguousarray((trials * to_si).T))
        if free.sum() > 1:
            conditions, distances = (np.where(free, scores, -1.0).tolist() for scores in (conditions, distances))
        start = int(np.argmax(conditions))
        distances[start] = -2.0
        loadable = np.max(tilts, axis=0) > 1e-3
        return cls(chain, trials, units, start, int(np.argmax(distances)), np.max(loads, axis=0), loadable)

    @cached_property
    def design_loads(self) -> Array:
        """Largest load of each joint, N·m or N, ``(n,)``, at least a tenth of its kind's largest; 0 without weights."""
        result = np.zeros(len(self.chain.joints))
        for kind in (self.chain.prismatic, ~self.chain.prismatic):
            group = kind & self.loadable
            result[group] = np.maximum(self.loads[group], LEAST_SHARE * np.max(self.loads[group], initial=0.0))
        return result


def _trials(ranges: Sequence[tuple[float, float, str]]) -> Array:
    """Return poses ``(T, n)`` over the joints' ranges, rounded if limits allow it."""
    columns = []
    for (centre, half, _), fraction in zip(ranges, spread_points(len(ranges), TRIALS), strict=True):
        values = centre + half * (2 * fraction - 1)
        # with this number of decimals, rounding changes a value by less than a quarter of half
        columns.append(np.round(values, max(0, math.ceil(-math.log10(half / 4)))) if half else values)
    return np.array(columns).T


def _trial_range(joint: Joint) -> tuple[float, float, str]:
    """Return centre, half-width and unit of a joint's usable range: at most ±60 deg or ±0.2 m about the middle."""
    lower, upper = (-math.inf, math.inf) if joint.limit is None else (joint.limit.lower, joint.limit.upper)
    slides = joint.kind == "prismatic"
    if lower == upper:
        return lower, 0.0, "m" if slides else "rad"
    half_range = 0.2 if slides else 60.0
    if not slides:
        lower, upper = math.degrees(lower), math.degrees(upper)
    if not math.isfinite(lower):
        lower = min(-half_range, upper - 2 * half_range)
    if not math.isfinite(upper):
        upper = max(half_range, lower + 2 * half_range)
    return (lower + upper) / 2, min(0.8 * (upper - lower) / 2, half_range), "m" if slides else "deg"


def scaffold(chain: Chain, robot_text: str, *, pose: Sequence[float] | None = None) -> str:
    """Return the text of a commented sheet for a chain; it loads and runs unedited, and is reproducible.

    All tolerances are marked as assumptions, each with its reason: joint offsets by the accuracy of strain wave gears,
    axes by ISO 286-1 grade IT6, lengths by ISO 2768-1 class fine, joints with a deflection of 0.2 mrad (prismatic: 0.02
    mm) under the largest weight on them. ``robot_text`` is the value of ``robot:``; the chain's payloads are omitted.
    ``pose``: the first pose (default: a well-conditioned one within the limits).
    """
    survey = Survey.of(chain)
    start = None if pose is None else chain.configuration(pose)
    sections = (
        _head(chain, robot_text),
        _chain_table(chain),
        _locked(chain),
        ["# keep_out: none    # if the base stands on no plate; else poses below the plate are excluded"],
        _poses(chain, survey, start),
        _parameters(),
        ["sources:", *_payload(chain)],
        _joint_offsets(chain),
        _axes(chain),
        _compliances(chain, survey),
        _lengths(chain),
        _beams(chain),
        _kinds(),
    )
    return "\n\n".join("\n".join(section) for section in sections) + "\n"


def kinematic_sheet(chain: Chain, robot_text: str) -> str:
    """Return the text of a commented sheet for a complete calibration of a chain; it loads and runs unedited.

    Each joint after the first has six free displacements, of which that along or about a coordinate axis that the joint moves
    by is written as its zero, and each joint that a weight can move a free compliance. The first joint's seat and the tip are
    free by the measurement block: base and target are estimated. Tolerances are broad and marked as assumptions: they keep
    combinations that no reading sees from running away, and hardly pull the others.
    """
    survey = Survey.of(chain)
    sections = (
        _calibration_head(chain, robot_text),
        _chain_table(chain),
        _locked(chain),
        _poses(chain, survey, None),
        _measurement(chain),
        ["sources:", *_payload(chain)],
        _free_frames(chain),
        _free_compliances(chain, survey),
    )
    return "\n\n".join("\n".join(section) for section in sections) + "\n"


def init(
    robot: str | os.PathLike[str], *, tip: str | None = None, base: str | None = None, calibration: bool = False
) -> str:
    """Return a commented sheet for a URDF: every joint and link of the chain, with starting tolerances to replace.

    Args:
        robot: The URDF, or ``example:NAME``, for which the sheet that comes with this package is returned if there is
            one.
        tip, base: Ends of the chain; by default the only leaf, and the root.
        calibration: Instead the sheet of a complete calibration: all displacements, zeros and compliances of the joints
            free, base and target estimated.

    Raises:
        InputError: A robot that cannot be read, or several leaves and no tip.

    Examples:
        >>> text = pp.init("4dof.urdf", tip="tool")
        >>> print(text.splitlines()[0][:36])
        # Error sheet of the robot paper_4do
    """
    name = os.fspath(check_path("the robot", robot))
    check_flag("calibration", calibration)
    shipped = None if calibration else shipped_sheet(name)
    if shipped is not None and tip is None and base is None:
        return shipped.read_text(encoding="utf-8")
    read = urdf.read(resolve_robot(name))
    if tip is None and len(read.leaves) > 1:
        raise InputError(f"{urdf.ask_for_tip(read)}: tip={urdf.likeliest_tip(read)!r}")
    return (kinematic_sheet if calibration else scaffold)(Chain.from_robot(read, tip, base), name)


def quoted(text: str) -> str:
    """Return text as a YAML scalar that every reader reads as this string, quoted if needed."""
    if (_PLAIN.fullmatch(text) and text.lower() not in _WORDS) or _PLAIN_EXAMPLE.fullmatch(text):
        return text
    if text.isprintable():
        return "'" + text.replace("'", "''") + "'"
    return '"' + _escaped(text.replace("\\", "\\\\").replace('"', '\\"')) + '"'


def _head(chain: Chain, robot_text: str) -> Lines:
    return [
        f"# Error sheet of the robot {_escaped(chain.robot.name)}, drafted by `precision-pin init`.",
        "# It runs unedited: precision-pin analyze THIS_FILE",
        '# No value is measured on this robot. Values marked "assumption" are starting tolerances: replace them by values of',
        "# a drawing, a data sheet or a calibration, and delete 'assumed: true'; until then, verdicts note that they rest on",
        "# assumptions. A tolerance is a half-width, ± about the mean: {normal: t} is ±3σ. For a known σ write",
        "# {normal: {std: σ}}; {normal: σ} would underestimate the error by a factor of three.",
        *_robot(chain, robot_text),
    ]


def _calibration_head(chain: Chain, robot_text: str) -> Lines:
    text = (
        f"Sheet for the calibration of the robot {_escaped(chain.robot.name)}, written by `precision-pin init --calibration`: "
        "all geometry of its joints is free, their zeros and compliances too. Write what was measured into measurement:, then "
        "run precision-pin calibrate THIS_FILE DATA.csv. The tolerances are broad on purpose: a forecast of what "
        "measuring will buy (calibrate --forecast, --plan) is right, but analyze of this sheet is no forecast of an arm as "
        "delivered; precision-pin init without --calibration drafts that."
    )
    return [*_comment(text), *_robot(chain, robot_text)]


def _robot(chain: Chain, robot_text: str) -> Lines:
    others = [name for name in chain.robot.leaves if name != chain.tip]
    leaf_names = ", ".join(_escaped(name) for name in others[:_MANY]) + (", …" if len(others) > _MANY else "")
    return [
        "precision-pin: 1",
        f"robot: {quoted(robot_text)}",
        *_gripper(chain),
        f"tip: {quoted(chain.tip)}" + (f"    # other leaves: {leaf_names}" if others else ""),
        f"base: {quoted(chain.base)}    # does not move",
        f"gravity: {' '.join(map(_number, chain.gravity))} m/s^2    # base axes; or earth, moon, none",
        "statics: nominal    # loads at the undeflected pose",
    ]


def _gripper(chain: Chain) -> Lines:
    joint = None if chain.robot.joints[0].reversed else gripper_joint(chain.robot, chain.tip)
    if joint is None or joint.name not in chain.joint_names:
        return []
    text = f"The joint {joint.name} opens a gripper: the tip is a finger. The last link before it is {joint.parent}."
    return _comment(_escaped(text))


def _chain_table(chain: Chain) -> Lines:
    lines = [
        "# The chain, base to tip; joint axes in the joint frames. 'effort' is the limit in the URDF.",
        f"#   link   {_escaped(chain.base)}: {_mass(chain, chain.base)}",
    ]
    joints = chain.robot.path(chain.base, chain.tip)
    for joint in joints:
        lines.append(f"#   joint  {_escaped(joint.name)}: {_described(chain, joint)}")
        lines.append(f"#   link   {_escaped(joint.child)}: {_mass(chain, joint.child)}")
    path_links = {chain.base, *(joint.child for joint in joints)}
    others = [link for link in chain.robot.links if link.name not in path_links]
    if others:
        weight = f"{sum(link.mass for link in others):.4g} kg"
        lines.append(f"# {len(others)} further links ({weight}) are attached; the weight of moving links counts.")
    return lines


def _described(chain: Chain, joint: Joint) -> str:
    if joint.kind == "fixed":
        return "fixed"
    axis = " ".join(_number(round(value, 6)) for value in joint.axis)
    words = [joint.kind, _range(joint), f"axis {axis}"]
    if joint.limit is not None and math.isfinite(joint.limit.effort):
        words.append(f"effort {joint.limit.effort:.6g} {'N' if joint.kind == 'prismatic' else 'N*m'}")
    if joint.name in chain.locked:
        words.append("locked")
    return ", ".join(words)


def _range(joint: Joint) -> str:
    limit = joint.limit
    if limit is None or joint.kind == "continuous" or (math.isinf(limit.lower) and math.isinf(limit.upper)):
        return "no limits"
    slides = joint.kind == "prismatic"
    lower, upper = (value if slides else math.degrees(value) for value in (limit.lower, limit.upper))
    return f"{lower:.5g} to {upper:.5g} {'m' if slides else 'deg'}"


def _mass(chain: Chain, name: str) -> str:
    link = chain.robot.link(name)
    return f"{link.mass:.5g} kg" if link.mass else "no mass"


def _locked(chain: Chain) -> Lines:
    """Return the joints off the chain: one per line with limits, or several per line if there are many; then mimics."""
    joints = [joint for joint in chain.robot.joints if joint.name in chain.locked]
    if not joints:
        return ["# No joint moves off the chain; one on it is locked so:  locked: {JOINT: 0 deg}"]
    path_names = {joint.name for joint in chain.robot.path(chain.base, chain.tip)}
    mimics = [joint for joint in joints if joint.name not in path_names and _follows(chain, joint)]
    independent = [joint for joint in joints if joint not in mimics]
    entries = [
        f"{quoted(joint.name)}: {_number(chain.locked[joint.name])} {'m' if joint.kind == 'prismatic' else 'rad'}"
        for joint in independent
    ]
    lines = ["# Joints that do not move; their links hang on the arm."]
    if len(independent) > _MANY:
        lines += ["locked: {", *(f"  {line}" for line in _packed(entries)), "  }"]
    elif independent:
        notes = (f"{joint.kind}, {_range(joint)}" for joint in independent)
        lines += ["locked:", *(f"  {text}    # {note}" for text, note in zip(entries, notes, strict=True))]
    if mimics:
        lines += _comment("They follow others (mimic): " + ", ".join(_escaped(joint.name) for joint in mimics))
    return lines


def _follows(chain: Chain, joint: Joint) -> bool:
    if joint.mimic is None:
        return False
    leader = chain.locked.get(joint.mimic.joint, 0.0)
    return chain.locked[joint.name] == joint.mimic.multiplier * leader + joint.mimic.offset


def _packed(entries: Iterable[str]) -> Lines:
    lines = [""]
    for entry in entries:
        if lines[-1] and len(lines[-1]) + len(entry) + 2 > _WIDTH:
            lines[-1] += ","
            lines.append(entry)
        else:
            lines[-1] += f", {entry}" if lines[-1] else entry
    return lines


def _poses(chain: Chain, survey: Survey, start: Array | None) -> Lines:
    lines = ["poses:", *_comment("Joint order: " + ", ".join(map(_escaped, chain.joint_names)), "  # ")]
    if start is None:
        lines.append(f"  # start: best conditioned of {TRIALS} trial poses within the limits.")
        lines += _pose(chain, "start", survey.trials[survey.start], survey.units)
    else:
        lines += _pose(chain, "start", start, ["m" if slides else "rad" for slides in chain.prismatic])
    lines.append("  # far: tip far from the first joint.")
    return lines + _pose(chain, "far", survey.trials[survey.far], survey.units)


def _pose(chain: Chain, name: str, values: ArrayLike, units: Sequence[str]) -> Lines:
    texts = [_number(float(value)) for value in np.asarray(values)]
    if len(set(units)) == 1:
        return [f"  {name}: {' '.join(texts)} {units[0]}"]
    rows = zip(chain.joint_names, texts, units, strict=True)
    return [f"  {name}:", *(f"    {quoted(joint)}: {text} {unit}" for joint, text, unit in rows)]


def _parameters() -> Lines:
    lines = [
        "# Named random numbers, for sources that share one (such as two lengths cut in one set-up):",
        "# parameters:",
        "#   set_up: {uniform: 0.05 mm}",
        "#   tool_mass: {normal: 0.06 kg, mean: 1 kg, scope: visit}",
        "# A source takes them instead of a tolerance:  parameters: [set_up, {uniform: 0.02 mm}]",
        f"# A law has one of these keys and, as it allows, {', '.join(law_options())}; normal: t is ±3σ.",
    ]
    for key, law in laws_of_sheets().items():
        lines += _comment(f"{key}: {_first_line(law)}", "#   ", "#       ")
    return lines


def _payload(chain: Chain) -> Lines:
    moving = {name for name, frame in chain.link_frames.items() if frame.link > 0}
    mass = sum(link.mass for link in chain.robot.links if link.name in moving)
    example = f"{round_125(0.05 * mass) if mass else 1.0:.3g} kg"
    return [
        "  # Payload: none yet. It loads the joints and links below; com: in the axes of the link that carries it.",
        f"  # - payload: {{at: {quoted(chain.tip)}, mass: {example}, com: 0 0 0 mm, {_MARK}}}",
    ]


def _measurement(chain: Chain) -> Lines:
    names = "; ".join(f"q{k + 1}={_escaped(name)}" for k, name in enumerate(chain.joint_names))
    return [
        "# What is read, by what instrument.",
        "measurement:",
        "  kind: position         # of a reflector or marker: x, y, z; or pose, distance, plane, socket",
        "  std: estimate          # from the readings; or that of one coordinate, such as 20 um",
        "  base: free             # where the base is in the instrument's axes is estimated; or known: they are the base's",
        "  target: 0 0 0 mm       # where on the tool, in the tip's axes; a guess within centimetres will do",
        "  target_known: false    # estimated; or true",
        *_comment(
            f"columns: what the columns of the data are, if their header does not say it ({names})", "  # ", "  #   "
        ),
        "  # load: none             # if the payloads below were not on the arm",
    ]


def _free_frames(chain: Chain) -> Lines:
    """Return the displacements and the zero of every joint; those of the first and of the tip are the set-up's."""
    shift = 1e3 * round_125(FREE_SHIFT * reach(chain))
    length, angle = f"{{normal: {{std: {_short(shift)} mm}}}}", f"{{normal: {{std: {FREE_TURN:g} mrad}}}}"
    displacements = {**dict.fromkeys("xyz", length), **{f"r{name}": angle for name in "xyz"}}
    lines = _comment(
        f"Each joint's seat is free in all six directions; the standard deviations of {_short(shift)} mm, {100 * FREE_SHIFT:g} % "
        f"of the arm's length, and {FREE_TURN:g} mrad are several times what arms are off, so that the readings decide. Along or "
        "about the axis that the joint moves by it is its zero.",
        "  # ",
    )
    for k, joint in enumerate(chain.joints):
        start = "  - "
        if k == 0:
            start = "  # - "
            lines += _comment(
                "The seat of the first joint is the base, which the measurement frees. With base: known free it here:",
                "  # ",
            )
        slides = joint.kind == "prismatic"
        zeros = [
            f"{'' if slides else 'r'}{name}"
            for name, part in zip("xyz", joint.axis, strict=True)
            if abs(part) > 1 - 1e-9
        ]
        free = ", ".join(f"{name}: {law}" for name, law in displacements.items() if name not in zeros)
        place, zero = f"joint: {quoted(joint.name)}", length if slides else angle
        lines.append(f"{start}frame: {{{place}, {free}, {_MARK}}}")
        lines.append(f"{start}joint_offset: {{{place}, offset: {zero}, {_MARK}}}")
    free = ", ".join(f"{name}: {law}" for name, law in displacements.items())
    return [
        *lines,
        "  # The tip is where the target is, which the measurement frees. With target_known: true free it here:",
        f"  # - frame: {{frame: {quoted(chain.tip)}, {free}, {_MARK}}}",
    ]


def _free_compliances(chain: Chain, survey: Survey) -> Lines:
    lines = _comment(
        f"Compliances: from zero to twice a mean by which the joint deflects by {FREE_WIND_UP * 1e3:g} mrad (prismatic: "
        f"{FREE_GIVE * 1e3:g} mm) under the largest load of the URDF's masses in {TRIALS} trial poses, at least "
        f"{100 * LEAST_SHARE:g} % of the largest load on any joint of its kind.",
        "  # ",
    )
    return lines + _compliance_lines(chain, survey, (FREE_WIND_UP, FREE_GIVE), 1.0)


def _joint_offsets(chain: Chain) -> Lines:
    lines: Lines = []
    if not chain.prismatic.all():
        lines += _comment(
            f"Joint values: zero setting and gear. {ANGLE_OFFSET} is 1.2 arcmin; data sheets of strain wave gears state 1 to 2 "
            "arcmin from the lowest to the highest error in a turn, and a calibrated zero is about as good.",
            "  # ",
        )
    if chain.prismatic.any():
        what = "about the travel deviation of a rolled ball screw of grade 7 over 300 mm (ISO 3408-3)"
        lines += _comment(f"Sliding joints: {SLIDE_OFFSET}, {what}. A rail that is not straight: guide, below.", "  # ")
    for joint in chain.joints:
        offset = f"{{normal: {SLIDE_OFFSET if joint.kind == 'prismatic' else ANGLE_OFFSET}}}"
        lines.append(f"  - joint_offset: {{joint: {quoted(joint.name)}, offset: {offset}, {_MARK}}}    # assumption")
    return lines


def _axes(chain: Chain) -> Lines:
    span = f"{min(max(round_125(0.1 * reach(chain)), 0.02), 0.1) * 1e3:.3g} mm"
    text = (
        f"Axes: each passes within {SEAT_RADIUS} of its nominal place in two planes, the bearings'. A seat of 50 to 80 mm "
        "in grade IT6 has 0.019 mm (ISO 286-1). The span is a guess from the arm's size, a tenth of its links' lengths "
        "within 20 to 100 mm; the rotation it causes is nearly proportional to 1/span."
    )
    settings = f"radius: {SEAT_RADIUS}, span: {span}, {_MARK}}}    # assumption"
    entries = [f"  - axis_install: {{joint: {quoted(name)}, {settings}" for name in chain.joint_names]
    return [*_comment(text, "  # "), *entries]


def _compliances(chain: Chain, survey: Survey) -> Lines:
    text = (
        f"Joint flexibility: such that a joint deflects by {WIND_UP * 1e3:g} mrad (prismatic: {GIVE * 1e3:g} mm) under the "
        f"largest load of the URDF's masses in {TRIALS} trial poses, at least {100 * LEAST_SHARE:g} % of the largest load "
        "on any joint of its kind; rounded to 1, 2, 5; known to "
        f"{100 * COMPLIANCE_SPREAD:g} %. Data sheets of the gears give it; some are known by name: instead of joint_compliance, "
        "transmission with gear: NAME, or servo with servo: NAME."
    )
    return _comment(text, "  # ") + _compliance_lines(chain, survey, (WIND_UP, GIVE), COMPLIANCE_SPREAD)


def _compliance_lines(chain: Chain, survey: Survey, deflections: tuple[float, float], spread: float) -> Lines:
    """Return a line for each joint; ``deflections`` under the design load, rad and m, give the means."""
    lines = []
    for joint, load, loadable in zip(chain.joints, survey.design_loads, survey.loadable, strict=True):
        slides = joint.kind == "prismatic"
        if not loadable:
            lines.append(f"  # {_escaped(joint.name)}: weight cannot move it in any pose")
        elif load == 0.0:
            lines.append(f"  # {_compliance(joint, 1e-5, spread)}    # no mass beyond it in the URDF")
        else:
            mean = round_125(deflections[slides] / load)
            unit = "N" if slides else "N*m"
            lines.append(f"  {_compliance(joint, mean, spread)}    # assumption; for {load:.4g} {unit}")
    return lines


def _compliance(joint: Joint, mean: float, spread: float) -> str:
    unit = "m/N" if joint.kind == "prismatic" else "rad/(N*m)"
    law = f"{{uniform: {_short(spread * mean)} {unit}, mean: {_short(mean)} {unit}}}"
    return f"- joint_compliance: {{joint: {quoted(joint.name)}, compliance: {law}, {_MARK}}}"


def _lengths(chain: Chain) -> Lines:
    text = (
        "Lengths of the links, from joint origin to joint origin: general tolerances ISO 2768-1, class f (fine), table 1; "
        "m (medium) above 2 m. Other directions: along: [-]x|y|z of JOINT."
    )
    lines = _comment(text, "  # ")
    for link, placement in enumerate(chain.placements):
        length = float(np.linalg.norm(placement[:3, 3]))
        ends = [chain.base, *chain.joint_names, chain.tip]
        between = " to ".join(map(_escaped, ends[link : link + 2]))
        if length < SHORTEST:
            lines.append(f"  # {between}: {length * 1e3:.3g} mm, too short for a general tolerance")
            continue
        tolerance, grade = general_tolerance(length)
        what = f"{'joint' if link < len(chain.joints) else 'frame'}: {quoted(ends[link + 1])}"
        entry = f"- length: {{{what}, parameters: {{uniform: {tolerance * 1e3:.3g} mm}}, {_MARK}}}"
        lines.append(f"  {entry}    # assumption: class {grade}; {between}, {length * 1e3:.5g} mm")
    return lines


def _beams(chain: Chain) -> Lines:
    diameter = round_125(reach(chain) / 15)
    wall = diameter / 16
    second_moment = math.pi / 8 * diameter**3 * wall
    bending = float(f"{_ALUMINIUM[0] * second_moment:.0e}")
    torsion = float(f"{_ALUMINIUM[1] * (2 * second_moment):.0e}")
    text = (
        f"Flexibility of the links: omitted. Values are those of aluminium tubes of {diameter * 1e3:g} mm mean diameter and "
        f"{wall * 1e3:.3g} mm wall (E 70 GPa, G 26 GPa: EI = E pi/8 d^3 t, GI = G pi/4 d^3 t); correct them first. "
        "If a joint slides along a link, the beam ends at its carriage; a bridge needs supports: both and span: too."
    )
    lines = _comment(text, "  # ")
    names = {frame.link: name for name, frame in chain.link_frames.items() if frame.is_own}
    for link, placement in enumerate(chain.placements):
        is_rail = link < len(chain.joints) and chain.prismatic[link] and not chain.reversed_joints[link]
        if np.linalg.norm(placement[:3, 3]) < SHORTEST and not is_rail:
            continue
        laws_text = ", ".join(
            f"{name}: {{uniform: {_short(0.1 * value)} N*m^2, mean: {_short(value)} N*m^2}}"
            for name, value in (("EI", bending), ("GI", torsion))
        )
        lines.append(f"  # - beam: {{link: {quoted(names[link])}, {laws_text}, {_MARK}}}")
    return lines


def _kinds() -> Lines:
    lines = ["# Every kind of source, with its settings:"]
    for name, kind in catalogue().items():
        settings = ", ".join(entry.key for entry in setting_fields(kind))
        lines += _comment(f"{name} {{{settings}}}: {_first_line(kind)}", "#   ", "#       ")
    return lines


def _first_line(thing: type) -> str:
    return (inspect.getdoc(thing) or "").split("\n")[0].replace("``", "")


def _comment(text: str, start: str = "# ", following: str | None = None) -> Lines:
    """Return text wrapped into comment lines; ``following`` is the start of all lines after the first."""
    return textwrap.wrap(
        text,
        _WIDTH,
        initial_indent=start,
        subsequent_indent=start if following is None else following,
        break_long_words=False,
        break_on_hyphens=False,
    )


def _escaped(text: str) -> str:
    """Return text with unprintable characters as escapes that are valid in YAML."""
    return "".join(character if character.isprintable() else f"\\U{ord(character):08x}" for character in text)


def _number(value: float) -> str:
    """Return the shortest text that reads back as an equal number."""
    return repr(float(value) + 0.0).removesuffix(".0")


def _short(value: float) -> str:
    """Return a number to three digits, such as 2e-5, not 2e-05."""
    return re.sub(r"e([+-])0*", lambda match: "e-" if match[1] == "-" else "e", f"{value:.3g}")
