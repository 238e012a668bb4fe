"""Identical bits for all workers and any order of blocks; what is killed, lost or interrupted costs no result; a Dask cluster."""

from __future__ import annotations

import json
import os
import pickle
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

import precision_pin as pp
from precision_pin.base import progress as progress_bar
from precision_pin.base.errors import InputError
from precision_pin.cli import main
from precision_pin.kernel import loops, sampler
from precision_pin.kernel.sampler import BLOCK
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sampling import many_poses
from precision_pin.sampling import workers as executors
from precision_pin.sampling.blocks import MOST_SAMPLES, check_samples
from precision_pin.sampling.journal import digest
from precision_pin.sampling.workers import Foreign, Processes, Threads, chosen, dask_cluster
from precision_pin.statistics import start
from sampling.cases import (
    MODEL,
    PLAN,
    SAMPLES,
    Muddled,
    assert_same_bits,
    in_one_go,
    sampled,
    spawned,
    wait_until,
    work,
)


class Unsendable:
    """Object that kills the process in which it is unpickled."""

    def __reduce__(self) -> tuple[Any, tuple[int]]:
        return os._exit, (1,)


@pytest.mark.slow
def test_seeds_in_every_layout_and_an_error_of_a_sample_comes_as_it_is() -> None:
    threads, processes = Threads(3), Processes(1)
    for seed, sizes in ((0, (1, 16)), (1, (3, None))):
        task = work(seed)
        whole = in_one_go(task)
        assert whole.count == SAMPLES
        for size in sizes:
            for workers in (threads, processes, Foreign(Muddled(shuffle=random.Random(seed)), 5)):
                assert_same_bits(sampled(task, workers, size), whole)
    backwards = Muddled()
    assert_same_bits(sampled(task, Foreign(backwards, 6), 2), whole)
    assert backwards.order[:6] == [10, 8, 6, 4, 2, 0]  # the executor did as its name says
    other = r"a worker has numpy \S+, the run was started with 0\.0; install the same version"
    for workers in (threads, processes, Foreign(Muddled(), 3)):
        with pytest.raises(InputError, match=other):
            sampled(work(packages=(("numpy", "0.0"),)), workers)
        workers.close(done=True)


@pytest.mark.parametrize("samples", [1, BLOCK, 17 * BLOCK + 5])
def test_runs_of_any_length(samples: int) -> None:
    task = work(7, samples)
    for most, size in ((1, None), (4, 5), (50, 100)):
        assert_same_bits(sampled(task, Foreign(Muddled(), most), size), in_one_go(task))


@pytest.mark.slow
def test_a_run_by_its_public_name_is_the_same_run_and_so_are_the_errors_it_keeps() -> None:
    settings = {"samples": 3 * BLOCK + 9, "seed": 5, "specifications": PLAN.specifications}
    known = pp.monte_carlo(MODEL, "paper", threads=1, **settings).to_json()
    errors = sampler.errors(work().layout, "exact", 5, 0, 3 * BLOCK + 9)
    with ThreadPoolExecutor(3) as pool:
        for how in ({}, {"executor": pool}, {"executor": Muddled(shuffle=random.Random(1)), "tasks_under_way": 4}):
            assert pp.monte_carlo(MODEL, "paper", **settings, **how).to_json() == known
            kept = pp.monte_carlo(MODEL, "paper", **settings, **how, keep_samples=True)
            np.testing.assert_array_equal(kept.errors, errors)


# what is sent --------------------------------------------------------------------------------------------------------


def test_work_and_its_blocks_can_be_sent_and_are_not_compiled_anew_where_they_arrive() -> None:
    task = work(3, 2 * BLOCK)
    in_one_go(task)
    before = len(loops.run.signatures)
    sent = pickle.loads(pickle.dumps(task))
    assert digest(replace(sent, packages=())) == digest(replace(task, packages=()))
    back = pickle.loads(pickle.dumps(sent.observe(0, 2)))
    assert_same_bits(back.add_to(start(PLAN)), in_one_go(task))
    # a read-only array that came back writable would have been another type, seven seconds of compiling
    assert len(loops.run.signatures) == before


# tasks under way -----------------------------------------------------------------------------------------------------


