from __future__ import annotations

import base64
import hashlib
import re
import runpy
import sys
from dataclasses import replace
from html import escape
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from outputs.view_cases import (
    HOSTILE,
    Tags,
    arm_text,
    array_of,
    commands_of,
    data_block,
    floats,
    geometry_of,
    made_up_errors,
    material_of,
    matrix,
    nodes_of,
    pages,
    pose_model,
    pose_of,
    simple_page,
    visual,
)
from precision_pin.base.errors import InputError
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.pages.view import DEFAULT_POINTS, MOST_POINTS, MOST_POSES, ViewPose, script_hashes
from precision_pin.pages.view.scales import arm_length, default_factor, middle_of, view_direction
from precision_pin.render.display_units import ColourScale, WrittenUnit, round_number
from precision_pin.robot.chain import Chain
from precision_pin.robot.examples import PAPER_SHEET, example_urdfs
from precision_pin.robot.mesh_surfaces import Surface, thinned
from precision_pin.robot.urdf import read

BOX = visual('<box size="0.1 0.2 0.3"/>', '<origin xyz="0.01 0.02 0.03" rpy="0.1 0.2 0.3"/>', "1 0 0 0.5")
ROLLER = visual('<cylinder radius="0.05" length="0.4"/>', '<origin xyz="0.25 0 0" rpy="0 1.2 0"/>', "0 0.4 1 1")
BALL = visual('<sphere radius="0.07"/>', '<origin xyz="0 0 -0.1"/>')
SCRIPTS = Path(__file__).parents[2] / "scripts"


@pytest.fixture(scope="module")
def paper():
    model = ErrorModel.load(PAPER_SHEET)
    at = model.at()
    errors = at.exact(model.space.sample(3, 0, 400))
    return at, errors, simple_page(at, errors, name="paper", caption=[("spec", "2 mm @ 99 %")])


def test_the_page_is_one_file_that_asks_for_nothing(paper):
    text = paper[2]
    parsed = Tags(text)
    kinds = {tag for tag, _ in parsed.tags}
    assert not kinds & {"link", "img", "iframe", "object", "embed", "base", "form", "video", "audio", "source"}
    for tag, attributes in parsed.tags:
        assert not {"src", "href", "srcset", "action", "data", "poster"} & attributes.keys(), tag
        assert not [name for name in attributes if name.startswith("on")], tag
    own = text.replace(max((code for _, code in parsed.scripts), key=len), "")
    assert len(own) < len(text) / 2
    assert not re.search(r"https?:|wss?:|url\(|@import|fetch\(|XMLHttpRequest|import\(", own)


def test_the_policy_lets_exactly_our_two_scripts_run(paper):
    parsed = Tags(paper[2])
    policy = next(attributes["content"] for tag, attributes in parsed.tags if tag == "meta" and "content" in attributes)
    running = [code for attributes, code in parsed.scripts if "type" not in attributes]
    hashes = [base64.b64encode(hashlib.sha256(code.encode()).digest()).decode() for code in running]
    assert len(running) == 2
    assert re.findall(r"'sha256-([^']+)'", policy) == hashes
    assert script_hashes() == tuple(f"'sha256-{one}'" for one in hashes)
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe-eval" not in policy
    assert "unsafe-inline" not in policy.split("style-src")[0]


def test_the_caption_says_what_is_shown_and_equal_input_gives_equal_bytes(paper):
    at, errors, text = paper
    words = " ".join(" ".join(Tags(text).words).split())
    for expected in (
        "robot paper_4dof",
        "from – to base – tool",
        "pose paper",
        "joints joint1 -90°, joint2 3°, joint3 88°, joint4 -91°",
        "samples N = 400",
        "seed 1",
        "model exact",
        "factor 100",
        f"drawn from the mean error, which is {1e3 * np.linalg.norm(errors[:3].mean(axis=1)):.1f} mm",
        "spec 2 mm @ 99 %",
        "Position error |d|, mm",
        "squares of 500 mm",
        "end effector of 400 sampled robots",
        "MCPC frames 0 to 5",
    ):
        assert expected in words, expected
    assert simple_page(at, errors, name="paper", caption=[("spec", "2 mm @ 99 %")]) == text


