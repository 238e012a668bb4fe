"""The page's first lines: the verdict, the size of the errors, and the tolerances that can be changed."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.stats

from outputs.view_cases import arm_text, data_block, made_up_errors, pages, pose_model, simple_page
from precision_pin.model.error_model import ErrorModel
from precision_pin.pages.view import ViewPose
from precision_pin.pages.view.headline import answers
from precision_pin.pages.view.tolerances import choose_groups, link_shares, tangent_of
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.statistics.plan import specification
from support.sheets import SEVEN_Q, everything, seven_joint_arm

MOVING = np.full(6, 1e-4)


@pytest.fixture(scope="module")
def paper():
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


@pytest.mark.parametrize(
    ("text", "verdict"),
    [
        ("4 mm @ 95 %", "met"),
        ("2 mm @ 95 %", "not met"),
        ("x 0.1 mm @ 50 %", "not met"),
        ("attitude 4 mrad @ 95 %", "met"),
    ],
)
def test_a_limit_has_a_verdict_and_an_interval(text, verdict):
    errors = made_up_errors(3000, size=1e-3)
    first, size = answers(errors, [specification(text)], MOVING)
    assert first.verdict == verdict
    assert first.text.startswith(verdict.capitalize())
    limit = specification(text)
    values = {
        "position.norm": np.linalg.norm(errors[:3], axis=0),
        "attitude.norm": np.linalg.norm(errors[3:], axis=0),
        "position.x": np.abs(errors[0]),
    }[limit.quantity]
    kept = int((values <= limit.limit).sum())
    expected = scipy.stats.binomtest(kept, 3000).proportion_ci(0.95, "exact")
    low, high = interval_in(first.detail)
    assert low == pytest.approx(100 * expected.low, abs=0.2)
    assert high == pytest.approx(100 * expected.high, abs=0.2)
    assert size.text.startswith("95 % of robots within")


def test_a_quantile_near_the_limit_is_undecided_and_few_samples_say_so():
    errors = made_up_errors(200, size=1e-3)
    limit = float(np.quantile(np.linalg.norm(errors[:3], axis=0), 0.95))
    (first, _) = answers(errors, [replace(specification("1 mm @ 95 %"), limit=limit)], MOVING)
    assert first.verdict == "undecided"
    assert "more samples decide it" in first.detail
    assert "too few" in answers(errors[:, :20], (), MOVING)[0].text


def test_errors_that_do_not_vary_are_no_verdict():
    still = np.full((6, 9), 1e-5)
    first, size = answers(still, [specification("1 mm @ 95 %")], np.zeros(6))
    assert first.verdict == "nothing to judge"
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


def test_every_pose_has_its_own_answer(tmp_path):
    at = pose_model(tmp_path, arm_text())
    shown = [ViewPose(at, made_up_errors(300, size=size), str(size)) for size in (1e-3, 2e-3)]
    first, second = (pose["answers"][0][0] for pose in data_block(pages(shown), "settings")["poses"])
    assert first != second
    assert ViewPose is ViewPose


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


def test_the_largest_contributors_have_a_slider_and_the_others_share_one(paper):
    at, _ = paper
    groups = choose_groups([at])
    assert len(groups.names) == len(groups.draws) <= 13
    own = [
        np.trace(at.jacobian[:3, columns] @ draw.covariance @ at.jacobian[:3, columns].T)
        for draw, columns in zip(at.space.draws, at.space.slices, strict=True)
    ]
    alone = [draws[0] for draws in groups.draws if len(draws) == 1]
    assert [at.space.draws[k].name for k in alone] == list(groups.names[: len(alone)])
    np.testing.assert_allclose([own[k] for k in alone], sorted(own, reverse=True)[: len(alone)], rtol=1e-9)


def test_the_groups_parts_of_the_variance_are_that_of_the_whole(paper):
    at, errors = paper
    (pose,) = data_block(simple_page(at, errors), "settings")["poses"]
    assert np.sum(pose["live"]["variances"]) == pytest.approx(np.trace(at.covariance[:3, :3]), rel=1e-6)
    assert sum(pose["shares"]) == pytest.approx(1, rel=1e-9)


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


def test_errors_of_another_seed_follow_no_slider(paper):
    at, errors = paper
    (pose,) = data_block(simple_page(at, errors, seed=2), "settings")["poses"]
    assert pose["live"] is None
