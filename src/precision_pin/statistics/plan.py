"""Plan of an accumulation: centre, scale and specifications; and specifications as text."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base import units
from precision_pin.base.arguments import check_name, check_number, check_quantity, check_text, shown
from precision_pin.base.arrays import Array, fix_copy
from precision_pin.base.errors import InputError, InternalError, UnitError, UnknownNameError
from precision_pin.base.units import ANGLE, LENGTH, RATIO, Quantity
from precision_pin.statistics import limits
from precision_pin.statistics.limits import LIMITED, LIMITED_WORDS, Condition

QUANTITIES: Final = tuple(LIMITED)[:8]
"""The eight quantities, in the order of every array's rows."""

NORMS: Final = (0, 4)
"""Rows of the two norms, |d| and |δ|."""

COMPONENTS: Final = (1, 2, 3, 5, 6, 7)
"""Rows of the components, in the order of an error's six numbers [d; δ]."""

# words of a specification, then symbols of the tables
_WORDS: Final = ("position x y z attitude rx ry rz", "|d| dx dy dz |δ| δx δy δz")

QUANTITY_WORDS: Final = {
    word: name for words in _WORDS for word, name in zip(words.split(), QUANTITIES, strict=True)
} | {name: name for name in QUANTITIES}
"""Result names of the eight quantities by every name that users can write."""

_SPECIFIED: Final = {**QUANTITY_WORDS, **LIMITED_WORDS, **{name: name for name in LIMITED}}

QUANTITY_PATTERN: Final = r"\|[^\s|@]++\||[^\W\d](?:[^\W\d]|\.(?=[^\W\d]))*+"
"""Pattern of a word that may be such a name: no digits, so that a number may follow without a space."""


def quantity_name(quantity: str) -> str:
    """Return the result name, ``position.z``, of any of its names, or raise UnknownNameError."""
    if isinstance(quantity, str) and quantity in QUANTITY_WORDS:
        return QUANTITY_WORDS[quantity]
    return check_name("quantity", quantity, QUANTITIES)


def si_quantity(quantity: str) -> Quantity:
    """Return angle or length, for the result name of a quantity; a ratio for several limits at once."""
    return RATIO if is_joint(quantity) else ANGLE if quantity.startswith("attitude") else LENGTH


_RELATIVE_SCALE_WITHOUT_SPREAD = 2.0**-10
_SCALE_WITHOUT_SPREAD = 2.0**-30
_SMALLEST_SCALE = 2.0**-40
"""Scales (m, rad) of quantities without spread: 1/1000 of the others' resolves second-order errors of a few mrad; if all
are zero, 1e-9; and a minimum of 1e-12, the rounding of an arm of metres."""

_OUTERMOST: Final = 2.0**8
"""Outer end of the sketch's bins, in units of the scale; `accumulate.HIGHEST_EXPONENT` sets it."""
_WIDEST: Final = 2.0**6
"""Largest scale, in units of the observed spread: bins near the centre are then 1/64 of the spread wide."""
_MARGIN: Final = 16.0
"""Ratio of the bins' outer end to the farthest sample of a pilot: rare samples far outside the pilot still get a bin."""
_NOISE: Final = 1e-12
"""Spreads below this fraction of the largest possible error count as rounding."""


_JOINT: Final = "all of:"


def is_joint(quantity: str) -> bool:
    """Return whether the quantity of a specification stands for several limits at once."""
    return quantity.startswith(_JOINT)


