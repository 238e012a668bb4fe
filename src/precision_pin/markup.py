"""Text that goes into HTML: whatever a URDF or a sheet calls its parts, nothing of it is markup."""

from __future__ import annotations

import html

__all__ = ["escaped"]


def escaped(text: str) -> str:
    """Return text for HTML, in elements or quoted attributes; what cannot be shown or encoded is replaced."""
    visible = (one if one.isprintable() else " " if one.isspace() else "\N{REPLACEMENT CHARACTER}" for one in text)
    return html.escape("".join(visible), quote=True)
