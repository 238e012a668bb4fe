"""As-built URDFs: read again by three readers and compared with the exact model; nothing else in the file changes."""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import precision_pin as pp
from precision_pin.base.errors import InternalError
from precision_pin.robot import urdf
from precision_pin.robot.examples import example_urdfs
from precision_pin.robot.urdf.editing import Placement, UrdfText
from precision_pin.sources.axis_install import AxisInstall
from precision_pin.sources.backlash import Backlash
from precision_pin.sources.encoder import Encoder
from precision_pin.sources.frame import Frame
from precision_pin.sources.joint_compliance import JointCompliance
from precision_pin.sources.joint_offset import JointOffset
from precision_pin.sources.length import Length
from precision_pin.sources.mcpc import Mcpc
from precision_pin.sources.mounting import Mounting
from precision_pin.sources.transmission import Transmission
from precision_pin.writers.as_built import AsBuilt, frozen_sources
from support.plain_robot import PlainRobot, joint, link, pose_error, random_arm, robot
from support.sheets import everything

CLOSE = 1e-12
COMMENT = re.compile(rb"<!--\s+As-built robot.*?-->\r?\n|\r?\n<!--\s+As-built robot.*?-->", re.DOTALL)


def written_file(folder: Path, text: str) -> Path:
    path = folder / "arm.urdf"
    path.write_bytes(text.encode())
    return path


def plain_model(folder: Path, text: str, *sources, tip: str | None = None, **more) -> pp.ErrorModel:
    return pp.ErrorModel(pp.Chain.from_urdf(written_file(folder, text), tip), pp.Space(), sources, **more)


def one_unit(model: pp.ErrorModel, q, *unit: int, **more):
    """Return what writes units of a model at a pose, and one of them."""
    writer = AsBuilt.prepare(model, q, **more)
    (built,) = writer.units(*(unit or (5, 3)), 1)
    return writer, built


def every_geometric(chain: pp.Chain) -> list:
    """Errors at every kind of place: ends, seats, named frames, base, tool, custom places, joint values."""
    names = chain.joint_names
    last = chain.joints[-1].child
    # whose URDF frame turns with the link between the first two joints: that of the joint whose child it is in the file
    carrier = names[1] if chain.reversed_joints[1] else names[0]
    sources = [
        Mounting(at="base", x=pp.Normal(1e-3), ry=pp.Normal(2e-3)),
        Mounting(at="tool", y=pp.Normal(1e-3), rx=pp.Normal(2e-3)),
        Length(joint=names[1], along=f"x of {carrier}", parameters=(pp.Uniform(1e-3),)),
        Mcpc(link=last, alpha=pp.Uniform(1e-3), gamma=pp.Uniform(2e-3), z=pp.Uniform(1e-3)),
        Mcpc(link=chain.joints[0].child, beta=pp.Uniform(1e-3), x=pp.Normal(5e-4)),
    ]
    for name in names:
        sources += [
            AxisInstall(joint=name, radius=2e-4, span=0.1, start=0.02),
            Frame(joint=name, z=pp.Normal(5e-4), rx=pp.Uniform(2e-3), rz=pp.Uniform(2e-3)),
            JointOffset(joint=name, offset=pp.Uniform(2e-3)),
        ]
    for name, where in chain.link_frames.items():
        is_named = name not in (chain.base, chain.tip) and not name.endswith(("_reversed", "_origin"))
        if where.path_rank is not None and is_named:
            sources.append(Frame(frame=name, x=pp.Uniform(1e-3), rz=pp.Normal(1e-3)))
    return sources


def poses_of(chain: pp.Chain, count: int = 4) -> np.ndarray:
    return np.random.default_rng(8).uniform(-2.5, 2.5, (count, len(chain.joints)))


# --- two readers, and a third written for the tests ---


def by_us(text: bytes, base: str, tip: str, values: dict[str, float]) -> np.ndarray:
    # by Pinocchio, through our reading
    chain = pp.Chain.from_robot(urdf.parse(text, "as_built.urdf"), tip, base)
    off = {name: value for name, value in values.items() if name not in chain.joint_names}
    chain = pp.Chain.from_robot(urdf.parse(text, "as_built.urdf"), tip, base, locked=off) if off else chain
    return chain.at({name: values[name] for name in chain.joint_names}).pose


