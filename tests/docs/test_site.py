"""The site: Sphinx builds it without a warning, and its pages work without a network."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import zlib
from pathlib import Path

import pytest

import precision_pin
from precision_pin.sources import catalogue
from support.browser import chromium, complaints, needs_chromium, outside_requests, visited

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
LATER = re.compile(r"_build|\.ipynb_checkpoints|__pycache__")

pytestmark = pytest.mark.slow


def build(source: Path, target: Path) -> subprocess.CompletedProcess[str]:
    words = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", str(source), str(target)]
    return subprocess.run(words, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """Build the site of a copy of the pages."""
    source = tmp_path_factory.mktemp("site") / "docs"
    shutil.copytree(DOCS, source, ignore=lambda _, names: [name for name in names if LATER.search(name)])
    target = source.parent / "html"
    run = build(source, target)
    assert run.returncode == 0, run.stderr
    assert not run.stderr
    return target


def test_every_page_is_there(site):
    pages = [path.relative_to(DOCS) for path in DOCS.rglob("*") if path.suffix in (".md", ".rst", ".ipynb")]
    pages = [page for page in pages if not LATER.search(str(page))]
    assert len(pages) > 20
    assert [str(page) for page in pages if not (site / page.with_suffix(".html")).exists()] == []


def test_a_link_that_leads_nowhere_is_an_error(tmp_path):
    for name in ("conf.py", "_static"):
        copy = shutil.copytree if (DOCS / name).is_dir() else shutil.copy
        copy(DOCS / name, tmp_path / name)
    (tmp_path / "index.md").write_text("# Page\n\n[nowhere](nowhere.md)\n\n[no heading](#no-heading)\n")
    run = build(tmp_path, tmp_path / "html")
    assert run.returncode != 0
    assert "nowhere.md" in run.stderr
    assert "no-heading" in run.stderr


def test_every_public_name_has_its_place_in_the_reference(site):
    page = (site / "api" / "index.html").read_text(encoding="utf-8")
    linked = dict(re.findall(r'href="([^"]+#[^"]+)"[^>]*><code[^>]*><span class="pre">pp\.(\w+)</span>', page))
    assert set(linked.values()) == set(precision_pin.__all__)
    for target in linked:
        name, _, anchor = target.partition("#")
        assert f'id="{anchor}"' in (site / "api" / name).read_text(encoding="utf-8"), target


def test_every_kind_of_source_is_in_the_reference(site):
    raw = (site / "objects.inv").read_bytes()
    names = zlib.decompress(raw.split(b"\n", 4)[4]).decode().splitlines()
    listed = {line.split(" ")[0] for line in names}
    assert {f"{kind.__module__}.{kind.__qualname__}" for kind in catalogue().values()} <= listed


def test_formulas_are_mathml_with_their_numbers(site):
    for page, fewest in (("model", 12), ("budget", 7), ("worst-case", 5), ("exact-law", 6), ("reliability", 5)):
        text = (site / f"{page}.html").read_text(encoding="utf-8")
        assert text.count('<math xmlns="http://www.w3.org/1998/Math/MathML" display="block">') >= fewest, page
        assert len(re.findall(r'<span class="eqno">\(\w+\)</span></div>', text)) >= fewest, page
        assert "$$" not in re.sub(r"<pre>.*?</pre>", "", text, flags=re.DOTALL), page
        assert "\\tag" not in text, page


@needs_chromium
@pytest.mark.parametrize(("scheme", "width"), [("light", 1280), ("dark", 400)])
def test_pages_ask_for_nothing_outside(site, scheme, width):
    with chromium(color_scheme=scheme, viewport={"width": width, "height": 800}) as browser:
        for page in ("index", "model", "sources", "api/index", "api/model", "tutorial"):
            visit = visited(browser, site / f"{page}.html")
            assert visit.page.title().endswith("precision-pin"), page
            # nothing wider than the window, however narrow
            assert visit.page.evaluate("document.documentElement.scrollWidth") <= width, page
            assert complaints(visit) == [], page
            assert outside_requests(visit) == [], page


@needs_chromium
def test_formulas_are_drawn_by_the_browser(site):
    with chromium() as browser:
        visit = visited(browser, site / "model.html")
        heights = visit.page.eval_on_selector_all(
            "div.math math", "all => all.map(it => it.getBoundingClientRect().height)"
        )
        assert len(heights) >= 12
        assert min(heights) > 10
