"""The MCPC parameters of the chain."""

from __future__ import annotations

import math
from collections.abc import Sequence

from precision_pin.analyses.collect import Missing, Results
from precision_pin.pages.report.wording import left_out
from precision_pin.render.html import Html, paragraph, section, table
from precision_pin.render.tables import plain

_HEADER = ("i", "joint", "offset [°]", "α [°]", "β [°]", "γ [°]", "x [mm]", "y [mm]", "z [mm]")


def geometry(poses: Sequence[Results]) -> Html:
    """Return the table of MCPC parameters, laid out as the paper's Table 1."""
    results, heading = poses[0], "MCPC parameters"
    if isinstance(results.mcpc, Missing):
        return section("mcpc", heading, left_out("MCPC parameters", results.mcpc, results))
    rows = []
    for row in results.mcpc.table:
        joint = "base" if row.joint is None else f"{row.joint} (slides)" if row.prismatic else row.joint
        angles = [
            None if angle is None else math.degrees(angle) for angle in (row.turn, row.alpha, row.beta, row.gamma)
        ]
        lengths = [None if length is None else 1e3 * length for length in (row.x, row.y, row.z)]
        rows.append([str(row.link), joint, *("" if value is None else plain(value) for value in (*angles, *lengths))])
    note = paragraph(
        "The nominal chain in the modified complete and parametrically continuous model of Zhuang, Wang and Roth (1993), "
        "laid out as Table 1 of Wei, Jia and Chen (2015).",
        class_="note",
    )
    return section("mcpc", heading, table("MCPC parameters of the nominal chain", _HEADER, rows, words=(1,)), note)
