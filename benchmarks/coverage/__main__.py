"""Measure how often every printed interval holds the truth.

    python -m benchmarks.coverage [--only NAME] [--share S] [--out docs]

With ``--out`` FOLDER/coverage.csv holds everything, and the tables replace those in FOLDER/coverage.md between its two marks.
``--share 0.01`` measures a hundredth of the runs.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path
from typing import Final

from benchmarks.coverage.row import Coverage, as_csv, as_markdown, cells

BEGIN: Final = "<!-- measured: python -m benchmarks.coverage -->"
END: Final = "<!-- end of what was measured -->"
PARTS: Final = {"sampling": "Sampling", "analyses": "Budget, moments, exact laws", "rare": "Reliability"}
"""Modules beside this one, each with ``measure(share) -> list[Coverage]``, and their headings."""


def main() -> int:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.coverage")
    parser.add_argument("--only", choices=PARTS, help="one part")
    parser.add_argument("--share", type=float, default=1.0, help="share of the runs, at most 1")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="write coverage.md and coverage.csv there")
    options = parser.parse_args()
    parts, rows = {}, list[Coverage]()
    for name, heading in PARTS.items():
        if options.only in (None, name):
            print(heading, file=sys.stderr, flush=True)
            measured = importlib.import_module(f"benchmarks.coverage.{name}").measure(options.share)
            rows += measured
            parts[heading] = cells(measured)
    print(as_csv(parts))
    if options.out is not None:
        (options.out / "coverage.csv").write_text(as_csv(parts), encoding="utf-8")
        text = "\n\n".join(f"### {heading}\n\n{as_markdown(lines)}" for heading, lines in parts.items())
        page = options.out / "coverage.md"
        before, _, rest = page.read_text(encoding="utf-8").partition(BEGIN)
        page.write_text(f"{before}{BEGIN}\n\n{text}\n\n{END}{rest.partition(END)[2]}", encoding="utf-8")
    return 0 if all(row.passes for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
