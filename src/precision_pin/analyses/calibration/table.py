"""A calibration as text for a terminal: forecast and result."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.calibration.calibrate import CalibrationResult
from precision_pin.analyses.calibration.datum_plan import DatumPlan
from precision_pin.analyses.calibration.design import Identifiability, SetUp, UnitNumbers, stations_of_data
from precision_pin.analyses.calibration.forecast import (
    ROBOTS,
    CalibrationForecast,
    CurvePoint,
    ErrorLeft,
    PosesOutcome,
    Posterior,
)
from precision_pin.analyses.calibration.gains import JOINTS_READ, CauseGain
from precision_pin.analyses.calibration.instrument import fitted_covariance
from precision_pin.analyses.calibration.plan import CalibrationPlan
from precision_pin.analyses.calibration.population import FactoryCalibration, Population
from precision_pin.analyses.calibration.std_estimate import EstimatedStd
from precision_pin.analyses.provenance import Provenance
from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.base.errors import shortened, shown, some, visible
from precision_pin.base.written_units import WrittenUnit
from precision_pin.render.tables import milli
from precision_pin.render.text_table import aligned, limited, remainder
from precision_pin.sheet.measurement import Measurement
from precision_pin.statistics import format_inside

MOST_NUMBERS: Final = 15
"""Maximum number of rows in the table of estimates."""
MOST_READINGS: Final = 8
"""Maximum number of rows in the table of the worst readings."""
LEARNED: Final = "learned: the share of the prior variance that the readings remove"
LEFT_OUT: Final = (
    "std: the residual in standard deviations of the reading, instrument and repeatability together; left out: its residual of a "
    "fit without it"
)
NO_PRIOR: Final = "maximum likelihood: the sheet's tolerances are no prior"
VERDICTS: Final = {
    "agrees": "the model explains the readings",
    "disagrees": "the model does NOT explain the readings",
    "better than stated": "the readings fit better than their standard deviations say",
    "not tested": "whether the model explains the readings is not tested",
}
_POSES: Final = 12
"""Maximum number of poses in the table, those with the largest error left."""
_NAME: Final = 44
"""Maximum number of characters of a number's name."""
_SEAT: Final = 34
"""Maximum number of characters of the name of a displaced joint or tip."""
_CAUSES: Final = 3
"""Maximum number of causes of which the gain is told."""
_ROWS: Final = 8
"""Maximum number of combinations, sockets and names listed; a curve has up to two columns more."""
_NAMED: Final = 4
"""Maximum number of numbers named of a combination."""
_PARAGRAPH: Final = 400
"""Maximum number of characters of the paragraph about combinations: up to five lines."""
_TOLERANCES: Final = 60
"""Maximum number of tolerances in the table."""
_HEAD: Final = 9
"""Maximum number of characters of a joint's name above its values."""
_JOINTS: Final = 7
"""Maximum number of joints whose values fit into a line."""
_AIMS: Final = {"task": "the position error left at the poses below", "D": "the determinant of the information"}
_SOURCES: Final = {
    "repeats": "differences at repeated poses",
    "all readings": "all readings, with what the model leaves",
}
_FREE: Final = {"distance": "anchor", "plane": "plane", "socket": "sockets"}
"""Known or free part of the set-up by kind; otherwise the base."""
_EXPLANATION: Final = (
    "before: from the nominal robot; after: from the calibrated robot; floor: what pose- and visit-scope draws cause, which no "
    "calibration removes; 95 %: quantile of |d|, first order, "
)


def table(result: CalibrationForecast | CalibrationPlan | CalibrationResult) -> str:
    """Return a result of one arm as text."""
    if isinstance(result, CalibrationForecast):
        return forecast_table(result)
    return plan_table(result) if isinstance(result, CalibrationPlan) else calibration_table(result)


def forecast_table(result: CalibrationForecast) -> str:
    """Return the forecast: remaining error at the user's poses, learned numbers, and accuracy against effort."""
    of = result.provenance
    lines = [
        f"calibrating {_arm(of)}: rms position error {_sizes(result)}",
        f"{result.readings:,} readings of {describe_measurement(result.measurement)}; first order",
        "",
        *_poses(result),
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
        explanation(result),
        *of.resting_lines,
    ]
    return "\n".join(lines)


