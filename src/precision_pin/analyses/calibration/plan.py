"""Which poses to measure: the best of many candidates, and how good they are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Literal, final

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from precision_pin.analyses.calibration.contact import doubt_contact, seen_poses
from precision_pin.analyses.calibration.design import (
    Estimator,
    Station,
    UnitNumbers,
    flat,
    measured_model,
    measurement_of,
    read_poses,
    stack_at_means,
    task_poses,
)
from precision_pin.analyses.calibration.identifiability import (
    Identifiability,
    determined_by,
    of_stack,
    refuse_where_nothing_is_seen,
    remarks_on,
)
from precision_pin.analyses.calibration.pose_choice import Design, branches, relaxed
from precision_pin.analyses.calibration.posterior import PosesOutcome, errors_left
from precision_pin.analyses.provenance import Provenance
from precision_pin.base.arguments import check_choice, check_items, check_whole
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError
from precision_pin.base.progress import steps_to
from precision_pin.base.record import Keys
from precision_pin.draws.space import check_seed
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.pose_set import PoseSet
from precision_pin.sheet.measurement import Measurement

_STARTS: Final = 3
PLAN_STEPS: Final = _STARTS + 3
"""Steps of a plan: an exchange from each start, the relaxed design, the perturbed choices, and branches of the bound."""
_PERTURBED: Final = 200
"""Searches from the best choice with some poses replaced at random."""
_REPLACED: Final = 0.3
"""Largest share of poses that are replaced."""
_CERTAIN: Final = 0.999
"""Efficiency at which no better choice is sought."""
_RANDOM: Final = 25
"""Random choices with which the choice is compared."""

Criterion = Literal["task", "D"]


@final
@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class CalibrationPlan(PosesOutcome):
    """The poses to measure, beside what :class:`PosesOutcome` has.

    Attributes:
        criterion, candidates: ``"task"`` or ``"D"``, and how many candidates there were that the instrument sees.
        chosen, names, q: Candidates to measure, in their order, from 0; their names, and joint values ``(n, count)``.
        left_out: How many candidates, or draws of random ones, are left out: ``collision``, ``kept out``, ``hidden``
            from the instrument.
        value, bound: The measure of the choice, and a bound that no choice of as many candidates can pass: ln det of
            the information on z (largest is best), or the mean square position error without the floor, m² (smallest is
            best).
        efficiency, random_efficiency: Of the choice, at least: for D ``exp((value - bound) / L)`` with L the
            combinations that all candidates together determine, for a task bound / value. The same of a random choice,
            the median of 25.
    """

    schema: ClassVar[str] = "precision-pin/calibration-plan/1"
    KEYS: ClassVar[Keys] = (
        *("*head", "measurement", "criterion", "candidates", "left_out", "count", "value", "bound", "efficiency"),
        *("random_efficiency", "chosen=choices", "rms_position", "identifiability", "observability"),
        *("poses", "findings"),
    )

    criterion: Criterion
    chosen: tuple[int, ...]
    names: tuple[str, ...]
    q: Array
    candidates: int
    left_out: Mapping[str, int]
    value: float
    bound: float
    efficiency: float
    random_efficiency: float

    @property
    def sliding_joints(self) -> tuple[str, ...]:
        """Sliding joints, whose values are in m."""
        return self.poses[0].sliding_joints

    @property
    def count(self) -> int:
        """How many candidates are measured."""
        return len(self.chosen)

    @property
    def choices(self) -> list[dict[str, Any]]:
        """Number, name and joint values of each candidate to measure, as in the JSON."""
        return [
            {"candidate": k, "name": name, "q": dict(zip(self.poses[0].q, values, strict=True))}
            for k, name, values in zip(self.chosen, self.names, self.q.T, strict=True)
        ]

    def rms(self, which: str) -> float:
        """Return the root mean square error of the position over the user's poses: ``before``, ``after``, ``floor``."""
        return self.rms_position[which]

    def __repr__(self) -> str:
        return (
            f"<CalibrationPlan of {self.provenance.robot}: {self.count} of {self.candidates} poses, {self.criterion} "
            f"efficiency at least {self.efficiency:.4g}>"
        )


