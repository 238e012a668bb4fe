"""Answers and bounds of an allocation against every choice of grades, judged by closed forms and plain numpy alone."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy import integrate, special

import precision_pin as pp

REQUIRED = 0.95
JOINTS = {"joint1": "0 0 1", "joint2": "0 1 0", "joint3": "1 0 0"}
URDF = (
    '<robot name="ball"><link name="base"/><link name="one"/><link name="two"/><link name="tip"/>'
    + "".join(
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>'
        '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        for (name, axis), parent, child in zip(
            JOINTS.items(), ("base", "one", "two"), ("one", "two", "tip"), strict=True
        )
    )
    + "</robot>"
)


def turned(angles: np.ndarray, joint: int) -> np.ndarray:
    """Return the axes of a joint's frame after it has turned, as columns."""
    turn = np.eye(3)
    for axis, angle in zip(np.array([[0, 0, 1], [0, 1, 0], [1, 0, 0]])[: joint + 1], angles, strict=False):
        cross = np.cross(np.eye(3), axis)
        turn = turn @ (np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)
    return turn


def normal_norm(mean: np.ndarray, covariance: np.ndarray, radius: float) -> float:
    """Return P(|v| ≤ r) by Imhof's integral (Biometrika 48, 419, 1961)."""
    variances, axes = np.linalg.eigh(covariance)
    squares = (axes.T @ mean) ** 2
    scale = variances.max()
    lam, shift, x = variances / scale, squares / scale, radius**2 / scale

    def integrand(u: float) -> float:
        size = 1 + (lam * u) ** 2
        angle = 0.5 * (np.arctan(lam * u) + shift * u / size).sum() - 0.5 * x * u
        return math.sin(angle) / (u * (size**0.25).prod() * math.exp(0.5 * (shift * lam * u**2 / size).sum()))

    return 0.5 - integrate.quad(integrand, 0, 400, limit=2000)[0] / math.pi


def uniform_sum(half: np.ndarray, limit: float) -> float:
    """Return P(|Σ ±half| ≤ limit) of independent uniform numbers, by the volume of a cut cube."""
    half = half[half > 1e-3 * half.max()]

    def below(s: float) -> float:
        signs = np.array(list(itertools.product((-1, 1), repeat=half.size)))
        volume = (signs.prod(axis=1) * np.maximum(s + signs @ half, 0) ** half.size).sum()
        return float(volume / (2**half.size * math.factorial(half.size) * half.prod()))

    return below(limit) - below(-limit)


@dataclass
class Case:
    """A problem and, by independent code, how far a choice keeps it: at least 0 if it does."""

    model: pp.ErrorModel
    problem: dict[str, object]
    costs: list[list[tuple[float, float]]]
    kept: Callable[[np.ndarray], bool]

    def least(self) -> float:
        """Return the cost of the cheapest choice that keeps the limits, infinite if none does."""
        for choice in sorted(itertools.product(*self.costs), key=lambda one: sum(price for _, price in one)):
            if self.kept(np.array([width for width, _ in choice])):
                return sum(price for _, price in choice)
        return math.inf


