"""Grid over joint values: every combination of some values of each joint."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base.arguments import check_instance, check_mapping, check_name
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.base.quantity_arguments import check_quantities
from precision_pin.robot.chain import Chain
from precision_pin.robot.configurations import joint_quantity
from precision_pin.robot.pose_set import PoseSet
from precision_pin.robot.urdf import Joint

_DECIMALS: Final = 9
"""Of values in names, mm and degrees."""
MOST_POSES: Final = 2**20 - 1
"""The most poses of a grid: draws of pose scope can be made at no more."""


def joint_grid(chain: Chain, values: Mapping[str, ArrayLike]) -> PoseSet:
    """Return every combination of joint values; the last joint's change fastest.

    Parameters
    ----------
    chain
        The arm.
    values
        For each joint by name its values, rad or m, one or several, or text such as ``"0 30 60 deg"``.

    Raises
    ------
    InputError
        A joint is missing or has no values, a number is not finite, or there are more than 1,048,575 poses.
    UnknownNameError
        No such joint on the chain.
    """
    check_instance("chain", chain, Chain, "as Chain.from_urdf returns it")
    for name in check_mapping("values", values):
        check_name("joint on the chain", name, chain.joint_names)
    missing = [name for name in chain.joint_names if name not in values]
    if missing:
        raise InputError(f"no values for the joints {', '.join(missing)}; a joint that is held has one value")
    rows = [_row(joint, values[joint.name]) for joint in chain.joints]
    check_grid_size([len(row) for row in rows])
    q = np.array([axis.ravel() for axis in np.meshgrid(*rows, indexing="ij")])
    return PoseSet.at(chain, chain.configurations.many(q), _names(chain, rows, q))


def check_grid_size(counts: list[int]) -> None:
    """Refuse a grid of more than 1,048,575 poses.

    Parameters
    ----------
    counts
        Numbers of values whose product is the number of poses.

    Raises
    ------
    InputError
        There are more.
    """
    total = 1
    for count in counts:
        total *= count
    if total > MOST_POSES:
        raise InputError(
            f"the grid has {' × '.join(map(str, counts))} = {total:,} poses; at most {MOST_POSES:,} are allowed"
        )


def _row(joint: Joint, values: ArrayLike) -> Array:
    name = joint.name
    row = np.atleast_1d(check_quantities(f"values of {name}", values, joint_quantity(joint)))
    if row.ndim != 1 or not row.size:
        raise InputError(f"values of {name}: expected one or several numbers, got the shape {row.shape}")
    return row


def _names(chain: Chain, rows: list[Array], q: Array) -> tuple[str, ...]:
    """Return the values of the joints that vary, as the name of each pose."""
    varied = [joint for joint, row in enumerate(rows) if len(row) > 1] or list(range(len(rows)))
    words = [
        [
            f"{_written(1e3 * value)} mm" if chain.prismatic[joint] else f"{_written(np.degrees(value))}°"
            for value in q[joint]
        ]
        for joint in varied
    ]
    return tuple(" ".join(word) for word in zip(*words, strict=True))


def _written(value: float) -> str:
    # a grid may reach zero up to a last digit
    return f"{round(float(value), _DECIMALS) + 0.0:.6g}"
