"""What does a one-sided approach gain?

Two joints have a play that gravity does not take up; each arm visits the place 30 times from either side.
"""

import numpy as np

import precision_pin as pp

model = pp.ErrorModel.from_dict(
    {
        "precision-pin": 1,
        "robot": "example:4dof",
        "tip": "tool",
        "gravity": "none",
        "poses": {"work": "-90 3 88 -91 deg"},
        "sources": [
            {"backlash": {"joint": "joint1", "backlash": "3 arcmin", "band": "5 N*m"}},
            {"backlash": {"joint": "joint2", "backlash": "2 arcmin", "band": "5 N*m"}},
            *(
                {"joint_offset": {"joint": f"joint{k}", "offset": {"normal": "20 arcsec", "scope": "visit"}}}
                for k in (1, 2)
            ),
        ],
    }
)
sides = ["joint1 +, joint2 +", "joint1 -, joint2 -"]
visits = pp.sample_approaches(model, "work", approaches=sides, robots=200)

print(f"repeatability from one side: {1e3 * np.median(visits.unidirectional):.2f} mm")
print(f"from both sides: {1e3 * np.median(visits.bidirectional):.2f} mm")
print(f"the two sides are apart by {1e3 * np.median(visits.variation):.2f} mm")
