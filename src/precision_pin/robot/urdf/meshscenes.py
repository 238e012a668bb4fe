"""Checks of scene files (glTF, COLLADA): sizes, counts, indices, and trees without circles."""

from __future__ import annotations

import base64
import binascii
import json
import struct
from collections.abc import Callable, Mapping
from typing import Any, Final
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.text_escape import shown

Companion = Callable[[str], bytes]
"""Function that returns the bytes of a file that a mesh names, or raises `BrokenMeshError`."""

MOST_TRIANGLES: Final = 4_000_000
"""Triangles of one file, every instance counted, and corners of one list."""
MOST_DEPTH: Final = 200
LONGEST_JSON: Final = 16 * 1024 * 1024
GLB_HEADER: Final = 12
GLB_JSON, GLB_BINARY = 0x4E4F534A, 0x004E4942
NUMBERS: Final = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
FARTHEST: Final = 1e30
"""Coordinate or factor beyond which extents and squares of a mesh may overflow in single or double precision."""
WIDTHS: Final = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


class BrokenMeshError(Exception):
    """A mesh file is broken; the message continues a sentence that names the file."""


def check_numbers(numbers: ArrayLike) -> None:
    """Refuse coordinates, or factors of them, that cannot be computed with."""
    values = np.asarray(numbers, dtype=np.float64)
    if not np.isfinite(values).all():
        raise BrokenMeshError("holds vertices that are not finite")
    if np.abs(values).max(initial=0.0) > FARTHEST:
        raise BrokenMeshError(f"holds vertices farther than {FARTHEST:g} from its origin")


# --- glTF ---


def check_glb(data: bytes, companion: Companion) -> None:
    """Check a binary glTF file."""
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
    _check_gltf_tree(_json(chunks[0][1]), binary, companion)


def check_gltf(data: bytes, companion: Companion) -> None:
    """Check a glTF file in JSON and the buffers that it names."""
    _check_gltf_tree(_json(data), None, companion)


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


def _check_gltf_tree(tree: Mapping[str, Any], binary: bytes | None, companion: Companion) -> None:
    buffers = []
    for k, buffer in enumerate(tree.get("buffers", [])):
        content = binary if "uri" not in buffer and k == 0 else _from_uri(str(buffer["uri"]), companion)
        if content is None or len(content) < int(buffer["byteLength"]):
            raise BrokenMeshError(f"claims {buffer['byteLength']} bytes in a buffer of {len(content or b'')}")
        buffers.append(content)
    views = [_view(view, buffers) for view in tree.get("bufferViews", [])]
    accessors = [_accessor(accessor, views) for accessor in tree.get("accessors", [])]
    triangles = []
    for mesh in tree.get("meshes", []):
        triangles.append(sum(_check_primitive(one, accessors) for one in mesh.get("primitives", [])))
    _check_nodes(tree, triangles)


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
    """Return the rows ``(N, width)`` of an accessor."""
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


def _check_primitive(primitive: Mapping[str, Any], accessors: list[NDArray[Any]]) -> int:
    """Return the number of triangles."""
    attributes = primitive.get("attributes", {})
    if "POSITION" not in attributes:
        return 0
    corners = accessors[_index(attributes["POSITION"], accessors)]
    check_numbers(corners)
    if "indices" not in primitive:
        return len(corners) // 3
    indices = accessors[_index(primitive["indices"], accessors)]
    if indices.size and not 0 <= int(indices.min()) <= int(indices.max()) < len(corners):
        raise BrokenMeshError(f"holds face indices outside its {len(corners)} vertices")
    return len(indices) // 3


def _check_nodes(tree: Mapping[str, Any], triangles: list[int]) -> None:
    """Refuse nodes that are no forest, as the format requires: readers would follow a circle without end."""
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
    if any(root in parents for root in roots) or _has_circle(parents):
        raise BrokenMeshError("holds nodes in a circle")
    if total > MOST_TRIANGLES:
        raise BrokenMeshError(f"holds {total} triangles; up to {MOST_TRIANGLES} are read")


def _has_circle(parents: Mapping[int, int]) -> bool:
    done: set[int] = set()
    for start in parents:
        way: set[int] = set()
        at: int | None = start
        while at is not None and at not in done:
            if at in way:
                return True
            way.add(at)
            at = parents.get(at)
        done |= way
    return False


# --- COLLADA ---


def check_collada(data: bytes, companion: Companion) -> None:
    """Check a COLLADA file; images it names are not opened."""
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
    _check_instances(root, geometries)


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


def _check_geometry(geometry: ElementTree.Element) -> int:
    """Return the approximate number of triangles."""
    rows = {}
    for source in geometry.iter("source"):
        rows["#" + source.get("id", "")] = _check_source(source)
    for vertices in geometry.iter("vertices"):
        for given in vertices.findall("input"):
            if given.get("semantic") == "POSITION":
                rows["#" + vertices.get("id", "")] = rows.get(given.get("source", ""), 0)
    total = 0
    for kind in ("triangles", "polylist", "polygons", "trifans", "tristrips"):
        for faces in geometry.iter(kind):
            total += _check_faces(faces, rows)
    return total


def _check_source(source: ElementTree.Element) -> int:
    """Return the number of rows of a source."""
    array, accessor = source.find("float_array"), source.find("technique_common/accessor")
    if array is None:
        return 0
    numbers = np.array((array.text or "").split(), dtype=float)
    if int(array.get("count", len(numbers))) != len(numbers):
        raise BrokenMeshError(f"claims {shown(array.get('count', ''))} numbers in an array of {len(numbers)}")
    check_numbers(numbers)
    stride = 3 if accessor is None else int(accessor.get("stride", 1))
    count = len(numbers) // max(stride, 1) if accessor is None else int(accessor.get("count", 0))
    if stride < 1 or count < 0 or count * stride > len(numbers):
        raise BrokenMeshError(f"claims {count} rows of {stride} in an array of {len(numbers)}")
    return count


def _check_faces(faces: ElementTree.Element, rows: Mapping[str, int]) -> int:
    inputs = [(int(one.get("offset", 0)), rows.get(one.get("source", ""))) for one in faces.findall("input")]
    width = 1 + max((offset for offset, _ in inputs), default=0)
    words = [np.array((p.text or "").split(), dtype=np.int64) for p in faces.findall("p")]
    indices = np.concatenate(words) if words else np.zeros(0, np.int64)
    if width < 1 or len(indices) % width:
        raise BrokenMeshError("holds faces that are cut short")
    vcount = faces.find("vcount")
    corners = 3 * int(faces.get("count", 0)) if faces.tag == "triangles" else None
    if vcount is not None:
        corners = int(np.array((vcount.text or "").split(), dtype=np.int64).sum())
    if corners is not None and corners * width != len(indices):
        raise BrokenMeshError(f"claims {corners} corners of faces, but holds {len(indices) // width}")
    for offset, count in inputs:
        column = indices[offset::width]
        if column.size and count is not None and not 0 <= int(column.min()) <= int(column.max()) < count:
            raise BrokenMeshError(f"holds face indices outside its {count} rows")
    return len(indices) // width // 3


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
