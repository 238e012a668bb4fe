"""Sampling a pose in blocks, merged in block order.

A block is a fixed run of units; its statistics depend on seed and block number only, so that a result has the same
bits whatever the number of threads.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.errors import Finding, InputError
from precision_pin.model import ErrorModel, PoseModel
from precision_pin.result import Analysis
from precision_pin.space import Scope, check_seed
from precision_pin.statistics import Plan, Specification, finish, merge, observe, start

__all__ = ["BLOCK", "MOST_SAMPLES", "Progress", "monte_carlo"]

Array = NDArray[np.float64]
Progress = Callable[[int], None]
"""Told how many samples have been added since it was last called."""

BLOCK: Final = 16_384
"""Units in a block: part of what makes results reproducible."""

MOST_SAMPLES: Final = 10**12


def monte_carlo(
    error_model: ErrorModel,
    q: ArrayLike | Mapping[str, float] | str | None = None,
    /,
    *,
    samples: int = 100_000,
    seed: int = 0,
    model: Literal["exact", "linear"] = "exact",
    specifications: Sequence[Specification] = (),
    keep_samples: bool = False,
    confidence: float = 0.95,
    findings: Sequence[Finding] = (),
    progress: Progress | None = None,
) -> Analysis:
    """Sample the pose error at one pose (section 4 of Wei, Jia and Chen, 2015).

    Parameters
    ----------
    error_model
        Chain, draws and sources.
    q
        The pose: joint values in chain order, by joint name, a pose's name, or the model's first pose if left out.
    samples
        How many built robots.
    seed
        64-bit seed.
    model
        ``"exact"`` multiplies the displaced chain out, ``"linear"`` superposes (eqs 12-17).
    specifications
        Limits to count against.
    keep_samples
        Keep every error, ``(6, samples)``.
    confidence
        Of every interval.
    findings
        Warnings to carry along, such as those of the sheet.
    progress
        Called after every block.

    Raises
    ------
    InputError
        A wrong number of samples, seed, model, confidence or pose, or errors too large to compute with.
    """
    check_samples(samples)
    check_seed(seed)
    if model not in ("exact", "linear"):
        raise InputError(f"model must be exact or linear, got {model!r}")
    if not 0 < confidence < 1:
        raise InputError(f"confidence {confidence!r}; it must lie above 0 and below 1")
    try:
        with np.errstate(over="raise"):
            at = error_model.at(q)
            error, _ = at.tangent
            plan = Plan.from_moments(error, at.covariance, tuple(specifications))
    except (OverflowError, FloatingPointError):
        raise InputError(
            "the errors at this pose are beyond any number; the tolerances or loads are far too large"
        ) from None
    state = start(plan)
    kept = np.empty((6, samples)) if keep_samples else None
    for first in range(0, samples, BLOCK):
        count = min(BLOCK, samples - first)
        errors = _errors(at, model, seed, first, count)
        state = merge(state, observe(plan, start(plan), errors))
        if kept is not None:
            kept[:, first : first + count] = errors
        if progress is not None:
            progress(count)
    chain = error_model.chain
    warnings = (*findings, *at.findings(model), *error_model.statics_findings(at))
    return Analysis(
        robot=os.path.basename(chain.robot.file),
        base=chain.base,
        tip=chain.tip,
        pose_name=error_model.pose_name(q),
        q=dict(zip(chain.joint_names, map(float, at.posture.q), strict=True)),
        seed=int(seed),
        model=model,
        statics=error_model.statics,
        scopes={scope.value: sum(draw.law.size for draw in at.space.draws if draw.scope is scope) for scope in Scope},
        nominal=error,
        sliding_joints=tuple(joint.name for joint in chain.joints if joint.kind == "prismatic"),
        summary=finish(plan, state, confidence),
        warnings=tuple(str(finding) for finding in warnings),
        errors=kept,
    )


def check_samples(samples: int) -> None:
    """Refuse a number of samples that is not a whole number from 1 to 10¹².

    Raises
    ------
    InputError
        It is not.
    """
    if isinstance(samples, bool) or not isinstance(samples, int | np.integer) or not 1 <= samples <= MOST_SAMPLES:
        raise InputError(f"the number of samples must be a whole number from 1 to {MOST_SAMPLES:.0e}, got {samples!r}")


def _errors(at: PoseModel, model: str, seed: int, first: int, count: int) -> Array:
    x = at.space.sample(seed, first, count)
    return at.linear(x) if model == "linear" else at.exact(x)
