"""Error sources: settings in, terms out; what a source draws and needs is read off its settings here, and nowhere else."""

from __future__ import annotations

import dataclasses
import re
import typing
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, TypeVar, cast, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.draws.expressions import Expression
from precision_pin.draws.laws import Law
from precision_pin.draws.space import Draw, LabelledSpace, indexed
from precision_pin.errors import Finding, InputError
from precision_pin.inputs.arguments import shown
from precision_pin.robot.chain import Chain, Posture
from precision_pin.robot.loads import Factors, Load
from precision_pin.terms.term import Term

__all__ = ["AskedSource", "Leaf", "Source", "fix_settings", "labels", "own_draws"]

Array = NDArray[np.float64]
Said = TypeVar("Said")


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


class _NeedsPosture(BaseException):
    """A source reads of a posture what is not the same at all of them; no ``except Exception`` of its own hides it."""


@final
class _AnyPosture:
    """Stands for a posture of which only the chain is known."""

    def __init__(self, chain: Chain) -> None:
        self.chain = chain

    def __getattr__(self, name: str) -> object:
        raise _NeedsPosture(name)


@final
class AskedSource:
    """A source, asked once only for what it says the same of every posture.

    Whether it does is seen by asking it about a posture that tells no more than its chain. A source sees nothing else that
    changes, and it makes the same of the same: it is frozen.

    Parameters
    ----------
    source
        The source.
    view
        The space as it sees it.
    chain
        The arm.
    """

    def __init__(self, source: Source, view: LabelledSpace, chain: Chain) -> None:
        self._source, self._view = source, view
        self._loads = self._of_any(source.loads, chain)
        self._gravity = self._of_any(source.gravity, chain)
        self._terms = self._of_any(source.terms, chain)

    @property
    def depends_on_posture(self) -> bool:
        """Whether anything it says may differ from posture to posture."""
        return self._loads is None or self._gravity is None or self._terms is None

    def loads(self, posture: Posture) -> Iterable[Load]:
        """Return its loads."""
        return self._source.loads(posture, self._view) if self._loads is None else self._loads

    def gravity(self, posture: Posture) -> Iterable[tuple[Array, Factors]]:
        """Return what it adds to gravity."""
        return self._source.gravity(posture, self._view) if self._gravity is None else self._gravity

    def terms(self, posture: Posture) -> Iterable[Term]:
        """Return its terms."""
        return self._source.terms(posture, self._view) if self._terms is None else self._terms

    def _of_any(self, ask: Callable[[Posture, LabelledSpace], Iterator[Said]], chain: Chain) -> tuple[Said, ...] | None:
        try:
            return tuple(ask(cast("Posture", _AnyPosture(chain)), self._view))
        except (_NeedsPosture, Exception):  # noqa: BLE001 - what is wrong with it comes up again at a posture
            return None


def fix_settings(source: Source) -> Source:
    """Return a source whose settings cannot be changed from outside: lists as tuples, arrays as copies."""
    if not dataclasses.is_dataclass(source):
        raise InputError(f"a source must be a frozen data class, got {shown(source)}")
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
