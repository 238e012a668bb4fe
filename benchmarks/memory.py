"""One run in a process of its own, whose time and peak memory it prints: ``python -m benchmarks.memory WAY SAMPLES``."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final, final

__all__ = ["NUMPY", "SAMPLER", "Spent", "spent"]

SAMPLER: Final = "sampler"
NUMPY: Final = "numpy"


@final
@dataclass(frozen=True)
class Spent:
    """What a run took: seconds of processor time, after loading the program, and bytes of memory at its peak."""

    seconds: float
    peak: int


def spent(way: str, samples: int) -> Spent:
    """Sample the paper's arm in a new process on one core."""
    words = [sys.executable, "-m", "benchmarks.memory", way, str(samples)]
    return Spent(**json.loads(subprocess.run(words, check=True, capture_output=True, text=True).stdout))


def main() -> None:
    """Sample, and print what it took as JSON."""
    way, samples = sys.argv[1], int(sys.argv[2])
    from benchmarks.loops import statistics_with_numpy
    from precision_pin.model.error_model import ErrorModel
    from precision_pin.robot.examples import PAPER_SHEET
    from precision_pin.sampling import monte_carlo

    model = ErrorModel.load(PAPER_SHEET)
    at = model.at()
    # what is loaded late is loaded now
    if way == SAMPLER:
        monte_carlo(model, samples=1000, threads=1)
    else:
        statistics_with_numpy(at.exact(at.space.sample(0, 0, 1000)))
    began = time.process_time()
    if way == SAMPLER:
        monte_carlo(model, samples=samples, threads=1)
    else:
        statistics_with_numpy(at.exact(at.space.sample(0, 0, samples)))
    seconds = time.process_time() - began
    print(json.dumps({"seconds": seconds, "peak": _peak()}))


def _peak() -> int:
    """Return the most memory this process had, in bytes."""
    status = Path("/proc/self/status")
    if status.exists():
        # Linux counts the parent's memory into the child's ru_maxrss
        lines = dict(line.split(":", 1) for line in status.read_text(encoding="utf-8").splitlines())
        return int(lines["VmHWM"].split()[0]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


if __name__ == "__main__":
    main()
