"""How far the tool gives way under a load: compliance, softest direction, ISO 9283 static compliance, their law over robots."""

from functools import partial
from pathlib import Path
from typing import Any

from precision_pin.analyses.declaration import (
    INPUTS,
    SAMPLING,
    Asked,
    Declaration,
    Files,
    Job,
    Option,
    PagePart,
    reader,
)
from precision_pin.base.errors import InputError

# poses of which each has a figure
_MOST_DRAWN = 12


def prepare(request: Asked) -> Job:
    """Return the stiffness at the poses of a command line."""
    poses, options = request.read_pose_set(), request.options
    from precision_pin.analyses.stiffness.stiffness import stiffness
    from precision_pin.model.error_model import ErrorModel

    names = ("rated", "axes", "robots", "goal", "seed")
    run = partial(
        stiffness, ErrorModel.from_sheet(request.sheet), poses, findings=request.sheet.findings,
        **{name: options[name] for name in names},
    )  # fmt: skip

    def files(result: Any) -> Files:
        from precision_pin.analyses.stiffness.figure import figure, map_figure

        count = len(result.poses)
        figures = {"stiffness-map": map_figure(result)} if count > 1 else {}
        if count <= _MOST_DRAWN:
            figures |= {f"stiffness-{k + 1}" if count > 1 else "stiffness": figure(result, k) for k in range(count)}
        return Files(figures)

    return Job(run, steps=len(poses), what="loading", unit="poses", files=files)


def _axes(text: str) -> str | list[float]:
    if text in ("base", "tool"):
        return text
    try:
        direction = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        direction = []
    if len(direction) != 3 or not any(direction):
        message = f'--axes: base, tool or a direction in base axes such as "1 0 1" is expected, got {text!r}'
        raise InputError.of("E_USAGE", message)
    return direction


DECLARATION = Declaration(
    name="stiffness",
    function=f"{__name__}.stiffness:stiffness",
    result=f"{__name__}.stiffness:StiffnessResult",
    title="Stiffness",
    heading="",
    summary="How far the tool gives way under a force, in which direction it is softest, and which joint gives most.",
    description=f"""Show how far the tool gives way under a force, in which direction it is softest, and which joint gives most.

    Compliances are along axes and in the softest direction, with their law over built robots; with --rated also the static
    compliance of ISO 9283, by axis and sign in ten steps. A stiffness along an axis is that of a force along it with the tool
    free to move sideways, which a dial gauge sees.

    {INPUTS}
    """,
    options=(
        Option(
            "--rated", "rated", "Load up to which the static compliance of ISO 9283 is stepped, in tenths of it.",
            metavar='"300 N"', read=reader("--rated", "300 N", lambda units, text: units.parse(text, units.FORCE)),
        ),
        Option(
            "--axes", "axes", "Axes of forces: base, tool, or one direction in base axes.", default="base",
            metavar='base|tool|"1 0 1"', read=_axes,
        ),
        Option(
            "--goal", "goal", "Largest compliance wanted: how much stiffer each part must be, and how many robots keep it.",
            metavar='"1 um/N"', read=reader("--goal", "1 um/N", lambda units, text: units.parse(text, units.LINEAR_COMPLIANCE)),
        ),
        *("poses", "target", "chain"),
        Option("--robots", "robots", "Built robots of the law.", int, 1000, "N", group=SAMPLING),
        *("seed", "json", "out", "messages"),
    ),
    prepare=prepare,
    is_sampled=False,
    part=PagePart(
        Option(
            "--stiffness", "stiffness_file", "Show how far the tool gives way over a grid, a file as for --grid.",
            kind=Path, metavar="FILE.yaml",
        ),
        place=15, chapter="figure:stiffness_chapter", layer="figure:ComplianceLayer", poses="grid", is_first=True,
    ),
)  # fmt: skip
