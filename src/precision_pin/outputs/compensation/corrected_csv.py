"""Corrected joint values as a trajectory file."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

from precision_pin.analyses.compensation.compensation_result import CompensationResult

__all__ = ["corrected_csv"]


def corrected_csv(result: CompensationResult, columns: Sequence[str] = ()) -> str:
    """Return the corrected joint values as ``--trajectory`` reads them: a row of names, then a row for each pose, rad and m.

    Parameters
    ----------
    result
        Every pose of it has corrected joint values.
    columns
        Joint names, and ``t`` for the times, in the order wanted; times first, then the chain's order, if left out.
    """
    times = result.poses.times
    of = {name: result.corrected[row] for row, name in enumerate(result.joints)}
    if times is not None:
        of = {"t": times, **of}
    order = list(columns) or list(of)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(order)
    writer.writerows([[repr(float(of[name][pose])) for name in order] for pose in range(len(result.poses))])
    return text.getvalue()
