"""Of many like cases some run in the fast run, all in the full one."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def mostly_slow(cases: Iterable[Any], fast: int) -> list[Any]:
    """Return the cases of one parameter, all but some of them marked as slow; the fast ones are spread evenly."""
    listed = list(cases)
    kept = {k * len(listed) // fast for k in range(fast)}
    return [case if k in kept else pytest.param(case, marks=pytest.mark.slow) for k, case in enumerate(listed)]
