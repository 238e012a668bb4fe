"""Quantities in Python: every argument that is one takes text with a unit, and none is forgotten."""

import inspect
import tempfile
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import precision_pin as pp
from precision_pin.robot.chain import Chain
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.statistics import Specification

MODEL = pp.ErrorModel.load(PAPER_SHEET)
CHAIN = MODEL.chain
DRAWN = pp.monte_carlo(MODEL, samples=1_000)
DEGREES = np.pi / 180
"""rad in a degree."""


def measured(name, **more):
    return lambda given: np.ravel(getattr(pp.Measurement(**{name: given}, **more), name))


def at_angles(first):
    return {name: first if name == CHAIN.joint_names[0] else 0.0 for name in CHAIN.joint_names}


def exported(first):
    with tempfile.TemporaryDirectory() as folder:
        pp.export(MODEL, folder, at_angles(first))
        row = (Path(folder) / "units.csv").read_text("utf-8").splitlines()[1]
    return np.array([float(cell) for cell in row.split(",")[2:8]])


CASES = {
    "Measurement.std": (measured("std"), "20 um", 20e-6, "3 mrad"),
    "Measurement.target": (measured("target"), "0 5 100 mm", (0.0, 0.005, 0.1), "0 0 3 deg"),
    "Measurement.attitude_std": (measured("attitude_std", kind="pose"), "10 arcsec", DEGREES / 360, "3 mm"),
    "Measurement.anchor": (measured("anchor", kind="distance"), ["1 m", "20 cm", 0], (1.0, 0.2, 0.0), "0 0 3 deg"),
    "Measurement.plane": (
        lambda given: pp.Measurement("plane", plane=(given, (0, 0, 1))).plane[0], "0 0 20 mm", (0, 0, 0.02), "0 0 3 kg"
    ),
    "Measurement.sockets": (
        lambda given: np.ravel(pp.Measurement("socket", sockets=[given, (1, 1, 1)]).sockets[0]),
        "400 0 20 mm", (0.4, 0, 0.02), "0 0 3 kg",
    ),
    "Measurement.visible_from": (measured("visible_from", facing=(0, 0, 1)), "3 0 1 m", (3, 0, 1), "0 0 3 kg"),
    "Measurement.stands_at": (
        measured("stands_at", std={"along": "1 um", "across": "2 um"}), "3 0 1 m", (3, 0, 1), "0 0 3 kg"
    ),
    "Measurement.cone": (measured("cone", visible_from=(1, 0, 0)), "40 deg", np.pi / 4.5, "3 mm"),
    "export.pose": (exported, "30 deg", 30 * DEGREES, "3 mm"),
    "iso9283.target": (
        lambda given: pp.iso9283(MODEL, [[0.1, 0.2, 0.3, 0.4]], robots=20, cycles=3, target=given).target,
        "0 0 100 mm", (0, 0, 0.1), "0 0 3 deg",
    ),
    "iso9283.load": (
        lambda given: pp.iso9283(MODEL, [[0.1, 0.2, 0.3, 0.4]], robots=20, cycles=3, load=given).mass,
        "500 g", 0.5, "3 mm",
    ),
    "sample_approaches.target": (
        lambda given: pp.sample_approaches(
            MODEL, [0.1, 0.2, 0.3, 0.4], approaches=["joint1 +", "joint1 -"], robots=2, cycles=2, target=given
        ).errors,
        "0 0 100 mm", (0, 0, 0.1), "0 0 3 deg",
    ),
    "stiffness.rated": (
        lambda given: pp.stiffness(MODEL, [0.1, 0.2, 0.3, 0.4], robots=2, rated=given).rated, "2 kN", 2000.0, "3 kg"
    ),
    "stiffness.goal": (
        lambda given: pp.stiffness(MODEL, [0.1, 0.2, 0.3, 0.4], robots=2, goal=given).goal, "1 um/N", 1e-6, "3 mm"
    ),
    "box_places.x": (lambda given: pp.box_places(given, 0, 0), "400 500 mm", (0.4, 0.5), "3 deg"),
    "box_places.y": (lambda given: pp.box_places(0, given, 0), "40 cm", 0.4, "3 deg"),
    "box_places.z": (lambda given: pp.box_places(0, 0, given), ["40 cm", 0], (0.4, 0), "3 deg"),
    "plane_places.origin": (
        lambda given: pp.plane_places(given, (1, 0, 0), (0, 1, 0), 0, 0), "1 2 3 cm", (0.01, 0.02, 0.03), "1 2 3 rad"
    ),
    "plane_places.along_u": (
        lambda given: pp.plane_places((0, 0, 0), (1, 0, 0), (0, 1, 0), given, 0), "1 2 cm", (0.01, 0.02), "3 rad"
    ),
    "plane_places.along_v": (
        lambda given: pp.plane_places((0, 0, 0), (1, 0, 0), (0, 1, 0), 0, given), "1 2 cm", (0.01, 0.02), "3 rad"
    ),
    "place_grid.places": (
        lambda given: pp.place_grid(CHAIN, given, pp.Orientation.free()).q, "600 0 200 mm", (0.6, 0, 0.2), "1 2 3 rad"
    ),
    "random_poses.box": (
        lambda given: pp.random_poses(CHAIN, 2, box=given, orientations=pp.Orientation.free()).q,
        ["40 60 cm", "-10 10 cm", "0 20 cm"], ((0.4, 0.6), (-0.1, 0.1), (0, 0.2)), "1 2 rad",
    ),
    "joint_grid.values": (
        lambda given: pp.joint_grid(CHAIN, at_angles(given)).q, "0 30 60 deg", (0, np.pi / 6, np.pi / 3), "3 mm"
    ),
    "configuration": (lambda given: CHAIN.configuration(at_angles(given)), "30 deg", np.pi / 6, "3 mm"),
    "configurations of many": (
        lambda given: CHAIN.configurations.many(at_angles(given)), "0 30 deg", (0, np.pi / 6), "3 mm"
    ),
    "Chain.with_payload.mass": (lambda given: _weights(CHAIN.with_payload(given)), "500 g", 0.5, "3 mm"),
    "Chain.with_payload.centre": (
        lambda given: _weights(CHAIN.with_payload(1.0, given)), "0 0 50 mm", (0, 0, 0.05), "0 0 3 kg"
    ),
    "Chain.from_urdf.gravity": (
        lambda given: Chain.from_urdf(CHAIN.robot.file, "tool", gravity=given).gravity,
        "0 0 -9810 mm/s^2", (0, 0, -9.81), "0 0 3 kg",
    ),
    "Specification.limit": (lambda given: Specification("rx", given, 0.9).limit, "0.1 deg", DEGREES / 10, "3 mm"),
    "Distribution.cdf": (DRAWN.position.norm.cdf, "3 mm", 3e-3, "3 mrad"),
    "Distribution.cumulative": (DRAWN.attitude.norm.cumulative, "1 3 mrad", (1e-3, 3e-3), "3 mm"),
    "Distribution.probability_inside": (DRAWN.position.x.probability_inside, "2 mm", 2e-3, "3 mrad"),
}  # fmt: skip
"""Of each argument that is a quantity: what is made of it, text, the same in SI, and text of another unit."""

