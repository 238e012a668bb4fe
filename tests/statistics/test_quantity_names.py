"""Names of quantities: the same words are accepted everywhere, and results use one name."""

from __future__ import annotations

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.analyses.budget.budget import check_quantities
from precision_pin.render.tables import symbol
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.statistics import QUANTITIES, Specification
from precision_pin.statistics.precision import target
from precision_pin.statistics.quantities import quantity_name

MODEL = pp.ErrorModel.load(PAPER_SHEET)
NAMES = {
    "position.norm": ("position", "|d|"),
    "position.x": ("x", "dx"),
    "position.y": ("y", "dy"),
    "position.z": ("z", "dz"),
    "attitude.norm": ("attitude", "|δ|"),
    "attitude.x": ("rx", "δx"),
    "attitude.y": ("ry", "δy"),
    "attitude.z": ("rz", "δz"),
}
"""Name of each quantity in results, and the other words that users may write."""
WORDS = [(word, name) for name, words in NAMES.items() for word in (name, *words)]


@pytest.fixture(scope="module")
def sampled() -> pp.MonteCarloResult:
    return pp.monte_carlo(MODEL, samples=200)


@pytest.mark.parametrize(("word", "name"), WORDS)
def test_every_word_is_known_everywhere(word: str, name: str, sampled: pp.MonteCarloResult) -> None:
    assert quantity_name(word) == name
    assert pp.specification(f"{word} 1 {'mm' if name.startswith('position') else 'mrad'}").quantity == name
    assert target(f"{word} mean to 1 %").quantity == name
    assert Specification(word, 1e-3, 0.9) == Specification(name, 1e-3, 0.9)
    assert sampled.summary.distribution(word) is sampled.summary.distribution(name)
    # in a budget, position and attitude are all three components together
    assert check_quantities([word]) == (word if word in ("position", "attitude") else name,)


def test_the_symbol_in_a_table_is_one_of_the_words() -> None:
    assert list(NAMES) == list(QUANTITIES)
    assert [quantity_name(symbol(name)) for name in QUANTITIES] == list(QUANTITIES)


@pytest.mark.parametrize("word", ["d", "norm", "position.w", "", "Z"])
def test_another_word_is_refused(word: str, sampled: pp.MonteCarloResult) -> None:
    for ask in (quantity_name, sampled.summary.distribution, lambda word: check_quantities([word])):
        with pytest.raises(pp.InputError, match="quantity"):
            ask(word)


@pytest.mark.slow
def test_where_unbounded_laws_are_cut_is_called_k() -> None:
    new, old = (pp.budget(MODEL, samples=1024, **{name: 4.0}) for name in ("k", "bound_at"))
    assert new.to_dict()["poses"] == old.to_dict()["poses"]
    for result in (new, old):
        assert (result.k, result.bound_at, result.to_dict()["k"], result.to_dict()["bound_at"]) == (4.0,) * 4
    usual = pp.budget(MODEL, samples=1024)
    unbounded = [draw.name for draw in usual.poses[0].draws if draw.unbounded]
    for name in unbounded:
        reach = np.array([[r.poses[0].draw(name).reach[c] for c in QUANTITIES[1:4]] for r in (new, usual)])
        np.testing.assert_allclose(reach[0], reach[1] * 4 / 3, rtol=1e-12)
    with pytest.raises(pp.InputError, match="k, in standard deviations"):
        pp.budget(MODEL, samples=1024, k=0.0)
