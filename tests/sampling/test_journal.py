"""File of the journal: incomplete ends, flipped bits, full disks, other runs, other processes, files made to harm."""

from __future__ import annotations

import errno
import hashlib
import io
import json
import os
import resource
import subprocess
import sys
import threading
import time
import tracemalloc
import zipfile
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.base.errors import InputError, OutputError
from precision_pin.kernel.sampler import BLOCK
from precision_pin.sampling import journal as journal_module
from precision_pin.sampling.journal import MAGIC, SAMPLES, differences, digest, identity, opened, packed, unpacked
from precision_pin.sampling.one_pose import Sampling
from precision_pin.sampling.workers import Foreign
from precision_pin.statistics import State, start
from precision_pin.statistics.accumulate import LARGEST
from sampling.cases import AT, MODEL, PLAN, Muddled, assert_same_bits, work

IDENTITY = {"seed": "0", "the error model": "ab12"}


BEGINNING = start(PLAN)
NARROW = {**vars(BEGINNING), "sketch": BEGINNING.sketch[:, :3]}


def small_state(count: int) -> State:
    """Return a state whose sketch is narrow, so that a file of it is short."""
    generator = np.random.default_rng(count)
    arrays = {name: entry for name, entry in NARROW.items() if isinstance(entry, np.ndarray)}
    filled = {name: generator.integers(0, 99, entry.shape).astype(entry.dtype) for name, entry in arrays.items()}
    filled["sketch"] = np.zeros_like(filled["sketch"])
    filled["sketch"][:, 0] = count
    # what samples could give: so many kept a limit, the largest norms in order and the others none
    filled["inside"] = np.minimum(filled["inside"], count)
    filled["highest"] = filled["lowest"] + filled["highest"]
    kept = min(count, LARGEST)
    filled["largest"] = np.sort(filled["largest"])[:, ::-1]
    filled["largest"][:, kept:] = -np.inf
    filled["largest_units"] %= max(count, 1)
    filled["largest_units"][:, kept:] = -1
    return State(**{**NARROW, **filled, "count": count})


EMPTY = small_state(0)
STATES = [small_state(count) for count in (100, 200, 300)]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "run.journal"


@pytest.fixture
def no_waiting_for_disks(monkeypatch) -> None:
    """Thousands of records; flushing them to disk is tested elsewhere."""
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)


def opened_by(file: Path, *, resume: bool = True, told: list[str] | None = None, identity=IDENTITY):
    return opened(file, identity, EMPTY, SAMPLES, resume=resume, tell=[].append if told is None else told.append)


def state_in(file: Path, told: list[str] | None = None) -> State:
    with opened_by(file, told=told) as (_, state):
        return state


@pytest.fixture
def whole(file: Path) -> bytes:
    """Write a journal of three states and return its bytes."""
    with opened_by(file, resume=False) as (journal, state):
        assert state is EMPTY
        for further in STATES:
            journal.save(further)
    return file.read_bytes()


def record_ends(data: bytes) -> list[int]:
    """Return the ends of the records, by the documented format."""
    ends, offset = [], len(MAGIC)
    while offset < len(data):
        offset += 24 + int.from_bytes(data[offset : offset + 8], "little")
        ends.append(offset)
    return ends


def test_a_journal_gives_back_the_last_state(whole: bytes, file: Path) -> None:
    told: list[str] = []
    assert_same_bits(state_in(file, told), STATES[-1])
    assert told == [f"the journal {file} holds the first 300 samples"]
    assert file.read_bytes() == whole
    ends = record_ends(whole)
    assert len(ends) == 4
    assert ends[-1] == len(whole)
    assert json.loads(whole[len(MAGIC) + 24 : ends[0]]) == IDENTITY
    with opened_by(file) as (journal, state):
        journal.save(state)
        journal.save_if_due(small_state(400))  # two seconds have not passed
    assert file.read_bytes() == whole


def places(data: bytes, begin: int, end: int) -> list[int]:
    """Return the places of all heads of records and their neighbours, and every fifth of the others."""
    heads = [len(MAGIC), *record_ends(data)]
    return [k for k in range(begin, end) if k % 5 == 0 or any(-3 <= k - head < 30 for head in heads)]


