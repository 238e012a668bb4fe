"""The compiled engine against the numpy oracle, matrix exponentials and by hand; the same bits for any blocks and poses."""

import itertools
import math
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm, logm
from scipy.spatial.transform import Rotation

from kernel.cases import (
    EVERY_LAW,
    accumulate,
    assert_same_state,
    model_of,
    plain_table,
    pose_model,
    random_frame,
    random_table,
)
from precision_pin.base.errors import InputError
from precision_pin.draws.correlation import Correlation
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.expressions import Component, Expression, sqrt
from precision_pin.draws.laws import Circle, Empirical, Fixed, Law, Normal, Rows, Sphere, Uniform
from precision_pin.draws.space import Space
from precision_pin.kernel import loops, sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.kernel.loops import FINE, NARROW, WIDE
from precision_pin.kernel.sampler import BLOCK, JoinedTables, NormBlocks
from precision_pin.model.pose_model import PoseModel
from precision_pin.statistics import Plan, Specification, finish, observe, quantity_values, start
from precision_pin.statistics.accumulate import LARGEST, merge


def worst(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.max(np.abs(found - expected) / np.maximum(1, np.abs(expected)), initial=0.0))


def single_formula(formula: Expression, law: Law | None = None, scale: float = 1e-3) -> PoseModel:
    """Return one target shifted along z by a formula of the draw ``a``, standard normal if no law is given."""
    space = Space((Draw("a", law or Normal(1.0)),))
    return model_of(space, [np.eye(4)], [0], [scale * np.eye(6)[2]], [[0]], formulas=[formula])