@dataclass(frozen=True)
class Specification:
    """Requirement that |quantity| ≤ limit with at least the required probability.

    Attributes:
        quantity: One of the names of :data:`precision_pin.statistics.limits.LIMITED`, or another name of it. Or several
            limits that one robot keeps together, ``"all of: 0.2 mm lateral, 1 mrad tilt"``: the quantity is then the
            largest of the |values| over their limits, and the limit 1.
        limit: Largest absolute value allowed (inclusive), m or rad, or text such as ``"0.5 mm"``.
        required: Required probability, between 0 and 1 (both excluded: no sample can show 100 %).

    Raises:
        UnknownNameError: The quantity does not exist.
        InputError: The limit is not a positive number, or the probability not between 0 and 1.
    """

    quantity: str
    limit: float
    required: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "quantity", _limited_name(self.quantity))
        what = f"specification of {self.quantity}:"
        limit = check_quantity(
            f"{what} limit", self.limit, si_quantity(self.quantity), "above 0", lambda limit: limit > 0
        )
        required = check_number(
            f"{what} probability", self.required, "a share above 0 % and below 100 %", lambda share: 0 < share < 1
        )
        if is_joint(self.quantity) and limit != 1:
            raise InputError(f"{what} limit must be 1, the limits are in the text, got {limit:g}")
        object.__setattr__(self, "limit", limit)
        object.__setattr__(self, "required", required)

    @property
    def row(self) -> int | None:
        """Row of the quantity in arrays of eight rows; None for others."""
        return QUANTITIES.index(self.quantity) if self.quantity in QUANTITIES else None

    @property
    def parts(self) -> tuple[tuple[str, float], ...]:
        """Quantities and limits that are kept together: of one limit itself."""
        return _parts(self.quantity) if is_joint(self.quantity) else ((self.quantity, self.limit),)

    def conditions(self, tool_axes: ArrayLike) -> list[Condition]:
        """Return the conditions at a pose with tool axes ``(3, 3)``, columns in the base."""
        return [limits.condition(quantity, limit, tool_axes) for quantity, limit in self.parts]


def sizes_of(quantity: str, errors: Array, tool_axes: ArrayLike) -> Array:
    """Return the absolute values ``(N,)`` of a specification's quantity for errors ``(6, N)``, m and rad, base axes."""
    if not is_joint(quantity):
        return limits.absolute_values(quantity, errors, tool_axes)
    ratios = [limits.absolute_values(name, errors, tool_axes) / limit for name, limit in _parts(quantity)]
    return np.asarray(np.max(ratios, axis=0))


