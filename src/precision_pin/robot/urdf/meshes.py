"""Mesh files of a URDF: located, read within limits, and checked before any mesh library reads them.

Mesh loaders are known to crash on broken files, or to open any file that a mesh names, so no loader is called here.
"""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final, final
from urllib.parse import unquote

import numpy as np

from precision_pin.base.input_files import is_regular, note_input
from precision_pin.base.text_escape import shown
from precision_pin.robot.urdf.findings import Findings, read_regular_file
from precision_pin.robot.urdf.meshscenes import (
    FARTHEST,
    MOST_TRIANGLES,
    BrokenMeshError,
    Companion,
    check_collada,
    check_glb,
    check_gltf,
    check_numbers,
)

MOST_BYTES: Final = 64 * 1024 * 1024
MOST_TEXT_BYTES: Final = 32 * 1024 * 1024
STL_HEADER, STL_TRIANGLE = 84, 50
PLY_SIZES = {
    "char": "b", "int8": "b", "uchar": "B", "uint8": "B", "short": "h", "int16": "h", "ushort": "H", "uint16": "H",
    "int": "i", "int32": "i", "uint": "I", "uint32": "I", "float": "f", "float32": "f", "double": "d", "float64": "d",
}  # fmt: skip
WORD: Final = re.compile(rb"\S+")


SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://(.*)", re.DOTALL)
LONGEST_NAME = 4096


@final
@dataclass(frozen=True, eq=False)
class MeshFile:
    """A mesh file whose contents agree with its header: its suffix, the whole file, and the files that it names.

    ``companions`` are those that were read: buffers of a glTF, material files of an OBJ; never images.
    """

    kind: str
    data: bytes
    companions: Mapping[str, bytes]


def read_mesh(path: Path) -> MeshFile:
    """Return a mesh file with a suffix of `MESH_KINDS` after checking it; `BrokenMeshError` where it cannot be used."""
    companions: dict[str, bytes] = {}

    def companion(name: str) -> bytes:
        companions[name] = _read_companion(path, name)
        return companions[name]

    kind = path.suffix.lower()
    data = _read(path, "")
    if not data:
        raise BrokenMeshError("is empty")
    try:
        MESH_KINDS[kind](data, companion)
    except (struct.error, ValueError, IndexError, KeyError, TypeError, AttributeError, OverflowError):
        raise BrokenMeshError("is cut short or garbled") from None
    return MeshFile(kind, data, companions)


def _read(path: Path, what: str) -> bytes:
    findings = Findings(str(path))
    data = read_regular_file(path, findings, most_bytes=MOST_BYTES)
    if data is None:
        reason = findings.result()[0]
        raise BrokenMeshError(
            f"is over {MOST_BYTES} bytes" if reason.code == "E_TOO_BIG" else f"{what}{reason.message}"
        )
    return data


def _read_companion(path: Path, name: str) -> bytes:
    """Return a file that a mesh names: one only one in the mesh's own folder or below it is read."""
    written = unquote(name).replace("\\", "/")
    inside = PurePosixPath(written)
    folder = path.resolve().parent
    real = (folder / inside).resolve()
    if "://" in written or inside.is_absolute() or ".." in inside.parts or not real.is_relative_to(folder):
        raise BrokenMeshError(f"names a file outside its folder: {shown(name)}")
    return _read(real, f"names {shown(name)}: ")


def _check_stl(data: bytes, companion: Companion) -> None:
    if len(data) >= STL_HEADER:
        count = int.from_bytes(data[80:84], "little")
        if len(data) == STL_HEADER + STL_TRIANGLE * count:
            _check_binary_stl(data, count)
            return
    if data.lstrip()[:5].lower() != b"solid" or b"vertex" not in data:
        if len(data) < STL_HEADER:
            raise BrokenMeshError("is too short for an STL file")
        fitting = (len(data) - STL_HEADER) / STL_TRIANGLE
        raise BrokenMeshError(f"claims {count} triangles, but its size fits {fitting:g}")
    for line in _lines(data):
        words = line.split()
        if words and words[0] == "vertex":
            _check_point(words[1:4])


