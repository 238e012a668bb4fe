"""The bench of measured robots: a small robot that the test makes, sets that are missing, and equations against closed forms."""

import csv
import importlib
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).parents[1]


@pytest.fixture(autouse=True)
def from_the_root(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT))
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    monkeypatch.setenv("XLA_FLAGS", "")


def load(name: str):
    return importlib.import_module(f"benchmarks.measured.{name}")


def wam_tip(q: np.ndarray, steps) -> np.ndarray:
    """Tip by Denavit and Hartenberg, written out: (4, 4)."""
    pose = np.eye(4)
    for angle, (a, alpha, d) in zip(q, steps, strict=True):
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        pose = pose @ np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]])
    return pose


def write_set(folder: Path, rows: dict[str, int]) -> None:
    """A WAM whose lengths are off by up to 3 mm and whose zeros by up to 5 mrad, as the tracker's sets are written."""
    rng = np.random.default_rng(0)
    steps = [row[:3] for row in load("sets").WAM]
    wrong = [(a + rng.uniform(-3e-3, 3e-3), alpha + rng.uniform(-5e-3, 5e-3), d + 2e-3) for a, alpha, d in steps]
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
                wanted = 1e3 * (wam_tip(q, steps) @ mirror)[:3]
                read = 1e3 * turn.apply((wam_tip(q + zeros, wrong) @ mirror)[:3]) + rng.normal(0, 0.02, 3)
                writer.writerow([k, *wanted, *(read - wanted), *np.degrees(q)])


def test_a_simulated_set_is_fitted_judged_and_written(tmp_path, capsys):
    write_set(tmp_path / "wam-tracker", {"grid.csv": 40, "random.csv": 8})
    run = load("__main__").main
    assert run([str(tmp_path), "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr()
    for name in ("ur5-tracker", "talos", "tiago", "ur-factory"):
        assert f"skipped {name}: no " in said.err
    with (tmp_path / "out" / "measured.csv").open(encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    assert (row["robot"], row["readings"], row["judged at"]) == ("WAM", "40", "8 set apart")
    # 0.02 mm a coordinate, 0.032 mm in the mean of lengths; forty rows of three tell some thirty numbers
    assert float(row["before"]) > 2 > 0.1 > float(row["geometry"]) > 0.02
    assert float(row["as measured"]) > float(row["before"])
    assert float(row["forecast low"]) < float(row["forecast median"]) < float(row["forecast high"])
    assert row["verdict"].startswith("helps")
    page = (tmp_path / "out" / "measured.md").read_text(encoding="utf-8")
    assert f"**{row['geometry and drives']}**" in page
    assert "- skipped: talos: no talos/left-arm-contact.csv" in page
    assert {path.name for path in (tmp_path / "out").glob("*.png")} == {"measured-forecast.png", "measured-unseen.png"}


def test_a_missing_folder_is_one_line(tmp_path, capsys):
    run = load("__main__").main
    assert run([str(tmp_path / "none")]) == 2
    assert capsys.readouterr().err == f"{tmp_path / 'none'}: no such folder\n"
    assert run([str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == f"{tmp_path}: no set of data to judge"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "said"),
    [("", "no rows"), ("x_t\n1\n", "no column y_t"), ("x_t,y_t\n1,\n", "a cell of x_t, y_t is not a number")],
    ids=["empty", "column", "cell"],
)
def test_a_broken_file_is_named(text, said, tmp_path):
    sets = load("sets")
    (tmp_path / "grid.csv").write_text(text, encoding="utf-8")
    with pytest.raises(sets.MissingSet, match=said):
        sets.columns(tmp_path / "grid.csv", ["x_t", "y_t"])


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
