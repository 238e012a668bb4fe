"""The error model at one pose: a term table, evaluated in plain numpy.

The compiled kernel is tested against these methods. Errors are ``[d; δ]`` of the tip in base axes (m, rad): ``d = p' -
p``, ``δ = Log(R' Rᵀ)``.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice
from typing import Final, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base import se3
from precision_pin.base.arguments import check_memory, check_numbers
from precision_pin.base.arrays import Array, Fixed, returns_read_only
from precision_pin.base.errors import Finding, InputError
from precision_pin.draws.draw import Draw
from precision_pin.draws.space import Space
from precision_pin.render import tables
from precision_pin.render.html import Table, rendered
from precision_pin.robot.chain import Posture
from precision_pin.robot.datums import Datum
from precision_pin.robot.places import ORDER_FRAME
from precision_pin.robot.urdf import Joint
from precision_pin.sheet.reader import Origin
from precision_pin.terms.table import SlopeColumns, TermTable
from precision_pin.terms.term import JointValue, Target, Term


@dataclass(frozen=True, eq=False)
class Part:
    """Rigid part of the drawn arm.

    Attributes:
        name: Name of its node below ``arm``.
        frame: Its pose in the chain link's axes, ``(4, 4)``.
        rank: Position of its URDF link among the links of the chain link from base to tip; ``None`` for the tip and
            parts attached to it.
    """

    name: str
    link: int
    frame: Array
    rank: int | None

    def targets_before(self, targets: Sequence[Target]) -> int:
        """Return the number of targets that move it: the first ones in chain order."""
        # The frame of its URDF link moves it; a custom place or the end of its chain link moves only later parts. All
        # targets move the tip.
        if self.rank is None:
            return len(targets)
        last = (self.link, ORDER_FRAME, self.rank)
        return sum(
            target.joint < self.link if isinstance(target, JointValue) else (target.link, *target.order) <= last
            for target in targets
        )


class Solver(Protocol):
    """Procedures that find datums."""

    datums: tuple[Datum, ...]

    def by_datum(self) -> Iterator[tuple[Datum, Array, Array]]:
        """Yield each datum, its places and nominal tips, ``(V, 4, 4)``."""

    def solved(self, at: PoseModel, x: Array) -> Array:
        """Return the errors ``(6, n)`` at a pose of robots that each carry out the procedures."""

    def in_base_axes(self, at: PoseModel) -> PoseModel:
        """Return the model at a pose without the procedures."""


@dataclass(frozen=True, eq=False)
class DatumPart(Fixed):
    """What the datum adds to the error at a pose: ``Σ gain × error of a visit + noise × components``.

    The errors are those of the same robot at the poses where the datum was found.

    Attributes:
        visits: The model at each of these poses, for the same components.
        gains: ``(V, 6, 6)``, zero for a visit that does not count here.
        noise: Derivative ``(6, d)`` by the procedure's own noise.
        procedures: The procedures, which solve robots one by one.
    """

    visits: tuple[PoseModel, ...]
    gains: Array
    noise: Array
    procedures: Solver = field(repr=False)

    def errors(self, values: Array, model: Literal["exact", "linear"]) -> Array:
        """Return what is added, ``(6, N)``, for component values ``(d, N)``."""
        total = self.noise @ values
        for gain, visit in self.counted:
            total += gain @ (visit.exact(values) if model == "exact" else visit.linear(values))
        return total

    @property
    def counted(self) -> Iterator[tuple[Array, PoseModel]]:
        """Each visit that counts, after its gain."""
        return ((gain, visit) for gain, visit in zip(self.gains, self.visits, strict=True) if gain.any())


_SOLVED: Final = 256
"""Robots solved one by one: they show differences of a per cent of the standard deviation."""
_SHARE: Final = 0.05
"""Difference of mean, standard deviation or quantile, relative, above which the maps of a datum are too coarse."""
_CANCELLED: Final = 0.01
"""Share of the standard deviation in base axes below which a component has cancelled: second order is left of it."""
_LEAST_STD: Final = 1e-9
"""Standard deviation, m and rad, below which a component does not vary."""

# components of ``[d; δ]`` and their units in a notebook
_COMPONENTS: Final = (("dx", "mm"), ("dy", "mm"), ("dz", "mm"), ("δx", "mrad"), ("δy", "mrad"), ("δz", "mrad"))


@dataclass(frozen=True, eq=False)
class PoseModel:
    """The error model at one pose.

    Attributes:
        posture: The undisplaced chain, with all loads.
        space: Draws in column order.
        table, terms: Of the arm.
        datum: What the datum adds to the error of the arm; None in base axes.
    """

    posture: Posture
    space: Space
    table: TermTable
    terms: Sequence[Term]
    datum: DatumPart | None = None

    @cached_property
    def arm(self) -> PoseModel:
        """The model of the arm alone, with errors in base axes."""
        return self if self.datum is None else replace(self, datum=None)

    @property
    def in_base_axes(self) -> PoseModel:
        """The model with errors in base axes; of an arm that is compensated, if this one is."""
        return self if self.datum is None else self.datum.procedures.in_base_axes(self)

    def linear(self, x: ArrayLike) -> Array:
        """Return the errors ``(6, N)`` by superposition (eqs 12-17), for component values ``(d, N)``.

        Σ J_target · twist · product of factors, with J at the undisplaced chain.
        """
        values = self._check(x)
        displacements = self.table.displacements(self.table.products(self.table.program.evaluate(values)))
        errors = np.einsum("kij,kjn->in", self.table.sensitivities, displacements)
        return errors if self.datum is None else errors + self.datum.errors(values, "linear")

    def exact(self, x: ArrayLike) -> Array:
        """Return the errors ``(6, N)`` of the displaced chain as a product of poses, for component values ``(d, N)``.

        ``T' = Π (T_k E_k T_k⁻¹) · T`` over the targets in chain order, T_k their undisplaced poses. Raises InputError if
        a target rotates by π or more, so that its rotation vector is not unique, or an error overflows.
        """
        values = self._check(x)
        with _check_overflow():
            errors = self._multiply_out(values)
            return errors if self.datum is None else errors + self.datum.errors(values, "exact")

    def _multiply_out(self, values: Array) -> Array:
        displacements = self.table.displacements(self.table.products(self.table.program.evaluate(values)))
        motion = np.broadcast_to(np.eye(4)[:, :, None], (4, 4, values.shape[1]))
        _check_half_turns(displacements[:, 3:], axis=1)
        for frame, twist, inverse in zip(self.table.frames, displacements, self.table.inverse_frames, strict=True):
            inserted = se3.compose(frame, se3.displacement(twist), inverse)
            motion = se3.compose(motion, inserted)
        tip = self.table.pose[:3, 3]
        shift = np.einsum("ijn,j->in", motion[:3, :3], tip) + motion[:3, 3] - tip[:, None]
        return np.concatenate([shift, se3.log_rotation(motion[:3, :3])])

    @cached_property
    @returns_read_only
    def tangent(self) -> tuple[Array, Array]:
        """First-order model of :meth:`exact` at the components' means: ``(e0 (6,), J (6, d))``.

        Under gravity it holds for the deflected arm, and differs from :meth:`linear`.
        """
        jacobian = self._add_up(part for _, part in self.jacobian_parts)
        return self.error_at_means, jacobian if self.datum is None else jacobian + self.datum.noise

    def jacobian_at(self, x: Array, error: Array) -> Array:
        """Return the derivative ``(6, d)`` of :meth:`exact` in base axes at values ``(d,)`` with the error ``(6,)``."""
        return self._add_up(self._slopes_at(x, error))

    def _add_up(self, parts: Iterable[SlopeColumns]) -> Array:
        jacobian = np.zeros((6, self.space.size))
        for part in parts:
            jacobian[:, part.columns] += part.slopes
        return jacobian

    @cached_property
    @returns_read_only
    def error_at_means(self) -> Array:
        """Error of :meth:`exact` with every component at its mean, ``(6,)``."""
        return self.exact(self.space.mean[:, None])[:, 0]

    @cached_property
    def jacobian_parts(self) -> tuple[tuple[Target, SlopeColumns], ...]:
        """Targets with their parts in the Jacobian of :attr:`tangent`; they and the noise of a datum add up to J."""
        slopes = self._slopes_at(self.space.mean, self.arm.error_at_means)
        parts = list(zip(self.table.targets, slopes, strict=True))
        for gain, visit in () if self.datum is None else self.datum.counted:
            parts += [(target, SlopeColumns(part.columns, gain @ part.slopes)) for target, part in visit.jacobian_parts]
        return tuple(parts)

    def _slopes_at(self, x: Array, error: Array) -> tuple[SlopeColumns, ...]:
        """Return each target's part in the derivative of :meth:`exact` at component values ``(d,)`` with this error."""
        table = self.table
        displacements = table.displacements(table.products(table.program.evaluate(x[:, None])))[:, :, 0]
        tip = table.pose[:3, 3] + error[:3]
        rotation_rates = se3.left_jacobian_inverse(error[3:])
        parts = []
        motion = np.eye(4)
        entries = zip(table.frames, displacements, table.inverse_frames, table.displacement_slopes(x), strict=True)
        for frame, displacement, inverse_frame, local in entries:
            turning = se3.left_jacobian(displacement[3:]) @ local.slopes[3:]
            twist = np.concatenate([local.slopes[:3] + se3.skew(displacement[:3]) @ turning, turning])
            spatial = se3.adjoint(motion @ frame) @ twist
            slopes = np.concatenate([spatial[:3] - se3.skew(tip) @ spatial[3:], rotation_rates @ spatial[3:]])
            parts.append(SlopeColumns(local.columns, slopes))
            motion = motion @ frame @ se3.displacement(displacement) @ inverse_frame
        return tuple(parts)

    @property
    def jacobian(self) -> Array:
        """Derivative of :meth:`exact` at the components' means, ``(6, d)``."""
        return self.tangent[1]

    @cached_property
    @returns_read_only
    def covariance(self) -> Array:
        """Covariance of the tangent model, ``(6, 6)``: J Σ Jᵀ."""
        return self.space.block_covariance.between(self.jacobian, self.jacobian)

    def solved(self, x: ArrayLike) -> Array:
        """Return the errors ``(6, N)`` of :meth:`exact`; with a datum, of robots that each find it, not linearised."""
        values = self._check(x)
        return self.exact(values) if self.datum is None else self.datum.procedures.solved(self, values)

    @cached_property
    def linearity(self) -> Mapping[str, float] | None:
        """Largest relative differences of mean, std and 95 % quantile of |d| from robots solved one by one.

        Those of mean and std are the largest of the six components, the mean in standard deviations; what the datum cancels
        to less than a hundredth of the error in base axes counts as that much. None without a datum.
        """
        if self.datum is None:
            return None
        x = self.space.sample(0, 0, _SOLVED)
        # an arm of fewer joints does not reach the attitude of a displaced pose
        rows = slice(6 if len(self.posture.q) >= 6 else 3)
        exact, solved = self.exact(x)[rows], self.solved(x)[rows]
        least = np.repeat(self.arm.exact(x).reshape(2, 3, -1).std(axis=2).max(axis=1) * _CANCELLED, 3)[rows]
        least = np.maximum(least, _LEAST_STD)
        std = np.maximum(solved.std(axis=1), least)
        lengths = (np.quantile(np.linalg.norm(error[:3], axis=0), 0.95) for error in (exact, solved))
        quantiles = np.maximum(list(lengths), _LEAST_STD)
        return {
            "robots": _SOLVED,
            "mean": float((np.abs((exact - solved).mean(axis=1)) / std).max()),
            "std": float(np.abs(np.maximum(exact.std(axis=1), least) / std - 1).max()),
            "quantile_95": float(abs(quantiles[0] / quantiles[1] - 1)),
        }

    def _datum_findings(self) -> tuple[Finding, ...]:
        """Return a warning if robots that carry out the procedure differ from the maps of the datum."""
        gaps = self.linearity
        if gaps is None or max(gaps["mean"], gaps["std"], gaps["quantile_95"]) <= _SHARE:
            return ()
        message = (
            f"{_SOLVED} robots that each found the datum differ from its first-order maps: mean {gaps['mean']:.2g} of the "
            f"standard deviation, standard deviation {gaps['std']:.2%}, 95 % quantile of |d| {gaps['quantile_95']:.2%}"
        )
        return (Finding("warning", "W_DATUM", message),)

    def findings(self, model: str) -> tuple[Finding, ...]:
        """Return warnings about this pose: limits, the datum and, for ``model`` "linear", the error of superposition."""
        known = (*self.posture.findings, *self._datum_findings())
        if model != "linear" or not self.space.size:
            return known
        superposed = self.linear(self.space.mean[:, None])[:, 0]
        gap = float(np.linalg.norm((superposed - self.error_at_means)[:3]))
        spread, negligible = spread_of(self)
        if gap <= negligible:
            return known
        message = (
            f"with every parameter at its mean, superposition places the tip {gap * 1e3:.3g} mm away from the "
            f"displaced chain, more than a tenth of the spread of {spread * 1e3:.3g} mm; the exact model has no such error"
        )
        return (*known, Finding("warning", "W_SUPERPOSITION", message))

    def __repr__(self) -> str:
        return f"<PoseModel of {self.posture!r}: terms {len(self.terms)}, random numbers {self.space.size}>"

    def _repr_html_(self) -> str:
        """Return the notebook view: error at the means and first-order spread, mm and mrad."""
        chain = self.posture.chain
        title = f"{os.path.basename(chain.robot.file)}: {chain.base} to {chain.tip_label}, first order at one pose"
        pose = ", ".join(map(joint_value, chain.joints, self.posture.q))
        counts = f"{len(self.terms)} terms, {len(self.space.draws)} draws of {self.space.size} numbers"
        try:
            spread = np.sqrt(np.diag(self.covariance))
        except InputError as error:
            return rendered(title, [], [pose, counts, error.findings[0].message])
        rows = [
            [name, unit, f"{1e3 * mean:.6g}", f"{1e3 * std:.6g}"]
            for (name, unit), mean, std in zip(_COMPONENTS, self.error_at_means, spread, strict=True)
        ]
        columns = ("", "unit", "error at the means", "standard deviation")
        return rendered(title, [Table(columns, rows, words=2)], [f"{pose}; base axes", counts])

    def _check(self, x: ArrayLike) -> Array:
        # not copied, unlike other arguments: it may be large and is only read
        values = x if type(x) is np.ndarray and x.dtype == np.float64 else check_numbers("x", x)
        if values.ndim != 2 or values.shape[0] != self.space.size:
            raise InputError(f"x has shape {values.shape}, expected ({self.space.size}, N): rows as in model.space")
        terms, parameters = self.table.factors.shape, len(self.table.program.outputs)
        # numbers for each robot: factors and products of terms, displacements of targets and their poses
        numbers = (terms[1] + 1) * terms[0] + 2 * parameters + 6 * len(self.table.targets) + 64
        check_memory(
            8.0 * numbers * values.shape[1], f"evaluating {values.shape[1]:,} robots", "evaluate some of them at a time"
        )
        if not np.isfinite(values).all():
            raise InputError("x must be finite")
        return values


