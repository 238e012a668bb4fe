"""The scripts of ``examples/``: each is short, asks a question, stands in the gallery and prints a right answer."""

import ast
import contextlib
import math
import re
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import precision_pin as pp
from docs import gallery
from precision_pin import cli
from precision_pin.robot.examples import ROBOTS, resolve_robot

ROOT = Path(__file__).parents[2]
SCRIPTS = {path.stem: path for path in sorted((ROOT / "examples").iterdir()) if path.suffix == ".py"}
QUICK = {
    *("how_far_does_each_joint_move_the_tool", "how_precise_is_my_own_design", "what_do_measured_parts_change"),
    *("what_does_one_sided_approach_gain", "what_is_wrong_with_my_sheet"),
}
CHECKS: dict[str, tuple[str, Callable[..., None]]] = {}
"""What each script prints, with a group for each number, and the check of these numbers."""


def answers(*lines: str):
    def register(check):
        CHECKS[check.__name__] = ("\n".join(lines) + "\n", check)
        return check

    return register


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name not in QUICK)) for name in SCRIPTS]
)
def test_every_script_prints_a_right_answer(name, tmp_path, monkeypatch):
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda _, path: Path(path).touch())
    monkeypatch.setattr("subprocess.run", lambda words, **_: run_command(words, monkeypatch))
    printed = gallery.run(SCRIPTS[name], tmp_path)
    pattern, check = CHECKS[name]
    found = re.fullmatch(pattern, printed)
    assert found, printed
    monkeypatch.chdir(tmp_path)
    check(*(float(text) if re.fullmatch(r"[-+\d.e]+", text) else text for text in found.groups()))
    drawn = "savefig" in SCRIPTS[name].read_text(encoding="utf-8")
    assert [path.name for path in tmp_path.glob("*.png")] == [f"{name}.png"] * drawn


def run_command(words, monkeypatch):
    """Run a command of the package in this process, which takes two seconds less than another."""
    assert words[:3] == [sys.executable, "-m", "precision_pin"]
    monkeypatch.setattr(sys, "argv", ["precision-pin", *words[3:]])
    with pytest.raises(SystemExit) as end, contextlib.redirect_stdout(None):
        cli.main()
    assert not end.value.code


def test_every_script_is_short_and_asks_a_question_that_the_gallery_lists():
    page = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    assert sorted(gallery.ENTRY.findall(page)) == list(SCRIPTS)
    assert len(SCRIPTS) >= 15
    for name, path in SCRIPTS.items():
        text = path.read_text(encoding="utf-8")
        assert len(text.splitlines()) <= 40, name
        assert gallery.question(path).endswith("?"), name
        modules = {
            alias.name if isinstance(node, ast.Import) else node.module
            for node in ast.walk(ast.parse(text))
            if isinstance(node, ast.Import | ast.ImportFrom)
            for alias in node.names
        }
        assert modules <= {"precision_pin", "numpy", "matplotlib.pyplot", "pathlib", "subprocess", "sys"}, name


def model_of(name):
    return pp.ErrorModel.load(ROBOTS / f"{name}.errors.yaml")


def levers_of(urdf, frame, degrees):
    """Return the displacement of a frame for each radian of each joint, ``(3, n)``, by Pinocchio."""
    arm = pin.buildModelFromUrdf(str(resolve_robot(urdf)))
    data, q = arm.createData(), np.radians(degrees)
    return pin.computeFrameJacobian(arm, data, q, arm.getFrameId(frame), pin.LOCAL_WORLD_ALIGNED)[:3]


# --- how large is the error? ---


@answers(
    r"median ([\d.]+) mm",
    r"95 of 100 arms within ([\d.]+) mm \(([\d.]+) to ([\d.]+) mm\)",
    r"within 2 mm: (\d+)% of the arms, not met",
)
def how_far_off_is_the_tool(median, within, low, high, percent):
    at = model_of("ur5").at("ready")
    normal = np.random.default_rng(0).multivariate_normal(at.error_at_means[:3], at.covariance[:3, :3], 200_000)
    error = 1e3 * np.linalg.norm(normal, axis=1)
    assert np.allclose([median, within], np.quantile(error, [0.5, 0.95]), rtol=0.03)
    assert low < within < high
    assert abs(percent - 100 * np.mean(error < 2)) < 2