class Counting(Executor):
    """Threads that count their live futures."""

    def __init__(self, workers: int) -> None:
        self._max_workers = workers
        self.pool = ThreadPoolExecutor(workers)
        self.alive = self.most = self.submitted = 0

    def submit(self, function: Any, /, *arguments: Any) -> Future[Any]:
        counting = self

        class Counted:
            def __init__(self) -> None:
                counting.alive += 1
                counting.submitted += 1
                counting.most = max(counting.most, counting.alive)
                self.future = counting.pool.submit(function, *arguments)

            def result(self) -> Any:
                return self.future.result()

            def __del__(self) -> None:
                counting.alive -= 1

        return Counted()


@pytest.mark.parametrize(("workers", "asked", "most"), [(3, None, 6), (3, 4, 4), (1, None, 2)])
def test_work_in_flight_is_bounded_and_futures_are_released(workers: int, asked: int | None, most: int) -> None:
    executor = Counting(workers)
    with executor.pool:
        sampled(work(samples=40 * BLOCK), chosen(None, None, executor, asked), 1)
    assert executor.submitted == 40
    assert executor.most == most
    assert executor.alive == 0


@pytest.mark.slow
def test_a_broken_executor_that_was_handed_in_is_told_in_one_line() -> None:
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        with pytest.raises(InputError, match=r"the executor ProcessPoolExecutor failed: BrokenProcessPool: ") as told:
            sampled(work(packages=(Unsendable(),)), chosen(None, None, pool, None))
        assert "\n" not in str(told.value)
        with pytest.raises(InputError, match=r"failed: BrokenProcessPool: "):  # now it breaks when a task is handed in
            sampled(work(), chosen(None, None, pool, None))


# workers that are lost -----------------------------------------------------------------------------------------------


class Deadly:
    """Object that kills the process in which it is unpickled and deletes a permit, as long as there are permits."""

    def __init__(self, permits: Path) -> None:
        self.permits = permits

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        code = (
            "(lambda os, left: () if not left else (os.unlink(left[0]), os._exit(1)))"
            f"(__import__('os'), __import__('glob').glob({str(self.permits / '*')!r}))"
        )
        return eval, (code,)


@pytest.mark.slow
def test_a_task_does_not_survive_three_processes(tmp_path: Path) -> None:
    for k in range(3):
        (tmp_path / str(k)).touch()
    workers = Processes(1)
    try:
        with pytest.raises(InputError, match="worker processes died 3 times at blocks 0 to 1; check the free memory"):
            sampled(work(packages=Deadly(tmp_path)), workers)
    finally:
        workers.close(done=True)
    assert list(tmp_path.iterdir()) == []


# wrong input ---------------------------------------------------------------------------------------------------------


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"threads": 0}, "threads must be a whole number from 1 to 1024, got 0"),
    ({"threads": 2.0}, "threads must be a whole number"),
    ({"processes": True}, "processes must be a whole number"),
    ({"threads": 1, "processes": 1}, "threads and processes exclude each other"),
    ({"threads": 1, "executor": Muddled()}, "threads and executor exclude each other"),
    ({"tasks_under_way": 3}, "tasks_under_way is possible with an executor only"),
    ({"executor": Muddled(), "tasks_under_way": 0}, "tasks_under_way must be a whole number"),
    ({"executor": map}, r"an executor must have submit\(function, \*arguments\); type does not"),
    ({"resume": True}, "resume needs a journal to resume from"),
    ({"journal": "never-made", "keep_samples": True}, "a journal holds statistics only"),
]


def test_wrong_requests_are_refused() -> None:
    for asked, message in WRONG:
        with pytest.raises(InputError, match=message):
            pp.monte_carlo(MODEL, "paper", samples=10, **asked)


def test_wrong_numbers_of_samples_and_more_than_memory_are_refused() -> None:
    for samples in (0, -1, 1.5, "7", True, MOST_SAMPLES + 1, None):
        with pytest.raises(InputError, match="number of samples must be a whole number from 1 to 1e"):
            check_samples(samples)
    with pytest.raises(InputError, match=r"keeping 10,000,000,000 samples takes 480\.0 GB, .* are free"):
        pp.monte_carlo(MODEL, "paper", samples=10**10, keep_samples=True)


