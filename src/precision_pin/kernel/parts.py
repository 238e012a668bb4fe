"""Parallel compilation of the parts of the compiled loops; listing them does not load the compiler."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, Literal

from precision_pin.base.compile_ahead import Job, begin_jobs, compile_jobs

Wanted = Literal[True] | None

PARTS: Final[Mapping[str, float]] = {
    "_displace": 2.4,
    "apply_laws": 1.3,
    "_superpose": 1.4,
    "_measure": 0.8,
    "uniforms": 0.5,
    "_derive": 0.5,
    "_keep_largest": 0.3,
    "_add_products": 0.3,
    "_find_bins": 0.3,
    "_fold": 0.2,
    "_norms": 0.2,
    "_count_inside": 0.2,
    "_empty_lanes": 0.1,
    "_fold_extremes": 0.1,
    "_count_all_bins": 0.1,
}
"""Parts and their approximate compilation times in seconds."""

_LAWS: Final = "apply_laws"
_RARE: Final = 1.5
"""Additional compilation time of the rare laws, in seconds."""
_TOGETHER: Final = 3.5
"""Seconds that the outermost function takes to compile once its parts are compiled."""


def part_jobs(rare: Wanted, linear: Wanted) -> list[Job]:
    """Return the jobs that compile the parts of a variant."""
    laws = Job(__name__, "compile_part", (_LAWS, rare), PARTS[_LAWS] + (_RARE if rare else 0.0))
    return [laws, *_list_common_jobs("_displace" if linear else "_superpose")]


def compile_parts(rare: Wanted, linear: Wanted, datum: Wanted, last: str) -> None:
    """Compile the parts of a variant in worker processes, then run the sampler's function ``last``, which compiles the rest."""
    from precision_pin.base.jit import can_keep
    from precision_pin.kernel import loops

    if can_keep(loops.run):
        job = Job("precision_pin.kernel.sampler", last, (rare, linear, datum), _TOGETHER, last=True)
        compile_jobs([*part_jobs(rare, linear), job])


def _list_common_jobs(unused: str) -> list[Job]:
    """Return the jobs of the parts that do not depend on the laws, except one unused part."""
    return [
        Job(__name__, "compile_part", (name, None), seconds)
        for name, seconds in PARTS.items()
        if name not in (_LAWS, unused)
    ]


def begin_compiling() -> None:
    """Start compiling the exact model's parts in worker processes if the cache is empty; a first use waits."""
    # the cache is recognised by its file names alone, because numba takes long to load
    own_cache = Path(__file__).parent / "__pycache__"
    folder = Path(os.environ["NUMBA_CACHE_DIR"]) if os.environ.get("NUMBA_CACHE_DIR") else own_cache
    index = f"loops.run-*.py{sys.version_info.major}{sys.version_info.minor}.nbi"
    try:
        is_there = any(folder.glob(index)) or any(folder.glob(f"*/{index}"))
        is_writable = folder != own_cache or os.access(own_cache if own_cache.is_dir() else own_cache.parent, os.W_OK)
    except OSError:
        return
    if is_writable and not is_there:
        begin_jobs(_list_common_jobs("_superpose"))


def part_arguments(name: str, rare: Wanted = None) -> tuple[Any, ...]:
    """Return arguments of the types that a part is called with, for compilation only."""
    import numpy as np

    from precision_pin.kernel.arrays import empty_table
    from precision_pin.kernel.loops import HELD, LARGEST, SCRATCH, STRIDE, TILE, Conditions, Counting

    layout = empty_table(rare)
    s, w, eight = np.zeros(SCRATCH * STRIDE), np.zeros(layout.rows * STRIDE), np.zeros(8)
    bins, offsets, offset = np.zeros(8 * (HELD + 1) * TILE, np.uint32), np.zeros(0, np.uint64), np.uint64(0)
    largest = np.zeros((2, LARGEST))
    conditions = Conditions(offsets, np.zeros((0, 3, 6)), np.zeros(0), offsets)
    counting = Counting(eight, eight, offsets, np.zeros(0), conditions)
    draws = layout.draws
    return {
        "_displace": (s, w, layout.motions, 0, 0, True),
        "apply_laws": (w, draws, rare),
        "_superpose": (s, w, layout.superposition, offset),
        "_measure": (s, eight, 0),
        "uniforms": (w, draws.stream_rows, draws.streams, offsets, offset, offset, offsets),
        "_derive": (w, layout.formulas),
        "_keep_largest": (s, 0, offset, largest, largest.astype(np.int64)),
        "_add_products": (s,),
        "_find_bins": (s, bins, 0, eight),
        "_fold": (s, eight),
        "_norms": (s,),
        "_count_inside": (s, 0, counting, np.zeros(0, np.int64)),
        "_empty_lanes": (s, eight, eight),
        "_fold_extremes": (s, eight, eight),
        "_count_all_bins": (bins, 0, 0, np.zeros(0, np.uint32)),
    }[name]


def compile_part(name: str, rare: Wanted) -> None:
    """Compile a part into the cache."""
    from precision_pin.base.jit import make_ready
    from precision_pin.kernel import loops

    make_ready(getattr(loops, name), part_arguments(name, rare))
