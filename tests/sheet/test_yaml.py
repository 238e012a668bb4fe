"""What YAML and files can do to a sheet: nothing but one clear line."""

import json
import os
import time
from pathlib import Path

import pytest
from fuzzing.errorsheets.trial import sheet_of
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from precision_pin.base.errors import Finding, InputError, SheetError
from precision_pin.sheet import read
from precision_pin.sheet.text import read_text

from .conftest import Load, Refuse, Write
from .test_contract import CONTRACT

HEAD = "precision-pin: 1\nrobot: 4dof.urdf\n"


@pytest.mark.parametrize(
    "word", ["1e-4", "on", "yes", "12:30:00", "0x1F", "1_000", "~", "null", ".nan", "2024-01-01", "010"]
)
def test_every_scalar_stays_text(word: str) -> None:
    assert read_text(f"a: {word}\n", "f").data == {"a": word}
    assert read_text(f"a: ['{word}', \"{word}\"]\n", "f").data == {"a": [word, word]}


def test_exponents_are_numbers_and_words_are_names(load: Load) -> None:
    text = HEAD + "poses: {on: 1e-4 1E-4 -1e-4 +1e-4 rad, yes: 0 0 0 0 rad, 12: 0 0 0 0 rad}\n"
    sheet = load(text)
    assert list(sheet.poses) == ["on", "yes", "12"]
    assert sheet.poses["on"].tolist() == [1e-4, 1e-4, -1e-4, 1e-4]


@pytest.mark.parametrize(
    "value", ["12:30:00", "on", "0x1F mm", "1_000 mm", "~", "null", ".nan mm", ".inf mm", "010:5 mm"]
)
def test_values_that_other_readers_would_take_for_numbers_are_refused(refuse: Refuse, value: str) -> None:
    found = refuse(HEAD + f"sources:\n  - axis_install: {{joint: joint2, radius: 0.1 mm, span: {value}}}\n")
    assert [finding.line for finding in found] == [4]


def test_lines_of_every_key_and_item() -> None:
    text = read_text("a: 1\nb:\n  - x\n  - y: 2\n    z:\n\n      - 3\n# c\nc: {d: 4,\n  e: 5}\n", "f")
    expected = {("a",): 1, ("b",): 2, ("b", 0): 3, ("b", 1): 4, ("b", 1, "y"): 4, ("b", 1, "z"): 5}
    expected |= {("b", 1, "z", 0): 7, ("c",): 9, ("c", "d"): 9, ("c", "e"): 10}
    assert {path: line for path, line in text.lines.items() if path} == expected
    assert text.line(("c", "e", "nowhere")) == 10
    assert text.line(("nowhere",)) == text.line(())


def test_anchors_stand_for_what_they_name(load: Load) -> None:
    sheet = load(HEAD + "parameters:\n  a: &tight {uniform: 1 mm}\n  b: *tight\n")
    assert sheet.space.draws[0].law == sheet.space.draws[1].law


def test_merge_keys_are_not_known(refuse: Refuse) -> None:
    found = refuse(HEAD + "parameters:\n  a: &t {uniform: 1 mm}\n  b:\n    <<: *t\n    mean: 1 mm\n")
    assert [(finding.line, "'<<'" in finding.message) for finding in found] == [(5, True)]


@pytest.mark.fast(12)
@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("poses:\n\tp: 0 0 0 0 deg\n", 4),
        ("tip: !foo tool\n", 3),
        ("!foo tip: tool\n", 3),
        ("tip: !!python/object/apply:os.system [echo]\n", 3),
        ("tip: !!binary dG9vbA==\n", 3),
        ("poses: !!omap [a: 0 0 0 0 deg]\n", 3),
        ("tip: tool\n---\na: 1\n", 4),
        ("tip: 'tool\n", None),
        ("tip: [tool\n", None),
        ("  tip: tool\n", 3),
        ("tip: a: b\n", 3),
        ("tip: *nothing\n", 3),
        ("tip: @tool\n", 3),
        ("tip: %tool\n", 3),
        ("? [a, b]\n: 3\n", 3),
        ("? {a: b}\n: 3\n", 3),
        ("tip: a\0b\n", None),
        ("tip: a\x07b\n", None),
        ("x: " + "[" * 40 + "]" * 40 + "\n", 3),
        ("x: " + "{a: " * 40 + "1" + "}" * 40 + "\n", 3),
        ("x: " + "[" * 20_000 + "\n", 3),
        ("x:\n" + "".join(" " * k + "a:\n" for k in range(1, 60)), None),
        ("x: &a [*a]\n", 3),
        ("x: &a {b: *a}\n", 3),
    ],
    ids=lambda value: repr(value)[:40],
)
def test_yaml_that_is_no_sheet(refuse: Refuse, text: str, line: int | None) -> None:
    start = time.perf_counter()
    found = refuse(HEAD + text)
    assert time.perf_counter() - start < 5
    assert found[0].code in ("E_YAML", "E_UNKNOWN_KEY")
    assert any(finding.code == "E_YAML" for finding in found)
    if line is not None:
        assert found[0].line == line


