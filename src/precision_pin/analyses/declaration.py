"""Declarations of analyses: all that the command line, the report, the package and the documentation know of one.

A declaration names functions and classes by their modules and imports none of them: the list of commands is shown without
a compiler and without a plotting library. Named tuples are made in a tenth of the time of data classes, and faster still
where annotations are types, not text: no ``from __future__ import annotations`` here.
"""

from collections.abc import Mapping
from importlib import import_module
from typing import Any, NamedTuple

__all__ = ["Declaration", "Option", "load"]


def load(place: str) -> Any:
    """Return what ``package.module:name`` names."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


class Option(NamedTuple):
    """An option of an analysis's command, beside those that every analysis has.

    Attributes
    ----------
    flag
        As ``--samples``.
    argument
        The function's keyword.
    help
        One line.
    kind
        Type of the value.
    default
        Shown in the help, unless it is None.
    metavar
        What stands for the value; of numbers and choices it may be left out.
    choices
        The values allowed, if not all.
    is_repeated, is_needed
        Whether it may be given several times (then the argument is a tuple), and whether it must be given.
    is_of_table
        Whether it is an argument of the table in place of the analysis.
    check
        ``module:function`` that refuses a wrong value, before any input is read.
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


class Declaration(NamedTuple):
    """An analysis.

    Attributes
    ----------
    name
        Its command, and its name in files and in the JSON's schema.
    function, result
        ``module:name`` of the function, whose arguments are ``(model, pose, *, seed, findings, progress, …)``, and of what
        it returns, a :class:`precision_pin.analyses.result.Result`.
    outputs
        The package of its modules ``table``, ``figure`` and ``section``: ``table.table(result, …)`` returns text,
        ``figure.figure(result, k)`` the figure of pose k, ``figure.draw(axes, result, k, quantity)`` draws
        one panel of it, ``section.content(result, results)`` the parts of its section of
        the report.
    title, heading
        In the report's list of contents, and above its section.
    summary, description
        One line in the list of commands, one line in the command's help.
    options
        Of its command.
    report_settings
        Arguments that a report gives it as it gives them to the sampling: ``samples``, ``specifications``. Without
        specifications, what takes them is left out.
    steps
        ``module:function(space, poses, **arguments)`` that returns how many steps it tells of at so many poses; without it,
        the samples at each pose.
    unit
        What those steps are.
    has_warnings_in_table
        Whether its table says what it warns of, so that the command does not say it again.
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
        """Run the analysis; returns its result."""
        return load(self.function)(model, pose=pose, **arguments)

    def count_steps(self, space: Any, poses: int, arguments: Mapping[str, Any]) -> int:
        """Return how many steps the analysis tells of at so many poses, with some of its arguments."""
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
        """Return the figure of a result's pose, by its number."""
        return load(f"{self.outputs}.figure:figure")(result, pose)

    def draw(self, axes: Any, result: Any, pose: int, quantity: str) -> None:
        """Draw one panel of a result's figure on given axes: of ``"position"`` or ``"attitude"``."""
        load(f"{self.outputs}.figure:draw")(axes, result, pose, quantity)

    def content(self, result: Any, results: Any) -> Any:
        """Return the parts of a result's section in a report."""
        return load(f"{self.outputs}.section:content")(result, results)
