"""What YAML and files can do to a sheet: one clear line; and large, deep or hostile ones cost what they say."""

import importlib
import itertools
import multiprocessing
import os
import pkgutil
import re
import sys
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from fuzzing.errorsheets.grammar import write_files
from fuzzing.errorsheets.trial import sheet_of, try_sheet
from scipy.linalg import block_diag

import precision_pin as pp
from precision_pin import Correlation, Disc, Draw, ErrorModel, JointNormal, Normal, Uniform
from precision_pin.base import csv_columns
from precision_pin.base.errors import InputError, SheetError
from precision_pin.draws.space import Extension, Space
from precision_pin.sheet import read
from precision_pin.sheet.text import edited_yaml, read_text, written_yaml

HEAD = "precision-pin: 1\nrobot: 4dof.urdf\n"


def test_every_scalar_stays_text():
    for word in ("1e-4", "on", "yes", "12:30:00", "0x1F", "1_000", "~", "null", ".nan", "2024-01-01", "010"):
        assert read_text(f"a: {word}\nb: ['{word}', \"{word}\"]\n", "f").data == {"a": word, "b": [word, word]}


def test_exponents_are_numbers_and_words_are_names(load):
    text = HEAD + "poses: {on: 1e-4 1E-4 -1e-4 +1e-4 rad, yes: 0 0 0 0 rad, 12: 0 0 0 0 rad}\n"
    sheet = load(text)
    assert list(sheet.poses) == ["on", "yes", "12"]
    assert sheet.poses["on"].tolist() == [1e-4, 1e-4, -1e-4, 1e-4]


def test_values_that_other_readers_would_take_for_numbers_are_refused(refuse):
    for value in ("12:30:00", "on", "0x1F mm", "1_000 mm", "~", ".inf mm", "010:5 mm"):
        found = refuse(HEAD + f"sources:\n  - axis_install: {{joint: joint2, radius: 0.1 mm, span: {value}}}\n")
        assert [finding.line for finding in found] == [4], value


def test_lines_of_every_key_and_item():
    text = read_text("a: 1\nb:\n  - x\n  - y: 2\n    z:\n\n      - 3\n# c\nc: {d: 4,\n  e: 5}\n", "f")
    expected = {("a",): 1, ("b",): 2, ("b", 0): 3, ("b", 1): 4, ("b", 1, "y"): 4, ("b", 1, "z"): 5}
    expected |= {("b", 1, "z", 0): 7, ("c",): 9, ("c", "d"): 9, ("c", "e"): 10}
    assert {path: line for path, line in text.lines.items() if path} == expected
    assert text.line(("c", "e", "nowhere")) == 10
    assert text.line(("nowhere",)) == text.line(())


def test_anchors_stand_for_what_they_name_and_may_be_set_again(load):
    sheet = load(HEAD + "parameters:\n  a: &tight {uniform: 1 mm}\n  b: *tight\n")
    assert sheet.space.draws[0].law == sheet.space.draws[1].law
    assert read_text("a: &x 1\nb: *x\nc: &x 2\nd: *x\n", "f").data == {"a": "1", "b": "1", "c": "2", "d": "2"}


NO_SHEETS = [
    ("poses:\n\tp: 0 0 0 0 deg\n", 4, "not YAML"),
    ("tip: !foo tool\n", 3, "tag"),
    ("!foo tip: tool\n", 3, "tag"),
    ("tip: !!binary dG9vbA==\n", 3, "tag"),
    ("tip: tool\n---\na: 1\n", 4, ""),
    ("tip: 'tool\n", None, "not YAML"),
    ("tip: [tool\n", None, "not YAML"),
    ("  tip: tool\n", 3, "not YAML"),
    ("tip: *nothing\n", 3, ""),
    ("tip: @tool\n", 3, "not YAML"),
    ("? [a, b]\n: 3\n", 3, ""),
    ("? {a: b}\n: 3\n", 3, ""),
    ("tip: a\0b\n", None, ""),
    ("x: " + "[" * 40 + "]" * 40 + "\n", 3, ""),
    ("x: " + "[" * 20_000 + "\n", 3, ""),
    ("x:\n" + "".join(" " * k + "a:\n" for k in range(1, 60)), None, ""),
    ("x: &a [*a]\n", 3, "is inside its own anchor"),
    ("x: &a {b: *a}\n", 3, "is inside its own anchor"),
    ('tip: "\\UFFFFFFFF"\n', 1, "not YAML"),
    ('tip: "\\ud800"\n', 3, "surrogate"),
    ('"\\ud800": tool\n', 3, "surrogate"),
    ("poses:\n  <<: {joint1: 1 deg}\n", 4, "merge keys"),
    ("tip: " + "%YAML 1.1\n---\n", 3, "not YAML"),
]


