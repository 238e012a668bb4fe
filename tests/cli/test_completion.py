"""Completion in the shell: in this process by click's classes, and in bash, zsh and fish themselves."""

import os
import pty
import re
import select
import shlex
import shutil
import subprocess
import sys
import time

import click
import pytest

from precision_pin.analyses.budget.budget import SAMPLED
from precision_pin.cli import completion
from precision_pin.cli.explain import list_codes
from precision_pin.cli.program import cli, list_commands, load_command
from precision_pin.robot.examples import PREFIX, example_urdfs, own_urdfs, shipped_sheets
from precision_pin.sheet import changes, read
from precision_pin.terms.bound_source import labels

SHEET = """precision-pin: 1
robot: gantry.urdf
tip: tool
poses: {out: 1 m, work place: 2 m}
parameters: {a1: ±0.1 mm}
sources:
  - payload: {at: tool, mass: {uniform: 0.1 kg, mean: 1 kg}}
  - joint_offset: {joint: y_axis, offset: {uniform: 0.1 mm}}
  - joint_offset: {joint: y_axis, offset: 0.2 mm}
"""
FREE = {
    *(
        "--approach",
        "--attitude-std",
        "--anchor",
        "--axes",
        "--columns",
        "--dask",
        "--goal",
        "--load",
        "--point",
        "--probability",
        "--rated",
        "--spec",
    ),
    *("--std", "--step", "--target", "--until", "--visible-from", "--weights", "arguments"),
}
"""Options whose values are free text."""


@pytest.fixture
def completed(folder, monkeypatch):
    """Return a function of a line up to the cursor: the words that zsh or another shell is told."""
    (folder / "g1.yaml").write_text(SHEET)
    for name in ("g1.csv", "g1.txt", "g1.html", ".hidden.yaml", "sub/g1.yaml"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).touch()

    def complete(line, shell=completion.Zsh):
        monkeypatch.setenv("COMP_LINE", f"precision-pin {line}")
        comp = shell(cli, {}, "precision-pin", "_PRECISION_PIN_COMPLETE")
        return [item.value for item in comp.get_completions(*comp.get_completion_args())]

    return complete


def test_files_folders_and_examples_complete(completed):
    expected = {
        "analyze g1": ["g1.yaml"],
        "analyze gantry": ["gantry.errors.yaml", "gantry.urdf"],
        "analyze ./g1": ["./g1.yaml"],
        "analyze s": ["sub/"],
        "analyze sub/": ["sub/g1.yaml"],
        "analyze .h": [".hidden.yaml"],
        "analyze none/": [],
        "compare g1": ["g1.yaml"],
        "calibrate g1": ["g1.csv", "g1.yaml"],
        "analyze g1.yaml --trajectory g1": ["g1.csv"],
        "analyze --json g1": ["g1.csv", "g1.html", "g1.txt", "g1.yaml"],
        "analyze --json=g1.t": ["--json=g1.txt"],
        "view --out g1": ["g1.html"],
        "calibrate --factory g1.t": ["g1.txt"],
        # no table has the suffix, but one may be called so
        "analyze --trajectory g1.t": ["g1.txt"],
        "analyze --out ": ["sub/"],
        "analyze --package-dir ": ["sub/"],
        "analyze exam": [PREFIX],
        "analyze g1.yaml gantry.urdf other.urdf g1": ["g1.yaml"],
        "nosuch g1": [],
    }
    assert {line: completed(line) for line in expected} == expected
    assert completed("analyze ") == ["4dof.errors.yaml", "4dof.urdf", "forked.urdf", "g1.yaml", "gantry.errors.yaml",
                                     "gantry.urdf", "sub/", PREFIX]  # fmt: skip
    known = {PREFIX + name for name in own_urdfs() | example_urdfs()}
    assert set(completed("init example:")) == known
    assert set(completed("init example:ur5")) == {name for name in known if name.startswith("example:ur5")}