def calibration_table(result: CalibrationResult) -> str:
    """Return the verdict on model and data, the residuals, the estimates and the error left."""
    of = result.provenance
    lines = [
        f"{_arm(of)}: {improvement_text(result)}",
        *share_lines(result),
        f"{VERDICTS[result.verdict]}; {residuals_text(result)}",
        f"{measured_text(result)}; {chi_square_text(result)}",
        *map(str, result.data.sessions),
        *gain_lines(result),
        *frame_lines(result),
        "" if result.has_prior else f"{NO_PRIOR}\n",
        *_poses(result),
        "",
        # no space for the mean of the sheet next to a long name; it is in the JSON and the report
        *aligned([[*row[:2], *row[3:]] for row in estimate_rows(result, limited(MOST_NUMBERS))]),
        *_learned_notes(len(result.posterior.names)),
        "",
        *aligned(_spaced(reading_rows(result))),
        LEFT_OUT,
        *set_up_lines(result.set_ups),
        "",
        *identifiability_lines(result.identifiability),
        "",
        explanation(result),
    ]
    return "\n".join(lines)


def plan_table(result: CalibrationPlan) -> str:
    """Return the poses to measure, how good the choice is, and the error that it leaves."""
    of = result.provenance
    joints, legend = list(result.poses[0].q), list[str]()
    heads = [visible(joint) for joint in joints]
    if any(len(head) > _HEAD for head in heads):
        legend = [f"joints: {', '.join(f'{k} {head}' for k, head in enumerate(heads, 1))}"]
        heads = [f"{k}" for k in range(1, len(joints) + 1)]
    rows = [["pose to measure", "", *heads]]
    for k, name, q in zip(result.chosen, result.names, result.q.T, strict=True):
        cells = [
            f"{1e3 * value:.2f} mm" if joint in result.sliding_joints else f"{math.degrees(value):.2f}°"
            for joint, value in zip(joints, q, strict=True)
        ]
        rows.append([shortened(name, 20) or f"candidate {k + 1}", "", *cells])
    left_out = ", ".join(f"{n:,} {why}" for why, n in result.left_out.items())
    lines = [
        f"measure {result.count:,} of {result.candidates:,} poses of {_arm(of)}: rms position error {_sizes(result)}",
        *([f"left out before: {left_out}"] if left_out else []),
        f"{describe_measurement(result.measurement)}; first order; seed {of.seed}",
        f"chosen for {_AIMS[result.criterion]}: at least {100 * result.efficiency:.4g} % of the best possible (certified bound); "
        f"random choices: {100 * result.random_efficiency:.3g} %",
        "",
        *_poses(result),
        "",
        *([*aligned(rows), *legend] if len(joints) <= _JOINTS else ["the poses to measure are in the JSON"]),
        "",
        *identifiability_lines(result.identifiability),
        "",
        explanation(result),
        *of.resting_lines,
    ]
    return "\n".join(lines)


def datum_table(result: DatumPlan) -> str:
    """Return the poses at which to find a datum, as in a sheet, and the error that they leave."""
    texts = {
        key: f"{milli(value, 3)} mm" if value < np.inf else "nothing" for key, value in result.rms_position.items()
    }
    count, total, of = f"{len(result.chosen):,}", f"{result.candidates:,}", result.provenance
    left_out = "".join(f", {n:,} {why}" for why, n in result.left_out.items())
    lines = [
        f"find datum {visible(result.datum.name)} ({result.datum.kind}) of {_arm(of)} at {count} of {total} poses: "
        f"{texts['chosen']} rms at {some(result.tasks, 3)}",
        f"with all {total}: {texts['all']}; with {count} random ones: {texts['random']} (median of 25)",
        f"deviation of the position, first order; no exchange of one pose is better; seed {of.seed}{left_out}",
        "",
        "poses:",
        *(f"  - {json.dumps(text, ensure_ascii=False)}" for text in result.texts),
    ]
    return "\n".join(lines)


def describe_measurement(measurement: Measurement) -> str:
    """Return a description of instrument and set-up."""
    parts = [f"{measurement.kind}, std {measurement.sight or f'{1e6 * measurement.std:.4g} µm'}"]
    if measurement.kind == "pose":
        parts.append(f"{1e6 * float(measurement.deviations[-1]):.4g} µrad")
    parts.append(f"target at {_point(measurement.target)} mm{'' if measurement.target_known else ' (estimated)'}")
    parts.append(f"{_FREE.get(measurement.kind, 'base')} {measurement.base}")
    if measurement.drift is not None:
        parts.append(str(measurement.drift))
    if measurement.load is not None:
        payloads = " + ".join(f"{payload.mass:.4g} kg at {visible(payload.at)}" for payload in measurement.load)
        parts.append(f"load {payloads or 'none'}")
    return ", ".join(parts)


