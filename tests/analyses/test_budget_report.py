"""The budget as text, picture and command."""

from __future__ import annotations

import json
import re
import shutil
import sys

import pytest
from matplotlib.text import Text

import precision_pin as pp
from precision_pin.analyses.budget.figure import figure
from precision_pin.analyses.budget.table import table
from precision_pin.base.errors import UnknownNameError
from precision_pin.cli import main
from precision_pin.draws.correlation import Correlation
from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sources.frame import Frame
from support.engines import GANTRY
from support.plain_robot import chain_of

FEW = 1024


@pytest.fixture(scope="module")
def paper():
    return pp.budget(ErrorModel.load(PAPER_SHEET), samples=FEW)


@pytest.fixture(scope="module")
def correlated():
    """Return a budget of 31 draws with names in two scripts, two of them correlated."""
    space = Space(
        (Draw("a", Normal(1e-3)), Draw("腕", Normal(2e-3)), *(Draw(f"n{k}", Uniform(1e-4)) for k in range(29))),
        (Correlation(("a", "腕"), ((1.0, 0.5), (0.5, 1.0))),),
    )
    sources = [Frame(link="base", x="a"), Frame(frame="tool", x="腕", z="a")]
    sources += [Frame(link="base", y=f"n{k}") for k in range(29)]
    chain = chain_of(GANTRY, tip="tool", gravity=(0, 0, 0))
    return pp.budget(ErrorModel(chain, space, sources), [0.1, 0.2], samples=FEW)


@pytest.mark.slow
def test_table_shows_shares_indices_widths_and_sums(paper):
    lines = table(paper).splitlines()
    assert re.fullmatch(
        r"position: axis_install\[joint1\]\.A, radius 0\.1 mm, causes 25\.\d % of the variance", lines[0]
    )
    assert lines[1].startswith("attitude: axis_install[")
    assert lines[3].startswith("4dof.urdf: base to tool, pose 'paper' (joint1 -90°")
    largest = next(line for line in lines if line.startswith("axis_install[joint1].A"))
    assert re.search(r" radius 0\.1 mm +25\.25 +\d+\.\d+ ± \d+\.\d+ +-?\d+\.\d+ ± \d+\.\d+$", largest)
    sums = [line for line in lines if line.startswith("sum ")]
    assert len(sums) == 2
    assert all(re.search(r" 100\.00$", line) for line in sums)
    assert re.search(
        r"first-order Sobol indices: position sum to \d+\.\d+ ± \d+\.\d+ %, attitude sum to ", "\n".join(lines)
    )
    assert any(line.startswith("a1: length[joint2], length[tool]") for line in lines)
    assert any(line.startswith("link from joint1 to joint2") for line in lines)
    assert "worst case" not in lines[8]


def test_components_show_the_worst_case_and_norms_no_closed_form(paper):
    text = table(paper, ["position.z", "attitude.norm"])
    assert "worst case %" in text
    assert re.search(r"^sum +-$", text, re.MULTILINE)
    assert re.search(r"attitude\.norm sum to \d+(\.\d+)? ± ", text)
    with pytest.raises(UnknownNameError, match=r"position\.z"):
        table(paper, ["position.w"])


@pytest.mark.slow
def test_many_draws_are_cut_and_correlated_ones_have_a_line(correlated):
    text = table(correlated)
    assert "and 21 more: --all" in text
    assert "more: --all" not in table(correlated, is_whole=True)
    assert "correlated: a + 腕" in text
    assert re.search(r"^腕 +σ 2 mm +\d+\.\d+ +- ", text, re.MULTILINE)
    # nothing turns: no attitude anywhere
    assert re.search(r"^sum +-$", text, re.MULTILINE)
    assert "attitude not resolved" in text


