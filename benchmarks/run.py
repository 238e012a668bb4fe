"""Measure every speed figure, print the tables, and write them into a folder's page.

    python -m benchmarks [--quick] [--out docs]

With ``--out`` the tables replace those in FOLDER/benchmarks.md between its two marks, and the pictures go to
FOLDER/images. Progress goes to stderr.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, NoReturn

from benchmarks import kernel, machine, plots, scaling, sketch, startup
from benchmarks.tables import Part, Ratio, Table

__all__ = ["BEGIN", "END", "main", "replaced"]

BEGIN: Final = "<!-- measured: python -m benchmarks -->"
END: Final = "<!-- end of what was measured -->"
FURTHER: Final = ("postures", "poses", "calibration", "variance", "allocation")
"""Modules beside this one that measure and print by themselves; what they print is not on the page."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description="Measure every speed figure, as ratios within one run."
    )
    parser.add_argument("--quick", action="store_true", help="fewer turns and samples, under a minute; not for citing")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="write FOLDER/benchmarks.md and FOLDER/images")
    options = parser.parse_args(arguments)
    page = None if options.out is None else options.out / "benchmarks.md"
    if page is not None:
        _check(page, parser.error)
    try:
        _run(options.quick, page)
    except KeyboardInterrupt:
        print("interrupted; nothing was written", file=sys.stderr)
        raise SystemExit(130) from None


def _check(page: Path, refuse: Callable[[str], NoReturn]) -> None:
    """Find out before minutes of measuring whether the page can be written."""
    try:
        replaced(page.read_text(encoding="utf-8"), "")
    except (OSError, UnicodeDecodeError) as error:
        refuse(f"{page}: {error.strerror if isinstance(error, OSError) else 'it is not text'}")
    except ValueError as error:
        refuse(f"{page}: {error}")


def _run(quick: bool, page: Path | None) -> None:
    began = time.perf_counter()

    def tell(what: str) -> None:
        print(f"{time.perf_counter() - began:5.0f} s  {what}", file=sys.stderr, flush=True)

    tell("the sampler and what one would write otherwise")
    compared = kernel.measure(quick)
    tell("samples, joints, parameters, threads")
    scaled = scaling.measure(quick)
    tell("start-up")
    started = startup.measure(quick)
    tell("quantiles")
    sketched = sketch.measure(quick)
    further = {name: text for name in (() if quick else FURTHER) if (text := _printed(name, tell))}
    tell("done")
    parts = (compared.part, scaled.part(), started, sketched)
    setting = machine.described() + (" A quick run: not for citing." if quick else "")
    summary = _summary(parts)
    tables = [summary, *(table for part in parts for table in part.tables)]
    print("\n\n".join([setting, *(table.as_text() for table in tables), *further.values()]))
    if page is not None:
        images = page.parent / "images"
        images.mkdir(exist_ok=True)
        plots.draw_comparison(compared.cost, kernel.EXACT, images / "benchmark-comparison.png")
        plots.draw_scaling(scaled, images / "benchmark-scaling.png")
        text = "\n\n".join([f"Measured on: {setting}", *(table.as_markdown() for table in tables if table.on_page)])
        page.write_text(replaced(page.read_text(encoding="utf-8"), text), encoding="utf-8")
        print(f"wrote {page}", file=sys.stderr)


def _summary(parts: Sequence[Part]) -> Table:
    """Return the ratios that have an aim; the others follow from the tables."""
    ratios: list[Ratio] = [ratio for part in parts for ratio in part.ratios if ratio.aim is not None]
    return Table("Ratios with an aim", ("ratio", "measured", "aim"), [ratio.as_row() for ratio in ratios])


def _printed(name: str, tell: Callable[[str], None]) -> str:
    """Return what a further module prints; nothing where it is not there."""
    if not (Path(__file__).parent / f"{name}.py").exists():
        return ""
    tell(name)
    words = [sys.executable, "-m", f"benchmarks.{name}"]
    run = subprocess.run(words, stdout=subprocess.PIPE, text=True, check=False)
    if run.returncode:
        raise SystemExit(f"benchmarks/{name}.py ended with exit code {run.returncode}; nothing was written")
    return run.stdout.strip()


def replaced(page: str, measured: str) -> str:
    """Return a page with what was measured between its marks.

    Raises:
        ValueError: The page does not have both marks, once each and in order.
    """
    if page.count(BEGIN) != 1 or page.count(END) != 1 or page.index(BEGIN) > page.index(END):
        raise ValueError(f"it needs the lines {BEGIN} and {END}, once each and in this order")
    before, _, rest = page.partition(BEGIN)
    return f"{before}{BEGIN}\n\n{measured}\n\n{END}{rest.partition(END)[2]}"
