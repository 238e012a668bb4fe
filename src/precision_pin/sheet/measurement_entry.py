"""Reader of the key ``measurement:``: instrument and set-up of a calibration."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from precision_pin.base import units
from precision_pin.base.arguments import shown
from precision_pin.base.errors import InputError
from precision_pin.robot.chain import Chain
from precision_pin.sheet.law_reader import SettingError
from precision_pin.sheet.measurement import KINDS, Kind, Measurement
from precision_pin.sources.payload import Payload


class PlaneEntry(BaseModel):
    """A plane that is touched."""

    model_config = ConfigDict(extra="forbid")

    point: str = Field(description="A point on it, such as '300 0 50 mm', in base axes.")
    normal: str = Field(description="Its normal, such as '0 0 1', in base axes.")


class LoadEntry(BaseModel):
    """A load while the arm is measured."""

    model_config = ConfigDict(extra="forbid")

    at: str = Field(description="The link that carries it.")
    mass: str = Field(description="Its mass, such as '1 kg'.")
    com: str = Field("0 0 0 mm", description="Its centre of mass in that link's frame.")


class MeasurementEntry(BaseModel):
    """Instrument and set-up of a calibration."""

    model_config = ConfigDict(extra="forbid")

    kind: Kind = Field("position", description=f"What is measured: {', '.join(KINDS)}.")
    std: str = Field("0.02 mm", description="Standard deviation of a measured length, or of a contact.")
    attitude_std: str | None = Field(
        None, description="That of a measured angle of a pose; std / 100 mm if left out, as of targets 100 mm apart."
    )
    target: str = Field("0 0 0 mm", description="The measured point in the tip's axes.")
    target_known: Literal["true", "false"] = Field("true", description="false: its place on the tool is estimated.")
    base: Literal["known", "free"] = Field(
        "known", description="free: the base in the instrument's axes (or anchor, plane, sockets) is estimated."
    )
    anchor: str = Field("0 0 0 mm", description="Where distances are measured from, in base axes.")
    plane: PlaneEntry | None = Field(None, description="The plane that is touched.")
    sockets: list[str] = Field(default_factory=list, description="Places of the sockets, in base axes.")
    seen_from: str | None = Field(
        None, description="Place of the instrument in base axes, where it must see the target."
    )
    facing: str | None = Field(
        None, description="Direction in the tip's axes to which the target faces, such as '0 0 1'."
    )
    cone: str = Field("60 deg", description="Largest angle between that direction and the instrument.")
    load: list[LoadEntry] | Literal["none"] | None = Field(
        None, description="What the arm carries while measured, in place of the payloads; none: nothing."
    )


def read_measurement(entry: MeasurementEntry, chain: Chain) -> Measurement:
    """Return the measurement of an entry.

    Raises
    ------
    InputError
        A number or a combination of settings is wrong; a :class:`~precision_pin.sheet.settings.SettingError` where one key is at
        fault.
    """
    plane = None
    if entry.plane is not None:
        point = _point(("plane", "point"), entry.plane.point)
        plane = (point, _vector(("plane", "normal"), entry.plane.normal, units.RATIO))
    angle = None if entry.attitude_std is None else _number(("attitude_std",), entry.attitude_std, units.ANGLE)
    return Measurement(
        kind=entry.kind,
        std=_number(("std",), entry.std, units.LENGTH),
        target=_point(("target",), entry.target),
        base=entry.base,
        target_known=entry.target_known == "true",
        attitude_std=angle,
        anchor=_point(("anchor",), entry.anchor),
        plane=plane,
        sockets=tuple(_point(("sockets", k), one) for k, one in enumerate(entry.sockets)),
        seen_from=None if entry.seen_from is None else _point(("seen_from",), entry.seen_from),
        facing=None if entry.facing is None else _vector(("facing",), entry.facing, units.RATIO),
        cone=_number(("cone",), entry.cone, units.ANGLE),
        load=_load(entry, chain),
    )


def _load(entry: MeasurementEntry, chain: Chain) -> tuple[Payload, ...] | None:
    if entry.load is None:
        return None
    payloads = []
    for k, one in enumerate(() if entry.load == "none" else entry.load):
        try:
            chain.link_frame(one.at)
        except InputError as error:
            raise SettingError(("load", k, "at"), error.findings[0].message) from None
        mass = _number(("load", k, "mass"), one.mass, units.MASS)
        payloads.append(Payload(at=one.at, mass=mass, com=_point(("load", k, "com"), one.com)))
    return tuple(payloads)


def _number(below: tuple[str | int, ...], text: object, quantity: units.Quantity) -> float:
    try:
        value = units.parse(text, quantity)
    except InputError as error:
        raise SettingError(below, f"{_word(below)}: {error.findings[0].message}") from None
    if value <= 0 and "std" in str(below[-1]):
        raise SettingError(below, f"{below[-1]} must be above zero, got {shown(text)}")
    return value


def _vector(below: tuple[str | int, ...], text: str, quantity: units.Quantity) -> tuple[float, float, float]:
    try:
        x, y, z = units.parse_vector(text, quantity, count=3)
    except InputError as error:
        raise SettingError(below, f"{_word(below)}: {error.findings[0].message}") from None
    return x, y, z


def _point(below: tuple[str | int, ...], text: str) -> tuple[float, float, float]:
    return _vector(below, text, units.LENGTH)


def _word(below: tuple[str | int, ...]) -> str:
    return ".".join(map(str, below))
