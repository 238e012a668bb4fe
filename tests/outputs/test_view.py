import base64
import hashlib
import re
import shutil
from dataclasses import replace
from html import escape
from pathlib import Path

import numpy as np
import pytest
import scipy.stats
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

import precision_pin as pp
from outputs.report_cases import Reader
from outputs.view_cases import (
    arm_model,
    arm_text,
    commands_of,
    data_block,
    floats,
    likeness,
    made_up_errors,
    matrix,
    nodes_of,
    pages,
    pose_model,
    simple_page,
)
from precision_pin.base import se3
from precision_pin.pages.view import DEFAULT_POINTS, MOST_POINTS, MOST_POSES, ViewPose, live, script_hashes
from precision_pin.pages.view.headline import answers
from precision_pin.pages.view.poses import (
    Groups,
    choose_groups,
    ellipsoids,
    link_shares,
    samples_that_fit,
    tangent_of,
)
from precision_pin.pages.view.scales import arm_length, default_factor, joint_points, middle_of, view_direction
from precision_pin.render.display_units import ColourScale, round_number
from precision_pin.robot import mcpc
from precision_pin.robot.examples import PAPER_SHEET, example_urdfs
from precision_pin.robot.mesh_surfaces import Surface, thinned
from precision_pin.robot.trajectory import read_trajectory
from precision_pin.robot.urdf import read
from precision_pin.sources import Frame, JointOffset, Mcpc, Source
from support.sheets import SEVEN_Q, everything, seven_joint_arm

HOSTILE = "</script><img src=x onerror=alert(1)>"
TYPES = {0x12: np.uint8, 0x15: np.int32, 0x16: np.uint32, 0x17: np.float32}


def visual(geometry: str, origin: str = "", colour: str = "") -> str:
    material = f'<material name=""><color rgba="{colour}"/></material>' if colour else ""
    return f"<visual>{origin}<geometry>{geometry}</geometry>{material}</visual>"


BOX = visual('<box size="0.1 0.2 0.3"/>', '<origin xyz="0.01 0.02 0.03" rpy="0.1 0.2 0.3"/>', "1 0 0 0.5")
ROLLER = visual('<cylinder radius="0.05" length="0.4"/>', '<origin xyz="0.25 0 0" rpy="0 1.2 0"/>', "0 0.4 1 1")
SMALL = pp.Uniform(1e-3)
BALL = visual('<sphere radius="0.07"/>', '<origin xyz="0 0 -0.1"/>')


@pytest.fixture(scope="module")
def paper(model):
    at = model.at()
    errors = at.exact(model.space.sample(1, 0, 400))
    return at, errors, simple_page(at, errors, name="paper", caption=[("spec", "2 mm @ 99 %")])


def test_the_page_is_one_file_that_asks_for_nothing_and_runs_exactly_our_two_scripts(paper):
    text = paper[2]
    parsed = Reader(text)
    loading = {"link", "img", "iframe", "object", "embed", "base", "form", "video", "audio", "source"}
    assert not loading & {tag for tag, _ in parsed.tags}
    for tag, attributes in parsed.tags:
        assert not {"src", "href", "srcset", "action", "data", "poster"} & attributes.keys(), tag
        assert not [name for name in attributes if name.startswith("on")], tag
    own = text.replace(max((code for _, code in parsed.scripts), key=len), "")
    assert len(own) < len(text) / 2
    assert not re.search(r"https?:|wss?:|url\(|@import|fetch\(|XMLHttpRequest|import\(", own)
    policy = next(attributes["content"] for tag, attributes in parsed.tags if tag == "meta" and "content" in attributes)
    running = [code for attributes, code in parsed.scripts if "type" not in attributes]
    hashes = [base64.b64encode(hashlib.sha256(code.encode()).digest()).decode() for code in running]
    assert len(running) == 2
    assert script_hashes() == tuple(f"'sha256-{one}'" for one in hashes)
    assert policy.startswith(f"default-src 'none'; script-src {' '.join(script_hashes())}; style-src ")
    assert "unsafe-eval" not in policy


def test_the_caption_says_what_is_shown_and_equal_input_gives_equal_bytes(paper):
    at, errors, text = paper
    words = " ".join(" ".join(Reader(text).words).split())
    for expected in (
        "robot paper_4dof from – to base – tool pose paper joints joint1 -90°, joint2 3°, joint3 88°, joint4 -91°",
        "samples N = 400 seed 1 model exact factor 100",
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
    assert_array_equal(points, errors[:3].T.astype(np.float32))
    assert_allclose(pose["mean"], errors.mean(axis=1), rtol=1e-14)
    assert_array_equal(pose["frames"], errors[:, :5].T)
    assert_array_equal(matrix(pose["tip"]), at.posture.pose)
    assert_array_equal([matrix(link) for link in pose["links"]], at.posture.link_poses)
    nodes = nodes_of(text)
    assert nodes["/Grid"].properties == nodes["/Axes"].properties == {"visible": False}


def test_the_bar_has_the_colours_of_viridis_and_ticks_in_mm(paper):
    _, errors, text = paper
    sizes = 1e3 * np.linalg.norm(errors[:3], axis=0)
    ends = np.array([sizes.min(), sizes.max()])
    bar = re.search(r"style=\"background: linear-gradient\(to right, ([^)]*)\)", text)[1].split(", ")
    settings = data_block(text, "settings")
    assert bar == settings["stops"]
    # viridis, published by matplotlib: its dark end is #440154, lightness grows along it
    assert bar[-1] == "#440154"
    levels = np.array([[int(stop[k : k + 2], 16) for k in (1, 3, 5)] for stop in bar])
    assert (np.diff(levels @ [0.2126, 0.7152, 0.0722]) < 0).all()
    assert_allclose(settings["colours"], 1e-3 * ends, rtol=1e-14)
    ticks = [float(tick) for tick in re.findall(r"<span>([\d.]+)</span>", text)]
    assert_allclose(ticks, np.linspace(*ends, 5), atol=0.05)


def test_shapes_stand_where_the_urdf_says(tmp_path):
    at = pose_model(tmp_path, arm_text((BOX, ROLLER, BALL)))
    nodes = nodes_of(simple_page(at))
    links = read(tmp_path / "arm.urdf").link_poses({"turn": 0.4, "bend": -0.7})
    turn_y_to_z = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])
    paths = [f"/meshcat/arm/link{k}/shape0" for k in range(3)]
    box, roller, round_one = (nodes[path] for path in paths)
    assert [geometry_of(box)[edge] for edge in ("width", "height", "depth")] == [0.1, 0.2, 0.3]
    assert [material_of(box)[name] for name in ("color", "opacity", "transparent")] == [0xFF0000, 0.5, True]
    assert [geometry_of(roller)[size] for size in ("radiusTop", "radiusBottom", "height")] == [0.05, 0.05, 0.4]
    assert (material_of(roller)["color"], geometry_of(round_one)["radius"]) == (0x0066FF, 0.07)
    for path, link, xyz, rpy, turn in (
        (paths[0], "base", (0.01, 0.02, 0.03), (0.1, 0.2, 0.3), np.eye(4)),
        (paths[1], "upper", (0.25, 0, 0), (0, 1.2, 0), turn_y_to_z),
        (paths[2], "fore", (0, 0, -0.1), (0, 0, 0), np.eye(4)),
    ):
        expected = links[link] @ se3.pose(se3.rpy_rotation(rpy), xyz) @ turn
        assert_allclose(pose_of(nodes, path), expected, atol=1e-12, err_msg=path)
    assert not [path for path in nodes if "rod" in path or "drum" in path]


