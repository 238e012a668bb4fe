"""The error model: makes the term table of a pose from sources, draws and chain."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from typing import Final, Literal, final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.call_warnings import add, warns_at_end
from precision_pin.display.html import Table, rendered
from precision_pin.draws.space import Draw, LabelledSpace, Space
from precision_pin.errors import Finding, InputError, UnknownNameError
from precision_pin.inputs.arguments import (
    check_choice,
    check_instance,
    check_items,
    check_mapping,
    check_path,
)
from precision_pin.model.about_rest import terms_about_rest
from precision_pin.model.equilibrium import settle
from precision_pin.model.pose_model import PoseModel, joint_value, spread_of
from precision_pin.robot.chain import Chain, Place, Posture
from precision_pin.sheet import Sheet
from precision_pin.sheet import read as read_sheet
from precision_pin.terms.bound_source import BoundSource, load_posture, terms_at_many
from precision_pin.terms.labelled_sources import draw_owners, draw_words, labels, own_draws, with_quantities
from precision_pin.terms.source import Source, fix_settings
from precision_pin.terms.table import TableLayout, TermTable
from precision_pin.terms.term import Term, TermsOfPose
from precision_pin.typing import Array

__all__ = ["ErrorModel", "limit_findings"]


_AT_ONCE: Final = 256
"""Poses whose joint frames and terms are computed together; their arrays stay in the processor's cache."""

_TRIED: Final = 1000
_TRIED_SEED: Final = 0
_TRIED_RANKS: Final = ((9, 0.005), (0, 0.02))
"""Test of equilibrium statics on single robots: their number and seed; ranks by distance, with the allowed difference."""
_NEGLIGIBLE: Final = 1e-9
"""Difference of errors (m, rad) that never causes a warning."""

_LARGEST_TURN: Final = 0.15
"""Rotation of a link's end by loads (rad) above which a warning is given: a cantilever's deflection is then wrong by 0.4 %."""


