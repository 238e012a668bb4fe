"""Sampling on a real Dask cluster with a scheduler and workers as separate processes."""

from __future__ import annotations

import json
import subprocess
import sys
from concurrent.futures import Future
from pathlib import Path

import numpy as np
import psutil
import pytest

import precision_pin as pp
from precision_pin.base.errors import InputError
from precision_pin.cli import main
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


@pytest.mark.slow
def test_a_cluster_gives_the_same_bits_and_costs_no_result_whoever_goes_away(
    tmp_path: Path, monkeypatch, capsys
) -> None:
    """First without workers, then with two of which one is killed, at last its scheduler."""
    cluster = Cluster(tmp_path)
    settings = {"samples": 40 * BLOCK + 5, "seed": 6, "specifications": [pp.specification("45 mm @ 90 %")]}
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
            impatient.setattr(workers, "PATIENCE", 5)
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
            assert not executor._client.futures  # nothing is left on the cluster
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
        settings = {"samples": 60 * BLOCK, "seed": 6, "journal": tmp_path / "run.journal"}
        gone = pytest.raises(InputError, match="the executor DaskCluster failed: ")
        with gone as told, dask_cluster(cluster.address) as (executor, _):
            pp.monte_carlo(MODEL, "paper", executor=executor, tasks_under_way=2, progress=stop, **settings)
        assert "\n" not in str(told.value)
    finally:
        cluster.stop()
    lines: list[str] = []
    resumed = pp.monte_carlo(MODEL, "paper", resume=True, tell=lines.append, **settings)
    assert int(lines[0].split()[-2].replace(",", "")) >= calls[0]
    assert resumed.to_json() == pp.monte_carlo(MODEL, "paper", samples=60 * BLOCK, seed=6).to_json()


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


def test_what_is_no_address_and_no_scheduler_is_one_line(monkeypatch) -> None:
    monkeypatch.setattr(workers, "PATIENCE", 0.5)
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