@dataclass(frozen=True, eq=False)
class Plan:
    """Centre and scale of the bins for each quantity, and the specifications to count.

    Neither biases a result: they set the resolution of the sketch and the number of digits that cancel in the sums.
    Median and spread of a pilot's samples are good choices (`from_pilot`).

    Attributes:
        centre: ``(8,)`` planned centres, m and rad; subtracted before anything is summed or binned.
        scale: ``(8,)`` planned spreads, m and rad, rounded to powers of two, so that division is exact. A zero spread
            becomes 2⁻¹⁰ of the largest of its four (position or attitude), or 2⁻³⁰ if all four are zero; none is below
            2⁻⁴⁰.
        specifications: Specifications whose samples are counted exactly.
        tool_axes: ``(3, 3)`` tool axes at the nominal pose, columns in the base.
        skewness: ``(8, 2)`` skewness of each quantity and of its squared deviation from the mean, from the laws; NaN if
            unknown. The intervals of the moments allow for it even if the samples do not show it.

    Raises:
        InternalError: An array of another shape, a value that is not finite, or a negative spread.
    """

    centre: Array
    scale: Array
    specifications: tuple[Specification, ...] = ()
    skewness: Array = field(default_factory=lambda: np.full((8, 2), np.nan))
    tool_axes: Array = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        centre = np.array(self.centre, dtype=float)
        spread = np.array(self.scale, dtype=float)
        if centre.shape != (8,) or spread.shape != (8,):
            raise InternalError(f"a plan has eight centres and scales, not {centre.shape} and {spread.shape}")
        if not (np.isfinite(centre).all() and np.isfinite(spread).all() and (spread >= 0).all()):
            raise InternalError("a plan's centres must be finite and its scales finite and not negative")
        for rows in (slice(0, 4), slice(4, 8)):
            largest = spread[rows].max()
            substitute = largest * _RELATIVE_SCALE_WITHOUT_SPREAD if largest > 0 else _SCALE_WITHOUT_SPREAD
            spread[rows] = np.where(spread[rows] > 0, spread[rows], substitute)
        # the nearest powers of two on a logarithmic scale
        mantissa, exponent = np.frexp(np.maximum(spread, _SMALLEST_SCALE))
        scale = np.ldexp(1.0, exponent - (mantissa < math.sqrt(0.5)))
        if np.shape(self.skewness) != (8, 2):
            raise InternalError(f"a plan has eight pairs of skewnesses, not {np.shape(self.skewness)}")
        if np.shape(self.tool_axes) != (3, 3):
            raise InternalError(f"tool axes are a 3 × 3 matrix, not {np.shape(self.tool_axes)}")
        arrays = {"skewness": self.skewness, "tool_axes": self.tool_axes, "centre": centre, "scale": scale}
        for name, values in arrays.items():
            object.__setattr__(self, name, fix_copy(values))
        object.__setattr__(self, "specifications", tuple(self.specifications))

    @classmethod
    def from_pilot(cls, values: ArrayLike, reach: ArrayLike, specifications: tuple[Specification, ...] = ()) -> Plan:
        """Return the plan for the samples of a pilot and the largest possible errors.

        Args:
            values: ``(8, N)`` quantities of the samples, as `quantity_values` returns them.
            reach: ``(6,)`` approximate largest deviation of each component from the centre; 0 if unknown.
            specifications: Specifications whose samples are counted exactly.

        The centre is the median. The spread s is that of the bulk: the smallest of interquartile range, 5 to 95 % range
        (each divided by that of a unit normal law) and standard deviation, ignoring zeros and mere rounding. The scale
        is s; if errors exceed 256 s, it is larger to cover them, but at most 64 s, so that the bulk stays resolved.
        Without spread in the samples, the scale follows from the reach alone.
        """
        pilot_values = np.asarray(values, dtype=float)
        component_reach = np.asarray(reach, dtype=float)
        ordered = np.sort(pilot_values, axis=1)
        ranks = [int(share * (ordered.shape[1] - 1)) for share in (0.05, 0.25, 0.5, 0.75, 0.95)]
        low, quarter, centre, three_quarters, high = ordered[:, ranks].T
        spreads = np.stack([(three_quarters - quarter) / 1.349, (high - low) / 3.29, pilot_values.std(axis=1)])
        farthest = _MARGIN * np.maximum(ordered[:, -1] - centre, centre - ordered[:, 0])
        scale = np.zeros(8)
        for norm, part in zip(NORMS, (slice(0, 3), slice(3, 6)), strict=True):
            vector_reach = float(np.sqrt(component_reach[part] @ component_reach[part]))
            for row, row_reach in zip(range(norm, norm + 4), (vector_reach, *component_reach[part]), strict=True):
                rounding = _NOISE * max(vector_reach, abs(float(ordered[row, 0])), abs(float(ordered[row, -1])))
                resolved_spreads = spreads[:, row][spreads[:, row] > rounding]
                covering_scale = max(row_reach, farthest[row]) / _OUTERMOST
                if resolved_spreads.size:
                    spread = float(resolved_spreads.min())
                    scale[row] = min(max(covering_scale, spread), _WIDEST * spread)
                else:
                    scale[row] = max(covering_scale, vector_reach / _OUTERMOST)
        return cls(centre, scale, specifications)

    @classmethod
    def from_moments(
        cls, mean: ArrayLike, covariance: ArrayLike, specifications: tuple[Specification, ...] = ()
    ) -> Plan:
        """Return the plan for the mean and covariance of the linear model.

        Args:
            mean: ``(6,)`` expected error [d; δ], m and rad, base axes.
            covariance: ``(6, 6)`` covariance of the error.
            specifications: Specifications whose samples are counted exactly.

        For a norm: E|d|² = |m|² + tr C and Var|d|² = 2 tr C² + 4 mᵀCm (for a normal vector), hence Var|d| ≈ Var|d|² /
        (4 E|d|²) and (E|d|)² ≈ E|d|² − Var|d|. These approximations only place bins.
        """
        expected = np.asarray(mean, dtype=float)
        spread = np.asarray(covariance, dtype=float)
        centre = np.zeros(8)
        scale = np.zeros(8)
        for norm, part in zip(NORMS, (slice(0, 3), slice(3, 6)), strict=True):
            m, c = expected[part], spread[part, part]
            square = float(m @ m + np.trace(c))
            variance = float(2 * np.trace(c @ c) + 4 * m @ c @ m) / (4 * square) if square > 0 else 0.0
            centre[norm] = math.sqrt(max(square - variance, 0.0))
            scale[norm] = math.sqrt(max(variance, 0.0))
            centre[norm + 1 : norm + 4] = m
            scale[norm + 1 : norm + 4] = np.sqrt(np.maximum(np.diagonal(c), 0.0))
        return cls(centre, scale, specifications)


