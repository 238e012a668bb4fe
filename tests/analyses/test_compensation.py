"""Corrected joint values: published and hand-computed cases, scipy, exact sampling."""

import numpy as np
import pytest
from scipy.optimize import fsolve, least_squares, minimize
from scipy.spatial.transform import Rotation

import precision_pin as pp
from precision_pin.analyses.compensation import compensate
from precision_pin.analyses.compensation.table import compensation_table
from precision_pin.base.errors import PrecisionPinWarning
from precision_pin.robot.examples import PAPER_SHEET, shipped_sheets
from precision_pin.robot.pose_set import PoseSet
from precision_pin.sources import Frame, JointCompliance, JointOffset, Payload
from support.oracles import displaced_pose, displacements
from support.plain_robot import PlainRobot, chain_of, inserted, joint, limits, link, pose_error, random_arm, robot
from support.refusals import check_refused

MEAN = 0.01
"""A mean offset, rad."""


def standing(model, q):
    """Return the pose of the arm with every component at its mean: by the terms' plain definition, ``(4, 4)``."""
    at = model.at(q)
    means = dict(zip(model.space.components, model.space.mean, strict=True))
    return displaced_pose(model.chain, q, displacements(at.terms, means))


@pytest.mark.slow
def test_the_sag_of_the_papers_arm():
    # 36.770 mm, 0.964 mm after one step, 6.54 mrad that four joints cannot correct: computed with independent code
    model = pp.ErrorModel.load(PAPER_SHEET)
    result = pp.compensate(model, ["paper"])
    made = result.correction
    assert made.status == ("corrected",)
    sizes = [1e3 * np.linalg.norm(part[:3, 0]) for part in (made.before, made.first_order)]
    assert sizes == pytest.approx([36.770, 0.964], abs=5e-4)
    assert 1e3 * np.linalg.norm(made.after[3:, 0]) == pytest.approx(6.54, abs=5e-3)
    wanted = model.chain.at(result.poses.q[:, 0]).pose
    assert np.linalg.norm(standing(model, made.q[:, 0])[:3, 3] - wanted[:3, 3]) < 1e-9
    assert made.iterations[0] <= 4


@pytest.mark.slow
def test_every_pose_of_a_six_axis_arm_with_payload():
    model = pp.ErrorModel.load(shipped_sheets()["ur5"])
    result = pp.compensate(model, list(model.poses), mode="pose")
    assert result.is_complete
    for q, corrected in zip(result.poses.q.T, result.corrected.T, strict=True):
        error = pose_error(standing(model, corrected), model.chain.at(q).pose)
        assert max(np.linalg.norm(error[:3]), np.linalg.norm(error[3:])) < 1e-9
    # one pose: joints by their whole names; the last one is turned by less than a digit, and zero has no sign
    lines = compensation_table(pp.compensate(model, ["ready"])).splitlines()
    assert any(line.startswith("shoulder_pan_joint ") for line in lines)
    assert next(line for line in lines if line.startswith("wrist_3_joint")).split()[2:] == ["0.0000"] * 3
    # of an arm of fewer joints weighted squares are smallest
    model = pp.ErrorModel.load(PAPER_SHEET)
    q, weights = model.poses["paper"], np.array([1.0, 2.0, 1.0, 0.3, 0.3, 0.3])
    wanted = model.chain.at(q).pose
    settings = {"x_scale": 0.1, "xtol": 1e-14, "ftol": 1e-14}
    found = least_squares(lambda of: weights * pose_error(standing(model, of), wanted), q, **settings)
    corrected = pp.compensate(model, ["paper"], mode="pose", weights=weights).corrected[:, 0]
    assert corrected == pytest.approx(found.x, abs=1e-6)
    squares = ((weights * pose_error(standing(model, corrected), wanted)) ** 2).sum()
    assert squares == pytest.approx(2 * found.cost, rel=1e-9)


