"""Many poses at once: the bits of one pose at a time, the closed form between poses, and the small sketch."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kernel.cases import EVERY_LAW, plain_table, pose_model, random_frame, random_table
from precision_pin.base.errors import InputError
from precision_pin.draws.correlation import Correlation
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.expressions import Component, Program
from precision_pin.draws.laws import Circle, Empirical, Fixed, Normal, Rows, Uniform
from precision_pin.draws.space import Space
from precision_pin.kernel import loops, sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.kernel.loops import WIDE
from precision_pin.kernel.sampler import BLOCK, JoinedTables, NormBlocks
from precision_pin.model.pose_model import PoseModel
from precision_pin.statistics import Plan, Specification
from precision_pin.terms.table import TermTable

LIMITED = (("position.norm", 5e-3), ("attitude.y", 2e-3), ("position.x", 3e-3), ("attitude.norm", 5e-3))
SPECIFICATIONS = tuple(Specification(quantity, limit, 0.5) for quantity, limit in LIMITED)


def at_poses(seed: int, poses: int, **shape: Any) -> list[PoseModel]:
    """Return a random table at random poses."""
    return moved(random_table(seed, **shape), seed, poses)


def moved(first: PoseModel, seed: int, poses: int) -> list[PoseModel]:
    """Return a table at random poses; at every third one some terms vanish."""
    rng = np.random.default_rng(seed)
    found = []
    for pose in range(poses):
        twists = first.table.twists * rng.uniform(0.5, 1.5, first.table.twists.shape)
        if pose % 3 == 2:
            twists[rng.random(twists.shape) < 0.5] = 0.0
        frames = [random_frame(rng) for _ in first.table.targets]
        table = replace(first.table, pose=random_frame(rng), frames=np.array(frames).reshape(-1, 4, 4), twists=twists)
        found.append(pose_model(first.space, table))
    return found


def planned(models: list[PoseModel]) -> list[Plan]:
    return [Plan.from_moments(at.error_at_means, at.covariance, SPECIFICATIONS) for at in models]


def assert_as_one_at_a_time(
    models: list[PoseModel], model: Any, samples: int, *, pose: int = 0, visit: int = 0
) -> None:
    """Compare many poses together with one pose after another."""
    layouts, plans = sampler.to_arrays_at_poses(models), planned(models)
    blocks = -(-samples // BLOCK)
    units: dict[str, Any] = {"samples": samples, "first_pose": pose, "visit": visit}
    tables = JoinedTables.of(layouts)
    norms = sampler.observe_norms(tables, plans, model, 7, 0, blocks, **units)
    edges = sampler.norm_edges()
    assert norms.count == samples
    for p, (at, plan) in enumerate(zip(models, plans, strict=True)):
        alone = sampler.to_arrays(at)
        expected = sampler.observe_blocks(
            alone, plan, model, 7, 0, blocks, samples=samples, keep_errors=True, pose=pose + p, visit=visit
        )
        np.testing.assert_array_equal(norms.inside[p], expected.inside)
        np.testing.assert_array_equal(norms.lowest[p], expected.lowest[[0, 4]])
        np.testing.assert_array_equal(norms.highest[p], expected.highest[[0, 4]])
        np.testing.assert_array_equal(norms.sums[p], expected.sums)
        for part, row in enumerate((0, 4)):
            vectors = expected.errors[3 * part : 3 * part + 3]
            length = np.sqrt((vectors * vectors).sum(axis=0))
            counts = np.histogram((length - plan.centre[row]) / plan.scale[row], edges)[0]
            np.testing.assert_array_equal(norms.sketch[p, part], counts)


@pytest.mark.fast(2)
@pytest.mark.parametrize(
    ("model", "poses", "samples"),
    [("exact", 1, 300), ("linear", 3, 1), ("exact", 5, BLOCK + 333), ("linear", 7, 2048)],
)
def test_all_scopes_formulas_and_products_have_the_bits_of_one_pose_at_a_time(model, poses: int, samples: int) -> None:
    models = at_poses(3, poses, targets=4, terms=25, shift=1e-3, turn=1e-3)
    assert {draw.scope for draw in EVERY_LAW.draws} == set(Scope)
    assert_as_one_at_a_time(models, model, samples, pose=2, visit=1)


@pytest.mark.parametrize("turn", [0.02, 0.2])
def test_wide_angles(turn: float) -> None:
    models = at_poses(12, 4, targets=3, terms=6, shift=1e-2, turn=turn)
    layouts = sampler.to_arrays_at_poses(models)
    assert any((layout.motions.series == WIDE).any() for layout in layouts)
    assert_as_one_at_a_time(models, "exact", 700)


PROGRAM = Program.compile([Component("a"), Component("b")], {"a": 0, "b": 1})


def two_targets(space: Space, twists: np.ndarray, frames: Any = None, program: Program = PROGRAM) -> PoseModel:
    """Return two targets, each displaced by one of two formulas."""
    factors = np.array([[0, -1, -1], [1, -1, -1]])
    frames = np.array([np.eye(4)] * 2) if frames is None else frames
    return pose_model(space, TermTable(np.eye(4), (None, None), frames, program, np.array([0, 1]), twists, factors))  # type: ignore[arg-type]


@pytest.mark.slow
def test_a_turn_of_nearly_half_a_turn_at_one_pose_of_many() -> None:
    space = Space((Draw("a", Uniform(1.0)), Draw("b", Uniform(1.0), Scope.POSE)))
    rng = np.random.default_rng(4)
    models = []
    for reach in (1e-3, 3.0, 0.2):
        axis = Rotation.random(random_state=rng).as_matrix()[0]
        twists = np.zeros((2, 6))
        twists[:, 3:] = [reach * axis, 1e-3 * axis]
        models.append(two_targets(space, twists, np.array([random_frame(rng), random_frame(rng)])))
    assert_as_one_at_a_time(models, "exact", 1000)
    layouts = sampler.to_arrays_at_poses(models)
    errors = sampler.errors(layouts[1], "exact", 0, 0, 4000, pose=1)
    assert np.linalg.norm(errors[3:], axis=0).max() > 2.9


def test_laws_of_every_kind_are_split_by_scope() -> None:
    laws = {
        "empirical": Empirical(((0.0, 0.9), (0.5, 1.0), (1.0, 1.4))),
        "rows": Rows(((1.0, 0.2), (0.5, -0.1), (0.3, 0.7))),
        "circle": Circle(0.5),
        "normal": Normal(0.3),
        "other": Normal(0.6),
        "uniform": Uniform(0.5),
        "fixed": Fixed(0.5),
    }
    draws = tuple(
        Draw(f"{name}.{scope.value}", law, scope) for name, law in laws.items() for scope in (Scope.UNIT, Scope.VISIT)
    )
    matrix = ((1.0, 0.6), (0.6, 1.0))
    groups = [tuple(f"{name}.{scope}" for name in ("other", "uniform")) for scope in ("visit", "unit")]
    space = Space(draws, tuple(Correlation(names, matrix) for names in groups))
    rng = np.random.default_rng(8)
    first = plain_table(space, [random_frame(rng) for _ in range(space.size)], 1e-3 * rng.normal(size=(space.size, 6)))
    assert_as_one_at_a_time(moved(first, 1, 4), "exact", 600, pose=5, visit=3)


def test_poses_laid_out_together_are_those_laid_out_alone_and_those_can_be_joined() -> None:
    models = at_poses(5, 8, targets=5, terms=30, shift=1e-3, turn=1e-2)
    together, alone = sampler.to_arrays_at_poses(models), [sampler.to_arrays(at) for at in models]
    for one, other in zip(together, alone, strict=True):
        assert (one.largest_angle, one.rows) == (other.largest_angle, other.rows)
        for a, b in zip((*one.superposition, *one.motions), (*other.superposition, *other.motions), strict=True):
            np.testing.assert_array_equal(a, b)
    assert sampler.to_arrays_at_poses([]) == []
    plans = planned(models)
    one, other = (sampler.observe_norms(of, plans, "exact", 0, 0, 1, samples=90) for of in (together, alone))
    for field in fields(NormBlocks):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name), err_msg=field.name)
    # a block depends on nothing but its number
    both = sampler.observe_norms(together, plans, "exact", 5, 2, 2)
    second = sampler.observe_norms(together[1:], plans[1:], "exact", 5, 3, 1, first_pose=1)
    np.testing.assert_array_equal(both.sums[1:, 1], second.sums[:, 0])


def test_the_small_sketch_is_as_fine_as_it_says() -> None:
    edges = sampler.norm_edges()
    assert edges.shape == (loops.NORM_COLUMNS + 1,)
    assert edges[0] == -np.inf
    assert edges[-1] == np.inf
    np.testing.assert_array_equal(edges, -edges[::-1])
    widths, inner = np.diff(edges[1:-1]), edges[1:-1]
    nearest = np.minimum(np.abs(inner[:-1]), np.abs(inner[1:]))
    assert (widths <= np.maximum(1 / 16, nearest / 32)).all()
    assert inner[-1] >= 15.5
    assert 2 * 4 * loops.NORM_COLUMNS + 8 * loops.LANE_DOUBLES < 10_240


def test_wrong_inputs_are_told_in_a_line() -> None:
    models = at_poses(3, 2, targets=2, terms=9, shift=1e-3, turn=1e-3)
    layouts, plans = sampler.to_arrays_at_poses(models), planned(models)
    other = sampler.to_arrays_at_poses(at_poses(4, 1, targets=3, terms=9, shift=1e-3, turn=1e-3))
    good: dict[str, Any] = {"poses": layouts, "plans": plans, "model": "exact", "seed": 0, "first": 0, "more": {}}
    for changed, message in (
        ({"poses": [], "plans": []}, "no poses to sample"),
        ({"plans": plans[:1]}, "2 poses and 1 plans"),
        ({"poses": [*layouts, *other], "plans": [*plans, plans[0]]}, "must be of one model"),
        ({"plans": [plans[0], replace(plans[1], specifications=())]}, "different specifications"),
        ({"model": "cubic"}, "model must be exact or linear"),
        ({"seed": -1}, "the seed must be"),
        ({"first": 1, "more": {"samples": 10}}, "none beyond the last sample"),
        ({"more": {"first_pose": 2**20 - 2}}, "the pose must be a whole number from 0 to 1048574, got 1048575"),
    ):
        poses, of, model, seed, first, more = {**good, **changed}.values()
        with pytest.raises(InputError, match=message):
            sampler.observe_norms(poses, of, model, seed, first, 1, **more)


@pytest.mark.parametrize("scope", [Scope.UNIT, Scope.VISIT])
def test_what_cannot_be_computed_is_told_with_pose_and_sample(scope: Scope) -> None:
    space = Space((Draw("a", Uniform(1.0), scope), Draw("b", Uniform(1.0))))
    plans = [Plan(np.zeros(8), np.ones(8))] * 2

    def layouts(reach: float, formula: Any = None) -> list[SamplerArrays]:
        program = PROGRAM if formula is None else Program.compile([formula, Component("b")], space.index)
        twists = [np.outer([size, 0.0], np.eye(6)[5]) for size in (1e-3, reach)]
        return sampler.to_arrays_at_poses([two_targets(space, one, program=program) for one in twists])

    turning = layouts(4.0)
    x = space.sample(0, 0, 1000, pose=1)[0]
    first = int(np.flatnonzero(np.abs(4.0 * x) >= np.pi)[0])
    observe = sampler.observe_norms
    with pytest.raises(InputError, match=r"pose 1, sample \d+: an error turns a place by half a turn") as caught:
        observe(turning, plans, "exact", 0, 0, 1, samples=1000)
    told = int(str(caught.value).split("sample ")[1].split(":")[0])
    assert abs(4.0 * x[told]) >= np.pi
    assert first // 256 == told // 256
    with pytest.raises(InputError, match=r"pose 0, sample 0: a parameter's formula fails"):
        observe(layouts(1e-3, 1 / (Component("a") * 0.0)), plans, "exact", 0, 0, 1, samples=300)
    with pytest.raises(InputError, match=r"pose 1, sample \d+: the error is not a finite number"):
        observe(layouts(1e200), plans, "linear", 0, 0, 1, samples=300)
    # beyond the last sample nothing is refused
    assert observe(turning, plans, "exact", 0, 0, 1, samples=first or 1).count == (first or 1)
