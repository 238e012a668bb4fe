"""Mesh files of a URDF: located, read within limits, and checked before any mesh library reads them.

Mesh loaders are known to crash on broken files, or to open any file that a mesh names, so none is called here.
"""

from __future__ import annotations

import base64
import binascii
import json
import os
import re
import struct
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path, PurePosixPath
from typing import Any, Final
from urllib.parse import unquote
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.errors import shown
from precision_pin.base.files import is_regular, note_input
from precision_pin.robot.urdf.xmltree import Findings, read_regular_file

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

Companion = Callable[[str], bytes]
"""Returns the bytes of a file that a mesh names, or raises `BrokenMeshError`."""

MOST_TRIANGLES: Final = 4_000_000
"""Most triangles of a file, counting every instance, and most corners of a list."""
MOST_DEPTH: Final = 200
LONGEST_JSON: Final = 16 * 1024 * 1024
GLB_HEADER: Final = 12
GLB_JSON, GLB_BINARY = 0x4E4F534A, 0x004E4942
NUMBERS: Final = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
FARTHEST: Final = 1e30
"""Coordinate or factor beyond which extents and squares of a mesh may overflow in single or double precision."""
_FLAT: Final = 1e-6
"""Area of a polygon, relative to its longest edge squared, that is rounding."""
WIDTHS: Final = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


class BrokenMeshError(Exception):
    """A mesh file is broken; the message continues a sentence that names the file."""


def check_numbers(numbers: ArrayLike) -> None:
    """Refuse coordinates, or factors of them, too large or not finite."""
    values = np.asarray(numbers, dtype=np.float64)
    if not np.isfinite(values).all():
        raise BrokenMeshError("holds vertices that are not finite")
    if np.abs(values).max(initial=0.0) > FARTHEST:
        raise BrokenMeshError(f"holds vertices farther than {FARTHEST:g} from its origin")


def _is_flat(polygons: ArrayLike) -> bool:
    """Return whether corners ``(N, 3)``, or ``(F, N, 3)`` of several polygons, enclose no area, to single precision."""
    corners = np.asarray(polygons)
    # in blocks, as the first one usually decides
    blocks = [corners] if corners.ndim == 2 else (corners[k : k + 1000] for k in range(0, len(corners), 1000))
    for block in blocks if corners.shape[-2] > 2 else ():
        edges = np.diff(block.astype(np.float64), axis=-2)
        twice = np.abs(np.cross(edges[..., :-1, :], edges[..., 1:, :])).max(axis=(-2, -1))
        if (twice > _FLAT * np.square(edges).max(axis=(-2, -1))).any():
            return False
    return True


def check_glb(data: bytes, companion: Companion) -> bool:
    """Check a binary glTF file; return whether no face has an area."""
    magic, version, length = struct.unpack_from("<4sII", data)
    if magic != b"glTF" or version != 2:
        raise BrokenMeshError("is not a binary glTF 2 file")
    if length != len(data):
        raise BrokenMeshError(f"claims {length} bytes, but has {len(data)}")
    at, chunks = GLB_HEADER, []
    while at < length:
        size, kind = struct.unpack_from("<II", data, at)
        chunks.append((kind, data[at + 8 : at + 8 + size]))
        at += 8 + size
    if at != length:
        raise BrokenMeshError("holds a chunk that is longer than the file")
    if not chunks or chunks[0][0] != GLB_JSON:
        raise BrokenMeshError("does not begin with a JSON chunk")
    binary = chunks[1][1] if len(chunks) > 1 and chunks[1][0] == GLB_BINARY else None
    return _check_gltf_tree(_json(chunks[0][1]), binary, companion)


def check_gltf(data: bytes, companion: Companion) -> bool:
    """Check a glTF file in JSON and the buffers that it names; return whether no face has an area."""
    return _check_gltf_tree(_json(data), None, companion)


