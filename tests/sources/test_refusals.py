"""What no source can be, each told in one line: settings, what a chain does not have, and lines of a sheet."""

from functools import cache

import numpy as np
import pytest

from precision_pin import Chain, ErrorModel, Fixed, InputError, Normal, Space, Uniform
from precision_pin.base.errors import SheetError, UnknownNameError
from precision_pin.sources import catalogue
from precision_pin.sources.profiles import Segment
from precision_pin.sources.strut import StrutEnd
from support.checks.common import one_link
from support.checks.places import CORRELATION, STD, rows
from support.engines import written
from support.plain_robot import chain_of, random_arm


@cache
def chain(name: str) -> Chain:
    match name:
        case "hinge":
            return one_link(axis=(0, 1, 0), mass=2.0, com=(0.4, 0.3, 0.1)).with_payload(2.0, (0.1, 0.2, -0.3))
        case "slide":
            return one_link("prismatic")
        case _:
            return chain_of(random_arm(12), tip="tool")


def at_pose(on: str, kind: str, settings: dict[str, object]) -> None:
    model = ErrorModel(chain(on), Space(), [catalogue()[kind](**settings)])
    model.at(np.full(len(chain(on).joints), 0.1))


HINGE = {"joint": "hinge"}
AXIS = {"joint": "hinge", "span": 0.1}
PLAY = {"joint": "hinge", "diametral": (1e-5,), "span": 0.1, "band": 1.0}
GAP = {"joint": "hinge", "backlash": 1e-3, "band": 1.0}
ARM = {"link": "arm"}
TUBE = {"link": "arm", "section": "tube", "outer_diameter": 0.06, "wall": 0.002, "material": "steel"}
PARTS = {"link": "arm", "segments": (Segment(length=0.5, EI=1.0), Segment(EI=2.0))}
SIX = {"joint": "hinge", "std": STD}
ENDS = {"from_": StrutEnd(link="base", point=(0.0, 0.0, 0.3)), "to": StrutEnd(link="arm", point=(0.5, 0.0, 0.0))}

SKEW, NEGATIVE = np.eye(6), np.eye(6)
SKEW[0, 1] = 0.5
NEGATIVE[:3, :3] = [[1, 0.9, 0.9], [0.9, 1, -0.9], [0.9, -0.9, 1]]