def headline(result: CalibrationResult) -> list[str]:
    """Return the answer as sentences: verdict, residuals, the error left, the readings without weight."""
    lines = [
        # a browser breaks a line within "->"
        f"{_capital(improvement_text(result).replace('->', '→'))}.",
        f"{_capital(VERDICTS[result.verdict])}: {chi_square_text(result)}.",
        f"{_capital(residuals_text(result))}.",
        *(f"{_capital(line)}." for line in share_lines(result)),
        *(f"{_capital(line).replace('->', '→')}." for line in _said_gains(result)),
        f"Position error of the tip at {_where(result)}: rms {_sizes(result)}.",
        *(f"{_capital(str(session))}." for session in result.data.sessions),
        *(f"{_capital(line)}." for line in frame_lines(result)),
    ]
    if result.gross_errors:
        worst = max(result.gross_errors, key=lambda error: error.deviations)
        count, label = len(result.gross_errors), result.data.label(worst.reading)
        lead, label = ("1 reading was", label) if count == 1 else (f"{count:,} readings were", f"the worst is {label}")
        lines.append(
            f"{lead} given no weight: {label}, {milli(worst.size, 3)} mm or {worst.deviations:.3g} standard deviations off."
        )
    return lines


def page_headline(result: CalibrationResult) -> tuple[str, str]:
    """Return the answer of a page with a calibration, the error after it, and a line that names the page's own answer."""
    before, after, seen = (milli(result.rms_position[which], 3) for which in ("before", "after", "seen"))
    if result.measurement.sees_apart:
        after = f"{seen} mm rms as the instrument sees it, in base axes {after}"
    answer = f"After calibration: position error {after} mm rms at {_where(result)}; {before} mm before"
    own = "Before calibration, robots of the sheet (after it: the sheet of calibrate --sheet with --datum compensated):"
    return f"{answer}; {verdict_text(result)}", own


def _where(result: CalibrationResult) -> str:
    return f"pose {shown(result.poses[0].name)}" if len(result.poses) == 1 else f"{len(result.poses):,} poses"


def _arm(of: Provenance) -> str:
    return f"{visible(of.robot)}, {visible(of.base)} to {visible(of.tip)}"


def _sizes(result: PosesOutcome) -> str:
    before, after, floor = (milli(result.rms_position[key], 3) for key in ("before", "after", "floor"))
    return f"{before} mm before, {after} mm after; floor {floor} mm"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def residuals_text(result: CalibrationResult) -> str:
    """Return the root mean squares of the residuals."""
    return (
        f"residuals: {milli(result.rms('before'), 3)} mm rms before, {milli(result.rms('after'), 3)} mm after; "
        f"left-out readings: {milli(result.rms('left out'), 3)} mm rms"
    )


def verdict_text(result: CalibrationResult) -> str:
    """Return the verdict on left-out poses as a short phrase."""
    return {
        "helps": "the calibration helps",
        "not shown to help": "the calibration is not shown to help",
        "makes unseen poses worse": "the calibration makes unseen poses worse",
    }["not shown to help" if result.improvement is None else result.improvement.verdict]


def improvement_text(result: CalibrationResult) -> str:
    """Return the verdict on left-out poses with its figures."""
    outcome = result.improvement
    if outcome is None:
        return f"{verdict_text(result)}: no reading follows from the others"
    baseline = "base and target alone" if result.measurement.nuisances else "the sheet's means"
    facts = f"left-out error {milli(outcome.before, 3)} -> {milli(outcome.after, 3)} mm rms"
    method = f"before: {baseline}; {outcome.groups:,} {outcome.grouped_by} left out in turn"
    if outcome.interval is None or outcome.before_interval is None:
        return f"{verdict_text(result)}: too few {outcome.grouped_by}; {facts}; {method}"
    low, high, before_low, before_high = (milli(limit, 3) for limit in (*outcome.interval, *outcome.before_interval))
    gain = f"gain {milli(outcome.gain, 3)} mm (95 %: {low} to {high}, of {before_low} to {before_high})"
    return f"{verdict_text(result)}: {facts}, {gain}; {method}"


