"""Checks of mesh files before they are read: whether a scene may read them, whether they exist, and their format."""

import os
import re
from collections.abc import Iterator
from pathlib import Path, PureWindowsPath
from typing import NamedTuple

from raytrace.errors import FileError, SceneError, printable, shortened
from raytrace.files import check_regular
from raytrace.limits import MAX_MESH
from raytrace.scene.problems import no_such_file

FORMATS = ".obj", ".ply", ".stl", ".glb", ".gltf"  # read by our own readers
FORMATS_WITH_MATERIALS = ".glb", ".gltf"
OTHERS = ".off", ".3mf", ".dae", ".zae", ".xaml", ".3dxml", ".ctm", ".stp", ".step"  # read by trimesh
IMAGES = ".png", ".jpg", ".jpeg", ".exr"  # of textures
URI = re.compile(r"(?i)(file|data):|[a-z][a-z0-9+.-]+:/")  # a scheme of one letter is a drive   [RFC3986, 3.1]
ALLOW = "move it there, or allow a folder: --root DIR, in Python load(..., root=DIR)"


class Reach(NamedTuple):
    """The folders whose files a scene may read (its own, and one that the user allows), and its memory limit."""

    folder: Path  # of the scene file; for a dict the current folder
    root: Path | None = None
    trusted: frozenset[str] = frozenset()  # given as ``pathlib.Path`` by a program; a scene file cannot contain one
    max_memory: int | None = None  # bytes that the process may use in total; None: the free memory

    def find(self, mesh: str) -> Path:
        """Return the path of a mesh file; nothing outside the folders is accessed, not even to check that it exists.

        Raises
        ------
        SceneError
            The scene may not read it.
        """
        path = self.folder / mesh
        if mesh in self.trusted or "\0" in mesh:  # no file has a name with a zero byte: it is reported as missing
            return path
        return self._checked(path, mesh)

    def around(self, mesh: str) -> "Reach":
        """Return the folders for files that a mesh file names; a mesh given as a path adds its own folder.

        Parameters
        ----------
        mesh : str
            As the scene names it.
        """
        return self._replace(folder=(self.folder / mesh).parent) if mesh in self.trusted else self

    def beside(self, mesh: Path, name: str) -> Path:
        """Return the path of a file that a mesh file names relative to itself; the rules are those of ``find``."""
        return self._checked(mesh.parent / name, name)

    def _checked(self, path: Path, mesh: str) -> Path:
        name = shortened(mesh, 200)
        if URI.match(mesh):
            raise SceneError([f"{name}: a URI; name a file: nothing is downloaded"])
        # names with a drive or a share are refused on every system, not only where they lead somewhere
        if PureWindowsPath(mesh).drive or not self._holds(os.path.abspath(path)):
            raise SceneError([f"{name}: outside the scene's folder; {ALLOW}"])
        if not self._holds(real := os.path.realpath(path)):
            raise SceneError([f"{name}: a link out of the scene's folder, to {real}; {ALLOW}"])
        if "\\" in mesh and os.sep == "/" and not os.path.lexists(path):  # as Windows writes paths
            return self.find(mesh.replace("\\", "/"))
        return path

    def _holds(self, path: str) -> bool:
        return any(Path(path).is_relative_to(folder) for folder in self._folders())

    def _folders(self) -> Iterator[str]:
        for folder in (self.folder, self.root):
            if folder is not None:
                yield os.path.realpath(folder)
                yield os.path.abspath(folder)


def check_root(root: str | os.PathLike[str] | None) -> Path | None:
    """Return the folder that the user allows, if any; refuse one that does not exist."""
    if root is not None and not os.path.isdir(root):
        raise FileError(f"root: {printable(root)}: no such folder")
    return None if root is None else Path(root)


def format_of(path: Path) -> str:
    """Return the suffix that names the format, without ``.gz``."""
    return Path(path.stem if path.suffix.lower() == ".gz" else path.name).suffix.lower()


def locate(path: Path) -> None:
    """Check that a path leads to a mesh file of a known format and size, without reading it.

    Raises
    ------
    SceneError
        Its format is none of those that can be read.
    FileError
        There is no such file, or it is a directory, a pipe or a device, or too large.
    """
    check_file(path, "a mesh file")
    if format_of(path) not in FORMATS + OTHERS:
        known = ", ".join(FORMATS + OTHERS)
        scene = "; a scene cannot be a part of another" if format_of(path) == ".json" else ""
        raise SceneError([f"{path}: not a known mesh format (known: {known}, plain or with .gz){scene}"])
    if path.stat().st_size > MAX_MESH:
        raise FileError(f"{path}: more than {MAX_MESH} bytes; split it or simplify it")


def locate_image(path: Path) -> None:
    """Check that a path leads to an image file of a known format, without reading it.

    Raises
    ------
    SceneError
        Its format is none of those that can be read.
    FileError
        There is no such file, or it is a directory, a pipe or a device.
    """
    check_file(path, "an image")
    if path.suffix.lower() not in IMAGES:
        raise SceneError([f"{path}: not a known format of textures (known: {', '.join(IMAGES)})"])


def check_file(path: Path, what: str) -> None:
    """Raise a FileError for a path that leads to no regular file; what: the expected kind, such as "a mesh file"."""
    try:
        check_regular(path, what)
    except FileError:
        raise
    except (FileNotFoundError, NotADirectoryError):
        raise FileError(no_such_file(path)) from None
    except OSError as error:
        raise FileError(f"{path}: can't be read: {error.strerror or error}") from None
