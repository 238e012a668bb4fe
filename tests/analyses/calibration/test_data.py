"""Readings and their derivatives by matrices and differences; data as they come: mixed, missing, copied, in other units."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import precision_pin as pp
from analyses.calibration.arms import OFF_AXIS, offsets, paper_model, plain_model, random_poses, readings_of
from precision_pin.analyses.calibration.data import CalibrationData, read_data
from precision_pin.analyses.calibration.design import Instruments
from precision_pin.analyses.calibration.fit import Problem
from precision_pin.analyses.calibration.start import first_guess
from precision_pin.analyses.readings import stations_of
from precision_pin.base import se3
from precision_pin.sources import JointOffset, Payload
from support.plain_robot import inserted
from support.refusals import check_refused

CHAIN = paper_model().chain
JOINTS = CHAIN.joint_names
SPREAD = 1e-3
TARGETS = np.array([[0.05, 0.03, 0.02], [-0.04, 0.06, 0.03], [0.02, -0.07, 0.05]])


TRUTH = SPREAD * np.array([0.6, -1.1, 0.4, 1.3])
Q = random_poses(4, 12)


def model(spread=SPREAD, *visit):
    again = [JointOffset(joint="joint2", offset=pp.Draw("", pp.Normal(std), pp.Scope.VISIT)) for std in visit]
    return offsets(pp.Normal(spread), *again)


def points(q, target):
    """Return the places of a target, ``(P, 3)``."""
    pose = CHAIN.at_columns(np.ascontiguousarray(q)).pose
    return (pose[:3, 3] + np.einsum("ijp,j->ip", pose[:3, :3], target)).T


def measured(std=20e-6, seed=1):
    """Return the readings of each target by an arm whose joints are off by ``TRUTH``."""
    noise = np.random.default_rng(seed).normal(0, std, (3, Q.shape[1], 3))
    return [points(Q + TRUTH[:, None], target) + own for target, own in zip(TARGETS, noise, strict=True)]


def write(path, columns, units="deg m", q=Q):
    """Write joint values and readings; joint values in degrees, and units in the header, unless asked otherwise."""
    angle, _, length = units.partition(" ")
    scale = np.degrees(1) if angle == "deg" else 1.0
    whole = {f"{name} [{angle}]" if length else name: scale * values for name, values in zip(JOINTS, q, strict=True)}
    whole |= {f"{name} [{length}]" if length else name: values for name, values in columns.items()}
    cells = zip(*whole.values(), strict=True)
    texts = ([one if isinstance(one, str) else repr(float(one)) for one in row] for row in cells)
    rows = map(",".join, texts)
    path.write_text("\n".join([",".join(whole), *rows]))
    return str(path)


def means(found):
    return np.array(list(found.posterior.mean.values()))


def xyz(number, values):
    return {f"{axis}{number}": column for axis, column in zip("xyz", values.T, strict=True)}


def read(data, *parts):
    return read_data(model(), data, parts)


def check_same(one, other):
    for name in ("q", "readings", "part", "visit"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def of_targets(*numbers, **more):
    return [pp.Measurement(std=20e-6, target=TARGETS[k - 1], target_name=str(k), **more) for k in numbers]


@pytest.mark.slow
def test_kinds_mixed_are_one_least_squares_problem(tmp_path):
    """Against Gauss-Newton steps in plain numpy, with the kinematics of the arm and differences for derivatives."""
    anchor, height, stds = np.array([0.4, 0.1, -0.2]), -0.3, (30e-6, 50e-6, 80e-6)
    guess, offset = TARGETS[0], np.array([1e-3, -2e-3, 0.5e-3])
    base, origin = Rotation.from_rotvec([0.3, -1.2, 0.8]), np.array([2.0, -1.0, 0.5])

    def predicted(n):
        """Joint offsets, target, shift and turn of the base."""
        y = points(Q + n[:4, None], guess + n[4:7])
        seen = (Rotation.from_rotvec(n[10:13]) * base).apply(y) + origin + n[7:10]
        return np.concatenate([seen.ravel(), np.linalg.norm(y - anchor, axis=1), y[:, 2] - height])

    std = np.repeat(stds, [36, 12, 12])
    truth = np.concatenate([TRUTH, offset, [1e-3, 2e-3, -1e-3, 2e-3, -1e-3, 3e-3]])
    y = predicted(truth) + std * np.random.default_rng(5).standard_normal(60)
    x, prior = np.zeros(13), np.diag([1 / SPREAD] * 4 + [0.0] * 9)[:4]
    for _ in range(6):
        pairs = [[predicted(x + k * one) - predicted(x - k * one) for k in (1, 2)] for one in 1e-3 * np.eye(13)]
        slopes = [(8 * near - far) / 12e-3 for near, far in pairs]
        rows = np.vstack([np.array(slopes).T / std[:, None], prior])
        residuals = np.concatenate([(y - predicted(x)) / std, -prior @ x])
        x = x + np.linalg.lstsq(rows, residuals, rcond=None)[0]

    shared = {"target": guess, "target_known": False}
    parts = [
        pp.Measurement("position", std=stds[0], base="free", **shared),
        pp.Measurement("distance", std=stds[1], anchor=anchor, **shared),
        pp.Measurement("plane", std=stds[2], plane=((0, 0, height), (0, 0, 1)), **shared),
    ]
    position, distance, plane = y[:36].reshape(-1, 3), y[36:48], y[48:]
    found = pp.calibrate(model(), [(Q, position), (Q, distance), (Q, plane)], parts, at=[Q[:, 0]])
    np.testing.assert_allclose(means(found) / SPREAD, x[:4] / SPREAD, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.set_up.target, guess + x[4:7], atol=1e-11)
    assert found.chi_square == pytest.approx(residuals @ residuals, rel=1e-9)
    assert found.degrees_of_freedom == 60 - 9
    covariance = np.linalg.inv(rows.T @ rows)[:4, :4]
    np.testing.assert_allclose(found.posterior.covariance, covariance, rtol=1e-6, atol=1e-6 * covariance.max())
    assert [len(one.std) for one in found.set_ups] == [9, 3, 3]

    # the same from one file, in which each row is of one kind
    whole = np.full((5, 36), np.nan)
    whole[:3, :12], whole[3, 12:24], whole[4, 24:] = position.T, distance, plane
    columns = dict(zip(("x", "y", "z", "distance", "height"), whole, strict=True))
    again = pp.calibrate(model(), write(tmp_path / "mixed.csv", columns, "rad m", np.tile(Q, 3)), parts)
    np.testing.assert_allclose(again.posterior.covariance, found.posterior.covariance, rtol=1e-12)
    np.testing.assert_allclose(means(again), means(found), atol=1e-14)
    assert sum("missing in 24 of 36 rows" in one.message for one in again.findings) == 3
    stored = json.loads(found.to_json())
    assert stored["rms_residual"] == found.rms_residual
    assert [one["kind"] for one in stored["measurements"]] == ["position", "distance", "plane"]


@pytest.mark.slow
def test_targets_of_a_row_add_up_and_share_what_changes_between_visits(tmp_path):
    spread, parts = 1e-6, of_targets(1, 2)
    # narrow laws, so that the arm is linear: precisions add up, but for the prior, which each has
    near = [points(Q, target) + np.random.default_rng(k).normal(0, 20e-6, (12, 3)) for k, target in enumerate(TARGETS)]
    path = write(tmp_path / "near.csv", xyz(1, near[0]) | xyz("_2", near[1]))
    both = pp.calibrate(model(spread), path, parts)
    assert len(both.data) == 24
    alone = [pp.calibrate(model(spread), (Q, values), part) for values, part in zip(near, parts, strict=False)]
    inverses = [np.linalg.inv(one.posterior.covariance) for one in alone]
    precision = sum(inverses) - np.eye(4) / spread**2
    found = np.linalg.inv(both.posterior.covariance)
    np.testing.assert_allclose(found, precision, rtol=1e-6, atol=1e-6 * precision.max())
    expected = np.linalg.solve(precision, sum(a @ means(one) for a, one in zip(inverses, alone, strict=True)))
    np.testing.assert_allclose(means(both), expected, atol=1e-6 * spread)

    # repeatability of joint2 moves both targets of a row together, by hand
    wobbly = model(SPREAD, 3e-5)
    problem, _ = Problem.of(wobbly, read_data(wobbly, path, tuple(parts)))
    step = np.array([0, 1e-6, 0, 0])[:, None]
    moved = np.hstack([(points(Q[:, :1] + step, one) - points(Q[:, :1] - step, one))[0] / 2e-6 for one in TARGETS[:2]])
    noise = np.eye(6) * 20e-6**2 + 3e-5**2 * np.outer(moved, moved)
    np.testing.assert_allclose(problem.chunks[0].noise.covariances[0], noise, rtol=1e-6, atol=1e-16)


@pytest.mark.slow
def test_unknown_targets_are_found(tmp_path):
    one, two, three = measured()
    path = write(tmp_path / "three.csv", xyz(1, one) | xyz(2, two) | xyz(3, three))
    found = pp.calibrate(model(), path, pp.Measurement(std=20e-6, target_known=False, base="free"))
    assert abs(np.array([one.target for one in found.set_ups]) - TARGETS).max() < 3e-4
    assert found.identifiability.nuisances[-1] == "target[3].z"
    assert len({one.reading for one in found.gross_errors}) == 0
    two = [pp.Measurement(), pp.Measurement(target_known=False)]
    check_refused(
        ("targets 1, 2, 3 and one known target", pp.calibrate, model(), path, two[0]),
        ("share target and say different things", pp.calibrate, model(), [(Q, np.ones((12, 3)))] * 2, two),
    )


# base and target of any turn, and gross errors -----------------------------------------------------------------------

NO_STD = np.zeros(0)


def turned(kind, rng):
    """Return attitudes ``(P,)`` of the tool, 43 of any turn, about one axis, 40 alike and 3 alike, or all alike."""
    if kind == "any":
        return Rotation.random(43, rng=rng)
    if kind == "one axis":
        return Rotation.from_rotvec(rng.uniform(-3, 3, (43, 1)) * [[0.0, 0.6, 0.8]])
    others = np.arange(43)[:, None] > (39 if kind == "two attitudes" else 43)
    return Rotation.random(rng=rng) * Rotation.from_rotvec(np.pi / 2 * others * [[0.0, 0.0, 1.0]])


@pytest.mark.parametrize("base", ["free", "known"])
@pytest.mark.parametrize("attitudes", ["any", "one axis", "two attitudes", "in a plane"])
def test_the_first_guess_is_exact_for_any_turn(attitudes, base):
    """Readings by products of matrices, without noise: the guess gives the same, and where it is determined the set-up."""
    for seed in range(2):
        rng = np.random.default_rng(seed)
        turns, places = turned(attitudes, rng), rng.uniform(-0.5, 0.5, (43, 3))
        places[:, 2] *= attitudes != "in a plane"
        seen_from, target = Rotation.random(rng=rng), Rotation.random(rng=rng)
        origin, offset = rng.uniform(-2, 2, 3), rng.uniform(-0.3, 0.3, 3)
        if base == "known":
            seen_from, origin = Rotation.identity(), np.zeros(3)
        seen = seen_from.apply(places + turns.apply(offset)) + origin
        whole = np.hstack([seen, (seen_from * turns * target).as_rotvec()])
        tips = np.tile(np.eye(4), (43, 1, 1))
        tips[:, :3, :3], tips[:, :3, 3] = turns.as_matrix(), places
        for kind, size in (("pose", 6), ("position", 3)):
            part = pp.Measurement(kind, base=base, target_known=False)
            data = CalibrationData(np.zeros((4, 43)), whole[:, :size], NO_STD, NO_STD, "", tuple(range(43)), (part,))
            (found,), nuisances = first_guess(data, tips, Instruments((part,)))
            own = nuisances[-size:]
            again = (places + turns.apply(own[:3])) @ found[:3, :3].T + found[:3, 3]
            np.testing.assert_allclose(again, seen, atol=1e-9)
            np.testing.assert_allclose(found[:3, :3], seen_from.as_matrix(), atol=1e-9)
            if kind == "pose":
                assert (Rotation.from_rotvec(own[3:]) * target.inv()).magnitude() < 1e-8
            if attitudes == "any" or base == "known":
                np.testing.assert_allclose(own[:3], offset, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize(("degrees", "std"), [(90, "estimate"), (180, 2e-5)])
def test_a_marker_turned_on_the_tool_is_found_with_the_base(degrees, std):
    """The arm is the sheet's, 12 poses; least squares of base and marker alone, by SciPy, leaves the same residuals."""
    q, rng = Q, np.random.default_rng(3)
    pose = CHAIN.at_columns(q).pose
    turns, places = Rotation.from_matrix(np.moveaxis(pose[:3, :3], -1, 0)), pose[:3, 3].T
    marker, base = Rotation.from_rotvec([0, 0, degrees], degrees=True), Rotation.from_rotvec([0, 0.2, 0.4])
    origin = np.array([1.5, -0.7, 0.2])
    seen = base.apply(places + turns.apply([0.02, 0.01, 0.1])) + origin + rng.normal(0, 2e-5, (12, 3))
    attitudes = base * turns * marker * Rotation.from_rotvec(rng.normal(0, 2e-4, (12, 3)))

    def residuals(x):
        here, there = Rotation.from_rotvec(x[3:6]) * base, marker * Rotation.from_rotvec(x[9:])
        off = (attitudes.inv() * here * turns * there).as_rotvec()
        return np.hstack([(here.apply(places + turns.apply(x[6:9])) + x[:3] - seen) / 2e-5, off / 2e-4]).ravel()

    alone = least_squares(residuals, np.r_[origin, np.zeros(3), 0.02, 0.01, 0.1, np.zeros(3)])
    free = {"base": "free", "target_known": False, "attitude_std": None if std == "estimate" else 2e-4}
    found = pp.calibrate(
        model(1e-6), (q, np.hstack([seen, attitudes.as_rotvec()])), pp.Measurement("pose", std=std, **free)
    )
    assert (found.verdict in ("agrees", "not tested"), found.gross_errors) == (True, ())
    np.testing.assert_allclose(found.set_up.target, alone.x[6:9], atol=5e-6)
    if std == "estimate":
        assert found.noise["std"].interval[0] < 2e-5 < found.noise["std"].interval[1]
    else:
        white = found.residuals_before / np.repeat([2e-5, 2e-4], 3)
        assert (white**2).sum() == pytest.approx(2 * alone.cost, rel=1e-6)


