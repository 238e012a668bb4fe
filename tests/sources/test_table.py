from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from precision_pin.base.errors import InputError, SheetError
from precision_pin.draws.draw import Scope
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.model.error_model import ErrorModel
from precision_pin.sampling import monte_carlo
from precision_pin.sources import table
from precision_pin.sources.table import Table
from support.checks.common import one_link
from support.checks.places import PLANE, check_table
from support.engines import check_engines, check_no_spread, written

TRACKER = "x [mm], y [mm], rz [mrad]\n0.012, -0.030, 0.05\n-0.004, 0.011, -0.02\n0.007, -0.018, 0.04\n"


@pytest.fixture
def plane(tmp_path: Path) -> Path:
    file = tmp_path / "plane.csv"
    file.write_text(PLANE, encoding="utf-8")
    return file


def test_by_hand_and_against_the_displaced_robot():
    check_table(table)


@pytest.mark.slow
@pytest.mark.filterwarnings(
    "ignore:.*W_(NO_POSES|FEW_SAMPLES|CONSTANT|OFF_CHAIN):precision_pin.base.errors.PrecisionPinWarning"
)
def test_from_a_sheet_through_every_engine(tmp_path):
    (tmp_path / "measured").mkdir()
    (tmp_path / "measured" / "tracker.csv").write_text(TRACKER, encoding="utf-8")
    file = written(
        tmp_path,
        "table: {frame: tool, file: measured/tracker.csv, scope: visit}\n"
        f"table: {{joint: joint2, file: {tmp_path / 'measured' / 'tracker.csv'}}}",
    )
    model = ErrorModel.load(file)
    one, two = model.space.draws
    assert (one.name, one.scope) == ("table[tool].row", Scope.VISIT)
    assert (two.name, two.scope) == ("table[joint2].row", Scope.UNIT)
    rows = np.array([[12e-6, -30e-6, 50e-6], [-4e-6, 11e-6, -20e-6], [7e-6, -18e-6, 40e-6]])
    np.testing.assert_allclose(one.law.array, rows, rtol=1e-15)
    np.testing.assert_allclose(one.law.covariance, np.cov(rows.T, bias=True), rtol=1e-13)
    check_engines(model)


@pytest.mark.filterwarnings(
    "ignore:.*W_(NO_POSES|FEW_SAMPLES|CONSTANT|OFF_CHAIN):precision_pin.base.errors.PrecisionPinWarning"
)
def test_the_path_is_relative_to_the_sheet_wherever_it_is_read_from(tmp_path, monkeypatch):
    (tmp_path / "sheets").mkdir()
    (tmp_path / "tracker.csv").write_text(TRACKER, encoding="utf-8")
    file = written(tmp_path / "sheets", "table: {frame: tool, file: ../tracker.csv}")
    monkeypatch.chdir(tmp_path / "sheets")
    inside = ErrorModel.load(file.name)
    monkeypatch.chdir("/")
    np.testing.assert_array_equal(ErrorModel.load(file).space.mean, inside.space.mean)


def test_the_rows_stay_together_in_the_compiled_sampler(plane):
    model = ErrorModel(one_link(), Space(), [Table(joint="hinge", file=plane)])
    result = monte_carlo(model, [0.0], samples=20_000, seed=4, model="linear", keep_samples=True)
    assert result.errors is not None
    tips, counts = np.unique(np.round(result.errors[[1, 5]] * 1e3, 9), axis=1, return_counts=True)
    # y + 1 m · rz of the four rows, each as often as any other: six standard deviations of a binomial count
    np.testing.assert_allclose(tips, [[-6, -1, 3, 4], [-3, 0, 2, 1]], rtol=0, atol=1e-9)
    assert np.abs(counts - 5000).max() < 6 * np.sqrt(20_000 * 0.25 * 0.75)


def test_two_places_with_one_file_draw_their_own_rows(plane):
    model = ErrorModel(one_link(), Space(), [Table(joint="hinge", file=plane), Table(frame="tool", file=plane)])
    x = model.space.sample(1, 0, 100)
    assert (x[0] != x[2]).any()
    np.testing.assert_array_equal(model.space.covariance[:2, 2:], np.zeros((2, 2)))


@pytest.mark.parametrize("scope", ["unit", "pose", "visit"])
def test_scope(plane, scope):
    model = ErrorModel(one_link(), Space(), [Table(frame="tool", file=plane, scope=scope)])
    layout = sampler.to_arrays(model.at([0.0]))
    home, visit, pose = (
        sampler.errors(layout, "exact", 1, 0, 50, pose=p, visit=v) for p, v in ((0, 0), (0, 1), (1, 0))
    )
    assert np.array_equal(home, visit) == (scope != "visit")
    assert np.array_equal(home, pose) == (scope == "unit")


