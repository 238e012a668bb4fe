"""In which pose should a robot drill?

A UR10 drills down with 300 N, at places in front of it and in all postures that lead there. Its joints are springs, of 67
kN*m/rad to the elbow (a strain wave gear of size 32 near zero torque), 10 in the wrist, known to 20 %: an assumption.
"""

import matplotlib.pyplot as plt
import numpy as np

import precision_pin as pp

names = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
soft = {name: 1 / k for name, k in zip(names, (67e3, 67e3, 67e3, 10e3, 10e3, 10e3), strict=True)}
compliances = {name: {"uniform": f"{0.2 * c} rad/(N*m)", "mean": f"{c} rad/(N*m)"} for name, c in soft.items()}
springs = [{"joint_compliance": {"joint": f"{name}_joint", "compliance": law}} for name, law in compliances.items()]
thrust = {"force": {"at": "tool0", "force": "0 0 300 N"}}  # the workpiece pushes back
sheet = {"precision-pin": 1, "robot": "example:ur10", "tip": "tool0", "gravity": "none", "sources": [*springs, thrust]}
sheet |= {"poses": {"up": "0 -90 0 -90 0 0 deg"}, "accept": {"W_MASS_ZERO": "base, ee_link and tool0 are frames"}}
arm = pp.ErrorModel.from_dict(sheet)

places = np.repeat(np.diag([1.0, -1.0, -1.0, 1.0])[:, :, None], 15, axis=2)  # the tool points down
places[0, 3], places[2, 3] = np.linspace(0.4, 1.1, 15), 0.3
found = pp.inverse_kinematics(arm, places)
postures = found.q[:, [not hit for hit in found.hit]].T
give = 1e3 * np.array([arm.at(q).error_at_means[:3] for q in postures])
reach, sideways = [arm.chain.at(q).pose[0, 3] for q in postures], np.hypot(give[:, 0], give[:, 1])
print(f"{len(give)} postures: the drill gives way by {give[:, 2].min():.2f} to {give[:, 2].max():.2f} mm")
for name, k in (("least", sideways.argmin()), ("most", sideways.argmax())):
    within = 1e3 * pp.monte_carlo(arm, postures[k], samples=20_000).position.norm.quantile(0.95)
    print(
        f"walks {name} at {reach[k]:.2f} m: {sideways[k]:.3f} mm, gives way {give[k, 2]:.2f} mm; 95 % within {within:.2f} mm"
    )

figure, axes = plt.subplots(figsize=(4.5, 2.8), layout="constrained")
figure.colorbar(axes.scatter(reach, sideways, c=give[:, 2]), label="gives way, mm")
axes.set(xlabel="place in front of the robot, m", ylabel="walks sideways, mm", ylim=(0, None))
figure.savefig("in_which_pose_should_a_robot_drill.png")
