"""Compliance of the target at poses: along axes, in the softest direction, by source, in steps of load, over robots.

    [d; δ] = C [F; M]    force and moment on the tip's link at the target

Nominal statics: C = Σ J_e C_e J_eᵀ over joints, bearings and links (Salisbury, IEEE Conference on Decision and Control,
1980). At rest C = J (K - K_g)⁻¹ Jᵀ, with J and the load stiffness K_g = ∂τ/∂q at rest (Chen and Kao, International Journal
of Robotics Research 19, 2000). The stiffness along an axis is 1/C_xx: the force along it, free sideways. Static
compliance: ISO 9283:1998, section 10, a displacement over its force, in steps of 10 % of the rated load.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Final, Literal, NamedTuple

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import minimize

from precision_pin.analyses.collect import bracketed
from precision_pin.analyses.provenance import Pose, PoseLabel, Poses, Provenance, approached, listed_poses
from precision_pin.analyses.result import AnalysisResult, list_warnings, name_pose
from precision_pin.base.arguments import check_choice, check_numbers, check_quantity, check_whole
from precision_pin.base.arrays import Array, Keys, Record
from precision_pin.base.errors import Finding, InputError, add, warns_at_end
from precision_pin.base.progress import stepped, steps_to
from precision_pin.base.units import FORCE, LINEAR_COMPLIANCE, Quantity
from precision_pin.draws.draw import Scope
from precision_pin.model.compliance import Elasticity, ElasticPose
from precision_pin.model.error_model import ErrorModel, takes_datum
from precision_pin.render.columns import Column, frame_row, notebook_table
from precision_pin.render.html import rendered
from precision_pin.render.tables import MOST_POSES, data_frame, milli, pose_labels
from precision_pin.robot.chain import pose_findings
from precision_pin.robot.pose_set import PoseSet
from precision_pin.sampling import Progress
from precision_pin.sampling.run import check_common
from precision_pin.statistics.intervals import clopper_pearson, tolerance_ranks
from precision_pin.statistics.sample_law import SampleLaw

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]

LEVELS: Final = (0.05, 0.5, 0.95, 0.99)
"""Probabilities of the quantiles over robots."""
CONTENT: Final = 0.95
"""Share of the robots in the interval of each entry of the compliance."""
MOST_ROBOTS: Final = 1_000_000
"""Largest number of robots, whose compliances stay in memory."""
STEPS: Final = 10
"""Steps up to the rated load."""
_STRAIGHT: Final = 1e-9
"""Relative difference that is rounding: from the tangent at the rated load, and between robots."""
_ROUNDING: Final = 1e-9
"""Compliance (mm/kN, mrad/(N·m)) or length (mm) that is rounding."""
_DIFFERENT: Final = 0.01
"""Relative difference of robots solved one by one from the law that causes a warning."""


@dataclass(frozen=True, eq=False)
class RobotLaw(Record):
    """Law of a number over robots, SI, without the robots; quantiles by probability, None where they do not resolve them."""

    mean: float
    std: float
    quantiles: Mapping[float, float | None]
    quantile_interval: Mapping[float, tuple[float, float] | None]


@dataclass(frozen=True, eq=False)
class Direction(Record):
    """Compliance along a direction for a force along it, or about it for a moment about it; free in all others.

    Attributes:
        axis: ``x``, ``y``, ``z``, ``along`` for a given direction, or ``softest``.
        direction: Unit vector ``(3,)``, base axes.
        compliance: m/N or rad/(N·m), every parameter at its mean.
        law: Law over robots; that of ``softest`` is of each robot's own softest direction.
    """

    KEYS: ClassVar[Keys] = ("axis", "direction", "compliance", "stiffness", "*law")

    axis: str
    direction: Array
    compliance: float
    law: RobotLaw

    @property
    def stiffness(self) -> float | None:
        """Reciprocal of the compliance, N/m or N·m/rad; None where nothing gives way."""
        return 1 / self.compliance if self.compliance > 0 else None


@dataclass(frozen=True, eq=False)
class ElasticPart(Record):
    """Part of an elastic source in the compliance.

    Attributes:
        source: Its label.
        compliance, share: Part in the softest direction, m/N, and as a fraction.
        axes: Part along each axis, m/N.
        factor: How many times stiffer it alone must be for the goal; 1 if the goal is kept, None if it alone cannot do it.
        split: How many times stiffer it must be where all parts share the goal so that the sum of their factors is least.
    """

    source: str
    compliance: float
    share: float
    axes: Array
    factor: float | None
    split: float | None


@dataclass(frozen=True, eq=False)
class LoadSteps(Record):
    """Static compliance along an axis with a sign.

    Attributes:
        step, rated: Step of the force and its largest, N.
        force, displacement: ``(10,)`` N, and ``(10, 3)`` of the target in base axes, m.
        compliance: Displacement along the force over the force, ``(10,)``, m/N.
    """

    step: float
    rated: float
    force: Array
    displacement: Array
    compliance: Array


@dataclass(frozen=True, eq=False)
class HeldJoint(Record):
    """A joint that friction holds: its band 2F/k, rad or m, and ``|J| 2F/k`` along each axis, m."""

    source: str
    joint: str
    band: float
    axes: Array


@dataclass(frozen=True, eq=False)
class Goal(Record):
    """The largest compliance wanted, m/N.

    Attributes:
        together: How many times stiffer all parts together must be; 1 if the goal is kept.
        probability, interval: Share of the robots that keep it.
    """

    limit: float
    together: float
    probability: float
    interval: tuple[float, float]


class Row(NamedTuple):
    """Row of the table of a pose: a direction with its static compliance and dead band along it."""

    quantity: str
    of: Direction
    turns: bool
    plus: float | None = None
    minus: float | None = None
    band: float | None = None

    @property
    def unit(self) -> str:
        """Unit of the compliance."""
        return "mrad/(N·m)" if self.turns else "mm/kN"

    @property
    def compliance(self) -> float:
        """Compliance in this unit."""
        return self.of.compliance * (1e3 if self.turns else 1e6)

    @property
    def stiffness(self) -> float | None:
        """Stiffness, N/µm or N·m/mrad."""
        return None if self.of.stiffness is None else self.of.stiffness * (1e-3 if self.turns else 1e-6)

    @property
    def robots(self) -> str | None:
        """95 % quantile over robots with its interval, as text; alone where all robots are alike."""
        value, interval = self.of.law.quantiles[0.95], self.of.law.quantile_interval[0.95]
        if value is None or interval is None:
            return None
        per_si, low, high = 1e3 if self.turns else 1e6, *interval
        alike = high - low <= _STRAIGHT * high
        return number(per_si * value) + ("" if alike else f" {bracketed(low, high, per_si)}")


@dataclass(frozen=True, eq=False)
class PoseStiffness(Record):
    """Stiffness at one pose.

    Attributes:
        position: Target in the base, ``(3,)``, m.
        compliance: C, ``(6, 6)``, base axes, every parameter at its mean: m/N, m/(N·m), rad/N, rad/(N·m).
        compliance_interval: Ends between which 95 % of the robots have each entry, with the stated confidence, ``(6, 6, 2)``;
            None for too few robots.
        axes, softest: Along the axes, and in the softest direction.
        rotation, softest_rotation: The same for moments.
        sources: The elastic sources, the largest part in the softest direction first.
        static_compliance: By sign and axis, such as ``+x``; empty without a rated load.
        dead_band: Joints that friction holds.
        solved_difference: Largest relative difference of the law from the softest and the stiffest robot solved one by one;
            None with nominal statics, where the law is exact.
    """

    pose: PoseLabel
    position: Array
    compliance: Array
    compliance_interval: Array | None
    axes: tuple[Direction, ...]
    softest: Direction
    rotation: tuple[Direction, ...]
    softest_rotation: Direction
    sources: tuple[ElasticPart, ...]
    static_compliance: Mapping[str, LoadSteps]
    dead_band: tuple[HeldJoint, ...]
    goal: Goal | None
    solved_difference: float | None

    @property
    def band(self) -> Array:
        """Dead band of all joints together along each axis, m."""
        return np.asarray(sum((held.axes for held in self.dead_band), np.zeros(len(self.axes))))

    @property
    def largest(self) -> tuple[float, str, float]:
        """Largest displacement along a force, m, its axis with sign, and the force; without a rated load of 100 N."""
        if not self.static_compliance:
            return 100.0 * self.softest.compliance, "", 100.0
        ends = {name: steps.compliance[-1] * steps.rated for name, steps in self.static_compliance.items()}
        name = max(ends, key=ends.__getitem__)
        return float(ends[name]), name, self.static_compliance[name].rated


def number(value: float) -> str:
    """Return a number of four digits, rounding as zero."""
    return f"{0.0 if abs(value) < _ROUNDING else value:.4g}"


def per_kilonewton(compliance: float) -> str:
    """Return a compliance in mm/kN as text."""
    return number(1e6 * compliance)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class StiffnessResult(AnalysisResult):
    """Stiffness at one or several poses, along the axes of ``directions``: ``base``, ``tool`` or a vector."""

    schema: ClassVar[str] = "precision-pin/stiffness/1"
    KEYS: ClassVar[Keys] = (
        *("*head", "directions", "rated", "robots", "confidence"),
        *("assumptions", "warnings", "findings", "poses"),
    )
    COLUMNS: ClassVar = (
        Column("quantity", text="", notebook="", report=""),
        Column("unit", text="", notebook="unit", report="unit", is_words=True),
        Column("compliance", number, "compliance", "compliance", "compliance"),
        Column("of.compliance", frame="compliance"),
        Column("stiffness", number, "N/µm, N·m/mrad", "N/µm, N·m/mrad", "N/µm, N·m/mrad"),
        Column("of.law.mean", frame="mean"),
        Column("of.law.std", frame="std"),
        Column(
            lambda row: (row.of.law.quantiles[0.95], row.of.law.quantile_interval[0.95]), frame="q95", has_interval=True
        ),
        Column("robots", text="95 % of robots", notebook="95 % of robots", report="95 % of robots"),
        Column("plus", per_kilonewton, "static, +", "static, +", "static, +", "static_plus"),
        Column("minus", per_kilonewton, "static, -", "static, -", "static, -", "static_minus"),
        Column("band", milli, "dead band mm", "dead band mm", "dead band mm", "dead_band"),
    )

    directions: str | Array
    rated: float | None
    robots: int
    confidence: float
    poses: tuple[PoseStiffness, ...]

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Assumptions of the numbers, one sentence each."""
        return (
            "a stiffness along an axis is one over the compliance: force along the axis, free sideways",
            "a joint, bearing or link without a stiffness in the sheet is rigid",
            "a force acts on the tip's link at the target and keeps its direction; friction counts in the dead band only",
            "a dead band is the displacement that friction may prevent when a force comes after the stop",
            "law: what differs between robots, each visit's draws at their means",
        )

    @property
    def goal(self) -> float | None:
        """Largest compliance wanted, m/N."""
        first = self.poses[0].goal
        return None if first is None else first.limit

    @property
    def named_axes(self) -> str:
        """Axes as text."""
        if isinstance(self.directions, str):
            return f"{self.directions} axes"
        return f"along {vector_text(self.directions)}"

    @property
    def labels(self) -> list[str]:
        """Distinct names of the poses."""
        return pose_labels([entry.pose.name for entry in self.poses])

    @property
    def softest_pose(self) -> int:
        """Index of the pose with the largest compliance."""
        return int(np.argmax([pose.softest.compliance for pose in self.poses]))

    def rows(self, pose: PoseStiffness) -> list[Row]:
        """Return a row for each axis and for the softest direction, of displacements and of rotations."""
        ends = {name: float(steps.compliance[-1]) for name, steps in pose.static_compliance.items()}
        bands = pose.band if pose.dead_band else [None] * len(pose.axes)
        rows = [
            Row(entry.axis, entry, False, ends.get(f"+{entry.axis}"), ends.get(f"-{entry.axis}"), band)
            for entry, band in zip(pose.axes, bands, strict=True)
        ]
        rows.append(Row("softest", pose.softest, False))
        rows += [Row(f"about {entry.axis}", entry, True) for entry in pose.rotation]
        return [*rows, Row("about softest", pose.softest_rotation, True)]

    def to_pandas(self) -> pandas.DataFrame:
        """Return the result as a data frame, SI: a row for each pose and axis.

        The columns are ``compliance``, ``mean`` and ``std`` over robots, ``q95`` with ``_lower`` and ``_upper``, at the rated
        load ``static_plus`` and ``static_minus``, and ``dead_band``. ``attrs`` gives the settings.
        """
        joints = {label: dict(entry.pose.q) for label, entry in zip(self.labels, self.poses, strict=True)}
        lines = [
            ((label, row.quantity), frame_row(self.COLUMNS, row))
            for label, pose in zip(self.labels, self.poses, strict=True)
            for row in self.rows(pose)
        ]
        return data_frame(["pose", "quantity"], lines, self.settings() | {"poses": joints})

    @property
    def summary(self) -> str:
        """Text of `repr`."""
        softest = 1e6 * self.poses[self.softest_pose].softest.compliance
        return (
            f"poses {len(self.poses)}, softest {softest:.4g} mm/kN, {self.robots:,} robots, seed {self.provenance.seed}"
        )

    @property
    def how(self) -> str:
        """Settings as text."""
        return (
            f"{self.named_axes}, statics {self.provenance.statics}; {self.robots:,} robots, seed {self.provenance.seed}, "
            f"intervals at {100 * self.confidence:g} % confidence"
        )

    def _repr_html_(self) -> str:
        hidden = len(self.poses) - MOST_POSES
        tables = [
            notebook_table(self.COLUMNS, self.rows(pose), name_pose(pose.pose)) for pose in self.poses[:MOST_POSES]
        ]
        more = [f"… and {hidden:,} more poses"] if hidden > 0 else []
        return rendered(f"Stiffness of {self.provenance.arm}", tables, [*more, self.how, *self.warnings])


