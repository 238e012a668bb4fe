"""Workers that compute blocks: threads of this process, child processes, a given executor, a Dask cluster."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any, Final, Protocol, Self, TypeVar

from precision_pin.base.arguments import check_whole
from precision_pin.base.errors import InputError, PrecisionPinError

Found = TypeVar("Found")
MOST_WORKERS: Final = 1024
MOST_LOSSES: Final = 3
"""Processes that may die during one task."""


class Submitter(Protocol):
    """Interface of an executor: :class:`concurrent.futures.Executor` and any class with its ``submit``."""

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Any:
        """Submit a call and return its future, which has ``result()``."""


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Workers:
    """Executor of tasks; leaving its context ends it, as :meth:`close` does.

    Attributes:
        most: Most submitted tasks: twice the number of workers, so that none waits.
        blocks_in_a_task: Most blocks in a task, large enough that submitting it costs little.
    """

    blocks_in_a_task: int = 64

    def __init__(self, executor: Any, most: int) -> None:
        self.most = most
        self._executor = executor

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        self.close(done=kind is None)

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Any:
        """Submit a call and return its future."""
        return self._executor.submit(function, *arguments)

    def is_done(self, future: Any) -> bool:
        """Return whether a task has ended; False if its future cannot tell."""
        done = getattr(future, "done", None)
        return bool(done()) if callable(done) else False

    def result(self, future: Any) -> Any:
        """Wait for a task and return its result."""
        return future.result()

    def close(self, *, done: bool) -> None:
        """End the workers after waiting for the running tasks; ``done`` states that there are none."""
        self._executor.shutdown(wait=True, cancel_futures=True)


class Threads(Workers):
    """Threads of this process; the sampler releases Python's global lock."""

    blocks_in_a_task = 16

    def __init__(self, threads: int) -> None:
        super().__init__(ThreadPoolExecutor(threads), 2 * threads)


class Processes(Workers):
    """Child processes, with a thread and a pipe for each.

    They end with this process, which closes their pipes. A process that dies early is replaced and its task repeated.
    (The pool of :mod:`concurrent.futures` shares one pipe and hangs if a process is killed while sending a result.)
    """

    def __init__(self, processes: int) -> None:
        super().__init__(ThreadPoolExecutor(processes), 2 * processes)
        self._idle: SimpleQueue[_Process | None] = SimpleQueue()
        for _ in range(processes):
            self._idle.put(None)
        self._running: set[_Process] = set()
        self._ending = False

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Future[Any]:
        """Submit a call of blocks, the first and their number, and return its future."""
        return super().submit(self._call, function, *arguments)

    def close(self, *, done: bool) -> None:
        """End the processes."""
        self._ending = True
        if not done:
            for process in list(self._running):
                process.kill()
        super().close(done=done)
        while self._running:
            self._running.pop().end()

    def _call(self, function: Callable[..., Any], first_block: int, blocks: int) -> Any:
        process = self._idle.get()
        try:
            for _ in range(MOST_LOSSES):
                if self._ending:
                    break
                if process is None:
                    process = _Process()
                    self._running.add(process)
                try:
                    answer = process.ask((function, first_block, blocks))
                except (EOFError, OSError):
                    self._running.discard(process)
                    process.kill()
                    process.end()
                    process = None
                    continue
                if isinstance(answer, Exception):
                    raise answer
                return answer
        finally:
            self._idle.put(process)
        raise InputError(
            f"worker processes died {MOST_LOSSES} times at blocks {first_block} to {first_block + blocks - 1}; check the free "
            "memory (a script that uses processes must start its work under: if __name__ == '__main__')"
        )


