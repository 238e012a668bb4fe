"""Blocks merged in their order, kept in a journal on the way."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import final

import numpy as np
from numpy.typing import NDArray

from precision_pin.errors import OutputError
from precision_pin.kernel import sampler
from precision_pin.kernel.sampler import Blocks
from precision_pin.sampling.blocks import Work
from precision_pin.sampling.journal import Journal
from precision_pin.sampling.stream import Stream, task_size
from precision_pin.sampling.workers import Workers
from precision_pin.statistics import State

__all__ = ["Sampling"]


@final
class Sampling:
    """A run, from a state on to the last sample.

    Parameters
    ----------
    work
        What is computed.
    state
        What was seen before.
    progress
        Told how many samples have been added since it was last called.
    journal
        Where the state is kept from time to time.
    """

    def __init__(self, work: Work, state: State, progress: Callable[[int], None], journal: Journal | None) -> None:
        self.state = state
        self.errors: NDArray[np.float64] | None = np.empty((6, work.samples)) if work.keep_errors else None
        self._work = work
        self._progress = progress
        self._journal = journal

    def run(
        self, workers: Workers, blocks_in_a_task: int | None = None, enough: Callable[[State], bool] | None = None
    ) -> None:
        """Sample to the end, or to the first look at which it is enough: at 1, 2, 4, 8 … blocks.

        The looks do not depend on the workers, and so neither does the result.

        Parameters
        ----------
        workers
            What computes the blocks. Neither they nor their speed decide any bit of the result.
        blocks_in_a_task
            As many as is good for the workers if left out; it decides no bit either.
        enough
            Asked at each look; never, if left out.

        Raises
        ------
        KeyboardInterrupt
            After what was under way is done and in the journal, if there is one; a note tells so.
        InputError
            A sample cannot be computed, or workers failed. What was done is in the journal.
        OutputError
            The journal cannot be written.
        """
        for end in self._looks() if enough is not None else [self._work.blocks]:
            if self._next_block() < end and self.state.count < self._work.samples:
                self._run_to(end, workers, blocks_in_a_task)
            if enough is not None and self._next_block() == end and enough(self.state):
                break
        if self._journal is not None:
            self._journal.save(self.state)

    def _looks(self) -> list[int]:
        """Return after which blocks to look."""
        blocks = self._work.blocks
        return [*(2**k for k in range((blocks - 1).bit_length())), blocks]

    def _run_to(self, end: int, workers: Workers, blocks_in_a_task: int | None) -> None:
        first = self._next_block()
        size = blocks_in_a_task or task_size(end - first, workers.blocks_in_a_task)
        stream = Stream(self._work, workers, first, end, size)
        try:
            while self._next_block() < end and self.state.count < self._work.samples:
                found = stream.result(self._next_block())
                self._add(found)
                if self._journal is not None:
                    self._journal.save_if_due(self.state)
                self._progress(found.count)
        except KeyboardInterrupt as interrupt:
            if self._journal is not None:
                self._finish_begun(stream)
                self._journal.save(self.state)
                interrupt.add_note(self._kept(self._journal))
            raise
        except OutputError:
            raise
        except Exception:
            if self._journal is not None:
                self._journal.save(self.state)
            raise

    def _next_block(self) -> int:
        return self.state.count // sampler.BLOCK

    def _add(self, found: Blocks) -> None:
        if self.errors is not None and found.errors is not None:
            self.errors[:, self.state.count : self.state.count + found.count] = found.errors
        self.state = found.add_to(self.state)

    def _finish_begun(self, stream: Stream) -> None:
        """Add what is under way; what fails now is found again by whoever goes on."""
        with suppress(Exception):
            while self.state.count < self._work.samples:
                found = stream.result_under_way(self._next_block())
                if found is None:
                    return
                self._add(found)

    def _kept(self, journal: Journal) -> str:
        return f"the journal {journal.name} holds the first {journal.saved:,} of {self._work.samples:,} samples"
