"""``python -m fuzzing commands``: every command, every kind of file, every number at its limits."""

from __future__ import annotations

import cmath
import gzip
import json
import math
import multiprocessing
import os
import random
import re
import resource
import shlex
import shutil
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NoReturn, final

import click

from fuzzing.errorsheets.grammar import FILES, SHIPPED
from precision_pin.cli.program import cli, run

__all__ = ["Ran", "command", "line_of", "run_line", "write_inputs"]

LONGEST = 40.0
"""Seconds of processor time after which a line hangs; in waiting it may take ten times that."""
MEMORY = 24 << 30
"""Bytes of address space of a process; below 8 GB every error is taken for one of memory."""
LINES_OF_A_PROCESS = 400

SLIDES = """precision-pin: 1
robot: slides.urdf
tip: hand
poses:
  home: {lift: 0.1 m, swing: 10 deg, reach: 0.2 m}
  out: {lift: 0.9 m, swing: -60 deg, reach: 0.9 m}
parameters: {gap: {normal: 0.1 mm}}
sources:
  - joint_offset: {joint: lift, offset: {uniform: 0.1 mm}}
  - joint_offset: {joint: swing, offset: {normal: 0.3 mrad, scope: visit}}
  - length: {joint: swing, along: x of swing, parameters: [gap]}
  - payload: {at: hand, mass: 1 kg}
measurement: {kind: position, std: 0.02 mm, target: 50 30 20 mm}
allocate:
  specs: [3 mm @ 95 %]
  tolerances: [{path: parameters.gap.normal, cost: {reciprocal: 1 mm}}]
"""
FACTORY = "[mounting]\n" + "".join(
    f"delta_{name} = [ 2.0775e-05, 0.0001, -0.0002, 0.0001, 5.6611e-05, -7.4631e-05]\n"
    for name in ("theta", "a", "d", "alpha")
)
WAY = "time [s], lift [m], swing [deg], reach [mm]\n0, 0.1, 0, 100\n0.5, 0.2, 10, 200\n2, 0.3, 90, 900\n"
INPUTS = {
    **FILES,
    "slides.errors.yaml": SLIDES,
    "way.csv": WAY,
    "paper.csv": "joint1 [deg],joint2 [deg],joint3 [rad],joint4 [deg]\n-90, 0, 1.5, -90\n0, 9, 1.5, -30\n",
    "joints.yaml": "joints: {lift: {from: 0 m, to: 1 m, count: 3}, swing: 0 30 deg, reach: [0.1 m, 20 cm]}\n",
    "places.yaml": "box: {x: {from: 0.5 m, to: 1 m, count: 2}, y: 300 mm, z: 600 mm}\norientations: any\n",
    "random.yaml": "random: {count: 4, seed: 1}\n",
    "read.csv": "lift [m], swing [deg], reach [mm], x [mm], y [mm], z [mm]\n"
    + "".join(
        f"0.{k}, {9 * k}, {100 * k}, {at.real + 0.1 * k:.3f}, {at.imag:.3f}, {440 + 100 * k}\n"
        for k in range(1, 9)
        for at in [cmath.rect(1.0, math.radians(9 * k)) * complex(650 + 100 * k, 30)]
    ),
    "cycles.csv": "pose, cycle, x [mm], y [mm], z [mm]\n"
    + "".join(f"{pose}, {k}, 80{k}, {k}.5, 500\n" for pose in ("home", "out") for k in range(1, 5)),
    "calibration.conf": FACTORY,
    "empty.yaml": "",
    "page.html": "<html></html>",
}
"""Files that are there besides those that commands write."""
WRITTEN = (
    "analyze slides.errors.yaml --samples 200000 --journal run.journal --json analyze.json",
    "budget slides.errors.yaml --samples 1024 --json budget.json",
    "map slides.errors.yaml --grid joints.yaml --samples 500 --json map.json --netcdf map.nc",
    "calibrate slides.errors.yaml read.csv --json calibrate.json --urdf calibrated.urdf",
    "exact-law slides.errors.yaml --samples 10000 --out plots",
)

