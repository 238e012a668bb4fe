"""Fits, and what they are worth at poses that they did not see, by equations of this file and not of the package."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.sparse.csgraph import connected_components

import precision_pin as pp
from benchmarks.measured.arms import URDF, load
from benchmarks.measured.sets import Factory, MeasuredSet, Rows
from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError

LEVEL: Final = 0.95
ROBOTS: Final = 200
"""Robots of a forecast."""
POSES: Final = 200
"""Random poses at which the error of a factory's robot is taken; joint values uniform within ± 180 degrees."""
SET_UP_ROWS: Final = 60
"""Rows of the fit, evenly chosen, by which base and target of each robot of a forecast are found."""
WAVES: Final = "1 mrad"
"""Amplitude of the free waves of once and twice in a turn of each joint."""
PLAY: Final = "{uniform: 5 mrad, mean: 5 mrad}"
"""What a joint lags behind its last motion, twice: by friction or play."""
FOLDS: Final = 5
"""Groups left out one after another where the publishers set no poses apart: place i belongs to group i mod 5."""
NEAR: Final = 0.01
"""Rows whose joints all differ by less, rad or m, are of one place, and left out together."""
GROSS: Final = 10.0
"""A reading is gross, counted and in no mean, if it is farther off than so many times the median of a fit that did not see
it, and a calibration to all readings, it among them, gives it no weight: so no reading that a fit foretells badly is left out."""
ALIKE: Final = 0.2
"""Angle, rad, within which attitudes of a tool are alike."""
VARIANTS: Final = {"geometry": "geometry", "complete": "geometry and drives"}
"""The fits in words."""
BAND: Final = "10 kN*m"
"""Friction, larger than any load, so that the approach decides the side."""


@dataclass
class Outcome:
    """A row of the table; lengths in m, ``None`` where there is nothing to say."""

    robot: str
    instrument: str
    readings: int
    judged: str
    forecast_by: str
    forecast: tuple[float, float, float]
    before: float
    as_measured: float | None = None
    geometry: float | None = None
    complete: float | None = None
    published: float | None = None
    within: float | None = None
    verdict: str = ""
    median: float | None = None
    gross: int | None = None
    seconds: float = 0.0
    distances: dict[str, Array] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class SetUp:
    """Base in the instrument's axes ``(4, 4)`` and targets in tool axes ``(T, 3)``."""

    base: Array
    targets: Array


# forward models ------------------------------------------------------------------------------------------------------


def tips(model: pp.ErrorModel, q: Array, x: Array, approaches: NDArray[np.int8] | None = None) -> tuple[Array, Array]:
    """Return positions ``(P, N, 3)`` and rotations ``(P, N, 3, 3)`` of the tip of N robots at P poses."""
    places, turns = [], []
    for at in model.at_columns(np.ascontiguousarray(q), approaches):
        error, pose = at.exact(x), at.posture.pose
        places.append((pose[:3, 3, None] + error[:3]).T)
        turns.append(np.moveaxis(se3.exp_rotation(error[3:]), 2, 0) @ pose[:3, :3])
    return np.array(places), np.array(turns)


def points(places: Array, turns: Array, set_up: SetUp) -> Array:
    """Return where the targets are read, ``(T, P, N, 3)``."""
    seen = places + np.einsum("pnij,tj->tpni", turns, set_up.targets)
    return np.asarray(seen @ set_up.base[:3, :3].T + set_up.base[:3, 3])