def by_pinocchio(text: bytes, base: str, tip: str, values: dict[str, float]) -> np.ndarray:
    model = pinocchio.buildModelFromXML(text.decode())
    q = pinocchio.neutral(model)
    for name, value in values.items():
        entry = model.joints[model.getJointId(name)]
        q[entry.idx_q : entry.idx_q + entry.nq] = [value] if entry.nq == 1 else [np.cos(value), np.sin(value)]
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, q)
    base_pose, tip_pose = (data.oMf[model.getFrameId(name, pinocchio.FrameType.BODY)] for name in (base, tip))
    return (base_pose.inverse() * tip_pose).homogeneous


def by_hand(text: bytes, base: str, tip: str, values: dict[str, float]) -> np.ndarray:
    return PlainRobot.parse(text.decode()).poses(values, base)[tip]


READERS = [by_us, by_pinocchio, by_hand]


def assert_reproduced(model: pp.ErrorModel, writer: AsBuilt, built, poses: np.ndarray, readers=READERS, unit=3, seed=5):
    """Compare a written unit with the exact model of the same numbers at poses ``(P, n)``."""
    x = model.space.sample(seed, unit, 1)
    chain = model.chain
    for q in poses:
        at = model.at(q)
        nominal, expected = at.posture.pose, at.exact(x)[:, 0]
        values = {**chain.locked, **dict(zip(chain.joint_names, map(float, q), strict=True))}
        for reader in readers:
            actual = pose_error(reader(built.text, writer.base, writer.tip, values), nominal)
            assert_allclose(actual, expected, rtol=0, atol=CLOSE, err_msg=reader.__name__)


# --- geometry at every pose ---


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*W_JOINT_LIMIT")
@pytest.mark.parametrize(("name", "tip", "base"), [("panda", "panda_hand_tcp", None), ("xarm7", "link7", "link_base")])
def test_geometric_errors_of_known_arms_are_reproduced_at_every_pose_by_origins_alone(name, tip, base):
    path = example_urdfs()[name]
    chain = pp.Chain.from_urdf(path, tip, base)
    model = pp.ErrorModel(chain, pp.Space(), every_geometric(chain))
    poses = poses_of(chain)
    writer, built = one_unit(model, poses[0])
    assert np.linalg.norm(built.error[:3]) > 1e-4
    assert_reproduced(model, writer, built, poses)
    # what the strict reader had to say about the file, it says of the written one, and nothing more
    codes = {finding.code for finding in urdf.parse(built.text, "as_built.urdf").findings}
    assert codes - {finding.code for finding in urdf.check(path)} == ({"W_BRANCHED"} if name == "xarm7" else set())
    before, after = path.read_bytes().splitlines(), COMMENT.sub(b"", built.text, count=1).splitlines()
    if name == "xarm7":  # the tip is the last joint's own link
        assert after[-3].startswith(b'  <link name="link7_as_built"/>')
        assert after[-2].startswith(b'  <joint name="link7_as_built_joint" type="fixed"><origin xyz="')
        after[-3:-1] = []
    changed = [(old, new) for old, new in zip(before, after, strict=True) if old != new]
    assert 0 < len(changed) <= len(urdf.read(path).path(chain.base, tip))
    number = rb'"[0-9.e+ -]+"'
    for old, new in changed:
        assert re.sub(number, b"", old) == re.sub(number, b"", new)
        assert b"<origin " in new


@pytest.mark.slow
@pytest.mark.parametrize(
    ("base", "tip", "locked", "ends"),
    [
        # the frame at the tip moves with a chain joint or with one held still
        ("base", "link7", {}, ("base", "link7_as_built")),
        ("base", "tool", {"joint3": 0.7, "joint4": -0.2}, ("base", "tool")),
        # the base is not the root: backwards only, up and down again
        ("link6", "base", {}, ("link6_as_built", "base")),
        ("tool", "bracket", {"joint4": 0.4}, ("tool", "bracket")),
        ("bracket", "finger", {}, ("bracket", "finger_as_built")),
    ],
)
def test_geometric_errors_with_other_bases_and_tips(tmp_path, base, tip, locked, ends):
    path = written_file(tmp_path, random_arm(61, prismatic=(4,)))
    chain = pp.Chain.from_urdf(path, tip, base, locked=locked)
    model = pp.ErrorModel(chain, pp.Space(), every_geometric(chain))
    poses = poses_of(chain)
    writer, built = one_unit(model, poses[0])
    assert (writer.base, writer.tip) == ends
    assert_reproduced(model, writer, built, poses, readers=[by_pinocchio, by_hand])
    # only what lies between base and tip is placed anew
    changed = changed_joints(path, built.text)
    way = {step.name for step in urdf.read(path).path("base", base) + urdf.read(path).path("base", tip)}
    assert changed
    assert changed <= way


