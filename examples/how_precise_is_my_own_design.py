"""How precise is my own design?

A SCARA arm from nothing but its lengths: two servos, each with a zero set to ±0.1°, and two bars cut to ±0.1 mm.
"""

from pathlib import Path

import precision_pin as pp

Path("scara.urdf").write_text("""<robot name="scara">
  <link name="base"/> <link name="arm"/> <link name="forearm"/> <link name="pen"/>
  <joint name="shoulder" type="continuous">
    <parent link="base"/> <child link="arm"/> <axis xyz="0 0 1"/>
  </joint>
  <joint name="elbow" type="continuous">
    <parent link="arm"/> <child link="forearm"/> <axis xyz="0 0 1"/> <origin xyz="0.3 0 0"/>
  </joint>
  <joint name="holder" type="fixed">
    <parent link="forearm"/> <child link="pen"/> <origin xyz="0.2 0 0"/>
  </joint>
</robot>""")

Path("scara.errors.yaml").write_text("""
precision-pin: 1
robot: scara.urdf
poses: {stretched: 0 0 deg, bent: 0 90 deg}
sources:
  - joint_offset: {joint: shoulder, offset: ±0.1 deg}
  - joint_offset: {joint: elbow, offset: ±0.1 deg}
  - length: {joint: elbow, along: x of shoulder, parameters: ±0.1 mm}
  - length: {frame: pen, along: x of elbow, parameters: ±0.1 mm}
""")

model = pp.ErrorModel.load("scara.errors.yaml")
for pose in model.poses:
    error = pp.monte_carlo(model, pose, samples=20_000).position.norm
    print(f"{pose}: typically {1e3 * error.quantile(0.5):.2f} mm, 95 % within {1e3 * error.quantile(0.95):.2f} mm")
