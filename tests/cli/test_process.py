"""The installed command as a process: what it imports, signals, pipes, streams."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

HEAVY = (
    "numpy",
    "scipy",
    "pinocchio",
    "matplotlib",
    "numba",
    "meshcat",
    "pydantic",
    "ruamel",
    "xarray",
    "tqdm",
    "yourdfpy",
)


def imported(*arguments: str) -> set[str]:
    """Return the top-level modules that a command line has imported when it ends."""
    code = (
        "import sys\n"
        f"sys.argv = ['precision-pin', *{list(arguments)!r}]\n"
        "from precision_pin.cli import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        "print(*{name.split('.')[0] for name in sys.modules}, file=sys.stderr)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    return set(done.stderr.split())


@pytest.mark.parametrize(
    "arguments",
    [("--help",), ("--version",), ("analyze", "--help"), ("nosuch",)],
)
def test_help_imports_nothing_heavy(arguments):
    assert imported(*arguments) & set(HEAVY) == set()


@pytest.mark.slow
def test_tables_need_no_matplotlib_and_mcpc_no_compiler():
    assert imported("mcpc") & {"matplotlib", "numba", "meshcat", "xarray", "yourdfpy"} == set()
    assert (
        imported("analyze", "--samples", "10", "--json", "-") & {"matplotlib", "meshcat", "xarray", "yourdfpy"} == set()
    )


@pytest.mark.slow
@pytest.mark.parametrize("command", [("precision-pin",), ("-m", "precision_pin")])
def test_installed_and_as_a_module(command, executable):
    line = [executable] if command == ("precision-pin",) else [sys.executable, *command]
    done = subprocess.run([*line, "mcpc", "--json"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0
    assert done.stderr == ""
    assert json.loads(done.stdout)["tip"] == "tool"


@pytest.mark.slow
def test_exit_codes_and_streams(executable, folder):
    def outcome(*arguments: str) -> tuple[int, str, str]:
        done = subprocess.run(
            [executable, "analyze", "--samples", "100", *arguments],
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=60,
        )
        return done.returncode, done.stdout, done.stderr

    code, out, err = outcome("--json", "-", "--spec", "1 nm", "--q", "0 0 0 200 deg")
    assert code == 1
    assert json.loads(out)["spec"][0]["met"] is False
    assert "W_JOINT_LIMIT" in err
    code, out, err = outcome("--pose", "nosuch")
    assert (code, out) == (2, "")
    assert err.count("\n") == 1


@pytest.mark.slow
@pytest.mark.parametrize("after", [0.5, 3.0])
def test_ctrl_c_in_a_long_run(executable, folder, new_files, after):
    arguments = ["analyze", "--samples", "100000000000", "--json", "result.json", "--out", "plots"]
    process = subprocess.Popen(
        [executable, *arguments], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        time.sleep(after)
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        begun = time.monotonic()
        out, err = process.communicate(timeout=30)
        taken = time.monotonic() - begun
    finally:
        process.kill()
    assert (process.returncode, out) == (130, "")
    # where the sampler had never run on this machine, that it is being compiled was said before
    assert re.fullmatch(r"(compiling the sampler[^\n]*\n)?interrupted\n", err)
    assert taken < 5
    assert new_files() == set()


@pytest.mark.slow
def test_ctrl_c_while_the_sampler_is_compiled(executable, folder, new_files, tmp_path_factory):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path_factory.mktemp("cache"))}
    process = subprocess.Popen(
        [executable, "analyze", "--samples", "100000000000"],
        cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert process.stderr is not None
        assert process.stderr.readline().startswith("compiling the sampler")
        time.sleep(1.5)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=5)
    finally:
        process.kill()
    assert (process.returncode, out, err) == (130, "", "interrupted\n")
    assert new_files() == set()


def closed_pipe() -> int:
    """Return a pipe to write to that nobody reads, as after ``| head`` has left."""
    reading, writing = os.pipe()
    os.close(reading)
    return writing


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        pytest.param(
            ("analyze", "--samples", "100", "--json", "result.json", "--spec", "1 nm"), 1, marks=pytest.mark.slow
        ),
        pytest.param(("schema",), 0, marks=pytest.mark.slow),
        (("check", "forked.urdf"), 0),
    ],
)
def test_a_reader_that_has_gone_is_no_error(executable, folder, arguments, code):
    writing = closed_pipe()
    try:
        done = subprocess.run(
            [executable, *arguments], cwd=folder, stdout=writing, stderr=subprocess.PIPE, text=True, timeout=60
        )
    finally:
        os.close(writing)
    assert "Traceback" not in done.stderr
    assert "Errno" not in done.stderr
    assert "Exception" not in done.stderr
    assert done.returncode == code
    if arguments[0] == "analyze":  # what was asked for besides is written
        assert json.loads((folder / "result.json").read_text("utf-8"))["samples"] == 100


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux has a device that is always full")
@pytest.mark.parametrize(
    "arguments",
    [("analyze", "--samples", "100"), ("init", "4dof.urdf", "--out", "-")],
)
def test_a_stdout_that_is_full(executable, folder, arguments):
    with open("/dev/full", "w") as device:
        done = subprocess.run(
            [executable, *arguments], cwd=folder, stdout=device, stderr=subprocess.PIPE, text=True, timeout=60
        )
    assert done.returncode == 2
    assert [line for line in done.stderr.splitlines() if " warning W_" not in line] == [
        "precision-pin: error E_OUTPUT: cannot write to the standard output: No space left on device"
    ]


@pytest.mark.slow
def test_an_output_that_cannot_show_greek(executable, folder):
    environment = os.environ | {"PYTHONIOENCODING": "latin-1"}
    done = subprocess.run([executable, "mcpc"], cwd=folder, env=environment, capture_output=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "offset °  \\u03b1 °".encode("latin-1") in done.stdout


@pytest.mark.slow
def test_a_file_whose_name_is_not_utf8(executable, folder):
    if sys.platform != "linux":
        pytest.skip("such names exist on Linux only")
    name = b"arm\xff.urdf"
    (folder / "gantry.urdf").rename(os.fsdecode(bytes(folder) + b"/" + name))
    arguments = [executable.encode(), b"analyze", name, b"gantry.errors.yaml", b"--samples", b"10"]
    done = subprocess.run([*arguments, b"--json", b"result.json"], cwd=folder, capture_output=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(b"arm\\udcff.urdf: ")
    assert json.loads((folder / "result.json").read_text("utf-8"))["robot"] == "arm\udcff.urdf"


@pytest.mark.slow
def test_without_a_stdout(executable, folder):
    done = subprocess.run(
        ["sh", "-c", 'exec "$0" mcpc >&-', executable],
        cwd=folder,
        stderr=subprocess.PIPE,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0
    assert done.stderr == ""
