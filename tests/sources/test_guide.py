"""Guides of slides in a sheet: tables and harmonics through every engine, and what a table cannot be."""

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.analyses.collect import find_causes
from precision_pin.base.errors import SheetError
from precision_pin.sheet.reader import read
from precision_pin.sources.guide import Guide
from support.engines import check_engines, written
from support.plain_robot import chain_of, gantry, joint, limits, link, robot

LINES = """\
guide: {joint: rail, EXX: 12 um, EYX: [10 ± 2 um, 4 um], EZX: [6 um, 2 um], EAX: [30 urad, 0 urad], order: [1, 3]}
guide: {joint: lift, EYX: 8 um, EZX: 5 um, length: 400 mm, order: 2, short_carriage: true}
guide: {joint: lift, file: column.csv}
"""


def test_guides_of_a_sheet_through_every_engine(tmp_path):
    rows = "travel [mm], EYX [um], ECX [arcsec]\n-400, -5, 2\n0, 3, -1\n400, -5, 0\n"
    (tmp_path / "column.csv").write_text(rows, encoding="utf-8")
    lines = LINES.replace("EXX: 12 um", "EXX: [12 um, 0 um]")
    model = pp.ErrorModel.load(written(tmp_path, lines, sliding=True))
    assert model.draw_words[0] == "straightness EYX of rail"
    # at -200 mm the table is half way between two rows; X is z of the lift's frame, Y its x, Z its y; the tool is 0.5 m along x
    table = pp.ErrorModel(model.chain, pp.Space(), [model.sources[2]]).at([0.3, -0.2])
    turn = np.radians(0.5 / 3600)
    expected = [-1e-6 + 0.5 * (np.cos(turn) - 1), 0, -0.5 * np.sin(turn), 0, turn, 0]
    np.testing.assert_allclose(table.error_at_means, expected, rtol=0, atol=1e-15)
    check_engines(model)


def test_a_harmonic_has_half_its_squared_amplitude_as_variance_wherever_the_slide_is():
    model = pp.ErrorModel(
        gantry(), pp.Space(), [Guide(joint="y", EYX=(20e-6,)), Guide(joint="y", EZX=(20e-6,), order=(3.0,))]
    )
    for y in (-1.0, 0.13, 0.9):
        np.testing.assert_allclose(
            np.diag(model.at([0.1, y, 0.2, 0]).covariance)[:3], [5e-11, 0, 5e-11], rtol=1e-12, atol=1e-25
        )
    # a quarter of the 2 m between the limits further, nothing is left of the correlation; half way on, it is reversed
    first, second, third = (model.at([0, y, 0, 0]).jacobian[2, :2] for y in (-0.3, 0.2, 0.7))
    np.testing.assert_allclose([first @ second, first @ third / (first @ first)], [0, -1], rtol=0, atol=1e-12)


def test_a_table_does_not_reach_beyond_its_rows(tmp_path):
    file = tmp_path / "rail.csv"
    file.write_text("travel [mm], EXX [um]\n0, 1\n500, 2\n", encoding="utf-8")
    model = pp.ErrorModel(gantry(), pp.Space(), [Guide(joint="x", file=file)])
    assert model.at([0.5, 0, 0, 0]).error_at_means[0] == pytest.approx(2e-6)
    poses = np.array([[0.1, 0.6], [0, 0], [0, 0], [0, 0]])
    for ask in (lambda: model.at([0.6, 0, 0, 0]), lambda: list(model.at_many(poses))):
        with pytest.raises(
            pp.InputError, match=r"guide\[x\]: the joint is at 600 mm, beyond the table from 0 to 500 mm"
        ):
            ask()
    file.write_text("travel [mm], EXX [um]\n0, 1\n299, 2\n", encoding="utf-8")
    sheet = written(tmp_path, "guide: {joint: rail, file: rail.csv}", sliding=True)
    with pytest.raises(SheetError, match=r"guide\[rail\]: the joint is at 300 mm, beyond the table from 0 to 299 mm"):
        read(sheet)


