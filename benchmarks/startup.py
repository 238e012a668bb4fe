"""How long the command takes to start, beside Python itself and the libraries it stands on."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Final

from benchmarks.tables import Part, Ratio, Table, figure
from benchmarks.timing import Work, best_times
from precision_pin.kernel import sampler
from precision_pin.robot.examples import PAPER_SHEET

__all__ = ["measure"]

PYTHON: Final = "python alone"
PINOCCHIO: Final = "python -c 'import pinocchio'"
COMMAND: Final = ("-m", "precision_pin")
STARTS: Final[Mapping[str, Sequence[str]]] = {
    PYTHON: ("-c", ""),
    "python -c 'import numpy'": ("-c", "import numpy"),
    PINOCCHIO: ("-c", "import pinocchio"),
    "precision-pin --help": (*COMMAND, "--help"),
    "precision-pin check": (*COMMAND, "check", str(PAPER_SHEET)),
    "precision-pin analyze, 100,000 samples": (*COMMAND, "analyze"),
}
COLD: Final = "precision-pin analyze, the first of all: the sampler is compiled"


def measure(quick: bool) -> Part:
    """Measure the time that passes from start to end of each; the best of several, of the cold start one, left out if quick."""
    sampler.warm_up()
    with tempfile.TemporaryDirectory() as folder:
        works = {name: Work(partial(_run, words, folder), 1) for name, words in STARTS.items()}
        seconds = best_times(works, 1 if quick else 8, time.perf_counter)
        if not quick:
            cold = {**os.environ, "NUMBA_CACHE_DIR": str(Path(folder) / "cache")}
            began = time.perf_counter()
            _run((*COMMAND, "analyze"), folder, cold)
            seconds[COLD] = time.perf_counter() - began
    rows = [(name, figure(value), figure(value / seconds[PINOCCHIO])) for name, value in seconds.items()]
    table = Table("Start-up, the time that passes", ("command", "s", "to importing Pinocchio"), rows)
    return Part(
        (table,),
        (
            Ratio("precision-pin --help to python alone", seconds["precision-pin --help"] / seconds[PYTHON]),
            Ratio(
                "precision-pin analyze to importing Pinocchio",
                seconds["precision-pin analyze, 100,000 samples"] / seconds[PINOCCHIO],
            ),
        ),
    )


def _run(words: Sequence[str], folder: str, environment: Mapping[str, str] | None = None) -> None:
    subprocess.run([sys.executable, *words], check=True, capture_output=True, cwd=folder, env=environment)