@pytest.mark.slow
def test_aliases_of_aliases_are_stopped(refuse: Refuse) -> None:
    text = "x0: &x0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n"
    for k in range(1, 9):
        text += f"x{k}: &x{k} [{', '.join([f'*x{k - 1}'] * 10)}]\n"
    start = time.perf_counter()
    (finding,) = refuse(HEAD + text)
    assert time.perf_counter() - start < 5
    assert "too large or too deep" in finding.message


@pytest.mark.parametrize("text", ["", "\n\n", "# only a comment\n", "hello", "- 1\n- 2\n", "3.14", "[]", "---\n...\n"])
def test_what_is_no_mapping_says_how_a_sheet_begins(refuse: Refuse, text: str) -> None:
    (finding,) = refuse(text)
    assert "precision-pin: 1" in finding.message


def test_an_empty_mapping_misses_its_keys(refuse: Refuse) -> None:
    assert [finding.code for finding in refuse("{}")] == ["E_MISSING_KEY", "E_MISSING_KEY"]


# ---- files ----


def one_finding(path: Path | str) -> str:
    with pytest.raises(SheetError) as caught:
        read(path)
    (finding,) = caught.value.findings
    assert finding.code == "E_FILE"
    assert str(path) in str(finding)
    return finding.message


def test_files_that_are_no_text(tmp_path: Path) -> None:
    path = tmp_path / "sheet.yaml"
    path.write_bytes(bytes(range(256)))
    assert "not UTF-8" in one_finding(path)
    path.write_bytes("precision-pin: 1\n".encode("utf-16"))
    assert "not UTF-8" in one_finding(path)
    path.write_bytes(b"\x7fELF\x02\x01\x01" + b"\x00" * 100)
    with pytest.raises(SheetError):
        read(path)


def test_files_that_are_too_large_are_not_read(tmp_path: Path) -> None:
    path = tmp_path / "sheet.yaml"
    path.write_bytes(b"# comment\n" * 500_000)
    start = time.perf_counter()
    assert "larger than" in one_finding(path)
    assert time.perf_counter() - start < 0.5


@pytest.mark.slow
def test_a_sheet_of_very_many_entries_is_refused_soon(tmp_path: Path) -> None:
    path = tmp_path / "sheet.yaml"
    path.write_text("x: [" + "1," * 110_000 + "1]\n")
    start = time.perf_counter()
    with pytest.raises(SheetError, match="too large"):
        read(path)
    assert time.perf_counter() - start < 15


def test_what_is_no_regular_file(tmp_path: Path) -> None:
    assert "not a regular file" in one_finding(tmp_path)
    assert "does not exist" in one_finding(tmp_path / "none.yaml")
    os.mkfifo(tmp_path / "pipe.yaml")
    assert "not a regular file" in one_finding(tmp_path / "pipe.yaml")
    (tmp_path / "loop.yaml").symlink_to(tmp_path / "loop.yaml")
    with pytest.raises(SheetError):
        read(tmp_path / "loop.yaml")
    with pytest.raises(SheetError):
        read("a\0b.yaml")
    with pytest.raises(SheetError):
        read(tmp_path / ("x" * 5000))


def test_byte_order_mark_and_other_line_ends(load: Load, folder: Path) -> None:
    path = folder / "windows.yaml"
    path.write_bytes(b"\xef\xbb\xbf" + (HEAD + "poses: {p: 0 0 0 0 deg}\n").replace("\n", "\r\n").encode())
    assert list(read(path).poses) == ["p"]


@pytest.mark.parametrize("robot", ["none.urdf", ".", "../4dof.urdf/x", "sheet.yaml", "example:nothing", "a\\0b", "~"])
def test_robots_that_cannot_be_read(write: Write, robot: str) -> None:
    with pytest.raises(InputError) as caught:
        read(write(f"precision-pin: 1\nrobot: '{robot}'\n"))
    assert all("\n" not in str(finding) for finding in caught.value.findings)


# ---- fuzz ----

WORDS = [
    "uniform",
    "normal",
    "std",
    "mean",
    "k",
    "1 mm",
    "-1 mm",
    "1e999 mm",
    "0",
    "joint2",
    "a1",
    "tool",
    "{",
    "}",
    "[",
    "]",
]
WORDS += [
    ": ",
    "\n",
    "\n  ",
    "\n  - ",
    "- ",
    "&a ",
    "*a",
    "!x ",
    "? ",
    "| ",
    "> ",
    "'",
    '"',
    "#",
    "\t",
    ",",
    "~",
    "<<: ",
    "\u2028",
    "é",
]


