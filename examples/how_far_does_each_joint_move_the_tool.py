"""How far does each joint move the tool?

One milliradian at every joint of a UR5e, at two poses.
"""

import numpy as np

import precision_pin as pp

JOINTS = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]

model = pp.ErrorModel.from_dict(
    {
        "precision-pin": 1,
        "robot": "example:ur5e",
        "tip": "tool0",
        "poses": {"ready": "0 -90 90 -90 -90 0 deg", "stretched": "0 -10 20 -100 -90 0 deg"},
        "sources": [{"joint_offset": {"joint": f"{joint}_joint", "offset": "±1 mrad"}} for joint in JOINTS],
    }
)

levers = {pose: np.linalg.norm(model.at(pose).jacobian[:3], axis=0) for pose in model.poses}
print("mm per mrad   " + "".join(f"{pose:>10}" for pose in levers))
for joint, *lever in zip(JOINTS, *levers.values(), strict=True):
    print(f"{joint:14}" + "".join(f"{metres:10.3f}" for metres in lever))
