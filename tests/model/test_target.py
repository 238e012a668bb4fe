"""A target off the tip: the errors there are those of the tip with the lever arm's shift, and loads and places stay."""

import itertools
from operator import attrgetter

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import precision_pin as pp
from precision_pin import InputError, Normal, Uniform
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sheet import Overrides, read
from precision_pin.sources import Mounting, Thermal
from precision_pin.writers.as_built import AsBuilt
from support.sheets import named

pytestmark = pytest.mark.slow

POINT = np.array([0.03, -0.08, 0.2])
POSES = np.radians([[-90, 3, 88, -91], [20, -40, 70, 10]]).T


@pytest.fixture(scope="module", params=["equilibrium", "nominal"])
def arms(request) -> list[pp.ErrorModel]:
    """Return the paper's arm, which bends under a payload, with a warm and badly mounted tool; and the same with a target."""
    sheet = pp.ErrorModel.load(PAPER_SHEET)
    warm = Thermal(expansion=Uniform(1e-6, mean=23e-6), temperature_change=Uniform(3.0, mean=5.0))
    sources = [*sheet.sources, Mounting(at="tool", x=Uniform(1e-4), ry=Normal(1e-3)), warm]
    chains = (sheet.chain, sheet.chain.with_target(POINT))
    return [pp.ErrorModel(chain, named(sheet), sources, statics=request.param) for chain in chains]


def at_lever(errors: np.ndarray, lever: np.ndarray) -> np.ndarray:
    """Return errors ``(6, N)`` of a point at a lever arm (base axes) from that whose errors are given."""
    turned = Rotation.from_rotvec(errors[3:].T).apply(lever) - lever
    return np.concatenate([errors[:3] + turned.T, errors[3:]])


def test_the_errors_at_a_target_are_those_of_the_tip_with_the_lever_arms_shift(arms):
    tip, target = arms
    x = tip.space.sample(0, 0, 20)
    for q in POSES.T[1:]:
        at, there = tip.at(q), target.at(q)
        lever = at.posture.pose[:3, :3] @ POINT
        np.testing.assert_allclose(there.posture.pose[:3, 3], at.posture.pose[:3, 3] + lever, atol=1e-14)
        np.testing.assert_allclose(there.exact(x), at_lever(at.exact(x), lever), atol=1e-12)
        linear = at.linear(x)
        linear[:3] += np.cross(linear[3:].T, lever).T
        np.testing.assert_allclose(there.linear(x), linear, atol=1e-12)
        # the first-order model, by central differences of the shift
        mean, jacobian = at.tangent
        steps = np.eye(6) * 1e-6
        slopes = (at_lever(mean[:, None] + steps, lever) - at_lever(mean[:, None] - steps, lever)) / 2e-6
        np.testing.assert_allclose(there.tangent[1], slopes @ jacobian, rtol=1e-8, atol=1e-8)
        # all else stays: torques, wrenches, places, and what the sources make of them
        for part in (
            "posture.load_torque",
            "posture.link_wrench",
            "posture.loaded_ends",
            "table.frames",
            "table.twists",
        ):
            one, other = (attrgetter(part)(of) for of in (there, at))
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("arms", ["nominal"], indirect=True)
def test_the_sampler_the_jacobian_and_robots_as_built_speak_of_the_target(arms):
    _, target = arms
    drawn = pp.monte_carlo(target, POSES[:, 0], samples=512, seed=3)
    expected = target.at(POSES[:, 0]).exact(target.space.sample(3, 0, 512)).mean(axis=1)
    means = [drawn.summary.distribution(f"position.{axis}").mean for axis in "xyz"]
    np.testing.assert_allclose(means, expected[:3], rtol=1e-9)
    assert drawn.tip == "tool + 30 -80 200 mm"
    for q, joint in itertools.product(POSES.T, range(4)):
        step = 1e-6
        ahead, behind = (target.chain.at(q + sign * step * np.eye(4)[joint]).pose[:3, 3] for sign in (1, -1))
        slope = target.chain.at(q).joint_jacobian[:3, joint]
        np.testing.assert_allclose((ahead - behind) / (2 * step), slope, atol=1e-8)
    # writing robots compares what is written with the exact model
    assert len(list(AsBuilt.prepare(target, POSES[:, 0], sheet="target.yaml").units(0, 0, 2))) == 2


def test_inverse_kinematics_brings_the_target_to_a_place():
    chain = pp.ErrorModel.load(PAPER_SHEET).with_({"target": "30 -80 200 mm"}).chain
    places = pp.box_places([1.0, 2.0], 0.4, 0.3)
    poses = pp.place_grid(chain, places, pp.Orientation.free(), branches="all")
    assert len(poses) >= 4
    tip = pp.ErrorModel.load(PAPER_SHEET).chain
    for q, node in zip(poses.q.T, poses.node, strict=True):
        pose = tip.at(q).pose
        np.testing.assert_allclose(pose[:3, :3] @ POINT + pose[:3, 3], places[:, node], atol=1e-9)


def test_a_target_of_the_command_line_replaces_the_sheets(tmp_path):
    (tmp_path / "4dof.urdf").write_bytes(PAPER_SHEET.with_name("4dof.urdf").read_bytes())
    text = PAPER_SHEET.read_text(encoding="utf-8")
    (tmp_path / "a.yaml").write_text(text.replace("tip: tool", "tip: tool\ntarget: 0 0 1 cm"))
    own = read(tmp_path / "a.yaml")
    given = read(tmp_path / "a.yaml", overrides=Overrides(target="1 2 3 mm"))
    found = [one.chain.target.tolist() for one in (own, given, own.with_changes({"target": "0 3 0 mm"}))]
    assert found == [[0, 0, 0.01], [0.001, 0.002, 0.003], [0, 0.003, 0]]
    bare = read(tmp_path / "a.yaml", overrides=Overrides(target="0 0 0 mm")).chain
    assert bare.tip_label == "tool"
    for wrong, message in (
        ("0 0 mm", "target: '0 0 mm' has 2 numbers, expected 3; write it as '0 0 100 mm', in the tip's axes"),
        ("0 0 1 deg", "target: 'deg' in '0 0 1 deg' is not a unit of length"),
        ("0 0 2000 m", "target: '0 0 2000 m' is farther than 1,000 m from the tip"),
    ):
        (tmp_path / "b.yaml").write_text(text.replace("tip: tool", f"tip: tool\ntarget: {wrong}"))
        with pytest.raises(InputError) as caught:
            read(tmp_path / "b.yaml")
        (finding,) = [found for found in caught.value.findings if found.severity == "error"]
        assert message in finding.message
        assert finding.line == text[: text.index("tip: tool")].count("\n") + 2
