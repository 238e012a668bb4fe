"""Warnings that the statics of a pose are beyond their range of validity."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from precision_pin.base.errors import Finding, InputError
from precision_pin.model.backlash_sides import resettled_findings
from precision_pin.model.equilibrium import MakeTerms, settle
from precision_pin.model.pose_model import PoseModel, spread_of
from precision_pin.robot.places import Place
from precision_pin.terms.table import TermTable

_TRIED: Final = 1000
_TRIED_SEED: Final = 0
_TRIED_RANKS: Final = ((9, 0.005), (0, 0.02))
"""Test of equilibrium statics on single robots: their number and seed; ranks by distance, with the allowed difference."""
_NEGLIGIBLE: Final = 1e-9
"""Difference of errors (m, rad) that never causes a warning."""

_LARGEST_TURN: Final = 0.15
"""Rotation of a link's end by loads (rad) above which a warning is given: a cantilever's deflection is then wrong by 0.4 %."""


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
        # a code of its own: whoever accepts that the arm at rest is elsewhere does not accept that there is none
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