def vector_text(vector: Array) -> str:
    """Return a direction as text."""
    return "({})".format(" ".join(f"{round(float(part), 2) + 0.0:g}" for part in vector))


@warns_at_end
@takes_datum
def stiffness(
    model: ErrorModel,
    poses: Poses | PoseSet = None,
    *,
    rated: float | str | None = None,
    axes: Literal["base", "tool"] | Sequence[float] | Array = "base",
    goal: float | str | None = None,
    robots: int = 1000,
    seed: int = 0,
    confidence: float = 0.95,
    findings: Sequence[Finding] = (),
    progress: Progress | bool | None = None,
) -> StiffnessResult:
    """Return how far the target gives way under a force, by direction and by elastic source.

    It follows the model's statics; a datum changes nothing, since it is found before the force comes.

    Args:
        model: Chain, draws and sources.
        poses: A pose (name, joint values, or None for the first), a list of poses, or a grid of them.
        rated: Largest force of the static compliance of ISO 9283, N or with a unit; by default only tangents.
        axes: Axes of the forces: ``"base"``, ``"tool"``, or one direction in base axes.
        goal: Largest compliance wanted, m/N or with a unit: in the softest direction, or along the one given.
        robots: Number of built robots of the law.
        seed, confidence: Seed of the robots, confidence of each interval.
        findings: Warnings to include in the result, such as those of the sheet.
        progress: Function called with the number of poses added since its last call; ``True`` shows a bar.

    Raises:
        InputError: A wrong argument, nothing in the model gives way, or the arm does not come to rest under a force.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> pose = pp.stiffness(model, robots=100).poses[0]
        >>> print(f"{1e6 * pose.softest.compliance:.0f} mm/kN, most by {pose.sources[0].source}")
        2208 mm/kN, most by beam[link2]
    """
    findings = check_common(model, seed=seed, confidence=confidence, findings=findings, progress=progress)
    check_whole("robots", robots, 1, MOST_ROBOTS)
    force = _positive("rated", rated, FORCE)
    if isinstance(axes, str):
        check_choice("axes", axes, ("base", "tool"))
        directions: str | Array = axes
    else:
        given = check_numbers("axes", axes, (3,), "base, tool or the 3 numbers of a direction")
        if not given.any():
            raise InputError("axes: the direction is zero; give base, tool or a direction such as 1 0 1")
        directions = given / np.linalg.norm(given)
    x = model.bare.space.sample(seed, 0, robots)
    visits = model.bare.space.has_scope(Scope.VISIT)
    x[visits] = model.bare.space.mean[visits, None]
    load = _Loading(
        model, directions, force, _positive("goal", goal, LINEAR_COMPLIANCE), x, confidence, Elasticity(model)
    )
    names, pose_list, warnings = _listed(model, poses)
    values = np.column_stack([model.configuration(pose) for pose in pose_list])
    doubts = pose_findings(model.chain, values, names) if len(names) > 1 else model.chain.at(values[:, 0]).findings
    add(doubts)
    warnings += map(str, doubts)
    with steps_to(progress, len(pose_list), "poses") as step:
        entries: list[PoseStiffness] = []
        softest, softest_arm = 0, None
        for k, elastic in enumerate(stepped(load.elasticity.at_many(pose_list), step)):
            entries.append(load.at(names[k], pose_list[k], elastic))
            if softest_arm is None or entries[k].softest.compliance > entries[softest].softest.compliance:
                softest, softest_arm = k, elastic
    assert softest_arm is not None
    difference = load.difference(pose_list[softest], softest_arm)
    entries[softest] = replace(entries[softest], solved_difference=difference)
    if difference is not None and difference > _DIFFERENT:
        warnings += [
            f"robots solved one by one differ from the law by {difference:.2%}: stiffnesses or loads vary too much for "
            "the rest of the mean robot"
        ]
    return StiffnessResult(
        provenance=Provenance.of(model, seed),
        robots=int(robots),
        confidence=confidence,
        directions=directions,
        rated=force,
        poses=tuple(entries),
        findings=findings,
        warnings=list_warnings(findings, warnings),
    )


