"""Loads a scene file, a dict or a mesh as a checked ``Scene``; reports all its problems together.

NumPy is not imported before the scene is valid, so that a mistake is reported quickly.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from raytrace.errors import FileError, SceneError
from raytrace.scene import checks, positions, rdr
from raytrace.scene.check_textures import textures_in
from raytrace.scene.files import FORMATS, OTHERS, Reach, check_root, format_of, locate, locate_image
from raytrace.scene.format import read_format
from raytrace.scene.problems import MAX_PROBLEMS, Problem, file_problem, shape_problem
from raytrace.scene.sources import Source
from raytrace.scene.text import Text, from_dict, read_file

if TYPE_CHECKING:
    from raytrace.records import Scene


def load(source: Source, root: str | Path | None = None, max_memory: int | None = None) -> Scene:
    """Load and check a scene.

    Parameters
    ----------
    source : str, pathlib.Path, dict or mesh
        A scene file, or its content. Mesh paths of a dict are relative to the current folder. In a dict, a mesh may
        also be an object with ``vertices`` and ``faces``, such as a ``trimesh.Trimesh``, or a pair of such arrays.
        Or such a mesh itself, a ``trimesh.Scene``, or the path of a mesh file: what these lack is added (see Notes).
    root : str or pathlib.Path, optional
        One more folder whose files the scene may read. It may always read files below its own folder (for a dict: the
        current folder), and files that a dict names by a ``pathlib.Path``.
    max_memory : int, bytes, optional
        Memory that the process may use in total; a scene that needs more is refused. Default: the free memory.

    Returns
    -------
    Scene

    Raises
    ------
    SceneError
        The scene or a mesh has wrong content, or a mesh lies outside the allowed folders; one line per problem.
    FileError
        The scene can't be read; or it is valid, but a mesh can't be read, or the meshes need too much memory.

    Notes
    -----
    A mesh or mesh file without a camera is seen from the diagonal (1, 1, 1) of its bounding sphere, y up, with ``fov``
    40. Without lights it is in a constant environment of radiance 1. Without materials it is diffuse, albedo 0.7 on
    both sides. Cameras, lights and materials of a GLB or glTF file, and the camera and the lights that were set in a
    ``trimesh.Scene``, are used. Where such a material is a metal, the integrator is ``path``.

    Examples
    --------
    >>> load("nowhere/box.json")
    Traceback (most recent call last):
    raytrace.errors.FileError: nowhere/box.json: no such file; there is no folder nowhere

    >>> triangle = [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]
    >>> scene = load({
    ...     "camera": {"position": [0, 0, 3], "look_at": [0, 0, 0], "fov": 40},
    ...     "lights": [{"type": "point", "position": [0, 0, 3], "flux": [9, 9, 9]}],
    ...     "materials": {"white": {"type": "diffuse", "albedo": [0.7, 0.7, 0.7]}},
    ...     "objects": [{"mesh": triangle, "material": "white"}],
    ... })
    >>> len(scene.mesh.faces)
    1

    >>> scene = load(triangle)
    >>> scene.camera.look_at.tolist(), scene.camera.fov
    ([0.5, 0.5, 0.0], 40.0)
    """
    if not isinstance(source, str | os.PathLike | dict) or is_mesh_file(source):
        from raytrace.scene.mesh_scene import load_mesh

        return load_mesh(source, check_root(root), max_memory)
    if isinstance(source, dict):
        path, text = None, from_dict(source)
    else:
        path = Path(source)
        text = read_file(path)
    reach = Reach(path.parent if path else Path(), check_root(root), text.trusted, max_memory)
    return read_scene(text, path, reach)


def is_mesh_file(source: str | Path | dict[str, Any]) -> bool:
    """Return whether something to load is the path of a mesh, and no scene."""
    return not isinstance(source, dict) and format_of(Path(source)) in FORMATS + OTHERS


def read_scene(text: Text, path: Path | None, reach: Reach) -> Scene:
    """Read and check a scene.

    Parameters
    ----------
    text : Text
    path : Path or None
        Its file; None for a dict.
    reach : Reach
        The folders that may be read, and the memory that may be used.

    Raises
    ------
    SceneError, FileError
        As ``load`` does.
    """
    data = text.parse()
    origins: positions.Origins = {}
    problems: list[Problem] = []
    if rdr.is_dialect(data):
        data, origins, problems = rdr.translate(data)
        if len(problems) > MAX_PROBLEMS:  # the translation is not whole
            raise text.error(problems, origins)
    scene, found = read_format(data)
    if problems:  # the translation has already reported missing keys
        found = [problem for problem in found if not problem.text.startswith("missing key")]
    problems += found + checks.check(data)
    if scene is None or problems:
        raise text.error(problems + _missing_meshes(data, reach, text.meshes) + _missing_images(data, reach), origins)
    from raytrace.scene.assemble import assemble

    return assemble(scene, data, path, text, origins, reach)


def _missing_meshes(data: dict[str, Any], reach: Reach, given: Mapping[str, Any]) -> list[Problem]:
    """Find mesh files that do not exist, for a scene that has other problems."""
    objects = data.get("objects")
    problems = list[Problem]()
    located: set[str] = set()
    for i, entry in enumerate(objects if isinstance(objects, list) else []):
        if len(problems) > MAX_PROBLEMS:
            break
        mesh = entry.get("mesh") if isinstance(entry, dict) else None
        if isinstance(mesh, str) and mesh and mesh not in given and mesh not in located:
            located.add(mesh)
            try:
                locate(reach.find(mesh))
            except (SceneError, FileError) as error:
                problems.append(shape_problem(i, "mesh", error))
    return problems


def _missing_images(data: dict[str, Any], reach: Reach) -> list[Problem]:
    """Find images of textures that do not exist, for a scene that has other problems."""
    problems = list[Problem]()
    located: set[str] = set()
    for path, texture in textures_in(data):
        name = texture.get("image")
        if isinstance(name, str) and name and name not in located and len(problems) <= MAX_PROBLEMS:
            located.add(name)
            try:
                locate_image(reach.find(name))
            except (SceneError, FileError) as error:
                problems.append(file_problem((*path, "image"), error))
    return problems
