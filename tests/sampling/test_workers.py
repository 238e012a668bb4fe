"""Identical bits for all workers and any order of blocks; what is killed, lost or interrupted costs no result; a Dask cluster."""

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
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import ExitStack, nullcontext
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import psutil
import pytest

import precision_pin as pp
from precision_pin.base import arguments
from precision_pin.base import progress as progress_bar
from precision_pin.base.errors import InputError
from precision_pin.cli import main
from precision_pin.kernel import loops, sampler
from precision_pin.kernel.sampler import BLOCK
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sampling import many_poses
from precision_pin.sampling import workers as executors
from precision_pin.sampling.blocks import MOST_SAMPLES
from precision_pin.sampling.journal import digest
from precision_pin.sampling.workers import ExecutorWorkers, Processes, Threads, chosen, dask_cluster
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


class Deadly:
    """Work that kills the process in which it is unpickled and deletes a permit, as long as there are permits."""

    def __init__(self, permits: Path, count: int) -> None:
        self.permits = permits
        for k in range(count):
            (permits / str(k)).touch()

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        code = (
            "(lambda os, left: () if not left else (os.unlink(left[0]), os._exit(1)))"
            f"(__import__('os'), __import__('glob').glob({str(self.permits / '*')!r}))"
        )
        return eval, (code,)

    def observe(self, first_block: int, blocks: int) -> None:
        raise NotImplementedError


@pytest.fixture(scope="module")
def processes() -> Iterator[Processes]:
    workers = Processes(1)
    yield workers
    workers.close(done=True)
    assert spawned(psutil.Process()) == []


@pytest.mark.slow
def test_seeds_in_every_layout_and_an_error_of_a_sample_comes_as_it_is(processes: Processes) -> None:
    threads = Threads(3)
    for seed, sizes in ((0, (1, 16)), (1, (3, None))):
        task = work(seed)
        whole = in_one_go(task)
        assert whole.count == SAMPLES
        for size in sizes:
            for workers in (threads, processes, ExecutorWorkers(Muddled(shuffle=random.Random(seed)), 5)):
                assert_same_bits(sampled(task, workers, size), whole)
    backwards = Muddled()
    assert_same_bits(sampled(task, ExecutorWorkers(backwards, 6), 2), whole)
    assert backwards.order[:6] == [10, 8, 6, 4, 2, 0]  # the executor did as its name says
    other = r"a worker has numpy \S+, the run was started with 0\.0; install the same version"
    for workers in (threads, processes, ExecutorWorkers(Muddled(), 3)):
        with pytest.raises(InputError, match=other):
            sampled(work(packages=(("numpy", "0.0"),)), workers)
    threads.close(done=True)


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


@pytest.mark.parametrize(("workers", "asked", "most"), [(3, None, 6), (3, 4, 4), (1, None, 2)])
def test_work_in_flight_is_bounded_and_futures_are_released(workers: int, asked: int | None, most: int) -> None:
    executor = Muddled()
    executor._max_workers = workers
    sampled(work(samples=40 * BLOCK), chosen(None, None, executor, asked), 1)
    assert (len(executor.order), executor.most, len(executor.alive)) == (40, most, 0)


@pytest.mark.slow
def test_a_broken_executor_that_was_handed_in_is_told_in_one_line(tmp_path: Path) -> None:
    broken = pytest.raises(InputError, match=r"the executor ProcessPoolExecutor failed: BrokenProcessPool: .*$")
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        workers = chosen(None, None, pool, None)
        with broken:
            workers.result(workers.submit(Deadly(tmp_path, 1).observe, 0, 1))
        with broken:  # now it breaks when a task is handed in
            workers.submit(work().observe, 0, 1)


