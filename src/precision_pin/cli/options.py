"""Options of several commands, and checks of all commands."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, TypeVar

import click

from precision_pin.base.errors import PrecisionPinWarning
from precision_pin.cli.headings import pose_option, robot_option, sampling_option, write_options
from precision_pin.cli.notes import all_warnings_option, quiet_option
from precision_pin.cli.resources import require_resources

Options = Mapping[str, Any]
"""Values of a command's options by argument."""
Decorated = TypeVar("Decorated", bound=Callable[..., Any])


class Command(click.Command):
    """A command that refuses an option given twice where one is meant, and more than one robot and one sheet."""

    data_suffixes: tuple[str, ...] = ()
    """Ends of the names of inputs that are data beside robot and sheet."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the arguments.

        Raises:
            UsageError: An option with one value is given more than once, or there are more than two inputs.
        """
        if not ctx.resilient_parsing:
            try:
                order = self.make_parser(ctx).parse_args(list(args))[2]
            except click.UsageError as error:
                error.ctx = error.ctx or ctx
                raise
            for option in dict.fromkeys(order):
                times = order.count(option)
                if isinstance(option, click.Option) and not (option.multiple or option.is_flag) and times > 1:
                    message = f"{option.opts[0]} is given {times} times; {ctx.command_path} takes one"
                    raise click.UsageError(message, ctx)
        left = super().parse_args(ctx, args)
        inputs = [text for text in ctx.params.get("inputs") or () if not text.lower().endswith(self.data_suffixes)]
        if len(inputs) > 2:
            # before what an unquoted option value left behind is taken for the value
            raise click.UsageError(describe_excess(inputs), ctx)
        return left

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options under their headings."""
        write_options(self, ctx, formatter)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command if the libraries can be loaded; ``doctor`` runs anyway and reports what is missing.

        The command prints the package's warnings among its findings.
        """
        if self.name != "doctor":
            require_resources()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PrecisionPinWarning)
            return super().invoke(ctx)


class SamplingCommand(Command):
    """A command that samples: on a machine where nothing is compiled yet, that begins while the inputs are read."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command."""
        from precision_pin.kernel.parts import begin_compiling

        begin_compiling()
        return super().invoke(ctx)


def spec_option(command: Decorated) -> Decorated:
    """Add the limits to judge, and whether they are judged beyond the joints' limits."""
    return click.option(
        "--spec", "specs", multiple=True, metavar='"0.5 mm @ 99.73 %"', help="A limit to judge; repeats."
    )(beyond_limits_option(command))


def chain_options(command: Decorated) -> Decorated:
    """Add the options that change a sheet and cut a chain out of its robot."""
    changes = robot_option(
        "--set",
        "changes",
        multiple=True,
        metavar="PATH=VALUE",
        help="Change the sheet: 'parameters.a1=±0.1 mm', 'payload.mass=2 kg', 'KIND[*].KEY=VALUE'; repeats.",
    )
    ignored = robot_option(
        "--ignore-collisions",
        "ignores_collisions",
        is_flag=True,
        help="Do not check poses for collisions and keep_out.",
    )
    return robot_options(changes(ignored(command)))


def robot_options(command: Decorated) -> Decorated:
    """Add the options that cut a chain out of a robot."""
    for option in (
        robot_option(
            "--package-dir",
            "package_dirs",
            multiple=True,
            type=click.Path(exists=True, file_okay=False),
            metavar="DIR",
            help="Where ROS packages of meshes lie.",
        ),
        robot_option("--base", metavar="LINK", help="The fixed link; the sheet's or the root if left out."),
        robot_option("--tip", metavar="FRAME", help="The end-effector; the sheet's or the only leaf if left out."),
    ):
        command = option(command)
    return command