def share_lines(result: CalibrationResult) -> list[str]:
    """Return a line on the calibration of the standard deviations; none if no reading is predicted."""
    if result.improvement is None:
        return []
    share = result.improvement.share
    times, percent = share.ratio_interval, [f"{100 * limit:.3g}" for limit in share.interval]
    few = ", too few poses" if share.verdict == "undecided" else ""
    return [
        f"{share.verdict}{few}: left-out readings are {share.ratio:.3g} times ({times[0]:.3g} to {times[1]:.3g}) as far off as "
        f"their standard deviations say; {100 * share.within:.3g} % are within their 95 % ({percent[0]} to {percent[1]} %)"
    ]


def gain_lines(result: CalibrationResult) -> list[str]:
    """Return a line on what causes would change at left-out readings if they were fitted too, and one on joint values as read."""
    by_cause = [entry for entry in result.gains if entry.kind != JOINTS_READ][:_CAUSES]
    lines = []
    if by_cause:
        # the largest of many that chance brings has no interval
        named, intervals = (by_cause, map(interval_text, by_cause)) if result.causes else (by_cause[:1], [""])
        parts = [
            f"{milli(entry.after, 3)} mm by {entry.label}{text}" for entry, text in zip(named, intervals, strict=True)
        ]
        lead = (
            "if a cause were fitted too"
            if result.causes
            else "no cause shows; the most that one would bring, by chance"
        )
        lines.append(f"{lead}: left-out error {milli(by_cause[0].before, 3)} -> {'; '.join(parts)}")
    for entry in result.gains:
        if entry.kind == JOINTS_READ:
            given, read = (f"{milli(value, 3)} mm" for value in (entry.before, entry.after))
            which = "undecided" if not entry.is_decided else "as read" if entry.gain > 0 else "as given"
            lines.append(
                f"joint values: left-out error {given} as given, {read} as read{interval_text(entry)}; better: {which}"
            )
    return lines


def _said_gains(result: CalibrationResult) -> list[str]:
    """Return the lines on gains for a first page: none where no cause shows."""
    return gain_lines(result) if result.causes or result.data.q_read.size else []


def interval_text(entry: CauseGain) -> str:
    """Return the interval of a gain in brackets, mm; nothing of too few groups."""
    return "" if entry.interval is None else f" (gain {' to '.join(milli(limit, 3) for limit in entry.interval)})"


def frame_lines(result: CalibrationResult) -> list[str]:
    """Return a line with the error left in both frames, at the pose with the largest; none if base and target are known."""
    if not result.measurement.sees_apart:
        return []
    worst = max(result.poses, key=lambda entry: entry.quantile("after"))
    base, frame = (milli(worst.quantile(which), 3) for which in ("after", "seen"))
    target = "" if result.measurement.target_known else " of the target"
    return [
        f"95 % of |d| left at {shown(worst.name)}: {base} mm in base axes, {frame} mm{target} in the frame of the readings"
    ]


def seen_lines(measurement: Measurement) -> list[str]:
    """Return a line on the column ``seen``; none if base and target are known."""
    found = [
        name
        for name, is_found in (("base", measurement.displaces_base), ("target", not measurement.target_known))
        if is_found
    ]
    point = "" if measurement.target_known else " of the target"
    verb = "is" if len(found) == 1 else "are"
    line = f"seen: the error after,{point} in the instrument's axes; {' and '.join(found)} {verb} found with the arm"
    return [line] if found else []


def measured_text(result: CalibrationResult) -> str:
    """Return the number of readings of each measurement."""
    data = result.data
    # merge targets of one kind and files of one measurement
    indices_by_measurement: dict[Measurement, list[int]] = {}
    for k, measurement in enumerate(data.measurements):
        indices_by_measurement.setdefault(replace(measurement, target_name=""), []).append(k)
    parts = []
    for measurement, numbers in indices_by_measurement.items():
        targets = len({data.measurements[k].target_name for k in numbers})
        several = f" of {targets} targets" if targets > 1 else ""
        count = int(np.isin(data.part, numbers).sum())
        parts.append(f"{count:,} readings{several} of {describe_measurement(measurement)}")
    return "; ".join(parts)