def _json(data: bytes) -> dict[str, Any]:
    if len(data) > LONGEST_JSON:
        raise BrokenMeshError(f"holds over {LONGEST_JSON} bytes of JSON")
    try:
        tree = json.loads(data)
    except RecursionError:
        raise BrokenMeshError("is nested too deep") from None
    if not isinstance(tree, dict):
        raise BrokenMeshError("is not a glTF file")
    return tree


def _check_gltf_tree(tree: Mapping[str, Any], binary: bytes | None, companion: Companion) -> bool:
    buffers = []
    for k, buffer in enumerate(tree.get("buffers", [])):
        content = binary if "uri" not in buffer and k == 0 else _from_uri(str(buffer["uri"]), companion)
        if content is None or len(content) < int(buffer["byteLength"]):
            raise BrokenMeshError(f"claims {buffer['byteLength']} bytes in a buffer of {len(content or b'')}")
        buffers.append(content)
    views = [_view(view, buffers) for view in tree.get("bufferViews", [])]
    accessors = [_accessor(accessor, views) for accessor in tree.get("accessors", [])]
    meshes = [
        [_triangles(primitive, accessors) for primitive in mesh.get("primitives", [])]
        for mesh in tree.get("meshes", [])
    ]
    _check_nodes(tree, [sum(map(len, primitives)) for primitives in meshes])
    surfaces = [triangles for primitives in meshes for triangles in primitives if len(triangles)]
    return bool(surfaces) and all(map(_is_flat, surfaces))


def _from_uri(uri: str, companion: Companion) -> bytes:
    if not uri.startswith("data:"):
        return companion(uri)
    try:
        return base64.b64decode(uri.partition(",")[2], validate=True)
    except binascii.Error:
        raise BrokenMeshError("holds garbled data") from None


def _view(view: Mapping[str, Any], buffers: list[bytes]) -> tuple[bytes, int]:
    """Return a view's bytes and its stride, 0 for contiguous rows."""
    start, length = int(view.get("byteOffset", 0)), int(view["byteLength"])
    buffer = buffers[_index(view["buffer"], buffers)]
    if start < 0 or length < 0 or start + length > len(buffer):
        raise BrokenMeshError("holds a view beyond its buffer")
    return buffer[start : start + length], int(view.get("byteStride", 0))


def _index(value: object, items: object) -> int:
    if not isinstance(value, int) or not 0 <= value < len(items):  # type: ignore[arg-type]
        raise BrokenMeshError("refers to a part that it does not hold")
    return value


def _accessor(accessor: Mapping[str, Any], views: list[tuple[bytes, int]]) -> NDArray[Any]:
    count, width = int(accessor["count"]), WIDTHS[accessor["type"]]
    kind = np.dtype(NUMBERS[accessor["componentType"]])
    if not 0 <= count * width <= 4 * MOST_TRIANGLES:
        raise BrokenMeshError(f"claims {count} rows, more than can be read")
    if "bufferView" not in accessor:
        return np.zeros((count, width), kind)
    data, stride = views[_index(accessor["bufferView"], views)]
    start, step = int(accessor.get("byteOffset", 0)), stride or kind.itemsize * width
    if count and (start < 0 or step < 1 or start + step * (count - 1) + kind.itemsize * width > len(data)):
        raise BrokenMeshError(f"claims {count} rows, more than its size can hold")
    return np.ndarray((count, width), kind, data, start, (step, kind.itemsize))


