"""Datums of a sheet: the same as built in Python, and one clear line for what is wrong."""

import numpy as np
import pytest

from precision_pin import ErrorModel, InputError
from precision_pin.base import se3
from precision_pin.robot.datums import Datum
from precision_pin.sampling.verdict_grounds import exact_findings_at

SHEET = """\
precision-pin: 1
robot: 4dof.urdf
tip: tool
gravity: none
poses: {a: -85 5 80 -85 deg, b: -60 0 80 -80 deg, c: -120 10 70 -90 deg, d: -90 -30 90 -60 deg, a2: -85 5 80 -85 deg}
sources:
  - joint_offset: {joint: joint2, offset: {normal: {std: 0.1 mrad}}}
  - joint_offset: {joint: joint3, offset: {normal: {std: 0.1 mrad}, scope: visit}}
"""
CAMERA = (
    "camera: {xyz: 10 0 40 mm, rpy: 3 -2 90 deg}, board: {xyz: 100 20 0 mm}, on: link4, poses: [a, b, c, d], "
    "grasp: {rpy: 170 5 30 deg}"
)
NOISE = "noise: {translation: 0.05 mm, rotation: 0.25 mrad}"
PLACES = {
    "camera": se3.pose(se3.rpy_rotation(np.radians([3, -2, 90])), np.array([0.01, 0, 0.04])),
    "board": se3.pose(np.eye(3), np.array([0.1, 0.02, 0])),
    "grasp": se3.pose(se3.rpy_rotation(np.radians([170, 5, 30])), np.zeros(3)),
    "on": "link4",
}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{best_fit: {poses: [a, b, c], std: 0.02 mm}}", Datum.best_fit(["a", "b", "c"], 2e-5)),
        ("{best_fit: {poses: [a, b, c], point: 50 0 -30 mm}}", Datum.best_fit(["a", "b", "c"], point=[0.05, 0, -0.03])),
        ("{taught: {pose: b, touch: {std: 0.05 mm, attitude: 0.2 mrad}}}", Datum.taught("b", 5e-5)),
        ("{three_points: {origin: a, x: b, xy: c, touch: 0.05 mm}}", Datum.three_points("a", "b", "c", 5e-5)),
        (f"{{eye_to_hand: {{{CAMERA}, {NOISE}}}}}", Datum.eye_to_hand(list("abcd"), noise=(5e-5, 2.5e-4), **PLACES)),
        (
            f"{{hand_eye: {{{CAMERA}, {NOISE}, view: {{d: a, c: b}}, weights: {{translation: 1 mm, rotation: 1 mrad}}}}}}",
            Datum.hand_eye(list("abcd"), "a", noise=(5e-5, 2.5e-4), weights=(1e-3, 1e-3), **PLACES),
        ),
    ],
)
def test_a_sheet_and_python_agree(write, text: str, expected: Datum) -> None:
    model = ErrorModel.load(write(f"{SHEET}datums: {{f: {text}}}\ndatum: f\n"))
    other = model.against(expected)
    assert [datum.name for datum in model.datums] == ["f"]
    np.testing.assert_allclose(model.at("d").covariance, other.at("d").covariance, rtol=1e-12, atol=1e-25)
    # base axes
    assert model.sheet.against("none").datum == ()
    assert not model.against().datums
    # a change of the sheet, also of the datum
    wider = model.with_({"joint_offset[joint2].offset": {"normal": {"std": "0.2 mrad"}}})
    assert wider.datums
    assert not np.allclose(wider.at("d").covariance, model.at("d").covariance, rtol=1e-3)


