"""Build the site once for all workers, beside the tests that need none: ``python -m support.site DOCS HOME``."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
LATER = re.compile(r"_build|\.ipynb_checkpoints|__pycache__")


def home_of(base: Path) -> Path:
    """Return the folder that all workers share, from the folder of temporary files of one."""
    return (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "site"


def begin(base: Path) -> subprocess.Popen[bytes] | None:
    """Return another process that builds the site; None if a worker has begun it already."""
    home = home_of(base)
    try:
        home.mkdir()
    except FileExistsError:
        return None
    words = [sys.executable, "-m", "support.site", str(home)]
    return subprocess.Popen(words, cwd=ROOT / "tests", stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def build(source: Path, target: Path) -> subprocess.CompletedProcess[str]:
    words = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", str(source), str(target)]
    return subprocess.run(words, capture_output=True, text=True, check=False)


def main(home: Path) -> None:
    shutil.copytree(ROOT / "examples", home / "examples")
    shutil.copytree(DOCS, home / "docs", ignore=lambda _, names: [name for name in names if LATER.search(name)])
    run = build(home / "docs", home / "html")
    made = home / "done.part"
    made.write_text(f"{run.returncode}\n{run.stderr}", encoding="utf-8")
    made.rename(home / "done")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