def spread_of(at: PoseModel) -> tuple[float, float]:
    """Return the spread of the tip's position, and the largest distance between tips without a warning, m."""
    spread = float(np.sqrt(np.trace(at.covariance[:3, :3])))
    return spread, max(0.1 * spread, 1e-9)


def joint_value(joint: Joint, value: float) -> str:
    """Return a joint's value as text in mm or degrees."""
    return tables.joint_value(joint.name, float(value), slides=joint.kind == "prismatic")


NOT_STATED: Final = "not stated"
"""Provenance of values without one in the sheet."""

OriginShares = Mapping[str, tuple[float, float]]
"""Share of the variance of position and attitude by provenance; shares add to one if the error varies."""


def origins_of_numbers(stated: Mapping[str, Origin], space: Space, owners: Sequence[Sequence[str]]) -> dict[str, str]:
    """Return the origin of each component of a space, by name; empty texts if nothing is stated."""
    pairs = zip(space.draws, owners, strict=True)
    return {name: kind for draw, users in pairs for kind in [_origin(stated, draw, users)] for name in draw.components}


def _origin(stated: Mapping[str, Origin], draw: Draw, owners: Sequence[str]) -> str:
    """Return the origin of a draw: that of its parameter in the sheet, else of its setting, else of a source."""
    label = next((owner for owner in owners if draw.name.startswith(f"{owner}.")), "")
    setting = draw.name.removeprefix(f"{label}.").partition(".")[0].partition("[")[0] if label else ""
    paths = [f"parameters.{draw.name}", f"{label}.{setting}", *owners]
    # a draw of several sources is as certain as the least certain source
    kinds = [stated[name].kind for name in paths if name in stated]
    if f"parameters.{draw.name}" in stated or (setting and f"{label}.{setting}" in stated):
        return kinds[0]
    return "assumed" if "assumed" in kinds else next(iter(kinds), "")


