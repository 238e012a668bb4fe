"""Fill numba's cache in parallel worker processes, with progress; interruptible.

A process compiles one function at a time and reacts to neither Ctrl-C nor timers meanwhile. Workers compile instead;
their pipes close when this process ends, which ends them too. If a worker cannot start or fails, nothing is lost:
functions missing from the cache are compiled on first use.
"""

from __future__ import annotations

import atexit
import json
import math
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

Report = Callable[[float], None]
"""Function called with the fraction of the work done, 0 to 1."""

MOST_WORKERS: Final = 3
"""More workers gain nothing: the longest part takes a third of the total time."""

PATIENCE: Final = 300.0
"""Seconds to wait for a worker's answer; the longest part takes some seconds, on a busy machine up to a minute."""

_TICK: Final = 0.1
"""Seconds between updates of the display, within which Ctrl-C takes effect too."""
# a worker finds the package where this process does: it gets its search path
_PROGRAM: Final = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from precision_pin.base.compile_ahead import serve; serve()"
)  # fmt: skip


COMPILING: Final = "compiling the sampler for this kind of model, once on this machine"
COMPILING_NOTE: Final = f"{COMPILING}: some 8 s"
"""Labels of the progress bar, and of the line where there is no bar; the time is that of three idle cores. The exact and the
linear model, with common laws only or rare ones too, are four kinds."""


def _ignore(fraction: float) -> None:
    """Show nothing."""


@contextmanager
def silent() -> Iterator[Report]:
    """Show nothing about compiling."""
    yield _ignore


@contextmanager
def announced() -> Iterator[Report]:
    """Announce compiling on stderr: eight seconds of silence look like a crash."""
    with suppress(AttributeError, OSError, ValueError):  # stderr is closed, or there is none
        sys.stderr.write(f"precision-pin: {COMPILING_NOTE}\n")
        sys.stderr.flush()
    yield _ignore


@dataclass(frozen=True)
class Job:
    """A call that compiles something, of some approximate duration; ``last`` if all others must be done first."""

    module: str
    function: str
    arguments: tuple[bool | float | str | None, ...]
    weight: float
    last: bool = False


@contextmanager
def shown_by(report: Callable[[], Any]) -> Iterator[None]:
    """Show compilation progress with ``report()``, a context manager that yields a function of the fraction done."""
    _displays.append(report)
    try:
        yield
    finally:
        _displays.remove(report)


_displays: Final[list[Callable[[], Any]]] = []
"""Displays set by `shown_by`, the innermost last."""
_background: Final[list[_BackgroundCompilation]] = []
"""Compilation started but not yet awaited; at most one."""
_worker_flags: Final[list[bool]] = []
"""Not empty in a worker process, which starts no further workers."""


def begin_jobs(jobs: Sequence[Job]) -> None:
    """Start jobs in the background that `compile_jobs` may request later; return at once."""
    if not _background and _can_start():
        _background.append(_BackgroundCompilation(jobs))


def compile_jobs(jobs: Sequence[Job]) -> None:
    """Run jobs in worker processes, the longest first, announced on stderr or by `shown_by`; return when done."""
    if not _can_start():
        return
    with _displays[-1]() if _displays else announced() as report:
        _compile(jobs, report)


def _can_start() -> bool:
    return not _worker_flags and bool(sys.executable) and not getattr(sys, "frozen", False)


def _compile(jobs: Sequence[Job], report: Report) -> None:
    background = _background.pop() if _background else _BackgroundCompilation(())
    pool = background.pool
    pool.show(sum(job.weight for job in jobs), report)
    pool.waiting += [job for job in jobs if not job.last and job not in background.jobs]
    try:
        background.wait()
        pool.work()  # jobs added after the thread had finished
        pool.waiting += [job for job in jobs if job.last]
        pool.work()
    except OSError:  # no process can be started, or another program was started
        return
    finally:
        pool.end()


class _BackgroundCompilation:
    """Jobs started before they are needed, and their workers."""

    def __init__(self, jobs: Sequence[Job]) -> None:
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        self.jobs, self.pool = tuple(jobs), _WorkerPool(min(MOST_WORKERS, cores))
        self.pool.waiting += self.jobs
        self._thread = threading.Thread(target=self._do, daemon=True)
        self._error: OSError | None = None
        if jobs:
            atexit.register(self.pool.end)
            self._thread.start()

    def wait(self) -> None:
        """Wait until the jobs are done; interruptible."""
        while self.jobs and self._thread.is_alive():
            self._thread.join(_TICK)
        if self._error is not None:
            raise self._error

    def _do(self) -> None:
        try:
            self.pool.work()
        except OSError as error:
            self._error = error


