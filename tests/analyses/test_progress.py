"""Progress of the analyses, from zero to the announced number of steps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.analyses.budget.budget import evaluations
from precision_pin.analyses.exact_law import exact_law as exact_law_module
from precision_pin.robot.examples import PAPER_SHEET

MODEL = pp.ErrorModel.load(PAPER_SHEET)
POSES = ["paper", [0.1, 0.2, 0.3, 0.4]]
CALLS: dict[str, tuple[Callable[..., Any], int]] = {
    "budget": (lambda **k: pp.budget(MODEL, POSES, samples=1024, **k), 2 * evaluations(MODEL.space, 1024)),
    "exact_law": (lambda **k: pp.exact_law(MODEL, POSES, samples=500, **k), 3 * 500),
    "moments": (lambda **k: pp.moments(MODEL, POSES, samples=2048, **k), 2 * 2048),
    "closed moments": (lambda **k: pp.moments(MODEL, "paper", method="closed", **k), 0),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name == "budget")) for name in CALLS])
def test_the_steps_are_as_many_as_the_bar_has(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    call, total = CALLS[name]
    told: list[int] = []
    call(progress=told.append)
    assert sum(told) == total

    bars: list[int] = []
    shown = pp.progress

    def bar(total: int, **_: str) -> Any:
        bars.append(total)
        return shown(total)

    monkeypatch.setattr("precision_pin.base.progress.progress", bar)
    call(progress=True)
    assert bars == [total]


def test_a_draw_that_does_not_vary_is_no_step() -> None:
    space = pp.Space((pp.Draw("a", pp.Uniform(1.0)), pp.Draw("b", pp.Fixed(1.0)), pp.Draw("c", pp.Normal(1.0))))
    # two sets, two exchanged for each draw that varies, one plain, one halved for each
    assert evaluations(space, 1024) == 1024 * (2 + 2 * 2 + 1 + 2)


def test_samples_of_the_exact_law_do_not_depend_on_how_many_are_drawn_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = exact_law_module._deviations(MODEL.space, 3, 5000, lambda _: None)
    np.testing.assert_array_equal(whole, MODEL.space.sample(3, 0, 5000) - MODEL.space.mean[:, None])
    monkeypatch.setattr(exact_law_module, "_AT_ONCE", 777)
    np.testing.assert_array_equal(exact_law_module._deviations(MODEL.space, 3, 5000, lambda _: None), whole)
