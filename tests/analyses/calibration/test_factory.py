"""UR's factory calibration against Denavit-Hartenberg matrices, and as a URDF read by Pinocchio."""

import numpy as np
import pinocchio
import pytest
from scipy.spatial.transform import Rotation

import precision_pin as pp
from analyses.calibration.arms import paper_model
from precision_pin.robot.examples import example_urdfs, shipped_sheets
from precision_pin.robot.ur_kinematics import MODELS, nominal_ur, read_ur_calibration
from support.plain_robot import inserted, joint, link, robot
from support.refusals import check_refused

# of a UR5, as its owner published them: Δd of axes 2 to 4 up to 278 m
DELTAS = (
    (2.077509787e-05, 0.9682157156, -1.85685385, 0.8886479015, 5.661068149e-05, -7.463107641e-05),
    (0.00039362105, 0.1840933004, 0.144939533, -6.432974036e-05, 7.767090401e-06, 0),
    (4.002630978e-05, 278.2441449, -183.6955139, -94.54715137, 0.0003047826818, 0.0001237379414),
    (-0.0002716249442, 0.001258565055, -0.003220520707, 0.0006515301653, -0.0005870046572, 0),
)
FAR = "".join(f"{key} = [0, 0.1, 0, 0, 0, 0]\n" for key in ("delta_theta", "delta_a", "delta_d", "delta_alpha"))
NAMES = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")


def dh_matrix(theta, a, d, alpha):
    """Return the matrix of the textbooks, element by element."""
    ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    rows = [[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, d], [0, 0, 0, 1]]
    return np.array(rows)


def dh_flange(q):
    """Return the flange with the differences, by the product of six matrices."""
    d1, a2, a3, d4, d5, d6 = MODELS["UR5"]
    theta, a, d, alpha = (np.array(row) for row in DELTAS)
    a, d = a + np.array([0, a2, a3, 0, 0, 0]), d + np.array([d1, 0, 0, d4, d5, d6])
    alpha = alpha + np.array([1, 0, 0, 1, -1, 0]) * np.pi / 2
    result = np.eye(4)
    for k in range(6):
        result = result @ dh_matrix(q[k] + theta[k], a[k], d[k], alpha[k])
    return result


def write_conf(folder):
    rows = zip(("delta_theta", "delta_a", "delta_d", "delta_alpha"), DELTAS, strict=True)
    text = "[mounting]\n" + "".join(f"{name} = [{', '.join(map(repr, row))}]\n" for name, row in rows)
    path = folder / "calibration.conf"
    path.write_text(text + "joint_checksum = [0x1, 0x2]\n")
    return path


KEYS = ("x", "y", "z", "roll", "pitch", "yaw")


def write_frames(path, frames, order="xyz", more=""):
    """Write the YAML of the ROS driver: frames (4, 4), or places and angles as they are."""
    lines = ["kinematics:"]
    for name, frame in zip(NAMES, frames, strict=True):
        angles = Rotation.from_matrix(frame[:3, :3]).as_euler(order) if np.ndim(frame) == 2 else ()
        numbers = [*frame[:3, 3], *angles] if np.ndim(frame) == 2 else frame
        lines.append(f"  {name}: {{{', '.join(f'{key}: {float(x)!r}' for key, x in zip(KEYS, numbers, strict=True))}}}")
    path.write_text("\n".join([*lines, more]))
    return path


def urdf_of(kind, folder):
    """Return a URDF of a nominal model: the frames of the ROS driver's description, the axes all z."""
    joints = nominal_ur(kind).joints
    steps = [joints[0], *(np.linalg.inv(joints[k]) @ joints[k + 1] for k in range(5))]
    links = ["base", *(f"{name}_link" for name in NAMES), "tool0"]
    parts = [link(name) for name in links]
    for k, step in enumerate(steps):
        rpy = Rotation.from_matrix(step[:3, :3]).as_euler("xyz")
        parts.append(joint(f"{NAMES[k]}_joint", "revolute", links[k], links[k + 1], step[:3, 3], rpy))
    parts.append(joint("tool", "fixed", "wrist_3_link", "tool0"))
    path = folder / f"{kind}.urdf"
    path.write_text(robot(*parts).replace('name="arm"', 'name="ur"'))
    return path


