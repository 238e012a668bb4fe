"""First call: one compilation for all robots, a cache that is damaged or cannot be written, and plain Python."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

import precision_pin
from kernel.cases import EVERY_LAW, compiled_variants, plain_table, random_table
from precision_pin.base import jit
from precision_pin.base.jit import INTERPRETED, cached_entry
from precision_pin.draws.correlation import Correlation
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.laws import (
    Arcsine,
    Circle,
    Disc,
    JointNormal,
    Law,
    Lognormal,
    Normal,
    Triangular,
    TruncatedNormal,
    Uniform,
)
from precision_pin.draws.space import Space
from precision_pin.kernel import loops, many_poses, parts, sampler
from precision_pin.kernel.parts import PARTS
from precision_pin.statistics import Plan, Specification

MODELS: tuple[sampler.Model, ...] = ("exact", "linear")
PACKAGE = Path(precision_pin.__file__).parent
TESTS = Path(__file__).parents[1]

SMALL = """
import numpy as np
from precision_pin.base.jit import cached_entry, cached_part, call, is_kept

@cached_part
def part(x, k):
    return 2.0 * x[k]

@cached_entry
def run(x, result):
    for k in range(x.size):
        result[k] = part(x, k) + 1.0

def main():
    result = np.empty(3)
    before = is_kept(run, (np.ones(3), result))
    call(run, (np.arange(3.0), result))
    print(before, result.tolist() == [1.0, 3.0, 5.0], result.tobytes().hex())
"""
"""An entry with a part, as the sampler is one, which takes a minute to compile."""

KERNEL = """
import numpy as np
from kernel.cases import random_table
from precision_pin.kernel import sampler as kernel
at = random_table(4, targets=3, terms=9, shift=1e-3, turn=1e-3)
layout = kernel.to_arrays(at)
before = kernel.is_compiled(layout.rare)
errors = kernel.errors(layout, "exact", 1, 0, 20)
assert kernel.is_compiled(layout.rare)
print(before, np.abs(errors - at.exact(at.space.sample(1, 0, 20))).max() < 1e-12, errors.tobytes().hex())
"""
PROGRAMS = {"small": "import small\nsmall.main()", "kernel": KERNEL}


def run(source: Path, program: str, *, cache: Path | None, **environment: str) -> list[str]:
    """Run a program; return what it printed: compiled before, right, the numbers' bits."""
    settings = {**os.environ, "PYTHONPATH": f"{source}{os.pathsep}{TESTS}", **environment}
    settings.pop("NUMBA_CACHE_DIR", None)
    if cache is not None:
        settings["NUMBA_CACHE_DIR"] = str(cache)
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", PROGRAMS[program]],
        env=settings,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


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
        sampler.observe_blocks(layout, plan, "exact", np.int64(1), np.int64(0), np.uint8(1), samples=np.int32(20))
    sampler.warm_up()
    assert sampler.is_compiled()
    if not INTERPRETED:
        seen = compiled_variants(loops.run)
        assert len(set(seen)) == len(seen) <= 4  # with and without rare laws, exact and linear


@pytest.mark.skipif(INTERPRETED, reason="nothing is compiled")
@pytest.mark.parametrize("name", PARTS)
def test_parts_compiled_ahead_are_those_that_the_loops_ask_for(name: str) -> None:
    """A part with other argument types would be compiled twice: ahead in vain, then with the loops."""
    for variant in ((None, None), (True, None), (None, True)):
        sampler.warm_up(*variant)
        many_poses.warm_up(*variant)
    function = getattr(loops, name)
    ahead = {tuple(map(numba.typeof, parts.part_arguments(name, rare))) for rare in (None, True)}
    asked = {*function.overloads, *(key[0] for key in function._cache._cache_file._load_index())}
    assert asked <= ahead


def test_loops_with_rare_laws_give_the_same_bits_where_there_are_none() -> None:
    space = Space((Draw("u", Uniform(0.1)), Draw("n", Normal(0.2)), Draw("t", Triangular(0.3), Scope.VISIT)))
    at = plain_table(space, np.array([np.eye(4)] * 3), np.random.default_rng(1).normal(size=(3, 6)))
    common, rare = sampler.to_arrays(at), sampler.to_arrays(at)
    assert common.rare is None
    rare.__dict__["rare"] = True
    for model in MODELS:
        np.testing.assert_array_equal(sampler.errors(common, model, 1, 0, 999), sampler.errors(rare, model, 1, 0, 999))


@pytest.mark.parametrize("draw", [Disc(1.0), Circle(0.7), JointNormal(((1.0,),)), Lognormal(0.3, 1.0), Arcsine(0.1)])
def test_laws_that_the_common_loops_do_not_draw_are_known_as_rare(draw: Law) -> None:
    assert sampler.variant_of(Space((Draw("a", Normal(1.0)), Draw("b", draw))), "exact") == (True, None)


def test_correlated_common_laws_are_rare() -> None:
    draws = (Draw("a", Normal(1.0)), Draw("b", Uniform(1.0)), Draw("c", TruncatedNormal(1.0, 0.0, 2.0)))
    assert sampler.variant_of(Space(draws), "linear") == (None, True)
    assert sampler.variant_of(Space(draws, (Correlation.pair("a", "b", 0.5),)), "exact") == (True, None)


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


@pytest.mark.slow
def test_a_cache_is_used_and_a_damaged_one_replaced(tmp_path: Path) -> None:
    (tmp_path / "small.py").write_text(SMALL)
    cache = tmp_path / "cache"
    first = run(tmp_path, "small", cache=cache)
    assert first[:2] == ["False", "True"]
    assert run(tmp_path, "small", cache=cache) == ["True", *first[1:]]
    for name in ("*.nbc", "*.nbi"):
        (file,) = cache.rglob(f"small.run-{name}")
        file.write_bytes(file.read_bytes()[:20])
        assert run(tmp_path, "small", cache=cache)[1:] == first[1:]
    for file in cache.rglob("small.*"):
        if file.name.startswith("small.run-"):
            file.unlink()  # so that the part is needed
        elif file.suffix == ".nbc":
            file.write_bytes(file.read_bytes()[:20])
    assert run(tmp_path, "small", cache=cache)[1:] == first[1:]
    assert run(tmp_path, "small", cache=cache) == ["True", *first[1:]]


@pytest.mark.slow
def test_without_any_place_for_a_cache_functions_are_compiled_all_the_same(tmp_path: Path) -> None:
    # numba's own places are then a directory that cannot be made: a file stands in its way, which stops root too
    (tmp_path / "small.py").write_text(SMALL)
    (tmp_path / "__pycache__").write_text("")
    blocked = tmp_path / "file"
    blocked.write_text("")
    places = {"HOME": str(blocked), "XDG_CACHE_HOME": str(blocked), "PYTHONDONTWRITEBYTECODE": "1"}
    assert run(tmp_path, "small", cache=None, **places)[:2] == ["False", "True"]


@pytest.mark.slow
def test_the_loops_run_as_plain_python(tmp_path: Path) -> None:
    jit = run(PACKAGE.parent, "kernel", cache=None)
    interpreted = run(PACKAGE.parent, "kernel", cache=None, NUMBA_DISABLE_JIT="1")
    assert interpreted[:2] == ["True", "True"]
    first, second = (np.frombuffer(bytes.fromhex(printed[2])) for printed in (jit, interpreted))
    np.testing.assert_allclose(first, second, rtol=0, atol=1e-15)