def _listed(model: ErrorModel, poses: Poses | PoseSet) -> tuple[Sequence[str], list[Pose], list[str]]:
    """Return names and poses in order, and a line about those without joint values."""
    if not isinstance(poses, PoseSet):
        pose_list = listed_poses(poses)
        return [model.pose_name(pose) for pose in pose_list], pose_list, []
    known = poses.of(poses.known)
    return known.names, list(approached(known)), [poses.unreached] * (poses.unreached != "")


def _positive(name: str, value: float | str | None, quantity: Quantity) -> float | None:
    number = None if value is None else check_quantity(name, value, quantity)
    if number is not None and not 0 < number < math.inf:
        raise InputError(f"{name} must be positive, got {number:g} {quantity.si}")
    return number


@dataclass(frozen=True, eq=False)
class _Loading:
    """Loading of the arm along given directions, for robots ``x`` ``(d, N)``."""

    model: ErrorModel
    directions: str | Array
    rated: float | None
    goal: float | None
    x: Array
    confidence: float
    elasticity: Elasticity

    @cached_property
    def mean(self) -> Array:
        """Every component at its mean, ``(d, 1)``."""
        return self.model.bare.space.mean[:, None]

    def at(self, name: str, pose: Pose, elastic: ElasticPose) -> PoseStiffness:
        """Return the stiffness at a pose."""
        if not elastic.labels:
            raise InputError(
                "nothing in the sheet gives way under a load, so the arm has no stiffness: add the flexibility of a joint, a "
                "gear, a servo, a bearing or a link"
            )
        by_source = elastic.by_source(self.mean)[..., 0]
        whole = by_source.sum(axis=0)
        sampled = elastic.whole(self.x)
        names, axes = self._axes(elastic)
        moves, turns = whole[:3, :3], whole[3:, 3:]
        softest = self._softest(moves, sampled[:3, :3])
        return PoseStiffness(
            pose=replace(PoseLabel.of(self.model, pose, elastic), name=name),
            position=elastic.posture.pose[:3, 3],
            compliance=whole,
            compliance_interval=self._interval(sampled),
            axes=self._along(names, axes, moves, sampled[:3, :3]),
            softest=softest,
            rotation=self._along(names, axes, turns, sampled[3:, 3:]),
            softest_rotation=self._softest(turns, sampled[3:, 3:]),
            sources=self._parts(elastic.labels, by_source[:, :3, :3], softest, axes),
            static_compliance=self._steps(elastic, whole, names, axes),
            dead_band=self._held(elastic, axes),
            goal=self._judged(moves, sampled[:3, :3]),
            solved_difference=None,
        )

    def _axes(self, elastic: ElasticPose) -> tuple[tuple[str, ...], Array]:
        if not isinstance(self.directions, str):
            return ("along",), self.directions[None]
        return ("x", "y", "z"), np.eye(3) if self.directions == "base" else elastic.posture.tool_axes.T

    def _along(self, names: Sequence[str], axes: Array, block: Array, sampled: Array) -> tuple[Direction, ...]:
        return tuple(
            Direction(name, u, float(u @ block @ u), self._law(np.einsum("i,ijn,j->n", u, sampled, u)))
            for name, u in zip(names, axes, strict=True)
        )

    def _softest(self, block: Array, sampled: Array) -> Direction:
        sizes, vectors = np.linalg.eigh((block + block.T) / 2)
        u = vectors[:, -1] * np.sign(vectors[np.abs(vectors[:, -1]).argmax(), -1])
        return Direction("softest", u, float(sizes[-1]), self._law(_largest(sampled)))

    def _law(self, values: Array) -> RobotLaw:
        law = SampleLaw(values, self.confidence, LEVELS)
        return RobotLaw(law.mean, law.std, law.quantiles, law.intervals)

    def _interval(self, sampled: Array) -> Array | None:
        ranks = tolerance_ranks(sampled.shape[-1], CONTENT, self.confidence)
        if ranks is None:
            return None
        ends = [ranks[0] - 1, ranks[1] - 1]
        return np.partition(sampled, ends, axis=-1)[..., ends]

    def _parts(self, labels: Sequence[str], blocks: Array, softest: Direction, axes: Array) -> tuple[ElasticPart, ...]:
        parts = np.einsum("i,lij,j->l", softest.direction, blocks, softest.direction)
        along = np.einsum("ki,lij,kj->lk", axes, blocks, axes)
        share = parts / softest.compliance if softest.compliance > 0 else np.zeros(len(labels))
        split = [None] * len(labels) if self.goal is None else split_goal(self._wanted(blocks), self.goal).tolist()
        entries = [
            ElasticPart(label, float(parts[k]), float(share[k]), along[k], self._factor(blocks, k), split[k])
            for k, label in enumerate(labels)
        ]
        return tuple(sorted(entries, key=lambda entry: -entry.compliance))

    def _wanted(self, block: Array) -> Array:
        """Return the part of blocks ``([M,] 3, 3)`` that the goal limits: all, or along the given direction ``([M,] 1, 1)``."""
        block = (block + np.swapaxes(block, -1, -2)) / 2
        return block if isinstance(self.directions, str) else self.directions[None] @ block @ self.directions[:, None]

    def _factor(self, blocks: Array, source: int) -> float | None:
        """Return the smallest f with C - C_e + C_e/f ≤ the goal in every direction."""
        if self.goal is None:
            return None
        part = self._wanted(blocks[source])
        room = self.goal * np.eye(len(part)) - (self._wanted(blocks.sum(axis=0)) - part)
        if np.linalg.eigvalsh(room)[0] <= 0:
            return None
        return max(float(eigh(part, room, eigvals_only=True)[-1]), 1.0)

    def _judged(self, block: Array, sampled: Array) -> Goal | None:
        if self.goal is None:
            return None
        wanted = float(np.linalg.eigvalsh(self._wanted(block))[-1])
        if isinstance(self.directions, str):
            values = _largest(sampled)
        else:
            values = np.einsum("i,ijn,j->n", self.directions, sampled, self.directions)
        inside = int((values <= self.goal).sum())
        interval = clopper_pearson(inside, len(values), self.confidence)
        return Goal(self.goal, max(wanted / self.goal, 1.0), inside / len(values), interval)

    def _steps(self, elastic: ElasticPose, whole: Array, names: Sequence[str], axes: Array) -> dict[str, LoadSteps]:
        if self.rated is None:
            return {}
        forces, result = self.rated * np.arange(1, STEPS + 1) / STEPS, {}
        start = self.elasticity.error(elastic.posture)[:3]
        for name, u in zip(names, axes, strict=True):
            for sign in (1.0, -1.0):
                tangent = np.outer(forces, whole[:3, :3] @ u * sign)
                end = self._position(elastic, self.rated, sign * u) - start
                if np.abs(end - tangent[-1]).max() > _STRAIGHT * np.abs(tangent[-1]).max():
                    tangent[-1] = end
                    for k, force in enumerate(forces[:-1]):
                        tangent[k] = self._position(elastic, float(force), sign * u) - start
                along = tangent @ u * sign / forces
                result[f"{'+' if sign > 0 else '-'}{name}"] = LoadSteps(
                    self.rated / STEPS, self.rated, forces, tangent, along
                )
        return result

    def _position(self, elastic: ElasticPose, force: float, u: Array) -> Array:
        try:
            return self.elasticity.error(elastic.posture, np.concatenate([force * u, np.zeros(3)]))[:3]
        except InputError as error:
            raise InputError(f"under {force:g} N along {vector_text(u)}: {error.findings[0].message}") from None

    def _held(self, elastic: ElasticPose, axes: Array) -> tuple[HeldJoint, ...]:
        posture = elastic.posture
        names, reach = posture.chain.joint_names, np.abs(axes @ posture.joint_jacobian[:3])
        bands = self.elasticity.dead_bands(posture)
        return tuple(
            HeldJoint(label, names[joint], band, reach[:, joint] * band) for label, (joint, band) in bands.items()
        )

    def difference(self, pose: Pose, elastic: ElasticPose) -> float | None:
        """Return the largest relative difference of the law at a pose from its softest and stiffest robot solved alone."""
        if self.elasticity.statics == "nominal":
            return None
        sizes, largest = _largest(elastic.whole(self.x)[:3, :3]), 0.0
        for robot in (int(sizes.argmin()), int(sizes.argmax())):
            x = self.x[:, robot]
            alone = _largest(self.elasticity.at(pose, x).whole(x[:, None])[:3, :3])[0]
            largest = max(largest, abs(float(sizes[robot] / alone) - 1))
        return largest


