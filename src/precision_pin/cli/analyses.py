"""The commands of the analyses, each made from its declaration."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click
from click.core import ParameterSource

from precision_pin.analyses.declaration import OUTPUT, Asked, Declaration, Files, Job, Option, WrongUsageError, load
from precision_pin.analyses.registry import SPECIFICATIONS
from precision_pin.base.interrupts import raise_if_interrupted, unwinding
from precision_pin.cli import options as shared
from precision_pin.cli.exit_codes import EXIT_SPEC
from precision_pin.cli.inputs import Outputs, read_sheet, write_folder
from precision_pin.cli.measurement import measurement_options, measurements_of
from precision_pin.cli.options import check_specs, check_workers, compile_sampler, progress_bar, worker_options, working
from precision_pin.cli.poses import check_poses, pose_files, read_pose_set, read_poses, reference_pose, specs_of
from precision_pin.cli.terminal import ALL, echo_note, echo_result, echo_warning_lines, echo_warnings
from precision_pin.render.text_table import whole_tables

if TYPE_CHECKING:
    from precision_pin.analyses.result import Result

_SHARED: Final[dict[str, shared.Decorator]] = {
    "poses": shared.pose_options,
    "target": shared.target_option,
    "datum": shared.datum_option,
    "chain": shared.chain_options,
    "seed": shared.seed_option,
    "model": shared.model_option,
    "spec": shared.spec_option,
    "beyond": shared.beyond_limits_option,
    "workers": worker_options,
    "measurement": measurement_options,
    "json": shared.json_option,
    "out": shared.plots_option,
    "plot": shared.output_option(
        "--out", type=shared.FILE, metavar="DIR", help="Write a plot (PNG and SVG) and the result there."
    ),
    "messages": shared.together(shared.all_warnings_option, shared.quiet_option),
}
"""Groups of options by the word that declares them."""


def make_command(declaration: Declaration) -> click.Command:
    """Return the command of an analysis."""

    def command(**options: Any) -> int:
        return _run(declaration, options)

    for option in reversed(declaration.options):
        command = (_SHARED[option] if isinstance(option, str) else make_option(option))(command)
    if not any(option.argument == ALL for option in declaration.own_options):
        every = shared.output_option("--all", ALL, is_flag=True, help="Print all rows of all tables.")
        command = every(command)
    name, metavar = declaration.arguments
    command = shared.argument(name, nargs=-1, metavar=metavar)(command)
    kind = shared.SamplingCommand if declaration.is_sampled else shared.Command
    made = click.command(declaration.name, cls=kind, help=declaration.description)(command)
    made.data_suffixes = declaration.data_suffixes
    return made


def make_option(option: Option) -> shared.Decorator:
    """Return the option of a command."""
    return shared.headed_option(
        option.flag,
        option.argument,
        type=click.Choice(option.choices) if option.choices else shared.FILE if option.kind is Path else option.kind,
        default=option.initial,
        is_flag=option.kind is bool,
        show_default=option.default is not None and option.is_default_shown,
        multiple=option.is_repeated,
        metavar=option.metavar,
        help=option.help,
        heading=option.group or (OUTPUT if option.is_of_table else shared.OWN),
    )


def _run(declaration: Declaration, options: dict[str, Any]) -> int:
    outputs, sheets = _check(declaration, options)
    read = {name: read_sheet({**options, **sheet_options}, outputs) for name, sheet_options in sheets.items()}
    first = next(iter(read.values()))
    source = click.get_current_context().get_parameter_source
    asked = Asked(
        read,
        options,
        [name for name in options if source(name) is not ParameterSource.DEFAULT],
        partial(read_poses, first, options),
        partial(read_pose_set, first, options),
        partial(measurements_of, first, options),
    )
    for argument, check in _spec_checks(declaration).items():
        texts = specs_of(first, options, options[argument], check)
        options[argument] = load(check)(texts) if argument == "specs" else texts
    for option in declaration.own_options:
        if option.is_pose:
            options[option.argument] = reference_pose(first, options[option.argument])
    job = (declaration.prepare or partial(_at_poses, declaration))(asked)
    for model in job.models:
        compile_sampler(model.space, options.get("model", "exact"))
    if job.note:
        echo_note(job.note)
    with ExitStack() as stack:
        given: dict[str, Any] = {}
        if "workers" in declaration.options:
            given |= stack.enter_context(working(options))
        if job.steps is not None:
            given["progress"] = stack.enter_context(progress_bar(job.steps, job.what, job.unit))
        if job.is_unwound:
            stack.enter_context(unwinding())
        result = job.run(**given)
        if job.is_unwound:
            raise_if_interrupted()
    if not declaration.has_warnings_in_table:
        echo_new_warnings(job, result)
    _answer(declaration, job, result, options)
    return 0 if job.is_met(result) else EXIT_SPEC


def _spec_checks(declaration: Declaration) -> dict[str, str]:
    """Return the checks of the option ``--spec`` by its argument."""
    checks = {option.argument: option.check for option in declaration.own_options if option.flag == "--spec"}
    return checks or ({"specs": SPECIFICATIONS} if "spec" in declaration.options else {})


def echo_new_warnings(job: Job, result: Any) -> None:
    """Print the warnings of a result that are not among those of its inputs."""
    if job.findings is None:
        echo_warning_lines(result.new_warnings)
    else:
        echo_warnings(result.findings[len(job.findings) :])


def check_shared(options: dict[str, Any]) -> None:
    """Reject wrong values of the shared options of a command before any input is read."""
    from precision_pin.draws.space import check_seed

    if "seed" in options:
        check_seed(options["seed"])
    if "specs" in options:
        check_specs(options["specs"])
    if "grid" in options:
        check_poses(options)
    if "dask" in options:
        check_workers(options)


def _check(declaration: Declaration, options: dict[str, Any]) -> tuple[Outputs, Mapping[str, Any]]:
    """Reject wrong options and unwritable outputs before any work; return outputs, and each sheet's options by name."""
    check_shared(options)
    for option in declaration.own_options:
        if option.flag == "--spec":
            check_specs(options[option.argument], option.check)
        elif option.check:
            load(option.check)(options[option.argument])
        if option.read is not None and options[option.argument] is not None:
            options[option.argument] = option.read(options[option.argument])
    try:
        if declaration.check is not None:
            declaration.check(options)
        sheets = {"": {}} if declaration.sheets is None else declaration.sheets(options)
    except WrongUsageError as error:
        raise click.UsageError(str(error)) from None
    names = declaration.files or (f"{declaration.name}.*", f"{declaration.name}-*")
    flags = {option.name: option.opts[0] for option in click.get_current_context().command.params}
    outputs = Outputs({flags[name]: options[name] for name in declaration.writes}, options["out"], names)
    further: list[str] = []
    for value in filter(None, map(options.get, declaration.reads)):
        further += (value,) if isinstance(value, str) else value
    options["tables"] = [*further, *(pose_files(options) if "poses" in declaration.options else ())]
    outputs.check(options["tables"])
    return outputs, sheets


