"""Drawings and the table of verdicts: in step with the code that draws, computes and says what they show."""

import ast
import functools
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from docs.drawings import budgets, datums, measured_arms, results, sources
from docs.drawings.canvas import IMAGES

import precision_pin as pp
from precision_pin.robot.examples import example_urdfs, shipped_sheets
from support.package_code import PACKAGE, nodes

PAGES = IMAGES.parent


def test_a_drawing_is_in_step():
    for name, drawn in sources.DRAWINGS.items():
        assert (IMAGES / name).read_text(encoding="utf-8") == drawn(), "run: python -m docs.drawings"


@pytest.mark.slow
@pytest.mark.parametrize("drawings", [measured_arms, budgets, datums])
def test_a_drawing_of_results_is_in_step(drawings):
    if not example_urdfs():
        pytest.skip("example-robot-data is not installed")
    for name, text in drawings.draw_all().items():
        assert (IMAGES / name).read_text(encoding="utf-8") == text, f"{name}: run: python -m docs.drawings"


def test_the_measured_arms_are_those_that_the_sheet_states():
    head = " ".join(line.lstrip("# ") for line in shipped_sheets()["ur5"].read_text(encoding="utf-8").splitlines()[:12])
    stated = re.search(
        r"by ([\d.]+) to ([\d.]+) mm \(median ([\d.]+)\), ([\d.]+) to ([\d.]+) mm \(([\d.]+)\) and ([\d.]+) to ([\d.]+) mm"
        r" \(([\d.]+)\)",
        head,
    )
    assert stated is not None
    found = [number for arms in measured_arms.MEASURED.values() for number in (min(arms), max(arms), np.median(arms))]
    assert found == pytest.approx([float(number) for number in stated.groups()])
    assert {len(arms) for arms in measured_arms.MEASURED.values()} == {9}


def test_the_first_page_states_what_sheet_and_drawing_do():
    text = (PAGES / "index.md").read_text(encoding="utf-8")
    head = shipped_sheets()["ur5"].read_text(encoding="utf-8")
    for pose, arms in measured_arms.MEASURED.items():
        median, most = re.findall(rf"^#   {pose} +median ([\d.]+) mm, 95 % ([\d.]+) mm$", head, re.MULTILINE)[0]
        row = f"| {pose} | {median} mm | {most} mm | {np.median(arms):.1f} mm | {min(arms)} to {max(arms)} mm |"
        assert row in text


def test_every_drawing_is_shown_and_every_picture_has_its_page():
    shown = " ".join(path.read_text(encoding="utf-8") for path in PAGES.glob("*.md"))
    for name in (*sources.DRAWINGS, "ur5-measured.svg", *budgets.BUDGETS, *datums.PICTURES, *results.PICTURES):
        assert (IMAGES / name).exists(), name
        assert f"(images/{name})" in shown, name
    for page, command, _ in results.PICTURES.values():
        assert f"$ precision-pin {command}" in (PAGES / page).read_text(encoding="utf-8")


def points(name: str, look: str) -> list[tuple[float, float]]:
    """Return the middles of the dots of a drawing that have a look and are as large as A and B are drawn."""
    dots = ElementTree.parse(IMAGES / name).iter("{http://www.w3.org/2000/svg}ellipse")
    return [
        (float(dot.attrib["cx"]), float(dot.attrib["cy"]))
        for dot in dots
        if dot.attrib["class"] == look and dot.attrib["rx"] == "6.0"
    ]