@pytest.mark.fast(10)
@pytest.mark.parametrize(("text", "line", "message"), NO_SHEETS, ids=[repr(row[0])[:40] for row in NO_SHEETS])
def test_yaml_that_is_no_sheet(refuse, text, line, message):
    start = time.perf_counter()
    found = refuse(HEAD + text)
    assert time.perf_counter() - start < 5
    assert any(finding.code == "E_YAML" for finding in found) or message in ("merge keys", "surrogate")
    assert line is None or found[0].line == line
    assert message in found[0].message


@pytest.mark.slow
def test_aliases_of_aliases_are_stopped(refuse):
    text = "x0: &x0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n"
    for k in range(1, 9):
        text += f"x{k}: &x{k} [{', '.join([f'*x{k - 1}'] * 10)}]\n"
    start = time.perf_counter()
    (finding,) = refuse(HEAD + text)
    assert time.perf_counter() - start < 5
    assert "too large or too deep" in finding.message


def test_what_is_no_mapping_says_how_a_sheet_begins(refuse):
    for text in ("", "# only a comment\n", "hello", "- 1\n- 2\n", "---\n...\n"):
        (finding,) = refuse(text)
        assert "precision-pin: 1" in finding.message
    assert [finding.code for finding in refuse("{}")] == ["E_MISSING_KEY", "E_MISSING_KEY"]


# files ---------------------------------------------------------------------------------------------------------------


def test_files_that_are_no_text_or_too_large_or_no_files(tmp_path):
    os.mkfifo(tmp_path / "pipe.yaml")
    (tmp_path / "loop.yaml").symlink_to(tmp_path / "loop.yaml")
    written = {
        "bytes.yaml": (bytes(range(256)), "not UTF-8"),
        "utf16.yaml": ("precision-pin: 1\n".encode("utf-16"), "not UTF-8"),
        "large.yaml": (b"#" * (4 * 2**20 + 1), "larger than 4 MiB"),
    }
    for name, (content, _) in written.items():
        (tmp_path / name).write_bytes(content)
    said = {name: words for name, (_, words) in written.items()}
    said |= {
        ".": "not a regular file",
        "none.yaml": "does not exist",
        "pipe.yaml": "not a regular file",
        "loop.yaml": "",
    }
    for name, words in {**said, "a\0b.yaml": "", "x" * 5000: ""}.items():
        start = time.perf_counter()
        with pytest.raises(SheetError) as caught:
            read(tmp_path / name)
        assert time.perf_counter() - start < 0.5
        (finding,) = caught.value.findings
        assert (finding.code, words in finding.message) == ("E_FILE", True)


@pytest.mark.slow
def test_a_sheet_of_very_many_entries_is_refused_soon(tmp_path, monkeypatch):
    path = tmp_path / "sheet.yaml"
    monkeypatch.setattr("precision_pin.sheet.text.MOST_NODES", 10_000)
    path.write_text("x: [" + "1," * 11_000 + "1]\n")
    start = time.perf_counter()
    with pytest.raises(SheetError, match="too large"):
        read(path)
    assert time.perf_counter() - start < 15


def test_byte_order_mark_and_other_line_ends(load, folder):
    path = folder / "windows.yaml"
    path.write_bytes(b"\xef\xbb\xbf" + (HEAD + "poses: {p: 0 0 0 0 deg}\n").replace("\n", "\r\n").encode())
    assert list(read(path).poses) == ["p"]


def test_robots_that_cannot_be_read(write):
    for robot in ("none.urdf", ".", "../4dof.urdf/x", "sheet.yaml", "example:nothing", "a\\0b", "~"):
        with pytest.raises(InputError) as caught:
            read(write(f"precision-pin: 1\nrobot: '{robot}'\n"))
        assert all("\n" not in str(finding) for finding in caught.value.findings)


# changed sheets ------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_small_share_of_the_changed_sheets(tmp_path):
    """``python -m fuzzing sheets`` tries more of them."""
    write_files(tmp_path)
    outcomes = [try_sheet(7, number, tmp_path) for number in range(20)]
    problems = [problem for outcome in outcomes for problem in outcome.problems]
    assert problems == []
    assert 20 / 6 < sum(outcome.accepted for outcome in outcomes) < 20 * 5 / 6


# large text --------------------------------------------------------------------------------------


def outcome(text):
    try:
        found = read_text(text, "f")
    except SheetError as error:
        return str(error)
    return found.data, list(found.lines.items()), found.findings


