"""The page: the scene, the controls beside it, and its caption, as one HTML text."""

from __future__ import annotations

import base64
import hashlib
import importlib.resources
import json
import os
import string
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Final

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError, InternalError
from precision_pin.pages.view import scales
from precision_pin.pages.view.arm import draw_arm
from precision_pin.pages.view.datum import DatumLayer
from precision_pin.pages.view.headline import CONFIDENCE, LEVELS, as_html, limit_text, mean_size
from precision_pin.pages.view.poses import (
    MOST_FRAMES,
    PageData,
    PoseData,
    ViewPose,
    choose_groups,
    columns,
    limits_attitude,
    share_rows,
    shown_names,
)
from precision_pin.render.display_units import ColourScale, round_number
from precision_pin.render.html import escaped
from precision_pin.render.scene import Layer, Scene, viewer_script
from precision_pin.robot import mcpc
from precision_pin.robot.chain import Posture
from precision_pin.statistics import Specification
from precision_pin.statistics.limits import LIMITED

_SCRIPTS_BEFORE: Final = ("stage", "cloud")
_SCRIPTS_AFTER: Final = ("frames", "arms", "tolerances", "headline", "camera", "pointer", "controls")
"""Own scripts before and after those of the layers."""
_GRID_HALF: Final = 8
_PICTURE: Final = (600, 500)
_DRAWN: Final = (0, 1, 2, 3)
"""Rows of the quantities whose limits are drawn."""
"""Width and height of the still picture."""


