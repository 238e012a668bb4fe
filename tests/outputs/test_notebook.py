"""What a notebook shows: tables whose numbers are the result's, names that are never markup, progress, the tutorial."""

import contextlib
import copy
import html
import importlib.util
import io
import itertools
import math
import re
import runpy
import sys
import warnings
from pathlib import Path

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient
from nbformat.v4 import new_code_cell, new_notebook
from numpy.testing import assert_allclose

import precision_pin as pp
from outputs.report_cases import Reader
from precision_pin.base import se3
from precision_pin.base.progress import progress
from precision_pin.render.html import MOST_ROWS, Table, rendered
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sources.joint_offset import JointOffset
from precision_pin.statistics import QUANTITIES

DOCS = Path(__file__).parents[2] / "docs"
HOSTILE = "</td><script>alert('&amp;')</script>"
PLUS_MINUS = re.compile(r"(-?[\d.]+) ± ([\d.]+)")


def shown(what: object) -> Reader:
    return Reader(what._repr_html_())  # type: ignore[attr-defined]


def everything(model: pp.ErrorModel) -> list[object]:
    """Return one of each thing that has a look of its own in a notebook."""
    limits = [pp.specification("20 mrad")]
    return [
        model.chain,
        pp.mcpc.from_chain(model.chain),
        model,
        model.at(),
        pp.monte_carlo(model, samples=500, specifications=limits),
        pp.budget(model, samples=1024),
        pp.worst_case(model, samples=500),
        pp.exact_law(model, samples=500),
        pp.reliability(model, limits, samples=500),
    ]


def rows_of(what: object) -> dict[str, list[str]]:
    """Return the rows of the first table by their first cells."""
    return {row[0]: row for row in shown(what).tables[0].rows}


@pytest.fixture(scope="module")
def paper_things(model) -> list[object]:
    return everything(model)


# tables ------------------------------------------------------------------------------------------


def test_a_long_table_is_cut_and_says_how_much_is_missing():
    rows = [[f"row {k}", str(k)] for k in range(1234)]
    page = Reader(rendered("title", [Table(("name", "number"), rows)], ["note"]))
    assert page.tables[0].rows[1:] == rows[:MOST_ROWS]
    assert f"… and {1234 - MOST_ROWS:,} more" in page.text
    assert "more" not in Reader(rendered("title", [Table(("name", "number"), rows[:MOST_ROWS])])).text


def test_no_text_of_a_table_is_markup():
    table = Table((HOSTILE, HOSTILE), [[HOSTILE, HOSTILE], ["a\x00\u202eb\ud800", "x" * 500]], HOSTILE)
    page = Reader(rendered(HOSTILE, [table], [HOSTILE]))
    assert page.named("script") == []
    assert page.text.count("<script>") == 7
    assert page.tables[0].rows[2] == ["a\ufffd\ufffdb\ufffd", "x" * 59 + "…" + "x" * 20]


# names -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def hostile_model(tmp_path_factory) -> pp.ErrorModel:
    """Return the paper's arm with markup for every name there is."""
    text = (PAPER_SHEET.parent / "4dof.urdf").read_text(encoding="utf-8")
    for name in ("base", "joint2", "joint4", "tool"):
        text = text.replace(f'"{name}"', f'"{html.escape(HOSTILE, quote=False)}{name}"')
    path = tmp_path_factory.mktemp("hostile") / "<script>.urdf"
    path.write_text(text, encoding="utf-8")
    chain = pp.Chain.from_urdf(path, locked={"joint3": 0.5})
    draw = pp.Draw(f"{HOSTILE}draw", pp.Normal(1e-3))
    source = JointOffset(joint=f"{HOSTILE}joint2", offset=draw.name)
    other = JointOffset(joint=f"{HOSTILE}joint4", offset=pp.Uniform(1e-3))
    return pp.ErrorModel(chain, pp.Space((draw,)), [source, other], {f"{HOSTILE}pose": [0.0, 0.1, 1.0]})


@pytest.mark.slow
def test_nothing_has_a_colour_or_a_script_and_plain_text_is_one_useful_line(paper_things, hostile_model):
    styles = {"overflow-x: auto", "text-align: left", "text-align: right; white-space: nowrap"}
    for what in (hostile := everything(hostile_model)):
        assert "<script>" in shown(what).text, type(what)
        assert "\n" not in repr(what), type(what)
    for what in (*paper_things, *hostile):
        for tag in shown(what).tags:
            assert tag.name in ("div", "p", "strong", "small", "table", "thead", "tbody", "tr", "th", "td")
            assert tag.attributes.keys() <= {"style"}
            assert tag.attributes.get("style", "overflow-x: auto") in styles
    for what in paper_things:
        line = repr(what)
        assert re.fullmatch(rf"<{type(what).__name__} .{{10,180}}>", line), line
    assert "4dof.urdf" in repr(paper_things[2])
    assert "seed 0" in repr(paper_things[5])