def _at_poses(declaration: Declaration, asked: Asked) -> Job:
    from precision_pin.model.error_model import ErrorModel

    poses = asked.read_poses()
    sheet = poses.noted_in(asked.sheet)
    model = ErrorModel.from_sheet(sheet)
    options = declaration.own_options
    arguments = {option.argument: asked.options[option.argument] for option in options if not option.is_of_table}

    def files(result: Result) -> Files:
        count = len(result.poses)
        names = [f"{declaration.name}-{k + 1}" if count > 1 else declaration.name for k in range(count)]
        return Files({name: declaration.figure(result, k) for k, name in enumerate(names)})

    where = [pose.where for pose in poses]
    return Job(
        partial(declaration.run, model, where, seed=asked.options.get("seed"), findings=sheet.findings, **arguments),
        (model,),
        declaration.count_steps(model.space, len(poses), arguments),
        unit=declaration.unit,
        files=files,
    )


def _answer(declaration: Declaration, job: Job, result: Any, options: Mapping[str, Any]) -> None:
    """Print a result and write the requested files: ``NAME.json`` and figures in a folder, and those of options."""
    json_path, out, stem = options["json_path"], options["out"], job.stem or declaration.name
    write = job.write or (lambda _: ())
    if job.is_written_first:
        for note in write(result):
            echo_note(note)
    of_table = {option.argument: options[option.argument] for option in declaration.own_options if option.is_of_table}
    table = job.table or partial(declaration.table, **of_table)
    others = () if job.is_written_first else set(declaration.writes) - {"json_path"}
    below = sum(options[name] is not None for name in ("out", *others))
    with whole_tables(bool(options[ALL])):
        echo_result(result, json_path, lambda: table(result), below=below)
    notes = () if job.is_written_first else write(result)
    if out is not None:
        files = Files({stem: declaration.figure(result)}) if job.files is None else job.files(result)
        write_folder(out, stem, result, files.figures, files.texts)
        drawn = [f"{files.listed or ', '.join(files.figures)} as PNG and SVG"] if files.figures else []
        echo_note(f"wrote {out}: {', '.join([f'{stem}.json', *drawn, *files.texts])}")
    for note in notes:
        echo_note(note)
