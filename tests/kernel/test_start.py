"""First call: one compilation for all robots, ahead in other processes; a cache that is damaged; plain Python."""

import importlib.util
import inspect
import json
import os
import subprocess
import sys
import time
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

import precision_pin
from kernel.cases import EVERY_LAW, plain_table, random_table
from precision_pin.base import compile_ahead, jit
from precision_pin.base.compile_ahead import Job, compile_jobs, shown_by, silent
from precision_pin.base.jit import INTERPRETED, cached_entry
from precision_pin.draws.correlation import Correlation
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.laws import Arcsine, Circle, Disc, JointNormal, Lognormal, Normal, Sphere, Triangular, Uniform
from precision_pin.draws.space import Space
from precision_pin.kernel import loops, parts, sampler
from precision_pin.kernel.parts import PARTS
from precision_pin.statistics import Plan, Specification

MODELS: tuple[sampler.Model, ...] = ("exact", "linear")
PACKAGE = Path(precision_pin.__file__).parent
TESTS = Path(__file__).parents[1]

SMALL = """
from precision_pin.base.jit import cached_entry, cached_part

@cached_part
def part(x, k):
    return 2.0 * x[k]

@cached_entry
def run(x, result):
    for k in range(x.size):
        result[k] = part(x, k) + 1.0
"""
"""An entry with a part, as the sampler is one, which takes a minute to compile."""

KERNEL = """
import numpy as np
from kernel.cases import random_table
from precision_pin.kernel import sampler as kernel
at = random_table(4, targets=3, terms=9, shift=1e-3, turn=1e-3)
errors = kernel.errors(kernel.to_arrays(at), "exact", 1, 0, 20)
assert np.abs(errors - at.exact(at.space.sample(1, 0, 20))).max() < 1e-12
"""


