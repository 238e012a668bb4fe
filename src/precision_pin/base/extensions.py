"""Analyses, sources and laws installed by other packages, found by their entry points.

The entry points have the groups ``precision_pin.analyses`` (declarations), ``precision_pin.sources`` and
``precision_pin.laws`` (classes). Unusable extensions are omitted, with the reason.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, Final, NamedTuple

from precision_pin.base.errors import Finding, one_line

GROUPS: Final = ("analyses", "sources", "laws")
"""Kinds of extensions; the entry points of each have the group ``precision_pin.KIND``."""


class Extension(NamedTuple):
    """Extension installed by another package.

    Attributes:
        name, place, package: Name and ``module:name`` of the entry point; name and version of the package.
        value: The object; None if unusable.
        error: Reason why it is unusable, or empty.
    """

    name: str
    place: str
    package: str
    value: Any
    error: str

    @property
    def finding(self) -> Finding:
        """Warning that an extension is omitted."""
        message = f"{self.name} of {self.package} ({self.place}) is left out: {self.error}"
        return Finding("warning", "W_EXTENSION", message)


@cache
def find_extensions(kind: str, check: Callable[[Any], str]) -> tuple[Extension, ...]:
    """Return the extensions of a kind of :data:`GROUPS`; ``check`` returns why an object is unusable, or no text."""
    # imported late: it takes 50 ms
    from importlib.metadata import entry_points

    extensions = []
    for point in sorted(entry_points(group=f"precision_pin.{kind}"), key=lambda point: point.name):
        value, error = None, ""
        try:
            value = point.load()
            error = check(value)
        except Exception as problem:  # noqa: BLE001 - code of others can raise anything
            error = one_line(f"{type(problem).__name__}: {problem}")
        package = "" if point.dist is None else f"{point.dist.name} {point.dist.version}"
        extensions.append(Extension(point.name, point.value, package, None if error else value, error))
    return tuple(extensions)