def _triangles(primitive: Mapping[str, Any], accessors: list[NDArray[Any]]) -> NDArray[Any]:
    """Return the corners ``(F, 3, 3)`` of a primitive's triangles, as if it were a list of them."""
    attributes = primitive.get("attributes", {})
    if "POSITION" not in attributes:
        return np.zeros((0, 3, 3))
    corners = accessors[_index(attributes["POSITION"], accessors)]
    check_numbers(corners)
    if "indices" in primitive:
        indices = accessors[_index(primitive["indices"], accessors)]
        if indices.size and not 0 <= int(indices.min()) <= int(indices.max()) < len(corners):
            raise BrokenMeshError(f"holds face indices outside its {len(corners)} vertices")
        corners = corners[indices.ravel()]
    return corners[: len(corners) // 3 * 3].reshape(-1, 3, 3)


def _check_nodes(tree: Mapping[str, Any], triangles: list[int]) -> None:
    """Refuse nodes that are not a forest, as the format requires: readers would follow a circle forever."""
    nodes = tree.get("nodes", [])
    parents: dict[int, int] = {}
    total = 0
    for k, node in enumerate(nodes):
        total += triangles[_index(node["mesh"], triangles)] if "mesh" in node else 0
        for key in ("matrix", "translation", "rotation", "scale"):
            check_numbers(node.get(key, ()))
        for child in node.get("children", []):
            if _index(child, nodes) in parents or child == k:
                raise BrokenMeshError("holds a node with two parents")
            parents[child] = k
    roots = {_index(root, nodes) for scene in tree.get("scenes", []) for root in scene.get("nodes", [])}
    try:
        TopologicalSorter({child: [parent] for child, parent in parents.items()}).prepare()
        in_circle = any(root in parents for root in roots)
    except CycleError:
        in_circle = True
    if in_circle:
        raise BrokenMeshError("holds nodes in a circle")
    if total > MOST_TRIANGLES:
        raise BrokenMeshError(f"holds {total} triangles; up to {MOST_TRIANGLES} are read")


def check_collada(data: bytes, companion: Companion) -> bool:
    """Check a COLLADA file, whose images are not opened; return whether no face has an area."""
    _check_xml(data)
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, RecursionError, LookupError) as problem:
        raise BrokenMeshError(f"is not well-formed XML: {problem}") from None
    for element in root.iter():
        element.tag = str(element.tag).rpartition("}")[2]
    for element in root.iter():
        if element.tag == "unit":
            check_numbers(float(element.get("meter", 1)))
        elif element.tag in ("matrix", "translate", "rotate", "scale", "skew", "lookat"):
            check_numbers([float(word) for word in (element.text or "").split()])
    geometries = {geometry.get("id", ""): _check_geometry(geometry) for geometry in root.iter("geometry")}
    _check_instances(root, {name: count for name, (count, _) in geometries.items()})
    return any(count for count, _ in geometries.values()) and all(is_flat for _, is_flat in geometries.values())


def _check_xml(data: bytes) -> None:
    depth = 0

    def refuse(*_: object) -> None:
        raise BrokenMeshError("holds a DOCTYPE")

    def start(*_: object) -> None:
        nonlocal depth
        depth += 1
        if depth > MOST_DEPTH:
            raise BrokenMeshError("is nested too deep")

    def end(*_: object) -> None:
        nonlocal depth
        depth -= 1

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler, parser.StartElementHandler, parser.EndElementHandler = refuse, start, end
    try:
        parser.Parse(data, True)
    except expat.ExpatError as problem:
        raise BrokenMeshError(f"is not well-formed XML: {problem}") from None
    except LookupError:
        raise BrokenMeshError("is of an unknown encoding") from None


def _check_geometry(geometry: ElementTree.Element) -> tuple[int, bool]:
    """Return the number of triangles, and whether no face has an area."""
    rows = {"#" + source.get("id", ""): _rows(source) for source in geometry.iter("source")}
    for vertices in geometry.iter("vertices"):
        for given in vertices.findall("input"):
            if given.get("semantic") == "POSITION":
                rows["#" + vertices.get("id", "")] = rows.get(given.get("source", ""), np.zeros((0, 3)))
    kinds = ("triangles", "polylist", "polygons", "trifans", "tristrips")
    results = [_check_faces(faces, rows) for kind in kinds for faces in geometry.iter(kind)]
    return sum(count for count, _ in results), all(is_flat for _, is_flat in results)