def origins_of(text: bytes) -> dict[str, tuple[str | None, str | None] | None]:
    found = ((node.get("name"), node.find("origin")) for node in ElementTree.fromstring(text).findall("joint"))
    return {name: None if origin is None else (origin.get("xyz"), origin.get("rpy")) for name, origin in found}


def changed_joints(path: Path, after: bytes) -> set[str]:
    old, new = origins_of(path.read_bytes()), origins_of(after)
    return {name for name in old if old[name] != new[name]}


def split_arm() -> str:
    """One turning joint, then three fixed ones in a row, the second of them without an origin."""
    return robot(
        *map(link, ("base", "arm", "cover", "plate", "tool", "lamp")),
        joint("turn", "revolute", "base", "arm", (0, 0, 0.3), (0.1, 0.2, 0.3), (0, 1, 0)),
        joint("screws", "fixed", "arm", "cover", (0.4, 0, 0), (0.5, 0, 0)),
        '<joint name="glue" type="fixed"><parent link="cover"/><child link="plate"/></joint>',
        joint("clamp", "fixed", "plate", "tool", (0, 0, 0.1)),
        joint("pin", "fixed", "cover", "lamp", (0, 0.2, 0)),
    )


@pytest.mark.parametrize(
    ("source", "moved"),
    [
        (Frame(joint="turn", x=1e-3), "turn"),
        (JointOffset(joint="turn", offset=1e-3), "turn"),
        # a named frame moves itself, one that a joint moves takes along all beyond it
        (Frame(frame="arm", x=1e-3), "screws"),
        (Frame(frame="cover", x=1e-3), "screws"),
        (Frame(frame="plate", x=1e-3), "glue"),
        (Frame(link="cover", x=1e-3), "clamp"),
        (Frame(frame="tool", x=1e-3), "clamp"),
        (Mounting(at="base", rx=1e-3), "turn"),
    ],
)
def test_a_displacement_goes_into_the_joint_that_leads_to_its_place(tmp_path, source, moved):
    model = plain_model(tmp_path, split_arm(), source, tip="tool")
    writer, built = one_unit(model, [0.4], 0, 0)
    assert changed_joints(tmp_path / "arm.urdf", built.text) == {moved}
    assert_reproduced(model, writer, built, np.array([[0.4], [-1.1]]))


def test_values_by_hand(tmp_path):
    # the joint turns about y: an offset of 0.25 rad is a pitch of 0.25 rad at its origin, whose position stays as written
    text = robot(
        *map(link, ("base", "arm", "tool")),
        joint("turn", "revolute", "base", "arm", (0, 0, 0.3), (0, 0, 0), (0, 1, 0)),
        joint("flange", "fixed", "arm", "tool", (0.5, 0, 0)),
    )
    sources = JointOffset(joint="turn", offset=0.25), Frame(frame="tool", x=0.125, rz=np.pi / 2)
    _, built = one_unit(plain_model(tmp_path, text, *sources), [0.0], 0, 0)
    found = origins_of(built.text)
    for name, place, angles in (("turn", "0.0 0.0 0.3", [0, 0.25, 0]), ("flange", "0.625 0.0 0.0", [0, 0, np.pi / 2])):
        xyz, rpy = found[name]
        assert xyz == place
        assert_allclose(np.array(rpy.split(), dtype=float), angles, rtol=0, atol=1e-15)
    # R_y(0.25) carries the tip to (0.625 cos, 0, 0.3 - 0.625 sin)
    expected = [0.625 * np.cos(0.25) - 0.5, 0, -0.625 * np.sin(0.25)]
    assert_allclose(built.error[:3], expected, rtol=0, atol=1e-15)


