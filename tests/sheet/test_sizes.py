"""Large, deep and hostile sheets: costs grow with what they say, and what would not end is refused."""

import importlib
import multiprocessing
import pkgutil
import re
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from fuzzing.errorsheets.grammar import write_files
from fuzzing.errorsheets.trial import try_sheet
from scipy.linalg import block_diag

import precision_pin
import precision_pin as pp
from precision_pin.base import csv_columns
from precision_pin.base.errors import InputError, SheetError, UnknownNameError
from precision_pin.draws.correlation import BlockCovariance, Correlation
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.laws import Disc, JointNormal, Normal, Uniform
from precision_pin.draws.space import Extension, Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.sheet import read
from precision_pin.sheet.text import read_text

from .conftest import Load, Refuse

HEAD = "precision-pin: 1\nrobot: 4dof.urdf\n"


def many(count: int) -> str:
    parameters = "".join(f"  p{k}: {{uniform: 0.{k % 9 + 1} mrad}}\n" for k in range(count))
    sources = "".join(f"- joint_offset: {{joint: joint{k % 4 + 1}, offset: p{k}}}\n" for k in range(count))
    return f"{HEAD}poses: {{a: 10 20 30 40 deg}}\nparameters:\n{parameters}sources:\n{sources}"


@pytest.mark.slow
def test_reading_takes_time_in_proportion_to_what_is_read(load: Load) -> None:
    spent = []
    for count in (300, 2400):
        start = time.process_time()
        load(many(count))
        spent.append(time.process_time() - start)
    assert spent[1] < 20 * spent[0]  # 64 if it grew with the square
    assert spent[1] < 8