FAR = (
    ("position", 0.2, 5e-3, "estimate"),
    ("pose", 0.2, 0.04, 20e-6),
    ("distance", 0.2, 0.2, 20e-6),
    ("targets", 0.2, 1.0, 20e-6),
)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "share", "size", "std"), FAR)
def test_far_readings_are_named_and_the_others_fit(kind, share, size, std):
    """As many as may be gross errors; the others give the estimate that they give alone."""
    rng, arm = np.random.default_rng(4), model()
    parts = [pp.Measurement("position" if kind == "targets" else kind, std=20e-6, target=TARGETS[0])]
    if kind == "targets":
        parts.append(replace(parts[0], target=TARGETS[1], target_name="2"))
    clean = [readings_of(arm, Q, part, seed=5) for part in parts]
    wrong = [values.copy() for values in clean]
    rows = np.sort(rng.choice(12, int(12 * share), replace=False))
    for row in rows:
        wrong[row % len(parts)][row, :3] += size * Rotation.random(rng=rng).as_matrix()[0, : wrong[0][:, :3].shape[1]]
    free = {"base": "free", "std_known": std != "estimate"} | (
        {"anchor": (1.0, 0.3, 0.2)} if kind == "distance" else {}
    )
    given = [replace(part, **free) for part in parts]

    def fit(values, kept):
        whole = [(Q[:, own], each[own]) for own, each in zip(kept, values, strict=True)]
        return pp.calibrate(arm, whole if len(parts) > 1 else whole[0], given, at=[Q[:, 0]])

    every = [np.arange(12)] * len(parts)
    right = [np.setdiff1d(np.arange(12), rows[rows % len(parts) == k]) for k in range(len(parts))]
    found, alone = fit(wrong, every), fit(clean, right)
    assert sorted(error.line for error in found.gross_errors) == [row + 1 for row in rows]
    assert alone.gross_errors == ()
    stds = np.array(list(alone.posterior.std.values()))
    np.testing.assert_allclose((means(found) - means(alone)) / stds, 0, atol=0.05 if std == "estimate" else 1e-4)
    assert found.rms("after") == pytest.approx(alone.rms("after"), rel=0.01)


