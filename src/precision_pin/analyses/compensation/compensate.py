"""Correct the constant part of the pose error by other joint values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.analyses.budget.shares import source_lines
from precision_pin.analyses.compensation.correction import Correction, correct
from precision_pin.analyses.map.first_order import first_order
from precision_pin.analyses.map.map_poses import PosesGiven, approached, pose_set
from precision_pin.analyses.map.normal_norms import norm_quantiles, principal_axes
from precision_pin.analyses.provenance import Provenance
from precision_pin.analyses.result import AnalysisResult, list_warnings
from precision_pin.base.arguments import check_choice, check_instance, check_items, check_numbers
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError, add, warns_at_end
from precision_pin.base.progress import steps_to
from precision_pin.base.record import Keys
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.verdict_grounds import strained_findings
from precision_pin.render.html import Table, rendered
from precision_pin.render.tables import data_frame, milli
from precision_pin.robot.approach import approach_entry, written_approach
from precision_pin.robot.chain import pose_findings
from precision_pin.robot.pose_set import PoseSet
from precision_pin.sampling import Progress, check_progress

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]


Mode = Literal["position", "pose"]
"""Corrected components: position alone, or position and attitude."""


@final
@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class CompensationResult(AnalysisResult):
    """Corrected joint values of P poses and the remaining errors, base axes, m and rad.

    Attributes:
        joints, prismatic, poses: Joints in chain order, which of them slide, and the poses as requested.
        mode, weights: What was corrected, and the weights of the components, ``(6,)``; ``None`` where they must vanish.
        correction: Corrected joint values, errors at the means before and after, statuses.
        within_before, within_after: 95 % quantiles of |d| and |δ| from the requested pose, without and with correction,
            ``(2, P)``, by the first-order normal law about the mean error; NaN where nothing was corrected.
        sources, shares: Sources, and their fractions of the position's remaining variance, ``(lines, P)``.
    """

    schema: ClassVar[str] = "precision-pin/compensation/1"

    KEYS: ClassVar[Keys] = (
        "*head",
        "mode",
        "weights",
        "sources",
        "poses=entries",
        "assumptions",
        "warnings",
        "findings",
    )

    joints: tuple[str, ...]
    prismatic: tuple[bool, ...]
    poses: PoseSet
    mode: Mode
    weights: Array | None
    correction: Correction
    within_before: Array
    within_after: Array
    sources: tuple[str, ...]
    shares: Array

    @property
    def corrected(self) -> Array:
        """Corrected joint values, ``(n, P)``, rad and m; NaN where there are none."""
        return self.correction.q

    @property
    def is_complete(self) -> bool:
        """Whether every pose has corrected joint values."""
        return all(status == "corrected" for status in self.correction.status)

    @property
    def dominant_source(self) -> tuple[str, ...]:
        """The source of most of the remaining variance, by pose; empty where nothing varies or is known."""
        if not self.sources:
            return ("",) * len(self.poses)
        shares = np.nan_to_num(self.shares)
        largest = shares.argmax(axis=0).tolist()
        return tuple(self.sources[line] if shares[line, pose] > 0 else "" for pose, line in enumerate(largest))

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Assumptions of the numbers, one sentence each."""
        return (
            "the error that is corrected is that with every component at its mean, of the exact model",
            "95 % quantiles are those of the first-order model about it with a normal error, in closed form",
            "the controller moves each joint by exactly the correction, on top of its drive's errors in the sheet",
        )

    @property
    def entries(self) -> list[dict[str, Any]]:
        """The poses as in the JSON; null where nothing was corrected."""
        return [self._entry(pose, dominant) for pose, dominant in enumerate(self.dominant_source)]

    def _entry(self, pose: int, dominant: str) -> dict[str, Any]:
        of, made = self.poses, self.correction
        known = made.status[pose] == "corrected"
        approach = () if of.approaches is None else tuple(of.approaches[:, pose].tolist())

        def split(values: Array) -> dict[str, Array]:
            position, attitude = np.split(values[:, pose], 2)
            return {"position": position.squeeze(), "attitude": attitude.squeeze()}

        return {
            "name": of.names[pose],
            **({} if of.times is None else {"time": float(of.times[pose])}),
            "q": of.q[:, pose],
            **approach_entry(written_approach(self.joints, approach)),
            "q_corrected": made.q[:, pose] if known else None,
            "before": split(made.before),
            "first_order": split(made.first_order),
            "after": split(made.after) if known else None,
            "within_95_before": split(self.within_before),
            "within_95_after": split(self.within_after) if known else None,
            "shares": self.shares[:, pose] if known else None,
            "dominant_source": dominant or None,
            "iterations": int(made.iterations[pose]),
            "status": made.status[pose],
            "is_least": bool(made.is_least[pose]) if known else None,
        }

    def to_pandas(self) -> pandas.DataFrame:
        """Return a data frame, m and rad: a row for each pose."""
        made = self.correction
        rows, dominant = [], self.dominant_source
        for pose, label in enumerate(self.poses.labels):
            columns: dict[str, Any] = dict(zip(self.joints, self.poses.q[:, pose].tolist(), strict=True))
            columns |= {f"{name} corrected": float(made.q[k, pose]) for k, name in enumerate(self.joints)}
            for when, error in (("before", made.before), ("first order", made.first_order), ("after", made.after)):
                columns[f"position {when}"] = float(np.linalg.norm(error[:3, pose]))
                columns[f"attitude {when}"] = float(np.linalg.norm(error[3:, pose]))
            for norm, name in enumerate(("position", "attitude")):
                columns[f"{name} 0.95 before"] = float(self.within_before[norm, pose])
                columns[f"{name} 0.95 after"] = float(self.within_after[norm, pose])
            columns |= {"dominant source": dominant[pose], "status": made.status[pose]}
            rows.append(((label,), columns))
        return data_frame(["pose"], rows, self.head)

    @property
    def summary(self) -> str:
        """Text of `repr` after the arm."""
        count = self.correction.status.count("corrected")
        return f"{count:,} of {len(self.poses):,} poses corrected in {self.mode}"

    def _repr_html_(self) -> str:
        made, labels = self.correction, self.poses.labels
        rows = []
        for pose in range(min(len(labels), _MOST_ROWS)):
            numbers = [
                milli(float(np.linalg.norm(error[rows_of, pose])))
                for rows_of in (slice(0, 3), slice(3, 6))
                for error in (made.before, made.after)
            ]
            within = [milli(float(of[0, pose])) for of in (self.within_before, self.within_after)]
            rows.append([labels[pose], *numbers, *within, self.dominant_source[pose], made.status[pose]])
        columns = ["pose", "|d| before [mm]", "after", "|δ| before [mrad]", "after", "95 % |d| before", "after"]
        of = self.provenance
        title = f"Compensation of {of.robot}: {of.base} to {of.tip}, {len(labels):,} poses, {self.mode}"
        return rendered(title, [Table([*columns, "what remains", "status"], rows)], [*self.assumptions, *self.warnings])