@final
class ErrorModel:
    """A chain with its error sources.

    Parameters
    ----------
    chain
        The chain.
    space
        The draws that have names of their own (a sheet's ``parameters``).
    sources
        Error sources, in any order. Laws in their settings become draws of the model.
    poses
        Named configurations, the first one the default.
    statics
        ``"nominal"``: loads at the undeflected pose, as in the paper. ``"equilibrium"``: on the arm at rest under them.

    Attributes
    ----------
    chain, sources, poses, statics
        As given.
    assumed
        Labels of the sources that the sheet marks as assumptions.
    labels
        Each source's label.
    space
        All draws, the named ones first.
    """

    def __init__(
        self,
        chain: Chain,
        space: Space,
        sources: Sequence[Source],
        poses: Mapping[str, ArrayLike | Mapping[str, float]] | None = None,
        statics: Literal["nominal", "equilibrium"] = "nominal",
    ) -> None:
        check_choice("statics", statics, ("nominal", "equilibrium"))
        check_instance("chain", chain, Chain, "as Chain.from_urdf returns it")
        check_instance("space", space, Space, "of the named draws")
        self.statics = statics
        self.chain = chain
        self.sources = tuple(fix_settings(source) for source in check_items("the sources", sources, Source))  # type: ignore[type-abstract]
        self.labels = labels(self.sources)
        drawn = space.including(own_draws(self.sources, self.labels))
        self.space = with_quantities(drawn, self.sources, self.labels, chain)
        self.poses = _read_poses(chain, {} if poses is None else poses)
        self.assumed: tuple[str, ...] = ()
        self._layout: TableLayout | None = None

    @classmethod
    @warns_at_end
    def load(cls, path: str | os.PathLike[str], kinds: Iterable[type[Source]] = ()) -> ErrorModel:
        """Read a sheet and its robot, with the same warnings as ``precision-pin check``.

        Parameters
        ----------
        path
            The YAML sheet.
        kinds
            Source classes beyond those of the package.

        Raises
        ------
        SheetError, UrdfError
            Carries all findings.
        """
        listed = check_items("the kinds of sources", kinds, type)
        sheet = read_sheet(check_path("the path of the sheet", path), kinds=listed)
        add(sheet.findings)
        return cls.from_sheet(sheet)

    @classmethod
    def from_sheet(cls, sheet: Sheet) -> ErrorModel:
        """Return the model of a sheet that has been read."""
        check_instance("sheet", sheet, Sheet, "as sheet.read returns it; ErrorModel.load takes a path")
        model = cls(sheet.chain, sheet.space, sheet.sources, sheet.poses, sheet.statics)
        model.assumed = tuple(model.labels[k] for k in sheet.assumed)
        return model

    def configuration(self, q: ArrayLike | Mapping[str, float] | str | None = None) -> Array:
        """Return joint values in chain order: given in that order, by joint name or by a pose's name; or of the first pose.

        Raises
        ------
        UnknownNameError
            No such pose or joint.
        InputError
            Wrong joint values, or none given and the model has no poses.
        """
        if q is None:
            if not self.poses:
                raise InputError("the model has no poses; give joint values")
            return next(iter(self.poses.values()))
        if isinstance(q, str):
            if q not in self.poses:
                raise UnknownNameError("pose", q, self.poses)
            return self.poses[q]
        return self.chain.configuration(q)

    def configurations(
        self, q: ArrayLike | Mapping[str, ArrayLike] | Sequence[object]
    ) -> tuple[Array, tuple[str, ...]]:
        """Return the joint values ``(n, P)`` of many poses and their names, empty if a pose has none; see :meth:`at_many`."""
        if isinstance(q, str):
            q = [q]
        listed = isinstance(q, list | tuple)
        names = tuple(one if isinstance(one, str) else "" for one in q) if listed else ()  # type: ignore[union-attr]
        if any(names):
            q = [self.configuration(one) if isinstance(one, str) else one for one in q]  # type: ignore[union-attr]
        values = self.chain.configurations.many(q)
        add(self.chain.configurations.doubts(q))
        return values, names or ("",) * values.shape[1]

    def pose_name(self, q: object) -> str:
        """Return the name of the pose that :meth:`configuration` returns for ``q``, empty if it has none."""
        return q if isinstance(q, str) else next(iter(self.poses), "") if q is None else ""

    @warns_at_end
    def at(self, q: ArrayLike | Mapping[str, float] | str | None = None) -> PoseModel:
        """Return the model at a pose; ``q`` as in :meth:`configuration`.

        Warns of joint values outside their limits, and of the other findings of the posture.
        """
        at = self._at(self.chain.at(self.configuration(q)))
        add(at.posture.findings)
        return at

    @warns_at_end
    def at_many(self, q: ArrayLike | Mapping[str, ArrayLike] | Sequence[object]) -> Iterator[PoseModel]:
        """Return an iterator of the model at P poses, one after another.

        Each equals that of :meth:`at`, to rounding; the joints' frames are computed for many poses at once.

        Parameters
        ----------
        q
            As for :meth:`precision_pin.robot.chain.Chain.at_many`: an array ``(n, P)``, a list of poses (names too), or P
            values for every joint's name.

        Raises
        ------
        InputError
            Wrong joint values, immediately; the errors of :meth:`at`, when the iterator reaches the pose.
        UnknownNameError
            No such joint on the chain.
        """
        values, _ = self.configurations(q)
        add(limit_findings(self.chain, values))
        return self.at_columns(values)

    def at_columns(self, values: Array) -> Iterator[PoseModel]:
        """Return the model at poses ``(n, P)`` as :meth:`configurations` returns them, one after another."""
        return itertools.chain.from_iterable(
            self._at_once(values[:, first : first + _AT_ONCE]) for first in range(0, values.shape[1], _AT_ONCE)
        )

    def statics_findings(self, at: PoseModel) -> tuple[Finding, ...]:
        """Return warnings that the statics are beyond their range of validity.

        ``W_DEFLECTION``: a link bends so far that formulas for small deflections are inaccurate. ``W_STATICS``, nominal
        statics: the tip is farther from that of the arm at rest than a tenth of the spread by tolerances. ``W_STATICS``,
        equilibrium statics: single robots, each solved on its own, differ from the model by more than 0.5 % (the 99 %
        robot of a thousand) or 2 % (the farthest).
        """
        if not any(term.loaded for term in at.terms):
            return ()
        findings = self._nominal_findings(at) if self.statics == "nominal" else self._equilibrium_findings(at)
        return (*_bending_findings(at), *findings)

    def _nominal_findings(self, at: PoseModel) -> tuple[Finding, ...]:
        spread, negligible = spread_of(at)
        try:
            rest_state = settle(at.posture, self.space, self._make_terms, within=1e-3 * negligible)
        except InputError as error:
            return (Finding("warning", "W_STATICS", f"{error.findings[0].message}; nominal statics hide it"),)
        rest = PoseModel(at.posture, self.space, rest_state.table, rest_state.terms)
        gap = float(np.linalg.norm((rest.error_at_means - at.error_at_means)[:3]))
        if gap <= negligible:
            return ()
        message = (
            f"loads at the undeflected pose (statics: nominal) put the tip {gap * 1e3:.3g} mm away from that of the arm at "
            f"rest, more than a tenth of the spread of {spread * 1e3:.3g} mm; use statics: equilibrium"
        )
        return (Finding("warning", "W_STATICS", message),)

    def _equilibrium_findings(self, at: PoseModel) -> tuple[Finding, ...]:
        x = self.space.sample(_TRIED_SEED, 0, _TRIED)
        errors = at.exact(x)
        found: dict[str, str] = {}
        for rank, allowed in _TRIED_RANKS:
            for rows, what, unit in ((slice(0, 3), "|d|", "mm"), (slice(3, 6), "|δ|", "mrad")):
                sizes = np.linalg.norm(errors[rows], axis=0)
                robot = int(np.argsort(-sizes, kind="stable")[rank])
                try:
                    rest_state = settle(at.posture, self.space, self._make_terms, values=x[:, robot])
                except InputError as error:
                    message = f"of {_TRIED:,} robots the one with {what} {1e3 * sizes[robot]:.3g} {unit} fails: "
                    return (Finding("warning", "W_STATICS", message + error.findings[0].message),)
                alone = PoseModel(at.posture, self.space, rest_state.table, rest_state.terms).exact(x[:, [robot]])[:, 0]
                size = float(np.linalg.norm(alone[rows]))
                if abs(sizes[robot] - size) > allowed * size + _NEGLIGIBLE:
                    found[what] = f"{what} {1e3 * sizes[robot]:.4g} {unit} for {1e3 * size:.4g}"
        if not found:
            return ()
        message = (
            f"stiffness or load vary too much for equilibrium statics: compared with {_TRIED:,} robots solved one by one "
            f"the model gives {' and '.join(found.values())}"
        )
        return (Finding("warning", "W_STATICS", message),)

    def __repr__(self) -> str:
        counts = f"sources {len(self.sources)}, draws {len(self.space.draws)}, poses {len(self.poses)}"
        return f"<ErrorModel of {self.chain!r}: {counts}>"

    def _repr_html_(self) -> str:
        """Return the HTML for a notebook: sources with settings, draws with laws and scopes, poses."""
        chain = self.chain
        sources = [[label, _settings(source)] for label, source in zip(self.labels, self.sources, strict=True)]
        draws = [[draw.name, repr(draw.law), draw.scope.value] for draw in self.space.draws]
        poses = [[name, ", ".join(map(joint_value, chain.joints, q))] for name, q in self.poses.items()]
        tables = (
            Table(("source", "settings (SI)"), sources, f"Sources: {len(sources)}", words=2),
            Table(("draw", "law (SI)", "drawn for each"), draws, f"Draws: {len(draws)}", words=3),
            Table(("pose", "joint values"), poses, f"Poses: {len(poses)}", words=2),
        )
        return rendered(
            f"Error model of {os.path.basename(chain.robot.file)}: {chain.base} to {chain.tip}",
            [table for table in tables if table.rows],
            [
                *(f"correlated: {', '.join(group.names)}" for group in self.space.correlations),
                f"statics {self.statics}",
            ],
        )

    def _at_once(self, values: Array) -> Iterable[PoseModel]:
        """Return the model at poses ``(n, P)``, with the terms of all of them made together where the sources accept that."""
        many = self.chain.at_columns(values)
        poses = np.ascontiguousarray(np.moveaxis(many.joint_poses, -1, 0))
        bare = [Posture(self.chain, many.q[:, k].copy(), poses[k], self.chain.loads) for k in range(len(many))]
        if self.statics == "nominal" and len(bare) > 1:
            together = Posture(self.chain, many.q, many.joint_poses, self.chain.loads)
            with suppress(InputError):  # of one pose: it is raised again when its turn comes
                terms = terms_at_many(together, bare, self.bound_sources)
                if terms is not None:
                    return self._models(load_posture(together, self.bound_sources), terms, bare)
        return map(self._at, bare)

    def _models(self, posture: Posture, terms: tuple[Term, ...], bare: Sequence[Posture]) -> Iterator[PoseModel]:
        """Yield the model at each configuration of a posture; the terms have a twist for each."""
        tables = self._layout_of(terms).at_many(posture, terms)
        for k, (one, table) in enumerate(zip(bare, tables, strict=True)):
            loaded = one.with_loads(posture.loads[len(one.loads) :]).with_tilts(posture.tilts)
            yield PoseModel(loaded, self.space, table, TermsOfPose(terms, k))

    def _layout_of(self, terms: tuple[Term, ...]) -> TableLayout:
        """Return the layout of terms: that of the last ones, unless these have other targets or factors."""
        if self._layout is None or not self._layout.fits(terms):
            self._layout = TableLayout.of(terms, self.space)
        return self._layout

    def _at(self, bare: Posture) -> PoseModel:
        """Return the model at a posture with the chain's own loads."""
        posture = load_posture(bare, self.bound_sources)
        if self.statics == "nominal":
            terms = self._make_terms(posture)
        else:
            terms = terms_about_rest(settle(posture, self.space, self._make_terms))
        return PoseModel(posture, self.space, self._layout_of(terms).at(posture, terms), terms)

    @cached_property
    def bound_sources(self) -> tuple[BoundSource, ...]:
        """Every source with the values of its settings."""
        pairs = zip(self.sources, self.labels, strict=True)
        return tuple(BoundSource(source, LabelledSpace(self.space, label)) for source, label in pairs)

    @cached_property
    def draw_words(self) -> tuple[str, ...]:
        """Each draw of the space in words, such as ``tilt of joint2 about z``."""
        return draw_words(self.space, self.sources, self.labels)

    @cached_property
    def owners(self) -> tuple[tuple[str, ...], ...]:
        """Labels of the sources that use each draw of the space."""
        return draw_owners(self.space, self.sources, self.labels)

    def _make_terms(self, posture: Posture) -> tuple[Term, ...]:
        return tuple(itertools.chain.from_iterable(source.terms(posture) for source in self.bound_sources))


