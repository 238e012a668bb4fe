"""Trajectories: units in the header, poses between the rows by hand, mistakes in one line."""

from __future__ import annotations

import math

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.base.errors import InputError
from precision_pin.robot.chain import Chain
from support.plain_robot import chain_of, joint, link, robot


@pytest.fixture(scope="module")
def chain() -> Chain:
    limits = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
    return chain_of(
        robot(
            link("base"), link("carriage"), link("tool"),
            joint("rail", "prismatic", "base", "carriage", axis=(1, 0, 0), extra=limits),
            joint("swing [old]", "revolute", "carriage", "tool", (0, 0, 0.5), axis=(0, 1, 0), extra=limits),
        )
    )  # fmt: skip


def way(folder, chain, text, most=1000):
    (folder / "way.csv").write_text(text)
    return pp.read_trajectory(folder / "way.csv", chain, most)


WAY = "time [ms], swing [old] [deg], rail [mm]\n0,0,0\n500,30,100\n750,30,200\n2000,90,-1100\n"


def test_units_of_the_header(tmp_path, chain):
    read = way(tmp_path, chain, WAY)
    np.testing.assert_allclose(read.times, [0, 0.5, 0.75, 2], rtol=1e-15)
    np.testing.assert_allclose(read.values[:, 0], [0, 0.1, 0.2, -1.1], rtol=1e-15)
    np.testing.assert_allclose(read.values[:, 1], np.radians([0, 30, 30, 90]), rtol=1e-15)
    plain = way(tmp_path, chain, "t,swing [old],rail\n0,0,0\n0.5,0.25,0.1\n")
    np.testing.assert_array_equal(plain.values, [[0, 0], [0.1, 0.25]])
    poses = read.poses
    assert poses.status == ("reached", "reached", "reached", "limit")
    assert poses.names == ("t = 0 s", "t = 0.5 s", "t = 0.75 s", "t = 2 s")
    np.testing.assert_array_equal(poses.times, read.times)


def test_poses_between_the_rows_by_hand(tmp_path, chain):
    read = way(tmp_path, chain, WAY)
    finer = read.refined(time_step=0.5)
    np.testing.assert_allclose(finer.times, [0, 0.5, 0.75, 0.75 + 1.25 / 3, 0.75 + 2.5 / 3, 2], rtol=1e-15)
    third = (1.3 / 3, math.pi / 9)
    np.testing.assert_allclose(finer.values[3], [0.2 - third[0], math.pi / 6 + third[1]], rtol=1e-14)
    assert [float(f"{row:.4f}") for row in finer.rows] == [1, 2, 3, 3.3333, 3.6667, 4]
    # 30 deg in four parts, nothing, 60 deg in eight
    turned = read.refined(angle_step=math.radians(7.5))
    assert len(turned.times) == 1 + 4 + 1 + 8
    assert np.abs(np.diff(turned.values[:, 1])).max() <= math.radians(7.5) * (1 + 1e-12)
    # 0.1 m in two, 0.1 m in two, 1.3 m in 26; with a time step at once the finer one counts
    for steps in ({"length_step": 0.05}, {"length_step": 0.05, "time_step": 1.0}):
        assert len(read.refined(**steps).times) == 1 + 2 + 2 + 26
    for finer_way in (finer, turned):
        rows = np.flatnonzero(finer_way.rows % 1 == 0)
        np.testing.assert_array_equal(finer_way.values[rows], read.values)
        np.testing.assert_array_equal(finer_way.times[rows], read.times)
    untimed = way(tmp_path, chain, "rail [mm],swing [old]\n0,0\n100,0\n").refined(length_step=0.03)
    assert untimed.names == ("row 1", "row 1.25", "row 1.5", "row 1.75", "row 2")
    np.testing.assert_array_equal(read.refined().values, read.values)


