"""Options of several commands, checks of all commands, compiling and progress."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any, Final, Literal

import click

from precision_pin.analyses.declaration import OUTPUT, POSES, ROBOT, SAMPLING, load
from precision_pin.analyses.registry import SPECIFICATIONS
from precision_pin.base.errors import PrecisionPinWarning
from precision_pin.base.interrupts import raise_if_interrupted, unwinding
from precision_pin.cli.streams import require_resources, say
from precision_pin.cli.terminal import echo_note, is_given, remember

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from precision_pin.draws.space import Space


Options = Mapping[str, Any]
"""Values of a command's options by argument."""
Decorator = Callable[[Any], Any]
OWN: Final = "Options"
_LAST: Final = (POSES, ROBOT, SAMPLING, OUTPUT)
"""Headings common to all commands, in their order after a command's own."""


class Command(click.Command):
    """A command that rejects a repeated single option, and more than one robot and one sheet."""

    data_suffixes: tuple[str, ...] = ()
    """Suffixes of inputs that are data beside robot and sheet."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the arguments."""
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
        if len(inputs) > 2 and not ctx.resilient_parsing:
            # before a leftover of an unquoted option value is taken for the value
            raise click.UsageError(describe_excess(inputs), ctx)
        return left

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options: those without a heading, those under the command's own headings, then the common ones."""
        groups: dict[str, list[tuple[str, str]]] = {OWN: []}
        help_option = self.get_help_option(ctx)
        for option in self.get_params(ctx):
            record = option.get_help_record(ctx) if isinstance(option, click.Option) else None
            if record is not None:
                heading = getattr(option, "heading", OUTPUT if option is help_option else OWN)
                groups.setdefault(heading, []).append(record)
        for heading in sorted(filter(groups.get, groups), key=lambda name: _LAST.index(name) if name in _LAST else -1):
            with formatter.section(heading):
                formatter.write_dl(groups[heading])

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command if the libraries load (``doctor`` always), with the package's warnings as findings."""
        if self.name != "doctor":
            require_resources()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PrecisionPinWarning)
            return super().invoke(ctx)


class SamplingCommand(Command):
    """A command that samples: where nothing is compiled yet, compilation starts while the inputs are read."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command."""
        from precision_pin.kernel.parts import begin_compiling

        begin_compiling()
        return super().invoke(ctx)


class _Completed(click.Parameter):
    """A parameter whose placeholder says what the shell completes."""

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem[str]]:
        """Return the values that begin with a text."""
        # by name, because completion reads the inputs of commands, which have these options
        items = load("precision_pin.cli.completion:complete")(self, ctx, incomplete)
        return super().shell_complete(ctx, incomplete) if items is None else items


