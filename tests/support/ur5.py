"""A UR5 by the maker's Denavit-Hartenberg table: its flange, and its branches in closed form."""

from __future__ import annotations

import math

import numpy as np

SHOULDER, UPPER, FORE, WRIST_1, WRIST_2, WRIST_3 = 0.089159, 0.425, 0.39225, 0.10915, 0.09465, 0.0823
"""Lengths of a UR5 in the maker's Denavit-Hartenberg table, m."""


def dh(angle: float, offset: float, length: float, twist: float) -> np.ndarray:
    c, s, ct, st = math.cos(angle), math.sin(angle), math.cos(twist), math.sin(twist)
    return np.array(
        [[c, -s * ct, s * st, length * c], [s, c * ct, -c * st, length * s], [0, st, ct, offset], [0, 0, 0, 1]]
    )


def ur5_pose(q) -> np.ndarray:
    """Return the flange of a UR5; the URDF's base is the maker's turned by half a turn."""
    quarter = math.pi / 2
    rows = ((SHOULDER, 0, quarter), (0, -UPPER, 0), (0, -FORE, 0), (WRIST_1, 0, quarter), (WRIST_2, 0, -quarter))
    pose = np.diag([-1.0, -1, 1, 1])
    for angle, row in zip(q, (*rows, (WRIST_3, 0, 0)), strict=True):
        pose = pose @ dh(angle, *row)
    return pose


def ur5_branches(pose) -> list[np.ndarray]:
    """Return the up to eight postures of a UR5 at a flange pose: shoulder left or right, wrist turned or not, elbow up, down."""
    turned = np.diag([-1.0, -1, 1, 1]) @ pose
    (nx, ox, _, px), (ny, oy, _, py) = turned[:2]
    found = []
    wx, wy, _ = turned[:3, 3] - WRIST_3 * turned[:3, 2]
    if math.hypot(wx, wy) < WRIST_1:
        return []
    for shoulder in (1, -1):
        q1 = math.atan2(wy, wx) + shoulder * math.acos(WRIST_1 / math.hypot(wx, wy)) + math.pi / 2
        s, c = math.sin(q1), math.cos(q1)
        cosine = (px * s - py * c - WRIST_1) / WRIST_3
        for wrist in (1, -1) if abs(cosine) <= 1 else ():
            q5 = wrist * math.acos(cosine)
            sine = math.sin(q5)
            q6 = math.atan2((oy * c - ox * s) / sine, (nx * s - ny * c) / sine)
            beyond = dh(q5, WRIST_2, 0, -math.pi / 2) @ dh(q6, WRIST_3, 0, 0)
            plane = np.linalg.inv(dh(q1, SHOULDER, 0, math.pi / 2)) @ turned @ np.linalg.inv(beyond)
            x, y, _ = plane[:3, 3] - WRIST_1 * plane[:3, 1]
            bend = (x * x + y * y - UPPER**2 - FORE**2) / (2 * UPPER * FORE)
            for elbow in (1, -1) if abs(bend) <= 1 else ():
                q3 = elbow * math.acos(bend)
                q2 = math.atan2(-y, -x) - math.atan2(FORE * math.sin(q3), UPPER + FORE * math.cos(q3))
                rest = np.linalg.inv(dh(q2, 0, -UPPER, 0) @ dh(q3, 0, -FORE, 0)) @ plane
                found.append(np.array([q1, q2, q3, math.atan2(rest[1, 0], rest[0, 0]), q5, q6]))
    return found
