"""Answers and bounds of an allocation against every choice of grades, judged by closed forms and plain numpy alone."""

import itertools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from scipy import integrate, optimize, special
from scipy.spatial.transform import Rotation

import precision_pin as pp
from analyses.test_exact_law import normal_norm, uniform_sum
from precision_pin.analyses.allocation.table import allocation_table
from support.plain_robot import joint, link, robot

REQUIRED = 0.95


LINKS = ("base", "one", "two", "tip")
AXES = ((0, 0, 1), (0, 1, 0), (1, 0, 0))
TURNS = [joint(f"joint{k + 1}", "revolute", LINKS[k], LINKS[k + 1], axis=axis) for k, axis in enumerate(AXES)]
URDF = robot(*map(link, LINKS), *TURNS)


def model_of(folder, parameters, sources, **more):
    """Return a model of an arm whose joints meet in a point; at home its axes are those of the base."""
    (folder / "ball.urdf").write_text(URDF, encoding="utf-8")
    given = {"precision-pin": 1, "robot": "ball.urdf", "poses": {"home": "0 0 0 deg"}, "parameters": parameters}
    lengths = [{"length": {"frame": "tip", **one}} for one in sources]
    return pp.ErrorModel.from_dict({**given, "sources": lengths, **more}, folder)


def turned(angles, joint):
    """Return the axes of a joint's frame after it has turned, as columns."""
    return Rotation.from_euler("ZYX"[: joint + 1], angles[: joint + 1]).as_matrix()


class Case(NamedTuple):
    """A problem and, by independent code, how far a choice keeps it: at least 0 if it does."""

    model: pp.ErrorModel
    problem: dict[str, object]
    costs: list[list[tuple[float, float]]]
    kept: Callable[[np.ndarray], bool]

    def least(self):
        """Return the cost of the cheapest choice that keeps the limits, infinite if none does."""
        for choice in sorted(itertools.product(*self.costs), key=lambda one: sum(price for _, price in one)):
            if self.kept(np.array([width for width, _ in choice])):
                return sum(price for _, price in choice)
        return math.inf


def random_case(folder, seed):
    """Return a problem with 3 to 5 tolerances in 3 or 4 grades each, 1 to 3 poses and one of six kinds of limit."""
    rng = np.random.default_rng(seed)
    kind = ("norm", "x", "uniform x", "rms", "worst_case", "norm and rms")[seed % 6]
    law = "uniform" if kind == "uniform x" else "normal"
    count, poses = int(rng.integers(3, 6)), int(rng.integers(1, 4))
    angles = rng.uniform(-2, 2, (poses, 3))
    axes = rng.permutation(count) % 3, rng.integers(0, 3, count)
    places = list(zip(*(one.tolist() for one in axes), strict=True))
    ways = np.array([[turned(q, joint)[:, axis] for joint, axis in places] for q in angles])
    mean = float(rng.choice([0.0, 0.05])) if law == "normal" else 0.0
    model = model_of(
        folder,
        {f"a{k}": {law: "0.1 mm", **({"mean": f"{mean} mm"} if k == 0 else {})} for k in range(count)},
        [
            {"along": f"{'xyz'[axis]} of joint{joint + 1}", "parameters": [f"a{k}"]}
            for k, (joint, axis) in enumerate(places)
        ],
        poses={f"p{k}": " ".join(f"{a!r}" for a in q) + " rad" for k, q in enumerate(angles.tolist())},
    )
    costs = []
    for _ in range(count):
        widths = np.sort(rng.choice(np.arange(300, 6000), int(rng.integers(3, 5)), replace=False)) / 1e4
        prices = np.round(rng.uniform(0.5, 2) * widths ** -rng.uniform(0.5, 1.5), 3)
        costs.append(list(zip(widths.tolist(), prices.tolist(), strict=True)))
    middle = np.array([own[1][0] for own in costs])
    still = mean * ways[:, 0]

    def rms(t):
        return float(np.sqrt((still**2).sum(axis=1) + (t**2).sum() / (9 if law == "normal" else 3)).max())

    def worst(t):
        return float((np.abs(still) + np.einsum("pni,n->pi", np.abs(ways), t)).max())

    def share(t, limit):
        found = []
        for way, shift in zip(ways, still, strict=True):
            if kind == "uniform x":
                half = np.abs(way[:, 0]) * t
                found.append(uniform_sum(half, limit, float) - uniform_sum(half, -limit, float))
            elif kind == "x":
                found.append(within(limit, shift[0], np.sqrt(((way[:, 0] * t) ** 2).sum()) / 3))
            else:
                found.append(normal_norm(shift, np.einsum("ni,nj,n->ij", way, way, t**2) / 9, limit))
        return min(found)

    wide = float(rng.uniform(0.9, 1.3))
    specs = []
    tests = []
    if kind in ("norm", "norm and rms", "x", "uniform x"):
        limit = round((2.0 if "norm" in kind else 1.3) * rms(middle) * wide, 4)
        specs.append(f"{'' if 'norm' in kind else 'x '}{limit} mm @ 95 %")
        tests.append(lambda t: share(t, limit) >= REQUIRED)
    for bound, measure, factor in (("rms", rms, 1.1), ("worst_case", worst, 1.0)):
        if bound in kind:
            most = round(factor * measure(middle) * wide, 4)
            specs.append({bound: f"{most} mm"})
            tests.append(lambda t, measure=measure, most=most: measure(t) <= most * (1 + 1e-12))
    grades = [[[f"{width} mm", price] for width, price in own] for own in costs]
    entries = [{"path": f"parameters.a{k}.{law}", "cost": {"grades": own}} for k, own in enumerate(grades)]
    return Case(model, {"tolerances": entries, "specs": specs}, costs, lambda t: all(test(t) for test in tests))


