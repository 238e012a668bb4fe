"""The model at many poses: terms made together, and first-order models computed together, against one pose at a time."""

from dataclasses import dataclass

import numpy as np
import pytest

from precision_pin import ErrorModel, InputError, Normal, Posture, Source, Space, Term, Uniform
from precision_pin.draws.space import LabelledSpace
from precision_pin.model.pose_model import tangents
from precision_pin.robot.examples import shipped_sheets
from precision_pin.sources import Backlash, Beam, Encoder, JointCompliance, Payload
from precision_pin.terms.bound_source import BoundSource, own_draws, terms_at_many, with_quantities
from precision_pin.terms.term import JointValue
from sources.test_depends_on import ARMS, CASES, Liar

ALONE = {"backlash", "clearance", "servo"}
"""Kinds whose terms may change with the side that a load presses on: they are made at one pose after another."""


def configurations(chain, poses: int, seed: int = 5):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (len(chain.joints), poses))


@pytest.mark.fast(14)
@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize(("kind", "source"), [case[:2] for case in CASES])
def test_terms_made_together_are_those_made_one_by_one(kind, source, arm):
    chain = ARMS[arm]
    model = ErrorModel(chain, Space(), [source, Payload(at="half2", mass=Uniform(0.1, mean=2.0))])
    q = configurations(chain, 7)
    travelling = kind == "bearing_stiffness" and bool(chain.prismatic[chain.joint_index(source.joint)])
    assert source.accepts_many(chain) is (kind not in ALONE and not travelling)
    many = list(model.at_columns(q))
    for k, at in enumerate(many):
        alone = model._at(chain.at(q[:, k]))
        assert [(term.target, term.factors, term.loaded) for term in at.terms] == [
            (term.target, term.factors, term.loaded) for term in alone.terms
        ]
        for one, other in zip(at.terms, alone.terms, strict=True):
            assert np.allclose(one.twist, other.twist, rtol=1e-12, atol=1e-13 * (1 + np.abs(other.twist).max()))
        assert np.allclose(at.table.twists, alone.table.twists, rtol=1e-12, atol=1e-12)
        assert np.allclose(at.table.frames, alone.table.frames, rtol=0, atol=1e-14)
        assert np.allclose(at.table.pose, alone.table.pose, rtol=0, atol=1e-14)
        assert np.allclose(at.posture.pose, alone.posture.pose, rtol=0, atol=1e-14)


def together(chain, sources, q):
    """Return the terms at many poses, None where they cannot be made together."""
    space = with_quantities(Space().including(own_draws(sources, [s.label() for s in sources])), sources,
                            [s.label() for s in sources], chain)  # fmt: skip
    bound = [BoundSource(source, LabelledSpace(space, source.label())) for source in sources]
    many = chain.at_columns(q)
    each = [chain.at(q[:, k]) for k in range(q.shape[1])]
    return terms_at_many(Posture(chain, many.q, many.joint_poses, chain.loads), each, bound)


@pytest.mark.slow
def test_what_turns_or_grows_between_poses_is_found():
    """A side, and loads that depend on the configuration: the model falls back on one pose after another."""
    chain = ARMS["base to tool"]
    q = configurations(chain, 40)
    torques = np.array([chain.at(q[:, k]).load_torque[1] for k in range(40)])
    firm = np.abs(torques) > 60.0
    assert 0 < firm.sum() < 40
    backlash = Backlash(joint="joint2", backlash=1e-3, band=60.0)
    terms = together(chain, [backlash], q[:, firm])
    assert np.array_equal(terms[0].twist[0], np.sign(torques[firm]) * 0.5e-3)
    liar, soft = Liar(reads="loads", says="loads"), JointCompliance(joint="joint2", compliance=1e-5)
    for sources in ([backlash, Encoder(joint="joint3", resolution=1e-4)], [liar, soft]):
        assert together(chain, sources, q) is None
        model = ErrorModel(chain, Space(), sources)
        for k, at in enumerate(model.at_columns(q)):
            assert np.allclose(at.table.twists, model.at(q[:, k]).table.twists, rtol=0, atol=1e-15)


@dataclass(frozen=True, kw_only=True)
class Plain(Source):
    """A source of a user, who reads one torque, or gives two twists at one posture."""

    twice: bool = False

    @property
    def subject(self):
        return "arm"

    def terms(self, posture, space):
        size = np.ones((1, 2)) if self.twice else float(sum(posture.torque_on(0).values()))
        yield Term.of(JointValue(0), size)


def test_a_source_of_a_user_needs_to_know_nothing_of_it_but_gives_one_twist():
    chain = ARMS["base to tool"]
    q = configurations(chain, 4)
    terms = together(chain, [Plain()], q)
    assert np.allclose(terms[0].twist[0], [sum(chain.at(q[:, k]).torque_on(0).values()) for k in range(4)])
    with pytest.raises(InputError, match="one twist, of 6 numbers for a place and 1 for a joint value"):
        ErrorModel(chain, Space(), [Plain(twice=True)]).at(np.zeros(len(chain.joints)))


# first-order models --------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*W_COLLISION")  # joint values at random
def test_tangents_are_those_of_one_pose():
    """Of poses together, in parts where formulas change between poses; errors of half a turn are refused."""
    chain = ARMS["base to tool"]
    backlash = Backlash(joint="joint2", backlash=Normal(1e-4, mean=1e-3), band=60.0)
    changing = ErrorModel(chain, Space(), [backlash, Beam(link="link3", EI=Uniform(1e3, mean=1e4))])
    shipped = [ErrorModel.load(shipped_sheets()[sheet]) for sheet in ("4dof", "ur5")]
    for model, count in ((changing, 30), *((one, 5) for one in shipped)):
        q = configurations(model.chain, count)
        found = list(tangents(model.at_columns(q)))
        assert (len(found) == 1) is (model is not changing)
        error = np.concatenate([part.error for part in found], axis=1)
        jacobian = np.concatenate([part.jacobian for part in found], axis=2)
        for k in range(q.shape[1]):
            e, j = model.at(q[:, k]).tangent
            assert np.allclose(error[:, k], e, rtol=0, atol=1e-14)
            assert np.allclose(jacobian[:, :, k], j, rtol=0, atol=1e-12 * np.abs(j).max())
    soft = ErrorModel(chain, Space(), [JointCompliance(joint="joint2", compliance=10.0)])
    with pytest.raises(InputError, match="180° or more"):
        list(tangents(soft.at_columns(configurations(chain, 3))))
