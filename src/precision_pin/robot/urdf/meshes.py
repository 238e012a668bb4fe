"""Location of the mesh files of a URDF, and the check that they may be opened."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import final

from precision_pin.base.input_files import is_regular, note_input
from precision_pin.base.text_escape import shown
from precision_pin.robot.urdf.findings import Findings
from precision_pin.robot.urdf.meshcontent import MESH_KINDS, read_mesh
from precision_pin.robot.urdf.meshscenes import BrokenMeshError

SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://(.*)", re.DOTALL)
LONGEST_NAME = 4096


def locate_mesh(filename: str, folder: Path, package_dirs: Sequence[Path] = ()) -> Path | None:
    """Return the path of a mesh named in a URDF, None if it is unknown.

    Parameters
    ----------
    filename
        As written: a path, ``file://…`` or ``package://NAME/…``.
    folder
        Folder of the URDF; relative paths start there. A package is searched for among ``package_dirs`` (each
        a package or a folder of packages), then in the folders above, and beside those.
    package_dirs
        Further folders.

    Returns
    -------
    Path | None
        The path (which need not exist); None for an unknown package or another scheme such as ``http``.
    """
    match = SCHEME.fullmatch(filename)
    if match is None:
        return folder / filename
    scheme, rest = match[1].lower(), match[2]
    if scheme == "file":
        return Path(rest)
    if scheme != "package":
        return None
    name, _, inside = rest.partition("/")
    if not name or name in (".", ".."):
        return None
    package = _package(name, folder, package_dirs)
    return None if package is None else package / inside


def _package(name: str, folder: Path, package_dirs: Sequence[Path]) -> Path | None:
    for directory in package_dirs:
        for candidate in (directory / name, directory):
            if candidate.name == name and candidate.is_dir():
                return candidate
    for above in (folder, *folder.parents)[:-1]:
        if above.name == name:
            return above
        if (above / name / "package.xml").is_file():
            return above / name
    return None


@final
class MeshFiles:
    """Checker of the mesh files that a URDF names, each once.

    Parameters
    ----------
    findings
        Receives ``W_MESH_PATH``, ``W_MESH_MISSING``, ``W_MESH_BAD``.
    folder
        Folder of the URDF.
    package_dirs
        Folders that contain packages.
    look_inside
        True to read the files; otherwise only their existence and kind are checked.
    """

    def __init__(self, findings: Findings, folder: Path, package_dirs: Sequence[Path], *, look_inside: bool) -> None:
        self._findings = findings
        self._folder = Path(os.path.realpath(folder))
        self._package_dirs = [Path(os.path.realpath(directory)) for directory in package_dirs]
        self._look_inside = look_inside
        self._allowed = self._allowed_folders()
        self._seen: set[str] = set()

    def check(self, filename: str, owner: str, line: int) -> None:
        """Check one mesh; any problem becomes a warning."""
        if filename in self._seen:
            return
        self._seen.add(filename)
        match = SCHEME.fullmatch(filename)
        scheme = "" if match is None else match[1].lower()
        label = f"{owner}: mesh {shown(filename)}"
        if scheme not in ("", "file", "package"):
            message = f"{label} is not a local file; it is not fetched"
            self._findings.warning("W_MESH_PATH", message, line)
            return
        if scheme == "package" and _leaves_its_package(filename):
            self._findings.warning("W_MESH_PATH", f"{label} leaves its package; it is not opened", line)
            return
        try:
            path = locate_mesh(filename, self._folder, self._package_dirs)
            if path is not None:
                note_input(path)
            if path is None:
                package = filename[len("package://") :].partition("/")[0]
                message = f"mesh package {shown(package)} is not found; give its folder (--package-dir)"
                self._findings.grouped_warning("W_MESH_MISSING", message, owner, line)
                return
            self._check_path(path, label, line, in_package=scheme == "package")
        except (OSError, ValueError) as problem:
            self._findings.warning("W_MESH_MISSING", f"{label} cannot be looked up: {problem}", line)

    def _check_path(self, path: Path, label: str, line: int, *, in_package: bool) -> None:
        if len(str(path)) > LONGEST_NAME:
            self._findings.warning("W_MESH_MISSING", f"{label} has too long a name", line)
            return
        real = Path(os.path.realpath(path))
        package = _package_root(path, self._folder, self._package_dirs) if in_package else None
        allowed = [*self._allowed, *([package] if package else [])]
        if not any(real.is_relative_to(folder) for folder in allowed):
            message = f"{label} is outside the folders of this robot; it is not opened"
            self._findings.warning("W_MESH_PATH", message, line)
            return
        try:
            status = os.stat(real)
        except (FileNotFoundError, NotADirectoryError):
            self._findings.warning("W_MESH_MISSING", f"{label} does not exist", line)
            return
        if not is_regular(status):
            self._findings.warning("W_MESH_BAD", f"{label} is not a regular file", line)
        elif real.suffix.lower() not in MESH_KINDS:
            kinds = ", ".join(sorted(MESH_KINDS))
            self._findings.warning("W_MESH_BAD", f"{label} is of an unknown kind; known: {kinds}", line)
        elif self._look_inside:
            try:
                read_mesh(real)
            except BrokenMeshError as problem:
                self._findings.warning("W_MESH_BAD", f"{label}: {problem}", line)

    def _allowed_folders(self) -> list[Path]:
        """Return the URDF's folder, the one above (``../meshes``), its ROS package, and the given ones."""
        allowed = [self._folder, *self._package_dirs]
        above = self._folder.parent
        if above != Path(above.anchor):
            allowed.append(above)
        packages = (folder for folder in self._folder.parents if (folder / "package.xml").is_file())
        package = next(packages, None)
        return allowed if package is None else [*allowed, package]


def _leaves_its_package(filename: str) -> bool:
    """Return whether a ``package://`` name leads out of its package, which need not exist."""
    depth = 0
    for part in filename[len("package://") :].split("/"):
        depth += -1 if part == ".." else part not in ("", ".")
        if depth < 1:
            return part not in ("", ".")
    return False


def _package_root(path: Path, folder: Path, package_dirs: Sequence[Path]) -> Path | None:
    """Return the package a located path was built from: the nearest folder above with a package.xml."""
    for above in path.parents:
        if (above / "package.xml").is_file() or above in package_dirs:
            return Path(os.path.realpath(above))
        if above == folder:
            return above
    return None