# numbers -----------------------------------------------------------------------------------------


def test_the_joints_of_a_chain(model):
    head, *rows = shown(model.chain).tables[0].rows
    assert head == ["joint", "kind", "axis", "limits", "x y z [mm]", "roll pitch yaw [°]"]
    assert rows == [
        ["joint1", "revolute", "0 0 1", "-180 to 180 °", "0 0 0", "0 0 0"],
        ["joint2", "revolute", "0 0 1", "-180 to 180 °", "0 0 85", "-90 0 0"],
        ["joint3", "revolute", "0 0 1", "-180 to 180 °", "1970 0 0", "0 0 0"],
        ["joint4", "revolute", "0 0 1", "-180 to 180 °", "1770 0 0", "0 0 0"],
        ["tool", "tip", "", "", "0 0 -274", "0 0 0"],
    ]


def test_roll_pitch_and_yaw_of_a_placement_give_its_rotation(tmp_path):
    text = (PAPER_SHEET.parent / "4dof.urdf").read_text(encoding="utf-8")
    origin = re.search(r'<joint name="joint3".*?(<origin [^>]*>)', text, re.DOTALL)[1]
    for angles in ((3.0, 1.2, -3.0), (0.0, math.pi / 2, 0.7), (0.4, -math.pi / 2, 0.0), (math.pi, 0, 0)):
        rpy = " ".join(map(repr, angles))
        (tmp_path / "turned.urdf").write_text(text.replace(origin, f'<origin xyz="0 0 0" rpy="{rpy}"/>'), "utf-8")
        row = shown(pp.Chain.from_urdf(tmp_path / "turned.urdf")).tables[0].rows[3]
        printed = se3.rpy_rotation(np.radians([float(part) for part in row[5].split()]))
        assert_allclose(printed, se3.rpy_rotation(angles), atol=2e-5)  # 6 digits of °


def test_the_numbers_of_an_analysis(model):
    result = pp.monte_carlo(model, samples=20_000, seed=3, specifications=[pp.specification("41 mm @ 99 %")])
    page = shown(result)
    head, *rows = page.tables[0].rows
    assert [row[0] for row in rows] == ["|d|", "dx", "dy", "dz", "|δ|", "δx", "δy", "δz"]
    statistics = dict(zip(head[2:7], ("mean", "std", 0.5, 0.95, 0.9973), strict=True))
    for quantity, row in zip(QUANTITIES, rows, strict=True):
        distribution = result.summary.distribution(quantity)
        assert row[1] == ("mm" if quantity.startswith("position") else "mrad")
        for name, cell in zip(head[2:7], row[2:7], strict=True):
            statistic = statistics[name]
            value = distribution.resolved_quantile(statistic) if "%" in name else getattr(distribution, statistic)
            printed, width = map(float, PLUS_MINUS.fullmatch(cell).groups())
            half = 1e3 * distribution.half_width(statistic)
            assert half <= width * (1 + 1e-9)
            assert width <= 1.1 * half
            # half a unit of the second digit of a half-width of 10 to 99
            assert abs(printed - 1e3 * value) <= 0.05 * half
        assert row[7:] == [f"{1e3 * distribution.min:.6g}", f"{1e3 * distribution.max:.6g}"]
    (spec,), judged = result.summary.specifications, page.tables[1].rows[1]
    assert [*judged[:3], judged[5]] == ["|d|", "41 mm", "99 %", "met" if spec.met else "NOT MET"]
    for told in ("20,000 samples", "seed 3", "exact model", "95 % confidence", "W_STATICS", "joint2 3°"):
        assert told in page.text
    # what one sample does not resolve
    assert shown(pp.monte_carlo(model, samples=1)).tables[0].rows[1][2:7] == ["-"] * 5


def test_the_spread_of_a_pose(model):
    at = model.at()
    rows = shown(at).tables[0].rows[1:]
    spread = np.sqrt(np.diag(at.jacobian @ model.space.covariance @ at.jacobian.T))
    error = at.exact(model.space.mean[:, None])[:, 0]
    found = [[float(cell) for cell in row[2:4]] for row in rows]
    assert_allclose(found, 1e3 * np.column_stack([error, spread]), rtol=1e-5)


def test_a_pose_without_a_first_order_still_shows(model):
    absurd = JointOffset(joint="joint1", offset=pp.Uniform(0.1, mean=4.0))
    page = shown(pp.ErrorModel(model.chain, pp.Space(()), [absurd]).at([0, 0, 0, 0]))
    assert page.tables == []
    assert "180°" in page.text