@answers(
    *(
        rf"{name}: sags by ([\d.]+) µm, and the rails add a standard deviation of ([\d.]+) µm"
        for name in ("middle", "end")
    )
)
def how_straight_does_a_gantry_move(*printed):
    """A beam on two supports, and harmonics of half a tolerance: two heights, and the roll of the bridge on its way."""
    rigidity = 210e9 * (0.12**4 - 0.108**4) / 12
    for y, sag, std in zip((0.6, 0.0), printed[::2], printed[1::2], strict=True):
        before, behind = 0.1 + y, 1.3 - y
        assert sag == pytest.approx(1e6 * 60 * 9.80665 * (before * behind) ** 2 / (3 * rigidity * 1.4), abs=0.06)
        assert std == pytest.approx(np.sqrt((4**2 + 3**2 + (10 * y) ** 2) / 2), abs=0.06)


@answers(*(rf"{pose}: typically ([\d.]+) mm, 95 % within ([\d.]+) mm" for pose in ("stretched", "bent")))
def how_precise_is_my_own_design(*printed):
    """By the trigonometry of two bars."""
    rng = np.random.default_rng(1)
    first, second = np.radians(rng.uniform(-0.1, 0.1, (2, 200_000)))
    upper, fore = np.array([[0.3], [0.2]]) + rng.uniform(-1e-4, 1e-4, (2, 200_000))
    expected = []
    for bend in (0, np.pi / 2):
        tool = upper * np.exp(1j * first) + fore * np.exp(1j * (first + bend + second))
        expected += [*np.quantile(1e3 * abs(tool - 0.3 - 0.2 * np.exp(1j * bend)), [0.5, 0.95])]
    assert np.allclose(printed, expected, rtol=0.02, atol=0.005)


@answers(
    r"arm.errors.yaml:6: error E_NAME: .+'joint_1'; did you mean 'joint1'.+",
    r"arm.errors.yaml:7: error E_SHEET: parameters: '0.25' has no unit; .+",
    r"arm.errors.yaml:8: error E_UNKNOWN_KEY: .+'axis_instal': did you mean 'axis_install'\?",
)
def what_is_wrong_with_my_sheet():
    pass


@answers(
    r"no arm is farther off than ([\d.]+) mm",
    r"the worst of 1000 arms is off by ([\d.]+) mm",
    r"([\d.]+) mm are the sag of every arm; the largest shares of the rest:",
    *[r"  ([\d.]+) mm of axis_install\[joint\d\]\.[AB], at .+"] * 3,
)
def how_bad_can_it_get(worst, seen, sag, *shares):
    assert sag < seen < worst
    assert list(shares) == sorted(shares, reverse=True)


@answers(
    r"yes: ([\d.e-]+) of the arms miss it \(([\d.e-]+) to ([\d.e-]+)\)",
    *[
        rf"  {method}: ([\d.e+-]+) from [\d,]+ arms"
        for method in ("sampling", "importance sampling", "subset simulation")
    ],
    r"first cause: axis_install\[joint2\]\.A, \d+%",
)
def how_rare_is_a_miss(probability, low, high, *estimates):
    law = pp.exact_law(model_of("4dof"), "paper", samples=1000).poses[0].laws["position.x"].law
    assert low <= 1 - law.cumulative(np.array([18.5e-3]))[0] <= high  # at the other end nothing is left
    assert low <= probability == estimates[1] <= high
    assert estimates[0] == 0


@answers(
    *(rf"{which} at x = (\S+) m, y = (\S+) m: 95 % of the arms within ([\d.]+) mm" for which in ("worst", "best")),
    r"(\d+) of 153 places are out of reach",
)
def where_is_the_arm_least_precise(x, y, worst, best_x, best_y, best, unreachable):
    assert math.hypot(best_x, best_y) < 0.4 < 0.7 < math.hypot(x, y) < 0.9
    assert unreachable == 2  # the corners, 0.9 m off
    model = model_of("ur5")
    for place, printed in (([x, y, 0.2], worst), ([best_x, best_y, 0.2], best)):
        q = pp.place_grid(model.chain, place, pp.Orientation.along((0, 0, -1))).q[:, 0]
        sampled = pp.monte_carlo(model, q, samples=20_000, seed=3).position.norm.quantile(0.95)
        assert math.isclose(printed, 1e3 * sampled, rel_tol=0.03)


