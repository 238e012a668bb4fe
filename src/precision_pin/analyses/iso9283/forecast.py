"""Forecast of an ISO 9283:1998 test from a sheet: every built robot is tested once.

Every robot comes n times to each pose, which gives the figures of its test. Draws of unit scope are the same in all
cycles of a robot, those of pose scope in all its cycles at a pose, those of visit scope new in every cycle. A robot's
figures depend on model, seed and its number only, for any number of threads.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.analyses.iso9283 import figures as formulas
from precision_pin.analyses.iso9283.cube import paths_of_approach, standard_poses
from precision_pin.analyses.iso9283.result import LEVELS, OF_ANGLES, OF_POSE, SINGLE, Iso9283Result, PoseForecast
from precision_pin.analyses.provenance import PoseLabel, Provenance
from precision_pin.base import arguments, se3
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError, UnknownNameError, add, warns_at_end
from precision_pin.base.progress import steps_to
from precision_pin.base.units import LENGTH, MASS
from precision_pin.draws.draw import MOST_VISITS, Scope
from precision_pin.kernel import sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.model.error_model import ErrorModel, takes_datum
from precision_pin.model.pose_model import PoseModel
from precision_pin.robot.pose_set import PoseSet
from precision_pin.sampling import Progress, available_cores
from precision_pin.sampling.approaches import ApproachErrors, sample_approaches
from precision_pin.sampling.run import check_common
from precision_pin.sampling.verdict_grounds import exact_findings, grounds_at
from precision_pin.sampling.workers import in_order
from precision_pin.statistics import NO_GROUNDS, NO_SPREAD, Grounds, SampleLaw, SpecificationResult, clopper_pearson
from precision_pin.statistics.plan import specification

CYCLES: Final = 30
"""Cycles of a test in the standard."""
MOST_ROBOTS: Final = 10**8
"""Maximum number of robots accepted; memory limits them further."""
MOST_POSES: Final = 100
"""Maximum number of poses of a test; the standard has five."""
# robots whose barycentres are compared for E
_EXCHANGED: Final = 5
# m
_FARTHEST_TARGET: Final = 1e3
_AXES: Final = (("x", "y", "z"), ("a", "b", "c"))


@warns_at_end
@takes_datum
def iso9283(
    model: ErrorModel,
    poses: ArrayLike | Mapping[str, ArrayLike] | Sequence[object] | PoseSet | None = None,
    *,
    cycles: int = CYCLES,
    robots: int = 2000,
    seed: int = 0,
    target: ArrayLike | None = None,
    load: float | str = 0.0,
    fit_base: bool = False,
    specifications: str | Sequence[str] = (),
    confidence: float = 0.95,
    findings: Sequence[Finding] = (),
    threads: int | None = None,
    progress: Progress | bool | None = None,
) -> Iso9283Result:
    """Return the law of the figures of ISO 9283:1998 over built robots and tests.

    Every robot is built once and tested once: draws of unit scope are made once for a robot, those of pose scope once
    for a robot and pose, those of visit scope in each cycle. The laws thus include the scatter over robots and tests.

    Args:
        model: Chain, draws and sources.
        poses: The poses P1, P2, …: as in :func:`precision_pin.sample_poses`, or a set of poses. By default the
            standard's five in the largest cube within reach, with the tool's orientation of the model's first pose.
        cycles: Cycles of a test, n ≥ 2; the standard has 30.
        robots: Number of built robots.
        seed: 64-bit seed.
        target: The measured point in tool axes, m, ``(3,)``; by default the tip.
        load: Mass at the target, kg or with a unit, added to the sheet's loads; the standard uses the rated load.
        fit_base: Align the barycentres to the commanded positions by a best fit over the poses, as if the base were
            located by the same measurement. It changes AP only; E is never fitted.
        specifications: Limits to judge, one or a list, such as ``"RP 0.1 mm @ 95 %"``: a figure, its limit, and the
            fraction of robots (95 % by default) that must keep it in a test, at every pose.
        confidence: Confidence of every interval.
        findings: Warnings to include in the result, such as those of the sheet.
        threads: Number of threads, by default one for each core. It does not change the result.
        progress: Function called with the number of visits simulated since its last call; ``True`` shows a bar.

    Raises:
        InputError: No poses, wrong joint values, numbers out of range, more robots than fit into memory, errors too
            large to compute with, or a best fit of poses on a line.
        UnknownNameError: No such pose or joint.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> again = pp.Draw("again", pp.Normal(1e-4), pp.Scope.VISIT)
        >>> arm = pp.ErrorModel(chain, pp.Space((again,)), [pp.sources.JointOffset(joint="joint1", offset="again")])
        >>> RP = pp.iso9283(arm, [[0, 0, 0, 0]], robots=200).poses["P1"].RP
        >>> print(round(1e3 * RP.quantile(0.5), 1))
        0.9
    """
    common = check_common(model, seed=seed, findings=findings, progress=progress, confidence=confidence)
    arguments.check_whole("the number of cycles", cycles, 2, MOST_VISITS)
    arguments.check_whole("the number of robots", robots, 1, MOST_ROBOTS)
    if threads is not None:
        arguments.check_whole("threads", threads, 1, 1024)
    limits = listed_limits(specifications)
    point = _measured_point(target)
    mass = arguments.check_quantity("the load", load, MASS, "zero or more and finite", lambda kg: kg >= 0)
    if mass:
        loaded = model.like(model.chain.with_payload(mass, tuple(point.tolist())), model.space)
        loaded.sheet = model.sheet
        model = loaded
    cube = None
    if poses is None:
        if not model.poses:
            raise InputError("the model has no pose to take the tool's orientation from; give the poses of the test")
        poses, cube = standard_poses(model.chain, model.configuration(), point)
    values, names, approaches = _poses(model, poses)
    count = values.shape[1]
    arguments.check_memory(
        8.0 * robots * (35 * count + 10), f"testing {robots:,} robots at {count} poses", "test fewer of them"
    )
    models = tuple(model.at_columns(values, approaches))
    setup = _set_up(models, point, int(seed), int(cycles), arguments.check_flag("fit_base", fit_base))
    warnings = _warnings(model, models, names)
    add(warnings)
    with steps_to(progress, robots * count * cycles) as step:
        figures = _simulate(
            setup, int(robots), threads or available_cores(), lambda tests: step(tests * int(cycles) * count)
        )
    labels = [replace(PoseLabel.of(model, None, at), name=name) for at, name in zip(models, names, strict=True)]

    def law(values: Array) -> SampleLaw:
        return SampleLaw(np.ascontiguousarray(values), confidence, LEVELS)

    forecasts = {
        f"P{pose + 1}": PoseForecast(
            label=labels[pose],
            commanded=setup.commanded[pose],
            point=setup.points[pose],
            **{name: law(getattr(figures, name)[pose]) for name in ("AP", "RP", "RP_limit")},
            **{
                f"{figure}_{axis}": law(getattr(figures, f"{figure}_{''.join(axes)}")[pose, k])
                for figure, axes in (("AP", _AXES[0]), ("AP", _AXES[1]), ("RP", _AXES[1]))
                for k, axis in enumerate(axes)
            },
        )
        for pose in range(count)
    }
    of_test, absent = _figures_of_test(model, figures, models[0].posture.q, setup, int(robots))
    single = {name: None if values is None else law(values) for name, values in of_test.items()}
    grounds = grounds_at(model, values, list(forecasts)) if limits else NO_GROUNDS
    verdicts = [_judge(limit, forecasts, single, absent, confidence, grounds) for limit in limits]
    return Iso9283Result(
        provenance=Provenance.of(model, seed),
        cycles=int(cycles),
        robots=int(robots),
        confidence=confidence,
        target=point,
        mass=mass,
        fit_base=setup.fit_base,
        poses=forecasts,
        worst={name: law(getattr(figures, name).max(axis=0)) for name in ("AP", "RP")},
        measured=None,
        **single,
        cube=cube,
        absent=absent,
        specifications=tuple(verdicts),
        findings=common,
        warnings=tuple(dict.fromkeys(map(str, (*common, *warnings)))),
    )


def _measured_point(target: ArrayLike | None) -> Array:
    if target is None:
        return np.zeros(3)
    needs = "three numbers in tool axes, in m or with a unit"
    point = arguments.check_quantities("the target", target, LENGTH, (3,), needs)
    if np.abs(point).max() > _FARTHEST_TARGET:
        raise InputError(f"the target must lie within {_FARTHEST_TARGET:,.0f} m of the tip, got {point.tolist()} m")
    return point


def _simulate(setup: Setup, robots: int, threads: int, step: Callable[[int], object]) -> RobotFigures:
    """Return the figures of robots; threads simulate groups of them, which are joined in order."""
    groups = (partial(simulate_tests, setup, first, min(ROBOTS, robots - first)) for first in range(0, robots, ROBOTS))
    parts = []
    for part in in_order(groups, threads):
        parts.append(part)
        step(part.AP.shape[1])
    return RobotFigures(*(np.concatenate(of_parts, axis=-1) for of_parts in zip(*parts, strict=True)))


def _figures_of_test(
    error_model: ErrorModel, figures: RobotFigures, q: Array, setup: Setup, robots: int
) -> tuple[dict[str, Array | None], dict[str, str]]:
    """Return the figures of a test that has one for all its poses, by name, and why some are absent; ``q`` is P1."""
    exchange, absent = _exchangeability(error_model, figures.first)
    # maximum number of robots for vAP and drift, whose visits are all in memory
    tested = min(robots, 10_000)
    approached = approach_figures(error_model, q, setup.target, tested, setup.cycles, setup.seed)
    if approached is None:
        absent |= dict.fromkeys(("vAP", "RP_bidirectional"), "no source of the sheet follows the direction of approach")
    drift = drift_from_cold(error_model, q, setup.target, tested, setup.cycles, setup.seed)
    if drift is None:
        absent["drift"] = "no thermal source has a time_constant"
    has_distance = len(figures.AD) > 0
    if not has_distance:
        absent |= dict.fromkeys(("AD", "RD"), "between P2 and P4, which needs four poses")
    return {
        "AD": figures.AD[0] if has_distance else None,
        "RD": figures.RD[0] if has_distance else None,
        "E": exchange,
        "vAP": None if approached is None else approached.variation,
        "RP_bidirectional": None if approached is None else approached.bidirectional,
        "drift": drift,
    }, absent


def _judge(
    limit: FigureLimit,
    forecasts: Mapping[str, PoseForecast],
    single: Mapping[str, SampleLaw | None],
    absent: Mapping[str, str],
    confidence: float,
    grounds: Grounds,
) -> SpecificationResult:
    """Return the verdict on a limit: of a figure of poses, on its largest value in a test."""
    if limit.figure not in single:
        largest = np.abs([getattr(forecast, limit.figure).values for forecast in forecasts.values()]).max(axis=0)
    elif (law := single[limit.figure]) is not None:
        largest = np.abs(law.values)
    else:
        why = absent[limit.figure]
        raise InputError(f"a specification limits {limit.figure}, which this forecast does not have: {why}")
    count, differs = int((largest <= limit.limit).sum()), bool(largest.max() - largest.min() > NO_SPREAD)
    fraction, interval = count / largest.size, clopper_pearson(count, largest.size, confidence)
    return SpecificationResult(limit.figure, limit.limit, limit.required, fraction, interval, differs, grounds)


def _poses(error_model: ErrorModel, poses: object) -> tuple[Array, tuple[str, ...], NDArray[np.int8] | None]:
    if isinstance(poses, PoseSet):
        if not poses.known.all():
            raise InputError(f"poses {', '.join(np.flatnonzero(~poses.known).astype(str))} have no joint values")
        values, names, approaches = poses.q, poses.names, poses.approaches
    else:
        values, names = error_model.configurations(poses)  # type: ignore[arg-type]
        approaches = error_model.approaches_of(poses, values)
    if not 1 <= len(names) <= MOST_POSES:
        raise InputError(f"a test has 1 to {MOST_POSES} poses, the standard's five; got {len(names):,}")
    return values, names, approaches


def _set_up(models: Sequence[PoseModel], target: Array, seed: int, cycles: int, fit_base: bool) -> Setup:
    layouts = tuple(sampler.to_arrays_at_poses(models))
    commanded = np.stack([at.posture.pose for at in models])
    shape = np.array([shape_factor(layout, pose, seed) for pose, layout in enumerate(layouts)])
    setup = Setup(layouts, commanded, target, seed, cycles, fit_base, visit_root(layouts[0]), shape)
    if fit_base:
        spread = np.linalg.svd(setup.points - setup.points.mean(axis=0), compute_uv=False)
        if len(models) < 3 or spread[1] < 1e-3 * spread[0]:
            raise InputError("fit_base: the best fit needs three poses or more whose positions do not lie on a line")
    return setup


def _warnings(error_model: ErrorModel, models: Sequence[PoseModel], names: Sequence[str]) -> tuple[Finding, ...]:
    """Return the warnings at each pose, and one if nothing in the sheet changes from visit to visit."""
    warnings = []
    for rank, (at, name) in enumerate(zip(models, names, strict=True), start=1):
        where = f"P{rank}, {name!r}" if name else f"P{rank}"
        for finding in (*at.findings("exact"), *error_model.statics_findings(at)):
            warnings.append(replace(finding, message=f"{where}: {finding.message}"))
    warnings += exact_findings(error_model, np.column_stack([at.posture.q for at in models]))
    if not _varies(error_model, Scope.VISIT):
        message = "no draw of the sheet has the scope visit: every cycle is as the first one, so RP and RD are 0"
        warnings.append(Finding("warning", "W_NO_VISITS", message))
    return tuple(warnings)


def _varies(error_model: ErrorModel, *scopes: Scope) -> bool:
    return any(draw.scope in scopes and draw.law.streamed for draw in error_model.space.draws)


def _exchangeability(error_model: ErrorModel, barycentres: Array) -> tuple[Array | None, dict[str, str]]:
    """Return E of each group of five robots from their barycentres at P1 ``(3, N)``, and why figures are absent."""
    groups = barycentres.shape[1] // _EXCHANGED
    if not _varies(error_model, Scope.UNIT):
        return None, {"E": "no draw of the sheet has the scope unit: it does not say how built robots differ"}
    if not groups:
        return None, {"E": f"it compares {_EXCHANGED} robots"}
    grouped = barycentres[:, : groups * _EXCHANGED].reshape(3, groups, _EXCHANGED)
    differences = grouped[:, :, :, None] - grouped[:, :, None, :]
    largest: Array = np.sqrt((differences * differences).sum(axis=0)).max(axis=(1, 2))
    return largest, {}


FIGURES: Final = (*OF_POSE, *SINGLE)


@dataclass(frozen=True)
class FigureLimit:
    """Limit ``limit`` (m or rad) of ``|figure|``, at every pose, kept by at least a fraction ``required`` of robots."""

    figure: str
    limit: float
    required: float


def listed_limits(texts: object) -> tuple[FigureLimit, ...]:
    """Return limits, one text or a list of texts, ``FIGURE LIMIT [@ PROBABILITY]``."""
    if isinstance(texts, str):
        texts = (texts,)
    if not isinstance(texts, list | tuple):
        raise InputError(
            f"specifications must be a list of texts such as 'RP 0.1 mm @ 95 %', got {arguments.shown(texts)}"
        )
    return tuple(map(_read, texts))


def _read(text: object) -> FigureLimit:
    parts = arguments.check_text("each of the specifications", text, "RP 0.1 mm @ 95 %").split(maxsplit=1)
    if len(parts) < 2:
        raise InputError(f"specification {arguments.shown(text)} is not understood; write it as 'RP 0.1 mm @ 95 %'")
    figure, text_ = parts
    if figure not in FIGURES:
        raise UnknownNameError("figure of a specification", figure, FIGURES)
    limit = specification(text_)
    of_angle = limit.quantity == "attitude.norm"
    if limit.quantity not in ("position.norm", "attitude.norm") or of_angle != (figure in OF_ANGLES):
        raise InputError(
            f"specification {arguments.shown(text)}: {figure} is limited by {'an angle' if figure in OF_ANGLES else 'a length'}"
        )
    return FigureLimit(figure, limit.limit, limit.required)


ROBOTS: Final = 512
"""Robots that are tested together: enough for the compiled loops, few enough for the cache."""
# step of a difference quotient in standard deviations of a visit's draws: inside the support of every law
_STEP: Final = 0.5
# visits of the mean robot that determine the shape of a cloud that is not normal
_VISITS: Final = 2**14


@dataclass(frozen=True, eq=False)
class Setup:
    """Data common to all robots.

    Attributes:
        layouts: The model at each pose.
        commanded: Commanded poses of the tip, ``(P, 4, 4)``.
        target: The measured point in tool axes, m, ``(3,)``.
        seed, cycles: 64-bit seed, and cycles of a test.
        fit_base: Whether positions and orientations are aligned by the best fit over the poses.
        root: ``(d, r)``, from `visit_root`.
        shape: ``(P,)``, from `shape_factor`.
    """

    layouts: tuple[SamplerArrays, ...]
    commanded: Array
    target: Array
    seed: int
    cycles: int
    fit_base: bool
    root: Array
    shape: Array

    @property
    def points(self) -> Array:
        """Commanded positions of the target, ``(P, 3)``."""
        return self.commanded[:, :3, 3] + np.einsum("pij,j->pi", self.commanded[:, :3, :3], self.target)


class RobotFigures(NamedTuple):
    """Figures of N robots, each tested once, m and rad; the last axis of every array is the robot.

    Attributes:
        AP, RP, RP_limit: ``(P, N)``; the last is RP of infinitely many cycles.
        AP_xyz, AP_abc, RP_abc: ``(P, 3, N)``.
        AD, RD: ``(1, N)``, or ``(0, N)`` with fewer than four poses.
        first: Barycentre minus commanded position at P1, without any fit, ``(3, N)``.
    """

    AP: Array
    RP: Array
    RP_limit: Array
    AP_xyz: Array
    AP_abc: Array
    RP_abc: Array
    AD: Array
    RD: Array
    first: Array


def simulate_tests(setup: Setup, first: int, count: int) -> RobotFigures:
    """Return the figures of robots ``first … first + count - 1``."""
    errors = [_errors(setup, layout, pose, first, count) for pose, layout in enumerate(setup.layouts)]
    shifts, rotations = ([_at_target(setup, pose, e) for pose, e in enumerate(errors)], [e[:, 3:] for e in errors])
    angles = [_angles(vectors) for vectors in rotations]
    pose_parts = [formulas.pose_figures(*pair) for pair in zip(shifts, angles, strict=True)]
    distance = distance_scatter = np.empty((0, count))
    if len(shifts) > max(formulas.DISTANCE):
        start, stop = setup.points[list(formulas.DISTANCE)]
        attained = (shifts[k] + at[:, None] for k, at in zip(formulas.DISTANCE, (start, stop), strict=True))
        distance, distance_scatter = (of[None] for of in formulas.distance_figures(start - stop, *attained)[:2])
    _, accuracy, mean_angles, RP, scatter_angles = (np.stack(of_poses) for of_poses in zip(*pose_parts, strict=True))
    unfitted = accuracy[0]
    if setup.fit_base:
        rotation, accuracy = formulas.fit_to(setup.points, accuracy)
        fitted = [_angles(vectors, rotation) for vectors in rotations]
        mean_angles = np.stack([formulas.barycentre(fit) for fit in fitted])
    return RobotFigures(
        AP=np.sqrt((accuracy * accuracy).sum(axis=1)),
        RP=RP,
        RP_limit=np.stack([_limit(setup, pose, first, count) for pose in range(len(setup.layouts))]),
        AP_xyz=accuracy,
        AP_abc=mean_angles,
        RP_abc=scatter_angles,
        AD=distance,
        RD=distance_scatter,
        first=unfitted,
    )


def visit_root(layout: SamplerArrays) -> Array:
    """Return C ``(d, r)`` with C Cᵀ the covariance of the draws of visit scope, zero in all other rows."""
    space = layout.space
    columns = visit_columns(layout)
    root = np.zeros((space.size, columns.size))
    values, vectors = np.linalg.eigh(space.block_covariance.within(columns))
    root[columns] = vectors * np.sqrt(np.maximum(values, 0.0))
    return root[:, (root != 0).any(axis=0)]


def visit_columns(layout: SamplerArrays) -> Array:
    """Return the components of visit scope that vary."""
    space = layout.space
    columns = [
        column
        for draw, of_draw in zip(space.draws, space.slices, strict=True)
        if draw.scope is Scope.VISIT and draw.law.streamed
        for column in range(of_draw.start, of_draw.stop)
    ]
    return np.array(columns, dtype=np.intp)


def shape_factor(layout: SamplerArrays, pose: int, seed: int) -> float:
    """Return the limit of RP relative to a normal cloud of the same covariance, 1 if all visit draws are normal."""
    space = layout.space
    laws = [draw.law for draw in space.draws if draw.scope is Scope.VISIT]
    columns = visit_columns(layout)
    if not columns.size or all(law.is_normal for law in laws):
        return 1.0
    x = np.repeat(space.mean[:, None], _VISITS, axis=1)
    x[columns] = sampler.sample(layout, seed, 0, _VISITS, pose=pose)[columns]
    positions = sampler.errors_at(layout, "exact", x)[:3]
    shifted = positions - positions.mean(axis=1)[:, None]
    distances = np.sqrt((shifted * shifted).sum(axis=0))
    normal = float(formulas.repeatability_limit(np.einsum("in,jn->ij", shifted, shifted) / _VISITS))
    return float(distances.mean() + 3 * distances.std()) / normal if normal > 0 else 1.0


# private -------------------------------------------------------------------------------------------------------------


def _errors(setup: Setup, layout: SamplerArrays, pose: int, first: int, count: int) -> Array:
    """Return the errors at the visits of a pose, ``(cycles, 6, N)``."""
    errors = np.empty((setup.cycles, 6, count))
    # without draws of visit scope all cycles are equal
    different = setup.cycles if setup.root.shape[1] else 1
    for visit in range(different):
        errors[visit] = sampler.errors(layout, "exact", setup.seed, first, count, pose=pose, visit=visit)
    errors[different:] = errors[0]
    return errors


def _at_target(setup: Setup, pose: int, errors: Array) -> Array:
    """Return the displacement of the target from its commanded position, ``(cycles, 3, N)``."""
    if not setup.target.any():
        return errors[:, :3]
    lever = np.einsum("ij,j->i", setup.commanded[pose, :3, :3], setup.target)
    result = np.empty((len(errors), 3, errors.shape[2]))
    for cycle, error in enumerate(errors):
        rotation = se3.exp_rotation(error[3:])
        result[cycle] = error[:3] + np.einsum("ijn,j->in", rotation, lever) - lever[:, None]
    return result


def _angles(vectors: Array, turn: Array | None = None) -> Array:
    """Return a, b, c ``(cycles, 3, N)`` of rotation vectors, after a further rotation ``(3, 3, N)`` of the base."""
    matrices = (se3.exp_rotation(v) for v in vectors)
    return np.stack([formulas.angles_of(v if turn is None else np.einsum("ijn,jkn->ikn", turn, v)) for v in matrices])


def _limit(setup: Setup, pose: int, first: int, count: int) -> Array:
    """Return RP of infinitely many cycles of each robot, ``(N,)``; its cloud is first order in the visits' draws."""
    layout, root = setup.layouts[pose], setup.root
    if not root.shape[1]:
        return np.zeros(count)
    x = sampler.sample(layout, setup.seed, first, count, pose=pose)
    columns = visit_columns(layout)
    x[columns] = layout.space.mean[columns][:, None]
    slopes = np.empty((root.shape[1], 3, count))
    for k, direction in enumerate(_STEP * root.T[:, :, None]):
        errors = np.stack([sampler.errors_at(layout, "exact", x + side * direction) for side in (1, -1)])
        displacements = _at_target(setup, pose, errors)
        slopes[k] = (displacements[0] - displacements[1]) / (2 * _STEP)
    covariance = np.einsum("kin,kjn->nij", slopes, slopes)
    return setup.shape[pose] * formulas.repeatability_limit(covariance)