def test_free_memory_is_what_the_system_says(monkeypatch, tmp_path) -> None:
    from precision_pin.base import arguments

    (tmp_path / "meminfo").write_text("MemTotal: 9000 kB\nMemAvailable:    4800 kB\n")
    (tmp_path / "memory.max").write_text("max\n")
    (tmp_path / "memory.current").write_text("1000\n")
    (tmp_path / "own").write_text("0::/\n")
    for name, place in (("_MEMORY", tmp_path / "meminfo"), ("_GROUPS", tmp_path), ("_OWN_GROUPS", tmp_path / "own")):
        monkeypatch.setattr(arguments, name, place)
    monkeypatch.setattr(arguments, "_UNCHECKED", 0)
    assert arguments.available_memory() == 4800 * 1024
    arguments.check_kept(102_400)  # 48 bytes each: exactly that
    with pytest.raises(InputError, match=r"at most 102,400 can be kept"):
        arguments.check_kept(102_401)
    (tmp_path / "memory.max").write_text("49000\n")
    assert arguments.available_memory() == 48_000


def test_a_bar_is_shown_if_asked_for(monkeypatch) -> None:
    told: list[object] = []

    class Bar:
        def __enter__(self) -> object:
            return told.append

        def __exit__(self, *error: object) -> None:
            told.append("end")

    monkeypatch.setattr(progress_bar, "progress", lambda total: told.append(total) or Bar())
    pp.monte_carlo(MODEL, "paper", samples=100, progress=True)
    assert told == [100, 100, "end"]


POSES = MODEL.poses["paper"][:, None] + np.random.default_rng(3).uniform(-0.3, 0.3, (4, 70))
RUN = {"samples": 400, "seed": 4, "specifications": ["40 mm"]}


@pytest.fixture(scope="module")
def plain() -> str:
    return pp.sample_poses(MODEL, POSES, **RUN, threads=1).to_json()


@pytest.mark.slow
def test_many_poses_have_the_same_bits_on_an_executor_and_on_processes(plain: str) -> None:
    assert pp.sample_poses(MODEL, POSES, **RUN, processes=1).to_json() == plain
    few = {"samples": 400, "seed": 4}
    with ThreadPoolExecutor(3) as pool:
        assert pp.sample_poses(MODEL, POSES, **RUN, executor=pool).to_json() == plain
        found = pp.map_poses(MODEL, POSES[:, :5], **few, executor=pool)
    assert found.to_json() == pp.map_poses(MODEL, POSES[:, :5], **few, threads=1).to_json()


@pytest.mark.slow
def test_many_poses_that_were_stopped_go_on_with_the_same_bits(plain: str, tmp_path: Path, monkeypatch):
    file, told = tmp_path / "run.journal", []

    done = many_poses.PosesDone.with_part

    def stop_after_one(state, part):
        if state.count:
            raise KeyboardInterrupt
        return done(state, part)

    monkeypatch.setattr(many_poses.PosesDone, "with_part", stop_after_one)
    with pytest.raises(KeyboardInterrupt) as stopped:
        pp.sample_poses(MODEL, POSES, **RUN, journal=file)
    assert stopped.value.__notes__ == [f"the journal {file} holds the first 64 of 70 poses"]
    monkeypatch.undo()
    resumed = pp.sample_poses(MODEL, POSES, **RUN, journal=file, resume=True, tell=told.append)
    assert resumed.to_json() == plain
    assert told == [f"the journal {file} holds the first 64 poses"]
    with pytest.raises(InputError, match=r"belongs to another run: .*the list of poses has changed"):
        pp.sample_poses(MODEL, POSES[:, ::-1], **RUN, journal=file, resume=True)


@pytest.mark.slow
def test_a_journal_of_other_poses_is_refused(tmp_path: Path):
    file = tmp_path / "run.journal"
    pp.sample_poses(MODEL, POSES[:, :2], **RUN, journal=file)
    with pytest.raises(InputError, match=r"belongs to another run: .*the list of poses has changed"):
        pp.sample_poses(MODEL, POSES[:, [1, 0]], **RUN, journal=file, resume=True)
    with pytest.raises(InputError, match="already exists"):
        pp.sample_poses(MODEL, POSES[:, :2], **RUN, journal=file)
    with pytest.raises(InputError, match="resume needs a journal"):
        pp.sample_poses(MODEL, POSES[:, :2], **RUN, resume=True)


# processes -----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_killed_process_costs_no_result() -> None:
    workers, task = Processes(1), work(4, 24 * BLOCK)
    here = psutil.Process()
    killed: list[psutil.Process] = []

    def kill_once(_: int) -> None:
        if not killed:
            killed.extend(spawned(here))
            killed[0].kill()

    try:
        assert_same_bits(sampled(task, workers, 2, kill_once), in_one_go(task))
    finally:
        workers.close(done=True)
    assert len(killed) == 1
    assert spawned(here) == []