def read_or_refused(path: Path) -> tuple[Finding, ...]:
    """Read a sheet and return its findings; anything else than a refusal passes on."""
    try:
        return read(path).findings
    except InputError as error:
        return error.findings


def edited(data: st.DataObject, text: str) -> str:
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(text)))
        cut = data.draw(st.integers(0, 12))
        text = text[:at] + data.draw(st.sampled_from(["", *WORDS])) + text[at + cut :]
    return text


@pytest.mark.slow
@settings(max_examples=80, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_an_edited_sheet_is_read_or_refused_but_never_crashes(write: Write, data: st.DataObject) -> None:
    text = edited(data, CONTRACT)
    for finding in read_or_refused(write(text)):
        assert "\n" not in str(finding)
        assert finding.line is None or 1 <= finding.line <= len(text.splitlines()) + 1


KEYS = ["uniform", "normal", "std", "mean", "joint", "at", "a1", "k", "scope", "disc", "joint_normal", "parameters"]
values = st.recursive(
    st.sampled_from(["1 mm", "-1 mm", "1", "a1", "tool", "joint2", "", "deg", "true", "z of joint1", "8000 N*m^2"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(KEYS), inner, max_size=3),
    max_leaves=6,
)
TOPS = ["tip", "base", "gravity", "statics", "locked", "poses", "parameters", "sources", "precision-pin", "robot", "x"]
KINDS = ["payload", "length", "axis_install", "beam", "joint_compliance", "frame", "joint_offset", "mcpc", "nothing"]
sources = st.lists(st.dictionaries(st.sampled_from(KINDS), values, min_size=1, max_size=2), max_size=3)


@pytest.mark.slow
@settings(max_examples=80, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.dictionaries(st.sampled_from(TOPS), values, max_size=4), st.none() | sources)
def test_any_structure_is_read_or_refused_but_never_crashes(
    write: Write, top: dict[str, object], listed: object
) -> None:
    # JSON is YAML
    contents = {"precision-pin": "1", "robot": "4dof.urdf"} | top
    if listed is not None:
        contents["sources"] = listed
    read_or_refused(write(json.dumps(contents, indent=1, ensure_ascii=False)))


# large text --------------------------------------------------------------------------------------


def outcome(text: str) -> object:
    try:
        found = read_text(text, "f")
    except SheetError as error:
        return str(error)
    return found.data, list(found.lines.items()), found.findings


@pytest.mark.slow
def test_large_text_is_read_by_libyaml(monkeypatch: pytest.MonkeyPatch) -> None:
    text = HEAD + "sources:\n" + "- {a: [1, x y], b: 'é'}  # ± 10 %\n" * 2000
    monkeypatch.delattr("precision_pin.sheet.text.YAML")
    found = read_text(text, "f")
    assert found.data["sources"] == [{"a": ["1", "x y"], "b": "é"}] * 2000
    assert (found.line(("sources", 1999, "a", 1)), len(found.lines)) == (2003, 3 + 1 + 2000 * 5)


@pytest.mark.slow
@pytest.mark.parametrize("count", [12, 150])
def test_libyaml_reads_what_the_pure_parser_reads(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    texts = [path.read_text() for path in Path("robots").glob("*.yaml")] if count > 12 else []
    texts += [sheet_of(3, number)[0].decode("utf-8", "replace") for number in range(count)]
    texts += [
        "a: {: 1}\n", "a: {b: 1, :c: d}\n", f"{'a' * 1030}: 1\n", "a:\tb\n", "- \tx: 1\n", "a: b\x85c: d\n", "a: 'b\u2028 c'\n",
        "a: b\rc: d\n", "%YAML 1.1\n---\na: b\n", "\ufeffa: b\n", "a: !t b\n", "a: 1\na: 2\n", "a: *b\n", "a: [b\n",
        "a: 5 %\n", "a: %b\n", "a: [%b, c%]\n", "a: b\n %c\n", "a: |\n %b\n", "a: |\n%b\n", "a: b\n%c\n", "# d\n%e: f\n",
        "a: b\n---\nc: d\n", '"a\\x41\\\n  b": c\n', "? a\n: b\n", "- - a\n  - b\n-\n", "",
        "a: &x {b: 1}\nc: *x\n", "a: |\n  b\n\n  c\nd: >-\n  e\n  f\n",
        "a: " + "[" * 14 + "]" * 14 + "\n", 'a: "\\ud800"\n', "a: \ud800\n",
    ]  # fmt: skip
    monkeypatch.setattr("precision_pin.sheet.text.LARGE", 0)
    quick = list(map(outcome, texts))
    monkeypatch.setattr("precision_pin.sheet.text.LARGE", 10**9)
    assert [text for text, found in zip(texts, quick, strict=True) if outcome(text) != found] == []
