"""Arrays handed in may be changed afterwards, and arrays handed out written into, without changing any result."""

import inspect
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import precision_pin as pp
from api.api_calls import POSE, model
from precision_pin import PrecisionPinError, Source
from precision_pin.base import se3
from precision_pin.robot.places import Load, Place
from precision_pin.terms.term import JointValue, Term

ARM = model()
CHAIN = ARM.chain


@dataclass(frozen=True)
class Table(Source):
    """A source with an array and a list among its settings."""

    shifts: Any
    turns: Any

    @property
    def subject(self):
        return "tool"

    def terms(self, posture, space):
        del space
        yield Term(posture.chain.end(4), np.array([*self.shifts, *self.turns]), ())


def quantities(rng):
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


def spoil(value):
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
def test_what_is_handed_in_may_be_changed_afterwards(name):
    make, arrays = quantities(np.random.default_rng(0))[name]
    _, same = quantities(np.random.default_rng(0))[name]
    made, kept = make(*arrays), make(*same)
    for array in arrays:
        spoil(array)
    # an iterator of models goes on only now
    made, kept = (tuple(one) if isinstance(one, Iterator) else one for one in (made, kept))
    assert repr(made) == repr(kept)
    assert bytes_of(made) == bytes_of(kept)


RESULTS = {
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
    "stiffness": lambda: pp.stiffness(ARM, POSE, rated=100.0, goal=1e-6, robots=100),
    "reliability": lambda: pp.reliability(ARM, "200 mm @ 99 %", POSE, samples=1000),
}


@pytest.mark.fast(3)
@pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")
@pytest.mark.parametrize("name", RESULTS)
def test_results_cannot_be_changed_by_writing_into_their_arrays(name):
    assert changed_by_writing(RESULTS[name]()) == []


def test_the_walk_finds_arrays_and_sees_changes():
    class Open:
        __module__ = "precision_pin.nowhere"

        def __init__(self):
            self.kept = np.zeros(2)
            self.parts = (np.ones(1), {"deep": np.ones(3)})

        @property
        def made(self):
            return np.zeros(3)

    assert {name for name, _ in arrays_of(Open())} == {".kept", ".parts[0]", ".parts[1]['deep']", ".made"}
    assert changed_by_writing(Open()) == [".parts[1]['deep']", ".parts[0]", ".kept"]


DEEPEST = 7


def arrays_of(root):
    """Yield the name of each array and what gets it anew from the root, as a user would."""
    seen = set()
    kept = []
    waiting = [("", lambda: root, 0)]
    while waiting:
        name, get, depth = waiting.pop()
        value = get()
        if isinstance(value, np.ndarray):
            yield name, get
            continue
        if id(value) in seen or depth > DEEPEST:
            continue
        seen.add(id(value))
        kept.append(value)  # or its id would be given to another
        waiting += [(f"{name}{part}", inner, depth + 1) for part, inner in _parts(value, get)]


def _parts(value, get):
    if isinstance(value, tuple | list):
        for k in range(min(len(value), 4)):
            yield f"[{k}]", lambda k=k: get()[k]
    elif isinstance(value, Mapping):
        for key in list(value)[:4]:
            yield f"[{key!r}]", lambda key=key: get()[key]
    elif type(value).__module__.startswith("precision_pin."):
        for name in _attributes(value):
            try:
                getattr(value, name)
            except PrecisionPinError:
                continue
            yield f".{name}", lambda name=name: getattr(get(), name)


def _attributes(value):
    kind = type(value)
    found = set(vars(value)) if hasattr(value, "__dict__") else set()
    for name in dir(kind):
        attribute = inspect.getattr_static(kind, name)
        if isinstance(attribute, property) or type(attribute).__name__ == "cached_property":
            found.add(name)
    return sorted(name for name in found if not name.startswith("_"))


def changed_by_writing(root):
    """Return the arrays of a result into which a user can write so that the result itself changes."""
    found = []
    for name, get in arrays_of(root):
        array = get()
        if not array.flags.writeable or not array.size or array.dtype.kind not in "iufb":
            continue
        before = array.copy()
        array.flat[0] = not array.flat[0] if array.dtype.kind == "b" else array.flat[0] + 1
        if not np.array_equal(get(), before, equal_nan=array.dtype.kind == "f"):
            found.append(name)
            array.flat[0] = before.flat[0]
    return found


def bytes_of(root):
    """Return the bytes of every array of a result by its name."""
    return {name: get().tobytes() for name, get in arrays_of(root)}