LIMITS = ("0", "-0", "1", "-1", "2", "1e308", "-1e308", "1.8e308", "1e-308", "1e-320", "nan", "inf", "-inf", "1e16", "1e-16",
          "9223372036854775807", "9223372036854775808", "18446744073709551616", "-9223372036854775808", "1e400", "9" * 400,
          "1e9", "1e-9", "1e150", "0x10", "1_0", "٣", "½", "0,5", "1e", ".", "--", "")  # fmt: skip
COUNTS = tuple(text for text in LIMITS if text != "1e9")
TEXTS = ("", " ", "\t", "\n", "a\nb", "ü", "腕", "\u202e", "\udcff", "a" * 5000, "%s%n", "../..", "/", "/dev/null", "/dev/full",
         "/proc/self/mem", "-", "--", "null", "[", "{", "a: b: c", "'", '"', ";", "*", "joint_offset[*].offset=1e308 mrad",
         "precision-pin", "position.norm", "home", "swing", "hand", "E_USAGE")  # fmt: skip
UNITS = ("mm", "m", "deg", "rad", "kg", "s", "%", "N", "nm", "m^2", "µm", "lightyear", "°", "")
VALID = {
    "NAME": ("home", "out"),
    "VALUES": ("lift: 0.2 m, swing: 1 rad, reach: 20 cm", "lift: 0.1 m, swing: 5 deg, reach: 0 m"),
    '"0.1 s"': ("0.5 s", "20 deg", "100 mm"),
    "DIRECTIONS": ("lift +, swing -", "swing +, reach -"),
    '"X Y Z mm"': ("10 20 30 mm", "0 0 0.1 m"),
    "FRAME": ("hand",),
    "LINK": ("floor",),
    "PATH=VALUE": ("parameters.gap.normal=0.2 mm", "joint_offset[lift].offset=1 mm", "payload.mass=2 kg",
                   "statics=equilibrium", "parameters.gap={lognormal: 0.1 mm, mean: 1 mm}", "joint_offset[lift].offset=±1 mm",
                   "payload[*].mass={uniform: 1 kg, mean: 2 kg}"),
    '"0.5 mm @ 99.73 %"': ("0.5 mm @ 99.73 %", "1 mm @ 50 %", "1 mrad @ 95 %", "x 1 mm @ 99 %", "37 mm"),
    '"RP 0.1 mm @ 95 %"': ("RP 0.1 mm @ 95 %", "AP 1 mm", "E 20 mm @ 50 %"),
    '"95 % to 0.01 mm"': ("95 % to 1 mm", "mean to 1 mm"),
    '"99.73 %"': ("95 %", "99.73 %"),
    '"M kg"': ("2 kg",),
    '"X Y Z RX RY RZ"': ("1 1 1 0 0 0", "1 1 1 1 m/rad 1 1"),
    "ANGLE": ("0.1 mrad", "1 deg"),
    "POSE": ("home", "lift: 0.2 m, swing: 1 rad, reach: 20 cm"),
    "QUANTITY": ("position.norm", "position.x", "rotation.norm"),
    "ADDRESS": ("tcp://127.0.0.1:1",),
    "CODE": ("E_USAGE", "W_UNITS"),
    "DIR": ("new", "plots", "."),
}  # fmt: skip
"""Values that are right, by an option's metavar; an option with another one gets those of all kinds."""
SMALL = {
    "--samples": "1024", "--robots": "20", "--cycles": "3", "--seconds": "0.3", "--units": "2", "--verify": "1",
    "--random": "20", "--pareto": "2", "--plan": "4", "--seed": "3", "--threads": "2",
}  # fmt: skip
"""Numbers that keep a line short; those above the line are given wherever the option is not attacked."""
ALWAYS = ("--samples", "--robots", "--seconds")
RARELY = ("--dask", "--processes", "--out", "--pareto")
"""Options that take seconds: processes, figures, searches."""
SELDOM = ("schema", "doctor", "report")
"""Commands without much to attack, or that take seconds."""
POSES = ("--pose", "--q", "--all-poses", "--trajectory", "--grid")
"""Options of which a line takes one."""