def _check_binary_stl(data: bytes, count: int) -> None:
    if count == 0:
        raise BrokenMeshError("holds no triangles")
    triangles = np.frombuffer(data, np.dtype([("numbers", "<f4", 12), ("spare", "<u2")]), count, STL_HEADER)
    check_numbers(triangles["numbers"][:, 3:])


def _lines(data: bytes) -> list[str]:
    if len(data) > MOST_TEXT_BYTES:
        raise BrokenMeshError(f"is text of over {MOST_TEXT_BYTES} bytes")
    return data.decode("latin-1").splitlines()


def _check_obj(data: bytes, companion: Companion) -> None:
    seen = {"v": 0, "vt": 0, "vn": 0}
    lowest, highest = 1, 0
    others = {"vt": 0, "vn": 0}
    for line in _lines(data):
        words = line.split()
        if not words:
            continue
        if words[0] == "v":
            _check_point(words[1:4])
            seen["v"] += 1
        elif words[0] in others:
            seen[words[0]] += 1
        elif words[0] == "f":
            corners = [int(word.partition("/")[0]) for word in words[1:]]
            for word in words[1:]:
                for kind, part in zip(others, word.split("/")[1:], strict=False):
                    others[kind] = max(others[kind], abs(int(part or 0)))
            if len(corners) < 3:
                raise BrokenMeshError("holds a face with fewer than three corners")
            # negative indices count backwards from the vertices seen so far
            corners = [corner if corner > 0 else seen["v"] + 1 + corner for corner in corners]
            lowest, highest = min(lowest, *corners), max(highest, *corners)
        elif words[0] == "mtllib":
            _read_materials(line.split(None, 1)[1].strip(), companion)
    if not highest and lowest == 1:
        raise BrokenMeshError("holds no faces")
    if lowest < 1 or highest > seen["v"]:
        raise BrokenMeshError(f"holds face indices outside its {seen['v']} vertices")
    if any(largest > seen[kind] for kind, largest in others.items()):
        raise BrokenMeshError("holds face indices outside its texture points or normals")


def _read_materials(name: str, companion: Companion) -> None:
    try:
        companion(name)
    except BrokenMeshError as problem:
        if "there is no file" not in str(problem):
            raise


def _check_point(words: Sequence[str]) -> None:
    values = [float(word) for word in words]
    if len(values) < 3:
        raise BrokenMeshError("holds vertices of fewer than three coordinates")
    if not all(abs(value) <= FARTHEST for value in values):  # a million lines: arrays only to say what is wrong
        check_numbers(values)


def _check_ply(data: bytes, companion: Companion) -> None:
    end = data.find(b"end_header")
    if not data.startswith(b"ply") or end < 0:
        raise BrokenMeshError("has no PLY header")
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
        if len(data) > MOST_TEXT_BYTES:
            raise BrokenMeshError(f"is text of over {MOST_TEXT_BYTES} bytes")
        reader = _PlyReader(values=(float(word[0]) for word in WORD.finditer(data, body)))
    elif kind in ("binary_little_endian", "binary_big_endian"):
        reader = _PlyReader(data=data, at=body, order="<" if "little" in kind else ">")
    else:
        raise BrokenMeshError("is of an unknown PLY format")
    vertices = next((count for name, count, _ in elements if name == "vertex"), 0)
    for name, count, properties in elements:
        if count < 0 or count > len(data):
            raise BrokenMeshError(f"claims {count} of {name}, more than its size can hold")
        if not properties:
            continue
        if all(words[0] != "list" for words in properties) and reader.takes_rows(name, count, properties):
            continue
        if count > MOST_TRIANGLES:
            raise BrokenMeshError(f"holds {count} of {name}; up to {MOST_TRIANGLES} are read")
        for _ in range(count):
            _check_ply_row(reader, name, properties, vertices)
    reader.finish()


