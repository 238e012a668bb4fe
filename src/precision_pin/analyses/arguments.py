"""Checks of the arguments that all analyses have in common."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from precision_pin.analyses.provenance import Pose, Poses, listed_poses
from precision_pin.base.arguments import check_instance, check_items
from precision_pin.base.errors import Finding
from precision_pin.draws.space import check_seed
from precision_pin.model.error_model import ErrorModel
from precision_pin.sampling import Progress, check_progress
from precision_pin.statistics.intervals import check_confidence


def check_common(
    error_model: ErrorModel,
    *,
    seed: int,
    findings: Sequence[Finding],
    progress: Progress | bool | None,
    confidence: float = 0.95,
) -> tuple[Finding, ...]:
    """Check the arguments that all analyses have in common before any work is done; return the findings."""
    check_instance("error_model", error_model, ErrorModel, "as ErrorModel.load makes it")
    check_seed(seed)
    check_confidence(confidence)
    known = check_items("findings", findings, Finding)
    check_progress(progress)
    return known


def check_request(
    error_model: ErrorModel, poses: tuple[Poses, Poses, Poses], **common: Any
) -> tuple[list[Pose], tuple[Finding, ...]]:
    """Check the arguments of an analysis at poses; return a list of these, and the findings.

    Args:
        error_model, common: Arguments of :func:`check_common`.
        poses: The arguments ``poses``, ``q`` and ``pose``, which are synonyms.
    """
    known = check_common(error_model, **common)
    return listed_poses(*poses), known
