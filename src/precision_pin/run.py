"""Sampling a pose in blocks, merged in block order.

A block is a fixed run of units; its statistics depend on seed and block number only, so that a result has the same
bits whatever the number of threads.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin import kernel
from precision_pin.errors import Finding, InputError
from precision_pin.model import ErrorModel
from precision_pin.result import Analysis, Correlated
from precision_pin.space import Scope, check_seed
from precision_pin.statistics import Plan, Specification, finish, start

__all__ = ["MOST_SAMPLES", "Progress", "monte_carlo"]

Array = NDArray[np.float64]
Progress = Callable[[int], None]
"""Told how many samples have been added since it was last called."""

MOST_SAMPLES: Final = 10**12

BLOCKS_IN_A_TASK: Final = 16
"""The most blocks that a thread takes at a time."""


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
    threads: int | None = None,
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
    threads
        How many threads sample; all cores if left out. The result has the same bits whatever their number.
    progress
        Called after every few blocks.

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
    table = kernel.compile_table(at)
    state = start(plan)
    kept = np.empty((6, samples)) if keep_samples else None

    def observe(blocks: range) -> kernel.Blocks:
        return kernel.observe_blocks(
            table, plan, model, seed, blocks.start, len(blocks), samples=samples, keep_errors=keep_samples
        )

    for found in in_order(observe, tasks_of(samples), threads or available_cores()):
        if kept is not None and found.errors is not None:
            kept[:, state.count : state.count + found.count] = found.errors
        state = found.added_to(state)
        if progress is not None:
            progress(found.count)
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
        correlations=Correlated.all_of(at.space),
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


def tasks_of(samples: int) -> list[range]:
    """Return which blocks each task takes: enough to keep a core busy, never so many that progress stalls."""
    blocks = -(-samples // kernel.BLOCK)
    size = min(BLOCKS_IN_A_TASK, max(1, blocks // 8))
    return [range(first, min(first + size, blocks)) for first in range(0, blocks, size)]


def available_cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_order(
    observe: Callable[[range], kernel.Blocks], tasks: Sequence[range], threads: int
) -> Iterator[kernel.Blocks]:
    """Yield what every task gives, in the order of the tasks, with twice as many under way as there are threads."""
    with ThreadPoolExecutor(max_workers=max(1, min(threads, len(tasks)))) as pool:
        waiting: deque[Future[kernel.Blocks]] = deque()
        try:
            for task in tasks:
                if len(waiting) >= 2 * threads:
                    yield waiting.popleft().result()
                waiting.append(pool.submit(observe, task))
            while waiting:
                yield waiting.popleft().result()
        finally:
            # a caller that stops early (Ctrl-C) waits for the tasks under way only
            pool.shutdown(wait=True, cancel_futures=True)