def _largest(blocks: Array) -> Array:
    """Return the largest eigenvalue of the symmetric part of each of ``(3, 3, N)`` (Smith, Communications of the ACM 4, 1961)."""
    (a, d, e), (g, b, f), (h, i, c) = blocks
    d, e, f, middle = (d + g) / 2, (e + h) / 2, (f + i) / 2, (a + b + c) / 3
    a, b, c = a - middle, b - middle, c - middle
    spread = np.sqrt((a * a + b * b + c * c + 2 * (d * d + e * e + f * f)) / 6)
    determinant = a * (b * c - f * f) - d * (d * c - e * f) + e * (d * f - e * b)
    cosine = np.clip(determinant / (2 * np.where(spread > 0, spread, 1.0) ** 3), -1.0, 1.0)
    return np.asarray(middle + 2 * spread * np.cos(np.arccos(cosine) / 3))


_ROUNDS: Final = 50
"""Directions at most that limit a split of the goal; each is the softest of the split before."""
_KEPT: Final = 1e-6
"""Relative excess of a goal that counts as kept."""


def split_goal(blocks: Array, goal: float) -> Array:
    """Return the factors f ≥ 1 ``(M,)`` of least sum with Σ C_e/f_e ≤ the goal in every direction, for ``(M, k, k)``.

    The problem is convex in 1/f. The goal is asked for in the softest direction of the last solution, one after another.
    """
    shares, directions = np.ones(len(blocks)), np.zeros((0, blocks.shape[1]))
    for _ in range(_ROUNDS):
        sizes, vectors = np.linalg.eigh(np.einsum("m,mij->ij", shares, blocks))
        if sizes[-1] <= goal * (1 + _KEPT):
            break
        directions = np.vstack([directions, vectors[:, -1]])
        rows = np.einsum("di,mij,dj->dm", directions, blocks, directions) / goal
        limits = {"type": "ineq", "fun": lambda x, rows=rows: 1 - rows @ x, "jac": lambda x, rows=rows: -rows}
        # a start that keeps the goal in every direction so far
        start = np.minimum(shares, 1 / rows.sum(axis=1).max())
        bounds = [(1e-6, 1.0)] * len(blocks)
        shares = minimize(
            lambda x: (1 / x).sum(), start, jac=lambda x: -1 / x**2, bounds=bounds, constraints=limits,
            method="SLSQP", options={"maxiter": 500, "ftol": 1e-12},
        ).x  # fmt: skip
    return np.asarray(1 / shares)
