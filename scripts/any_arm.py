"""How precise are a UR5 and a Panda, given a few tolerances? Sources written in Python, no sheet.

    python scripts/any_arm.py

The robots come from the package example-robot-data. The tolerances are assumptions to be replaced.
"""

from __future__ import annotations

from math import radians

import precision_pin as pp
from precision_pin.robot.examples import resolve_robot
from precision_pin.sampling.table import analysis_table
from precision_pin.sources.axis_install import AxisInstall
from precision_pin.sources.joint_compliance import JointCompliance
from precision_pin.sources.joint_offset import JointOffset
from precision_pin.sources.payload import Payload

ARMS = {
    "ur5": ("tool0", [0.3, -1.2, 1.4, -1.7, -1.5, 0.2]),
    "panda": ("panda_hand_tcp", [0.2, -0.6, 0.1, -2.2, 0.1, 1.7, 0.8]),
}


def error_model(name: str, tip: str) -> pp.ErrorModel:
    chain = pp.Chain.from_urdf(resolve_robot(f"example:{name}"), tip=tip)
    space = pp.Space((pp.Draw("payload_mass", pp.Normal(0.05, mean=2.0), pp.Scope.VISIT),))
    sources: list[pp.Source] = [Payload(at=tip, mass="payload_mass")]
    for joint in chain.joint_names:
        sources += [
            JointOffset(joint=joint, offset=pp.Normal.from_half_width(radians(0.02))),
            AxisInstall(joint=joint, radius=0.02e-3, span=80e-3),
            JointCompliance(joint=joint, compliance=pp.Uniform(1e-6, mean=5e-6)),
        ]
    return pp.ErrorModel(chain, space, sources)


def main() -> None:
    for name, (tip, q) in ARMS.items():
        result = pp.monte_carlo(
            error_model(name, tip), q, samples=50_000, seed=1, specifications=[pp.specification("1 mm @ 95 %")]
        )
        print(analysis_table(result), end="\n\n")


if __name__ == "__main__":
    main()
