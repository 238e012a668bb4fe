"""Error bounds of computed quantiles, given a bound of the error of the cumulative law.

With |F̂ - F| ≤ ε, the p-quantile of F lies between those of F̂ at p - ε and p + ε. Where the law has a density, a width δ of
about 2ε divided by the density is tried: F̂(q - δ) ≤ p - ε and F̂(q + δ) ≥ p + ε prove it. Elsewhere both quantiles of F̂
are computed.
"""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np

from precision_pin.base.arrays import Array

_ROUNDING: Final = 1e-15


class _Law(Protocol):
    @property
    def low(self) -> float: ...

    @property
    def high(self) -> float: ...

    @property
    def error(self) -> float: ...

    def cumulative(self, x: Array, /) -> Array: ...

    def density(self, x: Array, /) -> Array: ...

    def quantile(self, p: float, /) -> float: ...


def quantile_bounds(law: _Law, levels: Array, quantiles: Array) -> Array:
    """Return error bounds of quantiles ``(N,)`` of a law at these levels, from the law's own error bound."""
    rounding = _ROUNDING * (np.abs(quantiles) + law.high - law.low)
    with np.errstate(divide="ignore", invalid="ignore"):
        width = 2 * law.error / law.density(quantiles) + rounding
    tried = np.isfinite(width)
    safe = np.where(tried, width, 0.0)
    proved = tried & (law.cumulative(quantiles - safe) <= levels - law.error)
    proved &= law.cumulative(quantiles + safe) >= levels + law.error
    for k in np.flatnonzero(~proved):
        lower = law.quantile(max(levels[k] - law.error, law.error))
        upper = law.quantile(min(levels[k] + law.error, 1 - law.error))
        safe[k] = max(quantiles[k] - lower, upper - quantiles[k], 0.0) + rounding[k]
    return safe
