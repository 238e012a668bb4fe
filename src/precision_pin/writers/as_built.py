"""Sampled robots as URDF files: the original text with other placements.

Every displacement ``E`` of a place on chain link i is constant in the link's axes, and so is an error Δ of a joint's
value in the joint's: ``Q(q + Δ) = Exp(axis Δ)·Q(q)``. Both are folded into the ``<origin>`` of a joint, which every URDF
reader uses at every pose; ``<calibration>`` is unchanged, because readers ignore it. With ``O`` the origin, ``H`` the
frame it leads to and ``F`` the place's frame (both in the link's axes, undisplaced),

    O' = O · Π (H⁻¹ F) E (F⁻¹ H)        over the places folded into this origin, in chain order.

The displacement of a URDF link's frame is folded into the joint that leads to this link, so that the link moves; if that
joint moves on the chain, for a link's start, and for a custom place, into the next joint. The end and the seat of a link
are folded into the next joint of the chain, those of the last link into the last joint before the tip. If the base is
not the URDF's root, joints between base and root are passed backwards and ``O`` is the inverse of the origin in the
file. If the last joint of the chain moves the tip directly (or such a base), no origin is available, and a fixed frame is
added.
"""

from __future__ import annotations

import hashlib
import os
import textwrap
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base import se3
from precision_pin.base.arguments import check_instance, check_path, check_whole
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError, InternalError, UrdfError
from precision_pin.base.files import csv_text, whole_folder, write_text
from precision_pin.base.versions import versions
from precision_pin.draws.draw import Scope
from precision_pin.draws.expressions import component_names
from precision_pin.draws.space import check_seed
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.robot.chain import Chain
from precision_pin.robot.configurations import ApproachedPose
from precision_pin.robot.places import ORDER_FRAME, Place
from precision_pin.robot.urdf import Joint, Limits, Robot, parse, rpy_of
from precision_pin.robot.urdf.editing import AddedFrame, Placement, UrdfText
from precision_pin.robot.urdf.robot import to_vector
from precision_pin.robot.urdf.xmltree import Findings, read_regular_file
from precision_pin.terms.table import TableLayout
from precision_pin.terms.term import JointValue

BLOCK: Final = 1000
"""Robots displaced at a time, which bounds the memory."""
AGREEMENT: Final = 1e-9
"""Largest difference of a written robot from the exact model, above rounding: rad, and m (beyond 1 m of reach: relative)."""
WIDTH: Final = 110
"""Characters of a line of the header: within the 120 of common style rules, with the marks of a comment."""


@dataclass(frozen=True, eq=False)
class BuiltUnit:
    """A sampled robot: index, error at the export pose (``[d; δ]``, base axes, m and rad), URDF."""

    unit: int
    error: Array
    text: bytes

    @property
    def digest(self) -> str:
        """SHA-256 of the text."""
        return hashlib.sha256(self.text).hexdigest()