def _check_ply_row(reader: _PlyReader, name: str, properties: list[list[str]], vertices: int) -> None:
    for words in properties:
        if words[0] != "list":
            value = reader.next(words[0])
            if name == "vertex" and words[-1] in ("x", "y", "z") and not abs(value) <= FARTHEST:
                check_numbers(value)
            continue
        length = int(reader.next(words[1]))
        is_face = words[-1] in ("vertex_indices", "vertex_index")
        if is_face and length < 3:
            raise BrokenMeshError(f"holds a face with {length} corners")
        for _ in range(length):
            index = reader.next(words[2])
            if is_face and not 0 <= index < vertices:
                raise BrokenMeshError(f"holds face indices outside its {vertices} vertices")


class _PlyReader:
    """Reader of the numbers of a PLY body, one after the other."""

    def __init__(
        self, *, values: Iterator[float] | None = None, data: bytes = b"", at: int = 0, order: str = "<"
    ) -> None:
        self._values, self._data, self._at, self._order = values, data, at, order

    def next(self, kind: str) -> float:
        if self._values is not None:
            value = next(self._values, None)
            if value is None:
                raise BrokenMeshError("is cut short")
            return value
        code = _ply_code(kind)
        number: float = struct.unpack_from(self._order + code, self._data, self._at)[0]
        self._at += struct.calcsize(self._order + code)
        return number

    def takes_rows(self, name: str, count: int, properties: list[list[str]]) -> bool:
        """Check rows of plain numbers all at once and skip them; return False if the body is text."""
        if self._values is not None:
            return False
        fields = [(f"{k} {words[-1]}", self._order + _ply_code(words[0])) for k, words in enumerate(properties)]
        kind = np.dtype(fields)
        if self._at + count * kind.itemsize > len(self._data):
            raise BrokenMeshError(f"claims {count} of {name}, more than its size can hold")
        rows = np.frombuffer(self._data, kind, count, self._at)
        for field, _ in fields:
            if name == "vertex" and field.rpartition(" ")[2] in ("x", "y", "z"):
                check_numbers(rows[field])
        self._at += count * kind.itemsize
        return True

    def finish(self) -> None:
        rest = self._data[self._at :] if self._values is None else b""
        if rest.strip(b"\r\n\0"):
            raise BrokenMeshError(f"holds {len(rest)} bytes after its end")


def _ply_code(kind: str) -> str:
    code = PLY_SIZES.get(kind)
    if code is None:
        raise BrokenMeshError(f"holds numbers of an unknown kind {shown(kind)}")
    return code


MESH_KINDS: Final[Mapping[str, Callable[[bytes, Companion], None]]] = {
    ".stl": _check_stl,
    ".obj": _check_obj,
    ".glb": check_glb,
    ".gltf": check_gltf,
    ".dae": check_collada,
    ".ply": _check_ply,
}


def locate_mesh(filename: str, folder: Path, package_dirs: Sequence[Path] = ()) -> Path | None:
    """Return the path of a mesh named in a URDF, which need not exist; None for an unknown package or scheme.

    The name is a path, ``file://…`` or ``package://NAME/…``; relative paths start at the URDF's folder. A package is searched
    for among ``package_dirs`` (each a package or a folder of packages), then in the folders above, and beside those.
    """
    match = SCHEME.fullmatch(filename)
    if match is None:
        return folder / filename
    scheme, rest = match[1].lower(), match[2]
    if scheme == "file":
        return Path(rest)
    if scheme != "package":
        return None
    name, _, inside = rest.partition("/")
    if not name or name in (".", ".."):
        return None
    package = _package(name, folder, package_dirs)
    return None if package is None else package / inside


def _package(name: str, folder: Path, package_dirs: Sequence[Path]) -> Path | None:
    for directory in package_dirs:
        for candidate in (directory / name, directory):
            if candidate.name == name and candidate.is_dir():
                return candidate
    for above in (folder, *folder.parents)[:-1]:
        if above.name == name:
            return above
        if (above / name / "package.xml").is_file():
            return above / name
    return None


