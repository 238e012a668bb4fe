"""The page of ``report``: every number is the analysis' number, every name is text, and it needs nothing from outside."""

import hashlib
import io
import itertools
import math
import re
from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

import precision_pin as pp
from cli.conftest import FEWER, take_few_samples
from outputs.report_cases import (
    BLANK,
    BRACE,
    HAN,
    MATHS,
    SAMPLES,
    SCRIPT,
    SPECIFICATIONS,
    SVG,
    Reader,
    paper,
    results_of,
    silent,
    write_hostile,
)
from precision_pin.analyses.collect import CLOUD, collect_poses
from precision_pin.analyses.map.figure import map_chapter
from precision_pin.model.pose_model import origin_shares
from precision_pin.pages.report.distributions import distributions, specifications, verdict
from precision_pin.pages.report.page import _opened, assumptions, page, scene, without_folders
from precision_pin.pages.report.summary import changes, picture, summary
from precision_pin.pages.view import script_hashes
from precision_pin.render import figure_style
from precision_pin.render.html import element, section
from precision_pin.robot.examples import PAPER_SHEET, example_urdfs
from precision_pin.sheet import read
from precision_pin.statistics import Grounds, SpecificationResult
from support.browser import chromium, complaints, needs_chromium, outside_requests, visited
from support.waiting import eventually

SECTIONS = (
    "verdict", "assumptions", "distributions", "budget", "worst-case", "exact-law", "moments", "view", "mcpc", "parameters",
    "reproduce",
)  # fmt: skip
LARGEST = 6_000_000
pytestmark = pytest.mark.slow


@pytest.fixture
def undrawn(monkeypatch):
    """Leave figures blank: the page of the paper's case has all of them, and is made before, since it is kept for all tests."""
    paper()
    monkeypatch.setattr(figure_style, "_svg", lambda _: BLANK)
    monkeypatch.setattr("precision_pin.pages.view.drawing._OVERSAMPLING", 1)


@pytest.fixture(scope="module")
def reader():
    return Reader(paper()[1])


def sampled_again(model, **settings):
    """Return the results of the paper's case with another sampling."""
    return replace(paper()[0], analysis=pp.monte_carlo(model, **({"samples": SAMPLES, "seed": 4} | settings)))


def summed_up(**changes):
    """Return the results of the paper's case with changes of their summary."""
    results = paper()[0]
    return replace(results, analysis=replace(results.analysis, summary=replace(results.analysis.summary, **changes)))


def agrees(text: str, value: float) -> bool:
    """Return whether a number's text is the value rounded to its last digit."""
    number = Decimal(text)
    step = 10.0 ** int(number.as_tuple().exponent)
    return abs(float(number) - value) <= 0.5 * step * (1 + 1e-9)


def encloses(text: str, low: float, high: float) -> bool:
    """Return whether ``[a, b]`` is the interval with both ends rounded outwards by less than a step."""
    a, b = re.fullmatch(r"\[(\S+), (\S+)\]", text).groups()
    step = 10.0 ** int(Decimal(a).as_tuple().exponent)
    return 0 <= low - float(a) + 1e-12 < step * 1.001 and 0 <= float(b) - high + 1e-12 < step * 1.001


# structure -----------------------------------------------------------------------------------------------------------


def test_sections_stand_in_order_folded_but_the_decision(reader):
    assert tuple(tag.attributes["id"] for tag in reader.named("section")) == SECTIONS
    assert [tag.attributes["href"] for tag in reader.named("a")] == ["#main", *(f"#{name}" for name in SECTIONS)]
    text = re.sub(r'srcdoc="[^"]*"', "", paper()[1])
    # a browser opens the folds around the target of a link, so the target is inside
    folds = re.findall(
        r'<details class="fold"><summary><h2 id="([\w-]+)-heading">[^<]+</h2></summary><section id="([\w-]+)"', text
    )
    assert [name for name, _ in folds] == [name for _, name in folds] == list(SECTIONS[2:])
    assert re.findall(r'<section id="([\w-]+)"[^>]*><h2', text) == ["verdict", "assumptions"]
    assert 'open=""' not in text
    assert text.count("precision-pin report --full") == 1
    trap = '<details class="fold">'
    made = _opened([section("x", "X", trap, element("details", element("summary", "more")))])[0].text
    assert made.startswith('<details open="" class="fold"><summary><h2 id="x-heading">X</h2></summary>')
    assert made.count('open=""') == 2