def test_cloud_mean_frames_and_tip_are_the_errors_in_metres(paper):
    at, errors, text = paper
    (pose,) = data_block(text, "settings")["poses"]
    points = floats(pose["points"]).reshape(-1, 3)
    np.testing.assert_array_equal(points, errors[:3].T.astype(np.float32))
    np.testing.assert_allclose(pose["mean"], errors.mean(axis=1), rtol=1e-14)
    np.testing.assert_array_equal(pose["frames"], errors[:, :5].T)
    np.testing.assert_array_equal(matrix(pose["tip"]), at.posture.pose)
    np.testing.assert_array_equal([matrix(link) for link in pose["links"]], at.posture.link_poses)
    nodes = nodes_of(text)
    assert nodes["/Grid"].properties == nodes["/Axes"].properties == {"visible": False}


def test_the_bar_has_the_colours_of_viridis_and_ticks_in_mm(paper):
    _, errors, text = paper
    sizes = 1e3 * np.linalg.norm(errors[:3], axis=0)
    bar = re.search(r"style=\"background: linear-gradient\(to right, ([^)]*)\)", text)[1].split(", ")
    settings = data_block(text, "settings")
    assert bar == settings["stops"]
    # viridis, published by matplotlib: its dark end is #440154, lightness grows along it
    assert bar[-1] == "#440154"
    levels = np.array([[int(stop[k : k + 2], 16) for k in (1, 3, 5)] for stop in bar])
    assert (np.diff(levels @ [0.2126, 0.7152, 0.0722]) < 0).all()
    np.testing.assert_allclose(settings["colours"], [1e-3 * sizes.min(), 1e-3 * sizes.max()], rtol=1e-14)
    ticks = [float(tick) for tick in re.findall(r"<span>([\d.]+)</span>", text)]
    np.testing.assert_allclose(ticks, np.linspace(sizes.min(), sizes.max(), 5), atol=0.05)


