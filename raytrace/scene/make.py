"""From a valid scene to arrays: its meshes read and put in place, its tables, its hash."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from raytrace.errors import FileError, FileMemoryError, SceneError
from raytrace.limits import MAX_TRIANGLES
from raytrace.memory import Allowance, Joining
from raytrace.records import Camera, RawMesh, Scene, Settings
from raytrace.scene import checks
from raytrace.scene.files import Reach
from raytrace.scene.meshes.given import MARK, read_given
from raytrace.scene.meshes.reading import read_mesh
from raytrace.scene.place import Placed, assemble, place
from raytrace.scene.positions import Origins
from raytrace.scene.problems import MOST, Problem, mesh_problem
from raytrace.scene.tables import lights_of, materials_of
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
    placed, problems, file_warnings = _place_all(scene, reach, text.meshes)
    if problems:
        raise text.error(problems, origins)
    mesh, mesh_warnings = assemble(placed)
    names = _names(scene)
    warnings = checks.warn(data)
    warnings += [Problem(("objects", i, "mesh"), f"{names[i]}: {what}") for i, what in file_warnings + mesh_warnings]
    view = scene.camera
    camera = Camera(np.array(view.position), np.array(view.look_at), np.array(view.up), view.fov)
    background = np.array(scene.background)
    materials = materials_of(scene)
    render = scene.render
    made = Scene(
        source=path,
        about=scene.about,
        camera=camera,
        settings=Settings(
            scene.film.size,
            render.spp,
            render.max_depth,
            render.sampler,
            render.precision,
            render.seed,
            render.integrator,
        ),
        background=background,
        materials=materials,
        lights=lights_of(scene),
        mesh=mesh,
        objects=names,
        warnings=(),
    )
    if made.refractive:
        from raytrace.scene.coincident import MOST, chosen_coincidences

        for found in chosen_coincidences(made)[:MOST]:
            warnings.append(Problem(("objects", found.first), found.text(names)))
    return replace(made, warnings=text.warn(warnings, origins)) if warnings else made


def _place_all(
    scene: Any, reach: Reach, given: Mapping[str, Any]
) -> tuple[list[Placed], list[Problem], list[tuple[int, str]]]:
    """Read each mesh once, and put it where the objects want it; with what the files warn of, by object."""
    rows = {name: row for row, name in enumerate(scene.materials)}
    read: dict[str, RawMesh | None] = {}
    placed, problems, notes = list[Placed](), list[Problem](), list[tuple[int, str]]()
    allowance, joining = Allowance(reach.max_memory), Joining()
    for i, entry in enumerate(scene.objects):
        if len(problems) > MOST:  # no more are reported, and each takes a look into a folder
            break
        try:
            if entry.mesh not in read:
                read[entry.mesh] = None  # a broken file is told once
                if entry.mesh in given:
                    read[entry.mesh] = read_given(given[entry.mesh])
                else:
                    read[entry.mesh] = mesh = read_mesh(reach.find(entry.mesh), allowance, reach.around(entry.mesh))
                    allowance.left -= mesh.nbytes
                    notes += [(i, text) for text in mesh.warnings]
            raw = read[entry.mesh]
            if raw is not None:
                joining = joining.with_object(len(raw.faces), len(raw.vertices), _smoothness(raw, entry))
                _afford(joining, allowance)
                placed.append(place(raw, entry, rows[entry.material]))
        except _TooLargeError as error:  # and more would not make it smaller
            return [], [*problems, mesh_problem(i, error)], []
        except (SceneError, FileError) as error:
            problems.append(mesh_problem(i, error))
        except ValueError as error:
            problems.append(Problem(("objects", i), str(error)))
    return placed, problems, notes


class _TooLargeError(FileError):
    """A scene that no cure of one mesh makes small enough."""


class _TooMuchMemoryError(_TooLargeError, FileMemoryError):
    """The same, for lack of memory."""


def _smoothness(raw: RawMesh, entry: Any) -> int:
    """0: flat; 1: the file has its normals; 2: they are averages."""
    return 0 if entry.normals == "flat" else 1 if raw.normals is not None else 2


def _afford(joining: Joining, allowance: Allowance) -> None:
    """Refuse so many triangles."""
    if joining.triangles > MAX_TRIANGLES:
        raise _TooLargeError(f"with this object there are {joining.triangles:,} triangles; at most {MAX_TRIANGLES:,}")
    if lacks := allowance.lacks(joining.total(), "simplify the meshes, or use fewer objects"):
        raise _TooMuchMemoryError(f"memory: the scene, of {joining.triangles:,} triangles with this object, {lacks}")


def _names(scene: Any) -> tuple[str, ...]:
    """Name the objects after their files, with a number where a file is used again."""
    names: list[str] = []
    counts: dict[str, int] = {}
    for entry in scene.objects:
        name = "mesh" if entry.mesh.startswith(MARK) else Path(entry.mesh).name
        counts[name] = counts.get(name, 0) + 1
        names.append(name if counts[name] == 1 else f"{name} ({counts[name]})")
    return tuple(names)
