"""Options for what samples, and for the journal of a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, TypeVar

import click

from precision_pin.base.interrupts import raise_if_interrupted, unwinding
from precision_pin.cli.headings import sampling_option
from precision_pin.cli.notes import echo_note
from precision_pin.cli.options import Options
from precision_pin.cli.streams import say

Command = TypeVar("Command", bound=Callable[..., Any])


def worker_options(command: Command) -> Command:
    """Add the options to a command."""
    for option in (
        sampling_option("--resume", is_flag=True, help="Go on from the journal, if it is there."),
        sampling_option(
            "--journal", metavar="FILE", help="Keep the run in FILE on the way, so that it can be stopped and resumed."
        ),
        sampling_option(
            "--dask", metavar="ADDRESS", help="Sample on the Dask cluster of a scheduler, as tcp://host:8786."
        ),
        sampling_option("--processes", type=int, metavar="N", help="Sample in N processes instead."),
        sampling_option("--threads", type=int, metavar="N", help="How many threads sample; all cores if left out."),
    ):
        command = option(command)
    return command


def check_workers(options: Options) -> None:
    """Check that the options go together.

    Raises:
        UsageError: More than one kind of worker, or ``--resume`` without ``--journal``.
    """
    kinds = {"--threads": options["threads"], "--processes": options["processes"], "--dask": options["dask"]}
    asked = [name for name, value in kinds.items() if value is not None]
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
