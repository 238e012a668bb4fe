"""Data as they come: kinds mixed, several targets in a row, bare headers, missing and copied readings, degrees and radians."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import precision_pin as pp
from analyses.calibration.arms import paper_model, random_poses
from precision_pin.analyses.calibration.calibrate import CalibrationResult
from precision_pin.analyses.calibration.data import read_data
from precision_pin.analyses.calibration.fit import Problem
from precision_pin.base.errors import InputError
from precision_pin.sources import JointOffset

CHAIN = paper_model().chain
JOINTS = CHAIN.joint_names
SPREAD = 1e-3
TARGETS = np.array([[0.05, 0.03, 0.02], [-0.04, 0.06, 0.03], [0.02, -0.07, 0.05]])
TRUTH = SPREAD * np.array([0.6, -1.1, 0.4, 1.3])
Q = random_poses(4, 12)


def model(spread: float = SPREAD, *visit: float) -> pp.ErrorModel:
    sources: list[pp.Source] = [JointOffset(joint=name, offset=pp.Normal(spread)) for name in JOINTS]
    sources += [JointOffset(joint="joint2", offset=pp.Draw("", pp.Normal(std), pp.Scope.VISIT)) for std in visit]
    return pp.ErrorModel(CHAIN, pp.Space(), sources)


def points(q: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return the places of a target, ``(P, 3)``."""
    pose = CHAIN.at_columns(np.ascontiguousarray(q)).pose
    return (pose[:3, 3] + np.einsum("ijp,j->ip", pose[:3, :3], target)).T


def measured(std: float = 20e-6, seed: int = 1) -> list[np.ndarray]:
    """Return the readings of each target by an arm whose joints are off by ``TRUTH``."""
    noise = np.random.default_rng(seed).normal(0, std, (3, Q.shape[1], 3))
    return [points(Q + TRUTH[:, None], target) + own for target, own in zip(TARGETS, noise, strict=True)]


def write(path: Path, columns: dict[str, object], units: str = "deg m") -> str:
    """Write joint values and readings; joint values in degrees, and units in the header, unless asked otherwise."""
    angle, _, length = units.partition(" ")
    scale = np.degrees(1) if angle == "deg" else 1.0
    whole = {f"{name} [{angle}]" if length else name: scale * q for name, q in zip(JOINTS, Q, strict=True)}
    whole |= {f"{name} [{length}]" if length else name: values for name, values in columns.items()}
    rows = [
        ",".join(value if isinstance(value, str) else repr(float(value)) for value in row)
        for row in zip(*whole.values(), strict=True)
    ]
    path.write_text("\n".join([",".join(whole), *rows]))
    return str(path)


def xyz(number: object, values: np.ndarray) -> dict[str, object]:
    return {f"{axis}{number}": column for axis, column in zip("xyz", values.T, strict=True)}


def same(one: CalibrationResult, other: CalibrationResult) -> bool:
    return one.posterior.mean == other.posterior.mean and np.array_equal(
        one.posterior.covariance, other.posterior.covariance
    )


def of_targets(*numbers: int, **more: object) -> list[pp.Measurement]:
    return [
        pp.Measurement(std=20e-6, target=TARGETS[k - 1], target_name=str(k), **more)  # type: ignore[arg-type]
        for k in numbers
    ]