def _rows(source: ElementTree.Element) -> NDArray[np.float64]:
    array, accessor = source.find("float_array"), source.find("technique_common/accessor")
    if array is None:
        return np.zeros((0, 3))
    numbers = np.array((array.text or "").split(), dtype=float)
    if int(array.get("count", len(numbers))) != len(numbers):
        raise BrokenMeshError(f"claims {shown(array.get('count', ''))} numbers in an array of {len(numbers)}")
    check_numbers(numbers)
    stride = 3 if accessor is None else int(accessor.get("stride", 1))
    count = len(numbers) // max(stride, 1) if accessor is None else int(accessor.get("count", 0))
    if stride < 1 or count < 0 or count * stride > len(numbers):
        raise BrokenMeshError(f"claims {count} rows of {stride} in an array of {len(numbers)}")
    return numbers[: count * stride].reshape(count, stride)


def _check_faces(faces: ElementTree.Element, rows: Mapping[str, NDArray[np.float64]]) -> tuple[int, bool]:
    inputs = [(int(node.get("offset", 0)), rows.get(node.get("source", "")), node) for node in faces.findall("input")]
    width = 1 + max((offset for offset, _, _ in inputs), default=0)
    indices = np.array([word for p in faces.findall("p") for word in (p.text or "").split()], dtype=np.int64)
    if width < 1 or len(indices) % width:
        raise BrokenMeshError("holds faces that are cut short")
    corners = 3 * int(faces.get("count", 0)) if faces.tag == "triangles" else None
    if (vcount := faces.find("vcount")) is not None:
        corners = int(np.array((vcount.text or "").split(), dtype=np.int64).sum())
    if corners is not None and corners * width != len(indices):
        raise BrokenMeshError(f"claims {corners} corners of faces, but holds {len(indices) // width}")
    is_flat = not len(indices)
    for offset, table, node in inputs:
        column = indices[offset::width]
        if column.size and table is not None and not 0 <= int(column.min()) <= int(column.max()) < len(table):
            raise BrokenMeshError(f"holds face indices outside its {len(table)} rows")
        if node.get("semantic") == "VERTEX" and table is not None:
            # of polygons every three successive corners, also from one to the next
            first = np.arange(0, column.size - 2, 3 if faces.tag == "triangles" else 1)
            is_flat = _is_flat(table[column[first[:, None] + np.arange(3)], :3])
    return len(indices) // width // 3, is_flat


def _check_instances(root: ElementTree.Element, geometries: Mapping[str, int]) -> None:
    """Refuse nodes that instance one another in a circle or too often."""
    nodes = {"#" + node.get("id", ""): node for node in root.iter("node") if node.get("id")}
    known: dict[str, int] = {}
    open_nodes: set[str] = set()

    def weight(element: ElementTree.Element) -> int:
        total = 1
        for child in element:
            if child.tag == "instance_geometry":
                total += geometries.get(child.get("url", "").removeprefix("#"), 0)
            elif child.tag == "instance_node":
                total += weight_of(child.get("url", ""))
            elif child.tag == "node":
                total += weight(child)
        if total > MOST_TRIANGLES:
            raise BrokenMeshError(f"holds over {MOST_TRIANGLES} triangles, every instance counted")
        return total

    def weight_of(url: str) -> int:
        if url in open_nodes:
            raise BrokenMeshError("holds nodes in a circle")
        if url not in known and url in nodes:
            open_nodes.add(url)
            known[url] = weight(nodes[url])
            open_nodes.remove(url)
        return known.get(url, 0)

    try:
        for scene in root.iter("visual_scene"):
            weight(scene)
        for url in nodes:
            weight_of(url)
    except RecursionError:
        raise BrokenMeshError("is nested too deep") from None


@dataclass(frozen=True, eq=False)
class MeshFile:
    """A mesh file whose contents agree with its header: suffix, whole file, and the files that it names.

    ``companions`` are those that were read: buffers of a glTF, material files of an OBJ; never images.
    """

    kind: str
    data: bytes
    companions: Mapping[str, bytes]