NOT_QUANTITIES = {
    # shares, numbers of standard deviations, times of computing
    "budget.confidence", "budget.k", "compare.confidence", "exact_law.confidence", "iso9283.confidence",
    "map_poses.confidence", "moments.confidence", "monte_carlo.confidence", "path_law.probability", "path_law.confidence",
    "population.confidence", "relative.confidence", "reliability.confidence", "sample_poses.confidence",
    "worst_case.k", "worst_case.confidence", "allocate.seconds", "progress.delay", "compensate.weights",
    "stiffness.confidence",
    # directions and matrices
    "inverse_kinematics.wanted", "inverse_kinematics.tool_axis", "plane_places.u", "plane_places.v", "Measurement.facing",
    "stiffness.axes",
    "Orientation.rotations", "Orientation.tool_axis", "Correlation.matrix", "Term.twist",
    # arrays of measured or computed numbers
    "iso9283_distance.commanded_pair", "iso9283_distance.attained_pair", "iso9283_of.commanded", "iso9283_of.attained",
    # poses: names, arrays, or values by joint as "configuration" takes them
    "ErrorModel.poses", "iso9283.poses", "monte_carlo.q", "pose_covariance.poses",
    "sample_approaches.pose", "sample_poses.poses", "inverse_kinematics.reference", "place_grid.reference",
}  # fmt: skip

UNITLESS = {
    # laws do not know what they are laws of; a sheet does
    "Arcsine", "Circle", "Disc", "Empirical", "Fixed", "JointNormal", "Lognormal", "Normal", "Rows", "Sphere",
    "Triangular", "TruncatedNormal", "TwoPoint", "Uniform",
    # made by the package
    "MonteCarloResult", "PosesResult", "Chain", "Posture", "Postures",
}  # fmt: skip


def _weights(chain):
    """Return what gravity does to each joint, which a payload changes."""
    return np.concatenate([np.ravel(moment) for moment, _ in chain.loads[-1].moments])


def test_none_is_forgotten():
    """Every number among the arguments of the public names is a quantity of the table, or said to be none."""
    found = set()
    for name in set(pp.__all__) - UNITLESS:
        made = getattr(pp, name)
        if callable(made) and not (isinstance(made, type) and issubclass(made, Exception)):
            found |= {
                f"{name}.{entry.name}"
                for entry in inspect.signature(made).parameters.values()
                if any(word in str(entry.annotation) for word in ("float", "ArrayLike", "Array"))
            }
    assert found - set(CASES) - NOT_QUANTITIES == set()
    assert {name for name in NOT_QUANTITIES if name not in found} == set()


@pytest.mark.fast(10)
@pytest.mark.filterwarnings("ignore:.*W_NO_VISITS")
@pytest.mark.parametrize("name", CASES)
def test_text_is_the_same_as_the_number_and_another_unit_is_refused(name):
    make, text, si, wrong = CASES[name]
    assert_allclose(make(text), make(si), rtol=1e-12, atol=1e-15)
    with pytest.raises(pp.InputError) as caught:
        make(wrong)
    (finding,) = caught.value.findings
    assert finding.code == "E_UNIT"
    assert "is not a unit of" in finding.message
    assert "a plain number is in" in finding.message
    # what a message calls an argument where it is not by its name
    said = dict.fromkeys(("values", "configuration", "configurations of many"), "joint1:")
    said |= {"pose": "joint1:", "along_u": "of u:", "along_v": "of v:"}
    said |= {"cdf": "value:", "cumulative": "values:", "probability_inside": "limit:"}
    last = name.rpartition(".")[2]
    assert said.get(last, last) in finding.message


def test_a_number_without_unit_in_text_is_refused():
    said = "std, the standard deviation of a measurement: '20' has no unit; a length"
    with pytest.raises(pp.InputError, match=said):
        pp.Measurement(std="20")
