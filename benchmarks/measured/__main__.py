"""``python -m benchmarks.measured FOLDER``: fit and judge every set of data that lies in a folder, and write one page."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from numpy.linalg import LinAlgError

from benchmarks.measured.declared import FILE, MissingSet, names
from benchmarks.measured.judge import Outcome, judge, judge_factory, quiet
from benchmarks.measured.page import tables, write, write_docs
from benchmarks.measured.sets import factories, read
from precision_pin.base.errors import InputError

FACTORY = "ur-factory"


def outcomes_of(folder: Path) -> tuple[list[Outcome], list[str]]:
    """Return the rows of a folder's sets, and what was skipped and why; known sets that it lacks are not."""
    found: list[Outcome] = []
    skipped = []
    for name in names(folder):
        begin = time.process_time()
        try:
            measured = quiet(read, name, folder)
            if measured is None:
                continue
            outcome = judge(measured)
        except (MissingSet, InputError, LinAlgError) as error:
            skipped += [f"{name}: {text}" for text in lines(error)]
            continue
        outcome.seconds = time.process_time() - begin
        print(f"{name}: {outcome.seconds:.0f} s of processor time", file=sys.stderr)
        found.append(outcome)
    try:
        if (folder / FACTORY).is_dir():
            found += [judge_factory(factory) for factory in quiet(lambda: list(factories(folder / FACTORY)))]
    except (MissingSet, InputError) as error:
        skipped += [f"{FACTORY}: {text}" for text in lines(error)]
    return found, skipped


def lines(error: MissingSet | InputError | LinAlgError) -> Sequence[str]:
    """Return what is wrong, one line for each mistake."""
    if not isinstance(error, InputError):
        return error.args
    return [str(entry).removeprefix("precision-pin: error ") for entry in error.findings if entry.severity == "error"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the bench; 2 if there is nothing to judge."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.measured", description=__doc__)
    parser.add_argument(
        "folder", type=Path, metavar="FOLDER", help=f"folder with the known sets, NAME/{FILE}, or {FACTORY}"
    )
    parser.add_argument("--out", type=Path, default=Path("measured"), help="folder of the page (default: measured)")
    parser.add_argument(
        "--docs", type=Path, help="renew the page real-robots.md, its pictures and CSV in this folder too"
    )
    options = parser.parse_args(arguments)
    if not options.folder.is_dir():
        print(f"{options.folder}: no such folder", file=sys.stderr)
        return 2
    found, skipped = outcomes_of(options.folder)
    for text in skipped:
        print(f"skipped {text}", file=sys.stderr)
    if not found:
        print(f"{options.folder}: no set of data to judge", file=sys.stderr)
        return 2
    write(found, skipped, options.out)
    if options.docs is not None:
        write_docs(found, skipped, options.docs)
    print("\n\n".join(tables(found).values()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