def read_mesh(path: Path) -> MeshFile:
    """Return a checked mesh file with a suffix of `MESH_KINDS`; raise `BrokenMeshError` if unusable."""
    companions: dict[str, bytes] = {}

    def companion(name: str) -> bytes:
        companions[name] = _read_companion(path, name)
        return companions[name]

    kind = path.suffix.lower()
    data = _read(path, "")
    if not data:
        raise BrokenMeshError("is empty")
    try:
        is_flat = MESH_KINDS[kind](data, companion)
    except (struct.error, ValueError, IndexError, KeyError, TypeError, AttributeError, OverflowError):
        raise BrokenMeshError("is cut short or garbled") from None
    if is_flat:
        raise BrokenMeshError("holds no face with an area")
    return MeshFile(kind, data, companions)


def _read(path: Path, what: str) -> bytes:
    findings = Findings(str(path))
    data = read_regular_file(path, findings, most_bytes=MOST_BYTES)
    if data is None:
        (reason,) = findings.result()
        is_large = reason.code == "E_TOO_BIG"
        raise BrokenMeshError(f"is over {MOST_BYTES} bytes" if is_large else f"{what}{reason.message}")
    return data


def _read_companion(path: Path, name: str) -> bytes:
    """Return a file that a mesh names, if it is in the mesh's own folder or below."""
    written = unquote(name).replace("\\", "/")
    inside = PurePosixPath(written)
    folder = path.resolve().parent
    real = (folder / inside).resolve()
    if "://" in written or inside.is_absolute() or ".." in inside.parts or not real.is_relative_to(folder):
        raise BrokenMeshError(f"names a file outside its folder: {shown(name)}")
    return _read(real, f"names {shown(name)}: ")


def _check_stl(data: bytes, companion: Companion) -> bool:
    if len(data) >= STL_HEADER:
        count = int.from_bytes(data[80:84], "little")
        if len(data) == STL_HEADER + STL_TRIANGLE * count:
            if count == 0:
                raise BrokenMeshError("holds no triangles")
            triangles = np.frombuffer(data, np.dtype([("numbers", "<f4", 12), ("spare", "<u2")]), count, STL_HEADER)
            check_numbers(triangles["numbers"][:, 3:])
            return _is_flat(triangles["numbers"][:, 3:].reshape(-1, 3, 3))
    if data.lstrip()[:5].lower() != b"solid" or b"vertex" not in data:
        if len(data) < STL_HEADER:
            raise BrokenMeshError("is too short for an STL file")
        fitting = (len(data) - STL_HEADER) / STL_TRIANGLE
        raise BrokenMeshError(f"claims {count} triangles, but its size fits {fitting:g}")
    corners = [_point(words[1:4]) for words in map(str.split, _lines(data)) if words and words[0] == "vertex"]
    return _is_flat(np.reshape(corners, (-1, 3, 3)))


def _lines(data: bytes) -> list[str]:
    if len(data) > MOST_TEXT_BYTES:
        raise BrokenMeshError(f"is text of over {MOST_TEXT_BYTES} bytes")
    return data.decode("latin-1").splitlines()


def _is_flat_face(points: array[float], corners: Sequence[int], first: int = 0) -> bool:
    """Return whether a face has no area, by the numbers of its corners, counted from ``first``."""
    return len(set(corners)) < 3 or _is_flat([points[3 * (k - first) : 3 * (k - first) + 3] for k in corners])


def _check_obj(data: bytes, companion: Companion) -> bool:
    seen = {"v": 0, "vt": 0, "vn": 0}
    lowest, highest = 1, 0
    others = {"vt": 0, "vn": 0}
    points, is_flat = array("d"), True
    for line in _lines(data):
        words = line.split() or [""]
        if words[0] in seen:
            seen[words[0]] += 1
        if words[0] == "v":
            points.extend(_point(words[1:4]))
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
            is_flat = is_flat and 0 < lowest <= highest <= seen["v"] and _is_flat_face(points, corners, 1)
        elif words[0] == "mtllib":
            try:
                companion(line.split(None, 1)[1].strip())
            except BrokenMeshError as problem:
                if "there is no file" not in str(problem):
                    raise
    if not highest and lowest == 1:
        raise BrokenMeshError("holds no faces")
    if lowest < 1 or highest > seen["v"]:
        raise BrokenMeshError(f"holds face indices outside its {seen['v']} vertices")
    if any(largest > seen[kind] for kind, largest in others.items()):
        raise BrokenMeshError("holds face indices outside its texture points or normals")
    return is_flat