def test_joint_compliance_alone_has_the_exact_answer():
    # gravity turns joint k by C m g x_k, x_k the horizontal lever of the payload: the corrected joint values answer q
    softness, mass = np.array([2e-4, 5e-4]), 5.0
    soft = [JointCompliance(joint=name, compliance=c) for name, c in zip(("lift", "elbow"), softness, strict=True)]
    model = pp.ErrorModel(three_joints(), pp.Space(), [Payload(at="tool", mass=mass), *soft])
    q = np.array([0.3, -1.1])

    def deflected(of):
        forearm = 0.3 * np.cos(of.sum())
        return of + softness * mass * 9.81 * np.array([0.4 * np.cos(of[0]) + forearm, forearm])

    expected = fsolve(lambda of: deflected(of) - q, q, xtol=1e-13)
    result = pp.compensate(model, [[0.0, *q]], mode="position")
    assert result.corrected[:, 0] == pytest.approx([0.0, *expected], abs=1e-8)


def least_change(arm, q, offsets, shift, units, rows, limits, end):
    """Return the least root of the sum of squares, by SLSQP on a plain reading of the arm with its errors.

    It starts at no change, at what the offsets ask for and at the change found, ``end``.
    """
    plain, names = PlainRobot.parse(arm), [f"joint{k}" for k in range(1, len(q) + 1)]
    tool = {("link", "tool"): inserted([shift, 0, 0, 0, 0, 0])}

    def pose(values, displaced=None):
        return plain.poses(dict(zip(names, values, strict=True)), displaced=displaced)["tool"]

    wanted = pose(q)

    def missing(x):
        return 10 * pose_error(pose(q + units * x + offsets, tool), wanted)[rows]

    bounds, starts = np.transpose((limits - q) / units), (np.zeros(len(q)), -offsets / units, end)
    settings = {"jac": lambda x: 200 * x, "bounds": bounds, "constraints": {"type": "eq", "fun": missing}}
    found = [minimize(lambda x: 100 * x @ x, start, method="SLSQP", tol=1e-13, **settings).x for start in starts]
    return min((np.linalg.norm(x) for x in found if np.abs(missing(x)).max() < 1e-7), default=np.inf)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "joints", "sliding", "mode", "room"),
    [
        (3, 7, (), "pose", 7.0),
        (5, 7, (2,), "position", 0.01),
    ],
)
def test_a_redundant_arm_moves_least(monkeypatch, seed, joints, sliding, mode, room):
    """Errors of 20 to 60 mrad and 20 mm, for which one step is not the least; limits that leave ``room`` on one side."""
    monkeypatch.setattr(compensate, "_MOST_SETTLING", 50)
    rng = np.random.default_rng(seed)
    q, offsets = rng.uniform(-1, 1, joints), rng.uniform(0.02, 0.06, joints) * rng.choice([-1, 1], joints)
    arm = random_arm(seed, joints, sliding)
    for one in q[[k for k in (0, 1, 3, 4, 6) if k < joints]].tolist():  # joints 3 and 6 have no limits
        arm = arm.replace('lower="-7" upper="7"', f'lower="{one - room}" upper="{one + 7}"', 1)
    chain = chain_of(arm, tip="tool")
    sources = [JointOffset(joint=f"joint{k + 1}", offset=pp.Normal(1e-6, mean=one)) for k, one in enumerate(offsets)]
    model = pp.ErrorModel(chain, pp.Space(), [*sources, Frame(frame="tool", x=pp.Normal(1e-5, mean=0.02))])
    result = pp.compensate(model, [q], mode=mode)
    assert result.is_complete
    units = np.where(chain.prismatic, np.linalg.norm(chain.placements[1:, :3, 3], axis=1).sum(), 1.0)
    limits, corrected = chain.configurations.limits, result.corrected[:, 0]
    assert ((limits[0] <= corrected) & (corrected <= limits[1])).all()
    change = (corrected - q) / units
    least = least_change(arm, q, offsets, 0.02, units, slice(0, 3 if mode == "position" else 6), limits, change)
    assert np.linalg.norm(change) <= least * (1 + 1e-6)


