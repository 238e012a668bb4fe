"""Accuracy budgets for robot arms.

From a URDF and a sheet of error sources to the probability distribution of the end-effector's pose error, after Wei,
Jia and Chen (MATEC Web of Conferences 35, 02013, 2015). Names are imported when first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from precision_pin import mcpc as mcpc
    from precision_pin import sources as sources
    from precision_pin.analyses.budget import budget as budget
    from precision_pin.analyses.exact_law import exact_law as exact_law
    from precision_pin.analyses.moments import moments as moments
    from precision_pin.analyses.reliability import reliability as reliability
    from precision_pin.analyses.worst_case import worst_case as worst_case
    from precision_pin.chain import Chain as Chain
    from precision_pin.chain import Posture as Posture
    from precision_pin.correlation import Correlation as Correlation
    from precision_pin.errors import InputError as InputError
    from precision_pin.errors import PrecisionPinError as PrecisionPinError
    from precision_pin.laws import Arcsine as Arcsine
    from precision_pin.laws import Circle as Circle
    from precision_pin.laws import Disc as Disc
    from precision_pin.laws import Empirical as Empirical
    from precision_pin.laws import Fixed as Fixed
    from precision_pin.laws import JointNormal as JointNormal
    from precision_pin.laws import Lognormal as Lognormal
    from precision_pin.laws import Normal as Normal
    from precision_pin.laws import Rows as Rows
    from precision_pin.laws import Triangular as Triangular
    from precision_pin.laws import TruncatedNormal as TruncatedNormal
    from precision_pin.laws import TwoPoint as TwoPoint
    from precision_pin.laws import Uniform as Uniform
    from precision_pin.model import ErrorModel as ErrorModel
    from precision_pin.poses_result import PosesResult as PosesResult
    from precision_pin.postures import Postures as Postures
    from precision_pin.progress_bar import progress as progress
    from precision_pin.result import Analysis as Analysis
    from precision_pin.run import monte_carlo as monte_carlo
    from precision_pin.run_poses import sample_poses as sample_poses
    from precision_pin.space import Draw as Draw
    from precision_pin.space import Scope as Scope
    from precision_pin.space import Space as Space
    from precision_pin.specifications import specification as specification
    from precision_pin.terms import Source as Source
    from precision_pin.terms import Term as Term

_HOMES: Final = {
    "Analysis": "result",
    "Arcsine": "laws",
    "Chain": "chain",
    "Circle": "laws",
    "Correlation": "correlation",
    "Disc": "laws",
    "Draw": "space",
    "Empirical": "laws",
    "ErrorModel": "model",
    "Fixed": "laws",
    "InputError": "errors",
    "JointNormal": "laws",
    "Lognormal": "laws",
    "Normal": "laws",
    "Posture": "chain",
    "PosesResult": "poses_result",
    "Postures": "postures",
    "PrecisionPinError": "errors",
    "Rows": "laws",
    "Scope": "space",
    "Source": "terms",
    "Space": "space",
    "Term": "terms",
    "Triangular": "laws",
    "TruncatedNormal": "laws",
    "TwoPoint": "laws",
    "Uniform": "laws",
    "budget": "analyses.budget",
    "exact_law": "analyses.exact_law",
    "moments": "analyses.moments",
    "monte_carlo": "run",
    "progress": "progress_bar",
    "reliability": "analyses.reliability",
    "sample_poses": "run_poses",
    "specification": "specifications",
    "worst_case": "analyses.worst_case",
}
_ROOMS: Final = ("mcpc", "sources")

__all__ = [*sorted(_HOMES), *_ROOMS]


def __getattr__(name: str) -> Any:
    if name in _ROOMS:
        return importlib.import_module(f"{__name__}.{name}")
    if name in _HOMES:
        return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
