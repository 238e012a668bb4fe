"""Meshes that lie about their size, name files that must not be opened, or grow without end when they are walked."""

from __future__ import annotations

import base64
import json
import os
import signal
import socket
import struct
from pathlib import Path

import numpy as np
import pytest

from precision_pin.pages.view.arm import draw_arm
from precision_pin.render.scene import Scene
from precision_pin.robot.chain import Chain
from precision_pin.robot.urdf import check, read
from precision_pin.robot.urdf.meshes import BrokenMeshError, read_mesh

CYLINDER = '<cylinder radius="0.05" length="0.4"/>'
CORNERS = np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.3, 0]], "<f4").tobytes()
INDICES = np.array([0, 1, 2], "<u2").tobytes()


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
    last = (
        f'<node id="n{levels}">'
        + ('<instance_node url="#n0"/>' if circle else '<instance_geometry url="#g"/>')
        + "</node>"
    )
    library = f"<library_nodes>{last}{''.join(reversed(nodes))}</library_nodes>"
    visual = '<library_visual_scenes><visual_scene id="s"><node><instance_node url="#n0"/></node></visual_scene>'
    return dae(scene=library + visual)


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
BAD: dict[str, tuple[str, bytes]] = {
    "accessor.gltf": ("rows", json.dumps(gltf(accessors=[ACCESSOR | {"count": 10**9}])).encode()),
    "beyond.gltf": ("rows", json.dumps(gltf(accessors=[ACCESSOR | {"count": 4}] * 2)).encode()),
    "view.gltf": ("view", json.dumps(gltf(bufferViews=[{"buffer": 0, "byteLength": 999}] * 2)).encode()),
    "buffer.gltf": ("claims 99", json.dumps(gltf(buffers=[{"byteLength": 99, "uri": "data:,"}])).encode()),
    "parents.gltf": ("two parents", json.dumps(gltf(nodes=PARENTS)).encode()),
    "twins.gltf": ("two parents", json.dumps(gltf(nodes=[{"children": [1, 1]}, {"mesh": 0}])).encode()),
    "circle.gltf": ("circle", json.dumps(gltf(nodes=[{"children": [1]}, {"children": [0]}])).encode()),
    "deep.gltf": ("deep", b'{"a":' * 100_000 + b"1" + b"}" * 100_000),
    "list.gltf": ("not a glTF", b"[1]"),
    "number.gltf": ("garbled", json.dumps(gltf(accessors=[ACCESSOR | {"count": "x"}])).encode()),
    "index.glb": ("indices", glb(gltf(), CORNERS + np.array([0, 1, 3], "<u2").tobytes())),
    "nan.glb": ("finite", glb(gltf(), np.full(9, np.nan, "<f4").tobytes() + INDICES)),
    "binary.glb": ("beyond its buffer", glb(gltf(), CORNERS)),
    "index.dae": ("indices", dae("0 1 3")),
    "negative.dae": ("indices", dae("0 1 -1")),
    "faces.dae": ("corners", dae("0 1 2", count=10**9)),
    "rows.dae": ("rows", dae(numbers="0 0 0 1 0 0 0 1")),
    "nan.dae": ("finite", dae(numbers="0 0 0 1 0 0 0 1 nan")),
    "circle.dae": ("circle", doubling(3, circle=True)),
    "double.dae": ("every instance", doubling(40)),
    "deep.dae": ("deep", b"<a>" * 5000 + b"</a>" * 5000),
    "far.glb": (BEYOND, glb(gltf(), FAR + INDICES)),
    "scaled.gltf": (BEYOND, json.dumps(gltf(nodes=[{"mesh": 0, "scale": [1e308, 1, 1]}])).encode()),
    "far.dae": (BEYOND, dae(numbers="1e308 0 0 -1e308 0 0 0 1e308 0")),
    "scaled.dae": (BEYOND, dae().replace(b"<node>", b"<node><scale>1 1e308 1</scale>")),
    "unit.dae": (BEYOND, dae().replace(b"<asset/>", b'<asset><unit meter="1e308"/></asset>')),
    "text.ply": (BEYOND, TEXT_PLY.format("1e308").encode()),
    "nan.ply": ("finite", TEXT_PLY.format("nan").encode()),
    "doubles.ply": (BEYOND, TEXT_PLY.partition("{}")[0].replace("ascii", "binary_little_endian").encode() + DOUBLES),
    "far.stl": (BEYOND, bytes(80) + struct.pack("<I12x", 1) + FAR + bytes(2)),
    "rows.ply": ("can hold", PLY.format(99_999).encode() + b"1" * 100_000),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_what_a_mesh_claims_is_checked(tmp_path, name):
    reason, content = BAD[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(BrokenMeshError, match=reason):
        read_mesh(tmp_path / name)


def drawn(arm: str, folder: Path, filename: str) -> tuple[str, ...]:
    """Return the notes of drawing an arm with a mesh."""
    path = folder / "arm.urdf"
    path.write_text(arm.replace(CYLINDER, f'<mesh filename="{filename}"/>'))
    chain = Chain.from_robot(read(path))
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
        "/proc/self/environ": "outside its folder",
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
            f"ply\nformat ascii 1.0\ncomment TextureFile {name}\nelement vertex 3\nproperty float x\nproperty float y\n"
            "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
            "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
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
    triangle = struct.pack("<12fH", 0, 0, 1, 0, 0, 0, 1e-9, 0, 0, 0, 1e-9, 0, 0)
    (tmp_path / "dust.stl").write_bytes(bytes(80) + struct.pack("<I", 1) + triangle)
    (note,) = drawn(arm, tmp_path, "dust.stl")
    assert "too small to be seen" in note


@pytest.mark.skipif(not os.path.ismount("/proc"), reason="there is no /proc here")
def test_files_that_the_kernel_makes_up_are_no_input(tmp_path):
    link = tmp_path / "arm.urdf"
    link.symlink_to("/proc/self/environ")
    for path in ("/proc/self/environ", "/proc/version", link):
        (found,) = check(path)
        assert found.code == "E_FILE_KIND"
        assert "kernel" in found.message
