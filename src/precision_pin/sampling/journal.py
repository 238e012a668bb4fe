"""Journal of a run: the file from which a stopped run is resumed.

A first line names the format. Records follow, each a length, a digest of length and payload, and the payload. The first
payload is the identity of the run as JSON; the others are states, each of all blocks up to some block. Records are
appended and flushed to disk, so a stopped run leaves at most one incomplete record, which the digest reveals. One state
suffices to resume: after `MOST_RECORDS` the file is replaced atomically by one with the last state only.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import json
import os
import stat
import struct
import time
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Generic, Protocol, TypeVar

import numpy as np
from numba.core.registry import cpu_target
from numpy.typing import NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError, InternalError, OutputError
from precision_pin.base.versions import versions
from precision_pin.kernel import loops
from precision_pin.kernel.sampler import BLOCK
from precision_pin.robot.configurations import written_approach
from precision_pin.sampling.blocks import Work
from precision_pin.sampling.poses_result import POSE_ARRAYS
from precision_pin.statistics import Plan, State
from precision_pin.statistics.accumulate import LARGEST, is_consistent

if TYPE_CHECKING:
    from precision_pin.robot.chain import Posture


Files = Mapping[str, str | os.PathLike[str]]
"""Files that a run's model was read from, by their names in messages."""

_PLAN: Final = "the planned centres and scales"


def identity(work: Work, posture: Posture, files: Files) -> dict[str, str]:
    """Return all inputs that determine the bits of a run, by their names in messages."""
    # the processor that numba compiles for, as detected or configured
    triple, processor, features = cpu_target.target_context.codegen().magic_tuple()
    joints = zip(posture.chain.joint_names, posture.q, strict=True)
    signs = written_approach(posture.chain.joint_names, posture.approach)
    urdf = posture.chain.robot.file
    read_from = {**({"URDF": urdf} if os.path.isfile(urdf) else {}), **files}
    return {
        **{f"the {name}": _file_digest(Path(path)) for name, path in read_from.items()},
        "pose": ", ".join(
            f"{name} {float(value)!r}" + (f" ({signs[name]})" if name in signs else "") for name, value in joints
        ),
        "the error model": digest(work.layout),
        _PLAN: digest((work.plan.centre, work.plan.scale)),
        "specifications": ", ".join(
            f"{specification.quantity} {specification.limit!r} @ {specification.required!r}"
            for specification in work.plan.specifications
        ),
        "model": work.model,
        "seed": str(work.seed),
        "samples": str(work.samples),
        "block": str(BLOCK),
        **versions(),
        "the sampler's code": _file_digest(Path(loops.__file__)),
        "machine": f"{triple} {processor}",
        "the processor's features": digest(features),
    }