@pytest.mark.slow
def test_kinds_mixed_are_one_least_squares_problem(tmp_path: Path) -> None:
    """Against Gauss-Newton steps in plain numpy, with the kinematics of the arm and differences for derivatives."""
    anchor, height, stds = np.array([0.4, 0.1, -0.2]), -0.3, (30e-6, 50e-6, 80e-6)
    guess, offset = TARGETS[0], np.array([1e-3, -2e-3, 0.5e-3])
    base, origin = Rotation.from_rotvec([0.3, -1.2, 0.8]), np.array([2.0, -1.0, 0.5])

    def predicted(n: np.ndarray) -> np.ndarray:
        """Joint offsets, target, shift and turn of the base."""
        y = points(Q + n[:4, None], guess + n[4:7])
        seen = (Rotation.from_rotvec(n[10:13]) * base).apply(y) + origin + n[7:10]
        return np.concatenate([seen.ravel(), np.linalg.norm(y - anchor, axis=1), y[:, 2] - height])

    std = np.repeat(stds, [36, 12, 12])
    truth = np.concatenate([TRUTH, offset, [1e-3, 2e-3, -1e-3, 2e-3, -1e-3, 3e-3]])
    y = predicted(truth) + std * np.random.default_rng(5).standard_normal(60)
    x, prior = np.zeros(13), np.diag([1 / SPREAD] * 4 + [0.0] * 9)[:4]
    for _ in range(12):
        steps = 1e-3 * np.eye(13)
        slopes = (
            np.array(
                [
                    (8 * predicted(x + one) - 8 * predicted(x - one) - predicted(x + 2 * one) + predicted(x - 2 * one))
                    / 12e-3
                    for one in steps
                ]
            ).T
            / std[:, None]
        )
        rows = np.vstack([slopes, prior])
        residuals = np.concatenate([(y - predicted(x)) / std, -prior @ x])
        x = x + np.linalg.lstsq(rows, residuals, rcond=None)[0]

    parts = [
        pp.Measurement("position", std=stds[0], target=guess, target_known=False, base="free"),
        pp.Measurement("distance", std=stds[1], target=guess, target_known=False, anchor=anchor),
        pp.Measurement("plane", std=stds[2], target=guess, target_known=False, plane=((0, 0, height), (0, 0, 1))),
    ]
    position, distance, plane = y[:36].reshape(-1, 3), y[36:48], y[48:]
    found = pp.calibrate(model(), [(Q, position), (Q, distance), (Q, plane)], parts)
    np.testing.assert_allclose(
        np.array(list(found.posterior.mean.values())) / SPREAD, x[:4] / SPREAD, rtol=0, atol=1e-9
    )
    np.testing.assert_allclose(found.set_up.target, guess + x[4:7], atol=1e-11)
    assert found.chi_square == pytest.approx(residuals @ residuals, rel=1e-9)
    assert found.degrees_of_freedom == 60 - 9
    covariance = np.linalg.inv(rows.T @ rows)[:4, :4]
    np.testing.assert_allclose(found.posterior.covariance, covariance, rtol=1e-6, atol=1e-6 * covariance.max())
    assert [len(one.std) for one in found.set_ups] == [9, 3, 3]

    # the same from one file, in which each row is of one kind
    gaps = [np.array(["", "nan", "NA"])[np.arange(12) % 3]] * 2
    stacked = xyz("", position) | {"distance": distance, "height": plane}
    whole = {
        name: np.concatenate([values if k == kind else gaps[0] for k in range(3)]).tolist()
        for kind, names in enumerate((("x", "y", "z"), ("distance",), ("height",)))
        for name in names
        for values in (stacked[name],)
    }
    lines = [",".join([*(f"{name} [rad]" for name in JOINTS), *(f"{name} [m]" for name in whole)])]
    for row in range(36):
        lines.append(
            ",".join([*(repr(float(value)) for value in Q[:, row % 12]), *(str(one[row]) for one in whole.values())])
        )
    path = tmp_path / "mixed.csv"
    path.write_text("\n".join(lines))
    again = pp.calibrate(model(), str(path), parts)
    np.testing.assert_allclose(again.posterior.covariance, found.posterior.covariance, rtol=1e-12)
    np.testing.assert_allclose(list(again.posterior.mean.values()), list(found.posterior.mean.values()), atol=1e-14)
    assert sum("missing in 24 of 36 rows" in one.message for one in again.findings) == 3
    stored = json.loads(found.to_json())
    assert stored["rms_residual"] == found.rms_residual
    assert [one["kind"] for one in stored["measurements"]] == ["position", "distance", "plane"]


@pytest.mark.slow
def test_targets_of_a_row_add_up_and_share_what_changes_between_visits(tmp_path: Path) -> None:
    spread, read = 1e-6, measured()
    arm = model(spread)
    parts = of_targets(1, 2)
    path = write(tmp_path / "two.csv", xyz(1, read[0]) | xyz("_2", read[1]))
    found = pp.calibrate(model(), path, parts)
    assert len(found.data) == 24
    assert abs(np.array(list(found.posterior.mean.values())) - TRUTH).max() < 5 * max(found.posterior.std.values())
    # narrow laws, so that the arm is linear: precisions add up, but for the prior, which each has
    near = [points(Q, target) + np.random.default_rng(k).normal(0, 20e-6, (12, 3)) for k, target in enumerate(TARGETS)]
    path = write(tmp_path / "near.csv", xyz(1, near[0]) | xyz(2, near[1]))
    both = pp.calibrate(arm, path, parts)
    alone = [pp.calibrate(arm, (Q, values), part) for values, part in zip(near, parts, strict=False)]
    inverses = [np.linalg.inv(one.posterior.covariance) for one in alone]
    precision = sum(inverses) - np.eye(4) / spread**2
    np.testing.assert_allclose(
        np.linalg.inv(both.posterior.covariance), precision, rtol=1e-6, atol=1e-6 * precision.max()
    )
    means = [np.array(list(one.posterior.mean.values())) for one in alone]
    expected = np.linalg.solve(precision, sum(a @ m for a, m in zip(inverses, means, strict=True)))
    np.testing.assert_allclose(list(both.posterior.mean.values()), expected, atol=1e-6 * spread)

    # repeatability of joint2 moves both targets of a row together, by hand
    wobbly = model(SPREAD, 3e-5)
    problem, _ = Problem.of(wobbly, read_data(wobbly, path, tuple(parts)))
    step = np.array([0, 1e-6, 0, 0])[:, None]
    moved = np.hstack([(points(Q[:, :1] + step, one) - points(Q[:, :1] - step, one))[0] / 2e-6 for one in TARGETS[:2]])
    noise = np.eye(6) * 20e-6**2 + 3e-5**2 * np.outer(moved, moved)
    np.testing.assert_allclose(problem.roots[0] @ problem.roots[0].T, noise, rtol=1e-6, atol=1e-16)


