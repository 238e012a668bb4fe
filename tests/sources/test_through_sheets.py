"""Sources from a sheet: their numbers in SI, their draws by name, and every engine on all of them together."""

import numpy as np
import pytest

from precision_pin import ErrorModel, InputError, Scope, TruncatedNormal
from precision_pin.sources import Table
from support.checks.places import CORRELATION, PLANE, STD, rows
from support.engines import check_engines, written

pytestmark = pytest.mark.filterwarnings(
    "ignore:.*W_(NO_POSES|FEW_SAMPLES|CONSTANT|OFF_CHAIN|SUPERPOSITION):precision_pin.base.errors.PrecisionPinWarning"
)
ARCSEC = np.pi / 648000
STDS = "[0.1 mm, 0.2 mm, 0.3 mm, 1 mrad, 2 mrad, 3 mrad]"
TRACKER = "x [mm], y [mm], rz [mrad]\n0.012, -0.030, 0.05\n-0.004, 0.011, -0.02\n0.007, -0.018, 0.04\n"


def flow(matrix) -> str:
    return "[" + ", ".join("[" + ", ".join(map(repr, row)) + "]" for row in rows(matrix)) + "]"


TURNING = f"""\
encoder: {{joint: joint1, resolution: 20 arcsec, offset: {{normal: 0.02 deg}}, eccentricity: 10 um, radius: 20 mm}}
encoder: {{joint: joint2, amplitude: {{uniform: 10 arcsec, mean: 30 arcsec}}, order: 2, heads: 2, ratio: 50}}
encoder: {{joint: joint3, resolution: 0.1 deg, ratio: 100, scope: visit}}
covariance: {{joint: joint3, std: {STDS}, correlation: {flow(CORRELATION)}, scope: visit}}
covariance: {{frame: tool, matrix: {flow(CORRELATION * np.outer(STD, STD))}, mean: [1 mm, 0 m, 0 m, 0.1 deg, 0 deg, 0 deg]}}
mounting: {{at: base, x: {{normal: 0.5 mm}}, y: {{normal: 0.5 mm}}, rz: {{uniform: 0.5 mrad}}, ry: 0.1 mrad}}
mounting: {{at: tool, flange: link4, rx: {{uniform: 0.2 mrad}}, z: grip}}
table: {{frame: tool, file: measured/tracker.csv, scope: visit}}
thermal: {{expansion: {{uniform: 1 ppm/K, mean: 23e-6 1/K}}, temperature_change: warmth}}
thermal: {{link: link3, expansion: 12 um/(m*K), gradient: {{uniform: 20 K/m}}, across: z of base}}
thermal: {{link: link2, expansion: {{fixed: 1 um/(m*degC)}}, temperature_change: 3 degC}}
transmission: {{joint: joint2, amplitude: [0.25 arcmin, {{uniform: 5 arcsec, mean: 20 arcsec}}], order: [200, 1]}}
transmission: {{joint: joint3, stiffness: {{uniform: 2 kN*m/rad, mean: 50 kN*m/rad}}}}
levelling: {{rx: {{normal: 0.3 mrad}}, ry: {{normal: 0.3 mrad}}}}
joint_compliance: {{joint: joint2, compliance: {{uniform: 1e-6 rad/(N*m), mean: 1e-5 rad/(N*m)}}}}
backlash: {{joint: joint2, backlash: {{uniform: 0.5 arcmin, mean: 2 arcmin}}, band: 300 N*mm}}
bearing_stiffness: {{joint: joint1, radial: k, axial: 120 kN/mm, centre: -2 cm, tilt: {{uniform: 5 N*m/deg, mean: 30 N*m/deg}}}}
clearance: {{joint: joint1, diametral: [seat, {{uniform: 5 um, mean: 10 um}}], axial: 8 um, start: -4 cm, span: 8 cm, band: 2 N}}
payload: {{at: tool, mass: {{uniform: 0.5 kg, mean: 5 kg}}, com: [{{uniform: 5 mm}}, 0 mm, 0 mm]}}
"""
PARAMETERS = (
    "grip: {uniform: 20 um, scope: visit}, warmth: {uniform: 2 K}, seat: {triangular: 4 um, mean: 15 um}, "
    "k: {normal: 10 N/um, mean: 80 N/um, truncated: true}"
)
DRAWN = """
grip warmth seat k
encoder[joint1].offset encoder[joint1].quantisation encoder[joint1].phase.x encoder[joint1].phase.y
encoder[joint2].amplitude encoder[joint2].phase.x encoder[joint2].phase.y encoder[joint3].quantisation
mounting[base].x mounting[base].y mounting[base].rz mounting[tool].rx
table[tool].row.x table[tool].row.y table[tool].row.rz
thermal[arm].expansion thermal[link3].gradient thermal[link2].expansion
transmission[joint2].amplitude[1] transmission[joint2].phase.x transmission[joint2].phase.y
transmission[joint2].phase[1].x transmission[joint2].phase[1].y transmission[joint3].stiffness
levelling[base].rx levelling[base].ry joint_compliance[joint2].compliance
backlash[joint2].backlash backlash[joint2].side bearing_stiffness[joint1].tilt
clearance[joint1].diametral[1] clearance[joint1].A.x clearance[joint1].A.y clearance[joint1].B.x clearance[joint1].B.y
clearance[joint1].side payload[tool].mass payload[tool].com
"""