def ur5(base="base", tip="tool0"):
    """Return the chain of another description, with other frames."""
    if "ur5" not in example_urdfs():
        pytest.skip("example-robot-data is not installed")
    return pp.Chain.from_urdf(example_urdfs()["ur5"], tip, base)


def tip_by_pinocchio(urdf, q):
    """Return tool0 in the frame ``base`` as Pinocchio has it."""
    model = pinocchio.buildModelFromUrdf(str(urdf))
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, q)
    base, tip = (data.oMf[model.getFrameId(name)] for name in ("base", "tool0"))
    return base.actInv(tip).homogeneous


@pytest.mark.parametrize(
    ("kind", "frames"),
    [
        ("UR3e", (0.15185, -0.24355, -0.2132, 0.13105, -0.08535, 0.0921)),
        ("UR10e", (0.1807, -0.6127, -0.57155, 0.17415, -0.11985, 0.11655)),
        ("UR30", (0.2363, -0.637, -0.5037, 0.201, -0.1593, 0.1543)),
    ],
)
def test_nominal_arms_are_those_of_the_drivers_description(kind, frames, tmp_path):
    """The frames that the ROS driver's description has of them, with its angles of ten digits."""
    z1, x3, x4, z4, y5, y6 = frames
    rows = [
        (0, 0, z1, 0, 0, 0), (0, 0, 0, 1.570796327, 0, 0), (x3, 0, 0, 0, 0, 0), (x4, 0, z4, 0, 0, 0),
        (0, y5, 0, 1.570796327, 0, 0), (0, y6, 0, 1.570796326589793, np.pi, np.pi),
    ]  # fmt: skip
    read = read_ur_calibration(write_frames(tmp_path / "kinematics.yaml", rows), kind)
    for q in np.random.default_rng(0).uniform(-3, 3, (5, 6)):
        np.testing.assert_allclose(nominal_ur(kind).pose(q), read.pose(q), rtol=0, atol=2e-9)


@pytest.mark.slow
def test_differences_of_parameters_make_the_arm_of_their_matrices(tmp_path):
    """As a model and as a URDF read by Pinocchio, to 1e-9 m; with frames of an older description."""
    conf, chain = write_conf(tmp_path), ur5()
    found = pp.ur_calibration(conf, chain)
    assert (found.kind, found.findings) == ("UR5", ())
    urdf = tmp_path / "built.urdf"
    found.to_urdf(urdf)
    assert np.abs(found.displacements[:, :3]).max() < 0.02
    for q in np.random.default_rng(0).uniform(-3, 3, (5, 6)):
        np.testing.assert_allclose(found.predict(q), dh_flange(q), rtol=0, atol=1e-9)
        np.testing.assert_allclose(tip_by_pinocchio(urdf, q), dh_flange(q), rtol=0, atol=1e-9)
    many = np.random.default_rng(0).uniform(-np.pi, np.pi, (200, 6))
    distances = [np.linalg.norm(dh_flange(q)[:3, 3] - nominal_ur("UR5").pose(q)[:3, 3]) for q in many]
    assert found.largest_position == pytest.approx(max(distances), abs=1e-9)
    assert 1e-3 < found.rms_position < found.largest_position
    # another base and tip move with their links
    other, q = pp.ur_calibration(conf, ur5("base_link", "ee_link")), np.arange(6) / 3
    turned = Rotation.from_euler("z", np.pi).apply(found.predict(q)[:3, 3])
    np.testing.assert_allclose(other.predict(q)[:3, 3], turned, atol=1e-9)
    # beside a sheet with means and spreads of the same dimensions too, whose base is turned as well
    beside = pp.ur_calibration(conf, pp.ErrorModel.load(shipped_sheets()["ur5"]))
    np.testing.assert_allclose(beside.predict(q)[:3, 3], turned, atol=1e-9)
    beside.to_urdf(urdf)
    np.testing.assert_allclose(tip_by_pinocchio(urdf, q), found.predict(q), rtol=0, atol=1e-9)


