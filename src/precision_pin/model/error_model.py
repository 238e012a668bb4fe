"""The error model: computes the term table of a pose from sources, draws and chain."""

from __future__ import annotations

import inspect
import itertools
import os
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property, wraps
from typing import Any, Final, Literal, ParamSpec, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base import se3
from precision_pin.base.arguments import (
    check_choice,
    check_instance,
    check_items,
    check_mapping,
    check_name,
    check_path,
    shown,
)
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError, UnknownNameError, add, warns_at_end
from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import Normal
from precision_pin.draws.space import Estimates, LabelledSpace, Space
from precision_pin.model.datum import DatumRecord, Procedures, procedure_of
from precision_pin.model.equilibrium import solve_equilibrium, statics_findings, terms_about_rest
from precision_pin.model.owned_draws import OwnedDraw, OwnedDraws
from precision_pin.model.pose_model import AT_ONCE, PoseModel, joint_value, origins_of_numbers
from precision_pin.render.html import Table, rendered
from precision_pin.robot.chain import Chain, HasChain, Posture, chain_of, pose_findings
from precision_pin.robot.configurations import Approach, ApproachedPose, read_approach, read_approaches
from precision_pin.robot.datums import COMPENSATED, NO_DATUM, Datum, check_together
from precision_pin.robot.examples import ELSEWHERE, ROBOT_SUFFIXES, require_sheet, resolve_robot
from precision_pin.robot.places import Factors
from precision_pin.sheet import Overrides, Sheet, read_data
from precision_pin.sheet import read as read_sheet
from precision_pin.sheet.reader import MEASURED
from precision_pin.sources.frame import Frame
from precision_pin.terms import bound_source
from precision_pin.terms.source import Source, fix_settings
from precision_pin.terms.table import TableLayout
from precision_pin.terms.term import Target, Term, TermsOfPose

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")