def plan_calibration(
    model: ErrorModel,
    candidates: object,
    count: int,
    measurement: Measurement | None = None,
    *,
    at: object = None,
    criterion: Criterion = "task",
    seed: int = 0,
    findings: Sequence[Finding] = (),
    progress: Callable[[int], None] | bool | None = None,
) -> CalibrationPlan:
    """Choose the poses to measure among candidates.

    Args:
        model: The model, whose sheet is the prior.
        candidates: Poses that can be measured: a list, an array ``(n, P)``, a mapping of joint values or a pose set.
        count: How many of them are measured, each once.
        measurement: Instrument and set-up; those of the sheet if left out.
        at: The user's own poses; the model's named poses if left out, else the candidates.
        criterion: ``"task"``: the mean square position error left at the user's poses. ``"D"``: the determinant of the
            information.
        seed: 64-bit seed of the starting choices.
        findings: Findings to pass on, such as those of the sheet.
        progress: Function called with the number of steps done since its last call, of :data:`PLAN_STEPS`; ``True``
            shows a bar.

    Raises:
        InputError: Fewer candidates than poses to choose, a candidate twice, nothing varies from robot to robot, or no
            candidate sees anything.
    """
    measurement = measurement_of(model, measurement)
    findings = check_items("findings", findings, Finding)
    check_choice("the criterion", criterion, ("task", "D"))
    check_seed(seed)
    left_out: Counter[str] = Counter()
    if isinstance(candidates, PoseSet):
        left_out.update(candidates.obstructed)
        candidates = candidates.of(candidates.known) if candidates.known.any() else candidates
    values, names = read_poses(model, candidates)
    given = PoseSet.at(model.chain, np.ascontiguousarray(values), names).unobstructed(model.chain)
    hit = len(given) - int(given.known.sum())
    if hit == len(given):
        raise InputError(f"at each of {hit} candidates the arm hits itself or what it is kept out of")
    seen = seen_poses(model.chain, measurement, given.of(given.known) if hit else given)
    if seen is None:
        raise InputError(f"the instrument sees the target at none of {len(given) - hit} candidates")
    values, names = seen.q, seen.names
    total = values.shape[1]
    hidden = len(given) - hit - total
    left_out += Counter({**given.obstructed, "hidden": hidden})
    count = check_whole(
        "the number of poses to choose", count, 1, total, f"from 1 to {total}, the number of candidates"
    )
    _refuse_copies(values)
    unit = UnitNumbers.of(model.space)
    # each candidate by itself: one reading at its own pose
    stations = tuple(
        Station(one, (k,))
        for k, one in enumerate(measured_model(model, measurement).at_columns(np.ascontiguousarray(values)))
    )
    by_z, by_nuisance = stack_at_means(stations, unit, measurement)
    refuse_where_nothing_is_seen(of_stack(unit.names, flat(by_z), flat(by_nuisance), measurement.nuisances, total))
    tasks = task_poses(model, at, values)
    slopes = [one.jacobian[:3][:, unit.columns] @ unit.root for _, one in tasks]
    goal = sum((one.T @ one for one in slopes), np.zeros((by_z.shape[2],) * 2)) / len(slopes)
    design = Design.of(by_z, by_nuisance, goal if criterion == "task" else None)
    generator = np.random.default_rng(seed)
    # matrices of a few dozen rows: threads of BLAS would wait for each other, five times as long on two cores
    with threadpool_limits(1, user_api="blas"), steps_to(progress, PLAN_STEPS, "steps") as step:
        choices = []
        for _ in range(_STARTS):
            choices.append(design.exchange(generator.permutation(total)[:count]))
            step(1)
        root = relaxed(design, count, np.full(total, count / total), np.zeros(total), np.ones(total))
        chosen = min((*choices, design.exchange(root.rounded(count))), key=design.exact_loss)
        step(1)
        chosen = _perturbed(design, chosen, root.bound, generator)
        step(1)
        bound, chosen = branches(design, count, root, chosen)
        chosen = np.sort(design.exchange(chosen))
        step(1)
    loss = design.exact_loss(chosen)
    efficiency = design.efficiency(loss, bound)
    random = [design.exact_loss(generator.permutation(total)[:count]) for _ in range(_RANDOM)]
    estimator = Estimator.of(flat(by_z[chosen]), flat(by_nuisance[chosen]), has_prior=True)
    nominal = np.array([stations[k].at.posture.pose for k in chosen])
    own = tuple(Station(stations[k].at, (row,)) for row, k in enumerate(chosen))
    found = determined_by(own, unit, measurement)
    return CalibrationPlan(
        provenance=Provenance.of(model, seed),
        measurement=measurement,
        criterion=criterion,
        chosen=tuple(map(int, chosen)),
        names=tuple(names[k] for k in chosen),
        q=values[:, chosen],
        candidates=total,
        left_out=dict(left_out),
        value=-loss if criterion == "D" else loss,
        bound=-bound if criterion == "D" else bound,
        efficiency=efficiency,
        random_efficiency=design.efficiency(float(np.median(random)), bound),
        identifiability=found,
        poses=errors_left(tasks, unit, estimator, measurement.displaces_base, model.space),
        findings=(
            *findings,
            *(model.chain.collision_notes if left_out else ()),
            *_remarks(found, efficiency, hidden, hit),
            *doubt_contact(measurement, nominal),
        ),
    )


