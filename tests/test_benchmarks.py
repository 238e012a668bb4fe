"""The benchmarks: what they compare is the same, what they fit is right, and they run and write their page."""

import importlib
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from precision_pin.kernel import sampler as sampler

ROOT = Path(__file__).parents[1]
MODULES = sorted(path.stem for path in (ROOT / "benchmarks").glob("*.py") if path.stem != "__main__")


def load(name: str):
    return importlib.import_module("benchmarks" if name == "__init__" else f"benchmarks.{name}")


@pytest.fixture(autouse=True)
def from_the_root(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT))
    # loading the package sets them for what it starts
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    monkeypatch.setenv("XLA_FLAGS", "")


@pytest.mark.slow
def test_every_module_loads_without_the_other_libraries():
    before = set(sys.modules)
    for name in MODULES:
        load(name)
    assert not {"jax", "openturns", "roboticstoolbox"} & (set(sys.modules) - before)


@pytest.mark.slow
def test_all_ways_give_the_same_errors():
    cases, kernel = load("cases"), load("kernel")
    at = cases.ur5()
    x = cases.draw_with_numpy(np.random.default_rng(5), 40)
    compiled = sampler.errors_at(sampler.to_arrays(at), "exact", x)
    assert np.abs(compiled).max() > 1e-5
    ways = {name: errors for name, (errors, _) in kernel.written_by_hand().items()}
    ways |= {name: other.errors for name, other in kernel.installed_libraries()[0].items()}
    assert len(ways) >= 7
    for name, errors in ways.items():
        np.testing.assert_allclose(errors(x), compiled, rtol=0, atol=1e-10, err_msg=name)


def test_a_way_that_differs_stops_the_run():
    kernel = load("kernel")
    good = load("loops").numpy_by_hand()
    kernel.check_agreement({"good": good})
    with pytest.raises(SystemExit, match=r"^bad differs from the compiled sampler by 2\.0e-09; nothing was timed$"):
        kernel.check_agreement({"good": good, "bad": lambda x: good(x) + 2e-9})
    with pytest.raises(SystemExit, match="bad differs"):
        kernel.check_agreement({"bad": lambda x: good(x) * np.nan})


def test_the_case_is_as_described():
    cases = load("cases")
    at = cases.ur5()
    assert at.space.size == 36
    assert cases.IS_UNIFORM.sum() == 15
    # the variances of the laws, and of what numpy draws
    expected = np.where(cases.IS_UNIFORM, cases.HALF_WIDTH**2 / 3, cases.STD**2)
    np.testing.assert_allclose(np.diag(at.space.covariance), expected, rtol=1e-12)
    drawn = cases.draw_with_numpy(np.random.default_rng(0), 20_000)
    np.testing.assert_allclose(drawn.var(axis=1), expected, rtol=0.05)
    table = cases.with_products().table
    assert len(table.twists) == 100
    assert ((table.factors >= 0).sum(axis=1) == 2).sum() == 20


def test_chains_spread_their_parameters_over_all_axes():
    for joints, parameters in ((2, 12), (6, 180), (20, 120)):
        at = load("cases").chain_of(joints, parameters)
        counted = np.zeros((joints, 6))
        np.add.at(counted, at.table.target, at.table.twists)
        assert (counted == parameters / joints / 6).all()


def test_the_best_turn_counts():
    timing = load("timing")
    # a clock that each call puts forward: the works take turns, the first call of each is not timed
    now, asked = [0.0], []
    needed = {"slow": iter([9.0, 5.0, 3.0, 4.0]), "quick": iter([9.0, 1.0, 2.0, 1.5])}

    def work(name):
        def call():
            asked.append(name)
            now[0] += next(needed[name])

        return timing.Work(call, 10)

    best = timing.nanoseconds({name: work(name) for name in needed}, 3, clock=lambda: now[0])
    assert best == pytest.approx({"slow": 0.3e9, "quick": 0.1e9})
    assert asked == ["slow", "quick"] * 4


def test_a_straight_line_is_found_and_a_bent_one_told():
    fitted = load("scaling").fitted
    x = [1, 2, 3, 4, 5, 6]
    line = fitted(x, [7 + 2 * value for value in x])
    assert (line.at_zero, line.slope, line.bend) == pytest.approx((7, 2, 1))
    assert line.worst < 1e-12
    # slopes of x² by least squares: over 1 to 4 it is 5, over 4 to 6 it is 10
    assert fitted(x, [value**2 for value in x]).bend == pytest.approx(10 / 5)


FIGURES = {0: "0", 34_712.3: "34,700", 999.7: "1,000", 9.996: "10.0", 1: "1.00", 0.98512: "0.985", 0.0241: "0.0241"}