@dataclass(frozen=True, eq=False)
class AsBuilt:
    """Writer of robots of an error model as URDF, at an export pose.

    A written robot has the robot's errors between the links ``base`` and ``tip``: the chain's, or added frames.
    ``frozen`` are the labels of the sources whose displacements hold only at the export pose.
    """

    at: PoseModel
    original: UrdfText
    base: str
    tip: str
    frozen: tuple[str, ...]
    _folds: tuple[_Fold, ...]
    _header: tuple[str, ...]

    @classmethod
    def prepare(
        cls,
        model: ErrorModel,
        q: ArrayLike | Mapping[str, float] | ApproachedPose | str | None = None,
        *,
        sheet: str = "",
        loads: bool = True,
    ) -> AsBuilt:
        """Return the writer of a model's robots at a pose, as for `ErrorModel.configuration`; ``sheet`` names the sheet.

        Without ``loads`` the robots lack what loads cause.

        Raises `InputError` if the robot's file cannot be read, or has changed since the model was loaded.
        """
        model = model.bare
        at = model.at(q)
        if not loads:
            terms = tuple(t for source in model.bound_sources for t in source.terms(at.posture) if not t.loaded)
            at = replace(at, terms=terms, table=TableLayout.of(terms, at.space).at(at.posture, terms))
        chain = at.posture.chain
        data = _read(chain.robot.file)
        robot = parse(data, chain.robot.file)
        links = _links(robot, chain)
        names = {link.name for link in robot.links} | {joint.name for joint in robot.joints}
        folds = _folds(at, links)
        seats = {fold.step.name for fold in folds if fold.step.added}
        base, tip = (_free(f"{name}_as_built", names) if name in seats else name for name in (chain.base, chain.tip))
        frozen = frozen_sources(model, at, loads=loads)
        header = (
            f"robot: {robot.name}, from {Path(chain.robot.file).name} with SHA-256 {hashlib.sha256(data).hexdigest()}",
            *([f"sheet: {sheet}"] if sheet else []),
            *_about(at, model.pose_name(q), base, tip, frozen),
        )
        return cls(at, UrdfText.scan(data), base, tip, frozen, folds, header)

    def units(self, seed: int, first: int, count: int) -> Iterator[BuiltUnit]:
        """Yield robots in order, the robots of `monte_carlo` at one pose, with pose 0 and visit 0.

        Raises `InternalError` if a written robot, read again, disagrees with the exact model.
        """
        table = self.at.table
        for start in range(first, first + count, BLOCK):
            x = self.at.space.sample(seed, start, min(BLOCK, first + count - start))
            errors = self.at.exact(x)
            displacements = table.displacements(table.products(table.program.evaluate(x)))
            for k in range(x.shape[1]):
                text = self._written(displacements[:, :, k], f"unit {start + k} of seed {seed}")
                self._verify(text, errors[:, k])
                yield BuiltUnit(start + k, errors[:, k], text)

    def fitted(self, x: Array) -> bytes:
        """Return the text of the robot with component values ``(d,)``, such as those of a calibration."""
        table = self.at.table
        displacements = table.displacements(table.products(table.program.evaluate(x[:, None])))[:, :, 0]
        text = self._written(displacements, "calibrated")
        self._verify(text, self.at.exact(x[:, None])[:, 0])
        return text

    def _written(self, displacements: Array, unit: str) -> bytes:
        """Return the text with the targets' displacements ``(K, 6)`` in its placements."""
        placements: dict[str, Placement] = {}
        added: list[AddedFrame] = []
        for fold in self._folds:
            before, after = fold.step.written, fold.step.displaced(fold.insertion(displacements))
            xyz, rpy = to_vector(after[:3, 3]), rpy_of(after[:3, :3])
            if fold.step.added:
                name = self.base if fold.step.backwards else self.tip
                added.append(AddedFrame(name, f"{name}_joint", fold.step.name, xyz, rpy))
                continue
            shifts, turns = (not np.array_equal(after[:3, part], before[:3, part]) for part in (3, slice(0, 3)))
            placements[fold.step.name] = Placement(xyz if shifts else None, rpy if turns else None)
        version = versions()["precision-pin"]
        what = "As-built robot at the pose below and at no other" if self.frozen else "As-built robot"
        lines = (f"{what}, written by precision-pin {version}: {unit}.", *self._header)
        return self.original.edited(placements, added, [part for line in lines for part in _wrapped(line)])

    def tips(self, text: bytes, q: Array) -> tuple[list[Array], float]:
        """Return the tip of a written robot at joint values ``(n, P)``, and the largest coordinate of its links, at least 1."""
        chain, results, scale = self.at.posture.chain, [], 1.0
        robot = parse(text, chain.robot.file)
        for values in q.T:
            poses = robot.link_poses({**chain.locked, **dict(zip(chain.joint_names, values, strict=True))})
            results.append(se3.inverse(poses[self.base]) @ poses[self.tip] @ se3.translation(chain.target))
            scale = max(scale, *(float(np.abs(pose[:3, 3]).max()) for pose in poses.values()))
        return results, scale

    def _verify(self, text: bytes, error: Array) -> None:
        posture = self.at.posture
        chain = posture.chain
        (tip,), scale = self.tips(text, posture.q[:, None])
        expected = se3.displaced(posture.pose, error)
        if np.abs(tip - expected).max() > AGREEMENT * scale:
            raise InternalError(f"{chain.robot.file}: an as-built robot disagrees with the exact model")


class _Step(NamedTuple):
    """Constant factor on the path from base to tip, ``(4, 4)`` as in the file."""

    # `name` is the joint of the origin; if `added`, the link that gets a new frame; empty if the file cannot express a
    # change. `backwards`: from child to parent, so that the factor is the inverse of the origin in the file. `end` is
    # the frame it leads to, in the chain link's axes.

    name: str
    written: Array
    backwards: bool
    end: Array
    added: bool = False

    def displaced(self, insertion: Array) -> Array:
        """Return the placement to write, ``(4, 4)``, for a displacement after the factor."""
        return np.asarray(se3.inverse(insertion) @ self.written if self.backwards else self.written @ insertion)


class _Fold(NamedTuple):
    """The displacements folded into one step: rows of the term table's targets in chain order."""

    # each row has its frame relative to the step's end, `(4, 4)`, or None if they are equal

    step: _Step
    places: tuple[tuple[int, Array | None], ...]

    def insertion(self, displacements: Array) -> Array:
        """Return the product of the displacements, ``(4, 4)``, at the step's end and in its axes."""
        result = np.eye(4)
        for row, frame in self.places:
            displacement = se3.displacement(displacements[row])
            result = result @ (displacement if frame is None else frame @ displacement @ se3.inverse(frame))
        return result


