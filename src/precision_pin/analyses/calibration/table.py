"""A calibration as text for a terminal: forecast and result."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from precision_pin.analyses.calibration.calibration_result import CalibrationResult
from precision_pin.analyses.calibration.forecast import CalibrationForecast, CurvePoint
from precision_pin.analyses.calibration.identifiability import Identifiability
from precision_pin.analyses.calibration.plan import CalibrationPlan
from precision_pin.analyses.calibration.posterior import ROBOTS, ErrorLeft, Posterior
from precision_pin.analyses.calibration.readings import WorstReadings
from precision_pin.analyses.calibration.set_up import SetUp
from precision_pin.base.text_escape import shortened, shown, visible
from precision_pin.render.tables import milli, resting_on
from precision_pin.render.text_table import aligned
from precision_pin.sheet.measurement import Measurement
from precision_pin.statistics import format_inside

MOST_NUMBERS: Final = 15
"""Numbers in the table of what is learned."""
MOST_READINGS: Final = 8
"""Readings in the table of the worst."""
LEARNED: Final = "SI units; learned: the share of the prior variance that the readings remove"
LEFT_OUT: Final = (
    "std: the residual in standard deviations of the reading, instrument and repeatability together; left out: its residual of a "
    "fit without it"
)
NO_PRIOR: Final = "maximum likelihood: the sheet's tolerances are no prior"
VERDICTS: Final = {
    "agrees": "the model explains the readings",
    "disagrees": "the model does NOT explain the readings",
    "better than stated": "the readings fit better than their standard deviations say",
}
SEEN: Final = "seen: the error after, in the instrument's axes; the base is found with the arm"
_POSES: Final = 12
_NAME: Final = 44
_ROWS: Final = 8
_HEAD: Final = 9
"""Longest name of a joint above its values."""
_JOINTS: Final = 7
"""Most joints whose values fit into a line."""
_FREE: Final = {"distance": "anchor", "plane": "plane", "socket": "sockets"}
"""What is known or free of a kind; of others the base."""
_EXPLANATION: Final = (
    "before: from the nominal robot; after: from the calibrated robot; floor: what pose- and visit-scope draws cause, which no "
    "calibration removes; 95 %: quantile of |d|, first order, "
)


def forecast_table(result: CalibrationForecast) -> str:
    """Return what measuring will buy: the error left at the user's poses, what is learned, and against what it depends."""
    of = result.provenance
    lines = [
        f"calibrating {visible(of.robot)}, {visible(of.base)} to {visible(of.tip)}: rms position error "
        f"{milli(result.rms('before'), 3)} mm before, {milli(result.rms('after'), 3)} mm after; "
        f"floor {milli(result.rms('floor'), 3)} mm",
        f"{result.readings:,} readings of {describe_measurement(result.measurement)}; first order",
        "",
        *_poses(result.poses, result.measurement),
        "",
        *_learned(result.posterior),
        "",
        *identifiability_lines(result.identifiability),
        "",
        "rms position error over these poses, mm, against ...",
        *_curve("number of readings", result.by_count, 1.0),
        "",
        *_curve("std of the instrument, µm", result.by_instrument, 1e6),
        "",
        explanation(result.poses),
        *resting_on(of.assumed, of.sources, of.origins, of.origins_at),
    ]
    return "\n".join(lines)


def calibration_table(result: CalibrationResult) -> str:
    """Return the verdict on model and data, the residuals, the estimates and the error left."""
    of = result.provenance
    lines = [
        f"{visible(of.robot)}, {visible(of.base)} to {visible(of.tip)}: {VERDICTS[result.verdict]}; "
        f"{residuals_text(result)}",
        f"{measured_text(result)}; {chi_square_text(result)}",
        "" if result.has_prior else f"{NO_PRIOR}\n",
        *_poses(result.poses, result.measurement),
        "",
        # the mean of the sheet finds no room beside a long name; it is in the JSON and the report
        *aligned(_spaced([[row[0], *row[2:]] for row in estimate_rows(result)])),
        *_more(len(result.posterior.names)),
        "",
        *aligned(_spaced(reading_rows(result))),
        LEFT_OUT,
        *set_up_lines(result.set_up),
        "",
        *identifiability_lines(result.identifiability),
        "",
        explanation(result.poses),
    ]
    return "\n".join(lines)


