"""Beam sections in a sheet: by rigidities, or by shape, dimensions and material."""

from __future__ import annotations

import dataclasses
import math
from abc import ABC
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Final, Literal

import numpy as np

from precision_pin.base import units
from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.draws.draw import Setting
from precision_pin.draws.expressions import Value
from precision_pin.draws.space import LabelledSpace
from precision_pin.terms.source import setting_text


@dataclass(frozen=True)
class Material:
    """Isotropic material: moduli E and G (Pa), density (kg/m³), and the reference for the numbers."""

    E: float
    G: float
    density: float
    source: str


MATERIALS: Final[Mapping[str, Material]] = {
    "steel": Material(210e9, 81e9, 7850.0, "EN 1993-1-1, 3.2.6; EN 1991-1-1, table A.4"),
    "stainless_steel": Material(200e9, 77e9, 7900.0, "EN 1993-1-4, 2.1.3 (G from a Poisson's ratio of 0.3); 1.4301"),
    "aluminium": Material(70e9, 27e9, 2700.0, "EN 1999-1-1, 3.2.5"),
    "titanium": Material(113.8e9, 44e9, 4430.0, "Ti-6Al-4V, annealed: ASM, Materials Properties Handbook"),
}
"""Named materials, from standards: nominal values of structural design."""


@dataclass(frozen=True)
class Section:
    """Properties of a cross-section.

    Attributes:
        area: A, m².
        I_y, I_z: Second moments of area about the beam's y and z, m⁴; z is the joint's axis.
        J: Torsion constant, m⁴.
    """

    area: Value
    I_y: Value
    I_z: Value
    J: Value


def tube(outer_diameter: Value, wall: Value) -> Section:
    """Return a round tube: ``A = π (D² - d²)/4``, ``I = π (D⁴ - d⁴)/64``, ``J = 2 I`` with ``d = D - 2 t``."""
    inner = outer_diameter - 2.0 * wall
    second_moment = (outer_diameter**4 - inner**4) * (math.pi / 64)
    return Section((outer_diameter**2 - inner**2) * (math.pi / 4), second_moment, second_moment, 2.0 * second_moment)


def rod(diameter: Value) -> Section:
    """Return a solid round: ``A = π D²/4``, ``I = π D⁴/64``, ``J = 2 I``."""
    second_moment = diameter**4 * (math.pi / 64)
    return Section(diameter**2 * (math.pi / 4), second_moment, second_moment, 2.0 * second_moment)


def box(width: Value, height: Value, wall: Value) -> Section:
    """Return a rectangular tube with one wall thickness t and sharp corners, width b along z and height h along y.

    ``A = b h - b' h'``, ``I_z = (b h³ - b' h'³)/12``, ``I_y = (h b³ - h' b'³)/12`` with ``b' = b - 2 t``, ``h' = h - 2 t``;
    ``J = 2 t (b - t)² (h - t)²/(b + h - 2 t)``, Bredt's formula for thin walls: 5 % low for a square of t = b/10,
    2.4 % at b/20.
    """
    inner_width, inner_height = width - 2.0 * wall, height - 2.0 * wall
    middle_width, middle_height = width - wall, height - wall
    return Section(
        area=width * height - inner_width * inner_height,
        I_y=(height * width**3 - inner_height * inner_width**3) * (1 / 12),
        I_z=(width * height**3 - inner_width * inner_height**3) * (1 / 12),
        J=2.0 * wall * (middle_width * middle_height) ** 2 / (middle_width + middle_height),
    )


SHAPES: Final[Mapping[str, tuple[str, ...]]] = {
    "tube": ("outer_diameter", "wall"),
    "rod": ("diameter",),
    "box": ("width", "height", "wall"),
    "general": ("area", "I_y", "I_z", "J"),
}
"""Dimensions of every section."""
# the function that computes the properties of each shape
_MAKERS: Final[dict[str, Callable[..., Section]]] = {"tube": tube, "rod": rod, "box": box, "general": Section}
DIMENSIONS: Final = tuple(dict.fromkeys(name for names in SHAPES.values() for name in names))
MATERIAL: Final = ("material", "E", "G", "poisson_ratio", "density")
RIGIDITIES: Final = ("EI", "EI_y", "EI_z", "GI", "EA")
"""Settings of a section by group, for checks: dimensions and material exclude rigidities."""
SEGMENT_STIFFNESSES: Final = "section:, EI:, EI_y: with EI_z:, GI:, EA:"
STIFFNESSES: Final = f"{SEGMENT_STIFFNESSES}, bending_stiffness:, torsion_stiffness:, axial_stiffness:, segments:"
"""Settings that give a segment, or a beam, its stiffness, for messages."""
LENGTHS_AGREE: Final = 1e-6
"""Largest difference between a link's length and the sum of its segments, relative to the length: rounding of drawings."""