def _read(file: str) -> bytes:
    findings = Findings(file)
    data = read_regular_file(file, findings, most_bytes=Limits().file_bytes)
    if data is None:
        raise UrdfError(findings.result())
    return data


def _passed_joints(robot: Robot, base: str, tip: str) -> tuple[tuple[Joint, ...], tuple[Joint, ...]]:
    """Return the joints passed from child to parent, then the joints passed from parent to child, in order."""
    up, down = robot.path(robot.root, base), robot.path(robot.root, tip)
    shared = sum(1 for first, second in zip(up, down, strict=False) if first.name == second.name)
    return up[shared:][::-1], down[shared:]


def _links(robot: Robot, chain: Chain) -> tuple[tuple[_Step, ...], ...]:
    """Return the steps of every chain link, ranked like the links on the path."""
    # a moving joint passed backwards is two steps, as in `precision_pin.robot.urdf.rerooted`: no origin of the file
    # precedes its motion, its origin follows
    links: list[list[_Step]] = [[]]
    frame = np.eye(4)
    ends: list[Array] = []
    up, down = _passed_joints(robot, chain.base, chain.tip)
    for joint, backwards in (*((joint, True) for joint in up), *((joint, False) for joint in down)):
        if not backwards:
            frame = frame @ joint.origin
            links[-1].append(_Step(joint.name, joint.origin, backwards, frame))
        elif joint.moves:
            links[-1].append(_Step("", np.eye(4), backwards, frame))
        if joint.name in chain.joint_names:
            ends.append(frame)
            links.append([])
            frame = np.eye(4)
        elif joint.moves:
            motion = joint.motion(chain.locked.get(joint.name, 0.0))
            frame = frame @ (se3.inverse(motion) if backwards else motion)
        if backwards:
            frame = frame @ se3.inverse(joint.origin)
            links[-1].append(_Step(joint.name, joint.origin, backwards, frame))
    ends.append(frame)
    placements = np.array(ends)
    if placements.shape != chain.placements.shape or not np.allclose(placements, chain.placements, rtol=0, atol=1e-12):
        raise InputError(f"{chain.robot.file} is not the robot of this model any more: its placements have changed")
    return tuple(map(tuple, links))


def _folds(at: PoseModel, links: Sequence[Sequence[_Step]]) -> tuple[_Fold, ...]:
    chain = at.posture.chain
    folds: dict[int, tuple[_Step, list[tuple[int, Array | None]]]] = {}
    base = _Step(chain.base, np.eye(4), backwards=True, end=np.eye(4), added=True)
    tip = _Step(chain.tip, np.eye(4), backwards=False, end=chain.placements[-1], added=True)
    for row, target in enumerate(at.table.targets):
        if isinstance(target, JointValue):
            # a joint commutes with an error of its value, so the frame before its motion can be used
            joint_step = links[target.joint][-1]
            step, frame = (joint_step, joint_step.end) if joint_step.name else (links[target.joint + 1][0], np.eye(4))
        else:
            step = _step_for(target, links[target.link]) or (tip if target.link else base)
            frame = target.frame
        places = folds.setdefault(id(step), (step, []))[1]
        places.append((row, None if np.array_equal(frame, step.end) else se3.inverse(step.end) @ frame))
    return tuple(_Fold(step, tuple(places)) for step, places in folds.values())


def _step_for(place: Place, steps: Sequence[_Step]) -> _Step | None:
    """Return the first step with an origin that does not precede the place, else the last one."""
    rank = max(place.order[1], 1) if place.order[0] <= ORDER_FRAME else len(steps)
    free = [(k, step) for k, step in enumerate(steps, start=1) if step.name]
    return next((step for k, step in free if k >= rank), free[-1][1] if free else None)


def frozen_sources(model: ErrorModel, at: PoseModel, *, loads: bool = True) -> tuple[str, ...]:
    """Return the labels of sources whose displacements hold only at this pose: by loads, scope or declaration."""
    scopes = {name: draw.scope for draw in model.space.draws for name in draw.components}
    labels = []
    for bound, label in zip(model.bound_sources, model.labels, strict=True):
        terms = tuple(term for term in bound.terms(at.posture) if loads or not term.loaded)
        names = {name for term in terms for factor in term.factors for name in component_names(factor)}
        by_scope = any(scopes[name] is not Scope.UNIT for name in names)
        changes = not bound.source.is_alike_everywhere(model.chain)
        if terms and (changes or by_scope or any(term.loaded for term in terms)):
            labels.append(label)
    return tuple(labels)


