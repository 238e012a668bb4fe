"""Source modules with one planted fault."""

import importlib.util
import sys
import types
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import precision_pin.sources


@dataclass(frozen=True)
class Fault:
    """Return a change of text in a module of ``precision_pin.sources``.

    ``user`` names the module whose check must notice, where the fault sits in a helper it imports from.
    """

    module: str
    what: str
    old: str
    new: str
    user: str = ""


def original(module: str) -> types.ModuleType:
    """Return a fresh copy of a source module as it stands."""
    return _compiled(module, _text(module), "copy")


def planted(fault: Fault) -> types.ModuleType:
    """Return a copy of the module to check, with the fault in it."""
    text = _text(fault.module)
    assert text.count(fault.old) == 1, f"{fault.module}: {fault.old!r} occurs {text.count(fault.old)} times, not once"
    changed = _compiled(fault.module, text.replace(fault.old, fault.new), "fault")
    if not fault.user:
        return changed
    with mock.patch.dict(sys.modules, {f"precision_pin.sources.{fault.module}": changed}):
        user = original(fault.user)
    taken = {id(value) for name, value in vars(changed).items() if getattr(value, "__module__", "") == changed.__name__}
    assert taken & set(map(id, vars(user).values())), f"{fault.user} takes nothing from {fault.module}"
    return user


def _text(module: str) -> str:
    return (Path(precision_pin.sources.__path__[0]) / f"{module}.py").read_text(encoding="utf-8")


def _compiled(module: str, text: str, suffix: str) -> types.ModuleType:
    name = f"planted_{module}_{suffix}"
    spec = importlib.util.spec_from_loader(name, loader=None)
    assert spec is not None
    result = importlib.util.module_from_spec(spec)
    sys.modules[name] = result  # data classes look their module up
    try:
        exec(compile(text, f"<{name}>", "exec"), result.__dict__)
    finally:
        del sys.modules[name]
    return result
