"""Progress of commands: of compiling the sampler and of the work itself."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Literal

from precision_pin.base.interrupts import raise_if_interrupted
from precision_pin.cli.notes import echo_note, is_quiet

if TYPE_CHECKING:
    from precision_pin.draws.space import Space


def compile_sampler(space: Space, model: Literal["exact", "linear"] = "exact") -> None:
    """Compile the sampler of a model, if it never was on this machine, and show progress."""
    from precision_pin.base.compile_ahead import COMPILING_NOTE, shown_by, silent
    from precision_pin.base.progress import compilation
    from precision_pin.kernel import sampler

    variant = sampler.variant_of(space, model)
    if sampler.is_compiled(*variant):
        return
    on_terminal = sys.stderr.isatty()
    if not on_terminal:
        echo_note(COMPILING_NOTE)
    with shown_by(compilation if on_terminal and not is_quiet() else silent):
        sampler.warm_up(*variant)
    raise_if_interrupted()


@contextmanager
def progress_bar(total: int, what: str, unit: str = "samples", delay: float = 0.7) -> Iterator[Callable[[int], None]]:
    """Show progress on a terminal after ``delay`` s, unless quiet; yield what takes the steps and stops at an interrupt."""
    if is_quiet():
        yield lambda _: raise_if_interrupted()
        return
    from precision_pin.base.progress import progress

    with progress(total, what, delay=delay, unit=unit) as step:

        def advance(count: int) -> None:
            raise_if_interrupted()
            step(count)

        yield advance