def _point(words: Sequence[str]) -> list[float]:
    values = [*map(float, words)]
    if len(values) < 3:
        raise BrokenMeshError("holds vertices of fewer than three coordinates")
    if not all(abs(value) <= FARTHEST for value in values):  # there may be a million lines, so no arrays here
        check_numbers(values)
    return values


def _check_ply(data: bytes, companion: Companion) -> bool:
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
    return reader.is_flat


def _check_ply_row(reader: _PlyReader, name: str, properties: list[list[str]], vertices: int) -> None:
    for words in properties:
        if words[0] != "list":
            value = reader.next(words[0])
            if name == "vertex" and words[-1] in ("x", "y", "z"):
                reader.points.append(value)
                if not abs(value) <= FARTHEST:
                    check_numbers(value)
            continue
        length = int(reader.next(words[1]))
        is_face = words[-1] in ("vertex_indices", "vertex_index")
        if is_face and length < 3:
            raise BrokenMeshError(f"holds a face with {length} corners")
        corners = [int(reader.next(words[2])) for _ in range(length)]
        if is_face and not 0 <= min(corners) <= max(corners) < vertices:
            raise BrokenMeshError(f"holds face indices outside its {vertices} vertices")
        reader.is_flat &= not is_face or (len(reader.points) == 3 * vertices and _is_flat_face(reader.points, corners))


class _PlyReader:
    def __init__(
        self, *, values: Iterator[float] | None = None, data: bytes = b"", at: int = 0, order: str = "<"
    ) -> None:
        self._values, self._data, self._at, self._order = values, data, at, order
        self.points, self.is_flat = array("d"), True

    def next(self, kind: str) -> float:
        if self._values is not None:
            if (value := next(self._values, None)) is None:
                raise BrokenMeshError("is cut short")
            return value
        code = _ply_code(kind)
        number: float = struct.unpack_from(self._order + code, self._data, self._at)[0]
        self._at += struct.calcsize(self._order + code)
        return number

    def takes_rows(self, name: str, count: int, properties: list[list[str]]) -> bool:
        """Check rows of plain numbers at once and skip them; return False if the body is text."""
        if self._values is not None:
            return False
        fields = [(f"{k} {words[-1]}", self._order + _ply_code(words[0])) for k, words in enumerate(properties)]
        kind = np.dtype(fields)
        if self._at + count * kind.itemsize > len(self._data):
            raise BrokenMeshError(f"claims {count} of {name}, more than its size can hold")
        rows = np.frombuffer(self._data, kind, count, self._at)
        if name == "vertex":
            corners = np.stack([rows[field] for field, _ in fields if field.rpartition(" ")[2] in ("x", "y", "z")], -1)
            check_numbers(corners)
            self.points.extend(corners.astype(float).ravel())
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


MESH_KINDS: Final[Mapping[str, Callable[[bytes, Companion], bool]]] = {
    ".stl": _check_stl,
    ".obj": _check_obj,
    ".glb": check_glb,
    ".gltf": check_gltf,
    ".dae": check_collada,
    ".ply": _check_ply,
}


def locate_mesh(filename: str, folder: Path, package_dirs: Sequence[Path] = ()) -> Path | None:
    """Return the path, perhaps of a missing file, of a mesh named in a URDF; None for an unknown package or scheme.

    The name is a path, ``file://…`` or ``package://NAME/…``; relative paths start at the URDF's folder. A package is
    searched for among ``package_dirs`` (each a package or a folder of packages), then in the folders above, and beside
    those.
    """
    match = SCHEME.fullmatch(filename)
    if match is None:
        return folder / filename
    scheme, rest = match[1].lower(), match[2]
    if scheme == "file":
        return Path(rest)
    name, _, inside = rest.partition("/")
    if scheme != "package" or name in ("", ".", ".."):
        return None
    package = locate_package(name, folder, package_dirs)
    return None if package is None else package / inside


