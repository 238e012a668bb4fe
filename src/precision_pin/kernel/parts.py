"""Parallel compilation of the parts of the compiled loops, with arguments of the types they are called with."""

from __future__ import annotations

from typing import Any

import numpy as np

from precision_pin.base.jit import make_ready
from precision_pin.draws.draw import Draw
from precision_pin.draws.expressions import Program
from precision_pin.draws.laws import Disc
from precision_pin.draws.space import Space
from precision_pin.kernel import loops
from precision_pin.kernel.arrays import SamplerArrays, convert_table
from precision_pin.kernel.loops import HELD, LARGEST, SCRATCH, STRIDE, TILE, Counting, Wanted
from precision_pin.terms.table import TermTable


def empty_table(rare: Wanted = None) -> SamplerArrays:
    """Return the arrays of a model without errors, optionally with a rare law."""
    table = TermTable(
        pose=np.eye(4),
        targets=(),
        frames=np.zeros((0, 4, 4)),
        program=Program(0, (), (), ()),
        target=np.zeros(0, dtype=np.intp),
        twists=np.zeros((0, 6)),
        factors=np.zeros((0, 3), dtype=np.intp),
    )
    return convert_table(table, Space((Draw("disc", Disc(1.0)),) if rare else ()))


def part_arguments(name: str, rare: Wanted = None) -> tuple[Any, ...]:
    """Return arguments of the types that a part is called with, for compilation only."""
    layout = empty_table(rare)
    s, w, eight = np.zeros(SCRATCH * STRIDE), np.zeros(layout.rows * STRIDE), np.zeros(8)
    bins, offsets, offset = np.zeros(8 * (HELD + 1) * TILE, np.uint32), np.zeros(0, np.uint64), np.uint64(0)
    largest = np.zeros((2, LARGEST))
    counting = Counting(eight, eight, offsets, np.zeros(0))
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
    make_ready(getattr(loops, name), part_arguments(name, rare))
