"""``python -m fuzzing urdfs``: changed robots against a second reading and urdfdom, in processes that may die."""

from __future__ import annotations

import multiprocessing
import resource
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path

import click

from fuzzing.robots.mutations import mutant
from fuzzing.robots.trial import Outcome, try_robot

__all__ = ["command", "outcomes"]

LONGEST = 30.0
"""Seconds after which a process is ended."""
MEMORY = 4 << 30
"""Bytes of address space of a process."""


@dataclass
class Tally:
    """What became of all robots."""

    loaded: int = 0
    refused: int = 0
    codes: Counter[str] = field(default_factory=Counter)
    remarks: Counter[str] = field(default_factory=Counter)
    problems: list[str] = field(default_factory=list)

    def add(self, outcome: Outcome) -> None:
        self.loaded += outcome.loaded
        self.refused += not outcome.loaded
        self.codes.update(set(outcome.codes))
        self.remarks.update(set(outcome.remarks))
        self.problems += outcome.problems


@click.command("urdfs")
@click.option("--count", default=1000, show_default=True, help="How many changed robots.")
@click.option("--seed", default=0, show_default=True, help="Which ones.")
@click.option("--start", default=0, show_default=True, help="Number of the first.")
@click.option("--write", type=click.Path(path_type=Path), help="Write the robot number START to this file, and stop.")
def command(count: int, seed: int, start: int, write: Path | None) -> None:
    """Change robots at random; each must be refused with findings, or read as two other readers read it.

    A robot is changed in its elements, attributes, names, numbers, encoding and bytes. What is accepted is compared
    with a second reading (poses, masses, load torques, at random joint values, tips, bases and locked joints) and with
    Pinocchio's own reader (urdfdom); what urdfdom refuses or reads otherwise must carry a finding.
    """
    if write is not None:
        write.write_bytes(mutant(seed, start))
        return
    tally = Tally()
    began = time.monotonic()
    for done, (number, outcome) in enumerate(outcomes(seed, start, count), start=1):
        tally.add(outcome)
        for problem in outcome.problems:
            click.echo(f"seed {seed} number {number}: {problem}")
        if done % 1000 == 0:
            click.echo(
                f"{done} of {count}, {len(tally.problems)} did not hold, {time.monotonic() - began:.0f} s", err=True
            )
    _report(tally, seed, began)
    sys.exit(1 if tally.problems else 0)


def outcomes(seed: int, start: int, count: int) -> Iterator[tuple[int, Outcome]]:
    """Yield number and outcome of each robot; a process that dies or hangs is one outcome, and the next goes on."""
    context = multiprocessing.get_context("spawn")
    at, stop = start, start + count
    while at < stop:
        ours, theirs = context.Pipe(duplex=False)
        worker = context.Process(target=_work, args=(theirs, seed, at, stop), daemon=True)
        worker.start()
        theirs.close()
        stage = "start"
        while at < stop:
            try:
                if not ours.poll(LONGEST):
                    worker.kill()
                    worker.join()
                    yield at, Outcome(problems=[f"hung in: {stage}"])
                    at += 1
                    break
                message = ours.recv()
            except EOFError:
                worker.join()
                yield at, Outcome(problems=[f"the process ended with {worker.exitcode} in: {stage}"])
                at += 1
                break
            if isinstance(message, str):
                stage = message
            else:
                yield at, message
                at += 1
        worker.join(LONGEST)


def _work(pipe: Connection, seed: int, start: int, stop: int) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    with tempfile.TemporaryDirectory() as folder:
        for number in range(start, stop):
            pipe.send(try_robot(mutant(seed, number), f"{seed}/{number}", Path(folder), pipe.send))


def _report(tally: Tally, seed: int, began: float) -> None:
    seconds = time.monotonic() - began
    click.echo(f"seed {seed}: {tally.loaded} robots accepted, {tally.refused} refused, in {seconds:.0f} s")
    for title, counter in (("findings", tally.codes), ("known differences", tally.remarks)):
        click.echo(f"{title}:")
        for name, count in counter.most_common():
            click.echo(f"  {count:7d}  {name}")
    click.echo(f"{len(tally.problems)} did not hold")
    for name, count in Counter(problem[:60] for problem in tally.problems).most_common():
        click.echo(f"  {count:7d}  {name}")
