"""Runs that are killed, interrupted or lose their workers: no result is lost, and no process remains."""

from __future__ import annotations

import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import psutil
import pytest

import precision_pin as pp
from precision_pin.cli import main
from precision_pin.kernel.sampler import BLOCK
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sampling.workers import Processes
from sampling.cases import MODEL, assert_same_bits, in_one_go, sampled, spawned, wait_until, work

TRIALS = int(os.environ.get("KILL_TRIALS", "4"))
"""Number of runs that are killed repeatedly until they are complete."""


@pytest.mark.slow
def test_killed_at_any_moment_and_resumed(tmp_path: Path, monkeypatch) -> None:
    from sampling import kill_target  # it warms the sampler up, for the fork server

    context = get_context("forkserver")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, sys.path)))  # where the server finds its module
    context.set_forkserver_preload(["sampling.kill_target"])
    expected = pp.monte_carlo(MODEL, "paper", samples=kill_target.SAMPLES, seed=9).to_json()
    generator = random.Random(0)
    kills = resumed = 0
    for trial in range(TRIALS):
        file, result = tmp_path / f"{trial}.journal", tmp_path / f"{trial}.json"
        longest = 0.05
        while not result.exists():
            process = context.Process(target=kill_target.go, args=(str(file), str(result)))
            process.start()
            process.join(generator.uniform(0, longest))
            if process.is_alive():
                process.kill()
                kills += 1
                resumed += file.exists() and file.stat().st_size > 10_000
                longest *= 1.1  # so that a slow machine comes to an end
            process.join()
            assert process.exitcode in (0, -signal.SIGKILL)
            if process.exitcode:
                result.unlink(missing_ok=True)
        assert result.read_text("utf-8") == expected, trial
        assert file.stat().st_size < 2**20
    print(f"{TRIALS} runs, {kills} kills, {resumed} with something to go on from")
    assert kills >= TRIALS
    assert resumed >= TRIALS // 2


# processes -----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_killed_processes_cost_no_result() -> None:
    workers, task = Processes(2), work(4, 150 * BLOCK)
    here = psutil.Process()
    killed = []

    def kill_sometimes(_: int) -> None:
        # one that was killed just before may still be listed
        others = [process for process in spawned(here) if process not in killed]
        if len(killed) < 2 and others:
            killed.append(others[-1])
            killed[-1].kill()

    try:
        assert_same_bits(sampled(task, workers, 4, kill_sometimes), in_one_go(task))
    finally:
        workers.close(done=True)
    assert len({process.pid for process in killed}) == 2
    assert spawned(here) == []


@pytest.fixture
def started(executable: str, tmp_path: Path) -> Iterator[Any]:
    """Start ``precision-pin analyze`` in a folder of its own."""
    begun: list[subprocess.Popen[str]] = []

    def start(*arguments: str) -> subprocess.Popen[str]:
        begun.append(
            subprocess.Popen(
                [executable, "analyze", *arguments],
                cwd=tmp_path,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                start_new_session=True,
            )
        )
        return begun[-1]

    yield start
    for process in begun:
        process.kill()
        process.communicate()


@pytest.fixture
def executable() -> str:
    return str(Path(sys.executable).parent / "precision-pin")


def busy_children(process: subprocess.Popen[str], count: int) -> list[psutil.Process]:
    """Wait until the processes of a run sample; return all it has started, helpers too."""
    parent = psutil.Process(process.pid)

    def busy() -> bool:
        found = spawned(parent)
        return len(found) == count and all(child.cpu_times().user > 1.0 for child in found)

    wait_until(busy, 60)
    return parent.children(recursive=True)


def ended(processes: list[psutil.Process]) -> bool:
    return psutil.wait_procs(processes, timeout=10)[1] == []


MUCH = ("--samples", "100000000000")


@pytest.mark.slow
def test_no_process_stays_when_the_parent_is_killed(started: Any) -> None:
    process = started(*MUCH, "--processes", "2")
    children = busy_children(process, 2)
    process.kill()
    process.wait()
    assert ended(children)


@pytest.mark.slow
def test_no_process_stays_after_ctrl_c(started: Any, tmp_path: Path) -> None:
    process = started(*MUCH, "--processes", "2", "--journal", "run.journal", "--json", "result.json")
    children = busy_children(process, 2)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: the children get it too
    out, err = process.communicate(timeout=30)
    assert (process.returncode, out) == (130, "")
    assert re.fullmatch(
        r"the journal run\.journal holds the first [\d,]+ of 100,000,000,000 samples; the same command with --resume "
        r"goes on from there\ninterrupted\n",
        without_warnings(err),
    )
    assert ended(children)
    assert os.listdir(tmp_path) == ["run.journal"]


@pytest.mark.slow
def test_no_process_stays_after_a_normal_end_or_an_error(tmp_path: Path) -> None:
    here = psutil.Process()
    settings = {"samples": 3 * BLOCK, "seed": 2}
    result = pp.monte_carlo(MODEL, "paper", processes=1, **settings)
    assert spawned(here) == []
    assert result.to_json() == pp.monte_carlo(MODEL, "paper", **settings).to_json()

    def fail(_: int) -> None:
        assert spawned(here)
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        pp.monte_carlo(MODEL, "paper", processes=1, progress=fail, **settings)
    assert spawned(here) == []


