"""Error sources: settings in, terms out; what a source draws and needs is read off its settings here, and nowhere else."""

from __future__ import annotations

import dataclasses
import re
import typing
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, Literal, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.draws.expressions import Expression
from precision_pin.draws.laws import Law
from precision_pin.draws.space import Draw, LabelledSpace, indexed
from precision_pin.errors import Finding, InputError
from precision_pin.inputs.arguments import check_choice, shown
from precision_pin.robot.chain import Chain, Posture
from precision_pin.robot.loads import Factors, Load
from precision_pin.terms.term import Term

__all__ = ["BoundSource", "Dependence", "Leaf", "Source", "fix_settings", "labels", "load_posture", "own_draws"]

Array = NDArray[np.float64]
Answer = TypeVar("Answer")
Dependence = Literal["chain", "configuration", "loads"]
"""What of a posture a source reads: its chain, the joint values too, or the loads too."""


@final
@dataclass(frozen=True, eq=False)
class Leaf:
    """One value among the settings of a source.

    Attributes
    ----------
    name
        Where it stands: ``kind[subject].field``, of a part of a setting ``kind[subject].field[0].field``.
    value
        The value.
    owner, field
        The class whose field it is, and the field.
    """

    name: str
    value: object
    owner: type
    field: str

    @property
    def hint(self) -> Any:
        """The type that the field is declared with, its notes included."""
        return _hints(self.owner)[self.field]

    @property
    def may_be_random(self) -> bool:
        """Whether the field takes laws, so that text in it names a parameter."""
        return _takes_law(self.hint)


_hints = cache(partial(typing.get_type_hints, include_extras=True))


def _takes_law(hint: Any) -> bool:
    return hint is Law or any(_takes_law(part) for part in typing.get_args(hint))


def _leaves(part: Any, label: str) -> Iterator[Leaf]:
    for entry in dataclasses.fields(part):
        setting = getattr(part, entry.name)
        for k, value in enumerate(setting if isinstance(setting, tuple) else (setting,)):
            if dataclasses.is_dataclass(value) and not isinstance(value, Law | Draw | Expression):
                yield from _leaves(value, f"{label}.{entry.name}[{k}]")
            else:
                yield Leaf(f"{label}.{indexed(entry.name, k)}", value, type(part), entry.name)


class Source(ABC):
    """An error source: settings in, terms out.

    A final, frozen data class whose fields are its settings; the docstring holds the physics with equation and
    reference. It knows the posture and its own draws, nothing of what reads the terms.
    """

    @property
    @abstractmethod
    def subject(self) -> str:
        """The joint, link or frame it is about, as in its label."""

    @property
    def depends_on(self) -> Dependence:
        """What of a posture the source reads: its ``chain``, the ``configuration`` too, or the ``loads`` on it too.

        Of a source that says ``chain``, terms, loads and gravity are the same to the last digit at every posture, so it is
        asked once. The terms of one that says ``configuration`` are the same under all loads and on the deflected arm.
        ``loads`` is always safe.
        """
        return "loads"

    def is_alike_everywhere(self, chain: Chain) -> bool:
        """Return whether its terms are the same at every posture of a chain, to rounding.

        Of one that reads the configuration they may be, such as along a direction that turns with the link it is on.
        """
        del chain
        return self.depends_on == "chain"

    @abstractmethod
    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield the terms at a posture.

        Parameters
        ----------
        posture
            The chain at its nominal configuration, with all loads on it.
        space
            What the settings stand for.
        """

    def loads(self, posture: Posture, space: LabelledSpace) -> Iterator[Load]:
        """Yield the weights the source hangs on the chain; none by default."""
        del posture, space
        return iter(())

    def gravity(self, posture: Posture, space: LabelledSpace) -> Iterator[tuple[Array, Factors]]:
        """Yield what the source adds to gravity: vectors ``(3,)``, base axes, m/s², with the parameters that multiply them.

        None by default.
        """
        del posture, space
        return iter(())

    def remarks(self, space: LabelledSpace) -> Iterator[Finding]:
        """Yield warnings about settings that are allowed but seldom meant; none by default."""
        del space
        return iter(())

    def own_draws(self, label: str) -> tuple[Draw, ...]:
        """Return the draws the source makes itself, beside the laws in its settings; none by default."""
        del label
        return ()

    @classmethod
    def kind(cls) -> str:
        """Return the kind's name in a sheet: the class name in lower case with underscores."""
        return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", cls.__name__).lower()

    @final
    def label(self) -> str:
        """Return ``kind[subject]``, by which its unnamed draws are named."""
        return f"{self.kind()}[{self.subject}]"

    @final
    def settings(self) -> dict[str, object]:
        """Return the settings by field name."""
        return {entry.name: getattr(self, entry.name) for entry in dataclasses.fields(self)}  # type: ignore[arg-type]

    @final
    def leaves(self, label: str) -> Iterator[Leaf]:
        """Yield every value in the settings, each of several by itself and those of the parts of a setting too."""
        return _leaves(self, label)

    @final
    def draws(self, label: str) -> tuple[Draw, ...]:
        """Return every draw the source needs beyond the model's named ones: laws in its settings and its own."""
        found: list[Draw] = []
        for leaf in self.leaves(label):
            if isinstance(leaf.value, Law):
                found.append(Draw(leaf.name, leaf.value))
            elif isinstance(leaf.value, Draw):
                found.append(dataclasses.replace(leaf.value, name=leaf.value.name or leaf.name))
        return (*found, *self.own_draws(label))


