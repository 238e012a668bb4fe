"""The paper's arm, and a browser."""

from collections.abc import Iterator
from typing import Any

import pytest

from cli.conftest import run  # noqa: F401  (a fixture)
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.examples import PAPER_SHEET


@pytest.fixture(scope="session")
def model() -> ErrorModel:
    return ErrorModel.load(PAPER_SHEET)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from support.browser import chromium  # importing Playwright takes its time

    # small, since software draws
    with chromium(viewport={"width": 800, "height": 480}) as context:
        yield context


@pytest.fixture
def context(browser: Any) -> Iterator[Any]:
    before = set(browser.pages)
    yield browser
    for page in set(browser.pages) - before:
        page.close()