_MOST_ROWS = 20


_POSITION = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


@warns_at_end
def compensate(
    error_model: ErrorModel,
    /,
    poses: PosesGiven,
    *,
    mode: Mode = "position",
    weights: ArrayLike | None = None,
    findings: Sequence[Finding] = (),
    progress: Progress | bool | None = None,
) -> CompensationResult:
    """Return joint values that place the mean-error arm at the nominal pose.

    The constant part of the error is that of the exact model with every component at its mean: deflection, offsets,
    calibrated errors. Newton's method on the arm with its errors removes it (:func:`.correction.correct`).

    Args:
        error_model: Chain, draws and sources.
        poses: A :class:`precision_pin.robot.pose_set.PoseSet`, or poses as for :func:`precision_pin.sample_poses`.
        mode: ``"position"``, or ``"pose"`` for position and attitude, which needs six joints.
        weights: With ``"pose"``: six weights, 1/m and 1/rad. The weighted sum of squares is then minimised, which suits
            an arm with fewer than six joints; directions near a singularity are left as they are.
        findings: Warnings to include in the result, such as those of the sheet.
        progress: Function called with the number of poses done since its last call; ``True`` shows a bar.

    Raises:
        InputError: A wrong argument; too few joints for the mode; no poses, or none whose joint values are known;
            errors too large to compute with.
        UnknownNameError: No such pose or joint.
    """
    check_instance("error_model", error_model, ErrorModel, "as ErrorModel.load makes it")
    check_choice("mode", mode, ("position", "pose"))
    known_findings = check_items("findings", findings, Finding)
    check_progress(progress)
    given_weights = _check_weights(mode, weights)
    needed = int(_POSITION.sum()) if mode == "position" else 6
    joints = len(error_model.chain.joints)
    if given_weights is None and joints < needed:
        other = "correct the position, or give weights" if mode == "pose" else 'give weights with mode="pose"'
        raise InputError(f"{mode} has {needed} components, which {joints} joints cannot all correct; {other}")
    given = pose_set(error_model, poses)
    if not given.known.any():
        raise InputError(f"none of the {len(given):,} poses has joint values")
    values = given.q[:, given.known]
    effective = given_weights if given_weights is not None else _POSITION if mode == "position" else np.ones(6)
    with steps_to(progress, values.shape[1], "poses") as step:
        approaches = given.of(given.known).approaches
        correction = correct(error_model, values, approaches, effective, given_weights is None, step)
    labels = [label for label, is_known in zip(given.labels, given.known, strict=True) if is_known]
    result = _with_laws(error_model, given, correction, mode, given_weights)
    worst = int(np.nanargmax(np.linalg.norm(result.correction.before[:3], axis=0)))
    at = approached(given.take(np.array([worst])))[0]
    found = (
        *pose_findings(error_model.chain, values, labels),
        *strained_findings(error_model, at, given.labels[worst], first_order=True),
    )
    add(found)
    return replace(result, findings=known_findings, warnings=list_warnings(known_findings, map(str, found)))


