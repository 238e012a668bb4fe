"""One sheet in other words: another style of YAML, units, spelling of numbers, order of keys, names of parameters."""

from __future__ import annotations

import json
import random
import re
from decimal import Decimal
from typing import Any

__all__ = ["respelt", "written"]

_SCALES = {
    "mm": ("m", "0.001"), "m": ("mm", "1000"), "um": ("mm", "0.001"), "mrad": ("rad", "0.001"), "rad": ("mrad", "1000"),
    "kg": ("g", "1000"), "N": ("kN", "0.001"), "%": ("", "0.01"), "arcmin": ("arcsec", "60"), "K": ("mK", "1000"),
    "N*m^2": ("kN*m^2", "0.001"), "in": ("mm", "25.4"), "N*m": ("kN*m", "0.001"),
}  # fmt: skip
_SPELLINGS = {"um": "µm", "m/s^2": "m/s²", "N*m^2": "N·m²", "deg": "°", "N*m": "Nm", "rad/(N*m)": "rad/(N·m)"}
_QUANTITY = re.compile(r"((?:-?[0-9.]+(?:e-?[0-9]+)? )+)(\S+)")
_PLAIN = re.compile(r"[A-Za-z0-9][A-Za-z0-9_./*^()%µ·²° -]*")


def respelt(data: Any, generator: random.Random) -> tuple[Any, dict[str, str]]:
    """Return a sheet that says the same, and the new name of every parameter that has one."""
    names: dict[str, str] = {}
    if generator.random() < 0.5:
        # names keep their order, by which sources of one label are told apart
        prefix = generator.choice(["zz_", "A", "Ünit"])
        names = {name: prefix + name for name in data.get("parameters", {})}
    return _respelt(data, generator, names, ()), names


def _respelt(value: Any, generator: random.Random, names: dict[str, str], path: tuple[Any, ...]) -> Any:
    if isinstance(value, dict):
        entries = list(value.items())
        # which pose comes first says which one is meant where none is named
        if path[-1:] != ("poses",) and generator.random() < 0.7:
            generator.shuffle(entries)
        renamed = names if path == ("parameters",) else {}
        return {renamed.get(key, key): _respelt(entry, generator, names, (*path, key)) for key, entry in entries}
    if isinstance(value, list):
        return [_respelt(entry, generator, names, (*path, k)) for k, entry in enumerate(value)]
    owner = value.split(".")[0]
    if owner in names and path[:1] in (("sources",), ("correlations",)):
        return names[owner] + value[len(owner) :]
    return _quantity(value, generator)


def _quantity(text: str, generator: random.Random) -> str:
    match = _QUANTITY.fullmatch(text)
    if match is None or text.startswith("12e-6"):
        return text
    numbers, unit = match[1].split(), match[2]
    if unit in _SCALES and generator.random() < 0.5:
        unit, factor = _SCALES[unit]
        numbers = [str(Decimal(number) * Decimal(factor)) for number in numbers]
    numbers = [_number(number, generator) for number in numbers]
    unit = _SPELLINGS.get(unit, unit) if generator.random() < 0.3 else unit
    blank = generator.choice([" ", " ", "  "])
    return f"{blank.join(numbers)}{blank if unit else ''}{unit}"


def _number(text: str, generator: random.Random) -> str:
    number = Decimal(text)
    match generator.randrange(6):
        case 0:
            return f"{number:e}"
        case 1:
            return f"{number:E}".replace("E+", "E")
        case 2:
            return f"{number:f}" + ("00" if "." in f"{number:f}" else ".0")
        case 3:
            return f"+{number:f}" if number >= 0 else f"{number:f}"
        case 4:
            return f"{number:f}".replace("0.", ".", 1) if f"{number:f}".startswith("0.") else f"{number:f}"
        case _:
            return text


def written(data: Any, generator: random.Random | None = None) -> str:
    """Return a sheet as YAML, plainly or in a style made up at random."""
    if generator is None:
        return _block(data, 0, random.Random(0), plain=True)
    if generator.random() < 0.15:
        return json.dumps(data, indent=generator.choice([None, 1]), ensure_ascii=generator.random() < 0.5) + "\n"
    text = _block(data, 0, generator, plain=False)
    if generator.random() < 0.2:
        text = "\ufeff" + text
    if generator.random() < 0.2:
        text = text.replace("\n", "\r\n")
    return f"---\n{text}...\n" if generator.random() < 0.2 and not text.startswith("\ufeff") else text


def _scalar(text: str, generator: random.Random, *, plain: bool) -> str:
    styles = ["double", "single"] if not plain else ["double"]
    if _PLAIN.fullmatch(text) and not text.endswith(" ") and " #" not in text:
        styles = ["plain"] if plain else ["plain", "plain", "double", "single"]
    match generator.choice(styles):
        case "plain":
            return text
        case "single" if text.isprintable():
            return "'" + text.replace("'", "''") + "'"
        case _:
            return json.dumps(text, ensure_ascii=generator.random() < 0.5)


def _flow(value: Any, generator: random.Random, *, plain: bool) -> str:
    if isinstance(value, dict):
        entries = (
            f"{_scalar(k, generator, plain=plain)}: {_flow(v, generator, plain=plain)}" for k, v in value.items()
        )
        return "{" + ", ".join(entries) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(_flow(entry, generator, plain=plain) for entry in value) + "]"
    return _scalar(value, generator, plain=plain)


def _block(value: Any, level: int, generator: random.Random, *, plain: bool) -> str:
    """Return lines at an indentation, or one flow line."""
    indent = " " * level
    comment = "" if plain or generator.random() < 0.9 else "  # a comment: {not, read}"
    if not value or not isinstance(value, dict | list) or (level and generator.random() < 0.4):
        return f"{indent}{_flow(value, generator, plain=plain)}{comment}\n"
    lines = []
    step = 2 if plain else generator.choice([1, 2, 4])
    entries = value.items() if isinstance(value, dict) else ((None, entry) for entry in value)
    for key, entry in entries:
        head = "-" if key is None else f"{_scalar(key, generator, plain=plain)}:"
        if isinstance(entry, dict | list) and entry and generator.random() < 0.6:
            lines.append(f"{indent}{head}{comment}\n{_block(entry, level + step, generator, plain=plain)}")
        else:
            lines.append(f"{indent}{head} {_flow(entry, generator, plain=plain)}{comment}\n")
    return "".join(lines)
