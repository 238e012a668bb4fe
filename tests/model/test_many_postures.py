"""The model at many poses: terms made together, and first-order models computed together, against one pose at a time."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from precision_pin import ErrorModel, InputError, Posture, Source, Space, Term, Uniform
from precision_pin.draws.space import LabelledSpace
from precision_pin.model.pose_model import tangents
from precision_pin.robot.examples import shipped_sheets
from precision_pin.sources import Backlash, Beam, Clearance, JointCompliance, Payload, Servo, Transmission
from precision_pin.sources.places import travels
from precision_pin.terms.bound_source import BoundSource, load_postures, own_draws, terms_at_many, with_quantities
from precision_pin.terms.term import JointValue, TermsOfPose
from sources.test_depends_on import ARMS, CASES, Liar


def configurations(chain, poses: int, seed: int = 5):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (len(chain.joints), poses))


@pytest.mark.fast(14)
@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize(("kind", "source"), [case[:2] for case in CASES])
def test_terms_made_together_are_those_made_one_by_one(kind, source, arm):
    chain = ARMS[arm]
    model = ErrorModel(chain, Space(), [source, Payload(at="half2", mass=Uniform(0.1, mean=2.0))])
    q = configurations(chain, 7)
    travelling = kind in ("bearing_stiffness", "clearance") and travels(
        chain, chain.joint_index(source.joint), source.pads_on
    )
    assert source.accepts_many(chain) is not travelling
    check_alike(model, q)


def check_alike(model, q, approaches=None):
    """Compare the model at poses together with that at each: terms, errors of ten robots, and targets."""
    x = model.space.sample(0, 0, 10)
    for k, at in enumerate(model.at_columns(q, approaches)):
        alone = model._at(replace(model.chain.at(q[:, k]), approach=() if approaches is None else (*approaches[:, k],)))
        if isinstance(at.terms, TermsOfPose):  # else a formula with numbers of the pose, equal to rounding
            together, single = twists_by_factors(at), twists_by_factors(alone)
            assert together.keys() >= single.keys()
            scale = 1e-13 * (1 + max((np.abs(twist).max() for twist in single.values()), default=0))
            for key, twist in together.items():
                # terms that other poses have are zero here
                assert np.allclose(twist, single.get(key, 0.0), rtol=1e-12, atol=scale)
        # frames, which differ by rounding, are compared by themselves
        framed = replace(alone, table=replace(alone.table, frames=at.table.frames, pose=at.table.pose))
        assert np.allclose(at.exact(x), framed.exact(x), rtol=1e-12, atol=1e-14)
        assert np.allclose(at.table.frames, alone.table.frames, rtol=0, atol=1e-14)
        assert np.allclose(at.table.pose, alone.table.pose, rtol=0, atol=1e-14)
        assert np.allclose(at.posture.pose, alone.posture.pose, rtol=0, atol=1e-14)


def twists_by_factors(at):
    twists = {}
    for term in at.terms:
        key = term.target, term.factors, term.loaded
        twists[key] = twists.get(key, 0.0) + term.twist
    return twists


def together(chain, sources, q):
    """Return the terms at many poses, None where they cannot be made together."""
    space = with_quantities(Space().including(own_draws(sources, [s.label() for s in sources])), sources,
                            [s.label() for s in sources], chain)  # fmt: skip
    bound = [BoundSource(source, LabelledSpace(space, source.label())) for source in sources]
    many = chain.at_columns(q)
    each = [chain.at(q[:, k]) for k in range(q.shape[1])]
    postures = load_postures(Posture(chain, many.q, many.joint_poses, chain.loads), each, bound)
    return None if postures is None else terms_at_many(*postures, bound)


DRIVE = Servo(joint="joint2", stiffness=Uniform(1e4, mean=1e5), friction=Uniform(1.0, mean=20.0), load_friction=0.1)
PLAY = Backlash(joint="joint2", backlash=Uniform(1e-4, mean=1e-3), band=60.0)
LOOSE = Clearance(joint="joint2", diametral=(2e-5, 3e-5), span=0.3, axial=Uniform(1e-6, mean=1e-5), band=50.0)
PIECES = {"joint": "joint2", "stiffness": (2e4, Uniform(1e4, mean=1e5), 4e5), "limit_torques": (30.0, 70.0)}
GEAR = Transmission(**PIECES, hysteresis_loss=Uniform(1e-5, mean=1e-4))
SIDED = {"servo": [DRIVE, PLAY], "backlash": [PLAY], "clearance": [LOOSE], "gear": [GEAR, PLAY]}
"""Sources that arise in different ways, by the load and by how a joint arrived."""


@pytest.mark.parametrize("mass", [2.0, Uniform(1.9, mean=2.0)], ids=["fixed", "random"])
@pytest.mark.parametrize("sources", SIDED.values(), ids=SIDED)
def test_sides_that_change_between_poses(sources, mass):
    """Without an approach, with one, and with one in some poses; at once where all robots agree on the side."""
    chain = ARMS["base to tool"]
    model = ErrorModel(chain, Space(), [*sources, Payload(at="half2", mass=mass)])
    q = configurations(chain, 40)
    approaches = np.random.default_rng(6).integers(-1, 2, q.shape).astype(np.int8)
    known = np.where(approaches == 0, np.int8(1), approaches)
    for directions in (None, known, approaches):
        if mass == 2.0 or directions is known:
            are_together = {isinstance(at.terms, TermsOfPose) for at in model.at_columns(q, directions)}
            assert are_together == {mass == 2.0}
        check_alike(model, q, directions)


@pytest.mark.slow
def test_loads_that_grow_between_poses_are_found():
    """The model falls back on one pose after another."""
    chain = ARMS["base to tool"]
    q = configurations(chain, 40)
    sources = [Liar(reads="loads", says="loads"), JointCompliance(joint="joint2", compliance=1e-5)]
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
    load = Payload(at="half2", mass=Uniform(1.9, mean=2.0))
    changing = ErrorModel(chain, Space(), [GEAR, load, Beam(link="link3", EI=Uniform(1e3, mean=1e4))])
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
