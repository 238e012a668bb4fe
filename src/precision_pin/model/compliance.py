"""Loads of an arm, the terms caused by loads, and the compliance of the end-effector, by source.

Public interface for analyses of stiffness, which import no source.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.model.pose_model import PoseModel
from precision_pin.robot.places import Load
from precision_pin.terms.table import TermTable
from precision_pin.terms.term import Term

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from precision_pin.model.error_model import ErrorModel
    from precision_pin.robot.chain import Posture
    from precision_pin.robot.configurations import ApproachedPose

    Pose = ArrayLike | Mapping[str, float] | ApproachedPose | str | None

ARM: Final = "arm"
"""Key of the weights of the URDF's links; no source has this label."""


def loads_of(model: ErrorModel, q: Pose = None) -> dict[str, tuple[Load, ...]]:
    """Return the loads at a pose: the weights of the URDF's links under :data:`ARM`, those of sources by label.

    Args:
        q: The pose, as for :meth:`~precision_pin.model.error_model.ErrorModel.at`.
    """
    bare = replace(model.at(q).posture, loads=model.chain.loads, tilts=())
    source_loads = {
        label: tuple(source.loads(bare)) for label, source in zip(model.labels, model.bound_sources, strict=True)
    }
    return {ARM: bare.loads, **{label: loads for label, loads in source_loads.items() if loads}}


def loaded_terms(model: ErrorModel, q: Pose = None) -> dict[str, tuple[Term, ...]]:
    """Return the terms caused by loads at a pose, by the label of the elastic source."""
    return _loaded_terms(model, model.at(q).posture)


def compliances_of(model: ErrorModel, q: Pose = None) -> dict[str, Array]:
    """Return the contribution of each elastic source to the compliance of the end-effector at a pose, by label.

    A compliance C ``(6, 6)`` gives the displacement ``[d; δ] = C [f; m]`` of the target, m and rad, by a force and a moment
    on the tip's link, acting at the target, N and N·m, all in base axes. It holds for the undeflected arm, to first
    order, with every parameter at its mean. The sum over the sources is the compliance of the arm.

    Raises:
        InputError: An invalid pose; a formula has no value at the means.
    """
    posture = model.at(q).posture
    compliances: dict[str, Array] = {}
    for column in range(6):
        for label, terms in _loaded_terms(model, _under_wrench(posture, column)).items():
            at = PoseModel(posture, model.space, TermTable.build(posture, model.space, terms), terms)
            compliances.setdefault(label, np.zeros((6, 6)))[:, column] = at.linear(model.space.mean[:, None])[:, 0]
    return compliances


def _loaded_terms(model: ErrorModel, posture: Posture) -> dict[str, tuple[Term, ...]]:
    terms_by_label = {
        label: tuple(term for term in source.terms(posture) if term.loaded)
        for label, source in zip(model.labels, model.bound_sources, strict=True)
    }
    return {label: terms for label, terms in terms_by_label.items() if terms}


def _under_wrench(posture: Posture, column: int) -> Posture:
    """Return the posture under only a unit force along base axis 0 to 2, or a unit moment about axis 3 to 5.

    Without an approach, since friction holds or stops a joint but does not give way; stiffnesses in pieces are those at the
    loads of the posture.
    """
    link, frame = len(posture.chain.joints), posture.chain.target_placement
    entry = posture.chain.placements[-1][:3, 3]
    load = Load(link, frame, entry, along=False, moments=(), wrenches=((np.eye(6)[column], ()),))
    return replace(posture, loads=(load,), tilts=(), deflection=None, approach=(), deciding=posture)
