"""How exact is a pick by a camera in the hand?

A UR5 calibrates its camera on a board from twelve poses, sees the part from one of them and picks it, all with the same errors.
"""

import matplotlib.pyplot as plt
import numpy as np

import precision_pin as pp

views = ["0 -75 85 -100 -90 0", "15 -70 80 -85 -80 30", "-15 -80 93 -120 -105 -40", "10 -67 75 -115 -65 60"]
views += ["-10 -69 89 -80 -115 -75", "5 -85 95 -75 -75 90", "-8 -65 70 -125 -80 -100", "18 -81 91 -90 -120 45"]
views += ["-18 -71 77 -110 -60 -20", "6 -87 100 -120 -110 130", "-4 -63 73 -80 -70 -140", "12 -83 85 -100 -100 170"]
poses = {"pick": "5 -65 95 -120 -88 15 deg"} | {f"v{k}": f"{view} deg" for k, view in enumerate(views)}
turns = {f"r{axis}": {"normal": "1.5 mrad"} for axis in "xyz"}
sources = [{"frame": {"frame": "tool0", **{axis: {"normal": "0.9 mm"} for axis in "xyz"}, **turns}}]
for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"):
    joint = {"joint": f"{name}_joint"}
    sources.append({"frame": {**joint, **{axis: {"normal": "0.6 mm"} for axis in "xyz"}, **turns}})
    for offset in ({"normal": "1.5 mrad"}, {"normal": "60 urad", "scope": "visit"}):
        sources.append({"joint_offset": {**joint, "offset": offset}})
board, grasp = {"xyz": "620 120 30 mm", "rpy": "2 -3 20 deg"}, {"xyz": "50 20 10 mm", "rpy": "170 5 30 deg"}
camera = {"on": "tool0", "camera": {"xyz": "10 -70 40 mm", "rpy": "3 -2 90 deg"}, "board": board, "grasp": grasp}
camera |= {"poses": list(poses)[1:], "view": "v0", "noise": {"translation": "0.05 mm", "rotation": "0.25 mrad"}}
sheet = {"precision-pin": 1, "robot": "example:ur5", "tip": "tool0", "target": "30 -20 150 mm", "poses": poses}
sheet |= {"accept": {"W_MASS_ZERO": "frames"}, "sources": sources, "datums": {"camera": {"hand_eye": camera}}}
model = pp.ErrorModel.from_dict(sheet)
seen = model.against("camera")
robots, others = (seen.space.sample(seed, 0, 20_000) for seed in (0, 1))
own, other = (model.at("pick").exact(x[: model.space.size]) for x in (robots, others))
found, by_other = (seen.at("pick").exact(x) for x in (robots, others))
names = ["in base axes", "against the camera", "as if another robot had found the part"]
for name, error in zip(names, (own, found, own + by_other - other), strict=True):
    length = 1e3 * np.linalg.norm(error[:3], axis=0)
    print(f"{name}: 95 % within {np.quantile(length, 0.95):.2f} mm")
    plt.hist(length, 60, histtype="step", label=name)
plt.legend(title="|d|, mm")
plt.savefig("how_exact_is_a_pick_by_camera.png")
