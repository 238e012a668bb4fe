"""Identical bits for all kinds of workers and any order of the blocks."""

from __future__ import annotations

import os
import pickle
import random
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import fields, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.base import progress as progress_bar
from precision_pin.base.errors import InputError
from precision_pin.kernel import loops, sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.kernel.sampler import BLOCK
from precision_pin.sampling.blocks import MOST_SAMPLES, check_samples
from precision_pin.sampling.journal import digest
from precision_pin.sampling.workers import Foreign, Processes, Threads, chosen
from precision_pin.statistics import start
from sampling.cases import MODEL, PLAN, SAMPLES, Muddled, assert_same_bits, in_one_go, sampled, work


@pytest.fixture(scope="module")
def two_processes() -> Iterator[Processes]:
    workers = Processes(2)
    yield workers
    workers.close(done=True)


@pytest.mark.slow
def test_seeds_in_every_layout(two_processes: Processes) -> None:
    threads = {count: Threads(count) for count in (1, 2, 3, 8)}
    for seed in range(3):
        task = work(seed)
        whole = in_one_go(task)
        assert whole.count == SAMPLES
        for workers in (*threads.values(), two_processes):
            assert_same_bits(sampled(task, workers), whole)
        for size in (1, 3, 16):
            assert_same_bits(sampled(task, threads[3], size), whole)
            assert_same_bits(sampled(task, two_processes, size), whole)
            muddled = Muddled(shuffle=random.Random(seed))
            assert_same_bits(sampled(task, Foreign(muddled, 5), size), whole)
        backwards = Muddled()
        assert_same_bits(sampled(task, Foreign(backwards, 6), 2), whole)
        assert backwards.order[:6] == [10, 8, 6, 4, 2, 0]  # the executor did as its name says
    for workers in threads.values():
        workers.close(done=True)


@pytest.mark.fast(3)
@pytest.mark.parametrize("samples", [1, 2, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK, 17 * BLOCK + 5])
def test_runs_of_any_length(samples: int) -> None:
    task = work(7, samples)
    for most, size in ((1, None), (2, 1), (4, 5), (50, 100)):
        assert_same_bits(sampled(task, Foreign(Muddled(), most), size), in_one_go(task))


@pytest.mark.slow
def test_a_run_by_its_public_name_is_the_same_run() -> None:
    settings = {"samples": 3 * BLOCK + 9, "seed": 5, "specifications": PLAN.specifications}
    known = pp.monte_carlo(MODEL, "paper", threads=1, **settings)
    with ThreadPoolExecutor(3) as pool:
        others = [
            pp.monte_carlo(MODEL, "paper", **settings),
            pp.monte_carlo(MODEL, "paper", executor=pool, **settings),
            pp.monte_carlo(MODEL, "paper", executor=Muddled(), tasks_under_way=3, **settings),
        ]
    for other in others:
        assert other.to_json() == known.to_json()
        assert other.covariance.tobytes() == known.covariance.tobytes()
    assert known.summary.samples == in_one_go(work(5, 3 * BLOCK + 9)).count


@pytest.mark.slow
def test_kept_errors_do_not_depend_on_the_layout() -> None:
    settings = {"samples": 4 * BLOCK + 9, "seed": 5, "keep_samples": True}
    known = sampler.errors(work().layout, "exact", 5, 0, 4 * BLOCK + 9)
    for how in ({"threads": 2}, {"executor": Muddled(shuffle=random.Random(1)), "tasks_under_way": 4}):
        np.testing.assert_array_equal(pp.monte_carlo(MODEL, "paper", **how, **settings).errors, known)


# what is sent --------------------------------------------------------------------------------------------------------


def same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other) and one.flags.writeable == other.flags.writeable
    if isinstance(one, tuple):
        return type(one) is type(other) and all(map(same, one, other))
    return bool(one == other)


def test_work_can_be_sent_and_is_not_compiled_anew_where_it_arrives() -> None:
    task = work(3, 2 * BLOCK)
    in_one_go(task)
    before = len(loops.run.signatures)
    sent = pickle.loads(pickle.dumps(task))
    for field in fields(SamplerArrays):
        assert same(getattr(task.layout, field.name), getattr(sent.layout, field.name)), field.name
    assert same(task.plan.centre, sent.plan.centre)
    assert same(task.plan.scale, sent.plan.scale)
    assert sent.plan.specifications == task.plan.specifications
    assert_same_bits(in_one_go(sent), in_one_go(task))
    # a read-only array that came back writable would have been another type, seven seconds of compiling
    assert len(loops.run.signatures) == before


