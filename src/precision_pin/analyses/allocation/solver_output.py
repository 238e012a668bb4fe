"""Standard output of the process without a line that HiGHS prints although it is to be silent."""

from __future__ import annotations

import ctypes
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Final

_LINE: Final = b"HighsMipSolverData::transformNewIntegerFeasibleSolution"
"""Begin of a line that HiGHS 1.12 (SciPy 1.17) leaves from its development."""
_STDOUT: Final = 1


@contextmanager
def without_solver_lines() -> Iterator[None]:
    """Hold back what is written to standard output during the block, and write it afterwards without the solver's line."""
    _flush()
    try:
        kept = os.dup(_STDOUT)
    except OSError:  # standard output is closed
        yield
        return
    with tempfile.TemporaryFile() as held:
        os.dup2(held.fileno(), _STDOUT)
        try:
            yield
        finally:
            _flush()
            os.dup2(kept, _STDOUT)
            os.close(kept)
            held.seek(0)
            others = b"".join(line for line in held if not line.startswith(_LINE))
            with suppress(OSError):
                os.write(_STDOUT, others)


def _flush() -> None:
    """Write the buffers of Python and of C."""
    with suppress(OSError, ValueError, AttributeError):
        sys.stdout.flush()
    ctypes.CDLL(None).fflush(None)