@pytest.mark.slow
def test_text_without_findings_is_read_by_libyaml(monkeypatch):
    text = HEAD + "sources:\n" + "- {a: [1, x y], b: 'é'}  # ± 10 %\n" * 2000
    monkeypatch.setitem(sys.modules, "ruamel.yaml", None)
    found = read_text(text, "f")
    assert found.data["sources"] == [{"a": ["1", "x y"], "b": "é"}] * 2000
    assert (found.line(("sources", 1999, "a", 1)), len(found.lines)) == (2003, 3 + 1 + 2000 * 5)


@pytest.mark.slow
def test_libyaml_reads_what_the_pure_parser_reads(monkeypatch):
    texts = [path.read_text() for path in Path("src/precision_pin/robots").glob("*.yaml")]
    texts += [sheet_of(3, number)[0].decode("utf-8", "replace") for number in range(60)]
    texts += [
        "a: {: 1}\n", "a: {b: 1, :c: d}\n", f"{'a' * 1030}: 1\n", "a:\tb\n", "- \tx: 1\n", "a: b\x85c: d\n", "a: 'b\u2028 c'\n",
        "a: b\rc: d\n", "%YAML 1.1\n---\na: b\n", "\ufeffa: b\n", "a: !t b\n", "a: 1\na: 2\n", "a: *b\n", "a: [b\n",
        "a: 5 %\n", "a: %b\n", "a: [%b, c%]\n", "a: b\n %c\n", "a: |\n %b\n", "a: |\n%b\n", "a: b\n%c\n", "# d\n%e: f\n",
        "a: b\n---\nc: d\n", '"a\\x41\\\n  b": c\n', "? a\n: b\n", "- - a\n  - b\n-\n", "",
        "a: &x {b: 1}\nc: *x\n", "a: |\n  b\n\n  c\nd: >-\n  e\n  f\n",
        "|# a\n", "- >-2# a\n", "# a\n---\n b\n", "a: b\n...\n# c\n", "&a:\n  b\n", "&a://b\n", "{a:&b c}\n", "a: [*b:, c]\n",
        'a: [b, "c":]\n', ">\n#\n", "a: " + "[" * 14 + "]" * 14 + "\n", 'a: "\\ud800"\n', "a: \ud800\n",
    ]  # fmt: skip
    quick = list(map(outcome, texts))
    monkeypatch.setattr("precision_pin.sheet.text._read_with_libyaml", lambda *_: None)
    assert [text for text, found in zip(texts, quick, strict=True) if outcome(text) != found] == []


# costs ---------------------------------------------------------------------------------------------------------------


def many(count):
    parameters = "".join(f"  p{k}: {{uniform: 0.{k % 9 + 1} mrad}}\n" for k in range(count))
    sources = "".join(f"- joint_offset: {{joint: joint{k % 4 + 1}, offset: p{k}}}\n" for k in range(count))
    poses = "".join(f"  p{k}: 10 20 30 {k % 90} deg\n" for k in range(count))
    return f"{HEAD}poses:\n{poses}parameters:\n{parameters}sources:\n{sources}"


@pytest.mark.slow
def test_reading_takes_time_in_proportion_to_what_is_read(load):
    spent = []
    for count in (300, 2400):
        start = time.process_time()
        load(many(count))
        spent.append(time.process_time() - start)
    assert spent[1] < 20 * spent[0]  # 64 if it grew with the square
    assert spent[1] < 8


@pytest.mark.slow
def test_a_model_takes_memory_in_proportion_to_its_numbers(load):
    model = ErrorModel.from_sheet(load(many(1500)))
    tracemalloc.start()
    at = model.at()
    e0, jacobian = at.tangent
    covariance = at.covariance
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 40e6  # a square of numbers is 18 MB, a cube 27 GB
    assert e0.shape == (6,)
    # all of one joint have its column; uniform laws have a third of the squared half-width
    by_joint = [sum((1e-4 * (k % 9 + 1)) ** 2 / 3 for k in range(j, 1500, 4)) for j in range(4)]
    expected = sum(v * np.outer(jacobian[:, j], jacobian[:, j]) for j, v in enumerate(by_joint))
    np.testing.assert_allclose(covariance, expected, rtol=1e-11, atol=1e-24)