def within(limit, shift, deviation):
    """Return P(|n| ≤ limit) of a normal number."""
    return float(special.ndtr((limit - shift) / deviation) - special.ndtr((-limit - shift) / deviation))


@pytest.mark.fast(2)
@pytest.mark.parametrize("seed", [1, 2, 3, 22, 6, 11])
def test_the_cheapest_choice_and_its_bound_are_those_of_enumeration(tmp_path, seed):
    case = random_case(tmp_path, seed)
    least, result = case.least(), pp.allocate(case.model, case.problem)
    if not result.feasible:
        assert math.isinf(least)
        return
    assert result.lower_bound <= least * (1 + 1e-9)
    if result.met:
        assert case.kept(1e3 * result.after)
        assert result.cost * (1 - (result.gap or 0)) <= least * (1 + 1e-9)
    # of a norm, seeds 6 and 11, a choice that keeps the limit by less than the samples show may be missed
    assert seed in (6, 11) or result.cost == pytest.approx(least, rel=1e-9)


@pytest.mark.slow
def test_a_choice_that_is_cut_short_is_the_best_so_far_with_its_gap(tmp_path):
    case = random_case(tmp_path, 11)
    found, least = pp.allocate(case.model, case.problem, seconds=1e-9), case.least()
    assert case.kept(1e3 * found.after)
    assert found.lower_bound <= least <= found.cost < 1.2 * least
    assert found.gap > 0.01


OTHERS = {
    "rare": {"two_point": "0.5 mm", "probability": 0.01, "centre": "0.5 mm"},
    "lognormal": {"lognormal": {"std": "0.1 mm"}, "mean": "0.1 mm"},
    "two-point": {"two_point": "0.15 mm"},
}


LIMIT = 0.3


def along_x(folder, others):
    """Return a model of one component: a normal number a, to be chosen, and others."""
    laws = {"a": {"normal": "0.2 mm"}, **others}
    return model_of(folder, laws, [{"along": "x of joint1", "parameters": list(laws)}])


def share_within(other, deviation):
    """Return P(|n + o| ≤ 0.3 mm) of a normal n and one of the other laws, closed form or quadrature, mm."""
    if other == "rare":
        return 0.99 * within(LIMIT, 0.0, deviation) + 0.01 * within(LIMIT, 1.0, deviation)
    if other == "two-point":
        return 0.5 * within(LIMIT, 0.15, deviation) + 0.5 * within(LIMIT, -0.15, deviation)
    spread = math.sqrt(math.log(2))
    middle = math.log(0.1) - spread**2 / 2

    def integrand(score):
        shift = math.exp(middle + spread * score)
        return within(LIMIT, shift, deviation) * math.exp(-(score**2) / 2) / math.sqrt(2 * math.pi)

    return integrate.quad(integrand, -9, 9, limit=400)[0]


@pytest.mark.fast(2)
@pytest.mark.parametrize(
    ("other", "required", "graded"),
    [
        *[("rare", 0.985, True), ("two-point", 0.995, True), ("lognormal", 0.95, True)],
        *[("rare", 0.95, False), ("rare", 0.985, False), ("two-point", 0.995, False)],
    ],
)
def test_met_is_what_holds_where_the_other_law_is_far_from_normal(tmp_path, other, required, graded):
    """The normal law that an allocation starts from is wrong by percents here; what it says is not."""
    model = along_x(tmp_path, {"o": OTHERS[other]})
    grades = [(0.03 * 1.25**k, 0.1 / (0.03 * 1.25**k)) for k in range(15)]
    cost = {"grades": [[f"{width} mm", price] for width, price in grades]} if graded else {"reciprocal": "0.1 mm"}
    chosen = {"path": "parameters.a", "cost": cost, "min": "0.02 mm", "max": "1 mm"}
    problem = {"tolerances": [chosen], "specs": [f"x {LIMIT} mm @ {100 * required} %"]}
    # without a margin, which passes over a choice that keeps the limit by less
    result = pp.allocate(model, problem, for_samples=0)
    assert result.met <= (share_within(other, 1e3 * float(result.after[0]) / 3) >= required)
    kept = [price for width, price in grades if share_within(other, width / 3) >= required]
    text = allocation_table(result)
    if graded:
        assert result.feasible == bool(kept)
        assert not kept or result.lower_bound <= min(kept) * (1 + 1e-9)
        assert not kept or result.cost == pytest.approx(min(kept))
        assert ("every cheaper choice of grades fails by the samples" in text) == bool(kept)
        assert ("no allocation can meet" in text) == (not kept)
    elif share_within(other, 0.02 / 3) < required:
        assert not result.met
        assert "no allocation was found that meets" in text or "NOT " in text
    else:
        widest = max(width for width in np.geomspace(0.02, 1, 200) if share_within(other, width / 3) >= required)
        assert result.met
        assert result.cost <= 1.6 * 0.1 / widest


