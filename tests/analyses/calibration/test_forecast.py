"""The forecast against textbook formulas and complete calibrations, what one reading leaves, ranks known, the choice of poses."""

import itertools
import time
from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize, stats

import precision_pin as pp
from analyses.calibration.arms import OFF_AXIS, paper_model, plain_model, random_poses
from analyses.test_verdicts import CASES, UNIT, hinge
from precision_pin.analyses.calibration.design import observability
from precision_pin.analyses.calibration.forecast import (
    contact_poses,
    contact_warnings,
    interval_after,
    simulate_calibrations,
)
from precision_pin.analyses.calibration.plan import Design, _cheapest_weights, _project
from precision_pin.analyses.calibration.table import forecast_table, identifiability_lines
from precision_pin.render.text_table import whole_tables
from precision_pin.robot.examples import shipped_sheets
from support.refusals import check_refused
from support.sheets import seven_joint_arm

SET_UPS = [
    pp.Measurement(std=20e-6, target=OFF_AXIS),
    pp.Measurement(std=20e-6, target=OFF_AXIS, base="free", target_known=False),
    pp.Measurement("pose", std=20e-6, base="free"),
    pp.Measurement("distance", std=10e-6, anchor=(1.0, 0.5, 0.2), base="free"),
]


def textbook(model, q, measurement):
    """Return the covariance of the unit-scope numbers: the joint normal equations, by finite differences of readings."""
    space, nuisances = model.space, len(measurement.nuisances)
    std = np.sqrt(space.block_covariance.variances)
    is_unit = np.repeat([draw.scope is pp.Scope.UNIT for draw in space.draws], [draw.law.size for draw in space.draws])
    unit, others = np.flatnonzero(is_unit & (std > 0)), np.flatnonzero(~is_unit)
    wanted = [*unit, *range(space.size, space.size + nuisances)]
    here = np.concatenate([space.mean, np.zeros(nuisances)])
    steps = np.concatenate([np.where(std > 0, 1e-2 * std, 1.0), np.full(nuisances, 1e-6)])
    information = np.diag(np.concatenate([1 / std[unit] ** 2, np.zeros(nuisances)]))
    for at in model.at_columns(q):

        def reading(x):
            x, n = x[: space.size, None], x[space.size :, None]
            return measurement.predict(at.posture.pose, at.exact(x), n)[:, 0]  # noqa: B023

        slopes = np.array([reading(here + one) - reading(here - one) for one in np.diag(steps)]).T / (2 * steps)
        noise = np.diag(measurement.deviations**2) + (slopes[:, others] * std[others] ** 2) @ slopes[:, others].T
        information += slopes[:, wanted].T @ np.linalg.solve(noise, slopes[:, wanted])
    scale = np.sqrt(np.diag(information))
    return (np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale))[: unit.size, : unit.size]


@pytest.mark.slow
@pytest.mark.parametrize("measurement", SET_UPS, ids=lambda one: f"{one.kind}-{one.base}")
def test_covariance_is_that_of_the_normal_equations(measurement):
    q = random_poses(4, 8)
    found = pp.forecast_calibration(plain_model(), q, measurement).posterior
    expected = textbook(plain_model(), q, measurement)
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found.covariance / np.outer(scale, scale), expected / np.outer(scale, scale), atol=2e-5)


def test_error_left_is_propagated_to_the_users_poses():
    model, measurement, q = plain_model(), SET_UPS[0], random_poses(4, 12)
    found = pp.forecast_calibration(model, q, measurement, at=["work"])
    (entry,) = found.poses
    at = model.at("work")
    unit = [model.space.index[name] for name in found.posterior.names]
    rest = [k for k in range(model.space.size) if k not in unit]
    floor = at.jacobian[:, rest] @ np.diag(model.space.block_covariance.variances[rest]) @ at.jacobian[:, rest].T
    slopes = at.jacobian[:, unit]
    np.testing.assert_allclose(entry.floor, floor, atol=1e-20)
    left = slopes @ found.posterior.covariance @ slopes.T
    np.testing.assert_allclose(entry.covariance_after, left + floor, atol=1e-19)
    np.testing.assert_allclose(entry.covariance_before, at.covariance, atol=1e-19)
    # the arm that is left, for other analyses
    np.testing.assert_allclose(found.model.at("work").covariance, entry.covariance_after, atol=1e-19)
    assert found.rms("floor") < found.rms("after") < found.rms("before")