def random_case(folder: Path, seed: int) -> Case:
    """Return a problem with 3 to 5 tolerances in 3 or 4 grades each, 1 to 3 poses and one of six kinds of limit."""
    rng = np.random.default_rng(seed)
    kind = ("norm", "x", "uniform x", "rms", "worst_case", "norm and rms")[seed % 6]
    law = "uniform" if kind == "uniform x" else "normal"
    count, poses = int(rng.integers(3, 6)), int(rng.integers(1, 4))
    angles = rng.uniform(-2, 2, (poses, 3))
    places = [
        (int(k % 3), int(axis)) for k, axis in zip(rng.permutation(count), rng.integers(0, 3, count), strict=True)
    ]
    ways = np.array([[turned(q, joint)[:, axis] for joint, axis in places] for q in angles])
    mean = float(rng.choice([0.0, 0.05])) if law == "normal" else 0.0
    (folder / "ball.urdf").write_text(URDF, encoding="utf-8")
    model = pp.ErrorModel.from_dict(
        {
            "precision-pin": 1,
            "robot": "ball.urdf",
            "poses": {f"p{k}": " ".join(f"{a!r}" for a in q) + " rad" for k, q in enumerate(angles.tolist())},
            "parameters": {
                f"a{k}": {law: "0.1 mm", **({"mean": f"{mean} mm"} if k == 0 else {})} for k in range(count)
            },
            "sources": [
                {"length": {"frame": "tip", "along": f"{'xyz'[axis]} of joint{joint + 1}", "parameters": [f"a{k}"]}}
                for k, (joint, axis) in enumerate(places)
            ],
        },
        folder,
    )
    costs = []
    for _ in range(count):
        widths = np.round(np.sort(rng.uniform(0.03, 0.6, int(rng.integers(3, 5)))), 4)
        prices = np.round(rng.uniform(0.5, 2) * widths ** -rng.uniform(0.5, 1.5), 3)
        costs.append(list(zip(widths.tolist(), prices.tolist(), strict=True)))
    middle = np.array([own[1][0] for own in costs])
    still = mean * ways[:, 0]

    def rms(t: np.ndarray) -> float:
        return float(np.sqrt((still**2).sum(axis=1) + (t**2).sum() / (9 if law == "normal" else 3)).max())

    def worst(t: np.ndarray) -> float:
        return float((np.abs(still) + np.einsum("pni,n->pi", np.abs(ways), t)).max())

    def share(t: np.ndarray, limit: float) -> float:
        found = []
        for way, shift in zip(ways, still, strict=True):
            if kind == "uniform x":
                found.append(uniform_sum(np.abs(way[:, 0]) * t, limit))
            elif kind == "x":
                deviation = np.sqrt(((way[:, 0] * t) ** 2).sum()) / 3
                found.append(
                    special.ndtr((limit - shift[0]) / deviation) - special.ndtr((-limit - shift[0]) / deviation)
                )
            else:
                found.append(normal_norm(shift, np.einsum("ni,nj,n->ij", way, way, t**2) / 9, limit))
        return min(found)

    wide = float(rng.uniform(0.9, 1.3))
    specs: list[object] = []
    tests: list[Callable[[np.ndarray], bool]] = []
    if kind in ("norm", "norm and rms"):
        limit = round(2.0 * rms(middle) * wide, 4)
        specs.append(f"{limit} mm @ 95 %")
        tests.append(lambda t: share(t, limit) >= REQUIRED)
    if kind in ("x", "uniform x"):
        component = round(1.3 * rms(middle) * wide, 4)
        specs.append(f"x {component} mm @ 95 %")
        tests.append(lambda t: share(t, component) >= REQUIRED)
    if "rms" in kind:
        root = round(1.1 * rms(middle) * wide, 4)
        specs.append({"rms": f"{root} mm"})
        tests.append(lambda t: rms(t) <= root * (1 + 1e-12))
    if kind == "worst_case":
        largest = round(worst(middle) * wide, 4)
        specs.append({"worst_case": f"{largest} mm"})
        tests.append(lambda t: worst(t) <= largest * (1 + 1e-12))
    entries = [
        {"path": f"parameters.a{k}.{law}", "cost": {"grades": [[f"{width} mm", price] for width, price in own]}}
        for k, own in enumerate(costs)
    ]
    return Case(model, {"tolerances": entries, "specs": specs}, costs, lambda t: all(test(t) for test in tests))


def check(folder: Path, seed: int) -> str:
    """Return what is wrong with the answer to a problem, or nothing."""
    case = random_case(folder, seed)
    least = case.least()
    result = pp.allocate(case.model, case.problem)
    if not result.feasible:
        return "" if math.isinf(least) else f"{seed}: infeasible, but {least} keeps it"
    if result.lower_bound is None or result.lower_bound > least * (1 + 1e-9):
        return f"{seed}: bound {result.lower_bound} above {least}"
    if result.met and not case.kept(1e3 * result.after):
        return f"{seed}: met, but it is not kept"
    if result.met and result.cost * (1 - (result.gap or 0)) > least * (1 + 1e-9):
        return f"{seed}: cost {result.cost} with gap {result.gap}, least {least}"
    if result.cost != pytest.approx(least, rel=1e-9):
        return f"({seed}: cost {result.cost}, bound {result.lower_bound}, least {least}, met {result.met})"
    return ""


def test_the_cheapest_choice_and_its_bound_are_those_of_enumeration(tmp_path: Path) -> None:
    assert [found for seed in range(6) if (found := check(tmp_path, seed)) and not found.startswith("(")] == []
