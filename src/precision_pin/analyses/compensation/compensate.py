"""Correct the constant part of the pose error: joint values that place the mean-error arm at the nominal pose."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.analyses.first_order import first_order, norm_quantiles, principal_axes
from precision_pin.analyses.provenance import PosesGiven, Provenance, approached, pose_set
from precision_pin.analyses.result import AnalysisResult, list_warnings
from precision_pin.analyses.shares import source_lines
from precision_pin.base import se3
from precision_pin.base.arguments import check_choice, check_instance, check_items, check_numbers
from precision_pin.base.arrays import Array, Fixed, Keys
from precision_pin.base.errors import Finding, InputError, add, warns_at_end
from precision_pin.base.progress import check_progress, steps_to
from precision_pin.model.error_model import ErrorModel, takes_datum
from precision_pin.model.pose_model import tangents
from precision_pin.render.html import Table, rendered
from precision_pin.render.tables import data_frame, milli
from precision_pin.robot.chain import pose_findings
from precision_pin.robot.configurations import approach_entry, written_approach
from precision_pin.robot.pose_set import SINGULAR_BELOW, PoseSet, chain_length
from precision_pin.sampling import Progress
from precision_pin.sampling.verdict_grounds import strained_findings

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]

Mode = Literal["position", "pose"]
"""Corrected components: position alone, or position and attitude."""


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
        *("*head", "mode", "weights", "sources", "poses=entries", "assumptions", "warnings", "findings"),
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
        poses, correction = self.poses, self.correction
        is_corrected = correction.status[pose] == "corrected"
        approach = () if poses.approaches is None else tuple(poses.approaches[:, pose].tolist())

        def split(values: Array) -> dict[str, Array]:
            position, attitude = np.split(values[:, pose], 2)
            return {"position": position.squeeze(), "attitude": attitude.squeeze()}

        return {
            "name": poses.names[pose],
            **({} if poses.times is None else {"time": float(poses.times[pose])}),
            "q": poses.q[:, pose],
            **approach_entry(written_approach(self.joints, approach)),
            "q_corrected": correction.q[:, pose] if is_corrected else None,
            "before": split(correction.before),
            "first_order": split(correction.first_order),
            "after": split(correction.after) if is_corrected else None,
            "within_95_before": split(self.within_before),
            "within_95_after": split(self.within_after) if is_corrected else None,
            "shares": self.shares[:, pose] if is_corrected else None,
            "dominant_source": dominant or None,
            "iterations": int(correction.iterations[pose]),
            "status": correction.status[pose],
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
        correction, labels = self.correction, self.poses.labels
        rows = []
        for pose in range(min(len(labels), _MOST_ROWS)):
            numbers = [
                milli(float(np.linalg.norm(error[rows_of, pose])))
                for rows_of in (slice(0, 3), slice(3, 6))
                for error in (correction.before, correction.after)
            ]
            quantiles = [milli(float(array[0, pose])) for array in (self.within_before, self.within_after)]
            rows.append([labels[pose], *numbers, *quantiles, self.dominant_source[pose], correction.status[pose]])
        columns = ["pose", "|d| before [mm]", "after", "|δ| before [mrad]", "after", "95 % |d| before", "after"]
        run = self.provenance
        title = f"Compensation of {run.arm}, {len(labels):,} poses, {self.mode}"
        return rendered(title, [Table([*columns, "what remains", "status"], rows)], [*self.assumptions, *self.warnings])


_MOST_ROWS = 20  # rows of the notebook's table


@warns_at_end
@takes_datum
def compensate(
    model: ErrorModel,
    poses: PosesGiven,
    *,
    mode: Mode = "position",
    weights: ArrayLike | None = None,
    findings: Sequence[Finding] = (),
    progress: Progress | bool | None = None,
) -> CompensationResult:
    """Return joint values that place the mean-error arm at the nominal pose.

    The constant part of the error is that of the exact model with every component at its mean: deflection, offsets,
    calibrated errors. Newton's method on the arm with its errors removes it (:func:`correct`).

    Args:
        model: Chain, draws and sources.
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

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> result = pp.compensate(model, ["paper"])
        >>> print((1e3 * np.linalg.norm(result.correction.before[:3, 0])).round(2))
        36.77
        >>> print(np.degrees(result.corrected[:, 0]).round(2))
        [-90.23   2.32  87.74 -91.  ]
    """
    check_instance("model", model, ErrorModel, "as ErrorModel.load returns it")
    check_choice("mode", mode, ("position", "pose"))
    known_findings = check_items("findings", findings, Finding)
    check_progress(progress)
    is_exact = weights is None
    if not is_exact and mode != "pose":
        raise InputError('weights need mode="pose"; in mode "position" the three components of the position vanish')
    effective = np.repeat([1.0, float(mode == "pose")], 3) if is_exact else check_numbers("weights", weights, (6,))
    if (effective < 0).any() or not effective.any():
        raise InputError("weights must not be negative, and one must be positive")
    component_count, joints = np.count_nonzero(effective), len(model.chain.joints)
    if is_exact and joints < component_count:
        other = "correct the position, or give weights" if mode == "pose" else "give weights in mode pose"
        raise InputError(f"{mode} has {component_count} components, which {joints} joints cannot all correct; {other}")
    all_poses = pose_set(model, poses)
    is_known = all_poses.known
    if not is_known.any():
        raise InputError(f"none of the {len(all_poses):,} poses has joint values")
    values, approaches, lines = all_poses.q[:, is_known], all_poses.of(is_known).approaches, source_lines(model)
    with steps_to(progress, values.shape[1], "poses") as step:
        correction = correct(model, values, approaches, effective, is_exact, step)
    is_corrected = np.array(correction.status) == "corrected"
    moments_before = first_order(model, values, approaches, lines, None, lambda _: None)
    quantiles_after = np.full((2, len(is_corrected)), np.nan)
    shares = np.full((len(lines), len(is_corrected)), np.nan)
    if is_corrected.any():
        sides = None if approaches is None else approaches[:, is_corrected]
        moments_after = first_order(model, correction.q[:, is_corrected], sides, lines, None, lambda _: None)
        quantiles_after[:, is_corrected] = _quantiles(correction.after[:, is_corrected], moments_after.covariance)
        shares[:, is_corrected] = moments_after.shares

    def spread(array: NDArray[Any], fill: float = np.nan) -> NDArray[Any]:
        full = np.full((*array.shape[:-1], len(all_poses)), fill)
        full[..., is_known] = array
        return full

    status = np.array(all_poses.status, dtype="<U11")
    status[is_known] = correction.status
    worst = int(np.nanargmax(np.linalg.norm(spread(correction.before)[:3], axis=0)))
    pose_warnings = (
        *pose_findings(model.chain, values, list(itertools.compress(all_poses.labels, is_known))),
        *strained_findings(
            model, approached(all_poses.take(np.array([worst])))[0], all_poses.labels[worst], first_order=True
        ),
    )
    add(pose_warnings)
    return CompensationResult(
        provenance=Provenance.of(model, 0),
        joints=tuple(model.chain.joint_names),
        prismatic=tuple(model.chain.prismatic),
        poses=all_poses,
        mode=mode,
        weights=None if is_exact else effective,
        correction=Correction(
            **{name: spread(getattr(correction, name)) for name in ("q", "before", "first_order", "after")},
            iterations=spread(correction.iterations, 0),
            status=tuple(status.tolist()),
        ),
        within_before=spread(_quantiles(moments_before.mean, moments_before.covariance)),
        within_after=spread(quantiles_after),
        sources=tuple(line.name for line in lines),
        shares=spread(shares),
        findings=known_findings,
        warnings=list_warnings(known_findings, map(str, pose_warnings)),
    )


def _quantiles(mean: Array, covariance: Array) -> Array:
    parts = (slice(0, 3), slice(3, 6))
    return np.stack([norm_quantiles(*principal_axes(mean[part], covariance[part, part]), 0.95) for part in parts])


CorrectionStatus = Literal["corrected", "limit", "singular", "unreachable"]
"""``corrected``; ``limit``: none found near the pose within the joint limits; ``singular``: near a singularity some
directions cannot be corrected, or only on another branch; ``unreachable``: Newton's method finds no joint values.
"""

CONVERGED: Final = 1e-10
"""Error (m and rad) below which it counts as corrected."""
_SETTLED: Final = 1e-6
"""Relative change of the joints in a step below which they are settled: the excess over the minimum is its square."""
_MOST_ITERATIONS: Final = 20  # Newton steps where the correction is unique
_MOST_SETTLING: Final = 200
"""Steps of more free joints than corrected components."""
_LARGEST_STEP: Final = 0.3
"""Largest change of a joint in one step: rad, or lengths of the chain."""
_PARTS: Final = 4
"""Parts in which the error is taken off where Newton's method does not find the correction at once."""
_MOST_CHANGE: Final = 2.0
"""Largest change of the joints, in changes that the error asks for to first order (Newton-Kantorovich theorem)."""
_DIFFERENCE: Final = 1e-5
"""Half of the step of the central differences: rad, or lengths of the chain."""