@pytest.mark.slow
def test_simulated_calibrations_agree():
    """Robots are built, measured and fitted with the exact model: the error left is that forecast, to 2 %."""
    model, q, measurement = plain_model(), random_poses(4, 12), SET_UPS[3]
    forecast = pp.forecast_calibration(model, q, measurement)
    simulated = simulate_calibrations(model, q, measurement, robots=4000)
    expected = np.array([entry.rms("after") for entry in forecast.poses])
    np.testing.assert_allclose(simulated.rms_position, expected, rtol=0.02)
    assert simulated.chi_square.mean() == pytest.approx(simulated.degrees_of_freedom, rel=0.02)
    # intervals of 95 % of the numbers hold the truth as often as they say
    left = np.array(list(forecast.posterior.std.values())) / np.array(list(forecast.posterior.prior_std.values()))
    inside = np.abs(simulated.estimates - simulated.truth) <= stats.norm.ppf(0.975) * left[:, None]
    assert 0.945 < inside.mean() < 0.955


@pytest.mark.slow
def test_a_better_instrument_and_more_poses_help_down_to_the_floor():
    found = pp.forecast_calibration(plain_model(), random_poses(4, 40), SET_UPS[0])
    for curve, direction in ((found.by_count, -1), (found.by_instrument, 1)):
        values = np.array([point.rms_position for point in curve])
        assert (direction * np.diff(values) > 0).all()
        assert values.min() > found.rms("floor")
    for curve, own in ((found.by_count, 40), (found.by_instrument, 20e-6)):
        here = next(point for point in curve if point.value == pytest.approx(own))
        assert here.rms_position == pytest.approx(found.rms("after"), rel=1e-9)


@pytest.mark.slow
def test_repeating_a_pose_does_not_remove_its_own_error():
    """A pose-scope error is the same at every visit of a pose: visits average the others only."""
    model, one = plain_model(), random_poses(4, 1)
    found = pp.forecast_calibration(model, np.repeat(one, 400, axis=1), pp.Measurement(std=1e-7), at=one)
    pose_scope = model.at(one[:, 0]).jacobian[:3, model.space.index["joint_offset[joint3]#2.offset"]] * 1e-5
    left = found.poses[0].covariance_after[:3, :3] - found.poses[0].floor[:3, :3]
    assert np.trace(left) > 0.3 * pose_scope @ pose_scope