@final
class BoundSource:
    """A source and what its settings stand for; what does not depend on the posture it is asked for once.

    Parameters
    ----------
    source
        The source.
    view
        The space as it sees it.
    """

    def __init__(self, source: Source, view: LabelledSpace) -> None:
        self.source, self.view = source, view
        self._kept: dict[str, tuple[Any, ...]] = {}

    def loads(self, posture: Posture) -> Iterable[Load]:
        """Return its loads at a posture without those of sources."""
        return self._answer("loads", self.source.loads, posture)

    def gravity(self, posture: Posture) -> Iterable[tuple[Array, Factors]]:
        """Return what it adds to gravity at a posture without the loads of sources."""
        return self._answer("gravity", self.source.gravity, posture)

    def terms(self, posture: Posture) -> Iterable[Term]:
        """Return its terms at a posture with all loads."""
        return self._answer("terms", self.source.terms, posture)

    def _answer(
        self, name: str, method: Callable[[Posture, LabelledSpace], Iterator[Answer]], posture: Posture
    ) -> Iterable[Answer]:
        if self.source.depends_on != "chain":
            return method(posture, self.view)
        if name not in self._kept:
            self._kept[name] = tuple(method(posture, self.view))
        return self._kept[name]


def load_posture(bare: Posture, sources: Iterable[BoundSource]) -> Posture:
    """Return a posture with what sources hang on it and add to gravity."""
    listed = tuple(sources)
    laden = bare.with_loads([load for source in listed for load in source.loads(bare)])
    return laden.with_tilts([tilt for source in listed for tilt in source.gravity(bare)])


def fix_settings(source: Source) -> Source:
    """Return a source whose settings cannot be changed from outside: lists as tuples, arrays as copies."""
    if not dataclasses.is_dataclass(source):
        raise InputError(f"a source must be a frozen data class, got {shown(source)}")
    check_choice(f"depends_on of {source.label()}", source.depends_on, typing.get_args(Dependence))
    settings = source.settings()
    fixed = {name: _fixed(value) for name, value in settings.items()}
    if all(fixed[name] is value for name, value in settings.items()):
        return source
    return dataclasses.replace(source, **fixed)


def _fixed(value: object) -> object:
    if isinstance(value, list):
        return tuple(map(_fixed, value))
    if isinstance(value, np.ndarray) and value.flags.writeable:
        copy = np.array(value)
        copy.flags.writeable = False
        return copy
    return value


def labels(sources: Sequence[Source]) -> tuple[str, ...]:
    """Return every source's label.

    Sources with one label are told apart by ``#2``, ``#3``, … in the order of their settings (names and directions before
    numbers and laws), so that neither the order of the sources nor, as a rule, another tolerance changes a label.
    """
    result = [source.label() for source in sources]
    alike: dict[str, list[int]] = {}
    for k, label in enumerate(result):
        alike.setdefault(label, []).append(k)
    for label, numbers in alike.items():
        if len(numbers) > 1:
            numbers.sort(key=lambda k: _rank(sources[k]))
        for rank, k in enumerate(numbers[1:], start=2):
            result[k] = f"{label}#{rank}"
    return tuple(result)


def _rank(source: Source) -> tuple[str, str]:
    names = {field: value for field, value in source.settings().items() if isinstance(value, str)}
    return repr(names), repr(source)


def own_draws(sources: Sequence[Source], labels: Sequence[str]) -> list[Draw]:
    """Return the draws of all sources, each named after its source's label."""
    return [draw for source, label in zip(sources, labels, strict=True) for draw in source.draws(label)]
