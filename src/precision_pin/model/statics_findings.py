"""Warnings about the statics of a pose, and sides of play that flip under an individual robot's load."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, Literal

import numpy as np

from precision_pin.base.errors import Finding, InputError
from precision_pin.draws.expressions import Expression, Program, fix_signs, signs_of
from precision_pin.model.equilibrium import MakeTerms, settle
from precision_pin.model.pose_model import PoseModel, spread_of
from precision_pin.robot.places import Place
from precision_pin.terms.table import TermTable
from precision_pin.terms.term import JointValue

_TRIED: Final = 1000
_TRIED_SEED: Final = 0
_TRIED_RANKS: Final = ((9, 0.005), (0, 0.02))
"""Test of equilibrium statics on single robots: number and seed; ranks by distance, with the allowed difference."""
_NEGLIGIBLE: Final = 1e-9
"""Difference of errors (m, rad) that never causes a warning."""

_LARGEST_TURN: Final = 0.15
"""Rotation of a link's end by loads (rad) that causes a warning: a cantilever's deflection is then wrong by 0.4 %."""


def statics_findings(
    at: PoseModel, statics: Literal["nominal", "equilibrium"], make_terms: MakeTerms
) -> tuple[Finding, ...]:
    """Return the warnings of a pose; see :meth:`precision_pin.model.error_model.ErrorModel.statics_findings`."""
    if not any(term.loaded for term in at.terms):
        return ()
    if statics == "nominal":
        findings = _nominal_findings(at, make_terms)
    else:
        findings = (*_equilibrium_findings(at, make_terms), *resettled_findings(at, make_terms))
    return (*_bending_findings(at), *findings)


def _nominal_findings(at: PoseModel, make_terms: MakeTerms) -> tuple[Finding, ...]:
    spread, negligible = spread_of(at)
    try:
        rest_state = settle(at.posture, at.space, make_terms, within=1e-3 * negligible)
    except InputError as error:
        # a code of its own: accepting that the arm rests elsewhere does not accept that it never rests
        return (Finding("warning", "W_NO_REST", f"{error.findings[0].message}; nominal statics hide it"),)
    rest = PoseModel(at.posture, at.space, rest_state.table, rest_state.terms)
    gap = float(np.linalg.norm((rest.error_at_means - at.error_at_means)[:3]))
    if gap <= negligible:
        return ()
    message = (
        f"loads at the undeflected pose (statics: nominal) put the tip {gap * 1e3:.3g} mm away from that of the arm at "
        f"rest, more than a tenth of the spread of {spread * 1e3:.3g} mm; use statics: equilibrium"
    )
    return (Finding("warning", "W_STATICS", message),)


def _equilibrium_findings(at: PoseModel, make_terms: MakeTerms) -> tuple[Finding, ...]:
    x = at.space.sample(_TRIED_SEED, 0, _TRIED)
    errors = at.exact(x)
    found: dict[str, str] = {}
    for rank, allowed in _TRIED_RANKS:
        for rows, what, unit in ((slice(0, 3), "|d|", "mm"), (slice(3, 6), "|δ|", "mrad")):
            sizes = np.linalg.norm(errors[rows], axis=0)
            robot = int(np.argsort(-sizes, kind="stable")[rank])
            try:
                rest_state = settle(at.posture, at.space, make_terms, values=x[:, robot])
            except InputError as error:
                message = f"of {_TRIED:,} robots the one with {what} {1e3 * sizes[robot]:.3g} {unit} fails: "
                return (Finding("warning", "W_STATICS", message + error.findings[0].message),)
            alone = PoseModel(at.posture, at.space, rest_state.table, rest_state.terms).exact(x[:, [robot]])[:, 0]
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


def _bending_findings(at: PoseModel) -> tuple[Finding, ...]:
    """Return a warning that names the place turned most if loads, at the means, turn a place too far."""
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


TRIED_SIDES: Final = 4096
"""Robots for counting the fraction with play on another side."""
_SEED: Final = 0
RESETTLED: Final = 1000
"""Robots of which one close to a turnover is solved alone."""
_FEWEST: Final = 1e-3
"""Smallest fraction of robots that triggers a warning."""
MOST_SIDES: Final = 6
"""Most sides whose every combination is tried."""


def fixed_sides(at: PoseModel) -> PoseModel:
    """Return the model with every robot's play on the side it has at the means of all parameters."""
    signs = _signs(at)
    return _with_sides(at, dict(zip(signs, _at_means(at, signs), strict=True))) if signs else at


