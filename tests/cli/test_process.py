"""The installed command as a process: what it imports, signals, pipes, streams, and what the system does not give."""

import errno
import fcntl
import io
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from subprocess import PIPE
from unittest.mock import Mock

import llvmlite.binding as llvm
import pytest
from fuzzing.interrupts import CASES, disturb, run_undisturbed

from precision_pin.base import interrupts
from precision_pin.base.errors import OutputError
from precision_pin.base.files import whole_folder, write_text
from precision_pin.cli import streams
from precision_pin.cli.streams import shortage
from precision_pin.robot.examples import PAPER_SHEET

LIGHT = {"matplotlib", "meshcat", "xarray", "yourdfpy"}
LISTING = os.environ | {"PYTHONPROFILEIMPORTTIME": "1"}
HEAVY = {*LIGHT, "numpy", "scipy", "pinocchio", "numba", "pydantic", "ruamel", "tqdm"}
FULL = "precision-pin: error E_OUTPUT: cannot write to the standard output: No space left on device\n"
needs_full = pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux has a device that is always full")


def listed(stderr):
    """Return the top-level modules that a process has imported, which was told to list them with the times they took."""
    return set(re.findall(r"^import time: .* \| +([^.\s]+)", stderr.decode(errors="replace"), re.MULTILINE))


