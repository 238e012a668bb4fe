"""What all tests need of the process they run in."""

import signal
import sys
from collections.abc import Iterator

import pytest

# pytest compiles the tests with their asserts taken apart: five seconds for each process, unless it is kept
sys.dont_write_bytecode = False

# a shell that starts the tests in the background has Ctrl-C ignored, and so would every command that tests start
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int | None:
    """Take no workers where only files are named: each imports everything anew."""
    return 0 if all(".py" in word for word in config.args) else None


@pytest.fixture(autouse=True)
def signals_stay() -> Iterator[None]:
    """Give the tests their signals back: the command line keeps them to the end of the process."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in numbers]
    yield
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)