@pytest.mark.slow
@pytest.mark.parametrize("which", ["paper", "correlated"])
def test_figure_has_legible_text_inside_it(which, request):
    made = figure(request.getfixturevalue(which))
    made.canvas.draw()
    box = made.bbox
    for text in made.findobj(Text):
        if text.get_text() and text.get_visible():
            assert text.get_fontsize() >= 7
    upper, lower = made.axes
    for axes in (upper, lower):
        boxes = [label.get_window_extent() for label in axes.get_yticklabels()]
        assert all(one.x0 >= box.x0 and one.x1 <= box.x1 for one in boxes)
        assert not any(one.overlaps(other) for k, one in enumerate(boxes) for other in boxes[:k])
    assert not upper.xaxis.label.get_window_extent().overlaps(lower.get_window_extent())
    assert {text.get_text() for text in made.legends[0].get_texts()} == {
        "share of the variance, first order", "total Sobol index, exact model",
    }  # fmt: skip


@pytest.mark.slow
def test_bars_are_the_shares_largest_first_beside_total_indices_and_tolerances(paper):
    upper = figure(paper).axes[0]
    groups = sorted(paper.poses[0].groups, key=lambda group: -round(group.share["position"], 9))[:12]
    bars = [container for container in upper.containers if hasattr(container, "patches")]
    widths = [bar.get_width() for bar in bars[0].patches]
    assert widths == pytest.approx([100 * group.share["position"] for group in groups], rel=1e-12)
    diamonds = next(container for container in upper.containers if not hasattr(container, "patches"))[0].get_xdata()
    assert diamonds == pytest.approx([100 * group.total["position"].value for group in groups], rel=1e-12)
    assert "radius 0.1 mm" in {part for text in upper.texts for part in text.get_text().split("  ")}
    assert next(label.get_text() for label in upper.get_yticklabels()).startswith("axis of joint1, bearing")


# the command -------------------------------------------------------------------------------------


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    for file in PAPER_SHEET.parent.glob("4dof.*"):
        shutil.copy(file, tmp_path)
    monkeypatch.chdir(tmp_path)

    def command(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["precision-pin", "budget", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        return int(ended.value.code or 0), printed.out, printed.err

    return command


@pytest.mark.slow
def test_command_prints_the_table(run, paper):
    code, out, _ = run("--samples", str(FEW))
    assert code == 0
    assert out.split() == table(paper).split()
    assert max(map(len, out.splitlines())) <= 100


@pytest.mark.slow
def test_command_writes_json_and_pictures(run, paper, tmp_path):
    code, out, err = run("4dof.errors.yaml", "--samples", str(FEW), "--json", "-", "--out", "plots", "--pose", "paper")
    assert code == 0
    assert json.loads(out) == json.loads(paper.to_json())
    assert json.loads((tmp_path / "plots" / "budget.json").read_text(encoding="utf-8")) == json.loads(out)
    assert {path.name for path in (tmp_path / "plots").iterdir()} == {"budget.json", "budget.png", "budget.svg"}
    assert "wrote plots: budget.json, budget as PNG and SVG" in err


@pytest.mark.slow
def test_command_takes_several_poses_and_joint_values(run, tmp_path):
    code, out, _ = run("--samples", str(FEW), "--pose", "paper", "--pose", "paper", "--out", "plots", "--json", "-")
    assert code == 0
    assert len(json.loads(out)["poses"]) == 2
    assert {path.stem for path in (tmp_path / "plots").iterdir()} == {"budget", "budget-1", "budget-2"}
    code, out, _ = run("--samples", str(FEW), "--q", "0 10 30 0 deg", "--quantity", "attitude.x")
    assert code == 0
    assert "attitude.x: std" in out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--samples", "1000"), "32 times a power of two"),
        (("--seed", "-1"), "seed"),
        (("--quantity", "position.w"), "position.w"),
        (("--pose", "paper", "--q", "0 0 0 0"), "exclude each other"),
        (("--pose", "nowhere"), "nowhere"),
        (("--json", "no/such/folder.json"), "does not exist"),
        (("--out", ""), "names no folder"),
    ],
)
def test_wrong_lines_end_in_one_line(run, words, says):
    code, out, err = run(*words)
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert says in err