@pytest.mark.slow
def test_what_sheet_and_robot_name_completes(completed):
    sections = [
        f"{name}." if name in ("parameters", "poses") else f"{name}="
        for name in completion.SECTIONS
        if name != "locked"
    ]
    expected = {
        "analyze g1.yaml --pose ": ["out", "work place"],
        "analyze g1.yaml --pose 'wo": ["work place"],
        "map g1.yaml --pose out --relative-to ": ["out", "work place"],
        "calibrate g1.yaml g1.csv --at=o": ["--at=out"],
        "analyze --pose ": ["paper"],
        "analyze 4dof.urdf --pose ": ["paper"],
        "analyze example:ur5 --pose ": list(read(shipped_sheets()["ur5"]).poses),
        "analyze g1.yaml --tip ": ["frame", "Schlitten_ü", "腕", "tool"],
        "mcpc gantry.urdf --base t": ["tool"],
        "analyze g1.yaml --q ": ["y_axis:", "a_rather_long_name_for_a_joint_that_turns_about_x_of_the_carriage:"],
        'analyze g1.yaml --tip Schlitten_ü --q "': ["y_axis:"],
        "analyze 4dof.urdf --base link1 --tip link3 --q ": ["joint2:", "joint3:"],
        'analyze 4dof.urdf --q "joint1: 10 deg, joint2: 3 deg, jo': [
            f"joint1: 10 deg, joint2: 3 deg, joint{k}:" for k in (3, 4)
        ],
        "analyze g1.yaml --set par": ["parameters."],
        "analyze g1.yaml --set parameters.": ["parameters.a1="],
        "analyze g1.yaml --set poses.": ["poses.out=", "poses.work place="],
        "analyze g1.yaml --set payload.": ["payload.at=", "payload.mass=", "payload.mass."],
        "analyze g1.yaml --set payload.mass.": ["payload.mass.uniform=", "payload.mass.mean="],
        "analyze g1.yaml --set payload.mass=": [],
        "analyze g1.yaml --set joint": ["joint_offset[*].", "joint_offset[y_axis].", "joint_offset[y_axis]#2."],
        "calibrate g1.yaml --only ": ["payload", "joint_offset"],
        "calibrate --kind d": ["distance"],
        "budget --quantity ": [*SAMPLED],
        "explain w_superp": ["W_SUPERPOSITION"],
        "analy": ["analyze"],
        "analyze --rel": ["--relative-to"],
    }
    unordered = ("budget --quantity ",)
    for line, words in expected.items():
        found = completed(line)
        assert (sorted(found), len(found)) == (sorted(words), len(words)) if line in unordered else found == words, line
    assert sorted(completed("analyze g1.yaml --set ")) == sorted(
        [
            *sections,
            "payload.",
            "payload[tool].",
            "joint_offset[*].",
            "joint_offset[y_axis].",
            "joint_offset[y_axis]#2.",
        ]
    )
    assert set(completed("explain ")) == {
        name for group in list_codes().values() for one in group.codes for name in one.names
    }
    assert set(completed("")) == set(list_commands())
    # the keys are those that --set knows
    assert sorted(completion.SECTIONS) == sorted(changes._SECTIONS)


@pytest.mark.parametrize(
    "name", ["4dof", pytest.param("panda", marks=pytest.mark.slow), pytest.param("xarm7", marks=pytest.mark.slow)]
)
def test_sources_have_the_labels_of_the_model(completed, name):
    sheet = read(shipped_sheets()[name])
    words = {word.removesuffix(".") for word in completed(f"analyze example:{name} --set ")}
    assert {label for label in labels(sheet.sources) if label != "thermal[arm]"} <= words


def test_every_option_with_a_value_completes_or_is_free(completed):
    """An option is a number, a choice, or has a placeholder that something completes; of files every one."""
    wrong = []
    for command in map(load_command, list_commands()):
        for one in command.params:
            name, placeholder = (one.opts[0], (one.metavar or "").strip("[]."))
            is_plain = getattr(one, "is_flag", False) or not isinstance(one.type, click.Path | type(click.STRING))
            is_completed = (
                isinstance(one.type, click.Path)
                or placeholder in completion._NAMES
                or re.search(r"\.[a-z]", placeholder)
            )
            if not is_plain and bool(is_completed) == (name in FREE):
                wrong.append(f"{command.name} {name} {placeholder}")
            if re.search(r"\b(FILE|DIR)\b", placeholder) and not isinstance(one.type, click.Path):
                wrong.append(f"{command.name} {name} names a file")
    assert wrong == []


