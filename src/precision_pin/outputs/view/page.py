"""The page: the scene, the controls beside it, and its caption, in one HTML text."""

from __future__ import annotations

import base64
import hashlib
import importlib.resources
import json
import math
import os
import string
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin import se3
from precision_pin.chain import Posture
from precision_pin.errors import InputError, InternalError, OutputError
from precision_pin.markup import escaped
from precision_pin.model import PoseModel

from .arm import draw_arm
from .scales import DEFAULT_POINTS, MOST_POINTS, ColourScale, arm_length, default_factor, round_number
from .scene import Colour, Scene, rotation_to, viewer_script

__all__ = ["page", "write_page"]

Array = NDArray[np.float64]

# Okabe and Ito (2008): vermilion, bluish green, blue stay apart for colour-blind readers
_AXES: Final[tuple[Colour, ...]] = ((0.835, 0.369, 0.0, 1.0), (0.0, 0.620, 0.451, 1.0), (0.0, 0.447, 0.698, 1.0))
_GRID: Final[Colour] = (0.60, 0.64, 0.69, 1.0)
_LINE: Final[Colour] = (0.1, 0.1, 0.1, 1.0)
_MOST_FRAMES: Final = 5
# shares of the arm's length
_FRAME_LENGTH: Final = 0.06
_GRID_SPACING: Final = 0.125
_GRID_HALF: Final = 8


def page(
    pose_model: PoseModel,
    errors: ArrayLike,
    *,
    title: str,
    seed: int,
    model_name: str,
    factor: float | None = None,
    pose_name: str | None = None,
    caption: Iterable[tuple[str, str]] = (),
    points: int = DEFAULT_POINTS,
    package_dirs: Sequence[str | os.PathLike[str]] = (),
) -> str:
    """Return a self-contained HTML page that shows the arm and its sampled errors.

    The arm stands undisplaced; end-effector positions of the samples are drawn at the nominal tip plus ``factor``
    times their error, coloured by the true size of the error, and a slider in the page changes the factor. A few
    sampled end-effector frames are moved and turned by the same factor, ``Exp(factor·δ)·R``, by 90° at most. The same
    input gives the same text.

    Parameters
    ----------
    pose_model
        The model at the pose.
    errors
        Its errors ``(6, N)``, ``[d; δ]`` in base axes, m and rad.
    title
        Heading.
    seed, model_name
        Where the errors come from, for the caption.
    factor
        Exaggeration at first; chosen so that the cloud spans about 7 % of the arm's length if left out.
    pose_name
        The pose's name, for the caption.
    caption
        Further rows of the caption, ``(name, text)``.
    points
        How many samples to draw at most: the first ones.
    package_dirs
        Folders of packages for ``package://`` mesh names, beside those found around the URDF.

    Raises
    ------
    InputError
        Errors of another shape, none, or not finite; a factor that is not positive; more than 100,000 points.
    """
    values = _checked_errors(errors)
    if isinstance(points, bool) or not isinstance(points, int | np.integer) or not 1 <= points <= MOST_POINTS:
        raise InputError(f"the cloud can show 1 to {MOST_POINTS:,} points, got {points!r}")
    posture = pose_model.posture
    length = arm_length(posture)
    first_factor = default_factor(values[:3], length) if factor is None else float(factor)
    if not (math.isfinite(first_factor) and first_factor > 0):
        raise InputError(f"the exaggeration factor must be a positive number, got {factor!r}")
    drawn = values[:, :points]
    scale = ColourScale.of(np.linalg.norm(values[:3], axis=0))
    frames = drawn[:, :_MOST_FRAMES]
    spacing = round_number(_GRID_SPACING * length)

    scene = Scene()
    notes = draw_arm(scene, posture, [Path(folder) for folder in package_dirs])
    _draw_grid(scene, spacing)
    _draw_frame(scene, ("tip",), _FRAME_LENGTH * length, 0.035)
    scene.place(("tip",), posture.pose)
    for number in range(frames.shape[1]):
        _draw_frame(scene, ("frames", f"frame{number}"), 0.7 * _FRAME_LENGTH * length, 0.018)
    scene.points(("cloud",), drawn[:3], scale(np.linalg.norm(drawn[:3], axis=0)).T)
    scene.segments(("cloud", "mean"), np.stack([np.zeros(3), values[:3].mean(axis=1)], axis=1), _LINE)
    scene.place(("cloud",), se3.translation(posture.pose[:3, 3]))

    rows = [
        *_caption(posture, pose_name),
        ("samples", _counted(drawn.shape[1], values.shape[1])),
        ("seed", str(seed)),
        ("model", model_name),
        *caption,
    ]
    settings = {
        "factor": first_factor,
        "smallest": min(1.0, first_factor),
        "largest": 10 * max(1.0, first_factor),
        "frames": frames.T.tolist(),
        "tip": posture.pose[:3, 3].tolist(),
        "rotation": se3.pose(posture.pose[:3, :3], (0.0, 0.0, 0.0)).T.reshape(-1).tolist(),
        "from": _direction(posture).tolist(),
        "length": length,
        "closest": _FRAME_LENGTH * length,
    }
    return _assembled(
        scene.commands,
        settings,
        title=escaped(title),
        label=escaped(f"{title}: the arm, its end-effector frame and {drawn.shape[1]:,} sampled positions"),
        factor_text=f"{first_factor:,g}",
        example=escaped(f"{first_factor:,g} mm long"),
        stops=", ".join(scale.stops),
        unit=scale.unit[0],
        ticks="".join(f"<span>{escaped(tick)}</span>" for tick in scale.ticks),
        frames=str(frames.shape[1]),
        grid=escaped(f"{spacing:g} m" if spacing >= 1 else f"{1e3 * spacing:g} mm"),
        rows="\n".join(f"<tr><th scope='row'>{escaped(name)}</th><td>{escaped(text)}</td></tr>" for name, text in rows),
        notes=_list(notes),
    )