@pytest.fixture
def started(tmp_path: Path) -> Iterator[Any]:
    """Start ``precision-pin analyze`` in a folder of its own."""
    begun: list[subprocess.Popen[str]] = []

    def start(*arguments: str) -> subprocess.Popen[str]:
        words = [str(Path(sys.executable).parent / "precision-pin"), "analyze", *arguments]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        begun.append(subprocess.Popen(words, cwd=tmp_path, start_new_session=True, **pipes))
        return begun[-1]

    yield start
    for process in begun:
        process.kill()
        process.communicate()


def busy_children(process: subprocess.Popen[str]) -> list[psutil.Process]:
    """Wait until the process of a run samples; return all it has started, helpers too."""
    parent = psutil.Process(process.pid)

    def busy() -> bool:
        found = spawned(parent)
        return bool(found) and found[0].cpu_times().user > 0.7

    wait_until(busy, 60)
    return parent.children(recursive=True)


def ended(processes: list[psutil.Process]) -> bool:
    return psutil.wait_procs(processes, timeout=60)[1] == []


MUCH = ("--samples", "100000000000")


def told_of(journal: Path) -> str:
    """Return what is told of the journal of a run of so many samples."""

    def stop(line: str) -> None:
        raise KeyboardInterrupt(line)

    with pytest.raises(KeyboardInterrupt) as stopped:
        pp.monte_carlo(MODEL, samples=10**11, journal=journal, resume=True, tell=stop, files={"sheet": PAPER_SHEET})
    return str(stopped.value)


@pytest.mark.slow
def test_no_process_stays_when_the_parent_is_killed(started: Any, tmp_path: Path) -> None:
    process = started(*MUCH, "--processes", "1", "--journal", "run.journal")
    children = busy_children(process)
    process.kill()
    process.wait()
    assert ended(children)
    assert "holds the first" in told_of(tmp_path / "run.journal")


@pytest.mark.slow
def test_no_process_stays_after_ctrl_c(started: Any, tmp_path: Path) -> None:
    process = started(*MUCH, "--processes", "1", "--journal", "run.journal", "--json", "result.json")
    children = busy_children(process)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: the child gets it too
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
def test_no_process_stays_after_an_error() -> None:
    here = psutil.Process()

    def fail(_: int) -> None:
        assert spawned(here)
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        pp.monte_carlo(MODEL, "paper", processes=1, progress=fail, samples=3 * BLOCK)
    assert spawned(here) == []


# Ctrl-C --------------------------------------------------------------------------------------------------------------


def without_warnings(text: str) -> str:
    return "".join(line for line in text.splitlines(keepends=True) if " warning W_" not in line)


def held(err: str) -> int:
    return int(err.split("holds the first ")[1].split()[0].replace(",", ""))


@pytest.mark.slow
def test_ctrl_c_once_saves_and_says_how_to_go_on(started: Any, tmp_path: Path) -> None:
    samples = 250 * BLOCK + 1
    line = ("--samples", str(samples), "--seed", "3", "--spec", "45 mm @ 90 %", "--journal", "run.journal")
    process = started(*line, "--threads", "1", "--json", "result.json", "--out", "plots")
    wait_until(lambda: (tmp_path / "run.journal").exists(), 60)
    time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    begun = time.monotonic()
    _, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert time.monotonic() - begun < 5
    assert os.listdir(tmp_path) == ["run.journal"]
    done = held(err)
    assert 0 < done < samples
    assert done % BLOCK == 0
    settings = {"samples": samples, "seed": 3, "specifications": "45 mm @ 90 %", "files": {"sheet": PAPER_SHEET}}
    told: list[str] = []
    resumed = pp.monte_carlo(MODEL, journal=tmp_path / "run.journal", resume=True, tell=told.append, **settings)
    assert told[0].endswith(f"holds the first {done:,} samples")
    assert resumed.to_json() == pp.monte_carlo(MODEL, **settings).to_json()


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
    assert held(told_of(tmp_path / "run.journal")) > 0


