"""Random term tables of random chains, for the tests of the compiled sampler."""

from dataclasses import fields
from functools import cache
from typing import Any

import numpy as np
from numba import njit
from scipy.spatial.transform import Rotation

from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.expressions import Component, Expression, Program, cos, sin, sqrt
from precision_pin.draws.laws import Circle, Disc, Fixed, JointNormal, Normal, Triangular, TruncatedNormal, Uniform
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.model.pose_model import PoseModel
from precision_pin.statistics import Plan, State, start
from precision_pin.terms.table import TermTable

COVARIANCE = ((1.0, 0.3, 0.2), (0.3, 0.5, 0.0), (0.2, 0.0, 0.4))

EVERY_LAW = Space(
    (
        Draw("uniform", Uniform(1.0, 0.1)),
        Draw("triangular", Triangular(1.0, -0.2), Scope.POSE),
        Draw("normal", Normal(0.4, 0.1), Scope.VISIT),
        Draw("truncated", TruncatedNormal(0.5, 0.1, 3.0)),
        Draw("disc", Disc(1.0)),
        Draw("circle", Circle(0.7), Scope.VISIT),
        Draw("fixed", Fixed(1.3)),
        Draw("joint", JointNormal(COVARIANCE, (0.1, 0.2, 0.3)), Scope.POSE),
        Draw("pair", JointNormal(((0.2, -0.1), (-0.1, 0.2)))),
        Draw("modulus", Uniform(0.1, 1.0)),
        Draw("narrow", TruncatedNormal(1.0, 0.0, 0.2)),
    )
)


@cache
def from_python(function: Any) -> Any:
    """Return a Python callable for a function of the compiled loops, which only compiled code may call."""
    return njit(error_model="numpy")(lambda *arguments: function(*arguments))


def every_formula(space: Space) -> list[Expression]:
    """Every component, and formulas that use every operator."""
    x = [Component(name) for name in space.components]
    m = Component("modulus")
    return [*x, 1 / m, m**4, m**-0.5 * 2, sqrt(m + 1), sin(x[0]), cos(x[1] * x[2]), m**3 - x[0], m**1.0 + 0.25]


def random_frame(rng: np.random.Generator) -> np.ndarray:
    frame = np.eye(4)
    frame[:3, :3] = Rotation.random(random_state=rng).as_matrix()
    frame[:3, 3] = rng.normal(size=3)
    return frame


def model_of(
    space: Space, frames: Any, target: Any, twists: Any, factors: Any, *, formulas: Any = None, tip: Any = None
) -> PoseModel:
    """Return a model of terms, each of a target, a twist and up to three formulas, by default the components; tip at the base."""
    formulas = [Component(name) for name in space.components] if formulas is None else formulas
    table = TermTable(
        pose=np.eye(4) if tip is None else tip,
        targets=(None,) * len(frames),
        frames=np.asarray(frames, dtype=float).reshape(-1, 4, 4),
        program=Program.compile(formulas, space.index),
        target=np.array(target, dtype=np.intp),
        twists=np.asarray(twists, dtype=float),
        factors=np.array([[*of, -1, -1, -1][:3] for of in factors], dtype=np.intp).reshape(-1, 3),
    )
    return pose_model(space, table)


def random_table(seed: int, *, targets: int, terms: int, shift: float, turn: float, slides: float = 0.3) -> PoseModel:
    """Return terms of 0 to 3 factors on targets that share them; some targets only slide, as prismatic joints do."""
    rng = np.random.default_rng(seed)
    formulas = every_formula(EVERY_LAW)
    factors = [rng.integers(0, len(formulas), rng.integers(0, 4)) for _ in range(terms)]
    target = rng.integers(0, targets, terms)
    twists = rng.normal(size=(terms, 6)) * np.repeat([shift, turn], 3)
    twists[np.isin(target, np.flatnonzero(rng.random(targets) < slides)), 3:] = 0.0
    twists[rng.random(twists.shape) < 0.3] = 0.0
    tip, *frames = (random_frame(rng) for _ in range(1 + targets))
    return model_of(EVERY_LAW, frames, target, twists, factors, formulas=formulas, tip=tip)


def plain_table(space: Space, frames: Any, twists: Any, *, tip: Any = None) -> PoseModel:
    """Return target k displaced by ``twists[k]`` times component k, ``(K, 6)``."""
    return model_of(space, frames, range(len(twists)), twists, [[k] for k in range(len(twists))], tip=tip)


def pose_model(space: Space, table: TermTable) -> PoseModel:
    posture: Any = None
    return PoseModel(posture, space, table, ())


def accumulate(layout: SamplerArrays, plan: Plan, *of: Any, **units: Any) -> State:
    """Return the statistics of some blocks: model, seed, first block, number of blocks."""
    return sampler.observe_blocks(layout, plan, *of, **units).add_to(start(plan))


def assert_same_state(first: State, second: State) -> None:
    for field in fields(State):
        np.testing.assert_array_equal(getattr(first, field.name), getattr(second, field.name), err_msg=field.name)
