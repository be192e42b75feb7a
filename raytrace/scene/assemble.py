"""Makes a scene of valid data: reads its meshes, makes its shapes, and fills its tables."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import FileError, FileMemoryError, SceneError
from raytrace.limits import MAX_TRIANGLES
from raytrace.memory import Allowance, Joining
from raytrace.records import Camera, RawMesh, Scene, Settings
from raytrace.scene import checks
from raytrace.scene.attributes import COLOR, FROM_FILE, MATERIAL, NOTHING, UV, check_attributes, needed, wanted_of
from raytrace.scene.content import Content
from raytrace.scene.files import Reach
from raytrace.scene.joining import MeshWarning, join
from raytrace.scene.meshes.given import MARK, read_given
from raytrace.scene.meshes.reading import read_mesh
from raytrace.scene.positions import Origins
from raytrace.scene.problems import MAX_PROBLEMS, Problem, file_problem, shape_problem
from raytrace.scene.shapes import make_shape, shape_of, shape_size, sphere_frequency
from raytrace.scene.tables import lights_of, materials_of
from raytrace.scene.text import Text
from raytrace.scene.transforms import PlacedMesh, place
from raytrace.scene.uv_source import UvSource, with_uv
from raytrace.texture_records import EnvironmentImage


def assemble(scene: Any, data: dict[str, Any], path: Path | None, text: Text, origins: Origins, reach: Reach) -> Scene:
    """Return the scene of valid data, with its meshes read and joined.

    Parameters
    ----------
    scene : types.SimpleNamespace
        As ``read_format`` returns it.
    data : dict
        The same as JSON types.
    path : Path or None
        Its file; None for a dict.
    text, origins
        Used to find the line and column of a problem.
    reach : Reach
        The folders that may be read, and the memory that may be used.

    Raises
    ------
    SceneError, FileError
        What is wrong with meshes.
    """
    needs = needed(data)
    shapes = ShapeReader(scene, reach, text.meshes, needs)
    shapes.place_all()
    own = shapes.file_materials
    read = _read_textures(scene, reach, own) if needs or (own and own.textured) else None
    image, image_problems = _read_environment(scene, reach)
    if problems := shapes.problems + _at_objects(read, own) + image_problems:
        raise text.error(problems, origins)
    mesh, mesh_warnings = join(shapes.placed)
    materials, textures, warnings = materials_of(scene), None, checks.warn(data)
    if read is not None:
        read = read.finished(scene.materials, materials, mesh)
        if read.problems:
            raise text.error(_at_objects(read, own), origins)
        materials, textures, warnings = read.means, read.textures, warnings + read.warnings
    names = _names(scene)
    for i, what in shapes.warnings + mesh_warnings:
        warnings.append(Problem(("objects", i, shape_of(scene.objects[i])), f"{names[i]}: {what}"))
    made = Scene(
        source=path,
        about=scene.about,
        camera=camera_of(scene.camera),
        settings=settings_of(scene.film, scene.render),
        background=np.array(scene.background),
        materials=materials,
        lights=lights_of(scene, image),
        mesh=mesh,
        objects=names,
        warnings=(),
        textures=textures,
        uv_source=UvSource(scene.objects, reach, with_uv(text.meshes)),
        content=Content(text, reach),
    )
    if made.refractive:
        from raytrace.scene.coincident import MOST_PAIRS, chosen_coincidences

        for found in chosen_coincidences(made)[:MOST_PAIRS]:
            warnings.append(Problem(("objects", found.first), found.text(names)))
    return replace(made, warnings=text.warn(warnings, origins)) if warnings else made


def camera_of(view: Any) -> Camera:
    """Camera of valid data."""
    position, look_at = np.array(view.position), np.array(view.look_at)
    focus = math.dist(look_at, position) if view.focus is None else view.focus
    height = view.height if view.type == "orthographic" else None
    return Camera(position, look_at, np.array(view.up), view.fov or 0.0, view.aperture, focus, height)


def settings_of(film: Any, render: Any) -> Settings:
    """Settings of valid data."""
    return Settings(
        film.size,
        render.spp,
        render.max_depth,
        render.sampler,
        render.precision,
        render.seed,
        render.integrator,
        film.filter,
    )


def _read_textures(scene: Any, reach: Reach, own: Any) -> Any:
    """Read the textures of a scene that has some; own: the materials of its mesh files."""
    from raytrace.scene.textures import read_textures

    used = {entry.material for entry in scene.objects}
    if own is None:
        return read_textures(scene.materials, used, reach)
    return read_textures(scene.materials, used | set(own.used()), reach, own.images)


def _at_objects(read: Any, own: Any) -> list[Problem]:
    """Return the problems of textures; those of materials of mesh files at the objects that have them."""
    problems: list[Problem] = read.problems if read else []
    return [own.at_object(problem) for problem in problems] if own else problems


def _read_environment(scene: Any, reach: Reach) -> tuple[EnvironmentImage | None, list[Problem]]:
    """Read the image of the environment of a scene that has one; or say what is wrong with it."""
    for i, light in enumerate(scene.lights):
        if light.type == "environment" and light.image is not None:
            from raytrace.scene.environment import read_environment

            try:
                return read_environment(light, reach), []
            except (SceneError, FileError, ValueError) as error:
                return None, [file_problem(("lights", i, "image"), error)]
    return None, []


class ShapeReader:
    """The shapes of a scene: each read or made once, and placed where its objects state.

    Parameters
    ----------
    scene : types.SimpleNamespace
    reach : Reach
    given : mapping
        Name -> mesh that a program gives in memory.
    needs : dict of str
        Name of a material -> attributes that it needs.
    strict : bool
        Whether it is an error if a mesh lacks one of them.
    """

    def __init__(
        self, scene: Any, reach: Reach, given: Mapping[str, Any], needs: dict[str, set[str]], *, strict: bool = True
    ) -> None:
        self.placed: list[PlacedMesh] = []
        self.problems: list[Problem] = []
        self.warnings: list[MeshWarning] = []
        self._scene, self._reach, self._given = scene, reach, given
        self._needs, self._wanted, self._strict = needs, wanted_of(scene.objects, needs), strict
        self._made: dict[Any, RawMesh | None] = {}
        self.file_materials: Any = None  # SceneFileMaterials, if any object has them
        self._allowance, self._joining = Allowance(reach.max_memory), Joining()

    def place_all(self) -> None:
        """Place all objects, or collect the problems."""
        rows = {name: row for row, name in enumerate(self._scene.materials)}
        for i, entry in enumerate(self._scene.objects):
            if len(self.problems) > MAX_PROBLEMS:  # no more are reported, and each one reads a folder
                return
            try:
                raw = self._mesh(i, entry) if entry.mesh is not None else self._shape(entry)
                if raw is not None:
                    if self._strict and (needs := self._needs.get(entry.material)):
                        check_attributes(raw, needs, _name(entry), entry.material)
                    material = rows.get(entry.material)
                    self.placed.append(
                        place(raw, entry, self._of_file(i, entry, raw) if material is None else material)
                    )
            except _TooLargeError as error:  # more objects would not make it smaller
                self.problems.append(shape_problem(i, shape_of(entry), error))
                return
            except (SceneError, FileError) as error:
                self.problems.append(shape_problem(i, shape_of(entry), error))
            except ValueError as error:
                self.problems.append(Problem(("objects", i), str(error)))

    def _mesh(self, i: int, entry: Any) -> RawMesh | None:
        """Read the mesh of an object; None if it was read before, and is broken."""
        name = entry.mesh
        wanted = self._wanted.get(name, NOTHING)
        key = name
        if entry.material == FROM_FILE:
            key, wanted = (name, FROM_FILE), frozenset({MATERIAL})
        if key not in self._made:
            self._made[key] = None  # a broken file is reported once
            if name in self._given:
                self._made[key] = read_given(self._given[name], wanted)
            else:
                mesh = read_mesh(self._reach.find(name), self._allowance, self._reach.around(name), wanted)
                self._made[key] = mesh
                self._allowance.left -= mesh.nbytes
                self.warnings += [MeshWarning(i, text) for text in mesh.warnings]
        raw = self._made[key]
        if raw is not None:
            smoothness = 0 if entry.normals == "flat" else 1 if raw.normals is not None else 2
            has = {UV: raw.uv is not None, COLOR: raw.colors is not None}
            attributes = frozenset(each for each in has if has[each])
            self._joining = self._joining.with_object(len(raw.faces), len(raw.vertices), smoothness, attributes)
            _afford(self._joining, self._allowance)
        return raw

    def _of_file(self, i: int, entry: Any, raw: RawMesh) -> NDArray[np.int32]:
        """Return the material of each triangle of a mesh that has those of its file."""
        from raytrace.scene.file_materials import SceneFileMaterials

        if self.file_materials is None:
            self.file_materials = SceneFileMaterials(self._scene.materials, self._reach.max_memory)
        rows: NDArray[np.int32] = self.file_materials.rows(i, entry.mesh, raw)
        if left_out := self.file_materials.left_out.pop(entry.mesh, ()):
            text = f"of the materials of the file, these are left out: {', '.join(left_out)}"
            self.warnings.append(MeshWarning(i, text))
        return rows

    def _shape(self, entry: Any) -> RawMesh:
        """Make the sphere, rectangle or box of an object, unless one like it was made before."""
        size = shape_size(entry)
        smoothness = 0 if entry.normals == "flat" else 1 if entry.sphere is not None else 2
        wanted = frozenset(self._needs.get(entry.material, ())) & {UV}
        self._joining = self._joining.with_object(size.triangles, size.vertices, smoothness, wanted)
        key: Any = sphere_frequency(entry.sphere.tolerance) if entry.sphere is not None else shape_of(entry)
        key = (key, wanted)
        made = self._made.get(key)
        _afford(self._joining, self._allowance, 0.0 if made else size.making(bool(wanted)))
        if made is None:
            self._made[key] = made = make_shape(entry, bool(wanted))
            self._allowance.left -= made.nbytes
        return made


class _TooLargeError(FileError):
    """The scene is too large, whatever is changed in one mesh."""


class _TooMuchMemoryError(_TooLargeError, FileMemoryError):
    """The scene needs more memory than there is."""


def _afford(joining: Joining, allowance: Allowance, making: float = 0.0) -> None:
    """Refuse a scene of so many triangles; making: bytes that a shape takes while it is made."""
    if joining.triangles > MAX_TRIANGLES:
        raise _TooLargeError(f"with this object there are {joining.triangles:,} triangles; at most {MAX_TRIANGLES:,}")
    if lacks := allowance.lacks(joining.total() + making, "simplify the meshes, or use fewer objects"):
        raise _TooMuchMemoryError(f"memory: the scene, of {joining.triangles:,} triangles with this object, {lacks}")


def _name(entry: Any) -> str:
    """Return what a message calls the shape of an object."""
    return entry.mesh.replace(MARK, "") if entry.mesh is not None else shape_of(entry)


def _names(scene: Any) -> tuple[str, ...]:
    """Return names of the objects: those of their files or shapes, with a number where one is used again."""
    names: list[str] = []
    counts: dict[str, int] = {}
    for entry in scene.objects:
        name = shape_of(entry)
        if entry.mesh is not None and not entry.mesh.startswith(MARK):
            name = Path(entry.mesh).name
        counts[name] = counts.get(name, 0) + 1
        names.append(name if counts[name] == 1 else f"{name} ({counts[name]})")
    return tuple(names)
