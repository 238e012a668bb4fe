"""Poses at which a robot finds a datum: those of many candidates that leave the least error at the tasks.

To first order the error at a task is ``e = e_B + Σ G_i e_i + Σ H_i n_i``, with G and H of the poses chosen. With A the
derivatives by the robot's unit draws, V the covariances of its draws at a visit and N that of the noise, the position has
the covariance of ``A_B + Σ G_i A_i``, plus ``V_B + Σ G_i V_i G_iᵀ + Σ H_i N H_iᵀ``. Its trace, the mean over the tasks, is
minimised by exchanging one pose after another (Meyer and Nachtsheim 1995).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.calibration import design
from precision_pin.analyses.calibration.plan import usable_candidates
from precision_pin.analyses.provenance import Provenance
from precision_pin.analyses.result import Outcome
from precision_pin.base.arguments import check_instance, check_items
from precision_pin.base.arrays import Array, Keys
from precision_pin.base.errors import Finding, InputError
from precision_pin.base.interrupts import raise_if_interrupted
from precision_pin.base.progress import stepped, steps_to
from precision_pin.draws.space import check_seed
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.robot.datums import Datum
from precision_pin.robot.joint_columns import sheet_values
from precision_pin.sheet.measurement import Measurement

_STARTS: Final = 8
"""Random choices from which poses are exchanged."""
_RANDOM: Final = 25
"""Random choices for comparison."""
DATUM_PLAN_STEPS: Final = _STARTS + 1
"""Steps of a plan: a search from each start, and the comparison."""
_LEAST: Final = 3
"""Fewest poses of a procedure."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class DatumPlan(Outcome):
    """Poses at which to find a datum.

    Attributes:
        datum: The datum with the poses chosen.
        chosen, texts, q: Candidates chosen, in their order, from 0; as in a sheet; their joint values ``(n, count)``.
        candidates, left_out: Number of candidates, and of those left out by reason.
        tasks: Names of the tasks.
        rms_position: Root mean square deviation of the position over the tasks, m: with the poses ``chosen``, with
            ``all`` candidates, and with as many ``random`` ones, the median of 25.
    """

    schema: ClassVar[str] = "precision-pin/datum-plan/1"
    KEYS: ClassVar[Keys] = (
        *("*head", "name=datum.name", "kind=datum.kind", "candidates", "left_out", "chosen", "poses=texts"),
        *("tasks", "rms_position", "findings"),
    )

    datum: Datum
    chosen: tuple[int, ...]
    texts: tuple[str | list[str], ...]
    q: Array
    candidates: int
    left_out: Mapping[str, int]
    tasks: tuple[str, ...]
    rms_position: Mapping[str, float]

    def __repr__(self) -> str:
        rms = f"{1e3 * self.rms_position['chosen']:.3g} mm rms at the tasks"
        return f"<DatumPlan of {self.datum.name}: {len(self.chosen)} of {self.candidates} poses, {rms}>"


