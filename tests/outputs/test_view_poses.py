"""What the page is told of each pose: ellipsoids, arms as built, MCPC frames, texts."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.stats

from outputs.view_cases import (
    arm_text,
    data_block,
    floats,
    likeness,
    made_up_errors,
    matrix,
    pages,
    pose_model,
    simple_page,
)
from precision_pin.base import se3
from precision_pin.base.errors import InputError
from precision_pin.model.error_model import ErrorModel
from precision_pin.pages.view import ViewPose
from precision_pin.pages.view.headline import answers
from precision_pin.pages.view.poses import choose_groups, ellipsoids, link_shares, tangent_of
from precision_pin.robot import mcpc
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.robot.urdf import read
from precision_pin.statistics.plan import specification
from support.sheets import SEVEN_Q, everything, seven_joint_arm

# a hand beyond the first joint's link, a plate between fixed joints on the way, a grip that moves on its own
BRANCHES = """
  <link name="hand"/><link name="plate"/><link name="grip"/><link name="lamp"/>
  <joint name="to_hand" type="fixed"><origin xyz="0 0.1 0"/><parent link="upper"/><child link="hand"/></joint>
  <joint name="to_grip" type="prismatic"><origin xyz="0.02 0 0"/><parent link="tool"/><child link="grip"/>
    <axis xyz="0 0 1"/><limit lower="-0.1" upper="0.1" effort="1" velocity="1"/></joint>
  <joint name="to_lamp" type="fixed"><origin xyz="0 0.05 0"/><parent link="plate"/><child link="lamp"/></joint>
  <joint name="to_plate" type="fixed"><origin xyz="0.1 0 0"/><parent link="fore"/><child link="plate"/></joint>
