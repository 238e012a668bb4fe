"""Schedule of a run: blocks merged in order and saved in a journal."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.errors import OutputError
from precision_pin.kernel.sampler import BLOCK, Blocks
from precision_pin.sampling.blocks import Work
from precision_pin.sampling.journal import Journal
from precision_pin.sampling.workers import Workers
from precision_pin.statistics import State


def task_size(blocks: int, most: int) -> int:
    """Return the number of blocks in a task: enough to keep a worker busy, few enough for regular progress."""
    return min(most, max(1, blocks // 8))


@final
class Stream:
    """Tasks submitted ahead of the one being awaited, at most as many as the workers accept."""

    def __init__(self, work: Work, workers: Workers, first_block: int, end_block: int, size: int) -> None:
        self._work = work
        self._workers = workers
        self._size = size
        self._next = first_block
        self._end = end_block
        self._futures: dict[int, Any] = {}

    def result(self, block: int) -> Blocks:
        """Wait for the task that begins with a block, and submit further tasks.

        The block must be the one after the last of the task before.
        """
        self._forget_before(block)
        while len(self._futures) < self._workers.most and self._next < self._end:
            length = min(self._size, self._end - self._next)
            self._futures[self._next] = self._workers.submit(self._work, self._next, length)
            self._next += self._size
        return self._workers.result(self._futures[block])

    def result_under_way(self, block: int) -> Blocks | None:
        """Wait for the task that begins with a block, None if it was not submitted; submit no further tasks."""
        self._forget_before(block)
        return self._workers.result(self._futures[block]) if block in self._futures else None

    def _forget_before(self, block: int) -> None:
        for known in [known for known in self._futures if known < block]:
            del self._futures[known]


@final
class Sampling:
    """Run from a given state to the last sample."""

    def __init__(
        self, work: Work, state: State, progress: Callable[[int], None], journal: Journal[State] | None
    ) -> None:
        self.state = state
        self.errors: NDArray[np.float64] | None = np.empty((6, work.samples)) if work.keep_errors else None
        self._work = work
        self._progress = progress
        self._journal = journal

    def run(
        self, workers: Workers, blocks_in_a_task: int | None = None, enough: Callable[[State], bool] | None = None
    ) -> None:
        """Sample to the end, or to the first check that is passed: after 1, 2, 4, 8 … blocks.

        The checks do not depend on the workers, and so neither does the result.
        """
        for end in self._check_blocks() if enough is not None else [self._work.blocks]:
            if self._next_block() < end and self.state.count < self._work.samples:
                self._run_to(end, workers, blocks_in_a_task)
            if enough is not None and self._next_block() == end and enough(self.state):
                break
        if self._journal is not None:
            self._journal.save(self.state)

    def _check_blocks(self) -> list[int]:
        """Return the numbers of blocks after which to check."""
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
                self._finish_running(stream)
                self._journal.save(self.state)
                interrupt.add_note(self._saved_note(self._journal))
            raise
        except OutputError:
            raise
        except Exception:
            if self._journal is not None:
                self._journal.save(self.state)
            raise

    def _next_block(self) -> int:
        return self.state.count // BLOCK

    def _add(self, found: Blocks) -> None:
        if self.errors is not None and found.errors is not None:
            self.errors[:, self.state.count : self.state.count + found.count] = found.errors
        self.state = found.add_to(self.state)

    def _finish_running(self, stream: Stream) -> None:
        """Add the running tasks; one that fails now fails again in the resumed run, which reports it."""
        with suppress(Exception):
            while self.state.count < self._work.samples:
                found = stream.result_under_way(self._next_block())
                if found is None:
                    return
                self._add(found)

    def _saved_note(self, journal: Journal[State]) -> str:
        return f"the journal {journal.name} holds the first {journal.saved:,} of {self._work.samples:,} samples"
