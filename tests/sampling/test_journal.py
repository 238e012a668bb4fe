"""File of the journal: incomplete ends, flipped bits, full disks, other runs, other processes, files made to harm."""

import errno
import hashlib
import itertools
import json
import os
import resource
import subprocess
import sys
import threading
import time
import tracemalloc
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
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
from precision_pin.sampling.one_pose import sample_blocks
from precision_pin.sampling.run import Run
from precision_pin.sampling.workers import ExecutorWorkers
from precision_pin.statistics import State, start
from precision_pin.statistics.accumulate import LARGEST
from sampling.cases import AT, MODEL, PLAN, Muddled, assert_same_bits, work

IDENTITY = {"seed": "0", "the error model": "ab12"}


BEGINNING = start(PLAN)
NARROW = {**vars(BEGINNING), "sketch": BEGINNING.sketch[:, :3]}


def small_state(count: int) -> State:
    """Return a state whose sketch is narrow, so that a file of it is short."""
    generator = np.random.default_rng(count)
    filled = {
        name: generator.integers(0, 99, entry.shape).astype(entry.dtype)
        for name, entry in NARROW.items()
        if isinstance(entry, np.ndarray)
    }
    filled["sketch"] = np.eye(1, 3, dtype=filled["sketch"].dtype) * np.full((8, 1), count)
    # what samples could give: so many kept a limit, the largest norms in order and the others none
    filled["inside"] = np.minimum(filled["inside"], count)
    filled["highest"] += filled["lowest"]
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
    ends = record_ends(whole)
    assert (len(ends), ends[-1]) == (4, len(whole))
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
        # all that was before the damage
        before = sum(end <= place for end in ends[1:])
        assert_same_bits(state_in(file, told), [EMPTY, *STATES][before])
        assert "incomplete or damaged and are ignored" in told[0]


def test_other_files_are_left_as_they_are(file: Path) -> None:
    for contents in (b"precision-pin: 1\nrobot: 4dof.urdf\n", b"x", MAGIC.replace(b"2", b"3") + b"x" * 999):
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
    assert max(sizes) < 1.1 * max(sizes[:5])
    assert len(record_ends(file.read_bytes())) <= 6
    assert_same_bits(state_in(file), small_state(13))
    assert sorted(os.listdir(file.parent)) == [file.name]


@pytest.mark.slow
def test_pauses_grow_with_the_run(file: Path, monkeypatch, no_waiting_for_disks) -> None:
    now = 0.0
    monkeypatch.setattr(journal_module.time, "monotonic", lambda: now)
    saved = []
    with opened_by(file) as (journal, _):
        for tick in range(1, 8_000):  # the pauses are the longest from 6000 s on
            now, before = float(tick), journal.saved
            journal.save_if_due(replace(EMPTY, count=tick))
            if journal.saved != before:
                saved.append(now)
    gaps = np.diff(saved)
    assert (saved[0], gaps.min(), gaps.max()) == (2.0, 2.0, 60.0)
    assert (gaps <= np.clip(np.array(saved[1:]) / 100, 2.0, 60.0) + 1).all()


# disks ---------------------------------------------------------------------------------------------------------------


@contextmanager
def full_after(room: int) -> Iterator[None]:
    """Simulate a disk that is full after a number of further bytes."""
    real, left = os.pwrite, [room]

    def pwrite(descriptor: int, data: bytes, offset: int) -> int:
        if not left[0]:
            raise OSError(errno.ENOSPC, "No space left on device")
        written = real(descriptor, data[: left[0]], offset)
        left[0] -= written
        return written

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(os, "pwrite", pwrite)
        yield


