"""The site: Sphinx builds it without a warning, and its pages work without a network."""

import itertools
import json
import re
import shutil
import time
import zlib
from pathlib import Path

import pytest
from sphinx.search.en import SearchEnglish

import precision_pin
from docs import gallery
from precision_pin.cli.explain import list_codes
from precision_pin.sources import catalogue
from support.browser import chromium, complaints, needs_chromium, outside_requests, visited
from support.site import DOCS, LATER, build, home_of

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """Return the site of a copy of the pages, which one worker began to build when it had collected these tests."""
    home = home_of(tmp_path_factory.getbasetemp())
    done, until = home / "done", time.monotonic() + 280
    while not done.exists() and time.monotonic() < until:
        time.sleep(0.2)
    assert done.read_text(encoding="utf-8") == "0\n"
    return home / "html"


def test_a_link_that_leads_nowhere_is_an_error(tmp_path):
    for name in ("conf.py", "_static"):
        copy = shutil.copytree if (DOCS / name).is_dir() else shutil.copy
        copy(DOCS / name, tmp_path / name)
    (tmp_path / "index.md").write_text("# Page\n\n[nowhere](nowhere.md)\n\n[no heading](#no-heading)\n")
    run = build(tmp_path, tmp_path / "html")
    assert run.returncode != 0
    assert "nowhere.md" in run.stderr
    assert "no-heading" in run.stderr


def test_every_page_public_name_and_kind_of_source_is_there(site):
    pages = [path.relative_to(DOCS) for path in DOCS.rglob("*") if path.suffix in (".md", ".rst", ".ipynb")]
    pages = [page for page in pages if not LATER.search(str(page))]
    assert len(pages) > 20
    assert [str(page) for page in pages if not (site / page.with_suffix(".html")).exists()] == []
    page = (site / "api" / "index.html").read_text(encoding="utf-8")
    linked = dict(re.findall(r'href="([^"]+#[^"]+)"[^>]*><code[^>]*><span class="pre">pp\.(\w+)</span>', page))
    assert set(linked.values()) == set(precision_pin.__all__)
    for target in linked:
        name, _, anchor = target.partition("#")
        assert f'id="{anchor}"' in (site / "api" / name).read_text(encoding="utf-8"), target
    raw = (site / "objects.inv").read_bytes()
    listed = {line.split(" ")[0] for line in zlib.decompress(raw.split(b"\n", 4)[4]).decode().splitlines()}
    assert {f"{kind.__module__}.{kind.__qualname__}" for kind in catalogue().values()} <= listed


def test_the_gallery_shows_questions_answers_and_pictures(site):
    page = (site / "gallery.html").read_text(encoding="utf-8")
    scripts = sorted((DOCS.parent / "examples").glob("*.py"))
    for script in scripts:
        asked = gallery.question(script)
        assert f">{asked}</a></p></li>" in page, script
        is_drawn = "savefig" in script.read_text(encoding="utf-8")
        assert (f"_images/{script.stem}.png" in page) is is_drawn, script
        assert not is_drawn or (site / "_images" / f"{script.stem}.png").stat().st_size > 5000, script
    assert page.count('<div class="highlight-python') == page.count('<div class="highlight-text') == len(scripts)


def test_formulas_are_mathml_with_their_numbers(site):
    for page, fewest in (("model", 12), ("budget", 7), ("worst-case", 5), ("exact-law", 6), ("reliability", 5)):
        text = (site / f"{page}.html").read_text(encoding="utf-8")
        assert text.count('<math xmlns="http://www.w3.org/1998/Math/MathML" display="block">') >= fewest, page
        assert len(re.findall(r'<span class="eqno">\(\w+\)</span></div>', text)) >= fewest, page
        assert "$$" not in re.sub(r"<pre>.*?</pre>", "", text, flags=re.DOTALL), page
        assert "\\tag" not in text, page