@dataclass(frozen=True, kw_only=True)
class Profile(ABC):  # noqa: B024 - nothing to override: the settings that beams and segments share
    """Section of a beam, by material and dimensions or by rigidities. Every value may be random.

    See ``beam`` for the settings.
    """

    section: Literal["tube", "rod", "box", "general"] | None = None
    material: str | None = None
    E: Annotated[Setting | None, units.PRESSURE] = None
    G: Annotated[Setting | None, units.PRESSURE] = None
    poisson_ratio: Annotated[float | None, units.RATIO] = None
    density: Annotated[Setting | None, units.DENSITY] = None
    outer_diameter: Annotated[Setting | None, units.LENGTH] = None
    diameter: Annotated[Setting | None, units.LENGTH] = None
    width: Annotated[Setting | None, units.LENGTH] = None
    height: Annotated[Setting | None, units.LENGTH] = None
    wall: Annotated[Setting | None, units.LENGTH] = None
    area: Annotated[Setting | None, units.AREA] = None
    I_y: Annotated[Setting | None, units.SECOND_MOMENT] = None
    I_z: Annotated[Setting | None, units.SECOND_MOMENT] = None
    J: Annotated[Setting | None, units.SECOND_MOMENT] = None
    EI: Annotated[Setting | None, units.BENDING_RIGIDITY] = None
    EI_y: Annotated[Setting | None, units.BENDING_RIGIDITY] = None
    EI_z: Annotated[Setting | None, units.BENDING_RIGIDITY] = None
    GI: Annotated[Setting | None, units.BENDING_RIGIDITY] = None
    EA: Annotated[Setting | None, units.AXIAL_RIGIDITY] = None

    def given(self, *names: str) -> tuple[str, ...]:
        """Return the names of settings that have a value."""
        return tuple(name for name in names if getattr(self, name) is not None)


@dataclass(frozen=True, kw_only=True)
class Segment(Profile):
    """Part of a beam with its own section.

    Attributes:
        length, fraction: Its length, absolute or relative to the link. One segment may have neither: it extends over the
            remaining length.
    """

    length: Annotated[float | None, units.LENGTH] = None
    fraction: Annotated[float | None, units.RATIO] = None

    def __post_init__(self) -> None:
        if self.length is not None and self.fraction is not None:
            raise InputError("a segment needs one of length: and fraction:")
        for name in self.given("length", "fraction"):
            if not getattr(self, name) > 0:
                raise InputError(f"the {name} of a segment must be positive, got {setting_text(self, name)}")


