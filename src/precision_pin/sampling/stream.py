"""Tasks under way, in block order."""

from __future__ import annotations

from typing import Any, final

from precision_pin.kernel.sampler import Blocks
from precision_pin.sampling.blocks import Work
from precision_pin.sampling.workers import Workers

__all__ = ["Stream", "task_size"]


def task_size(blocks: int, most: int) -> int:
    """Return how many blocks a task takes: enough to keep a worker busy, never so many that progress stalls."""
    return min(most, max(1, blocks // 8))


@final
class Stream:
    """Hands out tasks ahead of the one that is waited for; holds no more of them than the workers take.

    Parameters
    ----------
    work
        What is computed.
    workers
        Where.
    first_block, end_block
        Where to begin and before which to end; the blocks before are known.
    size
        Blocks in a task; it changes no result.
    """

    def __init__(self, work: Work, workers: Workers, first_block: int, end_block: int, size: int) -> None:
        self._work = work
        self._workers = workers
        self._size = size
        self._next = first_block
        self._end = end_block
        self._futures: dict[int, Any] = {}

    def result(self, block: int) -> Blocks:
        """Return what the task gives that begins with a block, which ends the one before; keeps the workers busy.

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
        return self._workers.result(self._futures[block])

    def result_under_way(self, block: int) -> Blocks | None:
        """Return what the task gives that begins with a block, if it was begun; begins no further ones."""
        self._forget_before(block)
        return self._workers.result(self._futures[block]) if block in self._futures else None

    def _forget_before(self, block: int) -> None:
        for known in [known for known in self._futures if known < block]:
            del self._futures[known]
