"""Loads on bent links, in equilibrium: closed forms of columns, an elastica, and arms with more joints or shorter links."""

import numpy as np
import pytest
from scipy import integrate, optimize

from precision_pin import ErrorModel, InputError, Space, Uniform
from precision_pin.model.equilibrium import Feedback
from precision_pin.sources import Beam, Frame, JointCompliance, Payload
from support.oracles import settled_errors
from support.plain_robot import chain_of, joint, link, robot, unit

DOWN = (-9.81, 0.0, 0.0)
HINGE = joint("hinge", "revolute", "base", "arm", axis=(0, 1, 0))
CRITICAL = 100 * optimize.brentq(lambda u: u * np.tan(u) - 1, 0.1, 1.5) ** 2
"""Critical load, N, of a column of 1 m and 100 N·m² on a spring of 100 N·m/rad: u² EI/l² with u tan u = k l/EI."""


def on_a_spring(weight, hangs="payload", lean=0.0, aside=1e-4, spring=100.0, rigidity=100.0) -> ErrorModel:
    """Return a link of 1 m on a spring with a weight (N) on its end, or, with a rigid joint between, beyond it."""
    mass = weight / 9.81
    parts = [link("base"), HINGE, link("arm")]
    if hangs == "joint":
        parts += [joint("rigid", "revolute", "arm", "hand", (1, 0, 0)), link("hand")]
        parts += [joint("flange", "fixed", "hand", "tool"), link("tool")]
    else:
        parts += [joint("flange", "fixed", "arm", "tool", (1, 0, 0))]
        parts += [link("tool", mass, (0, 0, aside)) if hangs == "motor" else link("tool")]
    sources = [Beam(link="arm", EI=rigidity), JointCompliance(joint="hinge", compliance=1 / spring)]
    if hangs == "frame":
        sources.append(Frame(link="arm", z=aside))
        aside = 0.0
    if hangs != "motor":
        sources.append(Payload(at="tool", mass=mass, com=(0.0, 0.0, aside)))
    q = [lean, 0.0] if hangs == "joint" else [lean]
    return ErrorModel(chain_of(robot(*parts), gravity=DOWN), Space(), sources, {"": q}, statics="equilibrium")


@pytest.mark.slow
@pytest.mark.parametrize("hangs", ["payload", "motor", "joint", "frame"])
def test_what_hangs_on_a_column_loads_the_spring_below_where_the_column_has_moved_it(hangs):
    """EI y'' = P (δ + e - y) on the spring: δ = e A / (1 - A), A = 1 - cos u + P sin u / k u, u = l √(P/EI).

    e is that of the weight on the end or of the end itself, which then is at δ + e.
    """
    load = 0.9 * CRITICAL
    u = np.sqrt(load / 100)
    share = 1 - np.cos(u) + load * np.sin(u) / (100 * u)
    moved = np.linalg.norm(on_a_spring(load, hangs).at().error_at_means[:3])
    assert moved == pytest.approx(1e-4 * (1 if hangs == "frame" else share) / (1 - share), rel=1e-5)


@pytest.mark.slow
def test_past_its_critical_load_a_column_on_a_spring_is_refused():
    with pytest.raises(InputError, match="the arm buckles under its loads: beyond") as caught:
        on_a_spring(1.2 * CRITICAL).at()
    told = float(caught.value.findings[0].message.split("beyond ")[1].split()[0])
    assert told == pytest.approx(1 / 1.2, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("lean", [np.pi / 4, 3 * np.pi / 4])
def test_an_arm_at_45_degrees_is_an_elastica(lean):
    """1 m, 500 N·m² on 2000 N·m/rad, 5 kg, standing and hanging: θ' = M/EI, M' = -W sin θ, as a boundary value problem."""

    def slopes(_, y):
        return np.vstack([y[1] / 500, -49.05 * np.sin(y[0]), np.sin(y[0]), np.cos(y[0])])

    def ends(first, last):
        return np.array([first[0] - lean - first[1] / 2000, last[1], first[2], first[3]])

    way = np.linspace(0, 1, 21)
    guess = np.vstack([lean + 0 * way, 35 * (1 - way), way * np.sin(lean), way * np.cos(lean)])
    exact = integrate.solve_bvp(slopes, ends, way, guess, tol=1e-8).y[2:, -1] - [np.sin(lean), np.cos(lean)]
    moved = on_a_spring(49.05, "payload", lean, 0.0, 2000.0, 500.0).at().error_at_means[[2, 0]]
    assert np.linalg.norm(moved * [-1, 1] - exact) < 1.5e-4 * np.linalg.norm(exact)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("own", "motor", "self_weight", "within"),
    [
        (783.73, 0.0, "uniform", 1e-4),
        (0.0, 100 * np.pi**2, "uniform", 1e-2),
        (100 * np.pi**2, 0.0, "centre", 1e-2),
    ],
)
def test_clamped_columns_buckle_under_weights_along_them(own, motor, self_weight, within):
    """Own weight: q l³/EI = 7.8373 (Greenhill); a motor at half the height, or all weight there: a column of half the length.

    The growth per round of the loads is one at the critical load.
    """
    parts = [link("base"), HINGE, link("arm", own / 9.81, (0.5, 0, 0))]
    parts += [joint("bolt", "fixed", "arm", "motor", (0.5, 0, 0)), link("motor", motor / 9.81)]
    parts += [joint("flange", "fixed", "motor" if motor else "arm", "tool", (0.5 if motor else 1, 0, 0)), link("tool")]
    chain = chain_of(robot(*parts), tip="tool", gravity=DOWN)
    model = ErrorModel(chain, Space(), [Beam(link="arm", EI=100.0, self_weight=self_weight)])
    feedback = Feedback(model.at([0.0]).posture, model.space, model.bound_sources, model.space.mean)
    ways = feedback.loaded_directions
    slopes = feedback.slopes(feedback.term_slopes(feedback.at_start, ways), ways)
    assert np.linalg.eigvals(slopes).real.max() == pytest.approx(1.0, rel=within)