class _Process:
    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, other_end = context.Pipe()
        self._process = context.Process(target=_serve, args=(other_end,), daemon=True)
        # Ctrl-C and other signals of a terminal go to all its processes. The child inherits the signal mask of this
        # thread and must not receive them. The resource tracker is started first: its start would unblock them again.
        resource_tracker.ensure_running()
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM, signal.SIGHUP})
        self._process.start()
        other_end.close()  # so that only the child holds it, and it closes when the child ends

    def ask(self, task: tuple[Callable[..., Any], int, int]) -> Any:
        """Return the result of a task, or the exception it raised."""
        self._pipe.send(task)
        return self._pipe.recv()

    def kill(self) -> None:
        """Kill the process."""
        self._process.kill()

    def end(self) -> None:
        """End a process that is idle or killed."""
        self._pipe.close()
        self._process.join()


def _serve(pipe: Connection[Any, Any]) -> None:
    """Compute blocks until the other end of the pipe is closed."""
    with suppress(EOFError, OSError):
        while True:
            function, *arguments = pipe.recv()
            try:
                answer = function(*arguments)
            except Exception as error:  # noqa: BLE001 - raised again at the other end
                answer = error
            pipe.send(answer)


class ExecutorWorkers(Workers):
    """Executor given by the caller; it is not shut down."""

    def __init__(self, executor: Submitter, most: int) -> None:
        super().__init__(executor, most)
        self._under_way: set[Any] = set()

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Any:
        """Submit a call and return its future."""
        try:
            future = super().submit(function, *arguments)
        except Exception as error:
            raise self._make_error(error) from error
        self._under_way.add(future)
        return future

    def result(self, future: Any) -> Any:
        """Wait for a task and return its result."""
        try:
            return super().result(future)
        except PrecisionPinError:
            raise
        except Exception as error:
            raise self._make_error(error) from error
        finally:
            self._under_way.discard(future)

    def _make_error(self, error: Exception) -> InputError:
        reason = " ".join(str(error).split())
        return InputError(
            f"the executor {type(self._executor).__name__} failed: {type(error).__name__}"
            + f": {reason}" * bool(reason)
        )

    def close(self, *, done: bool) -> None:
        """Cancel the tasks that are no longer needed."""
        for future in self._under_way:
            if hasattr(future, "cancel"):
                future.cancel()


def chosen(
    threads: int | None, processes: int | None, executor: Submitter | None, tasks_under_way: int | None
) -> Workers:
    """Return the requested workers, by default threads on all cores."""
    options = [
        name
        for name, value in (("threads", threads), ("processes", processes), ("executor", executor))
        if value is not None
    ]
    if len(options) > 1:
        raise InputError(f"{' and '.join(options)} exclude each other; give one of threads, processes and executor")
    for name, number in (("threads", threads), ("processes", processes), ("tasks_under_way", tasks_under_way)):
        if number is not None:
            check_whole(name, number, 1, MOST_WORKERS)
    if tasks_under_way is not None and executor is None:
        raise InputError("tasks_under_way is possible with an executor only")
    if processes is not None:
        return Processes(processes)
    if executor is None:
        return Threads(threads or available_cores())
    if not callable(getattr(executor, "submit", None)):
        raise InputError(f"an executor must have submit(function, *arguments); {type(executor).__name__} does not")
    count = getattr(executor, "_max_workers", None)  # the name in the executors of Python, loky and mpi4py
    workers = count if isinstance(count, int) else available_cores()
    return ExecutorWorkers(executor, tasks_under_way or 2 * workers)


PATIENCE: Final = 10
"""Seconds to wait for the scheduler, and again for its first worker."""

_CHECK_INTERVAL: Final = 0.5
"""Seconds between checks that the scheduler is still connected."""


class _Task:
    """Submitted task. Waiting ends with an error if the scheduler is lost; Dask's own wait never would."""

    def __init__(self, future: Any, client: Any) -> None:
        self._future = future
        self._client = client

    def result(self) -> Any:
        """Return the task's value or raise its exception; raise ConnectionError if the scheduler is lost."""
        while True:
            done, _ = wait([self._future], timeout=_CHECK_INTERVAL)
            # the client cancels all tasks once it gives the scheduler up
            if self._client.status != "running" and (not done or self._future.cancelled()):
                raise ConnectionError("the scheduler is lost")
            if done:
                return self._future.result()

    def cancel(self) -> None:
        """Cancel the task."""
        self._future.cancel()


