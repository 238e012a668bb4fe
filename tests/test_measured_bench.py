"""The bench of measured robots: a small robot that the test makes, sets that are missing, and equations against closed forms."""

import csv
import importlib
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import precision_pin as pp

ROOT = Path(__file__).parents[1]


@pytest.fixture(autouse=True)
def from_the_root(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT))
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    monkeypatch.setenv("XLA_FLAGS", "")


def load(name: str):
    return importlib.import_module(f"benchmarks.measured.{name}")


def turned(axis: str, angle: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler(axis, angle).as_matrix()
    return pose


def moved(*shift: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = shift
    return pose


def dh_tip(q: np.ndarray, steps, modified: bool = False) -> np.ndarray:
    """Tip by Denavit and Hartenberg, a, alpha, d, theta of each joint, m and rad: (4, 4)."""
    pose = np.eye(4)
    for angle, (a, alpha, d, theta) in zip(q, steps, strict=True):
        joint, link = turned("z", angle + theta) @ moved(0, 0, d), moved(a, 0, 0) @ turned("x", alpha)
        pose = pose @ (link @ joint if modified else joint @ link)
    return pose


def write_set(folder: Path, rows: dict[str, int]) -> None:
    """A WAM whose lengths are off by up to 3 mm and whose zeros by up to 5 mrad, as the tracker's sets are written."""
    rng = np.random.default_rng(0)
    steps = [(a, np.radians(alpha), d, 0) for a, alpha, d, _ in load("declared").KNOWN["wam-tracker"]["dh"]["table"]]
    wrong = [(a + rng.uniform(-3e-3, 3e-3), alpha + rng.uniform(-5e-3, 5e-3), d + 2e-3, 0) for a, alpha, d, _ in steps]
    zeros, turn = rng.uniform(-5e-3, 5e-3, 7), Rotation.from_rotvec([0.01, -0.02, 0.03])
    mirror = np.array([0, 0, 0.044, 1])
    folder.mkdir()
    for name, count in rows.items():
        with (folder / name).open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(
                [
                    "step_order",
                    *(f"{axis}_{kind}" for kind in ("t", "dif") for axis in "xyz"),
                    *(f"joint_{k}" for k in range(1, 8)),
                ]
            )
            for k in range(count):
                q = rng.uniform(-1.5, 1.5, 7)
                wanted = 1e3 * (dh_tip(q, steps) @ mirror)[:3]
                read = 1e3 * turn.apply((dh_tip(q + zeros, wrong) @ mirror)[:3]) + rng.normal(0, 0.02, 3)
                writer.writerow([k, *wanted, *(read - wanted), *np.degrees(q)])


def judged_rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "measured.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_a_simulated_set_is_fitted_judged_and_written(tmp_path, capsys):
    write_set(tmp_path / "wam-tracker", {"grid.csv": 40, "random.csv": 8})
    (tmp_path / "talos").mkdir()
    run = load("__main__").main
    assert run([str(tmp_path), "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr()
    assert [line for line in said.err.splitlines() if "skipped" in line] == ["skipped talos: no talos/talos.urdf"]
    (row,) = judged_rows(tmp_path / "out")
    assert (row["robot"], row["readings"], row["judged at"]) == ("WAM", "40", "8 set apart")
    # 0.02 mm a coordinate, 0.032 mm in the mean of lengths; forty rows of three tell some thirty numbers
    assert float(row["before"]) > 2 > 0.1 > float(row["geometry"]) > 0.02
    assert float(row["as measured"]) > float(row["before"])
    assert float(row["forecast low"]) < float(row["forecast median"]) < float(row["forecast high"])
    assert row["verdict"].startswith("helps")
    assert row["gross"] == "0"
    page = (tmp_path / "out" / "measured.md").read_text(encoding="utf-8")
    assert f"**{row['geometry and drives']}**" in page
    assert "- skipped: talos: no talos/talos.urdf" in page
    assert {path.name for path in (tmp_path / "out").glob("*.png")} == {"measured-forecast.png", "measured-unseen.png"}


# a, alpha, d, theta of ABB's IRB 120 in mm and degrees, lengths from its data sheet
IRB_120 = [[0, -90, 290, 0], [270, 0, 0, -90], [70, -90, 0, 0], [0, 90, 302, 0], [0, -90, 0, 0], [0, 0, 72, 180]]
OWN = re.search(r"```text\n(.*?)```", (ROOT / "docs" / "real-robots.md").read_text(encoding="utf-8"), re.DOTALL)[1]
"""The declaration that the page shows."""


def write_irb_120(folder: Path, counts: dict[str, int], gross: dict[str, int]) -> None:
    """An IRB 120 whose lengths are off by up to 1 mm, with three reflectors; the first readings of a file are gross."""
    rng = np.random.default_rng(4)
    steps = np.array([(1e-3 * a, np.radians(alpha), 1e-3 * d, np.radians(theta)) for a, alpha, d, theta in IRB_120])
    wrong = steps + rng.uniform(-1, 1, steps.shape) * [1e-3, 2e-3, 1e-3, 2e-3]
    reflectors = np.array([[0.06, 0.0, 0.03, 1], [-0.03, 0.05, 0.04, 1], [-0.03, -0.05, 0.02, 1]]).T
    base = moved(1.5, -0.7, 0.2) @ turned("z", 2.0)
    folder.mkdir()
    (folder / "set.toml").write_text(OWN, encoding="utf-8")
    for name, count in counts.items():
        lines = []
        for k in range(count):
            q = rng.uniform([-2.5, -1.5, -1.5, -2.5, -1.8, -3.0], [2.5, 1.5, 1.0, 2.5, 1.8, 3.0])
            read = 1e3 * (base @ dh_tip(q, wrong) @ reflectors)[:3].T + rng.normal(0, 0.02, (3, 3))
            if k < gross[name]:
                read[k % 3] += rng.normal(0, 1, 3) * 40
            lines.append(";".join(f"{number:.6f}" for number in [*np.degrees(q), *read.ravel()]).replace(".", ","))
        (folder / name).write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.mark.slow
def test_gross_readings_of_a_users_own_arm_spoil_no_mean(tmp_path):
    counts = {"fit.csv": 50, "judge.csv": 40}
    write_irb_120(tmp_path / "clean", counts, dict.fromkeys(counts, 0))
    write_irb_120(tmp_path / "gross", counts, {"fit.csv": 2, "judge.csv": 3})
    assert load("__main__").main([str(tmp_path), "--out", str(tmp_path / "out")]) == 0
    clean, gross = judged_rows(tmp_path / "out")
    assert (clean["instrument"], clean["judged at"]) == ("laser tracker", "40 set apart")
    assert (clean["gross"], gross["gross"]) == ("0", "3")
    # 0.02 mm a coordinate: 0.032 mm in the mean of lengths
    for row in (clean, gross):
        assert float(row["before"]) > 0.5 > 0.06 > float(row["geometry"]) > 0.03
        assert 0.06 > float(row["geometry and drives"]) > 0.03
    assert float(gross["before"]) == pytest.approx(float(clean["before"]), rel=0.1)
    page = (tmp_path / "out" / "measured.md").read_text(encoding="utf-8")
    assert "- IRB 120: 3 of 120 readings at unseen poses are gross" in page


def test_a_missing_folder_is_one_line(tmp_path, capsys):
    run = load("__main__").main
    assert run([str(tmp_path / "none")]) == 2
    assert capsys.readouterr().err == f"{tmp_path / 'none'}: no such folder\n"
    assert run([str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == f"{tmp_path}: no set of data to judge"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "f/grid.csv has no rows"),
        ("x_t\n1\n", "f/grid.csv has no column y_t"),
        ("x_t,y_t,y_t\n1,2,3\n", "f/grid.csv has 2 columns y_t"),
        ("x_t,y_t\n\n1,o\n", "f/grid.csv, line 3: 'o' is not a number"),
        ("x_t,y_t\n1\n", "f/grid.csv, line 2: 1 cells, and column 2 is asked for"),
    ],
    ids=["empty", "column", "twice", "cell", "short"],
)
def test_a_broken_file_is_named(text, said, tmp_path):
    sets, declared, path = load("sets"), load("declared"), tmp_path / "f" / "grid.csv"
    path.parent.mkdir()
    path.write_text(text, encoding="utf-8")
    with pytest.raises(declared.MissingSet) as error:
        sets.columns(path, ["x_t", "y_t"], declared.Csv())
    assert error.value.args == (said,)


def test_columns_are_read_by_name_or_number_and_cells_may_be_empty(tmp_path):
    sets, declared, path = load("sets"), load("declared"), tmp_path / "grid.csv"
    path.write_text("\ufeff% by hand\na; b;c\n1,5;NA;2\n\n;-2e-3;nan\n", encoding="utf-8")
    form = declared.Csv(separator=";", decimal=",", comment="%")
    values = sets.columns(path, ["c", 1, "b"], form)
    np.testing.assert_array_equal(values, [[2, np.nan], [1.5, np.nan], [np.nan, -0.002]])
    path.write_text("1\t2\n3\t4\n", encoding="utf-8")
    np.testing.assert_array_equal(sets.columns(path, [2], declared.Csv(separator="\t", header=False)), [[2, 4]])


def own(folder: Path, *changes: tuple[str, str]) -> None:
    text = OWN
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    folder.mkdir(exist_ok=True)
    (folder / "set.toml").write_text(text, encoding="utf-8")


def test_values_are_turned_into_those_of_the_arm(tmp_path):
    """Sign, offset and theta of joints, a difference taken off, rows of two files, one of them without a reading."""
    own(
        tmp_path / "mine",
        ('unit = "deg"}', 'unit = "deg", sign = [1, 1, -1, 1, 1, 1], offset = [0, 10, 0, 0, 0, 0]}'),
        ("columns = [[7, 8, 9], [10, 11, 12], [13, 14, 15]]", "columns = [[7, 8, 9]], minus = [[10, 11, 12]]"),
        ('"fit.csv"', '["fit*.csv"]'),
        ('separator = ";", decimal = ",", ', ""),
    )
    joints = [1, 2, 3, 4, 5, 6]
    for name, step in (("fit-a.csv", 1), ("fit-b.csv", -1)):
        rows = [[*(joint + step * k for joint in joints), 100, 200, 300, 1, 2, k] for k in range(3)]
        rows[1][6] = "NA" if step > 0 else 100
        text = "\n".join(",".join(map(str, row)) for row in rows)
        (tmp_path / "mine" / name).write_text(text, encoding="utf-8")
    (tmp_path / "mine" / "judge.csv").write_text(text, encoding="utf-8")
    measured = load("sets").read("mine", tmp_path)
    assert (len(measured.fit), len(measured.judged)) == (5, 3)
    assert measured.notes == ("1 of 6 rows lack a reading",)
    np.testing.assert_allclose(np.degrees(measured.fit.q[:, 0]), [1, 12 - 90, -3, 4, 5, 6 + 180], atol=1e-12)
    np.testing.assert_allclose(np.degrees(measured.fit.q[:, 1]), [3, 14 - 90, -5, 6, 7, 8 + 180], atol=1e-12)
    # the row that was left out still tells how its successor was approached; the third joint is counted the other way
    np.testing.assert_array_equal(measured.fit.approaches[:, 1], [1, 1, -1, 1, 1, 1])
    np.testing.assert_array_equal(measured.fit.approaches[:, 2], 0)
    np.testing.assert_array_equal(measured.fit.approaches[:, 3], [-1, -1, 1, -1, -1, -1])
    np.testing.assert_allclose(measured.fit.points[0, -1], [0.099, 0.198, 0.298], atol=1e-15)
    assert measured.as_measured == pytest.approx(1e-3 * (np.sqrt(5) + np.sqrt(6) + 3) / 3)
    assert measured.guess == (0, 0, 0.05)


@pytest.mark.parametrize("modified", [False, True])
def test_an_arm_by_denavit_and_hartenberg_is_the_product_of_its_steps(modified):
    arms, declared, judge, rng = load("arms"), load("declared"), load("judge"), np.random.default_rng(5)
    table = rng.uniform(-1, 1, (5, 4)) * [300, 180, 300, 180]
    dh = declared.Dh(table=table.tolist(), units=("mm", "deg"), modified=modified)
    _, model = arms.drafts(arms.dh_urdf(dh))
    steps = table * [1e-3, np.pi / 180, 1e-3, np.pi / 180]
    q = rng.uniform(-3, 3, (5, 4))
    places, turns = judge.tips(model, q + steps[:, 3:], model.space.mean[:, None])
    for k in range(4):
        expected = dh_tip(q[:, k], steps, modified)
        np.testing.assert_allclose(places[k, 0], expected[:3, 3], atol=1e-12)
        np.testing.assert_allclose(turns[k, 0], expected[:3, :3], atol=1e-12)


def test_masses_lie_in_the_frame_of_their_row():
    arms, declared = load("arms"), load("declared")
    table, masses = [(100, 90, 50, 0)], [(2, 10, 20, 30)]
    for modified, centre in ((True, "0.01 0.02 0.03"), (False, "0.11 -0.03 0.07")):
        dh = declared.Dh(table=table, units=("mm", "deg"), modified=modified, masses=masses)
        found = re.search('<inertial><origin xyz="([^"]*)"', arms.dh_urdf(dh))[1]
        np.testing.assert_allclose([float(x) for x in found.split()], [float(x) for x in centre.split()], atol=1e-15)


MISTAKES = {
    "missing": ([('robot = "IRB 120"\n', "")], ["the key robot is missing"]),
    "unknown": ([("guess =", "gues =")], ["unknown key gues; did you mean 'guess'?"]),
    "nested": ([('"mm"}\ng', '"mm", minos = []}\ng')], ["unknown key targets.minos; did you mean 'minus'?"]),
    "two": (
        [('"IRB 120"', "120"), ('"mm"}\ng', '"km"}\ng')],
        ["robot: input should be a valid string, got 120", "targets.unit: input should be 'm' or 'mm', got 'km'"],
    ),
    "unit": (
        [("0 0 50 mm", "0 0 50")],
        ["guess: '0 0 50' has no unit; a length needs one of: m, cm, mm, um, µm, nm, in"],
    ),
    "arm": (
        [("guess", 'arm = "a.urdf"\nguess')],
        ["either arm (example:NAME, or a URDF) or dh (a table) says which arm it is"],
    ),
    "column": ([("[1, 2,", "[0, 2,")], ["joints.columns.0: a column is a name, or its number from 1, not 0"]),
    "names": ([("[1, 2,", '["q1", 2,')], ["files without a header have columns by number, from 1, not 'q1'"]),
    "commas": ([('separator = ";", ', "")], ["csv: commas are either between columns or in numbers"]),
    "signs": ([('unit = "deg"', 'unit = "deg", sign = [1, -1]')], ["joints: 2 values of sign for 6 columns"]),
    "differences": ([('"mm"}\ng', '"mm", minus = [[1, 2, 3]]}\ng')], ["targets: 1 differences for 3 targets"]),
    "file": (
        [('"fit.csv"', '"/fit.csv"')],
        ["fit.0: a file is named from the folder of the set, wildcards allowed, not '/fit.csv'"],
    ),
    "like": (
        [("robot", 'like = "wam-track"\nrobot')],
        ["like: no known set 'wam-track'; did you mean 'wam-tracker' or 'ur5-tracker'?"],
    ),
    "toml": ([('"IRB 120"', "IRB 120")], ["Invalid value (at line 1, column 9)"]),
}


@pytest.mark.parametrize(("changes", "said"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_in_a_declaration_is_one_line(changes, said, tmp_path):
    declared = load("declared")
    own(tmp_path / "mine", *changes)
    with pytest.raises(declared.MissingSet) as error:
        declared.declaration("mine", tmp_path)
    assert error.value.args == tuple(f"set.toml: {text}" for text in said)


@pytest.mark.parametrize(
    ("joints", "said"),
    [
        (
            '{columns = ["a", "b"], unit = "rad"}',
            "2 columns, and the arm has 6: shoulder_pan_joint, shoulder_lift_joint",
        ),
        (
            '{columns = ["a", "b", "c", "d", "e", "f"], unit = "mm"}',
            "shoulder_pan_joint is revolute, so its unit is an angle",
        ),
        (
            '{columns = ["shoulder_lift_joint", "shoulder_pan_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", '
            '"wrist_3_joint"], unit = "rad"}',
            "the arm has the order shoulder_pan_joint, shoulder_lift_joint",
        ),
    ],
    ids=["number", "unit", "order"],
)
def test_joint_values_that_are_not_the_arms_are_refused(joints, said, tmp_path):
    declared = load("declared")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "set.toml").write_text(f'like = "ipa-series-a"\njoints = {joints}\n', encoding="utf-8")
    with pytest.raises(declared.MissingSet, match=re.escape(said)):
        load("sets").read("mine", tmp_path)


def test_what_is_published_is_not_taken_over_by_a_users_own(tmp_path):
    (tmp_path / "mine").mkdir()
    text = 'like = "ur5-tracker"\nfit = "poses.csv"\ndh = {table = [[0, 0, 0, 0]], units = ["m", "rad"]}\n'
    (tmp_path / "mine" / "set.toml").write_text(text, encoding="utf-8")
    declared, home = load("declared").declaration("mine", tmp_path)
    assert (declared.published, declared.source, home) == (None, "", tmp_path / "mine")
    assert (declared.fit, declared.judge, declared.arm) == (["poses.csv"], ["random.csv"], [])


def test_every_known_set_is_declared_right(tmp_path):
    declared = load("declared")
    for name in declared.names(tmp_path):
        known, home = declared.declaration(name, tmp_path)
        assert known.source, name
        assert known.licence, name
        assert load("sets").read(name, tmp_path) is None, home


def write_readings(path: Path, names: list[str], rows: np.ndarray, separator: str = ",") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [separator.join(names), *(separator.join(f"{number:.9g}" for number in row) for row in rows)]
    text = "\n".join(lines)
    path.write_text(text.replace(".", ",") if separator == ";" else text, encoding="utf-8")


def exact_readings(model, q: np.ndarray, target: list[float]) -> np.ndarray:
    """What an instrument at an odd place reads of a nominal arm's target, m: (P, 3)."""
    places, turns = load("judge").tips(model, q, model.space.mean[:, None])
    turn = Rotation.from_rotvec([0.3, -0.2, 2.0]).as_matrix()
    return (places[:, 0] + turns[:, 0] @ np.array(target)) @ turn.T + [0.5, -3.3, -0.4]


def is_read_exactly(measured, target: list[float]) -> None:
    """Base and target explain the readings of a nominal arm, so columns, units and the tip are right."""
    judge = load("judge")
    places, turns = judge.tips(measured.forecast, measured.fit.q, measured.forecast.space.mean[:, None])
    found = judge.find_set_up(places[:, 0], turns[:, 0], measured.fit.points, np.array(measured.guess))
    np.testing.assert_allclose(found.targets, [target], atol=1e-6)
    np.testing.assert_allclose(judge.points(places, turns, found)[:, :, 0], measured.fit.points, atol=1e-6)


@pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")
def test_a_series_of_the_ur10_is_read(tmp_path):
    sets, rng = load("sets"), np.random.default_rng(6)
    model = load("arms").load(pp.init("example:ur10", tip="tool0"))
    q, target = rng.uniform(-2, 2, (6, 1500)), [0.004, -0.003, 0.093]
    # the order of columns of series B; series A has others before them and no deviations
    names = [joint.name for joint in model.chain.joints] + ["measurement_temperature"]
    names += [f"measurement_{text}" for axis in "xyz" for text in (axis, f"std_{axis}")]
    read = np.repeat(1e3 * exact_readings(model, q, target), 2, axis=1)
    rows = np.column_stack([q.T, np.full(1500, 21.5), read])
    write_readings(
        tmp_path / "ipa-robot-accuracy" / "Series_B" / "measurements_joint_configurations.csv", names, rows, ";"
    )
    measured = sets.read("ipa-series-b", tmp_path)
    assert (measured.robot, measured.judged) == ("UR10, series B", None)
    assert measured.notes == ("1000 of 1500 rows, evenly chosen",)
    assert len(measured.fit) == 1000
    np.testing.assert_allclose(measured.fit.q[:, [0, -1]], q[:, [0, -1]], atol=1e-8)
    is_read_exactly(measured, target)


def two_armed(folder: Path) -> None:
    """A lift and two arms of seven joints, the right one with a tool changer, as TIAGo Pro's URDF has them."""
    body = '<inertial><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>'
    links = ["base_footprint", "torso_lift_link"]
    joints = [("torso_lift_joint", "prismatic", "base_footprint", "torso_lift_link", "0 0 0.8", "0 0 0", "0 0 1")]
    for side, y in (("right", -0.2), ("left", 0.2)):
        parent = "torso_lift_link"
        for k in range(1, 8):
            child, place = f"arm_{side}_{k}_link", f"0.0{k} {y if k == 1 else 0} 0.1"
            joints.append(
                (f"arm_{side}_{k}_joint", "revolute", parent, child, place, f"{1.5 * (-1) ** k} 0 0.2", "0 0 1")
            )
            links.append(child)
            parent = child
        links.append(f"gripper_{side}_pal_atc_base_link")
        joints.append((f"mount_{side}", "fixed", parent, links[-1], "0 0 0.05", "0 0 0", "0 0 1"))
    text = "".join(f'<link name="{link}">{body}</link>' for link in links) + "".join(
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
        '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        for name, kind, parent, child, xyz, rpy, axis in joints
    )
    folder.mkdir(parents=True)
    (folder / "tiago_pro.urdf").write_text(f'<robot name="pro">{text}</robot>', encoding="utf-8")


@pytest.mark.parametrize("place", ["", "urdf"])
@pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")
def test_a_made_up_arm_in_the_form_of_tiago_pro_is_read(place, tmp_path):
    example, rng = tmp_path / "figaroh-examples" / "examples" / "tiago_pro", np.random.default_rng(7)
    two_armed(example / place)
    urdf = (example / place / "tiago_pro.urdf").read_text(encoding="utf-8")
    _, model = load("arms").drafts(urdf, "gripper_right_pal_atc_base_link")
    q, target = np.vstack([rng.uniform(0, 0.3, (1, 48)), rng.uniform(-2, 2, (7, 48))]), [-0.005, 0.002, 0.137]
    names = ["x1", "y1", "z1", "phix1", "phiy1", "phiz1", "torso_lift_joint"]
    names += [f"arm_right_{k}_joint" for k in range(1, 8)]
    rows = np.column_stack([exact_readings(model, q, target), np.zeros((48, 3)), q.T])
    write_readings(example / "data" / "calibration_samples_20260805_1246.csv", names, rows)
    measured = load("sets").read("tiago-pro", tmp_path)
    assert (measured.robot, measured.forecast_by, measured.guess) == (
        "TIAGo Pro, right arm",
        "init",
        (0, 0, pytest.approx(0.142)),
    )
    is_read_exactly(measured, target)
    with pytest.raises(load("declared").MissingSet, match=r"^no data/calibration_samples_20260701_0913\.csv$"):
        load("sets").read("tiago-pro-2026-07-01", tmp_path)


def test_targets_that_repeat_others_are_left_out():
    sets, rng = load("sets"), np.random.default_rng(8)
    points = rng.normal(size=(4, 6, 3))
    points[3] = points[2]
    kept, notes = sets.different(points)
    assert (kept, notes) == ([0, 1, 2], ["target 4 repeats target 3 in 6 of 6 rows: 4 is not used"])
    # which of the two is right in the other rows, nobody knows
    points[3, :2] += 1
    kept, notes = sets.different(points)
    assert (kept, notes) == ([0, 1], ["target 4 repeats target 3 in 4 of 6 rows: 3 and 4 are not used"])


def test_places_that_were_visited_again_are_left_out_together():
    places = np.random.default_rng(9).uniform(-2, 2, (6, 10))
    q = places[:, [0, 1, 2, 1, 3, 4, 0, 5, 6, 7, 8, 9]] + np.random.default_rng(10).normal(0, 1e-4, (6, 12))
    judge, sets = load("judge"), load("sets")
    number = judge.visited(q)
    np.testing.assert_array_equal(number, [0, 1, 2, 1, 3, 4, 0, 5, 6, 7, 8, 9])
    rows = sets.Rows(q, np.zeros((1, 12, 3)), np.zeros((6, 12), dtype=np.int8))
    found = judge.splits(sets.MeasuredSet("", "", "", None, "", rows))
    assert [new.tolist() for _, new in found] == [[0, 6, 7], [1, 3, 8], [2, 9], [4, 10], [5, 11]]
    assert all(sorted([*seen, *new]) == list(range(12)) for seen, new in found)


def test_a_reading_is_gross_if_it_is_far_off_and_has_no_weight(monkeypatch):
    judge, sets, rng = load("judge"), load("sets"), np.random.default_rng(12)
    rows = sets.Rows(rng.uniform(-2, 2, (6, 12)), rng.normal(size=(2, 12, 3)), np.zeros((6, 12), dtype=np.int8))
    measured = sets.MeasuredSet("", "", "", None, "", rows)
    # by target and row: the first two have no weight, the second of them is near, and the third is foretold badly
    size = np.ones((2, 12))
    size[1, 7] = size[0, 3] = 50
    fit = SimpleNamespace(gross_errors=[SimpleNamespace(reading=12 + 7), SimpleNamespace(reading=5)])
    monkeypatch.setattr(judge, "calibrated", lambda *_: fit)
    judged = np.concatenate([size[:, new].ravel() for _, new in judge.splits(measured)])
    is_gross = judge.gross_readings(None, measured, judged)
    assert is_gross.sum() == 1
    # row 7 is the second of the third group, and its second target
    order = [(target, row) for _, new in judge.splits(measured) for target in range(2) for row in new]
    assert order[int(np.flatnonzero(is_gross)[0])] == (1, 7)


def test_a_fit_that_ends_badly_leaves_the_others(tmp_path, monkeypatch, capsys):
    judge, calls = load("judge"), []

    def calibrated(*arguments):
        calls.append(arguments)
        if len(calls) > 1:
            raise np.linalg.LinAlgError("singular")
        return fitted(*arguments)

    fitted = judge.calibrated
    write_set(tmp_path / "wam-tracker", {"grid.csv": 40, "random.csv": 8})
    monkeypatch.setattr(judge, "calibrated", calibrated)
    assert load("__main__").main([str(tmp_path), "--out", str(tmp_path / "out")]) == 0
    (row,) = judged_rows(tmp_path / "out")
    assert (row["geometry"] != "", row["geometry and drives"]) == (True, "")
    assert "- WAM: geometry and drives: no fit (singular)" in (tmp_path / "out" / "measured.md").read_text("utf-8")
    assert load("__main__").main([str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert "skipped wam-tracker: singular" in capsys.readouterr().err


def test_base_and_target_are_found_beside_gross_readings():
    judge, rng = load("judge"), np.random.default_rng(11)
    turns, places = Rotation.random(40, random_state=3).as_matrix(), rng.uniform(-1, 1, (40, 3))
    target, shift = np.array([0.05, 0.02, 0.1]), np.array([3.0, -1.0, 0.5])
    read = (places + turns @ target + shift)[None] + rng.normal(0, 1e-4, (1, 40, 3))
    read[0, :3] += rng.normal(0, 1, (3, 3))
    found = judge.find_set_up_without_gross(places, turns, read, np.zeros(3))
    np.testing.assert_allclose(found.targets[0], target, atol=1e-4)
    np.testing.assert_allclose(found.base[:3, 3], shift, atol=1e-4)


def test_the_page_lists_the_data_that_are_declared():
    text = (ROOT / "docs" / "real-robots.md").read_text(encoding="utf-8")
    assert load("page").data_table() in text


def test_base_and_targets_are_found_wherever_they_are():
    judge, rng = load("judge"), np.random.default_rng(1)
    turns = Rotation.random(25, random_state=2).as_matrix()
    places, targets = rng.uniform(-1, 1, (25, 3)), np.array([[0.05, 0.02, 0.1], [-0.04, 0.03, 0.02]])
    base = np.eye(4)
    base[:3, :3], base[:3, 3] = Rotation.from_rotvec([0.5, 2.0, -1.0]).as_matrix(), [3, -1, 0.5]
    read = np.array([(places + turns @ target) @ base[:3, :3].T + base[:3, 3] for target in targets])
    found = judge.find_set_up(places, turns, read, np.zeros(3))
    np.testing.assert_allclose(found.base, base, atol=1e-9)
    np.testing.assert_allclose(found.targets, targets, atol=1e-9)


def test_slopes_of_the_set_up_are_differences():
    judge, rng, step = load("judge"), np.random.default_rng(3), 1e-6
    turns, places = Rotation.random(4, random_state=1).as_matrix()[:, None], rng.uniform(-1, 1, (4, 1, 3))
    base = np.eye(4)
    base[:3, :3], base[:3, 3] = Rotation.from_rotvec([0.5, 0.2, -1.0]).as_matrix(), [1, 2, 3]
    set_up = judge.SetUp(base, rng.uniform(-0.1, 0.1, (2, 3)))
    slopes = judge.set_up_slopes(judge.points(places, turns, set_up), turns, set_up)
    for k in range(12):
        ends = []
        for sign in (1, -1):
            moved, targets = base.copy(), set_up.targets.copy()
            if k < 3:
                moved[k, 3] += sign * step
            elif k < 6:
                moved[:3, :3] = Rotation.from_rotvec(sign * step * np.eye(3)[k - 3]).as_matrix() @ moved[:3, :3]
            else:
                targets.ravel()[k - 6] += sign * step
            ends.append(judge.points(places, turns, judge.SetUp(moved, targets)))
        np.testing.assert_allclose(slopes[..., k], (ends[0] - ends[1]) / (2 * step), atol=1e-8)