@pytest.mark.slow
def test_too_many_far_readings_are_refused_by_their_rows():
    readings, rows = measured()[0], [2, 3, 7, 11]
    readings[rows, 1] += 0.3
    said = "4 of 12 readings do not fit the others, which agree: rows 3, 4, 8, 12; measure these again"
    check_refused((said, pp.calibrate, model(), (Q, readings), of_targets(1)[0]))


@pytest.mark.slow
def test_missing_readings_are_those_of_a_file_without_them(tmp_path):
    one, two, _ = measured()
    columns = {name: [repr(float(value)) for value in values] for name, values in (xyz(1, one) | xyz(2, two)).items()}
    columns["y2"][4], columns["x1"][7], columns["x2"][7] = "", "NaN", "n/a"
    found = read(write(tmp_path / "gaps.csv", columns), *of_targets(1, 2))
    for k, (kept, values) in enumerate(((np.delete(np.arange(12), 7), one), (np.delete(np.arange(12), [4, 7]), two))):
        np.testing.assert_array_equal(found.readings[found.part == k], values[kept])
        np.testing.assert_allclose(found.q[:, found.part == k], Q[:, kept], rtol=1e-15)
        np.testing.assert_array_equal(found.visit[found.part == k], kept)
    said = [f"x{k} or y{k} or z{k} is missing in {k} of 12 rows, which are left out" for k in (1, 2)]
    assert [finding.message for finding in found.findings] == said
    gaps = one.copy()
    gaps[3, 1] = np.nan
    rest = np.delete(np.arange(12), 3)
    check_same(read((Q, gaps), *of_targets(1)), read((Q[:, rest], one[rest]), *of_targets(1)))
    assert read((Q, gaps), *of_targets(1)).lines == (1, 2, 3, *range(5, 13))