@pytest.mark.slow
def test_a_number_is_found_among_many_as_soon_as_among_few() -> None:
    spent = []
    for count in (2000, 16_000):
        space = Space(tuple(Draw(f"a{k}", Normal(1.0)) for k in range(count)))
        assert space.parameter("a0").name == "a0"
        start = time.process_time()
        for k in range(0, count, count // 1000):
            space.parameter(f"a{k}")
        spent.append(time.process_time() - start)
    assert spent[1] < 4 * spent[0]  # 8 if every name was looked at


def test_numbers_drawn_together_are_those_drawn_one_by_one() -> None:
    laws = (Normal(1.0), Uniform(2.0), Disc(3.0), Normal(0.5, 1.0))
    draws = tuple(Draw(f"a{k}", laws[k % 4], (Scope.UNIT, Scope.VISIT)[k % 3 // 2]) for k in range(40))
    for first, count in ((0, 7), (3, 1000), (5, 0)):
        together = Space(draws).sample(5, first, count, pose=2, visit=1)
        alone = [Space((draw,)).sample(5, first, count, pose=2, visit=1) for draw in draws]
        np.testing.assert_array_equal(together, np.concatenate(alone))


@pytest.mark.slow
def test_a_model_takes_memory_in_proportion_to_its_numbers(load: Load) -> None:
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


def test_block_covariance_is_that_of_the_whole_matrix() -> None:
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
    assert isinstance(blocks, BlockCovariance)
    np.testing.assert_allclose(space.covariance, whole, rtol=1e-14)
    one, other = generator.normal(size=(3, 7)), generator.normal(size=(4, 7))
    np.testing.assert_allclose(blocks.between(one, other), one @ whole @ other.T, rtol=1e-13)
    np.testing.assert_allclose(blocks.variances_of(one), np.diag(one @ whole @ one.T), rtol=1e-13)
    chosen = [4, 6, 0, 2]
    np.testing.assert_allclose(blocks.within(chosen), whole[np.ix_(chosen, chosen)], rtol=1e-14)
    factors = generator.normal(size=7)
    np.testing.assert_allclose(blocks.scaled(factors).dense, whole * np.outer(factors, factors), rtol=1e-13)


def test_a_group_of_draws_that_cannot_be_added_leaves_the_others_be() -> None:
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
def test_very_many_errors_are_not_all_listed(refuse: Refuse) -> None:
    start = time.process_time()
    found = refuse(many(1500).replace("offset: p", "offset: q"))
    assert time.process_time() - start < 8
    assert len(found) == 101
    assert [finding.line for finding in found[:100]] == list(range(1506, 1606))
    assert "more than 100 errors" in found[-1].message


def test_hints_are_found_among_very_many_names() -> None:
    names = [f"joint{k:05}" for k in range(30_000)]
    start = time.process_time()
    error = UnknownNameError("joint", "joint0777", names)
    UnknownNameError("joint", "x" * 100_000, ["x" * 99_999])
    assert time.process_time() - start < 2
    assert "did you mean" in str(error)


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ('tip: "\\UFFFFFFFF"\n', 1, "not YAML"),
        ('tip: "\\ud800"\n', 3, "surrogate"),
        ('"\\ud800": tool\n', 3, "surrogate"),
        ("poses:\n  <<: {joint1: 1 deg}\n", 4, "merge keys"),
        ("x: &a [[*a]]\n", 3, "is inside its own anchor"),
        ("tip: " + "%YAML 1.1\n---\n", 3, "not YAML"),
    ],
)
def test_what_yaml_allows_and_a_sheet_does_not(refuse: Refuse, text: str, line: int, message: str) -> None:
    found = refuse(HEAD + text)
    assert (found[0].line, message in found[0].message) == (line, True)


def test_an_anchor_may_be_set_again() -> None:
    assert read_text("a: &x 1\nb: *x\nc: &x 2\nd: *x\n", "f").data == {"a": "1", "b": "1", "c": "2", "d": "2"}


# tables ------------------------------------------------------------------------------------------


def test_rows_read_at_once_are_those_read_one_by_one(tmp_path: Path) -> None:
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


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (" " * 50_000 + "x[\n1\n", "does not name a column"),
        ("x" + " " * 100_000 + "[\n1\n", "does not name a column"),
        ("x [mm]\n" + "1" * 200_000 + "\n", "field larger than field limit|is not a number"),
        ("x [mm]\n" + "9" * 5000 + "\n", "is not a number"),
        ("x [mm]\n1e999\n", "is not a number"),
        ("x [mm]\n1_000\n", "is not a number"),
        ("x [mm]\n٣\n", "is not a number"),
        ("x [mm]\nnan\n", "is not a number"),
        ("x [mm]\n1\0\n", "is not a number"),
        ('x [mm]\n"1\n', "quotation mark"),
        ("x [mm]; y [mm]\n1;2\n", "commas"),
        ("x [mm],y [mm]\n1,2,\n", "3 cells"),
        ("x [mm],y [mm]\n1,\n", "is not a number"),
        ("x [mm]\n1 2\n", "is not a number"),
        (",".join(f"x{k}" for k in range(2000)) + "\n1\n", "at most 1,000"),
        ("x [mm]\n", "no rows"),
    ],
    ids=lambda value: repr(value)[:30],
)
def test_tables_that_are_none(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "table.csv"
    path.write_text(text, encoding="utf-8")
    start = time.process_time()
    with pytest.raises(InputError, match=message) as caught:
        csv_columns.read(path)
    assert time.process_time() - start < 1
    assert len(str(caught.value)) < 400 + len(str(path))


def test_lines_may_end_in_a_carriage_return_alone(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_bytes(b"\xef\xbb\xbfx [mm]\r1\r2\r")
    np.testing.assert_array_equal(csv_columns.read(path).rows, [[1.0], [2.0]])


# regular expressions -----------------------------------------------------------------------------

PIECES = (
    " ", "\t", "0", "1", "a", ".", "-", "+", "e", "1e", "1.", "@", "%", "/", "[", "]", "a ", "a. ", "1 ", ", ", "<", "'", '"',
    "x=", "#", ":", "://", " of ", "x of ", "\n", "é", "²", "nan", "__", "a_", "./", "example:a",
)  # fmt: skip


def _match_all(names: list[tuple[str, str]]) -> None:
    for module, name in names:
        pattern = getattr(importlib.import_module(module), name)
        for piece in PIECES:
            for start in ("", "a"):
                for end in ("!", "]"):
                    text = start + piece * (50_000 // len(piece)) + end
                    pattern.fullmatch(text.encode() if isinstance(pattern.pattern, bytes) else text)


@pytest.mark.slow
def test_no_regular_expression_takes_long_over_any_text() -> None:
    """Those that are searched for inside a text see the package's own output, or a tag that an XML parser took."""
    names = []
    for found in pkgutil.walk_packages(precision_pin.__path__, "precision_pin."):
        if "robots" in found.name or found.name.endswith("__main__") or ".view" in found.name:
            continue
        module = importlib.import_module(found.name)
        names += [(found.name, name) for name, value in vars(module).items() if isinstance(value, re.Pattern)]
    assert len(names) > 15
    process = multiprocessing.get_context("fork").Process(target=_match_all, args=(names,), daemon=True)
    process.start()
    process.join(60)
    alive = process.is_alive()
    process.kill()
    assert not alive


# what a machine cannot hold ----------------------------------------------------------------------


@pytest.mark.slow
def test_what_a_machine_cannot_hold_is_refused_at_once() -> None:
    space = Space((Draw("a", Normal(1.0)), Draw("b", Normal(1.0))))
    large = Space(tuple(Draw(f"a{k}", Normal(1.0)) for k in range(60_000)))
    start = time.process_time()
    with pytest.raises(InputError, match="GB of memory are free"):
        space.sample(0, 0, 10**12)
    with pytest.raises(InputError, match="GB of memory are free"):
        space.inverse(np.broadcast_to(0.5, (2, 10**12)))
    with pytest.raises(InputError, match="GB of memory are free"):
        _ = large.covariance
    with pytest.raises(InputError, match="at most 500"):
        Correlation(tuple(map(str, range(501))), ((1.0,),))
    assert time.process_time() - start < 10


@pytest.mark.slow
def test_analyses_that_take_hours_are_refused_at_once(load: Load) -> None:
    few = ErrorModel.from_sheet(load(many(4)))
    wide = ErrorModel(
        few.chain, Space(tuple(Draw(f"a{k}", Normal(1.0)) for k in range(10_001))), few.sources[:0], few.poses
    )
    with pytest.raises(InputError, match=r"a budget of 10,001 draws evaluates the model 4\.9e\+08 times"):
        pp.budget(wide)
    with pytest.raises(InputError, match="a worst case of 10,001 random numbers"):
        pp.worst_case(wide)


def test_a_tolerance_beyond_any_number_is_refused(load: Load) -> None:
    with pytest.raises(InputError, match=r"yaml:3: .*'1e300 m' is too large; at most 1e\+50 m"):
        load(HEAD + "parameters: {d: {disc: 1e300 m}}\nposes: {a: 0 0 0 0 deg}\n")


# changed sheets ----------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("count", [12, 60])
def test_a_small_share_of_the_changed_sheets(tmp_path: Path, count: int) -> None:
    """``python -m fuzzing sheets`` tries more of them."""
    write_files(tmp_path)
    outcomes = [try_sheet(7, number, tmp_path) for number in range(count)]
    problems = [problem for outcome in outcomes for problem in outcome.problems]
    assert problems == []
    assert count / 6 < sum(outcome.accepted for outcome in outcomes) < count * 5 / 6


@pytest.mark.slow
def test_a_sheet_of_very_many_poses_is_read_soon(tmp_path: Path) -> None:
    write_files(tmp_path)
    poses = "".join(f"  p{k}: {k % 90} 1 2 3 deg\n" for k in range(2000))
    path = tmp_path / "sheet.yaml"
    path.write_text(f"{HEAD}poses:\n{poses}sources:\n- joint_offset: {{joint: joint1, offset: {{uniform: 1 mrad}}}}\n")
    start = time.process_time()
    assert len(read(path).poses) == 2000
    assert time.process_time() - start < 5
    path.write_text("#" * (4 * 2**20 + 1))
    with pytest.raises(SheetError, match="larger than 4 MiB"):
        read(path)