@pytest.mark.slow
def test_turning_joints_through_every_engine(tmp_path):
    (tmp_path / "measured").mkdir()
    (tmp_path / "measured" / "tracker.csv").write_text(TRACKER, encoding="utf-8")
    model = ErrorModel.load(written(tmp_path, TURNING, parameters=PARAMETERS))
    errors = {f"covariance[{where}].error.{k}" for where in ("joint3", "tool") for k in range(6)}
    assert set(model.space.components) == set(DRAWN.split()) | errors
    draws = {draw.name: draw for draw in model.space.draws}
    visited = {name for name, draw in draws.items() if draw.scope is Scope.VISIT}
    assert visited == {"grip", "encoder[joint3].quantisation", "covariance[joint3].error", "table[tool].row",
                       "backlash[joint2].side",
        *(f"clearance[joint1].{name}" for name in ("A", "B", "side")),
    }  # fmt: skip
    assert draws["encoder[joint1].quantisation"].scope is Scope.POSE
    assert draws["k"].law == TruncatedNormal(1e7 / 3, 8e7, 3.0)
    for name in ("joint3", "tool"):
        law = draws[f"covariance[{name}].error"].law
        np.testing.assert_allclose(law.covariance, CORRELATION * np.outer(STD, STD), rtol=1e-14, atol=0)
    np.testing.assert_allclose(law.mean_vector, [1e-3, 0, 0, np.radians(0.1), 0, 0], rtol=1e-15)
    table = draws["table[tool].row"].law.array
    np.testing.assert_allclose(
        table, [[12e-6, -30e-6, 50e-6], [-4e-6, 11e-6, -20e-6], [7e-6, -18e-6, 40e-6]], rtol=1e-15
    )
    np.testing.assert_allclose(draws["table[tool].row"].law.covariance, np.cov(table.T, bias=True), rtol=1e-13)
    variance = dict(zip(model.space.components, np.diag(model.space.covariance), strict=True))
    mean = dict(zip(model.space.components, model.space.mean, strict=True))
    for name, middle, half in (
        ("encoder[joint1].quantisation", 0, 10 * ARCSEC),
        ("encoder[joint3].quantisation", 0, np.radians(0.5e-3)),
        ("thermal[arm].expansion", 23e-6, 1e-6),
        ("thermal[link2].expansion", 1e-6, 0),
        ("thermal[link3].gradient", 0, 20),
        ("transmission[joint3].stiffness", 5e4, 2e3),
        ("backlash[joint2].backlash", 120 * ARCSEC, 30 * ARCSEC),
        ("bearing_stiffness[joint1].tilt", 30 * 180 / np.pi, 5 * 180 / np.pi),
        ("clearance[joint1].diametral[1]", 1e-5, 5e-6),
    ):
        assert mean[name] == pytest.approx(middle, rel=1e-14, abs=1e-20), name
        assert variance[name] == pytest.approx(half**2 / 3, rel=1e-14), name
    backlash, bearing, clearance = (
        one for one in model.sources if one.kind() in ("backlash", "bearing_stiffness", "clearance")
    )
    read = [backlash.band, bearing.axial, bearing.centre]
    read += [clearance.start, clearance.span, clearance.band, clearance.axial]
    assert read == pytest.approx([0.3, 1.2e8, -0.02, -0.04, 0.08, 2.0, 8e-6], rel=1e-15)
    # 10 µm on 20 mm is 0.5 mrad, at -90° all of it times minus cos φ
    (x, y) = (term for term in model.at().terms if "joint1].phase" in str(term.factors))
    np.testing.assert_allclose([x.twist[0], y.twist[0]], [-5e-4, 0], atol=1e-18)
    check_engines(model)


