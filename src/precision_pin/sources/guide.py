"""Guide of a joint that slides."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, ClassVar, Final

import numpy as np

from precision_pin.base import csv_columns
from precision_pin.base.errors import nearest
from precision_pin.robot.postures import alignment
from precision_pin.sources.periodic import amplitude_remarks, phase_draw, phased_terms
from precision_pin.sources.places import block_diagonal
from precision_pin.terms import (
    Array,
    Chain,
    Dependence,
    Draw,
    Finding,
    InputError,
    LabelledSpace,
    Place,
    Posture,
    Setting,
    Source,
    Term,
    entry_name,
    units,
)

_LETTERS: Final = dict.fromkeys(("EXX", "EYX", "EZX"), units.LENGTH) | dict.fromkeys(("EAX", "EBX", "ECX"), units.ANGLE)
"""Errors of ISO 230-1 with their quantities, in the order of ``[d; δ]``."""
_MEANINGS: Final = ("positioning", "straightness", "straightness", "roll", "angle", "angle")
_TRAVEL: Final = "travel"
"""Column of a table with the joint's value."""
_BEYOND: Final = 1e-9
"""Travel (m) beyond a table that is rounding."""
_FLAT: Final = 1e-12
"""Deviation (m) from a line that is rounding."""


@dataclass(frozen=True, kw_only=True)
class Guide(Source):
    """Error motions of a linear axis (ISO 230-1), as if it were named X: the carriage is displaced at its travel x.

    ``E = Trans(EXX, EYX, EZX) · Exp(EAX, EBX, ECX)`` after the motion of the joint, at the origin of its child link. X is the
    joint's axis in the file, Y and Z follow in the order x, y, z, x of the joint's frame: y and z for a joint along x, x and y
    for one along z. Each error is a table, linear between its rows, or harmonics of the travel, ``Σ t_n/2 sin(2πn x/L + φ_n)``,
    t_n from peak to valley and each φ_n random but the same at all poses of one robot; what is given both ways adds. A
    harmonic ends as high as it began: straightness has no slope, which is squareness, geometry.

    A short carriage follows the rail, so that its angles are the slopes of the straightness, ``ECX = dEYX/dx``,
    ``EBX = -dEZX/dx``; a long one averages. Angles that are not given are zero, those that are given independent.

    Attributes:
        joint: The joint, which slides.
        EXX: Positioning error, peak to valley: one for each of the orders.
        EYX, EZX: Straightness in Y and Z.
        EAX: Roll, about X.
        EBX, ECX: Angles about Y and Z, pitch and yaw.
        order: n, whole numbers: periods in the length.
        length: L (default: from the lower to the upper limit of the joint).
        short_carriage: Whether EBX and ECX are the slopes of the harmonics of EZX and EYX.
        file: A CSV file with a column ``travel`` and columns among the six errors, with the unit after each name: ``travel
            [mm], EYX [um], EBX [urad]``.

    Raises:
        InputError: No error, or a negative one; orders that are none, or do not fit; angles of a short carriage, or no
            straightness; an unusable table, or one that does not reach the travel of a pose; a joint that turns, or has no
            limits.

    Examples:
        >>> rail = '<joint name="rail" type="prismatic"><parent link="base"/><child link="table"/><axis xyz="1 0 0"/>'
        >>> rail += '<limit lower="0" upper="1" effort="1" velocity="1"/></joint>'
        >>> chain = pp.Chain.from_urdf(f'<robot name="slide"><link name="base"/>{rail}<link name="table"/></robot>')
        >>> source = pp.sources.Guide(joint="rail", EYX=(20e-6,))
        >>> at = pp.ErrorModel(chain, pp.Space(), [source]).at([0.3])
        >>> print((1e6 * np.sqrt(np.diag(at.covariance)[:3])).round(3))
        [0.    7.071 0.   ]
    """

    depends_on: ClassVar[Dependence] = "configuration"
    takes_many: ClassVar[bool] = True
    words: ClassVar[Mapping[str, str]] = {
        f"{name}{suffix}": f"{meaning} {name} of {{subject}}{text}"
        for name, meaning in zip(_LETTERS, _MEANINGS, strict=True)
        for suffix, text in (("", ""), ("_phase", ", phase"))
    }

    joint: str
    EXX: Annotated[tuple[Setting, ...], units.LENGTH] = ()
    EYX: Annotated[tuple[Setting, ...], units.LENGTH] = ()
    EZX: Annotated[tuple[Setting, ...], units.LENGTH] = ()
    EAX: Annotated[tuple[Setting, ...], units.ANGLE] = ()
    EBX: Annotated[tuple[Setting, ...], units.ANGLE] = ()
    ECX: Annotated[tuple[Setting, ...], units.ANGLE] = ()
    order: Annotated[tuple[float, ...], units.RATIO] = (1.0,)
    length: Annotated[float | None, units.LENGTH] = None
    short_carriage: bool = False
    file: Path | None = None

    def __post_init__(self) -> None:
        if not self._tolerances and self.file is None:
            raise InputError(f"guide needs one of {', '.join(f'{name}:' for name in _LETTERS)} and file:")
        if any(not (order >= 1 and float(order).is_integer()) for order in self.order):
            raise InputError(
                f"order of guide must be 1, 2, 3, …, got {', '.join(f'{order:g}' for order in self.order)}"
            )
        for name, values in self._tolerances.items():
            if len(values) != len(self.order):
                raise InputError(f"guide needs one {name}: for each order:, got {len(values)} and {len(self.order)}")
            if any(isinstance(value, float) and value < 0 for value in values):
                raise InputError(f"{name}: of guide, from peak to valley, must not be negative")
        if self.length is not None and not self.length > 0:
            raise InputError(f"the length of guide must be positive, got {self.setting_text('length')}")
        if self.short_carriage and (self.EBX or self.ECX):
            raise InputError(
                "EBX: and ECX: of guide with short_carriage: are the slopes of EZX: and EYX:; give one of the two"
            )
        if self.short_carriage and not (self.EYX or self.EZX):
            raise InputError("short_carriage: of guide takes the slopes of EYX: and EZX:, and neither is given")
        _ = self._table  # read the file now, so that an error in it is raised here

    @property
    def _tolerances(self) -> dict[str, tuple[Setting, ...]]:
        return {name: values for name in _LETTERS if (values := getattr(self, name))}

    def own_draws(self, label: str) -> tuple[Draw, ...]:
        """Return the phases."""
        return tuple(
            phase_draw(f"{label}.{entry_name(f'{name}_phase', k)}")
            for name, values in self._tolerances.items()
            for k in range(len(values))
        )

    def remarks(self, space: LabelledSpace) -> Iterator[Finding]:
        """Yield a warning for each tolerance that varies about zero, and for a slope of a table's straightness."""
        for name, values in self._tolerances.items():
            for k, value in enumerate(space.values(name, values)):
                yield from amplitude_remarks(entry_name(name, k), value, space, "tolerance", "√8")
        travel, errors = self._table
        for row, name in enumerate(_LETTERS):
            if name not in ("EYX", "EZX") or not errors[row].any():
                continue
            slope, start = np.polyfit(travel, errors[row], 1)
            rise = float(abs(slope) * np.ptp(travel))
            if rise > np.ptp(errors[row] - start - slope * travel) + _FLAT:
                message = (
                    f"{name} of {space.label} rises by {1e6 * rise:.4g} µm along its travel, more than it leaves that line: "
                    "straightness has no slope; take the line out, it is squareness of the axis, such as a frame"
                )
                yield Finding("warning", "W_STRAIGHTNESS", message)

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield a term for the table, and two for each harmonic."""
        chain = posture.chain
        joint = chain.joint_index(self.joint)
        if not chain.prismatic[joint]:
            raise InputError(f"{self.label()}: guide is of a joint that slides; run_out is of one that turns")
        place, to_place = _carriage_of(chain, joint)
        travel = posture.q[joint]
        if self.file is not None:
            yield Term.of(place, to_place @ self._measured_at(travel))
        for row, (name, values) in enumerate((name, getattr(self, name)) for name in _LETTERS):
            for k, tolerance in enumerate(space.values(name, values)):
                rate = 2 * np.pi * self.order[k] / self._length(chain, joint)
                size, slope = to_place[:, row] / 2, to_place @ (self._slope(row) * rate / 2)
                sine, cosine = np.sin(rate * travel), np.cos(rate * travel)
                # sin(rate x + φ), and its derivative for what follows the slope
                twists = [
                    np.multiply.outer(size, wave) + np.multiply.outer(slope, change)
                    for wave, change in ((sine, cosine), (cosine, -sine))
                ]
                yield from phased_terms(place, twists, tolerance, space, entry_name(f"{name}_phase", k))

    def _slope(self, row: int) -> Array:
        """Return the angles of a short carriage for each unit of the derivative of an error."""
        if not self.short_carriage:
            return np.zeros(6)
        return {1: np.eye(6)[5], 2: -np.eye(6)[4]}.get(row, np.zeros(6))

    def _length(self, chain: Chain, joint: int) -> float:
        limit = chain.joints[joint].limit
        length = self.length or (np.inf if limit is None else limit.upper - limit.lower)
        if not 0 < length < np.inf:
            raise InputError(f"{self.label()}: the joint has no limits; give the length: of the travel")
        return float(length)

    @cached_property
    def _table(self) -> tuple[Array, Array]:
        """Travel ``(R,)`` in rising order, and errors ``(6, R)``, of the file; none without a file."""
        if self.file is None:
            return np.zeros(0), np.zeros((6, 0))
        table = csv_columns.read(self.file)
        for name in table.names:
            if name not in (_TRAVEL, *_LETTERS):
                raise InputError(f"{table.file}: unknown column {name!r}: {nearest(name, (_TRAVEL, *_LETTERS))}")
        travel = np.array(table.column(_TRAVEL, units.LENGTH))
        if table.names == (_TRAVEL,):
            raise InputError(
                f"{table.file} has no column of errors; allowed: {', '.join(_LETTERS)}, each with its unit"
            )
        if len(travel) < 2:
            raise InputError(f"{table.file}: two or more rows are needed, each at another {_TRAVEL}")
        steps = np.diff(travel) * np.sign(travel[-1] - travel[0])
        if (steps <= 0).any():
            row = int(np.argmin(steps > 0)) + 1
            raise InputError(
                f"{table.file}, line {table.lines[row]}: the {_TRAVEL} is {1e3 * travel[row]:.6g} mm after "
                f"{1e3 * travel[row - 1]:.6g} mm; the rows must go along the {_TRAVEL}, all one way, each place once"
            )
        order = np.argsort(travel)
        zero = np.zeros(len(travel))
        rows = [np.array(table.column(name, _LETTERS[name])) if name in table.names else zero for name in _LETTERS]
        return travel[order], np.array(rows)[:, order]

    def _measured_at(self, travel: Array) -> Array:
        """Return the table's errors ``(6[, P])`` at joint values ``([P])``."""
        at, errors = self._table
        if np.min(travel) < at[0] - _BEYOND or np.max(travel) > at[-1] + _BEYOND:
            far = float(np.min(travel) if np.min(travel) < at[0] - _BEYOND else np.max(travel))
            raise InputError(
                f"{self.label()}: the joint is at {1e3 * far:.6g} mm, beyond the table from {1e3 * at[0]:.6g} to "
                f"{1e3 * at[-1]:.6g} mm"
            )
        return np.array([np.interp(travel, at, row) for row in errors])


def _carriage_of(chain: Chain, joint: int) -> tuple[Place, Array]:
    """Return the place of a carriage after the motion of a 0-based joint, and the matrix ``(6, 6)`` from X, Y, Z there."""
    axis = chain.written_axes[joint]
    first = int(np.argmax(np.abs(axis).round(9)))
    # columns Y, Z, X: the axes of the joint's frame, turned by the smallest rotation that brings X onto the joint's axis
    following = np.roll(np.eye(3), -first - 1, axis=1)
    y, z, x = (following @ alignment(following.T @ axis)).T
    axes = block_diagonal(np.array([x, y, z]).T)
    if chain.reversed_joints[joint]:
        # the carriage is before the joint, the rail beyond it is displaced
        return chain.seat(joint), -axes
    return Place.start(joint + 1, f"seat of {chain.joint_names[joint]}"), axes
