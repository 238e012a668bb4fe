"""A small share of ``python -m fuzzing urdfs``: changed robots against a second reading and urdfdom."""

from __future__ import annotations

import pytest
from fuzzing.robots.bases import base_robots
from fuzzing.robots.mutations import mutant
from fuzzing.robots.trial import try_robot

SEED = 15


def test_robots_as_they_are_hold(tmp_path):
    for number, text in enumerate(base_robots()):
        outcome = try_robot(text.encode(), str(number), tmp_path)
        assert outcome.loaded
        assert outcome.problems == []


@pytest.mark.parametrize("start", [0, *(pytest.param(start, marks=pytest.mark.slow) for start in range(50, 300, 50))])
def test_changed_robots_are_refused_or_read_as_others_read_them(start, tmp_path):
    problems = {}
    for number in range(start, start + 50):
        outcome = try_robot(mutant(SEED, number), f"{SEED}/{number}", tmp_path)
        if outcome.problems:
            problems[number] = outcome.problems
    assert problems == {}


def test_a_changed_robot_is_made_again_from_seed_and_number():
    assert mutant(3, 7) == mutant(3, 7)
    assert len({mutant(3, number) for number in range(40)}) > 35


def test_a_trial_sees_what_does_not_hold(tmp_path, monkeypatch):
    """A reader that takes the wrong sign of an axis, and one that loses a mass, are found out."""
    from fuzzing.robots import second_reading, trial

    text = base_robots()[3].encode()
    assert try_robot(text, "0", tmp_path).problems == []
    real = second_reading.PlainReading.of
    plain = real(text)
    joint = plain.joints["joint2"]
    turned = {**plain.joints, "joint2": second_reading.PlainJoint(**{**vars(joint), "axis": -joint.axis})}
    links = {**plain.links, "link2": None}
    for other in (second_reading.PlainReading(plain.links, turned), second_reading.PlainReading(links, plain.joints)):
        monkeypatch.setattr(trial.PlainReading, "of", lambda data, other=other: other)
        problems = " ".join(try_robot(text, "0", tmp_path).problems)
        assert ("differ by" in problems) == (other.links == plain.links)
        assert "urdfdom" in problems
        assert "load torques" in problems