def run(program: str, **environment: str) -> str:
    """Run a program with the package and the tests on its path; return what it printed."""
    settings = {**os.environ, "PYTHONPATH": f"{PACKAGE.parent}{os.pathsep}{TESTS}", **environment}
    words = [sys.executable, "-W", "error", "-c", program]
    done = subprocess.run(words, env=settings, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_one_compilation_serves_every_table() -> None:
    for seed in range(3):
        layout = sampler.to_arrays(random_table(seed, targets=seed, terms=3 * seed, shift=0.0, turn=1e-3))
        sampler.errors(layout, "exact", 0, 0, 5)
        sampler.errors_at(layout, "linear", np.ones((EVERY_LAW.size, 2)))
        sampler.sample(layout, 0, 1, 5)
        # what numpy hands about must not be another type to numba
        fixed = np.ones((EVERY_LAW.size, 2), dtype=np.float32, order="F")
        fixed.flags.writeable = False
        sampler.errors_at(layout, "exact", fixed)
        sampler.errors(layout, "exact", np.uint64(3), np.uint64(5), np.int32(7))
        plan = Plan(np.zeros(8), np.ones(8), (Specification("position.x", 1.0, 0.5),))
        units = (np.int64(1), np.int64(0), np.uint8(1))
        sampler.observe_blocks(layout, plan, "exact", *units, samples=np.int32(20))
        sampler.observe_norms([layout], [plan], "linear", *units, samples=np.int64(3))
    sampler.warm_up()
    assert sampler.is_compiled()
    if not INTERPRETED:
        for function in (loops.run, loops.run_poses):
            names = list(inspect.signature(function.py_func).parameters)
            places = [names.index(name) for name in ("datum", "rare", "linear")]
            seen = [tuple(str(signature[place]) for place in places) for signature in function.signatures]
            assert len(set(seen)) == len(seen) <= 6  # with and without rare laws; linear, exact, and exact with a datum


@pytest.mark.skipif(INTERPRETED, reason="nothing is compiled")
def test_parts_compiled_ahead_are_those_that_the_loops_ask_for() -> None:
    """A part with other argument types would be compiled twice: ahead in vain, then with the loops."""
    for variant in ((None, None), (True, None), (None, True), (None, None, True)):
        sampler.warm_up(*variant)
        sampler.warm_up_poses(*variant)
        assert sampler.is_compiled(*variant)
    for name in PARTS:
        function = getattr(loops, name)
        ahead = {tuple(map(numba.typeof, parts.part_arguments(name, rare))) for rare in (None, True)}
        asked = {*function.overloads, *(key[0] for key in function._cache._cache_file._load_index())}
        assert asked <= ahead, name


def test_loops_with_rare_laws_give_the_same_bits_where_there_are_none() -> None:
    space = Space((Draw("u", Uniform(0.1)), Draw("n", Normal(0.2)), Draw("t", Triangular(0.3), Scope.VISIT)))
    at = plain_table(space, np.array([np.eye(4)] * 3), np.random.default_rng(1).normal(size=(3, 6)))
    common, rare = sampler.to_arrays(at), sampler.to_arrays(at)
    assert common.rare is None
    rare.__dict__["rare"] = True
    for model in MODELS:
        np.testing.assert_array_equal(sampler.errors(common, model, 1, 0, 999), sampler.errors(rare, model, 1, 0, 999))


def test_laws_that_the_common_loops_do_not_draw_and_correlated_ones_are_known_as_rare() -> None:
    a, b = Draw("a", Normal(1.0)), Draw("b", Uniform(1.0))
    for law in (Disc(1.0), Circle(0.7), Sphere(1.0), JointNormal(((1.0,),)), Lognormal(0.3, 1.0), Arcsine(0.1)):
        assert sampler.variant_of(Space((a, Draw("b", law))), "exact") == (True, None)
    assert sampler.variant_of(Space((a, b)), "linear") == (None, True)
    assert sampler.variant_of(Space((a, b), (Correlation.pair("a", "b", 0.5),)), "exact") == (True, None)


@pytest.mark.skipif(INTERPRETED, reason="nothing is compiled")
def test_code_of_another_variant_in_the_cache_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two processes that save two variants at once may leave an index that names the other's file."""

    @cached_entry
    def double(x: float) -> float:
        return 2 * x

    def load_another(*_: object) -> None:
        double.overloads["another"] = None

    jit.make_ready(double, (1.0,))
    assert double.signatures == [(numba.float64,)]
    double.overloads.clear()
    with monkeypatch.context() as patched:
        patched.setattr(double, "compile", load_another)
        with pytest.raises(RuntimeError, match="cannot be compiled"):
            jit.make_ready(double, (1.0,))


@pytest.mark.skipif(INTERPRETED, reason="nothing is compiled")
def test_a_cache_is_used_and_a_damaged_one_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    file = tmp_path / "small.py"
    file.write_text(SMALL)

    def kept_before() -> bool:
        """Import the functions anew and call them; return whether they were in the cache."""
        specification = importlib.util.spec_from_file_location("small", file)
        small = importlib.util.module_from_spec(specification)
        specification.loader.exec_module(small)
        result = np.empty(3)
        before = jit.is_kept(small.run, (np.ones(3), result))
        jit.call(small.run, (np.arange(3.0), result))
        assert result.tolist() == [1.0, 3.0, 5.0]
        return before

    assert not kept_before()
    for name in ("*.nbc", "*.nbi"):
        (kept,) = tmp_path.rglob(f"small.run-{name}")
        kept.write_bytes(kept.read_bytes()[:20])
        kept_before()
    for kept in tmp_path.rglob("small.*"):
        if kept.name.startswith("small.run-"):
            kept.unlink()  # so that the part is needed
        elif kept.suffix == ".nbc":
            kept.write_bytes(kept.read_bytes()[:20])
    kept_before()
    assert kept_before()


@pytest.mark.slow
def test_without_any_place_for_a_cache_functions_are_compiled_all_the_same(tmp_path: Path) -> None:
    # numba's own places are then a directory that cannot be made: a file stands in its way, which stops root too
    (tmp_path / "small.py").write_text(SMALL)
    (tmp_path / "__pycache__").write_text("")
    (tmp_path / "file").write_text("")
    places = dict.fromkeys(("HOME", "XDG_CACHE_HOME"), str(tmp_path / "file"))
    program = f"""import sys; sys.path.insert(0, {str(tmp_path)!r})
import numpy, small, precision_pin.base.jit as jit
x = numpy.ones(3)
print(jit.is_kept(small.run, (x, x)), jit.call(small.run, (numpy.arange(3.0), x)), x)"""
    assert run(program, **places, PYTHONDONTWRITEBYTECODE="1", NUMBA_CACHE_DIR="") == "False None [1. 3. 5.]\n"


@pytest.mark.slow
def test_the_loops_run_as_plain_python() -> None:
    interpreted = run(f"{KERNEL}print(errors.tobytes().hex())", NUMBA_DISABLE_JIT="1")
    compiled: dict[str, Any] = {}
    exec(KERNEL, compiled)
    found = np.frombuffer(bytes.fromhex(interpreted)).reshape(6, 20)
    np.testing.assert_allclose(found, compiled["errors"], rtol=0, atol=1e-15)


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[subprocess.Popen[str]]:
    """Return the list of the processes that are started, as it grows."""
    found: list[subprocess.Popen[str]] = []

    class Recorded(subprocess.Popen):  # type: ignore[type-arg]
        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            found.append(self)

    monkeypatch.setattr(compile_ahead.subprocess, "Popen", Recorded)
    return found


@pytest.mark.slow
def test_jobs_are_done_the_last_after_all_others(tmp_path: Path, started: list[subprocess.Popen[str]]) -> None:
    shares: list[float] = []
    first = [Job("os", "mkdir", (str(tmp_path / name),), 0.1) for name in "abcd"]
    # some are begun ahead and done once; those that fail or end their process keep nothing else from being done
    compile_ahead.begin_jobs(first[:2])
    first += [Job("os", "rmdir", (str(tmp_path / "none"),), 3.0), Job("os", "abort", (), 2.0)]
    first.append(Job("no_such_module", "f", (), 1.5))
    slow = Job("time", "sleep", (0.5,), 1.0)
    last = Job("os", "rename", (str(tmp_path / "a"), str(tmp_path / "b" / "a")), 0.1, last=True)
    with shown_by(lambda: nullcontext(shares.append)):
        compile_jobs([*first, slow, last])
    assert sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")) == ["b", "b/a", "c", "d"]
    assert 0 < len(started) <= compile_ahead.MOST_WORKERS
    assert all(worker.returncode is not None for worker in started)
    assert shares
    assert [0, *shares, 1] == sorted([0, *shares, 1])


def test_a_process_that_never_answers_is_given_up_and_none_that_can_be_started_is_no_error(
    monkeypatch: pytest.MonkeyPatch, started: list[subprocess.Popen[str]]
) -> None:
    monkeypatch.setattr(compile_ahead, "PATIENCE", 0.3)
    compile_jobs([Job("time", "sleep", (60.0,), 1.0)])
    assert started[0].returncode is not None
    for executable in ("", "/no/such/python", sys.prefix):
        monkeypatch.setattr(sys, "executable", executable)
        compile_jobs([Job("os", "abort", (), 1.0)])


def test_an_interrupt_ends_the_processes_at_once(started: list[subprocess.Popen[str]]) -> None:
    def interrupt(share: float) -> None:
        raise KeyboardInterrupt

    began = time.monotonic()
    with shown_by(lambda: nullcontext(interrupt)), pytest.raises(KeyboardInterrupt):
        compile_jobs([Job("time", "sleep", (60.0,), 1.0)] * 2)
    assert time.monotonic() - began < 5
    assert all(worker.returncode is not None for worker in started)


def test_a_process_ends_with_whoever_asked() -> None:
    words = [sys.executable, "-c", compile_ahead._PROGRAM, json.dumps(sys.path)]
    with subprocess.Popen(words, stdin=-1, stdout=-1, text=True) as worker:
        print('["time", "sleep", 0.0]\n["time", "sleep", 60.0]', file=worker.stdin, flush=True)
        assert worker.stdout.readline() == "done\n"
        worker.stdin.close()
        assert worker.wait(timeout=10) == 0


@pytest.mark.slow
def test_jobs_begun_ahead_that_nobody_asks_for_end_with_the_process() -> None:
    began = time.monotonic()
    begin = "begin_jobs([Job('time', 'sleep', (60.0,), 1.0)])\ntime.sleep(0.5)"
    assert run(f"from precision_pin.base.compile_ahead import Job, begin_jobs\nimport time\n{begin}") == ""
    assert time.monotonic() - began < 20


def test_compiling_begins_only_where_no_loops_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    monkeypatch.setattr(parts, "begin_jobs", lambda jobs: asked.append(len(jobs)))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    parts.begin_compiling()
    assert asked == [len(parts.PARTS) - 2]  # without the laws, which the sheet decides, and the linear model
    (tmp_path / "kernel_1").mkdir()
    (tmp_path / "kernel_1" / f"loops.run-1.py{sys.version_info.major}{sys.version_info.minor}.nbi").touch()
    parts.begin_compiling()
    assert len(asked) == 1


def test_python_says_that_something_is_compiled(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    line = "precision-pin: compiling the sampler for this kind of model, once on this machine: some 8 s\n"
    for name, quiet in (("a", nullcontext()), ("b", shown_by(silent))):
        with quiet:
            compile_jobs([Job("os", "mkdir", (str(tmp_path / name),), 1.0)])
        assert capfd.readouterr().err == (line if name == "a" else "")
