"""Random term tables of random chains, for the tests of the compiled sampler."""

from __future__ import annotations

import inspect
from dataclasses import fields
from functools import cache
from typing import Any

import numpy as np
from numba import njit
from scipy.spatial.transform import Rotation

from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.expressions import Component, Expression, Program, cos, sin, sqrt
from precision_pin.draws.laws import Circle, Disc, Fixed, JointNormal, Law, Normal, Triangular, TruncatedNormal, Uniform
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


def compiled_variants(function: Any) -> list[Any]:
    """Return the variants (laws, models) for which an outermost function is compiled, as types of these arguments."""
    place = list(inspect.signature(function.py_func).parameters).index("rare")
    return [signature[place : place + 2] for signature in function.signatures]


def every_formula(space: Space) -> list[Expression]:
    """Every component, and formulas that use every operator."""
    x = [Component(name) for name in space.components]
    modulus = Component("modulus")
    return [
        *x,
        1 / modulus,
        modulus**4,
        modulus**-0.5 * 2,
        sqrt(modulus + 1),
        sin(x[0]),
        cos(x[1] * x[2]),
        modulus**3 - x[0],
        modulus**1.0 + 0.25,
    ]


def random_frame(rng: np.random.Generator) -> np.ndarray:
    frame = np.eye(4)
    frame[:3, :3] = Rotation.random(random_state=rng).as_matrix()
    frame[:3, 3] = rng.normal(size=3)
    return frame


def random_table(seed: int, *, targets: int, terms: int, shift: float, turn: float, slides: float = 0.3) -> PoseModel:
    """Return terms of 0 to 3 factors on targets that share them; some targets only slide, as prismatic joints do."""
    rng = np.random.default_rng(seed)
    formulas = every_formula(EVERY_LAW)
    factors = np.full((terms, 3), -1, dtype=np.intp)
    for row in factors:
        count = rng.integers(0, 4)
        row[:count] = rng.integers(0, len(formulas), count)
    target = rng.integers(0, targets, terms)
    twists = rng.normal(size=(terms, 6)) * np.repeat([shift, turn], 3)
    twists[np.isin(target, np.flatnonzero(rng.random(targets) < slides)), 3:] = 0.0
    twists[rng.random(twists.shape) < 0.3] = 0.0
    table = TermTable(
        pose=random_frame(rng),
        targets=(None,) * targets,
        frames=np.array([random_frame(rng) for _ in range(targets)]).reshape(-1, 4, 4),
        program=Program.compile(formulas, EVERY_LAW.index),
        target=target.astype(np.intp),
        twists=twists,
        factors=factors,
    )
    return pose_model(EVERY_LAW, table)


def plain_table(space: Space, frames: Any, twists: Any, *, tip: Any = None) -> PoseModel:
    """Return target k displaced by ``twists[k]`` times component k, ``(K, 6)``; the tip at the base if left out."""
    count = len(twists)
    table = TermTable(
        pose=np.eye(4) if tip is None else tip,
        targets=(None,) * count,
        frames=np.asarray(frames, dtype=float),
        program=Program.compile([Component(name) for name in space.components], space.index),
        target=np.arange(count),
        twists=np.asarray(twists, dtype=float),
        factors=np.array([[k, -1, -1] for k in range(count)]),
    )
    return pose_model(space, table)


def single_formula(formula: Expression, law: Law | None = None, scale: float = 1e-3) -> PoseModel:
    """Return one target shifted along z by a formula of the draw ``a``, standard normal if no law is given."""
    space = Space((Draw("a", law or Normal(1.0)),))
    table = TermTable(
        pose=np.eye(4),
        targets=(None,),
        frames=np.eye(4)[None],
        program=Program.compile([formula], space.index),
        target=np.array([0]),
        twists=np.array([[0, 0, scale, 0, 0, 0.0]]),
        factors=np.array([[0, -1, -1]]),
    )
    return pose_model(space, table)


def pose_model(space: Space, table: TermTable) -> PoseModel:
    posture: Any = None
    return PoseModel(posture, space, table, ())


def accumulate(
    layout: SamplerArrays,
    plan: Plan,
    model: Any,
    seed: int,
    first_block: int,
    blocks: int,
    *,
    state: State | None = None,
    **units: Any,
) -> State:
    """Return the statistics after some blocks, added to those of ``state``."""
    found = sampler.observe_blocks(layout, plan, model, seed, first_block, blocks, **units)
    return found.add_to(start(plan) if state is None else state)


def assert_same_state(first: State, second: State) -> None:
    for field in fields(State):
        np.testing.assert_array_equal(getattr(first, field.name), getattr(second, field.name), err_msg=field.name)
