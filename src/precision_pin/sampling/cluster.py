"""Sampling on a Dask cluster."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from concurrent.futures import wait
from contextlib import contextmanager
from typing import Any, Final, final

from precision_pin.base.errors import InputError
from precision_pin.sampling.workers import MOST_WORKERS

PATIENCE: Final = 10
"""Seconds to wait for the scheduler, and again for its first worker."""

_CHECK_INTERVAL: Final = 0.5
"""Seconds between two checks that the scheduler is still connected."""


@final
class _Task:
    """Submitted task. Waiting for it ends with an error where the scheduler is lost; Dask's own wait never would."""

    def __init__(self, future: Any, client: Any) -> None:
        self._future = future
        self._client = client

    def result(self) -> Any:
        """Return the task's value or raise its exception; raise ConnectionError where the scheduler is lost."""
        while True:
            done, _ = wait([self._future], timeout=_CHECK_INTERVAL)
            if done:
                return self._future.result()
            if self._client.status != "running":
                raise ConnectionError("the scheduler is lost")

    def cancel(self) -> None:
        """Cancel the task."""
        self._future.cancel()


@final
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


@contextmanager
def dask_cluster(address: str) -> Iterator[tuple[DaskCluster, int]]:
    """Yield an executor on a running Dask cluster, and the number of tasks to keep under way.

    The workers need the same version of this package. Other workers take over the tasks of a lost one; Dask gives up on a
    task that has lost several workers.

    Parameters
    ----------
    address
        Address of the scheduler, such as ``tcp://host:8786``.

    Raises
    ------
    InputError
        The package distributed is not installed, there is no scheduler at the address, or it has no workers.
    """
    if not address.strip():
        raise InputError("the address of the Dask scheduler is empty; give one such as tcp://host:8786")
    try:
        import distributed
        from distributed.comm.addressing import get_address_host_port
    except ImportError:
        raise InputError("Dask is not installed (pip install 'precision-pin[dask]')") from None
    # errors reach the user as exceptions; the log would repeat them with tracebacks
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    client: Any = None
    try:
        # with an invalid address the client itself takes twenty seconds to close and prints a traceback
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
