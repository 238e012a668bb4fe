"""The first call: one compilation for every robot, a cache that may be damaged or impossible, plain Python."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import precision_pin
from kernel.kernel_cases import EVERY_LAW, random_table
from precision_pin import kernel, kernel_loops
from precision_pin.compiled import INTERPRETED
from precision_pin.statistics import Plan, Specification

PACKAGE = Path(precision_pin.__file__).parent
TESTS = Path(__file__).parents[1]

PROGRAM = """
import time
began = time.perf_counter()
import numpy as np
from kernel.kernel_cases import random_table
from precision_pin import kernel
at = random_table(4, targets=3, terms=9, shift=1e-3, turn=1e-3)
layout = kernel.compile_table(at)
before = kernel.is_compiled()
errors = kernel.errors(layout, "exact", 1, 0, 20)
assert kernel.is_compiled()
print(before, np.abs(errors - at.exact(at.space.sample(1, 0, 20))).max() < 1e-12, errors.tobytes().hex())
"""


def run(source: Path, *, cache: Path | None, **environment: str) -> list[str]:
    """Run the program on a copy of the package; return what it printed: compiled before, right, the errors' bits."""
    # hardly optimised: the cache is what is tried, and compiling takes most of the time
    settings = {"NUMBA_OPT": "1", **os.environ, "PYTHONPATH": f"{source}{os.pathsep}{TESTS}", **environment}
    settings.pop("NUMBA_CACHE_DIR", None)
    if cache is not None:
        settings["NUMBA_CACHE_DIR"] = str(cache)
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", PROGRAM],
        env=settings,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def copied(directory: Path) -> Path:
    shutil.copytree(PACKAGE, directory / "precision_pin", ignore=shutil.ignore_patterns("__pycache__", "robots"))
    return directory


def test_one_compilation_serves_every_table() -> None:
    for seed in range(3):
        layout = kernel.compile_table(random_table(seed, targets=seed, terms=3 * seed, shift=0.0, turn=1e-3))
        kernel.errors(layout, "exact", 0, 0, 5)
        kernel.errors_at(layout, "linear", np.ones((EVERY_LAW.size, 2)))
        kernel.sample(layout, 0, 1, 5)
        # what numpy hands about must not be another type to numba
        fixed = np.ones((EVERY_LAW.size, 2), dtype=np.float32, order="F")
        fixed.flags.writeable = False
        kernel.errors_at(layout, "exact", fixed)
        kernel.errors(layout, "exact", np.uint64(3), np.uint64(5), np.int32(7))
        plan = Plan(np.zeros(8), np.ones(8), (Specification("position.x", 1.0, 0.5),))
        kernel.accumulate(layout, plan, "exact", np.int64(1), np.int64(0), np.uint8(1), samples=np.int32(20))
    kernel.warm_up()
    if not INTERPRETED:
        assert len(kernel_loops.run.signatures) == 1
    assert kernel.is_compiled()


@pytest.mark.slow
def test_a_cache_is_used_and_a_damaged_one_replaced(tmp_path: Path) -> None:
    source, cache = copied(tmp_path / "source"), tmp_path / "cache"
    first = run(source, cache=cache)
    assert first[:2] == ["False", "True"]
    assert run(source, cache=cache) == ["True", *first[1:]]
    for name in ("*.nbc", "*.nbi"):
        (file,) = cache.rglob(f"kernel_loops.run-{name}")
        file.write_bytes(file.read_bytes()[:20])
        assert run(source, cache=cache)[1:] == first[1:]
    assert run(source, cache=cache) == ["True", *first[1:]]


@pytest.mark.slow
def test_without_any_place_for_a_cache_the_sampler_still_works(tmp_path: Path) -> None:
    # numba's own places are then a directory that cannot be made: a file stands in its way, which stops root too
    source = copied(tmp_path / "source")
    (source / "precision_pin" / "__pycache__").write_text("")
    blocked = tmp_path / "file"
    blocked.write_text("")
    printed = run(source, cache=None, HOME=str(blocked), XDG_CACHE_HOME=str(blocked), PYTHONDONTWRITEBYTECODE="1")
    assert printed[:2] == ["False", "True"]


@pytest.mark.slow
def test_the_loops_run_as_plain_python(tmp_path: Path) -> None:
    compiled = run(PACKAGE.parent, cache=None)
    interpreted = run(PACKAGE.parent, cache=None, NUMBA_DISABLE_JIT="1")
    assert interpreted[:2] == ["True", "True"]
    first, second = (np.frombuffer(bytes.fromhex(printed[2])) for printed in (compiled, interpreted))
    np.testing.assert_allclose(first, second, rtol=0, atol=1e-15)