def _perturbed(
    design: Design, chosen: NDArray[np.intp], bound: float, generator: np.random.Generator
) -> NDArray[np.intp]:
    """Return the best of searches that begin at a choice with some of its poses replaced (iterated local search)."""
    rest = len(design.rows) - len(chosen)
    most = min(max(2, round(_REPLACED * len(chosen))), len(chosen), rest)
    best = design.exact_loss(chosen)
    for number in range(_PERTURBED if most else 0):
        if design.efficiency(best, bound) >= _CERTAIN:
            break
        replaced = 1 + number % most
        others = np.setdiff1d(np.arange(len(design.rows)), chosen)
        tried = chosen.copy()
        tried[generator.permutation(len(chosen))[:replaced]] = generator.permutation(others)[:replaced]
        tried = design.swap(tried)
        loss = design.exact_loss(tried)
        if loss < best:
            chosen, best = tried, loss
    return chosen


def _refuse_copies(values: Array) -> None:
    _, first, place = np.unique(values, axis=1, return_index=True, return_inverse=True)
    copies = np.flatnonzero(first[place.ravel()] != np.arange(values.shape[1]))
    if copies.size:
        again = int(copies[0])
        raise InputError(
            f"the candidates {int(first[place.ravel()[again]]) + 1} and {again + 1} are one pose, and each is measured once; "
            "leave copies out"
        )


def _remarks(found: Identifiability, efficiency: float, hidden: int, hit: int) -> tuple[Finding, ...]:
    remarks = []
    if hit:
        message = f"{hit} candidates are left out: the arm hits itself or what it is kept out of"
        remarks.append(Finding("warning", "W_COLLISION", message))
    if hidden:
        message = f"{hidden} candidates are left out: the target faces away from the instrument by more than the cone"
        remarks.append(Finding("warning", "W_HIDDEN", message))
    if efficiency < 0.99:
        message = (
            f"the choice is certified to {100 * efficiency:.3g} % of the best only: the bound may be beyond every choice, and no "
            "exchange of two poses is better"
        )
        remarks.append(Finding("warning", "W_PLAN", message))
    return (*remarks, *remarks_on(found))