def test_table_and_plan_pickle_by_themselves() -> None:
    task = work()
    layout, plan = pickle.loads(pickle.dumps((task.layout, task.plan)))
    assert digest(layout) == digest(task.layout) != digest(replace(layout, largest_angle=1.0))
    assert_same_bits(in_one_go(work(samples=100, plan=plan)), in_one_go(work(samples=100)))


def test_blocks_can_be_sent_back() -> None:
    found = work(3, BLOCK + 5).observe(0, 2)
    back = pickle.loads(pickle.dumps(found))
    assert_same_bits(back.add_to(start(PLAN)), found.add_to(start(PLAN)))


def test_other_versions_on_a_worker_are_refused() -> None:
    with pytest.raises(
        InputError, match=r"a worker has numpy \S+, the run was started with 0\.0; install the same version"
    ):
        work(packages=(("numpy", "0.0"),)).observe(0, 1)


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


# workers that are lost -----------------------------------------------------------------------------------------------


class Unsendable:
    """Object that kills the process in which it is unpickled."""

    def __reduce__(self) -> tuple[Any, tuple[int]]:
        return os._exit, (1,)


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
@pytest.mark.parametrize(("losses", "given_up"), [(2, False), (3, True)])
def test_a_task_survives_two_processes(tmp_path: Path, losses: int, given_up: bool) -> None:
    for k in range(losses):
        (tmp_path / str(k)).touch()
    workers = Processes(1)
    try:
        task = work(packages=Deadly(tmp_path))
        if given_up:
            with pytest.raises(
                InputError, match="worker processes died 3 times at blocks 0 to 1; check the free memory"
            ):
                sampled(task, workers)
        else:
            assert_same_bits(sampled(task, workers), in_one_go(work()))
    finally:
        workers.close(done=True)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_broken_executor_that_was_handed_in_is_told_in_one_line() -> None:
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        with pytest.raises(InputError, match=r"the executor ProcessPoolExecutor failed: BrokenProcessPool: ") as told:
            sampled(work(packages=(Unsendable(),)), chosen(None, None, pool, None))
        assert "\n" not in str(told.value)
        with pytest.raises(InputError, match=r"failed: BrokenProcessPool: "):  # now it breaks when a task is handed in
            sampled(work(), chosen(None, None, pool, None))


@pytest.mark.slow
def test_an_error_of_a_sample_comes_as_it_is_from_every_kind_of_worker(two_processes: Processes) -> None:
    for workers in (Threads(2), two_processes, Foreign(Muddled(), 3)):
        with pytest.raises(InputError, match="a worker has numpy"):
            sampled(work(packages=(("numpy", "0.0"),)), workers)
    assert_same_bits(sampled(work(), two_processes), in_one_go(work()))


# wrong input ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"threads": 0}, "threads must be a whole number from 1 to 1024, got 0"),
        ({"threads": 2.0}, "threads must be a whole number"),
        ({"processes": -1}, "processes must be a whole number"),
        ({"processes": True}, "processes must be a whole number"),
        ({"threads": 1, "processes": 1}, "threads and processes exclude each other"),
        ({"threads": 1, "executor": Muddled()}, "threads and executor exclude each other"),
        ({"tasks_under_way": 3}, "tasks_under_way is possible with an executor only"),
        ({"executor": Muddled(), "tasks_under_way": 0}, "tasks_under_way must be a whole number"),
        ({"executor": map}, r"an executor must have submit\(function, \*arguments\); type does not"),
        ({"resume": True}, "resume needs a journal to resume from"),
        ({"journal": "never-made", "keep_samples": True}, "a journal holds statistics only"),
    ],
)
def test_wrong_requests_are_refused(asked: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        pp.monte_carlo(MODEL, "paper", samples=10, **asked)


@pytest.mark.parametrize("samples", [0, -1, 1.5, "7", True, MOST_SAMPLES + 1, None])
def test_wrong_numbers_of_samples_are_refused(samples: Any) -> None:
    with pytest.raises(InputError, match="number of samples must be a whole number from 1 to 1e"):
        check_samples(samples)


@pytest.mark.parametrize("samples", [10**10, MOST_SAMPLES])
def test_more_samples_than_memory_are_not_kept(samples: int) -> None:
    with pytest.raises(
        InputError, match=rf"keeping {samples:,} samples takes {48 * samples / 1e9:,.1f} GB, .* are free"
    ):
        pp.monte_carlo(MODEL, "paper", samples=samples, keep_samples=True)


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