_Q_HELP: Final = 'Joint values: "-90 3 88 -91 deg", "0.1 m, 10 deg" or "joint1: 10 deg, …".'
_APPROACH_HELP: Final = 'How joints moved last: "joint1 +, joint2 -"'
inputs_argument: Final = click.argument("inputs", nargs=-1, metavar="[ROBOT.urdf] [SHEET.yaml]")
seed_option: Final = sampling_option("--seed", type=int, default=0, show_default=True, metavar="S", help="64-bit seed.")
model_option: Final = sampling_option(
    "--model",
    type=click.Choice(["exact", "linear"]),
    default="exact",
    show_default=True,
    help="The exact displaced chain, or superposition as in the paper.",
)
beyond_limits_option: Final = pose_option(
    "--beyond-limits", is_flag=True, help="Judge also where joints are outside their limits, or faster than these."
)
target_option: Final = robot_option(
    "--target",
    metavar='"X Y Z mm"',
    help="The point that results are about, in the tip's axes; else the sheet's, or the tip.",
)


def layer_options(command: Decorated) -> Decorated:
    """Add the options of what a page shows beside the arm."""
    for option in (
        click.option(
            "--calibrate",
            "calibrate_file",
            metavar="DATA.csv",
            help="Fit the sheet to readings, a file as for calibrate with the sheet's measurement:; "
            "show readings against predictions.",
        ),
        click.option(
            "--compensate",
            "compensate_file",
            metavar="FILE",
            help="Correct the poses of a file as for --trajectory or --grid in position; show the arm before and after.",
        ),
        click.option(
            "--path",
            "path_file",
            metavar="FILE",
            help="Show a path, a file as for --trajectory or --grid: what 95 % of robots keep at its points and all along it.",
        ),
        click.option(
            "--map",
            "map_file",
            metavar="FILE.yaml",
            help="Map a grid, a file as for --grid: within how much 95 % of robots stay at its places.",
        ),
    ):
        command = option(command)
    return command


def pose_options(command: Decorated) -> Decorated:
    """Add the options that :func:`precision_pin.cli.poses.read_poses` turns into poses."""
    for option in (
        pose_option(
            "--approach",
            metavar="DIRECTIONS",
            help=f'{_APPROACH_HELP}, or "previous": from the pose before it.',
        ),
        pose_option(
            "--grid",
            metavar="FILE.yaml",
            help="Poses: a grid over joint values, or over places by inverse kinematics.",
        ),
        pose_option(
            "--trajectory",
            metavar="FILE.csv",
            help="Poses: a row of joint names and units, as joint1 [deg], and rows of values; times come first.",
        ),
        pose_option(
            "--step",
            "steps",
            multiple=True,
            metavar='"0.1 s"',
            help="Poses between the rows of a trajectory: largest step in s, deg or mm; repeats.",
        ),
        pose_option("--q", "qs", multiple=True, metavar="VALUES", help=f"{_Q_HELP[:-1]}; repeats."),
        pose_option("--all-poses", is_flag=True, help="All of the sheet's poses."),
        pose_option(
            "--pose",
            "pose_names",
            multiple=True,
            metavar="NAME",
            help="One of the sheet's poses, the first if left out; repeats.",
        ),
    ):
        command = option(command)
    return command


def one_pose_options(command: Decorated) -> Decorated:
    """Add the options of one arm at one pose."""
    pose = pose_option("--pose", metavar="NAME", help="One of the sheet's poses; the first if left out.")
    q = pose_option("--q", metavar="VALUES", help=_Q_HELP)
    approach = pose_option("--approach", metavar="DIRECTIONS", help=f"{_APPROACH_HELP}.")
    for option in (quiet_option, all_warnings_option, chain_options, approach, q, pose, inputs_argument):
        command = option(command)
    return command


def describe_excess(arguments: Sequence[str]) -> str:
    """Return the message for more than one robot and one sheet."""
    return (
        f"one robot and one sheet are expected, got {' '.join(arguments)}; a sheet's name ends in .yaml, and values with "
        'blanks need quotes, as in --q "0 90 deg"'
    )
