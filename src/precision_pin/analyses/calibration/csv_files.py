"""CSV files of readings and of poses to measure, as the commands read them."""

from __future__ import annotations

from collections.abc import Sequence

from precision_pin.analyses.calibration.data import COLUMNS
from precision_pin.base.arrays import Array
from precision_pin.base.files import csv_text
from precision_pin.robot.chain import Chain
from precision_pin.robot.trajectory import joint_columns


def poses_csv(chain: Chain, q: Array) -> str:
    """Return joint values ``(n, P)`` as ``--trajectory`` reads them, in degrees and mm."""
    headings, columns = _joints(chain, q)
    return csv_text(headings, zip(*columns, strict=True))


def readings_csv(chain: Chain, q: Array, kind: str, readings: Array, std: float, comments: Sequence[str]) -> str:
    """Return readings of one robot as ``calibrate`` reads them.

    Parameters
    ----------
    chain, q
        The arm, and its joint values ``(n, P)``.
    kind, readings
        What was measured, and the readings ``(P, m)``, m and rad.
    std
        Standard deviation of their lengths, m.
    comments
        Lines at the top.
    """
    headings, columns = _joints(chain, q)
    more, values = _readings(COLUMNS[kind], readings)
    stds = [_short(1e3 * std)] * len(readings)
    return csv_text([*headings, *more, "std [mm]"], zip(*columns, *values, stds, strict=True), comments)


def cycles_csv(names: Sequence[str], cycles: int, kind: str, readings: Array, comments: Sequence[str]) -> str:
    """Return measured cycles as ``iso9283 --measured`` reads them.

    Parameters
    ----------
    names, cycles
        The poses, and how often each is visited.
    kind, readings
        ``"position"`` or ``"pose"``, and the readings ``(P·n, m)``, m and rad, of all cycles at one pose after another.
    comments
        Lines at the top.
    """
    more, values = _readings(COLUMNS[kind], readings)
    visits = [(name, str(cycle)) for name in names for cycle in range(1, cycles + 1)]
    rows = zip(visits, *values, strict=True)
    return csv_text(["pose", "cycle", *more], ((*visit, *cells) for visit, *cells in rows), comments)


def _joints(chain: Chain, q: Array) -> tuple[list[str], list[list[str]]]:
    """Return headings with units, and the columns of the joints in full."""
    columns = joint_columns(chain.joint_names, chain.prismatic)
    # 1e-12 degrees: what is left of a conversion from degrees and back
    values = [(row / one.factor).tolist() for one, row in zip(columns, q, strict=True)]
    return [one.heading for one in columns], [[repr(round(value, 12)) for value in row] for row in values]


def _readings(names: Sequence[str], readings: Array) -> tuple[list[str], list[list[str]]]:
    """Return headings with units, and the columns of the readings, to 1 nm and 1 nrad."""
    headings = [f"{name} [{'mrad' if name.startswith('r') else 'mm'}]" for name in names]
    return headings, [[_short(value) for value in column] for column in (1e3 * readings.T).tolist()]


def _short(value: float) -> str:
    return f"{value:.6f}"