def _about(at: PoseModel, pose: str, base: str, tip: str, frozen: Sequence[str]) -> Iterator[str]:
    chain = at.posture.chain
    yield f"chain: {base} to {tip}"
    joints = chain.robot.path(chain.robot.root, chain.tip)
    locked = [joint for joint in joints if joint.name in chain.locked]
    if locked:
        yield f"locked on the way: {_values(locked, [chain.locked[joint.name] for joint in locked])}"
    yield f"pose{pose and ' ' + pose}: {_values(chain.joints, at.posture.q)}"
    yield (
        "The unit's errors are in the <origin> elements of the joints of the chain. At this pose the robot has all of them, "
        "those that loads cause and those drawn for each pose or visit (here pose 0, visit 0) included. At other poses it "
        "has those of the built robot that no pose changes: displaced frames and axes, joint offsets."
    )
    note = f"Fixed at their values at this pose: {', '.join(frozen)}."
    yield note if frozen else "No source was seen to depend on the pose."


def _wrapped(line: str) -> list[str]:
    return textwrap.wrap(line, WIDTH, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)


def _values(joints: Sequence[Joint], values: Sequence[float] | Array) -> str:
    return ", ".join(
        f"{joint.name} = {float(value)!r} {'m' if joint.kind == 'prismatic' else 'rad'}"
        for joint, value in zip(joints, values, strict=True)
    )


def _free(name: str, used_names: set[str]) -> str:
    while {name, f"{name}_joint"} & used_names:
        name += "_"
    return name


def describe_frozen(frozen: Sequence[str], where: str) -> list[str]:
    """Return a note about the sources, by label, that a written URDF has with their values at one pose, if any."""
    if not frozen:
        return []
    counts = Counter(label.partition("[")[0] for label in frozen)
    kinds = ", ".join(kind if count == 1 else f"{count} {kind}" for kind, count in counts.items())
    return [
        f"true at {where} only: the errors of {kinds}, which {'changes' if len(frozen) == 1 else 'change'} with load, pose "
        "or visit; readings with them at every pose: simulate"
    ]


HEAD: Final = ("unit", "file", "x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad", "sha256")
"""Columns of the table beside the robots."""
MOST_UNITS: Final = 100_000
"""Largest number of robots in a folder."""


def write_units(
    writer: AsBuilt, folder: Path, *, first: int, units: int, seed: int, progress: Callable[[int], object]
) -> list[str]:
    """Write robots and ``units.csv`` into a folder, all of them or none; return the names of the robots' files."""
    stem = Path(writer.at.posture.chain.robot.file).stem
    digits = max(4, len(str(first + units - 1)))
    names, rows = [], []
    with whole_folder(folder) as stage:
        for built in writer.units(seed, first, units):
            names.append(f"{stem}.unit{built.unit:0{digits}d}.urdf")
            (stage / names[-1]).write_bytes(built.text)
            rows.append((built.unit, names[-1], *map(repr, built.error.tolist()), built.digest))
            progress(1)
        write_text(stage / "units.csv", csv_text(HEAD, rows))
    return names


def export(
    model: ErrorModel,
    folder: str | os.PathLike[str],
    pose: ArrayLike | Mapping[str, float] | ApproachedPose | str | None = None,
    *,
    units: int = 1,
    first: int = 0,
    seed: int = 0,
) -> list[Path]:
    """Write robots as they may be built, each sampled, as URDF files, and ``units.csv`` with the error of each.

    A file holds the errors of the built robot at every pose, and all errors (loads, draws for a pose or a visit) at
    the export pose.

    Args:
        model: The arm and its errors.
        folder: Where to write; it is made if it is not there.
        pose: The export pose, by default the model's first.
        units, first, seed: Number of robots, number of the first, and the 64-bit seed: those of
            :func:`precision_pin.monte_carlo`.

    Returns:
        The files of the robots.

    Raises:
        InputError: A wrong pose or number, or a robot whose file has changed since the model was made.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> print([path.name for path in pp.export(model, "built", units=2)])
        ['4dof.unit0000.urdf', '4dof.unit0001.urdf']
    """
    check_instance("model", model, ErrorModel, "as ErrorModel.load returns it")
    check_whole("units", units, 1, MOST_UNITS)
    check_whole("first", first, 0, 2**64 - units)
    check_seed(seed)
    sheet = "" if model.sheet is None else Path(model.sheet.file).name
    if not check_path("the folder", folder):
        raise InputError("the folder has no name")
    target = Path(folder)
    writer = AsBuilt.prepare(model, pose, sheet=sheet)
    names = write_units(writer, target, first=first, units=units, seed=seed, progress=lambda _: None)
    return [target / name for name in names]