SETTINGS = [
    ("covariance", SIX | {"correlation": rows(SKEW)}, "must be symmetric"),
    ("covariance", SIX | {"correlation": rows(NEGATIVE)}, "negative eigenvalue"),
    ("covariance", HINGE | {"matrix": rows(np.full((6, 6), np.nan))}, "finite numbers"),
    ("guide", HINGE, "guide needs one of EXX:, EYX:, EZX:, EAX:, EBX:, ECX: and file:"),
    ("guide", HINGE | {"EXX": (1e-5,)}, r"guide\[hinge\]: guide is of a joint that slides; run_out is of one that turns"),
    ("guide", HINGE | {"EXX": (1e-5,), "order": (0.5,)}, "order of guide must be 1, 2, 3, …, got 0.5"),
    ("guide", HINGE | {"EXX": (1e-5,), "order": (1.0, 2.0)}, "guide needs one EXX: for each order:, got 1 and 2"),
    ("guide", HINGE | {"EXX": (1e-5,), "length": 0.0}, "the length of guide must be positive, got 0 m"),
    ("guide", HINGE | {"EXX": (1e-5,), "ECX": (1e-4,), "short_carriage": True}, "EBX: and ECX: of guide with short_carriage:"),
    ("guide", HINGE | {"EXX": (-1e-5,)}, "EXX: of guide, from peak to valley, must not be negative"),
    ("guide", HINGE | {"EXX": (1e-5,), "short_carriage": True}, "the slopes of EYX: and EZX:, and neither is given"),
    ("joint_compliance", HINGE | {"compliance": float("nan")}, "finite"),
    ("length", {"frame": "tol", "parameters": (1e-3,)}, "named 'tol'; did you mean 'tool'"),
    ("axis_install", AXIS, "either radius: or diameter:"),
    ("axis_install", AXIS | {"radius": -1e-4}, "must not be negative"),
    ("axis_install", AXIS | {"radius": 1e-4, "span": 0.0}, "span of axis_install must be positive"),
    ("backlash", GAP | {"band": 0.0}, "band of backlash must be positive"),
    ("backlash", GAP | {"scope": "day"}, "scope of backlash must be one of unit, pose, visit, got 'day'"),
    ("backlash", GAP | {"backlash": -1e-3}, r"backlash of backlash\[hinge\] can become negative"),
    ("backlash", GAP | {"joint": "hinges"}, "no joint on the chain named 'hinges'; did you mean 'hinge'"),
    ("bearing_stiffness", HINGE, "bearing_stiffness needs a stiffness: radial:, axial:, tilt: or roll:"),
    ("bearing_stiffness", HINGE | {"radial": 1.0, "pads_on": "x"}, "pads_on of .* must be one of child, parent, got 'x'"),
    ("bearing_stiffness", HINGE | {"radial": Normal(1e6, mean=2e6)}, r"radial of \S+ can become zero or negative"),
    ("bearing_stiffness", HINGE | {"roll": 5.0}, "roll: of .* the joint turns about its axis; joint_compliance"),
    ("clearance", PLAY | {"diametral": 1e-5}, "diametral of clearance must be a list"),
    ("clearance", PLAY | {"diametral": ()}, "one or two diametral:"),
    ("clearance", PLAY | {"diametral": (Normal(1e-6),)}, r"diametral of clearance\[hinge\] can become negative"),
    ("clearance", PLAY | {"band": None}, "needs band:, the load below which a direction is random"),
    ("clearance", PLAY | {"band": float("inf")}, "band of clearance must be positive"),
    ("clearance", PLAY | {"direction": "random"}, "band: of clearance is used only with direction: load"),
    ("clearance", PLAY | {"direction": "down"}, "direction of clearance must be one of load, random, got 'down'"),
    ("clearance", PLAY | {"pads_on": "both"}, "pads_on of clearance must be one of child, parent"),
    ("covariance", {"std": STD}, "covariance needs one of joint:, link: and frame:"),
    ("covariance", HINGE, "covariance needs either std: or matrix:"),
    ("covariance", HINGE | {"matrix": rows(np.eye(6)), "correlation": rows(CORRELATION)}, "used only with std:"),
    ("covariance", HINGE | {"std": STD[:5]}, "std: of covariance has 5 numbers, expected 6"),
    ("covariance", HINGE | {"std": (-1e-4, *STD[1:])}, "a standard deviation of covariance is negative"),
    ("covariance", SIX | {"correlation": rows(np.eye(5))}, "correlation: .* must be 6 rows of 6 numbers"),
    ("covariance", SIX | {"correlation": rows(2 * np.eye(6))}, "must have 1 on its diagonal"),
    ("covariance", HINGE | {"matrix": rows(-np.eye(6))}, "negative variance"),
    ("covariance", SIX | {"scope": "day"}, "scope: of covariance must be unit, pose or visit, got 'day'"),
    ("encoder", HINGE, "encoder needs one of resolution:, offset:, amplitude:, eccentricity: and scale:"),
    ("encoder", HINGE | {"amplitude": 1e-3, "eccentricity": 1e-5, "radius": 1.0}, "one of amplitude: and eccentricity:"),
    ("encoder", HINGE | {"eccentricity": 1e-5}, "both of eccentricity: and radius:"),
    ("encoder", HINGE | {"eccentricity": 1e-5, "radius": 0.0}, "radius of encoder must be positive, got 0"),
    ("encoder", HINGE | {"resolution": -1e-5}, "resolution of encoder must be zero or more, got -1e-05"),
    ("encoder", HINGE | {"resolution": 1e-5, "ratio": -100.0}, "ratio of encoder must be positive, got -100"),
    ("encoder", HINGE | {"amplitude": 1e-3, "order": 0}, "order of encoder must be 1, 2, 3, …, got 0"),
    ("encoder", HINGE | {"eccentricity": 1e-5, "radius": 1.0, "order": 2}, "eccentricity: of encoder is a once-per-turn"),
    ("encoder", HINGE | {"amplitude": 1e-3, "heads": 3}, "heads: of encoder must be 1 or 2, got 3"),
    ("encoder", HINGE | {"resolution": 1e-3, "scope": "unit"}, "scope: of encoder must be pose or visit, got 'unit'"),
    ("encoder", HINGE | {"amplitude": 1e-3, "period": 1e-3}, "period: is only for a prismatic joint"),
    ("encoder", HINGE | {"scale": 1e-6}, "scale: is only for a prismatic joint"),
    ("joint_compliance", HINGE | {"compliance": Uniform(2e-5, mean=1e-5)}, r"negative \(as low as -10 µrad/\(N·m\)\); narrow"),
    ("length", {"parameters": (1e-3,)}, "either joint: or frame:"),
    ("length", {"frame": "tool", "parameters": ()}, "at least one"),
    ("length", HINGE | {"parameters": (1e-3,)}, "the link has no length; give a direction"),
    ("length", {"frame": "tool", "parameters": (1e-3,), "along": "w of hinge"}, "'w of hinge' is not understood"),
    ("length", {"frame": "tool", "parameters": ("b",)}, "no parameter named 'b'"),
    ("mounting", {"at": "tip", "x": 1e-3}, "at: of mounting must be base or tool, got 'tip'"),
    ("mounting", {"at": "base", "flange": "link7", "x": 1e-3}, "flange: of mounting is used only with at: tool"),
    ("run_out", HINGE, "run_out needs one of radial:, axial: and tilt:"),
    ("run_out", HINGE | {"radial": 1e-5}, "radial and tilt run-out of order 1 in phase with the joint is geometry"),
    ("run_out", HINGE | {"tilt": 1e-5, "axial": 1e-5}, "radial and tilt run-out of order 1 in phase with the joint is geometry"),
    ("run_out", HINGE | {"axial": 1e-5, "order": 1.5}, "order of run_out must be 1, 2, 3, …, got 1.5"),
    ("run_out", HINGE | {"axial": 1e-5, "phases": "two"}, "phases of run_out must be one or independent, got 'two'"),
    ("servo", HINGE, "servo needs stiffness:, or servo: with the name of a published one"),
    ("servo", HINGE | {"servo": "so101-elbow"}, "no published servo named 'so101-elbow'; did you mean 'so101-elbow_flex'"),
    ("servo", {"joint": "hinge", "stiffness": 0.0}, r"stiffness of servo\[hinge\] can become zero or negative"),
    ("servo", {"joint": "hinge", "stiffness": 1.0, "friction": -1.0}, r"friction of servo\[hinge\] can become negative"),
    ("servo", {"joint": "hinge", "stiffness": 1.0, "encoder": "both"}, "encoder of servo must be motor or joint, got 'both'"),
    ("transmission", HINGE | {"stiffness": (1.0, 2.0)}, "a limit torque between every two pieces of stiffness:, got 0 for 2"),
    ("transmission", HINGE | {"stiffness": (1.0, 2.0, 3.0), "limit_torques": (2.0, 1.0)}, "limit_torques .* positive and rise"),
    ("transmission", HINGE | {"stiffness": 1.0, "lost_motion": 1e-3}, "both of lost_motion: and rated_torque:"),
    ("transmission", HINGE | {"lost_motion": 1e-3, "rated_torque": 9.0, "lead_error": 1.0}, "needs one stiffness:, that beyond"),
    ("transmission", HINGE | {"stiffness": 1.0, "stiffness_factor": Uniform(1.0)}, "can reach -100 %, no stiffness at all"),
    ("transmission", HINGE | {"gear": "HFUC-32-100", "limit_torques": (9.0,)}, "limit_torques: .* need the stiffness: of their"),
    ("transmission", HINGE | {"gear": "XYZ"}, "no published gear named 'XYZ'; valid: HFUC-32-100"),
    ("transmission", HINGE | {"hysteresis_loss": -1e-4}, r"hysteresis_loss of transmission\[hinge\] can become negative"),
    ("force", {"at": "tool"}, "force needs one of force: and magnitude:, or moment:"),
    ("force", {"at": "tool", "force": (1.0, 0.0)}, "the force: of force has 2 numbers, expected 3"),
    ("force", {"at": "tool", "magnitude": 5.0}, "magnitude: of force needs direction: any; for a known direction give force:"),
    ("force", {"at": "base", "force": (1.0, 0.0, 0.0), "axes": "tool"}, "axes: tool needs a force on the link that carries"),
    ("force", {"at": "tool", "magnitude": Normal(5.0, mean=9.0), "direction": "any"}, "magnitude of .* can become negative"),
    ("payload", {"at": "tool", "mass": 1.0, "com": (0.0, 0.0)}, "com of a payload has 2 numbers, expected 3"),
    ("payload", {"at": "tool", "mass": Normal(0.4, mean=1.0)}, r"mass of payload\[tool\] can become negative"),
    ("payload", {"at": "tol", "mass": 1.0}, "no link named 'tol'; did you mean 'tool'"),
    ("strut", ENDS, "strut needs one of push: .*, free_length: with rate: .* and tension:"),
    ("strut", ENDS | {"push": 9.0, "tension": 9.0}, "strut needs one of push:"),
    ("strut", ENDS | {"push": 9.0, "rate": 9.0}, "a gas spring's rate: and at_length: of strut are given together"),
    ("strut", ENDS | {"tension": 9.0, "at_length": 1.0}, "a gas spring's rate: and at_length: of strut are given together"),
    ("strut", ENDS | {"free_length": 0.1}, "free_length: of strut needs rate:"),
    ("strut", ENDS | {"tension": 9.0, "rate": 9.0}, "tension: of strut is that of a cable, the same at every length"),
    ("strut", ENDS | {"tension": Normal(5.0, mean=9.0)}, r"tension of strut\[base-arm\] can become zero or negative"),
    ("strut", ENDS | {"free_length": 0.1, "rate": -1.0}, r"rate of strut\[base-arm\] can become negative"),
    ("strut", ENDS | {"push": 9.0, "to": StrutEnd(link="base")}, "both ends of strut are on the link 'base'"),
    ("strut", ENDS | {"push": 9.0, "to": StrutEnd(link="amr")}, "no link named 'amr'; did you mean 'arm'"),
    ("strut", ENDS | {"push": 9.0, "from_": StrutEnd(link="tool")}, "no joint of the chain lies between its ends"),
    ("strut", ENDS | {"push": 9.0, "to": "arm"}, "to of strut must be of type StrutEnd"),
    ("table", HINGE | {"file": "none.csv"}, r"none\.csv does not exist"),
    ("thermal", {"expansion": 1e-5}, "thermal needs temperature_change: or gradient:, or both"),
    ("thermal", {"expansion": 1e-5, "gradient": 1.0}, "thermal needs both of gradient: and across:"),
    ("thermal", {"link": "base", "expansion": 1e-5, "temperature_change": 1.0}, r"thermal\[base\]: the link has no length"),
    ("transmission", HINGE, "needs one of amplitude:, stiffness:, hysteresis_loss:, lead_error: and gear:"),
    ("transmission", HINGE | {"amplitude": (1e-3,)}, "one order: for each amplitude:, got 1 and 0"),
    ("transmission", HINGE | {"amplitude": (1e-3,), "order": (0.0,)}, "an order of transmission must be positive"),
    ("transmission", HINGE | {"amplitude": (1e-3,), "order": (1.0,), "period": 0.0}, "period of .* must be positive, got 0"),
    ("transmission", HINGE | {"stiffness": 1e3, "period": 1.0}, "period: of transmission is used only with amplitude:"),
    ("transmission", HINGE | {"lead_error": 1e-5}, r"transmission\[hinge\]: lead_error: is only for a prismatic joint"),
    ("transmission", HINGE | {"stiffness": Normal(200.0, mean=500.0)}, r"stiffness of \S+ can become zero or negative"),
    ("beam", ARM, "needs a stiffness"),
    ("beam", ARM | {"EI": 1.0, "EI_y": 1.0, "EI_z": 1.0}, "one of EI"),
    ("beam", ARM | {"EI_y": 1.0}, "both of EI_y"),
    ("beam", ARM | {"GI": 1.0, "torsion_stiffness": 1.0}, "one of GI"),
    ("beam", ARM | {"EI": 0.0}, "EI of a beam must be positive"),
    ("beam", ARM | {"axial_stiffness": 0.0}, "axial_stiffness of a beam must be positive"),
    ("beam", ARM | {"EI": 1.0, "wall": 0.002}, "wall need section:, one of tube, rod, box, general"),
    ("beam", ARM | {"EI": 1.0, "self_weight": "section"}, "self_weight: section needs section: with density: or material:"),
    ("beam", TUBE | {"section": "pipe"}, "no section named 'pipe'"),
    ("beam", TUBE | {"material": "stel"}, "no material named 'stel'; did you mean 'steel'"),
    ("beam", TUBE | {"wall": None}, "section tube lacks wall; it needs outer_diameter, wall"),
    ("beam", TUBE | {"diameter": 0.06}, "section tube has no diameter"),
    ("beam", TUBE | {"material": None}, "needs material:, one of steel,"),
    ("beam", TUBE | {"G": 8e10, "poisson_ratio": 0.3}, "one of G: and poisson_ratio:"),
    ("beam", TUBE | {"poisson_ratio": 0.6}, "must lie above -1, up to 0.5, got 0.6"),
    ("beam", TUBE | {"EI": 100.0}, "either section: or rigidities, not EI:"),
    ("beam", TUBE | {"bending_stiffness": 100.0}, "either section: or segments:, or bending_stiffness:"),
    ("beam", TUBE | {"density": 7000.0}, "density: is used only with self_weight: section"),
    ("beam", TUBE | {"self_weight": "none"}, "no self_weight named 'none'"),
    ("beam", TUBE | {"wall": Uniform(0.001, mean=0.0295)}, "thicker than half its outer_diameter"),
    ("beam", TUBE | {"wall": Normal(0.001, mean=0.002)}, r"wall of beam\[arm\] can become zero or negative"),
    ("beam", ARM | {"segments": (Segment(),)}, r"segments\[0\] needs a stiffness"),
    ("beam", PARTS | {"EI": 5.0}, "beam has segments:, so give EI in the segments"),
    ("beam", PARTS | {"axial_stiffness": 5.0}, "either section: or segments:, or axial_stiffness:"),
    ("beam", {"link": "base", "EI": 1.0}, "chain link 0 .* has no length, so it cannot bend"),
]  # fmt: skip
BOX = {"link": "arm", "section": "box", "width": 0.05, "height": 0.03, "wall": Fixed(0.016), "material": "steel"}
OTHERS = [
    ("hinge", "beam", BOX, r"wall of beam\[arm\] can become thicker than half its height"),
    ("slide", "bearing_stiffness", HINGE | {"axial": 5.0}, "the joint slides along its axis; joint_compliance"),
    ("slide", "clearance", PLAY | {"axial": 3e-6}, "hinge slides: give its play along the axis as backlash"),
    ("slide", "encoder", HINGE | {"offset": 1e-6, "period": 1e-3}, "both of amplitude: and period:"),
    ("slide", "encoder", HINGE | {"eccentricity": 1e-6, "radius": 0.02}, "are only for a revolute joint"),
    ("slide", "transmission", HINGE | {"gear": "TP010-MF-10"}, r"transmission\[hinge\]: gear: is only for a revolute joint"),
    ("slide", "servo", HINGE | {"servo": "sts3215"}, r"servo\[hinge\]: servo: is only for a revolute joint"),
    ("slide", "transmission", HINGE | {"amplitude": (1e-5,), "order": (1.0,)}, "needs period: with amplitude:"),
    ("arm", "mcpc", {"link": "link2", "gamma": 1e-3}, "gamma and z are parameters of the last link only"),
    ("arm", "frame", {"frame": "bracket", "x": 1e-3}, "'bracket' is not on the path from 'base' to 'tool'"),
    ("arm", "mounting", {"at": "tool", "flange": "half2", "x": 1e-3}, "not beyond the last joint, 'joint7'"),
    ("arm", "mounting", {"at": "tool", "flange": "link8", "x": 1e-3}, "no link named 'link8'"),
]  # fmt: skip