# workers that are lost -----------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_killed_process_costs_no_result_and_a_task_that_kills_three_is_given_up(
    processes: Processes, tmp_path: Path
) -> None:
    task, killed = work(4, 24 * BLOCK), []

    def kill_once(_: int) -> None:
        if not killed:
            killed.extend(spawned(psutil.Process()))
            killed[0].kill()

    assert_same_bits(sampled(task, processes, 2, kill_once), in_one_go(task))
    assert len(killed) == 1
    with pytest.raises(InputError, match="worker processes died 3 times at blocks 4 to 5; check the free memory"):
        processes.submit(Deadly(tmp_path, 3).observe, 4, 2).result()
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
    ({"samples": 10**10, "keep_samples": True}, r"keeping 10,000,000,000 samples takes 480\.0 GB, .* are free"),
    *(
        ({"samples": samples}, "number of samples must be a whole number from 1 to 1e")
        for samples in (0, -1, 1.5, "7", True, MOST_SAMPLES + 1, None)
    ),
]


def test_wrong_requests_are_refused() -> None:
    for asked, message in WRONG:
        with pytest.raises(InputError, match=message):
            pp.monte_carlo(MODEL, "paper", **{"samples": 10, **asked})


def test_as_many_errors_are_kept_as_fit_into_free_memory(monkeypatch) -> None:
    monkeypatch.setattr(arguments, "available_memory", lambda: 4800 * 1024)
    monkeypatch.setattr(arguments, "_UNCHECKED", 0)
    arguments.check_kept(102_400)  # 48 bytes each: exactly that
    with pytest.raises(InputError, match=r"at most 102,400 can be kept"):
        arguments.check_kept(102_401)


def test_a_bar_is_shown_if_asked_for(monkeypatch) -> None:
    told: list[object] = []
    monkeypatch.setattr(progress_bar, "progress", lambda total, **_: told.append(total) or nullcontext(told.append))
    pp.monte_carlo(MODEL, "paper", samples=100, progress=True)
    assert told == [100, 100]


@pytest.mark.slow
def test_many_poses_that_were_stopped_go_on_with_the_same_bits(tmp_path: Path, monkeypatch):
    poses = MODEL.poses["paper"][:, None] + np.random.default_rng(3).uniform(-0.3, 0.3, (4, 70))
    file, told = tmp_path / "run.journal", []
    done = many_poses.CompletedPoses.with_part

    def stop_after_one(state, part):
        if state.count:
            raise KeyboardInterrupt
        return done(state, part)

    def sample(poses=poses, **saving):
        return pp.sample_poses(MODEL, poses, samples=400, seed=4, specifications=["40 mm"], **saving)

    monkeypatch.setattr(many_poses.CompletedPoses, "with_part", stop_after_one)
    with pytest.raises(KeyboardInterrupt) as stopped:
        sample(journal=file)
    assert stopped.value.__notes__ == [f"the journal {file} holds the first 64 of 70 poses"]
    monkeypatch.undo()
    assert sample(journal=file, resume=True, tell=told.append).to_json() == sample(threads=1).to_json()
    assert told == [f"the journal {file} holds the first 64 poses"]
    for other, asked, message in (
        (poses[:, ::-1], {"journal": file, "resume": True}, r"belongs to another run: .*the list of poses has changed"),
        (poses, {"journal": file}, "already exists"),
        (poses, {"resume": True}, "resume needs a journal"),
    ):
        with pytest.raises(InputError, match=message):
            sample(other, **asked)


@pytest.mark.slow
def test_many_poses_keep_what_was_done_before_an_error_and_finish_what_is_under_way_after_ctrl_c(tmp_path: Path):
    """As at one pose: the second of two groups cannot be given to the executor, or is under way at the interrupt."""

    class Broken(Muddled):
        def submit(self, function, /, *arguments):
            if self.order:
                raise OSError("no more")
            return super().submit(function, *arguments)

    def stop(_: int) -> None:
        raise KeyboardInterrupt

    settings = {"poses": MODEL.poses["paper"][:, None] + np.linspace(-0.3, 0.3, 70), "samples": 200}
    whole = pp.sample_poses(MODEL, **settings).to_json()
    broken, interrupted = {"executor": Broken(), "tasks_under_way": 1}, {"executor": Muddled(), "progress": stop}
    for name, how, raised, held in (("a", broken, InputError, 64), ("b", interrupted, KeyboardInterrupt, 70)):
        told, file = [], tmp_path / name
        with pytest.raises(raised):
            pp.sample_poses(MODEL, journal=file, **how, **settings)
        again = pp.sample_poses(MODEL, journal=file, resume=True, tell=told.append, **settings)
        assert (again.to_json(), told) == (whole, [f"the journal {file} holds the first {held} poses"])