def differences(then: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """Return one text for each difference between two runs.

    The plan follows from the other inputs and is listed only if nothing else differs.
    """
    names = [name for name in dict.fromkeys([*now, *then]) if then.get(name) != now.get(name)]
    return [
        f"{name} {'has changed' if name.startswith('the ') else f'was {then.get(name)!r}, is {now.get(name)!r}'}"
        for name in names
        if name != _PLAN or names == [_PLAN]
    ]


def digest(value: Any) -> str:
    """Return a digest of numbers, text, arrays, and sequences, mappings and data classes of them."""
    hasher = hashlib.blake2b(digest_size=16)
    _update(hasher, value)
    return hasher.hexdigest()


def _update(hasher: hashlib.blake2b, value: Any) -> None:
    match value:
        case np.ndarray():
            _hash_words(hasher, "array", value.dtype.str, *map(str, value.shape))
            hasher.update(np.ascontiguousarray(value).tobytes())
        case Enum():
            _hash_words(hasher, type(value).__name__, value.name)
        case None | bool() | int() | float() | str() | np.number():
            _hash_words(hasher, type(value).__name__, str(value) if isinstance(value, str) else repr(value))
        case Mapping():
            _hash_words(hasher, "mapping", str(len(value)))
            for key, entry in value.items():
                _update(hasher, key)
                _update(hasher, entry)
        case Sequence():
            _hash_words(hasher, "sequence", str(len(value)))
            for entry in value:
                _update(hasher, entry)
        case _ if is_dataclass(value):
            _hash_words(hasher, type(value).__name__)
            for field in fields(value):
                _hash_words(hasher, field.name)
                _update(hasher, getattr(value, field.name))
        case _:
            raise InternalError(f"no digest of a {type(value).__name__}")


def _hash_words(hasher: hashlib.blake2b, *texts: str) -> None:
    """Hash words with their lengths, so that different lists of words give different bytes."""
    for text in texts:
        data = text.encode("utf-8", "surrogatepass")
        hasher.update(len(data).to_bytes(8, "little") + data)


def _file_digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(
            f"cannot read {path}, which identifies the run in the journal: {error.strerror or error}"
        ) from None


MAGIC: Final = b"precision-pin journal 2\n"
MOST_RECORDS: Final = 64  # then the file is replaced by one with the last state: it stays small
LARGEST_IDENTITY: Final = 2**20  # bytes; a longer record is no identity of a run

SHORTEST_PAUSE: Final = 2.0
LONGEST_PAUSE: Final = 60.0
"""Limits of the pause between records, in seconds; within them it is a hundredth of the run time so far."""

COST_OF_WRITING: Final = 20
"""Least ratio of a pause to the time taken to write the last record."""

_HEAD: Final = struct.Struct("<Q16s")


def _record(payload: bytes) -> bytes:
    return _HEAD.pack(len(payload), _digest(payload)) + payload


def _digest(payload: bytes) -> bytes:
    return hashlib.blake2b(len(payload).to_bytes(8, "little") + payload, digest_size=16).digest()


# states: serialised without pickles, and checked when they are read --------------------------------------------------


class Counted(Protocol):
    """State of a run: how much of it is done, and arrays or mappings of arrays."""

    @property
    def count(self) -> int:
        """Number of completed items."""


S = TypeVar("S", bound=Counted)


@dataclass(frozen=True)
class Codec(Generic[S]):
    """Validation and unit of journal states.

    Attributes:
        check: Raises ValueError if no run could give a state.
        unit: What is counted, for messages.
    """

    check: Callable[[S], None]
    unit: str


def packed(state: Any) -> bytes:
    """Return a state as compressed bytes, without pickles: a journal may come from an untrusted source."""
    leaves = _leaves(state)
    return zlib.compress(_layout(leaves) + b"".join(leaf.tobytes() for leaf in leaves.values()), level=1)


def _layout(leaves: Mapping[str, NDArray[Any]]) -> bytes:
    """Return the names, types and shapes of arrays, with which their bytes begin."""
    return json.dumps([(name, leaf.dtype.str, leaf.shape) for name, leaf in leaves.items()]).encode()


def _size(leaves: Mapping[str, NDArray[Any]]) -> int:
    return len(_layout(leaves)) + sum(leaf.nbytes for leaf in leaves.values())


def largest(pattern: Any) -> int:
    """Return an upper bound of the bytes, packed or not, of a state like the pattern."""
    return _size(_leaves(pattern)) * 101 // 100 + 1000


def unpacked(data: bytes, pattern: S, check: Callable[[S], None]) -> S:
    """Return the state from its packed bytes; ``pattern`` is a state of the same run, for types and shapes.

    At most the bytes of a state are read, whatever the input.
    """
    leaves = _leaves(pattern)
    size, layout = _size(leaves), _layout(leaves)
    try:
        plain = zlib.decompressobj().decompress(data, size + 1)
        if len(plain) > size:
            raise ValueError("it is too long")
        if len(plain) < size or not plain.startswith(layout):
            raise ValueError("its arrays are of another type or shape")
        begin, arrays = len(layout), {}
        for name, leaf in leaves.items():
            arrays[name] = np.frombuffer(plain, leaf.dtype, leaf.size, begin).reshape(leaf.shape).copy()
            begin += leaf.nbytes
        values = {
            name: {key: arrays[f"{name}.{key}"] for key in like}
            if isinstance(like, dict)
            else (arrays[name] if isinstance(like, np.ndarray) else int(arrays[name]))
            for name, like in vars(pattern).items()
        }
        state: S = type(pattern)(**values)
        check(state)
    except (zlib.error, ValueError) as error:
        raise InputError(f"the journal's last record cannot be read: {error}") from None
    return state


def _check_samples(state: State) -> None:
    """Check that samples could give this state: a correct digest does not prove that a run wrote it."""
    sketched, inside = state.sketch.sum(axis=1), state.inside
    sums = (state.sums, state.products, state.norm_squares)
    if state.count < 0 or state.sketch.min() < 0 or (sketched != state.count).any():
        raise ValueError("its counts are inconsistent")
    if not ((inside >= 0) & (inside <= state.count)).all():
        raise ValueError("more samples keep a specification than there are")
    if not all(np.isfinite(part).all() for part in sums):
        raise ValueError("its sums are not finite")
    count = min(state.count, LARGEST)
    largest, units = state.largest[:, :count], state.largest_units[:, :count]
    extremes = (state.lowest, state.highest, largest) if state.count else ()
    if not all(np.isfinite(part).all() for part in extremes):
        raise ValueError("its smallest and largest values are not finite")
    # without samples they are infinite
    is_ordered = (state.lowest <= state.highest).all() or not state.count
    tail = (state.largest[:, count:] == -np.inf).all() and (state.largest_units[:, count:] == -1).all()
    if not (
        is_ordered and tail and (np.diff(largest, axis=1) <= 0).all() and ((units >= 0) & (units < state.count)).all()
    ):
        raise ValueError("its smallest and largest values are out of order")


SAMPLES: Final = Codec[State](_check_samples, "samples")


def samples_of(plan: Plan) -> Codec[State]:
    """Return the codec of states of a plan, whose statistics must agree with their histograms."""

    def check(state: State) -> None:
        _check_samples(state)
        if not is_consistent(plan, state):
            raise ValueError("its statistics contradict its histograms")

    return replace(SAMPLES, check=check)


def _leaves(state: Any) -> dict[str, NDArray[Any]]:
    """Return the arrays of a state by name; numbers are arrays without axes."""
    leaves: dict[str, Any] = {}
    for name, value in vars(state).items():
        leaves |= {f"{name}.{key}": part for key, part in value.items()} if isinstance(value, dict) else {name: value}
    return {name: np.asarray(leaf) for name, leaf in leaves.items()}


_ALWAYS: Final = ("mean", "norm_mean", "norm_max", "probability", "probability_interval")
"""Arrays without NaN for any number of samples."""


@dataclass(frozen=True, eq=False)
class CompletedPoses:
    """Arrays over all poses of a run, of which the first ``count`` are filled.

    Attributes:
        values: The arrays of `POSE_ARRAYS`; the last axis is the pose.
    """

    count: int
    values: dict[str, Array]

    @classmethod
    def start(cls, poses: int, specifications: int) -> CompletedPoses:
        """Return the empty state of P poses and S specifications."""
        shapes = {name: [length or specifications for length in shape] for name, shape in POSE_ARRAYS.items()}
        return cls(0, {name: np.zeros((*shape, poses)) for name, shape in shapes.items()})

    def with_part(self, part: Mapping[str, Array]) -> CompletedPoses:
        """Return the state with the next poses filled in place."""
        end = self.count + part["mean"].shape[-1]
        for name, array in self.values.items():
            array[..., self.count : end] = part[name]
        return replace(self, count=end)


def _check_poses(state: CompletedPoses) -> None:
    if not 0 <= state.count <= state.values["mean"].shape[-1]:
        raise ValueError("its counts are inconsistent")
    for name, array in state.values.items():
        completed = array[..., : state.count]
        # with few samples, the others may be NaN
        if np.isinf(completed).any() or (name in _ALWAYS and np.isnan(completed).any()):
            raise ValueError(f"its {name} is not finite")


POSES: Final = Codec[CompletedPoses](_check_poses, "poses")


# the file --------------------------------------------------------------------------------------------------------------


@contextmanager
def opened(
    path: str | os.PathLike[str],
    identity: Mapping[str, str],
    start: S,
    codec: Codec[S],
    *,
    resume: bool,
    tell: Callable[[str], None],
) -> Iterator[tuple[Journal[S], S]]:
    """Yield an open journal, locked against other processes, and the state to resume from."""
    name = os.fspath(path)
    journal = Journal(name, _open_locked(name, resume=resume), identity, codec)
    try:
        yield journal, journal.begin(start, resume=resume, tell=tell)
    finally:
        journal.close()


def _open_locked(name: str, *, resume: bool) -> int:
    """Return the descriptor of the file, created if necessary and locked."""
    while True:
        try:
            descriptor = os.open(name, os.O_RDWR | os.O_CREAT | os.O_NONBLOCK | (0 if resume else os.O_EXCL), 0o666)
        except FileExistsError:
            raise InputError(f"the journal {name} already exists; resume its run, or remove the file") from None
        except (OSError, ValueError) as error:
            raise _unwritable(name, error) from None
        try:
            if not stat.S_ISREG(os.fstat(descriptor).st_mode):
                raise OutputError(f"cannot write the journal {name}: it is not a regular file")
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):
                    raise _unwritable(name, error) from None
                raise InputError(f"the journal {name} is in use by another run") from None
            with suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(descriptor), os.stat(name)):
                    return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)  # the process that held the lock has replaced the file: open the new one