@pytest.mark.slow
def test_poses_without_a_correction_are_named():
    limit = limits(-1, 1)
    offset = JointOffset(joint="shoulder", offset=pp.Normal(1e-3, mean=MEAN))
    model = pp.ErrorModel(three_joints(limit), pp.Space(), [offset])
    q = np.array([[0.2, 0.3, 0.7], [-0.999, 0.3, 0.7], [1.5, 0.3, 0.7], [0.2, 0.3, 0.0]]).T
    with pytest.warns(PrecisionPinWarning, match="pose 3, with the joint shoulder at 1.5 rad"):
        result = pp.compensate(model, PoseSet.at(model.chain, q))
    assert result.correction.status == ("corrected", "limit", "limit", "singular")
    assert np.isnan(result.corrected[:, 1:]).all()
    assert result.corrected[:, 0] == pytest.approx(q[:, 0] - [MEAN, 0, 0], abs=1e-9)
    written = result.to_dict()["poses"]
    assert [pose["q_corrected"] is None for pose in written] == [False, True, True, True]
    assert not result.is_complete
    # poses of a grid whose joint values are not known keep the reason
    grid = pp.place_grid(model.chain, np.array([[0.5, 0, 2], [0, 0.6, 0], [0.2, 0, 0]]), pp.Orientation.free())
    assert pp.compensate(model, grid).correction.status == ("corrected", "limit", "unreachable")


@pytest.mark.slow
def test_no_row_of_a_way_is_on_another_branch():
    """The lift goes to its limit of -1 rad and back, with an offset of 0.5°: the rows that would pass it have no values.

    With the elbow the other way the tool reaches the points within the limits, which is 2 sin(0.7) rad away.
    """
    lift, offset = np.deg2rad([-55, -56, -57, -56, -55]), np.deg2rad(0.5)
    way = np.stack([np.full(5, 0.3), lift, np.full(5, 0.7)])
    source = JointOffset(joint="lift", offset=pp.Normal(1e-3, mean=offset))
    model = pp.ErrorModel(three_joints(lift=limits(-1, 1)), pp.Space(), [source])
    result = pp.compensate(model, PoseSet.at(model.chain, way))
    assert result.correction.status == ("corrected", "corrected", "limit", "corrected", "corrected")
    found = np.isfinite(result.corrected)
    assert (result.corrected - way)[found] == pytest.approx(np.tile([0, -offset, 0], (5, 1)).T[found], abs=1e-8)
    assert not found[:, 2].any()
    assert not result.is_complete


@pytest.mark.slow
def test_newtons_method_does_not_turn_the_elbow():
    """An offset of the shoulder goes by turning it back; by the first step the folded arm is shortened as well.

    That takes the elbow beyond half a turn, where the arm reaches the same point.
    """
    q = np.array([[0.2, 0.0, np.pi - elbow] for elbow in np.linspace(0.01, 0.05, 21)]).T
    turned = np.array([[0.15], [0], [0]])
    model = pp.ErrorModel(
        three_joints(), pp.Space(), [JointOffset(joint="shoulder", offset=pp.Normal(1e-6, mean=turned[0, 0]))]
    )
    result = pp.compensate(model, PoseSet.at(model.chain, q))
    found = np.isfinite(result.corrected[0])
    assert found[6:].all()
    assert (result.corrected + turned - q)[:, found] == pytest.approx(0.0, abs=1e-8)


def six_joints():
    """Return an arm like a UR: two shoulders, an elbow, a wrist of three axes that do not meet in a point."""
    axes = "001", "010", "010", "010", "001", "010"
    origins = (0, 0, 0.09), (0, 0.13, 0), (0, -0.12, 0.425), (0, 0, 0.39), (0, 0.09, 0), (0, 0, 0.09)
    names = ["base", *(f"link{k}" for k in range(1, 7)), "tool"]
    joints = [
        joint(
            f"joint{k + 1}", "revolute", names[k], names[k + 1], at, axis=tuple(map(int, axis)), extra=limits(-1.2, 1.6)
        )
        for k, (at, axis) in enumerate(zip(origins, axes, strict=True))
    ]
    return chain_of(
        robot(*map(link, names), *joints, joint("flange", "fixed", "link6", "tool", (0, 0.08, 0))), tip="tool"
    )


