"""Functions compiled by numba: options, cache on disk, and calls that survive a damaged cache.

The cache may hold a truncated file (full disk, killed process), be read-only, or run out of disk while saving. No such
fault may stop a computation.
"""

from __future__ import annotations

import gc
import pickle
import threading
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeVar, cast

import numba
import numpy as np
from numba.core.caching import NullCache
from numba.core.errors import NumbaError
from numba.core.registry import cpu_target

from precision_pin.base.interrupts import raise_if_interrupted

Function = TypeVar("Function", bound=Callable[..., Any])

_configuration: Any = numba.config
INTERPRETED: Final = bool(_configuration.DISABLE_JIT)
"""Whether NUMBA_DISABLE_JIT=1 runs compiled functions as plain Python, as for coverage."""

# numba's types do not know all options; _nrt=False: references are not counted, which costs atomic operations at every
# view of an array; hence no arrays can be made inside
_outermost: Any = partial(numba.njit, error_model="numpy", nogil=True, _nrt=False, no_cfunc_wrapper=True)
# for functions that Python never calls: the wrapper for Python arguments takes a quarter of the compile time
_inner: Any = partial(_outermost, no_cpython_wrapper=True)


def strict(function: Function) -> Function:
    """Compile with plain IEEE arithmetic; division by zero gives infinity, as in numpy.

    Cannot create arrays. Callable from compiled code only, except a `cached_entry`.
    """
    return cast("Function", _inner()(function))


def inline(function: Function) -> Function:
    """Compile as `strict`, inlined into callers: for functions with many array arguments, which are slow to pass."""
    # numba passes this on: functions it calls are inlined too, except `fma_noinline` ones
    return cast("Function", _inner(forceinline=True)(function))


def fma(function: Function) -> Function:
    """Compile with fused multiply-add and no other relaxation: infinities and NaN are kept."""
    return cast("Function", _inner(fastmath={"contract"})(function))


def fma_noinline(function: Function) -> Function:
    """Compile as `fma`, but not inlined: its constants and those of the caller would exceed the registers."""
    return cast("Function", _inner(forceinline=False, fastmath={"contract"})(function))


def cached_entry(function: Function) -> Function:
    """Compile an outermost function as `strict`, cached on disk; without a writable disk, compiled in every process."""
    return cast("Function", _kept(_outermost, function))


def cached_part(function: Function) -> Function:
    """Compile as `strict`, with its own disk cache: shared by outermost functions, compiled by any process."""
    return cast("Function", _kept(_inner, function))


def cached_part_inline(function: Function) -> Function:
    """Compile as `inline`, with its own disk cache as a `cached_part`."""
    return cast("Function", _kept(partial(_inner, forceinline=True), function))


def call(
    function: Any, arguments: tuple[Any, ...], variant: Hashable = None, ahead: Callable[[], None] | None = None
) -> Any:
    """Call an outermost function, compiled or loaded on first use, and return its result.

    An unusable cache is deleted first; if that does not help, this process uses no cache.

    Args:
        variant: Distinguishes arguments of different numba types.
        ahead: Called if the function must be compiled: fills the cache with it, or with parts of it.
    """
    if INTERPRETED:
        with np.errstate(all="ignore"):
            return function(*arguments)
    if (function, variant) not in _ready:
        with _making_ready:
            if ahead is not None and not is_kept(function, arguments):
                ahead()
            make_ready(function, arguments)
            _ready.add((function, variant))
        if threading.current_thread() is threading.main_thread():
            raise_if_interrupted()
    return function(*arguments)


def make_ready(function: Any, arguments: tuple[Any, ...]) -> None:
    """Compile or load a function for the types of the arguments."""
    types = _types_of(arguments)
    for remedy in (_delete_cache, _forgo_cache, None):
        try:
            with _no_garbage_collection():
                function.compile(types)
            if types in function.overloads:
                return
            # two processes that save two variants at once may swap them: the loaded code is then that of the other
        except _TROUBLES:
            if remedy is None:
                raise
        if remedy is not None:
            remedy(_file_of(function))
    raise RuntimeError(f"{function.py_func.__name__} cannot be compiled")


def is_kept(function: Any, arguments: tuple[Any, ...]) -> bool:
    """Return whether a function is known to be compiled for arguments, in this process or in the cache."""
    if INTERPRETED:
        return True
    types = _types_of(arguments)
    if types in function.overloads:
        return True
    try:
        # numba has no public function for this; the index reads as empty if it is of another version or source
        processor = cpu_target.target_context.codegen().magic_tuple()
        return any(key[:2] == (types, processor) for key in function._cache._cache_file._load_index())
    except _TROUBLES:
        return False


def can_keep(function: Any) -> bool:
    """Return whether numba can cache a function on disk."""
    return not INTERPRETED and function.stats.cache_path is not None


_TROUBLES: Final = (
    pickle.UnpicklingError,
    OSError,
    EOFError,
    ValueError,
    TypeError,
    LookupError,
    ImportError,
    AttributeError,
    RuntimeError,
    NumbaError,  # wraps any of the others if it occurs in a part
)
"""Exceptions of reading, writing or unpickling a damaged cache file."""

_ready: Final[set[tuple[Any, Hashable]]] = set()
"""Functions and variants that this process has compiled or loaded."""

_making_ready: Final = threading.Lock()
"""Held while a function is compiled or loaded: numba's compiler is not thread-safe, and others would repeat the work."""

_all_kept: Final[dict[Path, list[Any]]] = {}
"""Functions that are cached on disk, by source file."""


def _kept(decorator: Any, function: Function) -> Any:
    try:
        compiled = decorator(cache=True)(function)
    except RuntimeError:  # neither the package nor the home can be written: numba refuses to cache
        return decorator()(function)
    _all_kept.setdefault(_file_of(function), []).append(compiled)
    return compiled


def _types_of(arguments: tuple[Any, ...]) -> tuple[Any, ...]:
    return tuple(map(numba.typeof, arguments))


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Pause the garbage collector, which would keep searching the many objects a compiler makes."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _file_of(function: Any) -> Path:
    return Path(getattr(function, "py_func", function).__code__.co_filename)


def _delete_cache(source: Path) -> None:
    for function in _all_kept.get(source, ()):
        if function.stats.cache_path is not None:
            for path in Path(function.stats.cache_path).glob(f"{source.stem}.{function.py_func.__name__}-*"):
                with suppress(OSError):
                    path.unlink()


def _forgo_cache(source: Path) -> None:
    for function in _all_kept.get(source, ()):
        function._cache = NullCache()
