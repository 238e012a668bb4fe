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
from precision_pin.analyses.calibration.plan import left_out_warnings, usable_candidates
from precision_pin.analyses.provenance import Provenance
from precision_pin.analyses.result import Outcome
from precision_pin.base.arguments import check_instance, check_items, check_whole
from precision_pin.base.arrays import Array, Keys
from precision_pin.base.errors import Finding, InputError
from precision_pin.base.interrupts import raise_if_interrupted
from precision_pin.base.progress import steps_to
from precision_pin.draws.draw import Scope
from precision_pin.draws.space import check_seed
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.datums import Datum
from precision_pin.robot.joint_columns import sheet_values
from precision_pin.sheet.measurement import Measurement

_STARTS: Final = 8
"""Random choices from which poses are exchanged."""
_SWEEPS: Final = 20
"""Sweeps over the chosen poses of one search at most."""
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
        chosen, names, q: Candidates chosen, in their order, from 0; their names, and joint values ``(n, count)``.
        candidates, left_out: Number of candidates, and of those left out by reason.
        tasks: Names of the tasks.
        rms_position: Root mean square deviation of the position over the tasks, m: with the poses ``chosen``, with
            ``all`` candidates, and with as many ``random`` ones, the median of 25.
    """

    schema: ClassVar[str] = "precision-pin/datum-plan/1"
    KEYS: ClassVar[Keys] = (
        *("*head", "name=datum.name", "kind=datum.kind", "candidates", "left_out", "count"),
        *("chosen=choices", "tasks", "rms_position", "findings"),
    )

    datum: Datum
    chosen: tuple[int, ...]
    names: tuple[str, ...]
    q: Array
    candidates: int
    left_out: Mapping[str, int]
    tasks: tuple[str, ...]
    joints: tuple[str, ...]
    slides: tuple[bool, ...]
    rms_position: Mapping[str, float]

    @property
    def count(self) -> int:
        """Number of poses chosen."""
        return len(self.chosen)

    @property
    def choices(self) -> list[dict[str, Any]]:
        """Number, name and joint values of each pose, as in the JSON."""
        return [
            {"candidate": k, "name": name, "q": dict(zip(self.joints, q.tolist(), strict=True))}
            for k, name, q in zip(self.chosen, self.names, self.q.T, strict=True)
        ]

    @property
    def texts(self) -> list[str | list[str]]:
        """The poses as in a sheet: names, or joint values."""
        values = (sheet_values(self.joints, self.slides, q.tolist()) for q in self.q.T)
        return [name or value for name, value in zip(self.names, values, strict=True)]

    def __repr__(self) -> str:
        return (
            f"<DatumPlan of {self.datum.name}: {self.count} of {self.candidates} poses, "
            f"{1e3 * self.rms_position['chosen']:.3g} mm rms at the tasks>"
        )


@dataclass(frozen=True, eq=False)
class _Candidates:
    """Candidates of a procedure, then its other visits, which stay.

    Attributes:
        places: ``(V, 4, 4)``.
        shared, own: A ``(V, 6, r)`` and V ``(V, 6, 6)``.
        tasks: Pose, joint values, A and V of each task.
    """

    datum: Datum
    places: Array
    shared: Array
    own: Array
    tasks: tuple[tuple[Array, Array, Array, Array], ...]

    @classmethod
    def of(cls, model: ErrorModel, datum: Datum, tasks: Sequence[Any]) -> _Candidates:
        """Return the candidates that are the poses of a datum."""
        full = model.against(datum)
        visits, space = full.procedures.visits, full.space
        is_unit = [draw.scope is Scope.UNIT for draw in model.space.draws]
        names = [
            name for draw, unit in zip(model.space.draws, is_unit, strict=True) if unit for name in draw.components
        ]
        columns = np.array([space.index[name] for name in names], dtype=np.intp)
        others = np.setdiff1d(np.arange(space.size), columns)
        values, vectors = np.linalg.eigh(space.block_covariance.within(columns))
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        jacobians = [visit.at.jacobian for visit in visits]
        own = []
        for jacobian in jacobians:
            used = others[jacobian[:, others].any(axis=0)]
            own.append(jacobian[:, used] @ space.block_covariance.within(used) @ jacobian[:, used].T)
        columns_of_model = np.array([model.space.index[name] for name in names], dtype=np.intp)
        return cls(
            full.datums[0],
            np.array([visit.place for visit in visits]),
            np.array([jacobian[:, columns] @ root for jacobian in jacobians]),
            np.array(own),
            tuple(
                (
                    at.posture.pose,
                    at.posture.q,
                    at.jacobian[:, columns_of_model] @ root,
                    design.repeat_covariance(at),
                )
                for at in tasks
            ),
        )

    def loss(self, choice: NDArray[np.intp]) -> float:
        """Return the mean of the position's variance at the tasks, m², for some candidates; inf if they determine nothing."""
        count = len(self.datum.poses)  # type: ignore[attr-defined]
        rows = np.concatenate([choice, np.arange(count, len(self.places))])
        datum = replace(self.datum, poses=tuple(self.datum.poses[k] for k in choice))  # type: ignore[attr-defined, call-arg]
        try:
            maps = datum.maps(self.places[rows])
        except InputError:
            return np.inf
        noise, total = np.square([std for _, std in datum.noise]), 0.0
        for pose, q, by_unit, own in self.tasks:
            gains, noise_gains = maps(pose, datum.view_of(q))
            gains, noise_gains = gains[:, :3], noise_gains[:, :3]
            slopes = by_unit[:3] + np.einsum("vij,vjk->ik", gains, self.shared[rows])
            total += float((slopes**2).sum() + np.trace(own[:3, :3]) + (noise_gains**2 * noise[:, None]).sum())
            total += float(np.einsum("vij,vjk,vik->", gains, self.own[rows], gains, optimize=True))
        return total / len(self.tasks)

    def exchange(self, choice: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return a choice that no exchange of one pose for another improves."""
        total = len(self.datum.poses)  # type: ignore[attr-defined]
        best = self.loss(choice)
        for _ in range(_SWEEPS):
            before = best
            for place in range(len(choice)):
                raise_if_interrupted()
                for other in np.setdiff1d(np.arange(total), choice).tolist():
                    trial = choice.copy()
                    trial[place] = other
                    if (loss := self.loss(trial)) < best * (1 - 1e-12):
                        choice, best = trial, loss
            if not best < before:
                break
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
    bare = model.bare
    given = list(datum.poses) if candidates is None else candidates
    sees = measurement if datum.kind == "best_fit" else None
    usable, left_out, obstructed = usable_candidates(bare, given, sees)
    total = len(usable)
    count = check_whole(
        "the number of poses to choose", count, _LEAST, total, f"from {_LEAST} to {total}, the number of candidates"
    )
    tasks = design.task_poses(bare, at, usable.q)
    all_of_them = replace(datum, poses=tuple(usable.q.T))  # type: ignore[call-arg]
    pool = _Candidates.of(bare, all_of_them, [task for _, task in tasks])
    generator = np.random.default_rng(seed)
    with steps_to(progress, DATUM_PLAN_STEPS, "steps") as step:
        choices = []
        for _ in range(_STARTS):
            choices.append(pool.exchange(generator.permutation(total)[:count]))
            step(1)
        chosen = np.sort(min(choices, key=pool.loss))
        random = [pool.loss(generator.permutation(total)[:count]) for _ in range(_RANDOM)]
        losses = {"chosen": pool.loss(chosen), "all": pool.loss(np.arange(total)), "random": float(np.median(random))}
        step(1)
    if not np.isfinite(losses["chosen"]):
        raise InputError(f"datum {datum.name}: no {count} of the {total} candidates tried determine it; choose more")
    names = tuple(usable.names[k] for k in chosen)
    q = usable.q[:, chosen]
    return DatumPlan(
        provenance=Provenance.of(bare, seed),
        datum=replace(datum, poses=tuple(name or values for name, values in zip(names, q.T, strict=True))),  # type: ignore[call-arg]
        chosen=tuple(map(int, chosen)),
        names=names,
        q=q,
        candidates=total,
        left_out=dict(left_out),
        tasks=tuple(name for name, _ in tasks),
        joints=tuple(bare.chain.joint_names),
        slides=tuple(bare.chain.prismatic),
        rms_position={which: float(np.sqrt(loss)) for which, loss in losses.items()},
        findings=(
            *findings,
            *(bare.chain.collision_notes if left_out else ()),
            *left_out_warnings(obstructed, left_out["hidden"]),
        ),
    )
