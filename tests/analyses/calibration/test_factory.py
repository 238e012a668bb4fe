"""UR's factory calibration against Denavit-Hartenberg matrices, and as a URDF read by Pinocchio."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from scipy.spatial.transform import Rotation

import precision_pin as pp
from analyses.calibration.arms import paper_model
from precision_pin.robot.chain import Chain
from precision_pin.robot.examples import example_urdfs
from precision_pin.robot.ur_kinematics import MODELS, nominal_ur, read_ur_calibration
from precision_pin.sources import JointOffset
from support.plain_robot import inserted, joint, link, robot

# of a UR5 and a UR3, as their owners published them: Δd of axes 2 to 4 up to 278 m
DELTAS = {
    "UR5": (
        (2.07750978653505926e-05, 0.96821571555565844, -1.85685385014877657, 0.888647901450376643, 5.66106814887767484e-05,
         -7.46310764096455082e-05),
        (0.000393621049984383038, 0.184093300397451837, 0.14493953300732923, -6.43297403642304399e-05, 7.76709040084077299e-06,
         0),
        (4.00263097760228392e-05, 278.244144925623573, -183.695513914913732, -94.5471513669751289, 0.000304782681775556119,
         0.000123737941387466743),
        (-0.000271624944216508624, 0.00125856505456124258, -0.00322052070697146503, 0.00065153016530383745,
         -0.00058700465721117645, 0),
    ),
    "UR3": (
        (9.14361764983717684e-08, 0.178461025123001604, 6.68283349819805572, -0.578116982609792496, 6.11299818305960363e-06,
         -5.03926212855332345e-07),
        (-0.000243788991999517813, 0.00381165418642351317, 0.034503078453104935, 0.000107694612896758047,
         -0.000198736633205663144, 0),
        (9.225352853908797e-05, 12.0620003757611567, 17.6719025641737275, -29.7339960369544869, -2.8164617795367608e-05,
         0.000217420471082099831),
        (0.00115615746589403656, 0.0035851898103369975, 0.00392132336586574568, 0.000406668888106365145, -0.00201170396009153762,
         0),
    ),
}  # fmt: skip
FAR = "".join(f"{key} = [0, 0.1, 0, 0, 0, 0]\n" for key in ("delta_theta", "delta_a", "delta_d", "delta_alpha"))
NAMES = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")


def dh_matrix(theta: float, a: float, d: float, alpha: float) -> np.ndarray:
    """Return the matrix of the textbooks, element by element."""
    ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    rows = [[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, d], [0, 0, 0, 1]]
    return np.array(rows)


def dh_flange(kind: str, q: np.ndarray) -> np.ndarray:
    """Return the flange with the differences, by the product of six matrices."""
    d1, a2, a3, d4, d5, d6 = MODELS[kind]
    theta, a, d, alpha = (np.array(row) for row in DELTAS[kind])
    a, d = a + np.array([0, a2, a3, 0, 0, 0]), d + np.array([d1, 0, 0, d4, d5, d6])
    alpha = alpha + np.array([1, 0, 0, 1, -1, 0]) * np.pi / 2
    result = np.eye(4)
    for k in range(6):
        result = result @ dh_matrix(q[k] + theta[k], a[k], d[k], alpha[k])
    return result


def write_conf(folder: Path, kind: str) -> Path:
    rows = zip(("delta_theta", "delta_a", "delta_d", "delta_alpha"), DELTAS[kind], strict=True)
    text = "[mounting]\n" + "".join(f"{name} = [{', '.join(map(repr, row))}]\n" for name, row in rows)
    path = folder / "calibration.conf"
    path.write_text(text + "joint_checksum = [0x1, 0x2]\n")
    return path


KEYS = ("x", "y", "z", "roll", "pitch", "yaw")


def write_frames(path: Path, frames: Iterable[np.ndarray], order: str = "xyz", more: str = "") -> Path:
    """Write the YAML of the ROS driver: frames (4, 4), or places and angles as they are."""
    lines = ["kinematics:"]
    for name, frame in zip(NAMES, frames, strict=True):
        angles = Rotation.from_matrix(frame[:3, :3]).as_euler(order) if np.ndim(frame) == 2 else ()
        numbers = [*frame[:3, 3], *angles] if np.ndim(frame) == 2 else frame
        lines.append(f"  {name}: {{{', '.join(f'{key}: {float(x)!r}' for key, x in zip(KEYS, numbers, strict=True))}}}")
    path.write_text("\n".join([*lines, more]))
    return path


def urdf_of(kind: str, folder: Path) -> Path:
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


def chain_of(kind: str, folder: Path, base: str = "base", tip: str = "tool0") -> Chain:
    if kind == "UR5" and "ur5" not in example_urdfs():
        pytest.skip("example-robot-data is not installed")
    return Chain.from_urdf(example_urdfs()["ur5"] if kind == "UR5" else urdf_of(kind, folder), tip, base)


def tip_by_pinocchio(urdf: Path, q: np.ndarray) -> np.ndarray:
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
def test_nominal_arms_are_those_of_the_drivers_description(
    kind: str, frames: tuple[float, ...], tmp_path: Path
) -> None:
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
@pytest.mark.parametrize("kind", ["UR5", "UR3"])
def test_differences_of_parameters_make_the_arm_of_their_matrices(kind: str, tmp_path: Path) -> None:
    """As a model and as a URDF read by Pinocchio, to 1e-9 m; of a UR5 with frames of an older description."""
    conf = write_conf(tmp_path, kind)
    found = pp.ur_calibration(conf, chain_of(kind, tmp_path))
    assert found.kind == kind
    assert found.findings == ()
    urdf = tmp_path / "built.urdf"
    found.to_urdf(urdf)
    assert np.abs(found.displacements[:, :3]).max() < 0.02
    for q in np.random.default_rng(0).uniform(-3, 3, (5, 6)):
        expected = dh_flange(kind, q)
        np.testing.assert_allclose(found.predict(q), expected, rtol=0, atol=1e-9)
        np.testing.assert_allclose(tip_by_pinocchio(urdf, q), expected, rtol=0, atol=1e-9)
    many = np.random.default_rng(0).uniform(-np.pi, np.pi, (200, 6))
    distances = [np.linalg.norm(dh_flange(kind, q)[:3, 3] - nominal_ur(kind).pose(q)[:3, 3]) for q in many]
    assert found.largest_position == pytest.approx(max(distances), abs=1e-9)
    assert 1e-3 < found.rms_position < found.largest_position
    if kind == "UR5":
        # another base and tip move with their links
        other, q = pp.ur_calibration(conf, chain_of(kind, tmp_path, "base_link", "ee_link")), np.arange(6) / 3
        turned = Rotation.from_euler("z", np.pi).apply(found.predict(q)[:3, 3])
        np.testing.assert_allclose(other.predict(q)[:3, 3], turned, atol=1e-9)
    else:
        # sources of a model stay beside it
        chain = chain_of(kind, tmp_path)
        offset = JointOffset(joint=chain.joint_names[2], offset=pp.Normal(1e-4))
        model = pp.ErrorModel(chain, pp.Space(), [offset])
        assert pp.ur_calibration(conf, model).model.space.components == model.space.components


def test_the_yaml_of_the_ros_driver_is_read_as_urdf_readers_do(tmp_path: Path) -> None:
    """The same robot by both files; a warning says by how much the other reading of the angles differs."""
    chain = chain_of("UR3", tmp_path)
    found = pp.ur_calibration(write_conf(tmp_path, "UR3"), chain)
    # the frames of the calibrated arm, each axis near its nominal place
    places = [chain.placements[k] @ inserted(found.displacements[k].copy()) for k in range(5)]
    places.append(np.linalg.inv(np.linalg.multi_dot(places)) @ found.predict(np.zeros(6)))
    more = "  hash: calib_12788084448423163542\n"
    found = pp.ur_calibration(write_frames(tmp_path / "kinematics.yaml", places, more=more), chain)
    assert found.checksum == "calib_12788084448423163542"
    for q in np.random.default_rng(0).uniform(-3, 3, (5, 6)):
        np.testing.assert_allclose(found.predict(q), dh_flange("UR3", q), rtol=0, atol=1e-9)
    (finding,) = found.findings
    assert finding.code == "W_FACTORY_ANGLES"


# of a UR10e whose second joint starts beyond 90 degrees, from the documentation of ur_calibration
BEYOND = (
    (-2.4147806894359e-07, 1.60233952386695, -1.68607190752171, 0.0837331147700119, -1.01260355871158e-07,
     3.91986209186124e-08),
    (2.12234865571206e-05, 0.0193171326277006, -0.569251663611088, -4.61409023720934e-05, -6.39280053471802e-05, 0.0),
    (0.180539811714259, 439.140974079901, -446.027059806332, 7.0603368964236, 0.119811341150314, 0.115670917257426),
    (1.57014608044242, 0.0013941666682559, 0.00693818880325995, 1.56998468543761, -1.57038520649543, 0.0),
)  # fmt: skip


def extracted(*, folded: bool) -> list[np.ndarray]:
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
def test_a_half_turned_elbow_is_the_same_robot(written: str, tmp_path: Path) -> None:
    """The tool's arctangent of y/x turns the forearm back, which is undone and said; turned frames alone change nothing."""
    steps = extracted(folded=written == "folded")
    half = dh_matrix(np.pi, 0, 0, 0)
    if written == "frames turned":
        steps[2], steps[3] = steps[2] @ half, half @ steps[3]
    # stretched, the tip is 1.18 m from the shoulder, folded 0.04 m
    assert (abs(np.linalg.multi_dot(steps)[0, 3]) < 0.1) == (written == "folded")
    path = write_frames(tmp_path / "kinematics.yaml", steps, "XYZ" if written == "folded" else "xyz")
    found = pp.ur_calibration(path, chain_of("UR10e", tmp_path))
    codes = [finding.code for finding in found.findings]
    assert codes == ["W_FACTORY_FOLDED" if written == "folded" else "W_FACTORY_ANGLES"]
    for q in np.random.default_rng(0).uniform(-3, 3, (20, 6)):
        matrices = [dh_matrix(q[k] + BEYOND[0][k], *(row[k] for row in BEYOND[1:])) for k in range(6)]
        np.testing.assert_allclose(found.predict(q), np.linalg.multi_dot(matrices), rtol=0, atol=1e-9)