def origin_shares(origins: Mapping[str, str], at: PoseModel) -> OriginShares:
    """Return the share of the first-order variance of each provenance; empty if no provenance is stated."""
    # ``Cov(e_k, e)``, summed over the parameters of each provenance
    if not any(origins.values()):
        return {}
    space = at.space
    jacobian = at.jacobian
    spread = space.block_covariance.times(np.ascontiguousarray(jacobian.T))
    by_component = [np.einsum("id,di->d", jacobian[rows], spread[:, rows]) for rows in (slice(0, 3), slice(3, 6))]
    totals = [float(parts.sum()) for parts in by_component]
    shares: dict[str, list[float]] = {}
    for column, name in enumerate(space.components):
        sums = shares.setdefault(origins.get(name, "") or NOT_STATED, [0.0, 0.0])
        for vector, parts in enumerate(by_component):
            if totals[vector] > 0:
                sums[vector] += float(parts[column]) / totals[vector]
    ordered = sorted(shares.items(), key=lambda entry: -entry[1][0])
    return {kind: (sums[0], sums[1]) for kind, sums in ordered}


AT_ONCE: Final = 256
"""Poses computed together; their arrays stay in the processor's cache."""


@dataclass(frozen=True, eq=False)
class Tangents(Fixed):
    """First-order models ``e = error + jacobian · (x - mean of x)`` at P poses.

    Attributes:
        error: Error of the exact model with every component at its mean, ``(6, P)``.
        jacobian: Its derivative by the components, ``(6, d, P)``.
        arms: Per unit of each term's product, the rotation of the parts beyond its place, and a bound of the tip's
            shift: the place's shift plus rotation times distance, ``(2, T, P)``.
        table: The table of one of the poses; targets, factors and formulas are equal at all poses.
        added: First-order models of errors that are part of the error, each after the largest factors by which its
            position and attitude (columns) enter position and attitude (rows), ``(2, 2, P)``. Error and jacobian hold
            them, arms and table do not.
    """

    error: Array
    jacobian: Array
    arms: Array
    table: TermTable
    added: tuple[tuple[Array, Tangents], ...] = ()


