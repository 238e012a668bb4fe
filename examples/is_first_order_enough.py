"""Is first order enough?

The mean and the spread of one metre of arm on a joint whose angle is known to ± so many degrees.
"""

import matplotlib.pyplot as plt
import numpy as np

import precision_pin as pp

model = pp.ErrorModel.from_dict(
    {
        "precision-pin": 1,
        "robot": "example:4dof",
        "tip": "tool",
        "poses": {"reach": "0 0 0 0 deg"},
        "sources": [{"joint_offset": {"joint": "joint1", "offset": "±1 deg"}}],
    }
)

degrees = np.array([0.1, 0.3, 1, 3, 10])
missed = []
for degree in degrees:
    changed = model.with_({"joint_offset.offset": f"±{degree} deg"})
    pose = pp.moments(changed, method="closed").poses[0]
    shift = np.linalg.norm(pose.mean.value[:3] - pose.nominal[:3])
    spread = np.sqrt(np.trace(pose.first_order_covariance[:3, :3]))
    missed.append(shift / spread)
    print(f"±{degree:g}°: mean moved by {1e3 * shift:.3f} mm, spread {1e3 * spread:.1f} mm")

figure, axes = plt.subplots(figsize=(4.5, 2.8), layout="constrained")
axes.loglog(degrees, 100 * np.array(missed), "o-")
axes.set(xlabel="tolerance of the joint, ±°", ylabel="missed, % of the spread")
figure.savefig("is_first_order_enough.png")