BROKEN = {
    "deep": "poses: {out: 1}\nsources: " + "[" * 100_000,
    "half": SHEET + "  - encoder: {joint: [",
    "text": "\x00\xff{{{",
    "list": "- 1\n- 2\n",
    "flat": "poses: 3\nsources: none\nrobot: [1]\ntip: {a: b}\nlocked: 1\n",
    "keys": "? [a, b]\n: 1\nposes: {? {a: b} : c}\n",
    "alias": "robot: &a gantry.urdf\nposes: {out: *a}\nsources: [*a, &b [*b]]\n",
    "empty": "",
}


@pytest.mark.slow
def test_broken_inputs_complete_in_silence(completed, folder, capfd):
    """What is before the mistake completes; nothing is printed, and nothing ends in an error."""
    (folder / "loop.urdf").write_text(
        '<robot><joint name="a" type="revolute"><parent link="x"/><child link="y"/></joint>'
        '<joint name="b" type="revolute"><parent link="y"/><child link="x"/></joint>'
    )
    (folder / "bad.urdf").write_text(
        '<robot name="r"><link name="base"/><link name="tip"/><joint name="j" type="revolute"><oops'
    )
    (folder / "no.urdf").write_bytes(b"\xff\xfe\x00<")
    os.mkfifo(folder / "pipe.yaml")
    for name, text in BROKEN.items():
        (folder / f"{name}.yaml").write_text(text, "utf-8")
    names = [
        *(f"{name}.yaml" for name in BROKEN),
        "pipe.yaml",
        "gone.yaml",
        "loop.urdf",
        "bad.urdf",
        "no.urdf",
        "gone.urdf",
    ]
    options = (
        "--pose ",
        "--tip ",
        "--q ",
        "--set ",
        "--relative-to ",
        "--json gone/",
        "",
        "x y z ",
        "--nosuch ",
        "--samples x --pose ",
    )
    for name in names:
        for option in options:
            completed(f"analyze {name} {option}", completion.Bash)
    assert completed("analyze half.yaml --pose ") == ["out", "work place"]
    assert completed("analyze deep.yaml --pose ") == ["out"]
    assert completed("analyze bad.urdf --tip ") == ["base", "tip"]
    assert set(completed("analyze loop.urdf --tip y --q ")) == {"a:", "b:"}
    for line in (
        "nosuch ",
        "analyze g1.yaml gantry.urdf more.urdf --pose ",
        "analyze example:nosuch --pose ",
        "'",
        "analyze \\",
    ):
        completed(line)
    assert capfd.readouterr() == ("", "")


def test_bash_is_told_the_last_part_of_a_word(completed, monkeypatch):
    """Bash replaces what follows the last quote, colon or equals sign, its second argument."""
    for line, last, quoted, words in (
        ("analyze example:ur5e", "ur5e", "ur5e", ["ur5e"]),
        ("analyze 'example:ur5e", "example:ur5e", "'example:ur5e", ["example:ur5e"]),
        ("analyze --json=g1.t", "g1.t", "g1.t", ["g1.txt"]),
        ("analyze g1.yaml --pose w", "w", "w", ["work\\ place"]),
        ("analyze g1.yaml --pose work\\ p", "work\\ p", "work\\ p", ["work\\ place"]),
        ('analyze g1.yaml --pose "w', "w", '"w', ["work place"]),
        (
            "analyze g1.yaml --set joint_offset[y_axis]#",
            *["joint_offset[y_axis]#"] * 2,
            ["joint_offset\\[y_axis\\]\\#2."],
        ),
        (
            'analyze 4dof.urdf --q "joint1: 3 deg, joint2',
            "joint1: 3 deg, joint2",
            '"joint1: 3 deg, joint2',
            ["joint1: 3 deg, joint2:", "joint1: 3 deg, joint2: "],
        ),
        # of one that goes on, bash would close the quote
        ('analyze 4dof.urdf --q "joint1', "joint1", '"joint1', ["joint1:", "joint1: "]),
    ):
        monkeypatch.setenv("COMP_WORD", last)
        monkeypatch.setenv("COMP_QUOTED", quoted)
        assert completed(line, completion.Bash) == words, line


