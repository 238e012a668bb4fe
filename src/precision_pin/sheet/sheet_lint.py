"""Warnings about contents of a sheet that are valid but probably unintended."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from precision_pin.base import units
from precision_pin.base.errors import Finding, InputError, visible
from precision_pin.draws import lazy_special
from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import Law
from precision_pin.draws.laws.law import write_number
from precision_pin.draws.space import LabelledSpace, Space
from precision_pin.robot.chain import Chain
from precision_pin.robot.urdf import Joint
from precision_pin.sheet.chain_entry import split_pose
from precision_pin.sheet.schema import Document, Findings
from precision_pin.sheet.text import Path, Text
from precision_pin.terms.source import Source

FEW: Final = 30
"""Measured samples below which their spread gets a warning: with 30 the true σ may still be 1.3 times that of the samples."""
_NOMINAL: Final = 20.0
"""Standard deviations of a tolerance from its mean to 0 beyond which the mean is taken for a nominal size."""
_LEVEL: Final = 1e-9
"""Sine of the angle between a joint's axis and gravity that counts as none."""
_CONFIDENCE: Final = 0.95
"""Confidence of the factor in that warning, as of the intervals of results."""


def remark_on_sources(
    document: Document,
    sources: Mapping[int, Source],
    names: Sequence[str],
    space: Space,
    parameters: Sequence[Draw],
    source_draws: Sequence[tuple[Path, Draw]],
    findings: Findings,
) -> None:
    """Warn of settings that are probably unintended; reject laws too wide to compute with."""
    for path, draw in (*((("parameters", draw.name), draw) for draw in parameters), *source_draws):
        with findings.taking(*path):
            _ = draw.covariance
            remark = few_samples(draw.law)
            if remark is not None:
                findings.warning(path, f"{draw.name}: {remark}", "W_FEW_SAMPLES")
    findings.refuse()
    for (k, source), label in zip(sources.items(), names, strict=True):
        for finding in source.remarks(LabelledSpace(space, label)):
            findings.warning(("sources", k, source.kind()), finding.message, finding.code)
    if not sources:
        message = "there are no error sources: every robot is perfect, and no specification can be judged"
        findings.warning(("sources",), message, "W_NO_SOURCES")
    elif not any(np.any(draw.law.covariance) for draw in space.draws):
        message = "no source varies: all robots have the same error, and no specification can be judged"
        findings.warning(("sources",), message, "W_NOTHING_VARIES")
    _remark_on_constants(document, sources, findings)
    _remark_on_sizes(sources, source_draws, findings)
    _remark_on_angles(document, sources, findings)


def _remark_on_constants(document: Document, sources: Mapping[int, Source], findings: Findings) -> None:
    """Warn of plain numbers instead of tolerances, all in one message."""
    constants = [
        (("sources", k, source.kind(), *below), text)
        for k, source in sources.items()
        for below, text in _constants(source, document.sources[k][source.kind()])
    ]
    if constants:
        path, text = constants[0]
        key, size = path[3], text.lstrip(" +-")
        message = (
            f"{key}: {text} is a constant error, the same in every robot{_more(constants)}; write a tolerance as ±{size} (that "
            f"is {{uniform: {size}}}), an intended constant as {{fixed: {text}}}"
        )
        findings.warning(path, message, "W_CONSTANT")


def _remark_on_sizes(sources: Mapping[int, Source], draws: Sequence[tuple[Path, Draw]], findings: Findings) -> None:
    """Warn of a nominal size in the text of a deviation from it."""
    for path, draw in draws:
        key = draw.name.rpartition(".")[2].partition("[")[0]
        mean, variance = float(draw.law.mean_vector[0]), float(draw.law.covariance[0, 0])
        if draw.limits and key in sources[int(path[1])].deviations and abs(mean) > _NOMINAL * math.sqrt(variance):
            message = (
                f"{key}: {draw.limits} is a mean error of {write_number(mean, draw.known_quantities[0])}, the same in every "
                "robot; a deviation is written without the nominal size, as +0.5/-0.1 mm"
            )
            findings.warning((*path, key), message, "W_CONSTANT")


