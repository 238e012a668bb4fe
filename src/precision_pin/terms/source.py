"""Error sources, from settings to terms. Only this module inspects the settings of sources for draws and quantities."""

from __future__ import annotations

import dataclasses
import inspect
import itertools
import re
import typing
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, Literal

import numpy as np

from precision_pin.base.arguments import check_choice, check_number, check_text, shown
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError
from precision_pin.base.units import PerJoint, Quantity
from precision_pin.base.written_units import WrittenUnit
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.expressions import Component, Expression, component_names
from precision_pin.draws.laws import Law
from precision_pin.draws.space import LabelledSpace, entry_name
from precision_pin.robot.chain import Chain, Posture
from precision_pin.robot.places import Factors, Load
from precision_pin.terms.term import Term

Dependence = Literal["chain", "configuration", "loads"]
"""Parts of a posture that a source depends on: the chain; also the joint values; or also the loads."""


@dataclass(frozen=True)
class SettingField:
    """Setting of a source, or of a part of a setting; ``default`` is :data:`dataclasses.MISSING` if required."""

    name: str
    hint: Any
    default: Any

    @property
    def may_be_random(self) -> bool:
        """Whether it takes laws; text in it then names a parameter."""
        return takes_law(self.hint)

    @property
    def key(self) -> str:
        """Its key in a sheet: the name, without the ``_`` that sets it apart from a word of Python."""
        return self.name.removesuffix("_")

    @property
    def is_list(self) -> bool:
        """Whether it is a list."""
        return typing.get_origin(self.hint) is tuple

    @property
    def part(self) -> type | None:
        """The data class if it is one, or a list of them, else ``None``."""
        entry = next(iter(typing.get_args(self.hint)), None) if self.is_list else self.hint
        return entry if isinstance(entry, type) and dataclasses.is_dataclass(entry) else None

    @property
    def notes(self) -> tuple[Any, ...]:
        """Annotations of the type, such as quantities."""
        return typing.get_args(self.hint)[1:] if typing.get_origin(self.hint) is typing.Annotated else ()


@cache
def setting_fields(kind: type) -> tuple[SettingField, ...]:
    """Return the settings of a kind of source, or of the class of a part of a setting."""
    hints = typing.get_type_hints(kind, include_extras=True)
    return tuple(SettingField(entry.name, hints[entry.name], entry.default) for entry in dataclasses.fields(kind))


@cache
def setting_meanings(kind: type) -> dict[str, str]:
    """Return the meaning of each setting on one line, from the section Attributes of the class docstring."""
    section = re.search(r"^Attributes:\n(.*?)(?:\n\n\S|\Z)", inspect.getdoc(kind) or "", re.DOTALL | re.MULTILINE)
    meanings: dict[str, str] = {}
    for names, text in re.findall(r"^    (\S[^:]*): (.*(?:\n     .*)*)", section[1] if section else "", re.MULTILINE):
        meanings |= dict.fromkeys(names.split(", "), " ".join(text.replace("``", "`").split()))
    return meanings


def takes_law(hint: Any) -> bool:
    """Return whether a setting of this type may be random."""
    return hint is Law or any(takes_law(part) for part in typing.get_args(hint))


def setting_text(part: Any, name: str) -> str:
    """Return the number in a setting of a source, or of a part of a setting, with its unit."""
    kind: type = type(part)
    notes = next(field.notes for field in setting_fields(kind) if field.name == name)
    pairs = [(note.revolute, note.prismatic) if isinstance(note, PerJoint) else (note,) for note in notes]
    quantities, value = list(itertools.chain(*pairs)), getattr(part, name)
    if len(quantities) == 1:
        return WrittenUnit.suiting(quantities[0], [value])(value)
    return f"{value:.6g} {' or '.join(quantity.si for quantity in quantities)}"


