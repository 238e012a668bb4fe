"""Whole journeys through the command line, each in an empty folder, from what ``init`` writes."""

import contextlib
import io
import sys
from pathlib import Path
from typing import Any

import pytest

from cli.conftest import Outcome, undrawn_figures  # noqa: F401  (a fixture for all of these tests)
from journeys.arms import ARMS
from precision_pin.cli import main


class Desk:
    """A user's folder, which is the working folder, and command line."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def run(self, *arguments: object, code: int | tuple[int, ...] = 0) -> Outcome:
        """Run a command that must end with an exit code, or one of several."""
        out, err = io.StringIO(), io.StringIO()
        with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            patch.setattr(sys, "argv", ["precision-pin", *map(str, arguments)])
            with pytest.raises(SystemExit) as ended:
                main()
        found = Outcome(int(ended.value.code or 0), out.getvalue(), err.getvalue())
        assert found.code in (code if isinstance(code, tuple) else (code,)), (arguments, found.code, found.err[-2000:])
        return found

    def json(self, *arguments: object, code: int | tuple[int, ...] = 0) -> Any:
        """Run a command for its JSON."""
        return self.run(*arguments, "--json", "-", code=code).json

    def begin(self, arm: str) -> str:
        """Bring an arm and let ``init`` write its sheet; return its name."""
        (self.folder / f"{arm}.urdf").write_text(ARMS[arm])
        self.run("init", f"{arm}.urdf", "--tip", "tool")
        return f"{arm}.errors.yaml"

    def edit(self, sheet: str, *lines: str) -> None:
        """Add lines at the end of a sheet: sources, then keys of their own."""
        path = self.folder / sheet
        path.write_text(path.read_text().rstrip("\n") + "\n" + "\n".join(lines) + "\n")


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Desk:
    """Return an empty folder with a command line."""
    monkeypatch.chdir(tmp_path)
    return Desk(tmp_path)
