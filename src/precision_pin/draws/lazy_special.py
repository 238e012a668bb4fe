"""scipy.special, imported on first use: the import takes 0.2 s, and checking a sheet does without."""

from __future__ import annotations

from typing import Any

__all__: list[str] = []


def __getattr__(name: str) -> Any:
    from scipy import special

    return getattr(special, name)