def pose_of(nodes, path: str) -> np.ndarray:
    """Return a node's pose in the base: the product of the transforms on the way to it."""
    pose = np.eye(4)
    parts = path.strip("/").split("/")
    for end in range(1, len(parts) + 1):
        node = nodes.get("/" + "/".join(parts[:end]))
        if node is not None and node.transform is not None:
            pose = pose @ node.transform
    return pose


def array_of(attribute: dict) -> np.ndarray:
    values = np.frombuffer(attribute["array"].data, TYPES[attribute["array"].type])
    return values.reshape(-1, attribute["itemSize"])


def geometry_of(node) -> dict:
    return node.object["geometries"][0]


def material_of(node) -> dict:
    return node.object["materials"][0]


def ends_of_rod(nodes, path):
    pose, height = pose_of(nodes, path), geometry_of(nodes[path])["height"]
    return pose[:3, 3] - pose[:3, 1] * height / 2, pose[:3, 3] + pose[:3, 1] * height / 2


def test_an_arm_without_shapes_is_drawn_as_cylinders_along_its_links(tmp_path):
    nodes = nodes_of(simple_page(pose_model(tmp_path, arm_text())))
    links = read(tmp_path / "arm.urdf").link_poses({"turn": 0.4, "bend": -0.7})
    corners = [links[name][:3, 3] for name in ("base", "upper", "fore", "tool")]
    for number in range(3):
        start, end = ends_of_rod(nodes, f"/meshcat/arm/chain{number}/rod")
        assert_allclose([start, end], corners[number : number + 2], atol=1e-12)
    sliding = arm_text().replace('name="bend" type="revolute"', 'name="bend" type="prismatic"')
    assert "/meshcat/arm/joint1/slide" in nodes_of(simple_page(pose_model(tmp_path, sliding)))
    drum = pose_of(nodes, "/meshcat/arm/joint1/drum")
    assert_allclose(drum[:3, 3], corners[2], atol=1e-12)
    assert_allclose(drum[:3, 1], links["fore"][:3, 1], atol=1e-12)


def mesh_visual(filename, scale=""):
    return visual(f'<mesh filename="{filename}" {scale}/>', '<origin xyz="0 0 0.1"/>', "0.2 0.4 0.6 1")


@pytest.mark.parametrize("kind", ["stl", "glb"])
def test_meshes_stand_where_the_urdf_says(tmp_path, kind):
    block = trimesh.creation.box((0.1, 0.2, 0.4))
    block.apply_translation((0.3, 0, 0))
    data = trimesh.exchange.export.export_mesh(block, None, file_type=kind)
    (tmp_path / f"block.{kind}").write_bytes(data if isinstance(data, bytes) else data.encode())
    at = pose_model(tmp_path, arm_text((mesh_visual(f"block.{kind}", 'scale="2 1 0.5"'), ROLLER, BALL)))
    text = simple_page(at)
    nodes = nodes_of(text)
    part, pose = nodes[path := "/meshcat/arm/link0/shape0/part0"], pose_of(nodes, path)
    data = geometry_of(part)["data"]
    vertices, faces = array_of(data["attributes"]["position"]), array_of(data["index"])
    assert (vertices.shape, faces.shape) == ((8, 3), (12, 3))
    placed = vertices @ pose[:3, :3].T + pose[:3, 3]
    assert_allclose([placed.min(axis=0), placed.max(axis=0)], [[0.5, -0.1, 0.0], [0.7, 0.1, 0.2]], atol=1e-6)
    assert trimesh.Trimesh(placed, faces).volume == pytest.approx(0.2 * 0.2 * 0.2, rel=1e-6)
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
        ("bad.obj", b"v 0 0 0\nf 1 2 9\n", "indices"),
    ):
        if content is not None:
            (tmp_path / filename).write_bytes(content)
        text = simple_page(pose_model(tmp_path, arm_text((BOX, mesh_visual(filename), BALL))))
        note = re.search(r"<ul class='notes'>(.*?)</ul>", text)[1]
        assert reason in note
        assert "drawn as a plain cylinder" in note
        links = read(tmp_path / "arm.urdf").link_poses({"turn": 0.4, "bend": -0.7})
        ends = ends_of_rod(nodes_of(text), "/meshcat/arm/link1/rod0")
        assert_allclose(ends, [links["upper"][:3, 3], links["fore"][:3, 3]], atol=1e-12)