class _WorkerPool:
    """Workers, started as jobs arrive, each with a waiting thread; ``waiting`` may grow at any time."""

    def __init__(self, size: int) -> None:
        self._size = size
        self.waiting: list[Job] = []
        self._weight = math.inf
        self._report: Report = _ignore
        self._workers: list[subprocess.Popen[str]] = []
        self._idle: list[subprocess.Popen[str]] = []
        self._answers: queue.SimpleQueue[tuple[subprocess.Popen[str], Job, bool]] = queue.SimpleQueue()
        self._done = self._told = 0.0
        self._began = time.monotonic()
        self._ended = False

    def show(self, weight: float, report: Report) -> None:
        """Report the fraction done of jobs of this total weight."""
        self._weight, self._report = weight, report

    def work(self) -> None:
        """Run the waiting jobs, the longest first; failed jobs are dropped."""
        self._heard = time.monotonic()
        running = dict[subprocess.Popen[str], tuple[Job, float]]()
        while (self.waiting or running) and not self._ended:
            while self.waiting and (self._idle or len(self._workers) < self._size):
                worker = self._idle.pop() if self._idle else self._start()
                job = max(self.waiting, key=lambda job: job.weight)
                self.waiting.remove(job)
                running[worker] = job, time.monotonic()
                threading.Thread(target=self._ask, args=(worker, job), daemon=True).start()
            try:
                worker, job, alive = self._answers.get(timeout=_TICK)
            except queue.Empty:
                if time.monotonic() - self._heard > PATIENCE:
                    raise TimeoutError from None
                self._tell(running)
                continue
            self._heard = time.monotonic()
            del running[worker]
            self._done += job.weight
            if alive:
                self._idle.append(worker)
            elif not running and not self._idle:
                return  # every worker has died

    def end(self) -> None:
        """Kill the workers."""
        self._ended = True
        for worker in self._workers:
            worker.kill()
        for worker in self._workers:
            worker.wait()
            for pipe in (worker.stdin, worker.stdout):
                if pipe is not None:
                    with suppress(OSError):
                        pipe.close()

    def _start(self) -> subprocess.Popen[str]:
        environment = dict(os.environ)
        numba: Any = sys.modules.get("numba")  # if not loaded yet, it has the configuration of the environment
        if numba is not None and numba.config.CACHE_DIR:
            environment["NUMBA_CACHE_DIR"] = numba.config.CACHE_DIR
        worker = subprocess.Popen(
            [sys.executable, "-c", _PROGRAM, json.dumps(sys.path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env=environment,
        )
        self._workers.append(worker)
        return worker

    def _ask(self, worker: subprocess.Popen[str], job: Job) -> None:
        assert worker.stdin is not None
        assert worker.stdout is not None
        alive = False
        with suppress(OSError, ValueError):
            worker.stdin.write(json.dumps([job.module, job.function, *job.arguments]) + "\n")
            worker.stdin.flush()
            alive = bool(worker.stdout.readline())
        self._answers.put((worker, job, alive))

    def _tell(self, running: dict[subprocess.Popen[str], tuple[Job, float]]) -> None:
        """Report the fraction done, estimating that of running jobs from their elapsed time."""
        now = time.monotonic()
        # seconds for a unit of weight on one of the processes; at first that of a common machine
        pace = (now - self._began) * self._size / self._done if self._done else 1.0
        partial = sum(job.weight * min((now - start) / (pace * job.weight), 0.95) for job, start in running.values())
        self._told = min(max(self._told, (self._done + partial) / self._weight), 1.0)
        self._report(self._told)


# in the worker processes ---------------------------------------------------------------------------------------------


def serve() -> None:
    """Run the jobs that arrive on standard input, one a line, and answer each with a line; end when it closes."""
    with suppress(ValueError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C and ends this process
    _worker_flags.append(True)
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(lines,), daemon=True).start()
    while True:
        module, function, *arguments = json.loads(lines.get())
        with suppress(Exception):  # a failing job fails again, and is reported, when the function is first called
            getattr(import_module(module), function)(*arguments)
        sys.stdout.write("done\n")
        sys.stdout.flush()


def _read(lines: queue.SimpleQueue[str]) -> None:
    for line in sys.stdin:
        lines.put(line)
    os._exit(0)  # the parent is gone; a running compiler would not notice
