"""Sampling a pose: tasks of blocks on threads, processes or a cluster, merged in block order, kept in a journal.

A block is a fixed run of units; its statistics depend on error model, seed and block number only, and blocks are added
in order. So a result has the same bits whatever computed the blocks, in whatever order, and however often the run was
stopped and went on.
"""

from precision_pin.run.blocks import MOST_SAMPLES, check_samples
from precision_pin.run.cluster import dask_cluster
from precision_pin.run.executors import Submitter, available_cores
from precision_pin.run.pose import Progress, check_progress, monte_carlo

__all__ = [
    "MOST_SAMPLES",
    "Progress",
    "Submitter",
    "available_cores",
    "check_progress",
    "check_samples",
    "dask_cluster",
    "monte_carlo",
]