def test_nothing_of_the_input_becomes_markup(tmp_path):
    hostile = escape(HOSTILE)
    text = arm_text((BOX, mesh_visual(f"{hostile}.stl"), BALL), name=hostile)
    for name in ("turn", "bend", "base"):
        text = text.replace(f'"{name}"', f'"{name}{hostile}"')
    at = pose_model(tmp_path, text)
    shown = simple_page(at, title=HOSTILE, model_name=HOSTILE, name=HOSTILE, caption=[(HOSTILE, HOSTILE)])
    assert HOSTILE not in shown
    parsed = Reader(shown)
    assert "img" not in {tag for tag, _ in parsed.tags}
    assert len(parsed.scripts) == 4
    assert " ".join(parsed.words).count(HOSTILE) >= 7
    paths = {command["path"] for command in commands_of(shown)}
    assert all(re.fullmatch(r"[/A-Za-z0-9]+", path) for path in paths)
    text = simple_page(at, title="a\u202eb\x00c\ud800d\ne\N{NO-BREAK SPACE}f")
    assert "<h1>a\ufffdb\ufffdc\ufffdd e f</h1>" in text
    text.encode("utf-8")


def drawn_points(text):
    return [len(floats(pose["points"])) // 3 for pose in data_block(text, "settings")["poses"]]


@pytest.mark.slow
def test_the_cloud_is_capped_and_shared_by_the_poses_and_the_page_stays_small(model, tmp_path):
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
    # of 600,000 numbers: one for all ten poses, and two for each
    space = pp.Space([pp.Draw("a", pp.Normal(1.0)), pp.Draw("b", pp.Normal(1.0), pp.Scope.VISIT)])
    assert samples_that_fit(space, Groups(("a", "both"), ((0,), (0, 1))), 10) == 600_000 // 21
    # with as many points each as there are for the most poses: what each pose adds is small
    one = ViewPose(model.at(), model.at().exact(model.space.sample(1, 0, MOST_POINTS // MOST_POSES)))
    alone, several = (len(pages([one] * number)) for number in (1, 11))
    assert alone + (MOST_POSES - 1) * (several - alone) / 10 < 6e6


def test_bad_arguments_are_refused_in_one_line(paper, tmp_path):
    at, two = paper[0], np.zeros((6, 2))
    pair, other = ViewPose(at, two), ViewPose(pose_model(tmp_path, arm_text()), two)
    for poses, settings, message in (
        ([ViewPose(at, np.zeros((5, 3)))], {}, "expected (6, N)"),
        ([ViewPose(at, np.zeros(6))], {}, "expected (6, N)"),
        ([ViewPose(at, np.zeros((6, 0)))], {}, "N of 1 or more"),
        ([ViewPose(at, np.full((6, 2), np.nan))], {}, "finite"),
        ([pair], {"factor": 0}, "positive number from 1e-9 to 1e12, got 0"),
        ([pair], {"factor": 1e308}, "from 1e-9 to 1e12, got 1e+308"),
        ([pair], {"points": MOST_POINTS + 1}, "1 to 100,000 points, got 100001"),
        ([pair], {"points": True}, "1 to 100,000 points"),
        ([], {}, "1 to 200 poses, got 0"),
        ([pair] * 201, {}, "1 to 200 poses, got 201"),
        ([pair, other], {}, "of one chain"),
        ([pair, ViewPose(at, np.zeros((6, 3)))], {}, "equally many samples"),
    ):
        with pytest.raises(pp.InputError, match=re.escape(message)) as caught:
            pages(poses, **settings)
        assert "\n" not in str(caught.value)


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
def test_a_real_arm_with_every_point_makes_a_page_under_6_mb():
    chain = pp.Chain.from_urdf(example_urdfs()["so101"], tip="gripper_frame_link")
    at = pp.ErrorModel(chain, pp.Space(), []).at(np.full(len(chain.joints), 0.3))
    text = simple_page(at, made_up_errors(MOST_POINTS), points=MOST_POINTS)
    assert len(text) < 6e6
    assert "drawn as a plain" not in text
    meshes = sum(len(link.visuals) for link in chain.robot.links)
    assert len({path.rpartition("/")[0] for path in nodes_of(text) if "/part" in path}) == meshes


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
    seen = picture(joint_points(posture), view_direction(posture))
    half = 2.5 * factor * deviation
    seen = np.vstack([seen, seen[-1] - half, seen[-1] + half])
    width, height = np.ptp(seen, axis=0) / 0.9
    if factor > 1:
        assert 0.2 <= 2 * half / max(width, 1.2 * height) <= 0.36


def test_the_arm_is_not_lost_beside_a_far_mean(posture):
    # 30 mm away and hardly any spread: at 1000 the cloud would stand 30 m away from the arm of 1 m
    factor = default_factor(ball(1e-5, (0, 0, -0.03)), posture)
    seen = picture(joint_points(posture), view_direction(posture))
    both = np.vstack([seen, seen[-1] + picture(np.array([[0, 0, -0.03 * factor]]), view_direction(posture))])
    size = [max(np.ptp(points[:, 0]), 1.2 * np.ptp(points[:, 1])) for points in (seen, both)]
    assert 10 <= factor <= 50
    assert size[0] > 0.44 * size[1]


def test_errors_are_drawn_from_their_mean_where_it_is_far_larger_than_their_spread():
    direction = np.array([2.0, -1.0, 2.0]) / 3
    spread = np.sqrt(3) * 1e-3  # one standard deviation in each of three directions
    assert_array_equal(middle_of(ball(1e-3, tuple(2.9 * spread * direction))), np.zeros(3))
    assert_allclose(middle_of(ball(1e-3, tuple(3.1 * spread * direction))), 3.1 * spread * direction)
    # without spread the way from the tip is all there is to see
    assert_array_equal(middle_of(np.full((3, 9), 1e-3)), np.zeros(3))


def test_a_cloud_is_seen_from_a_wide_side(posture):
    # all errors lie along the usual line of sight: the camera turns until they are seen, and a round cloud turns nothing
    usual = view_direction(posture)
    level = usual * [1, 1, 0] / np.linalg.norm(usual[:2])
    line = np.random.default_rng(1).normal(size=500) * 1e-4 * level[:, None]
    turned = view_direction(posture, line)
    across = [np.ptp(picture(line.T, direction)[:, 0]) for direction in (usual, turned)]
    assert across[1] > 0.4 * np.ptp(np.linalg.norm(line, axis=0)) > across[0]
    assert_array_equal(view_direction(posture, ball(1e-4)), usual)


def test_the_default_factor_never_shrinks_and_stands_zeros(posture):
    assert arm_length(posture) == pytest.approx(0.2 + 0.5 + 0.3, rel=1e-14)
    assert default_factor(ball(0.5), posture) == 1
    assert default_factor(np.zeros((3, 5)), posture) == 1
    assert default_factor(np.full((3, 1), 0.01 / np.sqrt(3)), posture) > 1


def test_ticks_have_units_and_enough_digits():
    for low, high, unit, ticks in (
        (0.0, 1e-3, "mm", "0.00 0.25 0.50 0.75 1.00"),
        (30e-3, 30.004e-3, "mm", "30.0000 30.0010 30.0020 30.0030 30.0040"),
        (0.0, 8e-6, "µm", "0.0 2.0 4.0 6.0 8.0"),
        (0.4, 0.8, "mm", "400 500 600 700 800"),
    ):
        scale = ColourScale(low, high)
        assert (scale.unit.name, " ".join(scale.ticks)) == (unit, ticks)
    assert ColourScale(0.0, 8e-6).unit.per_si == 1e6
    assert ColourScale(0.0, 0.0).ticks == ("0",)
    assert ColourScale.of([0.02, 0.02 + 1e-16]).ticks == ("20.0",)


def test_thinning_keeps_the_shape():
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.5)
    whole = Surface(np.asarray(ball.vertices), np.asarray(ball.faces), None)
    (reduced,) = thinned([whole], 1.0, most_faces=5000)
    assert 500 < len(reduced.faces) <= 5000
    assert reduced.faces.max() < len(reduced.vertices)
    radii = np.linalg.norm(reduced.vertices, axis=1)
    assert 0.48 < radii.min() <= radii.max() <= 0.5 + 1e-12
    assert trimesh.Trimesh(reduced.vertices, reduced.faces).volume == pytest.approx(4 / 3 * np.pi * 0.125, rel=0.02)


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
        assert_allclose(np.ptp(reduced.vertices, axis=0), np.ptp(soup.vertices, axis=0), atol=0.2)
        assert len(box.faces) == 1


# a hand beyond the first joint's link, a plate between fixed joints on the way, a grip that moves on its own
BRANCHES = """
  <link name="hand"/><link name="plate"/><link name="grip"/><link name="lamp"/>
  <joint name="to_hand" type="fixed"><origin xyz="0 0.1 0"/><parent link="upper"/><child link="hand"/></joint>
  <joint name="to_grip" type="prismatic"><origin xyz="0.02 0 0"/><parent link="tool"/><child link="grip"/>
    <axis xyz="0 0 1"/><limit lower="-0.1" upper="0.1" effort="1" velocity="1"/></joint>
  <joint name="to_lamp" type="fixed"><origin xyz="0 0.05 0"/><parent link="plate"/><child link="lamp"/></joint>
  <joint name="to_plate" type="fixed"><origin xyz="0.1 0 0"/><parent link="fore"/><child link="plate"/></joint>
"""
BLOCK = '<visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual>'


def branched(folder: Path, *sources: Source) -> pp.ErrorModel:
    """Return the two-link arm with branches; the tool hangs on the plate, which hangs on the forearm."""
    text = arm_text((BLOCK, BLOCK, BLOCK)).replace("</robot>", BRANCHES + "</robot>")
    text = text.replace('<origin xyz="0.3 0 0"/><parent link="fore"/>', '<origin xyz="0.2 0 0"/><parent link="plate"/>')
    return arm_model(folder, text, *sources)


def displaced(pose, error):
    """Return a pose ``(4, 4)`` moved by an error ``[d; δ]``."""
    return se3.pose(se3.exp_rotation(error[3:]) @ pose[:3, :3], pose[:3, 3] + error[:3])


# ellipsoids ----------------------------------------------------------------------------------------------------------


def test_an_ellipsoid_is_the_surface_of_one_distance_and_its_count_is_of_the_samples_inside():
    positions = np.random.default_rng(2).gamma(2.0, size=(3, 500)) * 1e-4
    mean, covariance = positions.mean(axis=1), np.cov(positions)

    def squares(points):
        away = points - mean[:, None]
        return np.einsum("in,in->n", away, np.linalg.solve(covariance, away))

    directions = np.random.default_rng(3).normal(size=(3, 40))
    on_ball = np.vstack([directions / np.linalg.norm(directions, axis=0), np.ones(40)])
    for one in ellipsoids(positions):
        limit = scipy.stats.chi2.ppf(one.share, 3)
        assert_allclose(squares((one.matrix @ on_ball)[:3]), limit, rtol=1e-9)
        assert one.inside == (squares(positions) <= limit).mean()


def test_a_flat_cloud_has_as_many_degrees_of_freedom_as_directions():
    numbers = np.random.default_rng(5).normal(size=(2, 1000)) * 1e-4
    plane = np.array([[1, 0], [0, 1], [1, 1]]) @ numbers
    inner, _ = ellipsoids(plane)
    axes = np.linalg.norm(inner.matrix[:3, :3], axis=0)
    deviations = np.sqrt(np.linalg.eigvalsh(np.cov(plane))[::-1])
    assert_allclose(axes[:2], np.sqrt(scipy.stats.chi2.ppf(0.95, 2)) * deviations[:2], rtol=1e-9)
    assert axes[2] < 1e-3 * axes[1]


def test_the_legend_counts_the_samples_inside(tmp_path):
    errors = made_up_errors(400)
    text = simple_page(pose_model(tmp_path, arm_text()), errors)
    for one in ellipsoids(errors[:3]):
        assert f"{100 * one.inside:.2f} % of the samples inside" in text
    assert "too few samples or no spread" in simple_page(pose_model(tmp_path, arm_text()), errors[:, :3])
    for positions in (np.full((3, 9), 0.1), np.eye(3), np.zeros((3, 1))):
        assert ellipsoids(positions) == ()


# arms as built -------------------------------------------------------------------------------------------------------


def test_a_turned_arm_stands_where_its_joints_turned_would_put_it(tmp_path):
    offsets = {"turn": pp.Normal(10e-3), "bend": pp.Normal(20e-3, mean=5e-3)}
    model = branched(tmp_path, *(JointOffset(joint=name, offset=law) for name, law in offsets.items()))
    at, x = model.at("p"), model.space.sample(1, 0, 20)
    settings = data_block(simple_page(at, at.exact(x)), "settings")
    (pose,) = settings["poses"]
    robot = read(tmp_path / "arm.urdf")
    names = [f"link{number}" for number in range(len(robot.links))]
    sampled = [floats(ghost).reshape(-1, 6) for ghost in pose["ghosts"]]
    assert len(sampled) == 3
    for turned, displacements in [*zip(x.T[:3], sampled, strict=True), ([0, 5e-3], floats(pose["deflected"]))]:
        for factor in (1, 7):
            q = np.array([0.4, -0.7]) + factor * np.array(turned)
            expected = robot.link_poses({"turn": q[0], "bend": q[1], "to_grip": 0.0})
            parts, tip = likeness(settings, 0, np.reshape(displacements, (-1, 6)), factor)
            for name, link in zip(names, robot.links, strict=True):
                assert_allclose(parts[name], expected[link.name], atol=1e-6)
            assert_allclose(tip, expected["tool"], atol=1e-6)


def test_a_displacement_moves_what_lies_beyond_it(tmp_path):
    for source, moved in (
        (Frame(frame="base", x=SMALL), "base upper hand fore plate lamp tool grip"),
        (Frame(link="base", x=SMALL), "upper hand fore plate lamp tool grip"),
        (Frame(frame="plate", x=SMALL), "plate lamp tool grip"),
        (Frame(frame="tool", x=SMALL), "tool grip"),
        (JointOffset(joint="turn", offset=SMALL), "upper hand fore plate lamp tool grip"),
        (Mcpc(link="upper", x=SMALL), "fore plate lamp tool grip"),
        (Mcpc(link="fore", x=SMALL), "tool grip"),
    ):
        model = branched(tmp_path, source)
        at = model.at("p")
        settings = data_block(simple_page(at, at.exact(model.space.sample(1, 0, 20))), "settings")
        links = [link.name for link in model.chain.robot.links]
        # targets of a source follow each other; all of them or none move a link
        counts = dict(zip([part["name"] for part in settings["parts"]], settings["poses"][0]["before"], strict=True))
        assert {links[int(name.removeprefix("link"))] for name, count in counts.items() if count} == set(moved.split())
        assert set(counts.values()) <= {0, len(at.table.targets)}


@pytest.mark.slow
def test_the_tips_of_arms_with_every_kind_of_source_are_the_exact_samples():
    model = everything(seven_joint_arm(), scale=3.0)
    poses = [SEVEN_Q, tuple(-0.5 * value for value in SEVEN_Q)]
    shown = []
    for number, q in enumerate(poses):
        at = model.at(q)
        shown.append(ViewPose(at, at.exact(model.space.sample(1, 0, 10, pose=number)), None, number))
    settings = data_block(pages(shown), "settings")
    for number, one in enumerate(shown):
        pose = settings["poses"][number]
        for unit, packed in enumerate(pose["ghosts"]):
            _, tip = likeness(settings, number, floats(packed).reshape(-1, 6), 1)
            assert_allclose(tip, displaced(one.pose_model.table.pose, one.errors[:, unit]), atol=1e-6)
        _, tip = likeness(settings, number, floats(pose["deflected"]).reshape(-1, 6), 1)
        assert_allclose(tip, displaced(one.pose_model.table.pose, one.pose_model.error_at_means), atol=1e-6)


@pytest.mark.slow
def test_errors_of_another_seed_or_without_a_mean_have_no_arms(model, tmp_path):
    at, x = model.at(), model.space.sample(2, 0, 10)
    text = simple_page(at, at.exact(x))
    assert data_block(text, "settings")["poses"][0]["ghosts"] == []
    assert "none, the errors are not those of this seed" in text
    assert 'id="show-ghosts" disabled' in text
    assert 'id="show-ghosts">' in simple_page(at, at.exact(x), seed=2)
    with pytest.raises(pp.InputError, match="seed"):
        simple_page(at, at.exact(x), seed=-1)
    exact, linear = (data_block(simple_page(at, errors, seed=2), "settings") for errors in (at.exact(x), at.linear(x)))
    assert exact["poses"][0]["ghosts"] == linear["poses"][0]["ghosts"]
    offset = branched(tmp_path, JointOffset(joint="turn", offset=pp.Normal(10e-3))).at("p")
    text = simple_page(offset, offset.exact(offset.space.sample(1, 0, 9)))
    assert 'id="show-deflected" disabled' in text
    assert "the same as without error" in text


# frames and texts ----------------------------------------------------------------------------------------------------


def test_mcpc_frames_are_those_of_the_paper_at_every_pose(model):
    q = [model.configuration(), np.array([0.3, -0.4, 0.5, -0.6])]
    shown = [ViewPose(at, at.exact(model.space.sample(1, 0, 9))) for at in map(model.at, q)]
    settings = data_block(pages(shown), "settings")
    parameters = mcpc.from_chain(model.chain)
    for values, pose in zip(q, settings["poses"], strict=True):
        # frame 0 is the base's; T_i = Q_i V_i goes from frame i, before its joint turns, to frame i + 1
        frames = [se3.pose(se3.rotation_about((0, 0, 1), parameters.base_turn), np.zeros(3))]
        for i in range(5):
            frames[-1] = frames[-1] @ (parameters.joint_pose(i, values[i - 1]) if i else np.eye(4))
            frames.append(frames[-1] @ parameters.link_pose(i))
        found = [matrix(pose["links"][one["link"]]) @ matrix(one["frame"]) for one in settings["mcpc"]]
        assert_allclose(found, frames, atol=1e-12)


MOVING = 1e-8 * np.eye(6)
MILLIMETRE = pp.specification("1 mm @ 95 %")


def interval_in(detail: str) -> tuple[float, float]:
    low, high = re.search(r"interval ([\d.]+) to ([\d.]+)", detail).groups()
    return float(low), float(high)


def test_without_a_limit_the_answer_is_the_95_percent_quantile_with_its_interval():
    errors = made_up_errors(3000, size=1e-3)
    (found,) = answers(errors, (), MOVING)
    sizes = 1e3 * np.linalg.norm(errors[:3], axis=0)
    value = float(re.fullmatch(r"95 % of robots within ([\d.]+) mm", found.text)[1])
    low, high = interval_in(found.detail)
    assert low <= value <= high
    # the law of |d| is known: sigma times a chi variable of three degrees
    assert low < scipy.stats.chi(3).ppf(0.95) < high
    # about 95 % of intervals between such ranks: binomial numbers of samples below each end
    inside = scipy.stats.binom(3000, 0.95)
    assert inside.cdf((sizes < low).sum()) < 0.03
    assert inside.sf((sizes <= high).sum() - 1) < 0.03
    assert found.verdict == ""


def test_a_mean_that_is_far_larger_than_the_spread_has_a_line_of_its_own(tmp_path):
    errors = made_up_errors(3000, size=1e-3) + np.reshape([0.02, 0.02, -0.01, 0, 0, 0], (6, 1))
    _, constant = answers(errors, (), MOVING)
    mean, within = (float(re.search(r"[\d.]+(?= mm)", text)[0]) for text in (constant.text, constant.detail))
    assert constant.text == f"Mean error {mean} mm, the same for every robot"
    # 30 mm long, known to 2σ √(3/N); about it the law is sigma times a chi variable of three degrees
    assert mean == pytest.approx(30.0, abs=2 * np.sqrt(3 / 3000) + 0.05)
    assert within == pytest.approx(scipy.stats.chi(3).ppf(0.95), abs=0.1)
    settings = data_block(simple_page(pose_model(tmp_path, arm_text()), errors), "settings")
    assert settings["aboutMean"]
    assert settings["factor"] == settings["factors"][1] > settings["factors"][0]
    settings = data_block(simple_page(pose_model(tmp_path, arm_text())), "settings")
    assert not settings["aboutMean"]
    assert settings["factor"] == settings["factors"][0]


def test_a_limit_has_a_verdict_and_an_interval():
    errors = made_up_errors(3000, size=1e-3)
    values = {
        "position.norm": np.linalg.norm(errors[:3], axis=0),
        "attitude.norm": np.linalg.norm(errors[3:], axis=0),
        "position.x": np.abs(errors[0]),
    }
    for text, verdict in (
        ("4 mm @ 95 %", "met"),
        ("2 mm @ 95 %", "not met"),
        ("x 0.1 mm @ 50 %", "not met"),
        ("attitude 4 mrad @ 95 %", "met"),
    ):
        limit = pp.specification(text)
        first, size = answers(errors, [limit], MOVING)
        assert first.verdict == verdict
        assert first.text.startswith(verdict.capitalize())
        kept = int((values[limit.quantity] <= limit.limit).sum())
        expected = scipy.stats.binomtest(kept, 3000).proportion_ci(0.95, "exact")
        assert interval_in(first.detail) == pytest.approx((100 * expected.low, 100 * expected.high), abs=0.2)
        assert size.text.startswith("95 % of robots within")


def test_a_quantile_near_the_limit_is_undecided_and_few_samples_say_so():
    errors = made_up_errors(200, size=1e-3)
    limit = float(np.quantile(np.linalg.norm(errors[:3], axis=0), 0.95))
    (first, _) = answers(errors, [replace(MILLIMETRE, limit=limit)], MOVING)
    assert first.verdict == "undecided"
    assert "more samples decide it" in first.detail
    assert "too few" in answers(errors[:, :20], (), MOVING)[0].text
    still, size = answers(np.full((6, 9), 1e-5), [MILLIMETRE], np.zeros((6, 6)))
    assert still.verdict == "nothing to judge"
    assert "all alike" in size.detail


def test_the_verdict_is_the_first_text_of_the_page(tmp_path):
    at = pose_model(tmp_path, arm_text())
    text = simple_page(at, made_up_errors(3000, size=1e-3), specifications=[pp.specification("2 mm @ 95 %")])
    body = text[text.index("<body") :]
    assert body.index("Not met: |d| ≤ 2 mm for 95 %") < body.index("95 % of robots within") < body.index("<main")
    (limit,) = data_block(text, "settings")["limits"]
    assert (limit["row"], limit["limit"], limit["required"]) == (0, 0.002, pytest.approx(0.95))
    assert 'id="show-limit" checked' in text
    assert 'id="show-limit" disabled' in simple_page(at)
    # answers of two analyses, each with the line below it
    lines = ["After a: 1 mm", "Before a:", "After b: 2 mm", "Before b:"]
    above = re.findall(r"<p class='(\w+)'>(.*?)</p>", simple_page(at, headline=lines).partition('id="headline"')[0])
    assert above == list(zip(["answer", "fine"] * 2, lines, strict=True))


# tolerances ----------------------------------------------------------------------------------------------------------


def test_the_first_order_model_is_the_derivative_of_the_errors():
    at = everything(seven_joint_arm()).at(SEVEN_Q)
    mean = at.space.mean
    steps = np.sqrt(np.diag(at.space.covariance))
    moves = 1e-3 * np.diag(steps)
    for model, errors_of in (("exact", at.exact), ("linear", at.linear)):
        centre, jacobian = tangent_of(at, model)
        assert_allclose(centre, errors_of(mean[:, None])[:, 0], atol=1e-15)
        slopes = (errors_of(mean[:, None] + moves) - errors_of(mean[:, None] - moves)) / 2e-3
        assert_allclose(jacobian * steps, slopes, atol=1e-4 * np.abs(slopes).max())


def test_the_largest_contributors_have_a_slider_and_the_others_share_one(paper):
    at, errors, text = paper
    groups = choose_groups([at])
    assert len(groups.names) == len(groups.draws) <= 13
    own = [
        np.trace(at.jacobian[:3, columns] @ draw.covariance @ at.jacobian[:3, columns].T)
        for draw, columns in zip(at.space.draws, at.space.slices, strict=True)
    ]
    alone = [draws[0] for draws in groups.draws if len(draws) == 1]
    assert [at.space.draws[k].name for k in alone] == list(groups.names[: len(alone)])
    assert_allclose([own[k] for k in alone], sorted(own, reverse=True)[: len(alone)], rtol=1e-9)
    (pose,) = data_block(text, "settings")["poses"]
    assert np.sum(pose["live"]["variances"]) == pytest.approx(np.trace(at.covariance[:3, :3]), rel=1e-6)
    assert sum(pose["shares"]) == pytest.approx(1, rel=1e-9)
    # half an axis of an ellipsoid, by the number of directions in which the error varies
    assert_allclose(pose["live"]["reach"], [scipy.stats.chi(k).ppf([0.95, 0.9973]) for k in (1, 2, 3)], rtol=1e-9)
    # errors of another seed follow no slider
    assert data_block(simple_page(at, errors, seed=2), "settings")["poses"][0]["live"] is None


def test_a_link_has_the_share_of_what_sits_in_it_and_in_the_joint_before_it(tmp_path):
    for source, expected in (
        (JointOffset(joint="turn", offset=pp.Normal(1e-3)), [0, 1, 0]),
        (JointOffset(joint="bend", offset=pp.Normal(1e-3)), [0, 0, 1]),
        (Frame(frame="base", x=pp.Normal(1e-3)), [1, 0, 0]),
    ):
        assert link_shares(pose_model(tmp_path, arm_text(), source)) == pytest.approx(expected, abs=1e-12)


HEADER = "joint1,joint2,joint3,joint4"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    for file in PAPER_SHEET.parent.glob("4dof.*"):
        shutil.copy(file, tmp_path)
    # a second pose, and a draw that is another one at each
    edit(tmp_path, "^poses:\n", "poses:\n  straight: 0 10 20 30 deg\n")
    wobble = "  - joint_offset: {joint: joint1, offset: {normal: 1 mrad, scope: pose}}\n"
    edit(tmp_path, "^sources:\n", f"sources:\n{wobble}")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def edit(folder: Path, pattern: str, new: str) -> None:
    sheet = folder / "4dof.errors.yaml"
    text, count = re.subn(pattern, new, sheet.read_text("utf-8"), flags=re.MULTILINE)
    assert count == 1
    sheet.write_text(text, "utf-8")


@pytest.fixture
def view(run):
    def command(*arguments: str) -> tuple[int, str]:
        few = () if "--samples" in arguments else ("--samples", "40")
        found = run("view", "4dof.errors.yaml", *few, "--seed", "3", *arguments, code=None)
        assert found.out == ""
        return found.code, found.err

    return command


def shown_poses(path: Path) -> list[dict]:
    return data_block(path.read_text("utf-8"), "settings")["poses"]


def sampled_positions(pose: dict) -> np.ndarray:
    return floats(pose["points"]).reshape(-1, 3).T


@pytest.mark.fast(3)
@pytest.mark.parametrize(
    ("options", "names"),
    [
        ([], ["straight"]),
        (["--pose", "paper"], ["paper"]),
        (["--pose", "paper", "--pose", "straight"], ["paper (1 of 2)", "straight (2 of 2)"]),
        (["--all-poses"], ["straight (1 of 2)", "paper (2 of 2)"]),
        (["--q", "1 2 3 4 deg"], ["without a name"]),
        (["--trajectory", "way.csv"], ["t = 0 s (1 of 2)", "t = 0.25 s (2 of 2)"]),
    ],
)
def test_the_poses_asked_for_are_shown(view, folder, options, names):
    (folder / "way.csv").write_text(f"t,{HEADER}\n0,0,0.1,0.2,0.3\n0.25,0,0.2,0.3,0.4\n")
    code, said = view(*options, "--out", "page.html")
    assert code == 0
    assert said.splitlines()[-1].startswith("wrote page.html (")
    assert [pose["texts"]["caption-pose"] for pose in shown_poses(folder / "page.html")] == names


@pytest.mark.slow
@pytest.mark.parametrize("model", ["exact", "linear"])
def test_the_same_units_stand_at_every_pose(view, folder, model):
    view("--all-poses", "--model", model, "--out", "page.html")
    error_model = pp.ErrorModel.load(folder / "4dof.errors.yaml")
    for number, (name, pose) in enumerate(zip(("straight", "paper"), shown_poses(folder / "page.html"), strict=True)):
        at = error_model.at(name)
        x = error_model.space.sample(3, 0, 40, pose=number)
        expected = at.exact(x) if model == "exact" else at.linear(x)
        assert_allclose(sampled_positions(pose), expected[:3], rtol=1e-6, atol=1e-12)
        assert len(pose["ghosts"]) == 3


@pytest.mark.slow
def test_many_samples_are_drawn_in_pieces_and_are_those_of_one(view, folder):
    view("--samples", "40000", "--out", "page.html")
    (pose,) = shown_poses(folder / "page.html")
    error_model = pp.ErrorModel.load(folder / "4dof.errors.yaml")
    last = error_model.at().exact(error_model.space.sample(3, 39_990, 10))
    assert_allclose(sampled_positions(pose)[:, -10:], last[:3], rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize(("limit", "code", "verdict"), [("50 mm", 0, "met"), ("1 mm", 1, "not met")])
def test_a_limit_is_judged_in_the_page_and_by_the_exit_code(view, folder, limit, code, verdict):
    found, said = view("--pose", "paper", "--samples", "200", "--spec", limit, "--out", "page.html")
    assert found == code
    assert said.splitlines()[-1].startswith("wrote page.html (")
    assert shown_poses(folder / "page.html")[0]["answers"][0][2] == verdict


@pytest.mark.slow
def test_what_is_assumed_is_said_below_the_answer(view, folder):
    edit(folder, "scope: pose}}", "scope: pose}, assumed: true}")
    view("--out", "page.html")
    text = (folder / "page.html").read_text("utf-8")
    assert "Rests on assumptions: 1 of" in text[: text.index("<main")]


@pytest.mark.slow
def test_a_warning_of_many_poses_is_one_line(view, folder):
    (folder / "way.csv").write_text(f"{HEADER}\n0,0,0,0\n" + "9,0,0,0\n" * 5)
    code, said = view("--trajectory", "way.csv", "--out", "page.html")
    assert code == 0
    (line,) = [line for line in said.splitlines() if "W_JOINT_LIMIT" in line]
    assert line.endswith("(such a warning at 5 of 6 poses)")


WRONG = (
    (["--pose", "paper", "--q", "1 2 3 4 deg"], "--pose and --q exclude each other"),
    (["--pose", "paper", "--all-poses"], "--pose and --all-poses exclude each other"),
    (["--pose", "straigt"], "did you mean 'straight'"),
    (["--trajectory", "none.csv"], "none.csv: error E_TRAJECTORY: the file does not exist"),
    (["--samples", "100001"], "more than a page can show"),
    (["--port", "8000"], "--port is for a page that is served"),
    (["--no-browser"], "--no-browser is for a page that is served"),
    (["--factor", "-1"], "factor must be a positive number"),
    (["--spec", "1"], "has no unit"),
)


def test_what_cannot_be_shown_is_refused_in_one_line_and_writes_nothing(view, folder):
    for options, message in WRONG:
        code, said = view(*options, "--out", "page.html")
        assert code == 2
        (line,) = [line for line in said.splitlines() if " warning " not in line]
        assert message in line
    edit(folder, r"^poses:\n(  .*\n)+", "")
    code, said = view("--all-poses", "--out", "page.html")
    assert (code, "the sheet has no poses" in said) == (2, True)
    assert not (folder / "page.html").exists()


# served --------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_without_a_file_the_page_is_served_and_made_anew(view, folder, monkeypatch):
    served = {}

    def serve(make_page, watched, **options):
        served.update(options, watched=watched, first=make_page())
        edit(folder, "straight: 0 10", "straight: 5 10")
        served["second"] = make_page()
        (folder / "4dof.errors.yaml").write_text("precision-pin: 1\nrobot: [", "utf-8")
        with pytest.raises(pp.InputError):
            make_page()

    monkeypatch.setattr(live, "serve", serve)
    code, _ = view("--no-browser", "--port", "8123")
    assert code == 0
    assert (served["port"], served["open_browser"]) == (8123, False)
    assert [path.name for path in served["watched"]] == ["4dof.errors.yaml", "4dof.urdf"]
    assert all(path.exists() for path in served["watched"])
    assert "joint1 0°" in served["first"]
    assert "joint1 5°" in served["second"]
    # a trajectory is watched too
    (folder / "way.csv").write_text(f"{HEADER}\n0,0,0,0\n")
    seen = []
    monkeypatch.setattr(live, "serve", lambda make_page, watched, **options: seen.extend([*watched, options]))
    shutil.copy(PAPER_SHEET, folder)
    view("--trajectory", "way.csv")
    assert (seen[2].name, seen[3]["port"], seen[3]["open_browser"]) == ("way.csv", 0, True)


# trajectories --------------------------------------------------------------------------------------------------------


def written(folder: Path, content: str) -> Path:
    path = folder / "way.csv"
    path.write_text(content, "utf-8", "surrogateescape", newline="")
    return path


def test_columns_may_stand_in_any_order_with_times_and_blank_lines(tmp_path, model):
    path = written(tmp_path, "\ufefft, joint4 ,joint2,joint1,joint3\r\n0.5,4,2,1,3\r\n\r\n0.75,-4,-2e-1,-1,-3\r\n")
    way = read_trajectory(path, model.chain, 10)
    assert_array_equal(way.values, [[1, 2, 3, 4], [-1, -0.2, -3, -4]])
    assert_array_equal(way.times, [0.5, 0.75])
    last = read_trajectory(written(tmp_path, f"{HEADER},t\n1,2,3,4,5\n"), model.chain, 10)
    assert (last.times.tolist(), last.values.tolist()) == ([5], [[1, 2, 3, 4]])
    untimed = read_trajectory(written(tmp_path, f"{HEADER}\n1,2,3,4\n5,6,7,8\n"), model.chain, 10)
    assert untimed.times is None
    assert untimed.names == ("row 1", "row 2")


def test_a_wrong_trajectory_is_refused_with_its_line(tmp_path, model):
    for content, line, message in (
        ("\n\n", None, "the file is empty"),
        ("\udcff\udcfe", None, "not UTF-8"),
        (f"{HEADER}\n", 1, "no poses"),
        ("joint1,joint2,joint3\n1,2,3\n", 1, "no column for the joints joint4"),
        (f"{HEADER},joint5\n1,2,3,4,5\n", 1, "'joint5' is no joint of the chain; did you mean"),
        (f"{HEADER},joint1\n1,2,3,4,5\n", 1, "'joint1' has two columns"),
        (f"{HEADER}\n1,2,3,4\n\n1,2,3\n", 4, "3 values for 4 columns"),
        (f"{HEADER}\n1,2,3,4\n1,2,,4\n", 3, "joint3: '' is not a finite number"),
        (f"{HEADER}\n1,2,3,90 deg\n", 2, "joint4: '90 deg' is not a finite number"),
        (f"{HEADER}\n1,nan,3,4\n", 2, "joint2: 'nan' is not a finite number"),
        (f"t,{HEADER}\n1,1,2,3,4\n0.5,1,2,3,4\n", 3, "the time goes back from 1 s to 0.5 s"),
        (f"t,{HEADER}\n0,1,2,3,4\n0,1,2,3,4\n", 3, "the time stands still at 0 s"),
        (f"{HEADER}\n" + "1,2,3,4\n" * 4, 5, "more than 3 poses"),
    ):
        path = written(tmp_path, content)
        with pytest.raises(pp.InputError) as caught:
            read_trajectory(path, model.chain, 3)
        (finding,) = caught.value.findings
        assert (finding.file, finding.line) == (str(path), line)
        assert message in finding.message
        assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_the_map_of_a_grid_is_in_the_page_and_its_file_is_not_written_over(view, folder):
    grid = folder / "grid.yaml"
    grid.write_text("joints: {joint1: 0 90 deg, joint2: 10 40 deg, joint3: 45 deg, joint4: 0 deg}\n")
    code, said = view("--map", "grid.yaml", "--out", "page.html")
    assert code == 0, said
    assert "4 places, coloured by the worst pose at each<" in (folder / "page.html").read_text("utf-8")
    grid.write_text(grid.read_text().replace("joint1", "joint9"))
    code, said = view("--map", "grid.yaml", "--out", "other.html")
    assert (code, "grid.yaml" in said, "joint9" in said) == (2, True, True)
    assert not (folder / "other.html").exists()
