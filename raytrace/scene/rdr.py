"""Translates scenes of the course dialect to the scene format.

A scene of the dialect has an ``integrator``, ``textures``, or objects with ``material_name``. Whatever the scene format
cannot express is reported by its name. The normals of the meshes (``vn``) are not used: in the shipped scenes they
agree with the winding of the triangles, half of the meshes have none, and flat shading is right for both.
"""

import contextlib
from typing import Any

from raytrace.scene.positions import Path
from raytrace.scene.problems import HINTED, MOST, Problem, listed, quote, unknown_key, unknown_name

Json = dict[str, Any]


def is_dialect(data: Json) -> bool:
    """Return whether a scene is written in the course dialect.

    Examples
    --------
    >>> is_dialect({"integrator": {}}), is_dialect({"objects": [{"mesh": "a.obj", "material": "white"}]})
    (True, False)
    """
    objects = data.get("objects")
    entries = objects if isinstance(objects, list) else []
    named = any(isinstance(entry, dict) and "material_name" in entry for entry in entries)
    return "integrator" in data or "textures" in data or named


class _EnoughError(Exception):
    """There are more problems than are reported."""


class _Translation:
    """A translation in progress: the translated scene, the origin of each of its parts, and the problems."""

    def __init__(self, data: Json) -> None:
        self.data = data
        self.scene: Json = {}
        self.origins: dict[Path, Path] = {}
        self.problems: list[Problem] = []

    def report(self, path: Path, text: str, at_key: bool = False) -> None:
        self.problems.append(Problem(path, text, at_key))
        if len(self.problems) > MOST:
            raise _EnoughError

    def section(self, path: Path, value: Any, required: tuple[str, ...], optional: tuple[str, ...] = ()) -> Json:
        """Return an object of the dialect, with its keys checked; an empty one if the value is not an object."""
        if not isinstance(value, dict):
            self.report(path, f"expected an object, got {quote(value)}")
            return {}
        for key in value:
            if key not in required + optional:
                self.report((*path, key), unknown_key(key, required + optional), at_key=True)
        for key in required:
            if key not in value:
                self.report(path, f'missing key "{key}"')
        return value

    def copy(self, source: Path, target: Path, keys: dict[str, str]) -> Json:
        """Return the given keys of an object of the dialect, renamed, and record their origins."""
        found: Any = self.data
        for step in source:
            found = found[step]
        if not isinstance(found, dict):
            return {}
        renamed = {new: found[old] for old, new in keys.items() if old in found}
        self.origins.update({(*target, new): (*source, old) for old, new in keys.items()})
        return renamed


def translate(data: Json) -> tuple[Json, dict[Path, Path], list[Problem]]:
    """Translate a scene of the course dialect.

    Parameters
    ----------
    data : dict
        The scene as JSON types.

    Returns
    -------
    scene : dict
        In the keys of the scene format; not yet validated.
    origins : dict
        Path in the translated scene -> path in the original, for the parts that moved.
    problems : list of Problem
        What the format cannot express, and missing keys, at paths of the dialect.
    """
    t = _Translation(data)
    with contextlib.suppress(_EnoughError):
        _sections(t, data)
    return t.scene, t.origins, t.problems


def _sections(t: _Translation, data: Json) -> None:
    t.section((), data, ("integrator", "camera", "materials", "objects"), ("about", "film", "textures"))
    t.scene = {"about": data["about"]} if "about" in data else {}
    if "integrator" in data:
        _integrator(t, data["integrator"])
    if "camera" in data:
        t.section(("camera",), data["camera"], ("position", "look_at", "fov"), ("ref_up", "focal_length"))
        keys = {"position": "position", "look_at": "look_at", "ref_up": "up", "fov": "fov"}
        t.scene["camera"] = t.copy(("camera",), ("camera",), keys)
    if "film" in data:
        t.section(("film",), data["film"], ("resolution",))
        t.scene["film"] = t.copy(("film",), ("film",), {"resolution": "size"})
    t.scene["materials"] = _materials(t, data.get("materials", {}), data.get("textures", {}))
    t.scene["objects"] = _objects(t, data.get("objects", []))