def test_block_covariance_is_that_of_the_whole_matrix():
    generator = np.random.default_rng(1)
    root = generator.normal(size=(2, 2))
    draws = (
        Draw("a", Normal(2.0)), Draw("disc", Disc(3.0)), Draw("b", Uniform(1.5)), Draw("c", Normal(0.5)),
        Draw("pair", JointNormal(tuple(map(tuple, (root @ root.T).tolist())))),
    )  # fmt: skip
    space = Space(draws, (Correlation.pair("c", "a", 0.25),))
    whole = block_diag(4.0, np.eye(2) * 9 / 4, 1.5**2 / 3, 0.25, root @ root.T)
    whole[0, 4] = whole[4, 0] = 0.25 * 2.0 * 0.5
    blocks = space.block_covariance
    one, other, factors = generator.normal(size=(3, 7)), generator.normal(size=(4, 7)), generator.normal(size=7)
    chosen = [4, 6, 0, 2]
    for found, expected in (
        (space.covariance, whole),
        (blocks.between(one, other), one @ whole @ other.T),
        (blocks.variances_of(one), np.diag(one @ whole @ one.T)),
        (blocks.within(chosen), whole[np.ix_(chosen, chosen)]),
        (blocks.scaled(factors).dense, whole * np.outer(factors, factors)),
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-13)


def test_a_group_of_draws_that_cannot_be_added_leaves_the_others_be():
    extension = Extension(Space((Draw("a", Normal(1.0)),)))
    extension.add([Draw("a", Normal(1.0)), Draw("b", Uniform(1.0))])
    for wrong in (Draw("a", Normal(2.0)), Draw("b", Normal(1.0))):
        with pytest.raises(InputError, match="given twice"):
            extension.add([Draw("new", Normal(1.0)), wrong])
    extension.add([Draw("d", Disc(1.0))])
    with pytest.raises(InputError, match=r"two random numbers are named 'd\.x'"):
        extension.add([Draw("d.x", Normal(1.0))])
    assert extension.space().components == ("a", "b", "d.x", "d.y")


@pytest.mark.slow
def test_very_many_errors_are_not_all_listed(refuse):
    start = time.process_time()
    found = refuse(many(1500).replace("offset: p", "offset: q"))
    assert time.process_time() - start < 8
    assert len(found) == 101
    assert [finding.line for finding in found[:100]] == list(range(3006, 3106))
    assert "more than 100 errors" in found[-1].message


# tables ------------------------------------------------------------------------------------------


def test_rows_read_at_once_are_those_read_one_by_one(tmp_path):
    generator = np.random.default_rng(0)
    written = [
        [f"{a:.17g}", f"{b:+.3e}"]
        for a, b in generator.normal(size=(500, 2)) * 10.0 ** generator.integers(-300, 300, (500, 1))
    ]
    path = tmp_path / "table.csv"
    path.write_text("x [mm], y [mm]\n" + "\n# more\n".join(f" {a} ,{b}" for a, b in written) + "\n")
    expected = [[float(a), float(b)] for a, b in written]
    np.testing.assert_array_equal(csv_columns.read(path).rows, expected)
    # one cell in quotes: line by line
    path.write_text(path.read_text().replace(written[7][1], f'"{written[7][1]}"'))
    np.testing.assert_array_equal(csv_columns.read(path).rows, expected)
    # lines may end in a carriage return alone
    path.write_bytes(b"\xef\xbb\xbfx [mm]\r1\r2\r")
    np.testing.assert_array_equal(csv_columns.read(path).rows, [[1.0], [2.0]])


def test_tables_that_are_none(tmp_path):
    path = tmp_path / "table.csv"
    for text, message in (
        (" " * 50_000 + "x[\n1\n", "does not name a column"),
        ("x [mm]\n" + "1" * 200_000 + "\n", "field larger than field limit|is not a number"),
        *((f"x [mm]\n{cell}\n", "is not a number") for cell in ("1e999", "1_000", "٣", "nan", "1\0")),
        ('x [mm]\n"1\n', "quotation mark"),
        ("x [mm]; y [mm]\n1;2;3\n", "3 cells"),
        ("x [mm],y [mm]\n1,2,\n", "3 cells"),
        (",".join(f"x{k}" for k in range(2000)) + "\n1\n", "at most 1,000"),
        ("x [mm]\n", "no rows"),
    ):
        path.write_text(text, encoding="utf-8")
        start = time.process_time()
        with pytest.raises(InputError, match=message) as caught:
            csv_columns.read(path)
        assert time.process_time() - start < 1
        assert len(str(caught.value)) < 400 + len(str(path))


# regular expressions -----------------------------------------------------------------------------

PIECES = (
    " ", "\t", "0", "1", "a", ".", "-", "+", "e", "1e", "1.", "@", "%", "/", "[", "]", "a ", "a. ", "1 ", ", ", "<", "'", '"',
    "x=", "#", ":", "://", " of ", "x of ", "\n", "é", "²", "nan", "__", "a_", "./", "example:a",
)  # fmt: skip


