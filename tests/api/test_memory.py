"""Free memory: that of the machine, or what the control groups of a container leave of it."""

from __future__ import annotations

import pytest

from precision_pin.base import arguments

GIB = 2**30


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """Return a function that writes the files of the kernel: text by path."""

    def write(**files: str) -> int | None:
        for path, text in {"meminfo": f"MemAvailable: {8 * GIB // 1024} kB", **files}.items():
            place = tmp_path.joinpath(*path.split("__"))
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_text(text)
        return arguments.available_memory()

    monkeypatch.setattr(arguments, "_MEMORY", tmp_path / "meminfo")
    monkeypatch.setattr(arguments, "_GROUPS", tmp_path / "groups")
    monkeypatch.setattr(arguments, "_OWN_GROUPS", tmp_path / "own")
    return write


def test_without_groups_it_is_the_machine(machine):
    assert machine() == 8 * GIB
    assert machine(own="0::/\n", **{"groups__memory.max": "max", "groups__memory.current": "1"}) == 8 * GIB


def test_the_limit_of_a_container(machine):
    files = {"groups__memory.max": str(2 * GIB), "groups__memory.current": str(GIB)}
    assert machine(own="0::/\n", **files) == GIB


def test_the_tightest_of_nested_groups(machine):
    files = {"groups__a__memory.max": str(4 * GIB), "groups__a__memory.current": str(GIB)}
    files |= {"groups__a__b__memory.max": "max", "groups__a__b__memory.current": "0"}
    assert machine(own="0::/a/b\n", **files) == 3 * GIB


def test_groups_of_the_first_version(machine):
    files = {"groups__memory__x__memory.limit_in_bytes": str(GIB), "groups__memory__x__memory.usage_in_bytes": str(GIB)}
    assert machine(own="5:cpu:/\n4:memory:/x\n0::/\n", **files) == 0
