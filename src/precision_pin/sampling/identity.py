"""Identity of a run: all inputs that determine its bits, as texts and digests."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numba.core.registry import cpu_target

from precision_pin.base.errors import InputError, InternalError
from precision_pin.base.versions import versions
from precision_pin.kernel import loops
from precision_pin.kernel.blocks import BLOCK
from precision_pin.robot.approach import written_approach
from precision_pin.sampling.blocks import Work

if TYPE_CHECKING:
    import os

    from precision_pin.robot.chain import Posture

_PLAN: Final = "the planned centres and scales"


def identity(work: Work, posture: Posture, files: Mapping[str, str | os.PathLike[str]]) -> dict[str, str]:
    """Return all inputs that determine the bits of a run, keyed by their names in messages.

    Parameters
    ----------
    work
        The work of the run.
    posture
        The pose.
    files
        Files that the model was read from, keyed by their names in messages.

    Raises
    ------
    InputError
        A file cannot be read.
    """
    # the processor that numba compiles for, as detected or configured
    triple, processor, features = cpu_target.target_context.codegen().magic_tuple()
    joints = zip(posture.chain.joint_names, posture.q, strict=True)
    signs = written_approach(posture.chain.joint_names, posture.approach)
    return {
        **{f"the {name}": _file_digest(Path(path)) for name, path in files.items()},
        "pose": ", ".join(
            f"{name} {float(value)!r}" + (f" ({signs[name]})" if name in signs else "") for name, value in joints
        ),
        "the error model": digest(work.layout),
        _PLAN: digest((work.plan.centre, work.plan.scale)),
        "specifications": ", ".join(
            f"{specification.quantity} {specification.limit!r} @ {specification.required!r}"
            for specification in work.plan.specifications
        ),
        "model": work.model,
        "seed": str(work.seed),
        "samples": str(work.samples),
        "block": str(BLOCK),
        **versions(),
        "the sampler's code": _file_digest(Path(loops.__file__)),
        "machine": f"{triple} {processor}",
        "the processor's features": digest(features),
    }


def differences(then: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """Return one text for each difference between two runs.

    The plan follows from the other inputs and is listed only where nothing else differs.
    """
    found = [name for name in dict.fromkeys([*now, *then]) if then.get(name) != now.get(name)]
    return [
        f"{name} {'has changed' if name.startswith('the ') else f'was {then.get(name)!r}, is {now.get(name)!r}'}"
        for name in found
        if name != _PLAN or found == [_PLAN]
    ]


def digest(value: Any) -> str:
    """Return a digest of numbers, text, arrays, and sequences, mappings and data classes of them.

    Raises
    ------
    InternalError
        A value of another type is among them.
    """
    hasher = hashlib.blake2b(digest_size=16)
    _update(hasher, value)
    return hasher.hexdigest()


def _update(hasher: hashlib.blake2b, value: Any) -> None:
    match value:
        case np.ndarray():
            _say(hasher, "array", value.dtype.str, *map(str, value.shape))
            hasher.update(np.ascontiguousarray(value).tobytes())
        case Enum():
            _say(hasher, type(value).__name__, value.name)
        case None | bool() | int() | float() | str() | np.number():
            _say(hasher, type(value).__name__, str(value) if isinstance(value, str) else repr(value))
        case Mapping():
            _say(hasher, "mapping", str(len(value)))
            for key, entry in value.items():
                _update(hasher, key)
                _update(hasher, entry)
        case Sequence():
            _say(hasher, "sequence", str(len(value)))
            for entry in value:
                _update(hasher, entry)
        case _ if is_dataclass(value):
            _say(hasher, type(value).__name__)
            for field in fields(value):
                _say(hasher, field.name)
                _update(hasher, getattr(value, field.name))
        case _:
            raise InternalError(f"no digest of a {type(value).__name__}")


def _say(hasher: hashlib.blake2b, *words: str) -> None:
    """Hash words with their lengths, so that different lists of words never hash the same bytes."""
    for word in words:
        data = word.encode("utf-8", "surrogatepass")
        hasher.update(len(data).to_bytes(8, "little") + data)


def _file_digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(
            f"cannot read {path}, which identifies the run in the journal: {error.strerror or error}"
        ) from None
