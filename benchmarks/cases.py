"""The arms that are timed: a UR5 with a random displacement at each joint, and chains of any length made like it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, Literal, final

import numpy as np

from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.draws.draw import Draw
from precision_pin.draws.expressions import Component, Program
from precision_pin.draws.laws import Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.model.pose_model import PoseModel
from precision_pin.statistics import Plan
from precision_pin.terms.table import TermTable

__all__ = [
    "AXES",
    "HALF_WIDTH",
    "IS_UNIFORM",
    "POSE",
    "STD",
    "UR5",
    "Prepared",
    "chain_of",
    "draw_with_numpy",
    "prepared",
    "ur5",
    "with_products",
]


UR5: Final = (
    (0.0, 0.089159, math.pi / 2),
    (-0.425, 0.0, 0.0),
    (-0.39225, 0.0, 0.0),
    (0.0, 0.10915, math.pi / 2),
    (0.0, 0.09465, -math.pi / 2),
    (0.0, 0.0823, 0.0),
)
"""A UR5 in Denavit and Hartenberg's parameters, as its maker publishes them: a, d (m), α (rad) of each link."""

POSE: Final = (0.3, -1.2, 1.4, -1.7, -1.5, 0.4)
"""Joint angles, rad."""

AXES: Final = 6
"""Parameters at a joint: displacements along x, y, z (m), then the rotation vector about x, y, z (rad)."""

HALF_WIDTH: Final = 1e-4
"""Half-width of the uniform parameters, m or rad."""

STD: Final = 1e-4
"""Standard deviation of the normal parameters, m or rad."""

IS_UNIFORM: Final = np.arange(36) % 12 < 5
"""Which of the 36 parameters are uniform, 15 of them; the other 21 are normal."""


def ur5() -> PoseModel:
    """Return a UR5 with a random displacement, right after its turn, at each joint: 36 terms with a parameter each."""
    return chain_of(6, 36)


def with_products() -> PoseModel:
    """Return the UR5 with 100 terms of its 36 parameters, each along or about an axis: 20 hold a product of two, 80 one."""
    plain = ur5()
    count, products = 100, 20
    factors = np.full((count, 3), -1, dtype=np.intp)
    factors[:, 0] = np.arange(count) % 36
    factors[:products, 1] = np.arange(products) + 7
    table = TermTable(
        pose=plain.table.pose,
        targets=plain.table.targets,
        frames=plain.table.frames,
        program=plain.table.program,
        target=np.arange(count) * AXES // count,
        twists=np.eye(AXES)[np.arange(count) % AXES],
        factors=factors,
    )
    return PoseModel(plain.posture, plain.space, table, ())


def chain_of(joints: int, parameters: int) -> PoseModel:
    """Return a chain that repeats the UR5's links, with the parameters spread evenly over its joints."""
    draws = [
        Draw(f"parameter{k}", Uniform(HALF_WIDTH) if IS_UNIFORM[k % 36] else Normal(STD)) for k in range(parameters)
    ]
    space = Space(tuple(draws))
    frames, tip = [], np.eye(4)
    for k in range(joints):
        a, d, alpha = UR5[k % len(UR5)]
        tip = tip @ se3.pose(se3.rotation_about((0, 0, 1), POSE[k % len(POSE)]), (0, 0, 0))
        frames.append(tip)
        tip = tip @ se3.pose(se3.rotation_about((1, 0, 0), alpha), (a, 0, d))
    numbers = np.arange(parameters)
    target = numbers * joints // parameters
    # the samplers read the table only; there is no URDF to take a posture from
    posture: Any = None
    table = TermTable(
        pose=tip,
        targets=(posture,) * joints,
        frames=np.array(frames),
        program=Program.compile([Component(name) for name in space.components], space.index),
        target=target,
        twists=np.eye(AXES)[(numbers - np.searchsorted(target, target)) % AXES],
        factors=np.stack([numbers, np.full(parameters, -1), np.full(parameters, -1)], axis=1),
    )
    return PoseModel(posture, space, table, ())


def draw_with_numpy(random: np.random.Generator, count: int) -> Array:
    """Return the UR5's parameters ``(36, N)``, drawn in bulk by numpy."""
    x = np.empty((36, count))
    x[IS_UNIFORM] = random.uniform(-HALF_WIDTH, HALF_WIDTH, (int(IS_UNIFORM.sum()), count))
    x[~IS_UNIFORM] = random.normal(0.0, STD, (int((~IS_UNIFORM).sum()), count))
    return x


@final
@dataclass(frozen=True, eq=False)
class Prepared:
    """An error model laid out for the compiled sampler, and what its samples are counted into."""

    layout: SamplerArrays
    plan: Plan

    def sample(self, model: Literal["exact", "linear"], blocks: int) -> None:
        """Draw, displace and count whole blocks of samples."""
        sampler.observe_blocks(self.layout, self.plan, model, 0, 0, blocks)


def prepared(at: PoseModel) -> Prepared:
    """Lay an error model out."""
    return Prepared(sampler.to_arrays(at), Plan.from_moments(at.error_at_means, at.covariance))