@pytest.mark.parametrize(("name", "std"), [("two values", 0.2), ("lognormal of variation 1", 1.0)])
def test_the_95_percent_of_a_law_that_is_not_normal(name, std):
    """Of a hinge with its tip 1 m away, measured once across: to first order one number, of which c is left.

    Of two values the upper one has 1 in 17 robots: the normal law's quantile lies far below it.
    """
    ((law,), at, _), std = CASES[name], std * UNIT
    below = np.vectorize(at)

    def entry_of(law):
        found = pp.forecast_calibration(hinge(law), [[0.0]], pp.Measurement(std=std), at=[[0.0]])
        return found, *found.poses

    found, entry = entry_of(law)
    variance, mean = float(law.covariance[0, 0]), float(law.mean_vector[0])
    left = 1 / (1 + variance / std**2)
    noise = np.sqrt(variance * (left - left**2))
    assert entry.rms("after") == pytest.approx(np.sqrt(variance * left), rel=1e-6)
    # |left (a - mean) + noise|, by quadrature over the noise
    nodes, weights = np.polynomial.hermite_e.hermegauss(120)

    def inside(size):
        ends = [(mean + (sign * size - noise * nodes) / left) / UNIT for sign in (1, -1)]
        return float(weights @ (below(ends[0]) - below(ends[1])) / weights.sum())

    low, high = entry.quantile_interval("after")
    assert inside(low) < 0.95 + 3e-3
    assert inside(high) > 0.95 - 3e-3
    assert low <= entry.quantile("after") <= high
    assert inside(0.97 * low) < 0.95 < inside(1.03 * high)
    low, high = entry.quantile_interval("before")
    less, more = 0.9999 * low / UNIT - 1e-6, 1.0001 * high / UNIT
    assert below(less) - below(-less) <= 0.95 <= below(more) - below(-more)
    assert [finding.code for finding in found.findings] == ["W_NOT_NORMAL"]
    assert "of 10,000 robots sampled with the sheet's laws" in " ".join(forecast_table(found).split())
    # of a normal law it is a closed form
    _, entry = entry_of(pp.Normal(UNIT))
    expected = stats.norm.ppf(0.975) * UNIT * np.sqrt(1 / (1 + UNIT**2 / std**2))
    assert entry.quantile("after") == pytest.approx(expected, rel=1e-6)
    assert entry.quantile_interval("after") is None


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5", "sliding"])
def test_ranks_of_all_geometric_errors(name):
    """4R + 2P + 6 with poses, 4R + 2P + 3 with points, two fewer with the tip on the last axis."""
    chain = seven_joint_arm(prismatic=(2, 6)) if name == "sliding" else pp.ErrorModel.load(shipped_sheets()[name]).chain
    revolute = int((~chain.prismatic).sum())
    base = 4 * revolute + 2 * (len(chain.joints) - revolute)
    model, q = pp.every_frame(chain), random_poses(len(chain.joints), 25) / (2 if name == "sliding" else 1)
    point = pp.identifiability(model, q, pp.Measurement(target=OFF_AXIS))
    pose, tip = (pp.identifiability(model, q, pp.Measurement(kind)) for kind in ("pose", "position"))
    assert (pose.rank, point.rank, tip.rank) == (base + 6, base + 3, base + (3 if name == "sliding" else 1))
    # the rank does not hang on where zero begins: what is counted and what is not are far apart
    for found in (pose, point, tip):
        assert found.singular_values[found.rank - 1] > 1e-3 * found.singular_values[0]
        assert found.singular_values[found.rank :].max() < 1e-13 * found.singular_values[0]
    free = pp.identifiability(model, q, pp.Measurement("pose", base="free", target_known=False))
    assert (free.nuisance_rank, free.rank) == (12, base + 6 - 12)


def test_an_offset_and_a_turned_base_cannot_be_told_apart():
    chain = paper_model().chain
    mounting = pp.sources.Mounting(at="base", rz=pp.Normal(1e-3), x=pp.Normal(1e-3))
    sources = (pp.sources.JointOffset(joint="joint1", offset=pp.Normal(1e-3)), mounting)
    found = pp.identifiability(pp.ErrorModel(chain, pp.Space(), sources), random_poses(4, 10), pp.Measurement())
    assert (found.rank, found.determined) == (2, ("mounting[base].x",))
    (group,) = found.combinations
    assert (group.names, group.determined) == (("joint_offset[joint1].offset", "mounting[base].rz"), 1)
    np.testing.assert_allclose(group.unseen.weights, [np.sqrt(0.5), -np.sqrt(0.5)], atol=1e-9)


