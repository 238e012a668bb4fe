"""The first-order model over many poses: maps, covariance between poses, relative accuracy."""

from functools import partial
from pathlib import Path
from typing import Any

from precision_pin.analyses.declaration import OUTPUT, SAMPLING, Asked, Declaration, Files, Job, Option, PagePart


def prepare(request: Asked) -> Job:
    """Return the map of the poses of a command line."""
    poses, options = request.read_pose_set(), request.options
    # imported late: these take as long as all other imports, and reading a large file should start early
    from precision_pin.analyses.map.map_poses import check_json, count_steps, map_poses
    from precision_pin.analyses.shares import source_lines
    from precision_pin.model.error_model import ErrorModel

    model = ErrorModel.from_sheet(request.sheet)
    if options.get("json_path") is not None or options.get("out") is not None:
        is_relative = options["relative_to"] is not None
        check_json(len(poses), len(poses.q), len(source_lines(model)), len(options["specs"]), is_relative)
    names = ("samples", "seed", "relative_to", "verify")
    run = partial(
        map_poses, model, poses, **{name: options[name] for name in names},
        specifications=options["specs"], findings=request.sheet.findings, files={"sheet": request.sheet.file},
    )  # fmt: skip

    def write(result: Any) -> tuple[str, ...]:
        if options["netcdf"] is not None:
            result.to_netcdf(options["netcdf"])
        return ()

    def files(result: Any) -> Files:
        from precision_pin.analyses.map.figure import figure

        drawn = {f"map-{quantity}": figure(result, quantity) for quantity in ("position", "attitude")}
        return Files(drawn, listed="map-position and map-attitude")

    return Job(
        run,
        steps=count_steps(len(poses), options["samples"], options["verify"], judged=bool(options["specs"])),
        what="mapping",
        unit="steps",
        files=files,
        write=write,
    )


DECLARATION = Declaration(
    name="map",
    function=f"{__name__}.map_poses:map_poses",
    result=f"{__name__}.map_poses:MapResult",
    title="Map",
    heading="",
    summary="Map the pose error over many poses: quantiles, share in specification, main cause; the worst verified.",
    description="""Map the pose error over many poses: quantiles, share in specification, main cause, the worst poses verified.

    The numbers are in closed form, with limits that hold whatever the laws. A specification is judged by robots sampled with
    the exact model at every pose that can be reached, as many as it takes; it is met only if it is met at all of them.

    Example: precision-pin map example:ur5 --all-poses --spec "4 mm"
    """,
    options=(
        *("poses", "target", "chain"),
        Option(
            "--samples", "samples", "Sample N robots at every pose; if left out, as many as verdicts take.", int,
            metavar="N", group=SAMPLING,
        ),
        Option(
            "--verify", "verify",
            "Without --samples: sample the N worst poses once more; 0 samples nothing and judges no --spec.", int, 5, "N",
        ),
        Option(
            "--relative-to", "relative_to",
            "Add the error minus that at this pose, a name or joint values as for --q; a taught frame turns too: --datum.",
            metavar="POSE", is_pose=True,
        ),
        *("seed", "spec", "workers"),
        Option("--netcdf", "netcdf", "Write the map as netCDF, for xarray.", kind=Path, metavar="FILE.nc", group=OUTPUT),
        *("json", "out", "messages"),
    ),
    prepare=prepare,
    writes=("journal", "json_path", "netcdf"),
    files=("map.json", "map-*"),
    table_name="map_table",
    part=PagePart(
        Option(
            "--map", "map_file", "Map a grid, a file as for --grid: within how much 95 % of robots stay at its places.",
            kind=Path, metavar="FILE.yaml",
        ),
        place=10, chapter="figure:map_chapter", layer="figure:PlacesData", poses="grid", missed="on the map",
    ),
)  # fmt: skip
