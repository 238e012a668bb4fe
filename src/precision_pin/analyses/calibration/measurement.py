"""What an instrument reads at a pose: prediction and derivatives.

With the tip's error ``e = [d; δ]`` in base axes at a pose (R, p), a target at t in tool axes, and a base that is displaced
by ``Trans(c)·Exp(ω)`` as the instrument sees it, the target is at

    y = Exp(ω) (p + d + Exp(δ) R t) + c.

A *position* is y; a *pose* is y and the attitude ``Exp(ω) Exp(δ) R Exp(τ)``; a *distance* is ``|y - a|`` from an anchor a,
whose displacement takes the place of that of the base. Numbers of the set-up that are not known (c, ω, t, τ) are called
nuisances; they are estimated with the arm and have no prior law.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, final

import numpy as np

from precision_pin import se3
from precision_pin.errors import InputError
from precision_pin.inputs.arguments import check_choice, check_flag, check_number, check_numbers
from precision_pin.typing import Array

__all__ = ["Measurement", "Slopes"]

_AXES: Final = ("x", "y", "z")
_LEVER: Final = 0.1
"""Distance (m) between the targets from which an attitude is measured, where no attitude's deviation is given."""


@final
@dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives of a reading.

    Attributes
    ----------
    error
        With respect to the tip's error, ``(m, 6)``.
    nuisances
        With respect to the nuisances, ``(m, k)``.
    """

    error: Array
    nuisances: Array


@final
@dataclass(frozen=True)
class Measurement:
    """An instrument and its set-up.

    Parameters
    ----------
    kind
        ``"position"`` of a target (x, y, z), ``"pose"`` (position and attitude) or ``"distance"`` from a fixed anchor.
    std
        Standard deviation of each measured length, m.
    target
        The target in tool axes from the tip, m, wherever the point is that results are about.
    base
        ``"known"``: readings are in base axes. ``"free"``: the robot's base in the instrument's axes is not known and is
        estimated; of a distance, the place of the anchor.
    target_known
        Whether the target's place on the tool (of a pose, its attitude too) is known; it is estimated otherwise.
    attitude_std
        Standard deviation of each measured angle of a pose, rad; std / 0.1 m if left out, as of three targets 0.1 m apart.
    anchor
        Fixed point that a distance is measured from, in the base, m; the first guess where ``base`` is free.

    Raises
    ------
    InputError
        A setting is wrong.
    """

    kind: Literal["position", "pose", "distance"] = "position"
    std: float = 20e-6
    target: tuple[float, float, float] = (0.0, 0.0, 0.0)
    base: Literal["known", "free"] = "known"
    target_known: bool = True
    attitude_std: float | None = None
    anchor: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        check_choice("the kind of a measurement", self.kind, ("position", "pose", "distance"))
        check_choice("the base of a measurement", self.base, ("known", "free"))
        check_flag("target_known of a measurement", self.target_known)
        std = check_number(
            "the standard deviation of a measurement", self.std, "above zero and finite, in m", lambda n: n > 0
        )
        object.__setattr__(self, "std", std)
        if self.attitude_std is not None:
            if self.kind != "pose":
                raise InputError(f"attitude_std belongs to the measurement of a pose, not of a {self.kind}")
            angle = check_number(
                "attitude_std of a measurement", self.attitude_std, "above zero and finite, in rad", lambda n: n > 0
            )
            object.__setattr__(self, "attitude_std", angle)
        for name in ("target", "anchor"):
            point = check_numbers(f"the {name} of a measurement", getattr(self, name), (3,), "three lengths in m")
            object.__setattr__(self, name, tuple(point.tolist()))
        if self.kind != "distance" and any(self.anchor):
            raise InputError(f"anchor belongs to the measurement of a distance, not of a {self.kind}")

    @property
    def size(self) -> int:
        """Numbers of a reading."""
        return {"position": 3, "pose": 6, "distance": 1}[self.kind]

    @property
    def deviations(self) -> Array:
        """Standard deviation of each number of a reading, ``(m,)``."""
        lengths = [self.std] * min(self.size, 3)
        angle = self.std / _LEVER if self.attitude_std is None else self.attitude_std
        return np.array(lengths + [angle] * (self.size - len(lengths)))

    @property
    def nuisances(self) -> tuple[str, ...]:
        """Names of the unknown numbers of the set-up: m, and rad for those that begin with r."""
        turns = tuple(f"r{axis}" for axis in _AXES)
        names: tuple[str, ...] = ()
        if self.base == "free":
            names += tuple(f"anchor.{axis}" for axis in _AXES) if self.kind == "distance" else ()
            names += () if self.kind == "distance" else tuple(f"base.{axis}" for axis in _AXES + turns)
        if not self.target_known:
            names += tuple(f"target.{axis}" for axis in (_AXES + turns if self.kind == "pose" else _AXES))
        return names

    def predict(self, pose: Array, errors: Array, nuisances: Array) -> Array:
        """Return readings ``(m, N)``: of a pose, its position and its turn from the nominal attitude.

        Parameters
        ----------
        pose
            The nominal tip in the base, ``(4, 4)``.
        errors
            ``[d; δ]`` of the tip, ``(6, N)``.
        nuisances
            ``(k, N)``.
        """
        point, attitude = self._place(pose, errors, nuisances)
        if self.kind == "distance":
            away = ((point - self._anchor(nuisances)) ** 2).sum(axis=0)[None]
            distance: Array = np.sqrt(away)
            return distance
        if self.kind == "position":
            return point
        return np.concatenate([point, se3.log_rotation(np.einsum("ijn,kj->ikn", attitude, pose[:3, :3]))])

    def _place(self, pose: Array, errors: Array, nuisances: Array) -> tuple[Array, Array]:
        """Return position ``(3, N)`` and attitude ``(3, 3, N)`` of the target as the instrument sees them."""
        _, turn, offset, own_turn = self._split(nuisances)
        attitude = np.einsum("ijn,jk->ikn", se3.exp_rotation(errors[3:]), pose[:3, :3])
        point = pose[:3, 3, None] + errors[:3] + np.einsum("ijn,jn->in", attitude, offset)
        if own_turn is not None:
            attitude = _product(attitude, se3.exp_rotation(own_turn))
        if turn is None:
            return point, attitude
        rotation = se3.exp_rotation(turn)
        shift = self._split(nuisances)[0]
        return np.einsum("ijn,jn->in", rotation, point) + shift, _product(rotation, attitude)

    def _split(self, nuisances: Array) -> tuple[Array, Array | None, Array, Array | None]:
        """Return shift and turn of the base (or anchor), target ``(3, N)`` and the target's own turn."""
        samples = nuisances.shape[1]
        shift, turn, first = np.zeros((3, samples)), None, 0
        if self.base == "free":
            shift, first = nuisances[:3], 3
            if self.kind != "distance":
                turn, first = nuisances[3:6], 6
        offset = np.array(self.target)[:, None] + np.zeros((1, samples))
        own_turn = None
        if not self.target_known:
            offset = offset + nuisances[first : first + 3]
            own_turn = nuisances[first + 3 : first + 6] if self.kind == "pose" else None
        return shift, turn, offset, own_turn

    def _anchor(self, nuisances: Array) -> Array:
        shift = self._split(nuisances)[0]
        anchor: Array = np.array(self.anchor)[:, None] + shift
        return anchor

    def slopes(self, pose: Array, error: Array, nuisances: Array) -> Slopes:
        """Return the derivatives of a reading at one error ``(6,)`` and nuisances ``(k,)``.

        An attitude's are those of the turn of the reading: the rotation vector, in the axes of the reading, of a small
        further turn.
        """
        columns = nuisances[:, None]
        _, turn, offset, own_turn = self._split(columns)
        attitude = se3.exp_rotation(error[3:]) @ pose[:3, :3]
        arm = attitude @ offset[:, 0]
        inner = pose[:3, 3] + error[:3] + arm
        rotation = np.eye(3) if turn is None else se3.exp_rotation(turn[:, 0])
        tilt = se3.left_jacobian(error[3:])
        by_error = np.zeros((6, 6))
        by_error[:3, :3] = rotation
        by_error[:3, 3:] = -rotation @ se3.skew(arm) @ tilt
        by_error[3:, 3:] = rotation @ tilt
        parts = []
        if self.base == "free" and turn is not None:
            by_turn = se3.left_jacobian(turn[:, 0])
            base = np.zeros((6, 6))
            base[:3, :3] = np.eye(3)
            base[:3, 3:] = -se3.skew(rotation @ inner) @ by_turn
            base[3:, 3:] = by_turn
            parts.append(base)
        if not self.target_known:
            own = np.zeros((6, 6 if self.kind == "pose" else 3))
            own[:3, :3] = rotation @ attitude
            if own_turn is not None:
                own[3:, 3:] = rotation @ attitude @ se3.left_jacobian(own_turn[:, 0])
            parts.append(own)
        by_nuisances = np.concatenate([np.zeros((6, 0)), *parts], axis=1)
        if self.kind != "distance":
            return Slopes(by_error[: self.size], by_nuisances[: self.size])
        away = inner - self._anchor(columns)[:, 0]
        length = float(np.linalg.norm(away))
        if length == 0.0:
            raise InputError("the target is at the anchor, where the direction of a distance is not defined")
        direction = away[None] / length
        to_anchor = [-direction] if self.base == "free" else []
        return Slopes(direction @ by_error[:3], np.concatenate([*to_anchor, direction @ by_nuisances[:3]], axis=1))

    def residual(self, reading: Array, predicted: Array) -> Array:
        """Return reading less prediction, both ``(m, N)`` as :meth:`predict` returns them; an attitude's as a turn."""
        if self.kind != "pose":
            return reading - predicted
        measured, expected = se3.exp_rotation(reading[3:]), se3.exp_rotation(predicted[3:])
        turn = se3.log_rotation(np.einsum("ijn,kjn->ikn", measured, expected))
        return np.concatenate([reading[:3] - predicted[:3], turn])

    def to_dict(self) -> dict[str, object]:
        """Return the set-up as in the JSON."""
        return {
            "kind": self.kind,
            "std": self.std,
            "attitude_std": float(self.deviations[-1]) if self.kind == "pose" else None,
            "target": list(self.target),
            "base": self.base,
            "target_known": self.target_known,
            "anchor": list(self.anchor) if self.kind == "distance" else None,
            "nuisances": list(self.nuisances),
        }


def _product(left: Array, right: Array) -> Array:
    result: Array = np.einsum("ijn,jkn->ikn", left, right)
    return result
