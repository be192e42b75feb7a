"""Scenes of a mesh, a mesh file or a ``trimesh.Scene``: what these lack is added, each by itself.

- No camera: on the diagonal (1, 1, 1) of the bounding sphere, y up, with everything in view.
- No lights: the same radiance, 1, from all directions.
- No material: diffuse, albedo 0.7 on both sides.

The settings are the defaults of the format, but where a material is a metal the integrator is ``path``.
"""

import math
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from raytrace.errors import RaytraceError, SceneError, printable, shortened
from raytrace.memory import Allowance
from raytrace.records import CONDUCTOR, ROUGH_CONDUCTOR, Camera, Mesh, Scene, Settings
from raytrace.scene import positions
from raytrace.scene.files import FORMATS_WITH_MATERIALS, Reach, format_of, locate
from raytrace.scene.load import read_scene
from raytrace.scene.meshes.entries import Entry
from raytrace.scene.meshes.given import is_mesh
from raytrace.scene.meshes.trimesh_scenes import is_trimesh_scene, scene_of
from raytrace.scene.meshes.vertex_colors import has_vertex_colors
from raytrace.scene.other_camera import framed
from raytrace.scene.text import MAX_TEXT, Text, from_dict

FOV = 40.0  # degrees
MARGIN = 1.05  # of the distance at which the bounding sphere touches the edge of the image
UP = np.array([0.0, 1.0, 0.0])
GREY = "no material"
MATERIAL = {"type": "diffuse", "albedo": [0.7, 0.7, 0.7], "two_sided": True}
SKY = {"type": "environment", "radiance": [1, 1, 1]}
UNUSED_COLORS = 'vertex colours are not used; a scene shows them by a material with "albedo": {"attribute": "color"}'
ANY_CAMERA = {"position": [1, 1, 1], "look_at": [0, 0, 0], "fov": FOV}  # until the size of the mesh is known


def load_mesh(source: Any, root: Path | None, max_memory: int | None) -> Scene:
    """Return the scene of a mesh.

    Parameters
    ----------
    source : path, trimesh.Scene, object with vertices and faces, or (vertices, faces)
    root : Path or None
        A folder that may be read, beside that of a file.
    max_memory : int or None, bytes
        Memory that the process may use in total.

    Raises
    ------
    SceneError, FileError
        As ``load`` does.
    """
    names, left_out, entry = [""], list[str](), Entry()
    path = Path(source) if isinstance(source, str | os.PathLike) else None
    reach = Reach(path.parent if path else Path(), root, frozenset({path.name} if path else ()), max_memory)
    if path:
        name, own = str(path), format_of(path) in FORMATS_WITH_MATERIALS
        if own:
            entry, left_out = _view_of_file(path, max_memory)
        entry["objects"] = [{"mesh": path.name, "material": {"from": "file"} if own else GREY}]
    elif is_trimesh_scene(source):
        name = "trimesh.Scene"
        with np.errstate(all="ignore"):
            entry, names, left_out = scene_of(source, GREY)
    elif is_mesh(source):
        name = "mesh"
        entry["objects"] = [{"mesh": source, "material": GREY}]
    else:
        raise SceneError([f"scene: expected a path, a dict or a mesh, got {type(source).__name__}"])
    if any(getattr(getattr(each["mesh"], "visual", None), "defined", False) for each in entry["objects"]):
        left_out.append("the colours and materials of trimesh")
    entry["materials"] = {GREY: MATERIAL} if entry["objects"][0]["material"] == GREY else {}
    chosen = "camera" not in entry
    text = from_dict({"camera": ANY_CAMERA, "lights": [SKY]} | entry)
    scene = read_scene(_MeshText(name, text, names), path, reach)
    camera = _diagonal(scene.mesh) if chosen else _towards(scene.camera, scene.mesh)
    warnings = [f"{printable(name)}: left out: {shortened(', '.join(left_out), MAX_TEXT)}"] if left_out else []
    if path and has_vertex_colors(path):
        warnings.append(f"{printable(name)}: {UNUSED_COLORS}")
    scene = replace(scene, camera=camera, settings=_settings(scene), warnings=(*scene.warnings, *warnings))
    return framed(scene) if chosen else scene


def _view_of_file(path: Path, max_memory: int | None) -> tuple[Entry, list[str]]:
    """Return the camera and the lights of a glTF file, and what is left out of it."""
    from raytrace.scene.meshes.glb import read_json
    from raytrace.scene.meshes.glb_view import view_of
    from raytrace.scene.meshes.reading import read_bytes

    try:
        locate(path)
        document = read_json(read_bytes(path, Allowance(max_memory)))
    except (RaytraceError, ValueError, RecursionError):  # reported when its meshes are read
        return {}, []
    try:
        with np.errstate(all="ignore"):  # what is not finite is reported with its place
            return view_of(document)
    except RaytraceError:
        raise
    except (ValueError, OverflowError) as error:
        raise SceneError([f"{path}: {error}"]) from None


def _settings(scene: Scene) -> Settings:
    """Return the settings of a scene: with metals, all the light, since they would reflect other surfaces as black."""
    metals = np.isin(scene.materials.kind, (CONDUCTOR, ROUGH_CONDUCTOR)).any()
    return scene.settings._replace(integrator="path") if metals else scene.settings


class _MeshText(Text):
    """The text of such a scene, which the user has not seen: messages name the mesh instead of its place.

    Parameters
    ----------
    name : str
        Of the file, or of the object.
    text : Text
    labels : list of str
        What messages call each object.
    """

    def __init__(self, name: str, text: Text, labels: list[str]) -> None:
        super().__init__(name, text.text, in_file=False, trusted=text.trusted, meshes=text.meshes)
        self._labels = labels

    def _line(self, where: positions.Positions, offset: int, path: positions.Path, text: str) -> str:
        if path[:1] != ("objects",):
            return super()._line(where, offset, path, text)
        text = text.removeprefix(f"{Path(self.name).name}: ")
        named = text.startswith((self.name, f"memory: {self.name}"))
        label = self._labels[int(path[1])] if len(path) > 1 else ""
        parts = "" if named else self.name, label, shortened(text, MAX_TEXT)
        return printable(": ".join(part for part in parts if part))


# Cameras --------------------------------------------------------------------------------------------------------------


def _diagonal(mesh: Mesh) -> Camera:
    """Return a camera that sees a whole mesh; ``in_view`` moves it for images that are taller than wide."""
    centre, radius = _sphere(mesh)
    distance = MARGIN * radius / math.sin(math.radians(FOV / 2)) if radius > 0 else 1.0
    return Camera(centre + distance / math.sqrt(3), centre, UP, FOV, focus=distance)


def _towards(camera: Camera, mesh: Mesh) -> Camera:
    """Return a camera that looks at the point of its axis next to the centre of a mesh, if that is before it."""
    axis = camera.look_at - camera.position
    distance = float((_sphere(mesh)[0] - camera.position) @ axis)
    if not distance > 0:
        return camera
    return camera._replace(look_at=camera.position + distance * axis, focus=distance)


def _sphere(mesh: Mesh) -> tuple[Any, float]:
    """Return centre and radius of a sphere around all triangles: about the centre of their box."""
    used = np.zeros(len(mesh.vertices), np.bool_)
    used[mesh.faces.ravel()] = True
    points = mesh.vertices[used]
    centre = points.min(axis=0) / 2 + points.max(axis=0) / 2
    return centre, float(np.linalg.norm(points - centre, axis=1).max())
