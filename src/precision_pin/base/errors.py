"""Every exception and warning of the package, and the user's names in messages, on one line of limited length.

The tree::

    PrecisionPinError            base of all; never raised itself
    ├── InputError               the user's input is wrong; carries findings
    │   ├── UrdfError            a URDF cannot be used
    │   ├── SheetError           a sheet cannot be used
    │   ├── UnitError            a number with a wrong or missing unit
    │   ├── UnknownNameError     a joint, link, frame, pose … that does not exist
    │   └── OutputError          a result cannot be written where asked
    └── InternalError            a check of our own failed: a bug here, not in the input

    PrecisionPinWarning(UserWarning)   an assumption is being stretched

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
"""Most characters of a message."""

_LONGEST_NAME: Final = 80
_LONGEST_WORD: Final = 260
"""The longest file name that systems allow."""

_WORD: Final = re.compile(rf"\S{{{_LONGEST_WORD + 1},}}")


def shortened(text: str, most: int = _LONGEST_NAME) -> str:
    """Return a text of at most ``most`` characters; a longer one loses its middle."""
    if len(text) <= most:
        return text
    tail = most // 4
    return f"{text[: most - tail - 1]}…{text[len(text) - tail :]}"


def visible(text: str, most: int = _LONGEST_NAME) -> str:
    """Return a name shortened, with control, format and unassigned characters escaped."""
    text = shortened(text, most)
    if text.isprintable():
        return text
    return "".join(one if one.isprintable() else repr(one)[1:-1] for one in text)


def shown(text: str, most: int = _LONGEST_NAME) -> str:
    """Return a name in quotes for a message, as :func:`visible` shows it."""
    return repr(shortened(text, most))


def some(names: Sequence[str], most: int, between: str = ", ") -> str:
    """Return the first names as text, and the number of the others."""
    more = f" and {len(names) - most:,} more" if len(names) > most else ""
    return between.join(names[:most]) + more


def one_line(text: str, most: int = LONGEST_LINE) -> str:
    """Return a message as one line: unprintable characters escaped, long words and long texts cut in the middle."""
    # cut first, so that no search goes through millions of characters
    text = visible(shortened(text, 10 * most), 10 * most)
    return shortened(_WORD.sub(lambda word: shortened(word[0], _LONGEST_WORD // 2), text), most)


MOST_COMPARED: Final = 500
LONGEST_COMPARED: Final = 100
"""Most names, and most letters of a name, that are compared to suggest one."""


@dataclass(frozen=True)
class Finding:
    """One remark about an input.

    Attributes:
        severity: ``"error"`` refuses the input, ``"warning"`` lets it pass; ``"note"``: nothing is wrong, or the sheet
            accepts it.
        code: Stable identifier such as ``E_AXIS_ZERO`` or ``W_UNITS``.
        message: What is wrong and what is allowed, one line.
        file, line: Where, if known; lines count from 1.
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
        """Return the finding as results have it in their JSON."""
        return {name: getattr(self, name) for name in ("severity", "code", "message", "file", "line")}

    def at(self, file: str | None, line: int | None) -> Finding:
        """Return the finding with a file and line, if it has none."""
        return replace(self, file=self.file or file, line=self.line if self.line is not None else line)

    def accepted(self, reasons: Mapping[str, str]) -> Finding:
        """Return a warning whose code a sheet accepts as a note with its reason; other findings unchanged."""
        if self.severity != "warning" or self.code not in reasons:
            return self
        return replace(self, severity="note", message=f"{self.message}; accepted: {reasons[self.code]}")


def is_note(line: str) -> bool:
    """Return whether a line is a note, which commands do not repeat and calls do not warn of."""
    found = re.search(r": (error|warning|note) [A-Z]_\w+: ", line)
    return found is not None and found[1] == "note"


class PrecisionPinError(Exception):
    """Base of every exception the package raises on purpose."""


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
        """Return the error of one finding."""
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
    """A name that does not exist, of a ``kind`` such as ``"joint"``; the message gives the nearest valid ones."""

    code = "E_NAME"

    def __init__(self, kind: str, name: str, valid: Iterable[str]) -> None:
        self.name = name
        super().__init__(f"no {kind} named {shown(name)}; {nearest(name, valid)}")


class OutputError(InputError):
    """A result cannot be written where asked."""

    code = "E_OUTPUT"


class InternalError(PrecisionPinError):
    """An internal check failed: a bug in the package, not in the input."""


class PrecisionPinWarning(UserWarning):
    """An assumption is being stretched; the result says which."""


def nearest(name: str, valid: Iterable[str], *, most: int = 12) -> str:
    """Return the end of a message: ``"did you mean …?"``, or the valid names if there are at most ``most``."""
    names = sorted(set(valid))
    if not names:
        return "there are none"
    beside = bisect.bisect(names, name)
    # comparing many or long names is slow: only neighbours in the sorted list, which begin alike, are compared
    near = names[max(beside - MOST_COMPARED // 2, 0) : beside + MOST_COMPARED // 2]
    short = [candidate for candidate in near if len(candidate) <= LONGEST_COMPARED]
    import difflib  # imported late: every start loads this module, few need it

    close = difflib.get_close_matches(name, short, n=3, cutoff=0.6) if len(name) <= LONGEST_COMPARED else []
    if not close:
        folded = {candidate.casefold(): candidate for candidate in names}
        close = [folded[name.casefold()]] if name.casefold() in folded else []
    if close:
        return "did you mean " + " or ".join(repr(candidate) for candidate in close) + "?"
    listed = ", ".join(map(visible, names[:most]))
    return f"valid: {listed}" + (f", … ({len(names)} in all)" if len(names) > most else "")


Given = ParamSpec("Given")
Result = TypeVar("Result")

_added: Final[ContextVar[list[str] | None]] = ContextVar("added", default=None)


def add(findings: Iterable[Finding | str]) -> None:
    """Queue warnings for the current public call; a no-op outside one."""
    lines = _added.get()
    if lines is not None:
        lines.extend(line for line in map(str, findings) if not is_note(line))


@contextmanager
def unheard() -> Iterator[None]:
    """Drop the findings added in a ``with`` block: of some poses of a call that warns of all of them itself."""
    before = _added.set([])
    try:
        yield
    finally:
        _added.reset(before)


def warns_at_end(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """Make a public function emit its queued warnings at the end; a nested call leaves that to the outer one."""

    @wraps(function)
    def called(*arguments: Given.args, **options: Given.kwargs) -> Result:
        if _added.get() is not None:
            return function(*arguments, **options)
        lines: list[str] = []
        before = _added.set(lines)
        try:
            result = function(*arguments, **options)
        finally:
            _added.reset(before)
        for line in dict.fromkeys(lines):
            warnings.warn(line, PrecisionPinWarning, stacklevel=2)
        return result

    return called