@answers(
    r"within 4 mm on the whole seam: ([\d.]+)% of the arms, met",
    r"95 % quantile at the worst place alone: ([\d.]+) mm",
    r"95 % quantile of the largest error on the way: ([\d.]+) mm",
)
def does_the_tool_stay_on_its_path(percent, alone, largest):
    assert (percent < 95) is (largest > 4)
    assert alone <= largest < 1.1 * alone


@answers(
    r"95 % of the arms are within ([\d.]+) mm of the taught place",
    *[r" *(\d+) mm from there: within ([\d.]+) mm .+"] * 6,
)
def how_exact_is_a_short_move(absolute, *moves):
    distance, error = np.reshape(moves, (6, 2)).T
    assert all(nearer < farther for nearer, farther in pairwise(error))
    assert error[-1] < absolute
    assert np.allclose(
        error[:3] / distance[:3], error[3] / distance[3], rtol=0.25
    )  # rotations and scales, to first order


@answers(
    r"in base axes: 95 % within ([\d.]+) mm",
    r"against the camera: 95 % within ([\d.]+) mm",
    r"as if another robot had found the part: 95 % within ([\d.]+) mm",
)
def how_exact_is_a_pick_by_camera(base, camera, independent):
    # 200,000 robots that each solved the calibration by least squares, in another program
    assert [base, camera, independent] == pytest.approx([2.317, 1.107, 3.300], abs=0.03)


# --- what causes it? ---


@answers(
    *[r".+: arrives ([-+\d.]+) mm or ([-+\d.]+) mm from its height, by the direction of its joints"] * 2,
)
def how_far_does_a_cheap_arm_droop(*heights):
    # the balance of servo, friction and weight, iterated with Pinocchio's torques at the joint values where the arm rests
    stiffness, friction = np.array([48.94, 51.34, 18.57, 43.03, 47.14]), np.array([0.215, 0.318, 0.402, 0.296, 0.283])
    arm = pp.Chain.from_urdf("example:so101", tip="gripper_frame_link").with_payload(0.3)
    q, expected = np.radians([0.0, 76.0, -73.8, -5.0, 0.0]), []
    for share, side in ((0.0, 1), (0.0, -1), (0.8, 1), (0.8, -1)):
        turned = np.zeros(5)
        for _ in range(200):
            load = arm.at(q + turned).load_torque - share * arm.at(q).load_torque
            turned = (load - side * friction) / stiffness
        expected.append(1e3 * (arm.at(q + turned).pose[2, 3] - arm.at(q).pose[2, 3]))
    assert heights == pytest.approx(expected, abs=0.06)


@answers(
    *[
        r".+ \(σ [\d.]+ mm?r?a?d?\): (\d+)% of the variance\n"
        r"  halved, the 95 % quantile changes by ([-+][\d.]+) ± ([\d.]+) mm"
    ]
    * 3
)
def which_tolerance_first(*printed):
    at = model_of("ur5").at("ready")
    variances = (at.jacobian[:3] ** 2).sum(axis=0) * np.diag(at.space.covariance)
    largest = 100 * np.sort(variances)[:-4:-1] / variances.sum()
    share, change, half_width = np.reshape(printed, (3, 3)).T
    assert np.allclose(share, largest, atol=0.6)
    assert change[0] + half_width[0] < 0


@answers(r"elbow_joint causes (\d+)% of the variance of the position", r"the links between the joints together (\d+)%")
def which_joint_costs_most(joint, links):
    """In this sheet all that is of a joint has its name in brackets, but for the end of the forearm and the tool."""
    at = model_of("ur10e").at()
    variances = (at.jacobian[:3] ** 2).sum(axis=0) * np.diag(at.space.covariance)
    shares = [
        100 * sum(variances[k] for k, name in enumerate(at.space.components) if place in name) / variances.sum()
        for place in ("[elbow_joint]", "[forearm_end]", "[tool0]")
    ]
    assert np.allclose([joint, links], [shares[0], sum(shares[1:])], rtol=0, atol=1)