@dataclass(frozen=True, eq=False)
class Tables(Fixed):
    """Tables of P poses that differ only in frames ``(K, 4, 4, P)``, tips ``(3, P)`` and the twists of some terms ``(V, 6, P)``.

    ``first`` is the table of the first pose, ``varying`` ``(V,)`` are those terms.
    """

    first: TermTable
    varying: NDArray[np.intp]
    twists: Array
    frames: Array
    tips: Array

    @classmethod
    def of(cls, models: Sequence[PoseModel]) -> Tables:
        """Return the tables of models of one layout."""
        tables = [at.table for at in models]
        first, twists = tables[0], np.stack([table.twists for table in tables], axis=-1)
        varying = np.flatnonzero((twists != twists[:, :, :1]).any(axis=(1, 2)))
        return cls(
            # a copy: its arrays may be views of those of many poses
            replace(first, pose=first.pose.copy(), frames=first.frames.copy(), twists=first.twists.copy()),
            varying,
            twists[varying],
            np.stack([table.frames for table in tables], axis=-1),
            np.stack([table.pose[:3, 3] for table in tables], axis=-1),
        )

    def tangent(self, x: Array) -> Tangents:
        """Return the first-order models about component values ``(d,)``, in base axes."""
        with _check_overflow():
            return _multiply_out(x, self)


