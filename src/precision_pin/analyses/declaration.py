"""Declarations of the analyses for the command line, the report, the package and the documentation.

A declaration names functions and classes as text, so that listing the commands imports neither the compiler nor the
plotting library. Named tuples are created in a tenth of the time of data classes, and faster still where annotations
are types instead of text; hence no ``from __future__ import annotations``.
"""

from collections.abc import Callable, Collection, Mapping
from importlib import import_module
from operator import attrgetter
from typing import Any, NamedTuple

from precision_pin.base.errors import InputError, UnitError


def load(place: str) -> Any:
    """Import and return the object ``package.module:name``."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


UNDERSTAND, DECIDE, MEASURE = "Understand how accurate it is", "Decide what to change", "Measure"
"""Headings in the list of commands."""
POSES, ROBOT, SAMPLING, OUTPUT = "Poses", "Robot and sheet", "Sampling", "Output and messages"
"""Headings of options in the help of a command, alike in all commands."""
INPUTS = "Without arguments: the paper's arm and sheet, from inside the package. ROBOT may be example:NAME."
"""Last paragraph of a description."""
AT_POSES = ("poses", "chain", "target", "seed", "json", "out", "messages")
"""Shared options of an analysis at one or several poses."""
SHARED_OPTIONS = (
    *("poses", "target", "datum", "chain", "seed", "model", "spec", "beyond", "workers", "measurement", "json", "out"),
    *("plot", "messages"),
)
"""All words for shared options."""


class WrongUsageError(ValueError):
    """Arguments or options that contradict each other; the command line adds where its help is."""


def reader(option: str, example: str, parse: Callable[[Any, str], Any]) -> Callable[[str], Any]:
    """Return the function that reads an option with a unit; ``parse`` is given the module of units, imported late."""

    def read(text: str) -> Any:
        from precision_pin.base import units

        try:
            return parse(units, text)
        except UnitError as error:
            message = f"{option}: {error.findings[0].message}; write it as {example!r}"
            raise InputError.of("E_USAGE", message) from None

    return read


class Option(NamedTuple):
    """Option of an analysis's command, in addition to the shared ones.

    Attributes:
        flag: Name on the command line, such as ``--samples``.
        argument: Keyword argument of the function.
        kind: Type of the value; :class:`pathlib.Path` for text that names a file.
        default: Default value, shown in the help unless it is None.
        metavar: Placeholder of the value in the help, by which the shell completes it (``POSE``, ``FILE.csv``); optional for
            numbers and choices.
        choices: Allowed values; empty for any value.
        is_repeated: True if the option may be repeated; the argument is then a tuple.
        is_of_table: True if the table takes the argument instead of the analysis.
        check: ``module:function`` that rejects a wrong value before any input is read.
        group: Heading in the help; an option of the table defaults to :data:`OUTPUT`, others to none.
        read: Parses the text, or rejects it, before any input is read.
        is_pose: True if the value names a pose: one of the sheet's, or joint values.
    """

    flag: str
    argument: str
    help: str
    kind: type = str
    default: Any = None
    metavar: str | None = None
    choices: tuple[str, ...] = ()
    is_repeated: bool = False
    is_of_table: bool = False
    check: str = ""
    group: str = ""
    read: Callable[[str], Any] | None = None
    is_pose: bool = False
    is_default_shown: bool = True

    @property
    def initial(self) -> Any:
        """Value if the option is not given."""
        return () if self.is_repeated else False if self.kind is bool and self.default is None else self.default


class Asked(NamedTuple):
    """Inputs of a command, for the function ``prepare`` of a declaration.

    Attributes:
        sheets: Parsed sheets by name; most commands have one, whose name is empty.
        options: Values of all options by their arguments.
        chosen: Arguments of the options that the user gave.
        read_poses, read_pose_set: Functions of the largest number of poses. They read the command line's poses (by
            default the first) as a list with names or as a :class:`precision_pin.robot.pose_set.PoseSet`.
        read_measurements: Reads the measurements named by the options, with the first sheet.
    """

    sheets: Mapping[str, Any]
    options: Mapping[str, Any]
    chosen: Collection[str]
    read_poses: Callable[..., Any]
    read_pose_set: Callable[..., Any]
    read_measurements: Callable[[], Any]

    @property
    def sheet(self) -> Any:
        """The first sheet."""
        return next(iter(self.sheets.values()))


class Files(NamedTuple):
    """Files written with the result: figures by name, texts by file name, and how a note lists the figures."""

    figures: Mapping[str, Any] = {}
    texts: Mapping[str, str] = {}
    listed: str = ""


class Job(NamedTuple):
    """Work and outputs of a command, returned by the function ``prepare`` of a declaration.

    Attributes:
        run: Returns the result; takes ``progress`` if there are steps, and the settings of ``workers``.
        models: Models whose samplers are compiled first.
        steps, what, unit: Number of progress steps, None for no progress bar; its label and unit.
        is_unwound: True if a signal raises KeyboardInterrupt in the analysis instead of ending the process.
        note: Line printed before the run.
        stem: Name of the files (default: the command's).
        table: Renders the result as text; by default the declared table.
        files: Returns further files for the output folder; by default the figure.
        write, is_written_first: Writes other options' files and returns notes; whether before the result is printed.
        findings: Findings passed to an analysis whose result has no warning lines; those that it adds are printed.
        is_met: Whether the exit code is 0.
    """

    run: Callable[..., Any]
    models: Collection[Any] = ()
    steps: int | None = None
    what: str = "sampling"
    unit: str = "samples"
    is_unwound: bool = False
    note: str = ""
    stem: str = ""
    table: Callable[[Any], str] | None = None
    files: Callable[[Any], Files] | None = None
    write: Callable[[Any], Collection[str]] | None = None
    is_written_first: bool = False
    findings: tuple[Any, ...] | None = None
    is_met: Callable[[Any], bool | None] = attrgetter("met")


class PagePart(NamedTuple):
    """Parts of an analysis on a page, next to the poses: a chapter of the report and a layer of the view.

    Attributes:
        option: Option of ``report`` that asks for it, and of ``view`` if it has a layer.
        place: Place among the chapters, which stand in rising order.
        poses: Poses of the analysis: ``"page"`` those of the page, ``"grid"`` or ``"path"`` those of the file that the
            option names, as for ``--grid`` or also for ``--trajectory``; empty if it takes none.
        settings: Returns values of the analysis's options for the value of this option; the others have their defaults.
        check: Rejects a sheet that the analysis cannot use before any long work.
        what: Label of the progress (default: the job's).
        is_first: True if the analysis runs before the poses are sampled.
        chapter: ``module:function`` in the folder; takes the result, returns the :class:`precision_pin.render.scene.Chapter`.
        layer: ``module:Class`` in the folder; its method ``of`` takes the result and the model.
        missed: Where a specification is not met, such as ``"on the map"``; empty if the analysis judges none.
        headline: ``module:function`` in the folder; takes the result, returns the answer that stands above the page's own,
            and a line that names the page's own.
    """

    option: Option
    place: int
    chapter: str
    layer: str = ""
    poses: str = ""
    settings: Callable[[Any], Mapping[str, Any]] = lambda value: {}
    check: Callable[[Any], None] | None = None
    what: str = ""
    is_first: bool = False
    missed: str = ""
    headline: str = ""


class Declaration(NamedTuple):
    """Declaration of an analysis.

    The folder of the function has the modules ``table`` (but see ``table_name``) and ``figure``: ``table.table(result,
    …)`` returns text, ``figure.figure(result, k)`` the figure of pose k, ``figure.content(result, results)`` the parts of
    the report's section, and ``figure.draw(axes, result, k, quantity)`` draws one panel of the figure.

    Attributes:
        name: Name of the command, also in files and in the schema of the JSON.
        function, result: ``module:name`` of the function, with the arguments ``(model, pose, *, seed, findings,
            progress, …)``, and of the class of its result, a :class:`precision_pin.analyses.result.Result`.
        title, heading: Entry in the report's contents, and heading of its section; no heading, no section.
        summary, description: Line in the list of commands, and text of the command's help.
        options: Options in the order of the help; a word stands for a group of shared options.
        report_settings: Settings that a report passes on: ``samples``, ``specifications``. An analysis with
            specifications is left out of a report without any.
        steps: ``module:function(space, poses, **arguments)`` for the progress steps; by default all samples.
        has_warnings_in_table: True if the table includes the warnings, so that the command does not print them again.
        group: Heading in the list of commands.
        prepare: Returns the job for the inputs; by default ``function`` at the poses of the command line.
        check: Rejects options that contradict each other before any input is read; may change them.
        sheets: Returns, by name, the options with which each sheet is read; by default one sheet.
        arguments, data_suffixes: Command's arguments and their help; suffixes of those that are neither robot nor
            sheet.
        reads, writes: Arguments of the options that name further input files, and output files.
        files: Patterns of the names of files in a folder.
        is_sampled: True if the command samples, so that compilation may start while the inputs are read.
        table_name: Name of the function in ``table``, or ``module:name`` in the folder.
        part: Chapter of the report and layer of the view, next to the poses.
        causes: ``module:function`` in the folder that ranks the causes of the error for the report's first page; takes
            the result of one pose, the causes and a vector.
        keys: Keys of the sheet that belong to the analysis, with their descriptions.
        check_sheet: ``module:function`` in the folder that returns what ``check`` finds in these keys of a sheet.
        needs: Names of other analyses whose code it uses.
    """

    name: str
    function: str
    result: str
    title: str
    heading: str
    summary: str
    description: str
    options: tuple[Option | str, ...]
    report_settings: tuple[str, ...] = ()
    steps: str = ""
    unit: str = "samples"
    has_warnings_in_table: bool = False
    group: str = UNDERSTAND
    prepare: Callable[[Asked], Job] | None = None
    check: Callable[[dict[str, Any]], None] | None = None
    sheets: Callable[[Mapping[str, Any]], Mapping[str, Any]] | None = None
    arguments: tuple[str, str] = ("inputs", "[ROBOT.urdf] [SHEET.yaml]")
    data_suffixes: tuple[str, ...] = ()
    reads: tuple[str, ...] = ()
    writes: tuple[str, ...] = ("json_path",)
    files: tuple[str, ...] = ()
    is_sampled: bool = True
    table_name: str = "table"
    part: PagePart | None = None
    causes: str = ""
    keys: Mapping[str, str] = {}
    check_sheet: str = ""
    needs: tuple[str, ...] = ()

    @property
    def own_options(self) -> list[Option]:
        """Options that are not shared."""
        return [option for option in self.options if isinstance(option, Option)]

    def run(self, model: Any, pose: Any, *, seed: int | None, **arguments: Any) -> Any:
        """Run the analysis and return its result; one without the option ``seed`` draws nothing and takes none."""
        seed_argument = {"seed": seed} if "seed" in self.options else {}
        return load(self.function)(model, poses=pose, **seed_argument, **arguments)

    @property
    def outputs(self) -> str:
        """Package of the modules ``table`` and ``figure``."""
        return self.function.partition(":")[0].rpartition(".")[0]

    def count_steps(self, space: Any, poses: int, arguments: Mapping[str, Any]) -> int:
        """Return the number of progress steps, with default values for missing arguments."""
        defaults = {option.argument: option.default for option in self.own_options if not option.is_of_table}
        settings = {**defaults, **{key: value for key, value in arguments.items() if key in defaults}}
        if self.steps:
            return max(int(load(self.steps)(space, poses, **settings)), 0)
        return max(int(settings.get("samples") or 0) * poses, 0)

    def output(self, place: str) -> Any:
        """Import and return ``module:name`` of the folder."""
        return load(f"{self.outputs}.{place}")

    def table(self, result: Any, **arguments: Any) -> str:
        """Return a result as text."""
        module, _, name = self.table_name.rpartition(":")
        return self.output(f"{module or 'table'}:{name}")(result, **arguments)

    def figure(self, result: Any, *pose: int) -> Any:
        """Return the figure of a result, or of its pose with the given index."""
        return self.output("figure:figure")(result, *pose)

    def draw(self, axes: Any, result: Any, pose: int, quantity: str) -> None:
        """Draw one panel, ``"position"`` or ``"attitude"``, of a result's figure on given axes."""
        self.output("figure:draw")(axes, result, pose, quantity)

    def content(self, result: Any, results: Any) -> Any:
        """Return the parts of a result's section in a report."""
        return self.output("figure:content")(result, results)