def test_what_to_change_is_what_a_sheet_with_the_change_gives(model, tmp_path, reader):
    table = reader.table("What to change, and what it brings: |d|")
    assert table.rows[0] == ["change", "share of the variance %", "95 % within [mm]"]
    assert agrees(
        table.row("as it is")[1], 1e3 * pp.monte_carlo(model, samples=SAMPLES, seed=4).position.norm.quantile(0.95)
    )
    text = PAPER_SHEET.read_text("utf-8").replace("robot: 4dof.urdf", f"robot: {PAPER_SHEET.parent / '4dof.urdf'}")
    constant = model.at().exact(model.space.mean[:, None])[:3]

    def size(errors) -> float:
        return 1e3 * np.quantile(np.linalg.norm(errors[:3], axis=0), 0.95)

    def halved(*joints: str) -> np.ndarray:
        written = text
        for joint in joints:
            assert f"joint: {joint}, radius: 0.1 mm" in written
            written = written.replace(f"joint: {joint}, radius: 0.1 mm", f"joint: {joint}, radius: 0.05 mm")
        (tmp_path / "changed.yaml").write_text(written, "utf-8")
        changed = pp.ErrorModel.load(tmp_path / "changed.yaml")
        return changed.at().exact(changed.space.sample(4, 0, SAMPLES))[:3]

    joints = ("joint1", "joint2", "joint3")
    for joint in joints:
        assert agrees(table.row(f"halved: axis of {joint}, radius 0.1 mm")[1], size(halved(joint)))
    row = table.row(f"without the constant part of {1e3 * np.linalg.norm(constant):.3g} mm")
    assert agrees(row[1], size(halved() - constant))
    assert agrees(table.row("all of these")[1], size(halved(*joints) - constant))
    assert len(table.rows) == 7


def test_what_to_change_counts_the_robots_inside_the_limit_that_is_missed(model):
    results = sampled_again(model, specifications=[pp.specification(one) for one in ("60 mm", "40 mm @ 99 %")])
    table = Reader(changes(results).text).table("What to change")
    assert table.rows[0][-1] == "inside 40 mm"
    errors = model.at().exact(model.space.sample(4, 0, SAMPLES))[:3]
    for row, kept, said in (
        ("as it is", np.linalg.norm(errors, axis=0) <= 40e-3, "not met"),
        ("all of these", np.ones(1), "met"),
    ):
        share, verdict_there = table.row(row)[-1].split(" %, ")
        assert agrees(share, 100 * kept.mean())
        assert verdict_there == said
    assert "; not drawn: the limit 40 mm." in picture(results).text  # about the mean, which is far from zero
    analysis = results.analysis
    outside = analysis.summary.with_grounds(Grounds("joint1 is outside its limits"))
    table = Reader(changes(replace(results, analysis=replace(analysis, summary=outside))).text).table("What to change")
    assert {row[-1].partition(" %, ")[2] for row in table.rows[1:]} == {"not judged"}


def test_the_page_loads_nothing_and_runs_only_the_scripts_of_the_view(reader):
    (policy,) = (tag.attributes["content"] for tag in reader.named("meta") if "http-equiv" in tag.attributes)
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    expected = {"default-src": "'none'", "script-src": " ".join(script_hashes()), "style-src": "'unsafe-inline'"}
    assert expected.items() | {("img-src", "data:")} <= rules.items()
    assert reader.named("script") == reader.named("link") == reader.named("img") == []
    for tag in reader.tags:
        assert "src" not in tag.attributes
        assert not any(key.startswith("on") for key in tag.attributes)
        # the arm's picture is part of the page
        allowed = "data:image/png;base64," if tag.name == "image" else "#"
        assert tag.attributes.get("href", allowed).startswith(allowed)
    assert len(reader.named("image")) == 1
    frame = reader.named("iframe")[0]
    assert frame.attributes["sandbox"] == "allow-scripts"
    assert frame.attributes["title"].startswith("3-D view of 4dof.urdf")
    assert frame.attributes["srcdoc"].startswith("<!DOCTYPE html>")


def test_it_can_be_read_without_eyes(reader):
    levels = [level for level, _ in reader.headings]
    assert (levels[0], levels.count(1)) == (1, 1)
    assert all(after <= before + 1 for before, after in itertools.pairwise(levels))
    assert reader.named("html")[0].attributes["lang"] == "en"
    assert [len(reader.named(name)) for name in ("header", "nav", "main", "footer")] == [1, 1, 1, 1]
    assert len(reader.tables) >= 15
    for table in reader.tables:
        assert table.caption
        assert None not in table.scopes
        assert len({len(row) for row in table.rows}) == 1, table.caption
    for figure in reader.named("svg"):
        assert figure.attributes["role"] == "img"
        assert len(re.findall(r"-?\d+\.?\d*", figure.attributes["aria-label"])) >= 3
    known = [tag.attributes["id"] for tag in reader.tags if "id" in tag.attributes]
    assert len(set(known)) == len(known)
    used = {tag.attributes["aria-labelledby"] for tag in reader.tags if "aria-labelledby" in tag.attributes}
    for tag in reader.tags:
        for value in tag.attributes.values() if tag.name != "iframe" else ():
            used |= {first or second for first, second in re.findall(r"^#(.+)|url\(#(.+?)\)", value)}
    assert used <= set(known)