def tangents(models: Iterable[PoseModel]) -> Iterator[Tangents]:
    """Yield the first-order models of poses in order, up to `AT_ONCE` poses at a time."""
    for chunk in of_one_layout(models):
        with _check_overflow():
            part = _multiply_out(chunk[0].space.mean, Tables.of(chunk))
            yield _with_datum(part, chunk)


def of_one_layout(models: Iterable[PoseModel]) -> Iterator[list[PoseModel]]:
    """Yield models in order, up to `AT_ONCE` at a time, whose tables differ in twists and frames only."""
    remaining = iter(models)
    while chunk := list(islice(remaining, AT_ONCE)):
        while chunk:
            # tables of equal layout share their arrays; the formulas of a model rarely change between poses
            first = chunk[0].table
            parts = ("program", "factors", "target")
            has_layout = [all(getattr(first, part) is getattr(at.table, part) for part in parts) for at in chunk]
            count = [*has_layout, False].index(False)
            yield chunk[:count]
            chunk = chunk[count:]


def _with_datum(arm: Tangents, models: Sequence[PoseModel]) -> Tangents:
    """Return first-order models with what the datum adds at each pose."""
    parts = [at.datum for at in models if at.datum is not None]
    if not parts:
        return arm
    mean, visits = models[0].space.mean, parts[0].visits
    gains = np.stack([part.gains for part in parts], axis=-1)
    noise = np.stack([part.noise for part in parts], axis=-1)
    error, jacobian = arm.error + np.einsum("idp,d->ip", noise, mean), arm.jacobian + noise
    added = []
    for gain, visit in zip(gains, visits, strict=True):
        error = error + np.einsum("ijp,j->ip", gain, visit.error_at_means)
        jacobian = jacobian + np.einsum("ijp,jd->idp", gain, visit.jacobian)
        blocks = gain.reshape(2, 3, 2, 3, -1).transpose(4, 0, 2, 1, 3)
        lengths = np.moveaxis(np.linalg.norm(blocks, ord=2, axis=(3, 4)), 0, -1)
        added.append((lengths, _multiply_out(mean, Tables.of([visit]))))
    return replace(arm, error=error, jacobian=jacobian, added=tuple(added))