@pytest.mark.slow
def test_copies_are_not_counted_twice(tmp_path):
    one, two, _ = measured()
    free = pp.Measurement(std=20e-6, target_known=False)
    both = read(write(tmp_path / "a.csv", xyz(1, one) | xyz(2, two)), free)
    copied = read(write(tmp_path / "b.csv", xyz(1, one) | xyz(2, two) | xyz(3, two)), free)
    check_same(both, copied)
    said = "x3, y3, z3 repeat x2, y2, z2 to the last digit in 12 of 12 rows; the copy is left out"
    assert said in [finding.message for finding in copied.findings]
    # where only some rows are alike, nothing says which target was read there
    mixed = two.copy()
    mixed[:5] = one[:5]
    some = read(write(tmp_path / "c.csv", xyz(1, one) | xyz(2, mixed)), free)
    assert set(some.lines) == set(range(7, 14))
    assert any("5 of 12 rows" in finding.message for finding in some.findings)
    lines = Path(tmp_path / "a.csv").read_text().splitlines()
    (tmp_path / "d.csv").write_text("\n".join([*lines, lines[3], lines[4]]))
    repeated = read(str(tmp_path / "d.csv"), free)
    check_same(both, repeated)
    assert any("2 of 14 rows repeat another to the last digit" in finding.message for finding in repeated.findings)
    # with different times they were read twice
    timed = [f"{k or 't'},{line}" for k, line in enumerate([*lines, lines[3]])]
    (tmp_path / "e.csv").write_text("\n".join(timed))
    assert len(read(str(tmp_path / "e.csv"), free)) == 26


