"""Small run with a journal, to be killed; a fork server imports it once, so that its processes start quickly."""

from __future__ import annotations

from precision_pin.kernel import sampler
from precision_pin.kernel.sampler import BLOCK
from precision_pin.sampling import journal
from precision_pin.sampling.one_pose import monte_carlo
from precision_pin.sampling.workers import available_cores
from sampling.cases import MODEL

SAMPLES = 60 * BLOCK + 321

sampler.warm_up()


def go(file: str, result: str) -> None:
    """Sample, resuming from the journal if it exists, and write the result."""
    journal.SHORTEST_PAUSE = journal.LONGEST_PAUSE = journal.COST_OF_WRITING = 0
    journal.MOST_RECORDS = 3
    analysis = monte_carlo(
        MODEL, "paper", samples=SAMPLES, seed=9, threads=available_cores(), journal=file, resume=True
    )
    with open(result, "w", encoding="utf-8") as stream:
        stream.write(analysis.to_json())
