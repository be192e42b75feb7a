"""Scenes of trimesh as scenes of this package. trimesh itself is not imported: what has this form is enough."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from raytrace.errors import SceneError
from raytrace.scene.meshes.entries import Entry, camera_entry, light_entry

KINDS = {"PointLight": "point", "SpotLight": "spot", "DirectionalLight": "directional"}
SQUARE = 0.05  # relative difference between the sides of pixels that counts as square; the default of trimesh has 0.046


def is_trimesh_scene(value: Any) -> bool:
    """Return whether a value has the form of a ``trimesh.Scene``."""
    return hasattr(value, "geometry") and hasattr(value, "graph")


def scene_of(source: Any, material: str) -> tuple[Entry, list[str], list[str]]:
    """Return a ``trimesh.Scene`` in the scene format.

    Parameters
    ----------
    source : trimesh.Scene
        Its camera and lights are used where they were set; trimesh makes them when they are first read.
    material : str
        Of all objects.

    Returns
    -------
    entry : dict
        Of ``objects``, and of ``camera``, ``film`` and ``lights`` those that it has.
    names : list of str
        Of the geometry of each object.
    left_out : list of str
        What it has, and is not used.

    Raises
    ------
    SceneError
        What is wrong with it.
    """
    left_out = list[str]()
    objects, names = list[Entry](), list[str]()
    for node in source.graph.nodes_geometry:
        matrix, name = source.graph[node]
        mesh = source.geometry[name]
        if not hasattr(mesh, "faces"):
            left_out.append(f"{name} (a {type(mesh).__name__})")
            continue
        objects.append({"mesh": mesh, "matrix": np.asarray(matrix, np.float64), "material": material})
        names.append(str(name))
    if not objects:
        raise SceneError(["scene: a trimesh.Scene without a mesh"])
    entry = {"objects": objects} | _camera(source, left_out)
    if lights := list(_lights(source, left_out)):
        entry["lights"] = lights
    return entry, names, left_out


def _matrix(source: Any, name: str) -> Any:
    """Return the transform of a node; the identity for one that the graph does not have."""
    return np.asarray(source.graph[name][0] if name in source.graph.nodes else np.eye(4), np.float64)


def _camera(source: Any, left_out: list[str]) -> Entry:
    camera = getattr(source, "_camera", None)  # ``camera`` would make one
    if camera is None:
        return {}
    width, height = (int(side) for side in camera.resolution)
    across, fov = (float(angle) for angle in camera.fov)
    sides = np.tan(np.radians(across) / 2) / np.tan(np.radians(fov) / 2) * height / width if height and width else 1.0
    if abs(sides - 1) > SQUARE:
        left_out.append("the horizontal field of view (pixels are square)")
    return {"camera": camera_entry(_matrix(source, camera.name), fov=fov), "film": {"size": (width, height)}}


def _lights(source: Any, left_out: list[str]) -> Iterator[Entry]:
    for light in getattr(source, "_lights", None) or ():  # ``lights`` would make some
        kind = next((KINDS[each.__name__] for each in type(light).__mro__ if each.__name__ in KINDS), None)
        if kind is None:
            left_out.append(f"a {type(light).__name__}")
            continue
        if getattr(light, "radius", None) is not None and "the radius of lights" not in left_out:
            left_out.append("the radius of lights")
        level = np.asarray(light.color, np.float64)[:3] / 255 * float(light.intensity)  # the colour is linear
        cone = (float(light.innerConeAngle), float(light.outerConeAngle)) if kind == "spot" else ()
        yield light_entry(kind, _matrix(source, light.name), level, *cone)
