"""Sampling on a Dask cluster."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

from precision_pin.errors import InputError
from precision_pin.run.executors import MOST_WORKERS, Submitter

__all__ = ["dask_cluster"]

PATIENCE: Final = 10
"""Seconds to wait for the scheduler, and again for its first worker."""


@contextmanager
def dask_cluster(address: str) -> Iterator[tuple[Submitter, int]]:
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
    except ImportError:
        raise InputError("Dask is not installed (pip install 'precision-pin[dask]')") from None
    # what goes wrong is told by exceptions
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    client: Any = None
    try:
        client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)  # type: ignore[no-untyped-call]
        client.wait_for_workers(1, timeout=PATIENCE)
    except (OSError, ValueError, TypeError, TimeoutError) as error:
        if client is None:
            raise InputError(f"no Dask scheduler answers at {address!r} ({type(error).__name__})") from None
        client.close()
        raise InputError(f"the Dask scheduler at {address} has no workers; start some: dask worker {address}") from None
    with client:
        workers = client.scheduler_info(n_workers=-1)["workers"].values()
        cores = sum(worker["nthreads"] for worker in workers)
        yield client.get_executor(pure=False), min(2 * cores, MOST_WORKERS)
