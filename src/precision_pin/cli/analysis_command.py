"""What the analysis commands share: their options, the model and poses they ask about, and how they answer."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, final

import click

from precision_pin.cli.common import (
    ArmOptions,
    chain_options,
    chosen_pose,
    inputs_argument,
    q_option,
    read_sheet,
    seed_option,
)
from precision_pin.cli.notes import echo_note, quiet_option
from precision_pin.cli.streams import say
from precision_pin.cli.targets import check_folder_name
from precision_pin.cli.writing import Outputs, echo_data, whole_folder, write_text
from precision_pin.errors import Finding, InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from precision_pin.model.error_model import ErrorModel
    from precision_pin.sheet import Sheet

__all__ = ["Question", "Result", "Shared", "answer", "ask", "question_options"]

Decorated = TypeVar("Decorated", bound=Callable[..., Any])


class Shared(ArmOptions):
    """The options that every analysis command takes."""

    pose_names: tuple[str, ...]
    seed: int
    json_path: str | None
    out: str | None


class Result(Protocol):
    """What an analysis returns."""

    @property
    def poses(self) -> tuple[Any, ...]:
        """One entry for each pose."""

    def to_json(self) -> str:
        """Return the result as text."""


@final
@dataclass(frozen=True)
class Question:
    """What is asked about.

    Attributes
    ----------
    sheet
        As read; its findings are printed already.
    model
        The sheet's error model.
    poses
        The poses asked for, each as :meth:`precision_pin.model.error_model.ErrorModel.at` takes it.
    """

    sheet: Sheet
    model: ErrorModel
    poses: list[Any]


def question_options(command: Decorated) -> Decorated:
    """Add the options of :class:`Shared`."""
    for option in (
        quiet_option,
        click.option("--out", metavar="DIR", help="Write plots (PNG and SVG) and the result there."),
        click.option("--json", "json_path", metavar="FILE", help="Write the result as JSON; - prints it alone."),
        seed_option,
        chain_options,
        q_option,
        click.option("--pose", "pose_names", multiple=True, metavar="NAME", help="One of the sheet's poses; repeats."),
        inputs_argument,
    ):
        command = option(command)
    return command


def ask(shared: Shared, name: str) -> Question:
    """Return what the options ask about, refusing before any work what could not be written at its end.

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
    if shared["pose_names"] and shared["q"] is not None:
        raise InputError([Finding("error", "E_USAGE", "--pose and --q exclude each other")])
    outputs = Outputs({"--json": shared["json_path"]}, shared["out"], (f"{name}.*", f"{name}-*"))
    check_folder_name(shared["out"], json=True)
    outputs.check()
    sheet = read_sheet(shared["inputs"], shared["tip"], shared["base"], shared["package_dirs"], outputs)
    poses = [chosen_pose(sheet, name, shared["q"]) for name in shared["pose_names"] or (None,)]
    return Question(sheet, ErrorModel.from_sheet(sheet), poses)


def answer(
    shared: Shared,
    result: Result,
    name: str,
    text: Callable[[], str],
    figure: Callable[[int], Figure],
    warnings: Iterable[str] = (),
) -> None:
    """Print a result and write the files asked for: ``NAME.json`` and a figure for each pose.

    Parameters
    ----------
    shared
        The options.
    result
        What was found.
    name
        Of the analysis, and so of its files.
    text
        Makes the table.
    figure
        Draws the figure of a pose, by its number.
    warnings
        Printed to stderr.

    Raises
    ------
    OutputError
        Something cannot be written.
    """
    for line in warnings:
        say(line)
    json_path, out = shared["json_path"], shared["out"]
    echo_data(result.to_json() if json_path == "-" else text())
    if json_path is not None and json_path != "-":
        write_text(Path(json_path), result.to_json() + "\n")
    if out is None:
        return
    from precision_pin.outputs.monte_carlo import figures

    several = len(result.poses) > 1
    files = [f"{name}-{k + 1}" if several else name for k in range(len(result.poses))]
    with whole_folder(Path(out)) as stage:
        write_text(stage / f"{name}.json", result.to_json() + "\n")
        for k, file in enumerate(files):
            figures.save(figure(k), stage / file)
    echo_note(f"wrote {out}: {name}.json, {', '.join(files)} as PNG and SVG")