def test_what_the_factory_measured_leaves_the_sheet(tmp_path):
    """Means and spreads of the same dimensions go; what is drawn anew, what carries the arm and what it carries stay."""
    urdf = urdf_of("UR5", tmp_path)
    hand = link("hand") + joint("wrist", "fixed", "tool0", "hand", (0, 0, 0.2))
    urdf.write_text(urdf.read_text().replace("</robot>", f"{hand}</robot>"))
    chain, s = pp.Chain.from_urdf(urdf, "hand", "base"), pp.sources
    law, again = pp.Normal(1e-3, mean=2e-3), pp.Draw("again", pp.Normal(1e-4), pp.Scope.VISIT)
    measured = [
        s.Length(joint="upper_arm_joint", along="z of shoulder_joint", parameters=["d1", 1e-3]),
        s.Frame(joint="forearm_joint", z=2e-3, rx=law),
        s.Frame(frame="tool0", x=law),
        s.AxisInstall(joint="wrist_1_joint", radius=1e-3, span=0.1),
        s.Covariance(joint="wrist_2_joint", std=(1e-3,) * 6, mean=(1e-3,) * 6),
        s.JointOffset(joint="wrist_1_joint", offset=law),
        s.Mcpc(link="upper_arm_link", y=law),
    ]
    stays = [
        s.Frame(joint="wrist_3_joint", x=again, y=law),
        s.Encoder(joint="shoulder_joint", offset=law, amplitude=1e-3),
        s.Frame(frame="base", x=pp.Normal(2e-4)),
        s.Frame(frame="hand", y=pp.Normal(3e-4)),
    ]
    model = pp.ErrorModel(chain, pp.Space((pp.Draw("d1", law),)), measured + stays)
    built, q = pp.ur_calibration(write_conf(tmp_path), model), np.arange(6) / 3
    left = {draw.name for draw in built.model.space.draws}
    assert left == {"again", "encoder[shoulder_joint].phase", "frame[base].x", "frame[hand].y"}
    at, tip = built.model.at(q), (dh_flange(q) @ dh_matrix(0, 0, 0.2, 0))[:3, 3]
    np.testing.assert_allclose(built.predict(q)[:3, 3], tip, rtol=0, atol=1e-9)
    moved = at.exact(built.model.space.mean[:, None])[:3, 0]
    np.testing.assert_allclose(at.posture.pose[:3, 3] + moved, tip, rtol=0, atol=1e-9)


def test_the_yaml_of_the_ros_driver_is_read_as_urdf_readers_do(tmp_path):
    """The same robot by both files; a warning says by how much the other reading of the angles differs."""
    chain = pp.Chain.from_urdf(urdf_of("UR5", tmp_path), "tool0", "base")
    found = pp.ur_calibration(write_conf(tmp_path), chain)
    # the frames of the calibrated arm, each axis near its nominal place
    places = [chain.placements[k] @ inserted(found.displacements[k].copy()) for k in range(5)]
    places.append(np.linalg.inv(np.linalg.multi_dot(places)) @ found.predict(np.zeros(6)))
    more = "  hash: calib_12788084448423163542\n"
    found = pp.ur_calibration(write_frames(tmp_path / "kinematics.yaml", places, more=more), chain)
    assert found.checksum == "calib_12788084448423163542"
    for q in np.random.default_rng(0).uniform(-3, 3, (5, 6)):
        np.testing.assert_allclose(found.predict(q), dh_flange(q), rtol=0, atol=1e-9)
    (finding,) = found.findings
    assert finding.code == "W_FACTORY_ANGLES"


# of a UR10e whose second joint starts beyond 90 degrees, from the documentation of ur_calibration
BEYOND = (
    (-2.414780689e-07, 1.602339524, -1.686071908, 0.08373311477, -1.012603559e-07, 3.919862092e-08),
    (2.122348656e-05, 0.01931713263, -0.5692516636, -4.614090237e-05, -6.392800535e-05, 0),
    (0.1805398117, 439.1409741, -446.0270598, 7.060336896, 0.1198113412, 0.1156709173),
    (1.57014608, 0.001394166668, 0.006938188803, 1.569984685, -1.570385206, 0),
)


