"""Error sources, one file for each kind.

Each module here with a :class:`~precision_pin.terms.source.Source` class adds a kind; no other list exists. Other packages
add kinds by entry points. The sheet's schema and the documentation's catalogue follow from the classes.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from functools import cache

from precision_pin.base.extensions import Extension, find_extensions
from precision_pin.terms.source import Source

__all__ = ["catalogue"]


@cache
def catalogue() -> dict[str, type[Source]]:
    """Return every kind of source by its name in a sheet, those that other packages install included."""
    installed = (extension.value for extension in extensions() if not extension.error)
    return dict(sorted((_own_kinds() | {kind.kind(): kind for kind in installed}).items()))


def extensions() -> tuple[Extension, ...]:
    """Return the kinds that other packages install, and those that cannot be used."""
    return find_extensions("sources", _check)


def _check(kind: object) -> str:
    if not (inspect.isclass(kind) and issubclass(kind, Source) and not inspect.isabstract(kind)):
        return "it is no subclass of precision_pin.Source with its methods"
    return f"the name {kind.kind()!r} is taken" if kind.kind() in _own_kinds() else ""


def _own_kinds() -> dict[str, type[Source]]:
    kinds: dict[str, type[Source]] = {}
    for module in pkgutil.iter_modules(__path__):
        contents = vars(importlib.import_module(f"{__name__}.{module.name}"))
        for value in contents.values():
            if inspect.isclass(value) and issubclass(value, Source) and not inspect.isabstract(value):
                kinds[value.kind()] = value
    return kinds


def __getattr__(name: str) -> type[Source]:
    # Python also looks up module names here during import, when the catalogue is not complete
    if name[:1].isupper():
        for source in catalogue().values():
            if source.__name__ == name:
                return source
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
