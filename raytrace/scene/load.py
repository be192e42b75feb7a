"""A scene file, or a dict, to a checked ``Scene``; all that is wrong with it is told at once."""

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from raytrace.errors import FileError, SceneError
from raytrace.records import DIFFUSE, REFRACTIVE, Camera, Lights, Materials, Mesh, RawMesh, Scene, Settings
from raytrace.scene import checks, positions, rdr
from raytrace.scene.meshes import locate, read_mesh
from raytrace.scene.place import Placed, assemble, place
from raytrace.scene.problems import Problem
from raytrace.scene.text import Text, from_dict, read_file

if TYPE_CHECKING:
    from raytrace.scene.schema import SceneFile

Origins = dict[positions.Path, positions.Path]


def load(source: str | Path | dict[str, Any]) -> Scene:
    """Load and check a scene.

    Parameters
    ----------
    source : str, pathlib.Path or dict
        A scene file, or its content; mesh paths of a dict are relative to the current folder.

    Returns
    -------
    Scene

    Raises
    ------
    SceneError
        The scene or a mesh has wrong content; a line for each problem.
    FileError
        The scene can't be read; or it is right, but a mesh can't be read.

    Examples
    --------
    >>> load("nowhere/box.json")
    Traceback (most recent call last):
    raytrace.errors.FileError: nowhere/box.json: no such file; there is no folder nowhere
    """
    if isinstance(source, dict):
        path, text = None, from_dict(source)
    else:
        path = Path(source)
        text = read_file(path)
    data = text.parse()
    origins: Origins = {}
    problems: list[Problem] = []
    if rdr.is_dialect(data):
        data, origins, problems = rdr.translate(data)
    scene, found = _validate(data)
    if problems:  # the translator told already what lacks
        found = [problem for problem in found if not problem.text.startswith("missing key")]
    problems += found + checks.check(data)
    folder = path.parent if path else Path()
    if scene is None or problems:
        raise _error(text, problems + _missing_meshes(data, folder), origins)
    return _build(scene, data, path, text, origins)


def _validate(data: dict[str, Any]) -> tuple["SceneFile | None", list[Problem]]:
    # pydantic and the models take 0.1 s to import: only for those who load a scene
    from pydantic import ValidationError

    from raytrace.scene.messages import tell
    from raytrace.scene.schema import SceneFile

    try:
        return SceneFile.model_validate(data), []
    except ValidationError as error:
        return None, tell(error, data)


def _error(text: Text, problems: list[Problem], origins: Origins) -> SceneError | FileError:
    """Make one error of all problems: one of files where nothing else is wrong."""
    lines = text.tell(problems, origins)
    if all(problem.unreadable for problem in problems):
        return FileError("\n".join(lines))
    return SceneError(lines)


def _mesh_problem(index: int, error: SceneError | FileError) -> Problem:
    return Problem(("objects", index, "mesh"), str(error), unreadable=isinstance(error, FileError))


def _missing_meshes(data: dict[str, Any], folder: Path) -> list[Problem]:
    """Look whether the mesh files are there, for a scene that has other problems."""
    objects = data.get("objects")
    problems = []
    for i, entry in enumerate(objects if isinstance(objects, list) else []):
        mesh = entry.get("mesh") if isinstance(entry, dict) else None
        if isinstance(mesh, str) and mesh:
            try:
                locate(folder / mesh)
            except (SceneError, FileError) as error:
                problems.append(_mesh_problem(i, error))
    return problems


def _place_all(scene: "SceneFile", folder: Path) -> tuple[list[Placed], list[Problem]]:
    """Read each mesh file once, and put it where the objects want it."""
    rows = {name: row for row, name in enumerate(scene.materials)}
    read: dict[str, RawMesh | None] = {}
    placed, problems = [], []
    for i, entry in enumerate(scene.objects):
        try:
            if entry.mesh not in read:
                read[entry.mesh] = None  # a broken file is told once
                read[entry.mesh] = read_mesh(folder / entry.mesh)
            raw = read[entry.mesh]
            if raw is not None:
                placed.append(place(raw, entry, rows[entry.material]))
        except (SceneError, FileError) as error:
            problems.append(_mesh_problem(i, error))
        except ValueError as error:
            problems.append(Problem(("objects", i), str(error)))
    return placed, problems


def _materials(scene: "SceneFile") -> Materials:
    kinds = list(scene.materials.values())
    return Materials(
        name=tuple(scene.materials),
        kind=np.array([DIFFUSE if m.type == "diffuse" else REFRACTIVE for m in kinds], np.int8),
        albedo=np.array([m.albedo if m.type == "diffuse" else (1, 1, 1) for m in kinds], np.float64),
        ior=np.array([m.ior if m.type == "refractive" else 1 for m in kinds], np.float64),
        two_sided=np.array([m.type == "diffuse" and m.two_sided for m in kinds]),
        transparent_shadow=np.array([m.type == "refractive" and m.shadows == "transparent" for m in kinds]),
    )


def _names(scene: "SceneFile") -> tuple[str, ...]:
    """Name the objects after their files, with a number where a file is used again."""
    names: list[str] = []
    counts: dict[str, int] = {}
    for entry in scene.objects:
        name = Path(entry.mesh).name
        counts[name] = counts.get(name, 0) + 1
        names.append(name if counts[name] == 1 else f"{name} ({counts[name]})")
    return tuple(names)


def _hash(camera: Camera, max_depth: int, background: Any, *records: Materials | Lights | Mesh) -> str:
    """Hash what the light does in the scene: neither names nor how it is sampled, nor where it was loaded from."""
    digest = hashlib.sha256()
    content = {"fov": camera.fov, "max_depth": max_depth, "background": background}
    content |= {"position": camera.position, "look_at": camera.look_at, "up": camera.up}
    for record in records:
        content |= {f"{type(record).__name__}.{key}": value for key, value in record._asdict().items()}
    for key, value in content.items():
        if key not in ("Materials.name", "Mesh.object_id") and value is not None:
            array = np.ascontiguousarray(value)
            digest.update(f"{key} {array.dtype.str} {array.shape}".encode())
            digest.update(array.astype(array.dtype.newbyteorder("<"), copy=False).data)
    return digest.hexdigest()


def _build(scene: "SceneFile", data: dict[str, Any], path: Path | None, text: Text, origins: Origins) -> Scene:
    placed, problems = _place_all(scene, path.parent if path else Path())
    if problems:
        raise _error(text, problems, origins)
    mesh, mesh_warnings = assemble(placed)
    names = _names(scene)
    warnings = checks.warn(data)
    warnings += [Problem(("objects", i, "mesh"), f"{names[i]}: {what}") for i, what in mesh_warnings]
    view = scene.camera
    camera = Camera(np.array(view.position), np.array(view.look_at), np.array(view.up), view.fov)
    background = np.array(scene.background)
    materials = _materials(scene)
    lights = Lights(
        position=np.array([light.position for light in scene.lights]).reshape(-1, 3),
        flux=np.array([light.flux for light in scene.lights]).reshape(-1, 3),
    )
    render = scene.render
    return Scene(
        source=path,
        sha256=_hash(camera, render.max_depth, background, materials, lights, mesh),
        about=scene.about,
        camera=camera,
        settings=Settings(scene.film.size, render.spp, render.max_depth, render.sampler, render.precision, render.seed),
        background=background,
        materials=materials,
        lights=lights,
        mesh=mesh,
        objects=names,
        warnings=tuple(text.tell(warnings, origins)) if warnings else (),
    )