@final
class MeshFiles:
    """Checker of the mesh files that a URDF in ``folder`` names, each once: ``W_MESH_PATH``, ``W_MESH_MISSING``, ``W_MESH_BAD``.

    ``look_inside`` reads the files; otherwise only their existence and kind are checked.
    """

    def __init__(self, findings: Findings, folder: Path, package_dirs: Sequence[Path], *, look_inside: bool) -> None:
        self._findings = findings
        self._folder = Path(os.path.realpath(folder))
        self._package_dirs = [Path(os.path.realpath(directory)) for directory in package_dirs]
        self._look_inside = look_inside
        self._allowed = self._allowed_folders()
        self._seen: set[str] = set()

    def check(self, filename: str, owner: str, line: int) -> None:
        """Check one mesh; any problem becomes a warning."""
        if filename in self._seen:
            return
        self._seen.add(filename)
        match = SCHEME.fullmatch(filename)
        scheme = "" if match is None else match[1].lower()
        label = f"{owner}: mesh {shown(filename)}"
        if scheme not in ("", "file", "package"):
            message = f"{label} is not a local file; it is not fetched"
            self._findings.add("W_MESH_PATH", message, line)
            return
        if scheme == "package" and _leaves_its_package(filename):
            self._findings.add("W_MESH_PATH", f"{label} leaves its package; it is not opened", line)
            return
        try:
            path = locate_mesh(filename, self._folder, self._package_dirs)
            if path is not None:
                note_input(path)
            if path is None:
                package = filename[len("package://") :].partition("/")[0]
                message = f"mesh package {shown(package)} is not found; give its folder (--package-dir)"
                self._findings.group("W_MESH_MISSING", message, owner, line)
                return
            self._check_path(path, label, line, in_package=scheme == "package")
        except (OSError, ValueError) as problem:
            self._findings.add("W_MESH_MISSING", f"{label} cannot be looked up: {problem}", line)

    def _check_path(self, path: Path, label: str, line: int, *, in_package: bool) -> None:
        if len(str(path)) > LONGEST_NAME:
            self._findings.add("W_MESH_MISSING", f"{label} has too long a name", line)
            return
        real = Path(os.path.realpath(path))
        package = _package_root(path, self._folder, self._package_dirs) if in_package else None
        allowed = [*self._allowed, *([package] if package else [])]
        if not any(real.is_relative_to(folder) for folder in allowed):
            message = f"{label} is outside the folders of this robot; it is not opened"
            self._findings.add("W_MESH_PATH", message, line)
            return
        try:
            status = os.stat(real)
        except (FileNotFoundError, NotADirectoryError):
            self._findings.add("W_MESH_MISSING", f"{label} does not exist", line)
            return
        if not is_regular(status):
            self._findings.add("W_MESH_BAD", f"{label} is not a regular file", line)
        elif real.suffix.lower() not in MESH_KINDS:
            kinds = ", ".join(sorted(MESH_KINDS))
            self._findings.add("W_MESH_BAD", f"{label} is of an unknown kind; known: {kinds}", line)
        elif self._look_inside:
            try:
                read_mesh(real)
            except BrokenMeshError as problem:
                self._findings.add("W_MESH_BAD", f"{label}: {problem}", line)

    def _allowed_folders(self) -> list[Path]:
        """Return the URDF's folder, the one above (``../meshes``), its ROS package, and the given ones."""
        allowed = [self._folder, *self._package_dirs]
        above = self._folder.parent
        if above != Path(above.anchor):
            allowed.append(above)
        packages = (folder for folder in self._folder.parents if (folder / "package.xml").is_file())
        package = next(packages, None)
        return allowed if package is None else [*allowed, package]


def _leaves_its_package(filename: str) -> bool:
    """Return whether a ``package://`` name leads out of its package, which need not exist."""
    depth = 0
    for part in filename[len("package://") :].split("/"):
        depth += -1 if part == ".." else part not in ("", ".")
        if depth < 1:
            return part not in ("", ".")
    return False


def _package_root(path: Path, folder: Path, package_dirs: Sequence[Path]) -> Path | None:
    """Return the package a located path was built from: the nearest folder above with a package.xml."""
    for above in path.parents:
        if (above / "package.xml").is_file() or above in package_dirs:
            return Path(os.path.realpath(above))
        if above == folder:
            return above
    return None
