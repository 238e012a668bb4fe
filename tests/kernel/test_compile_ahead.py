"""Compilation jobs in other processes: done in order even if a process dies; no process outlives its parent."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import pytest

from precision_pin.base import compile_ahead
from precision_pin.base.compile_ahead import Job, compile_jobs, shown_by, silent
from precision_pin.kernel import parts


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[subprocess.Popen[str]]:
    """Return the list of the processes that are started, as it grows."""
    found: list[subprocess.Popen[str]] = []

    class Recorded(subprocess.Popen):  # type: ignore[type-arg]
        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            found.append(self)

    monkeypatch.setattr(compile_ahead.subprocess, "Popen", Recorded)
    return found


@pytest.mark.slow
def test_jobs_are_done_the_last_after_all_others(tmp_path: Path, started: list[subprocess.Popen[str]]) -> None:
    shares: list[float] = []

    @contextmanager
    def shown() -> Iterator[Any]:
        yield shares.append

    first = [Job("os", "mkdir", (str(tmp_path / name),), 0.1) for name in "abcd"]
    slow = Job("time", "sleep", (0.5,), 1.0)
    last = Job("os", "rename", (str(tmp_path / "a"), str(tmp_path / "b" / "a")), 0.1, last=True)
    with shown_by(shown):
        compile_jobs([*first, slow, last])
    assert sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")) == ["b", "b/a", "c", "d"]
    assert 0 < len(started) <= compile_ahead.MOST_WORKERS
    assert all(worker.returncode is not None for worker in started)
    assert shares
    assert shares == sorted(shares)
    assert 0 <= shares[0] <= shares[-1] <= 1


@pytest.mark.slow
def test_jobs_that_fail_or_end_their_process_keep_nothing_else_from_being_done(tmp_path: Path) -> None:
    jobs = [
        Job("os", "rmdir", (str(tmp_path / "none"),), 3.0),
        Job("os", "abort", (), 2.0),
        Job("no_such_module", "f", (), 1.5),
        Job("os", "mkdir", (str(tmp_path / "a"),), 1.0),
    ]
    compile_jobs([*jobs, Job("os", "mkdir", (str(tmp_path / "b"),), 1.0, last=True)])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


@pytest.mark.parametrize("executable", ["", "/no/such/python", sys.prefix])
def test_where_no_process_can_be_started_nothing_happens(executable: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", executable)
    compile_jobs([Job("os", "abort", (), 1.0)])


def test_a_process_that_never_answers_is_given_up(
    monkeypatch: pytest.MonkeyPatch, started: list[subprocess.Popen[str]]
) -> None:
    monkeypatch.setattr(compile_ahead, "PATIENCE", 0.3)
    compile_jobs([Job("time", "sleep", (60.0,), 1.0)])
    assert started[0].returncode is not None


def test_an_interrupt_ends_the_processes_at_once(started: list[subprocess.Popen[str]]) -> None:
    @contextmanager
    def shown() -> Iterator[Any]:
        def interrupt(share: float) -> None:
            raise KeyboardInterrupt

        yield interrupt

    began = time.monotonic()
    with shown_by(shown), pytest.raises(KeyboardInterrupt):
        compile_jobs([Job("time", "sleep", (60.0,), 1.0), Job("time", "sleep", (60.0,), 1.0)])
    assert time.monotonic() - began < 5
    assert all(worker.returncode is not None for worker in started)


def test_a_process_ends_with_whoever_asked() -> None:
    worker = subprocess.Popen(
        [sys.executable, "-c", compile_ahead._PROGRAM, json.dumps(sys.path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    with worker:
        assert worker.stdin is not None
        assert worker.stdout is not None
        worker.stdin.write('["time", "sleep", 0.0]\n["time", "sleep", 60.0]\n')
        worker.stdin.flush()
        assert worker.stdout.readline() == "done\n"
        worker.stdin.close()
        assert worker.wait(timeout=10) == 0


@pytest.mark.slow
def test_jobs_begun_ahead_are_done_once_and_others_join_them(
    tmp_path: Path, started: list[subprocess.Popen[str]]
) -> None:
    begun = [Job("os", "mkdir", (str(tmp_path / name),), 0.1) for name in "ab"]
    slow = Job("time", "sleep", (0.3,), 1.0)
    compile_ahead.begin_jobs([slow, *begun])
    more = Job("os", "mkdir", (str(tmp_path / "c"),), 0.1)
    last = Job("os", "rename", (str(tmp_path / "a"), str(tmp_path / "c" / "a")), 0.1, last=True)
    compile_jobs([*begun, more, last])
    assert sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")) == ["b", "c", "c/a"]
    assert 0 < len(started) <= compile_ahead.MOST_WORKERS
    assert all(worker.returncode is not None for worker in started)


@pytest.mark.slow
def test_jobs_begun_ahead_that_nobody_asks_for_end_with_the_process() -> None:
    code = (
        "from precision_pin.base.compile_ahead import Job, begin_jobs\n"
        "import time\n"
        "begin_jobs([Job('time', 'sleep', (60.0,), 1.0)])\n"
        "time.sleep(0.5)\n"
    )
    began = time.monotonic()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=30, check=True)
    assert (done.stdout, done.stderr) == ("", "")
    assert time.monotonic() - began < 20


def test_compiling_begins_only_where_no_loops_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    monkeypatch.setattr(parts, "begin_jobs", lambda jobs: asked.append(len(jobs)))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    parts.begin_compiling()
    assert asked == [len(parts.PARTS) - 2]  # without the laws, which the sheet decides, and the linear model
    (tmp_path / "kernel_1").mkdir()
    (tmp_path / "kernel_1" / f"loops.run-1.py{sys.version_info.major}{sys.version_info.minor}.nbi").touch()
    parts.begin_compiling()
    assert len(asked) == 1


@pytest.mark.parametrize(("shown", "said"), [(None, True), (silent, False)])
def test_python_says_that_something_is_compiled(
    shown: Any, said: bool, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    with nullcontext() if shown is None else shown_by(shown):
        compile_jobs([Job("os", "mkdir", (str(tmp_path / "a"),), 1.0)])
    line = "precision-pin: compiling the sampler, once on this machine: some 8 s\n"
    assert capfd.readouterr().err == (line if said else "")