def test_figures_are_in_colours_of_the_page_and_the_page_is_the_same_each_time():
    results, text = paper()
    figures = re.findall(r"<svg.*?</svg>", re.sub(r'srcdoc="[^"]*"', "", text), re.DOTALL)
    assert len(figures) == 9
    for figure in figures:
        assert not re.search(r"<!--|<(text|style|metadata|script|a)\b|#[0-9a-fA-F]{6}\b", figure)
        assert "currentColor" in figure
    assert summary([results]).text in text
    assert str(PAPER_SHEET.parent) not in text
    assert len(text.encode()) < LARGEST


# numbers -------------------------------------------------------------------------------------------------------------


def test_numbers_of_the_distributions(model, reader):
    summary = pp.monte_carlo(model, samples=SAMPLES, seed=4).summary
    for vector, caption in (
        (summary.position, "Numbers of the position"),
        (summary.attitude, "Numbers of the attitude"),
    ):
        table = reader.table(caption)
        parts = (vector.norm, vector.x, vector.y, vector.z)
        for which, heading in (("mean", "mean"), ("std", "standard deviation"), (0.5, "50 %"), (0.9973, "99.73 %")):
            for part, cell in zip(parts, table.row(heading), strict=True):
                if isinstance(which, float):
                    value, ends = part.resolved_quantile(which), part.quantile_interval(which)
                else:
                    value, ends = getattr(part, which), getattr(part, f"{which}_interval")()
                if value is None:
                    assert cell == "–"
                    continue
                number, interval = cell.split(" ", 1)
                assert agrees(number, 1e3 * value), cell
                assert encloses(interval, *(1e3 * end for end in ends)), cell
        assert table.row("5 %")[0] == ""
        for heading, which in (("smallest seen", "min"), ("largest seen", "max")):
            for part, cell in zip(parts, table.row(heading), strict=True):
                assert agrees(cell, 1e3 * getattr(part, which))


def test_without_a_specification_the_sizes_stand_at_the_top(reader):
    row = reader.table("Errors that few robots exceed").row("|d| [mm]")
    quantiles = reader.table("Numbers of the position")
    assert row == [quantiles.row(level)[0] for level in ("95 %", "99.73 %")]
    assert "No limit was given" in reader.text
    assert f"99.73 % of the robots have a position error |d| of at most {row[1].split()[0]} mm." in reader.text


def test_verdict_against_specifications(model):
    limits = [*map(pp.specification, SPECIFICATIONS)]
    results = sampled_again(model, specifications=limits, keep_samples=True)
    reader = Reader(verdict(results).text + specifications(results).text)
    assert "2 of 3 specifications are met." in reader.text
    table = reader.table("Specifications")
    errors = results.analysis.errors
    for row, head, sizes, limit, required, met in zip(
        table.rows[1:],
        ("|d| ≤ 45 mm", "|dx| ≤ 0.1 mm", "|δ| ≤ 25 mrad"),
        (np.linalg.norm(errors[:3], axis=0), np.abs(errors[0]), np.linalg.norm(errors[3:], axis=0)),
        (45e-3, 0.1e-3, 25e-3),
        ("99 %", "95 %", "95 %"),
        ("met", "not met", "met"),
        strict=True,
    ):
        assert (row[0], row[1], row[4]) == (head, required, met)
        assert agrees(row[2].removesuffix(" %"), 100 * (sizes <= limit).mean())
    assert "No limit was given" not in reader.text
    low, high = results.analysis.summary.specifications[0].interval
    assert encloses(table.rows[1][3].removesuffix(" %"), 100 * low, 100 * high)


def test_only_what_is_met_is_shown_as_met():
    for interval, varies, words in (
        ((0.99, 1.0), True, "The specification is met."),
        ((0.90, 0.94), True, "The specification is not met."),
        ((0.90, 0.99), True, "Whether the specification is met is undecided: the samples are too few."),
        ((0.99, 1.0), False, "There is nothing to judge: no source of the sheet makes it vary at this pose"),
    ):
        one = SpecificationResult("position.norm", 1e-3, 0.95, interval[1], interval, varies)
        alone, several = (summed_up(specifications=found) for found in ((one,), (one, one)))
        made = verdict(alone).text + specifications(alone).text
        assert words in Reader(made).text
        is_met = words == "The specification is met."
        marks = ['class="verdict met"' in made, 'class="good"' in made, 'class="verdict met"' in verdict(several).text]
        assert marks == [is_met] * 3
        elsewhere = verdict(alone, ["on the map", "along the path"]).text
        assert 'class="verdict met"' not in elsewhere
        missed = "The specification is met, but not on the map and not along the path."
        assert (missed if is_met else words) in Reader(elsewhere).text


