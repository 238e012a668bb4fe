"""``precision-pin compare``."""

from __future__ import annotations

import pytest

FEW = ("--samples", "2000")


@pytest.fixture
def tighter(folder):
    text = (folder / "gantry.errors.yaml").read_text("utf-8")
    (folder / "tighter.yaml").write_text(text.replace("uniform: 0.1 mm", "uniform: 0.05 mm"), "utf-8")
    return "tighter.yaml"


@pytest.mark.slow
def test_the_better_sheet_comes_first_and_the_verdicts_decide(run, folder, tighter):
    asked = ("compare", "gantry.errors.yaml", tighter, *FEW, "--pose", "home", "--spec", "y 0.16 mm @ 99.9 %")
    done = run(*asked, "--out", "plots")
    assert done.code == 1
    assert done.out.startswith("'tighter.yaml' is better than 'gantry.errors.yaml': 95 % of robots within |d|")
    assert "'gantry.errors.yaml': spec |dy| within 0.16 mm for 99.9 %: NOT MET" in done.out
    assert "joint_offset[y_axis].offset.uniform  0.1 mm  ->  0.05 mm" in done.out
    assert {one.name for one in (folder / "plots").iterdir()} == {"comparison.json", "comparison.png", "comparison.svg"}
    assert max(map(len, done.out.splitlines())) <= 120
    saved = run(*asked, "--json", "-")
    assert saved.json["schema"] == "precision-pin/comparison/1"
    assert saved.json["met"]["gantry.errors.yaml"] is False
    assert run(*asked[:-1], "y 1 mm @ 95 %", "--quiet").code == 0


@pytest.mark.slow
def test_one_sheet_against_what_set_changes(run, folder):
    done = run("compare", "gantry.errors.yaml", *FEW, "--all-poses", "--set", "joint_offset[y_axis].offset=±0.2 mm")
    assert done.code == 0
    assert done.out.startswith("'gantry.errors.yaml --set' is worse than 'gantry.errors.yaml'")
    assert "pose 'out'" in done.out
    assert "pose 'home'" in done.out


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (("gantry.errors.yaml",), "two sheets are needed, A.yaml B.yaml; or one and what --set changes in it"),
        ((), "two sheets are needed"),
        (("gantry.errors.yaml", "gantry.errors.yaml"), "gantry.errors.yaml is given twice"),
        (("gantry.errors.yaml", "4dof.errors.yaml"), "only arms with the same joints can be compared"),
        (("gantry.errors.yaml", "nosuch.yaml"), "the sheet does not exist"),
    ],
)
def test_what_cannot_be_compared_is_said_in_a_line(run, folder, given, message):
    refused = run("compare", *given, *FEW, "--out", "plots")
    assert refused.code == 2
    assert message in refused.err
    assert not (folder / "plots").exists()