def perturbed_yaml(folder: Path, kind: str, seed: int) -> Path:
    """Return the YAML of a robot of a model: every frame off by some tenths of a millimetre and of a milliradian.

    The tip of such a robot is 1 to 8 mm from the nominal one's, as those of robots that their maker has measured are.
    """
    frames = [np.eye(4), *nominal_ur(kind).joints[:5], nominal_ur(kind).flange]
    rng, steps = np.random.default_rng(seed), []
    for before, frame in itertools.pairwise(frames):
        off = np.concatenate([rng.normal(0, 5e-4, 3), rng.normal(0, 1e-3, 3)])
        steps.append(np.linalg.inv(before) @ frame @ inserted(off))
    return write_frames(folder / f"{kind}-{seed}.yaml", steps)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")
def test_the_file_of_another_model_is_refused_by_name(tmp_path: Path) -> None:
    """Each model's own file is taken, and refused for the nearest other one, with the right name."""
    chains = {kind: Chain.from_urdf(urdf_of(kind, tmp_path), "tool0", "base") for kind in MODELS}
    kinds = list(MODELS)
    for rank, kind in enumerate(kinds):
        path = perturbed_yaml(tmp_path, kind, rank)
        assert 1e-3 < pp.ur_calibration(path, chains[kind]).largest_position < 15e-3
        # a UR3 is nearest to a UR3e, three on, and so on
        other = kinds[(rank + 3) % len(kinds)]
        with pytest.raises(pp.InputError, match=f"this is the calibration of a {kind}, not of a {other}:"):
            pp.ur_calibration(path, chains[other])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nothing: 1\n", "this is no factory calibration"),
        ("delta_theta = [1, 2]\n", "delta_theta needs six numbers"),
        ("delta_theta = [0, 0, 0, 0, 0, 0]\n", "delta_a = .six numbers. is missing"),
        ("kinematics: {shoulder: {x: 0, y: 0}}\n", "shoulder needs the numbers x, y, z, roll, pitch, yaw"),
        (FAR, "the file is of another"),
    ],
)
def test_wrong_files_are_refused_in_one_line(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "wrong").write_text(text)
    with pytest.raises(pp.InputError, match=message) as caught:
        pp.ur_calibration(tmp_path / "wrong", chain_of("UR3", tmp_path))
    assert "\n" not in str(caught.value)
    with pytest.raises(pp.InputError, match="is none of UR3, UR5"):
        pp.ur_calibration(write_conf(tmp_path, "UR5"), paper_model().chain)