def plan_table(result: CalibrationPlan) -> str:
    """Return the poses to measure, how good the choice is, and the error that it leaves."""
    of = result.provenance
    joints = list(result.poses[0].q)
    aim = (
        "the position error left at the poses below"
        if result.criterion == "task"
        else "the determinant of the information"
    )
    heads = [visible(joint) for joint in joints]
    is_long = any(len(head) > _HEAD for head in heads)
    listed = [f"joints: {', '.join(f'{k} {head}' for k, head in enumerate(heads, 1))}"] if is_long else []
    rows = [["pose to measure", "", *([f"{k}" for k in range(1, len(joints) + 1)] if is_long else heads)]]
    for k, name, q in zip(result.chosen, result.names, result.q.T, strict=True):
        cells = [
            f"{1e3 * value:.2f} mm" if joint in result.sliding_joints else f"{math.degrees(value):.2f}°"
            for joint, value in zip(joints, q, strict=True)
        ]
        rows.append([shortened(name, 20) or f"candidate {k + 1}", "", *cells])
    lines = [
        f"measure {len(result.chosen):,} of {result.candidates:,} poses of {visible(of.robot)}, {visible(of.base)} to "
        f"{visible(of.tip)}: rms position error {milli(result.rms('before'), 3)} mm before, "
        f"{milli(result.rms('after'), 3)} mm after; floor {milli(result.rms('floor'), 3)} mm",
        f"{describe_measurement(result.measurement)}; first order; seed {of.seed}",
        f"chosen for {aim}: at least {100 * result.efficiency:.4g} % of the best possible (certified bound); "
        f"random choices: {100 * result.random_efficiency:.3g} %",
        "",
        *_poses(result.poses, result.measurement),
        "",
        *([*aligned(rows), *listed] if len(joints) <= _JOINTS else ["the poses to measure are in the JSON"]),
        "",
        *identifiability_lines(result.identifiability),
        "",
        explanation(result.poses),
        *resting_on(of.assumed, of.sources, of.origins, of.origins_at),
    ]
    return "\n".join(lines)


def describe_measurement(measurement: Measurement) -> str:
    """Return instrument and set-up in words."""
    words = [f"{measurement.kind}, std {1e6 * measurement.std:.4g} µm"]
    if measurement.kind == "pose":
        words.append(f"{1e6 * float(measurement.deviations[-1]):.4g} µrad")
    target = " ".join(f"{1e3 * x:.6g}" for x in measurement.target)
    words.append(f"target at {target} mm{'' if measurement.target_known else ' (estimated)'}")
    words.append(f"{_FREE.get(measurement.kind, 'base')} {measurement.base}")
    if measurement.load is not None:
        carried = " + ".join(f"{payload.mass:.4g} kg at {visible(payload.at)}" for payload in measurement.load)
        words.append(f"load {carried or 'none'}")
    return ", ".join(words)


def headline(result: CalibrationResult) -> list[str]:
    """Return the answer as sentences: verdict, residuals, the error left, the readings without weight."""
    lines = [
        f"{_capital(VERDICTS[result.verdict])}: {chi_square_text(result)}.",
        f"{_capital(residuals_text(result))}.",
    ]
    lines.append(f"{_error_left_text(result)}.")
    if result.gross_errors:
        worst = max(result.gross_errors, key=lambda error: error.deviations)
        count = len(result.gross_errors)
        what = "1 reading was" if count == 1 else f"{count:,} readings were"
        which = f"row {worst.line}" if count == 1 else f"the worst is row {worst.line}"
        lines.append(
            f"{what} given no weight: {which}, {milli(worst.size, 3)} mm or {worst.deviations:.3g} standard deviations off."
        )
    return lines


def _error_left_text(result: CalibrationResult) -> str:
    """Return the error at the user's poses before and after, rms over all of them."""
    entries = result.poses
    sizes = {
        which: milli(float(np.sqrt(np.mean([entry.rms(which) ** 2 for entry in entries]))), 3)
        for which in ("before", "after", "floor")
    }
    where = f"pose {shown(entries[0].name)}" if len(entries) == 1 else f"{len(entries):,} poses"
    return (
        f"Position error of the tip at {where}: rms {sizes['before']} mm before, {sizes['after']} mm after; floor "
        f"{sizes['floor']} mm"
    )


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def residuals_text(result: CalibrationResult) -> str:
    """Return the root mean squares of the residuals."""
    return (
        f"residuals: {milli(result.rms('before'), 3)} mm rms before, {milli(result.rms('after'), 3)} mm after; "
        f"left-out readings: {milli(result.rms('left out'), 3)} mm rms"
    )