# processes -----------------------------------------------------------------------------------------------------------


@pytest.fixture
def started(tmp_path: Path) -> Iterator[Any]:
    """Start ``precision-pin analyze`` in a folder of its own, with a journal."""
    with ExitStack() as stack:

        def start(*arguments: str) -> subprocess.Popen[str]:
            program = str(Path(sys.executable).with_name("precision-pin"))
            words = [program, "analyze", "--journal", "run.journal", *arguments]
            process = subprocess.Popen(words, cwd=tmp_path, start_new_session=True, stdout=-1, stderr=-1, text=True)
            stack.enter_context(process)
            stack.callback(process.kill)
            return process

        yield start


def ended(processes: list[psutil.Process]) -> bool:
    return psutil.wait_procs(processes, timeout=60)[1] == []


@pytest.mark.slow
def test_no_process_stays_when_the_parent_is_killed() -> None:
    """One that waits for a task, and one that computes, whose result is larger than a pipe takes."""
    program = """
from precision_pin.sampling.workers import Processes
workers = Processes(2)
workers.submit(pow, 3, 3_000_000)
print(workers.submit(divmod, 17, 5).result(), flush=True)
input()"""
    with subprocess.Popen([sys.executable, "-c", program], stdin=-1, stdout=-1, text=True) as process:
        assert process.stdout.readline() == "(3, 2)\n"
        parent = psutil.Process(process.pid)
        children = parent.children(recursive=True)
        assert len(spawned(parent)) == 2
        process.kill()
    assert ended(children)


@pytest.mark.slow
def test_no_process_stays_after_an_error() -> None:
    here = psutil.Process()
    before = spawned(here)

    def fail(_: int) -> None:
        assert len(spawned(here)) == len(before) + 1
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        pp.monte_carlo(MODEL, "paper", processes=1, progress=fail, samples=3 * BLOCK)
    assert spawned(here) == before


# Ctrl-C --------------------------------------------------------------------------------------------------------------


def without_warnings(text: str) -> str:
    return "".join(line for line in text.splitlines(keepends=True) if " warning W_" not in line)


MUCH = 10**11


def told_of(journal: Path) -> str:
    """Return what is told of the journal of a run of so many samples."""

    def stop(line: str) -> None:
        raise KeyboardInterrupt(line)

    with pytest.raises(KeyboardInterrupt) as stopped:
        pp.monte_carlo(MODEL, samples=MUCH, journal=journal, resume=True, tell=stop, files={"sheet": PAPER_SHEET})
    return str(stopped.value)


@pytest.mark.slow
def test_ctrl_c_leaves_no_process_saves_and_says_how_to_go_on(started: Any, tmp_path: Path) -> None:
    process = started("--samples", str(MUCH), "--processes", "1", "--json", "result.json", "--out", "plots")
    parent = psutil.Process(process.pid)
    wait_until(lambda: any(child.cpu_times().user > 0.7 for child in spawned(parent)), 60)
    children = parent.children(recursive=True)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: the child gets it too
    out, err = process.communicate(timeout=30)
    assert (process.returncode, out) == (130, "")
    told = re.fullmatch(
        r"the journal run\.journal (holds the first ([\d,]+)) of 100,000,000,000 samples; the same command with --resume "
        r"goes on from there\ninterrupted\n",
        without_warnings(err),
    )
    assert told is not None, err
    done = int(told[2].replace(",", ""))
    assert (done > 0, done % BLOCK) == (True, 0)
    assert ended(children)
    assert os.listdir(tmp_path) == ["run.journal"]
    assert told_of(tmp_path / "run.journal").endswith(f"{told[1]} samples")


