"""The factory calibration of a UR robot as a built arm."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import accumulate
from typing import ClassVar, Final, final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.analyses.provenance import Provenance
from precision_pin.analyses.result import Outcome
from precision_pin.base import se3
from precision_pin.base.arguments import check_path
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError
from precision_pin.base.files import write_files
from precision_pin.base.record import Keys
from precision_pin.export.as_built import AsBuilt
from precision_pin.model.error_model import ErrorModel, displaced_arm
from precision_pin.robot.chain import Chain
from precision_pin.robot.ur_kinematics import MODELS, UrKinematics, nominal_ur, read_ur_calibration

_SAME: Final = (1e-3, 1e-3)
"""Distance (m) and angle (rad) from a model's axes within which a robot is of this model."""
_CALIBRATED: Final = (0.05, 0.05)
"""Those of a calibrated axis from its nominal one beyond which a file is not of this model."""
_CHECKED: Final = 200
"""Random poses at which the arms are compared."""
_CLEARLY: Final = 0.5
"""Fraction of the distance from a model within which another fits clearly better.

Of 16 robots measured by their maker the right model had at most 4 mm rms, the others at least 21 mm.
"""
_NOTED: Final = 1e-7
"""Difference, m, between the two ways to read a YAML's angles that triggers a warning."""


@final
@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class FactoryCalibration(Outcome):
    """A UR robot as in its factory calibration.

    Attributes:
        file, checksum: The file, and its ``hash`` or an empty text.
        kind: The model of UR, such as ``"UR5e"``.
        model: The built arm: fixed displacements at each joint and at the tip, beside the sources of the given model.
        displacements: These displacements, ``[d; δ]`` in the axes of each seat, m and rad, ``(7, 6)``; the last is the
            tip's.
        rms_position, largest_position: Distance of the tip from the nominal robot over 200 random poses, m.
    """

    schema: ClassVar[str] = "precision-pin/factory-calibration/1"
    KEYS: ClassVar[Keys] = (
        *("*head", "file", "hash=checksum", "model=kind", "displacements=by_place"),
        *("rms_position", "largest_position", "findings"),
    )

    file: str
    checksum: str
    kind: str
    model: ErrorModel
    displacements: Array
    rms_position: float
    largest_position: float

    @property
    def by_place(self) -> dict[str, Array]:
        """Displacement of each joint and of the tip, by name."""
        chain = self.model.chain
        return dict(zip((*chain.joint_names, chain.tip), self.displacements, strict=True))

    def predict(self, q: ArrayLike | Mapping[str, float] | str | None = None) -> Array:
        """Return the tip of the built arm in the base, ``(4, 4)``; ``q`` as for :meth:`ErrorModel.at`."""
        at = self.model.at(q)
        return se3.displaced(at.posture.pose, at.exact(self.model.space.mean[:, None])[:, 0])

    def to_urdf(self, path: str | os.PathLike[str]) -> None:
        """Write the built arm as a URDF, with nothing of the model but the factory calibration.

        Raises:
            OutputError: The file cannot be written.
            InputError: The robot's file has changed.
        """
        name = check_path("the path of the URDF", path)
        chain = replace(self.model.chain, obstacles=None)
        bare = displaced_arm(chain, chain.placements @ np.array([se3.displacement(one) for one in self.displacements]))
        writer = AsBuilt.prepare(bare, np.zeros(6))
        write_files({name: writer.fitted(np.zeros(bare.space.size))})

    def __repr__(self) -> str:
        return (
            f"<FactoryCalibration of {self.provenance.robot}, a {self.kind}: tip {1e3 * self.rms_position:.3g} mm rms from the "
            f"nominal robot, at most {1e3 * self.largest_position:.3g} mm>"
        )


def ur_calibration(file: str | os.PathLike[str], robot: ErrorModel | Chain) -> FactoryCalibration:
    """Return a UR robot as in its factory calibration.

    Args:
        file: ``calibration.conf`` of the controller (differences to Denavit-Hartenberg parameters), or the YAML of
            ``ur_calibration`` that the ROS driver reads. Its angles are read as by URDF readers.
        robot: The nominal arm of six joints, a UR3 to UR30, with any frames, base and tip; or a model of it.

    Raises:
        InputError: The file cannot be read or is of another robot, or the robot is not a UR.
    """
    name = check_path("the factory calibration", file)
    if not isinstance(robot, ErrorModel | Chain):
        raise InputError("the robot must be an ErrorModel or a Chain, as Chain.from_urdf returns it")
    chain = robot.chain if isinstance(robot, ErrorModel) else robot
    kind, base = _model_of(chain)
    found = read_ur_calibration(name, kind)
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (_CHECKED, 6))
    if found.is_whole:
        _refuse_other_model(name, kind, found, q)
    placements = _placements(chain, kind, base, found, name)
    model = displaced_arm(chain, placements, robot if isinstance(robot, ErrorModel) else None)
    moved = [se3.inverse(old) @ new for old, new in zip(chain.placements, placements, strict=True)]
    displacements = np.array([[*one[:3, 3], *se3.log_rotation(one[:3, :3])] for one in moved])
    away = _distances(found, q, kind)[0]
    return FactoryCalibration(
        provenance=Provenance.of(model, 0),
        file=os.path.basename(name),
        checksum=found.checksum,
        kind=kind,
        model=model,
        displacements=displacements,
        rms_position=float(np.sqrt(np.mean(np.square(away)))),
        largest_position=float(away.max()),
        findings=_remarks(name, kind, found, q),
    )