def test_a_full_disk_loses_nothing(whole: bytes, file: Path, monkeypatch) -> None:
    message = r"cannot write the journal .*: No space left on device; it holds the first 300 samples, from"
    for most, room in itertools.product((journal_module.MOST_RECORDS, 3), (0, 23, 25, 300)):  # added to, or replaced
        monkeypatch.setattr(journal_module, "MOST_RECORDS", most)
        file.write_bytes(whole)
        with opened_by(file) as (journal, _):
            with full_after(room), pytest.raises(OutputError, match=message):
                journal.save(small_state(400))
            assert file.read_bytes() == whole
            journal.save(small_state(500))  # there is room again
        assert_same_bits(state_in(file), small_state(500))
        assert os.listdir(file.parent) == [file.name]


def test_a_journal_that_cannot_be_begun_leaves_no_file(file: Path) -> None:
    for room in (0, 1, 30):
        with full_after(room), pytest.raises(OutputError, match=r"No space left on device$"):
            state_in(file)
        assert os.listdir(file.parent) == []


@pytest.mark.slow
def test_a_run_that_a_real_limit_of_files_stops_goes_on(file: Path, monkeypatch) -> None:
    """The largest file size of the process allows the beginning and a few states only."""
    for name in ("SHORTEST_PAUSE", "LONGEST_PAUSE", "COST_OF_WRITING"):
        monkeypatch.setattr(journal_module, name, 0)
    before, alive = resource.getrlimit(resource.RLIMIT_FSIZE), threading.active_count()
    resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, before[1]))
    settings, told = {"samples": 20 * BLOCK, "journal": file}, []
    try:
        with pytest.raises(OutputError, match=r"cannot write the journal .*: File too large; it holds the first"):
            pp.monte_carlo(MODEL, threads=2, **settings)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert file.stat().st_size <= 300_000
    assert threading.active_count() == alive
    assert pp.monte_carlo(MODEL, **settings, resume=True, tell=told.append).samples == 20 * BLOCK
    assert int(told[0].split()[-2].replace(",", "")) > 0


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
    program = "import fcntl,sys\nf=open(sys.argv[1])\nfcntl.flock(f,2)\nprint(1,flush=True)\ninput()"
    in_use = pytest.raises(InputError, match=r"the journal .* is in use by another run")
    with subprocess.Popen([sys.executable, "-c", program, file], stdin=-1, stdout=-1) as holder:
        holder.stdout.readline()
        with in_use:
            state_in(file)
        holder.kill()
    assert_same_bits(state_in(file), STATES[-1])  # the lock went with the process
    with opened_by(file), in_use:
        state_in(file)
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

    def changed(posture=AT.posture, file=robot, **task) -> str:
        now = identity(work(**task), posture, {"URDF": file})
        return ", ".join(line.split(" was ")[0].removesuffix(" has changed") for line in differences(names, now))

    layout = work().layout
    draws = layout.space.draws
    softer = replace(layout.space, draws=(replace(draws[0], law=pp.Uniform(2e-3)), *draws[1:]))
    arms = layout.motions.arms.copy()
    arms[0, 0] += 1e-15
    other = tmp_path / "other.urdf"
    other.write_text(Path(robot).read_text("utf-8") + "<!-- -->", "utf-8")
    for now, expected in (
        (changed(), ""),
        (changed(seed=1), "seed"),
        (changed(samples=9), "samples"),
        (changed(model="linear"), "model"),
        (changed(plan=replace(PLAN, specifications=())), "specifications"),
        (changed(plan=replace(PLAN, centre=PLAN.centre + 1e-9)), "the planned centres and scales"),
        (changed(layout=replace(layout, space=softer)), "the error model"),
        (changed(layout=replace(layout, motions=layout.motions._replace(arms=arms))), "the error model"),
        (changed(posture=MODEL.chain.at([0, 0, 1, 0])), "pose"),
        (changed(file=other), "the URDF"),
    ):
        assert now == expected
    codegen = journal_module.cpu_target.target_context.codegen()
    triple, processor, features = codegen.magic_tuple()
    for where, name, value, expected in (
        (journal_module, "BLOCK", 1 << 15, "block"),
        (journal_module.loops, "__file__", str(other), "the sampler's code"),
        (type(codegen), "magic_tuple", lambda _: (triple, "386", features), "machine"),
        (type(codegen), "magic_tuple", lambda _: (triple, processor, features + ",+x"), "the processor's features"),
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


def stopping(error: BaseException) -> Any:
    """Return a progress function that ends the run."""

    def progress(count: int) -> None:
        raise error

    return progress


@pytest.mark.slow
def test_an_interrupted_run_goes_on_with_other_workers(file: Path) -> None:
    samples = 25 * BLOCK + 77
    settings = {"samples": samples, "seed": 3, "specifications": PLAN.specifications}
    whole = pp.monte_carlo(MODEL, "paper", **settings).to_json()
    first = {"executor": Muddled(), "tasks_under_way": 4, "progress": stopping(KeyboardInterrupt())}
    with pytest.raises(KeyboardInterrupt) as stopped:
        pp.monte_carlo(MODEL, "paper", journal=file, **first, **settings)
    held = 4 * 3 * BLOCK  # tasks of an eighth of the blocks; what was under way too
    assert stopped.value.__notes__ == [f"the journal {file} holds the first {held:,} of {samples:,} samples"]
    told: list[str] = []
    counted: list[int] = []
    then = {"threads": 2, "tell": told.append, "progress": counted.append}
    assert pp.monte_carlo(MODEL, "paper", journal=file, resume=True, **then, **settings).to_json() == whole
    assert told == [f"the journal {file} holds the first {held:,} samples"]
    assert (counted[0], sum(counted)) == (held, samples)
    never = Muddled()
    again = pp.monte_carlo(MODEL, "paper", journal=file, resume=True, executor=never, **settings)
    assert again.to_json() == whole
    assert never.order == []  # a finished run is read, not sampled


def test_a_second_interrupt_stops_at_once(file: Path) -> None:
    class Interrupting(Muddled):
        """Executor that raises the second Ctrl-C while its third task is awaited."""

        def submit(self, function, /, *arguments):
            future = super().submit(function, *arguments)
            if arguments[0] == 2:
                future.result = lambda: (_ for _ in ()).throw(KeyboardInterrupt("second"))
            return future

    with opened(file, {}, start(PLAN), SAMPLES, resume=False, tell=print) as (journal, state):
        run = Run(ExecutorWorkers(Interrupting(), 4), stopping(KeyboardInterrupt("first")), state, journal)
        with pytest.raises(KeyboardInterrupt, match="second"):
            sample_blocks(run, work(samples=30 * BLOCK), 1)
        assert journal.saved == 0
    assert run.state.count == 2 * BLOCK


@pytest.mark.slow
def test_an_error_keeps_what_was_done_even_if_nothing_was(tmp_path: Path) -> None:
    class Broken(Muddled):
        def submit(self, function, /, *arguments):
            if arguments[0] >= self.first:
                raise self.error
            return super().submit(function, *arguments)

    settings = {"samples": 25 * BLOCK, "seed": 3}
    whole = pp.monte_carlo(MODEL, "paper", **settings).to_json()
    for first, blocks, error, raised, says in (
        (9, 6, RuntimeError("no new\nfutures"), InputError, r"executor Broken failed: RuntimeError: no new futures$"),
        (0, 0, KeyboardInterrupt(), KeyboardInterrupt, None),
    ):
        Broken.first, Broken.error, told = first, error, []
        saved = {**settings, "journal": tmp_path / f"{first}.journal"}
        with pytest.raises(raised, match=says) as stopped:
            pp.monte_carlo(MODEL, "paper", executor=Broken(), tasks_under_way=2, **saved)
        assert blocks or "holds the first 0 of" in stopped.value.__notes__[0]
        assert pp.monte_carlo(MODEL, "paper", resume=True, tell=told.append, **saved).to_json() == whole
        assert told[0].endswith(f"holds the first {blocks * BLOCK:,} samples")


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
    records = []
    for data in payloads:
        head = len(data).to_bytes(8, "little")
        records += [head, hashlib.blake2b(head + data, digest_size=16).digest(), data]
    file.write_bytes(MAGIC + b"".join(records))


def arrays_of(record: bytes) -> dict[str, np.ndarray]:
    """Return the arrays of a record by name, by the documented format."""
    plain = zlib.decompress(record)
    listed, begin = json.JSONDecoder().raw_decode(plain.decode("latin-1"))
    arrays = {}
    for name, kind, shape in listed:
        arrays[name] = np.frombuffer(plain, kind, int(np.prod(shape)), begin).reshape(shape)
        begin += arrays[name].nbytes
    assert begin == len(plain)
    return arrays


def record_of(arrays: dict[str, np.ndarray], **claimed: tuple[int, ...]) -> bytes:
    """Return a record of arrays, of which some may claim another shape."""
    listed = [(name, array.dtype.str, claimed.get(name, array.shape)) for name, array in arrays.items()]
    return zlib.compress(json.dumps(listed).encode() + b"".join(array.tobytes() for array in arrays.values()))


def changed(name: str, array: np.ndarray, *claimed: int) -> bytes:
    """Return the last state with one of its arrays replaced, which may claim another shape."""
    return record_of({**arrays_of(packed(STATES[-1])), name: array}, **({name: claimed} if claimed else {}))


HARM: dict[str, tuple[Any, ...]] = {
    "a header of 80 terabytes": ("sums", np.zeros(8), 10**13),
    "an array that inflates a thousandfold": ("sums", np.zeros(200_000)),
    "more bytes than its shape has": ("sums", np.zeros(9), 8),
    "fewer bytes than its shape has": ("sums", np.zeros(7), 8),
    "another shape": ("sums", np.zeros(3)),
    "another shape of as many numbers": ("sums", np.zeros((2, 4))),
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
    journal_of(file, json.dumps(IDENTITY).encode(), changed(*HARM[harm]))
    before, begun = file.read_bytes(), time.perf_counter()
    tracemalloc.start()
    with pytest.raises(InputError, match=r"the journal's last record cannot be read: .*$"):
        state_in(file)
    assert tracemalloc.get_traced_memory()[1] < 10 * len(before) + 2_000_000
    tracemalloc.stop()
    assert time.perf_counter() - begun < 1
    assert file.read_bytes() == before


@pytest.mark.slow
def test_a_state_that_contradicts_its_own_histogram_is_refused(file: Path) -> None:
    """A forged share inside, or mean, or extreme, under a right digest; what bins cannot tell apart is taken."""
    told = {"samples": 4000, "specifications": [pp.specification("37 mm @ 50 %"), pp.specification("x 8 mm @ 50 %")]}
    pp.monte_carlo(MODEL, "paper", journal=file, **told)
    data = file.read_bytes()
    ends = record_ends(data)
    header, last = data[len(MAGIC) + 24 : ends[0]], data[ends[-2] + 24 : ends[-1]]
    errors = pp.monte_carlo(MODEL, "paper", keep_samples=True, samples=4000).errors
    inside = np.array([(np.linalg.norm(errors[:3], axis=0) <= 0.037).sum(), (np.abs(errors[0]) <= 0.008).sum()])
    arrays = arrays_of(last)
    assert (arrays["inside"] == inside).all()
    for name, value in (
        ("inside", [4000, inside[1]]), ("inside", [inside[0], 0]), ("inside", inside - [200, 0]),
        ("sums", arrays["sums"] + 1.0), ("lowest", arrays["lowest"] - 0.01), ("highest", arrays["highest"] + 0.01),
    ):  # fmt: skip
        journal_of(file, header, record_of({**arrays, name: np.array(value, dtype=arrays[name].dtype)}))
        with pytest.raises(InputError, match="its statistics contradict its histograms"):
            pp.monte_carlo(MODEL, "paper", journal=file, resume=True, **told)


@pytest.mark.slow
def test_a_record_that_inflates_without_end_is_refused_at_once() -> None:
    bomb = zlib.compress(bytes(2**24), 9)
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