class Wrong:
    """An arm with joint offsets and a shifted tool, computed anew: errors, derivatives, changes, in units of ``(n,)``."""

    def __init__(self, chain, mode, offsets, shift, q):
        self.chain, self.rows, self.offsets, self.shift = chain, 3 if mode == "position" else 6, offsets, shift
        length = np.linalg.norm(chain.placements[1:, :3, 3], axis=1).sum()
        self.units = np.where(chain.prismatic, length, 1.0)
        self.scale = np.repeat([1 / length, 1.0], 3)[: self.rows]
        self.wanted = chain.at_columns(q).pose

    def error(self, q, poses):
        at, wanted = self.chain.at_columns(q + self.offsets[:, None]).pose, self.wanted[:, :, poses]
        away = at[:3, 3] + np.einsum("ijp,j->ip", at[:3, :3], self.shift) - wanted[:3, 3]
        turn = np.einsum("ijp,kjp->pik", at[:3, :3], wanted[:3, :3])
        return np.concatenate([away, Rotation.from_matrix(turn).as_rotvec().T])[: self.rows].T * self.scale

    def slopes(self, q, poses):
        steps = 1e-6 * np.diag(self.units)
        ahead, behind = ([self.error(q + sign * step[:, None], poses) for step in steps] for sign in (1, -1))
        return np.moveaxis(np.subtract(ahead, behind) / 2e-6, 0, -1)

    def check(self, q, corrected, poses):
        """Return, for each corrected pose, how much its joints change and how much the error asks for to first order.

        No singularity lies on the straight way to it.
        """
        first, limits = self.slopes(q[:, poses], poses), self.chain.configurations.limits
        change = ((corrected - q)[:, poses] / self.units[:, None]).T
        free = ~np.any([np.abs(corrected[:, poses].T - one) < 1e-12 for one in limits], axis=0)
        held = np.where(free, 0.0, change)
        inverse = np.linalg.pinv(first * free[:, None])
        missing = self.error(q[:, poses], poses) + np.einsum("prj,pj->pr", first, held)
        asked = np.linalg.norm(np.einsum("pjr,pr->pj", inverse, missing) + held, axis=1)
        for part in np.linspace(0, 1, 9)[1:]:
            between = self.slopes((q + part * (corrected - q))[:, poses], poses) * free[:, None]
            assert (np.linalg.det(between @ inverse) > 0).all()
        return np.linalg.norm(change, axis=1), asked

    def track(self, q, poses, parts=20):
        """Return where the errors lead when they are taken off little by little, and the smallest singular values."""
        left, values, smallest = self.error(q[:, poses], poses), q[:, poses], np.inf
        for part in np.repeat(np.linspace(1, 0, parts + 1)[1:], 2):
            slopes = self.slopes(values, poses)
            smallest = np.minimum(smallest, np.linalg.svd(slopes, compute_uv=False)[:, -1])
            step = np.linalg.solve(slopes, self.error(values, poses)[..., None] - part * left[..., None])[..., 0].T
            values = values - np.clip(step, -0.1, 0.1) * self.units[:, None]
        return values, smallest


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arm", "mode", "seed"),
    [
        (lambda: three_joints(limits(-1, 1), limits(-1, 1)), "position", 9),
        (six_joints, "pose", 5),
        (lambda: tight(6, (2,)), "pose", 3),
        (lambda: tight(7), "pose", 4),
        (lambda: tight(7, (2,)), "position", 2),
    ],
    ids=["three", "six", "six with a slide", "seven", "seven in position"],
)
def test_corrections_are_continuous_with_their_poses(arm, mode, seed):
    """Random poses at limits and near singularities: what is corrected is near, on the branch; what is near is corrected.

    The last poses are a straight way; its rows differ by what is commanded and by twice what the errors ask for.
    """
    rng, chain = np.random.default_rng(seed), arm()
    low, high = chain.configurations.limits
    joints, size = len(low), 0.03
    q = rng.uniform(np.maximum(low, -1.5), np.minimum(high, 1.5), (24, joints)).T
    for pose in range(18):
        edge, bent = rng.integers(joints), rng.integers(1, joints)
        q[bent, pose] = rng.normal(0, 0.05)
        if np.isfinite(low[edge]) and pose % 2:
            q[edge, pose] = rng.choice([low[edge] + size * rng.random(), high[edge] - size * rng.random()])
    q[:, 18:] = q[:, [18]] + (q[:, [1]] - q[:, [18]]) * np.linspace(0, 1, 6)
    offsets, shift = rng.uniform(-size, size, joints), rng.uniform(-size, size, 3)
    sources = [
        *(
            JointOffset(joint=k, offset=pp.Normal(1e-6, mean=o))
            for k, o in zip(chain.joint_names, offsets, strict=True)
        ),
        Frame(frame="tool", **{axis: pp.Normal(1e-6, mean=one) for axis, one in zip("xyz", shift, strict=True)}),
    ]
    result = pp.compensate(pp.ErrorModel(chain, pp.Space(), sources), PoseSet.at(chain, q), mode=mode)
    corrected, wrong = result.corrected, Wrong(chain, mode, offsets, shift, q)
    found = np.array(result.correction.status) == "corrected"
    poses = np.flatnonzero(found)
    assert len(poses) > 5
    assert np.abs(wrong.error(corrected[:, poses], poses)).max() < 1e-8
    assert ((low[:, None] <= corrected) & (corrected <= high[:, None]))[:, poses].all()
    change, asked = wrong.check(q, corrected, poses)
    assert (change <= 2.001 * asked + 1e-8).all()
    ways = np.flatnonzero(np.diff(poses) == 1)
    moved = np.diff((corrected - q)[:, poses] / wrong.units[:, None], axis=1)[:, ways]
    assert (np.linalg.norm(moved, axis=0) <= 2.001 * (asked[:-1] + asked[1:])[ways] + 1e-8).all()
    if joints == wrong.rows:
        ends, smallest = wrong.track(q, np.arange(24))
        clear = smallest > 0.012
        assert (corrected - ends)[:, found & clear] == pytest.approx(0.0, abs=1e-4)
        inside = ((ends > low[:, None] + 1e-4) & (ends < high[:, None] - 1e-4)).all(axis=0)
        nominal = Wrong(chain, mode, 0 * offsets, 0 * shift, q).slopes(q, np.arange(24))
        assert found[inside & clear & (np.linalg.svd(nominal, compute_uv=False)[:, -1] > 0.01)].all()


