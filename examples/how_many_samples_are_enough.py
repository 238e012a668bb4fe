"""How many samples are enough?

As many as make the 95 % quantile known to the width that is asked for.
"""

from pathlib import Path

import precision_pin as pp

ROBOTS = Path(pp.__file__).parent / "robots"

model = pp.ErrorModel.load(ROBOTS / "ur5.errors.yaml")
for width in ("0.05 mm", "0.02 mm"):
    result = pp.monte_carlo(model, "ready", samples=200_000, until=f"95 % to {width}")
    low, high = result.position.norm.quantile_interval(0.95)
    print(f"to {width}: {result.samples:,} arms, 95 % within {1e3 * low:.3f} to {1e3 * high:.3f} mm")