@answers(
    "mm per mrad        ready stretched",
    *(rf"{joint} +([\d.]+) +([\d.]+)" for joint in ("shoulder_pan", "shoulder_lift", "elbow")),
    *(rf"{joint} +([\d.]+) +([\d.]+)" for joint in ("wrist_1", "wrist_2", "wrist_3")),
)
def how_far_does_each_joint_move_the_tool(*printed):
    for pose, degrees in enumerate(((0, -90, 90, -90, -90, 0), (0, -10, 20, -100, -90, 0))):
        levers = np.linalg.norm(levers_of("example:ur5e", "tool0", degrees), axis=0)
        assert np.allclose(printed[pose::2], levers, rtol=0, atol=5.1e-4)


@answers(r"its own weight bends it by ([\d.]+) mm, each kilogram by ([\d.]+) mm more")
def how_far_does_a_load_bend_the_arm(weight, slope):
    """By Castigliano's theorem: the integral of the squared moments of a unit load over the rigidities."""
    arm = pin.buildModelFromUrdf(str(resolve_robot("example:4dof")))
    data = arm.createData()
    pin.framesForwardKinematics(arm, data, np.zeros(4))
    shoulder, elbow, wrist = (data.oMi[joint].translation[0] for joint in (2, 3, 4))
    tool, side, _ = data.oMf[arm.getFrameId("tool")].translation
    gives = 1e-5 * (tool - shoulder) ** 2
    for start, end, bending, torsion in ((shoulder, elbow, 80e3, 60e3), (elbow, wrist, 40e3, 30e3)):
        gives += ((tool - start) ** 3 - (tool - end) ** 3) / 3 / bending + side**2 * (end - start) / torsion
    assert math.isclose(slope, 1e3 * 9.81 * gives, rel_tol=0.003)
    assert weight > slope


@answers(*(rf"{pose}: ([\d.]+) mm at 40 °C" for pose in ("ready", "stretched", "folded")))
def how_far_does_a_warm_arm_drift(*printed):
    """Aluminium grows by 23 ppm for each kelvin, all links alike: so does the way from base to tool."""
    model = model_of("ur5")
    reach = [np.linalg.norm(model.at(pose).posture.pose[:3, 3]) for pose in model.poses]
    assert np.allclose(printed, 1e3 * 23e-6 * 20 * np.array(reach), rtol=0.03, atol=0.005)


@answers(*(f"{pose}: {', '.join(['([0-9.]+)'] * 5)} mm" for pose in ("straight", "folded")))
def do_correlated_errors_add_up(*printed):
    ties = np.array([-0.9, -0.5, 0, 0.5, 0.9])
    assert np.allclose(printed, 0.1 * np.sqrt(2 + 2 * np.array([*ties, *-ties])), rtol=0, atol=6e-4)


@answers(
    *(
        rf"as {which}: the arm is longer by (-?\d+) um on average, with a spread of (\d+) um"
        for which in ("drawn", "measured")
    )
)
def what_do_measured_parts_change(drawn_mean, drawn_spread, mean, spread):
    both = np.loadtxt("tubes.csv", delimiter=",", skiprows=1).sum(axis=1)
    assert abs(drawn_mean) <= 2
    assert math.isclose(drawn_spread, 1e3 * 0.1 * math.sqrt(2 / 3), rel_tol=0.02)
    assert math.isclose(mean, 1e3 * both.mean(), abs_tol=1.5)
    assert math.isclose(spread, 1e3 * both.std(), rel_tol=0.03)


# --- what helps? ---