def test_help_imports_nothing_heavy():
    code = (
        "import contextlib, sys\nfrom precision_pin.cli import main\nfor line in '--help', 'analyze --help', 'nosuch':\n"
        "    sys.argv = ['precision-pin', *line.split()]\n    with contextlib.suppress(SystemExit): main()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], env=LISTING, capture_output=True, timeout=60, check=True)
    assert listed(done.stderr) & {*HEAVY, "click"} == {"click"}


def shell(line, folder):
    """Run a line in which PP is the command; return exit code, stdout and stderr."""
    command = line.replace("PP", f"{sys.executable} -m precision_pin")
    done = subprocess.run(["bash", "-c", command], cwd=folder, capture_output=True, text=True, timeout=60)
    return done.returncode, done.stdout, done.stderr


# streams -------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_reader_that_has_gone_is_no_error(executable, folder):
    """As after ``| head`` has left: a pipe to write to that nobody reads."""
    arguments = ("analyze", "--samples", "100", "--json", "result.json", "--spec", "1 nm")
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as gone:
        done = subprocess.run([executable, *arguments], cwd=folder, stdout=gone, stderr=PIPE, text=True, timeout=60)
    assert not re.search("Traceback|Errno|Exception", done.stderr)
    assert done.returncode == 1
    # what was asked for besides is written
    assert json.loads((folder / "result.json").read_text("utf-8"))["samples"] == 100


@pytest.mark.slow
@needs_full
def test_streams_that_are_full(folder):
    # a full stderr changes nothing
    lines = "PP explain > /dev/full; echo $?; PP nosuch 2> /dev/full; echo $?"
    assert shell(lines, folder) == (0, "2\n2\n", FULL)


@pytest.mark.slow
def test_closed_streams(folder):
    code, _, err = shell("PP init 4dof.urdf --out new.yaml >&- 2>&- <&-", folder)
    assert (code, "Traceback" in err) == (0, False)
    # no stream's number was given to the file
    assert (folder / "new.yaml").read_text("utf-8").startswith("# Error sheet of the robot")
    assert shell("PP explain >&-", folder) == (0, "", "")


@pytest.mark.slow
def test_an_output_that_cannot_show_greek_and_mcpc_needs_no_compiler(executable, folder):
    environment = LISTING | {"PYTHONIOENCODING": "latin-1"}
    done = subprocess.run([executable, "mcpc"], cwd=folder, env=environment, capture_output=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "offset °  \\u03b1 °".encode("latin-1") in done.stdout
    assert listed(done.stderr) & {*LIGHT, "numpy", "numba"} == {"numpy"}


@pytest.mark.slow
def test_exit_code_and_streams_of_the_installed_command_and_a_file_whose_name_is_not_utf8(executable, folder):
    if sys.platform != "linux":
        pytest.skip("such names exist on Linux only")
    name = b"arm\xff.urdf"
    (folder / "gantry.urdf").rename(os.fsdecode(bytes(folder) + b"/" + name))
    arguments = [executable.encode(), b"analyze", name, b"gantry.errors.yaml", b"--samples", b"10"]
    arguments += [b"--json", b"result.json", b"--spec", b"1 nm", b"--q", b"0 mm, 200 deg"]
    done = subprocess.run(arguments, cwd=folder, env=LISTING, capture_output=True, timeout=60)
    assert done.returncode == 1, done.stderr
    # a table needs no drawing
    assert listed(done.stderr) & {*LIGHT, "numba"} == {"numba"}
    assert b"W_JOINT_LIMIT" in done.stderr
    assert done.stdout.startswith(b"arm\\udcff.urdf: ")
    assert json.loads((folder / "result.json").read_text("utf-8"))["robot"] == "arm\udcff.urdf"


@pytest.mark.slow
def test_a_working_folder_that_is_gone_and_too_little_address_space(folder):
    code, out, err = shell("mkdir gone; cd gone; rmdir ../gone; PP export --out new", folder)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "No such file or directory" in err
    if sys.platform != "linux":
        pytest.skip("macOS has no such limit")
    code, out, err = shell("ulimit -v 600000; PP analyze", folder)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "error E_RESOURCES: the address space is limited to 614 MB" in err


def test_what_the_system_does_not_give():
    for error, words in (
        (MemoryError(), "not enough memory"),
        (RuntimeError("can't start new thread"), "no more threads"),
        (RuntimeError("std::bad_alloc"), "not enough memory"),
        (ImportError("libx.so: cannot allocate memory in static TLS block"), "not enough memory"),
        (OSError(errno.EMFILE, os.strerror(errno.EMFILE)), "Too many open files; a limit"),
    ):
        assert str(shortage(error)).startswith("precision-pin: error E_RESOURCES: ")
        assert words in str(shortage(error))
    assert shortage(ValueError("planted")) is None
    assert shortage(OSError(errno.ENOENT, "no such file")) is None


@pytest.mark.slow
def test_a_working_folder_that_is_gone_is_one_line(refused, monkeypatch, tmp_path):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    asked = ("analyze", str(PAPER_SHEET), "--samples", "10", "--processes", "2")
    assert refused(*asked).startswith("precision-pin: error E_RESOURCES: the working folder no longer exists; ")


def test_threads_that_do_not_start_and_a_lack_of_memory_are_one_line(refused, monkeypatch):
    model = "precision_pin.model.error_model.ErrorModel.from_sheet"
    with monkeypatch.context() as patch:
        patch.setattr(model, Mock(side_effect=MemoryError))
        assert "E_RESOURCES" in refused("analyze")
    monkeypatch.setattr(threading.Thread, "start", Mock(side_effect=RuntimeError("can't start new thread")))
    assert "E_RESOURCES: the system lets no thread start" in refused("mcpc")


def test_a_pipe_that_is_full_for_now_is_waited_for():
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    text = "x" * 200_000
    with subprocess.Popen(["wc", "-c"], stdin=reading, stdout=PIPE) as reader:
        os.close(reading)
        stream = io.TextIOWrapper(io.BufferedWriter(streams._Tolerant(writing)), "utf-8")
        stream.write(text)
        stream.flush()
        os.close(writing)
        assert reader.communicate()[0].split() == [b"200000"]


@needs_full
def test_output_is_told_lost_once(monkeypatch):
    with open("/dev/full", "wb") as device:
        stream = io.TextIOWrapper(io.BufferedWriter(streams._Tolerant(device.fileno())), "utf-8")
        monkeypatch.setattr(sys, "stdout", stream)
        print("text")
        with pytest.raises(OutputError, match="No space left"):
            streams.raise_if_output_lost()
        streams.raise_if_output_lost()


def test_what_clears_a_progress_bar_comes_before_what_follows():
    code = "from precision_pin.cli.streams import *; prepare_streams(); sys.stderr.write('bar\\r'); os._exit(0)"
    done = subprocess.run([sys.executable, "-c", f"import os, sys; {code}"], capture_output=True, timeout=60)
    assert done.stderr == b"bar\r"


# signals: what is half-written goes, what must be whole is, and the exit code tells the signal -------------------------


@pytest.mark.slow
def test_ctrl_c_while_the_sampler_is_compiled(executable, folder, new_files, tmp_path_factory):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path_factory.mktemp("cache"))}
    command = [executable, "analyze", "--samples", "100000000000"]
    process = subprocess.Popen(command, cwd=folder, env=environment, stdout=PIPE, stderr=PIPE, text=True)
    try:
        assert process.stderr.readline().startswith("compiling the sampler")
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=5)
    finally:
        process.kill()
    assert (process.returncode, out, err) == (130, "", "interrupted\n")
    assert new_files() == set()


SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Left(BaseException):
    """The process would have ended here."""


@pytest.fixture
def heeded(monkeypatch):
    def leave(code):
        raise Left(code)

    monkeypatch.setattr(os, "_exit", leave)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # as nohup, under which tests may run, it would stay ignored
    interrupts.take_over()
    yield
    interrupts.end()


def signals_in(monkeypatch, owner, name, number, *, after):
    """Let a signal come before or after a step of writing."""
    real = getattr(owner, name)

    def disturbed(*arguments, **settings):
        result = real(*arguments, **settings) if after else None
        signal.raise_signal(number)
        return result if after else real(*arguments, **settings)

    monkeypatch.setattr(owner, name, disturbed)


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize("after", [False, True])
@pytest.mark.parametrize("step", ["write_bytes", "replace"])
def test_a_file_is_whole_or_as_before(heeded, tmp_path, monkeypatch, capfd, number, step, after):
    (tmp_path / "file").write_text("before")
    signals_in(monkeypatch, Path, step, number, after=after)
    with pytest.raises(Left) as left:
        write_text(tmp_path / "file", "new")
    assert left.value.args == (128 + number,)
    assert (tmp_path / "file").read_text() == ("new" if step == "replace" and after else "before")
    assert os.listdir(tmp_path) == ["file"]
    assert capfd.readouterr().err == {2: "interrupted\n", 15: "terminated\n", 1: "hung up\n"}[number]