@pytest.mark.slow
@settings(max_examples=25, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    pitch=st.sampled_from([np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-9, -np.pi / 2 + 1e-5, 1.5708, 0.0, np.pi]),
    roll=st.floats(-3.2, 3.2),
    yaw=st.floats(-3.2, 3.2),
    turn=st.lists(st.one_of(st.just(0.0), st.floats(-1e-8, 1e-8), st.floats(-0.7, 0.7)), min_size=3, max_size=3),
    shift=st.lists(st.floats(-0.01, 0.01), min_size=3, max_size=3),
)
def test_angles_near_a_pitch_of_90_degrees(tmp_path, pitch, roll, yaw, turn, shift):
    text = robot(
        *map(link, ("base", "arm", "tool")),
        joint("turn", "revolute", "base", "arm", (0.1, -0.2, 0.3), (roll, pitch, yaw), (0.6, 0, 0.8)),
        joint("flange", "fixed", "arm", "tool", (0.5, 0.1, 0), (yaw, pitch, roll)),
    )
    error = dict(zip(("x", "y", "z", "rx", "ry", "rz"), (*shift, *turn), strict=True))
    model = plain_model(tmp_path, text, Frame(joint="turn", **error), Frame(frame="tool", **error))
    writer, built = one_unit(model, [0.3])
    assert_reproduced(model, writer, built, np.array([[0.3], [-2.0]]), readers=[by_pinocchio, by_hand])


# --- everything at the export pose ---


def laden(tmp_path: Path, statics: str = "nominal") -> pp.ErrorModel:
    path = written_file(tmp_path, random_arm(51, prismatic=(4,)))
    model = everything(pp.Chain.from_urdf(path, "tool"))
    # at equilibrium each direction in which a place can move costs an arm of its own; the other case has these sources
    many = (AxisInstall, Length, Mcpc) if statics == "equilibrium" else ()
    sources = [
        *(source for source in model.sources if not isinstance(source, many)),
        Backlash(joint="joint3", backlash=pp.Uniform(1e-4, mean=3e-4), band=1e3),
        Backlash(joint="joint2", backlash=1e-3, band=0.1),
        Transmission(joint="joint5", amplitude=(pp.Uniform(1e-4, mean=5e-4),), order=(2.0,), stiffness=5e4),
        Encoder(joint="joint6", resolution=1e-3, amplitude=2e-4),
        JointOffset(joint="joint7", offset=pp.Draw("repeat", pp.Normal(1e-3), pp.Scope.VISIT)),
        JointOffset(joint="joint6", offset=pp.Draw("anew", pp.Normal(1e-3), pp.Scope.POSE)),
    ]
    names = {draw.name for draw in model.space.draws if "[" not in draw.name}
    space = pp.Space(tuple(draw for draw in model.space.draws if draw.name in names))
    return pp.ErrorModel(model.chain, space, sources, {"export": [0.3, -0.7, 1.1, 0.2, -1.3, 0.8, 0.5]}, statics)


@pytest.mark.slow
@pytest.mark.parametrize("statics", ["nominal", "equilibrium"])
def test_all_errors_are_reproduced_at_the_export_pose(tmp_path, statics):
    model = laden(tmp_path, statics)
    writer = AsBuilt.prepare(model, "export")
    q = model.poses["export"]
    for built in writer.units(5, 3, 2 if statics == "nominal" else 1):
        assert_reproduced(model, writer, built, q[None], unit=built.unit)
    # elsewhere the loads pull otherwise: the same numbers give another error, and the file does not claim it
    at = model.at(q + 0.4)
    values = dict(zip(model.chain.joint_names, q + 0.4, strict=True))
    actual = pose_error(by_hand(built.text, "base", "tool", values), at.posture.pose)
    assert np.abs(actual - at.exact(model.space.sample(5, built.unit, 1))[:, 0]).max() > 1e-5


def comment_of(built) -> str:
    return " ".join(COMMENT.search(built.text)[0].decode().split())