@pytest.mark.slow
def test_targets_of_one_computed_pose_are_not_independent(tmp_path):
    exact = [points(Q + TRUTH[:, None], target) for target in TARGETS]
    shared = np.random.default_rng(0).normal(0, 20e-6, (12, 3))
    path = write(tmp_path / "rigid.csv", xyz(1, exact[0] + shared) | xyz(2, exact[1] + shared))
    (finding,) = read(path, *of_targets(1, 2)).findings
    assert (finding.code, "keep their distances" in finding.message) == ("W_NOT_INDEPENDENT", True)
    apart = write(tmp_path / "apart.csv", xyz(1, measured()[0]) | xyz(2, measured()[1]))
    assert not read(apart, *of_targets(1, 2)).findings


@pytest.mark.slow
@pytest.mark.parametrize(("joints", "unit"), [(JOINTS, "deg"), (("joint3",), "rad")])
def test_a_wrong_unit_of_joint_values_is_named(joints, unit):
    """The file says degrees of values in radians, or the other way, of all joints or of one."""
    scale = np.where([name in joints for name in JOINTS], np.radians(1) if unit == "deg" else np.degrees(1), 1.0)
    free = pp.Measurement(std=1e-3, target_known=False, base="free")
    right = "radians, not degrees" if unit == "deg" else "degrees, not radians"
    message = rf"better if the values of {', '.join(joints)} are {right} \(a factor of 57.3\)"
    check_refused((message, pp.calibrate, model(), (Q * scale[:, None], measured()[0]), free))


