"""Which robots of example-robot-data go through init, analyze, budget and map, and what comes out?

    python scripts/all_robots.py [NAME]...

Prints a row for each robot named; without names all of them are tried, and docs/robots.csv is written anew.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import re
import shlex
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from precision_pin.cli import main as precision_pin
from precision_pin.robot.examples import example_urdfs

TABLE = Path(__file__).parents[1] / "docs" / "robots.csv"
HEAD = "robot,tip,joints,rms error in mm,why not\n"
SAMPLES = "2000"


def run(*arguments: str) -> tuple[int, str]:
    """Return the exit code of a command and what it prints on stderr."""
    printed, sys.argv = io.StringIO(), ["precision-pin", *arguments]
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(printed):
        try:
            precision_pin()
        except SystemExit as ended:
            return int(ended.code or 0), printed.getvalue()
    return 0, printed.getvalue()


def draft(name: str) -> tuple[int, str]:
    """Run ``init``, and what it proposes: to mend inertias, another tip."""
    code, printed = run("init", f"example:{name}", "--out", f"{name}.errors.yaml")
    mend = ["--mend-inertia"] if "--mend-inertia" in printed else []
    if mend:
        code, printed = run("init", f"example:{name}", "--out", f"{name}.errors.yaml", *mend)
    proposed = re.search(r"precision-pin (init \S+ --tip .+)", printed)
    if proposed is None:
        return code, printed
    return run(*shlex.split(proposed[1]), "--out", f"{name}.errors.yaml", "--force", *mend)


def row(name: str) -> str:
    """Return the row of a robot: of each command the first that ends with an error says why not."""
    sheet = f"{name}.errors.yaml"
    code, printed = draft(name)
    for command in (
        ("analyze", sheet, "--samples", SAMPLES, "--json", f"{name}.json"),
        ("budget", sheet, "--samples", "1024"),
        ("map", sheet, "--all-poses"),
    ):
        if code not in (0, 1):
            break
        code, printed = run(*command)
    if code not in (0, 1):
        error = next(line for line in printed.splitlines() if re.search(r": error |internal", line))
        return line(name, "", "", "", re.sub(r"^.*?: error ", "", error))
    result = json.loads(Path(f"{name}.json").read_text(encoding="utf-8"))
    position = result["position"]["norm"]
    rms = (position["mean"] ** 2 + position["std"] ** 2) ** 0.5
    joints = len(result["pose"]["q"])
    return line(name, result["tip"], joints, f"{1e3 * rms:.2g}", "")


def line(*cells: object) -> str:
    """Return a line of CSV."""
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerow(cells)
    return out.getvalue()


def main(names: Sequence[str]) -> None:
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        rows = []
        for name in names or example_urdfs():
            rows.append(row(name))
            print(rows[-1], end="", flush=True)
    if not names:
        TABLE.write_text(HEAD + "".join(rows), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
