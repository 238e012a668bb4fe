"""Names and texts that users give, as messages, tables and figures show them: on one line, of limited length.

A name may hold a line break, a mark that turns the direction of writing, a terminal escape sequence, or a million
letters; its characters are shown as escapes, and a long name is cut.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

LONGEST_LINE: Final = 2000
"""Characters of a message."""

_LONGEST_NAME: Final = 80
_LONGEST_WORD: Final = 260
"""As long as a file's name may be."""

_WORD: Final = re.compile(rf"\S{{{_LONGEST_WORD + 1},}}")


def shortened(text: str, most: int = _LONGEST_NAME) -> str:
    """Return a text of at most so many characters; a longer one loses its middle."""
    if len(text) <= most:
        return text
    tail = most // 4
    return f"{text[: most - tail - 1]}…{text[len(text) - tail :]}"


def visible(text: str, most: int = _LONGEST_NAME) -> str:
    """Return a name shortened, with escapes for control, format and unassigned characters."""
    text = shortened(text, most)
    if text.isprintable():
        return text
    return "".join(one if one.isprintable() else repr(one)[1:-1] for one in text)


def shown(text: str, most: int = _LONGEST_NAME) -> str:
    """Return a name in quotes for a message, as :func:`visible` shows it."""
    return repr(shortened(text, most))


def some(names: Sequence[str], most: int, between: str = ", ") -> str:
    """Return the first names as text, and how many more there are."""
    more = f" and {len(names) - most:,} more" if len(names) > most else ""
    return between.join(names[:most]) + more


def one_line(text: str, most: int = LONGEST_LINE) -> str:
    """Return a message as one line: unprintable characters escaped, long words and long texts cut in the middle."""
    # cut first, so that no search goes through millions of characters
    text = visible(shortened(text, 10 * most), 10 * most)
    return shortened(_WORD.sub(lambda word: shortened(word[0], _LONGEST_WORD // 2), text), most)