def approach_figures(
    error_model: ErrorModel, q: Array, target: Array, robots: int, cycles: int, seed: int
) -> ApproachErrors | None:
    """Return the errors of visits over paths along the base axes; ``None`` if no error depends on the path.

    ``q`` is ``(n,)``, the measured point ``target`` is in tool axes, m, ``(3,)``; ``cycles`` are those of each path.
    """
    posture = error_model.at(q).posture
    lever = posture.pose[:3, :3] @ target
    jacobian = error_model.chain.at_columns(q[:, None]).joint_jacobian[:, :, 0].copy()
    jacobian[:3] += np.cross(jacobian[3:], lever, axis=0)
    paths = paths_of_approach(jacobian)
    if not _follows(error_model, q, paths):
        return None
    return sample_approaches(error_model, q, approaches=paths, robots=robots, cycles=cycles, seed=seed, target=target)


def _follows(error_model: ErrorModel, q: Array, paths: Sequence[tuple[int, ...]]) -> bool:
    """Return whether any source's terms differ for another approach."""
    first_terms, *other_terms = [error_model.at(q, approach=path).terms for path in paths]
    return any(
        [term.factors for term in terms] != [term.factors for term in first_terms]
        or any(not np.array_equal(term.twist, nominal.twist) for term, nominal in zip(terms, first_terms, strict=True))
        for terms in other_terms
    )


