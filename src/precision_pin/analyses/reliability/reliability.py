"""Probability that the error stays inside a limit, including failures too rare for plain sampling.

Plain sampling, FORM, importance sampling and subset simulation estimate the same probability with the exact model.
Contradictions between them are reported in the result.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from precision_pin.analyses.arguments import check_request
from precision_pin.analyses.provenance import PoseLabel, Poses, Provenance
from precision_pin.analyses.reliability.estimates import plain_estimate
from precision_pin.analyses.reliability.form import DesignPoint
from precision_pin.analyses.reliability.rare_events import rare_events
from precision_pin.analyses.reliability.reliability_result import (
    LikelyFailure,
    PoseReliability,
    ReliabilityResult,
    SpecificationReliability,
)
from precision_pin.analyses.reliability.strata import Stratum
from precision_pin.analyses.result import list_warnings
from precision_pin.base.arrays import Array
from precision_pin.base.call_warnings import warns_at_end
from precision_pin.base.errors import Finding, InputError
from precision_pin.kernel import sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.sampling import Progress, monte_carlo
from precision_pin.statistics import Specification, SpecificationResult, quantity_values
from precision_pin.statistics.plan import Specifications, listed_specifications

LISTED: Final = 3
"""Number of design points that are listed in full."""

# directions to the 26 faces, edges and corners of a cube
_NORM_STARTS: Final = np.array([n for n in np.ndindex(3, 3, 3) if n != (1, 1, 1)], dtype=float).T - 1.0

_REPEATS: Final = 4
_ASIDE: Final = 0.3


@warns_at_end
def reliability(
    error_model: ErrorModel,
    /,
    specifications: Specifications,
    pose: Poses = None,
    *,
    poses: Poses = None,
    q: Poses = None,
    seed: int = 0,
    samples: int = 100_000,
    confidence: float = 0.95,
    findings: Sequence[Finding] = (),
    progress: Progress | bool | None = None,
) -> ReliabilityResult:
    """Return the probability that the exact model's error keeps each specification, by several methods.

    Args:
        error_model: Chain, draws and sources.
        specifications: Limits of position, attitude or a component, one or a list, each from
            :func:`precision_pin.specification` or its text.
        pose, poses, q: A pose (a name, joint values, or None for the model's first) or a list of poses. The three
            arguments are synonyms.
        seed, samples, confidence: Seed and confidence of all methods; number of plain samples.
        findings: Warnings to include in the result, such as those of the sheet.
        progress: Function called with the number of plain samples added since its last call; ``True`` shows a bar.

    Raises:
        InputError: No specification, a wrong pose, seed, number of samples or confidence, or errors too large to
            compute with.
    """
    chosen, known = check_request(
        error_model, (poses, q, pose), seed=seed, confidence=confidence, findings=findings, progress=progress
    )
    listed = listed_specifications(specifications)
    if not listed:
        raise InputError("no specification is given; give at least one, such as '0.5 mm @ 99.73 %'")
    found: list[PoseReliability] = []
    warnings: list[str] = []
    for one in chosen:
        analysis = monte_carlo(
            error_model, one, samples=samples, seed=seed, specifications=listed, confidence=confidence,
            findings=findings, progress=progress,
        )  # fmt: skip
        warnings += analysis.warnings
        at = error_model.at(one)
        layout = sampler.to_arrays(at)
        results = [
            _of_specification(at, layout, specification, counted, samples, seed, confidence)
            for specification, counted in zip(listed, analysis.summary.specifications, strict=True)
        ]
        found.append(PoseReliability(PoseLabel.of(error_model, one, at), tuple(results)))
    return ReliabilityResult(
        provenance=Provenance.of(error_model, seed),
        samples=int(samples),
        confidence=float(confidence),
        poses=tuple(found),
        findings=known,
        warnings=list_warnings(known, warnings),
    )


def _margin(layout: SamplerArrays, specification: Specification) -> Callable[[Array], Array]:
    """Return the margin to the limit, relative to the limit, as a function of component values."""

    def margin(x: Array) -> Array:
        errors = sampler.errors_at(layout, "exact", x)
        return 1 - np.abs(quantity_values(errors)[specification.row]) / specification.limit

    return margin


def _starts(at: PoseModel, specification: Specification) -> list[Array]:
    """Return the starting points of the search, two standard deviations along the tangent's steepest directions."""
    rows = slice(0, 3) if specification.quantity.startswith("position") else slice(3, 6)
    part = specification.quantity.rpartition(".")[2]
    directions = (
        _NORM_STARTS if part == "norm" else np.tile(np.eye(3)[:, ["xyz".index(part)]] * [[1.0, -1.0]], _REPEATS)
    )
    spread = np.sqrt(at.space.block_covariance.variances)
    ways = (at.jacobian[rows] * spread).T @ directions
    lengths = np.linalg.norm(ways, axis=0)
    # a small random offset, because a gradient may vanish by symmetry
    aside = _ASIDE * np.random.Generator(np.random.Philox(0)).standard_normal(ways.shape)
    out = 2 * np.divide(ways, lengths, out=np.zeros_like(ways), where=lengths > 0)
    return list((out + aside).T)


def _of_specification(
    at: PoseModel,
    layout: SamplerArrays,
    specification: Specification,
    counted: SpecificationResult,
    samples: int,
    seed: int,
    confidence: float,
) -> SpecificationReliability:
    inside = round(counted.probability * samples)
    plain = plain_estimate(samples - inside, samples, confidence)
    found = rare_events(at.space, _margin(layout, specification), _starts(at, specification), plain, seed, confidence)
    failures = (_describe_failure(at, layout, one, found.strata.parts) for one in found.form.points[:LISTED])
    return SpecificationReliability(
        **vars(found),
        specification=specification,
        failures=tuple(failures),
        varies=counted.varies,
        grounds=counted.grounds,
    )


def _describe_failure(
    at: PoseModel, layout: SamplerArrays, point: DesignPoint, strata: Sequence[Stratum]
) -> LikelyFailure:
    """Return parameters, error and importance of each draw at a design point."""
    x = strata[point.stratum].values(point.u[:, None])
    groups = {draw.name: draw.name for draw in at.space.draws}
    for correlation in at.space.correlations:
        groups |= dict.fromkeys(correlation.names, " + ".join(correlation.names))
    shares: dict[str, float] = {}
    for draw, columns in zip(at.space.draws, at.space.slices, strict=True):
        name = groups[draw.name]
        shares[name] = shares.get(name, 0.0) + float(point.importance[columns].sum())
    return LikelyFailure(
        beta=point.beta,
        probability=point.probability,
        parameters=dict(zip(at.space.components, map(float, x[:, 0]), strict=True)),
        error=sampler.errors_at(layout, "exact", x)[:, 0],
        importance=dict(sorted(shares.items(), key=lambda entry: -entry[1])),
    )
