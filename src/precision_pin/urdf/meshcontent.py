"""Whether a mesh file is what it claims: counts, indices and numbers checked before any mesh library sees it.

Mesh loaders written in C++ are known to crash on such files, so nothing here calls one.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from xml.parsers import expat

import numpy as np

from .findings import shown

__all__ = ["MESH_KINDS", "mesh_problem"]

MOST_BYTES = 64 * 1024 * 1024
STL_HEADER, STL_TRIANGLE = 84, 50
GLB_HEADER = 12
PLY_SIZES = {
    "char": "b", "int8": "b", "uchar": "B", "uint8": "B", "short": "h", "int16": "h", "ushort": "H", "uint16": "H",
    "int": "i", "int32": "i", "uint": "I", "uint32": "I", "float": "f", "float32": "f", "double": "d", "float64": "d",
}  # fmt: skip


class _Broken(Exception):
    """Carries what is wrong with a mesh file."""


def mesh_problem(path: Path) -> str | None:
    """Return what is wrong with a regular mesh file of a known kind, None where nothing is.

    Parameters
    ----------
    path
        A file whose suffix is in `MESH_KINDS`.
    """
    with path.open("rb") as stream:
        data = stream.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        return f"is over {MOST_BYTES} bytes"
    if not data:
        return "is empty"
    try:
        MESH_KINDS[path.suffix.lower()](data)
    except _Broken as problem:
        return str(problem)
    except (struct.error, ValueError, IndexError, OverflowError):
        return "is cut short or garbled"
    return None


def _check_stl(data: bytes) -> None:
    if len(data) >= STL_HEADER:
        count = int.from_bytes(data[80:84], "little")
        if len(data) == STL_HEADER + STL_TRIANGLE * count:
            _check_binary_stl(data, count)
            return
    if data.lstrip()[:5].lower() != b"solid" or b"vertex" not in data:
        if len(data) < STL_HEADER:
            raise _Broken("is too short for an STL file")
        raise _Broken(f"claims {count} triangles, but its size fits {(len(data) - STL_HEADER) / STL_TRIANGLE:g}")
    for line in data.decode("latin-1").splitlines():
        words = line.split()
        if words and words[0] == "vertex":
            _finite(words[1:4], 3)


def _check_binary_stl(data: bytes, count: int) -> None:
    if count == 0:
        raise _Broken("holds no triangles")
    triangles = np.frombuffer(data, np.dtype([("numbers", "<f4", 12), ("spare", "<u2")]), count, STL_HEADER)
    if not np.isfinite(triangles["numbers"][:, 3:]).all():
        raise _Broken("holds vertices that are not finite")


def _check_obj(data: bytes) -> None:
    vertices = 0
    indices: list[int] = []
    for line in data.decode("latin-1").splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] == "v":
            _finite(words[1:4], 3)
            vertices += 1
        elif words[0] == "f":
            corners = [int(word.partition("/")[0]) for word in words[1:]]
            if len(corners) < 3:
                raise _Broken("holds a face with fewer than three corners")
            # negative indices count backwards from the vertices seen so far
            indices += [corner if corner > 0 else vertices + 1 + corner for corner in corners]
        elif words[0] == "mtllib":
            named = PurePosixPath(line.split(None, 1)[1].strip().replace("\\", "/"))
            if named.is_absolute() or ".." in named.parts:
                raise _Broken(f"names a material file outside its folder: {shown(str(named))}")
    if not indices:
        raise _Broken("holds no faces")
    if min(indices) < 1 or max(indices) > vertices:
        raise _Broken(f"holds face indices outside its {vertices} vertices")


def _finite(words: list[str], count: int) -> None:
    if len(words) < count or not all(math.isfinite(float(word)) for word in words):
        raise _Broken("holds vertices that are not finite")


def _check_glb(data: bytes) -> None:
    magic, version, length = struct.unpack_from("<4sII", data)
    if magic != b"glTF" or version != 2:
        raise _Broken("is not a binary glTF 2 file")
    if length != len(data):
        raise _Broken(f"claims {length} bytes, but has {len(data)}")
    at = GLB_HEADER
    while at < length:
        at += 8 + int(struct.unpack_from("<I", data, at)[0])
    if at != length:
        raise _Broken("holds a chunk that is longer than the file")


def _check_collada(data: bytes) -> None:
    def refuse(*_: object) -> None:
        raise _Broken("holds a DOCTYPE")

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(data, True)
    except expat.ExpatError as problem:
        raise _Broken(f"is not well-formed XML: {problem}") from None
    except LookupError:
        raise _Broken("is of an unknown encoding") from None


def _check_ply(data: bytes) -> None:
    end = data.find(b"end_header")
    if not data.startswith(b"ply") or end < 0:
        raise _Broken("has no PLY header")
    body = data.index(b"\n", end) + 1
    lines = [line.split() for line in data[:end].decode("latin-1").splitlines()]
    kind = next((words[1] for words in lines if words[:1] == ["format"]), "")
    elements: list[tuple[str, int, list[list[str]]]] = []
    for words in lines:
        if words[:1] == ["element"]:
            elements.append((words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            elements[-1][2].append(words[1:])
    if kind == "ascii":
        values: Iterator[float] = map(float, data[body:].split())
        reader = _PlyReader(values=values)
    elif kind in ("binary_little_endian", "binary_big_endian"):
        reader = _PlyReader(data=data, at=body, order="<" if "little" in kind else ">")
    else:
        raise _Broken("is of an unknown PLY format")
    vertices = next((count for name, count, _ in elements if name == "vertex"), 0)
    for name, count, properties in elements:
        if count < 0 or count > len(data):
            raise _Broken(f"claims {count} of {name}, more than its size can hold")
        for _ in range(count):
            _check_ply_row(reader, name, properties, vertices)
    reader.finish()


def _check_ply_row(reader: _PlyReader, name: str, properties: list[list[str]], vertices: int) -> None:
    for words in properties:
        if words[0] != "list":
            value = reader.next(words[0])
            if name == "vertex" and words[-1] in ("x", "y", "z") and not math.isfinite(value):
                raise _Broken("holds vertices that are not finite")
            continue
        length = int(reader.next(words[1]))
        is_face = words[-1] in ("vertex_indices", "vertex_index")
        if is_face and length < 3:
            raise _Broken(f"holds a face with {length} corners")
        for _ in range(length):
            index = reader.next(words[2])
            if is_face and not 0 <= index < vertices:
                raise _Broken(f"holds face indices outside its {vertices} vertices")


class _PlyReader:
    """Hands out the numbers of a PLY body one after the other."""

    def __init__(
        self, *, values: Iterator[float] | None = None, data: bytes = b"", at: int = 0, order: str = "<"
    ) -> None:
        self._values, self._data, self._at, self._order = values, data, at, order

    def next(self, kind: str) -> float:
        if self._values is not None:
            value = next(self._values, None)
            if value is None:
                raise _Broken("is cut short")
            return value
        code = PLY_SIZES.get(kind)
        if code is None:
            raise _Broken(f"holds numbers of an unknown kind {shown(kind)}")
        number: float = struct.unpack_from(self._order + code, self._data, self._at)[0]
        self._at += struct.calcsize(self._order + code)
        return number

    def finish(self) -> None:
        rest = self._data[self._at :] if self._values is None else b""
        if rest.strip(b"\r\n\0"):
            raise _Broken(f"holds {len(rest)} bytes after its end")


def _check_gltf(data: bytes) -> None:
    if not data.lstrip().startswith(b"{"):
        raise _Broken("is not a glTF file")


MESH_KINDS = {
    ".stl": _check_stl,
    ".obj": _check_obj,
    ".glb": _check_glb,
    ".gltf": _check_gltf,
    ".dae": _check_collada,
    ".ply": _check_ply,
}
