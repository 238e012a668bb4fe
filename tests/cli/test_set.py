"""``--set``: the sheet changed on the command line."""

from __future__ import annotations

import pytest

SHEET = "4dof.errors.yaml"
FEW = ("--samples", "400", "--json", "-")


@pytest.mark.slow
def test_a_set_value_is_that_of_the_sheet_edited_by_hand(run, folder):
    (folder / "heavy.errors.yaml").write_text((folder / SHEET).read_text().replace("mass: 1 kg", "mass: 3 kg"))
    edited = run("analyze", "heavy.errors.yaml", *FEW)
    changed = run("analyze", SHEET, "--set", "payload.mass=3 kg", *FEW)
    assert changed.code == 0
    assert changed.json["position"] == edited.json["position"]
    assert changed.json["position"] != run("analyze", SHEET, *FEW).json["position"]


@pytest.mark.parametrize("command", ["budget", "worst-case", "compensate", "check", "mcpc"])
def test_every_command_takes_changes(run, command):
    done = run(command, SHEET, "--set", "payload.mas=3 kg")
    assert done.code == 2
    said = done.out if command == "check" else done.err
    assert said.startswith("--set payload.mas: error E_UNKNOWN_KEY: unknown key 'mas': did you mean 'mass'?")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("payload.mass", "--set: 'PATH=VALUE' is expected"),
        ("payload.mass=", "--set: 'PATH=VALUE' is expected"),
        ("payload.mass={", "--set payload.mass: error E_YAML: not YAML"),
        ("payloud.mass=1 kg", "no source named 'payloud'; did you mean 'payload'"),
    ],
)
def test_wrong_changes_are_one_line(run, text, message):
    done = run("analyze", SHEET, "--set", text)
    assert done.code == 2
    assert len(done.said) == 1
    assert message in done.said[0]


def test_a_robot_without_a_sheet_cannot_be_changed(run):
    for command in ("check", "mcpc"):
        done = run(command, "gantry.urdf", "--set", "payload.mass=1 kg")
        assert done.code == 2
        assert "--set changes a sheet, and none is given" in done.out + done.err