SLIDING = """\
encoder: {joint: rail, resolution: 5 um, amplitude: 0.5 um, period: 20 um, scale: {uniform: 5 um/m}}
transmission: {joint: rail, amplitude: 4 um, order: 1, period: 10 mm, lead_error: {uniform: 77 um/m}}
transmission: {joint: lift, stiffness: {uniform: 5 N/um, mean: 50 N/um}, lead_error: {normal: 77 um/m}}
"""
LOOSE = """
backlash: {joint: lift, backlash: 20 um, band: 0.1 kN, scope: pose}
bearing_stiffness: {joint: rail, radial: 50 N/um, tilt: 2e4 N*m/rad, roll: 9 N*m/mrad, pads_on: parent}
clearance: {joint: rail, diametral: 0.03 mm, span: 60 mm, direction: random, law: disc, scope: unit, pads_on: parent}
"""


def test_sliding_joints_through_every_engine(tmp_path):
    at = ErrorModel.load(written(tmp_path, SLIDING, sliding=True)).at()
    # 0.3 m along the rail: ±1.5 µm of scale, ±2.5 µm of a step, ±0.5 µm within the period; the screw's lead and turns
    expected = (1.5e-6**2 + 2.5e-6**2) / 3 + 0.5e-6**2 / 2 + (0.3 * 77e-6) ** 2 / 3 + 4e-6**2 / 2
    np.testing.assert_allclose(at.covariance[0, 0], expected, rtol=1e-9)
    # 4 kg sink by 4 · 9.81 N / 50 N/µm
    np.testing.assert_allclose(at.tangent[0][2], -4 * 9.81 / 50e6, rtol=1e-9)
    sinking = (4 * 9.81 * 5e6 / 50e6**2) ** 2 / 3
    np.testing.assert_allclose(at.covariance[2, 2], (0.2 * 77e-6 / 3) ** 2 + sinking, rtol=1e-9)
    model = ErrorModel.load(written(tmp_path, SLIDING + LOOSE.strip(), sliding=True))
    backlash, bearing, clearance = model.sources[-3:]
    assert (backlash.band, backlash.scope, bearing.roll, bearing.pads_on) == (100.0, "pose", 9000.0, "parent")
    assert (clearance.law, clearance.scope, clearance.pads_on) == ("disc", "unit", "parent")
    assert clearance.diametral == (3e-5,)
    check_engines(model)


# --- tables of measured rows ---


def test_the_path_is_relative_to_the_sheet_wherever_it_is_read_from(tmp_path, monkeypatch):
    (tmp_path / "sheets").mkdir()
    (tmp_path / "tracker.csv").write_text(TRACKER, encoding="utf-8")
    file = written(tmp_path / "sheets", "table: {frame: tool, file: ../tracker.csv}")
    monkeypatch.chdir(tmp_path / "sheets")
    inside = ErrorModel.load(file.name)
    monkeypatch.chdir("/")
    np.testing.assert_array_equal(ErrorModel.load(file).space.mean, inside.space.mean)


def test_a_table_that_is_too_large_or_of_an_odd_scope_is_refused(tmp_path, monkeypatch):
    file = tmp_path / "large.csv"
    file.write_text(PLANE, encoding="utf-8")
    with pytest.raises(InputError, match="scope: of table must be unit, pose or visit, got 'day'"):
        Table(joint="hinge", file=file, scope="day")
    monkeypatch.setattr("precision_pin.base.csv_columns.LARGEST_FILE", 10)
    with pytest.raises(InputError, match=r"large\.csv is larger than"):
        Table(joint="hinge", file=file)


def test_what_spreadsheets_write_is_read(tmp_path):
    """A byte order mark, Windows line ends, quoted headers, blanks, units without a blank."""
    text = '\ufeff"x [mm]" ,y[µm],"rz [mrad]"\r\n 0.012 , -30 ,5e-2\r\n'
    (tmp_path / "sheet.csv").write_bytes(text.encode())
    (draw,) = Table(joint="hinge", file=tmp_path / "sheet.csv").draws("table[hinge]")
    np.testing.assert_allclose(draw.law.array, [[12e-6, -30e-6, 50e-6]], rtol=1e-15)
