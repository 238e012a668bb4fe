"""Small run and helpers for the tests of sampling."""

import random
from concurrent.futures import Future
from dataclasses import fields
from typing import Any
from weakref import WeakSet

import numpy as np
import psutil

from precision_pin.kernel import sampler
from precision_pin.kernel.sampler import BLOCK
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sampling import workers as executors
from precision_pin.sampling.blocks import Work, packages
from precision_pin.sampling.one_pose import sample_blocks
from precision_pin.sampling.run import Run
from precision_pin.statistics import Plan, Specification, State, start
from support.waiting import eventually

SAMPLES = 17 * BLOCK + 1234
MODEL = ErrorModel.load(PAPER_SHEET)
AT = MODEL.at("paper")
PLAN = Plan.from_moments(AT.tangent[0], AT.covariance, (Specification("position.norm", 0.035, 0.9),))


def work(seed: int = 0, samples: int = SAMPLES, **changed: Any) -> Work:
    settings = {"layout": sampler.to_arrays(AT), "plan": PLAN, "model": "exact", "keep_errors": False}
    return Work(**{**settings, "seed": seed, "samples": samples, "packages": packages(), **changed})


def sampled(
    work: Work, workers: executors.Workers, blocks_in_a_task: int | None = None, progress: Any = lambda _: None
) -> State:
    run = Run(workers, progress, start(work.plan))
    sample_blocks(run, work, blocks_in_a_task)
    return run.state


def in_one_go(work: Work) -> State:
    """Return the state by the kernel's own loop over all blocks, without tasks."""
    return work.observe(0, -(-work.samples // BLOCK)).add_to(start(work.plan))


def assert_same_bits(first: State, second: State) -> None:
    for field in fields(State):
        a, b = getattr(first, field.name), getattr(second, field.name)
        assert np.asarray(a).tobytes() == np.asarray(b).tobytes(), field.name


class Muddled:
    """Executor that computes nothing until a result is requested, then all submitted calls in the wrong order."""

    def __init__(self, *, shuffle: random.Random | None = None) -> None:
        self.shuffle = shuffle
        self.tasks: list[tuple[Future[Any], Any, Any]] = []
        self.alive: WeakSet[Future[Any]] = WeakSet()
        self.most = 0
        self.order: list[int] = []

    def submit(self, function: Any, /, *arguments: Any) -> Future[Any]:
        future: Future[Any] = Lazy(self)
        self.tasks.append((future, function, arguments))
        self.alive.add(future)
        self.most = max(self.most, len(self.alive))
        return future

    def complete(self) -> None:
        waiting, self.tasks = self.tasks[::-1], []
        if self.shuffle is not None:
            self.shuffle.shuffle(waiting)
        for future, function, arguments in waiting:
            self.order.append(arguments[0])
            future.set_result(function(*arguments))


class Lazy(Future[Any]):
    def __init__(self, executor: Muddled) -> None:
        super().__init__()
        self.executor = executor

    def result(self, timeout: float | None = None) -> Any:
        if not self.done():
            self.executor.complete()
        return super().result(timeout)


def spawned(process: psutil.Process) -> list[psutil.Process]:
    """Return the worker processes of a process."""
    found = []
    for child in process.children(recursive=True):
        try:
            if any("spawn_main" in word for word in child.cmdline()):
                found.append(child)
        except psutil.NoSuchProcess:
            continue
    return found


def wait_until(condition: Any, seconds: float = 20.0) -> None:
    assert eventually(condition, seconds), "waited in vain"
