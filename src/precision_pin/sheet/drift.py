"""Drift of an instrument: a random walk of its axes, which all that it reads at one time shares.

Along each axis the walk has independent steps, of variance ``std² (t - s)/every`` from the time s to t, and begins with zero at
the first reading. Time is that of a clock, or it is counted in readings. Targets that stand still and are read again and again
tell the walk apart from the arm.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from precision_pin.base import units
from precision_pin.base.arguments import check_quantity, shown
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.base.units import LENGTH, TIME, Quantity

_READINGS: Final = re.compile(r"\s*(-?\d+)\s*readings?\s*")
_EXAMPLE: Final = "{std: 20 um, every: 1 h}"


class DriftEntry(BaseModel):
    """Drift of the instrument, a random walk along each axis."""

    model_config = ConfigDict(extra="forbid")

    std: str = Field(description="Standard deviation along each axis after the time every, such as '20 um'.")
    every: str = Field(description="This time, such as '1 h' or '100 readings' (rows of a data file).")
    pace: str | None = Field(
        None, description="Before anything is read: the time from a reading to the next, such as '20 s'."
    )
    fixed: int | None = Field(None, description="Before anything is read: the number of fixed targets.")
    fixed_every: str | None = Field(
        None,
        description="Before anything is read: after how long these are read again, such as '10 min' or '25 readings'.",
    )


@dataclass(frozen=True)
class Drift:
    """A random walk with a standard deviation ``std``, m, along each axis after ``every``, s or (``is_counted``) readings.

    Attributes:
        pace: Time from a reading to the next before anything is read, s; ``None`` if unknown, 1 if readings are counted.
        fixed, fixed_every: Number of fixed targets, and of readings of the arm after which all of these are read again.
    """

    std: float
    every: float
    is_counted: bool = False
    pace: float | None = None
    fixed: int = 0
    fixed_every: int = 0

    @classmethod
    def of(cls, value: Mapping[str, object]) -> Drift:
        """Return the drift of texts, or of numbers in m and s, as in a sheet; raise for anything else."""
        given = {name: number for name, number in value.items() if number is not None}
        if not {"std", "every"} <= set(given) <= set(DriftEntry.model_fields):
            raise InputError(f"drift needs std and every, such as {_EXAMPLE}, got {shown(dict(value))}")
        std = _above_zero("std", given["std"], LENGTH)
        every, is_counted = _time("every", given["every"])
        pace = 1.0 if is_counted else None
        if "pace" in given:
            if is_counted:
                raise InputError("pace of drift belongs to every: of a time, not of readings")
            pace = _above_zero("pace", given["pace"], TIME)
        if ("fixed" in given) != ("fixed_every" in given):
            raise InputError(
                "fixed and fixed_every of drift belong together, such as fixed: 4, fixed_every: 25 readings"
            )
        fixed = again = 0
        if "fixed" in given:
            if not re.fullmatch("[1-9][0-9]{0,3}", str(given["fixed"])):
                raise InputError(
                    f"fixed of drift must be a number of targets, from 1 to 9999, got {shown(given['fixed'])}"
                )
            fixed = int(str(given["fixed"]))
            time, is_number = _time("fixed_every", given["fixed_every"])
            if not is_number and (is_counted or pace is None):
                raise InputError("fixed_every of drift needs pace, the time from a reading to the next, or readings")
            again = max(1, round(time if is_number or pace is None else time / pace))
        return cls(std, every, is_counted, pace, fixed, again)

    @property
    def rate(self) -> float:
        """Variance along an axis per unit of time, m²/s or m² per reading."""
        return self.std**2 / self.every

    @property
    def every_text(self) -> str:
        """The time ``every`` as a sheet has it."""
        if self.is_counted:
            return f"{self.every:.0f} readings"
        unit = next(unit for unit in ("h", "min", "s") if self.every >= TIME.units[unit] or unit == "s")
        return f"{self.every / TIME.units[unit]:.6g} {unit}"

    def to_dict(self) -> dict[str, object]:
        """Return the drift as in the JSON."""
        return {entry.name: getattr(self, entry.name) for entry in fields(self)}

    def __str__(self) -> str:
        return f"drift {1e6 * self.std:.4g} µm in {self.every_text}"

    def schedule(self, count: int) -> tuple[Array, Array, NDArray[np.intp]]:
        """Return when readings of the arm ``(count,)`` are taken and fixed targets read ``(F,)``, and the numbers of these.

        They are read first and last, and each reading takes the time ``pace``.
        """
        if self.pace is None:
            raise InputError(
                "before anything is read, drift needs pace, the time from a reading to the next, such as 20 s"
            )
        pace, k = np.array(self.pace), np.arange(count)
        blocks = 1 + k // self.fixed_every if self.fixed else np.zeros(count, dtype=np.intp)
        times = k + self.fixed * blocks
        starts = [
            *(times[np.flatnonzero(np.diff(blocks, prepend=0))] - self.fixed).tolist(),
            count + self.fixed * blocks[-1],
        ]
        fixed = (np.array(starts)[:, None] + np.arange(self.fixed)).ravel()
        return pace * times, pace * fixed, np.tile(np.arange(self.fixed), len(starts))

    def walk(self, times: Array, generator: np.random.Generator) -> Array:
        """Return a random walk at times ``(N,)`` in any order, ``(N, 3)``, m."""
        order = np.argsort(times, kind="stable")
        steps = np.sqrt(self.rate * np.diff(times[order], prepend=times.min()))
        walk = np.empty((len(times), 3))
        walk[order] = np.cumsum(steps[:, None] * generator.standard_normal((len(times), 3)), axis=0)
        return walk


def _time(name: str, value: object) -> tuple[float, bool]:
    """Return a time, s or a number of readings, and whether it is the latter."""
    counted = _READINGS.fullmatch(value) if isinstance(value, str) else None
    time = float(counted[1]) if counted else _above_zero(name, value, TIME, ", such as 1 h or 100 readings")
    if not time > 0:
        raise InputError(f"{name} of drift must be above zero, got {shown(value)}")
    return time, counted is not None


def _above_zero(name: str, value: object, quantity: Quantity, example: str = "") -> float:
    """Return a number in SI, from a number in SI or text with a unit as in a sheet."""
    what = f"{name} of drift{example}"
    if not isinstance(value, str):
        return check_quantity(what, value, quantity, "above zero", lambda n: n > 0)
    try:
        number = units.parse(value, quantity)
    except InputError as error:
        raise InputError(f"{what}: {error.findings[0].message}") from None
    if not number > 0:
        raise InputError(f"{name} of drift must be above zero, got {shown(value)}")
    return number
