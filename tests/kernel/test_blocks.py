"""Accumulation in blocks: the same bits for any division of the work, equal to those of the plain statistics."""

from __future__ import annotations

import itertools
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace

import numpy as np
import pytest

from kernel.cases import EVERY_LAW, accumulate, plain_table, random_table, single_formula
from precision_pin.base.errors import InputError
from precision_pin.draws.draw import Draw
from precision_pin.draws.expressions import Component, sqrt
from precision_pin.draws.laws import Fixed, Uniform
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.kernel.sampler import BLOCK
from precision_pin.statistics import Plan, Specification, State, finish, observe, start
from precision_pin.statistics.accumulate import LARGEST, merge

AT = random_table(8, targets=6, terms=25, shift=1e-3, turn=1e-3)
LAYOUT = sampler.to_arrays(AT)
ERRORS = AT.exact(EVERY_LAW.sample(0, 0, 4000))
PLAN = Plan.from_moments(
    ERRORS.mean(axis=1),
    np.cov(ERRORS),
    (
        Specification("position.norm", float(np.median(np.linalg.norm(ERRORS[:3], axis=0))), 0.5),
        Specification("attitude.y", float(np.median(np.abs(ERRORS[4]))), 0.5),
    ),
)


def assert_same_bits(first: State, second: State) -> None:
    for field in fields(State):
        np.testing.assert_array_equal(getattr(first, field.name), getattr(second, field.name), err_msg=field.name)