def _remark_on_angles(document: Document, sources: Mapping[int, Source], findings: Findings) -> None:
    """Warn of large angles among errors written in rad, all in one message."""
    parts: list[tuple[Path, Any]] = [(("parameters", name), law) for name, law in document.parameters.items()]
    parts += [(("sources", k), document.sources[k]) for k in sources]
    angles = [((*path, *below), text) for path, part in parts for below, text in _large_angles(part)]
    if angles:
        path, text = angles[0]
        message = f"{text!r} is an error of 2 deg or more{_more(angles)}; did you mean deg, or mrad?"
        findings.warning(path, message, "W_ANGLE_UNIT")


def _more(occurrences: Sequence[object]) -> str:
    return f" (and {len(occurrences) - 1:,} more like it)" if len(occurrences) > 1 else ""


def remark_on_poses(document: Document, chain: Chain, findings: Findings) -> None:
    """Warn of poses with a probably wrong unit, and of a sheet without poses."""
    if not document.poses:
        message = "there are no poses; give joint values with --q"
        findings.warning((), message, "W_NO_POSES")
    rotating = {joint.name: joint for joint in chain.robot.joints if joint.kind != "prismatic"}
    remark = _pose_question(document.locked, rotating)
    if remark is not None:
        findings.warning(("locked",), f"locked: {remark}", "W_ANGLE_UNIT")
    for name, value in document.poses.items():
        remark = pose_remark(split_pose(value, chain)[0], chain)
        if remark is not None:
            findings.warning(("poses", name), f"pose {name!r}: {remark}", "W_ANGLE_UNIT")


def remark_on_gravity(chain: Chain, sources: Mapping[int, Source], findings: Findings) -> None:
    """Warn of loads on a chain whose base is held by another arm or a positioner: gravity is constant in its axes."""
    # a chain that only runs against the file stands on its base; one that runs both ways stands on a link between
    backwards = chain.reversed_joints
    if backwards.all() or not any(source.depends_on == "loads" for source in sources.values()):
        return
    axes = chain.at(np.zeros(len(chain.joints))).joint_jacobian[3:]
    is_level = np.linalg.norm(np.cross(axes, chain.gravity, axis=0), axis=0) < _LEVEL * np.linalg.norm(chain.gravity)
    names = [joint.name for joint, turns in zip(chain.joints, backwards & ~is_level, strict=True) if turns]
    if not names or not chain.gravity.any():
        return
    message = (
        f"gravity is constant in axes of the base {visible(chain.base)}, which {visible(names[0])} turns{_more(names)}: loads "
        "are right at one posture of the base alone; give gravity: none, or gravity in its axes at the posture analysed"
    )
    findings.warning(("base",), message, "W_GRAVITY")


def note_on_normal(text: Text, file: str) -> Finding | None:
    """Return a note on the first ``normal:`` whose value is three standard deviations by default."""
    normals = [normal for key in ("parameters", "sources") for normal in _plain_normals(text.data.get(key), (key,))]
    if not normals:
        return None
    path, half_width = normals[0]
    message = (
        f"normal: {half_width} is a tolerance of ±3σ{_more(normals)}; a standard deviation is written "
        f"normal: {{std: {half_width.lstrip(' ±')}}}"
    )
    return Finding("note", "N_NORMAL", message, file, text.line(path))


def _plain_normals(value: object, below: Path) -> Iterator[tuple[Path, str]]:
    if isinstance(value, Mapping):
        if isinstance(value.get("normal"), str) and "k" not in value:
            yield (*below, "normal"), value["normal"]
        for key, entry in value.items():
            yield from _plain_normals(entry, (*below, key))
    elif isinstance(value, list):
        for k, entry in enumerate(value):
            yield from _plain_normals(entry, (*below, k))


def pose_remark(value: str | list[str] | Mapping[str, str], chain: Chain) -> str | None:
    """Return a question about the unit of a valid pose; ``None`` if the unit is plausible."""
    if isinstance(value, str):
        numbers, unit = units.split(value)
        value = [f"{number!r} {unit}" for number in numbers]
    values = value if isinstance(value, Mapping) else dict(zip(chain.joint_names, value, strict=True))
    return _pose_question(values, {joint.name: joint for joint in chain.joints if joint.kind != "prismatic"})


