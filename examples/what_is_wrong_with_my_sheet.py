"""What is wrong with my sheet?"""

from pathlib import Path

import precision_pin as pp

Path("arm.errors.yaml").write_text("""precision-pin: 1
robot: example:4dof
tip: tool
poses: {reach: 0 10 30 0 deg}
sources:
  - joint_offset: {joint: joint_1, offset: ±0.02 deg}
  - length: {joint: joint3, along: x of joint2, parameters: 0.25}
  - axis_instal: {joint: joint2, radius: 0.05 mm, span: 100 mm}
""")

try:
    pp.ErrorModel.load("arm.errors.yaml")
except pp.InputError as error:
    for finding in error.findings:
        print(finding)