@answers(
    r"better bearings: 95 % quantile ([-+][\d.]+) mm \(([-+][\d.]+) to ([-+][\d.]+)\)",
    r"finer lengths: .+, no difference that can be told",
    r"40 mm kept by: better bearings",
)
def which_of_two_designs_is_better(change, low, high):
    model = model_of("4dof")
    finer = model.with_({"axis_install[*].radius": "0.05 mm"})
    rng, laws = np.random.default_rng(2), [arm.at("paper") for arm in (model, finer)]
    quantiles = [
        np.quantile(
            np.linalg.norm(rng.multivariate_normal(at.error_at_means[:3], at.covariance[:3, :3], 100_000), axis=1), 0.95
        )
        for at in laws
    ]
    assert low < change < high
    assert math.isclose(change, 1e3 * (quantiles[1] - quantiles[0]), abs_tol=0.1)


@answers(
    *(rf"joint{k}: ±([\d.]+) mm instead of ±0.1 mm, cost (\d+)" for k in range(1, 5)),
    r"together (\d+) instead of (\d+): met",
)
def which_tolerances_are_cheapest(*printed):
    radii, costs = printed[:8:2], printed[1:8:2]
    assert np.allclose(costs, 1 / np.array(radii), rtol=0.05)
    assert np.allclose(printed[8:], [sum(costs), 4 / 0.1], atol=2)
    model = model_of("4dof")
    chosen = {f"axis_install[joint{k}].radius": f"{radius} mm" for k, radius in enumerate(radii, start=1)}
    assert pp.monte_carlo(model.with_(chosen), samples=50_000, seed=9).position.norm.quantile(0.95) < 37.55e-3


@answers(
    r"the tool sags by ([\d.]+) mm; with the joint values below by 0.0 um",
    *[r"  joint\d: +([-\d.]+)° -> +([-\d.]+)°"] * 4,
    r"95 % of the arms are then within ([\d.]+) mm instead of ([\d.]+) mm",
)
def what_makes_up_for_sag(sag, *printed):
    model, corrected = model_of("4dof"), np.radians(printed[1:8:2])
    assert sag == 36.8  # docs/errata.md
    tool = model.chain.at(corrected).pose[:3, 3] + model.at(corrected).error_at_means[:3]
    assert np.allclose(tool, model.chain.at(model.configuration("paper")).pose[:3, 3], rtol=0, atol=1e-4)
    assert printed[-2] < sag < printed[-1]


@answers(
    r"62 postures: the drill gives way by ([\d.]+) to ([\d.]+) mm",
    *[
        rf"walks {name} at ([\d.]+) m: ([\d.]+) mm, gives way ([\d.]+) mm; 95 % within ([\d.]+) mm"
        for name in ("least", "most")
    ],
)
def in_which_pose_should_a_robot_drill(low, high, *printed):
    # J diag(1/k) Jᵀ F with Pinocchio's Jacobian, in the postures of another search at the two places
    arm, soft = pp.Chain.from_urdf("example:ur10", tip="tool0"), 1 / np.array([67e3, 67e3, 67e3, 10e3, 10e3, 10e3])
    factors = np.random.default_rng(3).uniform(0.8, 1.2, (6, 20_000))
    for reach, walk, give, within in np.reshape(printed, (2, 4)):
        place = np.diag([1.0, -1.0, -1.0, 1.0])
        place[:3, 3] = reach, 0.0, 0.3
        shifts, tops = [], []
        for q in pp.inverse_kinematics(arm, place).q.T:
            jacobian = levers_of("example:ur10", "tool0", np.degrees(q))
            parts = 1e3 * jacobian * (soft * jacobian[2] * 300.0)
            shifts.append(parts.sum(axis=1))
            tops.append(np.quantile(np.linalg.norm(parts @ factors, axis=0), 0.95))
        walks = np.hypot(*np.transpose(shifts)[:2])
        one = int(np.argmin(np.abs(walks - walk)))
        assert [walks[one], shifts[one][2], tops[one]] == pytest.approx([walk, give, within], abs=0.02)
        assert low - 0.01 <= give <= high


@answers(
    r"repeatability from one side: ([\d.]+) mm",
    r"from both sides: ([\d.]+) mm",
    r"the two sides are apart by ([\d.]+) mm",
)
def what_does_one_sided_approach_gain(one, both, apart):
    levers = levers_of("example:4dof", "tool", (-90, 3, 88, -91))
    gap = levers[:, :2] @ np.radians(np.array([3, 2]) / 60)
    assert math.isclose(apart, 1e3 * np.linalg.norm(gap), rel_tol=0.02)
    assert both > apart / 2 > one


