"""Tables that other programs write: separators, decimal commas, recorders, clocks, units left out, whole turns."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.base import csv_columns
from precision_pin.base.errors import InputError
from precision_pin.robot.chain import Chain
from support.plain_robot import chain_of, joint, limits, link, robot

UR = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")


def arm(names=UR, bound=3.0) -> Chain:
    """Return an arm of joints that turn about x, y and z in turn, 0.1 m apart."""
    axes = itertools.cycle([(0, 0, 1), (0, 1, 0), (1, 0, 0)])
    parts = [link("l0")]
    for k, (name, axis) in enumerate(zip(names, axes, strict=False)):
        parts += [
            joint(name, "revolute", f"l{k}", f"l{k + 1}", (0.1, 0, 0), axis=axis, extra=limits(-bound, bound)),
            link(f"l{k + 1}"),
        ]
    return chain_of(robot(*parts))


ARM, OTHER = arm(), arm([f"j{k}" for k in range(1, 7)])
TWO = arm(("a", "swing [old]"))
Q = np.random.default_rng(5).uniform(-2.5, 2.5, (23, 6)).round(3)
TIMES = np.arange(23) * 0.008


def read(folder, text, chain=ARM, columns=""):
    (folder / "others.csv").write_text(text)
    return pp.read_trajectory(folder / "others.csv", chain, columns=columns)


def table(header, *columns, separator=","):
    rows = (
        [cell if isinstance(cell, str) else repr(float(cell)) for cell in row] for row in zip(*columns, strict=True)
    )
    return "\n".join([separator.join(header), *map(separator.join, rows), ""])


# separators and decimal signs ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("separator", [",", "; ", "\t", "   ", " \t"])
@pytest.mark.parametrize("decimal", [".", ","])
@pytest.mark.parametrize("is_large", [False, True])
def test_any_separator_and_decimal_sign_reads_the_same_numbers(tmp_path, monkeypatch, separator, decimal, is_large):
    """Rows at once, and row by row because of a cell in quotes."""
    if (separator, decimal) == (",", ","):
        return
    monkeypatch.setattr("precision_pin.robot.trajectory._AT_ONCE", 7)
    values = np.degrees(Q[:, :2])
    text = table(("time [ms]", "swing [old] [deg]", "a [deg]"), 1000 * TIMES, *values.T, separator=separator)
    head, body = text.split("\n", 1)
    body = body.replace(".", decimal) if decimal == "," else body
    if not is_large:
        first, more = body.split(separator.strip(" ") or " ", 1)
        body = f'"{first}"{separator.strip(" ") or " "}{more}'
    found = read(tmp_path, f"# by hand\n\n{head}\n# more\n{body}", TWO)
    np.testing.assert_allclose(found.values, Q[:, 1::-1], rtol=1e-14)
    np.testing.assert_allclose(found.times, TIMES, rtol=1e-14)


def test_measured_numbers_of_any_form_are_the_same(tmp_path):
    expected = Q[:, :2]
    for k, (separator, decimal) in enumerate(
        [(",", "."), (";", "."), (";", ","), ("\t", ","), (" ", ","), ("  ", ".")]
    ):
        text = table(("x [mm]", "y [mm]"), *expected.T, separator=separator)
        head, body = text.split("\n", 1)
        (tmp_path / f"{k}.csv").write_text(f"{head}\n{body.replace('.', decimal)}")
        found = csv_columns.read(tmp_path / f"{k}.csv")
        np.testing.assert_array_equal(found.rows, expected)
        assert found.units == ("mm", "mm")
    # columns without a name: the index of a data frame, and what follows a last separator
    (tmp_path / "frame.csv").write_text(
        table(("", "x [mm]", ""), np.arange(23), expected[:, 0], [""] * 23, separator=";")
    )
    assert csv_columns.read(tmp_path / "frame.csv").names == ("x",)
    frame = table(("", *UR, ""), [f"row {k}" for k in range(23)], *Q.T, [""] * 23)
    np.testing.assert_array_equal(read(tmp_path, frame).values, Q)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a;swing [old]\n0,1;0,2\n0,1;0.2\n", ":3: .*'0.2' is not a finite number; other numbers have a decimal comma"),
        ('a,swing [old]\n"0,1",0\n', ":2: .*'0,1' is not a finite number; with decimal commas, semicolons separate"),
        ("a;swing [old]\n0,1;0,2;3\n", ":2: .*3 values for 2 columns"),
        ("# values\n0.0,0.0\n1.0,2.0\n", r":2: .*the first row must name the columns and their units, such as 'a \[rad\]'"),
        ("0.1 0.2\n1.0 2.0\n", ":1: .*the first row must name the columns"),
        ("15;4;;a;b;0.1;0.2\n", ":1: .*the first row must name the columns"),
        ("x,a,swing [old]\n0,0,0\n", "the column 'x' is no joint .*; --columns 'x=JOINT .rad.' names its joint"),
        ("t,a,swing [old],time\n0,0,0,0\n", "the time has two columns; --columns drops one"),
        ("stamp,a,swing [old]\n1571234567000,0,0\n", r"stamp = .* s is beyond all clocks; give its unit: .*'stamp=\[ns\]'"),
        ("a,swing [old]\n0,0\n-85.9,10\n", r"row 2: a = -85.9 rad is far outside its limits; .* add --columns '\*=\[deg\]'"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_by_name(tmp_path, text, message):
    with pytest.raises(InputError, match=f"(?s)^[^\n]*{message}[^\n]*$"):
        read(tmp_path, text, TWO)


# columns of recorders ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("separator", [" ", ","])
@pytest.mark.parametrize("which", ["actual", "target", "target actual"])
def test_the_rtde_recorder_of_universal_robots(tmp_path, separator, which):
    """Times may come last; the actual values are taken; others of the recorder are not read."""
    sets = {name: Q if name == which.split()[-1] else Q + 0.5 for name in which.split()}
    header = [*(f"{name}_q_{k}" for name in sets for k in range(6)), "target_qd_0", "robot_mode", "timestamp"]
    columns = [*np.hstack(list(sets.values())).T, np.full(23, np.pi), ["RUNNING"] * 23, 1e6 + TIMES]
    found = read(tmp_path, table(header, *columns, separator=separator))
    np.testing.assert_array_equal(found.values, Q)
    np.testing.assert_array_equal(found.times, 1e6 + TIMES)
    slower = read(tmp_path, table(header, *columns, separator=separator), columns="timestamp=[min]")
    np.testing.assert_array_equal(slower.values, Q)
    np.testing.assert_allclose(slower.times, 60 * found.times)
    assert "RTDE" in found.recorder
    # rows of a clock that counts far have names that tell them apart
    assert len(set(found.names)) == len(found.names)
    assert found.columns[0].heading == "timestamp"
    said = r"RTDE recorder .*--columns 'actual_q_0=j1 \[rad\], .*actual_q_5=j6 \[rad\], timestamp=t \[s\], \*=ignore'"
    if "actual" in which:
        with pytest.raises(InputError, match=said) as refused:
            read(tmp_path, table(header, *columns, separator=separator), OTHER)
        option = str(refused.value).split("--columns '")[1].split("'")[0]
        again = read(tmp_path, table(header, *columns, separator=separator), OTHER, option)
        np.testing.assert_array_equal(again.values, Q)
        np.testing.assert_array_equal(again.times, 1e6 + TIMES)


def rostopic(order, q, fingers=("finger",)):
    """Return what ``rostopic echo -p`` prints of joint states, joints in some order, and those of a gripper."""
    names = [*(UR[k] for k in order), *fingers]
    header = ["%time", "field.header.seq", "field.header.frame_id"]
    header += [f"field.{what}{k}" for what in ("name", "position", "velocity") for k in range(len(names))]
    values = [*(q[:, k] for k in order), *(np.full(23, 0.04) for _ in fingers)]
    stamps = [str(1_571_234_567_000_000_000 + 8_000_000 * k) for k in range(23)]
    zero = [["0"] * 23] * len(names)
    return table(header, stamps, ["7"] * 23, [""] * 23, *([name] * 23 for name in names), *values, *zero)


def test_rostopic_and_plotjuggler(tmp_path, monkeypatch):
    monkeypatch.setattr("precision_pin.robot.trajectory._AT_ONCE", 7)
    order = (2, 1, 0, 3, 4, 5)
    text = rostopic(order, Q)
    found = read(tmp_path, text)
    np.testing.assert_array_equal(found.values, Q)
    np.testing.assert_allclose(np.diff(found.times), 0.008, rtol=1e-4)
    assert "rostopic" in found.recorder
    header = ["__time", *(f"/joint_states/{UR[k]}/{what}" for what in ("velocity", "position") for k in order)]
    columns = [1571234567.5 + TIMES, *np.zeros((6, 23)), *Q[:, order].T]
    found = read(tmp_path, table(header, *columns))
    np.testing.assert_array_equal(found.values, Q)
    assert "PlotJuggler" in found.recorder
    # the corrected values go into columns that are read again
    assert [column.heading for column in found.columns[1:]] == [f"{UR[k]} [rad]" for k in order]
    # a message of other joints in between
    lines = text.split("\n")
    lines[20] = lines[20].replace(f"{UR[2]},{UR[1]}", f"{UR[1]},{UR[2]}")
    with pytest.raises(InputError, match=r":21: .*'shoulder_lift_joint', and in the first row 'elbow_joint'"):
        read(tmp_path, "\n".join(lines))


def test_columns_are_named_and_left_out(tmp_path):
    text = table(("clock", "note", "q1", "b", "n"), 1000 * TIMES, ["x"] * 23, np.degrees(Q[:, 0]), Q[:, 1], ["y"] * 23)
    text = text.replace(",b,", ",swing [old],")
    for columns in ("clock=t [ms], note=ignore, n=ignore, q1=a [deg]", "clock=t [ms], q1=a [deg], *=ignore"):
        found = read(tmp_path, text, TWO, columns)
        np.testing.assert_allclose(found.values, Q[:, :2], rtol=1e-14)
        np.testing.assert_allclose(found.times, TIMES, rtol=1e-14)
        assert [column.heading for column in found.columns] == ["t [ms]", "a [deg]", "swing [old]"]
    with pytest.raises(InputError, match="there is no column 'swing'"):
        read(tmp_path, text, TWO, "swing=swing [rad], *=ignore")
    # the name in the file with its unit, or without
    whole = table(("q1 [deg]", "q2 [deg]"), *np.degrees(Q[:, :2]).T)
    np.testing.assert_allclose(read(tmp_path, whole, arm(("a", "b")), "q1 [deg]=a, q2=b").values, Q[:, :2], rtol=1e-14)
    bare = table(("a", "swing [old]"), *np.degrees(Q[:, :2]).T)
    np.testing.assert_allclose(read(tmp_path, bare, TWO, "*=[deg]").values, Q[:, :2], rtol=1e-14)


def test_an_option_for_several_files_gives_each_its_own(tmp_path):
    """Of columns that only the other file has nothing is expected; a slip is in the first."""
    own, other = str(tmp_path / "way.csv"), str(tmp_path / "data.csv")
    (tmp_path / "way.csv").write_text("q1,q2 [deg]\n1,2\n")
    (tmp_path / "data.csv").write_text("q1;px [mm]\n1;2\n")
    text = "q1=a [deg], q2=b, px=x, slip=y, *=[mm rad]"
    for_own, for_other = (
        csv_columns.ColumnNames.parse(csv_columns.columns_for(one, text, [own, other])) for one in (own, other)
    )
    assert set(for_own.names) == {"q1", "q2", "slip"}
    assert set(for_other.names) == {"q1", "px", "slip"}
    assert for_own.units == for_other.units == ("mm", "rad")
    assert csv_columns.columns_for(own, text, [own]) == text
    # what the sheet says of readings names columns of a trajectory, and gives no unit to those it does not name
    usual = csv_columns.ColumnNames.parse(csv_columns.columns_for(own, None, [own], [text, "q2=b"]))
    assert (set(usual.names), usual.units) == ({"q1", "q2"}, ())


# whole turns ---------------------------------------------------------------------------------------------------------


def test_whole_turns_are_taken_off_on_request_only(tmp_path):
    q = [np.radians(359.9997), -3.0 - 2 * np.pi, 2.0, 3.2, -10.0, 3.0 + 5e-6]
    inside = [np.radians(-0.0003), -3.0, 2.0, 3.2 - 2 * np.pi, -10.0 + 4 * np.pi, 3.0 + 5e-6]
    wrapping = replace(ARM, wraps=True)
    assert ARM.configuration(q).tolist() == q
    # 3.2 less a turn is -3.08, outside as well
    inside[3] = 3.2
    np.testing.assert_allclose(wrapping.configuration(q), inside, atol=1e-14)
    np.testing.assert_allclose(wrapping.configurations.many([q])[:, 0], inside, atol=1e-14)
    np.testing.assert_allclose(wrapping.at(q).pose, ARM.at(q).pose, atol=1e-14)
    text = table([f"{name} [rad]" for name in UR], *np.array([q]).T)
    np.testing.assert_allclose(read(tmp_path, text, wrapping).values, [inside], atol=1e-14)
    (first, *others) = [finding.message for finding in ARM.at(q).findings]
    assert first.endswith("; a whole turn less, -0.0003 deg, is inside: --wrap takes poses so")
    assert [message.count("whole turn") for message in others] == [1, 0, 1]
    assert "2 whole turns more" in others[2]
    sliding = chain_of(
        robot(link("a"), link("b"), joint("s", "prismatic", "a", "b", axis=(1, 0, 0), extra=limits(-1, 1)))
    )
    assert replace(sliding, wraps=True).configuration([7.0]) == [7.0]
