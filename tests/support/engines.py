"""One source through the sheet and through every engine."""

from pathlib import Path

import numpy as np

from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sampling import monte_carlo
from support.oracles import displaced_pose, displacements
from support.plain_robot import pose_error

GANTRY = """\
<robot name="slide">
  <link name="base"/>
  <joint name="rail" type="prismatic"><parent link="base"/><child link="carriage"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <link name="carriage"/>
  <joint name="lift" type="prismatic"><origin xyz="0 0.2 0.1"/><parent link="carriage"/><child link="arm"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <link name="arm"><inertial><origin xyz="0.3 0 0"/><mass value="4"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="bolt" type="fixed"><origin xyz="0.5 0 0"/><parent link="arm"/><child link="tool"/></joint>
  <link name="tool"/>
</robot>
"""
"""A gantry: a rail along x, a lift along z that carries 4 kg."""


def written(folder: Path, sources: str, *, parameters: str = "", sliding: bool = False, extra: str = "") -> Path:
    """Return a sheet of the paper's arm, or of a gantry, with these sources (one a line)."""
    robot = PAPER_SHEET.parent / "4dof.urdf"
    if sliding:
        robot = folder / "gantry.urdf"
        robot.write_text(GANTRY, encoding="utf-8")
    pose = "300 -200 mm" if sliding else "-90 3 88 -91 deg"
    lines = ["precision-pin: 1", f"robot: {robot}", "tip: tool", f"poses: {{here: {pose}}}"]
    lines += [f"{extra}"] if extra else []
    lines += [f"parameters: {{{parameters}}}"] if parameters else []
    lines += ["sources:", *(f"  - {line}" for line in sources.strip().splitlines())]
    file = folder / "arm.errors.yaml"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def check_engines(model: ErrorModel, q=None, *, seed: int = 8) -> None:
    """Compare exact with the oracle, tangent with its slope, linear to second order, the sampler with exact."""
    at = model.at(q)
    x = model.space.sample(seed, 0, 40)
    exact = at.exact(x)
    for column, error in zip(x.T, exact.T, strict=True):
        totals = displacements(at.terms, dict(zip(model.space.components, column, strict=True)))
        moved = displaced_pose(model.chain, at.posture.q, totals)
        np.testing.assert_allclose(error, pose_error(moved, at.posture.pose), rtol=0, atol=1e-13)
    size = np.linalg.norm(exact, axis=0)
    assert size.max() > 0
    reach = 1 + np.linalg.norm(at.posture.pose[:3, 3])
    assert (np.linalg.norm(at.linear(x) - exact, axis=0) <= 5 * reach * size**2 + 1e-14).all()
    e0, jacobian = at.tangent
    mean, deviation = model.space.mean, np.sqrt(np.diag(model.space.covariance))
    np.testing.assert_allclose(e0, at.exact(mean[:, None])[:, 0], rtol=0, atol=1e-15)
    for k, step in enumerate(1e-2 * deviation):
        ahead, behind = (at.exact((mean + sign * step * np.eye(mean.size)[k])[:, None])[:, 0] for sign in (1, -1))
        slope = (ahead - behind) / 2
        np.testing.assert_allclose(jacobian[:, k] * step, slope, rtol=0, atol=1e-6 * np.abs(exact).max() + 1e-15)
    for name, engine in (("exact", at.exact), ("linear", at.linear)):
        result = monte_carlo(model, at.posture.q, samples=2000, seed=seed, model=name)
        expected = engine(model.space.sample(seed, 0, 2000))
        spread = np.sqrt(np.diag(np.cov(expected))) + 1e-12
        assert np.abs((result.covariance - np.cov(expected)) / np.outer(spread, spread)).max() < 1e-8
        np.testing.assert_allclose(result.summary.mean[:6], expected.mean(axis=1), rtol=0, atol=1e-8 * spread.max())


def check_no_spread(model: ErrorModel, q=None) -> None:
    """Check that tolerances of zero leave no spread."""
    at = model.at(q)
    np.testing.assert_array_equal(np.ptp(at.exact(model.space.sample(3, 0, 10)), axis=1), np.zeros(6))
    np.testing.assert_array_equal(np.ptp(at.linear(model.space.sample(3, 0, 10)), axis=1), np.zeros(6))
