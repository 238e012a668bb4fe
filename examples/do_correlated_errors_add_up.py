"""Do correlated errors add up?

Two tubes, one behind the other, or one back over the other: what if their errors come from the same saw?
"""

import matplotlib.pyplot as plt
import numpy as np

import precision_pin as pp

lengths = {
    "upper": {"joint": "joint3", "along": "x of joint2", "parameters": "upper"},
    "fore": {"joint": "joint4", "along": "x of joint3", "parameters": "fore"},
}
sheet = {
    "precision-pin": 1,
    "robot": "example:4dof",
    "tip": "tool",
    "poses": {"straight": "0 0 0 0 deg", "folded": "0 0 180 0 deg"},
    "parameters": {name: {"normal": {"std": "0.1 mm"}} for name in lengths},
    "sources": [{"length": settings} for settings in lengths.values()],
}

correlations = np.array([-0.9, -0.5, 0, 0.5, 0.9])
spread = {pose: [] for pose in sheet["poses"]}
for correlation in correlations:
    tied = [{"parameters": ["upper", "fore"], "correlation": float(correlation)}]
    model = pp.ErrorModel.from_dict(sheet | {"correlations": tied})
    for pose, values in spread.items():
        values.append(1e3 * np.sqrt(model.at(pose).covariance[0, 0]))

figure, axes = plt.subplots(figsize=(4.5, 2.8), layout="constrained")
for pose, values in spread.items():
    print(f"{pose}: " + ", ".join(f"{value:.3f}" for value in values) + " mm")
    axes.plot(correlations, values, "o-", label=pose)
axes.set(xlabel="correlation", ylabel="spread in x, mm")
axes.legend()
figure.savefig("do_correlated_errors_add_up.png")
