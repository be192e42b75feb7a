"""``save``: writes a loaded scene as a scene file, with the meshes and images that it needs."""

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from raytrace.errors import FileError, SceneError, printable
from raytrace.files import open_regular, write_whole
from raytrace.scene.attributes import NOTHING, UV, needed, wanted_of
from raytrace.scene.check_textures import textures_in
from raytrace.scene.content import Content, content_of, data_of, same
from raytrace.scene.files import format_of
from raytrace.scene.meshes.given import read_given
from raytrace.scene.meshes.ply_writing import ply_bytes

if TYPE_CHECKING:
    from raytrace.records import RawMesh, Scene

WIDTH = 110  # characters of a line
PARTS = "settings", "background", "materials", "lights", "mesh", "textures"


def save(scene: "Scene", path: str | Path) -> Path:
    """Write a scene as a scene file, from which ``load`` makes the same scene: the same hash and the same images.

    Parameters
    ----------
    scene : Scene
        A loaded scene, or one from ``Scene.replace``; also with another camera or other settings.
    path : str or Path
        The file, ``.json``. An existing one is replaced.

    Returns
    -------
    Path

    Raises
    ------
    SceneError
        The scene has no form as a file: a program made its records, or changed them by ``dataclasses.replace``; or one
        of its mesh files has changed since it was loaded.
    FileError
        A file can't be read or written; the folder does not exist.

    Notes
    -----
    Meshes and images that lie in the folder of the new file, or below it, are named by their relative path. All others
    are written into a folder beside it, ``<name>-files``, meshes in memory as PLY files of float64: a scene may read
    files only from its own folder. Comments of the original file are lost. The scene is read again and compared before
    anything is written, so this takes as long as ``load``.

    Examples
    --------
    >>> import raytrace as rt
    >>> scene = rt.load("scenes/cornell-box.json").replace({"camera.fov": 30})
    >>> rt.save(scene, "box-30.json")  # doctest: +SKIP
    PosixPath('box-30.json')
    """
    path = Path(path)
    if path.suffix.lower() != ".json":
        raise FileError(f"{printable(path)}: a scene file ends in .json")
    if not path.parent.is_dir():
        raise FileError(f"{printable(path)}: there is no folder {printable(path.parent)}")
    content, data = content_of(scene), data_of(scene)
    _check_same(scene, content, data)
    files = _Files(content, path, _wanted(data))
    for entry in data["objects"]:
        if "mesh" in entry:
            entry["mesh"] = files.mesh(entry["mesh"])
    for _path, texture in textures_in(data):  # and environments
        if "image" in texture:
            texture["image"] = files.name(texture["image"])
    data.pop("$schema", None)  # its path is relative to the original file
    files.write()
    write_whole(path, (layout(data) + "\n").encode())
    return path


def _check_same(scene: "Scene", content: Content, data: dict[str, Any]) -> None:
    """Refuse a scene that is not what its files and its text say."""
    from raytrace.scene.load import read_scene
    from raytrace.scene.text import Text

    text = Text(printable(scene.source or "scene"), json.dumps(data), False, content.text.trusted, content.text.meshes)
    again = read_scene(text, scene.source, content.reach)
    different = [name for name in PARTS if not same(getattr(again, name), getattr(scene, name))]
    if different or again.sha256 != scene.sha256:
        cause = "a file has changed since the scene was loaded, or dataclasses.replace changed it"
        cure = "load it again, and use scene.replace, whose changes can be saved"
        raise SceneError([f"save: {', '.join(different) or 'camera'}: not as in the scene's files: {cause}; {cure}"])


def _wanted(data: dict[str, Any]) -> dict[str, frozenset[str]]:
    """Return which attributes of meshes the materials need."""
    from raytrace.scene.format import read_format

    read: Any = read_format(data).scene
    return wanted_of(read.objects, needed(data))


