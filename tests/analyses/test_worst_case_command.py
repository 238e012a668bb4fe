"""``precision-pin worst-case``, its text and its picture."""

from __future__ import annotations

import json
import shutil
import sys
import time

import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

import precision_pin as pp
from precision_pin.analyses.worst_case.figure import figure
from precision_pin.analyses.worst_case.table import table
from precision_pin.cli import main
from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import Fixed, JointNormal
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sources.joint_offset import JointOffset
from support.sheets import SEVEN_Q, everything, seven_joint_arm


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run ``precision-pin worst-case`` in a folder with the paper's files; returns exit code, stdout and stderr."""
    for file in PAPER_SHEET.parent.iterdir():
        shutil.copy(file, tmp_path)
    monkeypatch.chdir(tmp_path)

    def command(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["precision-pin", "worst-case", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        return ended.value.code, printed.out, printed.err

    return command


@pytest.mark.slow
def test_the_papers_arm_takes_less_than_five_seconds(run):
    sampler.warm_up()
    begin = time.perf_counter()
    code, out, _ = run()
    assert time.perf_counter() - begin < 5
    assert code == 0
    answer, text = out.split("\n\n", 1)
    lines = text.splitlines()
    assert lines[0].startswith("4dof.urdf: base to tool, pose 'paper' (joint1 -90°")
    assert lines[1] == "worst case of 18 draws, every law is bounded"
    assert "100,000 samples, seed 0" in lines[2]
    result = pp.worst_case(ErrorModel.load(PAPER_SHEET))
    bound = result.poses[0].position
    cells = next(line for line in lines if line.startswith("|d|")).split()
    expected = [bound.first_order.upper, bound.exact_norm, bound.found.norm, bound.seen.max]
    assert cells[1:6] == ["mm", *(f"{1e3 * value:.6g}" for value in expected)]
    assert answer.startswith(f"at worst, every tolerance at once: |d| {cells[2]} mm, ")
    assert f"exact\n  model: {cells[4]} mm, " in answer
    assert max(map(len, lines)) <= 130


@pytest.mark.slow
def test_json_alone_and_in_a_folder_with_a_picture_of_every_pose(run, tmp_path):
    arguments = ("4dof.errors.yaml", "--samples", "500", "--seed", "3", "--k", "2", "--out", "plots")
    code, out, err = run(*arguments, "--json", "-")
    assert code == 0
    data = json.loads(out)
    assert (data["k"], data["seed"], data["samples"], len(data["poses"])) == (2.0, 3, 500, 1)
    assert json.loads((tmp_path / "plots" / "worst-case.json").read_text(encoding="utf-8")) == data
    names = {"worst-case.json", "worst-case.png", "worst-case.svg"}
    assert {path.name for path in (tmp_path / "plots").iterdir()} == names
    assert "wrote plots: worst-case.json" in err
    code, out, _ = run("--samples", "500", "--pose", "paper", "--pose", "paper", "--out", "two", "--json", "two.json")
    assert code == 0
    assert out.count("4dof.urdf: base to tool, pose 'paper'") == 2
    assert len(json.loads((tmp_path / "two.json").read_text(encoding="utf-8"))["poses"]) == 2
    assert {path.stem for path in (tmp_path / "two").iterdir()} == {"worst-case", "worst-case-1", "worst-case-2"}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--k", "0"), "k, where unbounded laws are cut, must be positive and finite, got 0.0"),
        (("--k", "nan"), "k, where unbounded laws are cut"),
        (("--samples", "0"), "the number of samples must be a whole number"),
        (("--seed", "-1"), "the seed must be a whole number"),
        (("--pose", "papper"), "no pose named 'papper'"),
        (("--pose", "paper", "--q", "0 0 0 0 deg"), "--pose and --q exclude each other"),
        (("--out", ""), "--out names no folder"),
        (("nowhere.yaml",), "nowhere.yaml"),
    ],
)
def test_wrong_input_is_one_line(run, arguments, said):
    code, out, err = run(*arguments)
    assert code == 2
    assert out == ""
    lines = [line for line in err.splitlines() if "warning" not in line]
    assert len(lines) == 1
    assert said in lines[0]


def paper() -> ErrorModel:
    return ErrorModel.load(PAPER_SHEET)


def still() -> ErrorModel:
    return ErrorModel(paper().chain, Space(), [JointOffset(joint="joint1", offset=Fixed(0.0))])


def long_names() -> ErrorModel:
    name = "a_rather_long_name_of_a_parameter_that_was_measured_together_with_another_one"
    space = Space((Draw(name, JointNormal(((1e-6, 0.0), (0.0, 1e-6)))),))
    return ErrorModel(paper().chain, space, [JointOffset(joint="joint1", offset=f"{name}.0")])


CASES = {
    "paper": (paper, None, 2000),
    "one sample": (paper, None, 1),
    "seven joints": (lambda: everything(seven_joint_arm()), SEVEN_Q, 2000),
    "nothing varies": (still, (0.0, 0.0, 0.0, 0.0), 100),
    "long names": (long_names, (0.0, 0.0, 0.0, 0.0), 2000),
}


def drawn_texts(drawn: Figure) -> list[Text]:
    drawn.canvas.draw()
    inside = [
        label
        for axes in drawn.axes
        for axis in (axes.xaxis, axes.yaxis)
        for tick in axis.get_major_ticks()
        for label in (tick.label1, tick.label2)
        if not axes.get_window_extent().padded(1).contains(*_centre_on_axis(axes, axis, tick))
    ]
    return [
        text
        for text in drawn.findobj(Text)
        if text.get_visible() and text.get_text().strip() and not any(text is label for label in inside)
    ]


def _centre_on_axis(axes, axis, tick):
    place = tick.get_loc()
    point = (place, axes.get_ylim()[0]) if axis is axes.xaxis else (axes.get_xlim()[0], place)
    return axes.transData.transform(point)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*W_NOTHING_VARIES")
@pytest.mark.parametrize("case", CASES)
def test_the_picture_is_readable_and_the_text_says_what_was_cut(case):
    build, q, samples = CASES[case]
    result = pp.worst_case(build(), q, samples=samples)
    drawn = figure(result)
    texts = drawn_texts(drawn)
    assert len(texts) > 10
    boxes = [(text.get_text(), text.get_window_extent(drawn.canvas.get_renderer())) for text in texts]
    for text in texts:
        assert text.get_fontsize() >= 7
    for k, (words, box) in enumerate(boxes):
        assert drawn.bbox.x0 <= box.x0 < box.x1 <= drawn.bbox.x1, words
        assert drawn.bbox.y0 <= box.y0 < box.y1 <= drawn.bbox.y1, words
        for other_words, other in boxes[k + 1 :]:
            assert not box.overlaps(other), (words, other_words)
    lines = table(result).splitlines()
    heads = [line for line in lines if line.startswith("worst case of")]
    assert len(heads) == 1
    assert ("cut at 3 standard deviations" in heads[0]) == bool(result.cut)
    assert all(name in heads[0] for name in result.cut)


@pytest.mark.slow
def test_bars_end_at_the_bound():
    result = pp.worst_case(paper(), samples=500)
    for axes, bound in zip(figure(result).axes, (result.poses[0].position, result.poses[0].attitude), strict=True):
        last = axes.patches[-1]
        assert last.get_x() + last.get_width() == pytest.approx(1e3 * bound.first_order.lower, rel=1e-9)
        assert sum(bar.get_width() for bar in axes.patches) == pytest.approx(1e3 * bound.first_order.lower, rel=1e-9)