def chi_square_text(result: CalibrationResult) -> str:
    """Return the test statistics of the verdict."""
    facts = f"chi-square {result.chi_square:.4g} for {result.degrees_of_freedom:,} degrees of freedom"
    chance = "" if result.probability is None else f", probability {result.probability:.2g}"
    return "; ".join([facts + chance, *(_std_text(name, estimate) for name, estimate in result.noise.items())])


def _std_text(name: str, fit: EstimatedStd) -> str:
    unit = "mm" if name == "std" else "mrad"
    low, high = (milli(limit, 3) for limit in fit.interval)
    return (
        f"{name} estimated as {milli(fit.std, 3)} {unit} (95 %: {low} to {high}) on {fit.degrees_of_freedom:.3g} degrees of "
        f"freedom, from {_SOURCES[fit.decided_by]}"
    )


def _spaced(rows: Sequence[Sequence[str]]) -> list[list[str]]:
    """Return rows with an empty second column, so that a terminal shows the others to the right."""
    return [[row[0], "", *row[1:]] for row in rows]


def pose_rows(result: PosesOutcome) -> list[list[str]]:
    """Return a header and a row for each of the user's poses, mm; where there are many the twelve with most left, worst first."""
    columns, entries = ["before", "after", *["seen"] * result.measurement.sees_apart], list(result.poses)
    if len(entries) > _POSES:
        entries = sorted(entries, key=lambda entry: -entry.rms("after"))[: limited(_POSES)]
    rows = [["pose, mm", *(f"{error} {statistic}" for error in columns for statistic in ("rms", "95 %")), "floor rms"]]
    for entry in entries:
        cells = [text for error in columns for text in (milli(entry.rms(error), 3), _quantile_text(entry, error))]
        rows.append([shortened(entry.name, 20), *cells, milli(entry.rms("floor"), 3)])
    return rows


def _quantile_text(entry: ErrorLeft, error: str) -> str:
    value, bounds = entry.quantile(error), entry.quantile_interval(error)
    return milli(value, 3) if bounds is None else format_inside(1e3 * value, (1e3 * bounds[0], 1e3 * bounds[1]), most=3)


def explanation(result: PosesOutcome) -> str:
    """Return the meaning of the columns of :func:`pose_rows`, and the basis of the quantiles."""
    is_sampled = any(entry.sampled for entry in result.poses)
    return _EXPLANATION + (f"of {ROBOTS:,} robots sampled with the sheet's laws" if is_sampled else "of normal errors")


def poses_with_less(result: PosesOutcome) -> list[str]:
    """Return a line on the poses that :func:`pose_rows` omits; none if it has all."""
    return remainder(len(result.poses) - (limited(_POSES) or len(result.poses)), "poses with less left")


def _poses(result: PosesOutcome) -> list[str]:
    return [*aligned(_spaced(pose_rows(result))), *poses_with_less(result), *seen_lines(result.measurement)]


def _learned(posterior: Posterior) -> list[str]:
    rows = [["number", "unit", "prior std", "std after", "learned"]]
    for name in _most_learned(posterior)[: limited(MOST_NUMBERS)]:
        unit = posterior.units[name]
        before, after = (f"{std[name] * unit.per_si:.3g}" for std in (posterior.prior_std, posterior.std))
        rows.append([shortened(name, _NAME), unit.name, before, after, f"{100 * posterior.learned[name]:.1f} %"])
    return [*aligned(rows), *_learned_notes(len(posterior.names))]


def _most_learned(posterior: Posterior) -> list[str]:
    return sorted(posterior.names, key=lambda name: -posterior.learned[name])


def estimate_rows(result: CalibrationResult, most: int | None) -> list[list[str]]:
    """Return a header and up to ``most`` rows of numbers, or all, best learned first, each in its unit."""
    posterior = result.posterior
    rows = [["number", "unit", "prior mean", "prior std", "estimate", "95 % from", "to", "learned"]]
    for name in _most_learned(posterior)[:most]:
        values = (posterior.prior_mean[name], posterior.prior_std[name], posterior.mean[name], *result.interval(name))
        # a number that was not learned differs from its prior mean by rounding
        unit, step = posterior.units[name], 1e-9 * posterior.prior_std[name]
        cells = [f"{float(np.round(value / step)) * step * unit.per_si + 0.0:.3g}" for value in values]
        cells.append(f"{100 * posterior.learned[name]:.1f} %")
        rows.append([shortened(name, _NAME - 4), unit.name, *cells])
    return rows