def test_tables_and_their_figures_of_three_digits():
    tables = load("tables")
    assert {value: tables.figure(value) for value in FIGURES} == FIGURES
    table = tables.Table("Title", ("way", "ns"), [("one", "5"), ("another", "1,234")], ("A note.",))
    assert table.as_text() == "Title\n\nway         ns\n-------  -----\none          5\nanother  1,234\n  A note."
    assert table.as_markdown() == (
        "### Title\n\n| way | ns |\n| --- | ---: |\n| one | 5 |\n| another | 1,234 |\n\nA note."
    )
    assert tables.Ratio("a to b", 1.234, 1.7, at_most=True).as_row() == ("a to b", "1.23", "at most 1.7")
    assert tables.Ratio("a to b", None, 900).as_row() == ("a to b", "not measured", "at least 900")


def test_only_what_was_measured_is_replaced():
    run = load("run")
    page = f"before\n{run.BEGIN}\nold\n{run.END}\nafter\n"
    assert run.replaced(page, "new") == f"before\n{run.BEGIN}\n\nnew\n\n{run.END}\nafter\n"
    assert run.replaced(run.replaced(page, "new"), "newer") == run.replaced(page, "newer")
    for broken in ("", page + page, f"{run.END}\n{run.BEGIN}"):
        with pytest.raises(ValueError, match="once each and in this order"):
            run.replaced(broken, "new")


def test_a_page_that_cannot_be_written_is_told_before_measuring(tmp_path, capsys):
    run = load("run")
    for text, words in ((None, "No such file"), ("no marks", "it needs the lines")):
        if text is not None:
            (tmp_path / "benchmarks.md").write_text(text)
        with pytest.raises(SystemExit) as stopped:
            run.main(["--out", str(tmp_path)])
        assert stopped.value.code == 2
        assert words in capsys.readouterr().err
    with pytest.raises(SystemExit) as stopped:
        run.main(["--fast"])
    assert stopped.value.code == 2


def test_the_page_names_the_command_and_holds_its_results():
    run = load("run")
    text = (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8")
    assert run.replaced(text, "") != text
    assert "quick run" not in text
    for picture in re.findall(r"\(images/(\S+)\)", text):
        assert (ROOT / "docs" / "images" / picture).is_file()


@pytest.mark.slow
def test_memory_is_that_of_the_run_alone():
    memory = load("memory")
    held = np.ones(10**8)  # 0.8 GB in this process are none in the other
    few, many = (memory.spent(memory.NUMPY, count).peak for count in (1000, 20_000))
    assert 50e6 < few < 8 * held.size
    # 26 draws, 31 products and 12 targets' six numbers, 8 bytes each, are there at once
    assert many - few > 20_000 * 8 * (26 + 31 + 12 * 6) * 0.9


@pytest.mark.slow
def test_a_quick_run_writes_its_page(tmp_path, monkeypatch, capsys):
    """Of every part, with short chains; Python alone for every command, and the memory of runs is made up."""
    run, scaling, startup, memory = (load(name) for name in ("run", "scaling", "startup", "memory"))
    monkeypatch.setattr(scaling, "_JOINTS", scaling._JOINTS[:5])
    monkeypatch.setattr(scaling, "_PARAMETERS", scaling._PARAMETERS[:5])
    monkeypatch.setattr(startup, "STARTS", dict.fromkeys(startup.STARTS, ("-c", "")))
    monkeypatch.setattr(memory, "spent", lambda way, samples: memory.Spent(1e-6 * samples, 10**8))
    (tmp_path / "benchmarks.md").write_text(f"# Mine\n\n{run.BEGIN}\n{run.END}\n")
    run.main(["--quick", "--out", str(tmp_path)])
    text = (tmp_path / "benchmarks.md").read_text(encoding="utf-8")
    assert text.startswith(f"# Mine\n\n{run.BEGIN}\n\nMeasured on: ")
    printed = capsys.readouterr().out
    for title in re.findall(r"^### (.+)$", text, re.MULTILINE):
        assert title in printed
    assert text.count("\n### ") >= 5
    assert "nan" not in text
    images = {path.name for path in (tmp_path / "images").iterdir()}
    assert images == {"benchmark-comparison.png", "benchmark-scaling.png"}


@pytest.mark.slow
def test_maps_of_every_arm_are_timed(monkeypatch):
    poses = load("poses")
    assert poses.slope([10, 100, 1000], {10: 1e-3, 100: 1e-2, 1000: 0.1}) == pytest.approx(1)
    sheets = poses.shipped_sheets()
    assert {"4dof", "panda", "so100", "so101", "ur10e", "ur3e", "ur5", "ur5e", "xarm7"} == set(sheets)
    monkeypatch.setattr(poses, "shipped_sheets", lambda: {name: sheets[name] for name in ("4dof", "xarm7")})
    monkeypatch.setattr(poses, "MAPPED", (1, 2))
    monkeypatch.setattr(poses, "STEADY", 1)
    part = poses.measure_maps(1)
    assert [row[0] for row in part.tables[0].rows] == ["4dof", "xarm7"]
    assert all(ratio.value > 1 and ratio.aim == 1000 for ratio in part.ratios)
