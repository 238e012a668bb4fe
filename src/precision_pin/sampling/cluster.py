"""Sampling on a Dask cluster."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from concurrent.futures import wait
from contextlib import contextmanager
from typing import Any, Final, final

from precision_pin.errors import InputError
from precision_pin.sampling.workers import MOST_WORKERS

__all__ = ["DaskCluster", "dask_cluster"]

PATIENCE: Final = 10
"""Seconds to wait for the scheduler, and again for its first worker."""

_LOOK: Final = 0.5
"""Seconds after which it is looked whether the scheduler is still there."""


@final
class _Task:
    """Submitted tasks; one that the scheduler has lost would be waited for without end."""

    def __init__(self, future: Any, client: Any) -> None:
        self._future = future
        self._client = client

    def result(self) -> Any:
        """Return what the task returned, or raise what it raised; ConnectionError where the scheduler is lost."""
        while True:
            done, _ = wait([self._future], timeout=_LOOK)
            if done:
                return self._future.result()
            if self._client.status != "running":
                raise ConnectionError("the scheduler is lost")

    def cancel(self) -> None:
        """Call it off."""
        self._future.cancel()


@final
class DaskCluster:
    """An executor on a running cluster."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._executor = client.get_executor(pure=False)

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> _Task:
        """Return the task of calling a function."""
        return _Task(self._executor.submit(function, *arguments), self._client)


def _connected(connect: Callable[..., Any], address: str) -> Any:
    """Return a client; where distributed's own thread does not start in its ten seconds, under load, try once more."""
    try:
        return connect(address, timeout=PATIENCE, set_as_default=False)
    except AssertionError:
        return connect(address, timeout=PATIENCE, set_as_default=False)


@contextmanager
def dask_cluster(address: str) -> Iterator[tuple[DaskCluster, int]]:
    """Yield an executor on a running Dask cluster, and how many tasks it can be given at a time.

    The workers need the same version of this package. A worker that is lost is replaced by others; Dask gives up where a
    task lost several.

    Parameters
    ----------
    address
        Of the scheduler, such as ``tcp://host:8786``.

    Raises
    ------
    InputError
        The package distributed is not installed, there is no scheduler at the address, or it has no workers.
    """
    if not address.strip():
        raise InputError("the address of a Dask scheduler is empty; it reads such as tcp://host:8786")
    try:
        import distributed
        from distributed.comm.addressing import get_address_host_port
    except ImportError:
        raise InputError("Dask is not installed (pip install 'precision-pin[dask]')") from None
    # errors are reported by exceptions
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    client: Any = None
    try:
        # a client of no address fails too, but is then closed in vain for twenty seconds, and prints a traceback
        get_address_host_port(address)
        client = _connected(distributed.Client, address)
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
