"""Cross-sections and materials of beams: from dimensions to the constants for bending, torsion and weight.

Dimensions are numbers (m) or expressions; so are the constants. The y and z axes are those of the beam.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, final

from precision_pin.draws.expressions import Value


@final
@dataclass(frozen=True)
class Material:
    """Constants of an isotropic material.

    Attributes:
        E, G: Modulus of elasticity and shear modulus, Pa.
        density: kg/m³.
        source: Reference for the numbers.
    """

    E: float
    G: float
    density: float
    source: str


MATERIALS: Final = MappingProxyType(
    {
        "steel": Material(210e9, 81e9, 7850.0, "EN 1993-1-1, 3.2.6; EN 1991-1-1, table A.4"),
        "stainless_steel": Material(
            200e9, 77e9, 7900.0, "EN 1993-1-4, 2.1.3 (G from a Poisson's ratio of 0.3); 1.4301"
        ),
        "aluminium": Material(70e9, 27e9, 2700.0, "EN 1999-1-1, 3.2.5"),
        "titanium": Material(113.8e9, 44e9, 4430.0, "Ti-6Al-4V, annealed: ASM, Materials Properties Handbook"),
    }
)
"""Named materials."""


@final
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
    second = (outer_diameter**4 - inner**4) * (math.pi / 64)
    return Section((outer_diameter**2 - inner**2) * (math.pi / 4), second, second, 2.0 * second)


def rod(diameter: Value) -> Section:
    """Return a solid round: ``A = π D²/4``, ``I = π D⁴/64``, ``J = 2 I``."""
    second = diameter**4 * (math.pi / 64)
    return Section(diameter**2 * (math.pi / 4), second, second, 2.0 * second)


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
