"""Joint zeros and directions by the readings alone: a quick fit of the nominal arm, for what no tolerance can explain."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, islice
from typing import Final, final

import numpy as np
import scipy.optimize

from precision_pin.analyses.calibration.data import CalibrationData
from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError
from precision_pin.robot.chain import Chain
from precision_pin.sheet.measurement import Measurement

_BAD: Final = 0.01
"""Residual, as a share of the arm's length, that joint zeros leave where a direction may be wrong."""
_DEVIATIONS: Final = 10.0
"""The least such residual, in standard deviations of the instrument."""
_BETTER: Final = 3.0
"""By how much a reversed direction must lessen the residual."""
_CLEARLY: Final = 1.5
"""The same for joints whose direction hardly shows, where that of the others is found."""
_MOST_TRIED: Final = 64
"""Combinations of reversed joints that are tried."""
_HOLD: Final = 1e-4
"""Weight of a zero, m/rad, that keeps one that no reading sees where it is."""


@final
@dataclass(frozen=True, eq=False)
class Zeros:
    """Zeros of the joints ``(n,)``, rad or m, beside the nominal ones, and the root mean square (m) of what they leave."""

    values: Array
    rms: float


def fit_zeros(chain: Chain, data: CalibrationData, measurement: Measurement, signs: Array) -> Zeros:
    """Return the zeros, and with them base, target or anchor where unknown, that fit positions or distances best.

    ``signs`` ``(n,)`` of 1 and -1 multiply the joint values as they were read.
    """
    q, count = signs[:, None] * data.q, len(chain.joints)
    is_free, is_distance = measurement.base == "free", measurement.kind == "distance"
    readings = data.readings[:, :3]

    def residuals(x: Array) -> Array:
        pose = chain.at_columns(q + x[:count, None]).pose
        target = np.array(measurement.target) + x[count : count + 3]
        points = (pose[:3, 3] + np.einsum("ijp,j->ip", pose[:3, :3], target)).T
        if is_distance:
            anchor = np.array(measurement.anchor) + (x[count + 3 :] if is_free else 0.0)
            away = np.linalg.norm(points - anchor, axis=1) - readings[:, 0]
        else:
            away = (_aligned(points, readings) if is_free else points) - readings
        held = np.concatenate([x[:count], [] if measurement.target_known else x[count : count + 3]])
        return np.concatenate([away.ravel(), _HOLD * held])

    size = count + 3 + (3 if is_distance and is_free else 0)
    estimated = np.ones(size, dtype=bool)
    estimated[count : count + 3] = not measurement.target_known

    def some(y: Array) -> Array:
        x = np.zeros(size)
        x[estimated] = y
        return residuals(x)

    found = scipy.optimize.least_squares(some, np.zeros(int(estimated.sum())), method="trf", max_nfev=40)
    left = found.fun[: len(data) * (1 if is_distance else 3)]
    return Zeros(found.x[:count], float(np.sqrt((left**2).sum() / len(data))))


def _aligned(points: Array, readings: Array) -> Array:
    """Return points ``(P, 3)`` turned and shifted onto readings best."""
    centre, other = points.mean(axis=0), readings.mean(axis=0)
    rotation = se3.nearest_rotation((readings - other).T @ (points - centre))
    result: Array = (points - centre) @ rotation.T + other
    return result


def refuse_reversed(chain: Chain, data: CalibrationData, measurement: Measurement) -> Zeros | None:
    """Refuse readings that fit far better with the direction of some joints reversed; return the zeros that fit them best.

    None where the kind of reading is not one of those that say so: a contact depends on where the arm is thought to be.
    """
    if measurement.kind in ("plane", "socket"):
        return None
    count = len(chain.joints)
    plain = fit_zeros(chain, data, measurement, np.ones(count))
    length = float(np.linalg.norm(chain.placements[:, :3, 3], axis=1).sum())
    bad = max(_DEVIATIONS * measurement.std, _BAD * length)
    if plain.rms <= bad:
        return plain
    for signs in _reversals(count):
        rms = fit_zeros(chain, data, measurement, signs).rms
        if rms < min(plain.rms / _BETTER, bad):
            signs, rms = _refined(chain, data, measurement, signs, rms)
            names = " and ".join(chain.joint_names[k] for k in np.flatnonzero(signs < 0))
            message = (
                f"{names}: readings fit far better with the direction reversed (residuals {1e3 * rms:.3g} mm rms instead "
                f"of {1e3 * plain.rms:.3g} mm, all zeros free); change the sign of the column, or turn the axis and its "
                "limits around in the URDF; or two columns of places are swapped"
            )
            raise InputError([Finding("error", "E_REVERSED", message, data.file or None)])
    return plain


def _refined(
    chain: Chain, data: CalibrationData, measurement: Measurement, signs: Array, rms: float
) -> tuple[Array, float]:
    """Return signs with those joints turned around, one after another, that matter less and still fit clearly better."""
    while True:
        others = [signs * np.where(np.arange(signs.size) == k, -1.0, 1.0) for k in range(signs.size)]
        sizes = [fit_zeros(chain, data, measurement, other).rms for other in others]
        best = int(np.argmin(sizes))
        if sizes[best] > rms / _CLEARLY:
            return signs, rms
        signs, rms = others[best], sizes[best]


def _reversals(count: int) -> Iterator[Array]:
    """Yield signs of the joints ``(n,)`` with some reversed, the fewest first, as many as are tried."""
    chosen = (one for number in range(1, count + 1) for one in combinations(range(count), number))
    for one in islice(chosen, _MOST_TRIED):
        signs = np.ones(count)
        signs[list(one)] = -1.0
        yield signs


def describe_zeros(chain: Chain, zeros: Zeros) -> str:
    """Return zeros in words, those that matter first."""
    order = np.argsort(-np.abs(zeros.values), kind="stable")[:3]
    words = [
        f"{chain.joint_names[k]} {1e3 * zeros.values[k]:+.3g} mm"
        if chain.prismatic[k]
        else f"{chain.joint_names[k]} {np.degrees(zeros.values[k]):+.3g}°"
        for k in order
    ]
    return ", ".join(words)
