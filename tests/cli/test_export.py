"""``export``: which files appear, what they hold."""

import csv
import hashlib
import re

import numpy as np
import pytest

from cli.conftest import LONG
from precision_pin import Chain, ErrorModel
from support.plain_robot import PlainRobot, pose_error

HEAD = ["unit", "file", "x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad", "sha256"]


def table(path):
    header, *rows = csv.reader(path.read_text("utf-8").splitlines())
    assert header == HEAD
    return [dict(zip(HEAD, row, strict=True)) for row in rows]


def error_of(row):
    return np.array([float(row[name]) for name in HEAD[2:8]])


def test_the_papers_arm_without_arguments(run, folder):
    (folder / "built").mkdir()
    (folder / "built" / "notes.txt").write_text("mine")
    (folder / "built" / "4dof.unit0000.urdf").write_text("old")
    outcome = run("export", "--out", "built")
    assert outcome.out == ""
    assert outcome.said == [
        "wrote built: units.csv, 4dof.unit0000.urdf",
        "true at the pose 'paper' only: the errors of 2 beam, 4 joint_compliance, which change with load, pose or visit; "
        "readings with them at every pose: simulate",
    ]
    text = (folder / "built/4dof.unit0000.urdf").read_text()
    assert text.startswith("<?xml")
    # each of them by name in the file, and no folder
    assert "joint_compliance[joint4]" in text
    assert "/" not in text.partition("<robot")[0]
    assert {path.name for path in (folder / "built").iterdir()} == {"units.csv", "4dof.unit0000.urdf", "notes.txt"}
    check = run("check", "built/4dof.unit0000.urdf")
    assert (check.out, check.err) == ("", "no errors, 0 warnings\n")
    text = " ".join(run("export", "--help").out.split())
    assert "the errors of the built robot at every pose and all errors" in text


def test_files_and_table_agree(run, folder, new_files):
    outcome = run("export", "gantry.urdf", "--units", "3", "--first", "7", "--seed", "5", "--out", "deep/er")
    assert outcome.out == ""
    named = "gantry.urdf: with the sheet beside it, gantry.errors.yaml\n"
    assert outcome.err == f"{named}wrote deep/er: units.csv, gantry.unit0007.urdf to gantry.unit0009.urdf\n"
    names = [f"gantry.unit000{k}.urdf" for k in (7, 8, 9)]
    assert new_files() == {"deep", "deep/er", "deep/er/units.csv", *(f"deep/er/{name}" for name in names)}
    rows = table(folder / "deep/er/units.csv")
    assert [(row["unit"], row["file"]) for row in rows] == list(zip("789", names, strict=True))
    model, nominal = ErrorModel.load("gantry.errors.yaml"), Chain.from_urdf("gantry.urdf")
    x = model.space.sample(5, 7, 3)
    q = {"y_axis": 0.25, LONG: np.radians(30)}
    for k, row in enumerate(rows):
        data = (folder / "deep/er" / row["file"]).read_bytes()
        assert hashlib.sha256(data).hexdigest() == row["sha256"]
        np.testing.assert_array_equal(error_of(row), model.at("out").exact(x)[:, k])
        # both offsets are part of the robot at every pose: the gantry slides and turns further by them
        built = PlainRobot.parse(data.decode())
        for values in (q, {"y_axis": -0.5, LONG: 1.5}):
            offset = dict(zip(nominal.joint_names, x[:, k], strict=True))
            expected = nominal.at({name: values[name] + offset[name] for name in values}).pose
            np.testing.assert_allclose(built.poses(values)["tool"], expected, rtol=0, atol=1e-12)
        achieved = pose_error(built.poses(q)["tool"], nominal.at(q).pose)
        np.testing.assert_allclose(achieved, error_of(row), rtol=0, atol=1e-12)


def test_poses_the_same_bytes_and_names_that_grow_with_the_numbers(run, folder):
    for name, options in (("a", ("--pose", "home")), ("b", ("--q", "0 mm, 0 deg")), ("c", ()), ("d", ())):
        run("export", "gantry.urdf", *options, "--out", name)
    errors = {name: error_of(table(folder / name / "units.csv")[0]) for name in "abc"}
    np.testing.assert_array_equal(errors["a"], errors["b"])
    # an arm of half a metre that turns further about x: another direction at another angle
    assert np.abs(errors["a"] - errors["c"]).max() > 1e-6
    text = (folder / "a" / "gantry.unit0000.urdf").read_text("utf-8")
    assert "pose home: y_axis = 0.0 m," in text
    assert "Schlitten_ü" in text
    for file in ("units.csv", "gantry.unit0000.urdf"):
        assert (folder / "c" / file).read_bytes() == (folder / "d" / file).read_bytes()
    run("export", "gantry.urdf", "--units", "2", "--first", str(2**64 - 2), "--out", "o")
    assert [row["unit"] for row in table(folder / "o/units.csv")] == [str(2**64 - 2), str(2**64 - 1)]
    run("export", "gantry.urdf", "--units", "2", "--first", "9999", "--out", "p")
    names = {path.name for path in (folder / "p").glob("*.urdf")}
    assert names == {"gantry.unit09999.urdf", "gantry.unit10000.urdf"}


def test_a_tip_that_a_joint_moves_gets_a_frame(run, folder):
    (folder / "a.errors.yaml").write_text(
        "precision-pin: 1\nrobot: forked.urdf\ntip: left\nposes: {p: 30 deg}\n"
        "sources:\n  - frame: {frame: left, x: {uniform: 1 mm}}\n"
    )
    assert run("export", "a.errors.yaml", "--out", "o").err_lines[:-1] == [
        "forked.urdf: warning W_FRAME_ADDED: no placement is between 'left' and the joint next to it, so its own error "
        "is written as a fixed frame 'left_as_built'; take that as the tip"
    ]
    data = (folder / "o" / "forked.unit0000.urdf").read_text()
    (row,) = table(folder / "o/units.csv")
    tip = PlainRobot.parse(data).poses({"to_left": np.radians(30)})
    np.testing.assert_allclose(tip["left_as_built"][:3, 3] - tip["left"][:3, 3], error_of(row)[:3], rtol=0, atol=1e-15)
    assert np.linalg.norm(error_of(row)) > 1e-6


@pytest.mark.slow
def test_relative_mesh_names_that_lead_nowhere_are_warned_of(run, folder):
    (folder / "meshes").mkdir()
    for name in ("a.stl", "b.stl"):
        (folder / "meshes" / name).write_bytes(bytes(80) + (0).to_bytes(4, "little"))
    visuals = "".join(
        f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
        for name in ("meshes/a.stl", "meshes/b.stl", "package://x/c.stl", "/d.stl", "meshes/gone.stl")
    )
    text = (folder / "4dof.urdf").read_text()
    (folder / "4dof.urdf").write_text(text.replace('<link name="link1">', f'<link name="link1">{visuals}'))

    def lost(out):
        return [line for line in run("export", "4dof.urdf", "--out", out).said if "will not be found" in line]

    (line,) = lost("o")
    assert re.fullmatch(r"\S+: warning W_[A-Z_]+: .*'meshes/a.stl' and 1 more will not be found from 'o'.*", line)
    assert lost(".") == []
    (folder / "o" / "meshes").symlink_to(folder / "meshes")
    assert lost("o") == []