def test_the_lines_of_a_model(model):
    sources, draws, poses = (table.rows for table in shown(model).tables)
    assert [row[0] for row in sources[1:]] == list(model.labels)
    assert sources[1][1] == "at='tool', mass=1.0, com=(0.0, 0.0, 0.0)"
    assert [row[0] for row in draws[1:]] == [draw.name for draw in model.space.draws]
    assert draws[1] == ["a0", "Uniform(half_width=5e-05, mean=0.0)", "unit", "length[joint2]"]
    assert poses[1] == ["paper", "joint1 -90°, joint2 3°, joint3 88°, joint4 -91°"]


@pytest.mark.slow
def test_the_numbers_of_a_budget(model, paper_things):
    result = paper_things[5]
    head, *rows = shown(result).tables[0].rows
    assert head[2] == "d: share [%]"
    shares = [float(row[2]) for row in rows]
    assert shares == sorted(shares, reverse=True)
    assert sum(shares) == pytest.approx(100, abs=0.1)
    # closed form, here by hand: the trace of each draw's part of the covariance
    jacobian, covariance = model.at().jacobian[:3], model.space.covariance
    parts = np.einsum("ij,jk,ik->j", jacobian, covariance, jacobian)
    for draw, columns in zip(model.space.draws, model.space.slices, strict=True):
        (row,) = [row for row in rows if row[0] == draw.name]
        assert float(row[2]) == pytest.approx(100 * parts[columns].sum() / parts.sum(), abs=0.006)
        total = result.poses[0].group(draw.name).total["position"]
        assert float(row[4].split(" ± ")[0]) == pytest.approx(100 * total.value, abs=0.06)


@pytest.mark.slow
def test_the_numbers_of_the_worst_case(paper_things):
    result = paper_things[6]
    rows = rows_of(result)
    pose = result.poses[0]
    assert [rows["|d|"][2], rows["|d|"][4]] == ["-", f"{1e3 * pose.position.found.norm:.6g}"]
    # bounds are rounded outwards, by less than a unit of the sixth digit
    upper = 1e3 * pose.position.first_order.upper
    assert upper <= float(rows["|d|"][3]) < upper * (1 + 1e-5)
    for symbol, entry in zip(("dx", "dy", "dz", "δx", "δy", "δz"), pose.components, strict=True):
        low, high = float(rows[symbol][2]), float(rows[symbol][3])
        assert 1e3 * entry.low - 1e-5 * abs(low) < low <= 1e3 * entry.low
        assert 1e3 * entry.high <= high < 1e3 * entry.high + 1e-5 * abs(high)
        assert rows[symbol][4:] == ["-", *(f"{1e3 * end:.6g}" for end in entry.seen)]


@pytest.mark.slow
def test_the_numbers_of_the_exact_law(paper_things):
    result = paper_things[7]
    rows = rows_of(result)
    law = result.poses[0].laws["position.x"]
    printed = [float(cell) for cell in rows["dx"][2:9]]
    exact = [law.mean, law.std, *(law.law.quantile(p) for p in (0.00135, 0.05, 0.5, 0.95, 0.9973))]
    assert printed == pytest.approx([1e3 * value for value in exact], rel=1e-5)
    assert rows["|d|"][2:] == ["-"] * 10
    assert "not available: only of normal draws" in shown(result).text


@pytest.mark.slow
def test_the_verdict_of_a_reliability_analysis(paper_things):
    (entry,) = paper_things[8].poses[0].specifications
    row = shown(paper_things[8]).tables[0].rows[1]
    assert (row[0], row[3], row[6]) == ("|δ| 20 mrad @ 95 %", entry.best.method, "met" if entry.met else "NOT MET")
    assert float(row[5]) == pytest.approx(entry.form.points[0].beta, rel=1e-3)


@pytest.mark.slow
def test_of_many_poses_a_few_are_shown(model):
    result = pp.worst_case(model, [[0.0, 0.1 * k, 1.0, 0.0] for k in range(5)], samples=100)
    page = shown(result)
    assert len(page.tables) == 3
    assert "… and 2 more poses" in page.text


@pytest.mark.slow
def test_the_table_of_mcpc_parameters(paper_things):
    rows = shown(paper_things[1]).tables[0].rows
    # Table 1 of the paper: α_1 = -90°, y_1 = -a_1, x_2 = a_2, x_3 = a_4, z_4 = -(a_1 + a_3 + a_5)
    assert rows[2] == ["1", "joint1", "0", "-90", "0", "", "0", "-85", ""]
    assert [rows[3][6], rows[4][6], rows[5][8]] == ["1970", "1770", "-274"]


