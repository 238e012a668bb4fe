"""Which physical quantity each random number is, read off the settings of the sources that take it."""

from __future__ import annotations

import typing
from collections.abc import Iterator
from typing import Final

from precision_pin import units
from precision_pin.draws.laws import Law
from precision_pin.draws.space import Draw
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain
from precision_pin.terms.source import Source
from precision_pin.units import PerJoint, Quantity

__all__ = ["quantities_of"]

# what sources draw beside the laws in their settings, by kind and the ending of the component's name
_OWN: Final[dict[tuple[str, str], Quantity | PerJoint]] = {
    ("axis_install", "A.x"): units.LENGTH,
    ("axis_install", "A.y"): units.LENGTH,
    ("axis_install", "B.x"): units.LENGTH,
    ("axis_install", "B.y"): units.LENGTH,
    ("encoder", "quantisation"): units.PerJoint(units.ANGLE, units.LENGTH),
    **{("covariance", f"error.{k}"): units.LENGTH for k in range(3)},
    **{("covariance", f"error.{k}"): units.ANGLE for k in range(3, 6)},
    **{("table", f"row.{name}"): units.LENGTH for name in ("x", "y", "z")},
    **{("table", f"row.{name}"): units.ANGLE for name in ("rx", "ry", "rz")},
}
# directions and sides, of unit size
_PURE: Final = {("backlash", "side"), ("clearance", "side"), ("clearance", "A"), ("clearance", "B")}
_PHASE: Final = "phase"


def quantities_of(error_model: ErrorModel) -> dict[str, Quantity]:
    """Return the quantity of every component of the model's draws; those that no setting tells are left out."""
    known: dict[str, Quantity] = {}
    for source, label in zip(error_model.sources, error_model.labels, strict=True):
        slides = _slides(source, error_model.chain)
        for name, note in _settings(source, label):
            known.setdefault(name, _of(note, slides))
        for draw in source.own_draws(label):
            for component in draw.components:
                own = _own(source.kind(), component.removeprefix(f"{label}."))
                if own is not None:
                    known.setdefault(component, _of(own, slides))
    return known


def _settings(source: Source, label: str) -> Iterator[tuple[str, Quantity | PerJoint]]:
    """Yield the names of the random numbers in the settings of a source, and what they are."""
    for leaf in source.leaves(label):
        if not isinstance(leaf.value, str | Draw | Law):
            continue
        note = next((note for note in typing.get_args(leaf.hint)[1:] if isinstance(note, Quantity | PerJoint)), None)
        if note is not None:
            given = leaf.value if isinstance(leaf.value, str) else getattr(leaf.value, "name", "")
            yield given or leaf.name, note


def _own(kind: str, ending: str) -> Quantity | PerJoint | None:
    stem = ending.partition(".")[0]
    if (kind, stem) in _PURE or stem.partition("[")[0] == _PHASE:
        return units.RATIO
    return _OWN.get((kind, ending))


def _of(note: Quantity | PerJoint, slides: bool) -> Quantity:
    if isinstance(note, PerJoint):
        return note.prismatic if slides else note.revolute
    return note


def _slides(source: Source, chain: Chain) -> bool:
    joint = getattr(source, "joint", None)
    return joint in chain.joint_names and bool(chain.prismatic[chain.joint_index(joint)])
