"""What all tests need of the process they run in."""

import signal
from collections.abc import Iterator

import pytest

# a shell that starts the tests in the background has Ctrl-C ignored, and so would every command that tests start
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def signals_stay() -> Iterator[None]:
    """Give the tests their signals back: the command line keeps them to the end of the process."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in numbers]
    yield
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)