@dataclass(eq=False, slots=True)
class _SettingValue:
    """Value in the settings of a source.

    Attributes:
        name: ``kind[subject].field``, or in a part of a setting ``kind[subject].field[0].field``.
        owner, entry: Class of the field that holds it, and name of the field.
    """

    name: str
    value: object
    owner: type
    entry: str

    @property
    def field(self) -> SettingField:
        """The field that holds it; InputError if no module defines the names in the class's annotations."""
        try:
            return next(field for field in setting_fields(self.owner) if field.name == self.entry)
        except NameError as error:
            where = f"{self.owner.__module__}.{self.owner.__qualname__}"
            raise InputError(
                f"{where}: the types of its settings cannot be found ({error}); define the class in a module"
            ) from None

    @property
    def draw(self) -> Draw | None:
        """The draw in the setting, if any."""
        # most settings first: checks of abstract classes are slow
        if self.value is None or isinstance(self.value, str | float):
            return None
        if isinstance(self.value, Draw):
            return self.value if self.value.name else dataclasses.replace(self.value, name=self.name)
        return Draw(self.name, self.value) if isinstance(self.value, Law) else None

    @property
    def quantity(self) -> Quantity | PerJoint | None:
        """The quantity of the value, if the field has one."""
        return next((note for note in self.field.notes if isinstance(note, Quantity | PerJoint)), None)

    def numbers(self) -> dict[str, Quantity | PerJoint | None]:
        """Return the components that the value draws, uses or names, with their quantities."""
        if isinstance(self.value, str):
            return {self.value: self.quantity} if self.field.may_be_random else {}
        if isinstance(self.value, Expression):
            is_number = isinstance(self.value, Component)
            return dict.fromkeys(component_names(self.value), self.quantity if is_number else None)
        return {} if self.draw is None else dict.fromkeys(self.draw.components, self.quantity)


def _setting_values(part: Any, label: str) -> Iterator[_SettingValue]:
    """Yield every value in the settings, including entries of lists and values in parts of settings."""
    owner: type = type(part)
    for name in _field_names(owner):
        setting = getattr(part, name)
        for k, value in enumerate(setting if isinstance(setting, tuple) else (setting,)):
            if dataclasses.is_dataclass(value) and not isinstance(value, Draw | Law | Expression):
                yield from _setting_values(value, f"{label}.{name}[{k}]")
            else:
                yield _SettingValue(f"{label}.{entry_name(name, k)}", value, owner, name)


@cache
def _field_names(kind: type) -> tuple[str, ...]:
    return tuple(entry.name for entry in dataclasses.fields(kind))


