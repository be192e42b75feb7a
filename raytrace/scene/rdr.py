"""Translates scenes of the course dialect to the scene format.

A scene of the dialect has an ``integrator``, ``textures``, or objects with ``material_name`` or ``light``. What the
scene format cannot express is reported by its name. The normals of the meshes (``vn``) are not used: in the shipped
scenes they agree with the winding of the triangles, half of the meshes have none, and flat shading is right for both.
Spheres have their exact normals.
"""

import contextlib
from typing import Any

from raytrace.scene.positions import Path
from raytrace.scene.problems import HINTED, MAX_PROBLEMS, Problem, listed, quote, unknown_key, unknown_name

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
    named = any(isinstance(entry, dict) and {"material_name", "light"} & entry.keys() for entry in entries)
    return "integrator" in data or "textures" in data or named


class _EnoughError(Exception):
    """There are more problems than are reported."""


class Translation:
    """A translation in progress: the translated scene, the origin of each of its parts, and the problems."""

    def __init__(self, data: Json) -> None:
        self.data = data
        self.scene: Json = {}
        self.origins: dict[Path, Path] = {}
        self.problems: list[Problem] = []

    def report(self, path: Path, text: str, at_key: bool = False) -> None:
        """Add a problem, at a path of the dialect."""
        self.problems.append(Problem(path, text, at_key))
        if len(self.problems) > MAX_PROBLEMS:
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
    t = Translation(data)
    with contextlib.suppress(_EnoughError):
        _sections(t, data)
    return t.scene, t.origins, t.problems


def _sections(t: Translation, data: Json) -> None:
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


INTEGRATORS = {"intersection_test": "direct", "path": "path"}  # of the dialect -> of the format


def _integrator(t: Translation, integrator: Any) -> None:
    from raytrace.scene.rdr_lights import has_lamps, point_lights

    here = ("integrator",)
    kind = integrator.get("type") if isinstance(integrator, dict) else None
    if kind is not None and (not isinstance(kind, str) or kind not in INTEGRATORS):
        text = f"integrator {quote(kind)} is not supported (supported: {listed(INTEGRATORS)})"
        t.report((*here, "type"), text)
        return
    point = ("point_light_position", "point_light_flux")
    given = not isinstance(integrator, dict) or any(key in integrator for key in point)
    needed = given or not (kind == "path" or has_lamps(t.data) or "point_lights" in integrator)
    optional = ("max_depth", "spp", "point_lights", *(("profile",) if kind == "path" else ()))
    t.section(here, integrator, ("type", *(point if needed else ())), optional)
    t.scene["render"] = t.copy(here, ("render",), {"max_depth": "max_depth", "spp": "spp"})
    if kind == "path":
        t.scene["render"]["integrator"] = "path"
    t.scene["lights"] = point_lights(t, integrator) if isinstance(integrator, dict) else []


def _materials(t: Translation, materials: Any, textures: Any) -> Json:
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


def _material(t: Translation, name: str, entry: Any, textures: Json) -> Json:
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
    elif kind == "glass":
        return _glass(t, here, entry)
    else:
        text = f"material {quote(kind)} is not supported (supported: diffuse, glass, refraction)"
        t.report((*here, "type"), text)
    return stand_in


def _glass(t: Translation, here: Path, entry: Json) -> Json:
    """A smooth dielectric; ``eta`` is its index, ``R`` and ``T`` are factors of what it reflects and transmits."""
    t.section(here, entry, ("type", "eta"), ("R", "T"))
    for key in ("R", "T"):
        if entry.get(key, 1) not in (1, [1, 1, 1]):
            t.report((*here, key), f"{key} other than 1 is not supported, got {quote(entry[key])}")
    return {"type": "dielectric", **t.copy(here, here, {"eta": "ior"})}


SHAPES = {"mesh": ("path",), "sphere": ("center", "radius")}  # type of an object -> keys that it must have


def _objects(t: Translation, objects: Any) -> Any:
    from raytrace.scene.rdr_lights import drop_copied, make_lamp

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
            lamp = isinstance(entry, dict) and "light" in entry
            required = ("type", *SHAPES[kind or "mesh"], *(() if lamp else ("material_name",)))
            t.section(here, entry, required, ("material_name", "light", "translate", "scale"))
        moved = t.copy(here, here, keys)
        if isinstance(entry, dict) and "light" in entry:
            moved["material"] = make_lamp(t, i, entry)
        if kind == "sphere":
            moved.pop("mesh", None)
            t.origins[*here, "sphere"] = here
            moved["sphere"] = t.copy(here, (*here, "sphere"), {"center": "center", "radius": "radius"})
            moved["normals"] = "smooth"
        translated.append(moved)
    drop_copied(t, translated)
    return translated
