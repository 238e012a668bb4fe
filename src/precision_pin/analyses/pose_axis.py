"""The axis of a figure over poses: times, names or order."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from precision_pin.base.arrays import Array
from precision_pin.base.errors import visible
from precision_pin.render.figure_style import shortened
from precision_pin.robot.pose_set import PoseSet

_MOST_NAMED: Final = 12  # poses named below the axis; more are numbered


def mark_poses(axes: Axes, poses: PoseSet, most_letters: int, most_level: int) -> tuple[Array, str]:
    """Label the axis of poses by time, name or order; return the place of each pose, and the marker of its values.

    Names are cut to ``most_letters``, and turned where all together have more than ``most_level`` letters.
    """
    places = np.arange(1.0, len(poses) + 1) if poses.times is None else poses.times
    is_named = len(places) <= _MOST_NAMED
    if poses.times is not None:
        axes.set_xlabel("time [s]")
    elif is_named:
        labels = [shortened(visible(label), most_letters) for label in poses.labels]
        is_rotated = sum(map(len, labels)) > most_level
        axes.set_xticks(places, labels, rotation=45 if is_rotated else 0, ha="right" if is_rotated else "center")
    else:
        axes.set_xlabel("pose, in the order given")
        axes.xaxis.set_major_locator(MaxNLocator(nbins=8, integer=True))
    return places, "o" if is_named else ""