class ErrorModel:
    """A chain with its error sources.

    Args:
        chain: The chain.
        space: The named draws (a sheet's ``parameters``).
        sources: Error sources, in any order. Laws in their settings become draws of the model.
        poses: Named configurations, the first is the default; as an
            :class:`~precision_pin.robot.configurations.ApproachedPose` with an approach.
        statics: ``"nominal"``: loads at the undeflected pose, as in the paper. ``"equilibrium"``: on the arm at rest
            under its loads.

    Attributes:
        chain, sources, poses, statics: The arguments; a source also by its label, ``sources["payload"]``.
        approaches: Approach of each named pose that has one.
        assumed: Labels of the sources that the sheet marks as assumptions.
        origins: Origin of each component of the space, by name: ``assumed``, ``data sheet``, ``measured``, ``drawing``;
            empty if the sheet states none.
        sheet: The sheet of the model; ``None`` for a model built in Python.
        beyond_limits: Set to ``True`` to give verdicts also beyond the URDF's limits of joint values and speeds, as
            ``--beyond-limits`` does. Otherwise a specification at such a pose is ``"not judged"``, and not met.
        datums: What the errors are counted against, in the order in which the datums are found; empty for base axes.
        space: All draws, the named ones first.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> offset = pp.sources.JointOffset(joint="joint1", offset=pp.Normal(1e-3))
        >>> model = pp.ErrorModel(chain, pp.Space(), [offset], {"reach": [0, 0, 0, 0]})
        >>> print(model.at("reach").jacobian[:3, 0])
        [0.274 3.74  0.   ]
    """

    def __init__(
        self,
        chain: Chain,
        space: Space,
        sources: Sequence[Source],
        poses: Mapping[str, ArrayLike | Mapping[str, float] | ApproachedPose] | None = None,
        statics: Literal["nominal", "equilibrium"] = "nominal",
    ) -> None:
        check_choice("statics", statics, ("nominal", "equilibrium"))
        check_instance("chain", chain, Chain, "as Chain.from_urdf returns it")
        check_instance("space", space, Space, "of the named draws")
        self.statics = statics
        self.chain = chain
        fixed = tuple(fix_settings(source) for source in check_items("the sources", sources, Source))  # type: ignore[type-abstract]
        self.sources = bound_source.LabelledSources(fixed, bound_source.labels(fixed))
        for source in fixed:
            if reason := source.clash(fixed):
                raise InputError(f"{source.label()}: {reason}")
        full_space = space.including(bound_source.own_draws(self.sources, self.labels))
        self.space = bound_source.with_quantities(full_space, self.sources, self.labels, chain)
        self.poses, self.approaches = read_poses(chain, {} if poses is None else poses)
        self.assumed: tuple[str, ...] = ()
        self.origins: Mapping[str, str] = {}
        self.sheet: Sheet | None = None
        self.beyond_limits = False
        self.datums: tuple[Datum, ...] = ()
        self._layouts: dict[tuple[Factors, ...], TableLayout] = {}

    @classmethod
    @warns_at_end
    def load(cls, path: str | os.PathLike[str], kinds: Iterable[type[Source]] = ()) -> ErrorModel:
        """Read a sheet and its robot, with the warnings of ``precision-pin check``.

        Args:
            path: The YAML sheet; or a robot, a URDF, ``example:NAME`` or ``robot_descriptions:NAME``, for its sheet beside
                it, in the working folder, or shipped, as on the command line.
            kinds: Source classes beyond those of the package.

        Raises:
            SheetError, UrdfError: Carries all findings.

        Examples:
            >>> model = pp.ErrorModel.load("4dof.errors.yaml")
            >>> print(list(model.poses), len(model.sources))
            ['paper'] 15
            >>> print(list(pp.ErrorModel.load("example:ur5e").poses))
            ['ready', 'stretched', 'folded']
        """
        source_kinds = check_items("the kinds of sources", kinds, type)
        file, robot = check_path("the path of the sheet", path), None
        if file.startswith(ELSEWHERE) or file.endswith(ROBOT_SUFFIXES):
            robot = resolve_robot(file)
            file = str(require_sheet(file, robot)[0])
        sheet = read_sheet(file, kinds=source_kinds, overrides=Overrides(robot))
        add(sheet.findings)
        return cls.from_sheet(sheet)

    @classmethod
    @warns_at_end
    def from_dict(
        cls, data: Mapping[str, object], folder: str | os.PathLike[str] = ".", kinds: Iterable[type[Source]] = ()
    ) -> ErrorModel:
        """Return the model of a sheet in the form of a dictionary.

        Args:
            data: The keys and values of the YAML sheet: text (for a number with a unit), numbers, lists and
                dictionaries.
            folder: Base folder of the names of the robot and of tables.
            kinds: Source classes beyond those of the package.

        Raises:
            InputError: Carries all findings, each with the path of its key.

        Examples:
            >>> offset = {"joint": "joint1", "offset": "±1 mrad"}
            >>> sheet = {"precision-pin": 1, "robot": "4dof.urdf", "tip": "tool", "poses": {"reach": "0 0 0 0 deg"}}
            >>> model = pp.ErrorModel.from_dict(sheet | {"sources": [{"joint_offset": offset}]})
            >>> print(model.space.components)
            ('joint_offset[joint1].offset',)
        """
        source_kinds = check_items("the kinds of sources", kinds, type)
        sheet = read_data(check_mapping("the sheet", data), check_path("the folder", folder), source_kinds)
        add(sheet.findings)
        return cls.from_sheet(sheet)

    @classmethod
    def from_sheet(cls, sheet: Sheet) -> ErrorModel:
        """Return the model of a sheet that has been read."""
        check_instance("sheet", sheet, Sheet, "as sheet.read returns it; ErrorModel.load takes a path")
        poses = {name: ApproachedPose(q, sheet.approaches.get(name, ())) for name, q in sheet.poses.items()}
        model = cls(sheet.chain, sheet.space, sheet.sources, poses, sheet.statics)
        model.assumed = tuple(model.labels[k] for k in sheet.assumed)
        if sheet.origins:
            model.origins = origins_of_numbers(sheet.origins, model.space, model.owners)
        model = model if sheet.estimates is None else model.calibrated(sheet.estimates)
        model.sheet, model.beyond_limits = sheet, sheet.beyond_limits
        return model.against(*sheet.datum)

    @warns_at_end
    def against(self, *datums: Datum | str) -> ErrorModel:
        """Return the model with errors against datums instead of base axes.

        Args:
            datums: In the order in which the robot finds them: a tool first, say, then a fixture found with it; each from
                :class:`precision_pin.Datum` or a name of the sheet. Without any, or ``"none"``, errors are in base axes.

        Raises:
            InputError: Not a datum; poses that do not determine it; two datums of one name; a camera that is not the last.
            UnknownNameError: No such pose, frame or datum.

        Examples:
            >>> model = pp.ErrorModel.load("4dof.errors.yaml")
            >>> taught = model.against(pp.Datum.taught("paper"))
            >>> print(np.abs(taught.at("paper").jacobian[:3]).max() < 1e-12)
            True
        """
        known = {**({} if self.sheet is None else self.sheet.datums), COMPENSATED: Datum.compensated()}
        datums = () if datums == (NO_DATUM,) else datums
        named = [known[check_name("datum", datum, known)] if isinstance(datum, str) else datum for datum in datums]
        listed = check_items("the datums", named, Datum, "as Datum.taught returns it")  # type: ignore[type-abstract]
        model, space = self.bare, self.bare.space
        if not listed:
            return model
        check_together(listed)
        listed = tuple(datum.bound(len(model.chain.joints), model.configuration) for datum in listed)
        parts = [procedure_of(datum, space) for datum in listed]
        draws = [draw for source, _ in parts for draw in source.draws(source.label())]
        space = Space(
            (*space.draws, *draws), (*space.correlations, *(group for _, groups in parts for group in groups))
        )
        result = model.like(model.chain, space)
        result.sheet, result.datums = model.sheet, listed
        procedures = [source for source, _ in parts]
        labels = (*model.labels, *(source.label() for source in procedures))
        result.sources = bound_source.LabelledSources((*model.sources, *procedures), labels)
        result.procedures.check()
        return result

    @property
    def bare(self) -> ErrorModel:
        """The model in base axes."""
        if not self.datums:
            return self
        names = {name for datum in self.datums for name in (datum.label,)}
        draws = tuple(draw for draw in self.space.draws if not draw.name.startswith(tuple(f"{n}." for n in names)))
        known = {name for draw in draws for name in (draw.name, *draw.components)}
        groups = tuple(group for group in self.space.correlations if set(group.names) <= known)
        result = self.like(self.chain, Space(draws, groups))
        result.sheet, result.datums = self.sheet, ()
        count = len(self.sources) - len(self.datums)
        result.sources = bound_source.LabelledSources(self.sources[:count], self.labels[:count])
        return result

    def datum_record(self, at: PoseModel | None = None) -> DatumRecord | None:
        """Return what the errors are counted against, with the linearity at a pose (default: the first); None for base axes."""
        if at is None and self.datums and self.poses:
            with suppress(InputError):  # a camera may have no view of the first pose
                at = next(self.at_columns(next(iter(self.poses.values()))[:, None]))
        return DatumRecord.of(self.datums, at)

    @cached_property
    def procedures(self) -> Procedures:
        """The procedures of the datums."""
        return Procedures(self.bare, self.space, self.datums)

    @property
    def specs(self) -> tuple[str, ...]:
        """Texts of the sheet's ``specs:`` for all poses, as the analyses take them."""
        return () if self.sheet is None else tuple(spec.text for spec in self.sheet.specs if not spec.poses)

    def calibrated(self, estimates: Estimates) -> ErrorModel:
        """Return the calibrated arm: posterior means, and one joint draw of the remaining uncertainty.

        A component whose variance the data reduced by at least half counts as measured.

        Raises:
            InputError: A name is not that of a component drawn once per robot.
        """
        space = estimates.remaining_space(self.space)
        model = self.like(self.chain, bound_source.with_quantities(space, self.sources, self.labels, self.chain))
        learned = dict.fromkeys(estimates.learned(self.space), MEASURED)
        model.origins = {**self.origins, **learned} if self.origins else {}
        return model

    @warns_at_end
    def with_(self, changes: Mapping[str, object]) -> ErrorModel:
        """Return the model with changed values of its sheet, as with ``--set``.

        Draws keep their names, so that equal seeds give equal robots except for the change.

        Args:
            changes: Values by path: ``parameters.a1``, ``axis_install[joint2].radius``, ``payload.mass``, ``statics``;
                ``*`` matches anything. Values are those of a sheet, such as ``"0.05 mm"``, ``"±0.1 mm"`` or
                ``{"normal": "0.2 mrad"}``.

        Raises:
            InputError: The model was not read from a sheet or a dictionary; an unknown path; an invalid value.

        Examples:
            >>> model = pp.ErrorModel.load("4dof.errors.yaml")
            >>> finer = model.with_({"axis_install[*].radius": "0.05 mm"})
            >>> print(finer.sources[5].radius)
            5e-05
        """
        values = check_mapping("the changes", changes)
        if self.sheet is None:
            raise InputError("the model was not read from a sheet or a dictionary; create a new one with other sources")
        sheet = self.sheet.with_changes(values)
        add(sheet.findings)
        model = type(self).from_sheet(sheet)
        model.beyond_limits = self.beyond_limits
        return model.against(*self.datums)

    def configuration(self, q: ArrayLike | Mapping[str, float] | ApproachedPose | str | None = None) -> Array:
        """Return joint values in chain order, from an array, by joint name or pose name (default: the first pose).

        An :class:`~precision_pin.robot.configurations.ApproachedPose` gives the values of its pose.

        Raises:
            UnknownNameError: No such pose or joint.
            InputError: Invalid joint values, or no argument and the model has no poses.
        """
        if isinstance(q, ApproachedPose):
            return self.configuration(q.pose)
        if q is None:
            if not self.poses:
                raise InputError("the model has no poses; give joint values")
            return next(iter(self.poses.values()))
        if isinstance(q, str):
            if q not in self.poses:
                raise UnknownNameError("pose", q, self.poses)
            return self.poses[q]
        return self.chain.configuration(q)

    def approach(self, q: ArrayLike | Mapping[str, float] | ApproachedPose | str | None = None) -> Approach:
        """Return the approach of a pose as :meth:`configuration` takes it; empty if it has none.

        Raises:
            UnknownNameError: No such joint.
            InputError: Invalid directions, or an approach from the previous pose, which does not exist.
        """
        if not isinstance(q, ApproachedPose):
            return self.approaches.get(self.pose_name(q), ())
        if q.is_from_previous:
            raise InputError("the approach is 'previous', but there is no pose before; give + or - by joint")
        return read_approach(self.chain.joint_names, q.approach)

    def configurations(
        self, q: ArrayLike | Mapping[str, ArrayLike] | Sequence[object] | ApproachedPose
    ) -> tuple[Array, tuple[str, ...]]:
        """Return joint values ``(n, P)`` of many poses and their names or empty texts; see :meth:`at_many`."""
        if isinstance(q, ApproachedPose):
            return self.configurations(q.pose)
        if isinstance(q, str):
            q = [q]
        names: tuple[str, ...] = ()
        if isinstance(q, list | tuple):
            names = tuple(self.pose_name(pose) if pose is not None else "" for pose in q)
            if any(isinstance(pose, str | ApproachedPose) for pose in q):
                q = [self.configuration(pose) if isinstance(pose, str | ApproachedPose) else pose for pose in q]
        values = self.chain.configurations.many(q)
        add(self.chain.configurations.doubts(q))
        return values, names or ("",) * values.shape[1]

    def approaches_of(self, q: object, values: Array) -> NDArray[np.int8] | None:
        """Return the approaches of many poses, ``(n, P)``; ``None`` if no pose has one.

        Args:
            q: The poses, as for :meth:`configurations`; an :class:`~precision_pin.robot.configurations.ApproachedPose` gives
                each of its poses its approach.
            values: Their joint values ``(n, P)``.
        """
        return read_approaches(q, values, self.approach)

    def pose_name(self, q: object) -> str:
        """Return the name of the pose that :meth:`configuration` returns for ``q``, or an empty text."""
        if isinstance(q, ApproachedPose):
            return self.pose_name(q.pose)
        return q if isinstance(q, str) else next(iter(self.poses), "") if q is None else ""

    @warns_at_end
    def at(
        self, q: ArrayLike | Mapping[str, float] | ApproachedPose | str | None = None, *, approach: object = None
    ) -> PoseModel:
        """Return the model at a pose; warns of joint values outside their limits, and of the posture's other findings.

        Args:
            q: As in :meth:`configuration`.
            approach: As in :class:`~precision_pin.robot.configurations.ApproachedPose` (default: that of the pose).
        """
        q = q if approach is None else ApproachedPose(q, approach)
        at = self._at(replace(self.chain.at(self.configuration(q)), approach=self.approach(q)))
        add(at.posture.findings)
        return at

    @warns_at_end
    def at_many(self, q: ArrayLike | Mapping[str, ArrayLike] | Sequence[object]) -> Iterator[PoseModel]:
        """Return an iterator of the model at P poses, one after another.

        Each model equals that of :meth:`at` to rounding; joint frames are computed for many poses at once.

        Args:
            q: As for :meth:`precision_pin.robot.chain.Chain.at_many`: an array ``(n, P)``, a list of poses (names too),
                or P values for every joint's name.

        Raises:
            InputError: Invalid joint values, immediately; the errors of :meth:`at`, when the iterator reaches the pose.
            UnknownNameError: No such joint on the chain.
        """
        values, _ = self.configurations(q)
        add(pose_findings(self.chain, values))
        return self.at_columns(values, self.approaches_of(q, values))

    def at_columns(self, values: Array, approaches: NDArray[np.int8] | None = None) -> Iterator[PoseModel]:
        """Return the model at poses ``(n, P)``, with approaches as from :meth:`approaches_of`, in turn."""
        parts = [slice(first, first + AT_ONCE) for first in range(0, values.shape[1], AT_ONCE)]
        return itertools.chain.from_iterable(
            self._at_once(values[:, part], None if approaches is None else approaches[:, part]) for part in parts
        )

    def statics_findings(self, at: PoseModel) -> tuple[Finding, ...]:
        """Return warnings that the statics are beyond their range of validity.

        ``W_DEFLECTION``: a link bends too far for the formulas for small deflections. ``W_STATICS``, nominal statics:
        the tip is farther from the tip at rest than a tenth of the spread by tolerances. ``W_STATICS``, equilibrium
        statics: individually solved robots differ from the model by more than 0.5 % (the 99 % robot of a thousand) or 2
        % (the farthest). ``W_TURNOVER``, equilibrium statics with an approach: individual robots take up play on other
        sides.
        """
        # a sheet can accept the simplification of nominal statics, not that robots differ from equilibrium statics
        accepted = {} if self.sheet is None or self.statics != "nominal" else self.sheet.accepted
        return tuple(
            finding.accepted(accepted) for finding in statics_findings(at.arm, self.statics, self.bound_sources)
        )

    def __repr__(self) -> str:
        counts = f"sources {len(self.sources)}, draws {len(self.space.draws)}, poses {len(self.poses)}"
        return f"<ErrorModel of {self.chain!r}: {counts}>"

    def _repr_html_(self) -> str:
        """Return the notebook view: sources with settings, draws with laws and scopes, poses."""
        chain = self.chain
        sources = [[label, _settings(source)] for label, source in zip(self.labels, self.sources, strict=True)]
        poses = [[name, ", ".join(map(joint_value, chain.joints, q))] for name, q in self.poses.items()]
        tables = (
            Table(("source", "settings (SI)"), sources, f"Sources: {len(sources)}", words=2),
            Table(self.draws.COLUMNS, self.draws.rows, f"Draws: {len(self.draws)}", words=4),
            Table(("pose", "joint values"), poses, f"Poses: {len(poses)}", words=2),
        )
        title = f"Error model of {os.path.basename(chain.robot.file)}: {chain.base} to {chain.tip_label}"
        notes = [f"correlated: {', '.join(group.names)}" for group in self.space.correlations]
        return rendered(title, [table for table in tables if table.rows], [*notes, f"statics {self.statics}"])

    def _at_once(self, values: Array, approaches: NDArray[np.int8] | None) -> Iterable[PoseModel]:
        """Return the model at poses ``(n, P)``, with terms computed for all poses at once if the sources accept it."""
        stacked, bare = self.chain.postures_at(values)
        if approaches is not None:
            stacked = replace(stacked, approach=tuple(approaches))
            bare = [replace(p, approach=tuple(a)) for p, a in zip(bare, approaches.T.tolist(), strict=True)]
        if self.statics == "nominal" and len(bare) > 1:
            with suppress(InputError):  # raised again when the iterator reaches the pose at fault
                postures = bound_source.load_postures(stacked, bare, self.bound_sources)
                terms = None if postures is None else bound_source.terms_at_many(*postures, self.bound_sources)
                if postures is not None and terms is not None:
                    return self._models(*postures, terms)
        return map(self._at, bare)

    def _models(self, stacked: Posture, each: Sequence[Posture], terms: tuple[Term, ...]) -> Iterator[PoseModel]:
        """Yield the model at each configuration of a posture; the terms have a twist per configuration."""
        tables = self._layout_of(terms).at_many(stacked, terms)
        for k, (posture, table) in enumerate(zip(each, tables, strict=True)):
            yield self._in_datum(PoseModel(posture, self.space, table, TermsOfPose(terms, k)))

    def _layout_of(self, terms: tuple[Term, ...]) -> TableLayout:
        """Return the layout of terms: an earlier one with equal targets and factors, if there is one."""
        key = tuple(term.factors for term in terms)
        layout = self._layouts.get(key)
        if layout is None or not layout.fits(terms):
            layout = TableLayout.of(terms, self.space)
            if len(self._layouts) >= _MOST_LAYOUTS:
                self._layouts.clear()
            self._layouts[key] = layout
        return layout

    def _at(self, bare: Posture) -> PoseModel:
        posture = bound_source.load_posture(bare, self.bound_sources)
        if self.statics == "nominal":
            terms = bound_source.terms_at(posture, self.bound_sources)
        else:
            terms = terms_about_rest(solve_equilibrium(posture, self.space, self.bound_sources))
        return self._in_datum(PoseModel(posture, self.space, self._layout_of(terms).at(posture, terms), terms))

    def _in_datum(self, at: PoseModel) -> PoseModel:
        return replace(at, datum=self.procedures.part(at)) if self.datums else at

    @property
    def labels(self) -> tuple[str, ...]:
        """Label of each source."""
        return self.sources.labels

    @cached_property
    def draws(self) -> OwnedDraws:
        """Draws of the space by name, each with its law, scope and owners: the labels of the sources that use it."""
        entries = zip(self.space.draws, self.owners, strict=True)
        return OwnedDraws({draw.name: OwnedDraw(draw.law, draw.scope, owners) for draw, owners in entries})

    @cached_property
    def bound_sources(self) -> tuple[bound_source.BoundSource, ...]:
        """Every source, bound to the values of its settings."""
        pairs = zip(self.sources, self.labels, strict=True)
        return tuple(bound_source.BoundSource(source, LabelledSpace(self.space, label)) for source, label in pairs)

    @cached_property
    def draw_words(self) -> tuple[str, ...]:
        """Description of each draw of the space, such as ``tilt of joint2 about z``."""
        return bound_source.draw_words(self.space, self.sources, self.labels)

    @cached_property
    def owners(self) -> tuple[tuple[str, ...], ...]:
        """Labels of the sources that use each draw of the space."""
        return bound_source.draw_owners(self.space, self.sources, self.labels)

    def like(self, chain: Chain, space: Space) -> ErrorModel:
        """Return a model with equal sources for an arm with another target or payload, or with other laws."""
        model = ErrorModel(chain, Space(), (), self.poses, self.statics)
        model.sources, model.assumed, model.space = self.sources, self.assumed, space
        model.approaches, model.origins, model.beyond_limits = self.approaches, self.origins, self.beyond_limits
        model.datums = self.datums
        return model

    def measured_as(self, arm: ErrorModel, is_measured: Callable[[Target], bool]) -> ErrorModel:
        """Return the model with its dimensional errors replaced by the sources of a measured arm.

        A source at several targets is replaced if all are measured; draws at each pose or visit remain.
        """
        scopes = {name: draw.scope for draw in self.space.draws for name in draw.components}
        bare, sources = self.chain.at(np.zeros(len(self.chain.joints))), {}
        for label, source, bound in zip(self.labels, self.sources, self.bound_sources, strict=True):
            is_kept = source.is_dimensional and not all(is_measured(term.target) for term in bound.terms(bare))
            if (remaining := source if is_kept else source.without_dimensions(label, scopes)) is not None:
                sources[label] = remaining
        names = {name for label, source in sources.items() for name in source.numbers(label)}
        groups = tuple(group for group in self.space.correlations if names & set(group.names))
        names |= {name for group in groups for name in group.names}
        draws = tuple(draw for draw in self.space.draws if names & set(draw.components))
        model = self.like(self.chain, Space(draws, groups))
        labels = (*sources, *(f"{label}#measured" for label in arm.labels))
        model.sources = bound_source.LabelledSources((*sources.values(), *arm.sources), labels)
        model.assumed = tuple(label for label in self.assumed if label in sources)
        return model


