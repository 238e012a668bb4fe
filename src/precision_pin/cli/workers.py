"""What samples and how far it is: options for threads, processes, a cluster and the journal; compiling; progress."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any, Final, Literal

import click

from precision_pin.base.interrupts import raise_if_interrupted, unwinding
from precision_pin.cli.notes import echo_note, is_given
from precision_pin.cli.options import Options, sampling_option, together
from precision_pin.cli.streams import say

if TYPE_CHECKING:
    from precision_pin.draws.space import Space

worker_options: Final = together(
    sampling_option("--threads", type=int, metavar="N", help="How many threads sample; all cores if left out."),
    sampling_option("--processes", type=int, metavar="N", help="Sample in N processes instead."),
    sampling_option("--dask", metavar="ADDRESS", help="Sample on the Dask cluster of a scheduler, as tcp://host:8786."),
    sampling_option(
        "--journal", metavar="FILE", help="Keep the run in FILE on the way, so that it can be stopped and resumed."
    ),
    sampling_option("--resume", is_flag=True, help="Go on from the journal, if it is there."),
)


def check_workers(options: Options) -> None:
    """Refuse more than one kind of worker, and ``--resume`` without ``--journal``."""
    asked = [f"--{name}" for name in ("threads", "processes", "dask") if options[name] is not None]
    if len(asked) > 1:
        raise click.UsageError(f"{' and '.join(asked)} exclude each other")
    if options["resume"] and options["journal"] is None:
        raise click.UsageError("--resume needs the run's --journal FILE")


@contextmanager
def working(options: Options) -> Iterator[dict[str, Any]]:
    """Start what samples, and end it; yields the arguments of functions that sample; an interrupt says what the journal holds."""
    from precision_pin.sampling import dask_cluster

    with ExitStack() as stack:
        cluster = None if options["dask"] is None else stack.enter_context(dask_cluster(options["dask"]))
        executor, under_way = cluster or (None, None)
        try:
            with unwinding():
                own = {name: options[name] for name in ("threads", "processes", "journal", "resume")}
                yield {**own, "executor": executor, "tasks_under_way": under_way, "tell": echo_note}
                raise_if_interrupted()
        except KeyboardInterrupt as interrupt:
            for note in getattr(interrupt, "__notes__", ()):
                say(f"{note}; the same command with --resume goes on from there")
            raise


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
    with shown_by(compilation if on_terminal and not is_given("quiet") else silent):
        sampler.warm_up(*variant)
    raise_if_interrupted()


@contextmanager
def progress_bar(total: int, what: str, unit: str = "samples", delay: float = 0.7) -> Iterator[Callable[[int], None]]:
    """Show progress on a terminal after ``delay`` s, unless quiet; yield what takes the steps and stops at an interrupt."""
    if is_given("quiet"):
        yield lambda _: raise_if_interrupted()
        return
    from precision_pin.base.progress import progress

    with progress(total, what, delay=delay, unit=unit) as step:

        def advance(count: int) -> None:
            raise_if_interrupted()
            step(count)

        yield advance