class DaskCluster:
    """Executor on a running Dask cluster."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._executor = client.get_executor(pure=False)

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> _Task:
        """Submit a function call and return its task."""
        return _Task(self._executor.submit(function, *arguments), self._client)


def _connect_client(connect: Callable[..., Any], address: str) -> Any:
    """Return a client, on the second try if distributed's thread does not start within its ten seconds under load."""
    try:
        return connect(address, timeout=PATIENCE, set_as_default=False)
    except AssertionError:
        return connect(address, timeout=PATIENCE, set_as_default=False)


class InOrder(Iterator[tuple[Any, Any]]):
    """Keys and results of tasks, in the order of the tasks; workers compute a few ahead.

    Args:
        tasks: Each a key, a function and its arguments.
    """

    def __init__(self, workers: Workers, tasks: Iterable[tuple[Any, ...]]) -> None:
        self._workers = workers
        self._tasks = iter(tasks)
        self._under_way: deque[tuple[Any, Any]] = deque()

    def begin_no_more(self) -> None:
        """End after the tasks under way."""
        self._tasks = iter(())

    def __next__(self) -> tuple[Any, Any]:
        workers, under_way = self._workers, self._under_way
        # a result that is there comes at once: with few robots, preparing tasks takes longer than sampling
        while len(under_way) < workers.most and not (under_way and workers.is_done(under_way[0][1])):
            task = next(self._tasks, None)
            if task is None:
                break
            under_way.append((task[0], workers.submit(*task[1:])))
        if not under_way:
            raise StopIteration
        key, future = under_way[0]
        result = workers.result(future)
        under_way.popleft()
        return key, result


def in_order(tasks: Iterable[Callable[[], Found]], threads: int) -> Generator[Found, None, None]:
    """Yield the results of tasks in order; threads run a few ahead."""
    # after a failure or an interrupt the running tasks are awaited; each takes a fraction of a second
    with Threads(threads) as workers:
        for _, result in InOrder(workers, ((None, task) for task in tasks)):
            yield result


@contextmanager
def dask_cluster(address: str) -> Iterator[tuple[DaskCluster, int]]:
    """Yield an executor on a running Dask cluster, and the number of tasks to keep under way.

    The workers need the same version of this package. Other workers take over the tasks of a lost one; Dask gives up on
    a task that has lost several workers.

    Args:
        address: Address of the scheduler, such as ``tcp://host:8786``.

    Raises:
        InputError: The package distributed is not installed, there is no scheduler at the address, or it has no
            workers.
    """
    if not address.strip():
        raise InputError("the address of the Dask scheduler is empty; give one such as tcp://host:8786")
    try:
        import distributed
        from distributed.comm.addressing import get_address_host_port
    except ImportError:
        raise InputError("Dask is not installed (pip install 'precision-pin[dask]')") from None
    # errors reach the user as exceptions; the log would repeat them with tracebacks
    for name in [name for name in logging.root.manager.loggerDict if name.partition(".")[0] == "distributed"]:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    client: Any = None
    try:
        # with an invalid address the client takes twenty seconds to close and prints a traceback
        get_address_host_port(address)
        client = _connect_client(distributed.Client, address)
        client.wait_for_workers(1, timeout=PATIENCE)
    except (OSError, ValueError, TypeError, TimeoutError, AssertionError) as error:
        if client is None:
            raise InputError(f"no Dask scheduler answers at {address!r} ({type(error).__name__})") from None
        client.close()
        raise InputError(f"the Dask scheduler at {address} has no workers; start some: dask worker {address}") from None
    with client:
        workers = client.scheduler_info(n_workers=-1)["workers"].values()
        cores = sum(worker["nthreads"] for worker in workers)
        yield DaskCluster(client), min(2 * cores, MOST_WORKERS)