def extracted(*, folded):
    """Return the frames that ``ur_calibration`` makes of parameters: arms drawn in along their axes, then six steps."""
    theta, a, d, alpha = (list(row) for row in BEYOND)
    moves = []
    for k in range(6):
        moves += [dh_matrix(theta[k], 0, d[k], 0), dh_matrix(0, a[k], 0, alpha[k])]
    for k in (1, 2):
        start = moves[2 * k] @ moves[2 * k + 1]
        way = (start @ moves[2 * k + 2])[:3, 3] - start[:3, 3]
        way /= np.linalg.norm(way)
        along = -start[2, 3] / way[2]
        x, y, _ = start[:3, 3] + along * way
        turn = np.arctan(y / x) if folded else np.arctan2(y, x) - np.pi
        moves[2 * k] = dh_matrix(turn, 0, 0, 0)
        bent = dh_matrix(theta[k] - turn, 0, 0, alpha[k])
        bent[:3, 3] = -np.hypot(x, y), 0, 0
        moves[2 * k + 1] = bent
        moves[2 * k + 2][2, 3] -= along * np.sign(way[2])
    return [moves[0], *(moves[k] @ moves[k + 1] for k in range(1, 11, 2))]


@pytest.mark.parametrize("written", ["folded", "frames turned"])
def test_a_half_turned_elbow_is_the_same_robot(written, tmp_path):
    """The tool's arctangent of y/x turns the forearm back, which is undone and said; turned frames alone change nothing."""
    steps = extracted(folded=written == "folded")
    half = dh_matrix(np.pi, 0, 0, 0)
    if written == "frames turned":
        steps[2], steps[3] = steps[2] @ half, half @ steps[3]
    # stretched, the tip is 1.18 m from the shoulder, folded 0.04 m
    assert (abs(np.linalg.multi_dot(steps)[0, 3]) < 0.1) == (written == "folded")
    path = write_frames(tmp_path / "kinematics.yaml", steps, "XYZ" if written == "folded" else "xyz")
    found = pp.ur_calibration(path, pp.Chain.from_urdf(urdf_of("UR10e", tmp_path), "tool0", "base"))
    codes = [finding.code for finding in found.findings]
    assert codes == ["W_FACTORY_FOLDED" if written == "folded" else "W_FACTORY_ANGLES"]
    for q in np.random.default_rng(0).uniform(-3, 3, (20, 6)):
        matrices = [dh_matrix(q[k] + BEYOND[0][k], *(row[k] for row in BEYOND[1:])) for k in range(6)]
        np.testing.assert_allclose(found.predict(q), np.linalg.multi_dot(matrices), rtol=0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")
def test_the_file_of_another_model_is_refused_by_name(tmp_path):
    """Each model's own file is taken, and refused for the nearest other one, with the right name.

    Every frame is off by some tenths of a millimetre and of a milliradian: the tip of such a robot is 1 to 8 mm from the
    nominal one's, as those of robots that their maker has measured are.
    """
    chains = {kind: pp.Chain.from_urdf(urdf_of(kind, tmp_path), "tool0", "base") for kind in MODELS}
    kinds = list(MODELS)
    for rank, kind in enumerate(kinds):
        frames = [np.eye(4), *nominal_ur(kind).joints[:5], nominal_ur(kind).flange]
        off = np.random.default_rng(rank).normal(0, [5e-4] * 3 + [1e-3] * 3, (6, 6))
        steps = [np.linalg.inv(frames[k]) @ frames[k + 1] @ inserted(off[k]) for k in range(6)]
        path = write_frames(tmp_path / f"{kind}.yaml", steps)
        assert 1e-3 < pp.ur_calibration(path, chains[kind]).largest_position < 15e-3
        # a UR3 is nearest to a UR3e, three on, and so on
        other = kinds[(rank + 3) % len(kinds)]
        message = f"this is the calibration of a {kind}, not of a {other}:"
        check_refused((message, pp.ur_calibration, path, chains[other]))


def test_wrong_files_are_refused_in_one_line(tmp_path):
    chain = pp.Chain.from_urdf(urdf_of("UR3", tmp_path), "tool0", "base")
    for text, message in (
        ("nothing: 1\n", "this is no factory calibration"),
        ("delta_theta = [1, 2]\n", "delta_theta needs six numbers"),
        ("delta_theta = [0, 0, 0, 0, 0, 0]\n", "delta_a = .six numbers. is missing"),
        ("kinematics: {shoulder: {x: 0, y: 0}}\n", "shoulder needs the numbers x, y, z, roll, pitch, yaw"),
        (FAR, "the file is of another"),
    ):
        (tmp_path / "wrong").write_text(text)
        check_refused((rf"^[^\n]*{message}[^\n]*$", pp.ur_calibration, tmp_path / "wrong", chain))
    check_refused(("is none of UR3, UR5", pp.ur_calibration, write_conf(tmp_path), paper_model().chain))
