"""Mounting of the robot and of its tool."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from precision_pin.robot.chain import Chain, Posture
from precision_pin.sources.places import deviation_terms
from precision_pin.terms import Dependence, InputError, LabelledSpace, Place, Setting, Source, Term, units


@dataclass(frozen=True, kw_only=True)
class Mounting(Source):
    """Mounting error of the robot in its cell, or of the tool on its flange: a shift and a small rotation.

    At the base the whole arm moves with its base link's frame: the displacement comes before all others, and the error
    at the tip is that of the tip in the cell. At the tool the tip moves; with ``flange`` the tool turns about that
    link's frame, so that a tilt also moves the tip by tilt × length of the tool. The displacement is ``Trans(x, y,
    z)·Exp((rx, ry, rz))`` in the axes of the mounted frame. Gravity stays fixed in base axes: a base that is not level
    is a ``levelling``, which may share the parameters. Source: Δx … Δγ of the base and of the last link in eqs 1 and 2
    of Wei, Jia and Chen (2015).

    Attributes:
        at: ``base`` (base to world) or ``tool`` (flange to tool).
        flange: Only with ``at: tool``: the URDF link that the tool is bolted to, on the path to the tip and beyond the
            last joint; the tool rotates about its frame (default: about the frame of the tip).
        x, y, z: Shift.
        rx, ry, rz: Rotation vector.

    Raises:
        InputError: ``at`` is neither, or a flange at the base or one that does not carry the tool.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> source = pp.sources.Mounting(at="base", rz=pp.Normal(1e-3))
        >>> at = pp.ErrorModel(chain, pp.Space(), [source]).at([0, 0, 0, 0])
        >>> print((1e3 * np.sqrt(np.diag(at.covariance)[:3])).round(3))
        [0.274 3.74  0.   ]
    """

    depends_on: ClassVar[Dependence] = "chain"
    deviations: ClassVar[tuple[str, ...]] = ("x", "y", "z", "rx", "ry", "rz")
    words: ClassVar[Mapping[str, str]] = {
        **{name: f"mounting of the {{at}} along {name}" for name in ("x", "y", "z")},
        **{f"r{name}": f"mounting of the {{at}} about {name}" for name in ("x", "y", "z")},
    }

    at: Literal["base", "tool"]
    flange: str | None = None
    x: Annotated[Setting, units.LENGTH] = 0.0
    y: Annotated[Setting, units.LENGTH] = 0.0
    z: Annotated[Setting, units.LENGTH] = 0.0
    rx: Annotated[Setting, units.ANGLE] = 0.0
    ry: Annotated[Setting, units.ANGLE] = 0.0
    rz: Annotated[Setting, units.ANGLE] = 0.0

    def __post_init__(self) -> None:
        if self.at not in ("base", "tool"):
            raise InputError(f"at: of mounting must be base or tool, got {self.at!r}")
        if self.at == "base" and self.flange is not None:
            raise InputError("flange: of mounting is used only with at: tool")

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Return a term for each error that is not zero."""
        return deviation_terms(self, self._place(posture.chain), space)

    def _place(self, chain: Chain) -> Place:
        if self.at == "base":
            return chain.frame_place(chain.base)
        place = chain.frame_place(self.flange or chain.tip)
        if place.link != len(chain.joints):
            last = chain.joint_names[-1]
            raise InputError(
                f"{self.label()}: {self.flange!r} is no flange of the tool: it is not beyond the last joint, {last!r}"
            )
        return place