@needs_chromium
@pytest.mark.parametrize(
    ("scheme", "width", "pages"),
    [
        ("light", 1280, "index gallery model tutorial api/index"),
        ("dark", 400, "index questions gallery case glossary model sources api/index api/model tutorial"),
    ],
)
def test_pages_ask_for_nothing_outside(site, scheme, width, pages):
    with chromium(color_scheme=scheme, viewport={"width": width, "height": 800}) as browser:
        for page in pages.split():
            visit = visited(browser, site / f"{page}.html")
            assert visit.page.title().endswith("precision-pin"), page
            # nothing wider than the window, however narrow
            assert visit.page.evaluate("document.documentElement.scrollWidth") <= width, page
            assert complaints(visit) == [], page
            assert outside_requests(visit) == [], page
            if page == "model":
                heights = "all => all.map(it => it.getBoundingClientRect().height)"
                drawn = visit.page.eval_on_selector_all("div.math math", heights)
                assert len(drawn) >= 12
                assert min(drawn) > 10


def test_a_search_finds_the_words_of_the_field_and_every_code(site):
    text = (site / "searchindex.js").read_text(encoding="utf-8")
    index = json.loads(text.removeprefix("Search.setIndex(").removesuffix(")"))
    stem = SearchEnglish({}).stem
    codes = [name for group in list_codes().values() for one in group.codes for name in one.names]
    assert len(codes) > 90
    words = ["xacro", "Cp", "Cpk", "harmonic", "drive", "RP", "AP", "yield", "repeatability", *codes]
    assert [word for word in words if stem(word.lower()) not in {*index["terms"], *index["titleterms"]}] == []


@needs_chromium
def test_the_search_page_names_the_glossary_first_for_the_words_of_the_field(site):
    with chromium() as browser:
        for query, page in (("RP", "Glossary"), ("AP", "Glossary"), ("Cpk", "Glossary"), ("W_FEW_SAMPLES", "Codes of")):
            found = visited(browser, f"{(site / 'search.html').as_uri()}?q={query}").page
            found.wait_for_selector("#search-results li a")
            found.wait_for_function("document.querySelector('.search-summary').innerText.includes('matching')")
            assert found.inner_text("#search-results li a").startswith(page), query


@needs_chromium
@pytest.mark.parametrize("width", [390, 1280])
def test_the_set_up_line_is_shown_whole_and_copied_as_one(site, width):
    with chromium(viewport={"width": width, "height": 800}) as browser:
        page = visited(browser, site / "start.html").page
        lines = page.locator("article div.highlight-none pre")
        assert lines.count() == 2
        assert lines.evaluate_all("all => all.every(it => it.scrollWidth <= it.clientWidth)")
        page.evaluate("document.execCommand = () => { window.copied = document.activeElement.value; return true }")
        copied = []
        for block in ("highlight-none", "highlight-console"):
            page.locator(f"div.{block} button.copybtn").first.dispatch_event("click")
            copied.append(page.evaluate("window.copied").rstrip())
        assert re.fullmatch(r"python3 -m venv .venv && .+ analyze", copied[0])
        # of a console block the commands alone, without their prompts and what they print
        assert re.fullmatch(r"precision-pin check .+\nprecision-pin analyze .+", copied[1])


@needs_chromium
def test_labels_of_drawings_stand_apart_and_inside():
    with chromium() as browser:
        page = browser.new_page()
        for path in sorted((DOCS / "images").glob("*.svg")):
            page.goto(path.as_uri())
            frame = page.evaluate("(({width, height}) => [width, height])(document.documentElement.viewBox.baseVal)")
            boxes = page.eval_on_selector_all(
                "text",
                "all => all.map(it => [it.textContent, ...(({x, y, width, height}) => [x, y, width, height])(it.getBBox())])",
            )
            assert len(boxes) > 3, path
            for name, x, y, width, height in boxes:
                assert 0 <= x <= frame[0] - width, f"{path.name}: {name}"
                assert 0 <= y <= frame[1] - height, f"{path.name}: {name}"
            for one, other in itertools.combinations(boxes, 2):
                apart_x = max(one[1], other[1]) - min(one[1] + one[3], other[1] + other[3])
                # letters are lower than their boxes
                apart_y = max(one[2], other[2]) - min(one[2] + one[4], other[2] + other[4])
                assert apart_x > -1 or apart_y > -6, f"{path.name}: {one[0]!r} and {other[0]!r}"
