"""A group of poses that are sampled together, and their statistics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.kernel.loops import NORM_COLUMNS, SUMS
from precision_pin.kernel.many_poses import JoinedTables, NormBlocks, norm_edges, observe_norms
from precision_pin.sampling.blocks import Sent, check_packages, packages
from precision_pin.sampling.poses_result import LEVELS
from precision_pin.statistics import COMPONENTS, NORMS, Plan, Specification, clopper_pearson, quantile_ranks

Counts = NDArray[np.int64]
Model = Literal["exact", "linear"]

PILOTS: Final = (256, 1024)
"""Numbers of samples from which first the centres, then the spreads are planned: the first samples of the run."""


@final
@dataclass(frozen=True)
class PosesWork:
    """Settings of a run that are the same for all poses."""

    model: Model
    seed: int
    samples: int
    specifications: tuple[Specification, ...]


@final
@dataclass(frozen=True, eq=False)
class GroupWork(Sent):
    """Poses that are sampled together. Can be pickled."""

    tables: JoinedTables
    first_pose: int
    work: PosesWork
    plans: tuple[Plan, ...]
    packages: tuple[tuple[str, str], ...]

    def observe(self, first_block: int, blocks: int) -> NormBlocks:
        """Return the statistics of some blocks."""
        check_packages(self.packages)
        work = self.work
        return observe_norms(
            self.tables, self.plans, work.model, work.seed, first_block, blocks,
            samples=work.samples, first_pose=self.first_pose,
        )  # fmt: skip


@final
class PoseGroup:
    """Poses that are sampled together, and their accumulated statistics."""

    def __init__(self, tables: JoinedTables, first_pose: int, work: PosesWork, plans: Sequence[Plan]) -> None:
        self.poses = len(tables.layouts)
        self.count = 0
        self._plans = tuple(plans)
        self.work = GroupWork(tables, first_pose, work, self._plans, packages())
        self._sums = np.zeros((self.poses, SUMS))
        self._lowest, self._highest = np.full((self.poses, 2), np.inf), np.full((self.poses, 2), -np.inf)
        self._sketch = np.zeros((self.poses, 2, NORM_COLUMNS), dtype=np.uint32)
        self._inside = np.zeros((self.poses, len(work.specifications)), dtype=np.int64)

    @classmethod
    def with_plans(cls, tables: JoinedTables, first_pose: int, work: PosesWork) -> PoseGroup:
        """Return a group with centres and spreads planned from the first samples."""
        poses = len(tables.layouts)
        plans = [Plan(np.zeros(8), np.ones(8), work.specifications)] * poses
        for samples in PILOTS:
            pilot = cls(tables, first_pose, replace(work, samples=min(samples, work.samples)), plans)
            pilot.add(pilot.work.observe(0, 1))
            try:
                with np.errstate(over="raise", invalid="raise"):
                    mean, spread = pilot._moments()
            except FloatingPointError:
                raise InputError(
                    f"the errors at poses {first_pose} to {first_pose + poses - 1} are too large to compute with; "
                    "the tolerances or loads are far too large"
                ) from None
            plans = [Plan(mean[pose], spread[pose], work.specifications) for pose in range(poses)]
        return cls(tables, first_pose, work, plans)

    def add(self, found: NormBlocks) -> None:
        """Add blocks, in block order."""
        self.count += found.count
        for block in range(found.sums.shape[1]):
            self._sums += found.sums[:, block]
        self._lowest = np.minimum(self._lowest, found.lowest)
        self._highest = np.maximum(self._highest, found.highest)
        self._sketch += found.sketch
        self._inside += found.inside

    def to_arrays(self, confidence: float) -> dict[str, Array]:
        """Return the group's part of the result's arrays; the last axis is the pose."""
        mean, std = self._moments()
        covariance = np.full((6, 6, self.poses), np.nan)
        if self.count > 1:
            rows, columns = _UPPER
            sums = self._sums[:, COMPONENTS]
            upper = (self._sums[:, 8:29] - sums[:, rows] * sums[:, columns] / self.count) / (self.count - 1)
            covariance[rows, columns] = covariance[columns, rows] = upper.T
            diagonal = np.arange(6)
            covariance[diagonal, diagonal] = np.maximum(covariance[diagonal, diagonal], 0.0)
        cumulative = np.cumsum(self._sketch, axis=2, dtype=np.int64)
        quantiles = [self._quantile(cumulative, level, confidence) for level in LEVELS]
        inside = self._inside.T
        intervals = [[clopper_pearson(kept, self.count, confidence) for kept in row] for row in inside.tolist()]
        return {
            "mean": mean[:, COMPONENTS].T,
            "covariance": covariance,
            "norm_mean": mean[:, NORMS].T,
            "norm_std": (std if self.count > 1 else np.full_like(std, np.nan))[:, NORMS].T,
            "norm_max": self._highest.T,
            "quantile": np.stack([quantile for quantile, _, _ in quantiles]),
            "quantile_interval": np.stack([interval for _, interval, _ in quantiles]),
            "quantile_resolution": np.stack([resolution for _, _, resolution in quantiles]),
            "probability": inside / self.count,
            "probability_interval": np.moveaxis(np.reshape(intervals, (len(inside), self.poses, 2)), 2, 1),
        }

    def _moments(self) -> tuple[Array, Array]:
        """Return mean and standard deviation of the eight quantities, ``(P, 8)``; the deviation of one sample is zero."""
        centre = np.array([plan.centre for plan in self._plans])
        sums, squares = self._sums[:, :8], np.empty((self.poses, 8))
        squares[:, COMPONENTS] = self._sums[:, 8 + np.flatnonzero(_UPPER[0] == _UPPER[1])]
        squares[:, NORMS] = self._sums[:, 29:]
        variance = np.maximum(squares - sums * sums / self.count, 0.0) / max(self.count - 1, 1)
        return centre + sums / self.count, np.sqrt(variance)

    def _quantile(self, cumulative: Counts, level: float, confidence: float) -> tuple[Array, Array, Array]:
        """Return quantiles ``(2, P)``, their intervals ``(2, 2, P)`` and the widths of their bins.

        As in :meth:`precision_pin.statistics.Distribution.quantile`, the order statistics at rank 1 + (N - 1) p are
        interpolated linearly, each placed inside its bin by its rank in the bin.
        """
        ranks = quantile_ranks(self.count, level, confidence)
        if ranks is None:
            nothing = np.full((2, self.poses), np.nan)
            return nothing, np.full((2, 2, self.poses), np.nan), nothing
        position = (self.count - 1) * level
        below = min(int(position), self.count - 1)
        first, lower, upper = self._order_statistic(cumulative, below + 1)
        second, _, second_upper = self._order_statistic(cumulative, min(below + 2, self.count))
        # value - centre was rounded before binning: widen by one unit in the last place on each side
        _, low, _ = self._order_statistic(cumulative, ranks[0])
        _, _, high = self._order_statistic(cumulative, ranks[1])
        ends = (
            np.maximum(np.nextafter(low, -np.inf), self._lowest),
            np.minimum(np.nextafter(high, np.inf), self._highest),
        )
        quantile = first + (position - below) * (second - first)
        return quantile.T, np.stack([end.T for end in ends], axis=1), (np.maximum(upper, second_upper) - lower).T

    def _order_statistic(self, cumulative: Counts, rank: int) -> tuple[Array, Array, Array]:
        """Return estimates of the rank-th smallest norms (from 1), ``(P, 2)``, and the edges of their bins."""
        if rank in (1, self.count):
            seen = self._lowest if rank == 1 else self._highest
            return seen, seen, seen
        column = (cumulative < rank).sum(axis=2)[..., None]
        counts = np.take_along_axis(self._sketch, column, axis=2)[..., 0].astype(np.int64)
        before = np.take_along_axis(cumulative, column, axis=2)[..., 0] - counts
        centre, scale = (
            np.array([getattr(plan, name) for plan in self._plans])[:, NORMS] for name in ("centre", "scale")
        )
        lower = np.maximum(centre + _EDGES[column[..., 0]] * scale, self._lowest)
        upper = np.minimum(centre + _EDGES[column[..., 0] + 1] * scale, self._highest)
        return lower + (rank - before - 0.5) / counts * (upper - lower), lower, upper


_UPPER: Final = np.triu_indices(6)
_EDGES: Final = norm_edges()
