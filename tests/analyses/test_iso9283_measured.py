"""Measured cycles beside the forecast: the level of the test, what it notices, the file, wrong files in a line."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

import precision_pin as pp
from precision_pin.analyses.iso9283.figures import read_cycles
from precision_pin.analyses.iso9283.result import pose_names
from precision_pin.analyses.iso9283.table import iso9283_table, verdict
from precision_pin.sources import JointOffset
from sampling.cases import MODEL

CHAIN = MODEL.chain
JOINTS = CHAIN.joint_names
CYCLES = 6
Q = np.random.default_rng(5).uniform(-0.6, 0.6, (len(JOINTS), 4)) + MODEL.configuration()[:, None]


def arm(visits: float = 1e-4) -> pp.ErrorModel:
    """Return the arm with joint offsets of a milliradian of each robot, and others at each visit."""
    draws = [pp.Draw(f"built{k}", pp.Normal(1e-3)) for k in range(3)]
    draws += [pp.Draw(f"again{k}", pp.Uniform(visits), pp.Scope.VISIT) for k in range(3)]
    sources = [JointOffset(joint=JOINTS[k % 3], offset=draw.name) for k, draw in enumerate(draws)]
    return pp.ErrorModel(CHAIN, pp.Space(tuple(draws)), sources)


def measure(model: pp.ErrorModel, robots: int, seed: int) -> list[dict[str, np.ndarray]]:
    """Return the attained poses of robots by the plain model."""
    attained = np.empty((robots, Q.shape[1], CYCLES, 4, 4))
    for p, q in enumerate(Q.T):
        at = model.at(q)
        for visit in range(CYCLES):
            errors = at.exact(model.space.sample(seed, 0, robots, pose=p, visit=visit))
            attained[:, p, visit] = at.posture.pose
            attained[:, p, visit, :3, 3] += errors[:3].T
            attained[:, p, visit, :3, :3] = (
                Rotation.from_rotvec(errors[3:].T).as_matrix() @ attained[:, p, visit, :3, :3]
            )
    return [{f"P{p + 1}": of_pose for p, of_pose in enumerate(of_robot)} for of_robot in attained]


@pytest.fixture(scope="module")
def forecast():
    return pp.iso9283(arm(), list(Q.T), cycles=CYCLES, robots=400, seed=1)


@pytest.mark.slow
def test_robots_of_the_sheet_differ_once_in_twenty(forecast):
    """The share of alarms among robots built as the sheet says is that of the test, exactly: a binomial number."""
    found = [forecast.compare(robot).measured.probability for robot in measure(arm(), 200, seed=2)]
    alarms = sum(p <= 0.05 for p in found)
    assert stats.binom.cdf(alarms, 200, 0.05) > 1e-3
    assert stats.binom.sf(alarms - 1, 200, 0.05) > 1e-3
    assert stats.kstest(found, "uniform").pvalue > 1e-3


def test_a_robot_whose_joints_come_back_worse_differs_in_repeatability(forecast):
    measured = forecast.compare(measure(arm(visits=3e-4), 1, seed=3)[0]).measured
    assert measured.agrees is False
    assert measured.probability == pytest.approx(1 / 401)
    assert {one.name for one in measured.differing} <= {"RP", "RP_a", "RP_b", "RP_c", "RD"}
    assert measured.figure("P2", "RP").below == 1
    assert "DIFFERS" in verdict(measured)
    assert "AP" not in verdict(measured)


def test_a_robot_better_than_the_sheet_says_differs_too(forecast):
    measured = forecast.compare(measure(arm(visits=1e-5), 1, seed=3)[0]).measured
    assert measured.agrees is False
    assert measured.figure("P2", "RP").below == 0


def test_figures_are_those_of_the_cycles(forecast):
    robot = measure(arm(), 1, seed=4)[0]
    found = forecast.compare(robot)
    one = pp.iso9283_of(forecast.poses["P3"].commanded, robot["P3"])
    assert found.measured.poses["P3"] == one
    figure = found.measured.figure("P3", "RP")
    assert figure.value == one.RP
    assert figure.below == np.mean(forecast.poses["P3"].RP.values <= one.RP)
    assert found.to_dict()["measured"]["poses"]["P3"]["RP"] == one.RP
    assert forecast.measured is None
    pair = [forecast.poses[pose].commanded for pose in ("P2", "P4")]
    assert found.measured.distance == pp.iso9283_distance(pair, [robot["P2"], robot["P4"]])


def test_positions_alone_and_some_poses_are_enough(forecast):
    robot = measure(arm(), 1, seed=4)[0]
    found = forecast.compare({"P2": robot["P2"][:, :3, 3], "3": robot["P3"][:, :3, 3]}).measured
    assert {one.name for one in found.figures} == {"AP", "AP_x", "AP_y", "AP_z", "RP"}
    assert {one.pose for one in found.figures} == {"P2", "P3"}
    assert found.distance is None
    assert "AGREES" in verdict(found)


def test_too_few_robots_to_judge():
    few = pp.iso9283(arm(), list(Q.T), cycles=CYCLES, robots=15)
    found = few.compare(measure(arm(), 1, seed=4)[0]).measured
    assert found.agrees is None
    assert "too few to judge" in verdict(found)


@pytest.mark.slow
def test_a_measuring_system_elsewhere_needs_the_fit():
    """The best fit takes out where the measuring system stands; without it every position is far off."""
    robot = measure(arm(), 1, seed=4)[0]
    turn = Rotation.from_rotvec([0.2, -0.1, 2.0]).as_matrix()
    elsewhere = {}
    for pose, values in robot.items():
        elsewhere[pose] = np.tile(np.eye(4), (CYCLES, 1, 1))
        elsewhere[pose][:, :3, :3] = turn @ values[:, :3, :3]
        elsewhere[pose][:, :3, 3] = values[:, :3, 3] @ turn.T + [3.0, -1.0, 0.5]
    fitted = pp.iso9283(arm(), list(Q.T), cycles=CYCLES, robots=400, fit_base=True)
    here, there = (fitted.compare(one).measured for one in (robot, elsewhere))
    for one, other in zip(here.figures, there.figures, strict=True):
        assert one.value == pytest.approx(other.value, abs=1e-9), one
    assert there.agrees
    assert not pp.iso9283(arm(), list(Q.T), cycles=CYCLES, robots=400).compare(elsewhere).measured.agrees
    with pytest.raises(pp.InputError, match="needs the cycles of all 4 poses, got 1"):
        fitted.compare({"P1": robot["P1"]})


def test_the_table_has_the_verdict_and_every_measured_pose(forecast):
    found = forecast.compare(measure(arm(visits=3e-4), 1, seed=3)[0])
    lines = iso9283_table(found).splitlines()
    assert lines[0].startswith("95 % of robots built will show RP of ")
    assert lines[2].startswith("measured: DIFFERS")
    assert {"P1", "P2", "P3", "P4"} <= {line.split()[0] for line in lines if line}


@pytest.mark.parametrize(
    ("attained", "message"),
    [
        ({}, "are of no pose"),
        ({"P9": np.zeros((CYCLES, 3))}, "no pose of the forecast named 'P9'"),
        ({"P1": np.zeros((CYCLES, 6))}, r"positions \(n, 3\) or poses \(n, 4, 4\)"),
        ({"P1": np.zeros((30, 3))}, "are 30, the forecast has 6 cycles"),
        (np.zeros((CYCLES, 3)), "must be a dictionary"),
    ],
)
def test_wrong_cycles_are_refused_in_a_line(forecast, attained, message):
    with pytest.raises(pp.InputError, match=message):
        forecast.compare(attained)


# the file ------------------------------------------------------------------------------------------------------------

NAMES = pose_names(("home", "", "out"))


def test_names_of_poses():
    assert NAMES == {"1": "P1", "2": "P2", "3": "P3", "P1": "P1", "P2": "P2", "P3": "P3", "home": "P1", "out": "P3"}


def test_a_file_of_positions_and_angles(tmp_path):
    file = tmp_path / "cycles.csv"
    file.write_text(
        "# laser tracker\npose, cycle, x [mm], y [m], z [mm], a [deg], b [mrad], c [rad]\n"
        "out, 2, 1, 2, 3, 0, 0, 0.5\nhome, 1, 4, 5, 6, 90, 0, 0\nout, 1, 7, 8, 9, 0, 100, 0\nP1, 2, 10, 11, 12, 0, 0, 0\n"
    )
    found = read_cycles(file, NAMES)
    assert list(found) == ["P3", "P1"]
    np.testing.assert_allclose(found["P3"][:, :3, 3], [[7e-3, 8, 9e-3], [1e-3, 2, 3e-3]])
    np.testing.assert_allclose(found["P1"][0, :3, :3], [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-15)
    np.testing.assert_allclose(found["P3"][0, :3, :3], Rotation.from_rotvec([0, 0.1, 0]).as_matrix(), atol=1e-15)


def test_a_file_of_rotation_vectors_and_of_positions_alone(tmp_path):
    file = tmp_path / "cycles.csv"
    file.write_text("pose,cycle,x [mm],y [mm],z [mm],rx [mrad],ry [mrad],rz [mrad]\n1,1,0,0,0,300,-200,100\n")
    turn = Rotation.from_rotvec([0.3, -0.2, 0.1]).as_matrix()
    np.testing.assert_allclose(read_cycles(file, NAMES)["P1"][0, :3, :3], turn, atol=1e-15)
    file.write_text("cycle,z [mm],y [mm],x [mm],pose\n1,1,2,3,2\n")
    np.testing.assert_allclose(read_cycles(file, NAMES)["P2"], [[3e-3, 2e-3, 1e-3]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("pose,cycle,x [mm],y [mm]\nP1,1,0,0\n", "no column in .* named 'z'"),
        ("cycle,x [mm],y [mm],z [mm]\n1,0,0,0\n", "no column in .* named 'pose'"),
        ("pose,x [mm],y [mm],z [mm]\nP1,0,0,0\n", "no column in .* named 'cycle'"),
        ("pose,cycle,x,y [mm],z [mm]\nP1,1,0,0,0\n", "the column 'x' has no unit"),
        ("pose,cycle,x [deg],y [mm],z [mm]\nP1,1,0,0,0\n", "'deg' of the column 'x' is not a unit of length"),
        ("pose,cycle,x [mm],y [mm],z [mm],w [mm]\nP1,1,0,0,0,0\n", "the column 'w' has no meaning"),
        ("pose,cycle,x [mm],y [mm],z [mm],a [deg],rx [deg]\nP1,1,0,0,0,0,0\n", "exclude each other"),
        ("pose,cycle,x [mm],y [mm],z [mm],a [deg]\nP1,1,0,0,0,0\n", "no column in .* named 'b'"),
        ("pose,cycle,x [mm],y [mm],z [mm]\nP7,1,0,0,0\n", "no pose in .* named 'P7'"),
        ("pose,cycle,x [mm],y [mm],z [mm]\nP1,1,0,0,0\nhome,1,0,0,0\n", "'home' has the cycle 1 twice"),
        ("pose,cycle,x [mm],y [mm],z [mm]\nP1,1,0,0,0\nP2,2,0,0,0\n", "every pose needs the same cycles"),
        ("pose,cycle,x [mm],y [mm],z [mm]\nP1,1,0,zero,0\n", "line 2: 'zero' is not a number"),
        ("pose,cycle,x [mm],y [mm],z [mm]\nP1,1,0,0\n", "line 2: 4 cells, but the header has 5"),
        ("", "contains no rows of numbers"),
    ],
)
def test_a_wrong_file_is_refused_in_a_line(tmp_path, text, message):
    file = tmp_path / "cycles.csv"
    file.write_text(text)
    with pytest.raises(pp.InputError, match=message) as caught:
        read_cycles(file, NAMES)
    assert "\n" not in str(caught.value)