@final
@dataclass(frozen=True)
class Ran:
    """What became of a line."""

    number: int
    line: str
    code: int | None = None
    seconds: float = 0.0
    problems: list[str] = field(default_factory=list)


@click.command("commands")
@click.argument("files", nargs=-1, type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--count", default=1000, show_default=True, metavar="N", help="How many command lines.")
@click.option("--seed", default=0, show_default=True, metavar="S", help="Which ones.")
@click.option("--start", default=0, show_default=True, metavar="K", help="Number of the first.")
@click.option("--workers", default=2, show_default=True, metavar="N", help="How many processes.")
def command(files: Sequence[Path], count: int, seed: int, start: int, workers: int) -> None:
    """Run command lines at random: every command with its own options, at the limits of what they take.

    Each must end with exit code 0 to 2, without a traceback or a warning of a library, in 40 s of processor time;
    what is wrong is said in lines that name an error; JSON is valid; nothing unfinished is left. Given FILES are attacked
    beside the built-in ones.
    """
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        inputs = Path(name) / "inputs"
        inputs.mkdir()
        write_inputs(inputs)
        for file in files:
            shutil.copy(file, inputs)
        parts = [range(start + part, start + count, workers) for part in range(workers)]
        with ThreadPoolExecutor(workers) as pool:
            lists = pool.map(lambda part: list(_watched(seed, part, inputs)), parts)
        found = sorted((ran for one in lists for ran in one), key=lambda ran: ran.number)
    codes = Counter(str(ran.code) for ran in found)
    bad = [ran for ran in found if ran.problems]
    for what, times in Counter(problem for ran in bad for problem in ran.problems).most_common():
        click.echo(f"{times:5d}  {what}")
    slowest = max(found, key=lambda ran: ran.seconds)
    click.echo(f"the longest: {slowest.seconds:.1f} s, line {slowest.number}: {slowest.line[:300]}")
    click.echo(f"{len(found):,} lines of seed {seed} in {time.monotonic() - began:.0f} s; exit codes {dict(codes)}")
    click.echo(f"{len(bad)} did not hold")
    sys.exit(1 if bad else 0)


def _watched(seed: int, numbers: Sequence[int], inputs: Path) -> Iterator[Ran]:
    """Run lines in processes that are replaced when they hang, die or have run many."""
    context = multiprocessing.get_context("spawn")
    process: Any = None
    for done, number in enumerate(numbers):
        if process is None or done % LINES_OF_A_PROCESS == 0:
            if process is not None:
                process.kill()
            pipe, theirs = context.Pipe()
            process = context.Process(target=_work, args=(theirs, seed, inputs), daemon=False)
            process.start()
            theirs.close()
        try:
            pipe.send(number)
            line = pipe.recv()
            ran = pipe.recv() if _answers(pipe, process.pid) else Ran(number, line, None, LONGEST, ["hangs"])
        except (EOFError, ConnectionError):
            process.join()
            ran = Ran(number, line, None, 0.0, [f"the process died with {process.exitcode}"])
        if ran.code is None:
            process.kill()
            process = None
        for problem in ran.problems:
            click.echo(f"line {number} of seed {seed}: {problem}\n    {ran.line[:1000]}")
        if done % 500 == 499:
            click.echo(f"{done + 1:,} lines of a process", err=True)
        yield ran
    if process is not None:
        process.kill()


def _answers(pipe: Connection, process: int) -> bool:
    """Return whether a process answers within the time of a line."""
    used = _processor_time(process)
    for _ in range(round(10 * LONGEST)):
        if pipe.poll(1.0):
            return True
        if _processor_time(process) - used > LONGEST:
            return False
    return False


def _processor_time(process: int) -> float:
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _work(pipe: Connection, seed: int, inputs: Path) -> None:
    """Run the lines whose numbers come through a pipe, in a folder of this process."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(inputs, folder, dirs_exist_ok=True)
        os.chdir(folder)
        _catch_streams(folder)
        while True:
            number = pipe.recv()
            arguments = line_of(seed, number, folder)
            pipe.send(shlex.join(arguments).encode("utf-8", "backslashreplace").decode())
            pipe.send(run_line(number, arguments, folder))
            _restore(inputs, folder)


def _catch_streams(folder: Path) -> None:
    """Lead what this process prints, its libraries in C too, into two files beside the folder."""
    os.environ["MPLBACKEND"] = "agg"
    for stream in (1, 2):
        os.dup2(os.open(f"{folder}.{stream}", os.O_RDWR | os.O_CREAT | os.O_APPEND), stream)


def run_line(number: int, arguments: Sequence[str], folder: Path) -> Ran:
    """Run a line in this process, whose streams are caught, and look at what it did."""
    import precision_pin.cli.view

    precision_pin.cli.view.raise_if_interrupted = _stop_serving  # type: ignore[attr-defined]
    for stream in (1, 2):
        os.truncate(f"{folder}.{stream}", 0)
    sys.argv = ["precision-pin", *arguments]
    before = set(folder.rglob("*"))
    began, line, problems = time.monotonic(), shlex.join(arguments), []
    code = None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("always", RuntimeWarning)
            code = run()
    except BaseException as error:  # noqa: BLE001 - nothing may come out
        problems.append(f"raises {type(error).__name__}: {error}")
    seconds = time.monotonic() - began
    for each in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            each.flush()
    out, err = (Path(f"{folder}.{stream}").read_text("utf-8", "replace") for stream in (1, 2))
    if code not in (0, 1, 2):
        problems.append(f"exit code {code}: {_last_frames(err)}")
    elif "Traceback" in err + out or "Exception ignored" in err:
        problems.append(f"traceback: {_last_frames(err)}")
    elif re.search(r"\w+Warning: ", err):
        problems.append(f"a library warns: {' '.join(err.partition('Warning: ')[0].split()[-3:])} {err[-200:]!r}")
    elif code == 2 and not re.search(r"error|cannot|: ", err + out):
        problems.append(f"exit code 2 without an error: {err[-200:]!r}")
    new = [path for path in folder.rglob("*") if path not in before]
    problems += [f"{path.name} is left" for path in new if ".part" in path.name][:1]
    texts = [path.read_bytes() for path in new if path.suffix == ".json" and path.is_file()]
    for text in [out.encode()] * (code in (0, 1)) + texts:
        try:
            if text[:1] in (b"{", b"["):
                json.loads(text, parse_constant=_refuse)
        except ValueError as error:
            problems.append(f"invalid JSON: {error}")
    return Ran(number, line, code, seconds, problems)


def _stop_serving() -> NoReturn:
    raise KeyboardInterrupt


def _refuse(text: str) -> NoReturn:
    raise ValueError(text)


def _last_frames(err: str) -> str:
    """Return the last frame and the last line of a traceback."""
    frames = re.findall(r'File "[^"]*?([^"/]+/[^"/]+)", line (\d+)', err)
    last = err.strip().splitlines()[-1:] or [""]
    return f"{':'.join(frames[-1]) if frames else ''} {last[0][:200]}"


def _restore(inputs: Path, folder: Path) -> None:
    """Bring the folder back to what it was."""
    known = {path.relative_to(inputs): path for path in inputs.rglob("*")}
    for path in sorted(folder.rglob("*"), reverse=True):
        if path.relative_to(folder) not in known:
            path.rmdir() if path.is_dir() and not path.is_symlink() else path.unlink()
    for name, original in known.items():
        there, here = original.stat(), folder / name
        if original.is_dir():
            here.mkdir(exist_ok=True)
        elif not here.is_file() or (here.stat().st_size, here.stat().st_mtime_ns) != (there.st_size, there.st_mtime_ns):
            shutil.copy2(original, here)


def write_inputs(folder: Path) -> None:
    """Write a file of each kind."""
    for name, text in INPUTS.items():
        (folder / name).write_text(text, encoding="utf-8")
    for file in SHIPPED.glob("4dof.*"):
        shutil.copy(file, folder)
    (folder / "packed.urdf").write_bytes(gzip.compress((folder / "4dof.urdf").read_bytes()))
    (folder / "folder.yaml").mkdir()
    here, argv = Path.cwd(), sys.argv
    os.chdir(folder)
    try:
        for line in WRITTEN:
            sys.argv = ["precision-pin", *shlex.split(line)]
            with open(os.devnull, "w") as null, redirect_stdout(null), redirect_stderr(null):
                code = cli.main(sys.argv[1:], standalone_mode=False)
            if code not in (0, 1, None):
                raise click.ClickException(f"{line}: exit code {code}")
    finally:
        os.chdir(here)
        sys.argv = argv


def line_of(seed: int, number: int, folder: Path) -> list[str]:
    """Return the arguments of a line; may write a changed file into the folder."""
    return _Line(random.Random(f"{seed}/{number}"), folder).arguments()


@final
class _Line:
    """One command line, made of what the command declares."""

    def __init__(self, chance: random.Random, folder: Path) -> None:
        self._chance, self._folder = chance, folder
        self._names = sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))

    def arguments(self) -> list[str]:
        chance, context = self._chance, click.Context(cli)
        names = [name for name in cli.list_commands(context) for _ in range(1 if name in SELDOM else 8)]
        name = chance.choice(names)
        declared = cli.get_command(context, name)
        assert declared is not None
        options = [one for one in declared.params if isinstance(one, click.Option)]
        positional = [one for one in declared.params if isinstance(one, click.Argument)]
        # most values are right and let the line come far
        chosen = [one for one in options if chance.random() < (0.02 if one.opts[0] in RARELY else 0.06)]
        poses = [one for one in chosen if one.opts[0] in POSES]
        chosen = [one for one in chosen if one not in poses[1:] or chance.random() < 0.1]
        line = [name]
        for one in positional:
            line += self._inputs(str(one.metavar), name)
        for one in options:
            for _ in range(chance.choice((1, 1, 1, 2)) if one.multiple and one in chosen else one in chosen):
                line += self._option(one)
            if one not in chosen and (one.required or one.opts[0] in ALWAYS):
                line += self._option(one) if one.required else [one.opts[0], SMALL[one.opts[0]]]
        if name == "view" and "--out" not in line:
            line += ["--no-browser"] if chance.random() < 0.3 else ["--out", "view.html"]
        if name == "calibrate" and not {"--random", *POSES} & set(line) and {"--forecast", "--plan"} & set(line):
            line += ["--random", "20"]
        if name in ("report", "export", "init") and "--out" not in line:
            line += ["--out", "new.html" if name == "report" else "new"]
        if name in ("map", "path", "iso9283", "compensate") and not poses:
            line += chance.choice((["--all-poses"], ["--trajectory", "way.csv"], ["--grid", "joints.yaml"]))
        return line

    def _option(self, option: click.Option) -> list[str]:
        flag = self._chance.choice([*option.opts, *option.secondary_opts])
        if option.is_flag:
            return [flag]
        value = self._value(option)
        return [f"{flag}={value}"] if value.startswith("-") or self._chance.random() < 0.2 else [flag, value]

    def _value(self, option: click.Option) -> str:
        chance, metavar = self._chance, str(option.metavar)
        attacked = chance.random() < 0.25
        if isinstance(option.type, click.Choice):
            return chance.choice(TEXTS if attacked else tuple(map(str, option.type.choices)))
        if option.type in (click.INT, click.FLOAT):
            if attacked:
                return chance.choice(COUNTS if option.type is click.INT else LIMITS)
            return SMALL.get(option.opts[0], chance.choice(("1", "2", "5")))
        if metavar == "DIR" and option.opts[0] == "--out" and chance.random() < 0.7:
            return "new"
        if "FILE" in metavar or re.search(r"[A-Z]\.\w", metavar):
            return self._file(metavar)
        known = VALID.get(metavar, tuple(value for values in VALID.values() for value in values))
        if not attacked:
            return chance.choice(known)
        return self._damaged(chance.choice(known)) if chance.random() < 0.7 else chance.choice(TEXTS)

    def _inputs(self, metavar: str, name: str) -> list[str]:
        chance = self._chance
        if "CODE" in metavar:
            return [chance.choice((*VALID["CODE"], *TEXTS))]
        sheet = "slides.errors.yaml"
        kind = chance.random()
        found = [sheet if kind < 0.45 else self._changed(sheet) if kind < 0.75 else self._file(metavar)]
        if name == "init":
            return [chance.choice(("slides.urdf", "4dof.urdf", self._file(".urdf")))]
        if "[B.yaml" in metavar:
            found.append(chance.choice((sheet, "4dof.errors.yaml", self._file(".yaml"))))
        if chance.random() < 0.1:
            found.insert(0, self._file(".urdf"))
        if name == "calibrate":
            several = ["--population", "read.csv", "read.csv"]
            modes = (["read.csv"], [self._changed("read.csv")], ["--forecast"], ["--plan", "4"], several)
            found += chance.choice((*modes, [self._file(".csv")]))
        return found

    def _file(self, metavar: str) -> str:
        """Return the name of a file: one of the kind, one whose numbers are at their limits, or any."""
        chance = self._chance
        suffixes = re.findall(r"\.\w+", metavar) or [Path(name).suffix for name in self._names]
        fitting = [name for name in self._names if name.endswith(tuple(suffixes))] or self._names
        if chance.random() < 0.15:
            return chance.choice(("new", "new.json", "new.csv", "new.html", "new.yaml", "-", *TEXTS))
        name = chance.choice(fitting if chance.random() < 0.9 else self._names)
        path = self._folder / name
        is_left = chance.random() < 0.4 or path.is_dir() or path.stat().st_size > 1 << 20
        return name if is_left else self._changed(name)

    def _changed(self, name: str) -> str:
        """Return the name of a copy of a file with some of its numbers, units or words changed."""
        changed = Path("changed").with_suffix("".join(Path(name).suffixes) or ".txt")
        text = (self._folder / name).read_bytes().decode("utf-8", "surrogateescape")
        for _ in range(self._chance.choice((1, 1, 2, 5))):
            text = self._damaged(text)
        (self._folder / changed).write_bytes(text.encode("utf-8", "surrogateescape"))
        return str(changed)

    def _damaged(self, text: str) -> str:
        """Return a text with a number at a limit, in another unit, or a word in place of another."""
        chance = self._chance
        numbers = list(re.finditer(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?", text))
        units = list(re.finditer(r"\b(?:mm|mrad|rad|deg|kg|m|s|%)\b|%", text))
        words = list(re.finditer(r"[a-zA-Z_]\w*", text))
        kind = chance.random()
        places, values = (numbers, LIMITS) if kind < 0.7 else (units, UNITS) if kind < 0.85 else (words, TEXTS[:16])
        if not places:
            return text + chance.choice(LIMITS)
        place = chance.choice(places)
        return text[: place.start()] + chance.choice(values) + text[place.end() :]