def bent_arm(seed, rigid=False, displaced=False, pieces=1, softness=1.0, statics="equilibrium") -> ErrorModel:
    """Return two bent links at random, each with its own weight and a motor halfway, and a payload.

    ``rigid``: with a fixed frame and a joint without a spring at each link's end. ``pieces``: each link is a row of links
    with such joints between; one of them carries the motor.
    """
    draw = np.random.default_rng(seed)
    parts, sources, q, parent, at = [link("base")], [], [], "base", np.array([0, 0, 0.2])
    for k in range(2):
        along, axis = draw.uniform(0.5, 1) * unit(draw.normal(size=3)), unit(draw.normal(size=3))
        turn, lever = draw.uniform(-3, 3, 3), draw.uniform(-0.1, 0.1, 3)
        mass, motor, spring, bending, twisting = draw.uniform([1, 0.5, 1e3, 500, 300], [4, 3, 5e3, 900, 600]).tolist()
        q += [draw.uniform(-3, 3), *np.zeros(pieces - 1 + rigid)]
        sources.append(JointCompliance(joint=f"joint{k}.0", compliance=softness / spring))
        for piece in range(pieces):
            name = f"link{k}.{piece}"
            parts.append(joint(f"joint{k}.{piece}", "revolute", parent, name, at, np.zeros(3) if piece else turn, axis))
            parts.append(link(name, mass / pieces, along / pieces / 2))
            sources.append(Beam(link=name, EI=bending / softness, GI=twisting / softness, EA=1e6))
            parent, at = name, along / pieces
        half = along / 2 if pieces == 1 else np.zeros(3)
        carrier = f"link{k}.{pieces // 2}"
        parts += [joint(f"bolt{k}", "fixed", carrier, f"motor{k}", half), link(f"motor{k}", motor, lever)]
        if rigid:
            parts += [joint(f"frame{k}", "fixed", parent, f"frame{k}", at), link(f"frame{k}")]
            parts += [joint(f"rigid{k}", "revolute", f"frame{k}", f"rigid{k}", axis=axis), link(f"rigid{k}")]
            parent, at = f"rigid{k}", np.zeros(3)
    parts += [joint("flange", "fixed", parent, "tool", at), link("tool")]
    chain = chain_of(robot(*parts), tip="tool", gravity=tuple(9.81 * unit(draw.normal(size=3))))
    frame = [Frame(link="link1.0", x=3e-3, y=-2e-3, ry=1e-2)] if displaced else []
    payload = Payload(at="tool", mass=Uniform(0.5, mean=draw.uniform(1, 5)))
    return ErrorModel(chain, Space(), [*sources, *frame, payload], {"": q}, statics=statics)


@pytest.mark.slow
def test_a_rigid_joint_at_the_end_of_each_link_changes_nothing():
    """The payload then hangs beyond a joint; a frame, too, displaces the link's end."""
    one, other = (bent_arm(1, rigid, displaced=True).at() for rigid in (False, True))
    np.testing.assert_allclose(other.error_at_means, one.error_at_means, rtol=0, atol=1e-11)
    np.testing.assert_allclose(other.jacobian, one.jacobian, rtol=0, atol=1e-8 * np.abs(one.jacobian).max())


def settled(seed, **settings) -> np.ndarray:
    model = bent_arm(seed, **settings)
    return settled_errors(model, model.poses[""], model.space.mean[:, None])[:, 0]


@pytest.mark.slow
def test_a_link_in_pieces_is_the_same_link():
    """Two pieces: within a thousandth of what the bent links change; four are closer to two than two to one."""
    gaps = []
    for seed in (2, 3):
        one, two = settled(seed), settled(seed, pieces=2)
        nominal = bent_arm(seed, statics="nominal").at().error_at_means
        gaps.append(np.linalg.norm(two - one))
        assert gaps[-1] < 1e-3 * np.linalg.norm(one - nominal)
    assert np.linalg.norm(settled(3, pieces=4) - two) < gaps[-1] / 2
