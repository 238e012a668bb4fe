"""Blocks of samples at one pose, as work that can be sent to another process or machine."""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, Literal, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.errors import InputError
from precision_pin.inputs.arguments import check_whole
from precision_pin.kernel import sampler
from precision_pin.sampling.versions import versions
from precision_pin.statistics import Plan

__all__ = ["MOST_SAMPLES", "Work", "check_samples", "packages"]

MOST_SAMPLES: Final = 10**12


def check_samples(samples: int) -> None:
    """Refuse a number of samples that is not a whole number from 1 to 10¹².

    Raises
    ------
    InputError
        It is not.
    """
    check_whole("the number of samples", samples, 1, MOST_SAMPLES, f"from 1 to {MOST_SAMPLES:.0e}")


@lru_cache(maxsize=1)
def packages() -> tuple[tuple[str, str], ...]:
    """Return name and version of what decides a block's bits, of this process."""
    found = versions()
    return tuple((name, found[name]) for name in ("precision-pin", "numpy", "numba"))


@final
@dataclass(frozen=True, eq=False)
class Work:
    """All that a block's statistics depend on, but for its number. Can be pickled.

    Attributes
    ----------
    layout
        The error model at the pose.
    plan
        What is subtracted, binned and counted.
    model
        ``"exact"`` or ``"linear"``.
    seed
        64-bit seed.
    samples
        The number of samples of the whole run, at which its last block ends.
    keep_errors
        Return the errors as well.
    packages
        Versions where the run began; other versions elsewhere are refused.
    """

    layout: sampler.SamplerArrays
    plan: Plan
    model: Literal["exact", "linear"]
    seed: int
    samples: int
    keep_errors: bool
    packages: tuple[tuple[str, str], ...]

    @property
    def blocks(self) -> int:
        """Number of blocks of the run; the last one may be short."""
        return -(-self.samples // sampler.BLOCK)

    def observe(self, first_block: int, blocks: int) -> sampler.Blocks:
        """Return what blocks ``first_block … first_block + blocks - 1`` give.

        Raises
        ------
        InputError
            As :func:`precision_pin.kernel.sampler.observe_blocks`; or this process has other versions of the packages than
            the run was begun with.
        """
        here = dict(packages())
        for name, version in self.packages:
            if here[name] != version:
                raise InputError(
                    f"a worker has {name} {here[name]}, the run was begun with {version}; install the same"
                )
        return sampler.observe_blocks(
            self.layout, self.plan, self.model, self.seed, first_block, blocks,
            samples=self.samples, keep_errors=self.keep_errors,
        )  # fmt: skip

    def __reduce__(self) -> tuple[Callable[..., Work], tuple[bytes]]:
        buffer = io.BytesIO()
        _Pickler(buffer, protocol=5).dump(tuple(vars(self).values()))
        return _unpickled, (buffer.getvalue(),)


def _unpickled(data: bytes) -> Work:
    return Work(*pickle.loads(data))


class _Pickler(pickle.Pickler):
    """Keeps arrays that cannot be written so: to numba they are another type, for which it would compile anew."""

    def reducer_override(self, thing: Any) -> Any:
        """Return how a read-only array is made again; the default for all else."""
        if type(thing) is np.ndarray and not thing.flags.writeable:
            return _read_only, (np.array(thing),)
        return NotImplemented


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    array.flags.writeable = False
    return array
