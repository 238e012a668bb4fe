"""The compiled sampler stopped after a stage, nothing kept or counted: the one place here that uses private names.

Nobody needs this but a benchmark, so it has no public name.
"""

from __future__ import annotations

from typing import Final

from precision_pin.kernel import loops, sampler
from precision_pin.kernel.arrays import SamplerArrays

__all__ = ["BLOCKS", "run_uncounted"]

BLOCKS: Final = 16
"""Blocks of samples in a call, as many as a thread is given at a time."""

_STAGES: Final = {"draw": loops.DRAW, "linear": loops.LINEAR, "exact": loops.EXACT}


def run_uncounted(layout: SamplerArrays, stage: str, samples: int) -> None:
    """Draw ``samples`` samples and, for the stages "linear" and "exact", compute their errors; forget all of it."""
    sampler._run(layout, _STAGES[stage], sampler._Units(0, 0, 0, samples, 0, 0))
