"""Modules that have moved, under the names that the documentation gave them."""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.machinery import ModuleSpec

TYPE_CHECKING = False  # as in the package itself, which imports this
if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import ModuleType
    from typing import Final

__all__ = ["MOVED", "install"]

MOVED: Final = {
    "chain": "robot.chain",
    "correlation": "draws.correlation",
    "examples": "robot.examples",
    "laws": "draws.laws",
    "mcpc": "robot.mcpc",
    "outputs.plots": "outputs.monte_carlo.figures",
    "parameters": "draws.expressions",
    "philox": "draws.philox",
    "result": "sampling.result",
    "run": "sampling",
    "sections": "sources.cross_sections",
    "space": "draws.space",
    "urdf": "robot.urdf",
}
"""Name in the package → where it is now."""
_PACKAGE: Final = __package__ or "precision_pin"


class _Finder:
    """Finds a module that has moved, and gives the one at its new place."""

    @staticmethod
    def find_spec(name: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> ModuleSpec | None:
        del path, target
        package, _, moved = name.partition(".")
        return ModuleSpec(name, _Loader()) if package == _PACKAGE and moved in MOVED else None  # type: ignore[arg-type]


class _Loader:
    """Gives the module itself, not a copy, so that its classes are identical under both names."""

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module = import_module(f"{_PACKAGE}.{MOVED[spec.name.partition('.')[2]]}")
        self._spec = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        module.__spec__ = self._spec  # the import system has put that of the old name there


def install() -> None:
    """Make the old names importable."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.append(_Finder())
