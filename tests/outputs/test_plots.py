"""The pictures: text sizes and overlaps by measured extents, what is marked, and how files are written."""

import math
import os
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from precision_pin.base.errors import OutputError
from precision_pin.render.display_units import WrittenUnit
from precision_pin.sampling import figures as plots
from precision_pin.statistics import Plan, Specification, Summary, finish, observe, start

SPECIFICATIONS = (
    Specification("position.norm", 38.5e-3, 0.95),
    Specification("attitude.norm", 1e-1, 0.9973),
    Specification("position.y", 1.5e-3, 0.95),
    Specification("attitude.z", 5e-2, 0.95),
)
LONG_TITLE = "Attitude error of a_robot_with_quite_a_long_name at pose a_pose_with_quite_a_long_name, exact $ model"


def summary_of(errors: np.ndarray) -> Summary:
    covariance = np.cov(errors) if errors.shape[1] > 1 else np.zeros((6, 6))
    plan = Plan.from_moments(errors.mean(axis=1), covariance, SPECIFICATIONS)
    return finish(plan, observe(plan, start(plan), errors))


def errors_of(case: str) -> np.ndarray:
    generator = np.random.default_rng(5)
    noise = generator.standard_normal((6, 5000))
    offset = np.array([37e-3, 0, 0, 0, 0, 0])[:, None]
    usual = noise * np.array([1, 1, 1, 0.4, 0.01, 2])[:, None] * 1e-3 + offset
    match case:
        case "offset":
            return usual
        case "centred":
            return noise * 1.9e-3
        case "five samples":
            return usual[:, :5]
        case "two samples":
            return usual[:, :2]
        case "one sample":
            return usual[:, :1]
        case "no spread":
            return np.full((6, 500), 1e-2) * np.array([1, 0, 0, 1, 1, -1])[:, None]
        case "all zero":
            return np.zeros((6, 500))
        case "far and narrow":
            return noise * 1e-9 - 37e-3
        case "unequal components":
            return noise * 10.0 ** np.array([-2, -5, -8, -2, -6, -10])[:, None]
        case "large":
            return noise * 1.0 + 20.0
        case "outliers":
            return usual * np.where(generator.random(5000) < 1e-3, 100.0, 1.0)
    raise AssertionError(case)


CASES = (
    "offset",
    "centred",
    "five samples",
    "two samples",
    "one sample",
    "no spread",
    "all zero",
    "far and narrow",
    "unequal components",
    "large",
    "outliers",
)
FAST_CASES = ("offset",)


def figures_of(summary: Summary) -> dict[str, Figure]:
    return {
        "position": plots.figure_position(summary, title="Position error at pose paper", seed=0),
        "attitude": plots.figure_attitude(summary, title=LONG_TITLE, seed=2**64 - 1),
        "components": plots.figure_components(summary, seed=0),
        "histogram": plots.histogram(
            summary.position.y, title="dy", seed=1, specifications=summary.specifications
        ).figure,
        "cumulative": plots.cumulative(
            summary.attitude.norm, title=LONG_TITLE, specifications=summary.specifications
        ).figure,
    }


def drawn_texts(figure: Figure) -> list[Text]:
    """Every text that ends on the page: not hidden, not empty, no tick outside its axis."""
    outside: set[int] = set()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            slack = 1e-9 * (high - low)
            for tick in [*axis.get_major_ticks(), *axis.get_minor_ticks()]:
                hidden = not (low - slack <= tick.get_loc() <= high + slack)
                outside |= {id(label) for label in (tick.label1, tick.label2) if hidden or not label.get_visible()}
    return [
        text
        for text in figure.findobj(Text)
        if text.get_visible() and text.get_text().strip() and id(text) not in outside
    ]


@pytest.mark.slow
def test_a_figure_is_drawn_once_and_laid_out_as_if_drawn_before(tmp_path, monkeypatch) -> None:
    """Matplotlib draws all of it with drawing switched off, only to lay it out; the files are the same to the byte."""
    drawn: list[int] = []
    files = []
    for _ in range(2):
        figure = figures_of(summary_of(errors_of("offset")))["position"]
        draw = figure.patch.draw
        figure.patch.draw = lambda renderer, draw=draw: (drawn.append(len(files)), draw(renderer))
        files.append([path.read_bytes() for path in plots.save(figure, tmp_path / "figure")])
        monkeypatch.setattr(type(figure), "draw", Figure.draw)
    assert files[0] == files[1]
    assert (drawn.count(0), drawn.count(1)) == (2, 4)