DEFAULT_PROBABILITY: Final = 0.95
"""Required probability of a specification without one: the coverage probability of the GUM's expanded uncertainty."""

# possessive quantifiers: the time stays linear in the length of any text
_FORM: Final = re.compile(rf"((?:tool\s++)?+(?:{QUANTITY_PATTERN}))?\s*+(?:(?:<=|<|≤)\s*+)?(\S.*)", re.DOTALL)
_LEAST_PER_CENT: Final = 0.01
"""Smallest probability accepted in per cent; smaller ones are probably ratios with a stray per cent sign."""

Specifications = Specification | str | Sequence[Specification | str]
"""One or several limits, each as a specification or text."""


def specification(text: str) -> Specification:
    """Parse the text of a specification.

    Args:
        text: ``[QUANTITY] LIMIT [@ PROBABILITY]`` or ``LIMIT QUANTITY [@ PROBABILITY]``. The quantity is position (the
            default of a length), attitude (the default of an angle), a component x, y, z, rx, ry, rz, a name of the
            tables such as ``dx`` or ``|d|``, or a name of the JSON such as ``position.x``. In tool axes at the nominal
            pose it is a component ``tool x`` … ``tool rz``; ``lateral`` or ``axial``, the distance across or along
            the tool's z; ``zone``, twice ``lateral`` (diametral zone of ISO 1101); ``tilt``, the angle between the
            tool's z and its nominal z. It may be followed by ≤. The limit is a length or an angle. Several limits
            that one robot keeps together are ``all of: LIMIT, LIMIT, … [@ PROBABILITY]``. The probability is 95 % by
            default.

    Raises:
        InputError: The text is not of this form, the limit is not positive, or the probability lies outside 0 to 1.

    Examples:
        >>> print(pp.specification("z ≤ 0.2 mm @ 99 %"))
        Specification(quantity='position.z', limit=0.0002, required=0.99)
        >>> print(pp.specification("all of: 0.2 mm lateral, tilt 1 mrad @ 99 %").quantity)
        all of: 0.2 mm lateral, 1 mrad tilt
    """
    demand, at, probability_text = (
        part.strip() for part in check_text("a specification", text, "0.5 mm @ 99.73 %").partition("@")
    )
    try:
        required = _parse_required(probability_text) if probability_text else DEFAULT_PROBABILITY
    except UnitError as error:
        raise InputError(f"specification {text!r}: {error.findings[0].message}") from None
    if at and not probability_text:
        raise _not_understood(text)
    if _joint_text(demand) is not None:
        return Specification(demand, 1.0, required)
    return Specification(*_parse_limit(demand, text)[:2], required)


def _not_understood(text: str) -> InputError:
    return InputError(f"specification {text!r} is not understood; write it as '0.5 mm @ 99.73 %' or 'x 0.2 mm'")


def _joint_text(demand: str) -> str | None:
    """Return the limits of a text that begins with ``all of:``; None for others."""
    head, colon, rest = demand.partition(":")
    return rest if colon and head.split() == ["all", "of"] else None


