"""Sampled part of a budget: Sobol indices, quantiles and effects of halved tolerances of the exact model at one pose."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, final

import numpy as np

from precision_pin.analyses.budget import sobol
from precision_pin.analyses.budget.budget_result import VECTORS, Estimate, Group, Halved, Sums
from precision_pin.analyses.budget.shares import COMPONENTS, ROUNDING, deviations_of, group_part, shares_of
from precision_pin.analyses.replicates import REPLICATES, Estimates, Marginals, law_breaks
from precision_pin.base.arrays import Array
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.model.pose_model import PoseModel
from precision_pin.statistics import NORMS as NORM_ROWS
from precision_pin.statistics import QUANTITIES, quantity_values

MARKED: Final = 0.95
"""Probability of the quantile on which the effect of a halved tolerance is given."""

NONLINEAR: Final = 0.01
"""Difference of a share between closed form and sampling, beyond the interval, above which it counts as nonlinear."""

NORMS: Final = tuple(QUANTITIES[row] for row in NORM_ROWS)

SAMPLED: Final = (*VECTORS, *QUANTITIES)
_NOTHING: Final = Estimate(0.0, (0.0, 0.0))
_TOGETHER: Final = np.array(
    [[float(quantity in COMPONENTS and quantity.startswith(vector)) for quantity in QUANTITIES] for vector in VECTORS]
    + [[float(quantity == other) for other in QUANTITIES] for quantity in QUANTITIES]
)


def list_random_draws(space: Space) -> list[bool]:
    """Return, for each draw, whether it varies."""
    variances = space.block_covariance.variances
    return [bool(variances[rows].any()) for rows in space.slices]


@final
class SampledBudget:
    """Estimates of the exact model at one pose."""

    def __init__(
        self,
        at: PoseModel,
        groups: Sequence[tuple[int, ...]],
        seed: int,
        samples: int,
        confidence: float,
        step: Callable[[int], None],
    ) -> None:
        self.at, self.confidence, self.group_draws = at, confidence, groups
        self.samples, self.step = samples, step
        self.layout = sampler.to_arrays(at)
        size, slices = at.space.size, at.space.slices
        self.random = list_random_draws(at.space)
        points = (
            sobol.scrambled_points(2 * size, seed, samples // REPLICATES, lambda: step(0))
            if size
            else np.zeros((0, samples))
        )
        self.points = points[:size]
        # groups that do not vary need no sampling: their indices are zero
        self.sampled = [k for k, group in enumerate(groups) if any(self.random[draw] for draw in group)]
        self.indices = sobol.sobol_indices(
            lambda uniforms: quantity_values(self._errors(at.space.inverse(uniforms))),
            self.points,
            points[size:],
            [np.concatenate([np.arange(size)[slices[draw]] for draw in groups[k]]) for k in self.sampled],
            outputs=_TOGETHER,
            smallest=ROUNDING**2,
            confidence=confidence,
            breaks=law_breaks(at.space),
        )
        self.x = at.space.inverse(self.points)
        self.norms = self._norms(self.x)
        self.marginals = Marginals.of(size, samples // REPLICATES, is_net=True, breaks=law_breaks(at.space))
        self.nodes = at.space.inverse(self.marginals.uniforms)
        self.known = sobol.found_quantiles(self.norms, MARKED)
        self.quantiles = _estimates(self.known.estimates(confidence))

    def _errors(self, x: Array) -> Array:
        errors = sampler.errors_at(self.layout, "exact", x)
        # the nodes are few and not counted as progress
        self.step(self.samples if x.shape[1] == self.samples else 0)
        return errors

    def _norms(self, x: Array) -> Array:
        return quantity_values(self._errors(x))[list(NORM_ROWS)]

    def halve_each(self) -> list[Halved]:
        """Return the effect of halving each draw's deviation from its mean, with the same random numbers otherwise."""
        return [self._halve(k) for k in range(len(self.random))]

    def _halve(self, draw: int) -> Halved:
        rows = self.at.space.slices[draw]
        factors = np.ones(self.at.space.size)
        factors[rows] = 0.5
        std = deviations_of(self.at.space.block_covariance.variances_of(self.at.jacobian * factors))
        if not self.random[draw]:
            return Halved(std, dict(zip(NORMS, self.quantiles, strict=True)), dict.fromkeys(NORMS, _NOTHING))
        halved, unseen = self._norms(self._with_half(self.x, rows)), self._estimate_unseen_change(rows)
        found = sobol.quantile_changes(halved, self.known, MARKED, self.confidence, unseen)
        values, changes = (dict(zip(NORMS, _estimates(one), strict=True)) for one in found)
        return Halved(std, values, changes)

    def _with_half(self, x: Array, rows: slice) -> Array:
        """Return the samples with half the deviation in some rows."""
        result = x.copy()
        mean = self.at.space.mean[rows, None]
        result[rows] = mean + (x[rows] - mean) / 2
        return result

    def _estimate_unseen_change(self, rows: slice) -> Array:
        """Return the possible change of the norms by halving in regions without points."""
        nodes, weights = self.marginals.outermost(range(rows.start, rows.stop), self.x.shape[1])
        x = self.nodes[:, nodes]
        return np.abs(self._norms(self._with_half(x, rows)) - self._norms(x)) @ weights

    def groups(self, shares: Array, variances: Array) -> tuple[Group, ...]:
        """Return indices and closed-form share of every group."""
        names = [draw.name for draw in self.at.space.draws]
        spreads = zip(SAMPLED, self.indices.varies.tolist(), strict=True)
        none = {quantity: _NOTHING if spread else None for quantity, spread in spreads}
        result = []
        for k, group in enumerate(self.group_draws):
            closed = shares_of(group_part(self.at, group, shares), variances)
            first = self._row(self.indices.first, k) if k in self.sampled else none
            total = self._row(self.indices.total, k) if k in self.sampled else none
            nonlinear = tuple(one for one in closed if _differs(closed[one], first[one], total[one]))
            result.append(Group(tuple(names[draw] for draw in group), closed, first, total, nonlinear))
        return tuple(result)

    def sums(self, shares: Array, variances: Array) -> dict[str, Sums]:
        """Return the sum checks of every quantity."""
        parts = [group_part(self.at, group, shares) for group in self.group_draws]
        closed = shares_of(np.sum(parts, axis=0) if parts else np.zeros(6), variances)
        deviations = deviations_of(variances)
        first = _by_quantity(self.indices.first_sum)
        variance = _by_quantity(self.indices.variance)
        return {one: Sums(closed.get(one), first[one], deviations.get(one), variance[one]) for one in SAMPLED}

    def _row(self, estimates: Estimates, group: int) -> dict[str, Estimate | None]:
        k = self.sampled.index(group)
        return _by_quantity(Estimates(estimates.value[k], estimates.half_width[k], estimates.replicate_variance[k]))


def _differs(closed: float | None, first: Estimate | None, total: Estimate | None) -> bool:
    if first is None or total is None:
        return False
    shares = 0.0 if closed is None else closed
    return any(abs(index.value - shares) > NONLINEAR + index.half_width for index in (first, total))


def _by_quantity(estimates: Estimates) -> dict[str, Estimate | None]:
    return dict(zip(SAMPLED, _estimates(estimates), strict=True))


def _estimates(estimates: Estimates) -> list[Estimate | None]:
    return [
        None
        if np.isnan(value) or np.isnan(half)
        else Estimate(float(value), (float(value - half), float(value + half)))
        for value, half in zip(estimates.value, estimates.half_width, strict=True)
    ]