@pytest.mark.slow
def test_bare_headers_need_units_and_take_names(tmp_path):
    readings, part = measured()[0], of_targets(1)[0]
    whole = read(write(tmp_path / "whole.csv", xyz(1, readings), "rad m"), part)
    bare = write(tmp_path / "bare.csv", xyz(1, readings) | {"Time": ["12:30"] * 12}, "rad")
    with pytest.raises(
        pp.InputError,
        match=r"columns x1, .*joint4 have no unit; if lengths are in m and angles are in rad add "
        r"--columns '\*=\[m rad\]'",
    ) as refused:
        read(bare, part)
    assert len(refused.value.findings) == 1
    degrees = write(tmp_path / "degrees.csv", xyz(1, readings), "deg")
    check_refused((r"angles are in deg add --columns '\*=\[m deg\]'", read, degrees, part))
    check_same(whole, read(write(tmp_path / "same.csv", xyz(1, readings), "rad"), replace(part, columns="*=[m rad]")))
    found = read(bare, pp.Measurement(columns="*=[m rad]"))
    check_same(whole, found)
    assert [one.message for one in found.findings] == ["the column Time is not read"]
    text = Path(bare).read_text().replace("x1", "px").replace("joint2", "q2").replace("z1", "pz")
    (tmp_path / "other.csv").write_text(text)
    named = pp.Measurement(columns="px=x [m], y1=y [m], pz=z [m], q2=joint2, *=[rad]")
    check_same(whole, read(str(tmp_path / "other.csv"), named))
    check_refused(
        (r"the column 'q2' is not expected.*--columns 'q2=ignore'", read, str(tmp_path / "other.csv"), part),
        ("there is no column 'nope'", read, bare, pp.Measurement(columns="nope=x")),
    )


def test_tables_of_others_are_the_same_readings(tmp_path):
    """Semicolons and decimal commas, blanks, columns of recorders, and angles that are a whole turn off."""
    readings, part = measured()[0], of_targets(1)[0]
    whole = read(write(tmp_path / "whole.csv", xyz(1, readings), "rad m"), part)
    text = Path(tmp_path / "whole.csv").read_text()
    plotted, echoed = text.replace("joint", "/joint_states/joint").replace(" [rad]", "/position"), text
    for k, name in enumerate(JOINTS):
        echoed = echoed.replace(f"{name} [rad]", f"field.position{k}")
    names = [*(f"field.name{k}" for k in range(4)), "field.velocity0", "%time"], [*JOINTS, "0", "9"]
    lines = echoed.split("\n")
    echoed = "\n".join(f"{line},{','.join(names[k > 0])}" for k, line in enumerate(lines))
    for form, note in (
        (text.replace(",", ";").replace(".", ","), None),
        (text.replace(",", "  "), None),
        ("\n".join(f"{line},{k or '__time'}" for k, line in enumerate(plotted.split("\n"))), "PlotJuggler"),
        (echoed, "rostopic"),
    ):
        (tmp_path / "form.csv").write_text(form)
        found = read(str(tmp_path / "form.csv"), part)
        check_same(whole, found)
        assert note is None or note in found.findings[-1].message
    (tmp_path / "form.csv").write_text(echoed.replace("joint1,joint2", "joint2,joint1", 1))
    check_refused(
        ("line 3: field.name0 is 'joint1', and in the first row 'joint2'", read, str(tmp_path / "form.csv"), part)
    )
    # others are left out where asked for
    (tmp_path / "form.csv").write_text(
        "\n".join(f"{line},{'b' if k else 'a'}" for k, line in enumerate(text.split("\n")))
    )
    found = read(str(tmp_path / "form.csv"), replace(part, columns="*=ignore"))
    check_same(whole, found)
    turned = read(write(tmp_path / "turned.csv", xyz(1, readings), "rad m", Q + 2 * np.pi), part)
    wrapping = model().like(replace(CHAIN, wraps=True), model().space)
    inside = read_data(wrapping, str(tmp_path / "turned.csv"), (part,))
    limits = CHAIN.configurations.limits
    is_limited = (np.abs(Q) < limits[1][:, None]) & (Q + 2 * np.pi > limits[1][:, None])
    np.testing.assert_allclose(inside.q, np.where(is_limited, Q, Q + 2 * np.pi), atol=1e-14)
    np.testing.assert_allclose(turned.q, Q + 2 * np.pi)
    assert is_limited.any()


def test_a_group_is_a_whole_number(tmp_path):
    target, values = measured()[0], [1.0] * Q.shape[1]
    values[3] = 0.5
    path = write(tmp_path / "days.csv", xyz("", target) | {"group": [f"{value:g}" for value in values]})
    # the header and three rows are above it
    check_refused((r"days.csv:5: error E_DATA: group must be a whole number", read, path, pp.Measurement()))


POINT, NORMAL, SOCKETS = (0.2, 0.1, -0.3), (1.0, -2.0, 2.0), ((2.0, 2.0, 2.0), (0.1, 0.5, 0.3), (-2.0, 1.0, 0.0))


PLACES = {"distance": {"anchor": (0.4, 0.1, -0.2)}, "plane": {"plane": (POINT, NORMAL)}, "socket": {"sockets": SOCKETS}}
KINDS = [
    pp.Measurement(kind, target=(0.1, -0.2, 0.05), base=base, target_known=known, **PLACES.get(kind, {}))
    for kind in ("position", "pose", "distance", "plane", "socket")
    for base, known in (("known", True), ("free", False))
]


