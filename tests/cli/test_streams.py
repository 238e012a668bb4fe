"""Streams that are full, closed or gone, and resources that the system does not give: one line and the right code."""

from __future__ import annotations

import errno
import io
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from precision_pin.base.errors import OutputError
from precision_pin.cli import streams
from precision_pin.cli.resources import shortage

FULL = "precision-pin: error E_OUTPUT: cannot write to the standard output: No space left on device\n"
needs_full = pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux has a device that is always full")


def shell(line: str, folder: Path) -> tuple[int, str, str]:
    """Run a line in which PP is the command; return exit code, stdout and stderr."""
    command = line.replace("PP", f"{sys.executable} -m precision_pin")
    done = subprocess.run(["bash", "-c", command], cwd=folder, capture_output=True, text=True, timeout=60)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.slow
@needs_full
@pytest.mark.parametrize("words", ["--version", "--help", "schema"])
def test_a_full_stdout_is_one_line(folder, words):
    assert shell(f"PP {words} > /dev/full", folder) == (2, "", FULL)


@pytest.mark.slow
@needs_full
@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("nosuch", 2),
        pytest.param("mcpc 4dof.urdf", 0, marks=pytest.mark.slow),
        pytest.param("check nosuch.yaml", 2, marks=pytest.mark.slow),
    ],
)
def test_a_full_stderr_changes_nothing(folder, words, code):
    usual = shell(f"PP {words}", folder)
    assert shell(f"PP {words} 2> /dev/full", folder) == (code, usual[1], "")


@pytest.mark.slow
@pytest.mark.parametrize("closed", ["2>&-", ">&- 2>&- <&-"])
def test_closed_streams(folder, closed):
    code, _, err = shell(f"PP init 4dof.urdf --out new.yaml {closed}", folder)
    assert (code, "Traceback" in err) == (0, False)
    # no stream's number was given to the file
    assert (folder / "new.yaml").read_text("utf-8").startswith("# Error sheet of the robot")


@pytest.mark.slow
def test_a_working_folder_that_is_gone(folder):
    line = "mkdir gone; cd gone; rmdir ../gone; PP {}"
    for words in ("export --out new", "view --out page.html", "analyze --json result.json"):
        code, out, err = shell(line.format(words), folder)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert "No such file or directory" in err


@pytest.mark.slow
def test_too_little_address_space(folder):
    if sys.platform != "linux":
        pytest.skip("macOS has no such limit")
    for words in ("analyze", "view --out page.html", "check 4dof.urdf"):
        code, out, err = shell(f"ulimit -v 600000; PP {words}", folder)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert "error E_RESOURCES: the address space is limited to 614 MB" in err
    assert shell("ulimit -v 600000; PP --help", folder)[0] == 0


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (MemoryError(), "not enough memory"),
        (RuntimeError("can't start new thread"), "no more threads"),
        (RuntimeError("std::bad_alloc"), "not enough memory"),
        (ImportError("libx.so: cannot allocate memory in static TLS block"), "not enough memory"),
        (OSError(errno.EMFILE, os.strerror(errno.EMFILE)), "Too many open files; a limit"),
    ],
)
def test_what_the_system_does_not_give(error, words):
    found = shortage(error)
    assert found is not None
    assert str(found).startswith("precision-pin: error E_RESOURCES: ")
    assert words in str(found)


def test_threads_that_do_not_start(run, monkeypatch):
    def refused(_: object) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", refused)
    outcome = run("mcpc")
    assert (outcome.code, outcome.out, outcome.err.count("\n")) == (2, "", 1)
    assert "E_RESOURCES: the system lets no thread start" in outcome.err


def test_a_bug_is_no_shortage():
    assert shortage(ValueError("planted")) is None
    assert shortage(OSError(errno.ENOENT, "no such file")) is None


def test_a_lack_of_memory_in_a_command_is_one_line(run, monkeypatch):
    def greedy(*_: object) -> object:
        raise MemoryError

    monkeypatch.setattr("precision_pin.model.error_model.ErrorModel.from_sheet", greedy)
    outcome = run("analyze")
    assert (outcome.code, outcome.out, outcome.err.count("\n")) == (2, "", 1)
    assert "E_RESOURCES" in outcome.err


def test_a_pipe_that_is_full_for_now_is_waited_for():
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    text = "x" * 200_000
    with subprocess.Popen(["wc", "-c"], stdin=reading, stdout=subprocess.PIPE) as reader:
        os.close(reading)
        stream = io.TextIOWrapper(io.BufferedWriter(streams._Tolerant(writing)), "utf-8")
        stream.write(text)
        stream.flush()
        os.close(writing)
        assert reader.communicate()[0].split() == [b"200000"]


@needs_full
def test_output_is_told_lost_once(monkeypatch):
    with open("/dev/full", "wb") as device:
        stream = io.TextIOWrapper(io.BufferedWriter(streams._Tolerant(device.fileno())), "utf-8")
        monkeypatch.setattr(sys, "stdout", stream)
        print("text")
        with pytest.raises(OutputError, match="No space left"):
            streams.raise_if_output_lost()
        streams.raise_if_output_lost()


def test_what_clears_a_progress_bar_comes_before_what_follows():
    code = "from precision_pin.cli.streams import *; prepare_streams(); sys.stderr.write('bar\\r'); os._exit(0)"
    done = subprocess.run([sys.executable, "-c", f"import os, sys; {code}"], capture_output=True, timeout=60)
    assert done.stderr == b"bar\r"