def test_a_result_says_what_it_rests_on_and_where_nothing_varies(undrawn):
    results, _ = paper()
    analysis = results.analysis
    assert "assumptions" not in Reader(summary([results]).text).text
    marked = ("axis_install[joint1]", "payload[tool]")
    origins = {name: "assumed" for name in results.at.space.components if name.startswith(marked)}
    shares = origin_shares(origins, results.at)
    rests = replace(analysis, assumed=marked, sources=5, origins=shares)
    assumed = replace(results, analysis=rests)
    # the two bearings' share of the trace of the covariance, from the Jacobian
    jacobian, covariance = results.at.jacobian[:3], results.at.space.covariance
    of_axis = np.array([name.startswith("axis_install[joint1]") for name in results.at.space.components])
    some = jacobian * of_axis
    share = round(100 * np.trace(some @ covariance @ some.T) / np.trace(jacobian @ covariance @ jacobian.T))
    text = Reader(summary([assumed]).text).text
    assert f"{share} % of the variance of d rests on assumptions: 2 of 5 sources are marked as assumed in the" in text
    assert f"{share} % axis of joint1, radius 0.1 mm" in text
    # of a calibrated arm the numbers of an assumed source may be measured, and its sources share one draw
    measured = replace(rests, origins={"measured": (0.94, 0.8), "assumed": (0.06, 0.2)})
    text = Reader(summary([replace(results, analysis=measured)]).text).text
    assert "6 % of the variance of d rests on assumptions: 2 of 5" in text
    said = Reader(assumptions([assumed]).text).text
    assert "2 of 5 sources are marked as assumed in the sheet (axis_install, payload)" in said
    made = verdict(summed_up(varying=(False,) * 8)).text
    assert "No source makes the error vary" in Reader(made).text
    assert "verdict met" not in made


def test_budget_is_that_of_the_analysis_and_an_axis_is_one_cause_that_opens(model, reader):
    pose = pp.budget(model, seed=4, samples=FEWER["budget"]).poses[0]
    words = dict(zip((draw.name for draw in model.space.draws), model.draw_words, strict=True))
    for vector, unit in (("position", "mm"), ("attitude", "mrad")):
        large = reader.table(f"Causes of the {vector} error")
        small = [table for table in reader.tables if table.caption.endswith(f"each, {vector} error")]
        rows = {row[0]: row for table in (large, *small) for row in table.rows[1:]}
        columns = large.rows[0]
        for draw in pose.draws:
            if draw.name.startswith("axis_install"):
                continue
            row = dict(zip(columns, rows[words[draw.name]], strict=True))
            assert agrees(row["share %"], 100 * draw.share[vector])
            assert agrees(row["ST %"].split(" ± ")[0], 100 * pose.group(draw.name).total[vector].value)
            assert agrees(row[f"halved: std [{unit}]"], 1e3 * draw.halved.std[vector])
        shares = [float(row[3]) for row in large.rows[1:-1] if "more" not in row[0]]
        assert shares == sorted(shares, reverse=True)
        assert agrees(rows["sum"][3], 100.0)
        assert f"std {1e3 * pose.std[vector]:.5g} {unit} now" in large.caption
        places = reader.table("Joints and links").column(f"{vector} %")
        for place in pose.places:
            if place.name in places:
                assert agrees(places[place.name], 100 * place.share[vector])
    sources = reader.table("Sources").column("position %")
    ends = [draw for draw in pose.draws if draw.name.startswith("axis_install[joint1]")]
    both = sum(draw.share["position"] for draw in ends)
    assert agrees(sources["axis_install[joint1]"], 100 * both)
    # the two bearings of an axis are one cause that opens
    row = next(row for row in reader.table("Causes of the position error").rows if row[0].startswith("axis of joint1"))
    assert row[1:3] == ["radius 0.1 mm", "unit"]
    assert agrees(row[3], 100 * both)
    for draw, end in zip(ends, "AB", strict=True):
        assert f"axis of joint1, bearing {end}: {100 * draw.share['position']:.2f} %" in row[0]
    # half the tolerance: a quarter of its part of the variance
    assert agrees(row[6], 1e3 * pose.std["position"] * math.sqrt(1 - 0.75 * both))


def test_worst_case_is_that_of_the_analysis(model, reader):
    pose = pp.worst_case(model, seed=4, samples=SAMPLES).poses[0]
    table = reader.table("Worst case of the sizes")
    for bound, heading in ((pose.position, "|d| [mm]"), (pose.attitude, "|δ| [mrad]")):
        values = np.array([bound.first_order.upper, bound.exact_norm, bound.found.norm, bound.seen.max])
        assert [*map(float, table.row(heading)[:4])] == pytest.approx(1e3 * values, rel=1e-5)
        rows = reader.table(f"What adds up to the worst {heading.split()[0]}").rows[1:]
        parts = [float(row[1]) for row in rows]
        assert math.fsum(parts[:-1]) == pytest.approx(parts[-1], rel=1e-5)
        assert parts[-1] == pytest.approx(1e3 * bound.first_order.upper, rel=1e-5)
    components = reader.table("Worst case of the components")
    for entry, row in zip(pose.components, components.rows[1:], strict=True):
        values = 1e3 * np.array([entry.low, entry.high, *entry.seen])
        assert [*map(float, row[1:])] == pytest.approx(values, rel=1e-5)


