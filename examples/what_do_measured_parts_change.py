"""What do measured parts change?

The drawing allows ±0.1 mm for either tube; forty pairs, cut one after the other on one saw, have been measured.
"""

import numpy as np

import precision_pin as pp

measured = np.random.default_rng(0).multivariate_normal([0.04, 0.02], [[4e-4, 3e-4], [3e-4, 4e-4]], 40)
np.savetxt("tubes.csv", measured, "%.3f", ",", header="upper [mm],fore [mm]", comments="")

drawn = {
    "precision-pin": 1,
    "robot": "example:4dof",
    "tip": "tool",
    "gravity": "none",
    "poses": {"straight": "0 0 0 0 deg"},
    "parameters": {"upper": "±0.1 mm", "fore": "±0.1 mm"},
    "sources": [
        {"length": {"joint": "joint3", "along": "x of joint2", "parameters": "upper"}},
        {"length": {"joint": "joint4", "along": "x of joint3", "parameters": "fore"}},
    ],
}
rows = {"rows": {"file": "tubes.csv", "columns": ["upper", "fore"]}}
sawn = drawn | {
    "parameters": {"tubes": rows},
    "sources": [
        {"length": {"joint": "joint3", "along": "x of joint2", "parameters": "tubes.0"}},
        {"length": {"joint": "joint4", "along": "x of joint3", "parameters": "tubes.1"}},
    ],
}

for name, sheet in (("as drawn", drawn), ("as measured", sawn)):
    x = pp.monte_carlo(pp.ErrorModel.from_dict(sheet), samples=20_000).position.x
    print(f"{name}: the arm is longer by {1e6 * x.mean:.0f} um on average, with a spread of {1e6 * x.std:.0f} um")
