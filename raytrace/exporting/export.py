"""Exports a scene to the format of another renderer, as a folder of files."""

from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from raytrace.errors import OptionError
from raytrace.exporting.common import Contents
from raytrace.exporting.differences import Differences
from raytrace.exporting.meshes import file_stem
from raytrace.output_folder import write_new_folder
from raytrace.records import Scene

RENDERERS = {"mitsuba": "Mitsuba", "pbrt": "pbrt"}


class Exported(NamedTuple):
    """A scene in the format of another renderer."""

    scene: str  # path of the scene's file in the folder
    files: Contents  # contents by path in the folder
    warnings: tuple[str, ...]  # what the other renderer cannot express, and what is written for it


def export_files(scene: Scene, to: str, approximate: bool = False, name: str | None = None) -> Exported:
    """Return the files of a scene in the format of another renderer.

    Parameters
    ----------
    scene : Scene
    to : {"mitsuba", "pbrt"}
        Mitsuba 3 (XML) or pbrt-v4.
    approximate : bool
        Replace what the other renderer cannot express by what is closest, and return a warning for each.
    name : str, optional
        Name of the scene's file and of its image, without a suffix. Default: that of the scene's file, or "scene".

    Returns
    -------
    Exported

    Raises
    ------
    OptionError
        An unknown renderer.
    SceneError
        The other renderer cannot express the scene; the message names everything that it lacks.

    Examples
    --------
    >>> import raytrace as rt
    >>> export_files(rt.load("scenes/cornell-box.json"), "mitsuba").scene
    'cornell-box.xml'
    """
    if to not in RENDERERS:
        raise OptionError(f"to: expected one of {', '.join(RENDERERS)}, got {to!r}")
    differences = Differences(scene, RENDERERS[to])
    stem = file_stem(scene.source.stem if name is None and scene.source is not None else name or "scene")
    files = import_module(f"raytrace.exporting.{to}").export(scene, stem, differences)
    return Exported(next(iter(files)), files, differences.settle(approximate))


def export_scene(
    scene: Scene, to: str, folder: Path | str, approximate: bool = False, name: str | None = None
) -> tuple[Path, tuple[str, ...]]:
    """Write a scene in the format of another renderer into a folder, completely or not at all.

    Parameters
    ----------
    scene, to, approximate, name
        As for `export_files`.
    folder : path
        Is created. If it exists, it must be empty, or hold an earlier export of the scene, which is replaced.

    Returns
    -------
    path : Path
        The scene's file.
    warnings : tuple of str
        As in `Exported`.

    Raises
    ------
    OptionError, SceneError
        As `export_files` does.
    FileError
        The folder can't be written, or holds other files.
    """
    exported = export_files(scene, to, approximate, name)
    write_new_folder(Path(folder), exported.files)
    return Path(folder) / exported.scene, exported.warnings
