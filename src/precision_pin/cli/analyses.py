"""The commands of the analyses, each made from its declaration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar, final

import click

from precision_pin.analyses.declaration import Declaration, Option, load
from precision_pin.base.files import whole_folder, write_text
from precision_pin.cli import EXIT_SPEC
from precision_pin.cli.headings import output_option, sampling_option
from precision_pin.cli.inputs import read_sheet
from precision_pin.cli.notes import all_warnings_option, echo_note, echo_warning_lines, quiet_option
from precision_pin.cli.options import (
    ChainOptions,
    PoseOptions,
    SamplingCommand,
    beyond_limits_option,
    chain_options,
    inputs_argument,
    pose_options,
    seed_option,
    target_option,
)
from precision_pin.cli.poses import check_poses, pose_files, read_poses
from precision_pin.cli.progress import compile_sampler, progress_bar
from precision_pin.cli.streams import echo_data
from precision_pin.cli.targets import Outputs
from precision_pin.cli.terminal import echo_table

if TYPE_CHECKING:
    from precision_pin.analyses.result import Result
    from precision_pin.model.error_model import ErrorModel
    from precision_pin.sheet import Sheet

_INPUTS: Final = "Without arguments: the paper's arm and sheet, from inside the package. ROBOT may be example:NAME."

Decorated = TypeVar("Decorated", bound=Callable[..., Any])


class _Shared(ChainOptions, PoseOptions):
    """The options that every analysis command takes."""

    seed: int
    json_path: str | None
    out: str | None


@final
@dataclass(frozen=True)
class _Question:
    """The inputs of an analysis command.

    Attributes
    ----------
    sheet
        As read; its findings are printed already.
    model
        The sheet's error model.
    poses
        The requested poses, each as :meth:`precision_pin.model.error_model.ErrorModel.at` takes it.
    """

    sheet: Sheet
    model: ErrorModel
    poses: list[Any]


def _shared_options(command: Decorated) -> Decorated:
    """Add the options of :class:`_Shared`."""
    for option in (
        quiet_option,
        all_warnings_option,
        output_option("--out", metavar="DIR", help="Write plots (PNG and SVG) and the result there."),
        output_option("--json", "json_path", metavar="FILE", help="Write the result as JSON; - prints it alone."),
        seed_option,
        target_option,
        chain_options,
        pose_options,
        inputs_argument,
    ):
        command = option(command)
    return command


def _ask(shared: _Shared, name: str) -> _Question:
    """Return sheet, model and poses of the options; refuse unwritable outputs before any work.

    Parameters
    ----------
    shared
        The options.
    name
        Of the analysis, and so of its files.

    Raises
    ------
    InputError
        Any input is wrong.
    """
    from precision_pin.draws.space import check_seed
    from precision_pin.model.error_model import ErrorModel

    check_seed(shared["seed"])
    check_poses(shared)
    outputs = Outputs({"--json": shared["json_path"]}, shared["out"], (f"{name}.*", f"{name}-*"))
    outputs.check()
    outputs.refuse_inputs(pose_files(shared))
    sheet = read_sheet(shared, outputs)
    asked = read_poses(sheet, shared)
    return _Question(asked.noted_in(sheet), ErrorModel.from_sheet(sheet), [pose.where for pose in asked])


def make_command(declaration: Declaration) -> click.Command:
    """Return the command of an analysis."""

    def command(**given: Any) -> int:
        return _run(declaration, given)

    for option in reversed(declaration.options):
        command = _option(option)(command)
    if any(option.argument == "specifications" for option in declaration.options):
        command = beyond_limits_option(command)
    return click.command(declaration.name, cls=SamplingCommand, help=f"{declaration.description}\n\n{_INPUTS}")(
        _shared_options(command)
    )


def _option(option: Option) -> Callable[[Callable[..., int]], Callable[..., int]]:
    make = output_option if option.is_of_table else sampling_option if option.is_of_sampling else click.option
    return make(
        option.flag,
        option.argument,
        type=click.Choice(option.choices) if option.choices else option.kind,
        default=option.default,
        is_flag=option.kind is bool,
        show_default=option.default is not None,
        multiple=option.is_repeated,
        required=option.is_needed,
        metavar=option.metavar,
        help=option.help,
    )


def _run(declaration: Declaration, given: dict[str, Any]) -> int:
    """Run an analysis as its command; returns the exit code."""
    own = {option: given.pop(option.argument) for option in declaration.options}
    shared: _Shared = given  # type: ignore[assignment]
    for option, value in own.items():
        if option.check:
            load(option.check)(value)
    question = _ask(shared, declaration.name)
    compile_sampler(question.model.space)
    arguments = {option.argument: value for option, value in own.items() if not option.is_of_table}
    steps = declaration.count_steps(question.model.space, len(question.poses), arguments)
    with progress_bar(steps, "sampling", declaration.unit) as progress:
        result: Result = declaration.run(
            question.model,
            question.poses,
            seed=shared["seed"],
            findings=question.sheet.findings,
            progress=progress,
            **arguments,
        )
    echo_warning_lines(() if declaration.has_warnings_in_table else result.new_warnings)
    of_table = {option.argument: value for option, value in own.items() if option.is_of_table}
    _answer(declaration, shared, result, of_table)
    return 0 if result.met else EXIT_SPEC


def _answer(declaration: Declaration, shared: _Shared, result: Result, of_table: dict[str, Any]) -> None:
    """Print a result and write the requested files: ``NAME.json`` and a figure for each pose.

    Raises
    ------
    OutputError
        Something cannot be written.
    """
    name, json_path, out = declaration.name, shared["json_path"], shared["out"]
    if json_path == "-":
        echo_data(result.to_json())
    else:
        echo_table(declaration.table(result, **of_table))
    if json_path is not None and json_path != "-":
        write_text(Path(json_path), result.to_json() + "\n")
    if out is None:
        return
    from precision_pin.sampling import figures

    several = len(result.poses) > 1
    files = [f"{name}-{k + 1}" if several else name for k in range(len(result.poses))]
    with whole_folder(Path(out)) as stage:
        write_text(stage / f"{name}.json", result.to_json() + "\n")
        for k, file in enumerate(files):
            figures.save(declaration.figure(result, k), stage / file)
    echo_note(f"wrote {out}: {name}.json, {', '.join(files)} as PNG and SVG")
