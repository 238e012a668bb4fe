"""``python -m fuzzing sheets``: broken and respelt sheets, in a process that is watched."""

from __future__ import annotations

import multiprocessing
import resource
import sys
import tempfile
from collections import Counter
from multiprocessing.connection import Connection
from pathlib import Path

import click

from fuzzing.errorsheets.grammar import write_files
from fuzzing.errorsheets.trial import Outcome, sheet_of, try_sheet

__all__ = ["command"]

LONGEST = 60.0
"""Seconds after which a process is ended."""
MEMORY = 6 << 30
"""Bytes of address space of a process."""
SHOWN = 100


@click.command("sheets")
@click.option("--count", default=1000, show_default=True, help="How many sheets.")
@click.option("--seed", default=0, show_default=True, help="Which ones.")
@click.option("--start", default=0, show_default=True, help="Number of the first.")
@click.option("--write", type=click.Path(path_type=Path), help="Write the sheet number START to this file, and stop.")
def command(count: int, seed: int, start: int, write: Path | None) -> None:
    """Break sheets at random, and say the same in other words.

    A broken sheet must be refused with one line for each finding that says where, or give finite errors (64 robots of
    the clear engine at each pose, or one line that says why not); its text must be what another reader of YAML reads.
    Every fourth sheet is whole, made from all kinds of sources, laws, correlations and tables, and compared with one
    that says the same: in other units, numbers, names of parameters, order of keys and style of YAML.
    """
    if write is not None:
        write.write_bytes(sheet_of(seed, start)[0])
        return
    tally: Counter[str] = Counter()
    problems: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        write_files(Path(folder))
        worker = _Worker(seed, Path(folder))
        for number in range(start, start + count):
            outcome = worker.ask(number)
            tally["accepted" if outcome.accepted else "refused"] += 1
            tally.update(set(outcome.codes))
            for problem in dict.fromkeys(outcome.problems):
                problems.append(f"sheet {number} of seed {seed}: {problem}")
                if len(problems) <= SHOWN:
                    click.echo(problems[-1])
            if (number - start + 1) % 1000 == 0:
                click.echo(f"{number - start + 1:,} sheets, {len(problems)} did not hold", err=True)
        worker.end()
    click.echo(f"{count:,} sheets: {', '.join(f'{what} {times:,}' for what, times in tally.most_common())}")
    click.echo(f"{len(problems)} did not hold")
    sys.exit(1 if problems else 0)


class _Worker:
    """A process that tries sheets, and is made anew when it hangs or dies."""

    def __init__(self, seed: int, folder: Path) -> None:
        self._seed, self._folder = seed, folder
        self._begin()

    def ask(self, number: int) -> Outcome:
        """Return what became of a sheet."""
        self._pipe.send(number)
        try:
            if self._pipe.poll(LONGEST):
                outcome: Outcome = self._pipe.recv()
                return outcome
            problem = f"hangs: no answer in {LONGEST:g} s"
        except (EOFError, ConnectionError):
            self._process.join()
            problem = f"the process died with {self._process.exitcode}"
        self.end()
        self._begin()
        return Outcome(problems=[problem])

    def end(self) -> None:
        self._process.kill()
        self._process.join()

    def _begin(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_work, args=(theirs, self._seed, self._folder), daemon=True)
        self._process.start()
        theirs.close()


def _work(pipe: Connection, seed: int, folder: Path) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    while True:
        pipe.send(try_sheet(seed, pipe.recv(), folder))
