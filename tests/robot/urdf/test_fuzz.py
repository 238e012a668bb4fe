"""Whatever the bytes, there are findings or a robot, never another exception."""

from __future__ import annotations

import pinocchio as pin
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from precision_pin.base.errors import Finding, UrdfError
from precision_pin.robot.urdf import Robot, canonical, parse

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


@QUIET
@given(edits=st.lists(EDIT, min_size=1, max_size=4))
def test_edited_arms(arm, edits):
    data = arm.encode()
    for place, cut, text in edits:
        at = int(place * len(data))
        data = data[:at] + text + data[at + cut :]
    attempt(data)


@QUIET
@given(values=st.lists(st.sampled_from(TEXTS), min_size=1, max_size=3), places=st.lists(st.integers(0, 69), min_size=3))
def test_edited_attributes(arm, values, places):
    parts = arm.encode().split(b'"')
    for value, place in zip(values, places, strict=False):
        at = 2 * (place % (len(parts) // 2)) + 1
        parts[at] = value
    attempt(b'"'.join(parts))


@QUIET
@given(data=st.binary(max_size=200))
def test_any_bytes(data):
    attempt(data)
