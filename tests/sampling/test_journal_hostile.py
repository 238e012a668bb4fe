"""Malicious journals: decompression bombs, headers of huge arrays, states that no samples could give."""

from __future__ import annotations

import hashlib
import io
import json
import time
import tracemalloc
import zipfile
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from precision_pin.base.errors import InputError
from precision_pin.sampling.journal import MAGIC, SAMPLES, packed, unpacked
from sampling.cases import assert_same_bits
from sampling.test_journal import EMPTY, IDENTITY, STATES, state_in


def journal_of(file: Path, *payloads: bytes) -> None:
    """Write a journal of complete records with any contents."""
    records = [
        len(data).to_bytes(8, "little")
        + hashlib.blake2b(len(data).to_bytes(8, "little") + data, digest_size=16).digest()
        + data
        for data in payloads
    ]
    file.write_bytes(MAGIC + b"".join(records))


def changed(name: str, member: bytes, method: int = zipfile.ZIP_STORED) -> bytes:
    """Return the last state with one of its arrays replaced by other bytes."""
    before = zipfile.ZipFile(io.BytesIO(zlib.decompress(packed(STATES[-1]))))
    after = io.BytesIO()
    with zipfile.ZipFile(after, "w", method) as archive:
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


MEMBERS: dict[str, tuple[str, bytes, int]] = {
    "a header of 80 terabytes": ("sums", header_of((10**13,)), zipfile.ZIP_STORED),
    "a member that inflates to 100 MB": ("sums", bytes(10**8), zipfile.ZIP_DEFLATED),
    "another shape": ("sums", array(np.zeros(3)), zipfile.ZIP_STORED),
    "another type": ("sums", array(np.zeros(8, dtype=np.int64)), zipfile.ZIP_STORED),
    "text": ("sums", array(np.array(["a"] * 8)), zipfile.ZIP_STORED),
    "sums that are none": ("sums", array(np.full(8, np.nan)), zipfile.ZIP_STORED),
    "fewer than none": ("count", array(np.array(-5)), zipfile.ZIP_STORED),
    "a count of others": ("count", array(np.array(10**15)), zipfile.ZIP_STORED),
    "several counts": ("count", array(np.array([1, 2])), zipfile.ZIP_STORED),
    "a smallest value that is none": ("lowest", array(np.full(8, np.nan)), zipfile.ZIP_STORED),
    "a largest value that is none": ("highest", array(np.full(8, np.nan)), zipfile.ZIP_STORED),
    "an infinite largest value": ("highest", array(np.full(8, np.inf)), zipfile.ZIP_STORED),
    "a largest value below the smallest": ("highest", array(np.full(8, -1e9)), zipfile.ZIP_STORED),
    "largest norms that are none": ("largest", array(np.full((2, 10), np.nan)), zipfile.ZIP_STORED),
    "largest norms in ascending order": ("largest", array(np.tile(np.arange(10.0), (2, 1))), zipfile.ZIP_STORED),
    "largest norms of no samples": ("largest_units", array(np.full((2, 10), 2**62)), zipfile.ZIP_STORED),
}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "run.journal"


@pytest.mark.fast(7)
@pytest.mark.parametrize("name", MEMBERS)
def test_a_record_made_to_harm_is_refused_at_once(name: str, file: Path) -> None:
    journal_of(file, json.dumps(IDENTITY).encode(), changed(*MEMBERS[name]))
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
    small = replace(
        EMPTY, sketch=np.zeros((8, 2000), dtype=np.int64)
    )  # so that the bomb is no longer than a state may be
    tracemalloc.start()
    with pytest.raises(InputError, match="cannot be read: it is too long"):
        unpacked(bomb, small, SAMPLES.check)
    assert tracemalloc.get_traced_memory()[1] < 2_000_000
    tracemalloc.stop()


@pytest.mark.parametrize(
    "identity", [b'{"a":' + b"[" * 100_000, b"[1, 2]", b"\xff\xfe", b'{"seed": 1}', b" " * 2_000_000 + b"{}", b"nan"]
)
def test_an_identity_made_to_harm_is_refused(identity: bytes, file: Path) -> None:
    journal_of(file, identity, packed(STATES[-1]))
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