def _limited_name(quantity: object) -> str:
    """Return the result name of a specification's quantity; several limits in one form."""
    if isinstance(quantity, str) and (listed := _joint_text(quantity)) is not None:
        parts = [_parse_limit(part.strip(), quantity) for part in listed.split(",")]
        if len(parts) < 2 or len({name for name, *_ in parts}) < len(parts):
            raise InputError(f"specification {quantity!r}: give two or more limits of different quantities")
        return f"{_JOINT} {', '.join(written for *_, written in parts)}"
    known = _SPECIFIED.get(" ".join(quantity.split()) if isinstance(quantity, str) else "")
    return known or check_name("quantity", quantity, LIMITED)


@lru_cache(maxsize=256)
def _parts(quantity: str) -> tuple[tuple[str, float], ...]:
    return tuple(_parse_limit(part.strip(), quantity)[:2] for part in quantity.removeprefix(_JOINT).split(","))


def _parse_limit(demand: str, text: str) -> tuple[str, float, str]:
    """Return result name, limit (m or rad) and ``LIMIT QUANTITY`` of one limit within the text of a specification."""
    match = _FORM.fullmatch(demand)
    if match is None:
        raise _not_understood(text)
    word, limit_text = match.groups()
    if word is None:
        limit_text, word = _split_word(limit_text)
    try:
        unit = units.split(limit_text)[1]
        if not unit:
            raise UnitError(
                f"{limit_text!r} has no unit: '{limit_text} mm' limits the position, '{limit_text} mrad' the attitude"
            )
        limit = units.parse(limit_text, units.LENGTH, units.ANGLE)
    except UnitError as error:
        raise InputError(f"specification {text!r}: {error.findings[0].message}") from None
    is_length = unit in units.LENGTH.units
    if word is None:
        word = "position" if is_length else "attitude"
    # |dx| is accepted too: the limit applies to the absolute value
    word = " ".join(word.split())
    word = word if word in _SPECIFIED else word.strip("|")
    if word not in _SPECIFIED:
        raise UnknownNameError("quantity of a specification", word, _SPECIFIED)
    if _SPECIFIED[word].startswith("position") != is_length:
        raise InputError(f"specification {text!r}: {word} is limited by {'an angle' if is_length else 'a length'}")
    if not limit > 0:
        raise InputError(f"specification {text!r}: the limit must be positive")
    if not is_length and limit >= math.pi:
        hint = "deg, or mrad" if unit == "rad" else "mrad"
        raise InputError(f"specification {text!r}: no attitude error is larger than half a turn; did you mean {hint}?")
    written = next(known for known, name in _SPECIFIED.items() if name == _SPECIFIED[word])
    return _SPECIFIED[word], limit, f"{' '.join(limit_text.split())} {written}"


def _split_word(text: str) -> tuple[str, str | None]:
    """Return the limit and the quantity, or None, of a text such as ``0.1 mm lateral``."""
    *number, word = text.split()
    if number and number[-1] == "tool":
        word = f"{number.pop()} {word}"
    try:
        unit = units.split(" ".join(number))[1]
    except UnitError:
        return text, None
    is_word = unit in units.LENGTH.units or unit in units.ANGLE.units
    return (" ".join(number), word) if is_word else (text, None)


def _parse_required(text: str) -> float:
    """Return the required probability; reject one below 1 % in per cent as a probable slip."""
    value = units.parse_probability(text)
    if value < _LEAST_PER_CENT and units.split(text)[1] == "%":
        raise UnitError(
            f"{text} is fewer than one robot in a hundred; did you mean '{100 * units.split(text)[0][0]:g} %'? "
            f"(or the plain ratio {value:g})"
        )
    return value


def listed_specifications(specifications: Specifications) -> tuple[Specification, ...]:
    """Return specifications as a tuple, texts parsed; raise InputError for other entries."""
    if isinstance(specifications, Specification | str):
        specifications = (specifications,)
    if not isinstance(specifications, list | tuple):
        raise InputError(f"specifications must be a list of specifications or of texts, got {shown(specifications)}")
    return tuple(entry if isinstance(entry, Specification) else specification(entry) for entry in specifications)
