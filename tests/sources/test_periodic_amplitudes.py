"""What an amplitude means, and that a law about zero is warned of: in sheets, in the documentation, in shipped sheets."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from precision_pin.draws.laws import Law, Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sheet import read
from precision_pin.sources.encoder import Encoder
from precision_pin.sources.transmission import Transmission
from precision_pin.terms.term import JointValue
from support.checks.common import evaluated, one_link
from support.engines import written

ARCSEC = np.pi / 648000
DOCS = Path(__file__).parents[2] / "docs"


def spreads(source) -> tuple[float, float]:
    """Return the standard deviation of the joint's turn, arcsec: of the first-order model, and of 200,000 samples."""
    model = ErrorModel(one_link(), Space(), [source])
    at = model.at([0.3])
    sampled = at.exact(model.space.sample(3, 0, 200_000))[5]
    return float(np.sqrt(at.covariance[5, 5])) / ARCSEC, float(sampled.std()) / ARCSEC


@pytest.mark.slow
@pytest.mark.parametrize(
    ("amplitude", "expected", "first_order"),
    [
        pytest.param(30 * ARCSEC, 30 / np.sqrt(2), 30 / np.sqrt(2), marks=pytest.mark.slow),
        (Uniform(10 * ARCSEC, mean=30 * ARCSEC), np.sqrt((30**2 + 10**2 / 3) / 2), 30 / np.sqrt(2)),
        (Normal(10 * ARCSEC), 10 / np.sqrt(2), 0.0),
    ],
    ids=["known", "with a tolerance", "about zero"],
)
def test_the_standard_deviation_of_a_periodic_error_by_plain_draws(amplitude, expected, first_order):
    """Of an amplitude about zero the first-order model, at its mean, sees nothing."""
    rng = np.random.default_rng(4)
    count = 200_000
    drawn = {
        "Uniform": lambda: rng.uniform(20, 40, count),
        "Normal": lambda: rng.normal(0, 10, count),
    }.get(type(amplitude).__name__, lambda: np.full(count, 30.0))()
    plain = drawn * np.sin(7 * 0.3 + rng.uniform(0, 2 * np.pi, count))
    assert plain.std() == pytest.approx(expected, rel=0.01)
    for source in (
        Transmission(joint="hinge", amplitude=(amplitude,), order=(7.0,)),
        Encoder(joint="hinge", amplitude=amplitude, order=7),
    ):
        closed, sampled = spreads(source)
        assert closed == pytest.approx(first_order, rel=1e-12)
        assert sampled == pytest.approx(expected, rel=0.01)
        assert isinstance(amplitude, Law) or closed == pytest.approx(21.21, abs=0.005)


ABOUT_ZERO = (
    ("transmission: {joint: joint2, amplitude: {normal: 30 arcsec}, order: 200}", "amplitude of transmission[joint2]"),
    ("encoder: {joint: joint2, amplitude: {uniform: 30 arcsec}}", "amplitude of encoder[joint2]"),
    ("encoder: {joint: joint2, eccentricity: {normal: 5 um}, radius: 20 mm}", "eccentricity of encoder[joint2]"),
    (
        "transmission: {joint: joint1, amplitude: [30 arcsec, {triangular: 9 arcsec}], order: [1, 2]}",
        "amplitude[1] of transmission[joint1]",
    ),
)


@pytest.mark.parametrize(("line", "what"), ABOUT_ZERO)
def test_an_amplitude_about_zero_is_warned_of_at_its_line(tmp_path, line, what):
    file = written(tmp_path, f"joint_offset: {{joint: joint1, offset: {{normal: 0.01 deg}}}}\n{line}")
    (finding,) = (finding for finding in read(file).findings if finding.code == "W_AMPLITUDE")
    assert finding.severity == "warning"
    assert finding.message.startswith(f"{what} varies about zero")
    assert file.read_text(encoding="utf-8").splitlines()[(finding.line or 0) - 1].strip().startswith(f"- {line[:12]}")


