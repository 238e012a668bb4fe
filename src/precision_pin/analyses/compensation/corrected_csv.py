"""Corrected joint values as a trajectory file."""

from __future__ import annotations

from collections.abc import Sequence

from precision_pin.analyses.compensation.compensation_result import CompensationResult
from precision_pin.base.files import csv_text
from precision_pin.robot.trajectory import Column, joint_columns


def corrected_csv(result: CompensationResult, columns: Sequence[Column] = ()) -> str:
    """Return the corrected joint values as ``--trajectory`` reads them: a row of names, then a row for each pose.

    Parameters
    ----------
    result
        Every pose of it has corrected joint values.
    columns
        The columns wanted, with their units; times first, then the chain's order, in s, degrees and mm, if left out.
    """
    times = result.poses.times
    of = {name: result.corrected[row] for row, name in enumerate(result.joints)}
    order = list(columns)
    if not order:
        order = [Column("t [s]", "")] if times is not None else []
        order += joint_columns(result.joints, result.prismatic)
    if times is not None:
        of[""] = times
    values = [(of[column.joint] / column.factor).tolist() for column in order]
    rows = [[repr(value) for value in row] for row in zip(*values, strict=True)]
    return csv_text([column.heading for column in order], rows)
