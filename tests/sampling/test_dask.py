"""Sampling on a real Dask cluster with a scheduler and workers as separate processes."""

from __future__ import annotations

import builtins
import json
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path

import numpy as np
import psutil
import pytest

import precision_pin as pp
from precision_pin.base.errors import InputError
from precision_pin.kernel.sampler import BLOCK
from precision_pin.sampling import workers
from precision_pin.sampling.workers import dask_cluster
from sampling.cases import MODEL, wait_until


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


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    started = Cluster(tmp_path_factory.mktemp("dask"))
    yield started
    started.stop()


@pytest.mark.slow
def test_a_cluster_gives_the_same_bits_and_a_killed_worker_costs_no_result(scheduler: Cluster, tmp_path: Path) -> None:
    workers = [scheduler.worker() for _ in range(2)]
    settings = {"samples": 120 * BLOCK + 5, "seed": 6, "specifications": [pp.specification("45 mm @ 90 %")]}
    expected = pp.monte_carlo(MODEL, "paper", **settings).to_json()
    calls = []

    def kill_one(count: int) -> None:
        calls.append(count)
        if len(calls) == 2:
            workers[1].kill()

    with dask_cluster(scheduler.address) as (executor, under_way):
        executor._client.wait_for_workers(2, timeout=60)
        assert under_way in (2, 4)  # how many had come by then
        result = pp.monte_carlo(MODEL, "paper", executor=executor, tasks_under_way=4, **settings)
        assert result.to_json() == expected
        poses = MODEL.configuration("paper")[:, None] + np.linspace(-0.3, 0.3, 70)
        at_poses = pp.sample_poses(MODEL, poses, samples=300, executor=executor, tasks_under_way=4)
        assert at_poses.to_json() == pp.sample_poses(MODEL, poses, samples=300, threads=1).to_json()
        result = pp.monte_carlo(MODEL, "paper", executor=executor, tasks_under_way=4, progress=kill_one, **settings)
        assert result.to_json() == expected
        wait_until(lambda: len(executor._client.scheduler_info(n_workers=-1)["workers"]) == 1)
        assert not executor._client.futures  # nothing is left on the cluster
        far = pp.ErrorModel(MODEL.chain, pp.Space(), [pp.sources.Frame(frame="tool", rx=pp.Uniform(4.0))])
        with pytest.raises(InputError, match="an error turns a place by half a turn"):
            pp.monte_carlo(far, [0, 0, 1, 0], executor=executor, samples=10)
    command = [Path(sys.executable).parent / "precision-pin", "analyze", "--dask", scheduler.address]
    line = ["--samples", str(settings["samples"]), "--seed", "6", "--spec", "45 mm @ 90 %", "--json", "-"]
    done = subprocess.run(
        [*command, *line, "--journal", "run.journal"], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    printed, known = json.loads(done.stdout), json.loads(expected)
    for key in ("position", "attitude", "covariance", "spec"):
        assert printed[key] == known[key], key
    assert [text for text in done.stderr.splitlines() if " warning W_" not in text] == []


@pytest.mark.slow
def test_a_cluster_that_goes_away_is_told_and_the_journal_goes_on(scheduler: Cluster, tmp_path: Path) -> None:
    own_folder = tmp_path / "own"
    own_folder.mkdir()
    own = Cluster(own_folder)
    settings = {"samples": 300 * BLOCK, "seed": 6, "journal": tmp_path / "run.journal"}
    calls = []

    def stop(count: int) -> None:
        calls.append(count)
        if len(calls) == 1:
            own.stop()

    try:
        own.worker()
        with (
            pytest.raises(InputError, match="the executor DaskCluster failed: ") as told,
            dask_cluster(own.address) as (executor, _),
        ):
            pp.monte_carlo(MODEL, "paper", executor=executor, tasks_under_way=2, progress=stop, **settings)
        assert "\n" not in str(told.value)
    finally:
        own.stop()
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
    task = workers.DaskCluster(Lost()).submit(abs, -1)
    with pytest.raises(ConnectionError, match="the scheduler is lost"):
        task.result()
    task.cancel()


def test_a_timeout_of_the_task_itself_is_passed_on() -> None:
    with pytest.raises(TimeoutError, match="its own"):
        workers.DaskCluster(Lost(TimeoutError("its own"))).submit(abs, -1).result()


def test_no_address_is_one_line() -> None:
    with pytest.raises(InputError, match="address of the Dask scheduler is empty"), dask_cluster(" "):
        pass


@pytest.mark.fast(3)
@pytest.mark.parametrize("address", ["foo", "tcp://host", "ftp://a:1", "host:abc", "tcp://", ":::", "/tmp/x"])
def test_no_client_is_made_of_what_is_no_address(monkeypatch, address: str) -> None:
    monkeypatch.setattr("distributed.Client", None)
    with (
        pytest.raises(InputError, match=rf"no Dask scheduler answers at '{address}' \(ValueError\)$"),
        dask_cluster(address),
    ):
        pass


@pytest.mark.fast(1)
@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "127.0.0.1:1", "no address"])
def test_no_scheduler_is_one_line(monkeypatch, address: str) -> None:
    monkeypatch.setattr(workers, "PATIENCE", 0.5)
    with (
        pytest.raises(InputError, match=rf"no Dask scheduler answers at '{address}' \(\w+\)$"),
        dask_cluster(address),
    ):
        pass


@pytest.mark.slow
def test_a_cluster_without_workers_is_one_line(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(workers, "PATIENCE", 5)
    empty = Cluster(tmp_path)
    try:
        with (
            pytest.raises(InputError, match="has no workers; start some: dask worker tcp://"),
            dask_cluster(empty.address),
        ):
            pass
    finally:
        empty.stop()


def test_a_client_whose_thread_starts_late_is_made_again(monkeypatch) -> None:
    tries = []

    def late(address: str, **settings) -> None:
        tries.append(address)
        raise AssertionError

    monkeypatch.setattr("distributed.Client", late)
    with (
        pytest.raises(InputError, match=r"no Dask scheduler answers at 'tcp://127.0.0.1:1' \(AssertionError\)$"),
        dask_cluster("tcp://127.0.0.1:1"),
    ):
        pass
    assert len(tries) == 2


def test_without_dask_it_is_said_how_to_install_it(monkeypatch) -> None:
    real = builtins.__import__

    def without(name: str, *arguments):
        if name == "distributed":
            raise ImportError(name)
        return real(name, *arguments)

    monkeypatch.setattr(builtins, "__import__", without)
    with (
        pytest.raises(InputError, match=r"Dask is not installed \(pip install 'precision-pin\[dask\]'\)"),
        dask_cluster("tcp://127.0.0.1:1"),
    ):
        pass
