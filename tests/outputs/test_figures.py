"""The pictures: text sizes and overlaps by measured extents, what is marked, and how files are written."""

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from numpy.testing import assert_allclose

import precision_pin as pp
from precision_pin.analyses.budget.figure import Bar, draw_bars
from precision_pin.analyses.calibration import figure as calibration_figures
from precision_pin.analyses.map.figure import figure as map_figure
from precision_pin.analyses.pose_layout import layout_of
from precision_pin.analyses.registry import declarations
from precision_pin.analyses.shares import VECTORS
from precision_pin.analyses.worst_case.figure import explain_excess
from precision_pin.base import se3
from precision_pin.base.errors import UnknownNameError
from precision_pin.base.written_units import WrittenUnit
from precision_pin.pages.view import drawing
from precision_pin.pages.view.drawing import Camera, Cloud, draw_picture, draw_triangles
from precision_pin.render.draw_distribution import display_unit
from precision_pin.render.scene import Triangles
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.robot.pose_set import PoseSet
from precision_pin.sampling import figures as plots
from precision_pin.sampling.many_poses import sample_poses
from precision_pin.sources.joint_offset import JointOffset
from precision_pin.statistics import Plan, Specification, Summary, finish, observe, start
from support.figures import drawn_texts, overlaps, small_or_cut
from support.sheets import seven_joint_arm

SPECIFICATIONS = (
    Specification("position.norm", 38.5e-3, 0.95),
    Specification("attitude.norm", 1e-1, 0.9973),
    Specification("position.y", 1.5e-3, 0.95),
    Specification("attitude.z", 5e-2, 0.95),
)
PAPER = pp.ErrorModel.load(PAPER_SHEET)
LONG_TITLE = "Attitude error of a_robot_with_quite_a_long_name at pose a_pose_with_quite_a_long_name, exact $ model"


def summary_of(errors: np.ndarray, specifications: tuple[Specification, ...] = SPECIFICATIONS) -> Summary:
    covariance = np.cov(errors) if errors.shape[1] > 1 else np.zeros((6, 6))
    plan = Plan.from_moments(errors.mean(axis=1), covariance, specifications)
    return finish(plan, observe(plan, start(plan), errors))


def errors_of(case: str) -> np.ndarray:
    noise = np.random.default_rng(5).standard_normal((6, 5000))
    usual = noise * np.array([1, 1, 1, 0.4, 0.01, 2])[:, None] * 1e-3 + 37e-3 * np.eye(6)[:, :1]
    return {
        "offset": usual,
        "five samples": usual[:, :5],
        "one sample": usual[:, :1],
        "no spread": np.full((6, 500), 1e-2) * np.array([1, 0, 0, 1, 1, -1])[:, None],
        "far and narrow": noise * 1e-9 - 37e-3,
        "unequal components": noise * 10.0 ** np.array([-2, -5, -8, -2, -6, -10])[:, None],
    }[case]


CASES = ("offset", "one sample", "far and narrow", "unequal components")


def figures_of(summary: Summary) -> dict[str, Figure]:
    limits = summary.specifications
    return {
        "position": plots.figure_position(summary, title="Position error at pose paper", seed=0),
        "attitude": plots.figure_attitude(summary, title=LONG_TITLE, seed=2**64 - 1),
        "components": plots.figure_components(summary, seed=0),
        "histogram": plots.histogram(summary.position.y, title="dy", seed=1, specifications=limits).figure,
        "cumulative": plots.cumulative(summary.attitude.norm, title=LONG_TITLE, specifications=limits).figure,
    }


