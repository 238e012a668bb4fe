"""Collisions by hand, by closed forms, by plain forward kinematics, and by Pinocchio's own check of the whole robot."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import coal
import numpy as np
import pinocchio
import pytest
import trimesh

import precision_pin as pp
from precision_pin.analyses.iso9283 import cube as cubes
from precision_pin.base.errors import InputError, PrecisionPinWarning
from precision_pin.robot.chain import Chain
from precision_pin.robot.collision import KeepOut, Obstacles
from precision_pin.robot.examples import example_urdfs
from precision_pin.robot.pose_set import PoseSet
from support.plain_robot import PlainRobot, gantry, joint, limits, robot

WIDE = limits(-3.1, 3.1)
NONE = Obstacles(keep_out=())


def shaped(name: str, shape: str, at: str = "0 0 0", rpy: str = "0 0 0") -> str:
    origin = f'<origin xyz="{at}" rpy="{rpy}"/>'
    return f'<link name="{name}"><collision>{origin}<geometry>{shape}</geometry></collision></link>'


def checked(text: str, folder: Path, obstacles: Obstacles = NONE, tip: str | None = None) -> Chain:
    path = folder / "arm.urdf"
    path.write_text(text)
    return replace(pp.Chain.from_urdf(path, tip), obstacles=obstacles)


def hook(post: str, *, folder: Path, fore: str = '<box size="0.9 0.08 0.1"/>', obstacles: Obstacles = NONE) -> Chain:
    """Return two links in a plane, the second of which can fold back onto the base."""
    text = robot(
        shaped("base", post), shaped("upper", '<box size="0.8 0.08 0.1"/>', "0.5 0 0"), shaped("fore", fore, "0.45 0 0"),
        joint("shoulder", "revolute", "base", "upper", (0, 0, 0), axis=(0, 0, 1), extra=WIDE),
        joint("elbow", "revolute", "upper", "fore", (1, 0, 0), axis=(0, 0, 1), extra=WIDE),
    )  # fmt: skip
    return checked(text, folder, obstacles)


def test_a_folding_arm_hits_its_post_from_the_angle_on_that_a_ruler_gives(tmp_path):
    chain = hook('<cylinder radius="0.2" length="0.5"/>', folder=tmp_path)
    elbow = np.linspace(-3.1, 3.1, 621)
    # the post's axis in the fore link's axes, its distance from a rectangle of 0.9 by 0.08 m
    x, y = -np.cos(elbow), np.sin(elbow)
    gap = np.hypot(np.maximum(x - 0.9, 0) + np.maximum(-x, 0), np.maximum(np.abs(y) - 0.04, 0))
    free = chain.collision_check.free(np.array([np.full(621, 0.7), elbow]))
    clear = np.abs(gap - 0.2) > 1e-6
    assert (free == (gap > 0.2))[clear].all()
    assert 0 < free.sum() < 621


def test_the_depth_of_two_balls_is_the_sum_of_their_radii_less_their_distance(tmp_path):
    chain = hook('<sphere radius="0.3"/>', folder=tmp_path, fore='<sphere radius="0.2"/>')
    elbow = np.linspace(-3, 3, 100)
    apart = np.hypot(1 + 0.45 * np.cos(elbow), 0.45 * np.sin(elbow))
    reasons = chain.collision_check.reasons(np.array([0 * elbow, elbow]))
    assert [bool(reason) for reason in reasons] == (apart < 0.5).tolist()
    for reason, far in zip(reasons, apart, strict=True):
        if reason:
            assert reason.startswith("fore hits base, ")
            assert float(reason.split(", ")[1].split(" mm")[0]) == pytest.approx(1e3 * (0.5 - far), rel=5e-3, abs=1e-2)


@pytest.mark.parametrize("ball", ['<sphere radius="0.02"/>', '<mesh filename="ball.stl"/>'])
def test_a_link_that_is_swallowed_by_a_mesh_hits_it(tmp_path, ball):
    trimesh.creation.box((1.2, 1.2, 1.2)).export(tmp_path / "box.stl")
    trimesh.creation.icosphere(2, 0.02).export(tmp_path / "ball.stl")
    chain = hook('<mesh filename="box.stl"/>', folder=tmp_path, fore=ball)
    elbow = np.linspace(-3.1, 3.1, 300)
    # the ball's centre lies 0.55 m or more from the elbow's other side: inside the cube of 0.6 m where |x|, |y| < 0.6
    x, y = 1 + 0.45 * np.cos(elbow), 0.45 * np.sin(elbow)
    gap = np.hypot(np.maximum(np.abs(x) - 0.6, 0), np.maximum(np.abs(y) - 0.6, 0))
    free = chain.collision_check.free(np.array([0 * elbow, elbow]))
    sure = np.abs(gap - 0.02) > 1e-3  # the mesh has flat faces
    assert (free == (gap > 0.02))[sure].all()
    inside = np.maximum(np.abs(x), np.abs(y)) < 0.57
    assert inside.any()
    assert not free[inside].any()


def test_coal_is_asked_only_of_meshes_that_may_touch(tmp_path, monkeypatch):
    """A ball between two plates 18 cm apart: it fits, or it hits them from the edge on that a ruler gives."""
    plates = [trimesh.creation.box((1.6, 1.6, 0.02)).apply_translation((0, 0, z)) for z in (-0.1, 0.1)]
    trimesh.util.concatenate([plate.subdivide().subdivide() for plate in plates]).export(tmp_path / "plates.stl")
    elbow = np.random.default_rng(1).uniform(-3.1, 3.1, 300)
    q = np.array([0 * elbow, elbow])
    beyond = np.maximum(np.abs(1 + 0.45 * np.cos(elbow)), np.abs(0.45 * np.sin(elbow))) - 0.8
    asked, collide = [], coal.collide
    monkeypatch.setattr(coal, "collide", lambda *given: asked.append(1) or collide(*given))
    for radius, rim in ((0.088, 0.0), (0.1, np.sqrt(0.1**2 - 0.09**2))):
        trimesh.creation.icosphere(3, radius).export(tmp_path / "ball.stl")
        chain = hook('<mesh filename="plates.stl"/>', folder=tmp_path, fore='<mesh filename="ball.stl"/>')
        check = chain.collision_check
        asked.clear()
        free = check.free(q)
        # the ball's faces are flat: its rim a little within the circle
        assert free[(beyond > rim) | (radius < 0.09)].all()
        assert not free[(beyond < 0.9 * rim) & (radius > 0.09)].any()
        assert len(asked) <= (~free).sum() + 10
        assert check.free(q[:, :15]).tolist() == free[:15].tolist()  # too few for compiled code


def test_the_next_link_and_what_touches_at_joint_zero_are_not_looked_at(tmp_path):
    # the fore link is so long that it reaches the post at every angle: at joint zero too
    chain = hook('<sphere radius="0.3"/>', folder=tmp_path, fore='<box size="4 4 0.1"/>')
    assert chain.collision_check.free(np.zeros((2, 1))).all()
    assert any("fore and base" in note for note in chain.collision_check.notes)


@pytest.mark.slow
def test_lines_keep_out_of_planes_and_boxes():
    folder = Path(pp.__file__).parent / "robots"
    plain = PlainRobot.parse((folder / "4dof.urdf").read_text(encoding="utf-8"))
    chain = pp.ErrorModel.load(folder / "4dof.errors.yaml").chain
    assert chain.collision_check.free(np.zeros((4, 1))).all()  # nothing under it is known
    assert len(chain.collision_check.notes) == 1
    q = np.random.default_rng(3).uniform(-2, 2, (4, 100))
    normal = np.array([0.6, 0.0, 0.8])
    plane = KeepOut((0.1, 0.0, 0.2), normal=tuple(normal))
    low, high = np.array([0.4, -0.5, 0.1]), np.array([1.6, 0.5, 1.1])
    box = KeepOut(tuple((low + high) / 2), size=tuple(high - low))
    # the origins of the joints and the tip, by plain forward kinematics
    poses = [plain.poses(dict(zip(chain.joint_names, one, strict=True))) for one in q.T]
    ways = np.array(
        [[pose[name][:3, 3] for name in (*(one.child for one in chain.joints), chain.tip)] for pose in poses]
    )
    below = (np.array([0.1, 0.0, 0.2]) @ normal - ways @ normal).max(axis=1)
    with_plane = replace(chain, obstacles=Obstacles((plane,))).collision_check
    assert (with_plane.free(q) == (below <= 0)).all()
    for reason, depth in zip(with_plane.reasons(q), below, strict=True):
        assert not reason or float(reason.split(" is ")[1].split(" mm")[0]) == pytest.approx(1e3 * depth, rel=5e-3)
    # points along the lines, and how far outside the box the nearest is
    steps = np.linspace(0, 1, 1001)[:, None]
    gap = [
        min(np.abs(np.maximum(low - p, 0) + np.maximum(p - high, 0)).max(axis=1).min() for p in parts)
        for parts in ([a + steps * (b - a) for a, b in pairwise(way)] for way in ways)
    ]
    free = replace(chain, obstacles=Obstacles((box,))).collision_check.free(q)
    assert (free[np.array(gap) == 0] == False).all()  # noqa: E712
    assert free[np.array(gap) > 2e-3].all()
    assert 0 < free.sum() < 100


@pytest.fixture(scope="module")
def ur5() -> pp.ErrorModel:
    return pp.ErrorModel.load(Path(pp.__file__).parent / "robots" / "ur5.errors.yaml")


@pytest.mark.slow
def test_a_ur5_hits_what_pinocchio_says_and_the_plate_under_it(ur5):
    file = Path(example_urdfs()["ur5"])
    model = pinocchio.buildModelFromUrdf(str(file))
    shapes = pinocchio.buildGeomFromUrdf(
        model, str(file), pinocchio.GeometryType.COLLISION, package_dirs=[str(file.parents[4])]
    )
    shapes.addAllCollisionPairs()
    parents = [one.parentJoint for one in shapes.geometryObjects]
    for pair in list(shapes.collisionPairs):
        if abs(parents[pair.first] - parents[pair.second]) < 2:
            shapes.removeCollisionPair(pair)
    data, own = model.createData(), shapes.createData()
    low, high = ur5.chain.configurations.limits
    q = np.random.default_rng(5).uniform(low[:, None] / 2, high[:, None] / 2, (6, 200))
    hits = [pinocchio.computeCollisions(model, data, shapes, own, one, False) for one in np.ascontiguousarray(q.T)]
    bare = replace(ur5.chain, obstacles=NONE).collision_check
    assert (~bare.free(q)).tolist() == hits
    assert 5 < sum(hits) < 195

    # the lowest corner of every moving mesh, against the lowest of the base
    def lowest(joints: np.ndarray, moving: bool) -> float:
        pinocchio.updateGeometryPlacements(model, data, shapes, own, joints)
        return min(
            float(
                (one.geometry.vertices() * one.meshScale.T @ own.oMg[k].rotation[2] + own.oMg[k].translation[2]).min()
            )
            for k, one in enumerate(shapes.geometryObjects)
            if (one.parentJoint > 0) == moving and "ee_link" not in one.name
        )

    plate = lowest(np.zeros(6), False)
    above = np.array([lowest(one, True) for one in np.ascontiguousarray(q.T)]) - plate
    found = ur5.chain.collision_check.judge(q)
    sure = np.abs(above) > 0.02  # the flange's small box is not in it
    assert [what == "kept out" for what in np.array(found)[sure]] == (above < 0)[sure].tolist()


def test_random_poses_are_those_of_before_without_what_is_hit(ur5):
    bare = replace(ur5.chain, obstacles=None)
    every = pp.random_poses(bare, 120, seed=4)
    free = ur5.chain.collision_check.free(every.q)
    poses = pp.random_poses(ur5.chain, int(free.sum()), seed=4)
    assert poses.q.tobytes() == np.ascontiguousarray(every.q[:, free]).tobytes()
    assert sum(poses.left_out.values()) >= (~free).sum() > 30
    out = replace(ur5.chain, obstacles=NONE)
    assert pp.random_poses(out, 40, seed=4).left_out.keys() <= {"collision"}


def test_a_grid_takes_another_branch_before_it_gives_up_a_place(tmp_path):
    # in a plane: the elbow to the left of a place hits a box there, the elbow to the right does not
    box = KeepOut((0.3, 0.8, 0.0), size=(0.6, 0.6, 1.0))
    chain = hook('<cylinder radius="0.05" length="0.2"/>', folder=tmp_path, obstacles=Obstacles((box,)))
    tip = chain.with_target((0.9, 0.0, 0.0))
    places = [[1.2, 0.3, 3.0], [0.0, 0.8, 0.0], [0.0, 0.0, 0.0]]
    bare = pp.place_grid(replace(tip, obstacles=None), places, pp.Orientation.free(), branches="all")
    left = bare.q[:, :2][:, bare.q[1, :2] < 0]  # the elbow at positive shoulder angles
    assert left[0, 0] > 0
    near = pp.place_grid(tip, places, pp.Orientation.free(), reference=left[:, 0])
    assert near.status == ("reached", "kept out", "unreachable")
    assert near.q[1, 0] > 0
    assert np.isnan(near.q[:, 1]).all()
    assert near.obstructed == {"kept out": 1}
    grid = pp.joint_grid(tip, {"shoulder": [-1.5, 1.5], "elbow": 0.2})
    assert grid.status[1] == "kept out"
    assert grid.with_singular_below(tip, 0.5).status == ("singular", "kept out")


SHEET = """
precision-pin: 1
robot: example:ur5
tip: tool0
{keys}
poses: {{ready: 0 -90 90 -90 -90 0 deg, below: 0 60 0 0 0 0 deg}}
sources:
  - joint_offset: {{joint: elbow_joint, offset: {{normal: 1 mrad}}}}
  - joint_offset: {{joint: shoulder_pan_joint, offset: {{normal: 1 mrad}}}}