def _integrator(t: _Translation, integrator: Any) -> None:
    here = ("integrator",)
    kind = integrator.get("type") if isinstance(integrator, dict) else None
    if kind is not None and kind != "intersection_test":
        t.report((*here, "type"), f"integrator {quote(kind)} is not supported (supported: intersection_test)")
        return
    light = ("point_light_position", "point_light_flux")
    t.section(here, integrator, ("type", *light), ("max_depth", "spp"))
    t.scene["render"] = t.copy(here, ("render",), {"max_depth": "max_depth", "spp": "spp"})
    t.origins["lights", 0] = here
    moved = t.copy(here, ("lights", 0), {"point_light_position": "position", "point_light_flux": "flux"})
    t.scene["lights"] = [{"type": "point", **moved}]


def _materials(t: _Translation, materials: Any, textures: Any) -> Json:
    if not isinstance(materials, dict):
        t.report(("materials",), f"expected an object, got {quote(materials)}")
        return {}
    if not isinstance(textures, dict):
        t.report(("textures",), f"expected an object, got {quote(textures)}")
        textures = {}
    for name, texture in textures.items():
        kind = texture.get("type") if isinstance(texture, dict) else None
        if kind is not None and kind != "constant":
            t.report(("textures", name, "type"), f"texture {quote(kind)} is not supported (supported: constant)")
        else:
            t.section(("textures", name), texture, ("type", "color"))
    return {name: _material(t, name, entry, textures) for name, entry in materials.items()}


def _material(t: _Translation, name: str, entry: Any, textures: Json) -> Json:
    here = ("materials", name)
    kind = entry.get("type") if isinstance(entry, dict) else None
    stand_in = {"type": "diffuse", "albedo": [0, 0, 0]}  # so that one problem is not reported twice
    if kind == "diffuse":
        t.section(here, entry, ("type", "texture_name"))
        texture = entry.get("texture_name")
        if texture is not None and (not isinstance(texture, str) or texture not in textures):
            t.report((*here, "texture_name"), unknown_name("texture", texture, textures, len(t.problems) < HINTED))
        elif texture is not None:
            moved = t.copy(("textures", texture), here, {"color": "albedo"})
            return {"type": "diffuse", **moved} if moved else stand_in
    elif kind == "refraction":
        t.section(here, entry, ("type", "eta"))
        eta = entry.get("eta", 1.0)
        if type(eta) in (int, float) and 1e-300 < eta < 1e300:
            t.origins[*here, "ior"] = (*here, "eta")
            return {"type": "refractive", "ior": 1 / eta}
        t.report((*here, "eta"), f"expected a number > 0, got {quote(eta)}")
    elif kind is None:
        t.section(here, entry, ("type",), tuple(entry) if isinstance(entry, dict) else ())
    else:
        text = f"material {quote(kind)} is not supported (supported: diffuse, refraction)"
        t.report((*here, "type"), text)
    return stand_in


SHAPES = {"mesh": ("path",), "sphere": ("center", "radius")}  # type of an object -> keys that it must have


def _objects(t: _Translation, objects: Any) -> Any:
    if not isinstance(objects, list):
        return objects
    keys = {"path": "mesh", "material_name": "material", "translate": "translate", "scale": "scale"}
    translated = []
    for i, entry in enumerate(objects):
        here = ("objects", i)
        kind = entry.get("type") if isinstance(entry, dict) else None
        if kind is not None and (not isinstance(kind, str) or kind not in SHAPES):
            t.report((*here, "type"), f"object {quote(kind)} is not supported (supported: {listed(SHAPES)})")
        else:
            t.section(here, entry, ("type", *SHAPES[kind or "mesh"], "material_name"), ("translate", "scale"))
        moved = t.copy(here, here, keys)
        if kind == "sphere":
            moved.pop("mesh", None)
            t.origins[*here, "sphere"] = here
            moved["sphere"] = t.copy(here, (*here, "sphere"), {"center": "center", "radius": "radius"})
        translated.append(moved)
    return translated