@cache
def _kind(name: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()


class Source(ABC):
    """Error source: computes terms from its settings.

    Subclasses are final, frozen data classes whose fields are the settings; the docstring states the physics with
    equation and reference. A source reads the posture and its draws, and does not depend on the users of its terms.
    """

    def __init_subclass__(cls, **options: Any) -> None:
        """Make every source check its plain settings before the ``__post_init__`` of its class."""
        super().__init_subclass__(**options)
        class_checks: Callable[[Any], None] | None = getattr(cls, "__post_init__", None)

        def __post_init__(self: Source) -> None:
            _check_plain_settings(self)
            if class_checks is not None:
                class_checks(self)
            _check_finite_settings(self)

        cls.__post_init__ = __post_init__  # type: ignore[attr-defined]

    @property
    def subject(self) -> str:
        """Name in its label: the first non-empty of the settings ``joint``, ``link``, ``frame`` and ``at``."""
        names = (getattr(self, setting, None) for setting in ("joint", "link", "frame", "at"))
        return next((name for name in names if name), "")

    @property
    def depends_on(self) -> Dependence:
        """Parts of a posture that the source depends on: the ``chain``, also the ``configuration``, or also the ``loads``.

        For ``chain``, terms, loads and gravity are equal to the last digit at every posture and computed once. For
        ``configuration``, terms are equal under all loads and on the deflected arm. ``loads`` is always safe.
        """
        return "loads"

    takes_many: ClassVar[bool] = False
    """Whether :meth:`accepts_many` is true for every chain."""

    def accepts_many(self, chain: Chain) -> bool:
        """Return whether :meth:`terms` also takes a posture of P configurations of a chain, which makes maps faster.

        Targets and factors are then equal at all configurations, and twists get a last dimension of P; a twist is zero
        where a configuration alone has no such term. Where factors do differ, `terms` raises
        :class:`~precision_pin.terms.term.DifferentFormulas`. Loads and gravity do not depend on the configuration. False
        is always safe.
        """
        return self.takes_many or self.depends_on == "chain"

    def is_alike_everywhere(self, chain: Chain) -> bool:
        """Return whether its terms are equal at every posture of a chain, to rounding.

        True also for some sources that read the configuration, such as along a direction fixed in their link.
        """
        return self.depends_on == "chain"

    @abstractmethod
    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield the terms at a posture.

        Args:
            posture: The chain at its nominal configuration, with all loads on it.
            space: The space of the source, with the values of its settings.
        """

    def loads(self, posture: Posture, space: LabelledSpace) -> Iterator[Load]:
        """Yield the weights that the source adds to the chain (default: none)."""
        return iter(())

    def gravity(self, posture: Posture, space: LabelledSpace) -> Iterator[tuple[Array, Factors]]:
        """Yield additions to gravity: vectors ``(3,)``, base axes, m/s², with their factors (default: none)."""
        return iter(())

    def remarks(self, space: LabelledSpace) -> Iterator[Finding]:
        """Yield warnings about settings that are allowed but probably unintended (default: none)."""
        return iter(())

    def after(self, seconds: float, space: LabelledSpace) -> Source:
        """Return the source ``seconds`` after a cold start, with equal draws; itself if time has no effect."""
        return self

    def clash(self, sources: Sequence[Source]) -> str:
        """Return what speaks against this source beside the others of a model (default: nothing)."""
        return ""

    is_in_drive: ClassVar[bool] = False
    """Whether its errors arise between motor and joint, so that an encoder at the joint sees them."""

    holds_joint: ClassVar[bool] = False
    """Whether its friction holds its joint against a force that comes after the stop."""

    is_put_down: ClassVar[bool] = False
    """Whether the arm can put it down, as a payload."""

    deviations: ClassVar[tuple[str, ...]] = ()
    """Settings that are deviations from nominal: a nonzero plain number is a constant error."""

    @classmethod
    def nominal_size(cls, settings: Mapping[str, Any], chain: Chain) -> float | None:
        """Return the nominal length, m, from which its `deviations` are measured, by the settings of a sheet; None if unknown.

        Raises:
            InputError: The settings make no source.
        """
        return None

    is_dimensional: ClassVar[bool] = False
    """Whether its `deviations`, or else its draws, are errors of the arm's dimensions, which a manufacturer can measure."""

    def without_dimensions(self, label: str, scopes: Mapping[str, Scope]) -> Source | None:
        """Return the source without the dimensional errors of unit scope; None if no error remains.

        ``scopes`` are the scopes of all components, by name.
        """
        if not self.is_dimensional:
            return self
        source_draws, changed = self.own_draws(label), {}
        remains = bool(source_draws) if self.deviations else any(draw.scope is not Scope.UNIT for draw in source_draws)
        for name in self.deviations:
            leaves = [leaf for leaf in _setting_values(self, label) if leaf.entry == name]
            values = tuple(
                leaf.value for leaf in leaves if any(scopes[number] is not Scope.UNIT for number in leaf.numbers())
            )
            value = getattr(self, name)
            remains = remains or bool(values)
            changed[name] = values if isinstance(value, tuple) else values[0] if values else value and 0.0
        return dataclasses.replace(self, **changed) if remains else None  # type: ignore[type-var]

    def own_draws(self, label: str) -> tuple[Draw, ...]:
        """Return further draws of the source, with quantities, besides the laws in its settings."""
        return ()

    def idle_draws(self, label: str, names: Collection[str]) -> Collection[str]:
        """Return its further draws that nothing uses in a model with draws of these names (default: none)."""
        return ()

    @classmethod
    def kind(cls) -> str:
        """Return the kind's name in a sheet: the class name in snake case."""
        return _kind(cls.__name__)

    words: ClassVar[Mapping[str, str]] = {}
    """Texts for settings and further draws, with ``{subject}`` or other settings; else kind, setting and subject."""

    def describe(self, setting: str) -> str:
        """Return the description of a setting (``rz``, ``segments[0].wall``) or of a further draw."""
        first, *parts = re.sub(r"\[(\d+)\]", lambda index: f" {int(index[1]) + 1}", setting).split(".")
        name, _, number = first.partition(" ")
        name = name.partition("[")[0]  # of a draw that sources of one joint share
        if name in self.words and not parts:
            text = self.words[name].format(subject=self.subject, **self.settings())
            return f"{text} ({number})" if number not in ("", "1") else text
        phrase = " of ".join([*reversed(parts), first]).replace("_", " ")
        return f"{self.kind().replace('_', ' ')} {phrase} of {self.subject}"

    def label(self) -> str:
        """Return ``kind[subject]``, the prefix of the names of its unnamed draws."""
        return f"{self.kind()}[{self.subject}]"

    def setting_text(self, name: str) -> str:
        """Return the number in a setting with its unit."""
        return setting_text(self, name)

    def settings(self) -> dict[str, object]:
        """Return the settings by field name."""
        return {name: getattr(self, name) for name in _field_names(type(self))}

    def draws(self, label: str) -> tuple[Draw, ...]:
        """Return the draws that the source adds to the model: laws in its settings, and further draws."""
        setting_draws = [leaf.draw for leaf in _setting_values(self, label)]
        return (*(draw for draw in setting_draws if draw is not None), *self.own_draws(label))

    def places(self, label: str) -> dict[str, str]:
        """Return, for each component that the source uses, its setting or further draw.

        Raises:
            InputError: The types of its settings are unknown.
        """
        pairs = [(name, leaf.name) for leaf in _setting_values(self, label) for name in leaf.numbers()]
        pairs += [(name, draw.name) for draw in self.own_draws(label) for name in draw.components]
        places = dict(reversed(pairs))
        return {name: places[name].removeprefix(f"{label}.") for name, _ in pairs}

    def numbers(self, label: str) -> dict[str, Quantity | PerJoint | None]:
        """Return the components that the source uses with their quantities, None if no setting gives one.

        They are those of its draws, and those that its settings name, also in parts of settings and formulas.

        Raises:
            InputError: The types of its settings are unknown.
        """
        quantities: dict[str, Quantity | PerJoint | None] = {}
        for leaf in _setting_values(self, label):
            for name, quantity in leaf.numbers().items():
                quantities[name] = quantities.get(name) or quantity
        for draw in self.own_draws(label):
            for name, stated in itertools.zip_longest(draw.components, draw.quantities):
                quantities[name] = quantities.get(name) or stated
        return quantities


def _check_plain_settings(source: Source) -> None:
    """Check the types of settings declared as numbers, text or lists; each class then checks the values."""
    for field in dataclasses.fields(source):  # type: ignore[arg-type]
        value, declared = getattr(source, field.name), str(field.type).removeprefix("Annotated[")
        if value is None and "| None" in declared:
            continue
        what = f"{field.name} of {source.kind()}"
        if declared.startswith(("str", "Literal[", "PadsOn")):
            check_text(what, value)
        elif declared.startswith("float") and not isinstance(value, float):
            check_number(what, value)
        elif declared.startswith("tuple[") and not isinstance(
            value, tuple | list | np.ndarray if declared.startswith("tuple[float") else tuple | list
        ):
            raise InputError(f"{what} must be a list, got {shown(value)}")


def _check_finite_settings(source: Source) -> None:
    """Raise if a number is infinite or NaN, which the checks of a class may have accepted."""
    for field in dataclasses.fields(source):  # type: ignore[arg-type]
        value = getattr(source, field.name)
        if isinstance(value, float) and str(field.type).removeprefix("Annotated[").startswith("float"):
            check_number(f"{field.name} of {source.kind()}", value)


def fix_settings(source: Source) -> Source:
    """Return a source with immutable settings: lists as tuples, arrays as read-only copies."""
    if not dataclasses.is_dataclass(source):
        raise InputError(f"a source must be a frozen data class, got {shown(source)}")
    check_choice(f"depends_on of {source.label()}", source.depends_on, typing.get_args(Dependence))
    settings = source.settings()
    fixed = {name: fixed for name, value in settings.items() if (fixed := _fix_value(value)) is not value}
    return dataclasses.replace(source, **fixed) if fixed else source


def _fix_value(value: object) -> object:
    if isinstance(value, list):
        return tuple(map(_fix_value, value))
    if isinstance(value, np.ndarray) and value.flags.writeable:
        value = np.array(value)
        value.flags.writeable = False
    return value