"""


def sheet(folder: Path, keys: str = "") -> Path:
    path = folder / "arm.errors.yaml"
    path.write_text(SHEET.format(keys=keys))
    return path


@pytest.mark.slow
def test_named_poses_are_judged_with_a_warning_and_candidates_left_out(tmp_path):
    model = pp.ErrorModel.load(sheet(tmp_path))
    with pytest.warns(PrecisionPinWarning, match=r"W_COLLISION: here \w+_link is \d+ mm beyond the base plate"):
        model.at("below")
    with pytest.warns(PrecisionPinWarning, match="W_COLLISION: at 1 of 2 poses, the first of them below, "):
        made = pp.map_poses(model, ["ready", "below"], verify=0)
    assert made.poses.known.all()
    q = np.array([model.poses["ready"] + 0.02 * k for k in range(6)] + [model.poses["below"]]).T
    plan = pp.plan_calibration(model, q, 3, pp.Measurement("position"), at=["ready"])
    assert (plan.candidates, plan.left_out) == (6, {"kept out": 1})
    assert [one.code for one in plan.findings].count("W_COLLISION") == 1
    mapped = pp.map_poses(model, PoseSet.at(model.chain, q).unobstructed(model.chain), verify=0)
    assert mapped.to_dict()["left_out"] == {"kept out": 1}
    for keys in ("keep_out: none", "keep_out: [{plane: 0 0 1, at: 0 0 -2 m}]"):
        assert not pp.ErrorModel.load(sheet(tmp_path, keys)).at("below").posture.findings


@pytest.mark.slow
def test_a_sheet_narrows_limits_and_says_what_is_wrong(tmp_path):
    chain = pp.ErrorModel.load(sheet(tmp_path, "limits: {elbow_joint: -1 2 rad}")).chain
    low, high = chain.configurations.limits
    assert (low[2], high[2]) == (-1.0, 2.0)
    assert (np.delete(high, 2) > 3).all()
    drawn = pp.random_poses(replace(chain, obstacles=None), 200).q[2]
    assert (drawn >= -1).all() and (drawn <= 2).all() and np.ptp(drawn) > 2.8  # noqa: PT018
    for keys, message in (
        ("limits: {elbow_joint: -1 9 rad}", "within"),
        ("limits: {elbow_joint: 2 1 rad}", "lowest and the highest"),
        ("keep_out: [{box: 1 0 1 m}]", "above zero"),
        ("keep_out: [{at: 0 0 1 m}]", "an entry is"),
        ("keep_out: [{plane: 0 0 0}]", "normal of a plane is zero"),
        ("keep_out: [{sphere: 1 m}]", "unknown key 'sphere': valid: at, box, plane"),
    ):
        with pytest.raises(InputError, match=message) as refused:
            pp.ErrorModel.load(sheet(tmp_path, keys))
        assert len(refused.value.findings) == 1


def test_a_hanging_arm_has_no_plate(tmp_path):
    def hung(height: float, gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)) -> list[str]:
        text = robot(
            shaped("base", '<box size="0.2 0.2 0.1"/>'), shaped("upper", '<box size="0.05 0.05 0.9"/>', f"0 0 {height / 2}"),
            shaped("fore", '<box size="0.05 0.05 0.9"/>', f"0 0 {height / 2}"),
            joint("shoulder", "revolute", "base", "upper", (0, 0, 0.1 * np.sign(height)), axis=(0, 1, 0), extra=WIDE),
            joint("elbow", "revolute", "upper", "fore", (0, 0, height), axis=(0, 1, 0), extra=WIDE),
        )  # fmt: skip
        chain = replace(checked(text, tmp_path, Obstacles()), gravity=np.array(gravity))
        return chain.collision_check.judge(np.array([[0.0, 3.1], [0.0, 0.0]]))

    assert hung(1.0) == ["", "kept out"]
    assert hung(1.0, (0.0, 0.0, 9.81)) == ["", "kept out"]  # on a ceiling: its plate is the ceiling
    assert "kept out" not in hung(-1.0)
    assert "kept out" not in hung(1.0, (-9.81, 0.0, 0.0))


@pytest.mark.slow
def test_the_cube_has_no_pose_at_which_the_arm_is_kept_out(monkeypatch):
    """Of a gantry that reaches 1 m to all sides: 2 m, and 1.7 m where a plane keeps it out of the lowest 0.3 m."""
    chain = gantry()
    cube, searched = cubes.Cube(1.9996, np.zeros(3)), cubes._poses_in_cube
    monkeypatch.setattr(cubes, "_KNOWN", 2_000)  # of a table that only slides, Newton's steps reach all from anywhere

    def with_the_largest_given(tool):
        return searched(tool) if tool.avoids else (cube, cubes._follow(tool, cube))

    monkeypatch.setattr(cubes, "_poses_in_cube", with_the_largest_given)
    bare, known = cubes.standard_poses(replace(chain, obstacles=None), np.zeros(4), np.zeros(3))
    assert known is cube
    np.testing.assert_allclose(bare.position, cube.points(), rtol=0, atol=1e-6)
    # nothing is touched: no other cube is sought
    below = replace(chain, obstacles=Obstacles((KeepOut((0.0, 0.0, -0.81), normal=(0.0, 0.0, 1.0)),)))
    same, alike = cubes.standard_poses(below, np.zeros(4), np.zeros(3))
    assert same.q.tobytes() == bare.q.tobytes()
    assert alike is cube
    # a plane above the lower two of the five
    above = replace(chain, obstacles=Obstacles((KeepOut((0.0, 0.0, -0.7), normal=(0.0, 0.0, 1.0)),)))
    poses, smaller = cubes.standard_poses(above, np.zeros(4), np.zeros(3))
    assert smaller.side == pytest.approx(1.7, abs=2e-3)
    assert poses.position[2].min() >= -0.7
