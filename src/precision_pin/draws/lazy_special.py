"""The functions of scipy.special, imported when first used: that takes a fifth of a second, which no sheet's check needs."""

from __future__ import annotations

from typing import Any

__all__: list[str] = []


def __getattr__(name: str) -> Any:
    from scipy import special

    return getattr(special, name)