@dataclass(frozen=True, eq=False)
class _Candidates:
    """Candidates of a procedure, then its other visits, which stay.

    Attributes:
        datum, count: The procedure with all candidates, and their number.
        places, shared, own: ``(V, 4, 4)``, A ``(V, 6, r)`` and V ``(V, 6, 6)``.
        tasks: Pose, joint values, A and V of each task.
    """

    datum: Any
    count: int
    places: Array
    shared: Array
    own: Array
    tasks: tuple[tuple[Array, Array, Array, Array], ...]

    @classmethod
    def of(cls, model: ErrorModel, datum: Datum, count: int, tasks: Sequence[PoseModel]) -> _Candidates:
        """Return the candidates that are the poses of a datum."""
        full, unit = model.against(datum), design.UnitNumbers.of(model.space)
        visits = full.procedures.visits
        columns = [full.space.index[name] for name in unit.names]
        shared = np.array([visit.at.jacobian[:, columns] @ unit.root for visit in visits])
        covariances = np.array([visit.at.covariance for visit in visits]) - shared @ shared.swapaxes(1, 2)
        slopes = [at.jacobian[:, unit.columns] @ unit.root for at in tasks]
        parts = zip(tasks, slopes, strict=True)
        entries = tuple((at.posture.pose, at.posture.q, a, at.covariance - a @ a.T) for at, a in parts)
        return cls(full.datums[0], count, np.array([visit.place for visit in visits]), shared, covariances, entries)

    def loss(self, choice: NDArray[np.intp]) -> float:
        """Return the mean of the position's variance at the tasks, m², for some candidates; inf if they determine nothing."""
        rows = np.concatenate([choice, np.arange(self.count, len(self.places))])
        datum = replace(self.datum, poses=tuple(self.datum.poses[k] for k in choice))
        try:
            maps = datum.maps(self.places[rows])
        except InputError:
            return np.inf
        noise, total = np.square([std for _, std in datum.noise]), 0.0
        for pose, q, by_unit, covariance in self.tasks:
            gains, noise_gains = (part[:, :3] for part in maps(pose, datum.view_of(q)))
            slopes = by_unit[:3] + np.einsum("vij,vjk->ik", gains, self.shared[rows])
            total += float((slopes**2).sum() + np.trace(covariance[:3, :3]) + (noise_gains**2 * noise[:, None]).sum())
            total += float(np.einsum("vij,vjk,vik->", gains, self.own[rows], gains, optimize=True))
        return total / len(self.tasks)

    def exchange(self, choice: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return a choice that no exchange of one pose for another improves."""
        best, before = self.loss(choice), np.nan
        while best != before:
            before = best
            for place in range(len(choice)):
                raise_if_interrupted()
                for other in np.setdiff1d(np.arange(self.count), choice):
                    trial = np.where(np.arange(len(choice)) == place, other, choice)
                    if (loss := self.loss(trial)) < best * (1 - 1e-12):
                        choice, best = trial, loss
        return choice


@design.on_one_thread
def plan_datum(
    model: ErrorModel,
    datum: Datum,
    count: int,
    candidates: object = None,
    *,
    at: object = None,
    measurement: Measurement | None = None,
    seed: int = 0,
    findings: Sequence[Finding] = (),
    progress: Callable[[int], None] | bool | None = None,
) -> DatumPlan:
    """Choose the poses at which a robot finds a datum, of those that leave the least error at the tasks.

    Args:
        model: The model; its own datums are left out.
        datum: One whose procedure has a number of poses: ``best_fit``, ``tool_pivot``, ``hand_eye``, ``eye_to_hand``.
        count: Number of poses to choose, three or more.
        candidates: Poses, as for :func:`plan_calibration` (default: those of the datum).
        at: The tasks (default: the model's named poses).
        measurement: Instrument of a best fit, which must see the target.
        seed: 64-bit seed of the starting choices.
        findings: Findings to pass on, such as those of the sheet.
        progress: Function called with the number of steps done since its last call, of :data:`DATUM_PLAN_STEPS`;
            ``True`` shows a bar.

    Raises:
        InputError: Another procedure, fewer candidates than poses to choose, no task, or candidates that do not
            determine the datum.
    """
    check_instance("model", model, ErrorModel, "as ErrorModel.load returns it")
    check_instance("datum", datum, Datum, "as Datum.best_fit returns it")  # type: ignore[type-abstract]
    findings = check_items("findings", findings, Finding)
    check_seed(seed)
    if not hasattr(datum, "poses"):
        raise InputError(
            f"datum {datum.name}: a {datum.kind} has no number of poses to choose; "
            "plan a best_fit, tool_pivot, hand_eye or eye_to_hand"
        )
    bare, given = model.bare, list(datum.poses) if candidates is None else candidates
    seen_by = measurement if datum.kind == "best_fit" else None
    usable, left_out, notes = usable_candidates(bare, given, seen_by, _LEAST, count)
    total = len(usable)
    tasks = design.task_poses(bare, at, usable.q)
    every_pose = replace(datum, poses=tuple(usable.q.T))  # type: ignore[call-arg]
    pool = _Candidates.of(bare, every_pose, total, [task for _, task in tasks])
    generator = np.random.default_rng(seed)
    with steps_to(progress, DATUM_PLAN_STEPS, "steps") as step:
        starts = (generator.permutation(total)[:count] for _ in range(_STARTS))
        chosen = np.sort(min([pool.exchange(start) for start in stepped(starts, step)], key=pool.loss))
        random = [pool.loss(generator.permutation(total)[:count]) for _ in range(_RANDOM)]
        losses = {"chosen": pool.loss(chosen), "all": pool.loss(np.arange(total)), "random": float(np.median(random))}
        step(1)
    if not np.isfinite(losses["chosen"]):
        raise InputError(f"datum {datum.name}: no {count} of the {total} candidates tried determine it; choose more")
    chain, q, names = bare.chain, usable.q[:, chosen], [usable.names[k] for k in chosen]
    values = (sheet_values(chain.joint_names, chain.prismatic, row.tolist()) for row in q.T)
    return DatumPlan(
        provenance=Provenance.of(bare, seed),
        datum=replace(datum, poses=tuple(q.T)),  # type: ignore[call-arg]
        chosen=tuple(map(int, chosen)),
        texts=tuple(name or value for name, value in zip(names, values, strict=True)),
        q=q,
        candidates=total,
        left_out=left_out,
        tasks=tuple(name for name, _ in tasks),
        rms_position={which: float(np.sqrt(loss)) for which, loss in losses.items()},
        findings=(*findings, *notes),
    )