def test_combinations_are_one_short_paragraph():
    """The wall of a frame at every joint: five lines of 100, the other groups counted; all of them, by name, with --all."""
    found = pp.identifiability(pp.every_frame(paper_model().chain), random_poses(4, 30), pp.Measurement())
    (short,) = (line for line in identifiability_lines(found) if "only combinations" in line)
    with whole_tables(True):
        (full,) = (line for line in identifiability_lines(found) if "only combinations" in line)
    listed = [group for group in found.combinations if str(group) in short]
    assert len(short) <= 500
    assert short.endswith(f"and {len(found.combinations) - len(listed)} more groups: --all")
    assert all(str(group) in full for group in found.combinations)
    assert "--all" not in full


@pytest.mark.slow
def test_subspaces_do_not_depend_on_the_order_of_sources_and_poses():
    """At joint values off by 1e-9, too: the same groups, as ties are broken nowhere."""
    model, q = paper_model(), random_poses(4, 30)
    generator = np.random.default_rng(2)
    turned = pp.ErrorModel(model.chain, pp.Space(model.space.draws[::-1]), model.sources[::-1], model.poses)
    moved = q[:, generator.permutation(30)] + generator.normal(0, 1e-9, q.shape)
    one, other = (pp.identifiability(each, at, pp.Measurement()) for each, at in ((model, q), (turned, moved)))
    assert one.rank == other.rank
    assert (set(one.unseen), set(one.determined)) == (set(other.unseen), set(other.determined))
    groups, again = ({frozenset(group.names): group.determined for group in each.combinations} for each in (one, other))
    assert groups == again
    places = [other.names.index(name) for name in one.names]
    np.testing.assert_allclose(other.projector[np.ix_(places, places)], one.projector, atol=1e-6)
    # joint 1 is upright, and the load hangs in the axis of joint 4
    unseen = pp.identifiability(model, q, pp.Measurement("pose")).unseen
    assert unseen == ("joint_compliance[joint1].compliance", "joint_compliance[joint4].compliance")
    # one reading determines no more than it has numbers
    one = q[:, :1]
    ranks = [pp.identifiability(plain_model(), one, pp.Measurement(kind)).rank for kind in ("position", "distance")]
    assert ranks == [3, 1]


SOCKETS = ((0.9, 0.2, 0.8), (0.2, 0.9, 1.0), (-0.6, 0.5, 0.5))
PLANE = ((0.0, 0.0, 0.5), (0.1, -0.2, 1.0))


@pytest.mark.slow
def test_ranks_of_contact():
    """What moves no target against its place, of the 4R + 3 combinations that points determine.

    Known sockets leave nothing, and a known plane three moves along it and the scale of the arm about a point in it. With free
    places the six moves of the base go, and the scale of all lengths.
    """
    chain, unseen = paper_model().chain, {}
    model, points = pp.every_frame(chain), 4 * len(chain.joints) + 3
    for kind, place in (("socket", {"sockets": SOCKETS}), ("plane", {"plane": PLANE})):
        known = pp.Measurement(kind, target=OFF_AXIS, **place)
        poses = contact_poses(chain, known, 40)
        tips = np.array([at.posture.pose for at in model.at_columns(poses.q)])
        assert list(contact_warnings(known, tips)) == []
        for measurement in (known, replace(known, base="free")):
            found = pp.identifiability(model, poses, measurement)
            unseen[kind, measurement.base] = points - found.rank
            assert found.nuisance_rank == len(measurement.nuisances)
            assert found.singular_values[found.rank - 1] > 1e-5 * found.singular_values[0]
            assert found.singular_values[found.rank :].max() < 1e-13 * found.singular_values[0]
    assert unseen == {("socket", "known"): 0, ("plane", "known"): 4, ("socket", "free"): 7, ("plane", "free"): 7}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("criterion", "measurement"), [("D", SET_UPS[0]), ("task", pp.Measurement(std=20e-6, target=OFF_AXIS, base="free"))]
)
def test_the_best_of_all_choices_is_found(criterion, measurement):
    """3 of 6 poses: all 20 choices, each by its forecast."""
    model, q = plain_model(), random_poses(4, 6)
    plan = pp.plan_calibration(model, q, 3, measurement, at=["work"], criterion=criterion)
    losses = {}
    for chosen in itertools.combinations(range(6), 3):
        found = pp.forecast_calibration(model, q[:, chosen], measurement, at=["work"])
        std = np.array(list(found.posterior.prior_std.values()))
        volume = np.linalg.slogdet(found.posterior.covariance / np.outer(std, std))[1]
        losses[chosen] = found.rms("after") ** 2 - found.rms("floor") ** 2 if criterion == "task" else volume
    assert losses[plan.chosen] == pytest.approx(min(losses.values()), rel=1e-6)
    value, bound = (plan.value, plan.bound) if criterion == "task" else (-plan.value, -plan.bound)
    assert value == pytest.approx(losses[plan.chosen], rel=1e-5)
    # no choice passes the bound
    assert min(losses.values()) > bound
    assert 0 < plan.random_efficiency <= plan.efficiency <= 1


