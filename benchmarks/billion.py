"""A billion exact samples on all cores, and the memory of their process all the while.

    python -m benchmarks.billion [--samples N] [--out docs]

Prints time, memory and largest errors; with ``--out`` draws FOLDER/images/benchmark-billion.png.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

import matplotlib as mpl
import psutil
from matplotlib.figure import Figure

from benchmarks.plots import DOTS, OURS, STYLE

PAUSE = 0.25
"""Seconds between two looks at the memory."""


def main() -> None:
    """Sample in a process of its own and look at it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=10**9, help="how many, a billion if left out")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="draw FOLDER/images/benchmark-billion.png")
    options = parser.parse_args()
    command = [sys.executable, "-m", "precision_pin", "analyze", "--samples", str(options.samples), "--json", "-"]
    began = time.perf_counter()
    process = psutil.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    moments, resident = [], []
    while process.poll() is None:
        try:
            resident.append(process.memory_info().rss / 1e6)
            moments.append(time.perf_counter() - began)
        except psutil.Error:  # it has just ended
            break
        time.sleep(PAUSE)
    output, _ = process.communicate()
    seconds = time.perf_counter() - began
    result = json.loads(output)
    print(f"{result['samples']:,} samples of {result['robot']} in {seconds:.1f} s, at most {max(resident):.0f} MB")
    for one in result["largest"]["position"][:3]:
        print(f"unit {one['unit']:,}: |d| = {1e3 * one['value']:.4f} mm")
    if options.out is not None:
        with mpl.rc_context(STYLE):
            picture = Figure(figsize=(7, 2.6), layout="constrained")
            axes = picture.subplots()
            axes.plot(moments, resident, color=OURS)
            axes.set_ylim(0, 1.25 * max(resident))
            axes.set_xlim(0, seconds)
            axes.set_xlabel(f"time since the start (s); {result['samples']:,} samples")
            axes.set_ylabel("memory in use (MB)")
            picture.savefig(options.out / "images" / "benchmark-billion.png", dpi=DOTS)


if __name__ == "__main__":
    main()
