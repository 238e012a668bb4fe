"""Changed robots: findings or a robot whatever the bytes, and a share of ``python -m fuzzing urdfs``."""

from __future__ import annotations

import pinocchio as pin
import pytest
from fuzzing.robots.bases import base_robots
from fuzzing.robots.mutations import mutant
from fuzzing.robots.trial import try_robot
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from precision_pin.base.errors import Finding, UrdfError
from precision_pin.robot.urdf import Robot, canonical, parse

SEED = 15


@pytest.mark.slow
def test_robots_as_they_are_hold(tmp_path):
    for number, text in enumerate(base_robots()):
        outcome = try_robot(text.encode(), str(number), tmp_path)
        assert outcome.loaded
        assert outcome.problems == []


@pytest.mark.slow
@pytest.mark.parametrize("start", [0, *range(50, 300, 50)])
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


TEXTS = [
    b"nan", b"inf", b"-1", b"1e400", b"0", b"", b" ", b"1,5", b"%s%n", b"\0", b"\xff", b"&", b"<", b">", b'"', b"'",
    b"universe", b"foot", b"tip", b"elbow", b"fixed", b"floating", b"<!DOCTYPE x>", b"<![CDATA[", b"]]>", b"<!--",
    b"<link/>", b"<joint/>", b"<axis/>", b"<mimic joint='elbow'/>", b"<inertial/>", b"&#49;", b"&#0;", b"${x}",
    b"1e-320", b"99999999999999999999", b"<?xml version='1.0' encoding='idna'?>", b"package://", b"\xe2\x88\x92",
]  # fmt: skip
EDIT = st.tuples(st.floats(0, 1), st.integers(0, 40), st.sampled_from(TEXTS) | st.binary(max_size=6))
QUIET = settings(
    max_examples=250, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def read_or_findings(data: bytes) -> tuple[Robot | None, tuple[Finding, ...]]:
    try:
        robot = parse(data, "x.urdf")
    except UrdfError as refused:
        return None, refused.findings
    return robot, robot.findings


def attempt(data: bytes) -> None:
    robot, findings = read_or_findings(data)
    assert all("\n" not in str(found) for found in findings)
    if robot is None:
        assert any(found.severity == "error" for found in findings)
        return
    # what passed must be a robot that Pinocchio takes, with all its joints
    model = pin.buildModelFromXML(canonical(robot))
    assert model.nq == len(robot.moving_joints)


@pytest.mark.slow
@QUIET
@given(edits=st.lists(EDIT, min_size=1, max_size=4))
def test_edited_arms(arm, edits):
    data = arm.encode()
    for place, cut, text in edits:
        at = int(place * len(data))
        data = data[:at] + text + data[at + cut :]
    attempt(data)


@pytest.mark.slow
@QUIET
@given(values=st.lists(st.sampled_from(TEXTS), min_size=1, max_size=3), places=st.lists(st.integers(0, 69), min_size=3))
def test_edited_attributes(arm, values, places):
    parts = arm.encode().split(b'"')
    for value, place in zip(values, places, strict=False):
        at = 2 * (place % (len(parts) // 2)) + 1
        parts[at] = value
    attempt(b'"'.join(parts))


@pytest.mark.slow
@QUIET
@given(data=st.binary(max_size=200))
def test_any_bytes(data):
    attempt(data)