def _match_all(patterns):
    for pattern in patterns:
        for piece, start, end in itertools.product(PIECES, ("", "a"), ("!", "]")):
            text = start + piece * (50_000 // len(piece)) + end
            pattern.fullmatch(text.encode() if isinstance(pattern.pattern, bytes) else text)


@pytest.mark.slow
def test_no_regular_expression_takes_long_over_any_text():
    """Those that are searched for inside a text see the package's own output, or a tag that an XML parser took."""
    patterns = set()
    for found in pkgutil.walk_packages(pp.__path__, "precision_pin."):
        if not ("robots" in found.name or found.name.endswith("__main__") or ".view" in found.name):
            values = vars(importlib.import_module(found.name)).values()
            patterns |= {value for value in values if isinstance(value, re.Pattern)}
    assert len(patterns) > 15
    process = multiprocessing.get_context("fork").Process(target=_match_all, args=(patterns,), daemon=True)
    process.start()
    process.join(60)
    alive = process.is_alive()
    process.kill()
    assert not alive


# what a machine cannot hold ----------------------------------------------------------------------


def test_a_covariance_that_a_machine_cannot_hold_is_refused_at_once(monkeypatch):
    monkeypatch.setattr("precision_pin.base.arguments.available_memory", lambda: 10**6)
    monkeypatch.setattr("precision_pin.base.arguments._UNCHECKED", 0)
    with pytest.raises(InputError, match="of memory are free"):
        _ = Space(tuple(Draw(f"a{k}", Normal(1.0)) for k in range(1000))).covariance
    with pytest.raises(InputError, match="at most 500"):
        Correlation(tuple(map(str, range(501))), ((1.0,),))


@pytest.mark.slow
def test_analyses_that_take_hours_are_refused_at_once(load):
    few = ErrorModel.from_sheet(load(many(4)))
    wide = ErrorModel(
        few.chain, Space(tuple(Draw(f"a{k}", Normal(1.0)) for k in range(10_001))), few.sources[:0], few.poses
    )
    with pytest.raises(InputError, match=r"a budget of 10,001 draws evaluates the model 4\.9e\+08 times"):
        pp.budget(wide)
    with pytest.raises(InputError, match="a worst case of 10,001 random numbers"):
        pp.worst_case(wide)


COMMENTED = """\
# an arm, by hand
precision-pin: 1   # the format
robot: 4dof.urdf
poses: {paper: -90 3 88 -91 deg}  # chain order

parameters:
    a1: {uniform: 0.05 mm}          # drawing 12
    # of two values
    a3: "±0.05 mm"
    b: &b ±1 mm
sources:
- length: {joint: joint2, parameters: [a1, ±0.1 mm]}  # flow
- length:
    frame: tool
    parameters: 1 ± 0.3 mm
- length: {joint: joint3, parameters: *b}
"""


def test_an_edited_sheet_keeps_comments_order_and_style():
    """Only the values that differ change, and new keys follow: compared with the same edits by hand."""
    data = read_text(COMMENTED, "").data
    data["parameters"] |= {"a1": {"uniform": "0.0127 mm"}, "a3": "±0.04 mm"}
    data["sources"][0]["length"]["parameters"] = ["a1", {"normal": "0.2 mm", "k": "2"}]
    data["sources"][1]["length"]["parameters"] = "1 ± 0.25 mm"
    data |= {"robot": "../arm #2.urdf", "provenance": {"parameters.a1": {"measured": "12 robots"}}}
    by_hand = COMMENTED
    for old, new in (
        ("{uniform: 0.05 mm} ", "{uniform: 0.0127 mm} "), ('"±0.05 mm"', "±0.04 mm"), ("1 ± 0.3 mm", "1 ± 0.25 mm"),
        ("[a1, ±0.1 mm]", '[a1, {"normal": "0.2 mm", "k": "2"}]'), ("4dof.urdf", '"../arm #2.urdf"'),
    ):  # fmt: skip
        assert by_hand.count(old) == 1
        by_hand = by_hand.replace(old, new)
    assert edited_yaml(COMMENTED, data) == by_hand + "provenance:\n  parameters.a1:\n    measured: 12 robots\n"
    # what stands below an anchor changes for one user of it only: written anew
    data["parameters"]["b"] = "±2 mm"
    assert read_text(edited_yaml(COMMENTED, data), "").data == data
    assert written_yaml(data).startswith("precision-pin: 1\n")