def _check_weights(mode: Mode, weights: ArrayLike | None) -> Array | None:
    if weights is None:
        return None
    if mode != "pose":
        raise InputError('weights need mode="pose"; in mode "position" the three components of the position vanish')
    checked = check_numbers("weights", weights, (6,))
    if (checked < 0).any() or not checked.any():
        raise InputError("weights must not be negative, and one must be positive")
    return checked


def _with_laws(
    error_model: ErrorModel, poses: PoseSet, correction: Correction, mode: Mode, weights: Array | None
) -> CompensationResult:
    """Return the result with the laws before and after, over all poses; NaN where unknown."""
    known = poses.known
    lines = source_lines(error_model)
    corrected = np.array(correction.status) == "corrected"
    approaches = poses.of(known).approaches
    before = first_order(error_model, poses.q[:, known], approaches, lines, None, lambda _: None)
    within = np.full((2, len(corrected)), np.nan)
    shares = np.full((len(lines), len(corrected)), np.nan)
    if corrected.any():
        own = None if approaches is None else approaches[:, corrected]
        after = first_order(error_model, correction.q[:, corrected], own, lines, None, lambda _: None)
        within[:, corrected] = _within(correction.after[:, corrected], after.covariance)
        shares[:, corrected] = after.shares

    def spread(array: NDArray[Any], fill: float = np.nan) -> NDArray[Any]:
        full = np.full((*array.shape[:-1], len(poses)), fill)
        full[..., known] = array
        return full

    status = np.array(poses.status, dtype="<U11")
    status[known] = correction.status
    return CompensationResult(
        provenance=Provenance.of(error_model, 0),
        joints=tuple(error_model.chain.joint_names),
        prismatic=tuple(error_model.chain.prismatic),
        poses=poses,
        mode=mode,
        weights=weights,
        correction=Correction(
            q=spread(correction.q),
            before=spread(correction.before),
            first_order=spread(correction.first_order),
            after=spread(correction.after),
            iterations=spread(correction.iterations, 0),
            status=tuple(status.tolist()),
            is_least=spread(correction.is_least, True),
        ),
        within_before=spread(_within(before.mean, before.covariance)),
        within_after=spread(within),
        sources=tuple(line.name for line in lines),
        shares=spread(shares),
    )


def _within(mean: Array, covariance: Array) -> Array:
    parts = (slice(0, 3), slice(3, 6))
    return np.stack([norm_quantiles(*principal_axes(mean[part], covariance[part, part]), 0.95) for part in parts])