def test_harmonics_need_a_length():
    chain = chain_of(robot(link("base"), joint("x", "prismatic", "base", "tool", extra=limits(0, 0)), link("tool")))
    with pytest.raises(pp.InputError, match=r"guide\[x\]: the joint has no limits; give the length: of the travel"):
        pp.ErrorModel(chain, pp.Space(), [Guide(joint="x", EXX=(1e-5,))]).at([0.0])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "travel [mm], EXY [um]\n0, 1\n5, 2\n",
            r"rail\.csv: unknown column 'EXY': did you mean 'EZX' or 'EYX' or 'EXX'",
        ),
        ("EXX [um]\n0\n5\n", r"no column in \S+rail\.csv named 'travel'"),
        ("travel [mm], EXX [urad]\n0, 1\n5, 2\n", "'urad' of the column 'EXX' is not a unit of length"),
        ("travel [mm], EXX [um]\n0, 1\n", "two or more rows are needed, each at another travel"),
        (
            "travel [mm], EXX [um]\n5, 1\n0, 1\n5, 2\n",
            r"rail\.csv, line 3: the travel is 0 mm after 5 mm; the rows must go",
        ),
        (
            "travel [mm], EXX [um]\n9, 1\n5, 1\n5, 2\n0, 2\n",
            r"rail\.csv, line 4: the travel is 5 mm after 5 mm; .* each place once",
        ),
        ("travel [mm]\n0\n5\n", r"rail\.csv has no column of errors; allowed: EXX, EYX, EZX, EAX, EBX, ECX"),
    ],
)
def test_what_is_no_table_of_a_guide_is_refused(tmp_path, text, message):
    (tmp_path / "rail.csv").write_text(text, encoding="utf-8")
    with pytest.raises(pp.InputError, match=message):
        Guide(joint="x", file=tmp_path / "rail.csv")


@pytest.mark.parametrize(("rows", "warns"), [((0, 9, 20, 31), True), ((3, -2, 4, 0), False), ((0, 0, 0, 0), False)])
def test_a_slope_of_the_straightness_is_warned_of(tmp_path, rows, warns):
    lines = [f"{100 * k}, {row}" for k, row in enumerate(rows)]
    (tmp_path / "rail.csv").write_text("\n".join(["travel [mm], EZX [um]", *lines, ""]), encoding="utf-8")
    sheet = read(written(tmp_path, "guide: {joint: rail, file: rail.csv}", sliding=True))
    found = [finding.message for finding in sheet.findings if finding.code == "W_STRAIGHTNESS"]
    assert [message[:54] for message in found] == ["EZX of guide[rail] rises by 31.2 µm along its travel, "] * warns


def test_a_tolerance_about_zero_is_warned_of(tmp_path):
    sheet = read(written(tmp_path, "guide: {joint: rail, EYX: ±10 um}", sliding=True))
    (found,) = [finding.message for finding in sheet.findings if finding.code == "W_AMPLITUDE"]
    assert "(the error's standard deviation is then the tolerance over √8)" in found


def test_each_error_is_a_cause_with_its_phase(tmp_path):
    errors = "EXX: 9 um, EYX: {uniform: 2 um, mean: 8 um}, EAX: 20 urad"
    causes = find_causes(pp.ErrorModel.load(written(tmp_path, f"guide: {{joint: rail, {errors}}}", sliding=True)))
    assert {cause.text: cause.names for cause in causes} == {
        "positioning EXX of rail": ("guide[rail].EXX_phase",),
        "straightness EYX of rail, ±2 um": ("guide[rail].EYX", "guide[rail].EYX_phase"),
        "roll EAX of rail": ("guide[rail].EAX_phase",),
    }


def test_the_worst_phase_is_told_without_rounding():
    model = pp.ErrorModel(gantry(), pp.Space(), [Guide(joint="y", EXX=(20e-6,))])
    # a quarter of the travel from the middle the cosine of 2π y/L is rounding
    (contribution,) = pp.worst_case(model, [0, 0.5, 0, 0], samples=200).poses[0].position.contributions
    assert contribution.at in ("1, 0", "-1, 0")
