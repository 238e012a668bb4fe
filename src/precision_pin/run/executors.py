"""Where blocks are computed: threads of this process, processes of its own, or any executor that is handed in."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, CancelledError, Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing.connection import wait
from typing import Any, Final, Protocol, final

from precision_pin.errors import InputError, PrecisionPinError
from precision_pin.kernel import Blocks
from precision_pin.run.blocks import Work

__all__ = ["Foreign", "Processes", "Submitter", "Threads", "Workers", "WorkersLostError", "available_cores", "chosen"]

MOST_WORKERS: Final = 1024


class Submitter(Protocol):
    """What can be given as an executor: :class:`concurrent.futures.Executor` and all that have its ``submit``."""

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Any:
        """Return a future, which has ``result()``."""


def available_cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class WorkersLostError(Exception):
    """Workers ended; what was under way has to be computed again."""


class Workers(ABC):
    """Where tasks run.

    Attributes
    ----------
    most
        How many tasks are under way at a time: twice as many as there are workers, so that none waits.
    blocks_in_a_task
        The most blocks of a task: enough of them that handing a task over costs little.
    """

    most: int
    blocks_in_a_task: int = 16

    @abstractmethod
    def submit(self, work: Work, first_block: int, blocks: int) -> Any:
        """Return the future of a task.

        Raises
        ------
        WorkersLostError
            Workers ended, see :meth:`renew`.
        """

    @abstractmethod
    def result(self, future: Any) -> Blocks:
        """Wait for a task.

        Raises
        ------
        WorkersLostError
            Workers ended before it was done, see :meth:`renew`.
        """

    @abstractmethod
    def renew(self) -> None:
        """Replace workers that ended."""

    @abstractmethod
    def close(self, *, done: bool) -> None:
        """End the workers; with ``done`` no task is under way."""


@final
class Threads(Workers):
    """Threads of this process; the sampler runs without Python's lock."""

    def __init__(self, threads: int) -> None:
        self.most = 2 * threads
        self._pool = ThreadPoolExecutor(max_workers=threads)

    def submit(self, work: Work, first_block: int, blocks: int) -> Future[Blocks]:
        """Return the future of a task."""
        return self._pool.submit(work.observe, first_block, blocks)

    def result(self, future: Future[Blocks]) -> Blocks:
        """Wait for a task."""
        return future.result()

    def renew(self) -> None:
        """Threads do not end by themselves."""

    def close(self, *, done: bool) -> None:
        """End the threads; waits for the tasks that have begun."""
        self._pool.shutdown(wait=True, cancel_futures=True)


@final
class Processes(Workers):
    """Processes of our own, started afresh; they end with this process, however it ends."""

    blocks_in_a_task = 64

    def __init__(self, processes: int) -> None:
        self.most = 2 * processes
        self._processes = processes
        self._pool = self._started()

    def _started(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(
            self._processes, mp_context=multiprocessing.get_context("spawn"), initializer=_end_with_parent
        )

    def submit(self, work: Work, first_block: int, blocks: int) -> Future[Blocks]:
        """Return the future of a task."""
        # processes start here; a Ctrl-C in the terminal is meant for this one, which tells them
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return self._pool.submit(work.observe, first_block, blocks)
        except BrokenExecutor:
            raise WorkersLostError from None
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def result(self, future: Future[Blocks]) -> Blocks:
        """Wait for a task."""
        try:
            return future.result()
        except (BrokenExecutor, CancelledError):
            raise WorkersLostError from None

    def renew(self) -> None:
        """Start new processes in place of all of them."""
        self.close(done=False)
        self._pool = self._started()

    def close(self, *, done: bool) -> None:
        """End the processes."""
        if not done:
            # a pool has no public way to stop what has begun
            for process in list((self._pool._processes or {}).values()):
                process.kill()
        self._pool.shutdown(wait=True, cancel_futures=True)


def _end_with_parent() -> None:
    """Begin to watch the parent, in a process of :class:`Processes`."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@final
class Foreign(Workers):
    """An executor that was handed in; it is left running."""

    blocks_in_a_task = 64

    def __init__(self, executor: Submitter, most: int) -> None:
        self.most = most
        self._executor = executor
        self._under_way: set[Any] = set()

    def submit(self, work: Work, first_block: int, blocks: int) -> Any:
        """Return the future of a task."""
        try:
            future = self._executor.submit(_observe, work, first_block, blocks)
        except Exception as error:
            raise self._failed(error) from error
        self._under_way.add(future)
        return future

    def result(self, future: Any) -> Blocks:
        """Wait for a task."""
        try:
            found: Blocks = future.result()
        except PrecisionPinError:
            raise
        except Exception as error:
            raise self._failed(error) from error
        finally:
            self._under_way.discard(future)
        return found

    def renew(self) -> None:
        """Whoever handed the executor in replaces its workers."""

    def _failed(self, error: Exception) -> InputError:
        reason = " ".join(str(error).split())
        return InputError(
            f"the executor {type(self._executor).__name__} failed: {type(error).__name__}"
            + f": {reason}" * bool(reason)
        )

    def close(self, *, done: bool) -> None:
        """Call off what is no longer needed."""
        for future in self._under_way:
            if hasattr(future, "cancel"):
                future.cancel()


def _observe(work: Work, first_block: int, blocks: int) -> Blocks:
    """Return what blocks give; a plain function, which every executor can send."""
    return work.observe(first_block, blocks)


def chosen(
    threads: int | None, processes: int | None, executor: Submitter | None, tasks_under_way: int | None
) -> Workers:
    """Return the workers that were asked for; threads on all cores if nothing was.

    Raises
    ------
    InputError
        A wrong number, or more than one kind of worker.
    """
    asked = [
        name
        for name, value in (("threads", threads), ("processes", processes), ("executor", executor))
        if value is not None
    ]
    if len(asked) > 1:
        raise InputError(f"{' and '.join(asked)} exclude each other; give one of threads, processes and executor")
    for name, number in (("threads", threads), ("processes", processes), ("tasks_under_way", tasks_under_way)):
        if number is not None and (
            isinstance(number, bool) or not isinstance(number, int) or not 1 <= number <= MOST_WORKERS
        ):
            raise InputError(f"{name} must be a whole number from 1 to {MOST_WORKERS}, got {number!r}")
    if tasks_under_way is not None and executor is None:
        raise InputError("tasks_under_way goes with an executor")
    if processes is not None:
        return Processes(processes)
    if executor is None:
        return Threads(threads or available_cores())
    if not callable(getattr(executor, "submit", None)):
        raise InputError(f"an executor has submit(function, *arguments), {type(executor).__name__} has not")
    known = getattr(executor, "_max_workers", None)  # as the executors of Python, loky and mpi4py call it
    workers = known if isinstance(known, int) else available_cores()
    return Foreign(executor, tasks_under_way or 2 * workers)
