"""Exceptions and warnings of the package; names and messages shortened to one line.

The tree::

    PrecisionPinError            base of all; never raised itself
    ├── InputError               the user's input is wrong; carries findings
    │   ├── UrdfError            a URDF cannot be used
    │   ├── SheetError           a sheet cannot be used
    │   ├── UnitError            a number with a wrong or missing unit
    │   ├── UnknownNameError     a joint, link, frame, pose … that does not exist
    │   └── OutputError          a result cannot be written to the requested path
    └── InternalError            an internal check failed: a bug in the package, not in the input

    PrecisionPinWarning(UserWarning)   an assumption may not hold

A *finding* is one line about the input: ``file:line: error|warning|note CODE: what, and what is allowed``.
"""

from __future__ import annotations

import bisect
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from functools import wraps
from typing import Final, Literal, ParamSpec, TypeVar

LONGEST_LINE: Final = 2000
"""Maximum length of a message (characters): lists of names fit, a file's content quoted by mistake does not."""

_LONGEST_NAME: Final = 80
"""Maximum length of a name in a message: a terminal line; the names of common URDFs have up to 40 characters."""
_LONGEST_WORD: Final = 260
"""Maximum length of a word in a message: the longest file names (255 bytes on Linux) stay whole."""

_WORD: Final = re.compile(rf"\S{{{_LONGEST_WORD + 1},}}")
"""Words to be cut."""


def shortened(text: str, most: int = _LONGEST_NAME) -> str:
    """Return a text of at most ``most`` characters; longer texts lose their middle."""
    if len(text) <= most:
        return text
    tail = most // 4
    return f"{text[: most - tail - 1]}…{text[len(text) - tail :]}"


def visible(text: str, most: int = _LONGEST_NAME) -> str:
    """Return a name shortened, with control, format and unassigned characters escaped."""
    text = shortened(text, most)
    if text.isprintable():
        return text
    return "".join(character if character.isprintable() else repr(character)[1:-1] for character in text)


def shown(text: str, most: int = _LONGEST_NAME) -> str:
    """Return a name in quotes for a message, as :func:`visible` shows it."""
    return repr(shortened(text, most))


def some(names: Sequence[str], most: int, between: str = ", ") -> str:
    """Return the first ``most`` names as text, and the number of the others."""
    more = f" and {len(names) - most:,} more" if len(names) > most else ""
    return between.join(names[:most]) + more


