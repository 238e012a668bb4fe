"""Reports to test, and a reader of pages."""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

import pytest

from cli.conftest import take_few_samples
from precision_pin.analyses.collect import Results, collect
from precision_pin.pages.report.page import page
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sheet import read
from precision_pin.statistics.plan import specification
from support.plain_robot import joint, limits, link, robot

SAMPLES = 3_000
BLANK = b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1 1"/>'
SCRIPT, SVG, MATHS, BRACE, HAN = (
    "</script><img src=x onerror=alert(1)>",
    '"><svg onload=alert(2)>',
    "a$x$",
    "a_{b",
    "腕'&amp;",
)
SPECIFICATIONS = ("45 mm @ 99 %", "x 0.1 mm", "attitude 25 mrad")
VOID = ("meta", "br", "input", "link", "img", "path", "use")


def results_of(sheet: Path, specs: Sequence[str] = (), **settings: object) -> Results:
    """Return the results of a sheet; where a number of samples is given, the page's sections take few as well."""
    with pytest.MonkeyPatch.context() as patch:
        if "samples" in settings:
            take_few_samples(patch)
        return collect(
            read(sheet),
            settings.pop("pose", None),  # type: ignore[arg-type]
            **{
                "samples": SAMPLES,
                "seed": 4,
                "model": "exact",
                "specifications": [specification(text) for text in specs],
                "command": ["precision-pin", "report"],
                "package_dirs": (),
                "step": silent,
            }
            | settings,  # type: ignore[arg-type]
        )


@contextmanager
def silent(what: str, samples: int) -> Iterator[object]:
    assert what
    assert samples >= 0
    yield lambda count: None


@cache
def paper() -> tuple[Results, str]:
    """Return the results of the paper's case and its page."""
    results = results_of(PAPER_SHEET, samples=SAMPLES)
    return results, page(results)


def write_hostile(folder: Path) -> Path:
    """Write an arm and a sheet whose every name is an attack or a trap, and return the sheet."""

    def quoted(text: str) -> str:
        return "'" + text.replace("'", "''") + "'"

    written = {name: quoteattr(name)[1:-1].replace('"', "&quot;") for name in (SVG, MATHS, BRACE, SCRIPT, HAN)}
    svg, maths, brace, script, han = written.values()
    there = {"xyz": (0.4, 0, 0.2), "extra": limits(-3, 3)}
    arm = robot(
        *map(link, (svg, maths, brace, script)),
        joint(svg, "revolute", svg, maths, **there),
        joint(brace, "revolute", maths, brace, axis=(0, 1, 0), **there),
        joint(han, "prismatic", brace, script, axis=(1, 0, 0), **there),
    )
    (folder / "hostile.urdf").write_text(arm.replace('name="arm"', f'name="{script}"'), "utf-8")
    sheet = folder / "hostile.yaml"
    sheet.write_text(
        f"""precision-pin: 1
robot: hostile.urdf
poses:
  {quoted(SCRIPT)}: [10 deg, 20 deg, 0.1 m]
sources:
  - joint_offset: {{joint: {quoted(SVG)}, offset: {{uniform: 0.1 mrad}}}}
  - joint_offset: {{joint: {quoted(BRACE)}, offset: {{normal: 0.3 mrad}}}}
  - joint_offset: {{joint: {quoted(HAN)}, offset: {{normal: 0.3 mm}}}}
  - axis_install: {{joint: {quoted(SVG)}, radius: 0.1 mm, span: 100 mm}}
""",
        "utf-8",
    )
    return sheet


class Tag(NamedTuple):
    name: str
    attributes: dict[str, str]


@dataclass
class Table:
    """A table: its caption, its rows of cells, and the tags of the cells' headings."""

    caption: str = ""
    rows: list[list[str]] = field(default_factory=list)
    scopes: list[str | None] = field(default_factory=list)

    def row(self, heading: str) -> list[str]:
        return next(row[1:] for row in self.rows if row[0] == heading)

    def column(self, heading: str) -> dict[str, str]:
        k = self.rows[0].index(heading)
        return {row[0]: row[k] for row in self.rows[1:]}


class Reader(HTMLParser):
    """Tags, scripts, tables, headings and text of a page; what stands in the frame stays an attribute."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[Tag] = []
        self.tables: list[Table] = []
        self.headings: list[tuple[int, str]] = []
        self.words: list[str] = []
        self.scripts: list[tuple[dict[str, str], str]] = []
        self._open: list[str] = []
        self.feed(text)
        assert self._open == []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        given = {key: value or "" for key, value in attributes}
        self.tags.append(Tag(tag, given))
        if tag not in VOID:
            self._open.append(tag)
        if tag == "table":
            self.tables.append(Table())
        elif tag == "tr":
            self.tables[-1].rows.append([])
        elif tag in ("td", "th"):
            self.tables[-1].rows[-1].append("")
            if tag == "th":
                self.tables[-1].scopes.append(given.get("scope"))
        elif re.fullmatch("h[1-6]", tag):
            self.headings.append((int(tag[1]), ""))

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        inside = set(self._open)
        if inside & {"style", "script"}:
            self.scripts += [(self.tags[-1].attributes, data)] if "script" in inside else []
            return
        self.words.append(data)
        if "caption" in inside:
            self.tables[-1].caption += data
        elif inside & {"td", "th"}:
            self.tables[-1].rows[-1][-1] += data
        elif self._open and re.fullmatch("h[1-6]", self._open[-1]):
            level, text = self.headings[-1]
            self.headings[-1] = (level, text + data)

    @property
    def text(self) -> str:
        return " ".join("".join(self.words).split())

    def table(self, start: str) -> Table:
        return next(table for table in self.tables if table.caption.startswith(start))

    def named(self, name: str) -> list[Tag]:
        return [tag for tag in self.tags if tag.name == name]