def test_exact_law_is_that_of_the_analysis(model, reader):
    laws = pp.exact_law(model, seed=4, samples=FEWER["exact-law"]).poses[0].laws
    table = reader.table("Exact law of the first-order model")
    law = laws["position.y"]
    cells = dict(zip(table.rows[0][1:], table.row("dy [mm]"), strict=True))
    expected = {"mean": 1e3 * law.mean, "std": 1e3 * law.std, "95 %": 1e3 * law.law.quantile(0.95)}
    assert {name: float(cells[name]) for name in expected} == pytest.approx(expected, rel=1e-5)
    methods = reader.table("How exact the laws are")
    assert methods.row("dy")[0] == law.law.method
    assert agrees(methods.row("dy")[3], law.agreement.distance)
    assert f"|d|: {laws['position.norm'].reason}" in reader.text


def test_mcpc_parameters_are_those_of_the_paper(reader):
    # Table 1 of the paper: y_1 = -a_1, x_2 = a_2, x_3 = a_4, z_4 = -(a_1 + a_3 + a_5); lengths of the URDF
    table = reader.table("MCPC parameters")
    cells = {row[0]: dict(zip(table.rows[0], row, strict=True)) for row in table.rows[1:]}
    places = ["1 α [°]", "1 y [mm]", "2 x [mm]", "3 x [mm]", "4 z [mm]", "3 z [mm]", "3 γ [°]"]
    found = [cells[row][column] for row, column in (place.split(" ", 1) for place in places)]
    assert found == ["-90", "-85", "1970", "1770", "-274", "", ""]


def test_parameters_have_their_laws_in_words_and_what_they_feed(reader):
    table = reader.table("Random numbers")
    rows = {row[4]: row for row in table.rows[1:]}
    assert rows["a1"][1:] == ["uniform within ±0.05 mm", "length", "unit", "a1", "length[joint2], length[tool]"]
    assert rows["axis_install[joint2].A"] == [
        "axis of joint2, bearing A", "a point uniform over a disc of radius 0.1 mm", "length", "unit",
        "axis_install[joint2].A", "axis_install[joint2]",
    ]  # fmt: skip
    assert rows["joint_compliance[joint3].compliance"][:3] == [
        "compliance of joint3", "uniform within ±1 µrad/(N·m) about 10 µrad/(N·m)", "angular compliance",
    ]  # fmt: skip
    for quiet in ("payload[tool]", "beam[link2]", "beam[link3]"):
        assert quiet in reader.text


def test_assumptions_and_reproduction(model, reader):
    results, _ = paper()
    error = model.at().error_at_means
    nominal = ", ".join(f"{1e3 * value:.5g}" for value in error[:3])
    for words in (
        f"d = ({nominal}) mm",
        "nominal: loads act on the undeflected arm",
        "26 once for each built robot",
        "95 % for each interval by itself",
        "note W_STATICS",
        "accepted: the paper computes loads at the undeflected pose",
        "precision-pin report",
    ):
        assert words in reader.text
    table = reader.table("Files that were read")
    for file in ("4dof.urdf", "4dof.errors.yaml"):
        assert table.row(file) == [hashlib.sha256((PAPER_SHEET.parent / file).read_bytes()).hexdigest()]
    assert results.analysis.samples == SAMPLES


# other inputs --------------------------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")
def test_hostile_names_are_text(three_poses, reader, monkeypatch):
    """Drawn are the figures of one title and of all labels that hold names."""
    drawn, draw = [], figure_style._svg

    def with_names(figure: Figure) -> bytes:
        words = [text.get_text() for text in figure.findobj(Text)]
        if any(text.startswith(("Position error of", "zero of")) for text in words):
            drawn.append(draw(figure))
            return drawn[-1]
        return BLANK

    monkeypatch.setattr(figure_style, "_svg", with_names)
    sheet, found = three_poses
    text = page(next(one for one in found if one.analysis.pose_name == SCRIPT))
    assert len(drawn) == 4
    hostile = Reader(text)
    for name in (SCRIPT, SVG, MATHS, BRACE, HAN):
        assert name in "".join(hostile.words)
    # the tags of a page without such names, and none of its attributes is a script
    assert {tag.name for tag in hostile.tags} <= {tag.name for tag in reader.tags}
    assert not [key for tag in hostile.tags for key in tag.attributes if key.startswith("on")]
    assert str(sheet.parent) not in text
    names = [row[1] for row in hostile.table("MCPC").rows]
    assert (names[3], f"{HAN} (slides)" in names) == (BRACE, True)


