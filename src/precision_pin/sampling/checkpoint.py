"""State of a run as its journal keeps it: serialised without pickles, and checked when it is read."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, Final, Generic, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.sampling.poses_result import POSE_ARRAYS
from precision_pin.statistics import State
from precision_pin.statistics.accumulate import LARGEST

S = TypeVar("S")


_OVERHEAD: Final = 1000
"""Generous bound of the bytes that an array takes beyond its numbers."""


@final
@dataclass(frozen=True)
class Codec(Generic[S]):
    """What a journal must know of the states that it holds.

    Attributes:
        count: Function that returns how much of the run a state holds.
        check: Function that raises ValueError if no run could give a state.
        unit: What is counted, for messages.
    """

    count: Callable[[S], int]
    check: Callable[[S], None]
    unit: str


def packed(state: Any) -> bytes:
    """Return a state as compressed bytes, without pickles: a journal may come from an untrusted source."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **_leaves(state, ""))
    return zlib.compress(buffer.getvalue(), level=1)


def largest(pattern: Any) -> int:
    """Return an upper bound of the bytes of a state with the pattern's plan, packed or not."""
    return sum(np.asarray(leaf).nbytes * 101 // 100 + _OVERHEAD for leaf in _leaves(pattern, "").values())


def unpacked(data: bytes, pattern: S, check: Callable[[S], None]) -> S:
    """Return the state from its packed bytes; ``pattern`` is a state of the same run with the types and shapes to read.

    No more bytes are read than a state takes, whatever the input.
    """
    most = largest(pattern)
    try:
        plain = zlib.decompressobj().decompress(data, most + 1)
        if len(plain) > most:
            raise ValueError("it is too long")
        with zipfile.ZipFile(io.BytesIO(plain)) as members:
            arrays = {name: _read(members, name, np.asarray(leaf)) for name, leaf in _leaves(pattern, "").items()}
        found: S = _rebuild(arrays, pattern, "")
        check(found)
    except (zlib.error, zipfile.BadZipFile, KeyError, ValueError, TypeError, OSError, EOFError, RuntimeError) as error:
        raise InputError(f"the journal's last record cannot be read: {error}") from None
    return found


def _read(members: zipfile.ZipFile, name: str, like: NDArray[Any]) -> NDArray[Any]:
    """Return an array with the type and shape of another; a different header, which could claim any size, is an error."""
    pattern = io.BytesIO()
    np.save(pattern, like)
    size = pattern.tell()
    with members.open(f"{name}.npy") as member:
        data = member.read(size + 1)
    begin = size - like.nbytes
    if len(data) != size or data[:begin] != pattern.getvalue()[:begin]:
        raise ValueError(f"{name} is of another type or shape")
    return np.frombuffer(data, like.dtype, offset=begin).reshape(like.shape).copy()


def _check_samples(state: State) -> None:
    """Check that samples could give this state: a correct digest does not prove that a run wrote the record."""
    sketched, inside = state.sketch.sum(axis=1), state.inside
    sums = (state.sums, state.products, state.norm_squares)
    if state.count < 0 or state.sketch.min() < 0 or (sketched != state.count).any():
        raise ValueError("its counts are inconsistent")
    if not ((inside >= 0) & (inside <= state.count)).all():
        raise ValueError("more samples keep a specification than there are")
    if not all(np.isfinite(part).all() for part in sums):
        raise ValueError("its sums are not finite")
    kept = min(state.count, LARGEST)
    largest, units = state.largest[:, :kept], state.largest_units[:, :kept]
    extremes = (state.lowest, state.highest, largest) if state.count else ()
    if not all(np.isfinite(part).all() for part in extremes):
        raise ValueError("its smallest and largest values are not finite")
    # without samples they are infinite
    ordered = (state.lowest <= state.highest).all() or not state.count
    rest = (state.largest[:, kept:] == -np.inf).all() and (state.largest_units[:, kept:] == -1).all()
    if not (
        ordered and rest and (np.diff(largest, axis=1) <= 0).all() and ((units >= 0) & (units < state.count)).all()
    ):
        raise ValueError("its smallest and largest values are out of order")


SAMPLES: Final = Codec[State](lambda state: state.count, _check_samples, "samples")


def _leaves(value: Any, name: str) -> dict[str, Any]:
    """Return arrays and numbers keyed by their path in data classes and tuples."""
    leaves: dict[str, Any] = {}
    for key, entry in _parts(value):
        below = f"{name}{key}"
        leaves |= {below: entry} if isinstance(entry, np.ndarray | int) else _leaves(entry, f"{below}.")
    return leaves


def _rebuild(arrays: dict[str, Any], pattern: Any, name: str) -> Any:
    values = []
    for key, entry in _parts(pattern):
        below = f"{name}{key}"
        match entry:
            case np.ndarray():
                values.append(arrays[below])
            case int():
                values.append(int(arrays[below]))
            case _:
                values.append(_rebuild(arrays, entry, f"{below}."))
    kind: Any = type(pattern)
    return kind(*values) if is_dataclass(pattern) else kind(values)


def _parts(value: Any) -> list[tuple[str, Any]]:
    if is_dataclass(value):
        return [(field.name, getattr(value, field.name)) for field in fields(value)]
    return [(str(k), entry) for k, entry in enumerate(value)]


_ALWAYS: Final = ("mean", "norm_mean", "norm_max", "probability", "probability_interval")
"""Those that any number of samples gives."""


@final
@dataclass(frozen=True, eq=False)
class PosesDone:
    """Arrays over all poses of a run, of which the first ones are filled.

    Attributes:
        count: Number of poses that are finished.
        values: The arrays of `POSE_ARRAYS`; the last axis is the pose.
    """

    count: int
    values: tuple[Array, ...]

    def arrays(self) -> dict[str, Array]:
        """Return the arrays by name."""
        return dict(zip(POSE_ARRAYS, self.values, strict=True))

    def with_part(self, part: Mapping[str, Array]) -> PosesDone:
        """Return the state with the next poses filled, in place."""
        end = self.count
        for name, array in self.arrays().items():
            end = self.count + part[name].shape[-1]
            array[..., self.count : end] = part[name]
        return replace(self, count=end)


def start_of_poses(part: Mapping[str, Array], poses: int) -> PosesDone:
    """Return the state before any of P poses, with the types and shapes of the part of a pose."""
    return PosesDone(0, tuple(np.zeros((*part[name].shape[:-1], poses), part[name].dtype) for name in POSE_ARRAYS))


def _check_poses(state: PosesDone) -> None:
    """Check that samples could give this state."""
    if not 0 <= state.count <= state.values[0].shape[-1]:
        raise ValueError("its counts are inconsistent")
    for name, array in state.arrays().items():
        done = array[..., : state.count]
        # few samples leave the others without a number
        if np.isinf(done).any() or (name in _ALWAYS and np.isnan(done).any()):
            raise ValueError(f"its {name} is not finite")


POSES: Final = Codec[PosesDone](lambda state: state.count, _check_poses, "poses")
