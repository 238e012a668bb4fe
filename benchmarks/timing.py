"""Clocks: the candidates take turns, and the best turn of each counts.

A machine has other work to do, which can only add time. Candidates that take turns meet the same bad minutes; the
smallest of several turns is the one least disturbed.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, TypeVar, final

__all__ = ["Work", "best_times", "nanoseconds"]

Name = TypeVar("Name", str, int)

_SHORTEST_TURN: Final = 2e-3
"""Seconds below which a turn repeats its work."""


@final
@dataclass(frozen=True)
class Work:
    """Something to be timed.

    Attributes:
        call: What to do.
        samples: How many samples that makes.
    """

    call: Callable[[], object]
    samples: int


def best_times(
    works: Mapping[Name, Work], turns: int, clock: Callable[[], float] = time.process_time
) -> dict[Name, float]:
    """Return the seconds of each work, the best of its turns, after one call each that is not timed.

    Args:
        works: What to time, by name; they take turns.
        turns: How many each has.
        clock: ``time.process_time`` counts the processor's time of all threads, so that a library that starts threads
            of its own gains nothing by it; ``time.perf_counter`` counts the time that passes, for what is meant to be
            parallel.
    """
    repeats = {}
    for name, work in works.items():
        began = clock()
        work.call()
        repeats[name] = max(1, math.ceil(_SHORTEST_TURN / max(clock() - began, 1e-7)))
    best = dict.fromkeys(works, math.inf)
    for _ in range(turns):
        for name, work in works.items():
            began = clock()
            for _ in range(repeats[name]):
                work.call()
            best[name] = min(best[name], (clock() - began) / repeats[name])
    return best


def nanoseconds(
    works: Mapping[Name, Work], turns: int, clock: Callable[[], float] = time.process_time
) -> dict[Name, float]:
    """Return the nanoseconds per sample of each work, as `best_times`."""
    return {name: seconds / works[name].samples * 1e9 for name, seconds in best_times(works, turns, clock).items()}