@pytest.mark.parametrize(("on", "kind", "settings", "message"), [*(("hinge", *row) for row in SETTINGS), *OTHERS])
def test_settings_that_make_no_source_are_refused_in_one_line(on, kind, settings, message):
    with pytest.raises(InputError, match=message) as caught:
        at_pose(on, kind, settings)
    assert "\n" not in str(caught.value)
    if "named" in message:
        assert isinstance(caught.value, UnknownNameError)


@pytest.mark.parametrize("settings", [{"length": 1.0, "fraction": 0.2}, {"length": 0.0}, {"fraction": -0.1}])
def test_a_segment_of_no_length_is_refused(settings):
    with pytest.raises(InputError, match=r"one of length: and fraction:|must be positive"):
        Segment(EI=1.0, **settings)


def test_bearings_nearer_than_numbers_tell_are_refused():
    """A slide 0.5 m out has its bearings at 0.5 m ± half the span."""
    play = catalogue()["clearance"](joint="hinge", diametral=(2e-5,), span=1e-14, direction="random", pads_on="child")
    assert np.isfinite(ErrorModel(chain("slide"), Space(), [play]).at([0.0]).jacobian).all()
    with pytest.raises(InputError, match=r"the span is too small: both bearings are at .* m along the axis"):
        ErrorModel(chain("slide"), Space(), [play]).at([0.5])