@answers(*(rf"ur5e\.unit000{k}\.urdf: tool off by ([\d.]+) mm" for k in range(3)))
def can_a_simulator_use_built_arms(*printed):
    rows = np.genfromtxt("built/units.csv", delimiter=",", names=True)
    expected = 1e3 * np.linalg.norm([rows[name] for name in rows.dtype.names[2:5]], axis=0)
    assert np.allclose(printed, expected, rtol=0, atol=0.006)


# --- what do measurements tell? ---


@answers(
    r"measure candidates( \d+){8}",
    r"error before ([\d.]+) mm, after (\d+) um",
    r"after eight poses at random (\d+) um",
)
def which_poses_should_be_measured(_, before, after, at_random):
    assert before == 36.9
    assert 1 < after < at_random < 100


@answers(
    r"the readings and the sheet: agrees; the calibration helps",
    r"error at new poses ([\d.]+) mm before, (\d+) um after",
    *(rf"{name}: (-?\d+) to (-?\d+) um, built with (-?\d+) um" for name in ("a2", "a4")),
)
def what_did_the_calibration_find(before, after, *printed):
    assert before > 1
    assert 20 < after < 60  # a tracker's noise of 20 um in each of x, y, z, and what is left of the arm
    for low, high, truth in np.reshape(printed, (2, 3)):
        assert low < truth < high
        assert -250 <= low < high <= 250


@answers(*(rf"{name}: median arm ([\d.]+) mm, 90 % of the arms ([\d.]+) to ([\d.]+) mm" for name in ("AP", "RP")))
def what_will_iso_9283_show(accuracy, _, accuracy_high, repeatability, low, high):
    at = model_of("ur5").at("ready")
    normal = np.random.default_rng(0).multivariate_normal(at.error_at_means[:3], at.covariance[:3, :3], 100_000)
    error = 1e3 * np.linalg.norm(normal, axis=1)
    assert np.allclose([accuracy, accuracy_high], np.quantile(error, [0.5, 0.95]), rtol=0.08)
    assert 0.03 < low < repeatability < high < 0.1  # as docs/questions.md and the data sheet have it


# --- can it be trusted? ---


@answers(*(r"to (0.0[52]) mm: ([\d,]+) arms, 95 % within ([\d.]+) to ([\d.]+) mm" for _ in range(2)))
def how_many_samples_are_enough(*printed):
    for width, _, low, high in (printed[:4], printed[4:]):
        assert (high - low) / 2 <= width
    assert int(printed[1].replace(",", "")) < int(printed[5].replace(",", ""))


@answers(
    *[r"[\d.]+% quantile: +([\d.]+) um, of the samples +(-?[\d.]+) um"] * 3,
    r"beyond 0.39 mm: ([\d.e-]+), of the samples 0e\+00",
)
def does_sampling_agree(*printed):
    """By the law of Irwin and Hall: beyond 4 t - x the sum of four has the probability (x/2t)⁴/4!."""
    exact, sampled = np.reshape(printed[:6], (3, 2)).T
    assert np.allclose(exact, sampled, rtol=0, atol=1.5)
    assert math.isclose(printed[6], 0.05**4 / 24, rel_tol=5e-3)
    assert math.isclose(exact[2], 400 - 200 * (24 * 0.0027) ** 0.25, rel_tol=1e-3)


@answers(*[r"±([\d.]+)°: mean moved by ([\d.]+) mm, spread ([\d.]+) mm"] * 5)
def is_first_order_enough(*printed):
    """A uniform angle ± a turns a lever r, which stays on average at r sin(a)/a."""
    lever = np.linalg.norm(levers_of("example:4dof", "tool", (0, 0, 0, 0))[:, 0])
    for degrees, moved, spread in np.reshape(printed, (5, 3)):
        a = math.radians(degrees)
        assert math.isclose(moved, 1e3 * lever * (1 - math.sin(a) / a), rel_tol=0.002, abs_tol=6e-4)
        assert math.isclose(spread, 1e3 * lever * a / math.sqrt(3), rel_tol=0.002, abs_tol=0.06)
