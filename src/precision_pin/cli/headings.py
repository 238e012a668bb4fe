"""Options under headings in ``--help``: an option says where it is declared which heading it belongs under."""

from __future__ import annotations

from functools import partial
from typing import Any, Final, final

import click

_OWN: Final = "Options"
_POSES, _ROBOT, _SAMPLING, _OUTPUT = "Poses", "Robot and sheet", "Sampling", "Output and messages"
_LAST: Final = (_POSES, _ROBOT, _SAMPLING, _OUTPUT)
"""The headings that are alike in all commands, in their order after a command's own."""


@final
class HeadedOption(click.Option):
    """An option with the heading under which ``--help`` lists it."""

    def __init__(self, *arguments: Any, heading: str, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        self.heading = heading


pose_option: Final = partial(click.option, cls=HeadedOption, heading=_POSES)
robot_option: Final = partial(click.option, cls=HeadedOption, heading=_ROBOT)
sampling_option: Final = partial(click.option, cls=HeadedOption, heading=_SAMPLING)
output_option: Final = partial(click.option, cls=HeadedOption, heading=_OUTPUT)


def write_options(command: click.Command, ctx: click.Context, formatter: click.HelpFormatter) -> None:
    """Write the options of a command: those without a heading first, then its own headings, then those of all commands."""
    groups: dict[str, list[tuple[str, str]]] = {_OWN: []}
    help_option = command.get_help_option(ctx)
    for option in command.get_params(ctx):
        record = option.get_help_record(ctx) if isinstance(option, click.Option) else None
        if record is not None:
            heading = getattr(option, "heading", _OUTPUT if option is help_option else _OWN)
            groups.setdefault(heading, []).append(record)
    for heading in sorted(filter(groups.get, groups), key=lambda one: _LAST.index(one) if one in _LAST else -1):
        with formatter.section(heading):
            formatter.write_dl(groups[heading])
