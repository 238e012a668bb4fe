"""The pictures of results on the pages, made by the commands that stand there: ``python -m docs.drawings.results``.

They are matplotlib's, whose bytes change from version to version, so no test compares them.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
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
    "map.png": ("map.md", "map example:ur5 --grid table.yaml --relative-to ready", "position.png"),
    "path.png": ("path.md", 'path 4dof.errors.yaml --grid swing.yaml --spec "75 mm @ 90 %"', "path.png"),
    "your-arm-position.png": ("your-arm.md", "analyze mine.errors.yaml --samples 20000", "position.png"),
}
"""The page that holds the sheet, the command, and the picture to take, by the name of its file."""


def main() -> None:
    """Write every picture."""
    for name, (page, command, picture) in PICTURES.items():
        with tempfile.TemporaryDirectory() as folder:
            write_files(page, Path(folder))
            words = [sys.executable, "-m", "precision_pin", *shlex.split(command), "--out", "out"]
            paths = os.pathsep.join([str(PAGES.parent / "src"), os.environ.get("PYTHONPATH", "")])
            subprocess.run(
                words, cwd=folder, check=True, stdout=subprocess.DEVNULL, env=os.environ | {"PYTHONPATH": paths}
            )
            shutil.copy(Path(folder) / "out" / picture, IMAGES / name)


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
    main()
