"""Files that are not what they should be are refused without hanging; the limits are those that the pages state."""

from __future__ import annotations

import os
import struct
from pathlib import Path

import pytest

from precision_pin.base.errors import LONGEST_LINE, UrdfError
from precision_pin.robot.mesh_surfaces import MOST_FACES
from precision_pin.robot.urdf import Limits, Mesh, check, locate_mesh, read
from precision_pin.robot.urdf.meshes import MOST_BYTES, MOST_DEPTH, MOST_TEXT_BYTES, MOST_TRIANGLES
from precision_pin.robot.urdf.xmltree import ENCODINGS, MOST_FINDINGS

CYLINDER = '<cylinder radius="0.05" length="0.4"/>'


def codes(path: str | os.PathLike[str], **options: object) -> list[str]:
    return [found.code for found in check(path, **options)]


def test_read_returns_the_warnings_and_check_the_same(arm, tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(arm.replace("0 -1 0", "0 -2 0"))
    robot = read(path)
    assert [found.code for found in robot.findings] == ["W_AXIS_NORM"]
    assert robot.findings == check(path)
    assert robot.file == str(path)
    assert robot.findings[0].file == str(path)


def test_read_raises_with_everything(arm, tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(arm.replace("0 -1 0", "0 0 0").replace('upper="0.25"', 'upper="250"'))
    with pytest.raises(UrdfError) as refused:
        read(path)
    assert [found.code for found in refused.value.findings] == ["E_AXIS_ZERO", "W_UNITS"]
    assert refused.value.findings == check(path)


@pytest.mark.parametrize("name", ["nope.urdf", "no/such/folder.urdf", "a" * 300, "a" * 5000, "a\0b", "~/nope.urdf"])
def test_missing(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    assert codes(name) == ["E_FILE_MISSING"]


def test_empty_path():
    assert codes("") == ["E_FILE_MISSING"]


def test_symlink_loop(tmp_path):
    path = tmp_path / "loop.urdf"
    path.symlink_to(path)
    assert codes(path) == ["E_FILE_MISSING"]


def test_directory_pipe_and_device(tmp_path):
    pipe = tmp_path / "pipe.urdf"
    os.mkfifo(pipe)
    for path in (tmp_path, pipe, "/dev/zero"):
        assert codes(path) == ["E_FILE_KIND"]


@pytest.mark.skipif(os.getuid() == 0, reason="root may read everything")
def test_no_permission(arm, tmp_path):
    path = tmp_path / "secret.urdf"
    path.write_text(arm)
    path.chmod(0)
    assert codes(path) == ["E_FILE_PERM"]


def test_size_is_looked_at_before_the_content(tmp_path):
    path = tmp_path / "large.urdf"
    with path.open("wb") as stream:
        stream.truncate(16 * 1024 * 1024 + 1)
    assert codes(path) == ["E_TOO_BIG"]


def stl(count: int, triangles: list[tuple[float, ...]]) -> bytes:
    return bytes(80) + struct.pack("<I", count) + b"".join(struct.pack("<12fH", *t, 0) for t in triangles)


TRIANGLE = (0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0)
PLY = (
    b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    b"property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
)
CORNERS = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
ASCII_PLY = PLY.replace(b"binary_little_endian", b"ascii") + b"0 0 0\n1 0 0\n0 1 0\n3 0 1 "
GOOD = {
    "binary.stl": stl(1, [TRIANGLE]),
    "solid.stl": b"solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n",
    "faces.obj": b"mtllib faces.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\nf -3 -2 -1\n",
    "binary.ply": PLY + CORNERS + struct.pack("<B3i", 3, 0, 1, 2),
    "text.ply": ASCII_PLY + b"2\n",
    "scene.glb": struct.pack("<4sIIII", b"glTF", 2, 24, 4, 0x4E4F534A) + b"{}  ",
    "scene.dae": b"<COLLADA/>",
}
BAD = {
    "empty.stl": b"",
    "none.stl": stl(0, []),
    "lying.stl": stl(0xFFFFFFFF, [TRIANGLE]),
    "nan.stl": stl(1, [(0, 0, 1, float("nan"), *TRIANGLE[4:])]),
    "short.stl": b"\1\2\3",
    "solid.stl": b"solid x\nvertex 0 0 nan\n",
    "index.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9999\n",
    "negative.obj": b"v 0 0 0\nf -5 -6 -7\n",
    "escape.obj": b"mtllib ../../etc/passwd\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "garbled.obj": b"v 0 0 0\nf x y z\n",
    "length.glb": struct.pack("<4sIIII", b"glTF", 2, 0xFFFFFFF0, 4, 0) + b"{}  ",
    "chunk.glb": struct.pack("<4sIIII", b"glTF", 2, 24, 900, 0) + b"{}  ",
    "tiny.glb": b"glTF",
    "corners.ply": PLY + CORNERS + struct.pack("<B", 0),
    "index.ply": PLY + CORNERS + struct.pack("<B3i", 3, 0, 1, 3),
    "short.ply": PLY + CORNERS,
    "text.ply": ASCII_PLY,
    "rest.ply": PLY + CORNERS + struct.pack("<B3i", 3, 0, 1, 2) + b"more",
    "claim.ply": PLY.replace(b"vertex 3", b"vertex 3000000000"),
    "open.dae": b"<COLLADA>",
    "entity.dae": b'<!DOCTYPE x [<!ENTITY a "b">]><COLLADA>&a;</COLLADA>',
    "what.xyz": b"0 0 0",
}


def arm_with_mesh(arm: str, folder: Path, filename: str) -> Path:
    path = folder / "arm.urdf"
    path.write_text(arm.replace(CYLINDER, f'<mesh filename="{filename}"/>'))
    return path


@pytest.mark.parametrize("name", GOOD)
def test_sound_meshes_are_silent(arm, tmp_path, name):
    (tmp_path / name).write_bytes(GOOD[name])
    assert codes(arm_with_mesh(arm, tmp_path, name)) == []


@pytest.mark.parametrize("name", BAD)
def test_broken_meshes_are_warned_of_and_never_refuse_the_robot(arm, tmp_path, name):
    (tmp_path / name).write_bytes(BAD[name])
    path = arm_with_mesh(arm, tmp_path, name)
    (found,) = check(path)
    assert found.code == "W_MESH_BAD"
    assert "upper" in found.message
    assert name in found.message
    assert found.line == 13
    assert read(path).link("upper").visuals[0].geometry == Mesh(name)


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
        "package://package/../b.stl": ["W_MESH_PATH"],
        "package://../b.stl": ["W_MESH_PATH"],
        "package://p/../../etc/passwd": ["W_MESH_PATH"],
        "package://package/meshes/../../b.stl": ["W_MESH_PATH"],
        "package://package/urdf/../meshes/a.stl": [],
        "/etc/passwd": ["W_MESH_PATH"],
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


ROOT = Path(__file__).parents[3]
LIMITS = Limits()


@pytest.mark.parametrize(
    ("page", "stated"),
    [
        ("docs/urdf.md", f"| file | {LIMITS.file_bytes >> 20} MiB |"),
        ("docs/urdf.md", f"| a name or attribute | {LIMITS.text_length:,} characters |"),
        ("docs/urdf.md", f"| depth of elements | {LIMITS.xml_depth} |"),
        ("docs/urdf.md", f"| elements and attributes | {LIMITS.elements:,} |"),
        ("docs/urdf.md", f"| moving joints | {LIMITS.moving_joints} |"),
        ("docs/urdf.md", f"| links in a row, from root to tip | {LIMITS.links_in_depth} |"),
        ("docs/urdf.md", f"| {MOST_BYTES >> 20} MiB each, as text {MOST_TEXT_BYTES >> 20} MiB |"),
        ("docs/urdf.md", f"every instance counted | {MOST_TRIANGLES:,} |"),
        ("docs/urdf.md", f"holds {MOST_FACES:,} triangles"),
        ("SECURITY.md", f"{LIMITS.file_bytes >> 20} MiB; {LIMITS.xml_depth} levels; {LIMITS.elements:,} elements"),
        ("SECURITY.md", f"{LIMITS.text_length:,} characters a name or attribute; {LIMITS.moving_joints} moving joints"),
        ("SECURITY.md", f"{LIMITS.links_in_depth} links in a row"),
        (
            "SECURITY.md",
            f"{MOST_BYTES >> 20} MiB a file, {MOST_TEXT_BYTES >> 20} MiB as text; {MOST_TRIANGLES:,} triangles",
        ),
        ("SECURITY.md", f"every instance counted; {MOST_DEPTH} levels |"),
        ("SECURITY.md", f"| {MOST_FACES:,} triangles, 200 poses, 100,000 samples |"),
        ("SECURITY.md", f"cut to {LONGEST_LINE:,} characters and {MOST_FINDINGS:,} of a kind"),
    ],
)
def test_limits_of_the_pages_are_those_of_the_code(page, stated):
    assert stated in " ".join((ROOT / page).read_text(encoding="utf-8").split())


def test_every_encoding_is_listed():
    page = (ROOT / "docs" / "urdf.md").read_text(encoding="utf-8").lower()
    for name in ("utf-8", "utf-16", "iso-8859-1", "iso-8859-15", "windows-1252", "us-ascii"):
        assert name in ENCODINGS
        assert name in page