# Ctrl-C --------------------------------------------------------------------------------------------------------------


def without_warnings(text: str) -> str:
    return "".join(line for line in text.splitlines(keepends=True) if " warning W_" not in line)


def held(err: str) -> int:
    return int(err.split("holds the first ")[1].split()[0].replace(",", ""))


@pytest.mark.slow
def test_ctrl_c_once_saves_and_says_how_to_go_on(started: Any, tmp_path: Path) -> None:
    samples = 1000 * BLOCK + 1
    line = ("--samples", str(samples), "--seed", "3", "--spec", "45 mm @ 90 %", "--journal", "run.journal")
    process = started(*line, "--threads", "1", "--json", "result.json", "--out", "plots")
    wait_until(lambda: (tmp_path / "run.journal").exists(), 60)
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    begun = time.monotonic()
    _, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert time.monotonic() - begun < 5
    assert os.listdir(tmp_path) == ["run.journal"]
    done = held(err)
    assert 0 < done < samples
    assert done % BLOCK == 0
    process = started(*line, "--threads", "3", "--json", "result.json", "--resume")
    _, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    assert f"the journal run.journal holds the first {done:,} samples\n" in err
    specifications = [pp.specification("45 mm @ 90 %")]
    expected = pp.monte_carlo(MODEL, samples=samples, seed=3, specifications=specifications)
    result = json.loads((tmp_path / "result.json").read_text("utf-8"))
    known = json.loads(expected.to_json())
    for key in ("position", "attitude", "covariance", "spec", "samples", "complete"):
        assert result[key] == known[key], key


@pytest.mark.slow
def test_ctrl_c_twice_stops_at_once(started: Any, tmp_path: Path) -> None:
    process = started(*MUCH, "--journal", "run.journal", "--json", "result.json")
    wait_until(lambda: (tmp_path / "run.journal").exists(), 60)
    time.sleep(3.0)  # so that a first record is there
    for _ in range(2):
        process.send_signal(signal.SIGINT)
        time.sleep(0.002)
    begun = time.monotonic()
    _, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert time.monotonic() - begun < 2
    assert err.endswith("interrupted\n")
    assert "Traceback" not in err
    assert os.listdir(tmp_path) == ["run.journal"]
    process = started(*MUCH, "--journal", "run.journal", "--resume")
    assert process.stderr is not None
    line = next(line for line in process.stderr if " warning W_" not in line)
    assert held(line) > 0


# the command line ----------------------------------------------------------------------------------------------------


@pytest.fixture
def analyze(tmp_path: Path, monkeypatch, capsys) -> Any:
    """Run ``precision-pin analyze`` in this process, in a folder of its own; return exit code, stdout and stderr."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["precision-pin", "analyze", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        assert isinstance(ended.value.code, int)
        return ended.value.code, *capsys.readouterr()

    return run


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--resume",), "--resume needs the run's --journal FILE"),
        (("--threads", "2", "--processes", "2"), "--threads and --processes exclude each other"),
        (("--threads", "2", "--dask", "tcp://127.0.0.1:1"), "--threads and --dask exclude each other"),
        (("--threads", "0"), "threads must be a whole number from 1 to 1024, got 0"),
        (("--journal", "a.json", "--json", "./a.json"), "--journal and --json name the same file"),
        (("--journal", "no/such/place"), "no/such does not exist"),
    ],
)
def test_wrong_options_are_refused_in_one_line(analyze: Any, tmp_path: Path, arguments, message: str) -> None:
    code, out, err = analyze("--samples", "10", *arguments)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1 + err.count(" warning W_")
    assert message in err
    assert os.listdir(tmp_path) == []


@pytest.mark.slow
def test_a_changed_input_is_told(analyze: Any, tmp_path: Path) -> None:
    for file in PAPER_SHEET.parent.glob("4dof.*"):
        (tmp_path / file.name).write_bytes(file.read_bytes())

    def refused(*arguments: str) -> str:
        samples = () if "--samples" in arguments else ("--samples", "100")
        code, _, err = analyze("4dof.errors.yaml", "--quiet", "--journal", "j", *samples, *arguments)
        assert code == 2
        return without_warnings(err).removeprefix("precision-pin: error E_INPUT: the journal j ")

    assert analyze("4dof.errors.yaml", "--journal", "j", "--samples", "100")[0] == 0
    before = (tmp_path / "j").read_bytes()
    assert refused() == "already exists; resume its run, or remove the file\n"
    assert refused("--resume", "--seed", "8") == "belongs to another run: seed was '0', is '8'\n"
    assert refused("--resume", "--model", "linear") == "belongs to another run: model was 'exact', is 'linear'\n"
    assert refused("--resume", "--samples", "200") == "belongs to another run: samples was '100', is '200'\n"
    with (tmp_path / "4dof.errors.yaml").open("a", encoding="utf-8") as stream:
        stream.write("# a remark\n")
    assert refused("--resume") == "belongs to another run: the sheet has changed\n"
    with (tmp_path / "4dof.urdf").open("a", encoding="utf-8") as stream:
        stream.write("<!-- a remark -->\n")
    assert refused("--resume") == "belongs to another run: the URDF has changed; the sheet has changed\n"
    assert (tmp_path / "j").read_bytes() == before