def test_an_analysis_that_refuses_the_model_is_left_out_with_its_reason(tmp_path, undrawn):
    sheet = write_hostile(tmp_path)
    named = "parameters:\n  p: {uniform: 0.1 mrad}\n  r: {uniform: 0.2 mrad}\n"
    named += "correlations:\n  - {parameters: [p, r], correlation: 0.5}\nsources:"
    text = sheet.read_text("utf-8").replace("sources:", named)
    sheet.write_text(text.replace("{uniform: 0.1 mrad}}", "p}").replace("{normal: 0.3 mrad}", "r"), "utf-8")
    reader = Reader(page(results_of(sheet, samples=500)))
    assert "Exact law: not available. 'p' is correlated (p, r) and not normal" in reader.text
    assert "p and r: 0.5 of their normal scores, 0.4826 of the numbers" in reader.text  # 6/π asin(ρ/2)
    assert len(reader.named("svg")) == 7
    assert [row[0] for row in reader.table("Causes of the position error").rows].count("correlated: p + r") == 1


def test_few_samples_are_said_to_resolve_little(model, undrawn):
    results = sampled_again(model, samples=40)
    reader = Reader(verdict(results).text + distributions(results).text)
    assert reader.table("Errors that few robots exceed").row("|d| [mm]")[1:] == ["–"]
    assert "too few for the far quantiles" in reader.text
    assert set(reader.table("Numbers of the position").row("99.73 %")) == {"–"}


@pytest.mark.filterwarnings("ignore:.*W_NOTHING_VARIES")
def test_an_arm_without_errors(tmp_path, undrawn):
    sheet = tmp_path / "none.yaml"
    urdf = PAPER_SHEET.parent / "4dof.urdf"
    sheet.write_text(f"precision-pin: 1\nrobot: {urdf}\nposes: {{p: 0 10 20 30 deg}}\n", "utf-8")
    reader = Reader(page(results_of(sheet, samples=100)))
    assert "Nothing varies, so there are no shares." in reader.text
    assert "Nothing is drawn at random." in reader.text
    assert reader.table("Errors that few robots exceed").row("|d| [mm]") == ["0 [0, 0]", "–"]


@pytest.mark.skipif(not example_urdfs(), reason="example-robot-data is not installed")
def test_a_page_with_meshes_is_small_enough():
    model = pp.ErrorModel.load(PAPER_SHEET.parent / "panda.errors.yaml")
    at = model.at()
    # the view's cloud is the largest there is, and all else is about as large as for the paper's arm
    cloud = at.exact(at.space.sample(4, 0, CLOUD))
    text = scene([replace(paper()[0], model=model, at=at, cloud=cloud)]).text
    rest = len(paper()[1].encode()) - len(scene([paper()[0]]).text.encode())
    assert rest + len(text.encode()) < LARGEST
    for folder in {str(path.parent) for path in example_urdfs().values()}:
        assert folder not in text


# several poses -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def three_poses(tmp_path_factory):
    """Return a sheet with three poses, and the results at them."""
    folder = tmp_path_factory.mktemp("poses")
    sheet = write_hostile(folder)
    text = sheet.read_text("utf-8").replace(
        "poses:\n", "poses:\n  near: [10 deg, 0 deg, 0 m]\n  far: [10 deg, 0 deg, 2.9 m]\n"
    )
    sheet.write_text(text, "utf-8")
    settings = {"samples": 500, "seed": 4, "model": "exact", "command": ["precision-pin"], "package_dirs": ()}
    limit = [pp.specification("1 mm @ 90 %")]
    with pytest.MonkeyPatch.context() as patch:
        take_few_samples(patch)
        return sheet, collect_poses(read(sheet), ["near", "far", SCRIPT], specifications=limit, step=silent, **settings)


@pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")
def test_several_poses_stand_on_one_page_the_worst_first(three_poses, undrawn):
    sheet, found = three_poses
    assert found[0].analysis.pose_name == "far"
    # two poses have the sections of all analyses
    found = [*found[:2], replace(found[2], found={"budget": found[2].found["budget"]})]
    text = page(found)
    reader = Reader(text)
    table = reader.table("3 poses, the worst first")
    assert [row[0] for row in table.rows[1:]] == [one.analysis.pose_name for one in found]
    for one, row in zip(found, table.rows[1:], strict=True):
        alone = pp.monte_carlo(pp.ErrorModel.load(sheet), one.analysis.pose_name, samples=500, seed=4)
        assert agrees(row[2].split()[0], 1e3 * alone.position.norm.quantile(0.95))
        assert row[1] == one.analysis.summary.specifications[0].verdict
    identifiers = [tag.attributes["id"] for tag in reader.tags if "id" in tag.attributes]
    assert len(set(identifiers)) == len(identifiers)
    assert [name for name in identifiers if name.endswith("-pose")] == ["pose2-pose", "pose3-pose"]
    assert len(reader.named("iframe")) == 1
    assert {tag.attributes["href"][1:] for tag in reader.named("a")} <= set(identifiers)


@pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")
def test_the_map_has_a_section_and_its_verdict_stands_at_the_top(undrawn):
    results, without = paper()
    model = results.model
    q = model.configuration("paper")[:, None] + np.outer([0, 1, 0, 0], np.linspace(-1, 1, 30))
    found = pp.map_poses(model, q, specifications=["50 mm", "1 m"], verify=1)
    # of the analyses only the one that the verdict names
    few = replace(results, found={"budget": results.found["budget"]})
    text = page(few, [map_chapter(found)], missed=["on the map"])
    reader = Reader(text)
    sections = [tag.attributes["id"] for tag in reader.named("section")]
    worst = int(np.argmax(found.quantile[1, 0]))
    assert sections[sections.index("map") + 1] == "view"
    assert "#map" in [tag.attributes["href"] for tag in reader.named("a")]
    # nothing stands before the verdict, and its answers are in the same section
    assert "On the map" not in text[: text.index('class="verdict')]
    head = text[text.index('id="verdict"') : text.index('id="assumptions"')]
    kept = [int((found.probability[rank] >= 0.95).sum()) for rank in range(2)]
    verdicts = re.findall(r"On the map: .*?: (MET|NOT MET) - .*?met at (\d+) of 30 poses", head)
    assert verdicts == [("NOT MET", str(kept[0])), ("MET", "30")]
    assert f"On the map: worst pose 'pose {worst + 1}'" in reader.text
    own = text[text.index('id="map"') :]
    assert f"pose {worst + 1}" in own
    assert f"{1e3 * found.quantile[1, 0, worst]:.4g} mm" in own
    assert "On the map" not in without
    assert 'id="map"' not in without


def test_files_are_named_without_their_folders():
    results, _ = paper()
    folder = PAPER_SHEET.parent
    for text, expected in (
        (f"{folder}/4dof.urdf:3: warning W_X: what", "4dof.urdf:3: warning W_X: what"),
        ("mesh '/some/where/else/hand.dae' is not found", "mesh 'hand.dae' is not found"),
        *(2 * (text,) for text in ("a compliance in rad/(N*m), package://pkg/meshes/a.dae", "x/y m/s^2")),
    ):
        assert without_folders(text, results) == expected


# in a real browser -----------------------------------------------------------------------------------------------------

PATIENCE = 60_000
BACKGROUND = "getComputedStyle(document.body).backgroundColor"
OF_FIGURES = """
  [...document.querySelectorAll('svg')].map((svg) => getComputedStyle(svg.querySelector('path')).color)
"""
OPEN_ALL = "document.querySelectorAll('details').forEach((fold) => { fold.open = true; })"
TOO_WIDE = "document.documentElement.scrollWidth > innerWidth"
OUTSIDE = """
() => {
  const width = document.documentElement.clientWidth;
  const seen = [...document.querySelectorAll('table, svg, p, pre, dd, li, figcaption')]
    .filter((one) => !one.closest('details:not([open])'));
  return seen.map((one) => [one, one.getBoundingClientRect()])
    .filter(([one, box]) => box.width && (box.right > width + 1 || box.left < -1))
    .map(([one]) => one.tagName + ' ' + one.textContent.slice(0, 40));
}
"""


@pytest.fixture(scope="module")
def paper_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("report") / "paper.html"
    file.write_text(paper()[1], "utf-8")
    return file


@pytest.fixture(scope="module")
def kept_open(paper_page):
    """Yield the page in a browser; only the 3-D view in it has scripts, so that it follows sizes, schemes and media."""
    with chromium() as context:
        yield visited(context, paper_page)


@pytest.fixture
def visit(kept_open):
    kept_open.page.set_viewport_size({"width": 1280, "height": 800})
    kept_open.page.emulate_media(media="null", color_scheme="light")
    kept_open.page.evaluate(OPEN_ALL.replace("true", "false"))
    kept_open.page.evaluate("scrollTo(0, 0)")
    return kept_open


