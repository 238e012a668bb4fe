"""Files that are not what they should be, and meshes that lie, are refused without hanging; limits are those of the pages.

Meshes lie about their size, name files that must not be opened, or grow without end when they are walked.
"""

import base64
import json
import os
import signal
import socket
import struct
from pathlib import Path

import numpy as np
import pytest

from precision_pin.base.errors import LONGEST_LINE, UrdfError
from precision_pin.pages.view.arm import draw_arm
from precision_pin.render.scene import Scene
from precision_pin.robot.chain import Chain
from precision_pin.robot.mesh_surfaces import MOST_FACES
from precision_pin.robot.urdf import Limits, Mesh, check, locate_mesh, read
from precision_pin.robot.urdf.meshes import (
    MOST_BYTES,
    MOST_DEPTH,
    MOST_TEXT_BYTES,
    MOST_TRIANGLES,
    BrokenMeshError,
    read_mesh,
)
from precision_pin.robot.urdf.xmltree import ENCODINGS, MOST_FINDINGS

CYLINDER = '<cylinder radius="0.05" length="0.4"/>'


CORNERS = np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.3, 0]], "<f4").tobytes()
INDICES = np.array([0, 1, 2], "<u2").tobytes()
TRIANGLE = (0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0)


@pytest.fixture(autouse=True)
def _no_hang_and_no_network(monkeypatch):
    """End a test that waits for a pipe, and one that opens a connection."""

    def stop(*_: object) -> None:
        raise TimeoutError("this took too long")

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a connection was opened")

    monkeypatch.setattr(socket, "create_connection", refuse)
    monkeypatch.setattr(socket.socket, "connect", refuse)
    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(10)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def codes(path: str | os.PathLike[str], **options: object) -> list[str]:
    return [found.code for found in check(path, **options)]


def arm_with_mesh(arm: str, folder: Path, filename: str) -> Path:
    path = folder / "arm.urdf"
    path.write_text(arm.replace(CYLINDER, f'<mesh filename="{filename}"/>'))
    return path


# --- files ---


