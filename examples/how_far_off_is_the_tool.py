"""How far off is the tool?

A UR5 that is driven with the nominal dimensions of its URDF, not with its factory calibration.
"""

from pathlib import Path

import precision_pin as pp

ROBOTS = Path(pp.__file__).parent / "robots"

model = pp.ErrorModel.load(ROBOTS / "ur5.errors.yaml")
result = pp.monte_carlo(model, "ready", samples=20_000, specifications="2 mm @ 95 %")

error = result.position.norm
low, high = error.quantile_interval(0.95)
specification = result.summary.specifications[0]
print(f"median {1e3 * error.quantile(0.5):.2f} mm")
print(f"95 of 100 arms within {1e3 * error.quantile(0.95):.2f} mm ({1e3 * low:.2f} to {1e3 * high:.2f} mm)")
print(f"within 2 mm: {specification.probability:.0%} of the arms, {specification.verdict}")

result.plot().savefig("how_far_off_is_the_tool.png")
