"""Every file that one command writes, read by every command that takes such a file: one arm, whose files are written once."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from journeys.arms import ARMS, SLIDES
from journeys.conftest import Desk
from journeys.every_command import READERS, codes

pytestmark = pytest.mark.slow

ARM = ARMS["scara"]
SHEET = ARM.sheet
ALLOCATE = """allocate:
  specs: [0.7 mm @ 95 %]
  poses: [start]
  tolerances:
    - {path: 'axis_install[shoulder].radius', cost: {reciprocal: 1 mm}}
    - {path: 'length[elbow].parameters.uniform', cost: {reciprocal: 1 mm}}
"""
MEASURED = "measurement: {kind: position, std: 0.02 mm, target: 50 30 20 mm}"


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    """Write a file of every kind."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("pairs")
        patch.chdir(folder)
        desk = Desk(folder)
        desk.begin(ARM)
        desk.edit(SHEET, *ALLOCATE.splitlines(), MEASURED)
        desk.run("allocate", SHEET, "--out", "chosen")
        desk.run("calibrate", SHEET, "--plan", 6, "--random", 12, "--csv", "plan.csv")
        for unit in range(3):
            desk.run("simulate", SHEET, "--trajectory", "plan.csv", "--unit", unit, "--out", f"readings{unit}.csv")
        files = ("--sheet", "mine.errors.yaml", "--urdf", "mine.urdf")
        desk.run("calibrate", SHEET, "readings0.csv", *files)
        robots = ("mine.calibration.json", "readings1.csv", "readings2.csv")
        desk.run("calibrate", SHEET, "--population", *robots, "--sheet", "shop.errors.yaml")
        desk.run("simulate", SHEET, "--all-poses", "--cycles", 3, "--out", "cycles.csv")
        desk.run("export", SHEET, "--out", "robots")
        desk.run("compensate", SHEET, "--trajectory", "plan.csv", "--csv", "corrected.csv", code=(0, 1))
        yield desk


def sheets() -> dict[str, str]:
    """Return the sheets by the command that writes them."""
    return {
        "init": SHEET,
        "allocate --out": "chosen/allocated.errors.yaml",
        "calibrate --sheet": "mine.errors.yaml",
        "calibrate --population --sheet": "shop.errors.yaml",
    }


OF_SHEETS = [
    (name, command)
    for name in sheets()
    for command in READERS
    if command != "report" or name == "calibrate --sheet"  # a report takes as long as the others together
]


@pytest.mark.parametrize(("writer", "reader"), OF_SHEETS)
def test_sheets(written, writer, reader):
    written.run(reader, sheets()[writer], *READERS[reader], code=codes(reader))


ROBOTS = {"export": "robots/scara.unit0000.urdf", "calibrate --urdf": "mine.urdf"}


@pytest.mark.parametrize(
    "reader", ["analyze", "check", "init", "mcpc", "map", "compensate", "export", "view", "simulate", "iso9283"]
)
@pytest.mark.parametrize("writer", ROBOTS)
def test_robots(written, writer, reader):
    files = (ROBOTS[writer],) if reader in ("init", "mcpc") else (ROBOTS[writer], SHEET)
    more = ("--out", "drafted.yaml", "--force") if reader == "init" else READERS[reader]
    written.run(reader, *files, *more)


PATHS = {"calibrate --plan --csv": "plan.csv", "compensate --csv": "corrected.csv"}
OF_PATHS: dict[str, tuple[str, ...]] = {
    **{
        name: tuple(word for word in READERS[name] if word != "--all-poses")
        for name in ("analyze", "budget", "worst-case", "exact-law", "moments", "iso9283", "view", "export")
        if name != "export"
    },
    "calibrate": ("--forecast",),
    "simulate": ("--out", "again.csv"),
    "map": ("--verify", "0"),
    "path": ("--samples", "100"),
    "compensate": (),
    "compare": ("--samples", "200", "--set", "statics=equilibrium"),
}


@pytest.mark.parametrize("reader", OF_PATHS)
@pytest.mark.parametrize("writer", PATHS)
def test_paths(written, writer, reader):
    written.run(reader, SHEET, "--trajectory", PATHS[writer], *OF_PATHS[reader], code=codes(reader))


@pytest.mark.parametrize(
    "arguments",
    [
        ("calibrate", SHEET, "readings1.csv"),
        ("calibrate", SHEET, "--population", "readings0.csv", "readings1.csv"),
        ("view", SHEET, "--samples", "20", "--calibrate", "readings1.csv", "--out", "fit.html"),
        ("view", SHEET, "--samples", "20", "--compensate", "plan.csv", "--out", "fit.html"),
        ("view", SHEET, "--samples", "20", "--path", "corrected.csv", "--out", "fit.html"),
        ("iso9283", SHEET, "--all-poses", "--robots", "20", "--measured", "cycles.csv"),
        ("analyze", SHEET, "--samples", "200", "--set", "calibrated=mine.calibration.json"),
        ("calibrate", "mine.errors.yaml", "readings1.csv", "--sheet", "again.errors.yaml"),
        ("compare", SHEET, "mine.errors.yaml", "shop.errors.yaml", "chosen/allocated.errors.yaml", "--samples", "200"),
    ],
    ids=" ".join,
)
def test_others(written, arguments):
    written.run(*arguments)


def test_files_say_their_units(written):
    for name in ("plan.csv", "readings0.csv"):
        head = next(line for line in Path(name).read_text().splitlines() if line[:1] != "#")
        assert all(
            f"{joint} [{'mm' if joint in SLIDES else 'deg'}]" in head for joint in ("shoulder", "quill", "wrist")
        )