def test_one_row_is_no_spread(tmp_path):
    (tmp_path / "one.csv").write_text("x [mm]\n0.3\n", encoding="utf-8")
    model = ErrorModel(one_link(), Space(), [Table(joint="hinge", file=tmp_path / "one.csv")])
    check_no_spread(model, [0.2])
    assert model.at([0.0]).exact(model.space.mean[:, None])[0, 0] == pytest.approx(0.3e-3, rel=1e-12)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({}, "table needs one of joint:, link: and frame:"),
        ({"joint": "hinge", "frame": "tool"}, "table needs one of joint:, link: and frame:"),
        ({"joint": "hinge", "scope": "day"}, "scope: of table must be unit, pose or visit, got 'day'"),
    ],
)
def test_bad_settings_are_refused(plane, settings, message):
    with pytest.raises(InputError, match=message):
        Table(file=plane, **settings)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, r"gauge\.csv does not exist"),
        ("", r"gauge\.csv contains no rows of numbers"),
        ("x [mm]\n", r"gauge\.csv contains no rows of numbers"),
        ("# only\n\n# remarks\n", r"gauge\.csv contains no rows of numbers"),
        ("x [mm], y [mm]\n1, 2\n3\n", r"gauge\.csv, line 3: 1 cells, but the header has 2"),
        ("x [mm], y [mm]\n1, 2\n\n3, 4, 5\n", r"gauge\.csv, line 4: 3 cells, but the header has 2"),
        ("x [mm], y [mm]\n1, 2\n3,\n", r"gauge\.csv, line 3: '' is not a number"),
        ("x [mm]\n1\nhigh\n", r"gauge\.csv, line 3: 'high' is not a number such as"),
        ("x [mm]\nnan\n", r"gauge\.csv, line 2: 'nan' is not a number"),
        ("x [mm]\ninf\n", r"gauge\.csv, line 2: 'inf' is not a number"),
        ("x [mm]\n1e999\n", r"gauge\.csv, line 2: '1e999' is not a number"),
        ("x [mm]\n1_000\n", r"gauge\.csv, line 2: '1_000' is not a number"),
        ("x [mm]\n0.1 mm\n", r"gauge\.csv, line 2: '0\.1 mm' is not a number"),
        ('x [mm]\n"0,1"\n', r"gauge\.csv, line 2: '0,1' is not a number"),
        ("x [mm]; y [mm]\n0,1; 0,2\n", r"line 1: 'x \[mm\]; y \[mm\]' does not name a column .* separated by commas"),
        ("x [mm], [mm]\n1, 2\n", r"gauge\.csv, line 1: '\[mm\]' does not name a column"),
        ("x [mm], x [m]\n1, 2\n", r"gauge\.csv, line 1: two columns are named 'x'"),
        ("1, 2\n3, 4\n", r"gauge\.csv, line 1: the first row must name the columns and their units"),
        ("x [mm], w [mm]\n1, 2\n", r"gauge\.csv: unknown column 'w': .*rx"),
        ("x [mm], rX [rad]\n1, 2\n", r"gauge\.csv: unknown column 'rX': did you mean 'rx'"),
        ("x, y [mm]\n1, 2\n", r"the column 'x' has no unit; write the unit of a length after its name: x \[m\]"),
        ("x []\n1\n", r"the column 'x' has no unit"),
        ("x [mrad]\n1\n", r"'mrad' of the column 'x' is not a unit of length; allowed: m, cm, mm"),
        ("rz [mm]\n1\n", r"'mm' of the column 'rz' is not a unit of angle; allowed: rad"),
        ("x [km]\n1\n", r"'km' of the column 'x' is not a unit of length"),
        ("x [mm mm]\n1\n", r"'mm mm' of the column 'x' is not a unit of length"),
        ("rx [turn]\n1e308\n", r"the column 'rx' contains a number that is too large"),
        (b"x [mm]\n\xff\n", r"gauge\.csv is not UTF-8 text \(byte 7\)"),
    ],
)
def test_a_bad_file_gives_one_line_at_the_source(tmp_path, text, message):
    if text is not None:
        (tmp_path / "gauge.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(SheetError, match=rf"arm\.errors\.yaml:6: error E_\w+: .*{message}") as caught:
        ErrorModel.load(written(tmp_path, "table: {joint: joint1, file: gauge.csv}"))
    assert len(caught.value.findings) == 1
    assert "\n" not in str(caught.value.findings[0])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ("joint: joint1", "the key 'file' is missing"),
        ("joint: joint1, file: ''", "file: expected the name of a file"),
        ("joint: joint1, file: [a, b]", "file: expected the name of a file"),
        ("joint: joint1, file: .", "is not a regular file"),
        ("joint: joint1, file: 'a\\0b'", "cannot be read|does not exist"),
        ("joint: joint9, file: plane.csv", "no joint on the chain named 'joint9'"),
        ("joint: joint1, file: plane.csv, scope: day", "scope"),
    ],
)
def test_bad_sheets_give_one_line(tmp_path, plane, settings, message):
    with pytest.raises(SheetError, match=rf"arm\.errors\.yaml:6: error E_\w+: .*({message})") as caught:
        ErrorModel.load(written(tmp_path, f"table: {{{settings}}}"))
    assert len(caught.value.findings) == 1


def test_a_file_that_is_too_large_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("precision_pin.base.csv_columns.LARGEST_FILE", 10)
    (tmp_path / "large.csv").write_text(PLANE, encoding="utf-8")
    with pytest.raises(InputError, match=r"large\.csv is larger than"):
        Table(joint="hinge", file=tmp_path / "large.csv")


def test_what_spreadsheets_write_is_read(tmp_path):
    """A byte order mark, Windows line ends, quoted headers, blanks, units without a blank."""
    text = '\ufeff"x [mm]" ,y[µm],"rz [mrad]"\r\n 0.012 , -30 ,5e-2\r\n'
    (tmp_path / "sheet.csv").write_bytes(text.encode())
    (draw,) = Table(joint="hinge", file=tmp_path / "sheet.csv").draws("table[hinge]")
    np.testing.assert_allclose(draw.law.array, [[12e-6, -30e-6, 50e-6]], rtol=1e-15)
