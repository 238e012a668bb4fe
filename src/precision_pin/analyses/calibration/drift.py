"""Drift of an instrument: taken out of readings as far as fixed targets tell it, the rest a common error of the readings.

With the steps ξ of the walk between knots, of unit covariance, readings in the axes of the instrument are

    fixed target:  y = c + W(t) ξ + e,        arm:  y = h + W(t) ξ + e,

where the places c have no prior. Conditional on the fixed targets ξ has a mean, which is taken out, and a covariance U Uᵀ: W U
are common factors of the arm's readings, whose fit then decides together with these targets. Between knots, where there are more
times than these, the walk's own part is an error of each reading.

The rate θ of the walk follows from the fixed targets alone. Less their places, and in principal axes, they are independent
numbers u of variance 1 + θ λ. The score by θ is T(θ) = Σ w u²/(1 + θ λ), w = λ/(1 + θ λ), whose law at θ is that of Σ w χ²:
θ = 0 is tested by it, and the interval holds every θ that it does not reject on either side. The estimate is the likeliest, T =
Σ w.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Final, NamedTuple

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import NDArray

from precision_pin.analyses.calibration.noise import LEVEL
from precision_pin.analyses.number_law import tail
from precision_pin.base.arrays import Array, Keys, Record
from precision_pin.base.errors import Finding
from precision_pin.sheet.drift import Drift

MOST_KNOTS: Final = 64
"""Steps of a walk between knots; up to as many times are exact."""
FALSE_DRIFT: Final = 0.01
"""Probability that a drift is found where there is none."""
_TOUCHED: Final = (1e-6, FALSE_DRIFT)
"""Probabilities of as much drift by all targets, at most, and without the one that moved by itself, at least."""
_AT_ONCE: Final = 512
"""Readings whose factors are in memory at once."""
_UNSEEN: Final = 1e-9
"""Share of the largest information below which numbers tell nothing of the walk."""
_RATES: Final = (1e-8, 1e12)
"""Range of the search for a rate, over that at which the walk is as large as the noise."""
_MANY: Final = 1e9
"""Degrees of freedom of a standard deviation that is known."""
_EVERY: Final = 3600.0
"""Time (s) for which a drift is told where none is stated."""


class FixedReadings(NamedTuple):
    """Readings of fixed targets: times, numbers of the targets ``(F,)``, places ``(F, 3)``, m, and covariances ``(F, 3, 3)``.

    ``names`` are those of the targets.
    """

    times: Array
    targets: NDArray[np.intp]
    points: Array
    covariances: Array
    names: tuple[str, ...] = ()

    def without(self, target: int) -> FixedReadings:
        """Return the readings of the other targets."""
        is_kept = self.targets != target
        arrays = self.times[is_kept], self.targets[is_kept], self.points[is_kept], self.covariances[is_kept]
        return FixedReadings(*arrays, self.names)

    def white(self, steps: Array) -> tuple[Array, Array]:
        """Return whitened readings less the places of their targets, ``(3F,)``, and slopes by a walk of ``steps`` ``(F, K)``."""
        roots = np.linalg.cholesky(self.covariances)
        size, first = self.targets.size, np.unique(self.targets, return_index=True)[1]
        is_target = np.eye(first.size)[np.unique(self.targets, return_inverse=True)[1]]
        # a shift of each target, whatever it is, changes nothing that follows
        shifted = self.points - is_target @ self.points[first]
        shifts, walk = (
            np.einsum("fk,ij->fikj", factors, np.eye(3)).reshape(size, 3, -1) for factors in (is_target, steps)
        )
        columns = np.concatenate([shifts, walk, shifted[:, :, None]], axis=2)
        columns = np.linalg.solve(roots, columns).reshape(3 * size, -1)
        basis = np.linalg.qr(columns[:, : shifts.shape[2]])[0]
        rest = columns[:, shifts.shape[2] :]
        rest = rest - basis @ (basis.T @ rest)
        return rest[:, -1], rest[:, :-1]


NO_FIXED_READINGS: Final = FixedReadings(np.zeros(0), np.zeros(0, dtype=np.intp), np.zeros((0, 3)), np.zeros((0, 3, 3)))


class Steps(NamedTuple):
    """A walk at times ``(N,)``: at knots it is ``walk`` ``(K, …, k)`` times independent steps, and on a line between these.

    ``before`` and ``share`` ``(N,)`` tell the knot before a time and how far the next one is reached, ``own`` ``(N,)`` is the
    variance of the walk about the line.
    """

    walk: Array
    before: NDArray[np.intp]
    share: Array
    own: Array

    def of(self, rows: NDArray[np.intp]) -> Array:
        """Return the factors of the steps at some times, ``(R, …, k)``."""
        before, share = self.before[rows], self.share[rows].reshape(-1, *[1] * (self.walk.ndim - 1))
        return np.asarray(
            (1 - share) * self.walk[before] + share * self.walk[np.minimum(before + 1, len(self.walk) - 1)]
        )

    @property
    def factors(self) -> Array:
        """The factors at all times, ``(N, …, k)``."""
        return self.of(np.arange(self.own.size))


def steps_of(rate: float, times: Array, *others: Array) -> list[Steps]:
    """Return the steps of one walk of variance ``rate``, m² per unit of time, at times, and at others."""
    knots = np.unique(np.concatenate([times, *others]))
    if knots.size > MOST_KNOTS + 1:
        knots = knots[np.linspace(0, knots.size - 1, MOST_KNOTS + 1).round().astype(int)]
    roots = np.sqrt(rate * np.diff(knots))
    walk = np.tril(np.tile(roots, (knots.size, 1)), -1)
    result = []
    for asked in (times, *others):
        after = np.clip(np.searchsorted(knots, asked), min(1, knots.size - 1), knots.size - 1)
        before = np.maximum(after - 1, 0)
        length = np.where(after > before, knots[after] - knots[before], 1.0)
        share = (asked - knots[before]) / length
        result.append(Steps(walk, before, share, rate * length * share * (1 - share)))
    return result


def _in_parts(count: int) -> list[NDArray[np.intp]]:
    """Return the numbers below ``count`` in parts: the factors of all readings would fill the memory."""
    return np.array_split(np.arange(count), -(-count // _AT_ONCE))


class Remainder(NamedTuple):
    """A walk of which targets tell the mean ``(N, 3)``: the rest has ``steps``, of factors ``(N, 3, k)``."""

    mean: Array
    steps: Steps

    def about_its_mean(self) -> Remainder:
        """Return the walk less its mean over the readings, which a free base has in it."""
        mean = sum(self.steps.of(rows).sum(axis=0) for rows in _in_parts(len(self.mean))) / len(self.mean)
        return Remainder(self.mean - self.mean.mean(axis=0), self.steps._replace(walk=self.steps.walk - mean))

    @property
    def std(self) -> Array:
        """Standard deviation of what remains along each axis, ``(N, 3)``."""
        variances = [(self.steps.of(rows) ** 2).sum(axis=2) for rows in _in_parts(len(self.mean))]
        return np.asarray(np.sqrt(np.concatenate(variances) + self.steps.own[:, None]))


def remainder(rate: float, times: Array, fixed: FixedReadings) -> Remainder:
    """Return a walk of variance ``rate`` at times ``(N,)``, given the readings of fixed targets, in the axes of these."""
    of_arm, of_fixed = steps_of(rate, times, fixed.times)
    if not rate:
        return Remainder(np.zeros((times.size, 3)), of_arm._replace(walk=np.zeros((len(of_arm.walk), 3, 0))))
    count = 3 * of_arm.walk.shape[1]
    walk = np.einsum("nk,ij->nikj", of_arm.walk, np.eye(3)).reshape(-1, 3, count)
    if not fixed.times.size:
        return Remainder(np.zeros((times.size, 3)), of_arm._replace(walk=walk))
    own = of_fixed.own[:, None, None] * np.eye(3)
    white, slopes = fixed._replace(covariances=fixed.covariances + own).white(of_fixed.factors)
    root = np.linalg.cholesky(np.eye(count) + slopes.T @ slopes)
    mean = of_arm._replace(walk=walk @ scipy.linalg.cho_solve((root, True), slopes.T @ white)).factors
    left = scipy.linalg.solve_triangular(root, walk.reshape(-1, count).T, lower=True).T
    return Remainder(mean, of_arm._replace(walk=left.reshape(walk.shape)))


def drift_ahead(drift: Drift, count: int, std: float, *, is_free: bool) -> Remainder:
    """Return what will remain of a drift in readings ``(count,)`` if fixed targets are read with ``std``, m, as it says.

    ``is_free``: whether the base is estimated.
    """
    times, fixed_times, targets = drift.schedule(count)
    size = fixed_times.size
    fixed = FixedReadings(fixed_times, targets, np.zeros((size, 3)), np.tile(std**2 * np.eye(3), (size, 1, 1)))
    left = remainder(drift.rate, times, fixed)
    return left.about_its_mean() if is_free else left


@dataclass(frozen=True)
class ShownDrift(Record):
    """The drift that fixed targets show, m along each axis after a time, and its 95 % interval.

    ``chance`` is the probability of targets as far from the drift as stated; of as much drift, where none is stated.
    """

    KEYS: ClassVar[Keys] = ("std", "interval", "probability", "chance")
    probability: ClassVar[float] = LEVEL

    std: float
    interval: tuple[float, float]
    chance: float

    @classmethod
    def of(cls, fixed: FixedReadings, every: float, stated: Drift | None) -> ShownDrift | None:
        """Return the drift after a time ``every``; ``None`` where the targets tell nothing."""
        (steps,) = steps_of(1.0, fixed.times)
        white, slopes = fixed.white(steps.factors)
        vectors, values, _ = np.linalg.svd(slopes, full_matrices=False)
        is_seen = values**2 > _UNSEEN * values.max(initial=0.0) ** 2
        if not is_seen.any():
            return None
        scale = float((values[is_seen] ** 2).mean())
        information, squares = values[is_seen] ** 2 / scale, (vectors.T @ white)[is_seen] ** 2

        def score(rate: float) -> tuple[Array, float]:
            variances = 1 + rate * information
            weights = information / variances
            return weights, float(weights @ (squares / variances))

        def chance(rate: float) -> float:
            weights, total = score(rate)
            return tail(weights, total / _MANY, _MANY)

        def excess(rate: float) -> float:
            weights, total = score(rate)
            return total / float(weights.sum()) - 1

        def root(function: Callable[[float], float], value: float = 0.0) -> float:
            """Return the std for whose rate a function has a value; 0 where that is below the search."""
            first, last = (function(rate) - value for rate in _RATES)
            if first * last > 0:
                return 0.0
            log_rate = scipy.optimize.brentq(lambda log: function(np.exp(log)) - value, *np.log(_RATES), xtol=1e-6)
            return float(np.sqrt(every * np.exp(log_rate) / scale))

        low, high = (root(chance, side) for side in ((1 - LEVEL) / 2, (1 + LEVEL) / 2))
        of_stated = chance(0.0 if stated is None else scale * stated.rate)
        return cls(root(excess), (low, high), of_stated if stated is None else 2 * min(of_stated, 1 - of_stated))


@dataclass(frozen=True, eq=False)
class Session(Record):
    """Readings that an instrument took one after another, and its drift.

    Attributes:
        drift: As stated; ``None`` where fixed targets were read only.
        rows: Which readings these are, ``(N,)``.
        left: What was taken out of them, and what remains, in the axes of the readings; about the mean if the base is free.
        targets, readings: Number of fixed targets, and of their readings.
        shown: What these show; ``None`` where they tell nothing.
        touched: Name of a target without which the others show nothing else than stated; empty for none.
    """

    KEYS: ClassVar[Keys] = (
        *("drift", "targets", "readings", "shown", "every=told.every", "touched"),
        *("rows", "taken_out=left.mean", "std_left=left.std"),
    )

    drift: Drift | None
    rows: NDArray[np.intp]
    left: Remainder
    targets: int
    readings: int
    shown: ShownDrift | None
    touched: str

    @classmethod
    def of(cls, times: Array, fixed: FixedReadings, drift: Drift | None, *, is_free: bool) -> Session:
        """Return the session of readings at times ``(N,)``, and of fixed targets; ``is_free`` if the base is estimated."""
        left = remainder(0.0 if drift is None else drift.rate, times, fixed)
        left = left.about_its_mean() if is_free else left
        every, count = _EVERY if drift is None else drift.every, len(fixed.names)
        shown, touched = ShownDrift.of(fixed, every, drift) if count else None, ""
        if shown is not None and shown.chance <= _TOUCHED[0] and count > 2:
            others = [ShownDrift.of(fixed.without(target), every, drift) for target in range(count)]
            chances = [1.0 if other is None else other.chance for other in others]
            touched = fixed.names[int(np.argmax(chances))] if max(chances) >= _TOUCHED[1] else ""
        return cls(drift, np.arange(times.size), left, count, fixed.times.size, shown, touched)

    @property
    def told(self) -> Drift:
        """The drift as stated, else none in the time for which that of fixed targets is told."""
        return self.drift or Drift(0.0, _EVERY)

    def __str__(self) -> str:
        rms, most = np.sqrt((self.left.std**2).mean()), np.linalg.norm(self.left.mean, axis=1).max()
        parts = [str(self.drift or "no drift stated")]
        if self.shown is not None:
            low, high = (f"{1e6 * bound:.3g}" for bound in self.shown.interval)
            figure = f"{1e6 * self.shown.std:.3g} µm in {self.told.every_text} (95 %: {low} to {high})"
            parts.append(f"{figure} by {self.readings} readings of {self.targets} fixed targets")
        if self.drift is not None:
            taken_out = f"up to {1e6 * most:.3g} µm taken out" if self.readings else "no fixed targets"
            parts.append(f"{taken_out}, {1e6 * rms:.3g} µm left along each axis")
        return "; ".join(parts)

    def moved(self, offset: int) -> Session:
        """Return the session with its readings ``offset`` later among all."""
        return replace(self, rows=self.rows + offset)


class CommonFactors(NamedTuple):
    """Factors of what readings of ``width`` numbers share, in base axes, for their rotations ``(P, 3, 3)`` to the base."""

    sessions: tuple[Session, ...]
    width: int
    rotations: Array

    @property
    def size(self) -> int:
        """How many variables they share."""
        return sum(session.left.steps.walk.shape[2] for session in self.sessions)

    def of(self, rows: NDArray[np.intp]) -> Array:
        """Return the factors of some readings, ``(R, m, k)``."""
        result, first = np.zeros((len(rows), self.width, self.size)), 0
        for session in self.sessions:
            at, size = np.flatnonzero(np.isin(rows, session.rows)), session.left.steps.walk.shape[2]
            factors = session.left.steps.of(np.searchsorted(session.rows, rows[at]))
            result[at, :3, first : first + size] = self.rotations[rows[at]] @ factors
            first += size
        return result

    @property
    def covariances(self) -> Array:
        """Covariance of each reading by what they share, ``(P, m, m)``."""
        factors = map(self.of, _in_parts(len(self.rotations)))
        return np.concatenate([part @ part.swapaxes(1, 2) for part in factors])


def drift_warnings(sessions: Sequence[Session]) -> Iterator[Finding]:
    """Yield a warning where fixed targets show another drift than stated."""
    for session in sessions:
        shown, stated = session.shown, session.drift
        # targets quieter than the std of the instrument leave no figure to write
        if shown is None or shown.chance > FALSE_DRIFT or not (std := shown.std or shown.interval[1]):
            continue
        text = session.told.every_text
        low, high = (f"{1e6 * bound:.3g}" for bound in shown.interval)
        figure = f"{float(f'{1e6 * std:.2g}'):g}"
        lacks = "which the sheet lacks" if stated is None else f"not of {1e6 * stated.std:.3g} µm"
        advice = f"write measurement: {{drift: {{std: {figure} um, every: {text}}}}}"
        if session.touched:
            advice = f"without {session.touched} they do not, so it moved by itself: give it another name from then on"
        message = (
            f"{session.readings} readings of {session.targets} fixed targets show a drift of {figure} µm in {text} "
            f"(95 %: {low} to {high} µm), {lacks}: {advice}"
        )
        yield Finding("warning", "W_DRIFT", message)
