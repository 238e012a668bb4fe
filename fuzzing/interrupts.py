"""Signals at random times over every command: each ends as it says, and leaves nothing half-written behind."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import final

import click

from precision_pin.robot.examples import PAPER_SHEET

__all__ = ["CASES", "Disturbed", "Usual", "disturb", "run_undisturbed"]

CASES = {
    "analyze": ("analyze", "--samples", "400000", "--spec", "10 mm @ 10 %"),
    "analyze, threads": ("analyze", "--samples", "400000", "--threads", "2", "--json", "result.json"),
    "analyze, processes": ("analyze", "--samples", "2000000", "--processes", "2", "--json", "result.json"),
    "analyze, out": ("analyze", "--samples", "20000", "--json", "result.json", "--out", "new/plots"),
    "analyze, journal": (
        "analyze", "--samples", "4000000", "--threads", "2", "--journal", "run.journal", "--json", "result.json",
    ),
    "budget": ("budget", "--samples", "4096", "--json", "result.json", "--out", "plots"),
    "worst-case": ("worst-case", "--json", "result.json", "--out", "plots"),
    "exact-law": ("exact-law", "--json", "result.json", "--out", "plots"),
    "analyze, poses": ("analyze", "--q", "0 0 0 0 deg", "--q", "0 10 20 30 deg", "--samples", "100000", "--json", "result.json"),
    "path": ("path", "--q", "0 0 0 0 deg", "--q", "0 10 20 30 deg", "--json", "result.json", "--out", "plots"),
    "compare": ("compare", "4dof.errors.yaml", "--set", "gravity=none", "--json", "result.json"),
    "iso9283": ("iso9283", "--q", "0 0 0 0 deg", "--q", "0 10 20 30 deg", "--robots", "500", "--json", "result.json"),
    "reliability": ("reliability", "--spec", "1 nm @ 99 %", "--samples", "20000", "--json", "result.json"),
    "view": ("view", "--samples", "500", "--out", "view.html"),
    "report": ("report", "--samples", "20000", "--out", "report.html"),
    "export": ("export", "--units", "300", "--out", "units"),
    "init": ("init", "4dof.urdf", "--out", "new.errors.yaml"),
    "check": ("check", "4dof.errors.yaml"),
    "mcpc": ("mcpc",),
    "schema": ("schema",),
    "doctor": ("doctor",),
}  # fmt: skip
"""Command lines; what stands behind the comma of a name tells those of one command apart."""

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
LONGEST = 120.0
"""Seconds after which a run hangs."""


@final
@dataclass(frozen=True)
class Usual:
    """What a command does undisturbed."""

    code: int
    out: bytes
    files: dict[str, bytes]
    seconds: float


@final
@dataclass
class Disturbed:
    """What became of a command that a signal came to."""

    case: str
    number: signal.Signals
    after: float
    code: int
    early: bool = False
    wrong: list[str] = field(default_factory=list)


def _heed_signals() -> None:
    # nohup, or a shell that starts the attack in the background, has some of them ignored
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)


def _begin(arguments: tuple[str, ...], folder: Path) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "precision_pin", *arguments],
        cwd=folder,
        preexec_fn=_heed_signals,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def _inputs(folder: Path) -> None:
    for file in PAPER_SHEET.parent.glob("4dof.*"):
        shutil.copy(file, folder)


def _listing(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def _session(leader: int) -> list[int]:
    """Return the processes of a session that still run."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            fields = entry.read_text().rpartition(")")[2].split()
            if int(fields[3]) == leader and fields[0] != "Z":
                found.append(int(entry.parent.name))
    return found


def run_undisturbed(arguments: tuple[str, ...]) -> Usual:
    """Run a command to its end in a folder of its own."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _inputs(folder)
        begun = time.monotonic()
        process = _begin(arguments, folder)
        out, _ = process.communicate(timeout=LONGEST)
        return Usual(process.returncode, out, _listing(folder), time.monotonic() - begun)


def disturb(case: str, usual: Usual, number: signal.Signals, after: float, *, whole_group: bool) -> Disturbed:
    """Send a signal to a command, or to all its processes as a terminal does, and look what became of it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _inputs(folder)
        before = _listing(folder)
        process = _begin(CASES[case], folder)
        with suppress(subprocess.TimeoutExpired):
            process.wait(after)  # its output is less than a pipe holds
        with suppress(ProcessLookupError):
            (os.killpg if whole_group else os.kill)(process.pid, number)
        found = Disturbed(case, number, after, 0)
        try:
            out, err = process.communicate(timeout=LONGEST)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            out, err = process.communicate()
            found.wrong.append("hangs")
        found.code = process.returncode
        _look(found, usual, before, folder, out, err.decode("utf-8", "replace"))
        time.sleep(0.1)
        if _session(process.pid):
            time.sleep(2.0)
            if _session(process.pid):
                found.wrong.append(f"processes left: {_session(process.pid)}")
                os.killpg(process.pid, signal.SIGKILL)
        if "journal" in case and (folder / "run.journal").is_file():
            _resume(found, usual, folder)
        return found


