"""A progress bar for scripts and notebooks."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from precision_pin.base.arguments import check_number, check_text, check_whole, shown
from precision_pin.base.compile_ahead import COMPILING, announced, shown_by
from precision_pin.base.errors import InputError

Item = TypeVar("Item")


@contextmanager
def progress(
    total: int, what: str = "sampling", *, delay: float = 0.7, unit: str = "samples"
) -> Iterator[Callable[[int], None]]:
    """Show a progress bar while the body of a ``with`` runs; yields the function that takes the number of new steps.

    In a notebook it is a bar below the cell (text without ipywidgets), on a terminal a line on stderr, elsewhere
    nothing. It disappears at the end, also after an error or an interrupt. The one-time compilation of the sampler is
    shown the same way.

    Args:
        total: Number of steps.
        what: Label before the bar.
        delay: Seconds before it appears.
        unit: Name of a step, in the plural.

    Raises:
        InputError: The total is not a whole number of zero or more.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> with pp.progress(20_000) as advance:
        ...     result = pp.monte_carlo(model, samples=20_000, progress=advance)
    """
    check_whole("the total of a progress bar", total, 0, 2**63, "of zero or more")
    check_text("what, before a progress bar,", what)
    check_number("the delay of a progress bar", delay, "zero or more and finite", lambda seconds: seconds >= 0)
    check_text("the unit of a progress bar", unit)
    shape = {"total": total, "desc": what, "unit": f" {unit}", "unit_scale": True, "delay": delay}
    with shown_by(compilation), _bar(**shape) as bar:
        yield lambda count: bar.update(count)


Progress = Callable[[int], None]
"""Function called with the number of samples added since its last call."""


def check_progress(progress: object) -> None:
    """Check that progress is a function, a flag or None."""
    if progress is not None and not isinstance(progress, bool) and not callable(progress):
        raise InputError(f"progress must be a function, or True for a bar, got {shown(progress)}")


@contextmanager
def steps_to(
    show: Callable[[int], None] | bool | None, total: int, unit: str = "samples"
) -> Iterator[Callable[[int], None]]:
    """Yield the function for steps, given a function, True (a bar), False or None; raise InputError otherwise."""
    check_progress(show)
    if show is True:
        with progress(total, unit=unit) as step:
            yield step
    else:
        yield show or (lambda _: None)


def stepped(items: Iterable[Item], step: Callable[[int], object]) -> Iterator[Item]:
    """Yield items; each is a step, done when the next is asked for."""
    for item in items:
        yield item
        step(1)


def scaled(step: Callable[[int], object], work: int, steps: int) -> Callable[[int], None]:
    """Return a function that takes progress in units of ``work`` and reports ``steps``; at once if ``work`` is 0."""
    done = 0
    if work == 0:
        step(steps)

    def advance(count: int) -> None:
        nonlocal done
        before = done * steps // work
        done += count
        step(done * steps // work - before)

    return advance


@contextmanager
def compilation() -> Iterator[Callable[[float], None]]:
    """Show a bar or a line while the sampler is compiled; yields a function of the fraction done, 0 to 1."""
    if not (_in_kernel() or sys.stderr.isatty()):
        with announced() as show:
            yield show
        return
    with _bar(
        total=1.0, desc=COMPILING, bar_format="{desc}: {percentage:3.0f}%|{bar:20}| {elapsed}<{remaining}"
    ) as bar:

        def show(fraction: float) -> None:
            bar.n = max(bar.n, fraction)
            bar.refresh()

        yield show


def _bar(**shape: Any) -> Any:
    """Return tqdm's bar, hidden unless stderr is a terminal or a notebook."""
    from tqdm import tqdm

    if _in_kernel():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # ipywidgets is missing
            from tqdm.auto import tqdm
    return tqdm(leave=False, disable=False if _in_kernel() else None, file=sys.stderr, **shape)


def _in_kernel() -> bool:
    return type(sys.stderr).__module__.startswith("ipykernel")