@pytest.mark.slow
def test_a_figure_is_drawn_once_and_its_files_are_the_same_each_time(tmp_path, monkeypatch) -> None:
    """Matplotlib draws all of it with drawing switched off, only to lay it out; the files are the same to the byte."""
    before = dict(mpl.rcParams)
    drawn: list[int] = []
    files = []
    for _ in range(2):
        figure = plots.figure_position(summary_of(errors_of("offset")), title="Position error at pose paper", seed=0)
        draw = figure.patch.draw
        figure.patch.draw = lambda renderer, draw=draw: (drawn.append(len(files)), draw(renderer))
        paths = plots.save(figure, tmp_path / "position.error")
        files.append([path.read_bytes() for path in paths])
        monkeypatch.setattr(type(figure), "draw", Figure.draw)
    assert files[0] == files[1]
    assert (drawn.count(0), drawn.count(1)) == (2, 4)
    assert sorted(tmp_path.iterdir()) == [*paths]
    assert [path.name for path in paths] == ["position.error.png", "position.error.svg"]
    assert files[0][0][:8] == b"\x89PNG\r\n\x1a\n"
    assert int.from_bytes(files[0][0][16:20]) == pytest.approx(85 / 25.4 * 200, abs=1)
    root = ElementTree.fromstring(files[0][1])
    assert float(root.attrib["width"].removesuffix("pt")) == pytest.approx(85 / 25.4 * 72, abs=0.01)
    assert b"date" not in files[0][1].lower()
    assert dict(mpl.rcParams) == before


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_text_is_large_enough_inside_the_page_and_does_not_overlap(case: str) -> None:
    for name, figure in figures_of(summary_of(errors_of(case))).items():
        assert overlaps(figure) == [], name
        if name != "cumulative":
            assert figure.get_size_inches()[0] * 25.4 == pytest.approx(174 if name == "components" else 85)
        assert len(drawn_texts(figure)) > 8
        assert small_or_cut(figure) == [], name
    if case == CASES[0]:
        figure.text(0.5, 0.1, "a text laid across the legend, which it must not be")
        assert overlaps(figure)