def find_set_up(places: Array, turns: Array, read: Array, guess: Array) -> SetUp:
    """Return base and targets that fit readings ``(T, P, 3)`` of a tip ``(P, 3)``, ``(P, 3, 3)`` best, by Gauss-Newton."""
    targets = np.repeat(guess[None], len(read), axis=0)
    seen = places + turns @ guess
    # the best rotation between two clouds (Kabsch 1976), the readings' one the mean of the targets
    mean = read.mean(axis=0)
    u, _, vt = np.linalg.svd((mean - mean.mean(axis=0)).T @ (seen - seen.mean(axis=0)))
    rotation = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    base = np.eye(4)
    base[:3, :3], base[:3, 3] = rotation, mean.mean(axis=0) - rotation @ seen.mean(axis=0)
    for _ in range(50):
        set_up = SetUp(base, targets)
        predicted = points(places[:, None], turns[:, None], set_up)[:, :, 0]
        slopes = set_up_slopes(predicted, turns[:, None], set_up)[:, :, 0]
        columns = slopes.reshape(-1, slopes.shape[-1])
        step = np.linalg.lstsq(columns, (read - predicted).ravel(), rcond=1e-10)[0]
        base = base.copy()
        base[:3, 3] += step[:3]
        base[:3, :3] = se3.exp_rotation(step[3:6]) @ base[:3, :3]
        targets = targets + step[6:].reshape(-1, 3)
        if np.abs(step).max() < 1e-10:
            break
    return SetUp(base, targets)


def find_set_up_without_gross(places: Array, turns: Array, read: Array, guess: Array) -> SetUp:
    """Return base and targets as :func:`find_set_up` by the rows without gross readings."""
    kept = np.ones(len(places), dtype=bool)
    while True:
        set_up = find_set_up(places[kept], turns[kept], read[:, kept], guess)
        apart = np.linalg.norm(read - points(places[:, None], turns[:, None], set_up)[:, :, 0], axis=2)
        still = kept & (apart <= GROSS * np.median(apart)).all(axis=0)
        if still.sum() == kept.sum():
            return set_up
        kept = still


def set_up_slopes(predicted: Array, turns: Array, set_up: SetUp) -> Array:
    """Return the derivatives of ``points`` by the base's shift and turn about its origin and the targets, ``(T, P, N, 3, k)``.

    ``predicted`` is ``(T, P[, N], 3)``; without N it counts as one robot.
    """
    predicted = predicted.reshape(len(set_up.targets), *turns.shape[:2], 3)
    count = len(set_up.targets)
    slopes = np.zeros((*predicted.shape, 6 + 3 * count))
    slopes[..., :3] = np.eye(3)
    arm = predicted - set_up.base[:3, 3]
    for axis in range(3):
        slopes[..., 3 + axis] = np.cross(np.eye(3)[axis], arm)
    for k in range(count):
        slopes[k, ..., 6 + 3 * k : 9 + 3 * k] = set_up.base[:3, :3] @ turns
    return slopes


# fits ----------------------------------------------------------------------------------------------------------------


def variants(sheet: str) -> dict[str, str]:
    """Return the sheet with geometry alone, and with compliances, waves and play by approach of all joints that turn."""
    text, mark, urdf = sheet.partition(URDF)
    lines = text.rstrip("\n").split("\n")
    geometry = [line for line in lines if not line.startswith("  - joint_compliance:")]
    waves = []
    for line in lines:
        if line.lstrip(" #-").startswith("joint_offset: {joint: ") and "mrad" in line:
            joint = line.split("{joint: ")[1].split(", offset")[0]
            waves += [
                f"  - encoder: {{joint: {joint}, amplitude: {WAVES}, order: 1, assumed: true}}",
                f"  - transmission: {{joint: {joint}, amplitude: {WAVES}, order: 2, assumed: true}}",
                f"  - backlash: {{joint: {joint}, backlash: {PLAY}, band: {BAND}, assumed: true}}",
            ]
    complete = [*lines, *waves]
    return {
        name: "\n".join(text) + "\n" + mark + urdf for name, text in (("geometry", geometry), ("complete", complete))
    }