HOURS: Final = 8.0
"""Duration of the test; the standard ends it there, or earlier once the drift is slow."""
# times at which AP is measured, the first at the start: every half hour
_TESTS: Final = 17


def drift_from_cold(
    error_model: ErrorModel, q: Array, target: Array, robots: int, cycles: int, seed: int
) -> Array | None:
    """Return ``max |AP_0 - AP_t|`` of each robot over a test that starts cold, m, ``(N,)``; ``None`` if none drifts."""
    bound = error_model.bound_sources
    if all(entry.source.after(0.0, entry.view) is entry.source for entry in bound):
        return None
    accuracies = []
    for k, seconds in enumerate(np.linspace(0.0, 3600 * HOURS, _TESTS)):
        sources = [entry.source.after(float(seconds), entry.view) for entry in bound]
        model = ErrorModel(error_model.chain, error_model.space, sources, statics=error_model.statics)
        accuracies.append(_accuracy(model, q, target, robots, range(k * cycles, (k + 1) * cycles), seed))
    return np.abs(np.array(accuracies[1:]) - accuracies[0]).max(axis=0)


def _accuracy(model: ErrorModel, q: Array, target: Array, robots: int, visits: range, seed: int) -> Array:
    """Return AP of each robot, ``(N,)``: the distance of the barycentre of its visits from the commanded position."""
    at = model.at(q)
    layout = sampler.to_arrays(at)
    lever = at.posture.pose[:3, :3] @ target
    total = np.zeros((3, robots))
    for visit in visits:
        error = sampler.errors(layout, "exact", seed, 0, robots, visit=visit)
        total += error[:3] + np.einsum("ijn,j->in", se3.exp_rotation(error[3:]), lever) - lever[:, None]
    return np.sqrt(((total / len(visits)) ** 2).sum(axis=0))
