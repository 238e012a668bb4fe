"""Declarations of the analyses for the command line, the report, the package and the documentation.

A declaration names functions and classes by their modules and imports none of them, so that the list of commands needs
neither the compiler nor the plotting library. Named tuples are created in a tenth of the time of data classes, and faster
still where annotations are types instead of text. This file therefore has no ``from __future__ import annotations``.
"""

from collections.abc import Mapping
from importlib import import_module
from typing import Any, NamedTuple


def load(place: str) -> Any:
    """Import and return the object ``package.module:name``."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


class Option(NamedTuple):
    """Option of an analysis's command, in addition to the common ones.

    Attributes
    ----------
    flag
        Name on the command line, such as ``--samples``.
    argument
        Keyword argument of the function.
    help
        Help text, one line.
    kind
        Type of the value.
    default
        Default value, shown in the help unless it is None.
    metavar
        Placeholder of the value in the help; optional for numbers and choices.
    choices
        Allowed values; empty for any value.
    is_repeated, is_needed
        True if the option may be given several times (the argument is then a tuple), and if it is required.
    is_of_table
        True if it is an argument of the table instead of the analysis.
    is_of_sampling
        True if it says how many samples are taken; the help lists it with the seed.
    check
        ``module:function`` that rejects a wrong value before any input is read.
    """

    flag: str
    argument: str
    help: str
    kind: type = str
    default: Any = None
    metavar: str | None = None
    choices: tuple[str, ...] = ()
    is_repeated: bool = False
    is_needed: bool = False
    is_of_table: bool = False
    check: str = ""
    is_of_sampling: bool = False


class Declaration(NamedTuple):
    """Declaration of an analysis.

    Attributes
    ----------
    name
        Name of the command, also in files and in the schema of the JSON.
    function, result
        ``module:name`` of the function, with the arguments ``(model, pose, *, seed, findings, progress, …)``, and of the
        class of its result, a :class:`precision_pin.analyses.result.Result`.
    outputs
        Package with the modules ``table``, ``figure`` and ``section``: ``table.table(result, …)`` returns text,
        ``figure.figure(result, k)`` the figure of pose k, ``section.content(result, results)`` the parts of the report's
        section, and ``figure.draw(axes, result, k, quantity)`` draws one panel of the figure.
    title, heading
        Entry in the report's table of contents, and heading of its section.
    summary, description
        One line in the list of commands, one line in the help of the command.
    options
        Options of the command.
    report_settings
        Arguments that a report passes on as it does to the sampling: ``samples``, ``specifications``. An analysis with
        specifications is left out of a report without any.
    steps
        ``module:function(space, poses, **arguments)`` that returns the number of progress steps for a number of poses; by
        default the samples at all poses.
    unit
        Unit of these steps.
    has_warnings_in_table
        True if the table includes the warnings, so that the command does not print them again.
    """

    name: str
    function: str
    result: str
    outputs: str
    title: str
    heading: str
    summary: str
    description: str
    options: tuple[Option, ...]
    report_settings: tuple[str, ...] = ()
    steps: str = ""
    unit: str = "samples"
    has_warnings_in_table: bool = False

    def run(self, model: Any, pose: Any, **arguments: Any) -> Any:
        """Run the analysis and return its result."""
        return load(self.function)(model, pose=pose, **arguments)

    def count_steps(self, space: Any, poses: int, arguments: Mapping[str, Any]) -> int:
        """Return the number of progress steps for a number of poses and some of the arguments."""
        defaults = {option.argument: option.default for option in self.options if not option.is_of_table}
        known = {**defaults, **{key: value for key, value in arguments.items() if key in defaults}}
        if self.steps:
            return max(int(load(self.steps)(space, poses, **known)), 0)
        return max(int(known.get("samples") or 0) * poses, 0)

    def table(self, result: Any, **arguments: Any) -> str:
        """Return a result as text."""
        text: str = load(f"{self.outputs}.table:table")(result, **arguments)
        return text

    def figure(self, result: Any, pose: int) -> Any:
        """Return the figure of a result at a pose, given by its number."""
        return load(f"{self.outputs}.figure:figure")(result, pose)

    def draw(self, axes: Any, result: Any, pose: int, quantity: str) -> None:
        """Draw one panel of a result's figure, ``"position"`` or ``"attitude"``, on given axes."""
        load(f"{self.outputs}.figure:draw")(axes, result, pose, quantity)

    def content(self, result: Any, results: Any) -> Any:
        """Return the parts of a result's section in a report."""
        return load(f"{self.outputs}.section:content")(result, results)