LINES = [
    ("mounting: {at: floor, x: 1 mm}", "at: .*'base' or 'tool'"),
    ("backlash: {joint: joint1, backlash: 1 deg, band: 3 N}", "'N' in '3 N' is not a unit of torque; allowed: N[*]m, N[*]mm"),
    ("backlash: {joint: rail, backlash: 1 mm}", "the key 'band' is missing"),
    ("backlash: {joint: rail, backlash: 1 mm, band: 1 N, scope: day}", "scope: input should be 'unit', 'pose' or 'visit'"),
    ("bearing_stiffness: {joint: joint1, axial: 1 N*m/rad}", "axial: .* is not a unit of linear stiff"),
    ("clearance: {joint: joint1, diametral: 0.03, span: 1 mm, band: 1 N}", "diametral: '0.03' has no unit"),
    ("clearance: {joint: trun, diametral: 1 um, span: 1 mm, band: 1 N}", "no joint on the chain named 'trun'"),
    ("covariance: {joint: joint1, std: [1 mm, 1 mm, 1 mm, 1 mm, 1 mrad, 1 mrad]}", "'mm' in '1 mm' is not a unit of angle"),
    ("covariance: {joint: joint1, std: [1 mm, 1 mm, 1 mm]}", "std: 3 numbers, expected 6"),
    ("covariance: {joint: joint1, std: 1 mm}", "std: expected a list of numbers"),
    ("covariance: {joint: joint1, correlation: 0.5}", "correlation: expected rows of numbers"),
    ("covariance: {joint: joint1, matrix: [[1, high]]}", "matrix.*'high'"),
    ("encoder: {joint: joint1, resolution: {uniform: 1 deg}}", "expected a plain quantity, not a law"),
    ("encoder: {joint: joint1, amplitude: 1 mrad, ratio: 1:100}", "ratio: .*'1:100'"),
    ("levelling: {rx: tilt}", "no parameter named 'tilt'"),
    ("levelling: {x: 1 deg}", "unknown key 'x'"),
    ("strut: {to: {link: link1}, push: 1 N}", "the key 'from' is missing"),
    ("strut: {from: base, to: {link: link1}, push: 1 N}", "from: expected keys with values, {link: …, point: …}"),
    ("strut: {from: {link: base}, push: 1 N}", "the key 'to' is missing: The other end B, `{link: …, point: …}`"),
    ("guide: {joint: joint1, EYX: 1 um, short_carriage: maybe}", "short_carriage: expected true or false"),
    ("strut: {from: {link: base, at: 1 mm}, to: {link: link1}, push: 1 N}", "unknown key 'at'"),
    ("strut: {from: {link: base, point: 1 2 mm}, to: {link: link1}, push: 1 N}", "point: of strut has 2 numbers, expected 3"),
    ("table: {joint: joint1, file: ''}", "file: expected the name of a file"),
    ("table: {joint: joint1, file: .}", "is not a regular file"),
    ("table: {joint: joint1, file: 'a\\0b'}", "cannot be read|does not exist"),
    ("thermal: {expansion: 12e-6, temperature_change: 1 K}", "'12e-6' has no unit; a thermal expansion needs one of"),
    ("transmission: {joint: joint1, amplitude: 1 mrad, order: {uniform: 1}}", "order"),
]  # fmt: skip


