"""Findings about a model at poses before sampling, and conditions of a verdict other than the samples."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import zip_longest
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError, visible
from precision_pin.model.equilibrium import turnover_findings
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.robot.configurations import ApproachedPose
from precision_pin.statistics import NO_SPREAD, Grounds, Specification
from precision_pin.statistics.plan import sizes_of

_MOST_POSES: Final = 50
"""Maximum number of poses, evenly spaced, for the fraction of variance taken as exact: enough for its range in a message."""
_ROBOTS: Final = (2**8, 2**14, 2**20)
"""Minimum and maximum number of robots per pose, and maximum at all poses, to compare the linear and the exact model."""
_SOLVED: Final = (2**8, 2**11, 2**14)
"""The same numbers of robots that each find the datum; a robot takes a millisecond."""
_SPEED_SLACK: Final = 1e-6
"""Fraction by which a speed may exceed its limit: times and joint values of a file are rounded."""


def grounds_at(
    model: ErrorModel,
    values: Array,
    labels: Sequence[str] = (),
    times: NDArray[np.float64] | None = None,
    both: Iterable[BothModels] = (),
    unreached: str = "",
) -> Grounds:
    """Return the grounds of a verdict over poses: not judged if a pose is outside limits, unreached, or passed too fast.

    Args:
        model: The model; with ``beyond_limits`` all poses are judged.
        values: Joint values ``(n, P)``.
        labels: Labels of several poses, for the reason.
        times: Times of a path's poses, s, ``(P,)``.
        unreached: Text about poses without joint values (default: from the findings of the model's sheet).
        both: Robots at each pose by both models, as from :func:`by_both_models`; the largest errors count.
    """
    removed = _RemovedTolerances.of(model)
    exact = () if removed is None else removed.names
    largest = largest_of_both(both)
    words = {"sampled": "the sampled model", "better": "robots that each found the datum", "decides": True}
    settings: dict[str, Any] = words if model.datums else {}
    if model.beyond_limits:
        return Grounds("", exact, largest, **settings)
    findings = () if model.sheet is None else model.sheet.findings
    unreached = unreached or next((finding.message for finding in findings if finding.code == "W_UNREACHED"), "")
    reason = _outside(model, values, labels) or unreached or _too_fast(model, values, times)
    return Grounds(reason, exact, largest, **settings)


BothModels = tuple[Mapping[str, Array], Mapping[str, Array]]
"""Absolute values ``(n,)`` of specified quantities of robots, by the linear and by the exact model."""


def by_both_models(
    models: Iterable[PoseModel], sampled: str, seed: int, specifications: Sequence[Specification], poses: int = 1
) -> Iterator[BothModels]:
    """Yield the absolute values of the specified quantities of robots at each pose by the sampled and a better model.

    The better one is the exact model if the linear one is sampled; with a datum, robots that each find it. Nothing if
    there is no better one. Infinite if it has no error, since a rotation is too large.
    """
    for pose, at in enumerate(models if sampled else ()):
        if at.datum is None and sampled != "linear":
            return
        least, most, in_all = _ROBOTS if at.datum is None else _SOLVED
        robots = max(least, min(most, in_all // poses))
        x = at.space.sample(seed, 0, robots, pose=pose)
        better = {specification.quantity: np.full(robots, np.inf) for specification in specifications}
        with suppress(InputError):
            better = specified_values(specifications, at.solved(x), at.posture.tool_axes)
        errors = at.linear(x) if sampled == "linear" else at.exact(x)
        yield specified_values(specifications, errors, at.posture.tool_axes), better


def specified_values(specifications: Sequence[Specification], errors: Array, tool_axes: Array) -> dict[str, Array]:
    """Return the absolute values ``(n,)`` of the specified quantities for errors ``(6, n)``."""
    return {
        specification.quantity: sizes_of(specification.quantity, errors, tool_axes) for specification in specifications
    }


def largest_of_both(both: Iterable[BothModels]) -> BothModels | None:
    """Return the largest quantities of each robot by both models, from :func:`by_both_models`; None without poses."""
    largest: BothModels | None = None
    for pair in both:
        linear, exact = (
            pair
            if largest is None
            else (
                {name: np.maximum(of[name], more[name]) for name in of} for of, more in zip(largest, pair, strict=True)
            )
        )
        largest = linear, exact
    return largest


def grounds_at_each(
    model: ErrorModel, values: Array, labels: Sequence[str], both: Iterable[BothModels] = ()
) -> list[Grounds]:
    """Return the grounds of a verdict at each of many poses ``(n, P)``; see :func:`grounds_at`."""
    inside = grounds_at(model, values[:, :0])
    limited, at = model.chain.limited(values)
    outside = np.asarray(limited.outside(at).any(axis=0)) & np.full(1, not model.beyond_limits)
    all_grounds = [
        replace(inside, not_judged=_outside(model, values[:, [pose]], [labels[pose]])) if is_outside else inside
        for pose, is_outside in enumerate(outside.tolist())
    ]
    return [replace(grounds, both=errors) for grounds, errors in zip_longest(all_grounds, both)]


def _outside(model: ErrorModel, values: Array, labels: Sequence[str] = ()) -> str:
    """Return a text about the first joint outside its limits at poses ``(n, P)``, or an empty text."""
    limited, values = model.chain.limited(values)
    outside = limited.outside(values)
    poses = np.flatnonzero(outside.any(axis=0))
    if not poses.size:
        return ""
    pose = int(poses[0])
    k = int(np.flatnonzero(outside[:, pose])[0])
    low, high = (float(ends[k]) for ends in limited.limits)
    scale, unit = _unit(limited.joints[k].kind == "prismatic")
    where = f" at {visible(labels[pose])}" if labels else ""
    more = f", and so are joints at {poses.size - 1:,} more of {values.shape[1]:,} poses" if poses.size > 1 else ""
    return (
        f"{visible(limited.names[k])} is outside its limits{where}: {scale * values[k, pose]:.7g} {unit}, "
        f"limits {scale * low:.7g} to {scale * high:.7g} {unit}{limited.wrap_hint(k, values[:, [pose]])}{more}"
    )


def _too_fast(model: ErrorModel, values: Array, times: NDArray[np.float64] | None) -> str:
    """Return a text about the first joint beyond its ``velocity`` between poses ``(n, P)`` at these times, or empty."""
    # a velocity of zero limits nothing
    if times is None or len(times) < 2:
        return ""
    joints = model.chain.joints
    limits = np.array(
        [np.inf if joint.limit is None or not joint.limit.velocity > 0 else joint.limit.velocity for joint in joints]
    )
    # dividing by a tiny step may overflow, which counts as too fast
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        speeds = np.abs(np.diff(values, axis=1)) / np.diff(times)
    fast = speeds > limits[:, None] * (1 + _SPEED_SLACK)
    steps = np.flatnonzero(fast.any(axis=0))
    if not steps.size:
        return ""
    step = int(steps[0])
    k = int(np.flatnonzero(fast[:, step])[0])
    scale, unit = _unit(bool(model.chain.prismatic[k]))
    more = f", and so are joints in {steps.size - 1:,} more of {len(times) - 1:,} steps" if steps.size > 1 else ""
    return (
        f"{visible(joints[k].name)} is faster than its limit from t = {times[step]:.7g} s to {times[step + 1]:.7g} s: "
        f"{scale * speeds[k, step]:.6g} {unit}/s, limit {scale * limits[k]:.6g} {unit}/s{more}"
    )


def speed_findings(model: ErrorModel, values: Array, times: NDArray[np.float64] | None) -> tuple[Finding, ...]:
    """Return the warning that a joint exceeds its speed limit between poses ``(n, P)`` at these times."""
    message = _too_fast(model, values, times)
    return (Finding("warning", "W_JOINT_SPEED", message, model.chain.robot.file),) if message else ()


def exact_findings(model: ErrorModel, values: Array, approaches: NDArray[np.int8] | None = None) -> tuple[Finding, ...]:
    """Return a warning of the first-order variance lost at poses ``(n, P)`` by changes from laws to fixed values."""
    removed = _RemovedTolerances.of(model)
    if removed is None:
        return ()
    poses = values.shape[1]
    columns = np.unique(np.linspace(0, poses - 1, min(poses, _MOST_POSES)).round().astype(np.intp))
    parts = removed.shares(model, values[:, columns], None if approaches is None else approaches[:, columns])
    texts = []
    for name, fractions in zip(("position", "attitude"), parts, strict=True):
        low, high = 100 * fractions.min(), 100 * fractions.max()
        spread = f"{high:.3g}" if high - low < 0.05 else f"{low:.3g} to {high:.3g}"
        texts.append(f"{spread} % of the variance of the {name}")
    of_all = f"{len(columns)} of {poses:,}" if len(columns) < poses else f"{poses}"
    over = f" (over {of_all} poses)" if poses > 1 else ""
    are = "are" if len(removed.names) > 1 else "is"
    message = (
        f"{', '.join(map(visible, removed.names))} {are} taken as exact by a change of the sheet; with this went "
        f"{' and '.join(texts)}, to first order{over}"
    )
    return (Finding("warning", "W_TAKEN_AS_EXACT", message),)


def exact_findings_at(model: ErrorModel, at: PoseModel) -> tuple[Finding, ...]:
    """Return the warning of :func:`exact_findings` at one pose."""
    approach = np.array(at.posture.approach, dtype=np.int8)[:, None] if at.posture.approach else None
    return exact_findings(model, at.posture.q[:, None], approach)


def _unit(slides: bool) -> tuple[float, str]:
    """Return the factor from SI to the unit of messages, and the unit."""
    return (1e3, "mm") if slides else (180 / np.pi, "deg")


@dataclass(frozen=True, eq=False)
class _RemovedTolerances:
    """Draws of the unchanged sheet whose tolerance a change removed, from some or all of their sources.

    Attributes:
        before: The model of the unchanged sheet.
        draws: Positions of the draws in its space.
        names: Paths of values taken as exact: ``parameters.NAME``, a source's label, or one of its settings.
    """

    before: ErrorModel
    draws: tuple[int, ...]
    names: tuple[str, ...]

    @staticmethod
    @lru_cache(maxsize=1)
    def of(model: ErrorModel) -> _RemovedTolerances | None:
        """Return the tolerances removed by changes of the model's sheet, if any; cached for grounds and warning."""
        if model.sheet is None or model.sheet.contents is None or (unchanged := model.sheet.unchanged) is None:
            return None
        if ("calibrated",) in model.sheet.contents.text.changes:
            # another calibration, or none, makes no value exact: the underlying laws count
            unchanged = replace(unchanged, estimates=None)
            model = ErrorModel.from_sheet(replace(model.sheet, estimates=None)).against(*model.datums)
        # changes leave the datums; a command line or an argument may have chosen others than the sheet
        before = ErrorModel.from_sheet(unchanged).against(*model.datums)
        uses_before, uses = _uses(before), _uses(model)
        removed = sorted(uses_before - uses)
        if not removed:
            return None
        parameters = {draw.name for draw in unchanged.space.draws}
        used_labels = {label for _, label in uses}
        used_names = {name for name, _ in uses}
        names = []
        procedures = {datum.label for datum in model.datums}
        for name, label in removed:
            if label in procedures:  # a copy of the robot's draw, made at a visit
                continue
            if name in parameters and name not in used_names:
                names.append(f"parameters.{name}")
            else:
                names.append(label if label not in used_labels or name in parameters else name)
        removed_names = {name for name, _ in removed}
        positions = tuple(k for k, draw in enumerate(before.space.draws) if draw.name in removed_names)
        return _RemovedTolerances(before, positions, tuple(dict.fromkeys(names)))

    def shares(self, model: ErrorModel, values: Array, approaches: NDArray[np.int8] | None) -> Array:
        """Return ``Cov(e_k, e)`` of the removed part, over the variance of position and attitude, ``(2, P)``."""
        columns = np.concatenate([np.arange(self.before.space.size)[self.before.space.slices[k]] for k in self.draws])
        index, names = model.space.index, np.array(self.before.space.components)[columns]
        remaining = [(row, index[name]) for row, name in enumerate(names) if name in index]
        shares = []
        pairs = zip(self.before.at_columns(values, approaches), model.at_columns(values, approaches), strict=True)
        for before, after in pairs:
            part = before.jacobian[:, columns].copy()
            for row, column in remaining:
                part[:, row] -= after.jacobian[:, column] * (after.space.block_covariance.variances[column] > 0)
            spread = before.space.block_covariance.times(np.ascontiguousarray(before.jacobian.T))
            totals = np.einsum("id,di->i", before.jacobian, spread).reshape(2, 3).sum(axis=1)
            removed = np.einsum("id,di->i", part, spread[columns]).reshape(2, 3).sum(axis=1)
            shares.append(np.divide(removed, totals, out=np.zeros(2), where=totals > 0))
        return np.array(shares).T


def _uses(model: ErrorModel) -> set[tuple[str, str]]:
    """Return each varying draw with the label of each source that uses it."""
    variances = model.space.block_covariance.variances
    return {
        (draw.name, label)
        for draw, labels, columns in zip(model.space.draws, model.owners, model.space.slices, strict=True)
        if variances[columns].any()
        for label in labels
    }


MOST_POSES: Final = 200
"""Maximum number of poses of a sheet that are evaluated; for others only joint limits are checked, which is fast."""
MOST_NUMBERS: Final = 500
"""Maximum number of components for checks of the first-order model, which needs every derivative."""
LARGEST_SQUARE: Final = 1e75
"""Largest squared error (m², rad²): products of two fourth moments, as in intervals of covariances, stay below 1e300."""


def pose_findings(model: ErrorModel, pose: str, *, spread: bool = True) -> tuple[Finding, ...]:
    """Return the findings, including errors, that an analysis at a pose would have about the pose."""
    # Warnings about the range of validity of the statics are left to the analysis: they concern an assumption of the
    # model, not the sheet. With more than 500 components, some robots are sampled instead of the first-order check.
    try:
        with np.errstate(over="raise"):
            at = model.at(pose)
            findings = [*at.findings("exact")]
            if at.space.size <= MOST_NUMBERS:
                largest = max(float(np.abs(at.error_at_means).max()) ** 2, float(np.abs(at.covariance).max()))
                if largest > LARGEST_SQUARE:
                    raise OverflowError
            if spread and not _varies(at):
                message = (
                    "no source makes the error vary: all robots have the same error, and no specification can be judged"
                )
                findings.append(Finding("warning", "W_NOTHING_VARIES", message))
    except (OverflowError, FloatingPointError):
        message = "the errors are too large to compute with; the tolerances or loads are far too large"
        return (Finding("error", "E_INPUT", message),)
    except InputError as error:
        return error.findings
    return tuple(findings)


def strained_findings(
    model: ErrorModel, pose: Array | ApproachedPose, label: str, *, first_order: bool = False
) -> tuple[Finding, ...]:
    """Return the named warnings at one pose of many about statics and, if requested, about first-order results."""
    # an analysis of many poses checks only the pose with the largest error, since each check solves the deflected arm;
    # not by model.at, which would repeat warnings of joint limits
    q, approach = model.configuration(pose)[:, None], model.approach(pose)
    at = next(model.at_columns(q, np.array(approach, dtype=np.int8)[:, None] if approach else None))
    findings = (*model.statics_findings(at), *(turnover_findings(at) if first_order else ()))
    return tuple(replace(finding, message=f"{label}: {finding.message}") for finding in findings)


def _varies(at: PoseModel) -> bool:
    """Return whether robots differ, to first order or in a sample."""
    if not at.space.size:
        return False
    if at.space.size <= MOST_NUMBERS and float(np.diag(at.covariance).max()) > NO_SPREAD**2:
        return True
    errors = at.exact(at.space.sample(0, 0, 64))
    # with very many numbers the sample may miss rare values
    return bool(np.ptp(errors, axis=1).max() > NO_SPREAD) or at.space.size > MOST_NUMBERS