@dataclass(frozen=True, eq=False)
class Correction(Fixed):
    """Corrected joint values of P poses.

    Attributes:
        q: Corrected joint values, ``(n, P)``; NaN where there are none.
        before, first_order, after: Error of the arm with every component at its mean: at the requested joint values,
            after one step with the nominal Jacobian, and at the corrected ones; ``[d; δ]``, base axes, m and rad, ``(6,
            P)``.
        iterations: Newton steps, ``(P,)``.
    """

    q: Array
    before: Array
    first_order: Array
    after: Array
    iterations: NDArray[np.int64]
    status: tuple[CorrectionStatus, ...]


def correct(
    error_model: ErrorModel,
    values: Array,
    approaches: NDArray[np.int8] | None,
    weights: Array,
    is_exact: bool,
    advance: Callable[[int], object],
) -> Correction:
    """Return the corrected joint values of poses ``(n, P)``.

    Newton's method on the arm with its errors: they are recomputed at each step, since loads and lever arms change
    with the joint values, and the Jacobian is that of the arm with its errors, by central differences. For a redundant
    arm the sum of squares of the joint changes is a local minimum, with a sliding joint in lengths of the chain: each
    step goes to the smallest change that the Jacobian allows. A joint that would pass its limit stays there while the
    others correct; it leaves the limit again where that makes the change smaller.

    A correction is continuous with its pose: no singularity lies between them, and the joints change, as a vector, by at
    most twice the first-order change for the error (equation C2 at the pose, joints at their limits held there).

    Args:
        values, approaches: Joint values in chain order, ``(n, P)``, rad and m, and the direction in which each joint
            moved last, also assumed at the corrected values.
        weights: Weight of each component of the error, ``(6,)``, 1/m and 1/rad; zero for one that is left as it is.
        is_exact: Whether the weighted components must vanish; else the sum of their squares is minimised.
        advance: Called with the number of poses done since the last call.

    Raises:
        InputError: An error is too large to compute with.
    """
    poses, target_poses = values.shape[1], error_model.chain.at_columns(values).pose
    arm = _Arm(error_model, target_poses, approaches, weights, is_exact, np.zeros((6, poses)))
    before = arm.error(values, np.arange(poses))
    step, smallest = arm.step(np.zeros(values.shape), before, arm.nominal_slopes(values))
    first_order = arm.error(values + step, np.arange(poses))
    corrected_values, after, iterations = values.copy(), before.copy(), np.zeros(poses, dtype=np.int64)
    status = np.full(poses, "unreachable", dtype="<U11")
    is_outside = error_model.chain.configurations.outside(values).any(axis=0)
    status[is_outside] = "limit"
    singular = ~is_outside & (smallest < SINGULAR_BELOW) & is_exact
    status[singular] = "singular"
    solvable = np.flatnonzero(~is_outside & ~singular)
    for begin in range(0, len(solvable), _AT_ONCE):
        part = solvable[begin : begin + _AT_ONCE]
        corrected_values[:, part], after[:, part], iterations[part], status[part] = arm.follow(values[:, part], part)
        advance(len(part))
    advance(poses - len(solvable))
    corrected_values[:, status != "corrected"] = after[:, status != "corrected"] = np.nan
    return Correction(corrected_values, before, first_order, after, iterations, tuple(status.tolist()))


