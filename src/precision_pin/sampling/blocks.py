"""The work of a run and its histograms' centres and bins, in a form that can be sent to another process or machine."""

from __future__ import annotations

import io
import math
import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arguments import check_flag, check_kept, check_whole
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.base.versions import versions
from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import Law
from precision_pin.kernel import sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.kernel.sampler import Blocks
from precision_pin.model.pose_model import PoseModel
from precision_pin.statistics import COMPONENTS, NORMS, Plan, Specification, quantity_values

MOST_SAMPLES: Final = 10**12


def check_samples(samples: int, *, keep_samples: bool = False) -> None:
    """Raise unless the number of samples is a whole number from 1 to 10¹², and fits into memory if they are kept."""
    check_whole("the number of samples", samples, 1, MOST_SAMPLES, f"from 1 to {MOST_SAMPLES:.0e}")
    if check_flag("keep_samples", keep_samples):
        check_kept(samples)


def packages() -> tuple[tuple[str, str], ...]:
    """Return name and version of the packages that determine the bits of a block."""
    version_of = versions()
    return tuple((name, version_of[name]) for name in ("precision-pin", "numpy", "numba"))


def check_packages(started_with: Sequence[tuple[str, str]]) -> None:
    """Raise unless this process has the package versions of the process that started the run."""
    installed = dict(packages())
    for name, version in started_with:
        if installed[name] != version:
            raise InputError(
                f"a worker has {name} {installed[name]}, the run was started with {version}; install the same version"
            )


class PicklableReadOnly:
    """Data class whose read-only arrays stay read-only when pickled."""

    def __reduce__(self) -> tuple[Callable[[bytes], Any], tuple[bytes]]:
        buffer = io.BytesIO()
        _Pickler(buffer, protocol=5).dump((type(self), tuple(vars(self).values())))
        return _unpickle, (buffer.getvalue(),)


def _unpickle(data: bytes) -> Any:
    kind, values = pickle.loads(data)
    return kind(*values)


@dataclass(frozen=True, eq=False)
class Work(PicklableReadOnly):
    """All inputs of a block's statistics except the block number. Can be pickled.

    Attributes:
        model: ``"exact"`` or ``"linear"``.
        samples: Samples of the whole run, at which its last block ends.
        packages: Versions in the process that started the run; other versions in a worker are an error.
    """

    layout: SamplerArrays
    plan: Plan
    model: Literal["exact", "linear"]
    seed: int
    samples: int
    keep_errors: bool = False
    packages: tuple[tuple[str, str], ...] = field(default_factory=packages)

    def observe(self, first_block: int, blocks: int) -> Blocks:
        """Return the statistics of blocks ``first_block … first_block + blocks - 1``."""
        check_packages(self.packages)
        return sampler.observe_blocks(
            self.layout, self.plan, self.model, self.seed, first_block, blocks,
            samples=self.samples, keep_errors=self.keep_errors,
        )  # fmt: skip


class _Pickler(pickle.Pickler):
    """Pickler that keeps arrays read-only: numba compiles separately for writeable ones."""

    def reducer_override(self, value: Any) -> Any:
        """Return the reconstruction of a read-only array; the default for all other objects."""
        if type(value) is np.ndarray and not value.flags.writeable:
            return _make_read_only, (np.array(value),)
        return NotImplemented


def _make_read_only(array: NDArray[Any]) -> NDArray[Any]:
    array.flags.writeable = False
    return array


PILOT: Final = 512
"""Samples for planning: the first of the seed, even in a shorter run."""

_FARTHEST: Final = 1e100
"""Largest error planned for, m or rad."""


def planned(
    at: PoseModel,
    layout: SamplerArrays,
    model: Literal["exact", "linear"],
    seed: int,
    specifications: tuple[Specification, ...] = (),
) -> Plan:
    """Return the plan of a run at a pose, from a pilot."""
    slopes = at.tangent[1]
    skewness = first_order_skewness(at.space.draws, slopes)
    pilot = partial(sampler.errors, layout, model, seed, 0, PILOT)
    moments = at.error_at_means, at.covariance
    plan = plan_by_pilot(pilot, moments, reach(at, layout, slopes), skewness, specifications)
    return replace(plan, tool_axes=at.posture.tool_axes)