class _Files:
    """The meshes and images of a scene, and their names in a new file.

    Parameters
    ----------
    content : Content
    path : Path
        The new scene file.
    wanted : dict of str
        Name of a mesh -> attributes that are needed.
    """

    def __init__(self, content: Content, path: Path, wanted: dict[str, frozenset[str]]) -> None:
        self._text, self._reach, self._wanted = content.text, content.reach, wanted
        self._folder, self._beside = path.parent, f"{path.stem}-files"
        self._names: dict[str, str] = {}  # name in the scene -> name in the new file
        self._contents: dict[str, bytes] = {}  # of files to write

    def mesh(self, name: str) -> str:
        """Return the new name of a mesh."""
        if name not in self._text.meshes:
            return self.name(name)
        if name not in self._names:
            raw = _read_given(self._text.meshes[name], self._wanted.get(name, NOTHING))
            self._names[name] = self._add("mesh.ply", ply_bytes(raw))
        return self._names[name]

    def name(self, name: str) -> str:
        """Return the new name of a file."""
        if name not in self._names:
            self._names[name] = self._relative(self._reach.find(name)) or self._copy(self._reach.find(name))
        return self._names[name]

    def _relative(self, file: Path) -> str:
        """Return the path of a file below the folder of the scene, with slashes; "" where it lies elsewhere."""
        folder, real = os.path.realpath(self._folder), os.path.realpath(file)
        return Path(real).relative_to(folder).as_posix() if Path(real).is_relative_to(folder) else ""

    def _copy(self, file: Path) -> str:
        """Take a file along; return its new name."""
        if format_of(file) == ".gltf":
            cure = f"save the scene in {printable(file.parent)}, or convert the mesh to .glb"
            raise SceneError([f"save: {printable(file)}: lies elsewhere, and may name other files; {cure}"])
        try:
            with open_regular(file) as stream:
                return self._add(file.name, stream.read())
        except FileError:
            raise
        except OSError as error:
            raise FileError(f"{printable(file)}: can't be read: {error.strerror or error}") from None

    def _add(self, name: str, content: bytes) -> str:
        """Note a file to write, under a name that no other one has."""
        stem, dot, rest = name.partition(".")
        number = 2
        while (free := f"{self._beside}/{name}") in self._contents and self._contents[free] != content:
            name = f"{stem}-{number}{dot}{rest}"
            number += 1
        self._contents[free] = content
        return free

    def write(self) -> None:
        """Write the files."""
        if not self._contents:
            return
        folder = self._folder / self._beside
        try:
            folder.mkdir(exist_ok=True)
        except OSError as error:
            raise FileError(f"{printable(folder)}: can't be made: {error.strerror or error}") from None
        for name, content in self._contents.items():
            write_whole(self._folder / name, content)


def _read_given(mesh: Any, wanted: frozenset[str]) -> "RawMesh":
    """Return a mesh in memory; also with uv that no material needs, for the layer, where they are valid."""
    try:
        return read_given(mesh, wanted | {UV})
    except SceneError:
        return read_given(mesh, wanted)


def layout(value: Any, indent: str = "") -> str:
    """Return JSON text whose short parts stand on one line each.

    Examples
    --------
    >>> print(layout({"camera": {"fov": 30}, "lights": []}))
    {
      "camera": {"fov": 30},
      "lights": []
    }
    """
    line = json.dumps(value, ensure_ascii=False)
    if not isinstance(value, dict | list) or not value or (indent and len(indent) + len(line) <= WIDTH):
        return line
    inner = indent + "  "
    if isinstance(value, dict):
        rows = [f"{json.dumps(key, ensure_ascii=False)}: {layout(part, inner)}" for key, part in value.items()]
    else:
        rows = [layout(part, inner) for part in value]
    brackets = "{}" if isinstance(value, dict) else "[]"
    return brackets[0] + "\n" + ",\n".join(inner + row for row in rows) + "\n" + indent + brackets[1]
