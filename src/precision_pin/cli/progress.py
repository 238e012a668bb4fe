"""What commands show while they work: that the sampler is compiled, and how far they are."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from precision_pin.cli.interrupts import raise_if_interrupted
from precision_pin.cli.notes import echo_note, is_quiet

__all__ = ["compile_sampler", "progress_bar"]


def compile_sampler() -> None:
    """Compile the sampler where that was never done on this machine, and say so."""
    from precision_pin import kernel

    if not kernel.is_compiled():
        echo_note("compiling the sampler, once on this machine: some 20 s")
        kernel.warm_up()


@contextmanager
def progress_bar(total: int, what: str, unit: str = "samples") -> Iterator[Callable[[int], None]]:
    """Show progress on a terminal, unless quiet; yields what takes the steps, each of which an interrupt ends."""
    if is_quiet():
        yield lambda _: raise_if_interrupted()
        return
    from precision_pin.progress_bar import progress

    with progress(total, what, unit=unit) as step:

        def advance(count: int) -> None:
            raise_if_interrupted()
            step(count)

        yield advance
