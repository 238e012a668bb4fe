"""Sheets broken at random: in their bytes, and in their keys, values and structure."""

from __future__ import annotations

import copy
import random
from pathlib import Path
from typing import Any

from fuzzing.errorsheets.grammar import SHIPPED, random_sheet
from fuzzing.errorsheets.spelling import written
from precision_pin.sheet.text import read_text

__all__ = ["broken"]

_HOSTILE = (
    "", " ", "0", "-1 mm", "1e999 mm", "-1e999 mm", "1e308 m", "1e300 mm", "1e-320 mm", "nan", "nan mm", "inf mm", ".nan",
    "9" * 400, "9" * 400 + " mm", "0." + "0" * 400 + "1 mm", "1" * 5000, "1_000 mm", "1:30", "12:30:00", "0x1F mm",
    "012 mm", "０.５ mm", "٣ mm", "²", "yes", "no", "on", "off", "null", "~", "true", "1 mm mm", "1 2 3 4 5 mm", "1,5 mm",
    "1. mm", ".5 mm", "+.5e+1 mm", "5 furlong", "5", "1 %", "200 %", "-50 %", "a" * 3000, "joint1", "joint99", "tool",
    "a\nforged: error", "\u202emm 1", "\u0000", "\ud800", "x of joint2", "-z of nothing", "../../etc/passwd", "/dev/null",
    "six.csv", "gauge.csv", "4dof.urdf", ".", "earth", "0 0 0 m/s^2", "1e200 0 0 m/s^2", "0 0 0 0 deg", "1e20 0 0 0 rad",
    "pose", "visit", "unit", "equilibrium", "<<", "*a", "&a", "!!python", "%", "- -", "{", "[", "l0", "a1", "d0", "d0.x",
    "1e154 kg", "1e-300 N*m^2", "0 N*m^2", "-8000 N*m^2", "1e-9 N*m^2", "1e9 kg", "3 rad", "4 rad", "100 deg", "1e6 mm",
)  # fmt: skip
_PIECES = (
    b"&a ", b"*a", b"!!int ", b"<<: *a\n", b"---\n", b"...\n", b"%YAML 1.1\n", b"? ", b": ", b"- ", b"\t", b"\r", b"\n\n",
    b"#", b"'", b'"', b"|\n", b">-\n", b"{", b"}", b"[", b"]", b",", b"\xff", b"\xfe\xff", b"\x00", b"\xef\xbb\xbf",
    b"\xe2\x80\xa8", b"\xc2\x85", b"\\UFFFFFFFF", b'"\\ud800"', b"[" * 30, b"{a: " * 30, b"- " * 30, b"9" * 400, b"e99999",
)  # fmt: skip


def broken(generator: random.Random) -> bytes:
    """Return a sheet with one to four faults."""
    whole = _shipped(generator) if generator.random() < 0.15 else random_sheet(generator)
    if generator.random() < 0.6:
        for _ in range(generator.randint(1, 3)):
            _break_data(whole, generator)
        text = written(whole, generator if generator.random() < 0.5 else None).encode("utf-8", "surrogatepass")
        if generator.random() < 0.85:
            return text
    else:
        text = written(whole, generator).encode("utf-8", "surrogatepass")
    for _ in range(generator.randint(1, 4)):
        text = _break_bytes(text, generator)
    return text


def _shipped(generator: random.Random) -> dict[str, Any]:
    path = generator.choice(sorted(Path(SHIPPED).glob("*.errors.yaml")))
    data: dict[str, Any] = copy.deepcopy(read_text(path.read_text(encoding="utf-8"), path.name).data)
    if not data["robot"].startswith("example:") or generator.random() < 0.5:
        data["robot"] = "4dof.urdf"
    return data


def _places(value: Any) -> list[tuple[Any, Any]]:
    """Return every container with a key or number in it."""
    found: list[tuple[Any, Any]] = []
    keys = list(value) if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    for key in keys:
        found.append((value, key))
        found += _places(value[key])
    return found


def _break_data(data: dict[str, Any], generator: random.Random) -> None:
    places = _places(data)
    if not places:
        return
    holder, key = generator.choice(places)
    other_holder, other = generator.choice(places)
    match generator.randrange(9):
        case 0 | 1 | 2:
            holder[key] = generator.choice(_HOSTILE)
        case 3:
            del holder[key]
        case 4:
            holder[key] = copy.deepcopy(other_holder[other])
        case 5 if isinstance(holder, dict):
            holder[generator.choice([*_HOSTILE, str(other)])] = holder.pop(key)
        case 6 if isinstance(holder, list):
            holder.insert(generator.randrange(len(holder) + 1), copy.deepcopy(other_holder[other]))
        case 7:
            number = str(holder[key]).split(" ", 1)
            holder[key] = " ".join([generator.choice(["1e3", "-1", "0", "1e-9", "1e9", "7"]), *number[1:]])
        case _:
            unit = generator.choice(["mm", "deg", "kg", "N", "K", "%", "rad/(N*m)", "m/s^2", "N*m^2", ""])
            holder[key] = f"{str(holder[key]).split(' ', 1)[0]} {unit}"


def _break_bytes(text: bytes, generator: random.Random) -> bytes:
    at = generator.randrange(len(text) + 1)
    length = generator.choice([1, 1, 2, 5, 20, 100])
    match generator.randrange(6):
        case 0:
            return text[:at] + text[at + length :]
        case 1:
            return text[:at] + generator.choice(_PIECES) + text[at:]
        case 2:
            return text[:at] + bytes([generator.randrange(256)]) + text[at + 1 :]
        case 3:
            begin = generator.randrange(len(text) + 1)
            return text[:at] + text[begin : begin + length] + text[at:]
        case 4:
            return text[:at] + text[at : at + length] * generator.choice([2, 3, 20]) + text[at + length :]
        case _:
            lines = text.splitlines(keepends=True) or [b""]
            first, second = generator.randrange(len(lines)), generator.randrange(len(lines))
            lines[first], lines[second] = lines[second], lines[first]
            return b"".join(lines)