# the command line ----------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_changed_input_and_wrong_options_are_told_in_a_line(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    for file in PAPER_SHEET.parent.glob("4dof.*"):
        (tmp_path / file.name).write_bytes(file.read_bytes())

    def told(*arguments: str, samples: str = "100", journal: tuple[str, ...] = ("--journal", "j")) -> str:
        line = ["analyze", "4dof.errors.yaml", "--quiet", "--samples", samples, *journal, *arguments]
        monkeypatch.setattr(sys, "argv", ["precision-pin", *line])
        with pytest.raises(SystemExit) as ended:
            main()
        error = without_warnings(capsys.readouterr().err)
        assert ended.value.code == (2 if error else 0)
        return error.removeprefix("precision-pin: error E_INPUT: the journal j ")

    assert told() == ""
    before = (tmp_path / "j").read_bytes()
    assert told() == "already exists; resume its run, or remove the file\n"
    assert told("--resume", "--seed", "8") == "belongs to another run: seed was '0', is '8'\n"
    assert "--threads and --dask exclude each other" in told("--threads", "2", "--dask", "tcp://127.0.0.1:1")
    assert "--resume needs the run's --journal FILE" in told("--resume", journal=())
    for name, remark, changed in (
        ("4dof.errors.yaml", "# a remark\n", "the sheet has changed"),
        ("4dof.urdf", "<!-- a remark -->\n", "the URDF has changed; the sheet has changed"),
    ):
        with (tmp_path / name).open("a", encoding="utf-8") as stream:
            stream.write(remark)
        assert told("--resume") == f"belongs to another run: {changed}\n"
    assert (tmp_path / "j").read_bytes() == before


