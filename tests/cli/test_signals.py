"""Signals that end the program: what is half-written goes, what must be whole is, and the exit code tells the signal."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import llvmlite.binding as llvm
import pytest
from fuzzing.interrupts import CASES, disturb, run_undisturbed

from precision_pin.base import interrupts
from precision_pin.base.files import whole_folder, write_text

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Left(BaseException):
    """The process would have ended here."""


@pytest.fixture
def heeded(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    def leave(code: int) -> None:
        raise Left(code)

    monkeypatch.setattr(os, "_exit", leave)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # as nohup, under which tests may run, it would stay ignored
    interrupts.take_over()
    yield
    interrupts.end()


def signals_in(monkeypatch: pytest.MonkeyPatch, owner: type, name: str, number: int, *, after: bool) -> None:
    """Let a signal come before or after a step of writing."""
    real = getattr(owner, name)

    def disturbed(*arguments: object, **settings: object) -> object:
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


def write_in(folder: Path, *names: str) -> None:
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


@pytest.mark.slow
def test_of_two_processes_that_write_one_folder_one_writes_all_of_it(tmp_path):
    code = (
        "import sys; from pathlib import Path; from precision_pin.base.files import whole_folder\n"
        "for line in sys.stdin:\n"
        "    with whole_folder(Path(line.strip())) as stage:\n"
        "        for k in range(300): (stage / str(k)).write_text(sys.argv[1])\n"
        "        print(flush=True); sys.stdin.readline()\n"
        "    print(flush=True)\n"
    )
    both = [
        subprocess.Popen(
            [sys.executable, "-c", code, name], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        for name in "ab"
    ]
    mixed = []
    for round_ in range(10):
        for text in (f"{tmp_path}/{round_}\n", "\n"):  # all files are written, then both move theirs
            for process in both:
                process.stdin.write(text)
            for process in both:
                process.stdout.readline()
        found = {file.read_text() for file in (tmp_path / str(round_)).iterdir()}
        mixed += [round_] if len(found) > 1 else []
    for process in both:
        process.communicate()
    assert mixed == []


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
        def __del__(self) -> None:
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
    code = (
        "import time\n"
        "from precision_pin.base import interrupts\n"
        "interrupts.take_over(); interrupts.begin()\n"
        "import ctypes\n"
        "print('deep', flush=True)\n"
        "libc = ctypes.CDLL(None)\n"
        "end = time.monotonic() + 30\n"
        "while time.monotonic() < end: libc.sleep(30)\n"
    )
    # a library in C that takes up its sleep again
    code = code.replace("libc.sleep(30)", "libc.poll(None, 0, 30000)")
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGTERM)
        _, err = process.communicate(timeout=20)
    assert (process.returncode, err) == (143, b"terminated\n")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "number", "share"),
    [
        ("init", signal.SIGTERM, 0.3),
        ("view", signal.SIGHUP, 0.8),
        ("analyze, journal", signal.SIGINT, 0.6),
    ],
)
def test_a_signal_at_some_time(case, number, share):
    usual = run_undisturbed(CASES[case])
    assert disturb(case, usual, number, share * usual.seconds, whole_group=False).wrong == []