@pytest.mark.parametrize("graded", [True, False])
def test_what_a_wider_tolerance_keeps_is_not_said_to_be_impossible(tmp_path, graded):
    """A rare value just beyond the limit, which a wider normal number brings back in half of the robots."""
    near = {"two_point": "0.15015 mm", "centre": "0.15015 mm", "probability": 0.01}
    far = {"two_point": "3 mm", "centre": "-3 mm", "probability": 0.995}
    model = along_x(tmp_path, {"near": near, "far": far})
    required = 0.988

    def share(width):
        return 0.995 * (0.99 * within(LIMIT, 0.0, width / 3) + 0.01 * within(LIMIT, 0.3003, width / 3))

    assert share(0.001) < required - 0.001 < required + 0.001 < share(0.1)
    cost = {"grades": [["0.001 mm", 100], ["0.1 mm", 1]]} if graded else {"reciprocal": "0.1 mm"}
    chosen = {"path": "parameters.a", "cost": cost, "min": "0.001 mm", "max": "1 mm"}
    problem = {"tolerances": [chosen], "specs": [f"x {LIMIT} mm @ {100 * required} %", {"rms": "1 mm"}]}
    result = pp.allocate(model, problem, for_samples=0)
    assert result.feasible == graded
    text = allocation_table(result)
    assert "no allocation can meet" not in text
    assert graded or "no allocation was found that meets position.x 0.3 mm @ 98.8 %" in text
    # of a limit that is kept and one that only the samples show to fail, the second is named
    problem["specs"] = [f"x {LIMIT} mm @ 99.5 %", {"rms": "0.1005 mm"}]
    problem["tolerances"] = [{"path": "parameters.a", "cost": {"grades": [["0.001 mm", 100], ["0.002 mm", 1]]}}]
    said = allocation_table(pp.allocate(along_x(tmp_path, {"o": OTHERS["rare"]}), problem, for_samples=0))
    assert "no allocation can meet position.x 0.3 mm @ 99.5 %" in said


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_correlated_tolerances_cost_what_another_optimiser_finds(tmp_path, seed):
    """Two chosen lengths along one axis and a third that is not chosen, all correlated: σ² is a quadratic form of them."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3))
    scores = root @ root.T
    scores = np.round(scores / np.sqrt(np.outer(np.diag(scores), np.diag(scores))), 2)
    names = ["a", "b", "c"]
    laws, sources = {name: {"normal": "0.06 mm"} for name in names}, [{"along": "x of joint1", "parameters": names}]
    correlation = {"parameters": names, "matrix": scores.tolist()}
    model = model_of(tmp_path, laws, sources, correlations=[correlation])
    prices, limit, widths = rng.uniform(0.05, 0.2, 2), 0.06, [0.01, 0.03, 0.08, 0.2, 0.5]

    def allocated(cost):
        priced = zip(names, prices, strict=False)
        ends = {"min": "0.01 mm", "max": "0.5 mm"}
        chosen = [{"path": f"parameters.{name}", "cost": cost(price), **ends} for name, price in priced]
        return pp.allocate(model, {"tolerances": chosen, "rms": f"{limit} mm"})

    def variance(t):
        whole = np.append(t, 0.06)
        return float(whole @ scores @ whole) / 9

    def cost(t):
        return float((prices / t).sum())

    result = allocated(lambda price: {"reciprocal": f"{price} mm"})
    kept = {"type": "ineq", "fun": lambda t: 1e3 * (limit**2 - variance(t))}
    settings = {"method": "SLSQP", "options": {"ftol": 1e-14, "maxiter": 300}}
    starts = ([0.02, 0.02], [0.1, 0.1], [0.02, 0.3], [0.3, 0.02])
    found = [optimize.minimize(cost, start, bounds=[(0.01, 0.5)] * 2, constraints=kept, **settings) for start in starts]
    least = min(one.fun for one in found if variance(one.x) <= limit**2 * (1 + 1e-7))
    assert result.cost == pytest.approx(least, rel=1e-5)
    assert result.lower_bound <= result.cost <= result.lower_bound * (1 + 1e-5)
    # and in grades, where a wider one may make up for another
    graded = allocated(lambda price: {"grades": [[f"{width} mm", price / width] for width in widths]})
    costs = [cost(np.array(t)) for t in itertools.product(widths, repeat=2) if variance(np.array(t)) <= limit**2]
    assert graded.feasible == bool(costs)
    assert not costs or graded.cost == pytest.approx(min(costs))
