"""A real browser for the tests: headless Chromium, its console, its requests, its pictures.

Chromium is Debian's; on a machine without it these tests are skipped, never where CI is set.
"""

import contextlib
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, Playwright, sync_playwright

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
needs_chromium = pytest.mark.skipif(
    CHROMIUM is None and not os.environ.get("CI"), reason="Chromium is not installed; CI installs it"
)


@dataclass
class Visit:
    """A page that is open, and all it has said and asked for since."""

    page: Page
    console: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)


_shared: list[tuple[Playwright, Browser]] = []


@contextlib.contextmanager
def chromium(**options: object) -> Iterator[BrowserContext]:
    """Yield a new profile of the browser; options such as ``color_scheme="dark"`` or ``viewport``.

    Tests share a browser, since one takes seconds to start and to end; `close_browser` ends it.
    """
    if not _shared:
        playwright = sync_playwright().start()
        _shared.append((playwright, playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))))
    context = _shared[0][1].new_context(**{"viewport": {"width": 1280, "height": 800}, **options})  # type: ignore[arg-type]
    # drawn by processors that other tests use at the same time
    context.set_default_timeout(120_000)
    try:
        yield context
    finally:
        context.close()


def close_browser() -> None:
    """End the browser, and with it Playwright's event loop, which other tests would find running."""
    while _shared:
        playwright, browser = _shared.pop()
        browser.close()
        playwright.stop()


def visited(context: BrowserContext, where: str | Path, *, loaded: str = "load") -> Visit:
    """Open an address or a file in a new tab; what it complains of or asks for is kept from the first moment on."""
    visit = Visit(context.new_page())
    visit.page.on("console", lambda message: visit.console.append(f"{message.type}: {message.text}"))
    visit.page.on("pageerror", lambda error: visit.console.append(f"error: {error}"))
    visit.page.on("request", lambda request: visit.requests.append(request.url))
    visit.page.goto(where.as_uri() if isinstance(where, Path) else where, wait_until=loaded)  # type: ignore[arg-type]
    return visit


def complaints(visit: Visit) -> list[str]:
    """Return console lines that are errors or warnings of the page, not of the software renderer."""
    return [
        line for line in visit.console if not line.startswith(("log:", "info:", "debug:")) and "GPU stall" not in line
    ]


def outside_requests(visit: Visit) -> list[str]:
    """Return what the page asked for besides itself and data it carries."""
    return [url for url in visit.requests if not url.startswith(("file:", "data:", "blob:", "about:"))]