"""
BLOCK = '<visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual>'


def branched(folder: Path, sources: str) -> ErrorModel:
    """Return the two-link arm with branches; the tool hangs on the plate, which hangs on the forearm."""
    text = arm_text((BLOCK, BLOCK, BLOCK)).replace("</robot>", BRANCHES + "</robot>")
    text = text.replace('<origin xyz="0.3 0 0"/><parent link="fore"/>', '<origin xyz="0.2 0 0"/><parent link="plate"/>')
    (folder / "arm.urdf").write_text(text, "utf-8")
    (folder / "sheet.yaml").write_text(
        f"precision-pin: 1\nrobot: arm.urdf\ntip: tool\nposes: {{p: [0.4 rad, -0.7 rad]}}\nsources:\n{sources}", "utf-8"
    )
    return ErrorModel.load(folder / "sheet.yaml")


def displaced(pose, error):
    """Return a pose ``(4, 4)`` moved by an error ``[d; δ]``."""
    return se3.pose(se3.exp_rotation(error[3:]) @ pose[:3, :3], pose[:3, 3] + error[:3])


# ellipsoids ----------------------------------------------------------------------------------------------------------


def test_an_ellipsoid_is_the_surface_of_one_distance_and_its_count_is_of_the_samples_inside():
    positions = np.random.default_rng(2).gamma(2.0, size=(3, 500)) * 1e-4
    mean, covariance = positions.mean(axis=1), np.cov(positions)
    for one in ellipsoids(positions):
        limit = scipy.stats.chi2.ppf(one.share, 3)
        directions = np.random.default_rng(3).normal(size=(3, 40))
        on_ball = np.vstack([directions / np.linalg.norm(directions, axis=0), np.ones(40)])
        away = (one.matrix @ on_ball)[:3] - mean[:, None]
        squares = np.einsum("in,in->n", away, np.linalg.solve(covariance, away))
        np.testing.assert_allclose(squares, limit, rtol=1e-9)
        centred = positions - mean[:, None]
        inside = np.einsum("in,in->n", centred, np.linalg.solve(covariance, centred)) <= limit
        assert one.inside == inside.mean()


def test_a_flat_cloud_has_as_many_degrees_of_freedom_as_directions():
    numbers = np.random.default_rng(5).normal(size=(2, 1000)) * 1e-4
    plane = np.array([[1, 0], [0, 1], [1, 1]]) @ numbers
    inner, _ = ellipsoids(plane)
    axes = np.linalg.norm(inner.matrix[:3, :3], axis=0)
    deviations = np.sqrt(np.linalg.eigvalsh(np.cov(plane))[::-1])
    np.testing.assert_allclose(axes[:2], np.sqrt(scipy.stats.chi2.ppf(0.95, 2)) * deviations[:2], rtol=1e-9)
    assert axes[2] < 1e-3 * axes[1]


def test_the_legend_counts_the_samples_inside(tmp_path):
    errors = made_up_errors(400)
    text = simple_page(pose_model(tmp_path, arm_text()), errors)
    for one in ellipsoids(errors[:3]):
        assert f"{100 * one.inside:.2f} % of the samples inside" in text
    assert "too few samples or no spread" in simple_page(pose_model(tmp_path, arm_text()), errors[:, :3])
    for positions in (np.full((3, 9), 0.1), np.eye(3), np.zeros((3, 1))):
        assert ellipsoids(positions) == ()


# arms as built -------------------------------------------------------------------------------------------------------


def test_a_turned_arm_stands_where_its_joints_turned_would_put_it(tmp_path):
    model = branched(
        tmp_path,
        "  - joint_offset: {joint: turn, offset: {normal: 10 mrad}}\n"
        "  - joint_offset: {joint: bend, offset: {normal: {std: 20 mrad}, mean: 5 mrad}}\n",
    )
    at, x = model.at(), model.space.sample(1, 0, 20)
    settings = data_block(simple_page(at, at.exact(x)), "settings")
    (pose,) = settings["poses"]
    robot = read(tmp_path / "arm.urdf")
    names = [f"link{number}" for number in range(len(robot.links))]
    sampled = [floats(ghost).reshape(-1, 6) for ghost in pose["ghosts"]]
    assert len(sampled) == 3
    for turned, displacements in [*zip(x.T[:3], sampled, strict=True), ([0, 5e-3], floats(pose["deflected"]))]:
        for factor in (1, 7):
            q = np.array([0.4, -0.7]) + factor * np.array(turned)
            expected = robot.link_poses({"turn": q[0], "bend": q[1], "to_grip": 0.0})
            parts, tip = likeness(settings, 0, np.reshape(displacements, (-1, 6)), factor)
            for name, link in zip(names, robot.links, strict=True):
                np.testing.assert_allclose(parts[name], expected[link.name], atol=1e-6)
            np.testing.assert_allclose(tip, expected["tool"], atol=1e-6)


def test_a_displacement_moves_what_lies_beyond_it(tmp_path):
    for source, moved in (
        ("frame: {frame: base, x: {uniform: 1 mm}}", "base upper hand fore plate lamp tool grip"),
        ("frame: {link: base, x: {uniform: 1 mm}}", "upper hand fore plate lamp tool grip"),
        ("frame: {frame: plate, x: {uniform: 1 mm}}", "plate lamp tool grip"),
        ("frame: {frame: tool, x: {uniform: 1 mm}}", "tool grip"),
        ("joint_offset: {joint: turn, offset: {uniform: 1 mrad}}", "upper hand fore plate lamp tool grip"),
        ("mcpc: {link: upper, x: {uniform: 1 mm}}", "fore plate lamp tool grip"),
        ("mcpc: {link: fore, x: {uniform: 1 mm}}", "tool grip"),
    ):
        model = branched(tmp_path, f"  - {source}\n")
        at = model.at()
        settings = data_block(simple_page(at, at.exact(model.space.sample(1, 0, 20))), "settings")
        links = [link.name for link in model.chain.robot.links]
        # targets of a source follow each other; all of them or none move a link
        counts = dict(zip([part["name"] for part in settings["parts"]], settings["poses"][0]["before"], strict=True))
        assert {links[int(name.removeprefix("link"))] for name, count in counts.items() if count} == set(moved.split())
        assert set(counts.values()) <= {0, len(at.table.targets)}


@pytest.mark.slow
def test_the_tips_of_arms_with_every_kind_of_source_are_the_exact_samples():
    model = everything(seven_joint_arm(), scale=3.0)
    poses = [SEVEN_Q, tuple(-0.5 * value for value in SEVEN_Q)]
    shown = []
    for number, q in enumerate(poses):
        at = model.at(q)
        shown.append(ViewPose(at, at.exact(model.space.sample(1, 0, 10, pose=number)), None, number))
    settings = data_block(pages(shown), "settings")
    for number, one in enumerate(shown):
        pose = settings["poses"][number]
        for unit, packed in enumerate(pose["ghosts"]):
            _, tip = likeness(settings, number, floats(packed).reshape(-1, 6), 1)
            np.testing.assert_allclose(tip, displaced(one.pose_model.table.pose, one.errors[:, unit]), atol=1e-6)
        _, tip = likeness(settings, number, floats(pose["deflected"]).reshape(-1, 6), 1)
        np.testing.assert_allclose(tip, displaced(one.pose_model.table.pose, one.pose_model.error_at_means), atol=1e-6)


@pytest.mark.slow
def test_errors_of_another_seed_or_without_a_mean_have_no_arms(tmp_path):
    model = ErrorModel.load(PAPER_SHEET)
    at, x = model.at(), model.space.sample(2, 0, 10)
    text = simple_page(at, at.exact(x))
    assert data_block(text, "settings")["poses"][0]["ghosts"] == []
    assert "none, the errors are not those of this seed" in text
    assert 'id="show-ghosts" disabled' in text
    assert 'id="show-ghosts">' in simple_page(at, at.exact(x), seed=2)
    with pytest.raises(InputError, match="seed"):
        simple_page(at, at.exact(x), seed=-1)
    exact, linear = (data_block(simple_page(at, errors, seed=2), "settings") for errors in (at.exact(x), at.linear(x)))
    assert exact["poses"][0]["ghosts"] == linear["poses"][0]["ghosts"]
    offset = branched(tmp_path, "  - joint_offset: {joint: turn, offset: {normal: 10 mrad}}\n").at()
    text = simple_page(offset, offset.exact(offset.space.sample(1, 0, 9)))
    assert 'id="show-deflected" disabled' in text
    assert "the same as without error" in text


# frames and texts ----------------------------------------------------------------------------------------------------


def test_mcpc_frames_are_those_of_the_paper_at_every_pose():
    model = ErrorModel.load(PAPER_SHEET)
    q = [model.configuration(), np.array([0.3, -0.4, 0.5, -0.6])]
    shown = [ViewPose(at, at.exact(model.space.sample(1, 0, 9))) for at in map(model.at, q)]
    settings = data_block(pages(shown), "settings")
    parameters = mcpc.from_chain(model.chain)
    for values, pose in zip(q, settings["poses"], strict=True):
        # frame 0 is the base's; T_i = Q_i V_i goes from frame i, before its joint turns, to frame i + 1
        frames = [se3.pose(se3.rotation_about((0, 0, 1), parameters.base_turn), np.zeros(3))]
        for i in range(5):
            turned = frames[-1] @ (parameters.joint_pose(i, values[i - 1]) if i else np.eye(4))
            frames[-1] = turned
            frames.append(turned @ parameters.link_pose(i))
        assert len(settings["mcpc"]) == 6
        for entry, expected in zip(settings["mcpc"], frames, strict=True):
            found = matrix(pose["links"][entry["link"]]) @ matrix(entry["frame"])
            np.testing.assert_allclose(found, expected, atol=1e-12)


MOVING = np.full(6, 1e-4)


@pytest.fixture(scope="module")
def paper_sample():
    model = ErrorModel.load(PAPER_SHEET)
    at = model.at()
    return at, at.exact(model.space.sample(1, 0, 2000))


def interval_in(detail: str) -> tuple[float, float]:
    low, high = re.search(r"interval ([\d.]+) to ([\d.]+)", detail).groups()
    return float(low), float(high)


def test_without_a_limit_the_answer_is_the_95_percent_quantile_with_its_interval():
    errors = made_up_errors(3000, size=1e-3)
    (found,) = answers(errors, (), MOVING)
    sizes = 1e3 * np.linalg.norm(errors[:3], axis=0)
    value = float(re.fullmatch(r"95 % of robots within ([\d.]+) mm", found.text)[1])
    low, high = interval_in(found.detail)
    assert low <= value <= high
    # the law of |d| is known: sigma times a chi variable of three degrees
    assert low < scipy.stats.chi(3).ppf(0.95) < high
    # about 95 % of intervals between such ranks: binomial numbers of samples below each end
    inside = scipy.stats.binom(3000, 0.95)
    assert inside.cdf((sizes < low).sum()) < 0.03
    assert inside.sf((sizes <= high).sum() - 1) < 0.03
    assert found.verdict == ""


def test_a_mean_that_is_far_larger_than_the_spread_has_a_line_of_its_own(tmp_path):
    errors = made_up_errors(3000, size=1e-3) + np.reshape([0.02, 0.02, -0.01, 0, 0, 0], (6, 1))
    _, constant = answers(errors, (), MOVING)
    mean, within = (float(re.search(r"[\d.]+(?= mm)", text)[0]) for text in (constant.text, constant.detail))
    assert constant.text == f"Mean error {mean} mm, the same for every robot"
    # 30 mm long, known to 2σ √(3/N); about it the law is sigma times a chi variable of three degrees
    assert mean == pytest.approx(30.0, abs=2 * np.sqrt(3 / 3000) + 0.05)
    assert within == pytest.approx(scipy.stats.chi(3).ppf(0.95), abs=0.1)
    settings = data_block(simple_page(pose_model(tmp_path, arm_text()), errors), "settings")
    assert settings["aboutMean"]
    assert settings["factor"] == settings["factors"][1] > settings["factors"][0]
    settings = data_block(simple_page(pose_model(tmp_path, arm_text())), "settings")
    assert not settings["aboutMean"]
    assert settings["factor"] == settings["factors"][0]


def test_a_limit_has_a_verdict_and_an_interval():
    errors = made_up_errors(3000, size=1e-3)
    values = {
        "position.norm": np.linalg.norm(errors[:3], axis=0),
        "attitude.norm": np.linalg.norm(errors[3:], axis=0),
        "position.x": np.abs(errors[0]),
    }
    for text, verdict in (
        ("4 mm @ 95 %", "met"),
        ("2 mm @ 95 %", "not met"),
        ("x 0.1 mm @ 50 %", "not met"),
        ("attitude 4 mrad @ 95 %", "met"),
    ):
        limit = specification(text)
        first, size = answers(errors, [limit], MOVING)
        assert first.verdict == verdict
        assert first.text.startswith(verdict.capitalize())
        kept = int((values[limit.quantity] <= limit.limit).sum())
        expected = scipy.stats.binomtest(kept, 3000).proportion_ci(0.95, "exact")
        assert interval_in(first.detail) == pytest.approx((100 * expected.low, 100 * expected.high), abs=0.2)
        assert size.text.startswith("95 % of robots within")


def test_a_quantile_near_the_limit_is_undecided_and_few_samples_say_so():
    errors = made_up_errors(200, size=1e-3)
    limit = float(np.quantile(np.linalg.norm(errors[:3], axis=0), 0.95))
    (first, _) = answers(errors, [replace(specification("1 mm @ 95 %"), limit=limit)], MOVING)
    assert first.verdict == "undecided"
    assert "more samples decide it" in first.detail
    assert "too few" in answers(errors[:, :20], (), MOVING)[0].text
    still, size = answers(np.full((6, 9), 1e-5), [specification("1 mm @ 95 %")], np.zeros(6))
    assert still.verdict == "nothing to judge"
    assert "all alike" in size.detail


def test_the_verdict_is_the_first_text_of_the_page(tmp_path):
    at = pose_model(tmp_path, arm_text())
    text = simple_page(at, made_up_errors(3000, size=1e-3), specifications=[specification("2 mm @ 95 %")])
    body = text[text.index("<body") :]
    assert body.index("Not met: |d| ≤ 2 mm for 95 %") < body.index("95 % of robots within") < body.index("<main")
    (limit,) = data_block(text, "settings")["limits"]
    assert (limit["row"], limit["limit"], limit["required"]) == (0, 0.002, pytest.approx(0.95))
    assert 'id="show-limit" checked' in text
    assert 'id="show-limit" disabled' in simple_page(at)


# tolerances ----------------------------------------------------------------------------------------------------------


def test_the_first_order_model_is_the_derivative_of_the_errors():
    at = everything(seven_joint_arm()).at(SEVEN_Q)
    mean = at.space.mean
    for model, errors_of in (("exact", at.exact), ("linear", at.linear)):
        centre, jacobian = tangent_of(at, model)
        np.testing.assert_allclose(centre, errors_of(mean[:, None])[:, 0], atol=1e-15)
        steps = np.sqrt(np.diag(at.space.covariance))
        moved = mean[:, None] + 1e-3 * np.diag(steps)
        other = mean[:, None] - 1e-3 * np.diag(steps)
        slopes = (errors_of(moved) - errors_of(other)) / 2e-3
        np.testing.assert_allclose(jacobian * steps, slopes, atol=1e-4 * np.abs(slopes).max())


def test_the_largest_contributors_have_a_slider_and_the_others_share_one(paper_sample):
    at, _ = paper_sample
    groups = choose_groups([at])
    assert len(groups.names) == len(groups.draws) <= 13
    own = [
        np.trace(at.jacobian[:3, columns] @ draw.covariance @ at.jacobian[:3, columns].T)
        for draw, columns in zip(at.space.draws, at.space.slices, strict=True)
    ]
    alone = [draws[0] for draws in groups.draws if len(draws) == 1]
    assert [at.space.draws[k].name for k in alone] == list(groups.names[: len(alone)])
    np.testing.assert_allclose([own[k] for k in alone], sorted(own, reverse=True)[: len(alone)], rtol=1e-9)


def test_the_groups_parts_of_the_variance_are_that_of_the_whole(paper_sample):
    at, errors = paper_sample
    (pose,) = data_block(simple_page(at, errors), "settings")["poses"]
    assert np.sum(pose["live"]["variances"]) == pytest.approx(np.trace(at.covariance[:3, :3]), rel=1e-6)
    assert sum(pose["shares"]) == pytest.approx(1, rel=1e-9)
    # errors of another seed follow no slider
    assert data_block(simple_page(at, errors, seed=2), "settings")["poses"][0]["live"] is None


def test_a_link_has_the_share_of_what_sits_in_it_and_in_the_joint_before_it(tmp_path):
    (tmp_path / "arm.urdf").write_text(arm_text(), "utf-8")
    for source, expected in (
        ("joint_offset: {joint: turn, offset: {normal: 1 mrad}}", [0, 1, 0]),
        ("joint_offset: {joint: bend, offset: {normal: 1 mrad}}", [0, 0, 1]),
        ("frame: {frame: base, x: {normal: 1 mm}}", [1, 0, 0]),
    ):
        sheet = (
            f"precision-pin: 1\nrobot: arm.urdf\ntip: tool\nposes: {{p: [0.4 rad, -0.7 rad]}}\nsources:\n  - {source}\n"
        )
        (tmp_path / "sheet.yaml").write_text(sheet, "utf-8")
        assert link_shares(ErrorModel.load(tmp_path / "sheet.yaml").at()) == pytest.approx(expected, abs=1e-12)