@dataclass(frozen=True)
class Stretch:
    """A part of a beam with one section.

    Attributes:
        profile: Its settings, including those from the beam.
        prefix: Prefix of the names of its settings.
        shared: Settings that come from the beam.
    """

    profile: Profile
    prefix: str = ""
    shared: tuple[str, ...] = ()

    def check(self, *, may_be_rigid: bool = False, weighs: bool = False) -> None:
        """Check that the settings are complete and consistent.

        Args:
            may_be_rigid: True if it may have no stiffness.
            weighs: True if the section gives the weight.

        Raises:
            InputError: Names the invalid settings.
        """
        profile, where = self.profile, self.prefix.rstrip(".") or "beam"
        for name in profile.given("E", "G", "density", *DIMENSIONS, *RIGIDITIES):
            value = getattr(profile, name)
            if isinstance(value, float | int) and not 0 < value < math.inf:
                raise InputError(f"{name} of a {where} must be positive, got {setting_text(profile, name)}")
        if profile.section is not None:
            self._check_section(where)
        elif not profile.given(*RIGIDITIES) and not may_be_rigid:
            raise InputError(f"{where} needs a stiffness: {STIFFNESSES if where == 'beam' else SEGMENT_STIFFNESSES}")
        else:
            self._check_rigidities(where)
        if weighs and (profile.section is None or not profile.given("material", "density")):
            raise InputError(f"{where}: self_weight: section needs section: with density: or material:")
        if profile.density is not None and not weighs:
            raise InputError(f"{where}: density: is used only with self_weight: section")

    def rigidities(self, space: LabelledSpace) -> dict[str, Value]:
        """Return the rigidities by name; missing ones are infinite.

        Raises:
            InputError: A setting can become zero or negative in some sample, or a wall thicker than half its section.
        """
        read = self._reader(space)
        if self.profile.section is None:
            return {name: read(name) for name in self.profile.given(*RIGIDITIES)}
        shape = self._shape(space, read)
        modulus, shear = self._moduli(read)
        others = {"GI": shear * shape.J, "EA": modulus * shape.area}
        if shape.I_y == shape.I_z:
            return {"EI": modulus * shape.I_y} | others
        return {"EI_y": modulus * shape.I_y, "EI_z": modulus * shape.I_z} | others

    def mass_per_length(self, space: LabelledSpace) -> Value:
        """Return density × area, kg/m."""
        read = self._reader(space)
        density = read("density") if self.profile.given("density") else MATERIALS[self.profile.material or ""].density
        return density * self._shape(space, read).area

    def _reader(self, space: LabelledSpace) -> Callable[[str], Value]:
        def read(name: str) -> Value:
            field = name if name in self.shared else self.prefix + name
            return space.positive(field, getattr(self.profile, name))

        return read

    def _shape(self, space: LabelledSpace, read: Callable[[str], Value]) -> Section:
        assert self.profile.section is not None
        dimensions = {name: read(name) for name in SHAPES[self.profile.section]}
        wall = dimensions.get("wall")
        if wall is not None:
            for name in ("outer_diameter", "width", "height"):
                if name in dimensions and 2 * space.interval(wall)[1] > space.interval(dimensions[name])[0]:
                    raise InputError(
                        f"{self.prefix}wall of {space.label} can become thicker than half its {name}; "
                        "narrow or truncate their laws"
                    )
        return _MAKERS[self.profile.section](**dimensions)

    def _moduli(self, read: Callable[[str], Value]) -> tuple[Value, Value]:
        profile = self.profile
        material = MATERIALS.get(profile.material or "")
        modulus = read("E") if profile.E is not None or material is None else material.E
        if profile.poisson_ratio is not None:
            return modulus, modulus * (0.5 / (1 + profile.poisson_ratio))
        return modulus, read("G") if profile.G is not None or material is None else material.G

    def _check_rigidities(self, where: str) -> None:
        profile = self.profile
        unused = [name for name in profile.given(*DIMENSIONS, *MATERIAL) if name not in self.shared]
        if unused:
            raise InputError(f"{where}: {', '.join(unused)} need section:, one of {', '.join(SHAPES)}")
        if profile.EI is not None and profile.given("EI_y", "EI_z"):
            raise InputError(f"{where} needs one of EI: and EI_y: with EI_z:")
        if len(profile.given("EI_y", "EI_z")) == 1:
            raise InputError(f"{where} needs both of EI_y: and EI_z:")

    def _check_section(self, where: str) -> None:
        profile = self.profile
        if profile.section is None or profile.section not in SHAPES:
            raise UnknownNameError("section", str(profile.section), SHAPES)
        if profile.material is not None and profile.material not in MATERIALS:
            raise UnknownNameError("material", profile.material, MATERIALS)
        if profile.given(*RIGIDITIES):
            raise InputError(f"{where} needs either section: or rigidities, not {profile.given(*RIGIDITIES)[0]}: too")
        needed = SHAPES[profile.section]
        missing = [name for name in needed if name not in profile.given(*needed)]
        extra = [name for name in profile.given(*DIMENSIONS) if name not in needed]
        if missing or extra:
            what = f"lacks {', '.join(missing)}" if missing else f"has no {', '.join(extra)}"
            raise InputError(f"{where}: the section {profile.section} {what}; it needs {', '.join(needed)}")
        if profile.G is not None and profile.poisson_ratio is not None:
            raise InputError(f"{where} needs one of G: and poisson_ratio:")
        if profile.poisson_ratio is not None and not -1 < profile.poisson_ratio <= 0.5:
            raise InputError(
                f"the poisson_ratio of a {where} must lie above -1, up to 0.5, got {profile.poisson_ratio}"
            )
        if profile.material is None and (profile.E is None or not profile.given("G", "poisson_ratio")):
            raise InputError(
                f"{where}: a section needs material:, one of {', '.join(MATERIALS)}, or E: with G: or poisson_ratio:"
            )


def stretches(beam: Profile, segments: tuple[Segment, ...]) -> tuple[Stretch, ...]:
    """Return the parts of a beam: the beam itself, or its segments with the settings they take from it.

    A segment without a material (or any of its constants) takes the beam's; a segment without section and rigidities
    takes the beam's section. Raises InputError if the beam has dimensions or rigidities in addition to segments.
    """
    if not segments:
        return (Stretch(beam),)
    outside = beam.given(*DIMENSIONS, *RIGIDITIES)
    if outside:
        raise InputError(f"beam has segments:, so give {', '.join(outside)} in the segments")
    result = []
    for k, segment in enumerate(segments):
        shared: list[str] = []
        if not segment.given("section", *RIGIDITIES):
            shared += beam.given("section")
        if not segment.given(*MATERIAL, *RIGIDITIES):
            shared += beam.given(*MATERIAL)
        merged = dataclasses.replace(segment, **{name: getattr(beam, name) for name in shared})
        result.append(Stretch(merged, f"segments[{k}].", tuple(shared)))
    return tuple(result)


def ends(segments: tuple[Segment, ...], length: float) -> tuple[float, ...]:
    """Return the end of each part from the start of a beam of this length, m; raise InputError if the sum differs."""
    if not segments:
        return (length,)
    parts = [segment.length or (segment.fraction or 0.0) * length for segment in segments]
    open_parts = [k for k, part in enumerate(parts) if part == 0.0]
    missing = length - math.fsum(parts)
    if len(open_parts) > 1:
        raise InputError("only one of a beam's segments may have neither length: nor fraction:")
    if open_parts and missing > LENGTHS_AGREE * length:
        parts[open_parts[0]] = missing
    elif open_parts or abs(missing) > LENGTHS_AGREE * length:
        hint = ", which leaves nothing for the one without length:" if open_parts else ""
        raise InputError(f"the beam's segments are {math.fsum(parts):.6g} m long in all, its link {length:.6g} m{hint}")
    return (*np.cumsum(parts)[:-1].tolist(), length)
