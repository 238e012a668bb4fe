"""Functions compiled by numba: how they are made, kept in its cache on disk, and called whatever becomes of that cache.

Known troubles with the cache: a file cut short (a full disk, a killed process), a directory that cannot be written, a
disk that fills while the code is saved. None of them may keep anything from being computed.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import Any, Final, TypeVar, cast

import numba
import numpy as np
from numba.core.registry import cpu_target

__all__ = ["INTERPRETED", "apart", "call", "contracted", "is_kept", "kept", "plain", "within"]

Function = TypeVar("Function", bound=Callable[..., Any])

_configuration: Any = numba.config
INTERPRETED: Final = bool(_configuration.DISABLE_JIT)
"""Whether NUMBA_DISABLE_JIT=1 makes all this plain Python: for coverage."""

# numba's types do not know all options; _nrt=False: references are not counted, which costs atomic operations at every
# view of an array; hence no arrays can be made inside
_njit: Any = partial(numba.njit, error_model="numpy", nogil=True, _nrt=False)


def plain(function: Function) -> Function:
    """Compile with plain IEEE arithmetic; a division by zero gives infinity, as in numpy. It makes no arrays."""
    return cast("Function", _njit(no_cfunc_wrapper=True)(function))


def within(function: Function) -> Function:
    """Compile as `plain`, into its callers: for what is given many arrays, which take long to hand over.

    Numba hands this down: what such a function calls is compiled into it, too, unless it is `apart`.
    """
    return cast("Function", _njit(no_cfunc_wrapper=True, forceinline=True)(function))


def contracted(function: Function) -> Function:
    """Compile allowing fused multiply-add, and no other liberty: infinities and NaN stay what they are."""
    return cast("Function", _njit(no_cfunc_wrapper=True, fastmath={"contract"})(function))


def apart(function: Function) -> Function:
    """Compile as `contracted`, but not into its callers: among theirs, its constants would find no registers."""
    return cast("Function", _njit(no_cfunc_wrapper=True, forceinline=False, fastmath={"contract"})(function))


def kept(function: Function) -> Function:
    """Compile an outermost function as `plain`, kept on disk; without a disk to keep it on, in every process."""
    try:
        return cast("Function", _njit(cache=True)(function))
    except RuntimeError:  # neither the package nor the home can be written: numba refuses to cache
        return plain(function)


def call(function: Any, arguments: tuple[Any, ...]) -> Any:
    """Return what an outermost function returns, compiled or loaded when first called.

    A cache that cannot be used is deleted; if that does not help, the function is compiled for this process alone. All
    of this happens before anything is computed, so that calling again is safe.
    """
    if INTERPRETED:
        with np.errstate(all="ignore"):
            return function(*arguments)
    if function not in _alone:
        for remedy in (_delete_cache, _alone.add):
            try:
                return function(*arguments)
            except _TROUBLES:
                remedy(function)
    return _compiled_alone(function)(*arguments)


def is_kept(function: Any) -> bool:
    """Return whether an outermost function is compiled, in this process or in numba's cache, as far as can be told."""
    if INTERPRETED or function.signatures or function in _alone:
        return True
    try:
        # numba has no public way to ask; the index reads as empty if it is of another version or source
        keys = function._cache._cache_file._load_index()
        processor = cpu_target.target_context.codegen().magic_tuple()
        return any(processor in key for key in keys)
    except _TROUBLES:
        return False


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
)
"""What unpickling a damaged file, or reading or writing one, raises."""

_alone: Final[set[Any]] = set()
"""The functions of which no cache could be used in this process."""


@cache
def _compiled_alone(function: Any) -> Any:
    return plain(function.py_func)


def _delete_cache(function: Any) -> None:
    if function.stats.cache_path is not None:
        file = Path(function.py_func.__code__.co_filename).stem
        for path in Path(function.stats.cache_path).glob(f"{file}.{function.py_func.__name__}-*"):
            with suppress(OSError):
                path.unlink()