def legend_of(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_marks_name_mean_quantiles_limits_samples_and_seed() -> None:
    summary = summary_of(errors_of("offset"))
    figure = plots.figure_position(summary, seed=42)
    norm, (result, *_) = summary.position.norm, summary.specifications
    # 5000 samples of 37.03 ± 1.00 mm: the mean to 0.03 mm, the quantile to 0.06 mm
    expected = (
        rf"mean: {norm.mean * 1e3:.2f} mm",
        rf"95 % quantile: {norm.quantile(0.95) * 1e3:.1f} mm",
        r"99\.73 % quantile: (39\.|40).*",
        rf"limit 38\.5 mm:\n.*{100 * result.probability:.0f}.*95 % required: not met",
    )
    for label, pattern in zip(legend_of(figure)[:4], expected, strict=True):
        assert re.fullmatch(pattern, label, re.DOTALL)
    caption = figure.legends[0].get_title().get_text()
    assert ("N = 5,000" in caption, "seed 42" in caption) == (True, True)
    upper, lower = figure.axes
    labels = (lower.get_xlabel(), upper.get_ylabel(), lower.get_ylabel())
    assert labels == ("|d| [mm]", "density [1/mm]", "cumulative probability")
    places = [line.get_xdata()[0] for line in upper.get_lines()]
    expected = [norm.mean, *map(norm.quantile, (0.95, 0.9973)), 38.5e-3]
    assert_allclose(places, np.array(expected) * 1e3, rtol=1e-12)


def test_limits_beyond_the_axis_are_named_and_both_sides_of_a_component_drawn() -> None:
    summary = summary_of(errors_of("offset"))
    labels = legend_of(plots.figure_attitude(summary))
    assert any(label.startswith("limit 100 mrad (beyond this axis)") for label in labels)
    axes = plots.histogram(summary.position.y, specifications=summary.specifications)
    places = [line.get_xdata()[0] for line in axes.get_lines()[-2:]]
    assert_allclose(places, [-1.5, 1.5], rtol=1e-12)
    for case, said in (("one sample", "one sample"), ("no spread", "all equal")):
        panel = plots.histogram(summary_of(errors_of(case)).position.x)
        assert [text.get_text() for text in panel.texts] == [said]
    few = legend_of(plots.figure_position(summary_of(errors_of("five samples"))))
    assert few[:3] == [f"{name}: not resolved" for name in ("mean", "95 % quantile", "99.73 % quantile")]


def test_the_histogram_is_a_density_in_the_axis_unit() -> None:
    summary = summary_of(errors_of("offset"))
    axes = plots.histogram(summary.attitude.norm)
    (bars,) = [patch for patch in axes.patches if hasattr(patch, "get_data")]
    density, edges, _ = bars.get_data()
    assert density @ np.diff(edges) == pytest.approx(1.0, abs=1e-12)
    assert edges[0] == pytest.approx(summary.attitude.norm.min * 1e3, rel=1e-12)
    assert axes.get_xlabel() == "|δ| [mrad]"
    assert axes.get_xlim()[0] == 0.0


def test_values_that_hardly_differ_are_drawn_from_a_round_number() -> None:
    summary = summary_of(errors_of("far and narrow"))
    axes = plots.histogram(summary.position.x)
    # span 7 nm: rounded to 1 nm = 0.000001 mm
    assert axes.get_xlabel() == "dx + 37.000000 mm [nm]"
    low, high = axes.get_xlim()
    assert low < summary.position.x.min * 1e9 + 37e6 < summary.position.x.max * 1e9 + 37e6 < high
    assert high - low < 10


def test_units_suit_the_size() -> None:
    for size, position, attitude in (
        (0.0, "mm", "mrad"), (50.0, "m", "rad"), (5.0, "mm", "mrad"), (2e-4, "mm", "mrad"), (5e-5, "µm", "µrad")
    ):  # fmt: skip
        summary = summary_of(np.full((6, 3), size))
        assert (display_unit(summary.position.x).name, display_unit(summary.attitude.z).name) == (position, attitude)


def test_a_panel_takes_a_smaller_unit_where_its_labels_would_grow_long() -> None:
    figure = plots.figure_components(summary_of(errors_of("unequal components")))
    labels = ["dx [mm]", "dy [mm]", "dz [nm]", "δx [mrad]", "δy [µrad]", "δz [nrad]"]
    assert [axes.get_xlabel() for axes in figure.axes] == labels
    assert "limit 50 mrad (beyond this axis)" in legend_of(figure)


def test_given_axes_are_drawn_on_and_keep_their_figure() -> None:
    figure = Figure()
    left, right = figure.subplots(1, 2)
    summary = summary_of(errors_of("offset"))
    micrometres = WrittenUnit("µm", 1e6)
    assert plots.histogram(summary.position.z, axes=left, unit=micrometres, title="dz") is left
    assert plots.cumulative(summary.position.z, axes=right) is right
    assert left.get_xlabel() == "dz [µm]"
    assert left.get_title() == "dz"
    assert not figure.legends
    marks = [label.split(":")[0] for label in left.get_legend_handles_labels()[1]]
    assert marks == ["mean", "5 % quantile", "95 % quantile"]


# what a limit and a scale look like ----------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("limit", "colour"), [(39e-3, "#009e73"), (37.5e-3, "#d55e00")])
def test_a_missed_limit_is_red_and_the_tail_beyond_it_coloured(limit: float, colour: str) -> None:
    errors = errors_of("offset")
    upper = plots.figure_position(summary_of(errors, (Specification("position.norm", limit, 0.95),))).axes[0]
    line = next(one for one in upper.get_lines() if str(one.get_label()).startswith("limit"))
    assert mpl.colors.to_hex(line.get_color()) == colour
    (tail,) = (one for one in upper.patches if mpl.colors.to_hex(one.get_facecolor()) == "#d55e00")
    density, edges, _ = tail.get_data()
    # the coloured area is the share of the samples beyond
    share = (np.linalg.norm(errors[:3], axis=0) > limit).mean()
    assert density @ np.diff(edges) == pytest.approx(share, abs=0.01)
    assert edges[0] == pytest.approx(1e3 * limit)


def test_components_share_their_scale_and_say_where_one_does_not() -> None:
    summary = summary_of(errors_of("offset"))
    axes = plots.figure_components(summary).axes
    assert len({one.get_xlim() for one in axes[:3]}) == 1
    # the second turns a hundred times less than the others
    assert axes[3].get_xlim() == axes[5].get_xlim() != axes[4].get_xlim()
    assert ["own scale" in one.get_title() for one in axes] == [False, False, False, False, True, False]


N = 1024


@pytest.fixture(scope="module")
def results():
    made = {
        name.replace("_", "-"): getattr(pp, name)(PAPER, samples=N, seed=7)
        for name in ("budget", "worst_case", "exact_law", "moments")
    }
    return made | {"reliability": pp.reliability(PAPER, ["38 mm @ 95 %"], samples=N, seed=7)}


def texts(figure: Figure) -> str:
    return " ".join(text.get_text() for text in figure.findobj(Text)).replace("\n", " ")


@pytest.mark.slow
def test_every_result_draws_itself_or_on_given_axes_names_robot_pose_n_and_seed_and_refuses_others(results):
    assert set(results) == {name for name, one in declarations().items() if one.heading}
    for name, result in results.items():
        figure = result.plot()
        words = texts(figure)
        for part in ("4dof.urdf", "at pose paper", f"N = {N:,}", "seed 7"):
            assert part in words, name
        assert not {"SI", "spherical triangles"} & set(words.split())
        for quantity in ("position", "attitude"):
            axes = Figure().subplots()
            if (name, quantity) == ("reliability", "attitude"):
                with pytest.raises(pp.InputError, match="no specification limits the attitude"):
                    result.plot(quantity=quantity, axes=axes)
            else:
                assert result.plot(quantity=quantity, axes=axes) is axes
                assert axes.has_data()
    assert figure._repr_png_()[:4] == b"\x89PNG"
    with pytest.raises(UnknownNameError, match="position"):
        results["budget"].plot(quantity="speed")
    with pytest.raises(pp.InputError, match="pose must be a whole number from 0 to 0"):
        results["budget"].plot(pose=1)


@pytest.mark.slow
def test_rounding_is_drawn_as_zero_and_one_pose_is_singular(results):
    """Without gravity a joint offset has the mean zero, but for the rounding of the samples."""
    offsets = [JointOffset(joint=name, offset=pp.Normal(1e-8)) for name in CHAIN.joint_names]
    model = pp.ErrorModel(CHAIN, pp.Space(()), offsets, {"paper": PAPER.poses["paper"]})
    result = pp.moments(model, samples=N, seed=7)
    mean, std = (result.plot().axes[k] for k in (1, 3))
    spread = 1e9 * result.poses[0].std.value[3:].max()
    assert (mean.get_ylabel(), std.get_ylabel()) == ("mean [nrad]", "standard deviation [nrad]")
    low, high = mean.get_ylim()
    assert low <= -1e-3 * spread < 1e-3 * spread <= high
    assert "4dof.urdf at 1 pose" in pp.compensate(model, "paper").plot().get_suptitle()
    entries = [Bar("a", "", 1.0, None), Bar("b", "", 4e-70, None)]
    bars = draw_bars(results["budget"], 0, dict.fromkeys(VECTORS, entries))
    assert [text.get_text() for text in bars.axes[0].texts] == ["100 %", "under 0.001 %"]


@pytest.mark.slow
def test_sampled_results_draw_themselves():
    result = pp.monte_carlo(PAPER, samples=500, seed=7)
    for quantity in ("position", "attitude", "components", "position.x"):
        figure = result.plot(quantity)
        assert isinstance(figure, Figure)
        for part in ("4dof.urdf at pose paper", "N = 500", "seed 7"):
            assert part in texts(figure)
    axes = Figure().subplots()
    assert isinstance(result.plot("attitude", axes=axes), Axes)
    assert axes.has_data()
    with pytest.raises(UnknownNameError):
        result.plot("speed")
    with pytest.raises(pp.InputError, match="a separate figure"):
        result.plot("components", axes=axes)


@pytest.mark.slow
def test_a_bound_below_what_was_found_says_why():
    chain = seven_joint_arm()
    turning = [joint.name for joint in chain.joints if joint.kind != "prismatic"]

    def found(law):
        model = pp.ErrorModel(chain, pp.Space(()), [JointOffset(joint=turning[1], offset=law)])
        result = pp.worst_case(model, [0.1] * len(chain.joints), samples=N, seed=1)
        return explain_excess(result.poses[0]), texts(result.plot())

    lines, words = found(pp.Normal(1e-6))
    assert any("samples lie beyond the bound, which cuts unbounded laws" in line for line in lines)
    assert "samples lie beyond the bound" in words
    lines, _ = found(pp.Uniform(1e-6))
    assert lines == []


CHAIN = PAPER.chain
SIDEWAYS = pp.Orientation.along((0, 0, -1), tool_axis=(1, 0, 0))


def placed(**box) -> PoseSet:
    return pp.place_grid(CHAIN, pp.box_places(**box), SIDEWAYS)


@pytest.fixture(scope="module")
def plane() -> PoseSet:
    return placed(x=np.linspace(0.5, 4.0, 6), y=[0.0, 0.4, 0.8, 1.2, 1.6], z=0.3)


TIMED = PoseSet.at(CHAIN, PAPER.poses["paper"][:, None] + np.linspace(0, 0.2, 9), times=np.linspace(0, 2, 9))
LISTED = PoseSet.at(CHAIN, PAPER.poses["paper"][:, None] + np.linspace(0, 0.2, 3), ("one", "two", "three"))


@pytest.mark.slow
def test_the_layout_follows_the_places(plane, tmp_path):
    for poses, kind, axes in (
        (placed(x=[1.0, 1.5, 2.0, 2.6], y=0.3, z=0.3), "path", ("x [mm]",)),
        (plane, "plane", ("x [mm]", "y [mm]")),
        (placed(x=[1.0, 2.0], y=[0.0, 0.4], z=[0.1, 0.3]), "space", ("x [mm]", "y [mm]", "z [mm]")),
        (TIMED, "path", ("time [s]",)),
        (LISTED, "list", ("pose, in the order given",)),
    ):
        layout = layout_of(poses, np.arange(len(poses)))
        assert (layout.kind, layout.names) == (kind, axes)
        if kind == "space" or poses.node is None:  # the other path is drawn as that of times
            made = pp.map_poses(PAPER, poses, verify=0, relative_to="paper")
            map_figure(made).savefig(tmp_path / "map.png", dpi=30)
            assert (tmp_path / "map.png").stat().st_size > 3_000


@pytest.mark.slow
def test_a_heat_map_shows_the_value_of_each_place(plane):
    made = pp.map_poses(PAPER, plane, verify=1, specifications=["20 mm"])
    drawn = map_figure(made)
    (mesh,) = drawn.axes[0].collections[:1]
    field = np.ma.filled(mesh.get_array().reshape(5, 6), np.nan)
    x, y = np.linspace(500, 4000, 6), np.array([0, 400, 800, 1200, 1600])
    columns, rows = (np.abs(axis[:, None] - 1e3 * plane.position[k]).argmin(axis=0) for k, axis in enumerate((x, y)))
    assert_allclose(field[rows, columns], 1e3 * made.quantile[1, 0], rtol=1e-6)
    labels = [text.get_text() for text in drawn.legends[0].get_texts()]
    assert labels == ["not reached", "specification not met"]


WIDE = {"robot": "WIDE_MOUTHED_" * 9 + ".urdf", "base": "W" * 90, "tip": "the tool of a robot " * 5}


@pytest.fixture(scope="module")
def further(plane):
    """Results of the analyses that have no section for a pose, and of many poses, by name of the figure."""
    measurement, random = pp.Measurement("position", std="20 um"), pp.random_poses(CHAIN, 8, seed=1)
    offsets = [JointOffset(joint=name, offset=pp.Normal(1e-3)) for name in CHAIN.joint_names]
    small = pp.ErrorModel(CHAIN, pp.Space(()), offsets, {"paper": PAPER.poses["paper"]})
    tips = np.array([at.posture.pose[:3, 3] for at in small.at_many(random.q)])
    tolerances = [{"path": f"axis_install[joint{k}].radius", "cost": {"reciprocal": "1 mm"}} for k in (1, 2)]
    mapped = {"listed": LISTED, "timed": TIMED, "plane": plane, "space": random}
    return {
        **{f"map {name}": pp.map_poses(PAPER, poses, verify=0) for name, poses in mapped.items()},
        "path": pp.path_law(PAPER, TIMED, samples=100),
        "compare": pp.compare({"A" * 60: PAPER, "B" * 60: small}, samples=100),
        "compensate": pp.compensate(small, random),
        "compensate path": pp.compensate(small, TIMED),
        "stiffness": pp.stiffness(PAPER, rated="100 N", robots=100),
        "stiffness map": pp.stiffness(PAPER, random, robots=100),
        "allocate": pp.allocate(PAPER, {"specs": ["40 mm @ 90 %"], "tolerances": tolerances}, pareto=2, for_samples=0),
        "calibrate forecast": pp.forecast_calibration(small, random, measurement),
        "calibrate plan": pp.plan_calibration(small, random, 4, measurement),
        "calibrate": pp.calibrate(small, (random.q, tips + 1e-3), measurement),
    }


def drawn(name: str, result) -> Figure:
    kind, _, what = name.partition(" ")
    return (
        getattr(calibration_figures, f"{what or 'calibration'}_figure")(result)
        if kind == "calibrate"
        else result.plot()
    )


@pytest.mark.slow
def test_every_figure_has_all_its_text_on_the_page(results, further):
    shown = {**results, **further}
    # that of ISO 9283 is looked at with its tests
    assert {name.split()[0] for name in shown} == {*declarations()} - {"iso9283"}
    wide = {name: replace(one, provenance=replace(one.provenance, **WIDE)) for name, one in shown.items()}
    for name, result in [("moments", results["moments"]), *wide.items()]:
        figure = drawn(name, result)
        assert (name, overlaps(figure), small_or_cut(figure)) == (name, [], [])


@pytest.mark.slow
def test_only_poses_of_one_motion_are_joined_by_lines(further):
    figures = [further[name].plot() for name in ("map listed", "compensate", "map timed", "compensate path", "path")]
    figures.append(sample_poses(PAPER, LISTED.q, samples=100).plot())
    curves = [[line for line in figure.axes[0].lines if len(line.get_xdata()) > 2] for figure in figures]
    curves[-1] = figures[-1].axes[0].lines[:3]
    joined = [{line.get_linestyle() != "None" for line in lines} for lines in curves]
    assert joined == [{False}, {False}, {True}, {True}, {True}, {False}]


@pytest.mark.slow
def test_of_several_branches_the_worst_is_drawn():
    poses = pp.place_grid(CHAIN, pp.box_places(x=[1.0, 1.5, 2.0], y=[0.2, 0.6], z=0.3), SIDEWAYS, branches="all")
    made = pp.map_poses(PAPER, poses, verify=0)
    drawn = np.ma.filled(map_figure(made, "attitude").axes[0].collections[0].get_array(), np.nan).ravel()
    worst = [1e3 * made.quantile[1, 1, poses.node == node].max() for node in range(6)]
    assert np.sort(drawn) == pytest.approx(np.sort(worst))


RED, BLUE = (1.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0)
FRONT = Camera(0.0, 0.0)


@pytest.fixture(scope="module")
def at():
    return PAPER.at()


def image_of(triangles: Triangles, half: float = 1.0, pixels: int = 80) -> np.ndarray:
    seen = FRONT.project(triangles.corners)
    return draw_triangles(seen, triangles.colours, np.array([-half, -half]), 2 * half / pixels, (pixels, pixels))


def covered(image: np.ndarray) -> float:
    """Return the area that is not transparent, as a share of the image."""
    return float(image[:, :, 3].mean()) / 255


def test_shapes_cover_the_area_that_geometry_gives_them():
    for shape, sizes, area, rel in (
        ("sphere", (0.5, RED, np.eye(4)), np.pi * 0.25, 0.03),
        ("box", ((3.0, 0.8, 0.5), RED, np.eye(4)), 0.4, 0.03),
        ("rod", ((0.0, -0.5, -0.5), (0.0, 0.5, 0.5), 0.05, RED), 0.1 * np.sqrt(2), 0.05),
    ):
        drawn = Triangles()
        getattr(drawn, shape)((shape,), *sizes)
        assert covered(image_of(drawn)) == pytest.approx(area / 4, rel=rel), shape
    # the viewer has y at the right and z above; rows are from the top
    drawn = Triangles()
    drawn.box(("box",), (0.2, 0.2, 0.2), RED, se3.pose(np.eye(3), (0.0, 0.5, 0.25)))
    rows, columns = np.nonzero(image_of(drawn)[:, :, 3])
    assert (rows.mean(), columns.mean()) == pytest.approx((29.5, 59.5), abs=0.5)


def test_what_is_nearer_hides_what_is_behind_it_whatever_the_order():
    for order in (1, -1):
        shapes = [(-1.0, BLUE), (1.0, RED)][::order]
        drawn = Triangles()
        for x, colour in shapes:  # the viewer stands at large x
            drawn.place((colour,), se3.pose(np.eye(3), (x, 0.0, 0.0)))  # type: ignore[arg-type]
            drawn.box((colour, "box"), (0.1, 1.0, 1.0), colour, np.eye(4))  # type: ignore[arg-type]
        red, _, blue, seen = image_of(drawn)[40, 40].astype(int)
        assert seen == 255
        assert red > blue + 60


def test_nodes_stand_on_those_above_them():
    drawn = Triangles()
    drawn.place(("arm",), se3.pose(se3.rotation_about((0.0, 0.0, 1.0), np.pi / 2), (1.0, 2.0, 3.0)))
    drawn.place(("arm", "link"), se3.pose(np.eye(3), (0.5, 0.0, 0.0)))
    drawn.box(("arm", "link", "box"), (0.2, 0.2, 0.2), RED, se3.pose(np.eye(3), (0.0, 0.0, 1.0)))
    # x of arm is y of the root
    assert drawn.corners.reshape(-1, 3).mean(axis=0) == pytest.approx([1.0, 2.5, 4.0])


def test_long_thin_and_far_triangles_cost_no_more_than_they_show():
    drawn = Triangles()
    for low, high, half in ((-900.0, 900.0, 0.1), (50.0, 60.0, 0.1), (0.0, 0.0, 0.0)):
        corners = [[0, low, 0], [0, high, half], [0, high, -half]]
        drawn.surface((f"from {low}",), corners, [[0, 1, 2]], RED, np.eye(4))
    assert 0 < covered(image_of(drawn)) < 0.2
    assert covered(image_of(Triangles())) == 0


def test_the_camera_is_a_right_handed_frame_with_the_base_upright():
    for azimuth in (0.3, 2.0, 5.0):
        axes = Camera(azimuth, 0.4).axes
        assert axes @ axes.T == pytest.approx(np.eye(3))
        assert np.linalg.det(axes) == pytest.approx(1)
        assert axes[0, 2] == 0
        assert axes[1, 2] > 0


@pytest.mark.slow
def test_the_cloud_fills_a_fair_part_of_the_picture_and_the_limit_has_room(at, monkeypatch):
    monkeypatch.setattr(drawing, "_OVERSAMPLING", 1)
    errors = 1e-3 * np.random.default_rng(3).standard_normal((3, 2000))
    far = draw_picture(at.posture, Cloud(errors, 2.8e-3, 1.0))
    width = far.factor * 1e-3 * 2 * 2.33  # 98 % of a normal law
    assert 0.15 * 2.5 < width < 0.5 * 2.5  # m, about what the paper's arm is wide
    assert not far.shows_limit
    assert draw_picture(at.posture, Cloud(errors, 2.8e-3, 6e-3)).shows_limit
    assert draw_picture(at.posture, Cloud(0 * errors)).factor == 1
    # drawn from an error far away, the cloud is as large as it is about zero; a limit is about zero
    moved = Cloud(errors + np.reshape([36e-3, 0.0, 0.0], (3, 1)), 2.8e-3, 42e-3, True, (36e-3, 0.0, 0.0))
    from_mean = draw_picture(at.posture, moved)
    assert from_mean.factor == far.factor
    assert not from_mean.shows_limit


@pytest.mark.slow
@pytest.mark.parametrize(("middle", "limit"), [(36e-3, 42e-3), (0.0, 2e-3)])
def test_the_texts_of_a_picture_do_not_overlap(at, monkeypatch, middle, limit):
    """A limit about a cloud far from the tip reaches down to the scale of the errors."""
    monkeypatch.setattr(drawing, "_OVERSAMPLING", 1)
    errors = 1e-3 * np.random.default_rng(3).standard_normal((3, 500)) + [[middle], [0.0], [0.0]]
    made = draw_picture(at.posture, Cloud(errors, middle + 2.8e-3, limit)).figure
    assert len(made.axes[0].texts) >= 5
    # each letter stands beyond the end of its axis
    ends = {line.get_color(): line.get_xydata() for line in made.axes[0].lines if len(line.get_xydata()) == 2}
    for text in (text for text in made.axes[0].texts if text.get_text() in "xyz"):
        begin, end = np.linalg.norm(ends[text.get_color()] - text.get_position(), axis=1)
        assert begin > 3 * end
    assert overlaps(made) == []


def test_the_arm_stands_out_from_light_and_dark_paper():
    for shade in (0.0, 1.0):
        drawn = Triangles()
        drawn.sphere(("ball",), 0.8, (shade, shade, shade, 1.0), np.eye(4))
        middle = image_of(drawn)[30:50, 30:50, :3].astype(float)
        assert 20 < middle.mean() < 235
