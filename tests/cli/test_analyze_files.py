"""What ``analyze`` and ``init`` write: whole files or none, and nothing where nothing can be written."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

FILES = {f"{name}.{suffix}" for name in ("position", "attitude", "components") for suffix in ("png", "svg")} | {
    "analysis.json"
}
QUICK = ("analyze", "--samples", "200")


@pytest.mark.slow
def test_out_holds_the_plots_and_the_result(run, folder, new_files):
    outcome = run(*QUICK, "--out", "deep/er")
    assert outcome.code == 0
    assert outcome.out.startswith("4dof.urdf: base to tool")
    assert outcome.said == ["wrote deep/er: analysis.json, position, attitude and components as PNG and SVG"]
    assert new_files() == {"deep", "deep/er", *(f"deep/er/{name}" for name in FILES)}
    for name in FILES:
        path = folder / "deep/er" / name
        if path.suffix == ".png":
            assert path.read_bytes().startswith(b"\x89PNG\r\n")
        elif path.suffix == ".svg":
            assert ElementTree.parse(path).getroot().tag == "{http://www.w3.org/2000/svg}svg"
    assert json.loads((folder / "deep/er/analysis.json").read_text("utf-8")) == run(*QUICK, "--json", "-").json


@pytest.mark.slow
def test_out_overwrites_its_own_files_and_leaves_others(run, folder):
    (folder / "plots").mkdir()
    (folder / "plots" / "position.png").write_text("old")
    (folder / "plots" / "notes.txt").write_text("mine")
    assert run(*QUICK, "--out", "plots").code == 0
    assert {path.name for path in (folder / "plots").iterdir()} == FILES | {"notes.txt"}
    assert (folder / "plots" / "position.png").read_bytes().startswith(b"\x89PNG")
    assert (folder / "plots" / "notes.txt").read_text() == "mine"


@pytest.mark.slow
def test_json_to_a_file_prints_the_table_as_well(run, folder):
    outcome = run(*QUICK, "--json", "result.json")
    assert outcome.code == 0
    assert "99.73 %" in outcome.out
    assert json.loads((folder / "result.json").read_text("utf-8"))["samples"] == 200
    assert (folder / "result.json").stat().st_mode & 0o777 == 0o666 & ~current_umask()


def current_umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def test_json_is_written_through_a_link(run, folder):
    (folder / "elsewhere").mkdir()
    (folder / "result.json").symlink_to(folder / "elsewhere" / "real.json")
    assert run(*QUICK, "--json", "result.json").code == 0
    assert (folder / "result.json").is_symlink()
    assert json.loads((folder / "elsewhere" / "real.json").read_text("utf-8"))["samples"] == 200


def test_json_to_a_device_leaves_the_device_alone(run):
    if not Path("/dev/null").is_char_device():
        pytest.skip("no /dev/null here")
    assert run(*QUICK, "--json", "/dev/null").code == 0
    assert Path("/dev/null").is_char_device()


UNWRITABLE = [
    (("--json", "plots"), "cannot write plots: it is a folder"),
    (("--json", "nowhere/result.json"), "nowhere does not exist"),
    (("--json", "4dof.urdf/result.json"), "4dof.urdf is not a folder"),
    (("--out", "4dof.urdf"), "cannot write to the folder 4dof.urdf: it is a file"),
    (("--out", "4dof.urdf/plots"), "4dof.urdf is not a folder"),
    (("--out", ""), "--out names no folder"),
    (("--json", ""), "it is a folder"),
]


@pytest.mark.parametrize(("target", "message"), UNWRITABLE, ids=[" ".join(target) for target, _ in UNWRITABLE])
def test_what_cannot_be_written_is_refused_before_any_work(run, folder, contents, monkeypatch, target, message):
    (folder / "plots").mkdir()
    before = contents()
    monkeypatch.setattr("precision_pin.cli.analyze.read_sheet", lambda *a, **k: pytest.fail("work was begun"))
    outcome = run(*QUICK, *target)
    assert (outcome.code, outcome.out) == (2, "")
    assert message in outcome.err
    assert len(outcome.err_lines) == 1
    assert contents() == before


@pytest.mark.parametrize("target", [("--json", "locked/result.json"), ("--out", "locked"), ("--out", "locked/new/er")])
def test_a_folder_without_the_right_to_write(run, folder, contents, monkeypatch, target):
    (folder / "locked").mkdir()
    before = contents()
    # root may write anywhere, so the system's answer is planted
    real = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: real(path, mode) and not str(path).endswith("locked"))
    outcome = run(*QUICK, *target)
    assert outcome.code == 2
    (line,) = outcome.err_lines
    assert line.endswith("locked is not writable")
    assert "error E_OUTPUT" in line
    assert contents() == before


def test_bad_input_leaves_no_empty_folder(run, new_files):
    assert run(*QUICK, "--out", "plots", "--pose", "nosuch").code == 2
    assert run(*QUICK, "nosuch.yaml", "--out", "plots").code == 2
    assert new_files() == set()


def full(executable: str, folder: Path, limit: int, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a command that can write no file past a limit, as on a disk that becomes full."""

    def restrict() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    return subprocess.run(
        [executable, *arguments], cwd=folder, preexec_fn=restrict, capture_output=True, text=True, timeout=120
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("limit", "target"),
    [
        (1_000, ("--json", "result.json")),
        (1_000, ("--out", "plots")),  # none of the files fits
        (30_000, ("--out", "plots")),  # the result fits, not the plots
        (30_000, ("--out", "new/plots")),
    ],
)
def test_a_full_disk_leaves_nothing_half_written(executable, folder, contents, target, limit):
    (folder / "result.json").write_text("before")
    (folder / "plots").mkdir()
    (folder / "plots" / "position.svg").write_text("before")
    before = contents()
    done = full(executable, folder, limit, *QUICK, *target)
    assert done.returncode == 2
    lines = [
        line
        for line in done.stderr.splitlines()
        if " warning W_" not in line and not line.startswith("compiling the sampler")
    ]
    assert len(lines) == 1
    assert "error E_OUTPUT: cannot write" in lines[0]
    assert done.stdout.startswith("4dof.urdf")  # the work is not lost
    assert contents() == before


@pytest.mark.slow
def test_a_folder_in_the_way_of_a_plot(run, folder, contents):
    (folder / "plots" / "position.svg").mkdir(parents=True)
    before = contents()
    outcome = run(*QUICK, "--out", "plots")
    assert outcome.code == 2
    assert "plots/position.svg: it is a folder" in outcome.err
    assert contents() == before
