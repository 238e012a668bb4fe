"""Description of the work of a run, which can be sent to another process or machine."""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, Literal, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arguments import check_whole
from precision_pin.base.errors import InputError
from precision_pin.base.versions import versions
from precision_pin.kernel import sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.kernel.sampler import BLOCK, Blocks
from precision_pin.statistics import Plan

MOST_SAMPLES: Final = 10**12


def check_samples(samples: int) -> None:
    """Check that the number of samples is a whole number from 1 to 10¹²."""
    check_whole("the number of samples", samples, 1, MOST_SAMPLES, f"from 1 to {MOST_SAMPLES:.0e}")


@lru_cache(maxsize=1)
def packages() -> tuple[tuple[str, str], ...]:
    """Return name and version of the packages of this process that determine the bits of a block."""
    found = versions()
    return tuple((name, found[name]) for name in ("precision-pin", "numpy", "numba"))


def check_packages(started_with: Sequence[tuple[str, str]]) -> None:
    """Check that this process has the packages of the process that started a run."""
    here = dict(packages())
    for name, version in started_with:
        if here[name] != version:
            raise InputError(
                f"a worker has {name} {here[name]}, the run was started with {version}; install the same version"
            )


class Sent:
    """Data class that is pickled with its read-only arrays read-only."""

    def __reduce__(self) -> tuple[Callable[[bytes], Any], tuple[bytes]]:
        buffer = io.BytesIO()
        _Pickler(buffer, protocol=5).dump((type(self), tuple(vars(self).values())))
        return _unpickle, (buffer.getvalue(),)


def _unpickle(data: bytes) -> Any:
    kind, values = pickle.loads(data)
    return kind(*values)


@final
@dataclass(frozen=True, eq=False)
class Work(Sent):
    """All inputs of a block's statistics except the block number. Can be pickled.

    Attributes:
        layout: The error model at the pose.
        plan: Centres, bins and specifications.
        model: ``"exact"`` or ``"linear"``.
        seed: 64-bit seed.
        samples: Number of samples of the whole run, at which its last block ends.
        keep_errors: Return the errors as well.
        packages: Versions in the process that started the run; a worker with other versions is an error.
    """

    layout: SamplerArrays
    plan: Plan
    model: Literal["exact", "linear"]
    seed: int
    samples: int
    keep_errors: bool
    packages: tuple[tuple[str, str], ...]

    @property
    def blocks(self) -> int:
        """Number of blocks of the run; the last one may be short."""
        return -(-self.samples // BLOCK)

    def observe(self, first_block: int, blocks: int) -> Blocks:
        """Return the statistics of blocks ``first_block … first_block + blocks - 1``."""
        check_packages(self.packages)
        return sampler.observe_blocks(
            self.layout, self.plan, self.model, self.seed, first_block, blocks,
            samples=self.samples, keep_errors=self.keep_errors,
        )  # fmt: skip


class _Pickler(pickle.Pickler):
    """Pickler that keeps read-only arrays read-only: numba compiles separately for writeable ones."""

    def reducer_override(self, thing: Any) -> Any:
        """Return the reconstruction of a read-only array; the default for all other objects."""
        if type(thing) is np.ndarray and not thing.flags.writeable:
            return _make_read_only, (np.array(thing),)
        return NotImplemented


def _make_read_only(array: NDArray[Any]) -> NDArray[Any]:
    array.flags.writeable = False
    return array
