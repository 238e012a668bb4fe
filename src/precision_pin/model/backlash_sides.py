"""Sides of play that turn over with the load of single robots: how many, and what results without sampling leave out."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from precision_pin.base.errors import Finding, InputError
from precision_pin.draws.expressions import Expression, Program, fix_signs, signs_of
from precision_pin.model.equilibrium import MakeTerms, settle
from precision_pin.model.pose_model import PoseModel
from precision_pin.terms.table import TermTable
from precision_pin.terms.term import JointValue

TRIED: Final = 4096
"""Robots of which the share on another side is counted."""
_SEED: Final = 0
RESETTLED: Final = 1000
"""Robots of which one close to a turnover is solved alone."""
_NEGLIGIBLE: Final = 1e-3
"""Share of robots below which nothing is said."""
MOST_SIDES: Final = 6
"""Largest number of sides of which every combination is tried."""


def fixed_sides(at: PoseModel) -> PoseModel:
    """Return the model in which every robot's play lies where it lies with every parameter at its mean."""
    signs = _signs(at)
    return _with_sides(at, dict(zip(signs, _at_means(at, signs), strict=True))) if signs else at


def side_variants(at: PoseModel) -> tuple[PoseModel, ...]:
    """Return the model with every combination of sides fixed, of up to six sides; with more, that at the means alone."""
    signs = _signs(at)
    if not signs:
        return (at,)
    if len(signs) > MOST_SIDES:
        return (fixed_sides(at),)
    choices = np.stack(np.meshgrid(*[[1.0, -1.0]] * len(signs)), axis=-1).reshape(-1, len(signs))
    return tuple(_with_sides(at, dict(zip(signs, choice.tolist(), strict=True))) for choice in choices)


def turnover_findings(at: PoseModel) -> tuple[Finding, ...]:
    """Return a warning if results from the model at the means leave out that sides of play turn over with the load.

    Counted over 4,096 robots; nothing is said below one in a thousand.
    """
    signs = _signs(at)
    if not signs:
        return ()
    x = at.space.sample(_SEED, 0, TRIED)
    elsewhere = Program.compile(signs, at.space.index).evaluate(x) != np.array(_at_means(at, signs))[:, None]
    share = float(elsewhere.any(axis=0).mean())
    if share < _NEGLIGIBLE:
        return ()
    turned = {sign for sign, of_robots in zip(signs, elsewhere.mean(axis=1), strict=True) if of_robots >= _NEGLIGIBLE}
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
    """Return a warning if robots solved one by one take up play on other sides than equilibrium statics says.

    Its loads act on the arm at rest under the mean loads, with the deflections of a single robot to first order. The robot
    that is tried is as close to a turnover as the closest 1 % of a thousand.
    """
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
    """Return the signs that decide sides, each once."""
    return list(dict.fromkeys(sign for term in at.terms for sign in signs_of(term.factors)))


def _at_means(at: PoseModel, signs: list[Expression]) -> list[float]:
    values: list[float] = Program.compile(signs, at.space.index).evaluate(at.space.mean[:, None])[:, 0].tolist()
    return values


def _with_sides(at: PoseModel, sides: dict[Expression, float]) -> PoseModel:
    """Return the model with signs replaced by numbers."""
    terms = tuple(
        replace(term, factors=tuple(fix_signs(factor, sides) for factor in term.factors)) for term in at.terms
    )
    return replace(at, table=TermTable.build(at.posture, at.space, terms), terms=terms)