@pytest.mark.slow
def test_torn_anywhere_in_the_beginning_and_the_last_record(whole: bytes, file: Path, no_waiting_for_disks) -> None:
    ends = record_ends(whole)
    for length in [*places(whole, 0, ends[0]), *places(whole, ends[-2], ends[-1])]:
        file.write_bytes(whole[:length])
        told: list[str] = []
        with opened_by(file, told=told) as (journal, state):
            if length < ends[0]:
                assert state is EMPTY
                for further in STATES[:-1]:
                    journal.save(further)
                assert told == [f"the journal {file} is empty; the run starts from the first sample"]
            else:
                assert_same_bits(state, STATES[-2])
                is_told = f"the last {length - ends[-2]} bytes are incomplete or damaged" in told[0]
                assert is_told == (length > ends[-2])
            journal.save(STATES[-1])
        assert file.read_bytes() == whole


@pytest.mark.slow
def test_a_flipped_bit_anywhere_never_gives_a_wrong_state(whole: bytes, file: Path, no_waiting_for_disks) -> None:
    ends = record_ends(whole)
    known = {0: EMPTY, **{state.count: state for state in STATES}}
    for place in places(whole, 0, len(whole)):
        data = bytearray(whole)
        data[place] ^= 1 << place % 8
        file.write_bytes(data)
        told: list[str] = []
        if place < ends[0]:
            damaged = r"not a journal of this version|beginning of the journal .* is damaged"
            with pytest.raises(InputError, match=damaged):
                state_in(file)
            assert file.read_bytes() == data
            continue
        state = state_in(file, told)
        # all that was before the damage
        assert state.count == 100 * sum(end <= place for end in ends[1:])
        assert_same_bits(state, known[state.count])
        assert "incomplete or damaged and are ignored" in told[0]


def test_other_files_are_left_as_they_are(file: Path) -> None:
    for contents in (b"precision-pin: 1\nrobot: 4dof.urdf\n", b"x", MAGIC.replace(b"1", b"2") + b"x" * 999):
        file.write_bytes(contents)
        with pytest.raises(InputError, match=r"is not a journal of this version|beginning of the journal"):
            state_in(file)
        exists = "already exists; resume its run, or remove the file"
        with pytest.raises(InputError, match=exists), opened_by(file, resume=False):
            pass
        assert file.read_bytes() == contents


# size ----------------------------------------------------------------------------------------------------------------


def test_the_file_stays_small_however_many_records(file: Path, monkeypatch) -> None:
    monkeypatch.setattr(journal_module, "MOST_RECORDS", 5)
    (file.parent / "run.journal.part").write_bytes(b"half a fi")  # of a process that was killed while replacing
    sizes = []
    with opened_by(file) as (journal, _):
        for count in range(1, 14):
            journal.save(small_state(count))
            sizes.append(file.stat().st_size)
            with pytest.raises(InputError, match="in use by another run"):  # the file that took its place is locked too
                state_in(file)
    assert max(sizes) == max(sizes[:5]) or max(sizes) < 1.1 * max(sizes[:5])
    assert len(record_ends(file.read_bytes())) <= 6
    assert_same_bits(state_in(file), small_state(13))
    assert sorted(os.listdir(file.parent)) == [file.name]


def test_what_a_process_killed_while_replacing_left_does_no_harm(file: Path, monkeypatch) -> None:
    monkeypatch.setattr(journal_module, "MOST_RECORDS", 1)
    (file.parent / "run.journal.part").write_bytes(b"half a fi")
    with opened_by(file) as (journal, _):
        for state in STATES:
            journal.save(state)
    assert_same_bits(state_in(file), STATES[-1])
    assert sorted(os.listdir(file.parent)) == [file.name]


@pytest.mark.slow
def test_pauses_grow_with_the_run(file: Path, monkeypatch, no_waiting_for_disks) -> None:
    now = 0.0
    monkeypatch.setattr(journal_module.time, "monotonic", lambda: now)
    saved = []
    with opened_by(file) as (journal, _):
        for tick in range(1, 8_000):  # the pauses are the longest from 6000 s on
            now = float(tick)
            before = journal.saved
            journal.save_if_due(replace(EMPTY, count=tick))
            if journal.saved != before:
                saved.append(now)
    gaps = np.diff(saved)
    assert saved[0] == 2.0
    assert gaps.min() == 2.0
    assert gaps.max() == 60.0
    assert (gaps <= np.clip(np.array(saved[1:]) / 100, 2.0, 60.0) + 1).all()


# disks ---------------------------------------------------------------------------------------------------------------