def side_variants(at: PoseModel) -> tuple[PoseModel, ...]:
    """Return the model with every combination of up to six sides; with more, that at the means alone."""
    signs = _signs(at)
    if not signs:
        return (at,)
    if len(signs) > MOST_SIDES:
        return (fixed_sides(at),)
    choices = np.stack(np.meshgrid(*[[1.0, -1.0]] * len(signs)), axis=-1).reshape(-1, len(signs))
    return tuple(_with_sides(at, dict(zip(signs, choice.tolist(), strict=True))) for choice in choices)


def turnover_findings(at: PoseModel) -> tuple[Finding, ...]:
    """Return a warning if the load puts play on its other side in some robots, which the model at the means ignores."""
    # some: at least one in a thousand of the 4,096 robots tried
    signs = _signs(at)
    if not signs:
        return ()
    x = at.space.sample(_SEED, 0, TRIED_SIDES)
    elsewhere = Program.compile(signs, at.space.index).evaluate(x) != np.array(_at_means(at, signs))[:, None]
    share = float(elsewhere.any(axis=0).mean())
    if share < _FEWEST:
        return ()
    turned = {sign for sign, of_robots in zip(signs, elsewhere.mean(axis=1), strict=True) if of_robots >= _FEWEST}
    names = at.posture.chain.joint_names
    places = {
        names[term.target.joint] if isinstance(term.target, JointValue) else term.target.name
        for term in at.terms
        if turned & set(signs_of(term.factors))
    }
    moved = np.linalg.norm((at.linear(x) - fixed_sides(at).linear(x))[:3], axis=0)
    message = (
        f"at {', '.join(sorted(places))} the load of {100 * share:.2g} % of robots takes up play on another side than the "
        f"mean load, which moves the tip by up to {1e3 * float(moved.max()):.3g} mm; what is computed at first order takes "
        "the side of the mean load, what is sampled takes each robot's own"
    )
    return (Finding("warning", "W_TURNOVER", message),)


def resettled_findings(at: PoseModel, make_terms: MakeTerms) -> tuple[Finding, ...]:
    """Return a warning if robots solved one by one take up play on other sides than in equilibrium statics."""
    # There the loads act on the arm at rest under the mean loads, with a robot's deflections to first order. The robot
    # tried is as close to a turnover as the closest 1 % of a thousand.
    signs = _signs(at)
    if not signs:
        return ()
    x = at.space.sample(_SEED, 0, RESETTLED)
    margins = Program.compile([sign.arguments[0] for sign in signs], at.space.index).evaluate(x)  # type: ignore[attr-defined]
    spreads = margins.std(axis=1, keepdims=True)
    closest = np.abs(margins / np.where(spreads > 0, spreads, np.inf)) + np.where(spreads > 0, 0.0, np.inf)
    robot = int(np.argsort(closest.min(axis=0), kind="stable")[RESETTLED // 100 - 1])
    try:
        rest = settle(at.posture, at.space, make_terms, values=x[:, robot])
    except InputError as error:
        message = f"of {RESETTLED:,} robots one that is close to a turnover fails: {error.findings[0].message}"
        return (Finding("warning", "W_STATICS", message),)
    alone = _signs(replace(at, terms=rest.terms, table=rest.table))
    if len(alone) != len(signs):
        return ()
    sides, sides_alone = (Program.compile(found, at.space.index).evaluate(x[:, [robot]]) for found in (signs, alone))
    if (sides == sides_alone).all():
        return ()
    message = (
        "the load of each robot changes with its own deflection, which equilibrium statics leaves out where play is taken up: "
        "it has 1 % of robots or more on other sides than robots solved one by one"
    )
    return (Finding("warning", "W_TURNOVER", message),)


def _signs(at: PoseModel) -> list[Expression]:
    return list(dict.fromkeys(sign for term in at.terms for sign in signs_of(term.factors)))


def _at_means(at: PoseModel, signs: list[Expression]) -> list[float]:
    return Program.compile(signs, at.space.index).evaluate(at.space.mean[:, None])[:, 0].tolist()


def _with_sides(at: PoseModel, sides: dict[Expression, float]) -> PoseModel:
    terms = tuple(
        replace(term, factors=tuple(fix_signs(factor, sides) for factor in term.factors)) for term in at.terms
    )
    return replace(at, table=TermTable.build(at.posture, at.space, terms), terms=terms)