def test_read_and_check_tell_the_same(arm, tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(arm.replace("0 -1 0", "0 -2 0"))
    robot = read(path)
    assert [found.code for found in robot.findings] == ["W_AXIS_NORM"]
    assert robot.findings == check(path)
    assert robot.file == robot.findings[0].file == str(path)
    path.write_text(arm.replace("0 -1 0", "0 0 0").replace('upper="0.25"', 'upper="250"'))
    with pytest.raises(UrdfError) as refused:
        read(path)
    assert [found.code for found in refused.value.findings] == ["E_AXIS_ZERO", "W_UNITS"]
    assert refused.value.findings == check(path)


def test_what_is_no_file_or_too_large_is_refused_before_it_is_read(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("loop.urdf").symlink_to("loop.urdf")
    for name in ("", "nope.urdf", "no/such/folder.urdf", "a" * 5000, "a\0b", "~/nope.urdf", "loop.urdf"):
        assert codes(name) == ["E_FILE_MISSING"], name
    os.mkfifo("pipe.urdf")
    for name in (".", "pipe.urdf", "/dev/zero"):
        assert codes(name) == ["E_FILE_KIND"], name
    with Path("large.urdf").open("wb") as stream:
        stream.truncate(16 * 1024 * 1024 + 1)
    assert codes("large.urdf") == ["E_TOO_BIG"]


@pytest.mark.skipif(os.getuid() == 0, reason="root may read everything")
def test_no_permission(arm, tmp_path):
    path = tmp_path / "secret.urdf"
    path.write_text(arm)
    path.chmod(0)
    assert codes(path) == ["E_FILE_PERM"]


@pytest.mark.skipif(not os.path.ismount("/proc"), reason="there is no /proc here")
def test_files_that_the_kernel_makes_up_are_no_input(tmp_path):
    link = tmp_path / "arm.urdf"
    link.symlink_to("/proc/self/environ")
    for path in ("/proc/self/environ", "/proc/version", link):
        (found,) = check(path)
        assert found.code == "E_FILE_KIND"
        assert "kernel" in found.message


# --- meshes ---


def gltf(uri: str = "", **changes: object) -> dict[str, object]:
    content = CORNERS + INDICES
    uri = uri or "data:application/octet-stream;base64," + base64.b64encode(content).decode()
    tree: dict[str, object] = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(content), "uri": uri}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": len(CORNERS)},
            {"buffer": 0, "byteOffset": len(CORNERS), "byteLength": len(INDICES)},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    return tree | changes


def glb(tree: dict[str, object], content: bytes = CORNERS + INDICES) -> bytes:
    tree = tree | {"buffers": [{"byteLength": len(content)}]}
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    content += b"\0" * (-len(content) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(content), 0x004E4942) + content
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def dae(faces: str = "0 1 2", *, count: int = 1, numbers: str = "0 0 0 1 0 0 0 1 0", scene: str = "") -> bytes:
    words = len(numbers.split())
    scene = (
        scene or '<library_visual_scenes><visual_scene id="s"><node><instance_geometry url="#g"/></node></visual_scene>'
    )
    return f"""<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset/>
    <library_geometries><geometry id="g"><mesh><source id="p"><float_array id="a" count="{words}">{numbers}</float_array>
    <technique_common><accessor source="#a" count="3" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
    <param name="Z" type="float"/></accessor></technique_common></source>
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
    <triangles count="{count}"><input semantic="VERTEX" source="#v" offset="0"/><p>{faces}</p></triangles></mesh></geometry>
    </library_geometries>{scene}</library_visual_scenes>
    <scene><instance_visual_scene url="#s"/></scene></COLLADA>""".encode()


def doubling(levels: int, *, circle: bool = False) -> bytes:
    """Return a scene in which each node holds the next one twice."""
    nodes = [
        f'<node id="n{k}"><instance_node url="#n{k + 1}"/><instance_node url="#n{k + 1}"/></node>'
        for k in range(levels)
    ]
    end = '<instance_node url="#n0"/>' if circle else '<instance_geometry url="#g"/>'
    last = f'<node id="n{levels}">{end}</node>'
    library = f"<library_nodes>{last}{''.join(reversed(nodes))}</library_nodes>"
    visual = '<library_visual_scenes><visual_scene id="s"><node><instance_node url="#n0"/></node></visual_scene>'
    return dae(scene=library + visual)


def stl(count: int, triangles: list[tuple[float, ...]]) -> bytes:
    return bytes(80) + struct.pack("<I", count) + b"".join(struct.pack("<12fH", *t, 0) for t in triangles)


PLY = (
    "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
)
FAR = np.array([[3e38, 0, 0], [-3e38, 0, 0], [0, 3e38, 0]], "<f4").tobytes()
TEXT_PLY = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n{} 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
)
DOUBLES = (
    np.array([[1e308, 0, 0], [-1e308, 0, 0], [0, 1e308, 0]]).tobytes() + b"\3" + np.arange(3, dtype="<i4").tobytes()
)
BEYOND = "farther than 1e\\+30"
PARENTS = [{"children": [1]}, {"children": [2]}, {"children": [1]}]
ACCESSOR = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}
FACES = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\nf "
BAD: dict[str, tuple[str, bytes]] = {
    "empty.stl": ("empty", b""),
    "none.stl": ("no triangles", stl(0, [])),
    "lying.stl": ("claims", stl(0xFFFFFFFF, [TRIANGLE])),
    "nan.stl": ("finite", stl(1, [(0, 0, 1, float("nan"), *TRIANGLE[4:])])),
    "short.stl": ("too short", b"\1\2\3"),
    "solid.stl": ("finite", b"solid x\nvertex 0 0 nan\n"),
    "far.obj": ("indices outside", FACES + b"1 2 4"),
    "before.obj": ("indices outside", FACES + b"1 2 -9"),
    "texture.obj": ("indices outside", FACES + b"1/1/1 2/9999999999/1 3/1/1"),
    "escape.obj": ("outside its folder", b"mtllib ../../etc/passwd\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
    "length.glb": ("claims", struct.pack("<4sIIII", b"glTF", 2, 0xFFFFFFF0, 4, 0) + b"{}  "),
    "chunk.glb": ("longer than the file", struct.pack("<4sIIII", b"glTF", 2, 24, 900, 0) + b"{}  "),
    "corners.ply": ("0 corners", PLY.format(3).encode() + CORNERS + struct.pack("<B", 0)),
    "index.ply": ("indices outside", PLY.format(3).encode() + CORNERS + struct.pack("<B3i", 3, 0, 1, 3)),
    "short.ply": ("cut short", PLY.format(3).encode() + CORNERS),
    "text_short.ply": ("cut short", TEXT_PLY.format(0)[:-3].encode()),
    "rest.ply": ("4 bytes after its end", PLY.format(3).encode() + CORNERS + struct.pack("<B3i", 3, 0, 1, 2) + b"more"),
    "claim.ply": ("claims 3000000000", PLY.format(3_000_000_000).encode() + CORNERS),
    "open.dae": ("well-formed", b"<COLLADA>"),
    "entity.dae": ("DOCTYPE", b'<!DOCTYPE x [<!ENTITY a "b">]><COLLADA>&a;</COLLADA>'),
    "accessor.gltf": ("rows", json.dumps(gltf(accessors=[ACCESSOR | {"count": 10**9}])).encode()),
    "beyond.gltf": ("rows", json.dumps(gltf(accessors=[ACCESSOR | {"count": 4}] * 2)).encode()),
    "view.gltf": ("view", json.dumps(gltf(bufferViews=[{"buffer": 0, "byteLength": 999}] * 2)).encode()),
    "buffer.gltf": ("claims 99", json.dumps(gltf(buffers=[{"byteLength": 99, "uri": "data:,"}])).encode()),
    "parents.gltf": ("two parents", json.dumps(gltf(nodes=PARENTS)).encode()),
    "circle.gltf": ("circle", json.dumps(gltf(nodes=[{"children": [1]}, {"children": [0]}])).encode()),
    "deep.gltf": ("deep", b'{"a":' * 100_000 + b"1" + b"}" * 100_000),
    "list.gltf": ("not a glTF", b"[1]"),
    "number.gltf": ("garbled", json.dumps(gltf(accessors=[ACCESSOR | {"count": "x"}])).encode()),
    "index.glb": ("indices", glb(gltf(), CORNERS + np.array([0, 1, 3], "<u2").tobytes())),
    "nan.glb": ("finite", glb(gltf(), np.full(9, np.nan, "<f4").tobytes() + INDICES)),
    "index.dae": ("indices", dae("0 1 3")),
    "negative.dae": ("indices", dae("0 1 -1")),
    "faces.dae": ("corners", dae("0 1 2", count=10**9)),
    "rows.dae": ("rows", dae(numbers="0 0 0 1 0 0 0 1")),
    "nan.dae": ("finite", dae(numbers="0 0 0 1 0 0 0 1 nan")),
    "circle.dae": ("circle", doubling(3, circle=True)),
    "double.dae": ("every instance", doubling(40)),
    "deep.dae": ("deep", b"<a>" * 5000 + b"</a>" * 5000),
    "scaled.gltf": (BEYOND, json.dumps(gltf(nodes=[{"mesh": 0, "scale": [1e308, 1, 1]}])).encode()),
    "scaled.dae": (BEYOND, dae().replace(b"<node>", b"<node><scale>1 1e308 1</scale>")),
    "unit.dae": (BEYOND, dae().replace(b"<asset/>", b'<asset><unit meter="1e308"/></asset>')),
    "text.ply": (BEYOND, TEXT_PLY.format("1e308").encode()),
    "doubles.ply": (BEYOND, TEXT_PLY.partition("{}")[0].replace("ascii", "binary_little_endian").encode() + DOUBLES),
    "rows.ply": ("can hold", PLY.format(99_999).encode() + b"1" * 100_000),
}  # fmt: skip


POINT = np.zeros(3, "<u2").tobytes()
LINE = "0 0 0 0.1 0.2 0.7 0.3 0.6 2.1"
FLAT: dict[str, bytes] = {
    "fan.obj": FACES + b"1 " * 20_000,
    "line.obj": b"v 0 0 0\nv .1 .2 .7\nv .3 .6 2.1\nf 1 2 3\nf -3 -1 -2",
    "point.stl": stl(1, [TRIANGLE[:3] + TRIANGLE[3:6] * 3]),
    "line.stl": ("solid x\n" + "".join(f"vertex {k / 10} {k / 10} {k / 10}\n" for k in (0, 1, 3)) * 2).encode(),
    "point.ply": PLY.format(3).encode() + CORNERS + struct.pack("<B200i", 200, *[1] * 200),
    "line.ply": TEXT_PLY.format(0).replace("0 1 0\n", "3 0 0\n").encode(),
    "point.gltf": json.dumps(
        gltf("data:application/octet-stream;base64," + base64.b64encode(CORNERS + POINT).decode())
    ).encode(),
    "line.glb": glb(gltf(), np.array(LINE.split(), "<f4").tobytes() + INDICES),
    "point.dae": dae("1 1 1"),
    "line.dae": dae(numbers=LINE),
    "polygons.dae": dae("1 1 1 1 0 0 1", count=2)
    .replace(b'<triangles count="2">', b"<polylist>")
    .replace(b"<p>", b"<vcount>4 3</vcount><p>")
    .replace(b"</triangles>", b"</polylist>"),
}


@pytest.mark.parametrize("name", FLAT)
def test_a_mesh_without_a_face_that_has_an_area_is_warned_of(arm, tmp_path, name):
    """Faces of one point or on one line; one sound face among them is enough, in any format that the sound ones show."""
    (tmp_path / name).write_bytes(FLAT[name])
    (found,) = check(arm_with_mesh(arm, tmp_path, name))
    assert (found.code, "holds no face with an area" in found.message) == ("W_MESH_BAD", True)


@pytest.mark.parametrize("name", BAD)
def test_what_a_mesh_claims_is_checked(tmp_path, name):
    reason, content = BAD[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(BrokenMeshError, match=reason):
        read_mesh(tmp_path / name)


@pytest.mark.parametrize(
    "name", ["empty.stl", "far.obj", "index.glb", "short.ply", "open.dae", "list.gltf", "what.xyz"]
)
def test_broken_meshes_are_warned_of_and_never_refuse_the_robot(arm, tmp_path, name):
    (tmp_path / name).write_bytes(BAD.get(name, ("", b"0 0 0"))[1])
    path = arm_with_mesh(arm, tmp_path, name)
    (found,) = check(path)
    assert (found.code, found.line) == ("W_MESH_BAD", 13)
    assert "upper" in found.message
    assert name in found.message
    assert read(path).link("upper").visuals[0].geometry == Mesh(name)


GOOD = {
    "binary.stl": stl(1, [TRIANGLE]),
    "solid.stl": b"solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n",
    "faces.obj": b"mtllib faces.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\nf -3 -2 -1\n",
    "binary.ply": PLY.format(3).encode() + CORNERS + struct.pack("<B3i", 3, 0, 1, 2),
    "text.ply": TEXT_PLY.format(0).encode(),
    "scene.glb": struct.pack("<4sIIII", b"glTF", 2, 24, 4, 0x4E4F534A) + b"{}  ",
    "scene.dae": b"<COLLADA/>",
}


@pytest.mark.parametrize("name", GOOD)
def test_sound_meshes_are_silent(arm, tmp_path, name):
    (tmp_path / name).write_bytes(GOOD[name])
    assert codes(arm_with_mesh(arm, tmp_path, name)) == []


def test_mesh_paths(arm, tmp_path):
    robot = tmp_path / "package" / "urdf"
    robot.mkdir(parents=True)
    meshes = tmp_path / "package" / "meshes"
    meshes.mkdir()
    (meshes / "a.stl").write_bytes(GOOD["binary.stl"])
    (tmp_path / "b.stl").write_bytes(GOOD["binary.stl"])
    (meshes / "link.stl").symlink_to(tmp_path / "b.stl")
    os.mkfifo(meshes / "pipe.stl")
    expected = {
        "../meshes/a.stl": [],
        "package://package/meshes/a.stl": [],
        f"file://{meshes}/a.stl": [],
        f"{meshes}/a.stl": [],
        "../meshes/none.stl": ["W_MESH_MISSING"],
        "package://other/a.stl": ["W_MESH_MISSING"],
        "../meshes/pipe.stl": ["W_MESH_BAD"],
        "../../b.stl": ["W_MESH_PATH"],
        "../meshes/link.stl": ["W_MESH_PATH"],
        "package://../b.stl": ["W_MESH_PATH"],
        "package://p/../../etc/passwd": ["W_MESH_PATH"],
        "package://package/meshes/../../b.stl": ["W_MESH_PATH"],
        "package://package/urdf/../meshes/a.stl": [],
        "file:///etc/passwd": ["W_MESH_PATH"],
        "/dev/zero": ["W_MESH_PATH"],
        "http://127.0.0.1:9/a.stl": ["W_MESH_PATH"],
        "a" * 5000 + ".stl": ["W_MESH_MISSING"],
    }
    found = {name: codes(arm_with_mesh(arm, robot, name)) for name in expected}
    assert found == expected


def test_package_folders_can_be_given(arm, tmp_path):
    (tmp_path / "robot").mkdir()
    (tmp_path / "elsewhere" / "looks").mkdir(parents=True)
    (tmp_path / "elsewhere" / "looks" / "a.stl").write_bytes(GOOD["binary.stl"])
    path = arm_with_mesh(arm, tmp_path / "robot", "package://looks/a.stl")
    assert codes(path) == ["W_MESH_MISSING"]
    for folder in (tmp_path / "elsewhere", tmp_path / "elsewhere" / "looks"):
        assert codes(path, package_dirs=[folder]) == []
    found = locate_mesh("package://looks/a.stl", tmp_path / "robot", [tmp_path / "elsewhere"])
    assert found == tmp_path / "elsewhere" / "looks" / "a.stl"
    assert locate_mesh("http://x/a.stl", tmp_path) is None


# --- what is drawn ---


def drawn(arm: str, folder: Path, filename: str) -> tuple[str, ...]:
    """Return the notes of drawing an arm with a mesh."""
    chain = Chain.from_robot(read(arm_with_mesh(arm, folder, filename)))
    return draw_arm(Scene(), chain.at(np.zeros(3)))[1]


@pytest.mark.slow
def test_sound_scenes_are_drawn(arm, tmp_path):
    (tmp_path / "part.bin").write_bytes(CORNERS + INDICES)
    meshes = {
        "data.gltf": json.dumps(gltf()).encode(),
        "beside.gltf": json.dumps(gltf("part.bin")).encode(),
        "binary.glb": glb(gltf()),
        "scene.dae": dae(),
        "twice.dae": doubling(3),
    }
    for name, content in meshes.items():
        (tmp_path / name).write_bytes(content)
        assert drawn(arm, tmp_path, name) == ()
        assert check(tmp_path / "arm.urdf") == ()
    assert read_mesh(tmp_path / "beside.gltf").companions == {"part.bin": CORNERS + INDICES}


@pytest.mark.slow
def test_only_regular_files_beside_a_mesh_are_opened(arm, tmp_path):
    folder = tmp_path / "robot" / "urdf"
    folder.mkdir(parents=True)
    os.mkfifo(folder / "pipe.bin")
    (tmp_path / "robot" / "above.bin").write_bytes(CORNERS + INDICES)
    (folder / "link.bin").symlink_to(tmp_path / "robot" / "above.bin")
    uris = {
        "pipe.bin": "a pipe",
        "../above.bin": "outside its folder",
        "%2e%2e/above.bin": "outside its folder",
        "link.bin": "outside its folder",
        "..\\above.bin": "outside its folder",
        "/dev/zero": "outside its folder",
        "file:///etc/passwd": "outside its folder",
        "http://127.0.0.1:9/a.bin": "outside its folder",
        "none.bin": "there is no file",
        ".": "a directory",
        "a\0b": "garbled",
    }
    for uri, reason in uris.items():
        (folder / "scene.gltf").write_text(json.dumps(gltf(uri)))
        (note,) = drawn(arm, folder, "scene.gltf")
        assert reason in note
        assert "drawn as a plain cylinder" in note
        assert [found.code for found in check(folder / "arm.urdf")] == ["W_MESH_BAD"]


@pytest.mark.slow
def test_images_and_material_files_that_are_no_files_are_not_opened(arm, tmp_path):
    os.mkfifo(tmp_path / "pipe.png")
    os.mkfifo(tmp_path / "pipe.mtl")
    names = ("pipe.png", "/dev/zero", "http://127.0.0.1:9/a.png")
    for name in names:
        images = {"images": [{"uri": name}], "textures": [{"source": 0}]}
        material = {"materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]}
        (tmp_path / "scene.gltf").write_text(json.dumps(gltf() | images | material))
        assert drawn(arm, tmp_path, "scene.gltf") == ()
        (tmp_path / "faces.mtl").write_text(f"newmtl a\nKd 1 0 0\nmap_Kd {name}\n")
        (tmp_path / "faces.obj").write_text("mtllib faces.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n")
        assert drawn(arm, tmp_path, "faces.obj") == ()
        (tmp_path / "text.ply").write_text(
            TEXT_PLY.format(0).replace("element", f"comment TextureFile {name}\nelement", 1)
        )
        assert drawn(arm, tmp_path, "text.ply") == ()
        effect = (
            f'<library_images><image id="i"><init_from>{name}</init_from></image></library_images><library_effects>'
            '<effect id="e"><profile_COMMON><newparam sid="u"><surface type="2D"><init_from>i</init_from></surface></newparam>'
            '<newparam sid="t"><sampler2D><source>u</source></sampler2D></newparam><technique sid="c"><lambert><diffuse>'
            '<texture texture="t" texcoord="x"/></diffuse></lambert></technique></profile_COMMON></effect></library_effects>'
            '<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>'
        ).encode()
        (tmp_path / "scene.dae").write_bytes(dae().replace(b"<library_geometries>", effect + b"<library_geometries>"))
        assert drawn(arm, tmp_path, "scene.dae") == ()
    (tmp_path / "faces.obj").write_text("mtllib pipe.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (note,) = drawn(arm, tmp_path, "faces.obj")
    assert "a pipe" in note


def test_a_mesh_too_small_to_be_seen_is_not_called_drawn(arm, tmp_path):
    (tmp_path / "dust.stl").write_bytes(stl(1, [(0, 0, 1, 0, 0, 0, 1e-9, 0, 0, 0, 1e-9, 0)]))
    (note,) = drawn(arm, tmp_path, "dust.stl")
    assert "too small to be seen" in note


# --- what the pages state ---


def stated() -> dict[str, list[str]]:
    size, limits = 20, Limits()
    file, texts, text = limits.file_bytes >> size, f"{limits.text_length:,}", MOST_TEXT_BYTES >> size
    return {
        "docs/urdf.md": [
            f"| file | {file} MiB |",
            f"| a name or attribute | {texts} characters |",
            f"| depth of elements | {limits.xml_depth} |",
            f"| elements and attributes | {limits.elements:,} |",
            f"| moving joints | {limits.moving_joints} |",
            f"| links in a row, from root to tip | {limits.links_in_depth} |",
            f"| {MOST_BYTES >> size} MiB each, as text {text} MiB |",
            f"every instance counted | {MOST_TRIANGLES:,} |",
            f"holds {MOST_FACES:,} triangles",
        ],
        "SECURITY.md": [
            f"{file} MiB; {limits.xml_depth} levels; {limits.elements:,} elements",
            f"{texts} characters a name or attribute; {limits.moving_joints} moving joints",
            f"{limits.links_in_depth} links in a row",
            f"{MOST_BYTES >> size} MiB a file, {text} MiB as text; {MOST_TRIANGLES:,} triangles",
            f"every instance counted; {MOST_DEPTH} levels |",
            f"| {MOST_FACES:,} triangles, 200 poses, 100,000 samples |",
            f"cut to {LONGEST_LINE:,} characters and {MOST_FINDINGS:,} of a kind",
        ],
    }


def test_limits_and_encodings_of_the_pages_are_those_of_the_code():
    root = Path(__file__).parents[3]
    pages = {name: " ".join((root / name).read_text(encoding="utf-8").split()) for name in stated()}
    assert [text for name, texts in stated().items() for text in texts if text not in pages[name]] == []
    for name in ("utf-8", "utf-16", "iso-8859-1", "iso-8859-15", "windows-1252", "us-ascii"):
        assert name in ENCODINGS
        assert name in pages["docs/urdf.md"].lower()