def measured_text(result: CalibrationResult) -> str:
    """Return how many readings there are, and of what."""
    return f"{len(result.data):,} readings of {describe_measurement(result.measurement)}"


def chi_square_text(result: CalibrationResult) -> str:
    """Return what the verdict rests on."""
    return (
        f"chi-square {result.chi_square:.4g} for {result.degrees_of_freedom:,} degrees of freedom, probability "
        f"{result.probability:.2g}"
    )


def _spaced(rows: Sequence[Sequence[str]]) -> list[list[str]]:
    """Return rows with an empty second column, so that a terminal shows the others to the right."""
    return [[row[0], "", *row[1:]] for row in rows]


def pose_rows(entries: Sequence[ErrorLeft], measurement: Measurement) -> list[list[str]]:
    """Return a header and a row for each of the user's poses, mm; where there are many the twelve with most left, worst first."""
    columns = ["before", "after", *(["seen"] if measurement.displaces_base else []), "floor"]
    listed = sorted(entries, key=lambda entry: -entry.rms("after"))[:_POSES] if len(entries) > _POSES else entries
    head = [f"{which} {what}" for which in columns for what in (["rms", "95 %"] if which != "floor" else ["rms"])]
    rows = [["pose, mm", *head]]
    for entry in listed:
        cells = []
        for which in columns:
            cells.append(milli(entry.rms(which), 3))
            if which != "floor":
                cells.append(_quantile_text(entry, which))
        rows.append([shortened(entry.name, 20), *cells])
    return rows


def _quantile_text(entry: ErrorLeft, which: str) -> str:
    """Return a quantile of |d| in mm; of a sampled one the digits that its interval supports."""
    value, ends = entry.quantile(which), entry.quantile_interval(which)
    return milli(value, 3) if ends is None else format_inside(1e3 * value, (1e3 * ends[0], 1e3 * ends[1]), most=3)


def explanation(entries: Sequence[ErrorLeft]) -> str:
    """Return what the columns of :func:`pose_rows` are, and what the quantiles rest on."""
    if any(entry.sampled for entry in entries):
        return f"{_EXPLANATION}of {ROBOTS:,} robots sampled with the sheet's laws"
    return f"{_EXPLANATION}of normal errors"


def poses_with_less(count: int) -> list[str]:
    """Return a line on the poses that :func:`pose_rows` leaves out of so many; none where it has all."""
    return [f"… and {count - _POSES:,} poses with less left"] if count > _POSES else []


def _poses(entries: Sequence[ErrorLeft], measurement: Measurement) -> list[str]:
    lines = aligned(_spaced(pose_rows(entries, measurement)))
    return [*lines, *poses_with_less(len(entries)), *([SEEN] if measurement.displaces_base else [])]


def _learned(posterior: Posterior) -> list[str]:
    names = sorted(posterior.names, key=lambda name: -posterior.learned[name])
    rows = [["number", "", "prior std", "std after", "learned"]]
    for name in names[:MOST_NUMBERS]:
        cells = [
            f"{posterior.prior_std[name]:.3g}",
            f"{posterior.std[name]:.3g}",
            f"{100 * posterior.learned[name]:.1f} %",
        ]
        rows.append([shortened(name, _NAME), "", *cells])
    return [*aligned(rows), *_more(len(names))]


def estimate_rows(result: CalibrationResult, most: int = MOST_NUMBERS) -> list[list[str]]:
    """Return a header and a row for each number, at most so many, that of which most is learned first; SI units."""
    posterior = result.posterior
    names = sorted(posterior.names, key=lambda name: -posterior.learned[name])
    rows = [["number", "prior mean", "prior std", "estimate", "95 % from", "to", "learned"]]
    for name in names[:most]:
        values = (posterior.prior_mean[name], posterior.prior_std[name], posterior.mean[name], *result.interval(name))
        cells = [*(f"{value + 0.0:.3g}" for value in values), f"{100 * posterior.learned[name]:.1f} %"]
        rows.append([shortened(name, _NAME - 4), *cells])
    return rows


