"""Checks of what several keys of a scene must agree on, and warnings of what is legal but probably not meant.

The checks read the JSON itself, so that their problems can be reported together with those of the format. They skip
values of the wrong form, because ``format.py`` reports these.
"""

import math
from collections.abc import Iterator
from itertools import chain, islice
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from raytrace.scene.check_light import check_lights, check_materials, emits
from raytrace.scene.check_textures import check_textures
from raytrace.scene.files import FORMATS_WITH_MATERIALS, format_of
from raytrace.scene.positions import Path
from raytrace.scene.problems import HINTED, MAX_PROBLEMS, Problem, unknown_name

if TYPE_CHECKING:
    from raytrace.records import Scene

# sine of the angle between up and the view direction; the film's axes lose 1e-16 / MIN_SINE of their direction
MIN_SINE = 1e-6


NO_MATERIALS = "only GLB and glTF files have materials that are read; name one of materials"
Vector = tuple[float, float, float]


def _vector(section: Any, key: str, default: list[float] | None = None) -> Vector | None:
    value = section.get(key, default) if isinstance(section, dict) else None
    if not (isinstance(value, list) and len(value) == 3 and all(type(x) in (int, float) for x in value)):
        return None
    return float(value[0]), float(value[1]), float(value[2])


def _unit(vector: Vector) -> Vector:
    """Normalise without overflow or underflow; the zero vector is unchanged."""
    largest = max(map(abs, vector))
    if largest == 0:
        return vector
    x, y, z = (component / largest for component in vector)
    length = math.hypot(x, y, z)
    return x / length, y / length, z / length


def _sine(a: Vector, b: Vector) -> float:
    """Return the sine of the angle between two unit vectors."""
    return math.hypot(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def check_camera(camera: Any) -> Iterator[Problem]:
    """Find keys of a camera that contradict each other."""
    position, look_at = _vector(camera, "position"), _vector(camera, "look_at")
    up = _vector(camera, "up", [0.0, 1.0, 0.0])
    if up is not None and not any(up):
        yield Problem(("camera", "up"), "up has no direction; expected a vector other than 0")
    yield from _check_projection(camera)
    if position is None or look_at is None:
        return
    if position == look_at:
        yield Problem(("camera", "look_at"), "the camera looks at its own position; move one of the two")
    elif up is not None and any(up):
        # halves: the difference of two large numbers may overflow
        x, y, z = (there / 2 - here / 2 for there, here in zip(look_at, position, strict=True))
        if _sine(_unit(up), _unit((x, y, z))) < MIN_SINE:
            text = "up is parallel to the view direction; choose another, such as [0, 0, 1] for a view straight down"
            yield Problem(("camera", "up") if "up" in camera else ("camera",), text)


def _check_projection(camera: Any) -> Iterator[Problem]:
    """Find keys that do not belong to the type of a camera."""
    if not isinstance(camera, dict):
        return
    kind = camera.get("type", "perspective")
    both = "fov" in camera and "height" in camera  # one problem, which the format reports
    if kind == "perspective" and "height" in camera and not both:
        yield Problem(
            ("camera", "height"), 'a perspective camera has "fov"; or set "type": "orthographic"', at_key=True
        )
    if kind == "orthographic":
        for key, why in (("fov", '"height"'), ("aperture", "no lens"), ("focus", "no lens")):
            if key in camera and not (key == "fov" and both):
                yield Problem(("camera", key), f"an orthographic camera has {why}; remove this key", at_key=True)


def _check_rotations(path: Path, rotate: Any) -> Iterator[Problem]:
    several = isinstance(rotate, list)
    for k, rotation in enumerate(rotate if several else [rotate]):
        axis = _vector(rotation, "axis")
        if axis is not None and not any(axis):
            where = (*path, k, "axis") if several else (*path, "axis")
            yield Problem(where, "the axis has no direction; expected a vector other than 0")


def check(data: dict[str, Any]) -> list[Problem]:
    """Return the problems of keys that contradict each other.

    Parameters
    ----------
    data : dict
        A scene as JSON types, in the format's own keys; it need not be valid.

    Returns
    -------
    list of Problem
    """
    problems = list(check_camera(data.get("camera")))
    problems += islice(chain(check_lights(data), check_materials(data), check_textures(data)), MAX_PROBLEMS)
    materials, lights = data.get("materials"), data.get("lights")
    for i, light in enumerate(lights if isinstance(lights, list) else []):
        if isinstance(light, dict) and light.get("type") == "environment" and len(problems) <= MAX_PROBLEMS:
            problems += _check_rotations(("lights", i, "rotate"), light.get("rotate"))
    objects = data.get("objects")
    for i, entry in enumerate(objects if isinstance(objects, list) else []):
        if len(problems) > MAX_PROBLEMS:
            break
        hint = len(problems) < HINTED
        name = entry.get("material") if isinstance(entry, dict) else None
        if name == {"from": "file"} and format_of(FilePath(str(entry.get("mesh")))) not in FORMATS_WITH_MATERIALS:
            problems.append(Problem(("objects", i, "material"), NO_MATERIALS))
        if isinstance(name, str) and isinstance(materials, dict) and name not in materials:
            problems.append(Problem(("objects", i, "material"), unknown_name("material", name, materials, hint)))
        if isinstance(entry, dict):
            problems += _check_rotations(("objects", i, "rotate"), entry.get("rotate"))
    return problems


def warn(data: dict[str, Any]) -> list[Problem]:
    """Return what is legal but probably not meant, in a valid scene.

    Parameters
    ----------
    data : dict
        A valid scene as JSON types, in the format's own keys.

    Returns
    -------
    list of Problem
    """
    found = []
    if not data.get("lights") and not any(map(emits, data["materials"].values())):
        found.append(Problem(("lights",), "no lights: all surfaces will be black"))
    used = {entry["material"] for entry in data["objects"] if isinstance(entry["material"], str)}
    for name in data["materials"]:
        if name not in used:
            found.append(Problem(("materials", name), "no object uses this material", at_key=True))
    return found


def warnings_of(scene: "Scene", precision: str | None) -> list[str]:
    """Return the warnings of a scene, and those of rendering it in a precision; one line each."""
    lines = list(scene.warnings)
    if precision in ("float32", "float64") and getattr(scene, "refractive", False):
        from raytrace.scene.coincident import texts_in

        lines += [f"{scene.source or 'scene'}: {text}" for text in texts_in(scene, precision)]
    return lines
