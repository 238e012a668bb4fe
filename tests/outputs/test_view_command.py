"""The command ``view``: which poses it shows, trajectories, what it refuses, and the page that follows its files."""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from outputs.view_cases import data_block, floats
from precision_pin.base.errors import InputError
from precision_pin.cli import main
from precision_pin.model.error_model import ErrorModel
from precision_pin.pages.view import live
from precision_pin.robot.chain import Chain
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.robot.trajectory import read_trajectory

HEADER = "joint1,joint2,joint3,joint4"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    for file in PAPER_SHEET.parent.glob("4dof.*"):
        shutil.copy(file, tmp_path)
    sheet = tmp_path / "4dof.errors.yaml"
    text = sheet.read_text("utf-8")
    # a second pose, and a draw that is another one at each
    text, count = re.subn("^poses:\n", "poses:\n  straight: 0 10 20 30 deg\n", text, flags=re.MULTILINE)
    wobble = "  - joint_offset: {joint: joint1, offset: {normal: 1 mrad, scope: pose}}\n"
    text, also = re.subn("^sources:\n", f"sources:\n{wobble}", text, flags=re.MULTILINE)
    assert (count, also) == (1, 1)
    sheet.write_text(text, "utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def run(folder, monkeypatch, capsys):
    def command(*arguments: str) -> tuple[int, str]:
        few = () if "--samples" in arguments else ("--samples", "40")
        monkeypatch.setattr(sys, "argv", ["precision-pin", "view", "4dof.errors.yaml", *few, "--seed", "3", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        assert printed.out == ""
        return int(ended.value.code or 0), printed.err

    return command


def shown_poses(path: Path) -> list[dict]:
    return data_block(path.read_text("utf-8"), "settings")["poses"]


def sampled_positions(pose: dict) -> np.ndarray:
    return floats(pose["points"]).reshape(-1, 3).T


@pytest.mark.fast(3)
@pytest.mark.parametrize(
    ("options", "names"),
    [
        ([], ["straight"]),
        (["--pose", "paper"], ["paper"]),
        (["--pose", "paper", "--pose", "straight"], ["paper (1 of 2)", "straight (2 of 2)"]),
        (["--all-poses"], ["straight (1 of 2)", "paper (2 of 2)"]),
        (["--q", "1 2 3 4 deg"], ["without a name"]),
        (["--trajectory", "way.csv"], ["t = 0 s (1 of 2)", "t = 0.25 s (2 of 2)"]),
    ],
)
def test_the_poses_asked_for_are_shown(run, folder, options, names):
    (folder / "way.csv").write_text(f"t,{HEADER}\n0,0,0.1,0.2,0.3\n0.25,0,0.2,0.3,0.4\n")
    code, said = run(*options, "--out", "page.html")
    assert code == 0
    assert said.splitlines()[-1].startswith("wrote page.html (")
    assert [pose["texts"]["caption-pose"] for pose in shown_poses(folder / "page.html")] == names


@pytest.mark.slow
@pytest.mark.parametrize("model", ["exact", "linear"])
def test_the_same_units_stand_at_every_pose(run, folder, model):
    run("--all-poses", "--model", model, "--out", "page.html")
    error_model = ErrorModel.load(folder / "4dof.errors.yaml")
    for number, (name, pose) in enumerate(zip(("straight", "paper"), shown_poses(folder / "page.html"), strict=True)):
        at = error_model.at(name)
        x = error_model.space.sample(3, 0, 40, pose=number)
        expected = at.exact(x) if model == "exact" else at.linear(x)
        np.testing.assert_allclose(sampled_positions(pose), expected[:3], rtol=1e-6, atol=1e-12)
        assert len(pose["ghosts"]) == 3


@pytest.mark.slow
def test_many_samples_are_drawn_in_pieces_and_are_those_of_one(run, folder):
    run("--samples", "40000", "--out", "page.html")
    (pose,) = shown_poses(folder / "page.html")
    error_model = ErrorModel.load(folder / "4dof.errors.yaml")
    last = error_model.at().exact(error_model.space.sample(3, 39_990, 10))
    np.testing.assert_allclose(sampled_positions(pose)[:, -10:], last[:3], rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize(("limit", "code", "verdict"), [("50 mm", 0, "met"), ("1 mm", 1, "not met")])
def test_a_limit_is_judged_in_the_page_and_by_the_exit_code(run, folder, limit, code, verdict):
    found, said = run("--pose", "paper", "--samples", "200", "--spec", limit, "--out", "page.html")
    assert found == code
    assert said.splitlines()[-1].startswith("wrote page.html (")
    assert shown_poses(folder / "page.html")[0]["answers"][0][2] == verdict


@pytest.mark.slow
def test_what_is_assumed_is_said_below_the_answer(run, folder):
    sheet = folder / "4dof.errors.yaml"
    sheet.write_text(sheet.read_text("utf-8").replace("scope: pose}}", "scope: pose}, assumed: true}"), "utf-8")
    run("--out", "page.html")
    text = (folder / "page.html").read_text("utf-8")
    assert "Rests on assumptions: 1 of" in text[: text.index("<main")]


@pytest.mark.slow
def test_a_warning_of_many_poses_is_one_line(run, folder):
    (folder / "way.csv").write_text(f"{HEADER}\n0,0,0,0\n" + "9,0,0,0\n" * 5)
    code, said = run("--trajectory", "way.csv", "--out", "page.html")
    assert code == 0
    (line,) = [line for line in said.splitlines() if "W_JOINT_LIMIT" in line]
    assert line.endswith("(such a warning at 5 of 6 poses)")


WRONG = (
    (["--pose", "paper", "--q", "1 2 3 4 deg"], "--pose and --q exclude each other"),
    (["--pose", "paper", "--all-poses"], "--pose and --all-poses exclude each other"),
    (["--trajectory", "t.csv", "--all-poses"], "--all-poses and --trajectory exclude"),
    (["--pose", "straigt"], "did you mean 'straight'"),
    (["--trajectory", "none.csv"], "none.csv: error E_TRAJECTORY: the file does not exist"),
    (["--samples", "100001"], "more than a page can show"),
    (["--port", "8000"], "--port is for a page that is served"),
    (["--no-browser"], "--no-browser is for a page that is served"),
    (["--factor", "-1"], "factor must be a positive number"),
    (["--spec", "1"], "has no unit"),
)


def test_what_cannot_be_shown_is_refused_in_one_line_and_writes_nothing(run, folder):
    for options, message in WRONG:
        code, said = run(*options, "--out", "page.html")
        assert code == 2
        (line,) = [line for line in said.splitlines() if " warning " not in line]
        assert message in line
    sheet = folder / "4dof.errors.yaml"
    text, count = re.subn(r"^poses:\n(  .*\n)+", "", sheet.read_text("utf-8"), flags=re.MULTILINE)
    assert count == 1
    sheet.write_text(text, "utf-8")
    code, said = run("--all-poses", "--out", "page.html")
    assert (code, "the sheet has no poses" in said) == (2, True)
    assert not (folder / "page.html").exists()


# served --------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_without_a_file_the_page_is_served_and_made_anew(run, folder, monkeypatch):
    served = {}

    def serve(make_page, watched, **options):
        served.update(options, watched=watched, first=make_page())
        sheet = folder / "4dof.errors.yaml"
        sheet.write_text(sheet.read_text("utf-8").replace("straight: 0 10", "straight: 5 10"), "utf-8")
        served["second"] = make_page()
        sheet.write_text("precision-pin: 1\nrobot: [", "utf-8")
        with pytest.raises(InputError):
            make_page()

    monkeypatch.setattr(live, "serve", serve)
    code, _ = run("--no-browser", "--port", "8123")
    assert code == 0
    assert (served["port"], served["open_browser"]) == (8123, False)
    assert [path.name for path in served["watched"]] == ["4dof.errors.yaml", "4dof.urdf"]
    assert all(path.exists() for path in served["watched"])
    assert "joint1 0°" in served["first"]
    assert "joint1 5°" in served["second"]
    # a trajectory is watched too
    (folder / "way.csv").write_text(f"{HEADER}\n0,0,0,0\n")
    seen = []
    monkeypatch.setattr(live, "serve", lambda make_page, watched, **options: seen.extend([*watched, options]))
    shutil.copy(PAPER_SHEET, folder)
    run("--trajectory", "way.csv")
    assert (seen[2].name, seen[3]["port"], seen[3]["open_browser"]) == ("way.csv", 0, True)


# trajectories --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def chain():
    return Chain.from_urdf(PAPER_SHEET.with_name("4dof.urdf"), tip="tool")


def written(folder: Path, content: str | bytes) -> Path:
    path = folder / "way.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def test_columns_may_stand_in_any_order_with_times_and_blank_lines(tmp_path, chain):
    path = written(tmp_path, "\ufefft, joint4 ,joint2,joint1,joint3\r\n0.5,4,2,1,3\r\n\r\n0.75,-4,-2e-1,-1,-3\r\n")
    way = read_trajectory(path, chain, 10)
    np.testing.assert_array_equal(way.values, [[1, 2, 3, 4], [-1, -0.2, -3, -4]])
    np.testing.assert_array_equal(way.times, [0.5, 0.75])
    untimed = read_trajectory(written(tmp_path, f"{HEADER}\n1,2,3,4\n5,6,7,8\n"), chain, 10)
    assert untimed.times is None
    assert untimed.names == ("row 1", "row 2")


def test_a_wrong_trajectory_is_refused_with_its_line(tmp_path, chain):
    for content, line, message in (
        ("\n\n", None, "the file is empty"),
        (b"\xff\xfe\x00", None, "not UTF-8"),
        (f"{HEADER}\n", 1, "no poses"),
        ("joint1,joint2,joint3\n1,2,3\n", 1, "no column for the joints joint4"),
        (f"{HEADER},joint5\n1,2,3,4,5\n", 1, "'joint5' is no joint of the chain; did you mean"),
        (f"{HEADER},joint1\n1,2,3,4,5\n", 1, "'joint1' has two columns"),
        (f"{HEADER},t\n1,2,3,4,5\n", 1, "times come first"),
        (f"{HEADER}\n1,2,3,4\n\n1,2,3\n", 4, "3 values for 4 columns"),
        (f"{HEADER}\n1,2,3,4\n1,2,,4\n", 3, "joint3: '' is not a finite number"),
        (f"{HEADER}\n1,2,3,90 deg\n", 2, "joint4: '90 deg' is not a finite number"),
        (f"{HEADER}\n1,nan,3,4\n", 2, "joint2: 'nan' is not a finite number"),
        (f"t,{HEADER}\n1,1,2,3,4\n0.5,1,2,3,4\n", 3, "the time goes back from 1 s to 0.5 s"),
        (f"t,{HEADER}\n0,1,2,3,4\n0,1,2,3,4\n", 3, "the time stands still at 0 s"),
        (f"{HEADER}\n" + "1,2,3,4\n" * 4, 5, "more than 3 poses"),
    ):
        path = written(tmp_path, content)
        with pytest.raises(InputError) as caught:
            read_trajectory(path, chain, 3)
        (finding,) = caught.value.findings
        assert (finding.file, finding.line) == (str(path), line)
        assert message in finding.message
        assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_the_map_of_a_grid_is_in_the_page_and_its_file_is_not_written_over(run, folder):
    lines = ("joints:", "  joint1: 0 90 deg", "  joint2: 10 40 deg", "  joint3: 45 deg", "  joint4: 0 deg")
    grid = folder / "grid.yaml"
    grid.write_text("\n".join(lines) + "\n")
    code, said = run("--map", "grid.yaml", "--out", "page.html")
    assert code == 0, said
    assert "4 places, coloured by the worst pose at each<" in (folder / "page.html").read_text("utf-8")
    text = grid.read_text()
    grid.write_text(text.replace("joint1", "joint9"))
    code, said = run("--map", "grid.yaml", "--out", "other.html")
    assert code == 2
    assert "grid.yaml" in said
    assert "joint9" in said
    assert not (folder / "other.html").exists()