def _bending_findings(at: PoseModel) -> tuple[Finding, ...]:
    """Return a warning if loads turn a place too far, every parameter at its mean; it names the place turned most."""
    loaded = TermTable.build(at.posture, at.space, [term for term in at.terms if term.loaded])
    moved = loaded.displacements(loaded.products(loaded.program.evaluate(at.space.mean[:, None])))[:, 3:, 0]
    turns = {
        target.name: float(np.linalg.norm(turn))
        for target, turn in zip(loaded.targets, moved, strict=True)
        if isinstance(target, Place)
    }
    name, turn = max(turns.items(), key=lambda entry: entry[1], default=("", 0.0))
    if turn <= _LARGEST_TURN:
        return ()
    message = (
        f"loads turn the {name} by {turn:.2g} rad: formulas for small deflections are wrong by about "
        f"{20 * turn**2:.1g} % of the deflection"
    )
    return (Finding("warning", "W_DEFLECTION", message),)


def limit_findings(chain: Chain, values: Array) -> tuple[Finding, ...]:
    """Return a warning if poses ``(n, P)`` are outside the joints' limits: their number, and the first of them."""
    outside = chain.configurations.outside(values)
    poses = np.flatnonzero(outside.any(axis=0))
    if not poses.size:
        return ()
    first = int(poses[0])
    joint = chain.joints[int(np.flatnonzero(outside[:, first])[0])]
    message = (
        f"{poses.size:,} of {values.shape[1]:,} poses are outside joint limits, the first of them pose {first}, with the joint "
        f"{joint.name} at {values[chain.joint_index(joint.name), first]:.6g} {'m' if joint.kind == 'prismatic' else 'rad'}"
    )
    return (Finding("warning", "W_JOINT_LIMIT", message, chain.robot.file, joint.line),)


def _read_poses(chain: Chain, poses: Mapping[str, ArrayLike | Mapping[str, float]]) -> dict[str, Array]:
    found = {}
    for name, q in check_mapping("the poses", poses).items():
        try:
            found[name] = chain.configuration(q)
        except InputError as error:
            raise InputError(f"pose {name!r}: {error.findings[0].message}") from None
    return found


def _settings(source: Source) -> str:
    """Return the given settings of a source as text; a draw by its name, or by its law if it has none."""
    texts = []
    for name, value in source.settings().items():
        if isinstance(value, Draw):
            texts.append(f"{name}={value.name or value.law!r}")
        elif value is not None and value != ():
            texts.append(f"{name}={value!r}")
    return ", ".join(texts)