@pytest.mark.parametrize("seed", range(5))
def test_both_models_equal_the_oracle_on_random_tables(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = float(rng.choice([1e-6, 1e-4, 1e-3, 1e-2, 5e-2]))
    at = random_table(
        seed, targets=int(rng.integers(1, 15)), terms=int(rng.integers(1, 80)), shift=10 * turn, turn=turn
    )
    layout = sampler.to_arrays(at)
    x = EVERY_LAW.sample(seed, 5, 1000, pose=1, visit=2)
    for name, oracle in (("linear", at.linear), ("exact", at.exact)):
        expected = oracle(x)
        assert worst(sampler.errors_at(layout, name, x), expected) < 1e-12
        assert worst(sampler.errors(layout, name, seed, 5, 1000, pose=1, visit=2), expected) < 1e-12
        # relative to the errors themselves as well, although these may be micrometres
        assert np.abs(sampler.errors_at(layout, name, x) - expected).max() < 1e-12 + 1e-9 * np.abs(expected).max()


@pytest.mark.slow
@pytest.mark.parametrize(("turn", "series", "slides"), [(1e-4, FINE, False), (3e-3, NARROW, False), (0.03, WIDE, True)])
def test_any_number_of_terms_of_one_and_two_factors(turn: float, series: int, slides: bool) -> None:
    """The loops take six, five, four or three terms at once, and three products."""
    rng = np.random.default_rng(int(slides))
    space = Space(tuple(Draw(f"a{k}", Uniform(1.0)) for k in range(13)))
    x = space.sample(0, 0, 150)
    for singles, products in np.ndindex(14, 5):
        alone = [[k] for k in range(singles)]
        together = [[k, k + 1] for k in range(products)]
        # the second target turns once more than the first, and slides seldom
        of_first, of_second = [*together, *alone], [*alone, [3], *together, [0, 1, 2]]
        twists = rng.normal(size=(len(of_first) + len(of_second), 6)) * np.repeat([0.01, turn], 3)
        twists[: len(of_first) * slides, 3:] = 0.0
        twists[len(of_first) :: 2, :3] = 0.0
        target = np.repeat([0, 1], [len(of_first), len(of_second)])
        tip, *frames = (random_frame(rng) for _ in range(3))
        at = model_of(space, frames, target, twists, [*of_first, *of_second], tip=tip)
        layout = sampler.to_arrays(at)
        assert singles < 13 or layout.motions.series[-1] == series
        for name, oracle in (("linear", at.linear), ("exact", at.exact)):
            # of sums of up to 40 terms of 0.01 m and of the turn
            allowed = 1e-14 * (1 + 20 * turn)
            np.testing.assert_allclose(sampler.errors_at(layout, name, x), oracle(x), rtol=0, atol=allowed)


def test_up_to_three_radians_of_total_error() -> None:
    rng = np.random.default_rng(3)
    space = Space(tuple(Draw(f"a{k}", Uniform(1.0)) for k in range(5)))
    frames = [random_frame(rng) for _ in range(5)]
    at = plain_table(space, frames, rng.normal(size=(5, 6)) * 0.7, tip=random_frame(rng))
    x = space.sample(1, 0, 20_000)
    found, expected = sampler.errors_at(sampler.to_arrays(at), "exact", x), at.exact(x)
    angle = np.linalg.norm(expected[3:], axis=0)
    below = angle < 3.0
    assert angle[below].max() > 2.9
    assert worst(found[:, below], expected[:, below]) < 1e-12
    # beyond π the shorter way round is taken, as the oracle does
    assert worst(np.linalg.norm(found[3:], axis=0), angle) < 1e-11


@pytest.mark.parametrize(("largest", "series"), [(math.pi, WIDE), (0.2499, NARROW), (0.00999, FINE)])
def test_one_target_up_to_half_a_turn(largest: float, series: int) -> None:
    axis = np.array([1.0, -2.0, 0.5]) / np.linalg.norm([1.0, -2.0, 0.5])
    at = plain_table(Space((Draw("a", Uniform(largest)),)), np.eye(4)[None], [[0, 0, 0, *axis]])
    layout = sampler.to_arrays(at)
    assert layout.motions.series.tolist() == [series, series]
    edge = [0.2499999, 0.25, 0.2500001] if largest > 1 else []
    angle = np.concatenate([np.linspace(-largest, largest, 1003)[1:-1], [1e-300, 1e-12, *edge]])
    expected = np.outer(np.concatenate([np.zeros(3), axis]), angle)
    np.testing.assert_allclose(sampler.errors_at(layout, "exact", angle[None]), expected, rtol=2e-15, atol=1e-300)


@pytest.mark.parametrize(
    ("largest", "series"),
    [
        (0.0099, [FINE, FINE, FINE]),
        (0.0199, [FINE, FINE, NARROW]),
        (0.0201, [NARROW, NARROW, NARROW]),
        (0.251, [NARROW, NARROW, WIDE]),
        (3.0, [WIDE, WIDE, WIDE]),
    ],
)
def test_series_on_either_side_of_the_switches_equal_matrix_exponentials(largest: float, series: list[int]) -> None:
    rng = np.random.default_rng(7)
    at = plain_table(
        Space((Draw("a", Uniform(largest / 2)), Draw("b", Uniform(largest / 2)))),
        [random_frame(rng), random_frame(rng)],
        [[0.1, 0.2, 0.3, 0.6, 0.0, 0.8], [0.3, 0.0, -0.2, 0.0, 1.0, 0.0]],
        tip=random_frame(rng),
    )
    layout = sampler.to_arrays(at)
    assert layout.largest_angle == pytest.approx(largest, rel=1e-9)
    assert layout.motions.series.tolist() == series
    x = at.space.sample(0, 0, 8)
    found = sampler.errors(layout, "exact", 0, 0, 8)
    for values, error in zip(x.T, found.T, strict=True):
        motion = np.eye(4)
        for frame, twist, value in zip(at.table.frames, at.table.twists, values, strict=True):
            inserted = np.eye(4)
            inserted[:3, :3] = expm(np.cross(np.eye(3), twist[3:] * value))
            inserted[:3, 3] = twist[:3] * value
            motion = motion @ frame @ inserted @ np.linalg.inv(frame)
        tip = motion @ at.table.pose
        turn = logm(tip[:3, :3] @ at.table.pose[:3, :3].T).real
        expected = [*(tip[:3, 3] - at.table.pose[:3, 3]), turn[2, 1], turn[0, 2], turn[1, 0]]
        np.testing.assert_allclose(error, expected, rtol=0, atol=2e-14)


def test_nothing_random_nothing_at_all_and_what_no_draw_can_give() -> None:
    layout = sampler.to_arrays(plain_table(Space(()), np.zeros((0, 4, 4)), np.zeros((0, 6))))
    for model, count in itertools.product(("exact", "linear"), (0, 4)):
        assert not sampler.errors(layout, model, 0, 3, 7).any()
        assert sampler.errors_at(layout, model, np.zeros((0, count))).shape == (6, count)
    at = plain_table(Space((Draw("a", Uniform(1e-3)),)), np.eye(4)[None], [[0, 0, 1.0, 0, 0, 1.0]])
    layout = sampler.to_arrays(at)
    assert (layout.motions.series == FINE).all()
    np.testing.assert_allclose(sampler.errors_at(layout, "exact", [[2.5, 1e-3]])[5], [2.5, 1e-3], rtol=2e-15)


def test_a_formula_that_fails_is_refused_and_named_with_its_sample() -> None:
    a = Component("a")
    for formula, law, allowed in (
        (1 / a, None, True),
        (1 / (a - a), None, False),
        (sqrt(a), Normal(1e-3, 1.0), True),
        (a**0.5, None, False),
        (a**-2, Fixed(0.0), False),
        # infinity would vanish in the second division, so it is the first that must be noticed
        (1 / (1 / (a - a)), None, False),
        (a**8, Fixed(1e60), False),
    ):
        at = single_formula(formula, law)
        layout = sampler.to_arrays(at)
        x = at.space.sample(1, 0, 600)
        if allowed:
            assert worst(sampler.errors_at(layout, "exact", x), at.exact(x)) < 1e-12
            continue
        with pytest.raises(InputError, match=r"sample \d+: a parameter's formula fails") as failure:
            sampler.errors_at(layout, "exact", x)
        sample = int(str(failure.value).split("sample ")[1].split(":")[0])
        with pytest.raises(InputError):
            at.exact(x[:, [sample]])
        if sample:
            at.exact(x[:, :sample])


def test_a_failure_counts_only_among_the_units_asked_for() -> None:
    at = single_formula(sqrt(Component("a")), Uniform(1.0, 0.95))
    layout = sampler.to_arrays(at)
    bad = np.flatnonzero(at.space.sample(1, 0, 3000)[0] < 0)
    for unit in bad[:20].tolist():
        with pytest.raises(InputError, match=f"sample {unit}: "):
            sampler.errors(layout, "exact", 1, unit, 1)
        # neither the unit before, in the same pair, nor those after, in the same tile, may be the reason
        last = int(bad[bad > unit][0])
        assert np.isfinite(sampler.errors(layout, "exact", 1, unit + 1, last - unit - 1)).all()
    first = int(bad[0])
    assert accumulate(layout, PLAN, "exact", 1, 0, 1, samples=first).count == first
    with pytest.raises(InputError, match=f"sample {first}: "):
        accumulate(layout, PLAN, "exact", 1, 0, 1, samples=first + 1)


def test_a_target_that_turns_by_pi_is_refused_in_the_exact_model_only() -> None:
    at = plain_table(Space((Draw("a", Normal(1.0)),)), np.eye(4)[None], [[0, 0, 0, 0, 0, 1.0]])
    layout = sampler.to_arrays(at)
    unit = int(np.flatnonzero(np.abs(at.space.sample(5, 0, 20_000)[0]) >= math.pi)[0])
    with pytest.raises(InputError, match=f"sample {unit}: an error rotates a frame by 180° or more"):
        sampler.errors(layout, "exact", 5, 0, 20_000)
    assert sampler.errors(layout, "exact", 5, 0, unit).shape == (6, unit)
    assert sampler.errors(layout, "exact", 5, unit + 1, 1).shape == (6, 1)
    sampler.errors(layout, "linear", 5, 0, 20_000)


def test_errors_that_are_not_finite_and_wrong_arguments_are_refused() -> None:
    huge, layout = (sampler.to_arrays(single_formula(Component("a"), *of)) for of in ((Fixed(1e300), 1e10), ()))
    for wrong, message in (
        *(
            (lambda m=m: sampler.errors(huge, m, 0, 0, 1), "sample 0: the error is not a finite")
            for m in ("exact", "linear")
        ),
        (lambda: sampler.errors_at(layout, "exact", np.zeros((2, 3))), r"shape \(2, 3\), expected \(1, N\)"),
        (lambda: sampler.errors_at(layout, "exact", [[math.nan]]), "not a finite number"),
        (lambda: sampler.errors(layout, "quadratic", 0, 0, 1), "exact or linear"),
    ):
        with pytest.raises(InputError, match=message):
            wrong()
    # more than the memory holds, at once
    for count in (10**11, 2**62):
        for keep in (lambda n: sampler.sample(layout, 1, 0, n), lambda n: sampler.errors(layout, "exact", 1, 0, n)):
            with pytest.raises(InputError, match=r"keeping \d+ numbers for each of [\d,]+ robots takes .* GB"):
                keep(count)


def test_bounds_of_components_and_angles_hold() -> None:
    for seed in range(4):
        at = random_table(seed, targets=5, terms=30, shift=0.1, turn=1e-3, slides=0.0)
        layout = sampler.to_arrays(at)
        x = np.concatenate([EVERY_LAW.sample(seed, 0, 5000), EVERY_LAW.inverse(np.full((EVERY_LAW.size, 1), 0.999))], 1)
        assert (x >= layout.lowest[:, None]).all()
        assert (x <= layout.highest[:, None]).all()
        moved = at.table.displacements(at.table.products(at.table.program.evaluate(x)))
        turns = np.linalg.norm(moved[:, 3:], axis=1)
        assert turns.sum(axis=0).max() <= layout.largest_angle
        series = layout.motions.series[-2::-1]
        assert (turns[series == FINE] <= 0.01).all()
        assert (turns[series == NARROW] <= 0.25).all()


AT = random_table(8, targets=6, terms=25, shift=1e-3, turn=1e-3)
LAYOUT = sampler.to_arrays(AT)
ERRORS = AT.exact(EVERY_LAW.sample(0, 0, 4000))
LIMITED = (("position.norm", 5e-3), ("attitude.y", 2e-3), ("position.x", 3e-3), ("attitude.norm", 5e-3))
SPECIFICATIONS = tuple(Specification(quantity, limit, 0.5) for quantity, limit in LIMITED)
PLAN = Plan.from_moments(ERRORS.mean(axis=1), np.cov(ERRORS), SPECIFICATIONS)


@pytest.mark.parametrize(("model", "samples"), [("exact", 1), ("linear", 257), ("exact", 16_385), ("linear", 40_001)])
def test_the_state_has_the_bits_of_observing_the_errors(model, samples: int) -> None:
    errors = sampler.errors(LAYOUT, model, 11, 0, samples, pose=2, visit=1)
    blocks = -(-samples // BLOCK)
    state = accumulate(LAYOUT, PLAN, model, 11, 0, blocks, samples=samples, pose=2, visit=1)
    assert_same_state(state, observe(PLAN, start(PLAN), errors))
    assert state.count == samples
    assert finish(PLAN, state).samples == samples


def test_errors_do_not_depend_on_the_range_asked_for() -> None:
    whole = sampler.errors(LAYOUT, "exact", 3, 0, 2000)
    for first, count in [(0, 1), (1, 1), (1, 2), (7, 900), (255, 2), (256, 256), (513, 1487)]:
        np.testing.assert_array_equal(sampler.errors(LAYOUT, "exact", 3, first, count), whole[:, first : first + count])
    components = sampler.sample(LAYOUT, 3, 0, 2000)
    np.testing.assert_array_equal(sampler.errors_at(LAYOUT, "exact", components), whole)
    np.testing.assert_array_equal(sampler.errors_at(LAYOUT, "exact", components[:, 5:700]), whole[:, 5:700])


def test_a_block_depends_on_nothing_but_its_number() -> None:
    alone = accumulate(LAYOUT, PLAN, "exact", 5, 3, 1)
    errors = sampler.errors(LAYOUT, "exact", 5, 3 * BLOCK, BLOCK)
    observed = observe(PLAN, start(PLAN), errors)
    assert_same_state(alone, replace(observed, largest_units=observed.largest_units + 3 * BLOCK))
    together = sampler.observe_blocks(LAYOUT, PLAN, "exact", 5, 2, 2)
    np.testing.assert_array_equal(together.sums[1, :8], alone.sums)
    assert_same_state(merge(accumulate(LAYOUT, PLAN, "exact", 5, 2, 1), alone), together.add_to(start(PLAN)))


def test_the_largest_errors_can_be_drawn_again_by_their_numbers() -> None:
    state = accumulate(LAYOUT, PLAN, "exact", 5, 0, 3)
    everything = quantity_values(sampler.errors(LAYOUT, "exact", 5, 0, 3 * BLOCK))[[0, 4]]
    np.testing.assert_array_equal(state.largest_units, np.argsort(-everything, axis=1)[:, :LARGEST])
    for row, (largest, units) in enumerate(zip(state.largest, state.largest_units, strict=True)):
        again = [quantity_values(sampler.errors(LAYOUT, "exact", 5, int(unit), 1))[4 * row, 0] for unit in units]
        np.testing.assert_allclose(largest, again, rtol=1e-15)


def test_kept_errors_are_the_errors() -> None:
    found = sampler.observe_blocks(LAYOUT, PLAN, "linear", 5, 1, 2, samples=2 * BLOCK + 77, keep_errors=True)
    assert found.count == BLOCK + 77
    np.testing.assert_array_equal(found.errors, sampler.errors(LAYOUT, "linear", 5, BLOCK, BLOCK + 77))
    assert sampler.observe_blocks(LAYOUT, PLAN, "linear", 5, 1, 1).errors is None


def test_blocks_that_do_not_exist_are_refused() -> None:
    for first, blocks, samples in ((-1, 1, None), (0, 0, None), (0, 2**20, None), (2, 1, 2 * BLOCK), (0, 1, 0)):
        with pytest.raises(InputError, match=r"from block 0"):
            sampler.observe_blocks(LAYOUT, PLAN, "exact", 0, first, blocks, samples=samples)


def at_poses(seed: int, poses: int, **shape: Any) -> list[PoseModel]:
    return moved(random_table(seed, **shape), seed, poses)


def moved(first: PoseModel, seed: int, poses: int) -> list[PoseModel]:
    """Return a table at random poses; at every third one some terms vanish."""
    rng = np.random.default_rng(seed)
    found = []
    for pose in range(poses):
        twists = first.table.twists * rng.uniform(0.5, 1.5, first.table.twists.shape)
        if pose % 3 == 2:
            twists[rng.random(twists.shape) < 0.5] = 0.0
        tip, *frames = (random_frame(rng) for _ in (None, *first.table.targets))
        table = replace(first.table, pose=tip, frames=np.array(frames), twists=twists)
        found.append(pose_model(first.space, table))
    return found


def planned(models: list[PoseModel]) -> list[Plan]:
    return [Plan.from_moments(at.error_at_means, at.covariance, SPECIFICATIONS) for at in models]


def assert_as_one_at_a_time(
    models: list[PoseModel], model: Any, samples: int, *, pose: int = 0, visit: int = 0
) -> None:
    """Compare many poses together with one pose after another."""
    plans, blocks = planned(models), -(-samples // BLOCK)
    tables = JoinedTables.of(sampler.to_arrays_at_poses(models))
    norms = sampler.observe_norms(tables, plans, model, 7, 0, blocks, samples=samples, first_pose=pose, visit=visit)
    edges = sampler.norm_edges()
    assert norms.count == samples
    for p, (at, plan) in enumerate(zip(models, plans, strict=True)):
        units: dict[str, Any] = {"samples": samples, "keep_errors": True, "pose": pose + p, "visit": visit}
        expected = sampler.observe_blocks(sampler.to_arrays(at), plan, model, 7, 0, blocks, **units)
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
    ("model", "poses", "samples"), [("exact", 1, 300), ("linear", 3, 1), ("exact", 5, BLOCK + 333), ("linear", 7, 2048)]
)
def test_all_scopes_formulas_and_products_have_the_bits_of_one_pose_at_a_time(model, poses: int, samples: int) -> None:
    models = at_poses(3, poses, targets=4, terms=25, shift=1e-3, turn=1e-3)
    assert {draw.scope for draw in EVERY_LAW.draws} == set(Scope)
    assert_as_one_at_a_time(models, model, samples, pose=2, visit=1)


def test_wide_angles() -> None:
    for turn in (0.02, 0.2):
        models = at_poses(12, 4, targets=3, terms=6, shift=1e-2, turn=turn)
        assert any((layout.motions.series == WIDE).any() for layout in sampler.to_arrays_at_poses(models))
        assert_as_one_at_a_time(models, "exact", 700)


@pytest.mark.slow
def test_a_turn_of_nearly_half_a_turn_at_one_pose_of_many() -> None:
    space = Space((Draw("a", Uniform(1.0)), Draw("b", Uniform(1.0), Scope.POSE)))
    rng = np.random.default_rng(4)
    models = []
    for reach in (1e-3, 3.0, 0.2):
        axis = [0, 0, 0, *Rotation.random(random_state=rng).as_matrix()[0]]
        models.append(plain_table(space, [random_frame(rng), random_frame(rng)], np.outer([reach, 1e-3], axis)))
    assert_as_one_at_a_time(models, "exact", 1000)
    layouts = sampler.to_arrays_at_poses(models)
    errors = sampler.errors(layouts[1], "exact", 0, 0, 4000, pose=1)
    assert np.linalg.norm(errors[3:], axis=0).max() > 2.9


def test_laws_of_every_kind_are_split_by_scope() -> None:
    laws = {
        "empirical": Empirical(((0.0, 0.9), (0.5, 1.0), (1.0, 1.4))),
        "rows": Rows(((1.0, 0.2), (0.5, -0.1), (0.3, 0.7))),
        "circle": Circle(0.5),
        "sphere": Sphere(0.5),
        "normal": Normal(0.3),
        "other": Normal(0.6),
        "uniform": Uniform(0.5),
        "fixed": Fixed(0.5),
    }
    scopes = (Scope.UNIT, Scope.VISIT)
    draws = tuple(Draw(f"{name}.{scope.value}", law, scope) for name, law in laws.items() for scope in scopes)
    groups = tuple(Correlation.pair(f"other.{scope.value}", f"uniform.{scope.value}", 0.6) for scope in scopes[::-1])
    space, rng = Space(draws, groups), np.random.default_rng(8)
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
    assert (edges[0], edges[-1]) == (-np.inf, np.inf)
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
    for poses, of, model, seed, first, more, message in (
        ([], [], "exact", 0, 0, {}, "no poses to sample"),
        (layouts, plans[:1], "exact", 0, 0, {}, "2 poses and 1 plans"),
        ([*layouts, *other], [*plans, plans[0]], "exact", 0, 0, {}, "must be of one model"),
        (layouts, [plans[0], replace(plans[1], specifications=())], "exact", 0, 0, {}, "different specifications"),
        (layouts, plans, "cubic", 0, 0, {}, "model must be exact or linear"),
        (layouts, plans, "exact", -1, 0, {}, "the seed must be"),
        (layouts, plans, "exact", 0, 1, {"samples": 10}, "none beyond the last sample"),
        (
            layouts,
            plans,
            "exact",
            0,
            0,
            {"first_pose": 2**20 - 2},
            "pose must be a whole number from 0 to 1048574, got 1048575",
        ),
    ):
        with pytest.raises(InputError, match=message):
            sampler.observe_norms(poses, of, model, seed, first, 1, **more)


@pytest.mark.parametrize("scope", [Scope.UNIT, Scope.VISIT])
def test_what_cannot_be_computed_is_told_with_pose_and_sample(scope: Scope) -> None:
    space = Space((Draw("a", Uniform(1.0), scope), Draw("b", Uniform(1.0))))
    plans = [Plan(np.zeros(8), np.ones(8))] * 2
    a, b = Component("a"), Component("b")

    def layouts(reach: float, formula: Expression = a) -> list[SamplerArrays]:
        frames, factors = [np.eye(4)] * 2, [[0], [1]]
        twists = [np.outer([size, 0.0], np.eye(6)[5]) for size in (1e-3, reach)]
        models = [model_of(space, frames, [0, 1], one, factors, formulas=[formula, b]) for one in twists]
        return sampler.to_arrays_at_poses(models)

    turning = layouts(4.0)
    x = space.sample(0, 0, 1000, pose=1)[0]
    first = int(np.flatnonzero(np.abs(4.0 * x) >= np.pi)[0])
    observe = sampler.observe_norms
    with pytest.raises(InputError, match=r"pose 1, sample \d+: an error rotates a frame by 180°") as caught:
        observe(turning, plans, "exact", 0, 0, 1, samples=1000)
    told = int(str(caught.value).split("sample ")[1].split(":")[0])
    assert abs(4.0 * x[told]) >= np.pi
    assert first // 256 == told // 256
    with pytest.raises(InputError, match=r"pose 0, sample 0: a parameter's formula fails"):
        observe(layouts(1e-3, 1 / (a * 0.0)), plans, "exact", 0, 0, 1, samples=300)
    with pytest.raises(InputError, match=r"pose 1, sample \d+: the error is not a finite number"):
        observe(layouts(1e200), plans, "linear", 0, 0, 1, samples=300)
    # beyond the last sample nothing is refused
    assert observe(turning, plans, "exact", 0, 0, 1, samples=first or 1).count == (first or 1)