def _learned_notes(count: int) -> list[str]:
    return [LEARNED, *remainder(count - (limited(MOST_NUMBERS) or count), "numbers of which less is learned")]


def identifiability_lines(result: Identifiability) -> list[str]:
    """Return the numbers that the readings determine, do not determine, and determine in combinations only."""
    indices = ", ".join(f"{name} {value:.3g}" for name, value in result.observability.items())
    lines = [
        f"the readings determine {result.rank:,} combinations of {len(result.names):,} numbers; {indices} "
        "(units of prior std and noise)"
    ]
    if result.unseen:
        lines.append(f"not seen at all: {some(result.unseen, limited(_ROWS) or len(result.unseen))}")
    groups = [group.described(limited(_NAMED) or len(group.names)) for group in result.combinations]
    sizes = np.cumsum([len(group) for group in groups])
    shown_count = max(int((sizes <= (limited(_PARAGRAPH) or math.inf)).sum()), 1)
    others = remainder(len(groups) - shown_count, "groups")
    return lines + [f"only combinations: {'; '.join([*groups[:shown_count], *others])}"] * bool(groups)


def _curve(title: str, points: Sequence[CurvePoint], per_si: float) -> list[str]:
    last_points = points[-(limited(_ROWS + 2) or len(points)) :]
    head = [title, "", *(f"{point.value * per_si:.4g}" for point in last_points)]
    return aligned([head, ["", "", *(milli(point.rms_position, 3) for point in last_points)]])


def reading_rows(result: CalibrationResult) -> list[list[str]]:
    """Return a header and a row for each of the readings farthest from the calibrated arm, the worst first, mm."""
    worst = WorstReadings.of(result, limited(MOST_READINGS))
    rows = [["worst readings, mm", "residual", "std", "left out", "weight"]]
    for k, row in enumerate(worst.rows):
        left_out = float((result.left_out[row, :3] ** 2).sum() ** 0.5)
        weight = "0" if worst.is_gross[k] else "1"
        cells = [milli(float(worst.sizes[k]), 3), deviations_text(worst.deviations[k]), milli(left_out, 3), weight]
        rows.append([worst.labels[k], *cells])
    return rows


def deviations_text(value: float) -> str:
    """Return a number of standard deviations; below a thousandth it is 0."""
    return f"{round(float(value), 3):.3g}"


def gross_rows(result: CalibrationResult) -> list[list[str]]:
    """Return a header and a row for each reading that was given no weight, the worst first."""
    worst = sorted(result.gross_errors, key=lambda error: -error.deviations)
    rows = [[result.data.label(error.reading), milli(error.size, 3), f"{error.deviations:.3g}"] for error in worst]
    return [["reading", "residual, mm", "std"], *rows]


def set_up_lines(set_ups: Sequence[SetUp]) -> list[str]:
    """Return a line for each part of the set-ups that was estimated, mm."""
    return list(dict.fromkeys(line for set_up in set_ups for line in _set_up_lines(set_up)))


def _set_up_lines(set_up: SetUp) -> list[str]:
    lines: list[str] = []

    def is_estimated(part: str) -> bool:
        return any(name.startswith(part) for name in set_up.std)

    def add(name: str, place: Array, part: str, first: int = 0) -> None:
        deviations = [std for number, std in set_up.std.items() if number.startswith(part)][first : first + 3]
        lines.append(f"{name}, estimated (± std): {_with_std(1e3 * place, 1e3 * np.array(deviations))} mm")

    if set_up.base is not None:
        base, std = set_up.base, set_up.base_std
        turn = _with_std(np.degrees(se3.log_rotation(base[:3, :3])), np.degrees(std[3:]))
        place = f"{_with_std(1e3 * base[:3, 3], 1e3 * std[:3])} mm, rotation vector {turn} °"
        lines.append(f"base of the robot in the instrument's axes, estimated (± std): {place}")
    if is_estimated("target"):
        name = next(name for name in set_up.std if name.startswith("target")).partition(".")[0]
        add(f"{name} in tool axes", set_up.target, "target")
    if set_up.plane is not None and is_estimated("plane"):
        height, normal = 1e3 * float(set_up.plane[0] @ set_up.plane[1]), " ".join(f"{x:.6f}" for x in set_up.plane[1])
        lines.append(f"plane in base axes, estimated: normal {normal}, {height:.6g} mm from the base's origin")
    if set_up.sockets is not None and is_estimated("socket"):
        for k, socket in enumerate(set_up.sockets[: limited(_ROWS)]):
            add(f"socket {k + 1} in base axes", socket, "socket", 3 * k)
    if set_up.anchor is not None and is_estimated("anchor"):
        add("anchor in base axes", set_up.anchor, "anchor")
    return lines


