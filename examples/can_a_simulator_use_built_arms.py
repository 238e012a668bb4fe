"""Can a simulator use built arms?

Three arms as they may be built, as URDF files for any simulator or planner.
"""

import subprocess
import sys
from pathlib import Path

import numpy as np

import precision_pin as pp

ROBOTS = Path(pp.__file__).parent / "robots"

command = f"export {ROBOTS / 'ur5e.errors.yaml'} --units 3 --seed 7 --out built"
subprocess.run([sys.executable, "-m", "precision_pin", *command.split()], check=True, capture_output=True)

model = pp.ErrorModel.load(ROBOTS / "ur5e.errors.yaml")
drawn = model.at().posture.pose
for file in sorted(Path("built").glob("*.urdf")):
    arm = pp.Chain.from_urdf(file, tip=model.chain.tip)
    tool = arm.at(model.configuration()).pose
    print(f"{file.name}: tool off by {1e3 * np.linalg.norm(tool[:3, 3] - drawn[:3, 3]):.2f} mm")
