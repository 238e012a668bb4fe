"""Do 99.9999 % of the arms keep 18.5 mm in x?

Plain sampling would need more than ten million arms to see ten misses.
"""

from pathlib import Path

import precision_pin as pp

ROBOTS = Path(pp.__file__).parent / "robots"

model = pp.ErrorModel.load(ROBOTS / "4dof.errors.yaml")
result = pp.reliability(model, "x 18.5 mm @ 99.9999 %", "paper", samples=4000)

found = result.poses[0].specifications[0]
low, high = found.best.interval
print(f"{'yes' if found.met else 'no'}: {found.best.probability:.1e} of the arms miss it ({low:.1e} to {high:.1e})")
for estimate in found.estimates:
    print(f"  {estimate.method}: {estimate.probability:.1e} from {estimate.evaluations:,} arms")

cause, share = next(iter(found.failures[0].importance.items()))
print(f"first cause: {cause}, {share:.0%}")