def test_the_examples_of_the_help_are_lines_that_run():
    """They parse: commands, options and choices exist, and their files are told by their endings."""
    above = click.Context(cli, **cli.context_settings)
    for name in ("map", "path", "compare", "compensate", "allocate", "simulate", "view", "export"):
        command = load_command(name)
        (example,) = re.findall(
            r"^ *Example: precision-pin (.*)$", command.get_help(click.Context(command, above)), re.MULTILINE
        )
        first, *words = shlex.split(example)
        assert first == name
        command.make_context(name, words, above)


@pytest.mark.slow
def test_completion_loads_no_slow_library(completed, folder):
    """A tab takes some 0.35 s, half of it click and the declarations; with these libraries it takes more than a second."""
    script = (
        "import atexit, sys; from precision_pin.cli import main; atexit.register(lambda: print(*sys.modules)); main()"
    )
    env = {**os.environ, "_PRECISION_PIN_COMPLETE": "zsh_complete", "COMP_LINE": "precision-pin analyze g1.yaml --q "}
    done = subprocess.run([sys.executable, "-c", script], env=env, capture_output=True, text=True, check=True)
    assert "y_axis:" in done.stdout
    assert not {"numpy", "pydantic", "pinocchio", "numba", "ruamel.yaml"} & set(done.stdout.split())


SHELLS = {
    "bash": ("--norc --noprofile -i", "bind 'set enable-bracketed-paste off'"),
    "zsh": ("-f -i", "bindkey -e; autoload -Uz compinit; compinit -D -u"),
}
LINES = {
    "analyze g1": "analyze g1.yaml ",
    'analyze g1.yaml --pose "w': "analyze g1.yaml --pose work place ",
    "analyze g1.yaml --set=payload\\[": "analyze g1.yaml --set=payload[tool].",
    "analyze ~/g1": "analyze ~/g1.yaml ",
}
"""Beginnings of lines, and what the words are after a tab, with a space after a whole one."""


def after_tab(shell, lines, env):
    """Return what lines have become after a tab in a shell at a terminal, printed by ``echo`` put in front of each."""
    options, start = SHELLS[shell]
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [shell, *options.split()], stdin=theirs, stdout=theirs, stderr=theirs, env=env, start_new_session=True
    )
    os.close(theirs)
    printed = ""

    def send(text, mark):
        nonlocal printed
        os.write(ours, text.encode())
        start, ends = len(printed), time.monotonic() + 20
        while not (found := re.search(mark, printed[start:])):
            assert select.select([ours], [], [], max(ends - time.monotonic(), 0))[0], printed
            printed += os.read(ours, 4096).decode(errors="replace")
        return found

    try:
        send(f'{start}; eval "$(_PRECISION_PIN_COMPLETE={shell}_source precision-pin)"; echo re""ady\n', r"ready\r")
        return [send(f"precision-pin {line}\t'>'\x01echo '<' \n", r"\n< precision-pin (.*?)>\r")[1] for line in lines]
    finally:
        process.kill()
        process.wait()
        os.close(ours)


@pytest.mark.slow
@pytest.mark.parametrize("shell", [*SHELLS, "fish"])
def test_the_shell_completes(completed, folder, executable, shell):
    if not shutil.which(shell):
        pytest.skip(f"{shell} is not installed")
    env = {
        **os.environ,
        "PATH": f"{os.path.dirname(executable)}:{os.environ['PATH']}",
        "HOME": str(folder),
        "TERM": "dumb",
    }
    if shell == "fish":
        script = "_PRECISION_PIN_COMPLETE=fish_source precision-pin | source; for line in $argv; complete -C $line; echo =; end"
        lines = [f"precision-pin {line}" for line in LINES]
        done = subprocess.run([shell, "-N", "-c", script, *lines], env=env, capture_output=True, text=True, check=True)
        assert done.stderr == ""
        words = [answer.strip("\n") for answer in done.stdout.split("=\n")[:-1]]
        # it answers with the last word
        assert words == [after[line.replace('"', "").rindex(" ") + 1 :].rstrip() for line, after in LINES.items()]
    else:
        found = [line.replace(str(folder), "~") for line in after_tab(shell, LINES, env)]
        assert dict(zip(LINES, found, strict=True)) == LINES