def _more(count: int) -> list[str]:
    rest = (
        [f"… and {count - MOST_NUMBERS:,} numbers of which less is learned; all are in the JSON"]
        if count > MOST_NUMBERS
        else []
    )
    return [LEARNED, *rest]


def identifiability_lines(found: Identifiability) -> list[str]:
    """Return what the readings determine, what not, and what in combinations only."""
    indices = ", ".join(f"{name} {value:.3g}" for name, value in found.observability.items())
    lines = [
        f"the readings determine {found.rank:,} combinations of {len(found.names):,} numbers; {indices} "
        "(units of prior std and noise)"
    ]
    if found.unseen:
        lines.append(f"not seen at all: {_list(found.unseen)}")
    lines += [f"only combinations: {group}" for group in found.combinations[:_ROWS]]
    if len(found.combinations) > _ROWS:
        lines.append(f"… and {len(found.combinations) - _ROWS} more groups")
    return lines


def _list(names: Sequence[str]) -> str:
    more = f" and {len(names) - _ROWS} more" if len(names) > _ROWS else ""
    return f"{', '.join(names[:_ROWS])}{more}"


def _curve(what: str, points: Sequence[CurvePoint], per_si: float) -> list[str]:
    listed = points if len(points) <= _ROWS + 2 else points[-(_ROWS + 2) :]
    head = [what, "", *(f"{point.value * per_si:.4g}" for point in listed)]
    return aligned([head, ["", "", *(milli(point.rms_position, 3) for point in listed)]])


def reading_rows(result: CalibrationResult) -> list[list[str]]:
    """Return a header and a row for each of the readings farthest from the calibrated arm, the worst first, mm."""
    worst = WorstReadings.of(result, MOST_READINGS)
    rows = [["worst readings, mm", "residual", "std", "left out", "weight"]]
    for k, row in enumerate(worst.rows):
        left_out = float((result.left_out[row, :3] ** 2).sum() ** 0.5)
        weight = "0" if worst.is_gross[k] else "1"
        cells = [milli(float(worst.sizes[k]), 3), deviations_text(worst.deviations[k]), milli(left_out, 3), weight]
        rows.append([f"row {worst.lines[k]}", *cells])
    return rows


def deviations_text(value: float) -> str:
    """Return a number of standard deviations; below a thousandth it is 0."""
    return f"{round(float(value), 3):.3g}"


def gross_rows(result: CalibrationResult) -> list[list[str]]:
    """Return a header and a row for each reading that was given no weight, the worst first."""
    worst = sorted(result.gross_errors, key=lambda error: -error.deviations)
    rows = [[f"row {error.line}", milli(error.size, 3), f"{error.deviations:.3g}"] for error in worst]
    return [["reading", "residual, mm", "std"], *rows]


def set_up_lines(found: SetUp) -> list[str]:
    """Return a line for each part of the set-up that was estimated, mm."""
    lines = []
    if found.base is not None:
        place = " ".join(f"{1e3 * x:.6g}" for x in found.base[:3, 3])
        lines.append(f"base of the robot in the instrument's axes, estimated: {place} mm")
    if any(name.startswith("target") for name in found.std):
        lines.append(f"target in tool axes, estimated: {' '.join(f'{1e3 * x:.6g}' for x in found.target)} mm")
    if found.plane is not None and any(name.startswith("plane") for name in found.std):
        height, normal = 1e3 * float(found.plane[0] @ found.plane[1]), " ".join(f"{x:.6f}" for x in found.plane[1])
        lines.append(f"plane in base axes, estimated: normal {normal}, {height:.6g} mm from the base's origin")
    if found.sockets is not None and any(name.startswith("socket") for name in found.std):
        for k, place in enumerate(found.sockets[:_ROWS]):
            lines.append(f"socket {k + 1} in base axes, estimated: {' '.join(f'{1e3 * x:.6g}' for x in place)} mm")
    if found.anchor is not None and any(name.startswith("anchor") for name in found.std):
        lines.append(f"anchor in base axes, estimated: {' '.join(f'{1e3 * x:.6g}' for x in found.anchor)} mm")
    return lines