class Option(_Completed, click.Option):
    """An option with the heading under which ``--help`` lists it."""

    def __init__(self, *arguments: Any, heading: str = OWN, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        self.heading = heading


class Argument(_Completed, click.Argument):
    """An argument of a command."""


headed_option: Final = partial(click.option, cls=Option)
argument: Final = partial(click.argument, cls=Argument)
pose_option: Final = partial(headed_option, heading=POSES)
robot_option: Final = partial(headed_option, heading=ROBOT)
sampling_option: Final = partial(headed_option, heading=SAMPLING)
output_option: Final = partial(headed_option, heading=OUTPUT)


def together(*options: Decorator) -> Decorator:
    """Return a decorator that adds several options to a command, in their order."""

    def add(command: Any) -> Any:
        for option in reversed(options):
            command = option(command)
        return command

    return add


FILE: Final = click.Path(readable=False)
"""Type of an option that names a file; whether it can be read or written is checked later."""
_Q_HELP: Final = 'Joint values: "-90 3 88 -91 deg", "0.1 m, 10 deg" or "joint1: 10 deg, …".'
_APPROACH_HELP: Final = 'How joints moved last: "joint1 +, joint2 -"'
inputs_argument: Final = argument("inputs", nargs=-1, metavar="[ROBOT.urdf] [SHEET.yaml]")
seed_option: Final = sampling_option("--seed", type=int, default=0, show_default=True, metavar="S", help="64-bit seed.")
model_option: Final = sampling_option(
    "--model",
    type=click.Choice(["exact", "linear"]),
    default="exact",
    show_default=True,
    help="The exact displaced chain, or superposition as in the paper.",
)
beyond_limits_option: Final = pose_option(
    "--beyond-limits",
    is_flag=True,
    help="Judge also where poses are not reached, or joints outside their limits or too fast.",
)
spec_option: Final = together(
    headed_option("--spec", "specs", multiple=True, metavar='"0.5 mm @ 99.73 %"', help="A limit, else the sheet's."),
    beyond_limits_option,
)
datum_option: Final = robot_option(
    "--datum",
    metavar="DATUM",
    help="Count errors against a datum of the sheet, or several, A,B, in order; none: base axes.",
)
target_option: Final = together(
    robot_option(
        "--target",
        metavar='"X Y Z mm"',
        help="The point that results are about, in the tip's axes; else the sheet's, or the tip.",
    ),
    datum_option,
)
json_option: Final = output_option(
    "--json", "json_path", type=FILE, metavar="FILE", help="Write the result as JSON; - prints it alone."
)
plots_option: Final = output_option(
    "--out", type=FILE, metavar="DIR", help="Write plots (PNG and SVG) and the result there."
)
_flag: Final = partial(output_option, is_flag=True, expose_value=False, callback=remember)
all_warnings_option: Final = _flag(
    "--all-warnings", help="Print every warning about sheet and robot, not one of each code."
)
quiet_option: Final = _flag("--quiet", help="Leave out notes and progress; warnings and errors stay.")
robot_options: Final = together(
    robot_option("--tip", metavar="FRAME", help="The end-effector; the sheet's or the only leaf if left out."),
    robot_option("--base", metavar="LINK", help="The fixed link; the sheet's or the root if left out."),
    robot_option(
        "--package-dir",
        "package_dirs",
        multiple=True,
        type=click.Path(exists=True, file_okay=False),
        metavar="DIR",
        help="Where ROS packages of meshes and xacro lie.",
    ),
)
"""Options that cut a chain out of a robot."""
chain_options: Final = together(
    robot_options,
    robot_option(
        "--set",
        "changes",
        multiple=True,
        metavar="PATH=VALUE",
        help="Change the sheet: 'parameters.a1=±0.1 mm', 'payload.mass=2 kg', 'KIND[*].KEY=VALUE'; repeats.",
    ),
    robot_option(
        "--ignore-collisions",
        "ignores_collisions",
        is_flag=True,
        help="Do not check poses for collisions and keep_out.",
    ),
    robot_option("--wrap", "wraps", is_flag=True, help="Take angles outside limits by whole turns inside."),
)
"""Options that change a sheet and cut a chain out of its robot."""
pose_options: Final = together(
    pose_option(
        "--pose",
        "pose_names",
        multiple=True,
        metavar="POSE",
        help="One of the sheet's poses, the first if left out; repeats.",
    ),
    pose_option("--all-poses", is_flag=True, help="All of the sheet's poses."),
    pose_option("--q", "qs", multiple=True, metavar="VALUES", help=f"{_Q_HELP[:-1]}; repeats."),
    pose_option(
        "--step",
        "steps",
        multiple=True,
        metavar='"0.1 s"',
        help="Poses between the rows of a trajectory: largest step in s, deg or mm; repeats.",
    ),
    pose_option(
        "--trajectory",
        type=FILE,
        metavar="FILE.csv",
        help="Poses: a row of joint names and units, as joint1 [deg], and rows of values; perhaps times, as t [s].",
    ),
    pose_option(
        "--columns",
        metavar="TEXT",
        help="Columns of poses and readings: 'q1=joint1 [deg], n=ignore'; of all others '*=[m rad]' or '*=ignore'.",
    ),
    pose_option(
        "--grid",
        type=FILE,
        metavar="FILE.yaml",
        help="Poses: a grid over joint values, or over places by inverse kinematics.",
    ),
    pose_option("--approach", metavar="DIRECTIONS", help=f'{_APPROACH_HELP}, or "previous": from the pose before it.'),
)
"""Options for :func:`precision_pin.cli.poses.read_poses`."""
arm_options: Final = together(inputs_argument, pose_options, target_option, chain_options)
"""Robot, sheet and poses of a command that shows or samples them."""
one_pose_options: Final = together(
    inputs_argument,
    pose_option("--pose", metavar="POSE", help="One of the sheet's poses; the first if left out."),
    pose_option("--q", metavar="VALUES", help=_Q_HELP),
    pose_option("--approach", metavar="DIRECTIONS", help=f"{_APPROACH_HELP}."),
    chain_options,
    all_warnings_option,
    quiet_option,
)
"""Options of one arm at one pose."""


def describe_excess(arguments: Sequence[str]) -> str:
    """Return the message for more than one robot and one sheet."""
    return (
        f"one robot and one sheet are expected, got {' '.join(arguments)}; a sheet's name ends in .yaml, and values with "
        'blanks need quotes, as in --q "0 90 deg"'
    )


worker_options: Final = together(
    sampling_option("--threads", type=int, metavar="N", help="How many threads sample; all cores if left out."),
    sampling_option("--processes", type=int, metavar="N", help="Sample in N processes instead."),
    sampling_option("--dask", metavar="ADDRESS", help="Sample on the Dask cluster of a scheduler, as tcp://host:8786."),
    sampling_option(
        "--journal",
        type=FILE,
        metavar="FILE",
        help="Keep the run in FILE on the way, so that it can be stopped and resumed.",
    ),
    sampling_option("--resume", is_flag=True, help="Go on from the journal, if it is there."),
)


NO_SPECS: Final = ("none",)
"""Value of ``--spec`` that judges nothing, whatever the sheet says."""


def check_specs(texts: Sequence[str], check: str = SPECIFICATIONS) -> None:
    """Reject a wrong ``--spec`` before any input is read."""
    if tuple(texts) != NO_SPECS:
        load(check)(texts)


def check_workers(options: Options) -> None:
    """Reject more than one kind of worker, and ``--resume`` without ``--journal``."""
    asked = [f"--{name}" for name in ("threads", "processes", "dask") if options[name] is not None]
    if len(asked) > 1:
        raise click.UsageError(f"{' and '.join(asked)} exclude each other")
    if options["resume"] and options["journal"] is None:
        raise click.UsageError("--resume needs the run's --journal FILE")


@contextmanager
def working(options: Options) -> Iterator[dict[str, Any]]:
    """Start and stop the workers; yields the sampling arguments. An interrupt reports what the journal holds."""
    from precision_pin.sampling import dask_cluster

    with ExitStack() as stack:
        cluster = None if options["dask"] is None else stack.enter_context(dask_cluster(options["dask"]))
        executor, under_way = cluster or (None, None)
        try:
            with unwinding():
                settings = {name: options[name] for name in ("threads", "processes", "journal", "resume")}
                yield {**settings, "executor": executor, "tasks_under_way": under_way, "tell": echo_note}
                raise_if_interrupted()
        except KeyboardInterrupt as interrupt:
            for note in getattr(interrupt, "__notes__", ()):
                say(f"{note}; the same command with --resume goes on from there")
            raise


def compile_sampler(space: Space, model: Literal["exact", "linear"] = "exact") -> None:
    """Compile the sampler of a model with progress, if this machine never did."""
    from precision_pin.base.compile_ahead import COMPILING_NOTE, shown_by, silent
    from precision_pin.base.progress import compilation
    from precision_pin.kernel import sampler

    variant = sampler.variant_of(space, model)
    if sampler.is_compiled(*variant):
        return
    on_terminal = sys.stderr.isatty()
    if not on_terminal:
        echo_note(COMPILING_NOTE)
    with shown_by(compilation if on_terminal and not is_given("quiet") else silent):
        sampler.warm_up(*variant)
    raise_if_interrupted()


@contextmanager
def progress_bar(total: int, what: str, unit: str = "samples", delay: float = 0.7) -> Iterator[Callable[[int], None]]:
    """Show progress on a terminal after ``delay`` s, unless quiet; yield a step function that stops at an interrupt."""
    if is_given("quiet"):
        yield lambda _: raise_if_interrupted()
        return
    from precision_pin.base.progress import progress

    with progress(total, what, delay=delay, unit=unit) as step:

        def advance(count: int) -> None:
            raise_if_interrupted()
            step(count)

        yield advance