def _with_std(values: Array, deviations: Array) -> str:
    """Return three numbers to two digits of their standard deviations, each with it."""
    cells = []
    for value, std in zip(values.tolist(), deviations.tolist(), strict=True):
        decimals = max(0, 1 - math.floor(math.log10(std))) if 0 < std < math.inf else 3
        cells.append(f"{value:.{decimals}f} ± {f'{std:.{decimals}f}' if std < math.inf else 'unknown'}")
    return ", ".join(cells)


class WorstReadings(NamedTuple):
    """K readings, that with the largest residual of its lengths first, base axes.

    Attributes:
        rows, lines, labels: Their indices in the data, ``(K,)``, their rows in the file, from 1, and in words.
        points: Place of the target where the calibrated arm predicts it, m, ``(3, K)``.
        after, before, sizes: Residual after and before, m, ``(3, K)``: of a distance along the line of sight, of a
            height along the normal; before in the axes of the first guess of a free base. Lengths of ``after``,
            ``(K,)``.
        deviations, is_gross: Residual in standard deviations (gross: in a fit without it); whether it has no weight.
        anchor: Where distances are measured from, m, ``(3,)``; ``None`` for other readings and several measurements.
    """

    rows: NDArray[np.intp]
    lines: tuple[int, ...]
    labels: tuple[str, ...]
    points: Array
    after: Array
    before: Array
    sizes: Array
    deviations: Array
    is_gross: NDArray[np.bool_]
    anchor: Array | None

    @classmethod
    def of(cls, result: CalibrationResult, most: int | None) -> WorstReadings:
        """Return the worst readings of a calibration, ``most`` of them or all."""
        sizes = np.linalg.norm(result.residuals[:, :3], axis=1)
        rows = np.argsort(-sizes, kind="stable")[:most]
        data, fitted_measurements = result.data, _fitted_measurements(result)
        points, after, before = np.zeros((3, 3, rows.size))
        deviations = np.zeros(rows.size)
        instrument = fitted_covariance(data, [set_up.base for set_up in result.set_ups])
        selection = replace(
            data,
            q=data.q[:, rows],
            readings=data.readings[rows],
            part=data.part[rows],
            visit=np.arange(rows.size),
            approaches=data.approaches[:, rows] if data.approaches.size else data.approaches,
        )
        for station in stations_of_data(result.original, selection):
            pose, error = station.at.posture.pose, station.at.exact(result.components[:, None])
            for k in station.rows:
                row = int(rows[k])
                measurement, fitted = data.measurements[data.part[row]], fitted_measurements[data.part[row]]
                place = result.set_ups[data.part[row]].base
                point = Measurement(target=fitted.target).predict(pose, error, np.zeros((0, 1)))[:, 0]
                slopes = fitted.slopes(pose, error[:, 0], np.zeros(0))
                directions = np.eye(3)
                if fitted.place is not None:
                    nominal = pose[:3, 3] + pose[:3, :3] @ measurement.target
                    directions = fitted.place.slopes(point, np.zeros(len(fitted.place.names)), nominal)[0]
                points[:, k] = point
                after[:, k] = result.residuals[row, : len(directions)] @ directions
                before[:, k] = result.residuals_before[row, : len(directions)] @ directions
                if place is not None:
                    after[:, k] = (data.readings[row, :3] - place[:3, 3]) @ place[:3, :3] - point
                one_visit = np.zeros(measurement.size, dtype=np.intp)
                covariance = instrument[row, : measurement.size, : measurement.size]
                noise = station.noise(slopes.error, covariance, one_visit)
                residual = result.residuals[row, : measurement.size].copy()
                residual[:3] = after[:, k] if fitted.place is None else residual[:3]
                deviations[k] = np.sqrt(residual @ np.linalg.solve(noise, residual))
        gross = {error.reading: error.deviations for error in result.gross_errors}
        lines, labels = tuple(data.lines[row] for row in rows), tuple(data.label(row) for row in rows)
        is_gross = np.isin(rows, list(gross))
        deviations = np.array([*map(gross.get, rows.tolist(), deviations.tolist())])
        anchor = result.set_up.anchor if len(data.measurements) == 1 else None
        return cls(rows, lines, labels, points, after, before, sizes[rows], deviations, is_gross, anchor)


