"""How far does a load bend the arm?

An arm of two tubes, stretched out flat, whose second joint gives by 0.01 mrad for each newton metre.
"""

import matplotlib.pyplot as plt
import numpy as np

import precision_pin as pp

model = pp.ErrorModel.from_dict(
    {
        "precision-pin": 1,
        "robot": "example:4dof",
        "tip": "tool",
        "statics": "equilibrium",
        "poses": {"flat": "0 0 0 0 deg"},
        "sources": [
            {"payload": {"at": "tool", "mass": "1 ± 0.05 kg"}},
            {"beam": {"link": "link2", "EI": "80 kN*m^2", "GI": "60 kN*m^2"}},
            {"beam": {"link": "link3", "EI": "40 kN*m^2", "GI": "30 kN*m^2"}},
            {"joint_compliance": {"joint": "joint2", "compliance": "1e-5 rad/(N*m)"}},
        ],
    }
)

masses = np.array([0.1, 4, 8])
loaded = [model.with_({"payload.mass": f"{mass} ± 0.05 kg"}) for mass in masses]
sag = np.array([-1e3 * arm.at().error_at_means[2] for arm in loaded])
slope, own_weight = np.polyfit(masses, sag, 1)
print(f"its own weight bends it by {own_weight:.1f} mm, each kilogram by {slope:.2f} mm more")

figure, axes = plt.subplots(figsize=(4.5, 2.8), layout="constrained")
axes.plot(masses, sag, "o-")
axes.set(xlabel="mass at the tool, kg", ylabel="sag, mm", ylim=(0, None))
figure.savefig("how_far_does_a_load_bend_the_arm.png")