def test_the_file_names_what_is_frozen(tmp_path):
    model = laden(tmp_path)
    _, built = one_unit(model, "export", sheet="arm.errors.yaml")
    comment = comment_of(built)
    for words in (
        "unit 3 of seed 5",
        "pose export: joint1 = 0.3 rad, joint2 = -0.7 rad, joint3 = 1.1 rad, joint4 = 0.2 m, ",
        "sheet: arm.errors.yaml",
        "chain: base to tool",
    ):
        assert words in comment
    assert comment.removeprefix("<!-- ").startswith("As-built robot at the pose below and at no other, written by")
    frozen = comment.partition("Fixed at their values at this pose: ")[2].partition(". ")[0].split(", ")
    assert set(frozen) == {
        "beam[link2]",
        "beam[link3]",
        *(f"joint_compliance[joint{k}]" for k in (1, 2, 4)),
        "backlash[joint2]",
        "backlash[joint3]",
        "transmission[joint5]",
        "encoder[joint6]",
        "joint_offset[joint6]",
        "joint_offset[joint7]",
        "length[tool]",  # along an axis of joint 2, which turns against the tool
    }


def test_a_file_without_anything_frozen_says_so(tmp_path):
    path = written_file(tmp_path, random_arm(61, prismatic=(4,)))
    chain = pp.Chain.from_urdf(path, "tool", locked={"joint2": 0.25})
    _, built = one_unit(pp.ErrorModel(chain, pp.Space(), every_geometric(chain)), np.zeros(6))
    comment = comment_of(built)
    assert comment.endswith("No source was seen to depend on the pose. -->")
    assert "locked on the way: joint2 = 0.25 rad pose: " in comment


def test_what_loads_cause_counts_as_frozen_even_where_they_are_the_same_everywhere(tmp_path):
    lift = robot(link("base"), link("tool", 2.0), joint("lift", "prismatic", "base", "tool", axis=(0, 0, 1)))
    model = plain_model(tmp_path, lift, JointCompliance(joint="lift", compliance=1e-5))
    assert frozen_sources(model, model.at([0.3])) == ("joint_compliance[lift]",)


def test_a_robot_that_does_not_stand_where_it_should_is_not_given_out(tmp_path, monkeypatch):
    model = awkward_model(tmp_path)
    writer = AsBuilt.prepare(model, [0.1, 0.2, 0.3])
    monkeypatch.setattr(UrdfText, "edited", lambda text, *rest: text.data)
    with pytest.raises(InternalError, match="disagrees with the exact model"):
        next(writer.units(0, 0, 1))


@pytest.mark.slow
def test_units_are_those_of_the_sampler(tmp_path):
    from precision_pin import monte_carlo

    model = laden(tmp_path)
    analysis = monte_carlo(model, "export", samples=64, seed=11, keep_samples=True)
    built = list(AsBuilt.prepare(model, "export").units(11, 60, 4))
    assert [one.unit for one in built] == [60, 61, 62, 63]
    assert_allclose(np.array([one.error for one in built]).T, np.asarray(analysis.errors)[:, 60:], rtol=0, atol=1e-12)
    again = list(AsBuilt.prepare(model, "export").units(11, 62, 2))
    assert [one.text for one in again] == [one.text for one in built[2:]]
    assert len({one.digest for one in built}) == 4


# --- nothing else changes ---