@pytest.mark.slow
@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=[pytest.mark.slow] * (case not in FAST_CASES)) for case in CASES]
)
def test_text_is_large_enough_inside_the_page_and_does_not_overlap(case: str) -> None:
    for name, figure in figures_of(summary_of(errors_of(case))).items():
        figure.canvas.draw()
        renderer = figure.canvas.get_renderer()
        texts = drawn_texts(figure)
        assert len(texts) > 8
        page = figure.bbox
        boxes = [(text.get_text(), text.get_window_extent(renderer)) for text in texts]
        for text in texts:
            assert text.get_fontsize() >= 7, (name, text.get_text())
        for words, box in boxes:
            assert page.x0 <= box.x0, (name, words)
            assert box.x1 <= page.x1, (name, words)
            assert page.y0 <= box.y0, (name, words)
            assert box.y1 <= page.y1, (name, words)
        for index, (words, box) in enumerate(boxes):
            for other_words, other in boxes[index + 1 :]:
                assert not box.overlaps(other), (name, words, other_words)


@pytest.mark.slow
def test_the_overlap_check_notices_an_overlap() -> None:
    figure = plots.figure_position(summary_of(errors_of("offset")))
    figure.text(0.5, 0.1, "a text laid across the legend, which it must not be")
    figure.canvas.draw()
    boxes = [text.get_window_extent() for text in drawn_texts(figure)]
    assert any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[i + 1 :])


@pytest.mark.slow
def test_figures_have_the_column_widths() -> None:
    figures = figures_of(summary_of(errors_of("offset")))
    for name, width in (("position", 85), ("attitude", 85), ("histogram", 85), ("components", 174)):
        assert figures[name].get_size_inches()[0] * 25.4 == pytest.approx(width)


def legend_of(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_marks_name_mean_quantiles_limits_samples_and_seed() -> None:
    summary = summary_of(errors_of("offset"))
    figure = plots.figure_position(summary, seed=42)
    labels = legend_of(figure)
    # 5000 samples of 37.03 ± 1.00 mm: the mean to 0.03 mm, the quantile to 0.06 mm
    assert labels[0] == f"mean: {summary.position.norm.mean * 1e3:.2f} mm"
    assert labels[1] == f"95 % quantile: {summary.position.norm.quantile(0.95) * 1e3:.1f} mm"
    assert labels[2].startswith("99.73 % quantile: 39.") or labels[2].startswith("99.73 % quantile: 40")
    (result, *_) = summary.specifications
    assert labels[3].startswith("limit 38.5 mm:\n")
    assert f"{100 * result.probability:.0f}" in labels[3]
    assert labels[3].endswith("95 % required: not met")
    caption = figure.legends[0].get_title().get_text()
    assert "N = 5,000" in caption
    assert "seed 42" in caption
    upper, lower = figure.axes
    assert lower.get_xlabel() == "|d| [mm]"
    assert upper.get_ylabel() == "density [1/mm]"
    assert lower.get_ylabel() == "cumulative probability"
    places = [line.get_xdata()[0] for line in upper.get_lines()]
    expected = [summary.position.norm.mean, *map(summary.position.norm.quantile, (0.95, 0.9973)), 38.5e-3]
    np.testing.assert_allclose(places, np.array(expected) * 1e3, rtol=1e-12)


def test_limits_beyond_the_axis_are_named_and_both_sides_of_a_component_drawn() -> None:
    summary = summary_of(errors_of("offset"))
    labels = legend_of(plots.figure_attitude(summary))
    assert any(label.startswith("limit 100 mrad (beyond this axis)") for label in labels)
    axes = plots.histogram(summary.position.y, specifications=summary.specifications)
    places = [line.get_xdata()[0] for line in axes.get_lines()[-2:]]
    np.testing.assert_allclose(places, [-1.5, 1.5], rtol=1e-12)


def test_what_few_samples_do_not_resolve_is_said_not_drawn() -> None:
    figure = plots.figure_position(summary_of(errors_of("five samples")))
    assert legend_of(figure)[:3] == [
        "mean: not resolved",
        "95 % quantile: not resolved",
        "99.73 % quantile: not resolved",
    ]


def test_the_histogram_is_a_density_in_the_axis_unit() -> None:
    summary = summary_of(errors_of("centred"))
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


@pytest.mark.parametrize(
    ("size", "position", "attitude"),
    [(0.0, "mm", "mrad"), (50.0, "m", "rad"), (5.0, "mm", "mrad"), (2e-4, "mm", "mrad"), (5e-5, "µm", "µrad")],
)
def test_units_suit_the_size(size: float, position: str, attitude: str) -> None:
    summary = summary_of(np.full((6, 3), size))
    assert plots.display_unit(summary.position.x).name == position
    assert plots.display_unit(summary.attitude.z).name == attitude


def test_a_panel_takes_a_smaller_unit_where_its_labels_would_grow_long() -> None:
    figure = plots.figure_components(summary_of(errors_of("unequal components")))
    assert [axes.get_xlabel() for axes in figure.axes] == [
        "dx [mm]",
        "dy [mm]",
        "dz [nm]",
        "δx [mrad]",
        "δy [µrad]",
        "δz [nrad]",
    ]
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
    assert [label.split(":")[0] for label in left.get_legend_handles_labels()[1]] == [
        "mean",
        "5 % quantile",
        "95 % quantile",
    ]


def test_no_global_state_is_left_behind() -> None:
    before = dict(mpl.rcParams)
    plots.figure_components(summary_of(errors_of("five samples")))
    assert dict(mpl.rcParams) == before


@pytest.mark.slow
def test_saving_writes_the_same_bytes_each_time(tmp_path: Path) -> None:
    summary = summary_of(errors_of("centred"))
    first = plots.save(plots.figure_position(summary, seed=0), tmp_path / "position.error")
    again = plots.save(plots.figure_position(summary, seed=0), tmp_path / "again")
    assert first == (tmp_path / "position.error.png", tmp_path / "position.error.svg")
    for one, other in zip(first, again, strict=True):
        assert one.read_bytes() == other.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "again.png",
        "again.svg",
        "position.error.png",
        "position.error.svg",
    ]
    header = first[0].read_bytes()
    assert header[:8] == b"\x89PNG\r\n\x1a\n"
    assert int.from_bytes(header[16:20]) == pytest.approx(85 / 25.4 * 200, abs=1)
    root = ElementTree.fromstring(first[1].read_text(encoding="utf-8"))
    assert root.tag.endswith("svg")
    assert float(root.attrib["width"].removesuffix("pt")) == pytest.approx(85 / 25.4 * 72, abs=0.01)
    assert "date" not in first[1].read_text(encoding="utf-8").lower()


