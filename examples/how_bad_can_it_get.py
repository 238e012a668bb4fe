"""How bad can it get?

All tolerances at their limits at once, against what is seen of a thousand arms.
"""

from pathlib import Path

import precision_pin as pp

ROBOTS = Path(pp.__file__).parent / "robots"

model = pp.ErrorModel.load(ROBOTS / "4dof.errors.yaml")
worst = pp.worst_case(model, "paper", samples=1000).poses[0].position

print(f"no arm is farther off than {1e3 * worst.found.norm:.1f} mm")
print(f"the worst of 1000 arms is off by {1e3 * worst.seen.max:.1f} mm")
print(f"{1e3 * worst.nominal:.1f} mm are the sag of every arm; the largest shares of the rest:")
for entry in worst.contributions[:3]:
    print(f"  {1e3 * entry.value:.1f} mm of {entry.draw}, at {entry.at}")
