"""Compiling into numba's cache by other processes: several parts at once, with progress, and ended in an instant.

A process compiles one function at a time, and hears nothing meanwhile: neither Ctrl-C nor a clock. So the work is given
to processes of our own. They end with this one, however it ends: that closes their pipes. Where none can be started, or
one fails, nothing is lost: what is not in the cache afterwards is compiled by whoever needs it.
"""

from __future__ import annotations

import json
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
from typing import Any, Final, final

__all__ = ["Job", "compile_jobs", "serve", "shown_by"]

Report = Callable[[float], None]
"""Takes the share of the work that is done, 0 to 1."""

MOST_WORKERS: Final = 3
"""The longest part takes a third of all."""

PATIENCE: Final = 300.0
"""Seconds to wait for an answer."""

_TICK: Final = 0.1
_PROGRAM: Final = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from precision_pin.compile_ahead import serve; serve()"
)  # fmt: skip


@final
@dataclass(frozen=True)
class Job:
    """Something to compile: a function of a module, called with plain arguments, does so.

    Attributes
    ----------
    module, function, arguments
        What is called.
    weight
        About how long it takes, in units of any size.
    last
        Whether it needs all others to be done.
    """

    module: str
    function: str
    arguments: tuple[bool | float | str | None, ...]
    weight: float
    last: bool = False


@contextmanager
def shown_by(report: Callable[[], Any]) -> Iterator[None]:
    """Show what is compiled meanwhile: ``report`` makes a context manager that yields what takes the share done."""
    _shown.append(report)
    try:
        yield
    finally:
        _shown.remove(report)


_shown: Final[list[Callable[[], Any]]] = []
_served: Final[list[bool]] = []
"""Not empty in a process that others have asked: it starts none itself."""


def compile_jobs(jobs: Sequence[Job]) -> None:
    """Have jobs done by other processes, the longest first; return when they are, or cannot be."""
    if _served or not sys.executable or getattr(sys, "frozen", False):
        return
    if _shown:
        with _shown[-1]() as report:
            _compile(jobs, report)
    else:
        _compile(jobs, lambda share: None)


def _compile(jobs: Sequence[Job], report: Report) -> None:
    first = sorted((job for job in jobs if not job.last), key=lambda job: -job.weight)
    crew = _Crew(min(MOST_WORKERS, _cores(), max(len(first), 1)), sum(job.weight for job in jobs), report)
    try:
        crew.do(first)
        crew.do([job for job in jobs if job.last])
    except OSError:  # no process can be started, or what was started is none of ours
        return
    finally:
        crew.end()


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@final
class _Crew:
    """The processes, started one by one as there is work; each is asked and waited for by a thread."""

    def __init__(self, size: int, weight: float, report: Report) -> None:
        self._size, self._weight, self._report = size, weight, report
        self._workers: list[subprocess.Popen[str]] = []
        self._idle: list[subprocess.Popen[str]] = []
        self._answers: queue.SimpleQueue[tuple[subprocess.Popen[str], Job, bool]] = queue.SimpleQueue()
        self._done = self._told = 0.0
        self._began = self._heard = time.monotonic()

    def do(self, jobs: Sequence[Job]) -> None:
        """Do jobs; those that fail are left undone.

        Raises
        ------
        OSError
            No process can be started.
        TimeoutError
            None has answered for `PATIENCE`.
        """
        waiting, running = list(jobs), dict[subprocess.Popen[str], tuple[Job, float]]()
        while waiting or running:
            while waiting and (self._idle or len(self._workers) < self._size):
                worker = self._idle.pop() if self._idle else self._start()
                job = waiting.pop(0)
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
                return  # all have died

    def end(self) -> None:
        """End the processes."""
        for worker in self._workers:
            worker.kill()
        for worker in self._workers:
            worker.wait()
            for pipe in (worker.stdin, worker.stdout):
                if pipe is not None:
                    with suppress(OSError):
                        pipe.close()

    def _start(self) -> subprocess.Popen[str]:
        import numba  # takes half a second, which whoever only shows progress does not need

        environment = dict(os.environ)
        configuration: Any = numba.config
        if configuration.CACHE_DIR:
            environment["NUMBA_CACHE_DIR"] = configuration.CACHE_DIR
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
        """Report what is done, with the share of each running job that its time so far makes likely."""
        now = time.monotonic()
        # seconds for a unit of weight on one of the processes; at first that of a common machine
        pace = (now - self._began) * self._size / self._done if self._done else 1.0
        likely = sum(job.weight * min((now - begun) / (pace * job.weight), 0.95) for job, begun in running.values())
        self._told = min(max(self._told, (self._done + likely) / self._weight), 1.0)
        self._report(self._told)


# in the other processes ----------------------------------------------------------------------------------------------


def serve() -> None:
    """Do the jobs that come on standard input, a line for each, and answer each with a line; end when it closes."""
    with suppress(ValueError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a Ctrl-C is the first process's, which ends this one
    _served.append(True)
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(lines,), daemon=True).start()
    while True:
        module, function, *arguments = json.loads(lines.get())
        with suppress(Exception):  # what fails here fails again, and is told, where it is needed
            getattr(import_module(module), function)(*arguments)
        sys.stdout.write("done\n")
        sys.stdout.flush()


def _read(lines: queue.SimpleQueue[str]) -> None:
    for line in sys.stdin:
        lines.put(line)
    os._exit(0)  # whoever asked has gone: the compiler would not notice
