"""How straight does a gantry move?

A steel bridge on columns 1.4 m apart sags under a carriage of 60 kg; rails wave, and roll the tool 0.25 m below them.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import precision_pin as pp

SLIDE = '<joint name="{}" type="prismatic"><parent link="{}"/><child link="{}"/><axis xyz="{}"/>{}</joint>'
LIMIT = '<limit lower="0" upper="1.2" effort="1" velocity="1"/>'
Path("gantry.urdf").write_text(f"""<robot name="gantry"> <link name="frame"/> <link name="bridge"/> <link name="tool"/>
  <link name="carriage"><inertial><origin xyz="0 0 -0.1"/><mass value="60"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  {SLIDE.format("x", "frame", "bridge", "1 0 0", LIMIT)} {SLIDE.format("y", "bridge", "carriage", "0 1 0", LIMIT)}
  <joint name="spindle" type="fixed"><parent link="carriage"/><child link="tool"/><origin xyz="0 0 -0.25"/></joint>
</robot>""")
Path("gantry.errors.yaml").write_text("""
precision-pin: 1
robot: gantry.urdf
poses: {middle: 600 600 mm, end: 600 0 mm}
sources:
  - beam: {link: bridge, section: box, material: steel, width: 120 mm, height: 120 mm, wall: 6 mm,
      supports: both, start: -100 mm, span: 1.4 m}
  - guide: {joint: x, EYX: 8 um, EZX: 8 um, EAX: 20 urad, EBX: 20 urad, ECX: 20 urad}
  - guide: {joint: y, EYX: 6 um, EZX: 6 um, EAX: 30 urad, short_carriage: true}
""")
model, travel, rows = pp.ErrorModel.load("gantry.errors.yaml"), np.linspace(0, 1.2, 25), []
for at in (model.at([0.6, y]) for y in travel):
    rows.append((1e6 * at.error_at_means[2], 1e6 * at.covariance[2, 2] ** 0.5))
(sag, std), figure = np.transpose(rows), plt.figure(figsize=(4.5, 2.8), layout="constrained")
plt.plot(travel, sag)
plt.fill_between(travel, sag - 2 * std, sag + 2 * std, alpha=0.3)
plt.xlabel("carriage along the bridge, m"), plt.ylabel("height of the tool, µm")
figure.savefig("how_straight_does_a_gantry_move.png")
for name, k in (("middle", 12), ("end", 0)):
    print(f"{name}: sags by {-sag[k]:.1f} µm, and the rails add a standard deviation of {std[k]:.1f} µm")