def by_matrices(measurement, pose, error, nuisances):
    """Return a reading as a product of 4 × 4 matrices."""
    kind = measurement.kind
    count = {"plane": 3, "socket": 9, "distance": 3}.get(kind, 6) if measurement.base == "free" else 0
    place, own = np.zeros(9), np.zeros(6)
    place[:count], own[: nuisances.size - count] = nuisances[:count], nuisances[count:]
    tip = np.eye(4)
    tip[:3, :3] = Rotation.from_rotvec(error[3:]).as_matrix() @ pose[:3, :3]
    tip[:3, 3] = pose[:3, 3] + error[:3]
    base = inserted(place[:6]) if kind in ("position", "pose") else np.eye(4)
    seen = base @ tip @ inserted([*(own[:3] + measurement.target), *own[3:]])
    if kind == "distance":
        return np.array([np.linalg.norm(seen[:3, 3] - measurement.anchor - place[:3])])
    if kind == "plane":
        # n from two points in the plane, each raised by its tilt
        normal = np.array(NORMAL) / 3
        first = np.cross(normal, np.eye(3)[0])
        first /= np.linalg.norm(first)
        second = np.cross(normal, first)
        turned = np.cross(first - place[1] * normal, second - place[2] * normal)
        turned /= np.linalg.norm(turned)
        return np.array([turned @ (seen[:3, 3] - POINT) - place[0]])
    if kind == "socket":
        nominal = pose[:3, :3] @ measurement.target + pose[:3, 3]
        k = np.linalg.norm(np.array(SOCKETS) - nominal, axis=1).argmin()
        return seen[:3, 3] - SOCKETS[k] - place[3 * k : 3 * k + 3]
    turn = Rotation.from_matrix(seen[:3, :3] @ pose[:3, :3].T).as_rotvec()
    return np.concatenate([seen[:3, 3], turn])[: measurement.size]


@pytest.mark.parametrize("measurement", KINDS, ids=lambda one: f"{one.kind}-{one.base}-{one.target_known}")
def test_reading_is_the_product_of_matrices(measurement):
    """And its slopes are finite differences."""
    generator = np.random.default_rng(3)
    pose = se3.pose(Rotation.random(rng=generator).as_matrix(), generator.uniform(-1, 1, 3))
    error, nuisances = generator.normal(0, 0.1, 6), generator.normal(0, 0.2, len(measurement.nuisances))
    found = measurement.predict(pose, error[:, None], nuisances[:, None])[:, 0]
    np.testing.assert_allclose(found, by_matrices(measurement, pose, error, nuisances), atol=1e-14)
    here, step = np.concatenate([error, nuisances]), 1e-5

    def reading(values):
        return measurement.predict(pose, values[:6, None], values[6:, None])

    steps = step * np.eye(here.size)
    columns = [measurement.residual(reading(here + one), reading(here - one))[:, 0] / (2 * step) for one in steps]
    slopes = measurement.slopes(pose, error, nuisances)
    np.testing.assert_allclose(np.hstack([slopes.error, slopes.nuisances]), np.array(columns).T, atol=2e-9)


def test_wrong_settings_are_refused():
    payload = Payload(at="tool", mass=pp.Normal(0.1, mean=1.0))
    for settings, message in (
        ({"std": 0.0}, "above zero and finite, in m"),
        ({"target": (1.0, 2.0)}, "three lengths in m"),
        ({"attitude_std": 1e-4}, "belongs to the measurement of a pose"),
        ({"anchor": (1.0, 0.0, 0.0)}, "belongs to the measurement of a distance"),
        ({"sockets": ((1.0, 0.0, 0.0),)}, "sockets belongs to the measurement of a socket"),
        ({"kind": "socket"}, "the measurement of a socket needs sockets"),
        ({"kind": "socket", "sockets": 3}, "must be a list of points"),
        ({"kind": "socket", "sockets": ((0, 0, 0), (0, 0, 0))}, "two sockets of a measurement are at one place"),
        ({"kind": "plane", "plane": (1, 2, 3)}, "must be a point and a normal"),
        ({"kind": "plane", "plane": ((0, 0, 0), (0, 0, 0))}, "normal of the plane of a measurement is zero"),
        ({"facing": (1.0, 0.0, 0.0)}, "facing of a measurement needs visible_from"),
        ({"cone": 0.5}, "cone of a measurement needs visible_from"),
        ({"visible_from": (1.0, 0.0, 0.0), "facing": (0.0, 0.0, 0.0)}, "facing of a measurement is zero"),
        ({"cone": 4.0}, "above zero and at most a half turn"),
        ({"load": (payload,)}, "is given by fixed numbers"),
        ({"coupled": "joint3 - joint2"}, "coupled of a measurement must be of type dict"),
        ({"coupled": {"joint3": 2}}, "each of coupled of a measurement must be of type str"),
        *(({"columns": wrong}, "is not of the form") for wrong in ("px", "px=x [m], px=y", "x=[m")),
        ({"columns": "*=[furlong rad]"}, "columns: 'furlong' is not a unit"),
    ):
        check_refused((message, pp.Measurement), **settings)