def test_the_drawn_axis_meets_the_origins_plane_where_the_source_puts_the_seat(tmp_path):
    """A, B, start and span are read off the drawing; the model's seat must lie at the tip of the green arrow."""
    (ax, ay), (bx, by) = points("axis_install.svg", "fill-red")
    text = (IMAGES / "axis_install.svg").read_text(encoding="utf-8")
    x, origin = map(
        float, re.findall(r'<ellipse cx="([\d.]+)" cy="([\d.]+)" rx="5.0" ry="5.0" class="fill-ink"/>', text)[0]
    )
    tip = float(re.findall(r'<path d="M([\d.]+) [^"]+" class="green fill-green"/>', text)[0])
    start, span = (origin - ay) * 1e-5, (ay - by) * 1e-5  # 100 pixels are 1 mm
    urdf = """<robot name="one"><link name="base"/><link name="arm"/><joint name="turn" type="revolute"><parent link="base"/>
        <child link="arm"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
    (tmp_path / "one.urdf").write_text(urdf)
    chain = pp.Chain.from_urdf(tmp_path / "one.urdf", tip="arm")
    install = pp.sources.AxisInstall(joint="turn", radius=1e-3, span=span, start=start)
    model = pp.ErrorModel(chain, pp.Space(()), [install])
    values = {"A.x": (ax - x) * 1e-5, "A.y": 0.0, "B.x": (bx - x) * 1e-5, "B.y": 0.0}
    drawn = np.array([[values[name.removeprefix("axis_install[turn].")]] for name in model.space.components])
    assert model.at([0.0]).linear(drawn)[0, 0] == pytest.approx(
        (tip - x) * 1e-5, abs=1e-6
    )  # drawn to a tenth of a pixel


ROOT = Path(__file__).parents[2]
FOLDERS = ("analyses", "cli", "writers", "model", "pages", "render", "sampling", "statistics")
WORDS = re.compile(
    r"\{VERDICT\}|\b(MET|NOT MET|[Mm]et|holds?|at least|at most|bounds?|certified|agrees?|AGREES|DISAGREES?|worst|never|always"
    r"|no allocation)\b(?!-case)"
)


def rows() -> list[list[str]]:
    """Return the cells of both tables."""
    text = (ROOT / "docs" / "verdicts.md").read_text(encoding="utf-8")
    lines = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| `")]
    assert len(lines) > 30
    return lines


def quoted(cell: str) -> list[str]:
    return re.findall(r"`([^`]+)`", cell)


@functools.cache
def sentences(path: Path) -> tuple[str, ...]:
    """Return the texts of a module that it may print, {} for what is filled in; neither docstrings, refusals nor keys."""
    left_out: set[int] = set()
    found = []
    for node in nodes(path):
        if isinstance(node, ast.Raise):
            left_out |= {id(one) for one in ast.walk(node)}
        elif isinstance(node, ast.Expr):
            left_out.add(id(node.value))
        elif isinstance(node, ast.JoinedStr):
            left_out |= {id(one) for one in ast.walk(node) if isinstance(one, ast.Constant)}
    for node in nodes(path):
        if id(node) in left_out:
            continue
        if isinstance(node, ast.JoinedStr):
            found.append("".join(one.value if isinstance(one, ast.Constant) else filled_in(one) for one in node.values))
        elif (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and not re.fullmatch(r"[a-z_.=*]+", node.value)
        ):
            found.append(node.value)
    return tuple(found)


def filled_in(node: ast.expr) -> str:
    """Return {VERDICT} for a verdict in capitals: its own word, or what is said of it with its grounds."""
    return "{VERDICT}" if re.search(r"verdict.*\.(upper|capitalize)\(\)|\.said\b", ast.unparse(node)) else "{}"


@pytest.mark.slow
def test_every_sentence_has_a_row() -> None:
    known: dict[str, list[str]] = {}
    for row in rows():
        for file in quoted(row[1]):
            assert (PACKAGE / file).exists(), file
            known.setdefault(file, []).extend(quoted(row[0]))
    missing = []
    for folder in FOLDERS:
        for path in sorted((PACKAGE / folder).rglob("*.py")):
            file = path.relative_to(PACKAGE).as_posix()
            for text in sentences(path):
                if WORDS.search(text) and not any(part in text for part in known.get(file, [])):
                    missing.append(f"{file}: {text}")
    assert missing == []


@pytest.mark.slow
def test_every_sentence_of_the_table_is_printed() -> None:
    stale = []
    for row in rows():
        texts = [text for file in quoted(row[1]) for text in sentences(PACKAGE / file)]
        stale += [part for part in quoted(row[0]) if not any(part in text for text in texts)]
    assert stale == []


@pytest.mark.slow
def test_every_test_of_the_table_exists() -> None:
    named = [name for row in rows() for name in re.findall(r"`(tests/\S+\.py::\w+)`", " ".join(row[2:]))]
    assert len(named) > 25
    for name in named:
        file, _, function = name.partition("::")
        tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
        assert function in {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}, name
    promised = [row for row in rows() if len(row) == 4]
    assert [row[0] for row in promised if "::" not in row[3]] == []