WRONG = {
    "f: {taught: {pose: z}}": "no pose named 'z'",
    "f: {tought: {pose: a}}": "unknown key 'tought': did you mean 'taught'",
    "f: {taught: {pose: a, toch: 1 mm}}": "unknown key 'toch': did you mean 'touch'",
    "f: {}": "a datum is one of best_fit, taught, three_points, tool_pivot, hand_eye, eye_to_hand",
    "f: {taught: {pose: a}, best_fit: {random: 4}}": "a datum is one of",
    "none: {taught: {pose: a}}": "'none' is not a name of a datum",
    "'a,b': {taught: {pose: a}}": "'a,b' is not a name of a datum; give a word without commas",
    "f: {taught: {pose: a, touch: -1 mm}}": "touch must be zero or more, got -1 mm",
    "f: {taught: {pose: a, touch: {std: 1 mm, attitude: -1 mrad}}}": "attitude must be zero or more, got -1 mrad",
    "f: {taught: {pose: a, touch: 1 mrad}}": "'mrad' in '1 mrad' is not a unit of length",
    "f: {three_points: {origin: a, x: b, xy: a2}}": "datum f: the points of a three_points lie on a line",
    "f: {best_fit: {poses: [a, a, a2]}}": "datum f: the points of a best_fit lie on a line",
    "f: {best_fit: {poses: [a, b]}}": "2 poses for a datum; give at least 3",
    "f: {best_fit: {poses: [a, b, c], random: 4}}": "a best_fit needs poses: .*, or random: 30",
    "f: {best_fit: {poses: [a, b, c], point: 50 0 mm}}": "'50 0 mm' has 2 numbers, expected 3",
    "f: {best_fit: {random: 2.5}}": "a whole number of poses from 3 on, got 2.5",
    "f: {tool_pivot: {poses: [a, b, c]}}": "datum f: the tip must be at one point in all poses of a tool_pivot",
    "f: {tool_pivot: {poses: [a, a2, a]}}": "datum f: the attitudes of a tool_pivot need at least two axes",
    f"f: {{eye_to_hand: {{{CAMERA}}}}}": "give the weights of the solver",
    f"f: {{eye_to_hand: {{{CAMERA}, {NOISE}, weights: {{translation: 1 mm}}}}}}": "give the weights of the solver",
    f"f: {{hand_eye: {{{CAMERA}, {NOISE}}}}}": "the key 'view' is missing",
    f"f: {{hand_eye: {{{CAMERA}, {NOISE}, view: z}}}}": "no pose named 'z'",
    f"f: {{eye_to_hand: {{{CAMERA.replace('link4', 'lnk4')}, {NOISE}}}}}": "no link named 'lnk4'; did you mean 'link4'",
    f"f: {{eye_to_hand: {{{CAMERA.replace('b, c, d', 'a, a2')}, {NOISE}}}}}": "do not determine the camera",
}


def test_wrong_datums_are_one_line_each(write) -> None:
    for text, message in WRONG.items():
        path = write(f"{SHEET}datums: {{{text}}}\n")
        with pytest.raises(InputError, match=message) as caught:
            ErrorModel.load(path)
        (finding,) = caught.value.findings
        assert finding.line == 9, text


def test_wrong_choices_of_datums(write) -> None:
    known = f"{SHEET}datums: {{f: {{taught: {{pose: a}}}}, c: {{eye_to_hand: {{{CAMERA}, {NOISE}}}}}}}\n"
    for text, message in (
        ("[x]", "no datum named 'x'; valid: c, compensated, f, none"),
        ("[c, none]", "'none' is for base axes and stands alone, got c, none"),
        ("[f, f]", "two datums have the same name, got 'f', 'f'"),
        ("[c, f]", "datum c: a camera sees one workpiece; give it as the last datum"),
    ):
        with pytest.raises(InputError, match=message) as caught:
            ErrorModel.load(write(f"{known}datum: {text}\n"))
        assert [finding.line for finding in caught.value.findings] == [10]
    model = ErrorModel.load(write(f"{known}datum: [f, c]\n"))
    assert [datum.name for datum in model.datums] == ["f", "c"]
    with pytest.raises(InputError, match="no datum named 'g'"):
        model.against("g")
    with pytest.raises(InputError, match="no datum named 'g'"):
        model.sheet.against("f,g")


