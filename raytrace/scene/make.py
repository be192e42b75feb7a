"""From a valid scene to arrays: its meshes read and put in place, its tables, its hash."""

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from raytrace.errors import FileError, SceneError
from raytrace.limits import MAX_TRIANGLES
from raytrace.memory import Allowance, Joining
from raytrace.records import DIFFUSE, REFRACTIVE, Camera, Lights, Materials, Mesh, RawMesh, Scene, Settings
from raytrace.scene import checks
from raytrace.scene.files import Reach
from raytrace.scene.meshes import read_mesh
from raytrace.scene.place import Placed, assemble, place
from raytrace.scene.positions import Origins
from raytrace.scene.problems import MOST, Problem, mesh_problem
from raytrace.scene.text import Text


def make_scene(
    scene: Any, data: dict[str, Any], path: Path | None, text: Text, origins: Origins, reach: Reach
) -> Scene:
    """Read the meshes of a valid scene, and put them together.

    Parameters
    ----------
    scene : SceneFile, or what has its attributes
    data : dict
        The same as JSON types.
    path : Path or None
        Its file; None: it is a dict.
    text, origins
        Where problems lie.
    reach : Reach
        Where its meshes may lie.

    Raises
    ------
    SceneError, FileError
        What is wrong with meshes.
    """
    placed, problems = _place_all(scene, reach)
    if problems:
        raise text.error(problems, origins)
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
        warnings=text.warn(warnings, origins),
    )


def fingerprint(scene: Scene) -> str:
    """The hash that a scene has, or should have: of what the light does in it."""
    return _hash(scene.camera, scene.settings.max_depth, scene.background, scene.materials, scene.lights, scene.mesh)


def _place_all(scene: Any, reach: Reach) -> tuple[list[Placed], list[Problem]]:
    """Read each mesh file once, and put it where the objects want it."""
    rows = {name: row for row, name in enumerate(scene.materials)}
    read: dict[str, RawMesh | None] = {}
    placed, problems = list[Placed](), list[Problem]()
    allowance, joining = Allowance(reach.max_memory), Joining()
    for i, entry in enumerate(scene.objects):
        if len(problems) > MOST:  # no more are reported, and each takes a look into a folder
            break
        try:
            if entry.mesh not in read:
                read[entry.mesh] = None  # a broken file is told once
                read[entry.mesh] = mesh = read_mesh(reach.find(entry.mesh), allowance)
                allowance.left -= sum(array.nbytes for array in mesh if array is not None)
            raw = read[entry.mesh]
            if raw is not None:
                joining = joining.with_object(len(raw.faces), len(raw.vertices), _smoothness(raw, entry))
                _afford(joining, allowance)
                placed.append(place(raw, entry, rows[entry.material]))
        except _TooLargeError as error:  # and more would not make it smaller
            return [], [*problems, Problem(("objects", i, "mesh"), str(error), unreadable=True)]
        except (SceneError, FileError) as error:
            problems.append(mesh_problem(i, error))
        except ValueError as error:
            problems.append(Problem(("objects", i), str(error)))
    return placed, problems


class _TooLargeError(FileError):
    """A scene that no cure of one mesh makes small enough."""


def _smoothness(raw: RawMesh, entry: Any) -> int:
    """0: flat; 1: the file has its normals; 2: they are averages."""
    return 0 if entry.normals == "flat" else 1 if raw.normals is not None else 2


def _afford(joining: Joining, allowance: Allowance) -> None:
    """Refuse so many triangles."""
    if joining.triangles > MAX_TRIANGLES:
        raise _TooLargeError(f"with this object there are {joining.triangles:,} triangles; at most {MAX_TRIANGLES:,}")
    if lacks := allowance.lacks(joining.total(), "simplify the meshes, or use fewer objects"):
        raise _TooLargeError(f"the scene, of {joining.triangles:,} triangles with this object, {lacks}")


def _materials(scene: Any) -> Materials:
    kinds = list(scene.materials.values())
    return Materials(
        name=tuple(scene.materials),
        kind=np.array([DIFFUSE if m.type == "diffuse" else REFRACTIVE for m in kinds], np.int8),
        albedo=np.array([m.albedo if m.type == "diffuse" else (1, 1, 1) for m in kinds], np.float64),
        ior=np.array([m.ior if m.type == "refractive" else 1 for m in kinds], np.float64),
        two_sided=np.array([m.type == "diffuse" and m.two_sided for m in kinds]),
        transparent_shadow=np.array([m.type == "refractive" and m.shadows == "transparent" for m in kinds]),
    )


def _names(scene: Any) -> tuple[str, ...]:
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