@contextmanager
def _check_overflow() -> Iterator[None]:
    try:
        with np.errstate(over="raise", invalid="raise"):
            yield
    except FloatingPointError:
        raise InputError("an error is too large to compute with; the tolerances or loads are far too large") from None


def _check_half_turns(turns: Array, axis: int) -> None:
    if np.sqrt((turns**2).sum(axis=axis)).max(initial=0.0) >= np.pi:
        raise InputError("an error rotates a frame by 180° or more; the tolerances or loads are far too large")


def _multiply_out(mean: Array, tables: Tables) -> Tangents:
    first, frames, tip = tables.first, tables.frames, tables.tips
    poses = tip.shape[1]
    twists = np.repeat(first.twists[:, :, None], poses, axis=2)
    twists[tables.varying] = tables.twists
    products = first.products(first.program.evaluate(mean[:, None]))[:, 0]
    entries = zip(*first.product_slopes(mean), strict=True)
    spatial, arms = np.zeros((6, len(products), poses)), np.zeros((2, len(products), poses))
    pivots = np.zeros((len(products), 3, poses))
    motion = np.broadcast_to(np.eye(4)[:, :, None], (4, 4, poses))
    for target in range(len(first.targets)):
        terms = np.flatnonzero(first.target == target)
        displacement = np.zeros((6, poses))
        for term in terms:
            displacement += twists[term] * products[term]
        _check_half_turns(displacement[3:], axis=0)
        frame = frames[target]
        local = np.moveaxis(twists[terms], 0, 1)
        turning = np.einsum("ijp,jtp->itp", se3.left_jacobian(displacement[3:]), local[3:])
        moving = local[:3] + _cross(displacement[:3, None], turning)
        before = se3.compose(motion, frame)
        rotated = np.einsum("ijp,jtp->itp", before[:3, :3], turning)
        translations = np.einsum("ijp,jtp->itp", before[:3, :3], moving)
        spatial[:3, terms] = translations + _cross(before[:3, 3][:, None], rotated)
        spatial[3:, terms] = rotated
        arms[:, terms] = np.sqrt([(rotated**2).sum(axis=0), (translations**2).sum(axis=0)])
        pivots[terms] = before[:3, 3]
        motion = se3.compose(before, se3.displacement(displacement), se3.inverse(frame))
    shift = np.einsum("ijp,jp->ip", motion[:3, :3], tip) + motion[:3, 3] - tip
    error = np.concatenate([shift, se3.log_rotation(motion[:3, :3])])
    rate = np.moveaxis(np.linalg.inv(np.moveaxis(se3.left_jacobian(error[3:]), -1, 0)), 0, -1)
    rates = np.concatenate(
        [spatial[:3] - _cross((tip + error[:3])[:, None], spatial[3:]), np.einsum("ijp,jtp->itp", rate, spatial[3:])]
    )
    jacobian = np.zeros((6, mean.size, poses))
    for term, component, slope in entries:
        jacobian[:, component] += rates[:, term] * slope
    arms[1] += arms[0] * np.sqrt(((tip + error[:3] - pivots) ** 2).sum(axis=1))
    return Tangents(error, jacobian, arms, first)


def _cross(left: Array, right: Array) -> Array:
    """Return the cross products of vectors ``(3, ...)``; ``np.cross`` is several times slower."""
    result = np.empty(np.broadcast_shapes(left.shape, right.shape))
    for k in range(3):
        first, second = (k + 1) % 3, (k + 2) % 3
        np.subtract(left[first] * right[second], left[second] * right[first], out=result[k])
    return result
