"""What a cause of the error, or other joint values, would change at readings left out of a fit: one linear step.

A fit with the root of leverage Q leaves ``R y`` of whitened readings, with ``R = 1 - Q Qᵀ``. With columns c of a further cause,
its amplitudes with a prior variance of one, it leaves ``R y - R c (1 + cᵀ R c)⁻¹ cᵀ R y``. What that leaves of groups left out
follows in closed form, as without the cause. The variance is that of largest likelihood, which the groups left out have a
part in. Joint values as read change the readings that the fit predicts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from precision_pin.analyses.calibration.causes import Cause, Evidence, labelled
from precision_pin.analyses.calibration.data import READ, CalibrationData
from precision_pin.analyses.calibration.fit import LeftOut, Through, leave_out
from precision_pin.analyses.calibration.noise import LEVEL
from precision_pin.base import se3
from precision_pin.base.arrays import Array, Keys, Record
from precision_pin.base.errors import Finding, some

JOINTS_READ: Final = "joint values as read"
"""Kind of the gain that is not one of a cause."""
MIN_GROUPS: Final = 4
"""Minimum number of groups for a statement on the improvement."""


@dataclass(frozen=True)
class CauseGain(Record):
    """Root mean square length (m) of left-out readings as fitted, and with the likeliest cause of a kind added to the fit.

    Attributes:
        kind, joint, is_shared: As of :class:`~precision_pin.analyses.calibration.causes.Cause`; or joint values as read
            instead of those given.
        before, after: Without it and with it.
        interval: Of ``before - after``, 95 %, at a pose drawn as those measured were; ``None`` of too few groups.
    """

    KEYS: ClassVar[Keys] = ("kind", "joint", "is_shared", "before", "after", "gain", "interval")

    kind: str
    joint: str
    is_shared: bool
    before: float
    after: float
    interval: tuple[float, float] | None

    @property
    def gain(self) -> float:
        """Reduction of the left-out error, m."""
        return self.before - self.after

    @property
    def is_decided(self) -> bool:
        """Whether the interval is above zero, or below."""
        return self.interval is not None and self.interval[0] * self.interval[1] > 0

    @property
    def label(self) -> str:
        """The cause in words."""
        return labelled(self.kind, self.joint, is_shared=self.is_shared)


def find_gains(evidence: Evidence, data: CalibrationData, groups: NDArray[np.intp], before: LeftOut) -> list[CauseGain]:
    """Return the gain by the likeliest cause of each kind and by joint values as read, largest first.

    ``groups`` tell which readings are left out together, ``(P,)``; ``before`` are these as fitted.
    """
    problem, fit, reduction = evidence.problem, evidence.fit, evidence.reduction
    point, local, gains = (fit.z, fit.nuisances), fit.local(reduction, problem.by_z(reduction)), []
    root, over = local.leverage_root(), fit.over(problem, local)
    through_fit = problem.through(point, reduction, over)

    def add(owner: tuple[str, str, bool], through: Through, residuals: Array) -> None:
        after = leave_out(problem, [through], residuals, groups)
        if (outcome := _compared(before, after, groups, problem.sizes)) is not None:
            gains.append(CauseGain(*owner, *outcome))

    for candidate in evidence.best_of_kinds.values():
        columns = candidate.std * evidence.columns[:, candidate.columns]
        left = columns - root @ (root.T @ columns)
        inverse = np.linalg.inv(np.linalg.cholesky(np.eye(columns.shape[1]) + columns.T @ left)).T
        extra = evidence.coefficients(candidate, candidate.std * inverse, -over @ (root.T @ columns @ inverse))
        chosen, causes = evidence.chosen(candidate)
        followed = problem.combined(*point, extra @ ((left @ inverse).T @ reduction.white), causes)
        through = problem.through(point, chosen, over, extra, causes=causes)
        add(evidence.owner(candidate), through, fit.residuals - followed)
    if data.q_read.size:
        shift = _shift_of_read(evidence, data)
        followed = problem.combined(*point, over @ through_fit.times(shift)[-over.shape[1] :])
        add((JOINTS_READ, "", True), through_fit, fit.residuals - shift + followed)
    return sorted(gains, key=lambda entry: entry.after)


def _shift_of_read(evidence: Evidence, data: CalibrationData) -> Array:
    """Return how predictions change ``(P, m)`` if joint values are those read."""
    problem, chain = evidence.problem, evidence.problem.model.chain
    given, read = (chain.at_columns(q).pose for q in (data.q, data.q_read))
    turn = np.einsum("ijp,kjp->pik", read[:3, :3], given[:3, :3])
    error = np.hstack([(read - given)[:3, 3].T, se3.log_rotation(np.moveaxis(turn, 0, -1)).T])
    return np.asarray(np.einsum("pmi,pi->pm", problem.evaluation.by_error(evidence.fit.nuisances), error))


def _compared(
    before: LeftOut, after: LeftOut, groups: NDArray[np.intp], sizes: NDArray[np.intp]
) -> tuple[float, float, tuple[float, float] | None] | None:
    """Return the root mean squares of readings that both predict, and the interval of their difference."""
    common = np.flatnonzero(before.is_predicted & after.is_predicted)
    if not common.size:
        return None
    _, group = np.unique(groups[common], return_inverse=True)
    counts = np.bincount(group)
    squares = [np.bincount(group, (fit.values[common, :3] ** 2).sum(axis=1)) / counts for fit in (before, after)]
    weights = counts / common.size
    b, a = (float(np.sqrt(weights @ of_groups)) for of_groups in squares)
    if len(counts) < MIN_GROUPS or not min(a, b) > 0:
        return b, a, None
    trials = min(before.trials, len(counts)), min(after.trials, len(counts))
    lengths = float(np.minimum(sizes[common], 3).mean())
    return b, a, gain_interval(squares[0], squares[1], weights, trials, lengths)[0]


def cause_warnings(causes: Sequence[Cause], gains: Sequence[CauseGain], without_weight: str) -> Iterator[Finding]:
    """Yield a warning that names the likeliest causes, and one where joint values as read explain more.

    ``without_weight`` says which readings without weight the likeliest explains.
    """
    of_kinds = {entry.kind: entry for entry in gains}
    if causes:
        alternatives = f"; as well explained by: {some([*map(str, causes[1:])], 3, '; ')}" * bool(causes[1:])
        added = of_kinds.get(causes[0].kind)
        gain = (
            f"; fitted too: left-out error {1e3 * added.before:.3g} -> {1e3 * added.after:.3g} mm rms" if added else ""
        )
        message = (
            f"readings show an error that the sheet lacks, most likely {causes[0]}, by which readings left out are "
            f"{1e3 * causes[0].left_out:.3g} mm rms off{gain}{without_weight}{alternatives}; add its source, or measure where "
            "these differ"
        )
        yield Finding("warning", "W_CAUSE", message)
    read = of_kinds.get(JOINTS_READ)
    if read is not None and read.is_decided and read.gain > 0:
        message = (
            f"joint values as read explain more than those given: left-out error {1e3 * read.before:.3g} -> "
            f"{1e3 * read.after:.3g} mm rms; fit with them: --columns 'JOINT=ignore, JOINT{READ}=JOINT' for each joint"
        )
        yield Finding("warning", "W_JOINTS_READ", message)


def gain_interval(
    before: Array, after: Array, weights: Array, trials: tuple[float, float], lengths: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the intervals of ``b - a`` and of b, with ``b² = weights @ before`` and ``a² = weights @ after`` over G groups.

    ``before`` and ``after`` ``(G,)`` are mean squares of each group, worth ``trials`` independent groups of ``lengths`` numbers
    each. The gain is within both of two intervals. One is Student's t of what each group adds to it, first order, with
    the degrees of freedom of the fit: where little is gained both fits follow the same noise. The other combines the intervals
    of b, by t of its logarithm, and of a, by F, as of independent numbers (Zou and Donner 2008), so that it ends below the
    upper end of b. Groups left out in turn share the rest, so variances are 1.3 times as large, where little is gained up to
    4 times, and that of b twice (measured by coverage).
    """
    count, roots = len(weights), [float(np.sqrt(weights @ group_squares)) for group_squares in (before, after)]
    b, a = roots
    effects = [weights * (mean - root**2) / (2 * root) for mean, root in zip((before, after), roots, strict=True)]

    def half_width(terms: Array, known: float, widened: float) -> float:
        dof = max(known - 1, 1.0)
        return float(stats.t.isf((1 - LEVEL) / 2, dof) * np.sqrt(widened * count / dof * (terms @ terms)))

    paired = half_width(effects[0] - effects[1], trials[1], 1.3 + 2.7 * min(a / b, b / a) ** 8)
    factor = float(np.exp(half_width(effects[0], trials[0], 2.0) / b))
    dof = lengths * trials[1]
    ratio = float(np.sqrt(stats.f.isf((1 - LEVEL) / 2, dof, dof)))
    low, high = np.hypot(b - b / factor, a * ratio - a), np.hypot(b * factor - b, a - a / ratio)
    return (b - a - min(paired, float(low)), b - a + min(paired, float(high))), (b / factor, b * factor)
