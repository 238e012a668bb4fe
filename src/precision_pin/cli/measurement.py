"""Options of the instrument and the set-up of a calibration."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, Final

import click

from precision_pin.base.errors import InputError
from precision_pin.cli.options import Options, headed_option, together

if TYPE_CHECKING:
    from precision_pin.sheet import Sheet
    from precision_pin.sheet.measurement import Measurement

_NUMBERS: Final = ("std", "attitude_std", "point", "anchor", "visible_from")
"""Numeric options; the point is the setting ``target``."""
_option: Final = partial(headed_option, heading="Instrument")

measurement_options: Final = together(
    _option(
        "--kind",
        type=click.Choice(["position", "pose", "distance", "plane", "socket"]),
        help="What the instrument measures, or which of the sheet's; plane and sockets are given there.  [default: position]",
    ),
    _option("--std", help="Standard deviation of a measured length, or: estimate.  [default: 0.02 mm]"),
    _option("--attitude-std", metavar="ANGLE", help="That of a measured angle of a pose; std / 100 mm if left out."),
    _option(
        "--point", metavar='"X Y Z mm"', help="The point that is measured, in the tip's axes; the tip if left out."
    ),
    _option("--point-free/--point-known", default=None, help="The place of this point on the tool is estimated."),
    _option(
        "--base-free/--base-known",
        default=None,
        help="The base (or anchor, plane, sockets) is estimated. These options go before the sheet's measurement:.",
    ),
    _option(
        "--visible-from",
        metavar='"X Y Z mm"',
        help="Where the instrument stands, in base axes, if the target must face it: the tip's z, within 60°.",
    ),
    _option("--anchor", metavar='"X Y Z mm"', help="Where distances are measured from, in base axes."),
)
"""Options of the instrument."""


def measurement_of(sheet: Sheet, options: Options) -> Measurement:
    """Return the only measurement of :func:`measurements_of`; an :class:`InputError` if there are several."""
    from precision_pin.sheet.measurement import only_one

    return only_one(measurements_of(sheet, options))


def measurements_of(sheet: Sheet, options: Options) -> tuple[Measurement, ...]:
    """Return the measurements of the options and the sheet's ``measurement:``; ``--kind`` selects one of several."""
    from precision_pin.sheet.measurement import Measurement

    listed, kind = sheet.measurements or (Measurement(),), options["kind"]
    if len(listed) > 1 and kind is not None:
        listed = tuple(measurement for measurement in listed if measurement.kind == kind)
        if not listed:
            raise _usage(f"--kind {kind}: the sheet lists several measurements, none of this kind")
    return tuple(_changed(measurement, options) for measurement in listed)


def _changed(stated: Measurement, options: Options) -> Measurement:
    from precision_pin.sheet.measurement import ESTIMATE, KIND_SETTINGS, Measurement, read_setting

    given: dict[str, Any] = {name: getattr(stated, name) for name in Measurement.__match_args__}
    if options["kind"] is not None and options["kind"] != stated.kind:
        given = {name: value for name, value in given.items() if name not in KIND_SETTINGS}
    given |= {name: options[name] for name in ("kind", "columns") if options[name] is not None}
    for option in (option for option in _NUMBERS if options[option] is not None):
        setting = "target" if option == "point" else option
        try:
            value = read_setting(setting, options[option])
        except InputError as error:
            raise _usage(f"--{option.replace('_', '-')}: {error.findings[0].message}") from None
        if option == "std":
            given |= {"std_known": value != ESTIMATE, "sight": None, "stands_at": None}
        if value != ESTIMATE:
            given[setting] = value
    if options["base_free"] is not None:
        given["base"] = "free" if options["base_free"] else "known"
    if options["point_free"] is not None:
        given["target_known"] = not options["point_free"]
    return Measurement(**given)


def _usage(message: str) -> InputError:
    return InputError.of("E_USAGE", message)