# progress ----------------------------------------------------------------------------------------


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_progress_on_a_terminal_comes_and_goes_with_an_interrupt_too(monkeypatch):
    for stop in (False, True):
        monkeypatch.setattr(sys, "stderr", Terminal())
        with contextlib.suppress(KeyboardInterrupt), progress(1000, "writing", delay=0, unit="robots") as advance:
            for _ in range(5):
                advance(100)
            if stop:
                raise KeyboardInterrupt
            advance(500)
        # the last thing written over it is blanks
        assert re.fullmatch(r".*writing.*robots/s.*\r *\r", sys.stderr.getvalue(), re.DOTALL)


def test_short_work_and_files_get_no_progress(monkeypatch):
    for stream, delay in ((Terminal(), None), (io.StringIO(), 0)):
        monkeypatch.setattr(sys, "stderr", stream)
        with progress(1000, **({} if delay is None else {"delay": delay})) as advance:
            advance(1000)
        assert stream.getvalue() == ""
    for total in (-1, 1.5, "many", True):
        with pytest.raises(pp.InputError, match="whole number"), progress(total):
            pass


# the tutorial ------------------------------------------------------------------------------------


def text_outputs(notebook: nbformat.NotebookNode) -> dict[str, list[str]]:
    """Return by cell what it says, without pictures and without the dress of other packages."""
    found = {}
    for cell in notebook.cells:
        outputs = [(one.get("text", ""), one.get("data", {})) for one in cell.get("outputs", [])]
        plain = [(text, data.get("text/plain", ""), data.get("text/html", "")) for text, data in outputs]
        found[cell.id] = [[text, line, markup if line.startswith("<") else ""] for text, line, markup in plain]
    return found


@pytest.fixture(scope="module")
def tutorial() -> nbformat.NotebookNode:
    return nbformat.read(DOCS / "tutorial.ipynb", as_version=4)


@pytest.mark.slow
def test_the_tutorial_is_in_step_with_the_code(tutorial):
    committed = text_outputs(tutorial)
    again = copy.deepcopy(tutorial)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the client's event loop and sockets, not of the package
        NotebookClient(again, timeout=300, record_timing=False, resources={"metadata": {"path": DOCS}}).execute()
    for cell, said in text_outputs(again).items():
        assert said == committed[cell], f"{cell}; run: python docs/execute_notebook.py"
    outputs = itertools.chain.from_iterable(cell.get("outputs", []) for cell in again.cells)
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 5


def test_the_tutorial_carries_its_outputs_and_nothing_of_the_machine(tutorial):
    text = (DOCS / "tutorial.ipynb").read_text(encoding="utf-8")
    assert len(text) < 750_000
    assert tutorial.metadata.kernelspec.name == "python3"
    assert not re.search(r"/(home|work|tmp|usr|root)/|[A-Z]:\\\\", re.sub(r'"image/png": "[^"]*"', "", text))
    code = [cell for cell in tutorial.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    assert all(cell.outputs for cell in code)
    assert all(cell.metadata == {} for cell in tutorial.cells)
    kinds = {output.output_type for output in itertools.chain.from_iterable(cell.outputs for cell in code)}
    assert kinds <= {"execute_result", "display_data"}  # no errors, nothing on stderr


INTERRUPTED = """
import time
from precision_pin.base.progress import progress
try:
    with progress(100, "sampling", delay=0) as advance:
        advance(10)
        time.sleep(0.2)
        advance(10)
        raise KeyboardInterrupt
except KeyboardInterrupt:
    pass
"""


@pytest.mark.slow
def test_the_command_of_the_docs_executes_a_notebook_whose_progress_goes_with_an_interrupt(tmp_path, monkeypatch):
    path = tmp_path / "small.ipynb"
    cells = [new_code_cell("1 + 1"), new_code_cell(INTERRUPTED)]
    nbformat.write(new_notebook(cells=cells, metadata={"language_info": {"name": "python", "version": "0"}}), path)
    monkeypatch.setattr(sys, "argv", ["execute_notebook.py", str(path)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the client's event loop and sockets
        runpy.run_path(str(DOCS / "execute_notebook.py"), run_name="__main__")
    made = nbformat.read(path, as_version=4)
    assert made.cells[0].outputs[0].data["text/plain"] == "2"
    assert set(made.metadata) == {"kernelspec"}
    assert made.cells[0].metadata == {}
    said = "".join(output.get("text", "") for output in made.cells[1].outputs)
    assert "Warning" not in said
    if importlib.util.find_spec("ipywidgets") is None:
        assert re.fullmatch(r".*sampling.*\r *\r[^\r]*", said, re.DOTALL)
