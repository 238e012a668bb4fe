"""Limits along the tool's axes and joint limits: counts against scipy's rotations, and laws with closed forms."""

import math
import re
import shutil

import numpy as np
import pytest
from scipy import special
from scipy.spatial.transform import Rotation

import precision_pin as pp
from precision_pin.sampling.figures import figure_across
from precision_pin.statistics import Specification, SpecificationResult
from precision_pin.statistics.accumulate import observe, start
from precision_pin.statistics.plan import Plan
from sampling.cases import MODEL

SHEET = """
precision-pin: 1
robot: 4dof.urdf
tip: tool
poses: {bent: -1.2 0.4 1.1 -0.7 rad}
parameters: {a: {normal: 1 mm}, b: {normal: 1 mm}}
sources: [{frame: {frame: tool, x: a, y: b}}]
"""
BENT = [-1.2, 0.4, 1.1, -0.7]
STRAIGHT = [0.3, 0.0, 0.2, 0.1]
JOINT = "all of: 2.2 mm lateral, 2.4 mm axial, 400 mrad tilt @ 60 %"
TEXTS = (
    "1.5 mm lateral @ 60 %", "zone 3 mm @ 60 %", "1 mm axial @ 60 %", "tool x 1 mm", "0.9 mm tool y", "tool z 1 mm",
    "tool rx 150 mrad", "tool ry 0.2 rad", "tool rz 300 mrad", "tilt 250 mrad @ 50 %", "x 1 mm", JOINT,
)  # fmt: skip
SPECIFICATIONS = [pp.specification(text) for text in TEXTS]


def arm(*std: float, mean: tuple[float, ...] = (0.0,) * 6) -> pp.ErrorModel:
    """Return an arm whose tool has independent normal errors in its own axes, mm and rad."""
    scaled = tuple(1e-3 * one for one in std[:3]) + std[3:]
    return pp.ErrorModel(MODEL.chain, pp.Space(), [pp.sources.Covariance(frame="tool", std=scaled, mean=mean)])


WIDE = arm(0.8, 1.1, 1.0, 0.2, 0.15, 0.4, mean=(3e-4, 0, -2e-4, 0.02, 0, 0.1))


