"""Limits of the figures of ISO 9283: ``RP 0.1 mm @ 95 %``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np

from precision_pin.analyses.iso9283.figure_law import FigureLaw
from precision_pin.analyses.iso9283.pose_forecast import OF_ANGLES, OF_POSE, SINGLE, PoseForecast
from precision_pin.base.arguments import check_text, shown
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.statistics import NO_SPREAD, SpecificationResult, clopper_pearson
from precision_pin.statistics.plan import specification

FIGURES: Final = (*OF_POSE, *SINGLE)


@final
@dataclass(frozen=True)
class FigureLimit:
    """A limit of a figure's absolute value; for a figure of poses, at every pose.

    Attributes
    ----------
    figure
        Its name, such as ``RP``.
    limit
        m or rad.
    required
        Share of robots that must keep it.
    """

    figure: str
    limit: float
    required: float


def listed_limits(given: object) -> tuple[FigureLimit, ...]:
    """Return limits, one text or a list of texts, ``FIGURE LIMIT [@ PROBABILITY]``.

    Raises
    ------
    InputError
        One is no text of this form, the limit is not positive or of another quantity, or the probability lies outside 0 to 1.
    UnknownNameError
        There is no such figure.
    """
    if isinstance(given, str):
        given = (given,)
    if not isinstance(given, list | tuple):
        raise InputError(f"specifications must be a list of texts such as 'RP 0.1 mm @ 95 %', got {shown(given)}")
    return tuple(map(_read, given))


def judge_limits(
    limits: Sequence[FigureLimit],
    poses: Mapping[str, PoseForecast],
    single: Mapping[str, FigureLaw | None],
    absent: Mapping[str, str],
    confidence: float,
) -> tuple[SpecificationResult, ...]:
    """Return the share of robots that keep each limit in a test, and its verdict.

    Raises
    ------
    InputError
        A figure does not exist in this forecast.
    """
    return tuple(_judge(one, _largest(one.figure, poses, single, absent), confidence) for one in limits)


def _read(text: object) -> FigureLimit:
    words = check_text("each of the specifications", text, "RP 0.1 mm @ 95 %").split(maxsplit=1)
    if len(words) < 2:
        raise InputError(f"specification {shown(text)} is not understood; write it as 'RP 0.1 mm @ 95 %'")
    figure, rest = words
    if figure not in FIGURES:
        raise UnknownNameError("figure of a specification", figure, FIGURES)
    found = specification(rest)
    of_angle = found.quantity == "attitude.norm"
    if found.quantity not in ("position.norm", "attitude.norm") or of_angle != (figure in OF_ANGLES):
        raise InputError(
            f"specification {shown(text)}: {figure} is limited by {'an angle' if figure in OF_ANGLES else 'a length'}"
        )
    return FigureLimit(figure, found.limit, found.required)


def _largest(
    figure: str, poses: Mapping[str, PoseForecast], single: Mapping[str, FigureLaw | None], absent: Mapping[str, str]
) -> Array:
    """Return the largest absolute value of a figure over the poses, of each robot."""
    if figure not in single:
        largest: Array = np.abs([getattr(at, figure).values for at in poses.values()]).max(axis=0)
        return largest
    law = single[figure]
    if law is None:
        raise InputError(f"a specification limits {figure}, which this forecast does not have: {absent[figure]}")
    return np.abs(law.values)


def _judge(one: FigureLimit, values: Array, confidence: float) -> SpecificationResult:
    kept = int((values <= one.limit).sum())
    return SpecificationResult(
        one.figure,
        one.limit,
        one.required,
        kept / values.size,
        clopper_pearson(kept, values.size, confidence),
        varies=bool(values.max() - values.min() > NO_SPREAD),
    )
