"""Ranks known from the literature, and subspaces that do not depend on the order of sources."""

from __future__ import annotations

import numpy as np
import pytest

import precision_pin as pp
from analyses.calibration.arms import OFF_AXIS, chain_of, paper_model, plain_model, random_poses
from precision_pin.analyses.calibration.forecast import contact_poses, doubt_contact
from precision_pin.draws.space import Space
from precision_pin.sources import JointOffset, Mounting
from support.sheets import seven_joint_arm


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper", "ur5", "panda"])
def test_ranks_of_all_geometric_errors(name: str) -> None:
    """4R + 2P + 6 with poses, 4R + 2P + 3 with points, two fewer with the tip on the last axis."""
    chain = chain_of(name)
    revolute = int((~chain.prismatic).sum())
    base = 4 * revolute + 2 * (len(chain.joints) - revolute)
    model, q = pp.every_frame(chain), random_poses(len(chain.joints), 25)
    pose = pp.identifiability(model, q, pp.Measurement("pose"))
    point = pp.identifiability(model, q, pp.Measurement(target=OFF_AXIS))
    tip = pp.identifiability(model, q, pp.Measurement())
    assert (pose.rank, point.rank, tip.rank) == (base + 6, base + 3, base + 1)
    # the rank does not hang on where zero begins: what is counted and what is not are far apart
    for found in (pose, point, tip):
        assert found.singular_values[found.rank - 1] > 1e-3 * found.singular_values[0]
        assert found.singular_values[found.rank :].max() < 1e-13 * found.singular_values[0]
    free = pp.identifiability(model, q, pp.Measurement("pose", base="free", target_known=False))
    assert free.nuisance_rank == 12
    assert free.rank == base + 6 - 12


@pytest.mark.slow
def test_ranks_with_a_prismatic_joint() -> None:
    chain = seven_joint_arm(prismatic=(2, 6))
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (7, 40))
    found = pp.identifiability(pp.every_frame(chain), q, pp.Measurement("pose"))
    assert found.rank == 4 * 5 + 2 * 2 + 6


def test_an_offset_and_a_turned_base_cannot_be_told_apart() -> None:
    chain = paper_model().chain
    sources = (
        JointOffset(joint="joint1", offset=pp.Normal(1e-3)),
        Mounting(at="base", rz=pp.Normal(1e-3), x=pp.Normal(1e-3)),
    )
    found = pp.identifiability(pp.ErrorModel(chain, Space(), sources), random_poses(4, 10), pp.Measurement())
    assert found.rank == 2
    assert found.determined == ("mounting[base].x",)
    (group,) = found.combinations
    assert group.names == ("joint_offset[joint1].offset", "mounting[base].rz")
    assert group.determined == 1
    assert group.unseen is not None
    np.testing.assert_allclose(group.unseen.weights, [np.sqrt(0.5), -np.sqrt(0.5)], atol=1e-9)


@pytest.mark.slow
def test_subspaces_do_not_depend_on_the_order_of_the_sources() -> None:
    model, q = paper_model(), random_poses(4, 30)
    turned = pp.ErrorModel(model.chain, Space(model.space.draws[::-1]), model.sources[::-1], model.poses)
    one, other = (pp.identifiability(each, q, pp.Measurement()) for each in (model, turned))
    assert one.rank == other.rank
    assert set(one.unseen) == set(other.unseen)
    assert set(one.determined) == set(other.determined)
    assert {frozenset(group.names): group.determined for group in one.combinations} == {
        frozenset(group.names): group.determined for group in other.combinations
    }
    places = [other.names.index(name) for name in one.names]
    np.testing.assert_allclose(other.projector[np.ix_(places, places)], one.projector, atol=1e-8)


@pytest.mark.slow
def test_subspaces_do_not_depend_on_the_order_of_poses_or_on_rounding() -> None:
    """Readings in another order, at joint values off by 1e-9: the same groups, as ties are broken nowhere."""
    model, q = pp.every_frame(paper_model().chain), random_poses(4, 30)
    generator = np.random.default_rng(2)
    moved = q[:, generator.permutation(30)] + generator.normal(0, 1e-9, q.shape)
    one, other = (pp.identifiability(model, each, pp.Measurement("pose")) for each in (q, moved))
    assert one.combinations
    assert [(group.names, group.determined) for group in one.combinations] == [
        (group.names, group.determined) for group in other.combinations
    ]
    np.testing.assert_allclose(other.projector, one.projector, atol=1e-6)


@pytest.mark.slow
def test_a_joint_without_load_has_no_identifiable_compliance() -> None:
    found = pp.identifiability(paper_model(), random_poses(4, 30), pp.Measurement("pose"))
    # joint 1 is upright, and the load hangs in the axis of joint 4
    assert found.unseen == ("joint_compliance[joint1].compliance", "joint_compliance[joint4].compliance")


def test_one_reading_determines_no_more_than_it_has_numbers() -> None:
    assert pp.identifiability(plain_model(), random_poses(4, 1), pp.Measurement()).rank == 3
    assert pp.identifiability(plain_model(), random_poses(4, 1), pp.Measurement("distance")).rank == 1


SOCKETS = ((0.9, 0.2, 0.8), (0.2, 0.9, 1.0), (-0.6, 0.5, 0.5))
PLANE = ((0.0, 0.0, 0.5), (0.1, -0.2, 1.0))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper", "ur5"])
def test_ranks_of_contact(name: str) -> None:
    """What moves no target against its place, of the 4R + 3 combinations that points determine.

    Known sockets leave nothing, and a known plane three moves along it and the scale of the arm about a point in it. With free
    places the six moves of the base go, and the scale of all lengths.
    """
    chain = chain_of(name)
    model, points = pp.every_frame(chain), 4 * len(chain.joints) + 3
    shrink = 0.5 if name == "ur5" else 1.0
    sockets = tuple(tuple(shrink * x for x in place) for place in SOCKETS)
    unseen = {}
    for base in ("known", "free"):
        for kind, place in (("socket", {"sockets": sockets}), ("plane", {"plane": PLANE})):
            measurement = pp.Measurement(kind, base=base, target=OFF_AXIS, **place)  # type: ignore[arg-type]
            poses = contact_poses(chain, measurement, 60)
            found = pp.identifiability(model, poses, measurement)
            unseen[kind, base] = points - found.rank
            assert found.nuisance_rank == len(measurement.nuisances)
            assert found.singular_values[found.rank - 1] > 1e-5 * found.singular_values[0]
            assert found.singular_values[found.rank :].max() < 1e-13 * found.singular_values[0]
            assert (
                list(doubt_contact(measurement, np.array([at.posture.pose for at in model.at_columns(poses.q)]))) == []
            )
    assert unseen == {("socket", "known"): 0, ("plane", "known"): 4, ("socket", "free"): 7, ("plane", "free"): 7}
