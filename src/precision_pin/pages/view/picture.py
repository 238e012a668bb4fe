"""A still picture of the arm and the cloud, SVG, for readers whose browser cannot draw the scene."""

from __future__ import annotations

from typing import Final

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.pages.view.scales import picture_axes
from precision_pin.robot.chain import Posture

_WIDTH: Final = 600
_HEIGHT: Final = 500
_MARGIN: Final = 30
_DOTS: Final = 400


def picture(posture: Posture, positions: Array, factor: float, direction: Array, label: str) -> str:
    """Return the arm as lines between its joints, and sampled positions about its tip, as an SVG element.

    Args:
        posture: The arm.
        positions: Position errors ``(3, N)``, m, from what is drawn at the tip.
        factor: By how much they are drawn too large.
        direction: From where it is seen.
        label: What the picture shows, escaped.
    """
    axes = picture_axes(direction)
    arm = axes @ np.vstack([posture.link_poses[:, :3, 3], posture.pose[:3, 3]]).T
    cloud = arm[:, -1:] + factor * (axes @ positions[:, :_DOTS])
    low, high = (end(np.hstack([arm, cloud]), axis=1) for end in (np.min, np.max))
    room = np.array([_WIDTH - 2 * _MARGIN, _HEIGHT - 2 * _MARGIN])
    per_metre = float((room / np.maximum(high - low, 1e-9)).min())
    middle = np.array([_WIDTH / 2, _HEIGHT / 2])

    def drawn(points: Array) -> list[str]:
        pixels = middle[:, None] + per_metre * np.array([[1], [-1]]) * (points - (low + high)[:, None] / 2)
        return [f"{x:.1f} {y:.1f}" for x, y in pixels.T]

    joints = drawn(arm)
    dots = "".join(f"M{place}h0" for place in drawn(cloud))
    return (
        f"<svg viewBox='0 0 {_WIDTH} {_HEIGHT}' role='img' aria-label='{label}'>"
        f"<path d='M{'L'.join(joints)}' fill='none' stroke='#5b7a99' stroke-width='7' stroke-linejoin='round'/>"
        f"<path d='{''.join(f'M{place}h0' for place in joints)}' stroke='#de8c33' stroke-width='13' stroke-linecap='round'/>"
        f"<path d='{dots}' stroke='#21918c' stroke-width='3' stroke-linecap='round'/></svg>"
    )
