"""Wait for what happens elsewhere: in another process, thread or browser."""

import time
from collections.abc import Callable


def eventually(holds: Callable[[], object], within: float = 5.0) -> bool:
    """Return whether something comes true in time, s."""
    end = time.monotonic() + within
    while not (true := holds()) and time.monotonic() < end:
        time.sleep(0.02)
    return bool(true)
