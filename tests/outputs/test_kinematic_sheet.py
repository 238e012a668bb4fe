"""The sheet of ``init --calibration``: everything that readings can tell of an arm is free, and nothing else is."""

import functools
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import precision_pin as pp
from support.plain_robot import joint, limits, link, robot

pytestmark = pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")

UNKNOWN = pp.Measurement("position", std="20 um", base="free", target_known=False, target="40 20 30 mm")
Y, Z = (0, 1, 0), (0, 0, 1)


def sheet_of(folder: Path, *parts: str) -> Path:
    (folder / "arm.urdf").write_text(robot(*parts), encoding="utf-8")
    path = folder / "arm.errors.yaml"
    path.write_text(
        pp.init(folder / "arm.urdf", calibration=True).replace(str(folder / "arm.urdf"), "arm.urdf"), "utf-8"
    )
    return path


def arm_parts(kinds: str) -> list[str]:
    """An arm whose axes are alternately along y and z, each link bent and turned, ``p`` sliding and ``r`` turning."""
    ranges = {"p": ("prismatic", -0.3, 0.3), "r": ("revolute", -2.5, 2.5)}
    parts = [link("root")]
    for k, kind in enumerate(kinds):
        what, low, high = ranges[kind]
        place = {"xyz": (0.1, 0.03, 0.25), "rpy": (0.2, -0.4, 0.3), "axis": Z if k % 2 else Y}
        parts += [
            link(f"l{k}", 1.0, (0.05, 0.02, 0.1)),
            joint(f"j{k}", what, f"l{k - 1}" if k else "root", f"l{k}", **place, extra=limits(low, high)),
        ]
    end = joint("end", "fixed", f"l{len(kinds) - 1}", "tip", (0.05, 0.1, 0.2), (0.3, 0.2, 0.1))
    return [*parts, link("tip"), end]


@functools.cache
def poses(kinds: str, count: int, seed: int = 0) -> np.ndarray:
    scale = np.array([0.3 if kind == "p" else 2.4 for kind in kinds])[:, None]
    return scale * np.random.default_rng(seed).uniform(-1, 1, (len(kinds), count))


@pytest.mark.parametrize("kinds", ["rrr", "rrrrrr", "prrr", "rpr"])
def test_geometry_is_complete_and_nothing_of_the_set_up_is_twice(kinds, tmp_path):
    """4R + 2P + 3 combinations are seen by a target; nine of them are base and target."""
    path = sheet_of(tmp_path, *arm_parts(kinds))
    text = path.read_text(encoding="utf-8")
    path.write_text("\n".join(row for row in text.splitlines() if not row.startswith("  - joint_compliance")), "utf-8")
    model = pp.ErrorModel.load(path)
    assert len(model.space.components) == 6 * (len(kinds) - 1)
    assert not any("[j0]" in name or "[tip]" in name for name in model.space.components)
    found = pp.identifiability(model, poses(kinds, 60), UNKNOWN)
    assert found.rank == 4 * kinds.count("r") + 2 * kinds.count("p") + 3 - 9


def test_each_joint_has_six_numbers_whatever_its_axis(tmp_path):
    """A zero replaces the displacement along or about an axis of the joint's frame; a skew axis has none to replace."""
    skew = [part.replace('xyz="0.0 0.0 1.0"', 'xyz="0.0 0.6 0.8"') for part in arm_parts("rprp")]
    for parts, counts in ((arm_parts("rprp"), (5, 5, 5)), (skew, (6, 5, 6))):
        sources = [
            (source.joint, source)
            for source in pp.ErrorModel.load(sheet_of(tmp_path, *parts)).sources
            if type(source).__name__ == "Frame"
        ]
        free = {name: sum(getattr(s, d) != 0.0 for d in ("x", "y", "z", "rx", "ry", "rz")) for name, s in sources}
        assert free == dict(zip(("j1", "j2", "j3"), counts, strict=True))


def test_an_arm_wrong_in_every_frame_is_found_from_a_tracker(tmp_path):
    """The truth is built of other sources, stands anywhere, and is judged at poses that were not read."""
    kinds, rng = "rrrrrr", np.random.default_rng(3)
    path = sheet_of(tmp_path, *arm_parts(kinds))
    model = pp.ErrorModel.load(path)
    truth = pp.every_frame(model.chain)
    bent = pp.ErrorModel(
        model.chain,
        pp.Space(),
        [pp.sources.JointCompliance(joint=f"j{k}", compliance=c) for k, c in ((1, 3e-5), (2, 5e-5), (3, 2e-5))],
    )
    x = truth.space.sample(seed=5, first=0, count=1)
    turn, shift, target = (
        Rotation.from_rotvec([0.3, -0.2, 2.1]),
        np.array([2.0, -1.0, 0.4]),
        np.array([0.04, 0.02, 0.03]),
    )

    def read(q: np.ndarray) -> np.ndarray:
        seen = []
        for at, sag in zip(truth.at_many(q), bent.at_many(q), strict=True):
            error = at.exact(x)[:, 0] + sag.exact(np.zeros((0, 1)))[:, 0]
            pose = at.posture.pose
            seen.append(pose[:3, 3] + error[:3] + Rotation.from_rotvec(error[3:]).apply(pose[:3, :3] @ target))
        return turn.apply(seen) + shift

    q, new = poses(kinds, 60), poses(kinds, 40, seed=1)
    readings = read(q) + rng.normal(0, 20e-6, (60, 3))
    arm = pp.calibrate(model, (q, readings))
    base, mount = arm.set_up.base, arm.set_up.target
    predicted = np.array([(base @ arm.predict(column) @ [*mount, 1])[:3] for column in new.T])
    left = np.linalg.norm(predicted - read(new), axis=1)
    assert np.sqrt((left**2).mean()) < 40e-6
    assert arm.improvement.share.verdict in ("honest", "undecided")
    assert 14e-6 < arm.noise["std"].std < 28e-6


def test_masses_decide_which_compliances_are_free(tmp_path):
    model = pp.ErrorModel.load(sheet_of(tmp_path, *arm_parts("rrr")))
    compliant = [name for name in model.space.components if "compliance" in name]
    assert len(compliant) == 3
    massless = [part for part in arm_parts("rrr") if not part.startswith("<link")]
    massless += [link(name) for name in ("root", "l0", "l1", "l2", "tip")]
    model = pp.ErrorModel.load(sheet_of(tmp_path, *massless))
    assert not [name for name in model.space.components if "compliance" in name]
