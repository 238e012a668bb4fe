"""The page of ``report`` in a real browser: no complaint, no request, the 3-D view alive, dark mode, paper."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from outputs.report_cases import paper
from support.browser import chromium, complaints, needs_chromium, outside_requests, visited

pytestmark = [pytest.mark.slow, needs_chromium]

PATIENCE = 60_000
BACKGROUND = "getComputedStyle(document.body).backgroundColor"
OF_FIGURES = """
  [...document.querySelectorAll('svg')].map((svg) => getComputedStyle(svg.querySelector('path')).color)
"""
OPEN_ALL = "document.querySelectorAll('details.fold').forEach((fold) => { fold.open = true; })"
TOO_WIDE = "document.documentElement.scrollWidth > innerWidth"


@pytest.fixture(scope="module")
def paper_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("report") / "paper.html"
    file.write_text(paper()[1], "utf-8")
    return file


def blue_pixels(picture: bytes) -> int:
    """Return how many pixels are as blue as links 2 and 3 of the paper's arm."""
    red, green, blue = np.moveaxis(np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"), dtype=int), 2, 0)
    return int(((blue > red + 60) & (blue > green + 30)).sum())


@pytest.mark.parametrize(("scheme", "width"), [("light", 1280), ("dark", 600)])
def test_the_page_opens_in_either_scheme_and_on_a_narrow_screen(paper_page, scheme, width):
    with chromium(color_scheme=scheme, viewport={"width": width, "height": 800}) as context:
        visit = visited(context, paper_page)
        visit.page.evaluate(OPEN_ALL)
        frame = visit.page.frame_locator("iframe")
        frame.locator("body[data-ready=yes]").wait_for(timeout=PATIENCE, state="attached")
        assert complaints(visit) == []
        assert outside_requests(visit) == []
        assert not visit.page.evaluate(TOO_WIDE)
        ground = visit.page.evaluate(BACKGROUND)
        assert ground == ("rgb(255, 255, 255)" if scheme == "light" else "rgb(20, 24, 29)")
        drawn = visit.page.evaluate(OF_FIGURES)
        assert set(drawn) == {"rgb(27, 34, 43)" if scheme == "light" else "rgb(232, 236, 241)"}
        assert visit.page.locator("#figure-arm svg").is_visible()
        visit.page.locator("iframe").scroll_into_view_if_needed()
        assert blue_pixels(visit.page.locator("iframe").screenshot()) > 2_000


def test_keyboard_and_links_lead_past_the_contents_and_into_tables_and_folds(paper_page):
    with chromium() as context:
        visit = visited(context, paper_page)
        visit.page.keyboard.press("Tab")
        assert visit.page.evaluate("document.activeElement.className") == "skip"
        visit.page.keyboard.press("Enter")
        assert visit.page.evaluate("document.activeElement.id") == "main"
        unreached = "[...document.querySelectorAll('.wide, .drawing')].filter((one) => one.tabIndex !== 0).length"
        assert visit.page.evaluate(unreached) == 0
        budget = visit.page.locator("#budget")
        assert not budget.is_visible()
        visit.page.click("nav a[href='#budget']")
        assert budget.is_visible()
        assert 0 <= visit.page.locator("#budget-heading").bounding_box()["y"] < 100
        # on to the summary of the section after it
        visit.page.locator(".fold:has(> #worst-case)").locator("> summary").focus()
        for expected in (True, False):
            visit.page.keyboard.press("Enter")
            assert visit.page.locator("#worst-case").is_visible() == expected


def test_paper_gets_the_decision_or_what_is_open_and_the_still_picture_instead_of_the_view(paper_page):
    with chromium(color_scheme="dark") as context:
        visit = visited(context, paper_page)

        def pages(paper: str) -> int:
            return len(re.findall(rb"/Type\s*/Page\b", visit.page.pdf(format=paper)))

        assert [pages(paper) for paper in ("A4", "Letter")] == [2, 2]
        visit.page.emulate_media(media="print")
        assert visit.page.locator(".paper").is_visible()
        assert visit.page.locator("#assumptions").is_visible()
        assert not visit.page.locator("#budget").is_visible()
        # as the page is written with --full
        visit.page.evaluate(OPEN_ALL)
        assert 10 <= pages("A4") <= 20
        assert visit.page.locator("#budget").is_visible()
        assert visit.page.locator("#figure-arm svg").is_visible()
        assert not visit.page.locator("iframe").is_visible()
        assert not visit.page.locator("nav").is_visible()
        assert visit.page.evaluate(BACKGROUND) == "rgb(255, 255, 255)"


def test_without_scripts_the_still_picture_stands_there(paper_page):
    with chromium(java_script_enabled=False) as context:
        visit = visited(context, paper_page)
        assert visit.page.locator("#figure-arm svg").is_visible()
        assert not visit.page.locator("iframe").is_visible()


OUTSIDE = """
() => {
  const width = document.documentElement.clientWidth;
  const seen = [...document.querySelectorAll('table, svg, p, pre, dd, li, figcaption')]
    .filter((one) => !one.closest('details:not([open])'));
  return seen.map((one) => [one, one.getBoundingClientRect()])
    .filter(([one, box]) => box.width && (box.right > width + 1 || box.left < -1))
    .map(([one]) => one.tagName + ' ' + one.textContent.slice(0, 40));
}
"""


@pytest.mark.parametrize("width_mm", [182, 188], ids=["A4", "Letter"])
def test_nothing_is_clipped_on_paper(paper_page, width_mm):
    # the width between the margins, in pixels of CSS
    with chromium(viewport={"width": int(width_mm / 25.4 * 96), "height": 1000}) as context:
        visit = visited(context, paper_page)
        visit.page.evaluate(OPEN_ALL)
        visit.page.emulate_media(media="print")
        assert visit.page.evaluate(OUTSIDE) == []


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844)])
def test_the_first_screen_holds_the_answer_and_the_arm(paper_page, width, height):
    with chromium(viewport={"width": width, "height": height}) as context:
        visit = visited(context, paper_page)
        places = (".verdict", ".first table", ".causes", "#figure-arm svg")
        boxes = [visit.page.locator(place).first.bounding_box() for place in places]
        ends = [box["y"] + box["height"] for box in boxes]
        assert max(ends) <= height
        if width < 1000:
            assert ends == sorted(ends)  # in reading order
            visit.page.evaluate(OPEN_ALL)
            assert not visit.page.evaluate(TOO_WIDE)
            # charts keep the size of their letters and scroll
            assert [one for one in visit.page.evaluate(OUTSIDE) if not one.startswith("svg")] == []
            label = "getComputedStyle(document.querySelector('#budget td:last-child'), '::before').content"
            assert "change of 95 % of |d|" in visit.page.evaluate(label)