def _look(found: Disturbed, usual: Usual, before: dict[str, bytes], folder: Path, out: bytes, err: str) -> None:
    """Add what is wrong with the exit code, the messages and the files."""
    files = _listing(folder)
    journal = files.pop("run.journal", None)
    expected = {name: data for name, data in usual.files.items() if name != "run.journal"}
    complete = files == expected and out == usual.out and (journal is not None or "journal" not in found.case)
    # what comes before the program's first line meets Python's own handlers
    found.early = found.code in (-found.number, 1) and files == before and not out and "in main\n" not in err
    if found.early and (found.code == -found.number or "KeyboardInterrupt" in err):
        return
    found.early = False
    if found.code not in (128 + found.number, usual.code):
        found.wrong.append(f"exit code {found.code}")
    if found.code == usual.code and not complete:
        found.wrong.append(f"exit code {found.code}, but not all is written")
    if "Traceback" in err or "Exception ignored" in err:
        found.wrong.append(f"traceback: {err[-300:]!r}")
    left = [name for name in files if ".part" in name or ".precision-pin" in name]
    found.wrong += [f"{left[0]} is left, and {len(left) - 1} more"] if left else []
    found.wrong += [f"{name} is not whole" for name, data in files.items() if expected.get(name, data) != data]
    for parent in {Path(name).parent for name in expected} - {Path()}:
        there = [name for name in expected if Path(name).parent == parent and name in files]
        if there and len(there) < sum(Path(name).parent == parent for name in expected):
            found.wrong.append(f"{parent} holds only {there}")
    if found.code != usual.code and any(path.is_dir() and not any(path.iterdir()) for path in folder.rglob("*")):
        found.wrong.append("an empty folder is left")


def _resume(found: Disturbed, usual: Usual, folder: Path) -> None:
    process = _begin((*CASES[found.case], "--resume"), folder)
    out, _ = process.communicate(timeout=LONGEST)
    files = _listing(folder)
    if process.returncode != usual.code or out != usual.out or files["result.json"] != usual.files["result.json"]:
        found.wrong.append(f"resumed to something else, exit code {process.returncode}")


@click.command("interrupts")
@click.option("--count", default=200, show_default=True, metavar="N", help="How many signals.")
@click.option("--seed", default=0, show_default=True, metavar="S")
@click.option("--only", metavar="TEXT", default="", help="Only the cases whose name holds this.")
def command(count: int, seed: int, only: str) -> None:
    """Send signals to every command at random times, from before its start to after its end."""
    usual = {}
    for case in (case for case in CASES if only in case):
        run_undisturbed(CASES[case])  # compiles and caches
        first, second = run_undisturbed(CASES[case]), run_undisturbed(CASES[case])
        usual[case] = min(first, second, key=lambda run: run.seconds)
        names = [name for name in first.files if first.files[name] != second.files.get(name) and name != "run.journal"]
        if names or first.out != second.out:
            raise click.ClickException(f"{case}: two undisturbed runs differ in {names or 'stdout'}")
        click.echo(f"{case}: exit code {usual[case].code} after {usual[case].seconds:.1f} s")
    random_numbers = random.Random(seed)
    codes: dict[str, Counter[str]] = {case: Counter() for case in usual}
    failures, latest = 0, 0.0
    for trial in range(count):
        case = list(usual)[trial % len(usual)]
        number = random_numbers.choice((signal.SIGINT, signal.SIGTERM, *SIGNALS))
        after = random_numbers.uniform(0.0, usual[case].seconds)
        found = disturb(case, usual[case], number, after, whole_group=random_numbers.random() < 0.3)
        latest = max(latest, after) if found.early else latest
        codes[case][f"{found.number.name} {'before the first line' if found.early else found.code}"] += 1
        for wrong in found.wrong:
            failures += 1
            click.echo(f"trial {trial}, {case}, {number.name} after {after:.3f} s: {wrong}")
    for case, counted in codes.items():
        click.echo(f"{case}: " + ", ".join(f"{what}: {times}" for what, times in sorted(counted.items())))
    click.echo(f"the latest before the first line: after {latest:.3f} s")
    click.echo(f"{count} signals, {failures} failures")
    sys.exit(1 if failures else 0)
