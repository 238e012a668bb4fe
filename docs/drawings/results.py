"""The pictures of results on the pages, made by the commands that stand there: ``python -m docs.drawings.results``.

Names after it select figures (default: all). They are matplotlib's, whose bytes change from version to version, so no test
compares them.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from docs.drawings.canvas import IMAGES

PAGES: Final = IMAGES.parent
ROBOTS: Final = PAGES.parent / "src" / "precision_pin" / "robots"

PICTURES: Final = {
    "start-position.png": ("start.md", "analyze mine.errors.yaml --samples 20000", "position.png"),
    "allocation.png": ("allocate.md", "allocate cell.errors.yaml --pareto 5", "allocation.png"),
    "calibration.png": (
        "calibrate.md",
        'calibrate --forecast --point "50 30 20 mm" --random 30',
        "calibration-forecast.png",
    ),
    "calibration-fit.png": ("calibrate.md", "calibrate rehearsal.csv", "calibration.png"),
    "calibration-map.png": (
        "calibrate.md",
        'calibrate example:ur5 corner.csv --base-free --std "0.03 mm" --grid level.yaml',
        "calibration-map.png",
    ),
    "budget.png": ("budget.md", "budget --samples 2048", "budget.png"),
    "worst-case.png": ("worst-case.md", "worst-case", "worst-case.png"),
    "exact-law.png": ("exact-law.md", "exact-law", "exact-law.png"),
    "moments.png": ("moments.md", "moments", "moments.png"),
    "reliability.png": ("reliability.md", 'reliability --spec "x 18 mm @ 99.999 %"', "reliability.png"),
    "iso9283.png": ("iso9283.md", "iso9283 example:ur5 --cube --ignore-collisions", "iso9283.png"),
    "comparison.png": (
        "compare.md",
        'compare 4dof.errors.yaml --set "axis_install[joint1].radius=0.05 mm" --spec "40 mm @ 94 %"',
        "comparison.png",
    ),
    "compensation.png": ("compensate.md", "compensate 4dof.errors.yaml --grid swing.yaml", "compensation.png"),
    "analysis.png": ("analyze.md", "analyze", "position.png"),
    "map.png": ("map.md", "map example:ur5 --grid table.yaml --relative-to ready", "map-position.png"),
    "stiffness.png": ("stiffness.md", 'stiffness drill.errors.yaml --rated "300 N"', "stiffness.png"),
    "stiffness-map.png": (
        "stiffness.md",
        "stiffness drill.errors.yaml --grid plate.yaml --set statics=nominal --robots 200",
        "stiffness-map.png",
    ),
    "path.png": ("path.md", 'path 4dof.errors.yaml --grid swing.yaml --spec "75 mm @ 90 %"', "path.png"),
    "cheap-arm.png": (
        "cheap-arm.md",
        'analyze example:so101 --pose stretched --set "parameters.load={fixed: 300 g}" --samples 20000',
        "position.png",
    ),
    "cheap-arm-corrected.png": (
        "cheap-arm.md",
        'compensate example:so101 --all-poses --set "parameters.load={fixed: 300 g}"',
        "compensation.png",
    ),
    "your-arm-position.png": ("your-arm.md", "analyze mine.errors.yaml --samples 20000", "position.png"),
}
"""The page that holds the sheet, the command, and the picture to take, by the name of its file."""


def main(names: Sequence[str]) -> None:
    """Write these pictures."""
    paths = os.pathsep.join([str(PAGES.parent / "src"), os.environ.get("PYTHONPATH", "")])
    for name in names:
        page, command, picture = PICTURES[name]
        with tempfile.TemporaryDirectory() as folder:
            write_files(page, Path(folder))
            for line in (*earlier_commands(page, command), f"{command} --out out"):
                ended = subprocess.run(
                    [sys.executable, "-m", "precision_pin", *shlex.split(line)],
                    cwd=folder,
                    check=False,
                    stdout=subprocess.DEVNULL,
                    env=os.environ | {"PYTHONPATH": paths},
                ).returncode
                if ended > 1:  # 1: a specification is not met, which a page may show
                    raise SystemExit(f"{page}: {line}: exit code {ended}")
            shutil.copy(Path(folder) / "out" / picture, IMAGES / name)


def earlier_commands(page: str, command: str) -> list[str]:
    """Return the commands that stand before a command in its block and write the files that it reads."""
    text = (PAGES / page).read_text(encoding="utf-8")
    for block in re.findall(r"^```console\n(.*?)^```$", text, re.DOTALL | re.MULTILINE):
        lines = re.findall(r"^\$ precision-pin (.+)$", block, re.MULTILINE)
        if matches := [index for index, line in enumerate(lines) if line.startswith(command)]:
            return lines[: matches[0]]
    raise ValueError(f"{page} has no command {command}")


def write_files(page: str, folder: Path) -> None:
    """Write the files that stand on a page, with the paper's arm."""
    for path in ROBOTS.glob("4dof.*"):
        shutil.copy(path, folder)
    text = (PAGES / page).read_text(encoding="utf-8")
    for block, name in re.findall(
        r"^```(?:yaml|xml)\n((?:# |<!-- )file: (\S+).*?)^```$", text, re.DOTALL | re.MULTILINE
    ):
        (folder / name).write_text(block, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:] or list(PICTURES))
