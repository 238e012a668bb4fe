"""Statistics of the poses that a run has finished, as its journal keeps them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, final

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.sampling.checkpoint_codec import Codec

NAMES: Final = (
    "mean", "covariance", "norm_mean", "norm_std", "norm_max", "quantile", "quantile_interval", "quantile_resolution",
    "probability", "probability_interval",
)  # fmt: skip
"""Arrays of a group of poses, fields of :class:`precision_pin.sampling.poses_result.PosesResult`."""
_ALWAYS: Final = ("mean", "norm_mean", "norm_max", "probability", "probability_interval")
"""Those that any number of samples gives."""


@final
@dataclass(frozen=True, eq=False)
class PosesDone:
    """Arrays over all poses of a run, of which the first ones are filled.

    Attributes
    ----------
    count
        Number of poses that are finished.
    values
        The arrays of `NAMES`; the last axis is the pose.
    """

    count: int
    values: tuple[Array, ...]

    def arrays(self) -> dict[str, Array]:
        """Return the arrays by name."""
        return dict(zip(NAMES, self.values, strict=True))

    def with_part(self, part: Mapping[str, Array]) -> PosesDone:
        """Return the state with the next poses filled, in place."""
        end = self.count
        for name, array in self.arrays().items():
            end = self.count + part[name].shape[-1]
            array[..., self.count : end] = part[name]
        return replace(self, count=end)


def start_of_poses(part: Mapping[str, Array], poses: int) -> PosesDone:
    """Return the state before any of P poses, with the types and shapes of the part of a pose."""
    return PosesDone(0, tuple(np.zeros((*part[name].shape[:-1], poses), part[name].dtype) for name in NAMES))


def _check(state: PosesDone) -> None:
    """Check that samples could give this state.

    Raises
    ------
    ValueError
        More poses are finished than there are, or numbers of them are infinite, or not numbers where samples always give
        some.
    """
    if not 0 <= state.count <= state.values[0].shape[-1]:
        raise ValueError("its counts are inconsistent")
    for name, array in state.arrays().items():
        done = array[..., : state.count]
        # few samples leave the others without a number
        if np.isinf(done).any() or (name in _ALWAYS and np.isnan(done).any()):
            raise ValueError(f"its {name} is not finite")


POSES: Final = Codec[PosesDone](lambda state: state.count, _check, "poses")