def few_samples(law: Law) -> str | None:
    """Return a warning about a law of few measured samples; None for any other law.

    Draws from n samples have the samples' variance with divisor n, or less with interpolation: on average below the true
    variance. The warning gives the upper confidence bound of the true standard deviation for normal samples, ``s √((n -
    1)/χ²)`` with the lower quantile of χ² of n - 1 degrees of freedom.
    """
    samples = law.measured
    if samples is None:
        return None
    count = len(samples)
    if count >= FEW:
        return None
    if count == 1:
        return "one measured sample has no spread; give a law with a tolerance about it"
    spread, draw_stds = samples.std(axis=0, ddof=1), np.sqrt(np.diag(law.covariance))
    varies = spread > 0
    if not varies.any():
        return f"{count} measured samples that are all the same have no spread; give a law with a tolerance about them"
    factor = float((draw_stds[varies] / spread[varies]).min())
    largest = math.sqrt((count - 1) / (2 * float(lazy_special.gammaincinv((count - 1) / 2, 1 - _CONFIDENCE))))
    return (
        f"{count} measured samples: draws from them have {factor:.2f} times the samples' standard deviation (divisor n - 1), "
        f"and the true one may be up to {largest:.1f} times the samples' ({_CONFIDENCE:.0%} confidence, for normal numbers); "
        f"give a law with a known spread, or at least {FEW} samples"
    )


def _constants(source: Source, settings: Mapping[str, Any]) -> Iterator[tuple[Path, str]]:
    for key in source.deviations:
        value = getattr(source, key)
        for k, entry in enumerate(value if isinstance(value, tuple) else (value,)):
            if isinstance(entry, float) and entry != 0:
                setting = settings.get(key, "")
                path: Path = (key, k) if isinstance(setting, list) else (key,)
                yield path, str(setting[k] if isinstance(setting, list) else setting)
                if not isinstance(setting, list):
                    break  # several numbers in one text


def _large_angles(value: object, below: Path = ()) -> Iterator[tuple[Path, str]]:
    """Yield path and text of each angle in rad that is large for an error, in settings of a source or in a law."""
    if isinstance(value, Mapping):
        for key, entry in value.items():
            # these angles are large by nature
            if key not in ("roll", "period"):
                yield from _large_angles(entry, (*below, key))
    elif isinstance(value, list):
        for k, entry in enumerate(value):
            yield from _large_angles(entry, (*below, k))
    elif isinstance(value, str) and value.endswith("rad"):
        try:
            numbers, unit = units.split(value.lstrip(" ±+-/"))
        except InputError:
            return
        if unit == "rad" and max(map(abs, numbers)) >= math.radians(2):
            yield below, value


def _pose_question(values: Mapping[str, str], joints: Mapping[str, Joint]) -> str | None:
    """Return a question about joint values with a probably wrong unit; ``None`` if all are plausible."""
    # A value in rad is doubtful if it is outside the joint's limits, or beyond two revolutions without limits, and inside
    # in degrees. A value in degrees is doubtful if all are small and it is close to a multiple of π/4.
    are_small, slips = True, []
    for name, text in values.items():
        if name not in joints:
            continue
        (number, *_), unit = units.split(text)
        if unit == "rad" and _looks_like_degrees(number, joints[name]):
            return f"{name} at {number:g} rad is {math.degrees(number):.4g} deg; did you mean deg?"
        if unit in ("deg", "°"):
            are_small = are_small and abs(number) <= 2 * math.pi
            eighths = abs(number) / (math.pi / 4)
            # this close to a multiple of π/4, assume a rounded constant
            if round(eighths) and abs(eighths - round(eighths)) * math.pi / 4 < 0.002 and number != round(number):
                slips.append(f"{name} at {number:g} deg looks like {round(eighths) / 4:g} π; did you mean rad?")
    return slips[0] if are_small and slips else None


def _looks_like_degrees(number: float, joint: Joint) -> bool:
    limit = None if joint.kind == "continuous" else joint.limit
    if limit is None or math.isinf(limit.lower) or math.isinf(limit.upper):
        return abs(number) > 2 * 2 * math.pi  # two turns
    return not limit.lower <= number <= limit.upper and limit.lower <= math.radians(number) <= limit.upper
