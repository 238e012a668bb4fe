"""Arrays handed in may be changed afterwards, and arrays handed out written into, without changing any result."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, final

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import precision_pin as pp
from api.api_calls import POSE, model
from api.array_walk import arrays_of, bytes_of, changed_by_writing
from precision_pin.base import se3
from precision_pin.robot.loads import Load
from precision_pin.robot.places import Place
from precision_pin.terms.source import Source
from precision_pin.terms.term import JointValue, Term

ARM = model()
CHAIN = ARM.chain


@final
@dataclass(frozen=True)
class Table(Source):
    """A source with an array and a list among its settings."""

    shifts: Any
    turns: Any

    @property
    def subject(self) -> str:
        return "tool"

    def terms(self, posture: Any, space: Any) -> Iterator[Term]:
        del space
        yield Term(posture.chain.end(4), np.array([*self.shifts, *self.turns]), ())


def quantities(rng: np.random.Generator) -> dict[str, tuple[Callable[..., Any], list[Any]]]:
    """Return what is made of arrays: its name, how, and of which."""
    square = rng.normal(size=(3, 3))
    return {
        "Chain.at": (CHAIN.at, [rng.normal(size=4)]),
        "Chain.at_many": (CHAIN.at_many, [rng.normal(size=(4, 3))]),
        "Chain.at_many by name": (
            lambda *rows: CHAIN.at_many(dict(zip(CHAIN.joint_names, rows, strict=True))),
            list(rng.normal(size=(4, 3))),
        ),
        "Chain.configuration": (CHAIN.configuration, [rng.normal(size=4)]),
        "Chain.from_urdf": (lambda g: pp.Chain.from_urdf(CHAIN.robot.file, CHAIN.tip, gravity=g), [rng.normal(size=3)]),
        "Chain.with_payload": (lambda c: CHAIN.with_payload(1.0, c).at(POSE), [rng.normal(size=3)]),
        "ErrorModel.at": (ARM.at, [rng.normal(size=4)]),
        "ErrorModel.at_many": (lambda q: ARM.at_many(q), [rng.normal(size=(4, 2))]),
        "ErrorModel poses": (lambda q: pp.ErrorModel(CHAIN, ARM.space, ARM.sources, {"home": q}), [rng.normal(size=4)]),
        "ErrorModel sources": (
            lambda a, b: pp.ErrorModel(CHAIN, pp.Space(), [Table(a, b)]),
            [rng.normal(size=3) * 1e-3, [1e-3, 0.0, 0.0]],
        ),
        "JointNormal": (lambda m, c: pp.JointNormal(m, c), [square @ square.T, rng.normal(size=3)]),
        "Rows": (pp.Rows, [rng.normal(size=(5, 2))]),
        "Rows of lists": (pp.Rows, [rng.normal(size=(5, 2)).tolist(), ["a", "b"]]),
        "Empirical": (pp.Empirical, [np.column_stack([np.linspace(0, 1, 5), np.sort(rng.normal(size=5))])]),
        "Empirical.from_samples": (pp.Empirical.from_samples, [rng.normal(size=6)]),
        "Uniform": (pp.Uniform, [np.array(1.0), np.array(2.0)]),
        "Correlation": (pp.Correlation, [["a", "b"], np.array([[1.0, 0.5], [0.5, 1.0]])]),
        "Space": (pp.Space, [[pp.Draw("a", pp.Uniform(1.0)), pp.Draw("b", pp.Uniform(1.0))]]),
        "Term": (lambda twist: pp.Term(JointValue(0), twist), [rng.normal(size=1)]),
        "Term.of": (lambda twist: pp.Term.of(JointValue(0), twist), [rng.normal(size=1)]),
        "Place": (lambda frame: Place.custom(0, 0, "here", frame), [np.eye(4)]),
        "Load": (lambda f, p, m: Load(0, f, p, False, ((m, ()),)), [np.eye(4), rng.normal(size=3), rng.normal(size=4)]),
        "Mcpc.perturbed": (pp.mcpc.from_chain(CHAIN).perturbed, [rng.normal(size=26) * 1e-3]),
        "PosesResult": (lambda q: pp.sample_poses(ARM, q, samples=64), [rng.normal(size=(4, 2))]),
        "se3.compose": (se3.compose, [np.eye(4)]),
    }


def spoil(value: Any) -> None:
    """Change an array or a list that was handed in."""
    if isinstance(value, np.ndarray):
        value += 1.0
    else:
        value[:] = list(reversed(value))
        value.pop()


NAMES = sorted(quantities(np.random.default_rng(0)))


@pytest.mark.fast(6)
@pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")
@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_what_is_handed_in_may_be_changed_afterwards(name: str, seed: int) -> None:
    make, arrays = quantities(np.random.default_rng(seed))[name]
    _, same = quantities(np.random.default_rng(seed))[name]
    made, kept = make(*arrays), make(*same)
    for array in arrays:
        spoil(array)
    # an iterator of models goes on only now
    made, kept = (tuple(one) if isinstance(one, Iterator) else one for one in (made, kept))
    assert repr(made) == repr(kept)
    assert bytes_of(made) == bytes_of(kept)


RESULTS: dict[str, Callable[[], Any]] = {
    "Chain": lambda: CHAIN,
    "Posture": lambda: CHAIN.at(POSE),
    "Postures": lambda: CHAIN.at_many(np.zeros((4, 3))),
    "ErrorModel": lambda: ARM,
    "PoseModel": lambda: ARM.at(POSE),
    "PoseModel at equilibrium": lambda: pp.ErrorModel(CHAIN, ARM.space, ARM.sources, statics="equilibrium").at(POSE),
    "Space": lambda: ARM.space,
    "laws": lambda: (
        pp.JointNormal(((1.0, 0.5), (0.5, 1.0))),
        pp.Rows(((1.0, 2.0), (2.0, 3.0))),
        pp.Empirical(((0.0, 1.0), (1.0, 2.0))),
        pp.Correlation.pair("a", "b", 0.5),
    ),
    "Mcpc": lambda: pp.mcpc.from_chain(CHAIN),
    "monte_carlo": lambda: pp.monte_carlo(ARM, POSE, samples=1000, keep_samples=True, specifications="9 mm"),
    "sample_poses": lambda: pp.sample_poses(ARM, [POSE, POSE], samples=64, specifications="9 mm"),
    "moments": lambda: pp.moments(ARM, POSE, samples=1024),
    "closed moments": lambda: pp.moments(ARM, POSE, method="closed", samples=1024),
    "budget": lambda: pp.budget(ARM, POSE, samples=1024),
    "exact_law": lambda: pp.exact_law(ARM, POSE, samples=1000),
    "worst_case": lambda: pp.worst_case(ARM, POSE, samples=1000),
    "reliability": lambda: pp.reliability(ARM, "200 mm @ 99 %", POSE, samples=1000),
}


@pytest.mark.fast(3)
@pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")
@pytest.mark.parametrize("name", RESULTS)
def test_results_cannot_be_changed_by_writing_into_their_arrays(name: str) -> None:
    assert changed_by_writing(RESULTS[name]()) == []


def test_the_walk_finds_arrays_and_sees_changes() -> None:
    class Open:
        __module__ = "precision_pin.nowhere"

        def __init__(self) -> None:
            self.kept = np.zeros(2)
            self.parts = (np.ones(1), {"deep": np.ones(3)})

        @property
        def made(self) -> Any:
            return np.zeros(3)

    assert {name for name, _ in arrays_of(Open())} == {".kept", ".parts[0]", ".parts[1]['deep']", ".made"}
    assert changed_by_writing(Open()) == [".parts[1]['deep']", ".parts[0]", ".kept"]
