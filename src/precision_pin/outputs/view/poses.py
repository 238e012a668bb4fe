"""Data of each pose for the page: poses of links, errors to draw, texts."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from typing import Any, Final, final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.display.html import escaped
from precision_pin.errors import InputError
from precision_pin.outputs.view.arm import Part
from precision_pin.outputs.view.ellipsoids import ellipsoids
from precision_pin.outputs.view.shown import Shown
from precision_pin.robot import mcpc
from precision_pin.robot.chain import Posture
from precision_pin.typing import Array

__all__ = ["MOST_FRAMES", "MOST_GHOSTS", "PoseData", "columns", "mcpc_frames"]


MOST_FRAMES: Final = 5
"""How many sampled end-effector frames are drawn."""

MOST_GHOSTS: Final = 3
"""How many arms as built."""


@final
class PoseData:
    """One pose of the page.

    Parameters
    ----------
    shown
        The pose and its errors ``(6, N)``, checked.
    seed
        Of the samples.
    parts
        Of the drawn arm.
    points
        How many samples to draw at most.
    number, count
        Which of how many poses this is, from 1.
    """

    def __init__(self, shown: Shown, seed: int, parts: Sequence[Part], *, points: int, number: int, count: int) -> None:
        self._at = shown.pose_model
        self._errors = shown.errors
        self._parts = parts
        self._shown = shown
        self._points = min(points, shown.errors.shape[1])
        self._title = " ".join(
            [*([shown.name] if shown.name else []), *([f"({number} of {count})"] if count > 1 else [])]
        )
        self.ellipsoids = ellipsoids(self._errors[:3])
        self.ghosts = self._as_built(seed)
        self.deflected = self._displacements(self._at.space.mean[:, None])[:, :, 0]

    @property
    def texts(self) -> dict[str, str]:
        """Texts of the page by the identifier of their element, not yet escaped."""
        samples = self._errors.shape[1]
        drawn = "" if self._points == samples else f", of which the first {self._points:,} are drawn"
        inside = [f"{100 * one.inside:.2f} % of the samples inside" for one in self.ellipsoids]
        none = ["none, too few samples or no spread"] * 2
        return {
            "pose-text": self._title or "without a name",
            "caption-pose": self._title or "without a name",
            "caption-joints": _joints(self._at.posture),
            "caption-samples": f"N = {samples:,}{drawn}",
            "drawn": f"{self._points:,}",
            **dict(zip(("inside-inner", "inside-outer"), inside or none, strict=True)),
        }

    @property
    def settings(self) -> dict[str, Any]:
        """The pose as the page's script reads it; matrices are 16 numbers by columns, many numbers base64 of float32."""
        posture, errors = self._at.posture, self._errors
        return {
            "links": [columns(pose) for pose in posture.link_poses],
            "tip": columns(posture.pose),
            "points": _packed(errors[:3, : self._points].T),
            "mean": errors[:3].mean(axis=1).tolist(),
            "ellipsoids": [columns(one.matrix) for one in self.ellipsoids],
            "frames": errors[:, :MOST_FRAMES].T.tolist(),
            "targets": _packed(self._at.table.frames.swapaxes(1, 2)),
            "before": [part.targets_before(self._at.table.targets) for part in self._parts],
            "ghosts": [_packed(displacements) for displacements in self.ghosts],
            "deflected": _packed(self.deflected),
            # the script puts them in as text, never as markup
            "texts": {name: html.unescape(escaped(text)) for name, text in self.texts.items()},
        }

    def _displacements(self, x: Array) -> Array:
        """Return every target's displacement ``(K, 6, N)`` for component values ``(d, N)``."""
        table = self._at.table
        return table.displacements(table.products(table.program.evaluate(x)))

    def _as_built(self, seed: int) -> tuple[Array, ...]:
        """Return the targets' displacements ``(K, 6)`` of the first units; none if the errors are not theirs."""
        count = min(MOST_GHOSTS, self._errors.shape[1])
        x = self._at.space.sample(seed, 0, count, pose=self._shown.pose)
        given = self._errors[:, :count]
        for errors_of in (self._at.exact, self._at.linear):
            try:
                same = np.allclose(errors_of(x), given, rtol=1e-6, atol=1e-12)
            except InputError:
                continue
            if same and len(self._at.table.targets):
                return tuple(self._displacements(x).transpose(2, 0, 1))
        return ()


def mcpc_frames(posture: Posture) -> list[dict[str, Any]]:
    """Return the MCPC frames 0 to n + 1 (Wei, Jia and Chen, 2015, Fig 4): chain link, and pose in its axes.

    Frame i stands on link i, after the joint turned; frame n + 1 is the tip's.
    """
    frames = mcpc.from_chain(posture.chain).frame_in_link
    standing = [*enumerate(frames), (len(frames) - 1, posture.chain.placements[-1])]
    return [{"link": link, "frame": columns(frame)} for link, frame in standing]


def columns(pose: ArrayLike) -> list[float]:
    """Return a pose ``(4, 4)`` as 16 numbers by columns."""
    numbers: list[float] = np.asarray(pose, dtype=float).T.reshape(-1).tolist()
    return numbers


def _packed(numbers: ArrayLike) -> str:
    return base64.b64encode(np.asarray(numbers, dtype="<f4").tobytes()).decode("ascii")


def _joints(posture: Posture) -> str:
    return ", ".join(
        f"{joint.name} {1e3 * value:.5g} mm" if joint.kind == "prismatic" else f"{joint.name} {np.degrees(value):.5g}°"
        for joint, value in zip(posture.chain.joints, posture.q, strict=True)
    )