@pytest.mark.parametrize(
    "line",
    [
        "transmission: {joint: joint2, amplitude: {normal: 30 arcsec, mean: 31 arcsec}, order: 200}",
        "transmission: {joint: joint2, amplitude: 30 arcsec, order: 200}",
        "transmission: {joint: joint2, amplitude: {fixed: 0 arcsec}, order: 200}",
        "encoder: {joint: joint2, offset: {normal: 30 arcsec}, resolution: 10 arcsec}",
    ],
)
def test_others_are_not_warned_of(tmp_path, line):
    assert "W_AMPLITUDE" not in [finding.code for finding in read(written(tmp_path, line)).findings]


@pytest.mark.slow
def test_no_example_and_no_shipped_sheet_has_an_amplitude_about_zero():
    lines = [line for page in DOCS.glob("*.md") for line in page.read_text(encoding="utf-8").splitlines()]
    examples = [line for line in lines if re.match(r"\s+- (transmission|encoder): \{", line)]
    settings = [
        found for line in examples for found in re.findall(r"(?:amplitude|eccentricity): (\{.*?\}|[^,}]+)", line)
    ]
    assert len(settings) >= 3
    assert all("mean:" in setting for setting in settings if setting.startswith("{"))
    for name in ("4dof", "panda", "ur5", "xarm7"):
        found = [finding.code for finding in read(PAPER_SHEET.with_name(f"{name}.errors.yaml")).findings]
        assert not {"W_AMPLITUDE", "W_FEW_SAMPLES"} & set(found)


# --- the sign of an encoder's errors ---


def error_of(slides: bool, q: float, **settings) -> float:
    """Return the joint's error by the source, of a phase of 0.9 rad."""
    chain = one_link("prismatic" if slides else "revolute")
    phase = {"encoder[hinge].phase.x": np.cos(0.9), "encoder[hinge].phase.y": np.sin(0.9)}
    periodic = {"amplitude", "eccentricity"} & set(settings)
    _, totals = evaluated(chain, [q], [Encoder(joint="hinge", **settings)], phase if periodic else None)
    return float(totals[JointValue(0)][0])


@pytest.mark.parametrize(
    ("slides", "settings", "reading"),
    [
        # the zero mark sits at +o of the joint's scale: the reading is too small by o
        (False, {"offset": 1e-3}, lambda q: q - 1e-3),
        (True, {"offset": -2e-3}, lambda d: d + 2e-3),
        # a scale that is too long by a thousandth has passed fewer marks than millimetres
        (True, {"scale": 1e-3}, lambda d: d / 1.001),
        # what the disc's or the grating's error adds to the joint it takes from the reading
        (False, {"eccentricity": 5e-6, "radius": 0.02}, lambda q: q - 2.5e-4 * np.sin(q + 0.9)),
        (False, {"amplitude": 1e-4, "order": 3, "ratio": 5}, lambda q: q - 1e-4 / 5 * np.sin(15 * q + 0.9)),
        (
            True,
            {"amplitude": 1e-7, "period": 2e-2},
            lambda d: d - 1e-7 * np.sin(2 * np.pi * d / 2e-2 + 0.9),
        ),
    ],
    ids=["zero", "zero of a slide", "scale", "eccentricity", "order and ratio", "grating"],
)
def test_a_controller_that_holds_the_reading_puts_the_joint_where_the_source_does(slides, settings, reading):
    """The joint stands where the reading is what was asked for, solved for by bisection."""
    for asked in (0.3, -0.7):
        true = brentq(lambda q, asked=asked: reading(q) - asked, asked - 0.1, asked + 0.1, xtol=1e-15, rtol=1e-14)
        size = abs(true - asked)
        # first order in the error: what it changes over its own length is left out
        assert error_of(slides, asked, **settings) == pytest.approx(true - asked, rel=1e-2, abs=1e-6 * size + 1e-14)


def test_a_reading_in_steps_is_off_by_up_to_half_a_step():
    """Half a step is the half-width of what is drawn: the true angles at which one step is read."""
    step = 1e-3
    angles = np.linspace(0.2995, 0.3005, 100_001)
    held = angles[np.round(angles / step) * step == np.round(0.3 / step) * step]
    law = ErrorModel(one_link(), Space(), [Encoder(joint="hinge", resolution=step)]).space.draws[0].law
    assert law.support([1.0]) == pytest.approx(held.max() - 0.3, abs=1e-8)
    assert -law.support([-1.0]) == pytest.approx(held.min() - 0.3, abs=1e-8)