@pytest.mark.slow
def test_unknown_targets_are_found(tmp_path: Path) -> None:
    path = write(
        tmp_path / "three.csv",
        {key: value for k, values in enumerate(measured(), 1) for key, value in xyz(k, values).items()},
    )
    found = pp.calibrate(model(), path, pp.Measurement(std=20e-6, target_known=False, base="free"))
    assert abs(np.array([one.target for one in found.set_ups]) - TARGETS).max() < 3e-4
    assert found.identifiability.nuisances[-1] == "target[3].z"
    assert len({one.reading for one in found.gross_errors}) == 0
    with pytest.raises(InputError, match=r"targets 1, 2, 3 and one known target"):
        pp.calibrate(model(), path, pp.Measurement())
    with pytest.raises(InputError, match=r"share target and say different things"):
        pp.calibrate(model(), [(Q, np.ones((12, 3)))] * 2, [pp.Measurement(), pp.Measurement(target_known=False)])


@pytest.mark.slow
def test_missing_readings_are_those_of_a_file_without_them(tmp_path: Path) -> None:
    one, two, _ = measured()
    columns = {name: [repr(float(value)) for value in values] for name, values in (xyz(1, one) | xyz(2, two)).items()}
    columns["y2"][4], columns["x1"][7], columns["x2"][7] = "", "NaN", "n/a"
    found = pp.calibrate(model(), write(tmp_path / "gaps.csv", columns), of_targets(1, 2))
    kept = [np.delete(np.arange(12), 7), np.delete(np.arange(12), [4, 7])]
    whole = pp.calibrate(
        model(), [(Q[:, own], values[own]) for own, values in zip(kept, (one, two), strict=True)], of_targets(1, 2)
    )
    np.testing.assert_allclose(list(found.posterior.mean.values()), list(whole.posterior.mean.values()), atol=1e-15)
    assert found.chi_square == pytest.approx(whole.chi_square, rel=1e-9)
    said = [finding.message for finding in found.findings if finding.code == "W_MISSING_READING"]
    assert said == [
        f"x{k} or y{k} or z{k} is missing in {count} of 12 rows, which are left out" for k, count in ((1, 1), (2, 2))
    ]
    gaps = one.copy()
    gaps[3, 1] = np.nan
    arrays = pp.calibrate(model(), (Q, gaps), of_targets(1)[0])
    assert same(arrays, pp.calibrate(model(), (np.delete(Q, 3, axis=1), np.delete(one, 3, axis=0)), of_targets(1)[0]))
    assert arrays.data.lines == (1, 2, 3, *range(5, 13))


@pytest.mark.slow
def test_copies_are_not_counted_twice(tmp_path: Path) -> None:
    one, two, _ = measured()
    free = pp.Measurement(std=20e-6, target_known=False)
    both = pp.calibrate(model(), write(tmp_path / "a.csv", xyz(1, one) | xyz(2, two)), free)
    copied = pp.calibrate(model(), write(tmp_path / "b.csv", xyz(1, one) | xyz(2, two) | xyz(3, two)), free)
    assert same(both, copied)
    said = "x3, y3, z3 repeat x2, y2, z2 to the last digit in 12 of 12 rows; the copy is left out"
    assert said in [finding.message for finding in copied.findings]
    # where only some rows are alike, nothing says which target was read there
    mixed = two.copy()
    mixed[:5] = one[:5]
    some = pp.calibrate(model(), write(tmp_path / "c.csv", xyz(1, one) | xyz(2, mixed)), free)
    assert set(some.data.lines) == set(range(7, 14))
    assert any("5 of 12 rows" in finding.message for finding in some.findings)
    lines = Path(tmp_path / "a.csv").read_text().splitlines()
    (tmp_path / "d.csv").write_text("\n".join([*lines, lines[3], lines[4]]))
    repeated = pp.calibrate(model(), str(tmp_path / "d.csv"), free)
    assert same(both, repeated)
    assert any("2 of 14 rows repeat another to the last digit" in finding.message for finding in repeated.findings)
    # with different times they were read twice
    (tmp_path / "e.csv").write_text(
        "\n".join(f"{'t' if k == 0 else k},{line}" for k, line in enumerate([*lines, lines[3]]))
    )
    assert len(pp.calibrate(model(), str(tmp_path / "e.csv"), free).data) == 26