AWKWARD = """\ufeff<?xml version='1.0' encoding="utf-8" standalone="yes"?>
<!-- a comment with <joint name="shoulder"><origin xyz="9 9 9"/></joint> in it; tabs\tand  blanks -->
<?pi keep="this"?>
<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="Arm-Ü &amp; co">
  <material name="grey"><color rgba="0.50 .5 5e-1 1"/></material>
  <link name="foot"/>
  <link name="upper"><inertial><origin xyz="0.10 0 0"/><mass value="2.50"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.040" iyz="0" izz="0.04"/></inertial>
    <visual><origin xyz="0.1 0 0" rpy="0 1.57 0"/><geometry><mesh filename="meshes/a &amp; b.stl"/></geometry></visual>
    <collision><geometry><mesh filename="package://arm/c.stl"/></geometry></collision></link>
  <link name="fore"/><link name="wrist"/><link name="tool"/><link name="camera"/>
  <gazebo reference="upper"><joint name="shoulder"><origin xyz="7 7 7"/></joint><mu1>0.20</mu1></gazebo>
  <joint
      type = 'revolute'  name='shoulder' >
    <!-- where it stands: --><origin note="xyz='1 1 1' > rpy" rpy = '0.10 0.2
      0.3'  other="2" xyz="0.0 0 .30"   /><axis xyz="0 0.0 1"/>
    <parent link="foot"/><child link="upper"/><limit lower="-2.0" upper="2" effort="50" velocity="1.50"/>
    <calibration rising="0.5"/><dynamics damping="0.10"/>
  </joint>
  <joint name="elbow" type="continuous">
    <parent link="upper"/>
    <child link="fore"/>
    <axis xyz="0 -1.0 0"/>
  </joint>
  <joint name="roll" type="revolute"><note><joint name="elbow"><origin xyz="6 6 6"/></joint></note>
    <origin rpy="0 0 0.50"></origin><parent link="fore"/><child link="wrist"/>
    <axis xyz="1 0 0"/><limit lower="-2" upper="2" effort="50" velocity="1.5"/></joint>
  <joint name="flange" type="fixed"><origin xyz="5e-2 0 0"/><parent link="wrist"/><child link="tool"/></joint>
  <joint name="bracket" type="fixed"><origin xyz="0.050 0 0"/><parent link="wrist"/><child link="camera"/></joint>
  <transmission name="t"><type>x</type><joint name="shoulder"><origin xyz="8 8 8"/></joint></transmission>
  <ros2_control name="system" type="system"><hardware><plugin>mock</plugin></hardware>
    <joint name="elbow"><command_interface name="position"/></joint></ros2_control>
  <vendor:tag xmlns:vendor="urn:v" a="1">text &lt; <![CDATA[ <joint name="elbow"> ]]></vendor:tag>
</robot>
<!-- the end -->
""".replace("\n", "\r\n")


def awkward_model(folder: Path) -> pp.ErrorModel:
    chain = pp.Chain.from_urdf(written_file(folder, AWKWARD), "tool")
    turns = {"rx": pp.Uniform(1e-3), "ry": pp.Normal(1e-3)}
    return pp.ErrorModel(
        chain,
        pp.Space((pp.Draw("spot", pp.Disc(1e-3)),)),
        [
            Frame(joint="shoulder", x="spot.x", y="spot.y", **turns),
            Frame(joint="elbow", z=pp.Uniform(1e-3), **turns),
            Frame(joint="roll", x=pp.Uniform(1e-3), **turns),
            Frame(frame="tool", x=pp.Uniform(1e-3)),
        ],
    )


def test_every_other_byte_stays(tmp_path):
    model = awkward_model(tmp_path)
    writer, built = one_unit(model, [0.1, 0.2, 0.3])
    assert_reproduced(model, writer, built, poses_of(model.chain), readers=[by_us, by_hand])
    text = COMMENT.sub(b"", built.text, count=1).decode()
    number = r"-?[0-9.e+-]+"
    three = f"{number} {number} {number}"
    # back to what was there, each by the very place where it must stand
    for pattern, original in (
        (
            f'rpy = \'{three}\'  other="2" xyz="{three}"   />',
            'rpy = \'0.10 0.2\r\n      0.3\'  other="2" xyz="0.0 0 .30"   />',
        ),
        (f'(?<=type="continuous">\r\n    )<origin xyz="{three}" rpy="{three}"/>\r\n    ', ""),
        (f'<origin rpy="{three}" xyz="{three}"></origin>', '<origin rpy="0 0 0.50"></origin>'),
        (f'(?<=name="flange" type="fixed">)<origin xyz="{three}"/>', '<origin xyz="5e-2 0 0"/>'),
    ):
        text, count = re.subn(pattern, lambda _, back=original: back, text)
        assert count == 1, pattern
    assert text.encode() == AWKWARD.encode()
    assert UrdfText.scan(AWKWARD.encode()).meshes == ("meshes/a & b.stl", "package://arm/c.stl")


def test_no_error_no_change(tmp_path):
    for sources in ([], [Frame(joint="roll", x=0.0), JointOffset(joint="elbow", offset=pp.Uniform(0.0))]):
        _, built = one_unit(plain_model(tmp_path, AWKWARD, *sources, tip="tool"), [0.1, 0.2, 0.3])
        assert COMMENT.sub(b"", built.text, count=1) == AWKWARD.encode()