@pytest.mark.slow
def test_a_place_that_cannot_be_written_is_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    figure = plots.figure_position(summary_of(errors_of("five samples")))
    with pytest.raises(OutputError, match=r"cannot write .*No such file") as caught:
        plots.save(figure, tmp_path / "missing" / "figure")
    assert "\n" not in str(caught.value)
    (tmp_path / "taken.svg").mkdir()
    with pytest.raises(OutputError, match="directory"):
        plots.save(figure, tmp_path / "taken")
    assert not list(tmp_path.glob(".*"))


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="permission bits are those of POSIX")
def test_files_get_the_usual_permissions(tmp_path: Path) -> None:
    (tmp_path / "plain").write_text("")
    paths = plots.save(plots.figure_position(summary_of(errors_of("five samples"))), tmp_path / "figure")
    for path in paths:
        assert path.stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_colours_are_okabe_and_itos() -> None:
    palette = {"#000000", "#e69f00", "#56b4e9", "#009e73", "#f0e442", "#0072b2", "#d55e00", "#cc79a7"}
    summary = summary_of(errors_of("offset"))
    lines = [line for axes in plots.figure_position(summary).axes for line in axes.get_lines()]
    assert {mpl.colors.to_hex(line.get_color()) for line in lines} <= palette
    marked = {(line.get_color(), str(line.get_linestyle())) for line in lines[:4]}
    assert len(marked) >= 3
    assert all(math.isfinite(line.get_linewidth()) for line in lines)


# what a limit and a scale look like ----------------------------------------------------------------------------------


def filled(axes, colour: str) -> list:
    return [one for one in axes.patches if mpl.colors.to_hex(one.get_facecolor()) == colour]


@pytest.mark.slow
@pytest.mark.parametrize(("limit", "colour"), [(39e-3, "#009e73"), (37.5e-3, "#d55e00")])
def test_a_missed_limit_is_red_and_the_tail_beyond_it_coloured(limit: float, colour: str) -> None:
    errors = errors_of("offset")
    plan = Plan.from_moments(errors.mean(axis=1), np.cov(errors), (Specification("position.norm", limit, 0.95),))
    summary = finish(plan, observe(plan, start(plan), errors))
    upper = plots.figure_position(summary).axes[0]
    line = next(one for one in upper.get_lines() if str(one.get_label()).startswith("limit"))
    assert mpl.colors.to_hex(line.get_color()) == colour
    (tail,) = filled(upper, "#d55e00")
    density, edges, _ = tail.get_data()
    # the coloured area is the share of the samples beyond
    assert float(density @ np.diff(edges)) == pytest.approx(
        (np.linalg.norm(errors[:3], axis=0) > limit).mean(), abs=0.01
    )
    assert edges[0] == pytest.approx(1e3 * limit)


def test_components_share_their_scale_and_say_where_one_does_not() -> None:
    summary = summary_of(errors_of("offset"))
    axes = plots.figure_components(summary).axes
    assert len({one.get_xlim() for one in axes[:3]}) == 1
    # the second turns a hundred times less than the others
    assert axes[3].get_xlim() == axes[5].get_xlim() != axes[4].get_xlim()
    assert ["own scale" in one.get_title() for one in axes] == [False, False, False, False, True, False]