CELLS = [
    ("", r"gauge\.csv contains no rows of numbers"),
    ("x [mm], y [mm]\n1, 2\n\n3, 4, 5\n", r"gauge\.csv, line 4: 3 cells, but the header has 2"),
    ("x [mm], y [mm]\n1, 2\n3,\n", r"gauge\.csv, line 3: '' is not a number"),
    ('x [mm]\n"0,1"\n', r"gauge\.csv, line 2: '0,1' is not a number"),
    ("x [mm]; y [mm]\n0,1; 0.2\n", r"line 2: '0\.2' is not a number .* other numbers have a decimal comma"),
    ("x [mm], x [m]\n1, 2\n", r"gauge\.csv, line 1: two columns are named 'x'"),
    ("1, 2\n3, 4\n", r"gauge\.csv, line 1: the first row must name the columns and their units"),
    ("x [mm], rX [rad]\n1, 2\n", r"gauge\.csv: unknown column 'rX': did you mean 'rx'"),
    ("x, y [mm]\n1, 2\n", r"the column 'x' has no unit; write the unit of a length after its name: x \[m\]"),
    ("x [mrad]\n1\n", r"'mrad' of the column 'x' is not a unit of length; allowed: m, cm, mm"),
    ("rx [turn]\n1e308\n", r"the column 'rx' contains a number that is too large"),
    (b"x [mm]\n\xff\n", r"gauge\.csv is not UTF-8 text \(byte 7\)"),
]  # fmt: skip


TABLE = "table: {joint: joint1, file: gauge.csv}"


@pytest.mark.parametrize(
    ("line", "text", "message"), [*((line, "", found) for line, found in LINES), *((TABLE, *row) for row in CELLS)]
)
def test_a_bad_line_of_a_sheet_or_table_gives_one_line_at_the_source(tmp_path, line, text, message):
    (tmp_path / "gauge.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(SheetError, match=rf"arm\.errors\.yaml:6: error E_\w+: .*({message})") as caught:
        ErrorModel.load(written(tmp_path, line, sliding="rail" in line))
    (finding,) = caught.value.findings
    assert "\n" not in str(finding)