HOSTILE = "a--b-->\n<x/>\x85\u202e腕--"


@pytest.mark.parametrize("ascii_only", [False, True])
def test_hostile_names_in_comments_and_added_frames(tmp_path, ascii_only):
    tip = 't"i<p>&ü'
    escaped = tip.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;").replace("ü", "&#252;")
    text = robot(link("base"), link(escaped), joint("turn", "revolute", "base", escaped)).replace("arm", "a--&gt;b")
    declared = "ISO-8859-1" if ascii_only else "UTF-8"
    text = f'<?xml version="1.0" encoding="{declared}"?>\n{text}'
    if not ascii_only:
        text = text.replace("&#252;", "ü")
    model = plain_model(tmp_path, text, Frame(frame=tip, y=1e-3, rx=0.2), poses={HOSTILE: [0.1]})
    writer, built = one_unit(model, HOSTILE, sheet=HOSTILE)
    assert writer.tip == f"{tip}_as_built"
    assert built.text.isascii() == ascii_only
    # ElementTree goes by the declared encoding
    root = ElementTree.fromstring(built.text)
    assert [node.get("name") for node in root.findall("link")] == ["base", tip, f"{tip}_as_built"]
    assert [node.tag for node in root] == ["link", "link", "joint", "link", "joint"]
    comment = COMMENT.search(built.text)[0].decode()
    assert "--" not in comment.strip()[4:-3]
    assert_reproduced(model, writer, built, np.array([[0.1], [2.0]]), readers=[by_us])


def test_added_frames_take_free_names(tmp_path):
    text = robot(
        *map(link, ("base", "arm", "arm_as_built")),
        joint("turn", "revolute", "base", "arm"),
        joint("arm_as_built__joint", "fixed", "base", "arm_as_built"),
    )
    model = plain_model(tmp_path, text, Frame(frame="arm", x=1e-3), tip="arm")
    writer, built = one_unit(model, [0.0])
    assert writer.tip == "arm_as_built__"
    assert_reproduced(model, writer, built, np.array([[0.0], [2.0]]))


def test_a_robot_that_changed_or_went_is_refused(tmp_path):
    model, path = awkward_model(tmp_path), tmp_path / "arm.urdf"
    other = AWKWARD.replace("5e-2 0 0", "6e-2 0 0").encode()
    for data, message in ((other, "is not the robot of"), (b"<robot", "E_XML_SYNTAX"), (None, "E_FILE_MISSING")):
        path.unlink() if data is None else path.write_bytes(data)
        with pytest.raises(pp.InputError, match=message):
            AsBuilt.prepare(model, [0.1, 0.2, 0.3])


def test_an_error_of_half_a_turn_is_refused(tmp_path):
    with pytest.raises(pp.InputError, match="180°"):
        one_unit(plain_model(tmp_path, split_arm(), Frame(frame="tool", rx=3.2), tip="tool"), [0.0])


# --- the text, edit by edit ---


def test_placements_and_a_comment_are_put_where_there_was_none():
    text = '<robot name="a"><joint name="j" type="fixed">{}<parent link="a"/><child link="b"/></joint></robot>'
    for before, placement, after in (
        ("<origin/>", Placement((1, 2.5, -3), (4, 5, 6)), '<origin xyz="1.0 2.5 -3.0" rpy="4.0 5.0 6.0"/>'),
        ("<origin ></origin>", Placement((1, 2, 3), None), '<origin xyz="1.0 2.0 3.0" ></origin>'),
        ("", Placement(None, (1e-9, 0, 0)), '<origin rpy="1e-09 0.0 0.0"/>'),
        ("", Placement(None, None), ""),
    ):
        edited = UrdfText.scan(text.format(before).encode()).edited({"j": placement})
        assert edited.decode() == text.format(after)
    # at the top, before the first element, and after a byte order mark
    for mark in ("", "\ufeff"):
        edited = UrdfText.scan(f"{mark}<robot/>".encode()).edited({}, comment=["one", "t---wo"])
        assert edited.decode() == f"{mark}<!--\n  one\n  t- - -wo\n-->\n<robot/>"
