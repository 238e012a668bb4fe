"""Names that forge lines, turn the writing or have no end: shown as what they are made of, on one line, cut."""

from __future__ import annotations

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from precision_pin.base.errors import LONGEST_LINE, Finding, InputError, UnknownNameError, one_line, shown, visible

FORGED = "precision-pin: error E_FORGED: forged"
HOSTILE = {
    "long": "N" * 300_000,
    "bidi": "a\u202eb\u2066c\u200bd\ufeffe",
    "terminal": "a\x1b[31m\x9b31mred\x85",
    "lines": f"a\n{FORGED}\r\n\u2028{FORGED}",
    "words": "w " * 50_000,
}


@pytest.mark.slow
@settings(max_examples=50, deadline=None)
@given(st.text())
def test_a_message_is_one_printable_line(text):
    line = one_line(text)
    assert line.isprintable()
    assert len(line) <= LONGEST_LINE
    if text.isprintable() and len(text) <= 260:
        assert line == text


@settings(max_examples=50, deadline=None)
@given(st.text())
def test_what_is_shown_tells_names_apart(text):
    if len(text) <= 80:
        assert eval(shown(text)) == text
    assert visible(text).isprintable()


@pytest.mark.parametrize("kind", HOSTILE)
def test_findings_and_errors(kind):
    name = HOSTILE[kind]
    finding = Finding("error", "E_X", f"no joint named {name}", f"/{name}.urdf", 3)
    assert finding.message == f"no joint named {name}"  # for those who want it whole
    for line in (
        str(finding),
        str(InputError(f"the file {name} is not there")),
        str(UnknownNameError("joint", name, ["a", name + "b"])),
    ):
        assert line.isprintable()
        assert len(line) < LONGEST_LINE + 600
        assert FORGED not in line.splitlines()


WRONG = {
    "command": lambda name: (name,),
    "option": lambda name: ("analyze", f"--{name}"),
    "seed": lambda name: ("analyze", "--seed", name),
    "pose": lambda name: ("analyze", "--pose", name),
    "joint values": lambda name: ("analyze", "--q", name),
    "limit": lambda name: ("analyze", "--spec", name),
    "precision": lambda name: ("analyze", "--until", name),
    "tip": lambda name: ("mcpc", "4dof.urdf", "--tip", name),
    "robot": lambda name: ("mcpc", f"{name}.urdf"),
    "sheet": lambda name: ("analyze", f"{name}.yaml"),
    "example": lambda name: ("mcpc", f"example:{name}"),
    "json": lambda name: ("analyze", "--json", f"{name}/x"),
    "packages": lambda name: ("mcpc", "4dof.urdf", "--package-dir", name),
}


@pytest.mark.fast(26)
@pytest.mark.parametrize("kind", HOSTILE)
@pytest.mark.parametrize("where", WRONG)
def test_command_lines(run, where, kind):
    outcome = run(*WRONG[where](HOSTILE[kind]))
    assert outcome.code == 2
    assert outcome.out == ""
    (line,) = [line for line in outcome.err.split("\n")[:-1] if " warning " not in line]
    assert line.isprintable()
    assert len(line) < LONGEST_LINE + 600


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["bidi", "lines"])
def test_tables_and_json(run, folder, kind):
    name = HOSTILE[kind]
    attribute = "".join(f"&#{ord(one)};" for one in name)
    robot = (folder / "gantry.urdf").read_text("utf-8").replace('"y_axis"', f'"{attribute}"')
    (folder / "hostile.urdf").write_text(robot, "utf-8")
    quoted = json.dumps(name)
    sheet = f"precision-pin: 1\nrobot: hostile.urdf\nposes: {{{quoted}: [0 mm, 0 deg]}}\n"
    sheet += f"sources:\n  - joint_offset: {{joint: {quoted}, offset: {{uniform: 0.1 mm}}}}\n"
    (folder / "hostile.yaml").write_text(sheet, "utf-8")
    for arguments in (("analyze", "--samples", "10"), ("mcpc",), ("worst-case",), ("exact-law",)):
        outcome = run(*arguments, "hostile.yaml")
        assert outcome.code == 0, outcome.err
        assert all(line.isprintable() for line in (outcome.out + outcome.err).split("\n"))
        assert not any(line.startswith(FORGED) for line in outcome.out.splitlines())
    result = run("analyze", "--samples", "10", "hostile.yaml", "--json", "-").json
    assert (result["pose"]["name"], name in result["pose"]["q"]) == (name, True)
