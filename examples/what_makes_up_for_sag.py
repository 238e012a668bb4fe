"""Which joint values make up for the sag?"""

from pathlib import Path

import numpy as np

import precision_pin as pp

ROBOTS = Path(pp.__file__).parent / "robots"

model = pp.ErrorModel.load(ROBOTS / "4dof.errors.yaml")
result = pp.compensate(model, ["paper"])

correction = result.correction
before, after = (np.linalg.norm(error[:3, 0]) for error in (correction.before, correction.after))
print(f"the tool sags by {1e3 * before:.1f} mm; with the joint values below by {1e6 * after:.1f} um")
for joint, nominal, corrected in zip(result.joints, model.configuration("paper"), result.corrected[:, 0], strict=True):
    print(f"  {joint}: {np.degrees(nominal):7.3f}° -> {np.degrees(corrected):7.3f}°")
print(f"95 % of the arms are then within {1e3 * result.within_after[0, 0]:.1f} mm ", end="")
print(f"instead of {1e3 * result.within_before[0, 0]:.1f} mm")
