"""A map in the scene: a coloured mark at each place, and the bar that explains the colours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from precision_pin.analyses.map.figure import worst_said
from precision_pin.analyses.map.map_result import MapResult
from precision_pin.base.arrays import Array
from precision_pin.render.colour_scale import ColourScale
from precision_pin.render.notebook import escaped
from precision_pin.render.scene import Colour, Scene
from precision_pin.sampling.poses_result import LEVELS

_UNREACHED: Final[Colour] = (0.62, 0.62, 0.62, 1.0)
_CORNERS: Final = np.concatenate([np.eye(3), -np.eye(3)])
# an octahedron
_FACES: Final = np.array(
    [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]], dtype=np.uint32
)
# of places in m: joint values come from an iteration, so that places do not agree to the last bit
_DECIMALS: Final = 8
_OF_SPACING: Final = 0.3
# smallest and largest radius of a mark, in lengths of the arm
_RADII: Final = (0.004, 0.03)
# radius of a place that is not reached, of that of the others
_SMALLER: Final = 0.4


@final
@dataclass(frozen=True, eq=False)
class PlacesData:
    """Places of a map.

    Attributes:
        positions: m, ``(3, M)``.
        sizes: 95 % quantile of |d| in closed form, of the worst pose there, m, ``(M,)``; NaN where no joint values are
            known.
        scale: Colours of the sizes.
        worst: What was found at the worst pose, in words.
    """

    positions: Array
    sizes: Array
    scale: ColourScale
    worst: str

    @classmethod
    def of(cls, result: MapResult) -> PlacesData:
        """Return the places of a map; solutions and orientations at one place are one."""
        quantile = result.quantile[LEVELS.index(0.95), 0]
        positions, place = np.unique(result.poses.position.round(_DECIMALS), axis=1, return_inverse=True)
        worst = np.full(positions.shape[1], -np.inf)
        known = np.isfinite(quantile)
        np.maximum.at(worst, place.ravel()[known], quantile[known])
        sizes = np.where(np.isfinite(worst), worst, np.nan)
        said = worst_said(result, 0, LEVELS.index(0.95))
        return cls(positions, sizes, ColourScale.of(sizes[np.isfinite(sizes)]), said)

    @property
    def name(self) -> str:
        """Name of the layer."""
        return "map"

    def settings(self, length: float) -> dict[str, Any]:
        """Return nothing: the marks stand as they are."""
        del length
        return {}

    def draw(self, scene: Scene, length: float) -> None:
        """Add a mark at each place: one surface for each colour, so that thousands stay a page that opens quickly."""
        radius = _radius(self.positions, length)
        colours, scale = self.scale.stops, self.scale
        span = scale.largest - scale.smallest
        share = (self.sizes - scale.smallest) / span if span > 0 else np.where(np.isnan(self.sizes), np.nan, 1.0)
        known = np.isfinite(share)
        stops = np.rint(np.where(known, share, 0) * (len(colours) - 1)).astype(int)
        for stop, colour in enumerate(colours):
            chosen = known & (stops == stop)
            _draw_marks(scene, f"level{stop}", self.positions[:, chosen], radius, (*to_rgb(colour), 1.0))
        _draw_marks(scene, "unreached", self.positions[:, ~known], _SMALLER * radius, _UNREACHED)

    def legend(self) -> str:
        """Return the section of the legend: the colours, and how many places there are."""
        unreached = int(np.isnan(self.sizes).sum())
        many = "places that are" if unreached > 1 else "place that is"
        grey = f"; grey: {unreached:,} {many} not reached" if unreached else ""
        reached = len(self.sizes) - unreached
        words = f"{reached:,} place{'' if reached == 1 else 's'}, coloured by the worst pose at each{grey}"
        return (
            f'<section aria-label="Map"><h2>Map: 95 % of robots within |d|, {self.scale.unit.name}</h2>'
            f'{self.scale.bar()}<ul class="legend controls"><li><label><input type="checkbox" id="show-map" checked>'
            f'<i class="dot"></i><span>{escaped(words)}</span></label></li></ul>'
            f'<p class="fine">To first order; {escaped(self.worst)}. Places and arm are true to scale.</p></section>'
        )


def _draw_marks(scene: Scene, name: str, positions: Array, radius: float, colour: Colour) -> None:
    count = positions.shape[1]
    if count == 0:
        return
    corners = (positions.T[:, None] + radius * _CORNERS).reshape(-1, 3)
    faces: NDArray[np.uint32] = (_FACES + 6 * np.arange(count, dtype=np.uint32)[:, None, None]).reshape(-1, 3)
    scene.surface(("map", name), corners, faces, colour, np.eye(4))


def _radius(positions: Array, length: float) -> float:
    smallest, largest = (share * length for share in _RADII)
    if positions.shape[1] < 2:
        return largest
    nearest = cKDTree(positions.T).query(positions.T, k=2)[0][:, 1]
    return float(np.clip(_OF_SPACING * np.median(nearest), smallest, largest))