def full_after(monkeypatch, room: int):
    """Simulate a disk that is full after a number of further bytes."""
    real, left = os.pwrite, [room]

    def pwrite(descriptor: int, data: bytes, offset: int) -> int:
        if not left[0]:
            raise OSError(errno.ENOSPC, "No space left on device")
        written = real(descriptor, data[: left[0]], offset)
        left[0] -= written
        return written

    monkeypatch.setattr(os, "pwrite", pwrite)


@pytest.mark.parametrize("replacing", [False, True])
def test_a_full_disk_loses_nothing(whole: bytes, file: Path, monkeypatch, replacing: bool) -> None:
    if replacing:
        monkeypatch.setattr(journal_module, "MOST_RECORDS", 3)
    for room in (0, 23, 25, 500):
        file.write_bytes(whole)
        with opened_by(file) as (journal, _):
            with monkeypatch.context() as patched:
                full_after(patched, room)
                message = r"cannot write the journal .*: No space left on device; it holds the first 300 samples, from"
                with pytest.raises(OutputError, match=message):
                    journal.save(small_state(400))
            assert file.read_bytes() == whole
            journal.save(small_state(500))  # there is room again
        assert_same_bits(state_in(file), small_state(500))
        assert os.listdir(file.parent) == [file.name]


def test_a_journal_that_cannot_be_begun_leaves_no_file(file: Path, monkeypatch) -> None:
    for room in (0, 1, 30):
        full_after(monkeypatch, room)
        with pytest.raises(OutputError, match=r"No space left on device$"), opened_by(file, resume=False):
            pass
        monkeypatch.undo()
        assert os.listdir(file.parent) == []


@pytest.mark.slow
def test_a_run_that_a_real_limit_of_files_stops_goes_on(file: Path, monkeypatch) -> None:
    """The largest file size of the process allows the beginning and a few states only."""
    for name in ("SHORTEST_PAUSE", "LONGEST_PAUSE", "COST_OF_WRITING"):
        monkeypatch.setattr(journal_module, name, 0)
    before, alive = resource.getrlimit(resource.RLIMIT_FSIZE), threading.active_count()
    resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, before[1]))
    try:
        with pytest.raises(OutputError, match=r"cannot write the journal .*: File too large; it holds the first"):
            pp.monte_carlo(MODEL, samples=40 * BLOCK, threads=2, journal=file)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert file.stat().st_size <= 300_000
    assert threading.active_count() == alive
    told: list[str] = []
    resumed = pp.monte_carlo(MODEL, samples=40 * BLOCK, journal=file, resume=True, tell=told.append)
    assert int(told[0].split()[-2].replace(",", "")) > 0
    assert resumed.to_json() == pp.monte_carlo(MODEL, samples=40 * BLOCK).to_json()