def _fitted_measurements(result: CalibrationResult) -> list[Measurement]:
    """Return the measurements with their set-ups as estimated, in base axes."""
    measurements = []
    for measurement, set_up in zip(result.data.measurements, result.set_ups, strict=True):
        places = {name: getattr(set_up, name) for name in ("target", "anchor", "plane", "sockets")}
        values = {name: place.tolist() for name, place in places.items() if place is not None}
        known = replace(measurement, base="known", target_known=True, sight=None, stands_at=None, **values)
        measurements.append(known)
    return measurements


def _point(values: Iterable[float]) -> str:
    return " ".join(f"{1e3 * x:.6g}" for x in values)


def population_table(result: Population) -> str:
    """Return the number of tolerances that differ from the sheet's, and each with its interval."""
    of = result.provenance
    changed = [tolerance for tolerance in result.tolerances if not tolerance.agrees]
    verdict = f"{len(changed):,} of {len(result.tolerances):,} tolerances are other than the sheet's"
    numbers = UnitNumbers.of(result.model.space)
    quantities = dict(zip(numbers.names, numbers.quantities, strict=True))
    rows = [["draw", "unit", "measured std", "of the sheet's", f"{100 * result.confidence:g} %", "interval", ""]]
    order = sorted(result.tolerances, key=lambda tolerance: (tolerance.agrees, -tolerance.scale))
    for tolerance in order[: limited(_TOLERANCES)]:
        unit = WrittenUnit.suiting(quantities[tolerance.numbers[0]], [tolerance.std])
        high = f"{tolerance.high:.3g}" if tolerance.high < float("inf") else "no limit"
        mark = "" if tolerance.agrees else "other"
        name = shortened(" and ".join(tolerance.names), _NAME)
        interval = [f"{tolerance.low:.3g}", high]
        rows.append([name, unit.name, f"{tolerance.std * unit.per_si:.3g}", f"{tolerance.scale:.3g}", *interval, mark])
    lines = [
        f"{result.robots:,} robots {_arm(of)}: {verdict}",
        f"means {'estimated too, restricted likelihood' if result.means == 'estimated' else 'of the sheet'}; likelihood ratio "
        f"to the sheet's {result.log_likelihood_ratio:.4g} (chi-square of {len(result.tolerances)} where the sheet is right)",
        "",
        *aligned(rows),
        *remainder(len(order) - (limited(_TOLERANCES) or len(order)), "tolerances"),
        "of the sheet's: measured over the sheet's standard deviation; profile likelihood",
    ]
    if result.unseen:
        lines.append(f"no reading shows {', '.join(map(visible, result.unseen))}")
    lines += [f"hardly more than a joint tolerance of {', '.join(group.names)}" for group in result.groups]
    return "\n".join(lines)


def factory_table(result: FactoryCalibration) -> str:
    """Return the distance of the built arm from the nominal robot, and the displacement of each joint."""
    of, chain = result.provenance, result.model.chain
    rows = [["place", "", "x [mm]", "y [mm]", "z [mm]", "rx [mrad]", "ry [mrad]", "rz [mrad]"]]
    for name, values in zip((*chain.joint_names, chain.tip), result.displacements, strict=True):
        rows.append([shortened(name, _SEAT), "", *(f"{1e3 * value + 0.0:.4f}" for value in values)])
    lines = [
        f"{visible(of.robot, 30)} is a {result.kind}; as its factory measured it, the tip is "
        f"{milli(result.rms_position, 3)} mm rms from the nominal",
        f"robot's, at most {milli(result.largest_position, 3)} mm (200 random poses); {visible(of.base)} to {visible(of.tip)}",
        f"{visible(result.file)}{f', hash {visible(result.checksum)}' if result.checksum else ''}",
        "",
        *aligned(rows),
        "displacement of each joint's origin and of the tip, in their own axes, as a shift and a rotation vector",
    ]
    return "\n".join(lines)
