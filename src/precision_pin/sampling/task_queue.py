"""Stream of running tasks, in block order."""

from __future__ import annotations

from typing import Any, final

from precision_pin.kernel.blocks import Blocks
from precision_pin.sampling.blocks import Work
from precision_pin.sampling.workers import Workers


def task_size(blocks: int, most: int) -> int:
    """Return the number of blocks in a task: enough to keep a worker busy, few enough for regular progress."""
    return min(most, max(1, blocks // 8))


@final
class Stream:
    """Tasks submitted ahead of the one being awaited, at most as many as the workers accept.

    Parameters
    ----------
    work
        The work of the run.
    workers
        Workers that compute the tasks.
    first_block, end_block
        The first block, and the one after the last.
    size
        Blocks in a task; it does not change the result.
    """

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

        Raises
        ------
        InputError
            A sample cannot be computed, or the workers failed.
        """
        self._forget_before(block)
        while len(self._futures) < self._workers.most and self._next < self._end:
            length = min(self._size, self._end - self._next)
            self._futures[self._next] = self._workers.submit(self._work, self._next, length)
            self._next += self._size
        found: Blocks = self._workers.result(self._futures[block])
        return found

    def result_under_way(self, block: int) -> Blocks | None:
        """Wait for the task that begins with a block, None if it was not submitted; submit no further tasks."""
        self._forget_before(block)
        return self._workers.result(self._futures[block]) if block in self._futures else None

    def _forget_before(self, block: int) -> None:
        for known in [known for known in self._futures if known < block]:
            del self._futures[known]