@pytest.mark.slow
def test_what_is_measured_does_not_move_with_the_point_that_results_are_about():
    plain, q = plain_model(), random_poses(4, 8)
    measurement = pp.Measurement(std=20e-6, target=OFF_AXIS)
    readings = readings_of(plain, q, measurement, seed=2)
    away = pp.ErrorModel(plain.chain.with_target((0.0, 0.1, 0.0)), pp.Space(), plain.sources, plain.poses)
    here, there = (pp.calibrate(each, (q, readings), measurement) for each in (plain, away))
    assert there.posterior.mean == pytest.approx(here.posterior.mean, rel=1e-9, abs=1e-15)
    tip, point = here.predict("work"), there.predict("work")
    np.testing.assert_allclose(point[:3, 3], tip[:3, 3] + 0.1 * tip[:3, 1], atol=1e-12)


@pytest.mark.slow
def test_the_load_of_a_measurement_takes_the_place_of_payloads():
    """Without a payload its mass cannot be learned; with a known one the readings are those of an arm that carries it."""
    plain, q = plain_model(), random_poses(4, 10)
    measurement, three = pp.Measurement(std=20e-6, target=OFF_AXIS), Payload(at="tool", mass=3.0)

    def loaded(payload):
        return pp.ErrorModel(plain.chain, pp.Space(), (*plain.sources, payload), plain.poses)

    arm = loaded(Payload(at="tool", mass=pp.Uniform(0.5, mean=2.0)))
    ways = [replace(measurement, load=load) for load in (None, (), (three,))]
    posteriors = [pp.forecast_calibration(arm, q, one).posterior for one in ways]
    learned = [one.learned["payload[tool].mass"] for one in posteriors]
    assert learned[0] > 0.1
    assert learned[1:] == [0.0, 0.0]
    carrying = stations_of(arm, q, replace(measurement, load=(three,)))
    for one, other in zip(carrying, stations_of(loaded(three), q, measurement), strict=True):
        columns = [one.at.space.index[name] for name in other.at.space.components]
        np.testing.assert_allclose(one.at.jacobian[:, columns], other.at.jacobian, rtol=0, atol=1e-15)
        np.testing.assert_allclose(one.at.error_at_means, other.at.error_at_means, rtol=0, atol=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize(("facing", "axis"), [((0.0, 3.0, 0.0), 1), (None, 2)])
def test_a_target_is_seen_within_its_cone(facing, axis):
    """A target 0.1 m off the tip that faces along its y, or z, seen from 2 m along the base's y: by angles of plain vectors."""
    seen_from = {"visible_from": (0.0, 2.0, 0.5), "facing": facing, "cone": np.radians(40)}
    measurement = pp.Measurement(target=(0.0, 0.0, 0.1), **seen_from)
    chain, seen, q = plain_model().chain, [], random_poses(4, 60)
    for one in q.T:
        pose = chain.at(one).pose
        target = pose @ [0.0, 0.0, 0.1, 1.0]
        sight = np.array([0.0, 2.0, 0.5]) - target[:3]
        angle = np.degrees(np.arccos(sight @ pose[:3, axis] / np.linalg.norm(sight)))
        assert measurement.sees(pose) == (angle <= 40)
        seen.append(angle <= 40)
    assert 2 < sum(seen) < 40
    plan = pp.plan_calibration(plain_model(), q, 3, measurement)
    assert plan.candidates == sum(seen)
    assert all(measurement.sees(chain.at(one).pose) for one in plan.q.T)
    assert "W_HIDDEN" in {finding.code for finding in plan.findings}
    hidden = q[:, [seen.index(False)]]
    check_refused(("target at none of 1 candidates", pp.plan_calibration, plain_model(), hidden, 1, measurement))