def write_page(path: str | os.PathLike[str], text: str) -> None:
    """Write a page as UTF-8; it is never seen half-written.

    Raises
    ------
    OutputError
        The folder does not exist or cannot be written to.
    """
    target = Path(path)
    temporary: Path | None = None
    try:
        temporary = target.with_name(f".page.{os.getpid()}.part")
        temporary.unlink(missing_ok=True)
        with temporary.open("xb") as stream:
            stream.write(text.encode("utf-8"))
        temporary.replace(target)
    except (OSError, ValueError) as problem:
        reason = getattr(problem, "strerror", None) or str(problem)
        raise OutputError(
            f"cannot write {str(target)!r}: {reason}; give a file in a folder that can be written"
        ) from None
    finally:
        if temporary is not None:
            with suppress(OSError, ValueError):
                temporary.unlink(missing_ok=True)


def _checked_errors(errors: ArrayLike) -> Array:
    values = np.asarray(errors, dtype=float)
    if values.ndim != 2 or values.shape[0] != 6 or values.shape[1] < 1:
        raise InputError(f"errors have shape {values.shape}, expected (6, N) with N of 1 or more")
    if not np.isfinite(values).all():
        raise InputError("errors must be finite numbers")
    return values


def _draw_frame(scene: Scene, path: tuple[str, ...], length: float, thickness: float) -> None:
    """Draw three axes; ``thickness`` is a rod's radius as a share of its length."""
    for name, axis, colour in zip("xyz", np.eye(3), _AXES, strict=True):
        middle = se3.pose(rotation_to(axis), 0.5 * length * axis)
        scene.cylinder((*path, name), thickness * length, length, colour, middle)


def _draw_grid(scene: Scene, spacing: float) -> None:
    reach = _GRID_HALF * spacing
    ends = []
    for step in range(-_GRID_HALF, _GRID_HALF + 1):
        at = step * spacing
        ends += [(at, -reach, 0.0), (at, reach, 0.0), (-reach, at, 0.0), (reach, at, 0.0)]
    scene.segments(("grid",), np.array(ends).T, _GRID)


def _direction(posture: Posture) -> Array:
    """Return whence to look, base axes: across the plane of the arm, a little from its front and from above."""
    points = np.vstack([posture.link_poses[:, :3, 3], posture.pose[:3, 3]])
    spread = points[:, :2] - points[0, :2]
    farthest = spread[np.argmax(np.linalg.norm(spread, axis=1))]
    size = float(np.linalg.norm(farthest))
    front = farthest / size if size > 1e-6 * arm_length(posture) else np.array([1.0, 0.0])
    return np.array([front[1] + 0.35 * front[0], -front[0] + 0.35 * front[1], 0.45])


def _caption(posture: Posture, pose_name: str | None) -> list[tuple[str, str]]:
    chain = posture.chain
    values = [
        f"{joint.name} {1e3 * value:.5g} mm" if joint.kind == "prismatic" else f"{joint.name} {np.degrees(value):.5g}°"
        for joint, value in zip(chain.joints, posture.q, strict=True)
    ]
    rows = [("robot", chain.robot.name), ("from – to", f"{chain.base} – {chain.tip}")]
    if pose_name is not None:
        rows.append(("pose", pose_name))
    return [*rows, ("joints", ", ".join(values))]


def _counted(drawn: int, samples: int) -> str:
    return f"N = {samples:,}" if drawn == samples else f"N = {samples:,}, of which the first {drawn:,} are drawn"


def _list(notes: Sequence[str]) -> str:
    if not notes:
        return ""
    return "<h2>Notes</h2>\n<ul class='notes'>" + "".join(f"<li>{escaped(note)}</li>" for note in notes) + "</ul>"


def _assembled(commands: Sequence[bytes], settings: dict[str, object], **fields: str) -> str:
    viewer, script = _script(viewer_script()), _script(_asset("page.js"))
    hashes = " ".join(f"'sha256-{_sha256(code)}'" for code in (viewer, script))
    policy = (
        f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )
    return string.Template(_asset("page.html")).substitute(
        fields,
        policy=policy,
        style=_asset("page.css"),
        settings=_data(settings),
        scene=_data([base64.b64encode(command).decode("ascii") for command in commands]),
        viewer=viewer,
        script=script,
    )


def _asset(name: str) -> str:
    return importlib.resources.files(__package__).joinpath(name).read_text("utf-8")


def _script(code: str) -> str:
    """Return code that can stand in a script element as it is."""
    if "</script" in code.lower() or "<!--" in code:
        raise InternalError("the viewer's script would end its HTML element early")
    return code


def _data(value: object) -> str:
    """Return JSON that can stand in a script element."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def _sha256(code: str) -> str:
    return base64.b64encode(hashlib.sha256(code.encode("utf-8")).digest()).decode("ascii")
