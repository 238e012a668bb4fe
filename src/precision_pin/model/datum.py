"""The error model in a datum: draws of the procedures, what they add at a pose, and robots solved one by one."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, ClassVar, Final, Protocol

import numpy as np

from precision_pin.base import se3
from precision_pin.base.arrays import Array, Keys, Record
from precision_pin.base.errors import InputError
from precision_pin.draws.correlation import Correlation
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.expressions import renamed
from precision_pin.draws.laws import Normal
from precision_pin.draws.space import Space
from precision_pin.model.pose_model import DatumPart, PoseModel
from precision_pin.robot.chain import Chain
from precision_pin.robot.datums import Compensated, Datum, Found, Maps
from precision_pin.robot.places import ORDER_FRAME, Place
from precision_pin.terms import LabelledSpace, Posture, Setting, Source, Term, units
from precision_pin.terms.table import TableLayout
from precision_pin.terms.term import JointValue, Target

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

_AXES: Final = ("x", "y", "z", "rx", "ry", "rz")
_STEPS: Final = 12
"""Newton steps of a search for joint values at most."""
_REACHED: Final = 1e-11
"""Distance, m, or angle, rad, that counts as none."""
_NO_SPREAD: Final = 1e-12
"""Standard deviation, m or rad, that counts as none."""


@dataclass(frozen=True)
class Procedure(Source):
    """Draws of the procedure that finds a datum: its noise, and the robot's draws at each visit of its own."""

    name: str
    draws_of_visits: tuple[Setting, ...]

    @property
    def subject(self) -> str:
        """Name of the datum."""
        return self.name

    def label(self) -> str:
        """Return ``datum[name]``."""
        return f"datum[{self.name}]"

    def places(self, label: str) -> dict[str, str]:
        """Return what each component is, such as ``3 x``: noise of the third reading along x."""
        names = [name for draw in self.draws(label) for name in draw.components]
        return {name: name.removeprefix(f"{label}.") for name in names}

    def describe(self, setting: str) -> str:
        """Return the description of a draw."""
        return f"{setting} of datum {self.name}"

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield nothing: the errors of the procedure are added by the model."""
        return iter(())


def procedure_of(datum: Datum, space: Space) -> tuple[Procedure, tuple[Correlation, ...]]:
    """Return the draws that a datum adds to a space, and their correlations.

    A draw of pose or visit scope is drawn anew for each visit, once per robot.
    """
    visit_draws = [draw for draw in space.draws if draw.scope is not Scope.UNIT]
    draws: list[Draw] = []
    groups: list[Correlation] = []
    for visit in range(len(datum.visits)):
        names = _names_at(datum, visit, visit_draws)
        for draw in visit_draws:
            components = tuple(names[name] for name in draw.components)
            copy = replace(draw, name=_name_at(datum, visit, draw.name), scope=Scope.UNIT, names=components)
            draws.append(copy)
        groups += [
            replace(group, names=tuple(_name_at(datum, visit, name) for name in group.names))
            for group in space.correlations
            if any(draw.name in group.names for draw in visit_draws)
        ]
    for number, (_, std) in enumerate(datum.noise):
        for axis, value in enumerate(std.tolist()):
            if value > 0:
                quantity = units.LENGTH if axis < 3 else units.ANGLE
                draws.append(Draw(_noise_name(datum, number, axis), Normal(value), quantities=(quantity,)))
    return Procedure(datum.name, tuple(draws)), tuple(groups)


def _name_at(datum: Datum, visit: int, name: str) -> str:
    return f"{datum.label}.{visit + 1} {name}"


def _names_at(datum: Datum, visit: int, draws: Sequence[Draw]) -> dict[str, str]:
    return {name: _name_at(datum, visit, name) for draw in draws for name in draw.components}


def _noise_name(datum: Datum, number: int, axis: int) -> str:
    return f"{datum.label}.{datum.noise[number][0]} {_AXES[axis]}"


@dataclass(frozen=True, eq=False)
class DatumEffect(Record):
    """First-order parts of the variances of position (m²) and attitude (rad²) against datums, each ``(2,)``.

    Attributes:
        robot: Variance in base axes, by the robot's errors at the task.
        procedure: Variance of the datum, by its errors at the visits.
        common: Twice the covariance of both, negative if they cancel.
        visits: Variance of the datum, by draws made anew at each visit.
        noise: Variance of the datum, by the noise of the procedures.
    """

    KEYS: ClassVar[Keys] = (
        *("without", "with_datum", "cancelled", "on_top", "robot", "procedure", "common", "visits", "noise"),
    )

    robot: Array
    procedure: Array
    common: Array
    visits: Array
    noise: Array

    @classmethod
    def of(cls, at: PoseModel) -> DatumEffect:
        """Return the effect of the datums of a model at a pose."""
        assert at.datum is not None
        labels, noise = tuple(f"{datum.label}." for datum in at.datum.procedures.datums), at.datum.noise
        is_robot = np.array([not name.startswith(labels) for name in at.space.components])
        slopes = sum((gain @ visit.jacobian for gain, visit in at.datum.counted), np.zeros_like(noise))
        task, procedure, visits = at.arm.jacobian, np.where(is_robot, slopes, 0.0), np.where(is_robot, 0.0, slopes)

        def variance(left: Array, right: Array) -> Array:
            return np.diag(at.space.block_covariance.between(left, right)).reshape(2, 3).sum(axis=1)

        pairs = ((task, task), (procedure, procedure), (2 * task, procedure), (visits, visits), (noise, noise))
        return cls(*(variance(*pair) for pair in pairs))

    @property
    def without(self) -> Array:
        """Root of the variances in base axes, ``(2,)``, m and rad."""
        return np.sqrt(self.robot)

    @property
    def total(self) -> Array:
        """Variances against the datums, ``(2,)``, m² and rad²."""
        return np.maximum(self.robot + self.procedure + self.common + self.visits + self.noise, 0.0)

    @property
    def with_datum(self) -> Array:
        """Root of the variances against the datums, ``(2,)``, m and rad."""
        return np.sqrt(self.total)

    @property
    def on_top(self) -> Array:
        """Root of the variances that cannot cancel, by draws of the procedures, ``(2,)``, m and rad."""
        return np.sqrt(self.visits + self.noise)

    @property
    def cancelled(self) -> Array:
        """Share of the variances in base axes that cancels, ``(2,)``; negative if they grow, NaN if there are none."""
        return -(self.procedure + self.common) / np.where(self.without > _NO_SPREAD, self.robot, np.nan)

    @property
    def text(self) -> str:
        """What cancelled and what came on top, of the position; and which vector the datums make worse."""
        share, before, after = self.cancelled[0], self.without, self.with_datum
        part = f"{'all' if share > 1 - 1e-9 else f'{min(100 * share, 99.9):.3g} %'} of the variance of d cancelled"
        if share < 0:
            part = f"nothing cancelled, the robot's errors in the procedure added {-100 * share:.3g} % to the variance of d"
        elif np.isnan(share):
            part = "d does not vary in base axes"
        worse = "".join(
            f"; the datum makes {name} worse: {1e3 * after[k]:.3g} {unit} rms instead of {1e3 * before[k]:.3g}"
            for k, (name, unit) in enumerate((("d", "mm"), ("δ", "mrad")))
            if after[k] > before[k] + _NO_SPREAD
        )
        return f"{part}, {1e3 * self.on_top[0]:.3g} mm rms came on top{worse}"


@dataclass(frozen=True, eq=False)
class DatumRecord(Record):
    """What the errors of a result are counted against.

    Attributes:
        name, kind: Names of the datums and of their procedures, in order.
        poses: Each visit, by name or joint values.
        linearity: Relative differences from robots solved one by one, :attr:`PoseModel.linearity`.
        effect: Parts of the variance at the same pose; None without poses.
        base_axes: ``samples``, the number of robots of the same sample that are counted in base axes; ``quantile_95`` of
            their |d| and |δ|, m and rad, with ``interval`` at 95 % confidence. None if not sampled or not resolved.
    """

    KEYS: ClassVar[Keys] = ("name", "kind", "poses", "linearity", "effect", "base_axes")

    name: str
    kind: str
    poses: tuple[str | tuple[float, ...], ...]
    linearity: Mapping[str, float] | None
    effect: DatumEffect | None = None
    base_axes: Mapping[str, Any] | None = None

    @classmethod
    def of(cls, datums: Sequence[Datum], at: PoseModel | None) -> DatumRecord | None:
        """Return the record of datums at a pose; None for base axes."""
        if not datums:
            return None
        visits = (visit for datum in datums for visit in datum.visits)
        poses = tuple(visit if isinstance(visit, str) else tuple(np.ravel(visit).tolist()) for visit in visits)
        names, kinds = (", ".join(getattr(datum, key) for datum in datums) for key in ("name", "kind"))
        if at is None:
            return cls(names, kinds, poses, None)
        return cls(names, kinds, poses, at.linearity, DatumEffect.of(at) if poses else None)

    @property
    def text(self) -> str:
        """Name and kind, for the first line of a table."""
        return f", against datum {self.name}" + ("" if self.kind == self.name else f" ({self.kind})")

    @property
    def procedure_text(self) -> str:
        """Names, kinds and number of poses, for a sentence about the effect."""
        if not self.poses:
            return f"against datum {self.name}"
        kind = "" if self.kind == self.name else f"{self.kind}, "
        return f"against datum {self.name} ({kind}{len(self.poses)} pose{'s'[: len(self.poses) - 1]})"


def datum_text(record: DatumRecord | None) -> str:
    """Return what the first line of a table says of the datum."""
    return "" if record is None else record.text


@dataclass(frozen=True, eq=False)
class _Visit:
    """A visit of a procedure.

    Attributes:
        q: Joint values.
        link, frame: Chain link, and the tip, flange or point in its axes.
        place: Tip, flange or point in the base.
        at: The model of its error.
        is_tip: Whether it is the tip, which moves with the tool found.
    """

    q: Array
    link: int
    frame: Array
    place: Array
    at: PoseModel
    is_tip: bool


class ArmModel(Protocol):
    """An error model in base axes, as the procedures use it."""

    @property
    def chain(self) -> Chain:
        """The arm."""

    @property
    def space(self) -> Space:
        """Its draws."""

    def at(self, q: Any = None) -> PoseModel:
        """Return the model at a pose."""


class Procedures:
    """The procedures of a model's datums, in the order in which they are done.

    Args:
        arm: The model in base axes.
        space: Its space with the draws of the procedures.
        datums: The datums.
    """

    def __init__(self, arm: ArmModel, space: Space, datums: Sequence[Datum]) -> None:
        self.arm, self.space = arm, space
        self.datums = tuple(datums)
        self._keeps_attitude = len(arm.chain.joints) < 6
        self._first = np.cumsum([0, *(len(datum.visits) for datum in self.datums)]).tolist()
        self._added_at: dict[int, tuple[Array, Array]] = {}
        self._first_noise = np.cumsum([0, *(len(datum.noise) for datum in self.datums)]).tolist()

    @cached_property
    def visits(self) -> tuple[_Visit, ...]:
        """The visits of all procedures."""
        return tuple(self._visit(datum, k) for datum in self.datums for k in range(len(datum.visits)))

    def check(self) -> None:
        """Raise if visits are unknown or do not determine a datum."""
        assert len(self._maps) == len(self.datums)

    def by_datum(self) -> Iterator[tuple[Datum, Array, Array]]:
        """Yield each datum, its places and nominal tips, ``(V, 4, 4)``."""
        for datum, (a, b) in zip(self.datums, itertools.pairwise(self._first), strict=True):
            visits = self.visits[a:b]
            yield datum, np.array([v.place for v in visits]), np.array([v.at.posture.pose for v in visits])

    @cached_property
    def _maps(self) -> tuple[Maps, ...]:
        return tuple(datum.maps(places) for datum, places, _ in self.by_datum())

    def _added(self, count: int, place: Array, q: Array, *, is_tip: bool = True) -> tuple[Array, Array]:
        """Return the gains ``(V, 6, 6)`` of all visits and ``(M, 6, 6)`` of all noise after the first datums."""
        gains, noise = np.zeros((self._first[-1], 6, 6)), np.zeros((self._first_noise[-1], 6, 6))
        for number, datum in reversed(list(enumerate(self.datums[:count]))):
            if datum.moves_tool and not is_tip:
                continue
            datum_gains, datum_noise = self._maps[number](place, datum.view_of(q))
            # a camera sees where the hand is, not whether it could be turned as commanded
            if self._keeps_attitude and datum.is_commanded and count == len(self.datums):
                datum_gains[:, 3:], datum_noise[:, 3:] = 0.0, 0.0
            first, first_noise = self._first[number], self._first_noise[number]
            gains[first : first + len(datum_gains)] += datum_gains
            noise[first_noise : first_noise + len(datum_noise)] += datum_noise
            for k, gain in enumerate(datum_gains if number else ()):
                before, before_noise = self._before(number, first + k)
                gains += gain @ before
                noise += gain @ before_noise
        return gains, noise

    def _before(self, number: int, visit: int) -> tuple[Array, Array]:
        """Return what the datums before a datum add at one of its visits."""
        if visit not in self._added_at:
            entry = self.visits[visit]
            self._added_at[visit] = self._added(number, entry.place, entry.q, is_tip=entry.is_tip)
        return self._added_at[visit]

    def part(self, at: PoseModel) -> DatumPart:
        """Return what the datums add to the error of the arm at a pose."""
        gains, noise = self._added(len(self.datums), at.posture.pose, at.posture.q)
        slopes = np.zeros((6, self.space.size))
        for number, axis, column in self._noise_columns:
            slopes[:, column] += noise[number, :, axis]
        return self._less_known(at, DatumPart(tuple(visit.at for visit in self.visits), gains, slopes, self))

    def in_base_axes(self, at: PoseModel) -> PoseModel:
        """Return the model of the arm at a pose in base axes, compensated too if there is another datum."""
        if self._compensated is None or len(self.datums) == 1:
            return at.arm
        nothing = DatumPart((), np.zeros((0, 6, 6)), np.zeros((6, self.space.size)), self)
        return replace(at, datum=self._less_known(at.arm, nothing))

    def _less_known(self, at: PoseModel, part: DatumPart) -> DatumPart:
        """Return the part with the error at the means subtracted, if a controller knows it."""
        if self._compensated is None:
            return part
        known = np.zeros((1, 6, 6))
        known[0, :, 0] = -replace(at, datum=part).error_at_means
        if not self._compensated.turns:
            known[0, 3:] = 0.0
        return replace(part, visits=(*part.visits, self._one_metre), gains=np.concatenate([part.gains, known]))

    @property
    def _compensated(self) -> Compensated | None:
        return next((datum for datum in self.datums if isinstance(datum, Compensated)), None)

    @cached_property
    def _one_metre(self) -> PoseModel:
        """A visit with the error 1 m along x: its gain at a pose is a constant that is added there."""
        posture = self.arm.chain.at(np.zeros(len(self.arm.chain.joints)))
        terms = (Term.of(Place.start(0, self.arm.chain.base), [1.0, 0, 0, 0, 0, 0]),)
        table = TableLayout.of(terms, self.space).at(posture, terms)
        return PoseModel(posture, self.space, table, terms)

    @cached_property
    def _noise_columns(self) -> tuple[tuple[int, int, int], ...]:
        """Number of each draw of noise among all datums, its axis and its column."""
        index = self.space.index
        return tuple(
            (first + number, axis, index[_noise_name(datum, number, axis)])
            for datum, first in zip(self.datums, self._first_noise, strict=False)
            for number, (_, std) in enumerate(datum.noise)
            for axis in np.flatnonzero(std).tolist()
        )

    def _visit(self, datum: Datum, number: int) -> _Visit:
        """Return a visit, with the error of the tip or of the flange before what it carries."""
        at = self.arm.at(datum.visits[number])
        posture, chain = at.posture, self.arm.chain
        point = chain.target if datum.place is None else datum.place
        link, frame = len(chain.joints), chain.with_target(point).target_placement
        terms = tuple(at.terms)
        if datum.frame is not None:
            where = chain.link_frame(datum.frame)
            if where.path_rank is None:
                raise InputError(
                    f"datum {datum.name}: {datum.frame!r} is not on the path from {chain.base} to {chain.tip}"
                )
            link, frame = where.link, where.frame
            last = (link, ORDER_FRAME, where.path_rank)
            terms = tuple(term for term in terms if _moves(term.target, last))
        visit_draws = [draw for draw in self.arm.space.draws if draw.scope is not Scope.UNIT]
        names = _names_at(datum, number, visit_draws)
        if names:
            terms = tuple(replace(term, factors=tuple(renamed(f, names) for f in term.factors)) for term in terms)
        place = se3.compose(posture.link_poses[link], frame)
        table = replace(TableLayout.of(terms, self.space).at(posture, terms), pose=place)
        is_tip = datum.frame is None and datum.place is None
        return _Visit(posture.q, link, frame, place, PoseModel(posture, self.space, table, terms), is_tip)

    # robots solved one by one ------------------------------------------------------------------------------------

    def solved(self, at: PoseModel, x: Array) -> Array:
        """Return the errors ``(6, n)`` at a pose of robots that each carry out the procedures, without linearising.

        Args:
            at: The model at the task.
            x: Components ``(d, n)`` of the robots.
        """
        robots = _Robots(self, at, x)
        for number, datum in enumerate(self.datums):
            first, last = self._first[number], self._first[number + 1]
            places = np.array([visit.place for visit in self.visits[first:last]])
            noise = np.zeros((len(datum.noise), 6, x.shape[1]))
            for item, axis, column in self._noise_columns:
                if self._first_noise[number] <= item < self._first_noise[number + 1]:
                    noise[item - self._first_noise[number], axis] = x[column]
            robots.first = first
            task = at.posture.pose
            robots.take(datum.find(robots, places, noise, task, datum.view_of(at.posture.q)))
        assert at.datum is not None
        known = 0.0 if self._compensated is None else at.datum.gains[-1, :, :1]
        return robots.error() + known


def _moves(target: Target, last: tuple[int, int, int]) -> bool:
    """Return whether a target moves a frame at a point of the chain."""
    return target.joint < last[0] if isinstance(target, JointValue) else (target.link, *target.order) <= last


class _Robots:
    """Individual robots in their procedures; see :class:`precision_pin.robot.datums.Robots`."""

    def __init__(self, procedures: Procedures, at: PoseModel, x: Array) -> None:
        self._chain, self._x, self._count = procedures.arm.chain, x, x.shape[1]
        link, frame = len(self._chain.joints), self._chain.target_placement
        task = _Visit(at.posture.q, link, frame, at.posture.pose, at.arm, is_tip=True)
        self._visits = (*procedures.visits, task)
        self._displacements: dict[int, Array] = {}
        self.first = 0
        self._is_new = False
        self._tool = np.zeros((3, self._count))
        self._change = self._seen = np.broadcast_to(np.eye(4)[:, :, None], (4, 4, self._count))

    def true(self, visit: int, q: Array) -> Array:
        """Return where a visit's tip or flange truly is, in the datums found so far."""
        entry = self._visits[self.first + visit]
        table = entry.at.table
        links = self._links(q)
        number = self.first + visit
        if number not in self._displacements:
            products = table.products(table.program.evaluate(self._x))
            self._displacements[number] = table.displacements(products)
        displacements, motion = self._displacements[number], self._seen
        for target, twist in zip(table.targets, displacements, strict=True):
            link, frame = (
                (target.joint + 1, np.eye(4)) if isinstance(target, JointValue) else (target.link, target.frame)
            )
            place = se3.compose(links[link], frame)
            motion = se3.compose(motion, place, se3.displacement(twist), se3.inverse(place))
        return se3.compose(motion, links[entry.link], entry.frame)

    def read(self, visit: int, q: Array) -> Array:
        """Return where the controller believes it to be, in the frame found so far."""
        entry = self._visits[self.first + visit]
        place = se3.compose(se3.inverse(self._change), self._links(q)[entry.link], entry.frame)
        return se3.compose(place, se3.translation(self._tool)) if entry.is_tip else place

    def jog(self, visit: int, pose: Array) -> Array:
        """Return joint values at which the true pose is as wanted."""
        return self._search(visit, self.commanded(visit), partial(self.true, visit), pose)

    def touch(self, visit: int, position: Array) -> Array:
        """Return joint values at which the true position is as wanted, and the attitude is believed to be nominal."""

        def touched(q: Array) -> Array:
            return se3.pose(self.read(visit, q)[:3, :3], self.true(visit, q)[:3, 3])

        nominal = self._visits[self.first + visit].place[:3, :3, None]
        wanted = se3.pose(np.repeat(nominal, self._count, axis=2), position)
        return self._search(visit, self.commanded(visit), touched, wanted)

    def commanded(self, visit: int) -> Array:
        """Return the joint values at which the controller believes that a visit's nominal pose is reached."""
        entry = self._visits[self.first + visit]
        q = np.repeat(entry.q[:, None], self._count, axis=1)
        return self._search(visit, q, partial(self.read, visit), entry.place[:, :, None]) if self._is_new else q

    def take(self, correction: Found) -> None:
        """Let the robots use what a procedure has found."""
        if correction.change is not None:
            self._change = se3.compose(self._change, correction.change)
        if correction.tool is not None:
            self._tool = self._tool + correction.tool
        if correction.seen is not None:
            self._seen = se3.compose(correction.seen, self._seen)
        self._is_new = True

    def error(self) -> Array:
        """Return the errors ``(6, n)`` at the task."""
        self.first = len(self._visits) - 1
        true, nominal = self.true(0, self.commanded(0)), self._visits[-1].place
        turn = se3.log_rotation(np.einsum("ijn,kj->ikn", true[:3, :3], nominal[:3, :3]))
        return np.concatenate([true[:3, 3] - nominal[:3, 3, None], turn])

    def _links(self, q: Array) -> Array:
        poses = self._chain.at_columns(q).joint_poses
        return np.concatenate([np.broadcast_to(np.eye(4)[:, :, None], (1, 4, 4, q.shape[1])), poses])

    def _search(self, visit: int, q: Array, place: Callable[[Array], Array], wanted: Array) -> Array:
        """Return joint values at which a place is as wanted; an arm of fewer than six joints reaches the position only."""
        link = self._visits[self.first + visit].link
        rows = 6 if len(self._chain.joints) >= 6 else 3
        for _ in range(_STEPS):
            now = place(q)
            turn = se3.log_rotation(np.einsum("ij...,kj...->ik...", wanted[:3, :3], now[:3, :3]))
            change = np.concatenate([wanted[:3, 3] - now[:3, 3], turn])[:rows]
            if np.abs(change).max() < _REACHED:
                break
            arm = self._chain.at_columns(q)
            shifts, turns = np.split(arm.joint_jacobian[:, :link], 2)
            tip = se3.compose(arm.joint_poses[-1], self._chain.target_placement)[:3, 3]
            slopes = np.zeros((self._count, rows, len(q)))
            at_place = shifts + np.cross(turns, (now[:3, 3] - tip)[:, None], axis=0)
            slopes[:, :, :link] = np.moveaxis(np.concatenate([at_place, turns])[:rows], -1, 0)
            q = q + np.einsum("nji,in->jn", np.linalg.pinv(slopes), change)
        return q