def _unwritable(name: str, error: Exception) -> OutputError:
    return OutputError(f"cannot write the journal {name}: {getattr(error, 'strerror', None) or error}")


class Journal(Generic[S]):
    """Open journal, created by :func:`opened`.

    Attributes:
        name: Path of the file, as given.
        saved: Number of samples, or of other counted things, in the last record.
    """

    def __init__(self, name: str, descriptor: int, identity: Mapping[str, str], codec: Codec[S]) -> None:
        self.name = name
        self._codec = codec
        self._place = os.path.realpath(name)
        self._descriptor = descriptor
        self._identity = dict(identity)
        self._opening = MAGIC + _record(json.dumps(self._identity).encode())
        self._end = 0
        self._states = 0
        self.saved = 0
        self._begun = time.monotonic()
        self._due = self._begun + SHORTEST_PAUSE

    def begin(self, start: S, *, resume: bool, tell: Callable[[str], None]) -> S:
        """Return the state to resume from, as in :func:`opened`."""
        size = os.fstat(self._descriptor).st_size
        if size < len(self._opening) and self._opening.startswith(self._read(0, size)):
            if resume:
                tell(f"the journal {self.name} is empty; the run starts from the first sample")
            try:
                self._append(self._opening)
                self._flush_folder()
            except OutputError:
                with suppress(OSError):
                    os.unlink(self._place)
                raise
            return start
        return self._last_state(start, size, tell)

    def save_if_due(self, state: S) -> None:
        """Add a record if the pause since the last one is over."""
        if time.monotonic() >= self._due:
            self.save(state)

    def save(self, state: S) -> None:
        """Add a record, unless the last one has the same count."""
        if state.count == self.saved:
            return
        start = time.monotonic()
        record = _record(packed(state))
        if self._states >= MOST_RECORDS:
            self._replace(record)
        else:
            self._append(record)
        self._states += 1
        self.saved = state.count
        now = time.monotonic()
        pause = min(max(SHORTEST_PAUSE, (now - self._begun) / 100), LONGEST_PAUSE)
        self._due = now + max(pause, COST_OF_WRITING * (now - start))

    def close(self) -> None:
        """Close the file and release its lock."""
        os.close(self._descriptor)

    def _last_state(self, start: S, size: int, tell: Callable[[str], None]) -> S:
        """Return the last complete state; the next record overwrites what follows it."""
        if self._read(0, len(MAGIC)) != MAGIC:
            raise InputError(f"{self.name} is not a journal of this version of precision-pin; the file is unchanged")
        header = next(self._records(len(MAGIC), size, 1, LARGEST_IDENTITY), None)
        identity = None if header is None else _identity(header)
        if header is None or identity is None:
            raise InputError(f"the beginning of the journal {self.name} is damaged; remove the file and start again")
        changes = differences(identity, self._identity)
        if changes:
            raise InputError(f"the journal {self.name} belongs to another run: {'; '.join(changes)}")
        self._end = len(MAGIC) + _HEAD.size + len(header)
        last_payload = None
        for payload in self._records(self._end, size, MOST_RECORDS, largest(start)):
            last_payload = payload
            self._end += _HEAD.size + len(payload)
            self._states += 1
        state = start if last_payload is None else unpacked(last_payload, start, self._codec.check)
        self.saved = state.count
        if self._end < size:
            ignored = size - self._end
            tell(f"the journal {self.name}: the last {ignored} bytes are incomplete or damaged and are ignored")
        tell(f"the journal {self.name} holds the first {self.saved:,} {self._codec.unit}")
        return state

    def _records(self, offset: int, size: int, most: int, largest: int) -> Iterator[bytes]:
        """Yield records up to the first incomplete one, within the number and size that a run can write."""
        for _ in range(most):
            if offset + _HEAD.size > size:
                return
            length, digest = _HEAD.unpack(self._read(offset, _HEAD.size))
            offset += _HEAD.size
            if length > min(size - offset, largest):
                return
            payload = self._read(offset, length)
            if _digest(payload) != digest:
                return
            yield payload
            offset += length

    def _read(self, offset: int, length: int) -> bytes:
        pieces = []
        while length:
            try:
                piece = os.pread(self._descriptor, length, offset)
            except OSError as error:
                raise InputError(f"cannot read the journal {self.name}: {error.strerror}") from None
            if not piece:
                break
            pieces.append(piece)
            offset, length = offset + len(piece), length - len(piece)
        return b"".join(pieces)

    def _append(self, data: bytes) -> None:
        try:
            os.ftruncate(self._descriptor, self._end)  # removes the remains of an interrupted write
            _write(self._descriptor, data, self._end)
        except OSError as error:
            with suppress(OSError):
                os.ftruncate(self._descriptor, self._end)
            raise self._lost(error) from None
        self._end += len(data)

    def _replace(self, record: bytes) -> None:
        """Replace the file atomically by one with the last state only."""
        part, old_descriptor, descriptor = self._place + ".part", self._descriptor, -1
        try:
            descriptor = os.open(part, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o666)
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            _write(descriptor, self._opening + record, 0)
            os.replace(part, self._place)
            self._descriptor, self._end, self._states = descriptor, len(self._opening) + len(record), 0
        except OSError as error:
            raise self._lost(error) from None
        finally:
            is_replaced = self._descriptor == descriptor
            if not is_replaced:
                with suppress(OSError):
                    os.unlink(part)
            if descriptor >= 0:
                os.close(old_descriptor if is_replaced else descriptor)
        self._flush_folder()

    def _flush_folder(self) -> None:
        """Flush the file's folder entry to disk, if the system supports it."""
        with suppress(OSError):
            folder = os.open(os.path.dirname(self._place), os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)

    def _lost(self, error: OSError) -> OutputError:
        resumed = f"; it holds the first {self.saved:,} {self._codec.unit}, from which the run can be resumed"
        advice = resumed if self.saved else ""
        return OutputError(f"cannot write the journal {self.name}: {error.strerror or error}{advice}")


def _identity(header: bytes) -> dict[str, str] | None:
    try:
        identity = json.loads(header)
    except (ValueError, RecursionError):
        return None
    texts = isinstance(identity, dict) and all(isinstance(value, str) for value in identity.values())
    return identity if texts else None


def _write(descriptor: int, data: bytes, offset: int) -> None:
    view = memoryview(data)
    while view:
        count = os.pwrite(descriptor, view, offset)
        view, offset = view[count:], offset + count
    os.fsync(descriptor)