def plan_by_pilot(
    pilot: Callable[[], Array],
    moments: tuple[Array, Array],
    farthest: Array,
    skewness: Array,
    specifications: tuple[Specification, ...],
) -> Plan:
    """Return the plan for the errors ``(6, N)`` of a pilot, or if it fails for first-order mean and covariance."""
    try:
        plan = Plan.from_pilot(quantity_values(pilot()), farthest, specifications)
    except InputError:
        # the run itself reports the invalid sample, if it gets that far
        plan = Plan.from_moments(*moments, specifications)
    return replace(plan, skewness=skewness)


def reach(at: PoseModel, layout: SamplerArrays, slopes: Array) -> Array:
    """Return the approximate largest deviation of each component ``(6,)`` for slopes ``(6, d)`` of the error."""
    with np.errstate(over="ignore", invalid="ignore"):
        farthest = np.maximum(layout.highest - at.space.mean, at.space.mean - layout.lowest)
        largest = (np.abs(slopes) * np.minimum(farthest, _FARTHEST)).sum(axis=1)
    return np.minimum(np.nan_to_num(largest), _FARTHEST)


_NO_SLOPE = 1e-3
"""Fraction of its vector's first-order spread below which higher orders dominate a component."""
_NORMAL_SQUARE = math.sqrt(8)
"""Skewness of the square of a normal variable."""


def first_order_skewness(draws: Sequence[Draw], slopes: Array) -> Array:
    """Return the skewness of the eight quantities and of their squared deviations, ``(8, 2)``.

    Args:
        draws: The draws, independent of each other.
        slopes: ``(6, d)`` slopes of the error's components.

    For a norm, and for a component without first-order slopes, it is that of the sum of squares of its vector's
    components, minus the skewness of a normal variable's square.
    """
    result = np.zeros((8, 2))
    skewed = [_cumulants(draw.law) for draw in draws]
    if all(cumulants is None for cumulants in skewed):
        # only normal-like laws: components are not skewed, and squares are as skewed as those of normal variables
        result[:, 1] = _NORMAL_SQUARE
        result[list(COMPONENTS), 1] *= (slopes != 0).any(axis=1)
        return result
    padded = [
        np.pad([np.diagonal(draw.law.covariance)], ((0, 3), (0, 0))) if row is None else row
        for draw, row in zip(draws, skewed, strict=True)
    ]
    cumulants = np.concatenate([np.zeros((4, 0)), *padded], axis=1)
    second, third, fourth, sixth = (
        (slopes**power * cumulant).sum(axis=1) for power, cumulant in zip((2, 3, 4, 6), cumulants, strict=True)
    )
    moves = second > 0
    variance = np.where(moves, second, 1.0)
    skewness = np.where(moves, third / variance**1.5, 0.0)
    k4, k6 = np.where(moves, fourth / variance**2, 0.0), np.where(moves, sixth / variance**3, 0.0)
    # central moments of a standardised variable from its cumulants, then those of its square
    m4, m6 = k4 + 3, k6 + 15 * k4 + 10 * skewness**2 + 15
    square = (m6 - 3 * m4 + 2) / np.maximum(m4 - 1, 1e-9) ** 1.5
    result[list(COMPONENTS), 0], result[list(COMPONENTS), 1] = np.abs(skewness), np.where(moves, np.abs(square), 0.0)
    for norm, part in zip(NORMS, (slice(0, 3), slice(3, 6)), strict=True):
        rows = slice(norm + 1, norm + 4)
        spread = np.sqrt(second[part])
        heaviest = float(result[rows, 1].max())
        excess = max(heaviest - _NORMAL_SQUARE, 0.0)
        result[norm] = excess, heaviest
        is_bent = spread <= _NO_SLOPE * spread.max()
        result[rows] = np.where(is_bent[:, None], (excess, heaviest if excess else 0.0), result[rows])
    return result


@lru_cache(maxsize=4096)
def _cumulants(law: Law) -> Array | None:
    return law.cumulants()