def _against(argument: Any, datums: Sequence[Datum | str]) -> Any:
    """Return a model, or each model of a list, against datums; any other argument unchanged."""
    if isinstance(argument, list | tuple) and any(isinstance(item, ErrorModel) for item in argument):
        return [_against(item, datums) for item in argument]
    return argument.against(*datums) if isinstance(argument, ErrorModel) else argument


def takes_datum(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Make an analysis take ``datum=``: a datum, its name in the sheet, or several in order, instead of the models' own."""
    text = (
        "datum: What errors are counted against: from :class:`precision_pin.Datum`, or a name of the sheet, or several in "
        'order; ``"none"`` for base axes (default: the model\'s).'
    )

    @wraps(function)
    def called(*arguments: Any, datum: Datum | str | Sequence[Datum | str] | None = None, **options: Any) -> Result:
        if datum is not None:
            datums = (datum,) if isinstance(datum, Datum | str) else datum
            if not isinstance(datums, tuple | list):
                raise InputError(f"datum must be a datum, the name of one, or a list of these, got {shown(datum)}")
            arguments = tuple(_against(argument, datums) for argument in arguments)
            options = {name: _against(value, datums) for name, value in options.items()}
        return function(*arguments, **options)

    signature, lines = inspect.signature(function), inspect.cleandoc(function.__doc__ or "").split("\n")
    entry = inspect.Parameter("datum", inspect.Parameter.KEYWORD_ONLY, default=None)
    called.__signature__ = signature.replace(parameters=[*signature.parameters.values(), entry])  # type: ignore[attr-defined]
    end = next(k for k in range(lines.index("Args:"), len(lines)) if not lines[k].strip())
    entry_lines = textwrap.wrap(text, 112, initial_indent=" " * 4, subsequent_indent=" " * 8)
    called.__doc__ = "\n".join([*lines[:end], *entry_lines, *lines[end:]])
    return cast("Callable[Parameters, Result]", called)


def _settings(source: Source) -> str:
    """Return the settings of a source that have a value as text; a draw by its name, or else by its law."""
    settings = {name: value for name, value in source.settings().items() if value is not None and value != ()}
    return ", ".join(
        f"{name}={(value.name or repr(value.law)) if isinstance(value, Draw) else repr(value)}"
        for name, value in settings.items()
    )


def read_poses(
    chain: Chain, poses: Mapping[str, ArrayLike | Mapping[str, float] | ApproachedPose]
) -> tuple[dict[str, Array], dict[str, Approach]]:
    """Return joint values by pose name, and the approaches of poses that have one."""
    configurations, approaches = {}, {}
    for name, q in check_mapping("the poses", poses).items():
        try:
            pose, approach = (q.pose, q.approach) if isinstance(q, ApproachedPose) else (q, ())
            configurations[name] = chain.configuration(pose)
            if directions := read_approach(chain.joint_names, approach):
                approaches[name] = directions
        except InputError as error:
            raise InputError(f"pose {name!r}: {error.findings[0].message}") from None
    return configurations, approaches


_MOST_LAYOUTS: Final = 32
"""Layouts that a model keeps: as many as five joints have ways of being held by friction or not."""

_NAMES: Final = ("x", "y", "z", "rx", "ry", "rz")
"""Settings of a ``frame`` source, in the order of ``[d; δ]``."""


def every_frame(chain: Chain | HasChain) -> ErrorModel:
    """Return a model with all six displacements at every joint, at the base and at the tool.

    Each is normal with a standard deviation of 1 mm or 1 mrad. With :func:`precision_pin.identifiability` it shows
    which combinations of geometric errors measurements can distinguish.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> model = pp.every_frame(chain)
        >>> print(model.space.size, model.space.components[:2])
        36 ('frame[base].x', 'frame[base].y')
    """
    chain = chain_of(chain)
    places = [{"frame": chain.base}, *({"joint": name} for name in chain.joint_names), {"frame": chain.tip}]
    free = dict.fromkeys(_NAMES, Normal(1e-3))
    return ErrorModel(chain, Space(), [Frame(**place, **free) for place in places])  # type: ignore[arg-type]


def displaced_arm(chain: Chain, placements: Array) -> ErrorModel:
    """Return the model of an arm with other placements, expressed by fixed displacements.

    ``placements`` ``(n + 1, 4, 4)`` are those of the joints' seats, and finally of the tip, each in the preceding chain
    link.
    """
    sources = []
    for k, (old, new) in enumerate(zip(chain.placements, placements, strict=True)):
        displacement = se3.inverse(old) @ new
        values = np.concatenate([displacement[:3, 3], se3.log_rotation(displacement[:3, :3])]).tolist()
        place = {"joint": chain.joint_names[k]} if k < len(chain.joints) else {"frame": chain.tip}
        sources.append(Frame(**place, **dict(zip(_NAMES, values, strict=True))))
    return ErrorModel(chain, Space(), sources)