_AT_ONCE: Final = 256  # poses corrected together


class _State(NamedTuple):
    """Poses under correction, changed in place: where the change is measured from, joint values, errors, and so on."""

    start: Array
    values: Array
    error: Array
    free: NDArray[np.bool_]
    iterations: NDArray[np.int64]
    poses: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class _Arm:
    """The arm with every component at its mean, and its target poses ``(4, 4, P)``; approaches are ``(n, P)``.

    ``rest``, ``(6, P)``, is the part of the errors that is left as it is.
    """

    error_model: ErrorModel
    wanted: Array
    approaches: NDArray[np.int8] | None
    weights: Array
    is_exact: bool
    rest: Array

    @property
    def units(self) -> Array:
        """Unit of each joint, ``(n, 1)``: rad, or the chain's length for a sliding joint."""
        chain = self.error_model.chain
        return np.where(chain.prismatic, chain_length(chain), 1.0)[:, None]

    @property
    def limits(self) -> tuple[Array, Array]:
        """Least and largest joint values, ``(n, 1)`` each."""
        low, high = self.error_model.chain.configurations.limits
        return low[:, None], high[:, None]

    @property
    def rows(self) -> NDArray[np.intp]:
        """Components of the error that count."""
        return np.flatnonzero(self.weights)

    @property
    def scale(self) -> Array:
        """Factors that make these components dimensionless, ``(r, 1)``: positions in lengths of the chain."""
        return np.where(self.rows < 3, 1 / chain_length(self.error_model.chain), 1.0)[:, None]

    def error(self, values: Array, poses: NDArray[np.intp]) -> Array:
        """Return the error ``(6, P)`` from the targets with numbers ``poses``, less the rest, at joint values ``(n, P)``."""
        approaches = None if self.approaches is None else self.approaches[:, poses]
        parts = tangents(self.error_model.at_columns(values, approaches))
        errors = np.concatenate([part.error for part in parts], axis=1)
        nominal = self.error_model.chain.at_columns(values).pose
        targets = self.wanted[:, :, poses]
        rotations = np.einsum("ijp,jkp,lkp->ilp", se3.exp_rotation(errors[3:]), nominal[:3, :3], targets[:3, :3])
        deviation = np.concatenate([nominal[:3, 3] + errors[:3] - targets[:3, 3], se3.log_rotation(rotations)])
        return deviation - self.rest[:, poses]

    def slopes(self, values: Array, poses: NDArray[np.intp]) -> Array:
        """Return the derivative of :meth:`error` by each joint, in its unit, ``(6, n, P)``, by central differences."""
        joints, count = values.shape
        shifts = _DIFFERENCE * np.eye(joints)[:, :, None] * self.units
        shifted = np.concatenate([values[:, None] + shifts, values[:, None] - shifts], axis=1).reshape(joints, -1)
        errors = self.error(shifted, np.tile(poses, 2 * joints)).reshape(6, 2, joints, count)
        return np.asarray((errors[:, 0] - errors[:, 1]) / (2 * _DIFFERENCE))

    def nominal_slopes(self, values: Array) -> Array:
        """Return the Jacobian of the nominal arm, as :meth:`slopes`."""
        return self.error_model.chain.at_columns(values).joint_jacobian * self.units

    def step(self, moved: Array, error: Array, slopes: Array) -> tuple[Array, Array]:
        """Return a change of the joints ``(n, P)`` and the smallest singular value of the scaled Jacobian ``(P,)``.

        ``moved`` is the joints' displacement so far; its component in the null space of the Jacobian is undone.
        """
        scale = self.scale if self.is_exact else self.weights[self.rows, None]
        jacobian = np.moveaxis(slopes[self.rows] * scale[:, None], -1, 0)
        left, sizes, right = np.linalg.svd(jacobian, full_matrices=False)
        threshold = 1e-9 if self.is_exact else SINGULAR_BELOW * sizes[:, :1]
        safe = sizes > threshold
        inverse = np.where(safe, 1 / np.where(safe, sizes, 1.0), 0.0)
        error_rows = np.einsum("pij,ip->pj", left, error[self.rows] * scale)
        offset = moved / self.units
        free_part = np.einsum("pji,ip->pj", right, offset)
        step = np.einsum("pji,pj->ip", right, np.where(safe, free_part, 0.0) - inverse * error_rows) - offset
        largest = np.abs(step).max(axis=0, initial=0.0)
        step *= np.minimum(1.0, _LARGEST_STEP / np.maximum(largest, _LARGEST_STEP))
        smallest = sizes[:, -1] if len(self.rows) <= len(moved) else np.zeros(moved.shape[1])
        return step * self.units, smallest

    def follow(self, start: Array, poses: NDArray[np.intp]) -> tuple[Array, Array, NDArray[np.int64], NDArray[np.str_]]:
        """Return corrected joint values ``(n, P)``, errors ``(6, P)``, numbers of steps and statuses ``(P,)``.

        Where Newton's method does not lead to the correction at once, the error is taken off in equal parts.
        """
        before, slopes, rest = self.error(start, poses), self.slopes(start, poses), np.zeros(self.rest.shape)
        values, after, iterations = start.copy(), before.copy(), np.zeros(len(poses), dtype=np.int64)
        status = np.full(len(poses), "unreachable", dtype="<U11")
        for parts in (1, _PARTS):
            of = np.flatnonzero(status != "corrected")
            at = start[:, of]
            for part in reversed(range(parts)):
                if not len(of):
                    break
                rest[:, poses[of]] = before[:, of] * (part / parts)
                state, reached = replace(self, rest=rest).solve(start[:, of], poses[of], at)
                iterations[of] += state.iterations
                is_free = state.free.all(axis=0)
                is_near = reached if part else reached & self._is_near(state, slopes[:, :, of], before[:, of])
                status[of] = np.where(is_free, np.where(reached, "singular", "unreachable"), "limit")
                of, at, error = of[is_near], state.values[:, is_near], state.error[:, is_near]
            if len(of):
                values[:, of], after[:, of], status[of] = at, error, "corrected"
        return values, after, iterations, status

    def _is_near(self, state: _State, slopes: Array, before: Array) -> NDArray[np.bool_]:
        """Return whether corrections are on the branch of the poses, and as near as the errors ``before`` ask for.

        The Jacobian, at the poses ``slopes`` = U Σ Vᵀ, must not become singular on the straight way to the corrections:
        as far as it is linear there, no eigenvalue of Uᵀ J V Σ⁻¹ is then negative.
        """
        scale = self.scale if self.is_exact else self.weights[self.rows, None]
        change = (state.values - state.start) / self.units
        locked_change = np.where(state.free, 0.0, change)
        first_slopes, last_slopes = (
            np.moveaxis(derivatives[self.rows] * scale[:, None] * state.free, -1, 0)
            for derivatives in (slopes, self.slopes(state.values, state.poses))
        )
        left_vectors, sizes, right_vectors = np.linalg.svd(first_slopes, full_matrices=False)
        safe = sizes > SINGULAR_BELOW * (1.0 if self.is_exact else sizes[:, :1])
        inverse = np.where(safe, 1 / np.where(safe, sizes, 1.0), 0.0)
        error = (before[self.rows] + np.einsum("rjp,jp->rp", slopes[self.rows], locked_change)) * scale
        step = inverse * np.einsum("pij,ip->pj", left_vectors, error)
        needed_norm = np.hypot(np.linalg.norm(step, axis=1), np.linalg.norm(locked_change, axis=0))
        ratio = left_vectors.swapaxes(1, 2) @ last_slopes @ right_vectors.swapaxes(1, 2) * inverse[:, None]
        ratio = np.where(safe[:, None] & safe[:, :, None], ratio, np.eye(safe.shape[1]))
        is_near = np.linalg.norm(change, axis=0) <= _MOST_CHANGE * needed_norm + CONVERGED
        is_near &= np.linalg.eigvals(ratio).real.min(axis=1) > 0
        return np.asarray(is_near & safe.all(axis=1) if self.is_exact else is_near)

    def solve(self, start: Array, poses: NDArray[np.intp], begin: Array) -> tuple[_State, NDArray[np.bool_]]:
        """Return corrections, found from ``begin``, and whether each was; the change is measured from ``start``."""
        low, high = self.limits
        values, free = begin.copy(), np.ones(begin.shape, dtype=bool)
        iterations = np.zeros(values.shape[1], dtype=np.int64)
        error = self.error(values, poses)
        state = _State(start, values, error, free, iterations, poses)
        remaining = np.arange(values.shape[1])
        is_reached = np.zeros(values.shape[1], dtype=bool)
        for _ in range(4 * len(values)):
            is_reached[remaining] = self._iterate(state, remaining)
            remaining = remaining[is_reached[remaining]]
            excess = np.where(free, np.maximum(low - values, values - high) / self.units, 0.0)[:, remaining]
            is_outside = excess.max(axis=0, initial=0.0) > 0
            # one joint at a time, because that may bring the others back
            free[excess.argmax(axis=0)[is_outside], remaining[is_outside]] = False
            inside_poses = remaining[~is_outside]
            leaving, joint = self._select_leaving(state, inside_poses)
            free[joint[leaving], inside_poses[leaving]] = True
            remaining = np.concatenate([remaining[is_outside], inside_poses[leaving]])
            if self.is_exact:
                hopeless = free[:, remaining].sum(axis=0) < len(self.rows)
                is_reached[remaining[hopeless]], remaining = False, remaining[~hopeless]
            if not len(remaining):
                break
            values[:, remaining] = np.clip(values, low, high)[:, remaining]
            error[:, remaining] = self.error(values[:, remaining], poses[remaining])
        is_reached[remaining] = False
        return state, is_reached

    def _select_leaving(self, state: _State, of: NDArray[np.intp]) -> tuple[NDArray[np.bool_], NDArray[np.intp]]:
        """Return which of the poses ``of`` have a joint at its limit that should leave it, and which joint."""
        start, values, error, free, _, poses = state
        is_locked = ~free[:, of]
        if not is_locked.any():
            return np.zeros(len(of), dtype=bool), np.zeros(len(of), dtype=np.intp)
        slopes = np.moveaxis(self.slopes(values[:, of], poses[of])[self.rows], -1, 0)
        if self.is_exact:
            # the change is minimal where it is a combination of the rows, except for joints that press against their
            # limits
            change = ((values - start) / self.units)[:, of]
            pseudoinverse = np.linalg.pinv(np.where(is_locked.T[:, None], 0.0, slopes))
            rows = np.einsum("pjr,jp->pr", pseudoinverse, np.where(is_locked, 0.0, change))
            rises = change - np.einsum("prj,pr->jp", slopes, rows)
            threshold = _SETTLED * np.abs(change).max(axis=0, initial=0.0)
        else:
            weighted = error[self.rows][:, of] * self.weights[self.rows, None] ** 2
            rises = np.einsum("prj,rp->jp", slopes, weighted)
            threshold = _SETTLED * np.einsum("prj,rp->jp", np.abs(slopes), np.abs(weighted)).max(axis=0, initial=0.0)
        inward = np.where(is_locked, np.where(values[:, of] <= self.limits[0], -rises, rises), 0.0)
        return np.asarray(inward.max(axis=0, initial=0.0) > threshold), inward.argmax(axis=0)

    def _iterate(self, state: _State, selected: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Iterate the free joints of the ``selected`` poses in place; return whether each converged."""
        start, values, error, free, iterations, poses = state
        is_redundant = self.is_exact and len(self.rows) < len(values)
        is_done = self._is_done(error, None)
        if is_redundant:
            is_done &= (values == start).all(axis=0)
        has_choice = self.is_exact & (free[:, selected].sum(axis=0) > len(self.rows))
        most_iterations = np.where(has_choice, _MOST_SETTLING, _MOST_ITERATIONS)
        for iteration in range(most_iterations.max(initial=0)):
            active = selected[~is_done[selected] & (iteration < most_iterations)]
            if not len(active):
                break
            slopes = self.slopes(values[:, active], poses[active]) * free[:, active]
            change = np.where(free[:, active], values[:, active] - start[:, active], 0.0)
            step, _ = self.step(change, error[:, active], slopes)
            values[:, active] += step * free[:, active]  # exactly at its limit, whatever the rounding
            error[:, active] = self.error(values[:, active], poses[active])
            iterations[active] += 1
            is_done[active] = self._is_done(error[:, active], step)
            if is_redundant:
                size = np.abs((values - start)[:, active] / self.units).max(axis=0)
                is_done[active] &= np.abs(step / self.units).max(axis=0) <= _SETTLED * size
        return is_done[selected]

    def _is_done(self, error: Array, step: Array | None) -> NDArray[np.bool_]:
        if self.is_exact:
            return np.asarray(np.abs(error[self.rows]).max(axis=0, initial=0.0) < CONVERGED)
        if step is None:
            return np.zeros(error.shape[1], dtype=bool)
        return np.asarray(np.abs(step).max(axis=0, initial=0.0) < CONVERGED)