def _distances(found: UrKinematics, q: Array, *kinds: str) -> Array:
    """Return the distances of the flange from some models' at poses ``(P, 6)``, m, ``(kinds, P)``."""
    tip, *others = (one.pose(q)[:, :3, 3] for one in (found, *map(nominal_ur, kinds)))
    return np.asarray(np.linalg.norm(np.array(others) - tip, axis=2))


def _refuse_other_model(file: str, kind: str, found: UrKinematics, q: Array) -> None:
    sizes = np.sqrt((_distances(found, q, *MODELS) ** 2).mean(axis=1))
    rms = dict(zip(MODELS, sizes.tolist(), strict=True))
    best = min(rms, key=lambda one: rms[one])
    if rms[best] < _CLEARLY * rms[kind]:
        message = (
            f"this is the calibration of a {best}, not of a {kind}: its tip is {1e3 * rms[best]:.3g} mm rms from that of a "
            f"nominal {best} and {1e3 * rms[kind]:.3g} mm from that of a {kind}; give the URDF of a {best}, or another file"
        )
        raise InputError.of("E_DATA", message, file)


def _remarks(file: str, kind: str, found: UrKinematics, q: Array) -> tuple[Finding, ...]:
    """Return warnings of a forearm turned back, or of angles that differ between the two ways to read a YAML."""
    if found.was_folded:
        message = (
            "the forearm points back at zero, as ur_calibration before June 2024 writes some robots; read as the robot that the "
            "controller has; a ROS driver with this file is wrong by twice the forearm: extract it with a newer version"
        )
        return (Finding("warning", "W_FACTORY_FOLDED", message, file),)
    other = read_ur_calibration(file, kind, x_y_z=True)
    apart = float(np.linalg.norm(found.pose(q)[:, :3, 3] - other.pose(q)[:, :3, 3], axis=1).max())
    if apart <= _NOTED:
        return ()
    message = (
        "roll, pitch and yaw are read as URDF readers do; the tool that extracts them means turns about x, y and z in this "
        f"order, which puts the tip up to {1e3 * apart:.2g} mm elsewhere; calibration.conf of the controller has no such doubt"
    )
    return (Finding("warning", "W_FACTORY_ANGLES", message, file),)


def _seats(chain: Chain) -> Array:
    return np.array(list(accumulate(chain.placements, np.matmul, initial=np.eye(4)))[1:])


def _model_of(chain: Chain) -> tuple[str, Array]:
    if len(chain.joints) == 6 and not chain.prismatic.any():
        seats = _seats(chain)[:6]
        directions = np.einsum("kij,kj->ki", seats[:, :3, :3], chain.axes)
        best, distance = "", np.inf
        for kind in MODELS:
            frames = nominal_ur(kind).joints
            base, apart, turned = _fitted(frames[:, :3, 3], frames[:, :3, 2], seats[:, :3, 3], directions)
            if turned < _SAME[1] and apart < distance:
                best, placed, distance = kind, base, apart
        if best and distance < _SAME[0]:
            return best, placed
    raise InputError(
        f"{os.path.basename(chain.robot.file)}, {chain.base} to {chain.tip_label}, is none of {', '.join(MODELS)}: a factory "
        "calibration is that of a nominal UR robot with six joints"
    )


def _fitted(points: Array, directions: Array, places: Array, axes: Array) -> tuple[Array, float, float]:
    """Return the pose that moves lines onto others, and the largest remaining distance and angle; ``(n, 3)`` each."""
    rotation = se3.nearest_rotation(axes.T @ directions)
    across = np.eye(3) - np.einsum("ki,kj->kij", axes, axes)
    wanted = np.einsum("kij,kj->i", across, places - points @ rotation.T)
    shift = np.linalg.solve(across.sum(axis=0), wanted)
    away = np.einsum("kij,kj->ki", across, places - points @ rotation.T - shift)
    turned = np.linalg.norm(np.cross(directions @ rotation.T, axes), axis=1)
    opposite = ((directions @ rotation.T) * axes).sum(axis=1).min() < 0
    return (
        se3.pose(rotation, shift),
        float(np.linalg.norm(away, axis=1).max()),
        np.pi if opposite else float(turned.max()),
    )


def _placements(chain: Chain, kind: str, base: Array, found: UrKinematics, file: str) -> Array:
    """Return the built arm's placements: seats at their axes' points nearest to the nominal ones, turned least."""
    # only the axes and the tip at zero change poses, not where a frame lies along its axis or how it turns about it
    seats = _seats(chain)
    new = []
    for k, frame in enumerate(base @ found.joints):
        axis, centre = seats[k, :3, :3] @ chain.axes[k], seats[k, :3, 3]
        point, direction = frame[:3, 3], frame[:3, 2]
        foot = point + direction * float(direction @ (centre - point))
        sine = np.cross(axis, direction)
        size = float(np.linalg.norm(sine))
        turn = sine * (np.arctan2(size, float(axis @ direction)) / size if size > 0 else 1.0)
        away, angle = float(np.linalg.norm(foot - centre)), float(np.linalg.norm(turn))
        if away > _CALIBRATED[0] or angle > _CALIBRATED[1]:
            message = (
                f"{chain.joint_names[k]} would be {1e3 * away:.3g} mm and {angle:.3g} rad from that of a {kind}: the file is of "
                "another robot"
            )
            raise InputError.of("E_DATA", message, file)
        new.append(se3.pose(se3.exp_rotation(turn) @ seats[k, :3, :3], foot))
    new.append(base @ found.flange @ se3.inverse(base @ nominal_ur(kind).flange) @ seats[6])
    before = [np.eye(4), *new[:-1]]
    return np.array([se3.inverse(one) @ other for one, other in zip(before, new, strict=True)])