@pytest.mark.slow
def test_ctrl_c_twice_stops_at_once(started: Any, tmp_path: Path) -> None:
    journal = tmp_path / "run.journal"
    process = started("--samples", str(MUCH), "--threads", "1", "--json", "result.json")
    wait_until(lambda: journal.exists() and journal.stat().st_size > 20_000, 60)  # a first record is there
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
    assert re.search(r"holds the first [1-9][\d,]* samples", told_of(journal))


# the command line ----------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_changed_input_and_wrong_options_are_told_in_a_line(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    for file in PAPER_SHEET.parent.glob("4dof.*"):
        (tmp_path / file.name).write_bytes(file.read_bytes())

    def told(words: str = "--journal j") -> str:
        line = f"precision-pin analyze 4dof.errors.yaml --quiet --samples 100 {words}"
        monkeypatch.setattr(sys, "argv", line.split())
        with pytest.raises(SystemExit) as ended:
            main()
        error = without_warnings(capsys.readouterr().err)
        assert ended.value.code == (2 if error else 0)
        return error.removeprefix("precision-pin: error E_INPUT: the journal j ")

    assert told() == ""
    before = (tmp_path / "j").read_bytes()
    assert told() == "already exists; resume its run, or remove the file\n"
    assert told("--journal j --resume --seed 8") == "belongs to another run: seed was '0', is '8'\n"
    assert "--threads and --dask exclude each other" in told("--journal j --threads 2 --dask tcp://127.0.0.1:1")
    assert "--resume needs the run's --journal FILE" in told("--resume")
    for name, remark, changed in (
        ("4dof.errors.yaml", "# a remark\n", "the sheet has changed"),
        ("4dof.urdf", "<!-- a remark -->\n", "the URDF has changed; the sheet has changed"),
    ):
        with (tmp_path / name).open("a", encoding="utf-8") as stream:
            stream.write(remark)
        assert told("--journal j --resume") == f"belongs to another run: {changed}\n"
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

    def start(self, what: str, *arguments: str) -> subprocess.Popen[bytes]:
        # nothing beyond this machine is listened to
        line = [sys.executable, "-m", "dask", what, *arguments, "--host", "127.0.0.1", "--no-dashboard"]
        with (self.folder / "log").open("ab") as log:
            self.processes.append(subprocess.Popen(line, cwd=self.folder, stdout=log, stderr=log))
        return self.processes[-1]

    def stop(self) -> None:
        for process in self.processes:
            process.kill()
            process.wait()