def test_many_plain_rows_are_those_of_the_file_and_their_reading_is_in_view(tmp_path, chain, monkeypatch):
    monkeypatch.setattr("precision_pin.robot.trajectory._AT_ONCE", 7)
    monkeypatch.setattr("precision_pin.robot.pose_set._AT_ONCE", 6)
    values = np.random.default_rng(3).uniform(-1, 1, (20, 2))
    lines = ["t [ms],swing [old], rail [cm]", *(f"{k}, {a!r} ,{b!r}\r" for k, (a, b) in enumerate(values.tolist())), ""]
    read_at, posed = [], []
    (tmp_path / "many.csv").write_text("\n\n".join(lines), newline="")
    read = pp.read_trajectory(tmp_path / "many.csv", chain, progress=read_at.append)
    np.testing.assert_array_equal(read.values, values[:, ::-1] * [0.01, 1])
    np.testing.assert_allclose(read.times, np.arange(20) / 1000, rtol=1e-15)
    # 20 rows between blank lines, seven lines at a time; of the header nothing is said
    assert len(read_at) == 6
    assert sum(read_at) == len("\n\n".join(lines).replace("\r\n", "\n")) - len(lines[0]) - 1
    assert read.pose_set(posed.append).status == read.poses.status
    assert posed == [6, 6, 6, 2]
    np.testing.assert_allclose(read.poses.position[0], values[:, 1] / 100, atol=1e-12)
    with pytest.raises(InputError, match=r"way.csv:3: .* 'nan' is not a finite number"):
        way(tmp_path, chain, "t,swing [old],rail\n0,0,0\n1,nan,0\n")


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ({17: "17,nan,0"}, r"way.csv:18: .* 'nan' is not a finite number"),
        ({14: "13,0,0"}, r"way.csv:15: .* the time stands still at 13 s"),  # the first row of a part
        ({17: "16,0,0"}, r"way.csv:18: .* the time stands still at 16 s"),
        ({21: "21,0,0"}, r"way.csv:22: .* more than 20 poses"),
        ({9: '"9",0,"\n0"', 12: "12,0"}, r"way.csv:14: .* 2 values for 3 columns"),  # a row of two lines before it
    ],
)
def test_a_wrong_row_far_down_is_named_by_its_line(tmp_path, chain, monkeypatch, rows, message):
    """Rows are read seven lines at a time."""
    monkeypatch.setattr("precision_pin.robot.trajectory._AT_ONCE", 7)
    text = {0: "t,swing [old],rail", **{k: f"{k},0,0" for k in range(1, 21)}, **rows}
    with pytest.raises(InputError, match=message):
        way(tmp_path, chain, "\n".join(text.values()), most=20)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("rail [deg],swing [old]\n0,0\n", "1: error E_TRAJECTORY: rail [deg]: 'deg' is not a unit of length; allowed: m, cm"),
        ("rail [],swing [old]\n0,0\n", "rail []: '' is not a unit of length"),
        ("time [m],rail,swing [old]\n0,0,0\n", "time [m]: 'm' is not a unit of time; allowed: s, ms, min"),
        ("rail,swing [old],time [s]\n0,0,0\n", "'time' is no joint of the chain"),
        ("rail,swing [old],time [s]\n0,0,0\n", "; times come first, as 'time'"),
        ("rail,rail [mm],swing [old]\n0,0,0\n", "the joint 'rail' has two columns"),
        ("rail,swing [deg]\n0,0\n", "the column 'swing' is no joint of the chain; did you mean 'swing [old]'?"),
        ("rail [cm],swing [old]\n0,x\n", "2: error E_TRAJECTORY: swing [old]: 'x' is not a finite number"),
    ],
)  # fmt: skip
def test_wrong_units_are_refused_by_column(tmp_path, chain, text, message):
    with pytest.raises(InputError) as caught:
        way(tmp_path, chain, text)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_wrong_steps_are_refused(tmp_path, chain):
    untimed = way(tmp_path, chain, "rail,swing [old]\n0,0\n1,0\n")
    with pytest.raises(InputError, match="time_step: the trajectory has no times"):
        untimed.refined(time_step=0.1)
    with pytest.raises(InputError, match="the steps make 1,000,001 poses; at most 1,000 are allowed"):
        untimed.refined(length_step=1e-6, most=1000)
    with pytest.raises(InputError, match="at most 1,048,575 are allowed"):
        untimed.refined(length_step=1e-300)
    with pytest.raises(InputError, match="angle_step must be positive"):
        untimed.refined(angle_step=0.0)