def one_line(text: str, most: int = LONGEST_LINE) -> str:
    """Return a message as one line: unprintable characters escaped, long words and long texts cut in the middle."""
    # cut first: a text may have millions of characters
    text = visible(shortened(text, 10 * most), 10 * most)
    return shortened(_WORD.sub(lambda word: shortened(word[0], _LONGEST_WORD // 2), text), most)


MOST_COMPARED: Final = 500
LONGEST_COMPARED: Final = 100
"""Names compared to suggest one, and their maximum length: 30 ms for names of common length, 1.5 s for the longest."""


@dataclass(frozen=True)
class Finding:
    """Error, warning or note about an input.

    Attributes:
        severity: ``"error"`` rejects the input, ``"warning"`` accepts it; ``"note"``: nothing is wrong, or the sheet
            accepts the warning.
        code: Stable identifier such as ``E_AXIS_ZERO`` or ``W_UNITS``.
        message: Fault and allowed values, one line.
        file, line: Location, if known; lines count from 1.
        subjects: All links and joints that a warning lists, as ``link 'name'``; the message may show fewer.
    """

    severity: Literal["error", "warning", "note"]
    code: str
    message: str
    file: str | None = None
    line: int | None = None
    subjects: tuple[str, ...] = field(default=(), compare=False, repr=False)

    def __str__(self) -> str:
        """Return the finding as one line, with names shortened and escaped."""
        where = "precision-pin" if not self.file else visible(self.file, _LONGEST_WORD)
        if self.line is not None:
            where += f":{self.line}"
        return f"{where}: {self.severity} {self.code}: {one_line(self.message)}"

    def to_dict(self) -> dict[str, str | int | None]:
        """Return the finding as in the JSON of results."""
        return {name: getattr(self, name) for name in ("severity", "code", "message", "file", "line")}

    def at(self, file: str | None, line: int | None) -> Finding:
        """Return the finding with this file and line, unless it has a location."""
        is_here = self.line is None and self.file in (None, file)  # the line is not one of another file
        return replace(self, file=self.file or file, line=line if is_here else self.line)

    def accepted(self, reasons: Mapping[str, str]) -> Finding:
        """Return a warning as a note with the sheet's reason if the sheet accepts its code; else the finding itself."""
        if self.severity != "warning" or self.code not in reasons:
            return self
        return replace(self, severity="note", message=f"{self.message}; accepted: {reasons[self.code]}")


def is_note(line: str) -> bool:
    """Return whether a line is a note; commands do not repeat notes, and calls do not warn of them."""
    severity = re.search(r": (error|warning|note) [A-Z]_\w+: ", line)
    return severity is not None and severity[1] == "note"


class PrecisionPinError(Exception):
    """Base of the exceptions of the package."""


class InputError(PrecisionPinError):
    """The user's input is wrong.

    Args:
        findings: A message, or all findings: errors, perhaps with warnings among them.

    Examples:
        >>> try:
        ...     pp.specification("1 mm @ 200 %")
        ... except pp.InputError as error:
        ...     print(error)
        precision-pin: error E_INPUT: specification '1 mm @ 200 %': the probability must lie above 0 and below 1 (or 100 %)
    """

    code = "E_INPUT"

    def __init__(self, findings: str | Sequence[Finding]) -> None:
        if isinstance(findings, str):
            findings = (Finding("error", self.code, findings),)
        self.findings: tuple[Finding, ...] = tuple(findings)
        super().__init__("\n".join(str(finding) for finding in self.findings))

    @classmethod
    def of(cls, code: str, message: str, file: str | None = None, line: int | None = None) -> InputError:
        """Return the error with a single finding."""
        return cls([Finding("error", code, message, file, line)])

    def __reduce__(self) -> tuple[Callable[..., InputError], tuple[type[InputError], dict[str, object]]]:
        # by default, unpickling rebuilds an exception from its text, which loses the findings
        return _restored, (type(self), vars(self))


def _restored(kind: type[InputError], state: dict[str, object]) -> InputError:
    error = kind.__new__(kind)
    vars(error).update(state)
    Exception.__init__(error, "\n".join(str(finding) for finding in error.findings))
    return error


class UrdfError(InputError):
    """A URDF cannot be used."""

    code = "E_URDF"


class SheetError(InputError):
    """A sheet cannot be used."""

    code = "E_SHEET"


class UnitError(InputError):
    """A number with a wrong or missing unit."""

    code = "E_UNIT"


class UnknownNameError(InputError):
    """A ``kind`` (such as ``"joint"``) has no element of this name; the message gives the nearest valid names."""

    code = "E_NAME"

    def __init__(self, kind: str, name: str, valid: Iterable[str]) -> None:
        self.name = name
        super().__init__(f"no {kind} named {shown(name)}; {nearest(name, valid)}")


class OutputError(InputError):
    """A result cannot be written to the requested path."""

    code = "E_OUTPUT"


class InternalError(PrecisionPinError):
    """An internal check failed: a bug in the package, not in the input."""


class PrecisionPinWarning(UserWarning):
    """An assumption may not hold; the result says which."""


def nearest(name: str, valid: Iterable[str], *, most: int = 12) -> str:
    """Return the end of a message: ``"did you mean …?"``, or the valid names if there are at most ``most``."""
    names = sorted(set(valid))
    if not names:
        return "there are none"
    position = bisect.bisect(names, name)
    # comparing many names is slow: only neighbours in the sorted list, which begin alike, are compared
    near = names[max(position - MOST_COMPARED // 2, 0) : position + MOST_COMPARED // 2]
    short = [candidate for candidate in near if len(candidate) <= LONGEST_COMPARED]
    import difflib  # imported late: every start loads this module, few need it

    close = difflib.get_close_matches(name, short, n=3, cutoff=0.6) if len(name) <= LONGEST_COMPARED else []
    if not close:
        folded = {candidate.casefold(): candidate for candidate in names}
        close = [folded[name.casefold()]] if name.casefold() in folded else []
    if close:
        return "did you mean " + " or ".join(repr(candidate) for candidate in close) + "?"
    choices = ", ".join(map(visible, names[:most]))
    return f"valid: {choices}" + (f", … ({len(names)} in all)" if len(names) > most else "")


Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

_added: Final[ContextVar[list[str] | None]] = ContextVar("added", default=None)
"""Warnings of the current public call; a context variable, because calls in several threads must not mix theirs."""


def add(findings: Iterable[Finding | str]) -> None:
    """Queue warnings for the current public call; a no-op outside one."""
    lines = _added.get()
    if lines is not None:
        lines.extend(line for line in map(str, findings) if not is_note(line))


@contextmanager
def unheard() -> Iterator[None]:
    """Drop the findings added in a ``with`` block: those of single poses, if the caller warns of all poses itself."""
    token = _added.set([])
    try:
        yield
    finally:
        _added.reset(token)


def warns_at_end(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Make a public function emit its queued warnings at the end; nested calls leave theirs to the outermost call."""

    @wraps(function)
    def called(*arguments: Parameters.args, **options: Parameters.kwargs) -> Result:
        if _added.get() is not None:
            return function(*arguments, **options)
        lines: list[str] = []
        token = _added.set(lines)
        try:
            result = function(*arguments, **options)
        finally:
            _added.reset(token)
        for line in dict.fromkeys(lines):
            warnings.warn(line, PrecisionPinWarning, stacklevel=2)
        return result

    return called