def test_places_where_no_journal_can_be(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    for name, message in (
        ("", "cannot write the journal : No such file"),
        ("no/such/folder", "No such file or directory"),
        (".", "Is a directory"),
        ("pipe", "it is not a regular file"),
        ("a\0b", "embedded null"),
        ("x" * 300, "File name too long"),
    ):
        with pytest.raises(OutputError, match=message):
            pp.monte_carlo(MODEL, samples=10, journal=name, resume=True)
    assert os.listdir() == ["pipe"]


# other runs, other processes -----------------------------------------------------------------------------------------


def test_a_journal_in_use_is_refused(whole: bytes, file: Path) -> None:
    with opened_by(file), pytest.raises(InputError, match=r"the journal .* is in use by another run"):
        state_in(file)
    held = subprocess.Popen(
        [sys.executable, "-c", "import fcntl,sys\nf=open(sys.argv[1])\nfcntl.flock(f,2)\nprint(1,flush=True)\ninput()", file],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    )  # fmt: skip
    try:
        assert held.stdout is not None
        held.stdout.readline()
        with pytest.raises(InputError, match="in use by another run"):
            state_in(file)
    finally:
        held.kill()
        held.communicate()
    assert_same_bits(state_in(file), STATES[-1])  # the lock went with the process
    assert file.read_bytes() == whole


def test_every_part_of_the_identity_counts(whole: bytes, file: Path) -> None:
    for other, told in (
        ({**IDENTITY, "seed": "0x"}, "seed was '0', is '0x'"),
        ({**IDENTITY, "the error model": "x"}, "the error model has changed"),
        ({"seed": "0"}, "the error model has changed"),
        ({**IDENTITY, "the moon": "full"}, "the moon has changed"),
    ):
        with pytest.raises(InputError, match=f"belongs to another run: {told}$"), opened_by(file, identity=other):
            pass
    assert file.read_bytes() == whole


@pytest.mark.slow
def test_the_identity_tells_runs_apart(monkeypatch, tmp_path: Path) -> None:
    robot = AT.posture.chain.robot.file
    names = identity(work(), AT.posture, {"URDF": robot})

    def changed(task=None, posture=AT.posture, file=robot) -> set[str]:
        now = identity(task or work(), posture, {"URDF": file})
        return {line.split(" was ")[0].removesuffix(" has changed") for line in differences(names, now)}

    layout = work().layout
    draws = layout.space.draws
    softer = replace(layout.space, draws=(replace(draws[0], law=pp.Uniform(2e-3)), *draws[1:]))
    arms = layout.motions.arms.copy()
    arms[0, 0] += 1e-15
    other = tmp_path / "other.urdf"
    other.write_text(Path(robot).read_text("utf-8") + "<!-- -->", "utf-8")
    for now, expected in (
        (changed(), set()),
        (changed(work(1)), {"seed"}),
        (changed(work(samples=9)), {"samples"}),
        (changed(work(model="linear")), {"model"}),
        (changed(work(plan=replace(PLAN, specifications=()))), {"specifications"}),
        (changed(work(plan=replace(PLAN, centre=PLAN.centre + 1e-9))), {"the planned centres and scales"}),
        (changed(work(layout=replace(layout, space=softer))), {"the error model"}),
        (changed(work(layout=replace(layout, motions=layout.motions._replace(arms=arms)))), {"the error model"}),
        (changed(posture=MODEL.chain.at([0, 0, 1, 0])), {"pose"}),
        (changed(file=other), {"the URDF"}),
    ):
        assert now == expected
    codegen = journal_module.cpu_target.target_context.codegen()
    triple, processor, features = codegen.magic_tuple()
    for where, name, value, expected in (
        (journal_module, "BLOCK", 1 << 15, {"block"}),
        (journal_module.loops, "__file__", str(other), {"the sampler's code"}),
        (type(codegen), "magic_tuple", lambda _: (triple, "386", features), {"machine"}),
        (type(codegen), "magic_tuple", lambda _: (triple, processor, features + ",+x"), {"the processor's features"}),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(where, name, value)
            assert changed() == expected
    monkeypatch.setattr(journal_module, "versions", lambda: {"numba": "0"})
    assert "numba" in changed()


def test_digests_tell_apart_what_looks_alike() -> None:
    values = [0, 0.0, -0.0, False, None, "0", "", (), (0,), ((0,),), ("a", "b"), ("ab",), ("ab", ""), {"a": "b"},
              np.zeros(1), np.zeros((1, 1)), np.zeros(1, dtype=int), np.zeros(2), pp.Scope.UNIT, pp.Scope.POSE,
              pp.Uniform(1.0), pp.Uniform(2.0), pp.Normal(1.0), pp.Uniform(1.0, 0.5)]  # fmt: skip
    assert len({digest(value) for value in values}) == len(values)
    assert digest(np.arange(6.0).reshape(2, 3)) == digest(np.asfortranarray(np.arange(6.0).reshape(2, 3)))


# runs ----------------------------------------------------------------------------------------------------------------


class Stopping:
    """Progress function that ends the run after a number of samples."""

    def __init__(self, after: int, error: BaseException) -> None:
        self.left, self.error = after, error

    def __call__(self, count: int) -> None:
        self.left -= count
        if self.left <= 0:
            raise self.error


@pytest.mark.slow
@pytest.mark.parametrize(
    ("first", "then"),
    [
        ({"threads": 3}, {"executor": Muddled(), "tasks_under_way": 3}),
        ({"executor": Muddled(), "tasks_under_way": 4}, {"threads": 2}),
    ],
)
def test_an_interrupted_run_goes_on_with_any_workers(file: Path, first, then) -> None:
    settings = {"samples": 25 * BLOCK + 77, "seed": 3, "specifications": PLAN.specifications}
    whole = pp.monte_carlo(MODEL, "paper", **settings).to_json()
    with pytest.raises(KeyboardInterrupt) as stopped:
        pp.monte_carlo(MODEL, "paper", journal=file, progress=Stopping(1, KeyboardInterrupt()), **first, **settings)
    held = int(stopped.value.__notes__[0].split("holds the first ")[1].split()[0].replace(",", ""))
    assert stopped.value.__notes__ == [f"the journal {file} holds the first {held:,} of {25 * BLOCK + 77:,} samples"]
    size = 3  # an eighth of the blocks
    assert held >= size * BLOCK * 2  # what was under way too
    told: list[str] = []
    counted: list[int] = []
    resumed = pp.monte_carlo(
        MODEL, "paper", journal=file, resume=True, tell=told.append, progress=counted.append, **then, **settings
    )
    assert told == [f"the journal {file} holds the first {held:,} samples"]
    assert counted[0] == held
    assert sum(counted) == 25 * BLOCK + 77
    assert resumed.to_json() == whole
    never = Foreign(Muddled(), 1)
    again = pp.monte_carlo(MODEL, "paper", journal=file, resume=True, executor=never._executor, **settings)
    assert again.to_json() == whole
    assert never._executor.order == []  # a finished run is read, not sampled


def test_a_second_interrupt_stops_at_once(file: Path) -> None:
    class Interrupting(Muddled):
        """Executor that raises the second Ctrl-C while its third task is awaited."""

        def submit(self, function, /, *arguments):
            future = super().submit(function, *arguments)
            if arguments[0] == 2:
                future.result = lambda: (_ for _ in ()).throw(KeyboardInterrupt("second"))
            return future

    with opened(file, {}, start(PLAN), SAMPLES, resume=False, tell=print) as (journal, state):
        sampling = Sampling(work(samples=30 * BLOCK), state, Stopping(1, KeyboardInterrupt("first")), journal)
        with pytest.raises(KeyboardInterrupt, match="second"):
            sampling.run(Foreign(Interrupting(), 4), 1)
        assert journal.saved == 0
    assert sampling.state.count == 2 * BLOCK


@pytest.mark.slow
def test_an_error_keeps_what_was_done(file: Path) -> None:
    class Broken(Muddled):
        def submit(self, function, /, *arguments):
            if arguments[0] >= 9:
                raise RuntimeError("cannot schedule new futures\nafter shutdown")
            return super().submit(function, *arguments)

    settings = {"samples": 25 * BLOCK, "seed": 3}
    with pytest.raises(
        InputError, match=r"executor Broken failed: RuntimeError: cannot schedule new futures after shutdown$"
    ):
        pp.monte_carlo(MODEL, "paper", journal=file, executor=Broken(), tasks_under_way=2, **settings)
    told: list[str] = []
    resumed = pp.monte_carlo(MODEL, "paper", journal=file, resume=True, tell=told.append, **settings)
    assert told == [f"the journal {file} holds the first {6 * BLOCK:,} samples"]
    assert resumed.to_json() == pp.monte_carlo(MODEL, "paper", **settings).to_json()


@pytest.mark.slow
def test_a_run_may_end_before_it_began(file: Path) -> None:
    class Never(Muddled):
        def submit(self, function, /, *arguments):
            raise KeyboardInterrupt

    settings = {"samples": 3 * BLOCK, "journal": file}
    with pytest.raises(KeyboardInterrupt) as stopped:
        pp.monte_carlo(MODEL, "paper", executor=Never(), **settings)
    assert "holds the first 0 of" in stopped.value.__notes__[0]
    resumed = pp.monte_carlo(MODEL, "paper", threads=1, resume=True, **settings)
    assert resumed.to_json() == pp.monte_carlo(MODEL, "paper", samples=3 * BLOCK).to_json()


def test_records_are_forced_to_the_disk_before_they_count(file: Path, monkeypatch) -> None:
    events: list[str] = []
    for name in ("pwrite", "fsync", "replace"):
        real = getattr(os, name)
        monkeypatch.setattr(os, name, lambda *a, name=name, real=real: (events.append(name), real(*a))[1])
    monkeypatch.setattr(journal_module, "MOST_RECORDS", 2)
    with opened_by(file) as (journal, _):
        for state in STATES:
            journal.save(state)
    assert events == ["pwrite", "fsync", "fsync", *["pwrite", "fsync"] * 2, "pwrite", "fsync", "replace", "fsync"]


def journal_of(file: Path, *payloads: bytes) -> None:
    """Write a journal of complete records with any contents, by the documented format."""
    heads = [len(data).to_bytes(8, "little") for data in payloads]
    digests = [
        hashlib.blake2b(head + data, digest_size=16).digest() for head, data in zip(heads, payloads, strict=True)
    ]
    file.write_bytes(MAGIC + b"".join(map(b"".join, zip(heads, digests, payloads, strict=True))))


def changed(name: str, member: bytes) -> bytes:
    """Return the last state with one of its arrays replaced by other bytes."""
    before = zipfile.ZipFile(io.BytesIO(zlib.decompress(packed(STATES[-1]))))
    after = io.BytesIO()
    with zipfile.ZipFile(after, "w", zipfile.ZIP_DEFLATED) as archive:
        for known in before.namelist():
            archive.writestr(known, member if known == f"{name}.npy" else before.read(known))
    return zlib.compress(after.getvalue())


def array(values: Any) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, values)
    return buffer.getvalue()


def header_of(shape: tuple[int, ...]) -> bytes:
    """Return the header of an array of any size, without the array."""
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(buffer, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return buffer.getvalue() + bytes(64)


HARM: dict[str, tuple[str, Any]] = {
    "a header of 80 terabytes": ("sums", header_of((10**13,))),
    "a member that inflates to 100 MB": ("sums", bytes(10**8)),
    "another shape": ("sums", np.zeros(3)),
    "another type": ("sums", np.zeros(8, dtype=np.int64)),
    "text": ("sums", np.array(["a"] * 8)),
    "sums that are none": ("sums", np.full(8, np.nan)),
    "fewer than none": ("count", np.array(-5)),
    "a count of others": ("count", np.array(10**15)),
    "a smallest value that is none": ("lowest", np.full(8, np.nan)),
    "a largest value below the smallest": ("highest", np.full(8, -1e9)),
    "more than all inside": ("inside", np.array([301])),
    "largest norms that are none": ("largest", np.full((2, 10), np.nan)),
    "largest norms in ascending order": ("largest", np.tile(np.arange(10.0), (2, 1))),
    "largest norms of no samples": ("largest_units", np.full((2, 10), 2**62)),
}


@pytest.mark.parametrize("harm", HARM)
def test_a_record_made_to_harm_is_refused_at_once(harm: str, file: Path) -> None:
    name, entry = HARM[harm]
    member = entry if isinstance(entry, bytes) else array(entry)
    journal_of(file, json.dumps(IDENTITY).encode(), changed(name, member))
    before, begun = file.read_bytes(), time.perf_counter()
    tracemalloc.start()
    with pytest.raises(InputError, match="the journal's last record cannot be read: ") as refused:
        state_in(file)
    assert tracemalloc.get_traced_memory()[1] < 10 * len(before) + 2_000_000
    tracemalloc.stop()
    assert time.perf_counter() - begun < 1
    assert "\n" not in str(refused.value)
    assert file.read_bytes() == before


@pytest.mark.slow
def test_a_record_that_inflates_without_end_is_refused_at_once(file: Path) -> None:
    inflate = zlib.compressobj(9)
    bomb = b"".join([inflate.compress(bytes(2**20)) for _ in range(64)]) + inflate.flush()
    # so that the bomb is no longer than a state may be
    small = replace(EMPTY, sketch=np.zeros((8, 2000), dtype=np.int64))
    tracemalloc.start()
    with pytest.raises(InputError, match="cannot be read: it is too long"):
        unpacked(bomb, small, SAMPLES.check)
    assert tracemalloc.get_traced_memory()[1] < 2_000_000
    tracemalloc.stop()


def test_an_identity_made_to_harm_is_refused(file: Path) -> None:
    for harm in (b'{"a":' + b"[" * 100_000, b"[1, 2]", b"\xff\xfe", b'{"seed": 1}', b" " * 2_000_000 + b"{}"):
        journal_of(file, harm, packed(STATES[-1]))
        with pytest.raises(InputError, match=r"the beginning of the journal .* is damaged"):
            state_in(file)


def test_a_record_longer_than_any_state_is_not_read(file: Path) -> None:
    journal_of(file, json.dumps(IDENTITY).encode(), packed(STATES[-1]))
    with file.open("ab") as stream:
        stream.write((10**9).to_bytes(8, "little") + bytes(16))
        stream.truncate(2 * 10**9)  # a file with a hole: it takes no room
    told: list[str] = []
    begun = time.perf_counter()
    assert_same_bits(state_in(file, told), STATES[-1])
    assert time.perf_counter() - begun < 1
    assert "incomplete or damaged" in told[0]