def write_in(folder, *names):
    with whole_folder(folder) as stage:
        for name in names:
            (stage / name).write_text(name)


@pytest.mark.parametrize("after", [False, True])
@pytest.mark.parametrize("step", ["mkdir", "write_text"])
def test_a_folder_is_not_there_if_it_is_not_whole(heeded, tmp_path, monkeypatch, step, after):
    signals_in(monkeypatch, Path, step, signal.SIGTERM, after=after)
    with pytest.raises(Left):
        write_in(tmp_path / "a" / "b", "one")
    assert os.listdir(tmp_path) == []


def test_files_of_a_folder_are_moved_all_or_none(heeded, tmp_path, monkeypatch):
    signals_in(monkeypatch, Path, "replace", signal.SIGINT, after=True)
    with pytest.raises(Left):
        write_in(tmp_path / "new", "one", "two", "three")
    assert sorted(os.listdir(tmp_path / "new")) == ["one", "three", "two"]


def test_files_move_into_a_folder_while_others_wait_and_wait_for_others(tmp_path, monkeypatch):
    """Of two processes that write one folder one writes all of it: a lock on a folder holds against its other openings too."""
    events, replace = [], Path.replace

    def lock():
        descriptor = os.open(tmp_path, os.O_RDONLY)
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return descriptor

    def move(file, target):
        with pytest.raises(BlockingIOError):
            lock()
        events.append(target.name)
        return replace(file, target)

    def leave():
        events.append("the other has ended")
        os.close(other)

    monkeypatch.setattr(Path, "replace", move)
    other = lock()
    threading.Timer(0.2, leave).start()
    write_in(tmp_path, "one", "two")
    assert events == ["the other has ended", "one", "two"]
    os.close(lock())


def test_work_that_is_worth_keeping_is_unwound_and_a_second_signal_is_not_waited_for(heeded):
    with pytest.raises(KeyboardInterrupt), interrupts.unwinding():
        signal.raise_signal(signal.SIGTERM)
    assert interrupts.came() == signal.SIGTERM
    with pytest.raises(Left):
        signal.raise_signal(signal.SIGINT)


def test_a_signal_in_an_import_ends_the_process_at_once(heeded, tmp_path, monkeypatch):
    (tmp_path / "signals_in_it.py").write_text("import signal\nsignal.raise_signal(signal.SIGINT)\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(Left), interrupts.unwinding():
        import signals_in_it  # noqa: F401


def test_a_signal_in_the_compiler_is_heeded_when_it_is_done(heeded, capfd):
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly("define void @f() {\n ret void\n}"), machine)
    # LLVM, which is C, calls this: an exception would be printed and lost
    engine.set_object_cache(lambda module, code: signal.raise_signal(signal.SIGTERM))
    with interrupts.unwinding():
        engine.finalize_object()
    assert interrupts.came() == signal.SIGTERM
    with pytest.raises(KeyboardInterrupt):
        interrupts.raise_if_interrupted()
    assert capfd.readouterr().err == ""


def test_a_signal_in_a_finaliser_is_heeded_when_it_is_done(heeded, capfd):
    class Ended:
        def __del__(self):
            signal.raise_signal(signal.SIGHUP)

    with interrupts.unwinding():
        Ended()
    with pytest.raises(KeyboardInterrupt):
        interrupts.raise_if_interrupted()
    assert capfd.readouterr().err == ""


def test_signals_that_are_ignored_stay_so():
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    interrupts.take_over()
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
    interrupts.end()


def test_other_threads_take_no_signals():
    before = [signal.getsignal(number) for number in SIGNALS]
    thread = threading.Thread(target=interrupts.take_over)
    thread.start()
    thread.join()
    assert [signal.getsignal(number) for number in SIGNALS] == before
    interrupts.end()


@pytest.mark.slow
def test_a_process_that_is_deep_in_a_library_ends_all_the_same():
    # a library in C that takes up its sleep again
    code = (
        "import ctypes, time\n"
        "from precision_pin.base import interrupts\n"
        "interrupts.take_over(); interrupts.begin()\n"
        "print('deep', flush=True)\n"
        "end = time.monotonic() + 30\n"
        "while time.monotonic() < end: ctypes.CDLL(None).poll(None, 0, 30000)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=PIPE, stderr=PIPE) as process:
        process.stdout.readline()
        process.send_signal(signal.SIGTERM)
        _, err = process.communicate(timeout=20)
    assert (process.returncode, err) == (143, b"terminated\n")


@pytest.mark.slow
def test_a_signal_at_some_time():
    """A journal that is interrupted is tried in tests/sampling."""
    usual = run_undisturbed(CASES["init"])
    assert disturb("init", usual, signal.SIGTERM, 0.3 * usual.seconds, whole_group=False).wrong == []
