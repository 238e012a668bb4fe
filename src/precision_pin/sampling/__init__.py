"""Sampling at a pose: tasks of blocks on threads, processes or a cluster, merged in block order, saved in a journal.

A block is a fixed range of robot indices. Its statistics depend on error model, seed and block number only, and blocks
are added in order, so the result has the same bits for any workers, any order of completion and any stops and
resumptions. Names are imported on first use, so that displaying a result does not load the compiler.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from precision_pin.base.progress import Progress as Progress
    from precision_pin.sampling.blocks import check_samples as check_samples
    from precision_pin.sampling.one_pose import monte_carlo as monte_carlo
    from precision_pin.sampling.workers import available_cores as available_cores
    from precision_pin.sampling.workers import dask_cluster as dask_cluster

_HOMES: Final = {
    "Progress": "run",
    "monte_carlo": "one_pose",
    **dict.fromkeys(("available_cores", "dask_cluster"), "workers"),
    "check_samples": "blocks",
}
__all__ = [*_HOMES]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