def locate_package(name: str, folder: Path, package_dirs: Sequence[Path]) -> Path | None:
    """Return the folder of a package, as for :func:`locate_mesh`."""
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


class MeshFiles:
    """Checker of a URDF's mesh files, each once: ``W_MESH_PATH``, ``W_MESH_MISSING``, ``W_MESH_BAD``.

    ``look_inside`` reads the files; otherwise only existence and kind are checked.
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
        try:
            code, problem = self._find_problem(filename, owner, line)
        except (OSError, ValueError) as error:
            code, problem = "W_MESH_MISSING", f" cannot be looked up: {error}"
        if code:
            self._findings.add(code, f"{owner}: mesh {shown(filename)}{problem}", line)

    def _find_problem(self, filename: str, owner: str, line: int) -> tuple[str, str]:
        """Return the code of a warning and what follows the mesh's name in it, empty if nothing is wrong."""
        match = SCHEME.fullmatch(filename)
        scheme = "" if match is None else match[1].lower()
        if scheme not in ("", "file", "package"):
            return "W_MESH_PATH", " is not a local file; it is not fetched"
        if scheme == "package" and _leaves_its_package(filename):
            return "W_MESH_PATH", " leaves its package; it is not opened"
        path = locate_mesh(filename, self._folder, self._package_dirs)
        if path is None:
            package = filename[len("package://") :].partition("/")[0]
            message = f"mesh package {shown(package)} is not found; give its folder (--package-dir)"
            self._findings.group("W_MESH_MISSING", message, owner, line)
            return "", ""
        note_input(path)
        if len(str(path)) > LONGEST_NAME:
            return "W_MESH_MISSING", " has too long a name"
        real = Path(os.path.realpath(path))
        package_root = _package_root(path, self._folder, self._package_dirs) if scheme == "package" else None
        if not any(real.is_relative_to(folder) for folder in (*self._allowed, package_root) if folder is not None):
            return "W_MESH_PATH", " is outside the folders of this robot; it is not opened"
        try:
            status = os.stat(real)
        except (FileNotFoundError, NotADirectoryError):
            return "W_MESH_MISSING", " does not exist"
        if not is_regular(status):
            return "W_MESH_BAD", " is not a regular file"
        if real.suffix.lower() not in MESH_KINDS:
            return "W_MESH_BAD", f" is of an unknown kind; known: {', '.join(sorted(MESH_KINDS))}"
        try:
            if self._look_inside:
                read_mesh(real)
        except BrokenMeshError as problem:
            return "W_MESH_BAD", f": {problem}"
        return "", ""

    def _allowed_folders(self) -> list[Path]:
        """Return the URDF's folder, the one above (``../meshes``), its ROS package, and the given ones."""
        above = [folder for folder in (self._folder.parent,) if folder != Path(folder.anchor)]
        packages = [folder for folder in self._folder.parents if (folder / "package.xml").is_file()]
        return [self._folder, *self._package_dirs, *above, *packages[:1]]


def _leaves_its_package(filename: str) -> bool:
    """Return whether a ``package://`` name leads out of its package, which may not exist."""
    depth = 0
    for part in filename[len("package://") :].split("/"):
        depth += -1 if part == ".." else part not in ("", ".")
        if depth < 1:
            return part not in ("", ".")
    return False


def _package_root(path: Path, folder: Path, package_dirs: Sequence[Path]) -> Path | None:
    """Return the package of a located path: the nearest folder above with a package.xml."""
    for above in path.parents:
        if (above / "package.xml").is_file() or above in package_dirs:
            return Path(os.path.realpath(above))
        if above == folder:
            return above
    return None