@pytest.mark.slow
def test_targets_of_one_computed_pose_are_not_independent(tmp_path: Path) -> None:
    exact = [points(Q + TRUTH[:, None], target) for target in TARGETS]
    shared = np.random.default_rng(0).normal(0, 20e-6, (12, 3))
    path = write(tmp_path / "rigid.csv", xyz(1, exact[0] + shared) | xyz(2, exact[1] + shared))
    found = pp.calibrate(model(), path, of_targets(1, 2))
    assert any("keep their distances" in one.message for one in found.findings if one.code == "W_NOT_INDEPENDENT")
    apart = pp.calibrate(
        model(), write(tmp_path / "apart.csv", xyz(1, measured()[0]) | xyz(2, measured()[1])), of_targets(1, 2)
    )
    assert not any(one.code == "W_NOT_INDEPENDENT" for one in apart.findings)


@pytest.mark.slow
@pytest.mark.parametrize("joints", [JOINTS, ("joint3",)])
@pytest.mark.parametrize("unit", ["deg", "rad"])
def test_a_wrong_unit_of_joint_values_is_named(tmp_path: Path, joints: tuple[str, ...], unit: str) -> None:
    """The file says degrees of values in radians, or the other way, of all joints or of one."""
    scale = np.where([name in joints for name in JOINTS], np.radians(1) if unit == "deg" else np.degrees(1), 1.0)
    free = pp.Measurement(std=1e-3, target_known=False, base="free")
    readings = measured()[0]
    with pytest.raises(
        InputError, match=rf"times better if the values of {', '.join(joints)} are .* \(a factor of 57.3\)"
    ):
        pp.calibrate(model(), (Q * scale[:, None], readings), free)
    small = Path(write(tmp_path / "u.csv", xyz("", readings), "rad m"))
    if unit == "deg" and joints == JOINTS:
        small.write_text(small.read_text().replace("[rad]", "[deg]"))
        with pytest.raises(InputError, match="are radians, not degrees"):
            pp.calibrate(model(), str(small), free)


@pytest.mark.slow
def test_bare_headers_need_units_and_take_names(tmp_path: Path) -> None:
    read, part = measured()[0], of_targets(1)[0]
    whole = pp.calibrate(model(), write(tmp_path / "whole.csv", xyz(1, read), "rad m"), part)
    bare = write(tmp_path / "bare.csv", xyz(1, read) | {"Time": ["12:30"] * 12}, "rad")
    with pytest.raises(
        InputError,
        match=r"columns x1, .*joint4 have no unit; if lengths are in m and angles are in rad add "
        r"--columns '\*=\[m rad\]'",
    ) as refused:
        pp.calibrate(model(), bare, part)
    assert len(refused.value.findings) == 1
    named = pp.Measurement(std=20e-6, target=TARGETS[0], columns="*=[m rad]")
    found = pp.calibrate(model(), bare, named)
    assert same(whole, found)
    assert [one.message for one in found.findings if one.severity == "note"] == ["the column Time is not read"]
    text = Path(bare).read_text().replace("x1", "px").replace("joint2", "q2").replace("z1", "pz")
    (tmp_path / "other.csv").write_text(text)
    named = pp.Measurement(std=20e-6, target=TARGETS[0], columns="px=x [m], y1=y [m], pz=z [m], q2=joint2, *=[rad]")
    assert same(whole, pp.calibrate(model(), str(tmp_path / "other.csv"), named))
    with pytest.raises(InputError, match=r"the column 'q2' is not expected.*--columns 'q2=ignore'"):
        pp.calibrate(model(), str(tmp_path / "other.csv"), part)
    for wrong in ("px", "px=x [m], px=y", "x=[m"):
        with pytest.raises(InputError, match="is not of the form"):
            pp.Measurement(columns=wrong)
    with pytest.raises(InputError, match="there is no column 'nope'"):
        pp.calibrate(model(), bare, pp.Measurement(columns="nope=x"))
