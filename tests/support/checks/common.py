"""What the checks of the sources share."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from precision_pin.draws.draw import Draw
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain, Posture
from precision_pin.terms.source import Source
from support.oracles import displacements
from support.plain_robot import PlainRobot, chain_of, inserted, joint, link, pose_error, random_arm, robot

MM = 1e-3
Q7 = (0.3, -0.7, 1.1, 0.4, -1.3, 0.8, 0.5)


def evaluated(chain: Chain, q, sources: Sequence[Source], values=None, draws: Sequence[Draw] = ()):
    """Return the displacement of every target, with components as given and the rest at their means."""
    model = ErrorModel(chain, Space(tuple(draws)), sources)
    at = model.at(q)
    means = dict(zip(model.space.components, model.space.mean, strict=True))
    assert set(values or {}) <= set(means), f"{set(values or {}) - set(means)} are no components: {sorted(means)}"
    return at, displacements(at.terms, means | (values or {}))


def in_base(posture: Posture, totals) -> np.ndarray:
    """Return the displacement of the only place, turned into base axes."""
    ((place, total),) = totals.items()
    turn = posture.place_pose(place)[:3, :3]
    return np.concatenate([turn @ total[:3], turn @ total[3:]])


def same(actual, expected, tolerance=1e-12) -> None:
    np.testing.assert_allclose(actual, expected, rtol=tolerance, atol=tolerance)


def one_link(kind="revolute", axis=(0, 0, 1), length=1.0, gravity=(0.0, 0.0, -9.81), **mass) -> Chain:
    return chain_of(
        robot(
            link("base"),
            joint("hinge", kind, "base", "arm", (0, 0, 0), (0, 0, 0), axis),
            link("arm", **mass),
            joint("flange", "fixed", "arm", "tool", (length, 0, 0)),
            link("tool"),
        ),
        gravity=gravity,
    )


@dataclass(frozen=True)
class RandomArm:
    """An arm with slanted axes at `Q7`, read twice: as a chain, and plainly."""

    chain: Chain
    reading: PlainRobot
    q: dict[str, float]

    @property
    def tool(self) -> np.ndarray:
        return self.reading.poses(self.q)["tool"]

    def moved(self, kind: str, place: str, six) -> np.ndarray:
        """Return the error of the tool where E is inserted at a joint's origin or at a link."""
        displaced = {(kind, place): inserted(six)}
        return pose_error(self.reading.poses(self.q, displaced=displaced)["tool"], self.tool)


def slanted_arm(seed: int, prismatic: tuple[int, ...] = (), **settings) -> RandomArm:
    text = random_arm(seed, prismatic=prismatic)
    chain = chain_of(text, tip="tool", **settings)
    return RandomArm(chain, PlainRobot.parse(text), dict(zip(chain.joint_names, Q7, strict=True)))


SIX = (0.03, -0.05, 0.02, 0.3, -0.4, 0.25)
"""A large displacement, m and rad."""
NAMES = ("x", "y", "z", "rx", "ry", "rz")
PLACES = (
    ({"joint": "joint4"}, "joint", "joint4"),
    ({"link": "half2"}, "joint", "joint3"),
    ({"frame": "half2"}, "link", "half2"),
    ({"frame": "tool"}, "link", "tool"),
)
"""Where a source may displace: joint, link or frame; and where that is: the joint's origin or the link's."""


def leaning_hand() -> tuple[Chain, float]:
    """Return a hand on an arm that droops, and the torque of their weight about the shoulder, N·m."""
    chain = chain_of(
        robot(
            link("base"),
            joint("shoulder", "revolute", "base", "upper", axis=(0, 1, 0)),
            link("upper", 5.0, (0.5, 0, 0)),
            joint("wrist", "revolute", "upper", "hand", (0.6, 0, 0), axis=(0, 1, 0)),
            link("hand", 2.0, (0.0, 0, 0.3)),
        )
    )
    return chain, 9.81 * (5.0 * 0.5 + 2.0 * 0.6)