def kept(errors: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Return which of the errors keep each of `TEXTS`, by scipy's rotations."""
    x, y, z = np.array(axes).T @ errors[:3]
    tool_z = Rotation.from_rotvec(errors[3:].T.copy()).apply(np.array(axes)[:, 2])
    tilt = np.arctan2(np.linalg.norm(np.cross(tool_z, axes[:, 2]), axis=1), tool_z @ axes[:, 2])
    turns, lateral = np.abs(np.array(axes).T @ errors[3:]), np.hypot(x, y)
    return np.array(
        [
            lateral <= 1.5e-3, 2 * lateral <= 3e-3, np.abs(z) <= 1e-3, np.abs(x) <= 1e-3, np.abs(y) <= 0.9e-3,
            np.abs(z) <= 1e-3, turns[0] <= 0.15, turns[1] <= 0.2, turns[2] <= 0.3, tilt <= 0.25,
            np.abs(errors[0]) <= 1e-3, (lateral <= 2.2e-3) & (np.abs(z) <= 2.4e-3) & (tilt <= 0.4),
        ]
    )  # fmt: skip


@pytest.mark.fast(1)
@pytest.mark.parametrize("model", ["exact", "linear"])
def test_counts_are_those_of_independent_rotations_at_one_pose_and_at_many(model):
    counts, masks = [], []
    for q in (BENT, STRAIGHT):
        result = pp.monte_carlo(WIDE, q, samples=3000, model=model, specifications=SPECIFICATIONS, keep_samples=True)
        axes = WIDE.at(q).posture.pose[:3, :3]
        inside = kept(result.errors, axes)
        counts.append([round(3000 * one.probability) for one in result.summary.specifications])
        assert counts[-1] == inside.sum(axis=1).tolist()
        assert min(counts[-1]) > 0
        assert max(counts[-1]) < 3000
        masks.append(inside)
        # the numpy engine counts the same
        plan = Plan(np.zeros(8), np.ones(8), SPECIFICATIONS, tool_axes=axes)
        assert observe(plan, start(plan), result.errors).inside.tolist() == counts[-1]
    many = pp.sample_poses(
        WIDE, [BENT, STRAIGHT], samples=3000, model=model, specifications=SPECIFICATIONS, everywhere=True
    )
    assert (3000 * many.probability).round().T.tolist() == counts
    assert list(many.kept_everywhere) == (masks[0] & masks[1]).sum(axis=1).tolist()


@pytest.mark.slow
def test_a_path_and_a_comparison_count_the_same_robots():
    poses = [BENT, STRAIGHT]
    runs = [pp.monte_carlo(WIDE, q, samples=2000, keep_samples=True) for q in poses]
    masks = [kept(run.errors, WIDE.at(q).posture.pose[:3, :3]) for run, q in zip(runs, poses, strict=True)]
    path = pp.path_law(WIDE, poses, samples=2000, probability=0.9, specifications=SPECIFICATIONS)
    found = [round(2000 * one.probability) for one in path.specification_results]
    assert found == (masks[0] & masks[1]).sum(axis=1).tolist()
    wider = arm(1.6, 1.1, 1.0, 0.3, 0.15, 0.4)
    compared = pp.compare([WIDE, wider], [BENT], samples=2000, specifications=SPECIFICATIONS)
    other = pp.monte_carlo(wider, BENT, samples=2000, keep_samples=True)
    after = kept(other.errors, WIDE.at(BENT).posture.pose[:3, :3])
    changes = [one.value for one in compared.poses[0].differences[0].shares]
    np.testing.assert_allclose(changes, after.mean(axis=1) - masks[0].mean(axis=1), atol=1e-12)


@pytest.mark.fast(1)
@pytest.mark.parametrize(
    ("std", "varying"),
    [
        ((0, 0, 1, 0, 0, 0), {"axial", "tool z", "|d|", JOINT}),
        ((1, 0, 0, 0, 0, 0), {"lateral", "zone", "tool x", "|d|", JOINT}),
        ((0, 0, 0, 1e-3, 0, 0), {"tilt", "tool rx", JOINT}),
        ((0, 0, 0, 0, 0, 1e-3), {"tool rz"}),
    ],
)
def test_what_does_not_move_is_not_judged(std, varying):
    words = ["lateral", "zone", "axial", "tool x", "tool z", "|d|", "tilt", "tool rx", "tool rz"]
    texts = [f"{word} 9 {'mrad' if word.startswith(('tilt', 'tool r')) else 'mm'} @ 50 %" for word in words]
    model = arm(*std)
    named = dict(zip([*words, JOINT], [*texts, JOINT], strict=True))
    one = pp.monte_carlo(model, BENT, samples=500, specifications=list(named.values())).summary.specifications
    many = pp.sample_poses(model, [BENT, STRAIGHT], samples=500, specifications=list(named.values()))
    path = pp.path_law(model, [BENT, STRAIGHT], samples=500, probability=0.9, specifications=list(named.values()))
    expected = ["met" if word in varying else "nothing to judge" for word in named]
    assert [result.verdict for result in one] == expected
    assert [result.verdict for result in many.specification_results] == expected
    assert [result.verdict for result in path.specification_results] == expected


@pytest.mark.slow
def test_isotropic_errors_have_the_laws_of_rayleigh_and_gauss_on_a_map_and_in_samples():
    sigma, limit, along = 1e-3, 1.7e-3, 2.1e-3
    model = arm(1, 1, 1, 0, 0, 0)
    lateral = 1 - math.exp(-((limit / sigma) ** 2) / 2)
    axial = special.erf(along / sigma / math.sqrt(2))
    texts = ["1.7 mm lateral @ 50 %", "3.4 mm zone @ 50 %", "2.1 mm axial", "all of: 1.7 mm lateral, 2.1 mm axial"]
    mapped = pp.map_poses(model, [BENT, STRAIGHT], specifications=texts, verify=0)
    expected = np.array([lateral, lateral, axial, 1 - (1 - lateral) - (1 - axial)])
    np.testing.assert_allclose(mapped.probability, np.tile(expected[:, None], 2), atol=2e-7)
    sampled = pp.monte_carlo(model, BENT, samples=40_000, specifications=texts, confidence=0.9999)
    exact = [lateral, lateral, axial, lateral * axial]
    for one, share, (low, high) in zip(
        sampled.summary.specifications, exact, mapped.probability_bounds[:, :, 0], strict=True
    ):
        assert one.interval[0] <= share <= one.interval[1]
        assert low - 1e-9 <= share <= high + 1e-9


@pytest.mark.slow
def test_bounds_of_a_tilt_hold_the_exact_angle():
    model = arm(0, 0, 0, 0.02, 0.02, 0.08)
    mapped = pp.map_poses(model, [BENT], specifications=["tilt 40 mrad @ 50 %"], verify=0)
    result = pp.monte_carlo(model, BENT, samples=40_000, specifications="tilt 40 mrad @ 50 %", confidence=0.9999)
    low, high = mapped.probability_bounds[0, :, 0]
    interval = result.summary.specifications[0].interval
    assert low <= interval[1]
    assert high >= interval[0]
    assert interval[0] <= mapped.probability[0, 0] + 2e-3
    assert mapped.probability[0, 0] <= interval[1]


@pytest.mark.slow
def test_a_rare_lateral_error_has_the_probability_of_rayleigh():
    model = arm(1, 1, 1, 0, 0, 0)
    texts = ["4.8 mm lateral @ 99.99 %", "all of: 4.8 mm lateral, 4.5 mm axial @ 99.99 %"]
    result = pp.reliability(model, texts, BENT, samples=2000)
    lateral, axial = math.exp(-(4.8**2) / 2), special.erfc(4.5 / math.sqrt(2))
    for entry, failure in zip(result.poses[0].specifications, (lateral, 1 - (1 - lateral) * (1 - axial)), strict=True):
        assert entry.resolved
        assert entry.met
        assert entry.best.probability == pytest.approx(failure, rel=0.1)


@pytest.mark.slow
def test_the_cheapest_tolerance_keeps_a_zone_of_rayleigh(tmp_path):
    shutil.copy(MODEL.chain.robot.file, tmp_path / "4dof.urdf")
    sheet = tmp_path / "arm.errors.yaml"
    sheet.write_text(SHEET)
    model = pp.ErrorModel.load(sheet)
    tolerances = [{"path": f"parameters.{name}.normal", "cost": {"reciprocal": 1}, "group": "tool"} for name in "ab"]
    result = pp.allocate(model, {"specs": ["2 mm zone @ 95 %"], "tolerances": tolerances}, for_samples=0)
    # P(2 lateral ≤ 2 mm) = 95 %
    sigma = 1e-3 / math.sqrt(-2 * math.log(0.05))
    before = math.sqrt(model.at("bent").covariance[:3, :3].trace() / 2)
    ratio = [after / one.before for after, one in zip(result.after, result.tolerances, strict=True)]
    np.testing.assert_allclose(before * np.array(ratio), sigma, rtol=0.02)
    assert result.limits[0].quantity == "position.zone"
    assert result.limits[0].is_kept


def test_a_linear_result_names_its_distance_from_the_exact_one():
    texts = ["tilt 250 mrad @ 10 %", "all of: 9 mm lateral, 900 mrad tilt @ 10 %"]
    alone, joint = pp.monte_carlo(WIDE, BENT, samples=2000, model="linear", specifications=texts).summary.specifications
    assert re.search(r"up to \S+ mrad from the exact one", alone.said)
    assert "of the limits from the exact one" in joint.said


def test_texts_of_limits():
    for text, quantity, limit in (
        ("0.1 mm lateral", "position.lateral", 1e-4), ("lateral ≤ 0.1 mm", "position.lateral", 1e-4),
        ("zone 0.1mm", "position.zone", 1e-4), ("1 mrad tilt", "attitude.tilt", 1e-3),
        ("0.1 mm  tool  x", "position.tool_x", 1e-4), ("tool  rz < 1 mrad", "attitude.tool_z", 1e-3),
        ("0.2 mm |d|", "position.norm", 2e-4), ("1 mm dz", "position.z", 1e-3),
    ):  # fmt: skip
        found = pp.specification(f"{text} @ 99 %")
        assert (found.quantity, found.required) == (quantity, 0.99)
        assert found.limit == pytest.approx(limit, rel=1e-15)
        assert pp.specification(
            f"{quantity} {1e3 * limit} {'mm' if quantity[0] == 'p' else 'mrad'}"
        ) == pp.specification(text)
    joint = pp.specification("all  of : lateral 0.2 mm, 1 mrad @ 99 %")
    assert joint.quantity == "all of: 0.2 mm lateral, 1 mrad attitude"
    assert joint.parts == (("position.lateral", 2e-4), ("attitude.norm", 1e-3))
    assert pp.specification(f"{joint.quantity} @ 99 %") == joint == Specification(joint.quantity, 1, 0.99)
    for text, says in (
        ("0.1 mm laterall", "did you mean 'lateral'"), ("1 mm tilt", "limited by an angle"),
        ("all of: 1 mm", "two or more"), ("all of: 1 mm, 2 mm", "different quantities"),
        ("all of: 1 mm, 2", "has no unit"), ("all of: 1 mm, 1 mrad @", "not understood"), ("tool w 1 mm", "tool"),
        ("lateral 1 mm axial", "unit"),
    ):  # fmt: skip
        with pytest.raises(pp.InputError) as raised:
            pp.specification(text)
        assert says in str(raised.value), text
        assert "\n" not in str(raised.value), text
    with pytest.raises(pp.InputError, match="limit must be 1"):
        Specification(joint.quantity, 0.5, 0.99)
    with pytest.raises(pp.InputError, match="specification of its own"):
        pp.allocate(
            MODEL,
            {"specs": [joint], "tolerances": [{"path": "axis_install[joint4].radius", "cost": {"reciprocal": 1}}]},
        )


def test_the_figure_has_the_circle_of_the_limit_and_every_robot():
    points = np.random.default_rng(5).normal(scale=1e-3, size=(3, 400))
    share = (np.hypot(*points[:2]) <= 2e-3).mean()
    results = [
        SpecificationResult("position.lateral", 2e-3, 0.5, share, (share - 0.05, share + 0.05)),
        SpecificationResult("position.zone", 6e-3, 0.5, 1.0, (0.99, 1.0)),
    ]
    (axes,) = figure_across(points, results).axes
    drawn = {line.get_label(): line.get_xydata() for line in axes.lines}
    radii = [np.hypot(*drawn[label].T) for label in axes.get_legend_handles_labels()[1]]
    np.testing.assert_allclose(radii[0], 2.0)
    np.testing.assert_allclose(radii[1], 3.0)
    inside, outside = (line.get_xydata() for line in axes.lines[:2])
    assert len(inside) == share * 400
    assert len(inside) + len(outside) == 400
    assert f"lateral ≤ 2 mm: {100 * share:.0f} % inside" in axes.get_legend_handles_labels()[1][0]
