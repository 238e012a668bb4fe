"""How far does a cheap arm droop?

An SO-101 with 300 g at its gripper: servos without integral action give way under the weight, and their friction stops the arm
short of where it was sent. Stiffness and friction were identified on one arm (a published field report).
"""

import matplotlib.pyplot as plt
import numpy as np

import precision_pin as pp

stiffness, friction = (48.94, 51.34, 18.57, 43.03, 47.14), (0.215, 0.318, 0.402, 0.296, 0.283)  # N*m/rad, N*m
chain = pp.Chain.from_urdf("example:so101", tip="gripper_frame_link")
reach = np.radians([0.0, 76.0, -73.8, -5.0, 0.0])

figure, axes = plt.subplots()
for share, label in ((0.0, "no compensation"), (0.8, "80 % of the weight compensated")):
    servos = [
        pp.sources.Servo(joint=joint, stiffness=k, friction=f, gravity_compensation=share)
        for joint, k, f in zip(chain.joint_names, stiffness, friction, strict=True)
    ]
    payload = pp.sources.Payload(at="gripper_frame_link", mass=0.3)
    arm = pp.ErrorModel(chain, pp.Space(), [*servos, payload], statics="equilibrium")
    up, down = (
        1e3 * arm.at(reach, approach=dict.fromkeys(chain.joint_names, side)).error_at_means[:3] for side in (1, -1)
    )
    visits = 1e3 * arm.at(reach).exact(arm.space.sample(0, 0, 5000))[:3]
    print(f"{label}: arrives {up[2]:.1f} mm or {down[2]:.1f} mm from its height, by the direction of its joints")
    axes.plot(*visits[[0, 2]], ".", markersize=1, label=label)
axes.set(xlabel="x, mm", ylabel="z, mm")
axes.legend(markerscale=10)
figure.savefig("how_far_does_a_cheap_arm_droop.png")