@pytest.mark.slow
def test_plan_and_forecast_agree_and_a_seed_gives_one_plan():
    model, q, measurement = plain_model(), random_poses(4, 14), SET_UPS[0]
    one, other = (pp.plan_calibration(model, q, 5, measurement, at=["work"], seed=3) for _ in range(2))
    assert one.to_json() == other.to_json()
    found = pp.forecast_calibration(model, one.q, measurement, at=["work"])
    assert found.rms("after") == pytest.approx(one.rms("after"), rel=1e-9)
    assert found.observability == pytest.approx(one.observability, rel=1e-6)
    assert one.efficiency > 0.9


@pytest.mark.slow
def test_forty_of_a_hundred_poses_in_time_and_certified():
    """All geometric errors of the paper's arm by points: D-efficiency of 0.99, in less than 10 s of the processor."""
    began = time.process_time()
    measurement = pp.Measurement(target=OFF_AXIS)
    model = pp.every_frame(paper_model().chain)
    plan = pp.plan_calibration(model, random_poses(4, 100), 40, measurement, criterion="D")
    assert plan.efficiency >= 0.99
    assert time.process_time() - began < 10


def test_weights_within_limits_by_general_solvers():
    """The closest weights are those shifted by one number and cut; the least sum of slopes is that of a linear programme."""
    generator = np.random.default_rng(0)
    for _ in range(40):
        count = int(generator.integers(2, 30))
        settled = generator.random(count)
        low, high = (settled < 0.1).astype(float), (settled < 0.9).astype(float)
        total = int(generator.integers(low.sum(), high.sum() + 1))
        wanted = generator.normal(size=count) * generator.choice([0.1, 1, 10])
        shift = optimize.brentq(lambda m: np.clip(wanted + m, low, high).sum() - total, -99, 99, xtol=1e-13)  # noqa: B023
        np.testing.assert_allclose(_project(wanted, total, low, high), np.clip(wanted + shift, low, high), atol=1e-9)
        slopes = generator.normal(size=count)
        best = optimize.linprog(slopes, A_eq=np.ones((1, count)), b_eq=[total], bounds=np.column_stack([low, high]))
        assert slopes @ _cheapest_weights(slopes, total, low, high) == pytest.approx(best.fun, abs=1e-9)


@pytest.mark.parametrize("criterion", ["D", "task"])
def test_one_pose_more_or_less_by_the_loss_itself(criterion):
    generator = np.random.default_rng(1)
    by_z, by_nuisance = generator.normal(size=(9, 3, 5)), generator.normal(size=(9, 3, 2))
    goal = np.diag([1.0, 2.0, 3.0, 0.0, 1.0])
    design = Design.of(by_z, by_nuisance, goal if criterion == "task" else None)
    chosen = np.arange(4)
    here, information = design.loss(design.information(chosen)), design.information(chosen)
    more, less = (design._changes_by_one(information, sign) for sign in (1.0, -1.0))
    for k in range(4, 9):
        assert more[k] == pytest.approx(design.loss(design.information(np.append(chosen, k))) - here, rel=1e-6)
    for k in range(4):
        assert less[k] == pytest.approx(design.loss(design.information(np.delete(chosen, k))) - here, rel=1e-6)