@pytest.mark.fast(6)
@pytest.mark.parametrize("model", ["exact", "linear"])
@pytest.mark.parametrize("samples", [1, 2, 255, 256, 257, 16_384, 16_385, 40_001, 3 * BLOCK])
def test_the_state_has_the_bits_of_observing_the_errors(model, samples: int) -> None:
    errors = sampler.errors(LAYOUT, model, 11, 0, samples, pose=2, visit=1)
    blocks = -(-samples // BLOCK)
    state = accumulate(LAYOUT, PLAN, model, 11, 0, blocks, samples=samples, pose=2, visit=1)
    assert_same_bits(state, observe(PLAN, start(PLAN), errors))
    assert state.count == samples
    assert finish(PLAN, state).samples == samples


def test_errors_do_not_depend_on_the_range_asked_for() -> None:
    whole = sampler.errors(LAYOUT, "exact", 3, 0, 2000)
    for first, count in [(0, 1), (1, 1), (1, 2), (7, 900), (255, 2), (256, 256), (513, 1487)]:
        np.testing.assert_array_equal(sampler.errors(LAYOUT, "exact", 3, first, count), whole[:, first : first + count])
    components = sampler.sample(LAYOUT, 3, 0, 2000)
    np.testing.assert_array_equal(sampler.errors_at(LAYOUT, "exact", components), whole)
    np.testing.assert_array_equal(sampler.errors_at(LAYOUT, "exact", components[:, 5:700]), whole[:, 5:700])


@pytest.mark.slow
def test_any_cut_into_calls_and_any_number_of_threads_give_the_same_bits() -> None:
    samples, blocks = 9 * BLOCK + 1234, 10
    whole = accumulate(LAYOUT, PLAN, "exact", 5, 0, blocks, samples=samples)
    for cuts in ([0, 10], [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10], [0, 4, 5, 10], [0, 9, 10]):
        pieces = [(a, b - a) for a, b in itertools.pairwise(cuts)]
        one_by_one = start(PLAN)
        for first, count in pieces:
            one_by_one = accumulate(LAYOUT, PLAN, "exact", 5, first, count, samples=samples, state=one_by_one)
        assert_same_bits(one_by_one, whole)
        for threads in (1, 2, 3):
            with ThreadPoolExecutor(threads) as pool:
                found = pool.map(
                    lambda piece: sampler.observe_blocks(LAYOUT, PLAN, "exact", 5, *piece, samples=samples), pieces
                )
                state = start(PLAN)
                for part in found:
                    state = part.add_to(state)
            assert_same_bits(state, whole)


def test_a_block_depends_on_nothing_but_its_number() -> None:
    alone = accumulate(LAYOUT, PLAN, "exact", 5, 3, 1)
    errors = sampler.errors(LAYOUT, "exact", 5, 3 * BLOCK, BLOCK)
    observed = observe(PLAN, start(PLAN), errors)
    assert_same_bits(alone, replace(observed, largest_units=observed.largest_units + 3 * BLOCK))
    together = sampler.observe_blocks(LAYOUT, PLAN, "exact", 5, 2, 2)
    np.testing.assert_array_equal(together.sums[1, :8], alone.sums)
    assert_same_bits(merge(accumulate(LAYOUT, PLAN, "exact", 5, 2, 1), alone), together.add_to(start(PLAN)))


def test_the_largest_errors_can_be_drawn_again_by_their_numbers() -> None:
    state = accumulate(LAYOUT, PLAN, "exact", 5, 0, 3)
    for largest, units, rows in zip(state.largest, state.largest_units, (slice(0, 3), slice(3, 6)), strict=True):
        again = [np.linalg.norm(sampler.errors(LAYOUT, "exact", 5, int(unit), 1)[rows]) for unit in units]
        np.testing.assert_allclose(largest, again, rtol=1e-15)
        everything = np.linalg.norm(sampler.errors(LAYOUT, "exact", 5, 0, 3 * BLOCK)[rows], axis=0)
        np.testing.assert_array_equal(units, np.argsort(-everything)[:LARGEST])


def test_kept_errors_are_the_errors() -> None:
    found = sampler.observe_blocks(LAYOUT, PLAN, "linear", 5, 1, 2, samples=2 * BLOCK + 77, keep_errors=True)
    assert found.count == BLOCK + 77
    np.testing.assert_array_equal(found.errors, sampler.errors(LAYOUT, "linear", 5, BLOCK, BLOCK + 77))
    assert sampler.observe_blocks(LAYOUT, PLAN, "linear", 5, 1, 1).errors is None


def test_seeds_units_poses_and_visits_differ() -> None:
    first = sampler.errors(LAYOUT, "exact", 0, 0, 100)
    for other in (
        sampler.errors(LAYOUT, "exact", 1, 0, 100),
        sampler.errors(LAYOUT, "exact", 0, 100, 100),
        sampler.errors(LAYOUT, "exact", 0, 0, 100, pose=1),
        sampler.errors(LAYOUT, "exact", 0, 0, 100, visit=1),
    ):
        assert (first != other).any(axis=0).all()


def test_units_beyond_the_last_one_do_not_fail_the_run() -> None:
    at = single_formula(sqrt(Component("a")), Uniform(1.0, 0.99))
    layout = sampler.to_arrays(at)
    bad = int(np.flatnonzero(at.space.sample(0, 0, 10_000)[0] < 0)[0])
    assert accumulate(layout, PLAN, "exact", 0, 0, 1, samples=bad).count == bad
    with pytest.raises(InputError, match=f"sample {bad}: "):
        accumulate(layout, PLAN, "exact", 0, 0, 1, samples=bad + 1)


def test_a_constant_error_is_counted_without_spread() -> None:
    at = plain_table(Space((Draw("a", Fixed(1e-3)),)), np.eye(4)[None], [[1.0, 0, 0, 0, 0, 0]])
    plan = Plan(np.zeros(8), np.zeros(8))
    summary = finish(plan, accumulate(sampler.to_arrays(at), plan, "exact", 0, 0, 1, samples=1000))
    assert summary.position.norm.mean == summary.position.norm.max == summary.position.x.min == 1e-3
    assert summary.position.x.std == 0
    assert summary.attitude.norm.max == 0


@pytest.mark.parametrize(
    ("first", "blocks", "samples"), [(-1, 1, None), (0, 0, None), (0, 2**20, None), (2, 1, 2 * BLOCK), (0, 1, 0)]
)
def test_blocks_that_do_not_exist_are_refused(first: int, blocks: int, samples: int | None) -> None:
    with pytest.raises(InputError, match=r"from block 0"):
        sampler.observe_blocks(LAYOUT, PLAN, "exact", 0, first, blocks, samples=samples)
