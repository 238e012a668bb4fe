"""Every file that one command writes, read by every command that takes such a file: one arm, whose files are written once."""

import os
import re
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from journeys.arms import READERS, codes
from journeys.conftest import Desk
from precision_pin.cli.program import cli, list_commands
from precision_pin.render.text_table import width

OUTPUT = "Output and messages"
SHEET, SHORT = "scara.errors.yaml", "short.errors.yaml"
MORE_LINES = """\
  - joint_offset: {joint: wrist, offset: {uniform: 0.01 mrad, scope: pose}}
allocate:
  specs: [0.7 mm @ 95 %]
  poses: [start]
  tolerances:
    - {path: 'axis_install[shoulder].radius', cost: {reciprocal: 1 mm}}
    - {path: 'length[elbow].parameters.uniform', cost: {reciprocal: 1 mm}}
measurement: {kind: position, std: 0.02 mm, target: 50 30 20 mm}
"""


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    """Write a file of every kind."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("pairs")
        patch.chdir(folder)
        desk = Desk(folder)
        desk.begin("scara")
        desk.edit(SHEET, MORE_LINES)
        # the axes and lengths of two joints: what a tolerance more costs grows with their number
        Path(SHORT).write_text(
            re.sub(r"  - (axis_install|length): {joint: (quill|wrist),.*\n", "", Path(SHEET).read_text())
        )
        desk.run("allocate", SHORT, "--out", "chosen")
        desk.run("calibrate", SHORT, "--plan", 6, "--random", 12, "--csv", "visited.csv")
        desk.run("calibrate", SHORT, "--plan", 2, "--random", 4, "--csv", "plan.csv")
        for unit in range(3):
            desk.run("simulate", SHORT, "--trajectory", "visited.csv", "--unit", unit, "--out", f"readings{unit}.csv")
        files = ("--sheet", "mine.errors.yaml", "--urdf", "mine.urdf")
        desk.run("calibrate", SHORT, "readings0.csv", *files)
        robots = ("mine.calibration.json", "readings1.csv", "readings2.csv")
        desk.run("calibrate", SHORT, "--population", *robots, "--sheet", "shop.errors.yaml")
        desk.run("simulate", SHORT, "--all-poses", "--cycles", 3, "--out", "cycles.csv")
        desk.run("export", SHORT, "--out", "robots")
        for name, robot in (("mine", "mine.urdf"), ("built", ROBOTS["export"])):
            sheet = Path(SHORT).read_text().replace("robot: scara.urdf", f"robot: {robot}")
            Path(f"of_{name}.errors.yaml").write_text(sheet)
        desk.run("compensate", SHORT, "--trajectory", "plan.csv", "--csv", "corrected.csv", code=(0, 1))
        for name in PATHS.values():
            lines = Path(name).read_text().splitlines(keepends=True)
            head = next(k for k, line in enumerate(lines) if line[:1] != "#")
            Path(f"one.{name}").write_text("".join(lines[: head + 2]))
        yield desk


SHEETS = {
    "allocate --out": "chosen/allocated.errors.yaml",
    "calibrate --population --sheet": "shop.errors.yaml",
    "calibrate --sheet": "mine.errors.yaml",
}
"""Beside that of ``init``, which every command reads for the screen of 24 rows."""
ROBOTS = {"export": "robots/scara.unit0000.urdf", "calibrate --urdf": "mine.urdf"}
PATHS = {"calibrate --plan --csv": "plan.csv", "compensate --csv": "corrected.csv"}
READINGS = {"simulate": "readings1.csv"}
WRITTEN = {
    "ROBOT.urdf": ROBOTS,
    "SHEET.yaml": SHEETS,
    "A.yaml": SHEETS,
    "B.yaml": SHEETS,
    "DATA.csv": READINGS,
    "--trajectory": PATHS,
    "--path": PATHS,
    "--compensate": PATHS,
    "--calibrate": READINGS,
    "--measured": {"simulate --cycles": "cycles.csv"},
    "--journal": {"the same command": "run.journal"},
    "--grid": {},
    "--map": {},
    "--stiffness": {},
    "--factory": {},
}
"""Files by what takes them, a word of the arguments or an option, and by the command that writes them."""
ALONE = {"DATA.csv", "--measured", "--journal"}
"""What is read in a run of its own."""
LONG = {"report", "worst-case", "reliability", "budget"}
"""What takes seconds for each pose."""
MORE = {
    **READERS,
    "analyze": ("--samples", "200", "--threads", "1"),
    "init": ("--out", "drafted.yaml", "--force"),
    "map": (*READERS["map"], "--samples", "20"),
    "compare": ("--samples", "200"),
}


def files_of(command: click.Command) -> dict[str, dict[str, str]]:
    """Return what a command takes files by, as click declares it: files by their writers."""
    found = {}
    for parameter in command.params:
        metavar = parameter.metavar or ""
        words = re.findall(r"[A-Z]+\.[a-z]+|\bFILE\b", metavar)
        if isinstance(parameter, click.Argument):
            found.update({word: WRITTEN[word] for word in words})
        elif words and getattr(parameter, "heading", "") != OUTPUT and "rite " not in (parameter.help or ""):
            found[parameter.opts[0]] = WRITTEN[parameter.opts[0]]
    return found


def runs_of(name: str, files: dict[str, dict[str, str]]) -> list[tuple[str, dict[str, str]]]:
    """Return as few runs as read every file once, each a command and its writers by what takes their files."""
    together = {taker: list(writers) for taker, writers in files.items() if writers and taker not in ALONE}
    most = max(map(len, together.values()), default=0)
    runs = [
        # the second of two sheets is not the first
        {taker: writers[k - (taker == "B.yaml")] for taker, writers in together.items() if k < len(writers)}
        for k in range(most)
    ]
    runs += [{taker: writer} for taker, writers in files.items() if taker in ALONE for writer in writers]
    return [(name, run) for run in runs]


def command_of(name: str) -> click.Command:
    return cli.get_command(click.Context(cli), name)


RUNS = [run for name in list_commands() for run in runs_of(name, files_of(command_of(name)))]


def words_of(name: str, run: dict[str, str]) -> list[str]:
    """Return the command line of a run."""
    words = [name, *(WRITTEN[taker][writer] for taker, writer in run.items() if not taker.startswith("--"))]
    takers = files_of(command_of(name))
    words += [SHORT for word in ("A.yaml", "SHEET.yaml") if word in takers and word not in run]
    for taker, writer in run.items():
        one = "one." if name in LONG and taker == "--trajectory" else ""
        words += [taker, one + WRITTEN[taker][writer]] if taker.startswith("--") else []
    if "--measured" in run:
        return [*words, "--robots", "20", "--all-poses"]
    if name == "calibrate":
        return words if "DATA.csv" in run else [*words, "--forecast"]
    return [*words, *(word for word in MORE.get(name, ()) if word != "--all-poses" or "--trajectory" not in run)]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "run"), RUNS, ids=[f"{name} {' '.join(run.values())}" for name, run in RUNS])
def test_pairs(written, name, run):
    words = words_of(name, run)
    refused = name == "allocate" and run.get("SHEET.yaml") == "calibrate --sheet"
    found = written.run(*words, code=2 if refused else codes(name))
    if refused:
        # what was measured is no tolerance any more, but of the next robot
        assert "--set calibrated=none" in found.err
        written.run(*words, "--set", "calibrated=none")
    if name == "check" and run.get("SHEET.yaml") == "calibrate --sheet":
        assert "warning W_ALLOCATE" in found.out
        assert "W_ALLOCATE" not in written.run(*words, "--set", "calibrated=none").out
    if "--journal" in run:
        # a journal is read by the command that wrote it
        assert "holds the first" in written.run(*words, "--resume").err
        Path(WRITTEN["--journal"][run["--journal"]]).unlink()


def test_an_option_that_takes_a_file_needs_one_that_is_written():
    def reads(_: object) -> None:
        """Do nothing."""

    assert files_of(click.command()(click.option("--path", metavar="FILE")(reads))) == {"--path": PATHS}
    with pytest.raises(KeyError, match="--new"):
        files_of(click.command()(click.option("--new", metavar="FILE.csv")(reads)))


@pytest.mark.slow
@pytest.mark.parametrize("command", READERS)
def test_a_screen_of_24_rows_shows_what_a_command_says(written, monkeypatch, command):
    for module in ("streams", "terminal"):
        monkeypatch.setattr(f"precision_pin.cli.{module}.count_columns", lambda _: 80)
    monkeypatch.setattr("precision_pin.cli.streams.os.get_terminal_size", lambda _: os.terminal_size((80, 24)))
    found = written.run(command, SHEET, *READERS[command], code=codes(command))
    lines = found.out.splitlines()
    messages = [line for line in found.err.splitlines() if line]
    assert len(lines) + len(messages) <= 24, lines
    assert max(map(width, lines), default=0) <= 80
    if len(lines) > 12 and command != "mcpc":
        ends = lines[-1].removeprefix("  ")
        assert sum(ends in line for line in lines) > 1 or "".join(lines).count(ends) > 1, lines


OTHERS = [
    ("analyze", SHORT, "--samples", "200", "--set", "calibrated=mine.calibration.json"),
    ("calibrate", "mine.errors.yaml", "readings1.csv", "--sheet", "again.errors.yaml"),
    ("compare", SHORT, "of_mine.errors.yaml", "of_built.errors.yaml", "--samples", "200"),
]
"""What no word or option of its own says: several files, keys of sheets, sheets of sheets."""


@pytest.mark.slow
@pytest.mark.parametrize("arguments", OTHERS, ids=" ".join)
def test_others(written, arguments):
    written.run(*arguments)