def tight(joints, sliding=()):
    arm = random_arm(1, joints, sliding).replace('lower="-7" upper="7"', 'lower="-1.2" upper="1.4"')
    return chain_of(arm, tip="tool")


def three_joints(shoulder="", lift=""):
    """Return an arm that turns about z and bends twice about y; straight, it is singular."""
    parts = [
        *map(link, ("base", "column", "upper", "lower", "tool")),
        joint("shoulder", "revolute", "base", "column", extra=shoulder),
        joint("lift", "revolute", "column", "upper", axis=(0, 1, 0), extra=lift),
        joint("elbow", "revolute", "upper", "lower", (0.4, 0, 0), axis=(0, 1, 0)),
        joint("flange", "fixed", "lower", "tool", (0.3, 0, 0)),
    ]
    return chain_of(robot(*parts), tip="tool")


@pytest.mark.slow
def test_the_law_that_remains_is_that_of_exact_robots():
    model = pp.ErrorModel.load(shipped_sheets()["ur5"])
    name = next(iter(model.poses))
    result = pp.compensate(model, [name])
    q = result.corrected[:, 0]
    sampled = pp.monte_carlo(model, q, samples=200_000, seed=3, keep_samples=True)
    shift = model.chain.at(q).pose[:3, 3] - model.chain.at(result.poses.q[:, 0]).pose[:3, 3]
    norms = np.linalg.norm(sampled.errors[:3].T + shift, axis=1)
    # the 95 % quantile of 200,000 samples: standard error below 0.2 %; first order and normal: the tolerance allows 1 % more
    assert result.within_after[0, 0] == pytest.approx(np.quantile(norms, 0.95), rel=0.015)
    assert result.shares[:, 0].sum() == pytest.approx(1.0)


def test_wrong_questions_are_refused():
    for message, settings in (
        ("pose has 6 components, which 4 joints cannot all correct", {"mode": "pose"}),
        ('weights need mode="pose"', {"weights": np.ones(6)}),
        ("must not be negative, and one must be positive", {"mode": "pose", "weights": np.zeros(6)}),
    ):
        check_refused((message, pp.compensate, pp.ErrorModel.load(PAPER_SHEET), ["paper"]), **settings)