class Cluster:
    """Scheduler on this machine, with the processes started for it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.processes: list[subprocess.Popen[bytes]] = []
        self.start("scheduler", "--port", "0", "--scheduler-file", "scheduler.json")
        file = folder / "scheduler.json"
        wait_until(lambda: file.exists() and file.read_text("utf-8").endswith("}"), 60)
        self.address = json.loads(file.read_text("utf-8"))["address"]

    def start(self, what: str, *arguments: str) -> psutil.Process:
        # nothing beyond this machine is listened to
        line = [sys.executable, "-m", "dask", what, *arguments, "--host", "127.0.0.1", "--no-dashboard"]
        with (self.folder / "log").open("ab") as log:
            self.processes.append(subprocess.Popen(line, cwd=self.folder, stdout=log, stderr=log))
        return psutil.Process(self.processes[-1].pid)

    def worker(self) -> psutil.Process:
        return self.start("worker", self.address, "--nthreads", "1", "--no-nanny")

    def stop(self) -> None:
        for process in self.processes:
            process.kill()
            process.wait()


@pytest.mark.slow
def test_a_cluster_gives_the_same_bits_and_costs_no_result_whoever_goes_away(
    tmp_path: Path, monkeypatch, capsys
) -> None:
    """First without workers, then with two of which one is killed, at last its scheduler."""
    cluster = Cluster(tmp_path)
    settings = {"samples": 120 * BLOCK + 5, "seed": 6, "specifications": [pp.specification("45 mm @ 90 %")]}
    expected = pp.monte_carlo(MODEL, "paper", **settings).to_json()
    calls: list[int] = []

    def kill_one(count: int) -> None:
        calls.append(count)
        if len(calls) == 2:
            pair[1].kill()

    def stop(count: int) -> None:
        calls.append(count)
        if len(calls) == 1:
            cluster.stop()

    try:
        with monkeypatch.context() as impatient:
            impatient.setattr(executors, "PATIENCE", 5)
            none = "has no workers; start some: dask worker tcp://"
            with pytest.raises(InputError, match=none), dask_cluster(cluster.address):
                pass
        pair = [cluster.worker() for _ in range(2)]
        with dask_cluster(cluster.address) as (executor, under_way):
            executor._client.wait_for_workers(2, timeout=60)
            assert under_way in (2, 4)  # how many had come by then
            poses = MODEL.configuration("paper")[:, None] + np.linspace(-0.3, 0.3, 70)
            at_poses = pp.sample_poses(MODEL, poses, samples=300, executor=executor, tasks_under_way=4)
            assert at_poses.to_json() == pp.sample_poses(MODEL, poses, samples=300, threads=1).to_json()
            how = {"executor": executor, "tasks_under_way": 4}
            assert pp.monte_carlo(MODEL, "paper", progress=kill_one, **how, **settings).to_json() == expected
            wait_until(lambda: len(executor._client.scheduler_info(n_workers=-1)["workers"]) == 1)
            wait_until(lambda: not executor._client.futures)  # nothing is left on the cluster
            far = pp.ErrorModel(MODEL.chain, pp.Space(), [pp.sources.Frame(frame="tool", rx=pp.Uniform(4.0))])
            with pytest.raises(InputError, match="an error turns a place by half a turn"):
                pp.monte_carlo(far, [0, 0, 1, 0], executor=executor, samples=10)
        words = ["analyze", "--dask", cluster.address, "--json", "-", "--quiet"]
        words += ["--samples", str(settings["samples"]), "--seed", "6", "--spec", "45 mm @ 90 %"]
        monkeypatch.setattr(sys, "argv", ["precision-pin", *words])
        with pytest.raises(SystemExit):
            main()
        printed, known = json.loads(capsys.readouterr().out), json.loads(expected)
        for key in ("position", "attitude", "covariance", "spec"):
            assert printed[key] == known[key], key
        calls.clear()
        settings = {"samples": 300 * BLOCK, "seed": 6, "journal": tmp_path / "run.journal"}
        gone = pytest.raises(InputError, match="the executor DaskCluster failed: ")
        with gone as told, dask_cluster(cluster.address) as (executor, _):
            pp.monte_carlo(MODEL, "paper", executor=executor, tasks_under_way=2, progress=stop, **settings)
        assert "\n" not in str(told.value)
    finally:
        cluster.stop()
    lines: list[str] = []
    resumed = pp.monte_carlo(MODEL, "paper", resume=True, tell=lines.append, **settings)
    assert int(lines[0].split()[-2].replace(",", "")) >= calls[0]
    assert resumed.to_json() == pp.monte_carlo(MODEL, "paper", samples=300 * BLOCK, seed=6).to_json()


class Lost:
    """Client that has lost its scheduler, with futures that never complete."""

    status = "connecting"

    def __init__(self, raised: Exception | None = None) -> None:
        self.future: Future[int] = Future()
        if raised is not None:
            self.future.set_exception(raised)

    def get_executor(self, *, pure: bool) -> Lost:
        assert not pure
        return self

    def submit(self, function, *arguments) -> Future[int]:
        return self.future


@pytest.mark.slow
def test_a_task_submitted_when_the_scheduler_is_already_lost_is_not_waited_for() -> None:
    task = executors.DaskCluster(Lost()).submit(abs, -1)
    with pytest.raises(ConnectionError, match="the scheduler is lost"):
        task.result()
    task.cancel()


def test_a_timeout_of_the_task_itself_is_passed_on() -> None:
    with pytest.raises(TimeoutError, match="its own"):
        executors.DaskCluster(Lost(TimeoutError("its own"))).submit(abs, -1).result()


def test_what_is_no_address_and_no_scheduler_is_one_line(monkeypatch) -> None:
    monkeypatch.setattr(executors, "PATIENCE", 0.5)
    with pytest.raises(InputError, match="address of the Dask scheduler is empty"), dask_cluster(" "):
        pass
    none = r"no Dask scheduler answers at 'tcp://127\.0\.0\.1:1' \(\w+\)$"
    with pytest.raises(InputError, match=none), dask_cluster("tcp://127.0.0.1:1"):
        pass
    tries = []

    def late(address: str, **settings: object) -> None:
        tries.append(address)
        raise AssertionError

    # a client whose thread starts late is made again; none is made of what is no address
    monkeypatch.setattr("distributed.Client", late)
    with pytest.raises(InputError, match=r"'tcp://127.0.0.1:1' \(AssertionError\)$"), dask_cluster("tcp://127.0.0.1:1"):
        pass
    assert tries == ["tcp://127.0.0.1:1"] * 2
    monkeypatch.setattr("distributed.Client", None)
    for address in ("foo", "tcp://host", "ftp://a:1", ":::"):
        none = rf"no Dask scheduler answers at '{address}' \(ValueError\)$"
        with pytest.raises(InputError, match=none), dask_cluster(address):
            pass


def test_without_dask_it_is_said_how_to_install_it(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    missing = r"Dask is not installed \(pip install 'precision-pin\[dask\]'\)"
    with pytest.raises(InputError, match=missing), dask_cluster("tcp://127.0.0.1:1"):
        pass