@pytest.mark.slow
def test_a_cluster_gives_the_same_bits_and_costs_no_result_whoever_goes_away(
    tmp_path: Path, monkeypatch, capsys
) -> None:
    """First without workers, then with two of which one is killed, at last its scheduler."""
    from distributed import Client

    cluster, wait = Cluster(tmp_path), Client.wait_for_workers
    settings = {"samples": 40 * BLOCK + 5, "seed": 6, "specifications": [pp.specification("45 mm @ 90 %")]}
    expected = pp.monte_carlo(MODEL, "paper", **settings).to_json()
    calls: list[int] = []

    def kill_one(count: int) -> None:
        calls.append(count)
        if len(calls) == 2:
            pair[1].kill()

    try:
        with monkeypatch.context() as impatient:
            impatient.setattr(Client, "wait_for_workers", lambda self, n, timeout: wait(self, n, timeout=0.1))
            none = "has no workers; start some: dask worker tcp://"
            with pytest.raises(InputError, match=none), dask_cluster(cluster.address):
                pass
        pair = [cluster.start("worker", cluster.address, "--nthreads", "1", "--no-nanny") for _ in range(2)]
        with dask_cluster(cluster.address) as (executor, under_way):
            executor._client.wait_for_workers(2, timeout=60)
            assert under_way in (2, 4)  # how many had come by then
            how = {"executor": executor, "tasks_under_way": 4}
            poses = MODEL.configuration("paper")[:, None] + np.linspace(-0.3, 0.3, 70)
            at_poses, known = (pp.sample_poses(MODEL, poses, samples=300, **of) for of in (how, {"threads": 1}))
            assert at_poses.to_json() == known.to_json()
            assert pp.monte_carlo(MODEL, "paper", progress=kill_one, **how, **settings).to_json() == expected
            wait_until(lambda: len(executor._client.scheduler_info(n_workers=-1)["workers"]) == 1)
            wait_until(lambda: not executor._client.futures)  # nothing is left on the cluster
            far = pp.ErrorModel(MODEL.chain, pp.Space(), [pp.sources.Frame(frame="tool", rx=pp.Uniform(4.0))])
            with pytest.raises(InputError, match="an error rotates a frame by 180°"):
                pp.monte_carlo(far, [0, 0, 1, 0], executor=executor, samples=10)
        words = ["analyze", "--dask", cluster.address, "--json", "-", "--quiet"]
        words += ["--samples", str(settings["samples"]), "--seed", "6", "--spec", "45 mm @ 90 %"]
        monkeypatch.setattr(sys, "argv", ["precision-pin", *words])
        with pytest.raises(SystemExit):
            main()
        printed, known = json.loads(capsys.readouterr().out), json.loads(expected)
        for key in ("position", "attitude", "covariance", "spec"):
            assert printed[key] == known[key], key
        gone = pytest.raises(
            InputError, match=r"the executor DaskCluster failed: ConnectionError: the scheduler is lost$"
        )
        with gone, dask_cluster(cluster.address) as (executor, _):
            pp.monte_carlo(
                MODEL, "paper", executor=executor, tasks_under_way=2, progress=lambda _: cluster.stop(), **settings
            )
    finally:
        cluster.stop()


def test_a_timeout_of_the_task_itself_is_passed_on_and_a_lost_scheduler_not_waited_for(monkeypatch) -> None:
    monkeypatch.setattr(executors, "_CHECK_INTERVAL", 0.01)
    never, late = Future(), Future()
    late.set_exception(TimeoutError("its own"))
    for future, error, says in ((never, ConnectionError, "the scheduler is lost"), (late, TimeoutError, "its own")):
        pool = SimpleNamespace(submit=lambda *_, future=future: future)
        client = SimpleNamespace(status="connecting", get_executor=lambda *, pure, pool=pool: pure or pool)
        task = executors.DaskCluster(client).submit(abs, -1)
        with pytest.raises(error, match=says):
            task.result()
        task.cancel()
    assert never.cancelled()


def test_what_is_no_address_no_scheduler_and_no_dask_is_one_line(monkeypatch) -> None:
    def refused(address: str, says: str) -> None:
        with pytest.raises(InputError, match=says), dask_cluster(address):
            pass

    monkeypatch.setattr(executors, "PATIENCE", 0.2)
    refused(" ", "address of the Dask scheduler is empty")
    nobody = "tcp://127.0.0.1:1"
    refused(nobody, rf"no Dask scheduler answers at '{nobody}' \(\w+\)$")
    tries = []

    def late(address: str, **settings: object) -> None:
        tries.append(address)
        raise AssertionError

    # a client whose thread starts late is made again; none is made of what is no address
    monkeypatch.setattr("distributed.Client", late)
    refused(nobody, rf"'{nobody}' \(AssertionError\)$")
    assert tries == [nobody] * 2
    monkeypatch.setattr("distributed.Client", None)
    for address in ("foo", "tcp://host", "ftp://a:1", ":::"):
        refused(address, rf"no Dask scheduler answers at '{address}' \(ValueError\)$")
    monkeypatch.setitem(sys.modules, "distributed", None)
    refused(nobody, r"Dask is not installed \(pip install 'precision-pin\[dask\]'\)")