def test_shapes_stand_where_the_urdf_says(tmp_path):
    at = pose_model(tmp_path, arm_text((BOX, ROLLER, BALL)))
    nodes = nodes_of(simple_page(at))
    links = read(tmp_path / "arm.urdf").link_poses({"turn": 0.4, "bend": -0.7})
    turn_y_to_z = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])

    def expected(link, xyz, rpy):
        cr, sr, cp, sp, cy, sy = (f(a) for a in rpy for f in (np.cos, np.sin))
        rotation = np.array(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, xyz
        return links[link] @ pose

    box = nodes["/meshcat/arm/link0/shape0"]
    assert [geometry_of(box)[edge] for edge in ("width", "height", "depth")] == [0.1, 0.2, 0.3]
    assert (material_of(box)["color"], material_of(box)["opacity"]) == (0xFF0000, 0.5)
    assert material_of(box)["transparent"]
    np.testing.assert_allclose(
        pose_of(nodes, "/meshcat/arm/link0/shape0"), expected("base", (0.01, 0.02, 0.03), (0.1, 0.2, 0.3)), atol=1e-12
    )
    roller = nodes["/meshcat/arm/link1/shape0"]
    assert (geometry_of(roller)["radiusTop"], geometry_of(roller)["radiusBottom"]) == (0.05, 0.05)
    assert geometry_of(roller)["height"] == 0.4
    assert material_of(roller)["color"] == 0x0066FF
    np.testing.assert_allclose(
        pose_of(nodes, "/meshcat/arm/link1/shape0"),
        expected("upper", (0.25, 0, 0), (0, 1.2, 0)) @ turn_y_to_z,
        atol=1e-12,
    )
    assert geometry_of(nodes["/meshcat/arm/link2/shape0"])["radius"] == 0.07
    np.testing.assert_allclose(
        pose_of(nodes, "/meshcat/arm/link2/shape0"), expected("fore", (0, 0, -0.1), (0, 0, 0)), atol=1e-12
    )
    assert not [path for path in nodes if "rod" in path or "drum" in path]


def ends_of_rod(nodes, path):
    pose, height = pose_of(nodes, path), geometry_of(nodes[path])["height"]
    return pose[:3, 3] - pose[:3, 1] * height / 2, pose[:3, 3] + pose[:3, 1] * height / 2


def test_an_arm_without_shapes_is_drawn_as_cylinders_along_its_links(tmp_path):
    nodes = nodes_of(simple_page(pose_model(tmp_path, arm_text())))
    links = read(tmp_path / "arm.urdf").link_poses({"turn": 0.4, "bend": -0.7})
    corners = [links[name][:3, 3] for name in ("base", "upper", "fore", "tool")]
    for number in range(3):
        start, end = ends_of_rod(nodes, f"/meshcat/arm/chain{number}/rod")
        np.testing.assert_allclose([start, end], corners[number : number + 2], atol=1e-12)
    sliding = arm_text().replace('name="bend" type="revolute"', 'name="bend" type="prismatic"')
    assert "/meshcat/arm/joint1/slide" in nodes_of(simple_page(pose_model(tmp_path, sliding)))
    drum = pose_of(nodes, "/meshcat/arm/joint1/drum")
    np.testing.assert_allclose(drum[:3, 3], corners[2], atol=1e-12)
    np.testing.assert_allclose(drum[:3, 1], links["fore"][:3, 1], atol=1e-12)


def mesh_visual(filename, scale=""):
    return visual(f'<mesh filename="{filename}" {scale}/>', '<origin xyz="0 0 0.1"/>', "0.2 0.4 0.6 1")


@pytest.mark.parametrize("kind", ["stl", "obj", "ply", "glb"])
def test_meshes_stand_where_the_urdf_says(tmp_path, kind):
    block = trimesh.creation.box((0.1, 0.2, 0.4))
    block.apply_translation((0.3, 0, 0))
    data = trimesh.exchange.export.export_mesh(block, None, file_type=kind)
    (tmp_path / f"block.{kind}").write_bytes(data if isinstance(data, bytes) else data.encode())
    at = pose_model(tmp_path, arm_text((mesh_visual(f"block.{kind}", 'scale="2 1 0.5"'), ROLLER, BALL)))
    text = simple_page(at)
    nodes = nodes_of(text)
    part = nodes["/meshcat/arm/link0/shape0/part0"]
    data = geometry_of(part)["data"]
    vertices, faces = array_of(data["attributes"]["position"]), array_of(data["index"])
    assert (vertices.shape, faces.shape) == ((8, 3), (12, 3))
    placed = vertices @ pose_of(nodes, "/meshcat/arm/link0/shape0/part0")[:3, :3].T
    placed += pose_of(nodes, "/meshcat/arm/link0/shape0/part0")[:3, 3]
    np.testing.assert_allclose(placed.min(axis=0), [0.5, -0.1, 0.0], atol=1e-6)
    np.testing.assert_allclose(placed.max(axis=0), [0.7, 0.1, 0.2], atol=1e-6)
    volume = np.einsum("fi,fi->f", placed[faces[:, 0]], np.cross(placed[faces[:, 1]], placed[faces[:, 2]])).sum() / 6
    assert volume == pytest.approx(0.2 * 0.2 * 0.2, rel=1e-6)
    assert material_of(part)["color"] == 0x336699
    assert "Notes" not in text


def test_a_meshs_own_colours_come_before_the_urdfs(tmp_path):
    blocks = [trimesh.creation.box((0.1, 0.1, 0.1)) for _ in range(2)]
    for block, colour, shift in zip(blocks, ([255, 0, 0, 255], [0, 0, 255, 255]), (0, 1), strict=True):
        block.visual.face_colors = colour
        block.apply_translation((shift, 0, 0))
    (tmp_path / "two.glb").write_bytes(trimesh.Scene(blocks).export(file_type="glb"))
    nodes = nodes_of(simple_page(pose_model(tmp_path, arm_text((mesh_visual("two.glb"), ROLLER, BALL)))))
    parts = [node for path, node in nodes.items() if path.startswith("/meshcat/arm/link0/shape0/part")]
    assert {material_of(part)["color"] for part in parts} == {0xFF0000, 0x0000FF}


def test_package_names_are_looked_up_in_the_given_folders(tmp_path):
    package = tmp_path / "elsewhere" / "parts"
    package.mkdir(parents=True)
    (tmp_path / "robot").mkdir()
    (package / "block.stl").write_bytes(trimesh.creation.box().export(file_type="stl"))
    at = pose_model(tmp_path / "robot", arm_text((mesh_visual("package://parts/block.stl"), ROLLER, BALL)))
    assert "is not found" in simple_page(at)
    found = simple_page(at, package_dirs=[package.parent])
    assert "Notes" not in found
    assert "/meshcat/arm/link0/shape0/part0" in nodes_of(found)


def test_an_unreadable_mesh_becomes_a_cylinder_and_a_note(tmp_path):
    for filename, content, reason in (
        ("lost.stl", None, "does not exist"),
        ("short.stl", b"solid", "too short"),
        ("odd.blend", b"BLENDER", "unknown kind"),
        ("huge.stl", b"\0" * 80 + b"\xff\xff\xff\x7f" + b"\0" * 50, "claims"),
        ("bad.dae", b"<COLLADA><unclosed>", "XML"),
        ("empty.dae", b"<COLLADA/>", "empty.dae"),
        ("bad.obj", b"v 0 0 0\nf 1 2 9\n", "indices"),
        ("http://example.org/part.stl", None, "not fetched"),
        ("/etc/hostname.stl", None, "outside"),
    ):
        if content is not None:
            (tmp_path / filename).write_bytes(content)
        text = simple_page(pose_model(tmp_path, arm_text((BOX, mesh_visual(filename), BALL))))
        note = re.search(r"<ul class='notes'>(.*?)</ul>", text)[1]
        assert reason in note
        assert "drawn as a plain cylinder" in note
        links = read(tmp_path / "arm.urdf").link_poses({"turn": 0.4, "bend": -0.7})
        ends = ends_of_rod(nodes_of(text), "/meshcat/arm/link1/rod0")
        np.testing.assert_allclose(ends, [links["upper"][:3, 3], links["fore"][:3, 3]], atol=1e-12)


def test_nothing_of_the_input_becomes_markup(tmp_path):
    hostile = escape(HOSTILE)
    text = arm_text((BOX, mesh_visual(f"{hostile}.stl"), BALL), name=hostile)
    for name in ("turn", "bend", "base"):
        text = text.replace(f'"{name}"', f'"{name}{hostile}"')
    at = pose_model(tmp_path, text)
    shown = simple_page(at, title=HOSTILE, model_name=HOSTILE, name=HOSTILE, caption=[(HOSTILE, HOSTILE)])
    assert HOSTILE not in shown
    parsed = Tags(shown)
    assert "img" not in {tag for tag, _ in parsed.tags}
    assert len(parsed.scripts) == 4
    assert " ".join(parsed.words).count(HOSTILE) >= 7
    paths = {command["path"] for command in commands_of(shown)}
    assert all(re.fullmatch(r"[/A-Za-z0-9]+", path) for path in paths)
    text = simple_page(at, title="a\u202eb\x00c\ud800d\ne\N{NO-BREAK SPACE}f")
    assert "<h1>a\ufffdb\ufffdc\ufffdd e f</h1>".replace("\ufffdd", "\ufffdd") in text
    text.encode("utf-8")


def drawn_points(text):
    return [len(floats(pose["points"])) // 3 for pose in data_block(text, "settings")["poses"]]


@pytest.mark.slow
def test_the_cloud_is_capped_and_shared_by_the_poses_and_the_page_stays_small(tmp_path):
    at = pose_model(tmp_path, arm_text())
    errors = made_up_errors(MOST_POINTS + 1)
    text = simple_page(at, errors)
    assert drawn_points(text) == [DEFAULT_POINTS]
    assert "N = 100,001, of which the first 20,000 are drawn" in text
    most = simple_page(at, errors, points=MOST_POINTS)
    assert drawn_points(most) == [MOST_POINTS]
    # 12 bytes a point, in base64
    assert len(most) - len(text) == pytest.approx(80_000 * 16, abs=10)
    assert len(most) < 3e6
    for count, each in ((4, DEFAULT_POINTS), (10, 10_000)):
        assert drawn_points(pages([ViewPose(at, errors[:, :30_000])] * count)) == [each] * count
    # with as many points each as there are for the most poses: what each pose adds is small
    paper = ErrorModel.load(PAPER_SHEET)
    one = ViewPose(paper.at(), paper.at().exact(paper.space.sample(1, 0, MOST_POINTS // MOST_POSES)))
    alone, several = (len(pages([one] * number)) for number in (1, 11))
    assert alone + (MOST_POSES - 1) * (several - alone) / 10 < 6e6


def test_bad_arguments_are_refused_in_one_line(paper, tmp_path):
    at, two = paper[0], np.zeros((6, 2))
    for errors, settings, message in (
        (np.zeros((5, 3)), {}, "expected (6, N)"),
        (np.zeros(6), {}, "expected (6, N)"),
        (np.zeros((6, 0)), {}, "N of 1 or more"),
        (np.full((6, 2), np.nan), {}, "finite"),
        (two, {"factor": 0}, "positive number from 1e-9 to 1e12, got 0"),
        (two, {"factor": float("inf")}, "positive number"),
        (two, {"factor": 1e308}, "from 1e-9 to 1e12, got 1e+308"),
        (two, {"factor": 1e-320}, "from 1e-9 to 1e12"),
        (two, {"points": MOST_POINTS + 1}, "1 to 100,000 points, got 100001"),
        (two, {"points": 0}, "1 to 100,000 points"),
        (two, {"points": True}, "1 to 100,000 points"),
    ):
        with pytest.raises(InputError, match=re.escape(message)) as caught:
            simple_page(at, errors, **settings)
        assert "\n" not in str(caught.value)
    other = pose_model(tmp_path, arm_text())
    for poses, message in (
        ([], "1 to 200 poses, got 0"),
        ([ViewPose(at, two)] * 201, "1 to 200 poses, got 201"),
        ([ViewPose(at, two), ViewPose(other, two)], "of one chain"),
        ([ViewPose(at, two), ViewPose(at, np.zeros((6, 3)))], "equally many samples"),
    ):
        with pytest.raises(InputError, match=re.escape(message)):
            pages(poses)


def test_errors_without_spread_make_a_page(paper):
    for errors in (np.zeros((6, 9)), np.full((6, 1), 1e-5)):
        text = simple_page(paper[0], errors)
        (tick,) = re.findall(r"<span>([\d.]+)</span>", text)
        assert float(tick) == pytest.approx(1e6 * np.sqrt(3) * errors[0, 0], abs=0.1)
        assert "Position error |d|, µm" in text


def test_a_given_factor_is_where_the_slider_starts(paper):
    for factor, smallest, largest in ((37.5, 1.0, 375.0), (0.5, 0.5, 10.0)):
        settings = data_block(simple_page(*paper[:2], factor=factor), "settings")
        assert (settings["factor"], settings["smallest"], settings["largest"]) == (factor, smallest, largest)


@pytest.mark.slow
@pytest.mark.skipif(not example_urdfs(), reason="example-robot-data is not installed")
@pytest.mark.parametrize(("name", "tip"), [("ur5", "tool0"), ("so101", "gripper_frame_link")])
def test_real_arms_with_every_point_make_pages_under_6_mb(name, tip):
    chain = Chain.from_urdf(example_urdfs()[name], tip=tip)
    at = ErrorModel(chain, Space(), []).at(np.full(len(chain.joints), 0.3))
    text = simple_page(at, made_up_errors(MOST_POINTS), points=MOST_POINTS)
    assert len(text) < 6e6
    assert "drawn as a plain" not in text
    nodes = nodes_of(text)
    meshes = sum(len(link.visuals) for link in chain.robot.links)
    assert len({path.rpartition("/")[0] for path in nodes if "/part" in path}) == meshes


@pytest.mark.slow
def test_the_script_writes_its_pages(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["view_poses.py", str(tmp_path)])
    runpy.run_path(str(SCRIPTS / "view_poses.py"), run_name="__main__")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["view_folded.html", "view_paper.html"]
    assert capsys.readouterr().out.count("half of the units") == 2


def test_arm_length_is_the_way_over_the_joints(tmp_path):
    assert arm_length(pose_model(tmp_path, arm_text()).posture) == pytest.approx(0.2 + 0.5 + 0.3, rel=1e-14)


@pytest.mark.slow
@given(st.floats(1e-6, 1e6))
def test_round_numbers_are_1_2_5_and_near(value):
    rounded = round_number(value)
    assert f"{rounded:e}"[0] in "125"
    assert float(f"{rounded:.0e}") == rounded
    assert abs(np.log(rounded / value)) <= np.log(2.5) / 2 * (1 + 1e-12)


@pytest.fixture(scope="module")
def posture(tmp_path_factory):
    return pose_model(tmp_path_factory.mktemp("arm"), arm_text()).posture


def ball(deviation: float, at: tuple[float, float, float] = (0, 0, 0)) -> np.ndarray:
    """Return six points with one standard deviation in every direction."""
    return np.hstack([np.eye(3), -np.eye(3)]) * deviation * np.sqrt(3) + np.array(at)[:, None]


def picture(points: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Return points ``(N, 3)`` as seen from a direction, ``(N, 2)``: the camera's turn, by its azimuth and elevation."""
    azimuth, elevation = np.arctan2(direction[1], direction[0]), np.arctan2(direction[2], np.hypot(*direction[:2]))
    turned = points @ np.array(
        [[np.cos(azimuth), -np.sin(azimuth), 0], [np.sin(azimuth), np.cos(azimuth), 0], [0, 0, 1]]
    )
    # now the camera looks from +x, raised by the elevation
    up = turned[:, 2] * np.cos(elevation) - turned[:, 0] * np.sin(elevation)
    return np.column_stack([turned[:, 1], up])


@pytest.mark.slow
@given(st.floats(1e-8, 1e-3))
def test_the_cloud_spans_a_fifth_to_a_third_of_the_picture(posture, deviation):
    factor = default_factor(ball(deviation), posture)
    assert float(f"{factor:e}".split("e")[0]) in (1, 1.5, 2, 3, 5, 7)
    joints = np.vstack([posture.link_poses[:, :3, 3], posture.pose[:3, 3]])
    seen = picture(joints, view_direction(posture))
    half = 2.5 * factor * deviation
    seen = np.vstack([seen, seen[-1] - half, seen[-1] + half])
    width, height = np.ptp(seen, axis=0) / 0.9
    if factor > 1:
        assert 0.2 <= 2 * half / max(width, 1.2 * height) <= 0.36


def test_the_arm_is_not_lost_beside_a_far_mean(posture):
    # 30 mm away and hardly any spread: at 1000 the cloud would stand 30 m away from the arm of 1 m
    factor = default_factor(ball(1e-5, (0, 0, -0.03)), posture)
    seen = picture(np.vstack([posture.link_poses[:, :3, 3], posture.pose[:3, 3]]), view_direction(posture))
    both = np.vstack([seen, seen[-1] + picture(np.array([[0, 0, -0.03 * factor]]), view_direction(posture))])
    size = [max(np.ptp(points[:, 0]), 1.2 * np.ptp(points[:, 1])) for points in (seen, both)]
    assert 10 <= factor <= 50
    assert size[0] > 0.44 * size[1]


def test_errors_are_drawn_from_their_mean_where_it_is_far_larger_than_their_spread():
    direction = np.array([2.0, -1.0, 2.0]) / 3
    spread = np.sqrt(3) * 1e-3  # one standard deviation in each of three directions
    np.testing.assert_array_equal(middle_of(ball(1e-3, tuple(2.9 * spread * direction))), np.zeros(3))
    np.testing.assert_allclose(middle_of(ball(1e-3, tuple(3.1 * spread * direction))), 3.1 * spread * direction)
    # without spread the way from the tip is all there is to see
    np.testing.assert_array_equal(middle_of(np.full((3, 9), 1e-3)), np.zeros(3))


def test_a_cloud_is_seen_from_a_wide_side(posture):
    # all errors lie along the usual line of sight: the camera turns until they are seen, and a round cloud turns nothing
    usual = view_direction(posture)
    level = usual * [1, 1, 0] / np.linalg.norm(usual[:2])
    line = np.random.default_rng(1).normal(size=500) * 1e-4 * level[:, None]
    turned = view_direction(posture, line)
    across = [np.ptp(picture(line.T, direction)[:, 0]) for direction in (usual, turned)]
    assert across[1] > 0.4 * np.ptp(np.linalg.norm(line, axis=0)) > across[0]
    np.testing.assert_array_equal(view_direction(posture, ball(1e-4)), usual)


def test_the_default_factor_never_shrinks_and_stands_zeros(posture):
    assert default_factor(ball(0.5), posture) == 1
    assert default_factor(np.zeros((3, 5)), posture) == 1
    assert default_factor(np.full((3, 1), 0.01 / np.sqrt(3)), posture) > 1


def test_ticks_have_units_and_enough_digits():
    assert ColourScale(0.0, 1e-3).unit == WrittenUnit("mm", 1e3)
    assert ColourScale(0.0, 1e-3).ticks == ("0.00", "0.25", "0.50", "0.75", "1.00")
    assert ColourScale(30e-3, 30.004e-3).ticks == ("30.0000", "30.0010", "30.0020", "30.0030", "30.0040")
    assert ColourScale(0.0, 8e-6).unit == WrittenUnit("µm", 1e6)
    assert ColourScale(0.0, 8e-6).ticks == ("0.0", "2.0", "4.0", "6.0", "8.0")
    assert ColourScale(0.4, 0.8).ticks == ("400", "500", "600", "700", "800")
    assert ColourScale(0.0, 0.0).ticks == ("0",)
    assert ColourScale.of([0.02, 0.02 + 1e-16]).ticks == ("20.0",)


def test_thinning_keeps_the_shape():
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.5)
    whole = Surface(np.asarray(ball.vertices), np.asarray(ball.faces), None)
    (reduced,) = thinned([whole], 1.0, most_faces=5000)
    assert 500 < len(reduced.faces) <= 5000
    assert reduced.faces.max() < len(reduced.vertices)
    radii = np.linalg.norm(reduced.vertices, axis=1)
    assert radii.min() > 0.48
    assert radii.max() <= 0.5 + 1e-12
    corners = reduced.vertices[reduced.faces]
    volume = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume == pytest.approx(4 / 3 * np.pi * 0.125, rel=0.02)


def test_small_meshes_are_only_freed_of_doubled_corners():
    block = trimesh.creation.box((0.1, 0.2, 0.3))
    soup = Surface(np.asarray(block.triangles).reshape(-1, 3), np.arange(36).reshape(12, 3), (1, 0, 0, 1))
    (joined,) = thinned([soup], 1.0)
    assert (len(joined.vertices), len(joined.faces), joined.colour) == (8, 12, (1, 0, 0, 1))
    assert {*map(tuple, joined.vertices.round(12))} == {*map(tuple, block.vertices.round(12))}


def test_triangles_that_do_not_hang_together_are_never_thinned_to_none():
    generator = np.random.default_rng(5)
    corners = generator.uniform(-0.5, 0.5, (20_000, 1, 3)) + generator.normal(0, 1e-2, (20_000, 3, 3))
    heap = Surface(corners.reshape(-1, 3), np.arange(60_000).reshape(-1, 3), None)
    same = Surface(np.tile([[0.0, 0, 0], [0.3, 0, 0], [0, 0.3, 0]], (20_000, 1)), heap.faces, None)
    for soup in (heap, same):
        dust = Surface(1e-9 * np.eye(3), np.array([[0, 1, 2]]), None)
        reduced, gone, box = thinned([soup, dust, replace(dust, vertices=np.eye(3))], 1.0, most_faces=1000)
        assert len(gone.faces) == 0
        assert 200 < len(reduced.faces) <= 1000
        assert len(reduced.vertices) <= 3000
        assert reduced.faces.max() < len(reduced.vertices)
        np.testing.assert_allclose(np.ptp(reduced.vertices, axis=0), np.ptp(soup.vertices, axis=0), atol=0.2)
        assert len(box.faces) == 1
