"""Tasks under way, in block order, and computed again where workers were lost."""

from __future__ import annotations

from contextlib import suppress
from typing import Any, Final, final

from precision_pin.errors import InputError, PrecisionPinError
from precision_pin.kernel import Blocks
from precision_pin.run.blocks import Work
from precision_pin.run.executors import Workers, WorkersLostError

__all__ = ["Stream", "task_size"]

MOST_LOSSES: Final = 3
"""How often workers may be lost over one task."""


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
    first_block
        Where to begin; the blocks before are known.
    size
        Blocks in a task; it changes no result.
    """

    def __init__(self, work: Work, workers: Workers, first_block: int, size: int) -> None:
        self._work = work
        self._workers = workers
        self._size = size
        self._next = first_block
        self._futures: dict[int, Any] = {}
        self._losses: dict[int, int] = {}

    def result(self, block: int) -> Blocks:
        """Return what the task gives that begins with a block, which ends the one before; keeps the workers busy.

        Raises
        ------
        InputError
            A sample cannot be computed; or workers ended again and again over this task, or those beside it.
        """
        self._forget_before(block)
        while True:
            try:
                while len(self._futures) < self._workers.most and self._next < self._work.blocks:
                    self._futures[self._next] = self._submitted(self._next)
                    self._next += self._size
                return self._workers.result(self._futures[block])
            except WorkersLostError:
                self._begin_again()

    def result_under_way(self, block: int) -> Blocks | None:
        """Return what the task gives that begins with a block, if it was begun; begins no further ones."""
        self._forget_before(block)
        return self._workers.result(self._futures[block]) if block in self._futures else None

    def _submitted(self, block: int) -> Any:
        return self._workers.submit(self._work, block, self._length(block))

    def _length(self, block: int) -> int:
        return min(self._size, self._work.blocks - block)

    def _forget_before(self, block: int) -> None:
        for known in [known for known in self._futures if known < block]:
            del self._futures[known]
            self._losses.pop(known, None)

    def _begin_again(self) -> None:
        """Get new workers and hand them all tasks that are not done."""
        self._workers.renew()
        lost = []
        for block, future in self._futures.items():
            try:
                self._workers.result(future)  # all are settled by now
            except WorkersLostError:
                lost.append(block)
                self._losses[block] = self._losses.get(block, 0) + 1
            except PrecisionPinError:
                continue  # told when its turn comes
        ended = [block for block in lost if self._losses[block] >= MOST_LOSSES]
        if ended:
            last = ended[-1] + self._length(ended[-1]) - 1
            raise InputError(
                f"worker processes ended {MOST_LOSSES} times over blocks {ended[0]} to {last}; is there memory enough? "
                "(a script that asks for processes begins its work under: if __name__ == '__main__')"
            )
        with suppress(WorkersLostError):  # those that are not handed over now count as lost again
            for block in lost:
                self._futures[block] = self._submitted(block)