def page(
    shown: Sequence[ViewPose],
    *,
    title: str = "",
    seed: int,
    model_name: str,
    factor: float | None = None,
    caption: Iterable[tuple[str, str]] = (),
    points: int = scales.DEFAULT_POINTS,
    package_dirs: Sequence[str | os.PathLike[str]] = (),
    specifications: Sequence[Specification] = (),
    headline: Sequence[str] = (),
    remarks: Sequence[str] = (),
    layers: Sequence[Layer] = (),
) -> str:
    """Return a self-contained HTML page of the arm and its sampled errors; the same input gives the same text.

    The arm is drawn undisplaced; end-effector positions of the samples are drawn at the nominal tip plus a factor times
    their error, or their error minus its mean, as initially if at some pose the mean is far larger than the spread
    (:func:`.scales.middle_of`). A slider changes the factor of everything that shows errors: sampled end-effector
    frames are turned by ``Exp(factor·δ)``, by 90° at most; arms as built (units 0 to 2 of ``seed``) are the chain
    multiplied out with every displacement ``[d; δ]`` times the factor. The largest contributors have a slider each,
    which widens or narrows a tolerance, to first order. Both are left out if the errors do not belong to that seed.

    Args:
        shown: The poses, all of one chain, and their errors; several get a slider.
        title: Heading (default: the robot and the ends of its chain).
        seed, model_name: Origin of the errors.
        factor: Initial exaggeration; by default the cloud spans about a quarter of the picture's width.
        caption: Further rows of the caption, ``(name, text)``.
        points: Largest number of samples drawn at each pose: the first ones. All poses together draw at most 100,000.
        package_dirs: Folders of packages for ``package://`` mesh names, in addition to those found around the URDF.
        specifications: Limits; the page states at its top whether they are kept, and draws those of the position.
        headline: Answers above that of the robots shown, each with the line between it and the next.
        remarks: Basis of the answer, one line each below it.
        layers: Layers beside the arm and its errors, such as a map or a path of the same chain.
    """
    if factor is not None:
        scales.check_factor(factor)
    poses = _checked(shown)
    datum = poses[0].pose_model.datum
    layers = layers if datum is None else (*layers, DatumLayer(datum.procedures))
    if isinstance(points, bool) or not isinstance(points, int | np.integer) or not 1 <= points <= scales.MOST_POINTS:
        raise InputError(f"the cloud can show 1 to {scales.MOST_POINTS:,} points, got {points!r}")
    posture = poses[0].pose_model.posture
    title = title or f"{posture.chain.robot.name}: {posture.chain.base} to {posture.chain.tip_label}"
    length = scales.arm_length(posture)
    direction = scales.view_direction(posture, poses[0].errors[:3])
    about_mean = any(scales.middle_of(pose.errors[:3]).any() for pose in poses)
    factors = [float(factor)] * 2 if factor is not None else _factors(poses, direction)
    first_factor = factors[about_mean]
    scale = ColourScale.of(np.concatenate([np.linalg.norm(pose.errors[:3], axis=0) for pose in poses]))
    spacing = round_number(0.125 * length)
    scene = Scene()
    parts, notes = draw_arm(scene, posture, [Path(folder) for folder in package_dirs])
    _draw_grid(scene, spacing)
    for layer in layers:
        layer.draw(scene, length)
    pose_models = [pose.pose_model for pose in poses]
    groups = choose_groups(pose_models, poses[0].words, attitude=limits_attitude(specifications))
    most = min(points, scales.MOST_POINTS // len(poses))
    common = PageData(seed, parts, most, len(poses), groups, specifications)
    data = [PoseData(pose, common, number) for number, pose in enumerate(poses, start=1)]
    # MCPC frames 0 to n + 1, the tip (Wei, Jia and Chen, 2015, Fig 4), each in its chain link
    frames = mcpc.from_chain(posture.chain).frame_in_link
    standing = [*enumerate(frames), (len(frames) - 1, posture.chain.placements[-1])]
    settings = {
        "factor": first_factor,
        "factors": factors,
        "aboutMean": about_mean,
        "far": scales.FAR,
        "smallest": min(1.0, *factors),
        "largest": 10 * max(1.0, *factors),
        "length": length,
        "layers": {layer.name: layer.settings(length) for layer in layers},
        "frame": 0.06 * length,
        "from": direction.tolist(),
        "stops": scale.stops,
        "darkStops": scale.dark_stops,
        "colours": [scale.smallest, scale.largest],
        "parts": [{"name": part.name, "link": part.link, "frame": columns(part.frame)} for part in parts],
        "mcpc": [{"link": link, "frame": columns(frame)} for link, frame in standing],
        **_settings_of_answers(data, common),
        "joints": shown_names(posture.chain.joint_names),
    }
    texts = data[0].texts
    spans = {name: f"<span id='{name}'>{escaped(text)}</span>" for name, text in texts.items()}
    errors = poses[0].errors[:3]
    middle = errors.mean(axis=1, keepdims=True)
    # as the page's script also writes it
    about = f"from the mean error, which is {mean_size(errors)} mm" if about_mean else "from zero error"
    rows = (
        ("robot", escaped(posture.chain.robot.name)),
        ("from – to", escaped(f"{posture.chain.base} – {posture.chain.tip_label}")),
        *((row, spans[f"caption-{row}"]) for row in ("pose", "joints", "samples")),
        ("seed", escaped(str(seed))),
        ("model", escaped(model_name)),
        ("factor", f"<span id='caption-factor'>{first_factor:,g}</span>"),
        ("drawn", f"<span id='caption-about'>{escaped(about)}</span>"),
        *((name, escaped(text)) for name, text in caption),
    )
    listed = "".join(f"<li>{escaped(note)}</li>" for note in notes)
    label = escaped(f"{title}: the arm, its end-effector frame and sampled positions, described beside it")
    deflected = any(np.any(pose.deflected) for pose in data)
    how = "deflected by its mean loads" if deflected else "the same as without error"
    is_limit_drawn = any(specification.row in _DRAWN for specification in specifications)
    ghosts_line, limit_line = _optional_layers(data, specifications, is_limit_drawn, datum is not None)
    viewer, script = _scripts(layers)
    return string.Template(asset("page.html")).substitute(
        policy=f"default-src 'none'; script-src {' '.join(script_hashes(layers))}; style-src 'unsafe-inline'; "
        "img-src data: blob:; base-uri 'none'; form-action 'none'",
        style=asset("page.css"),
        settings=_data(settings),
        scene=_data([base64.b64encode(command).decode("ascii") for command in scene.commands]),
        viewer=viewer,
        script=script,
        title=escaped(title),
        above="\n".join(
            f"<p class='{('answer', 'fine')[number % 2]}'>{escaped(line)}</p>" for number, line in enumerate(headline)
        ),
        headline=as_html(data[0].answers),
        remarks="\n".join(f"<p class='fine'>{escaped(line[:1].upper() + line[1:])}</p>" for line in remarks),
        label=label,
        picture=_picture(posture, errors - about_mean * middle, first_factor, direction, label),
        still_about=" about their mean" if about_mean else "",
        zero_chosen="" if about_mean else " selected",
        mean_chosen=" selected" if about_mean else "",
        still_pose=escaped(f", pose {texts['pose-text']}") if len(poses) > 1 else "",
        factor_text=f"{first_factor:,g}",
        example=escaped(f"{first_factor:,g} mm long"),
        pose_text=escaped(texts["pose-text"]),
        stops=", ".join(scale.stops),
        unit=scale.unit.name,
        ticks="".join(f"<span>{escaped(tick)}</span>" for tick in scale.ticks),
        drawn=spans["drawn"],
        inside_inner=spans["inside-inner"],
        inside_outer=spans["inside-outer"],
        frames=str(min(MOST_FRAMES, errors.shape[1])),
        last_mcpc=str(len(standing) - 1),
        grid=escaped(f"{spacing:g} m" if spacing >= 1 else f"{1e3 * spacing:g} mm"),
        rows="\n".join(f"<tr><th scope='row'>{escaped(name)}</th><td>{text}</td></tr>" for name, text in rows),
        notes=f"<h2>Notes</h2>\n<ul class='notes'>{listed}</ul>" if notes else "",
        layers="\n".join(layer.legend() for layer in layers),
        deflected=f"arm with every draw at its mean: {how}",
        no_deflected="" if deflected else " disabled",
        no_ellipsoids="" if any(pose.ellipsoids for pose in data) else " disabled",
        # a drawn limit is among the first four
        fourth=limit_line if is_limit_drawn else ghosts_line,
        under_more=ghosts_line if is_limit_drawn else limit_line,
        no_shares="" if groups.names else " disabled",
    )


def _factors(poses: Sequence[ViewPose], direction: Array) -> list[float]:
    """Return the initial exaggeration of errors drawn from zero, and of errors drawn from their mean."""
    postures = [pose.pose_model.posture for pose in poses]

    def choose(*, about_mean: bool) -> float:
        means = [pose.errors[:3].mean(axis=1, keepdims=True) * about_mean for pose in poses]
        return min(
            scales.default_factor(pose.errors[:3] - mean, pose.pose_model.posture, postures, direction)
            for pose, mean in zip(poses, means, strict=True)
        )

    return [choose(about_mean=False), choose(about_mean=True)]


def _draw_grid(scene: Scene, spacing: float) -> None:
    """Draw lines ``spacing`` m apart on the ground."""
    reach = _GRID_HALF * spacing
    steps = spacing * np.arange(-_GRID_HALF, _GRID_HALF + 1)
    ends = [((at, -reach, 0.0), (at, reach, 0.0), (-reach, at, 0.0), (reach, at, 0.0)) for at in steps]
    scene.segments(("grid",), np.concatenate(ends).T, (0.60, 0.64, 0.69, 1.0))


def _settings_of_answers(data: Sequence[PoseData], common: PageData) -> dict[str, object]:
    """Return the settings of what the scripts compute: quantiles, verdicts and the effect of other tolerances."""
    poses = [pose.settings for pose in data]
    return {
        "seed": common.seed,
        "levels": LEVELS,
        "confidence": CONFIDENCE,
        "limits": [
            {
                "row": -1 if specification.row is None else specification.row,
                "limit": specification.limit,
                "parts": [{**asdict(LIMITED[quantity]), "limit": limit} for quantity, limit in specification.parts],
                "required": specification.required,
                "text": limit_text(specification),
            }
            for specification in common.specifications
        ],
        "tolerances": shown_names(common.groups.names),
        "deviations": share_rows(poses),
        "poses": poses,
    }


def _optional_layers(
    data: Sequence[PoseData], specifications: Sequence[Specification], is_drawn: bool, is_in_datum: bool
) -> list[str]:
    """Return the boxes of the arms as built and of the limit on the position, which not every page has."""
    has_ghosts = all(pose.ghosts for pose in data)
    built = f"arms of {len(data[0].ghosts)} sampled robots, as built"
    if is_in_datum:
        built += ", where the datum sees them"
    none = "arms as built: none, the errors are not those of this seed"
    limits = "; ".join(limit_text(specification) for specification in specifications if specification.row in _DRAWN)
    return [
        f'<li><label><input type="checkbox" id="show-{name}"{state}><i class="{mark}"></i>'
        f"<span>{escaped(text)}</span></label></li>"
        for name, mark, text, state in (
            ("ghosts", "arm ghost", built if has_ghosts else none, "" if has_ghosts else " disabled"),
            (
                "limit",
                "ball limit",
                f"limit: {limits or 'none on the position in base axes; --spec states one'}",
                " checked" if is_drawn else " disabled",
            ),
        )
    ]


def _picture(posture: Posture, positions: Array, factor: float, direction: Array, label: str) -> str:
    """Return the arm as lines between its joints, and sampled positions about its tip, as an SVG element.

    Args:
        positions: Position errors ``(3, N)``, m, relative to the point drawn at the tip.
        factor: Their magnification.
        direction: Viewing direction.
        label: Description of the picture, escaped.
    """
    axes = scales.picture_axes(direction)
    arm = axes @ scales.joint_points(posture).T
    cloud = arm[:, -1:] + factor * (axes @ positions[:, :400])
    low, high = (end(np.hstack([arm, cloud]), axis=1) for end in (np.min, np.max))
    room = np.array(_PICTURE) - 2 * 30
    per_metre = float((room / np.maximum(high - low, 1e-9)).min())
    middle = np.array(_PICTURE) / 2

    def drawn(points: Array) -> list[str]:
        pixels = middle[:, None] + per_metre * np.array([[1], [-1]]) * (points - (low + high)[:, None] / 2)
        return [f"{x:.1f} {y:.1f}" for x, y in pixels.T]

    joints = drawn(arm)
    dots = "".join(f"M{place}h0" for place in drawn(cloud))
    return (
        f"<svg viewBox='0 0 {_PICTURE[0]} {_PICTURE[1]}' role='img' aria-label='{label}'>"
        f"<path d='M{'L'.join(joints)}' fill='none' stroke='#5b7a99' stroke-width='7' stroke-linejoin='round'/>"
        f"<path d='{''.join(f'M{place}h0' for place in joints)}' stroke='#de8c33' stroke-width='13' stroke-linecap='round'/>"
        f"<path d='{dots}' stroke='#21918c' stroke-width='3' stroke-linecap='round'/></svg>"
    )


def script_hashes(layers: Sequence[Layer] = ()) -> tuple[str, ...]:
    """Return the sources ``'sha256-…'`` that a content security policy needs to allow every script of a page with layers.

    A frame with ``srcdoc`` inherits the policy of the page around it, which must allow them too.
    """
    return tuple(map(source_hash, _scripts(layers)))


def source_hash(text: str) -> str:
    """Return the source of a content security policy that allows an inline script or style."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode('utf-8')).digest()).decode('ascii')}'"


def _checked(view_poses: Sequence[ViewPose]) -> list[ViewPose]:
    """Return the poses with errors as arrays of numbers, all with equally many sampled frames."""
    if not 1 <= len(view_poses) <= scales.MOST_POSES:
        raise InputError(f"a page shows 1 to {scales.MOST_POSES} poses, got {len(view_poses)}")
    poses = []
    for pose in view_poses:
        if pose.pose_model.posture.chain is not view_poses[0].pose_model.posture.chain:
            raise InputError("all poses of a page must be of one chain")
        values = np.asarray(pose.errors, dtype=float)
        if values.ndim != 2 or values.shape[0] != 6 or values.shape[1] < 1:
            raise InputError(f"errors have shape {values.shape}, expected (6, N) with N of 1 or more")
        if not np.isfinite(values).all():
            raise InputError("errors must be finite numbers")
        poses.append(replace(pose, errors=values))
    if len({pose.errors.shape for pose in poses}) > 1:
        raise InputError("all poses of a page must have equally many samples")
    return poses


def asset(name: str) -> str:
    """Return the text of a file in the folder ``assets``."""
    return importlib.resources.files(__package__).joinpath("assets", name).read_text("utf-8")


def _scripts(layers: Sequence[Layer]) -> tuple[str, str]:
    """Return the page's two scripts, MeshCat's viewer and our own, escaped for script elements."""
    before, after = ("".join(asset(f"{name}.js") for name in names) for names in (_SCRIPTS_BEFORE, _SCRIPTS_AFTER))
    drawn = (
        f"(function (layer, group) {{\n{layer.script}}})(settings.layers[{_data(layer.name)}], kinds[{_data(layer.name)}]);\n"
        for layer in layers
        if layer.script
    )
    page_script = f"{before}{''.join(drawn)}{after}"
    scripts = viewer_script(), f'"use strict";\n(function () {{\n{page_script}}})();'
    for code in scripts:
        if "</script" in code.lower() or "<!--" in code:
            raise InternalError("a script would end its HTML element early")
    return scripts


def _data(value: object) -> str:
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