def test_all_candidates_are_chosen_where_all_are_asked_for():
    q = random_poses(4, 5)
    plan = pp.plan_calibration(plain_model(), q, 5, SET_UPS[0])
    assert (plan.chosen, plan.efficiency) == ((0, 1, 2, 3, 4), pytest.approx(1.0, abs=1e-9))
    assert "W_PLAN" not in {finding.code for finding in plan.findings}
    nothing, twice = pp.ErrorModel(paper_model().chain, pp.Space(), ()), np.hstack([q, q[:, 1:2]])
    check_refused(
        ("from 1 to 5, the number of candidates", pp.plan_calibration, plain_model(), q, 6, SET_UPS[0]),
        ("candidates 2 and 6 are one pose", pp.plan_calibration, plain_model(), twice, 3, SET_UPS[0]),
        ("nothing varies from robot to robot", pp.forecast_calibration, nothing, q, pp.Measurement()),
    )


def of_reading(law, reading, std):
    """Return the interval that one reading ± std of the number itself leaves, 90 %."""
    before, mean = float(law.covariance[0, 0]), float(law.mean_vector[0])
    after = 1 / (1 / before + 1 / std**2)
    estimate = after * (mean / before + reading / std**2)
    return interval_after(law, 0, estimate, before**0.5, after / before, 0.9)


@pytest.mark.parametrize(("reading", "std"), [(2.2, 0.5), (3.5, 0.3), (9.0, 0.2), (1.0, 1e-4), (2.0, 100.0)])
def test_a_uniform_number_has_a_truncated_normal_law(reading, std):
    law = pp.Uniform(1.0, mean=2.0)
    expected = stats.truncnorm((1 - reading) / std, (3 - reading) / std, reading, std).ppf([0.05, 0.95])
    assert of_reading(law, reading, std) == pytest.approx(expected, abs=1e-3 * min(std, 1.0))


def test_a_reading_of_a_lognormal_number_by_quadrature():
    law, reading, std = pp.Lognormal(1.2, mean=2.0), 2.6, 0.7
    variance = np.log(1 + 1.2**2 / 2.0**2)
    own = stats.lognorm(variance**0.5, scale=2.0 * np.exp(-variance / 2))
    x = np.linspace(1e-6, 30, 200_001)
    within = np.cumsum(own.pdf(x) * np.exp(-((x - reading) ** 2) / (2 * std**2)))
    expected = np.interp([0.05, 0.95], within / within[-1], x)
    assert of_reading(law, reading, std) == pytest.approx(expected, rel=1e-3)


def test_of_two_values_the_likely_ones_are_left():
    """Odds exp(-(1.5-1)²/2 s²) to exp(-(1.5+1)²/2 s²): with s = 2 the lower value keeps a third, with s = 0.5 nothing."""
    law = pp.TwoPoint(1.0)
    assert of_reading(law, 1.5, 2.0) == pytest.approx((-1, 1), abs=3e-3)
    assert of_reading(law, 1.5, 0.5) == pytest.approx((1, 1), abs=3e-3)
    assert of_reading(law, 0.4, 1e-3) == pytest.approx((1, 1), abs=3e-3)
    # of a number that no reading shows the law is left
    left = interval_after(pp.Triangular(1.0), 0, 0.0, 6**-0.5, 1.0, 0.5)
    assert left == pytest.approx(stats.triang(0.5, -1, 2).ppf([0.25, 0.75]), abs=1e-3)


def test_observability_indices_by_hand():
    found = observability(np.array([4.0, 2.0, 1.0]), 4)
    assert found == pytest.approx({"O1": 1.0, "O2": 0.25, "O3": 1.0, "O4": 0.25, "O5": 1 / 1.75})