def blue_pixels(picture: bytes) -> int:
    """Return how many pixels are as blue as links 2 and 3 of the paper's arm."""
    red, green, blue = np.moveaxis(np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"), dtype=int), 2, 0)
    return int(((blue > red + 60) & (blue > green + 30)).sum())


@needs_chromium
def test_keyboard_and_links_lead_past_the_contents_and_into_tables_and_folds(visit):
    visit.page.keyboard.press("Tab")
    assert visit.page.evaluate("document.activeElement.className") == "skip"
    visit.page.keyboard.press("Enter")
    assert visit.page.evaluate("document.activeElement.id") == "main"
    unreached = "[...document.querySelectorAll('.wide, .drawing')].filter((one) => one.tabIndex !== 0).length"
    assert visit.page.evaluate(unreached) == 0
    budget = visit.page.locator("#budget")
    assert not budget.is_visible()
    visit.page.click("nav a[href='#budget']")
    assert budget.is_visible()
    assert 0 <= visit.page.locator("#budget-heading").bounding_box()["y"] < 100
    # on to the summary of the section after it
    visit.page.locator(".fold:has(> #worst-case)").locator("> summary").focus()
    for expected in (True, False):
        visit.page.keyboard.press("Enter")
        assert visit.page.locator("#worst-case").is_visible() == expected


@needs_chromium
def test_the_first_screen_holds_the_answer_and_the_arm_and_nothing_is_off_a_narrow_one(visit):
    for width, height in ((1280, 800), (390, 844)):
        visit.page.set_viewport_size({"width": width, "height": height})
        places = (".verdict", ".first table", ".causes", "#figure-arm svg")
        boxes = [visit.page.locator(place).first.bounding_box() for place in places]
        ends = [box["y"] + box["height"] for box in boxes]
        assert max(ends) <= height
    assert ends == sorted(ends)  # in reading order
    visit.page.evaluate(OPEN_ALL)
    assert not visit.page.evaluate(TOO_WIDE)
    # charts keep the size of their letters and scroll
    assert [one for one in visit.page.evaluate(OUTSIDE) if not one.startswith("svg")] == []
    label = "getComputedStyle(document.querySelector('#budget td:last-child'), '::before').content"
    assert "change of 95 % of |d|" in visit.page.evaluate(label)


@needs_chromium
def test_the_page_and_its_view_are_seen_in_either_scheme_without_complaint_or_request(visit):
    visit.page.evaluate(OPEN_ALL)
    frame = visit.page.locator("iframe")
    frame.scroll_into_view_if_needed()
    visit.page.frame_locator("iframe").locator("body[data-ready=yes]").wait_for(timeout=PATIENCE, state="attached")
    for scheme, width, ground, ink in (
        ("light", 1280, "rgb(255, 255, 255)", "rgb(27, 34, 43)"),
        ("dark", 600, "rgb(20, 24, 29)", "rgb(232, 236, 241)"),
    ):
        visit.page.emulate_media(color_scheme=scheme)
        visit.page.set_viewport_size({"width": width, "height": 800})
        assert not visit.page.evaluate(TOO_WIDE)
        assert visit.page.evaluate(BACKGROUND) == ground
        assert set(visit.page.evaluate(OF_FIGURES)) == {ink}
        assert visit.page.locator("#figure-arm svg").is_visible()
        frame.scroll_into_view_if_needed()
        assert eventually(lambda: blue_pixels(frame.screenshot()) > 2_000, PATIENCE / 1e3)
    assert complaints(visit) == outside_requests(visit) == []


@needs_chromium
def test_paper_gets_the_decision_or_what_is_open_and_the_still_picture_instead_of_the_view(visit):
    def sheets(paper: str) -> int:
        return len(re.findall(rb"/Type\s*/Page\b", visit.page.pdf(format=paper)))

    visit.page.emulate_media(color_scheme="dark")
    assert [sheets(paper) for paper in ("A4", "Letter")] == [2, 2]
    visit.page.emulate_media(media="print")
    seen = {name: visit.page.locator(name).is_visible() for name in (".paper", "#assumptions", "#budget")}
    assert seen == {".paper": True, "#assumptions": True, "#budget": False}
    # as the page is written with --full
    visit.page.evaluate(OPEN_ALL)
    assert 10 <= sheets("A4") <= 20
    # of the last section no line stands alone on the last page
    assert visit.page.evaluate("getComputedStyle(document.querySelector('#reproduce')).breakInside") == "avoid"
    seen = {name: visit.page.locator(name).is_visible() for name in ("#budget", "#figure-arm svg", "iframe", "nav")}
    assert seen == {"#budget": True, "#figure-arm svg": True, "iframe": False, "nav": False}
    assert visit.page.evaluate(BACKGROUND) == "rgb(255, 255, 255)"
    # nothing is clipped at the width between the margins of A4 and Letter, in pixels of CSS
    for width_mm in (182, 188):
        visit.page.set_viewport_size({"width": int(width_mm / 25.4 * 96), "height": 1000})
        assert visit.page.evaluate(OUTSIDE) == []


@needs_chromium
def test_without_scripts_the_still_picture_stands_there(paper_page):
    with chromium(java_script_enabled=False) as context:
        visit = visited(context, paper_page)
        assert visit.page.locator("#figure-arm svg").is_visible()
        assert not visit.page.locator("iframe").is_visible()