@pytest.mark.parametrize("named", ["datum: f", ""], ids=["f", "base axes"])
@pytest.mark.parametrize("chosen", ["none", "g", "f,g"])
def test_a_datum_of_the_command_line_takes_nothing_as_exact(write, named: str, chosen: str) -> None:
    procedures = "datums: {f: {taught: {pose: b, touch: 0.05 mm}}, g: {taught: {pose: c, touch: 0.05 mm}}}"
    sheet = ErrorModel.load(write(f"{SHEET}{procedures}\n{named}\n")).sheet

    def model(**changes: object) -> ErrorModel:
        """Return the model as a command makes it: --set changes the sheet before --datum chooses."""
        changed = sheet.with_changes({f"joint_offset[{joint}].offset": law for joint, law in changes.items()})
        return ErrorModel.from_sheet(changed.against(chosen))

    wider = model(joint2={"normal": {"std": "0.2 mrad"}})
    assert exact_findings_at(wider, wider.at("d")) == ()
    # the part of the variance in the datum chosen; the draws of joint3, of scope visit, are made at the visits too
    before, without = model(), model(joint3={"fixed": "0 rad"})
    (finding,) = exact_findings_at(without, without.at("d"))
    left, whole = (np.trace(one.at("d").covariance[:3, :3]) for one in (without, before))
    assert finding.message.startswith(
        f"joint_offset[joint3] is taken as exact by a change of the sheet; with this went {100 * (1 - left / whole):.3g} % "
    )


def test_the_poses_of_a_grid_are_read(write, folder) -> None:
    grid = folder / "grid.yaml"
    text = f"{SHEET}datums: {{f: {{best_fit: {{poses: grid.yaml, std: 0.02 mm}}}}}}\ndatum: f\n"
    joints = "joints: {joint1: 0 40 deg, joint2: 5 deg, joint3: 40 80 deg, joint4: -60 deg}\n"
    grid.write_text(joints)
    model = ErrorModel.load(write(text))
    visits = np.radians([[first, 5, third, -60] for first in (0, 40) for third in (40, 80)])
    expected = model.against(Datum.best_fit(list(visits), 2e-5))
    np.testing.assert_allclose(model.at("d").covariance, expected.at("d").covariance, rtol=1e-12, atol=1e-25)
    # of places, by inverse kinematics: the nominal tips are those of the grid
    grid.write_text(
        "plane: {origin: 700 0 300 mm, u: {direction: 1 0 0, values: 0 100 mm}, v: {direction: 0 1 0, "
        "values: 0 100 mm}}\norientations: any\n"
    )
    (datum,) = ErrorModel.load(write(text)).datums
    tips = [1e3 * model.chain.at(visit).pose[:3, 3] for visit in datum.visits]
    corners = [[700, 0, 300], [700, 100, 300], [800, 0, 300], [800, 100, 300]]
    np.testing.assert_allclose(sorted(map(tuple, np.round(tips, 6))), corners, atol=1e-6)
    wrong = {
        joints.replace("5 deg", "5 mm"): "'mm'",
        "plane: {origin: 700 0 300 mm, u: {direction: 1 0 0, values: 0 1 9 m}, v: {direction: 0 1 0, values: 0 "
        "100 mm}}\norientations: any\n": "grid.yaml: 4 reached, 2 unreachable; a datum needs each of its poses",
        "random: {count: 1001}\n": "grid.yaml has 1,001 poses; at most 1,000 find a datum",
        joints.replace("0 40", " ".join(map(str, range(501)))): "grid.yaml has 1,002 poses; at most 1,000",
    }
    for content, message in wrong.items():
        grid.write_text(content)
        with pytest.raises(InputError, match=message) as caught:
            ErrorModel.load(write(text))
        assert len(caught.value.findings) == 1
    grid.unlink()
    with pytest.raises(InputError, match=r"grid\.yaml: error E_GRID: the file does not exist"):
        ErrorModel.load(write(text))