def calibrated(model: pp.ErrorModel, rows: Rows, guess: tuple[float, float, float]) -> pp.CalibrationResult:
    """Return the calibration of an arm by rows; base, targets and the instrument's deviation are estimated.

    Where the tool hardly turns, readings do not tell a target from the base, and the target is where it was guessed.
    """
    several, is_known = len(rows.points) > 1, alike(model, rows.q)
    measurements = [
        pp.Measurement(
            *("position", "estimate"),
            target=guess,
            base="free",
            target_known=is_known,
            target_name=str(k + 1) * several,
        )  # type: ignore[arg-type]
        for k in range(len(rows.points))
    ]
    poses = [pp.ApproachedPose(q, signs) for q, signs in zip(rows.q.T, rows.approaches.T.tolist(), strict=True)]
    data = [(poses, read) for read in rows.points]
    return pp.calibrate(model, data if several else data[0], measurements if several else measurements[0])


def alike(model: pp.ErrorModel, q: Array) -> bool:
    """Return whether the tool's attitudes at joint values ``(n, P)`` are within `ALIKE`."""
    turns = np.moveaxis(model.chain.at_columns(np.ascontiguousarray(q)).pose[:3, :3], -1, 0)
    return bool(np.linalg.norm(se3.log_rotation(np.moveaxis(turns @ turns[0].T, 0, -1)), axis=0).max() < ALIKE)


@dataclass(frozen=True)
class Prediction:
    """Distances of readings from what a fit predicts ``(T, P)``, m, and whether each is within its 95 %."""

    distances: Array
    within: Array


def predict(model: pp.ErrorModel, fit: pp.CalibrationResult, seen: Rows, new: Rows) -> Prediction:
    """Judge a fit to ``seen`` by readings that are ``new``: the set-up is the fit's, covariances are computed here."""
    first = fit.set_ups[0].base
    assert first is not None
    set_up = SetUp(first, np.array([one.target for one in fit.set_ups]))
    free = np.array([name not in fit.at_bounds for name in fit.posterior.names])
    index = [model.space.index[name] for name in fit.posterior.names]
    prior = np.array([fit.posterior.prior_std[name] for name in fit.posterior.names])
    sigma = next(iter(fit.noise.values())).std
    count = 6 + 3 * len(set_up.targets)

    def slopes(rows: Rows) -> tuple[Array, Array]:
        """Return the prediction ``(T·P·3,)`` and its derivatives by numbers in units of their deviations, and the set-up."""
        step = 1e-2 * prior[free]
        x = np.repeat(fit.components[:, None], 1 + 2 * step.size, axis=1)
        x[np.array(index)[free], 1 + np.arange(step.size)] += step
        x[np.array(index)[free], 1 + step.size + np.arange(step.size)] -= step
        places, turns = tips(model, rows.q, x, rows.approaches)
        read = points(places, turns, set_up)
        by_arm = (read[:, :, 1 : 1 + step.size] - read[:, :, 1 + step.size :]) / 2e-2
        by_set_up = set_up_slopes(read[:, :, :1], turns[:, :1], set_up)[:, :, 0]
        columns = np.concatenate([np.moveaxis(by_arm, 2, 3), by_set_up], axis=3)
        return read[:, :, 0], columns

    _, fitted = slopes(seen)
    white = fitted.reshape(-1, fitted.shape[-1]) / sigma
    # a weak prior of 1 m and 1 rad keeps a set-up that readings determine in part regular
    weights = np.concatenate([np.ones(int(free.sum())), np.full(count, 1e-3)])
    scale = np.concatenate([np.ones(int(free.sum())), np.full(count, 1e-3)])
    triangle = np.linalg.qr(np.vstack([white * scale, np.diag(weights)]), mode="r")
    predicted, columns = slopes(new)
    roots = np.linalg.solve(triangle.T, (columns * scale).reshape(-1, len(scale)).T)
    residuals = new.points - predicted
    halves = roots.reshape(len(scale), *residuals.shape)
    covariance = np.einsum("ktpi,ktpj->tpij", halves, halves) + sigma**2 * np.eye(3)
    squares = np.einsum("tpi,tpi->tp", residuals, np.linalg.solve(covariance, residuals[..., None])[..., 0])
    return Prediction(np.linalg.norm(residuals, axis=2), squares <= stats.chi2.ppf(LEVEL, 3))


