"""Settings of a run that do not change its result, and a run under way: its workers, its state and its journal."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, Generic

from precision_pin.base.arguments import (
    check_callable,
    check_flag,
    check_instance,
    check_items,
    check_mapping,
    check_path,
)
from precision_pin.base.errors import Finding, InputError, OutputError
from precision_pin.base.progress import Progress, check_progress, steps_to
from precision_pin.draws.space import check_seed
from precision_pin.model.error_model import ErrorModel
from precision_pin.sampling.journal import Codec, Files, Journal, S, opened
from precision_pin.sampling.workers import InOrder, Submitter, Workers, chosen
from precision_pin.statistics import check_confidence


def check_common(
    error_model: ErrorModel,
    *,
    seed: int,
    findings: Sequence[Finding],
    progress: Progress | bool | None,
    confidence: float = 0.95,
) -> tuple[Finding, ...]:
    """Check the arguments common to all analyses before any work is done, and return the findings."""
    check_instance("the error model", error_model, ErrorModel, "as ErrorModel.load returns it")
    check_seed(seed)
    check_confidence(confidence)
    check_progress(progress)
    return check_items("findings", findings, Finding)


@dataclass
class Run(Generic[S]):
    """A run under way.

    Attributes:
        step: Function called with the number of samples added.
        state: All that is added so far, from which the run can be resumed.
    """

    workers: Workers
    step: Callable[[int], object]
    state: S
    journal: Journal[S] | None = None

    def work_off(self, tasks: Iterable[tuple[Any, ...]], add: Callable[[Any, Any], int]) -> None:
        """Compute tasks and add their results in order.

        Args:
            tasks: Each a key, a function and its arguments.
            add: Given the key and the result, adds it to the state unless the one before it is missing, and returns the
                number of samples.
        """
        results = InOrder(self.workers, tasks)
        try:
            for key, result in results:
                count = add(key, result)
                if self.journal is not None:
                    self.journal.save_if_due(self.state)
                self.step(count)
        except KeyboardInterrupt:
            if self.journal is not None:
                results.begin_no_more()
                # a running task that fails now fails again in the resumed run, which reports it
                with suppress(Exception):
                    for key, result in results:
                        add(key, result)
            raise


@dataclass
class RunSettings:
    """Workers, journal and progress of a run, as for :func:`precision_pin.monte_carlo`.

    Raises:
        InputError: Wrong settings.
    """

    threads: int | None = None
    processes: int | None = None
    executor: Submitter | None = None
    tasks_under_way: int | None = None
    journal: str | os.PathLike[str] | None = None
    resume: bool = False
    files: Files | None = None
    progress: Progress | bool | None = None
    tell: Callable[[str], None] | None = None
    workers: Workers = field(init=False)

    def __post_init__(self) -> None:
        check_flag("resume", self.resume)
        if self.journal is not None:
            check_path("the journal", self.journal)
        for name, path in check_mapping("files", {} if self.files is None else self.files).items():
            check_path(f"{name} among the files", path)
        if self.tell is not None:
            check_callable("tell", self.tell)
        if self.resume and self.journal is None:
            raise InputError("resume needs a journal to resume from")
        self.workers = chosen(self.threads, self.processes, self.executor, self.tasks_under_way)

    def report(self, line: str) -> None:
        """Call ``tell``, if given, with a line."""
        if self.tell is not None:
            self.tell(line)

    @contextmanager
    def begun(
        self,
        start: S,
        codec: Codec[S],
        identity: Callable[[Files], Mapping[str, str]],
        total: int,
        steps: int | None = None,
    ) -> Iterator[Run[S]]:
        """Yield the run from its start, or from the state of its journal, which is saved at its end in any case.

        Args:
            identity: Returns all inputs that determine the bits of the run, given its files.
            total: The count of the state at the end of the run.
            steps: Number of samples of all passes, for the progress; by default the ``total``.
        """
        with ExitStack() as stack:
            run = Run(self.workers, stack.enter_context(steps_to(self.progress, steps or total)), start)
            if self.journal is not None:
                identities = identity(self.files or {})
                run.journal, run.state = stack.enter_context(
                    opened(self.journal, identities, start, codec, resume=self.resume, tell=self.report)
                )
            journal = run.journal
            stack.enter_context(self.workers)
            try:
                yield run
            except OutputError:
                raise
            except BaseException as error:
                if journal is not None:
                    journal.save(run.state)
                    if isinstance(error, KeyboardInterrupt):
                        error.add_note(
                            f"the journal {journal.name} holds the first {journal.saved:,} of {total:,} {codec.unit}"
                        )
                raise
            if journal is not None:
                journal.save(run.state)