def splits(measured: MeasuredSet) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Return rows to fit and rows to judge, of those to fit and those set apart together; or each group in turn."""
    row = np.arange(len(measured.rows))
    if measured.judged is not None:
        return [(row[: len(measured.fit)], row[len(measured.fit) :])]
    group = visited(measured.fit.q) % FOLDS
    return [(row[group != k], row[group == k]) for k in range(FOLDS) if (group == k).any()]


def visited(q: Array) -> NDArray[np.intp]:
    """Return the number of the place of each row of ``(n, P)``, in order of their first rows."""
    near = np.array([(np.abs(q - row[:, None]) < NEAR).all(axis=0) for row in q.T])
    labels = connected_components(near, directed=False)[1]
    _, first, label = np.unique(labels, return_index=True, return_inverse=True)
    return np.asarray(np.argsort(np.argsort(first))[label])


def gross_readings(model: pp.ErrorModel, measured: MeasuredSet, distances: Array) -> NDArray[np.bool_]:
    """Return which of the readings that were judged ``(N,)`` are gross."""
    is_far = np.asarray(distances > GROSS * np.median(distances))
    if not is_far.any():
        return is_far
    has_no_weight = np.zeros(measured.rows.points.shape[:2], dtype=bool)
    fit = quiet(calibrated, model, measured.rows, measured.guess)
    has_no_weight.ravel()[[error.reading for error in fit.gross_errors]] = True
    return is_far & np.concatenate([has_no_weight[:, new].ravel() for _, new in splits(measured)])


def judge(measured: MeasuredSet) -> Outcome:
    """Return the row of a set."""
    before, band = forecast_and_before(measured)
    distances, within, verdict = {"before": before}, np.array([]), ""
    parts, notes, rows = splits(measured), list(measured.notes), measured.rows
    for name, sheet in variants(measured.sheet).items():
        model, found = load(sheet), []
        try:
            for seen, new in parts:
                fit = quiet(calibrated, model, rows[seen], measured.guess)
                found.append(quiet(predict, model, fit, rows[seen], rows[new]))
            if measured.judged is None:
                fit = quiet(calibrated, model, rows, measured.guess)
        except (InputError, np.linalg.LinAlgError) as error:
            if name == "geometry":
                raise
            notes.append(
                f"{VARIANTS[name]}: no fit ({error.findings[0].message if isinstance(error, InputError) else error})"
            )
            break
        last = model
        distances[name] = np.concatenate([one.distances.ravel() for one in found])
        within = np.concatenate([one.within.ravel() for one in found])
        gain = fit.improvement
        verdict = "no group can be left out" if gain is None else f"{gain.verdict}, {gain.share.verdict}"
        for cause in fit.causes[:1]:
            added = next(entry for entry in fit.gains if entry.kind == cause.kind)
            notes.append(
                f"{VARIANTS[name]}: most likely {cause}; fitted too, readings left out would be {1e3 * added.after:.3g} "
                f"instead of {1e3 * added.before:.3g} mm rms off"
            )
    apart = 1e3 * list(distances.values())[-1]
    is_gross = gross_readings(last, measured, apart)
    if is_gross.any():
        notes.append(
            f"{is_gross.sum()} of {apart.size} readings at unseen poses are gross, {apart[is_gross].min():.3g} to "
            f"{apart[is_gross].max():.3g} mm off where the median is {np.median(apart):.3g}: they are in no mean"
        )
    judged = f"{len(parts[0][1])} set apart" if measured.judged is not None else f"{len(parts)} groups"
    means = {name: float(values[~is_gross].mean()) for name, values in distances.items()}
    return Outcome(
        *(measured.robot, measured.instrument, len(measured.fit), judged, measured.forecast_by, band, means["before"]),
        *(measured.as_measured, means["geometry"], means.get("complete"), measured.published),
        *(float(np.mean(within[~is_gross])), verdict, 1e-3 * float(np.median(apart)), int(is_gross.sum())),
        distances=distances,
        notes=tuple(notes),
    )


# forecasts -----------------------------------------------------------------------------------------------------------


def sampled(model: pp.ErrorModel) -> Array:
    """Return the numbers of robots, ``(d, N)``; what changes from visit to visit is at its mean."""
    x = model.space.sample(seed=0, first=0, count=ROBOTS)
    for draw in model.space.draws:
        if draw.scope is not pp.Scope.UNIT:
            rows = [model.space.index[name] for name in draw.components]
            x[rows] = model.space.mean[rows][:, None]
    return np.asarray(x)


def quantiles(values: Array) -> tuple[float, float, float]:
    """Return the ends of the 95 % band of values of robots, and in between the median."""
    low, middle, high = np.quantile(values, [(1 - LEVEL) / 2, 0.5, (1 + LEVEL) / 2]).tolist()
    return low, middle, high


def forecast_and_before(measured: MeasuredSet) -> tuple[Array, tuple[float, float, float]]:
    """Return distances at unseen poses by base and target alone, and the forecast of their mean: with base and target alike."""
    model, distances, by_robot = measured.forecast, [], []
    x, guess = quiet(sampled, model), np.array(measured.guess)
    nominal = load(variants(measured.sheet)["geometry"])
    still = nominal.space.mean[:, None]
    for fitted_rows, judged_rows in splits(measured):
        seen, new = measured.rows[fitted_rows], measured.rows[judged_rows]
        places, turns = quiet(tips, nominal, seen.q, still)
        set_up = find_set_up_without_gross(places[:, 0], turns[:, 0], seen.points, guess)
        predicted = points(*quiet(tips, nominal, new.q, still), set_up)[:, :, 0]
        distances.append(np.linalg.norm(new.points - predicted, axis=2).ravel())
        chosen = seen.q[:, np.linspace(0, len(seen) - 1, min(SET_UP_ROWS, len(seen))).round().astype(int)]
        one = np.eye(4)
        own = SetUp(one, guess[None])
        (near, near_turns), (far, far_turns) = quiet(tips, model, chosen, x), quiet(tips, model, new.q, x)
        read, new_read = points(near, near_turns, own)[0], points(far, far_turns, own)[0]
        (near_0, near_r), (far_0, far_r) = quiet(tips, nominal, chosen, still), quiet(tips, nominal, new.q, still)
        by_robot.append([])
        for robot in range(x.shape[1]):
            fitted = find_set_up(near_0[:, 0], near_r[:, 0], read[None, :, robot], guess)
            left = new_read[:, robot] - points(far_0, far_r, fitted)[0, :, 0]
            by_robot[-1].append(np.linalg.norm(left, axis=1))
    means = np.concatenate([np.array(part) for part in by_robot], axis=1).mean(axis=1)
    return np.concatenate(distances), quantiles(means)


def judge_factory(factory: Factory) -> Outcome:
    """Return the row of a robot by its factory's file: mean distance of its tip from nominal at random poses."""
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (6, POSES))
    model = factory.forecast
    built = quiet(pp.ur_calibration, factory.path, model)
    nominal = np.array([at.posture.pose[:3, 3] for at in model.at_many(q)])
    none = np.zeros((0, 1))
    there = tips(built.arm, q, none)[0][:, 0]
    distances = np.linalg.norm(there - nominal, axis=1)
    forecast = np.linalg.norm(quiet(tips, model, q, quiet(sampled, model))[0] - nominal[:, None], axis=2).mean(axis=0)
    low, middle, high = quantiles(forecast)
    before = float(distances.mean())
    verdict = (
        "within the band"
        if low <= before <= high
        else "better than the band"
        if before < low
        else "worse than the band"
    )
    return Outcome(
        *(f"{factory.kind} {factory.path.stem.partition('-')[2]}", "factory calibration", POSES, "random poses"),
        *(factory.forecast_by, (low, middle, high), before),
        verdict=verdict,
        distances={"before": distances},
    )


def quiet(function: Any, *arguments: Any) -> Any:
    """Return a call's result without its warnings, such as of poses at which this arm would hit a plate."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return function(*arguments)
