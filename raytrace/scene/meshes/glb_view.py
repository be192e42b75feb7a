"""The camera and the lights of a glTF file, as entries of a scene   [glTF, 3.10; KHR_lights_punctual]."""

import math
from typing import Any

from raytrace.scene.meshes.entries import Entry, camera_entry, light_entry
from raytrace.scene.meshes.glb_json import Record, entries, extension, item, numbers, record_in
from raytrace.scene.meshes.glb_nodes import PlacedNode, visible_nodes

PUNCTUAL = "KHR_lights_punctual"
LIGHTS = "EXT_lights_"  # further lights, which are not read
LONGER = 512  # pixels of the longer side of a film with the shape that a camera states
NARROW = 1 / 16  # of a film: the shortest side over the longest


def view_of(document: Record) -> tuple[Entry, list[str]]:
    """Return what a scene takes from a glTF file beside its meshes.

    Parameters
    ----------
    document : dict
        The file's JSON.

    Returns
    -------
    entry : dict
        Of ``camera``, ``film`` and ``lights``, those that the file has.
    left_out : list of str
        What it has, and is not used.

    Raises
    ------
    ValueError
        What is wrong with it.
    """
    nodes = sorted(visible_nodes(document), key=lambda placed: placed.number)
    view, left_out = Entry(), list[str]()
    cameras = [placed for placed in nodes if "camera" in placed.node]
    if cameras:
        view = _camera(item(document, "cameras", cameras[0].node["camera"]), cameras[0])
    if len(cameras) > 1:
        left_out.append("all cameras but the first")
    lights = list[Entry]()
    for placed in nodes:
        use = extension(placed.node, PUNCTUAL)
        if use is not None:
            light = item(extension(document, PUNCTUAL) or {}, "lights", use.get("light"))
            lights.append(_light(light, placed))
            if "range" in light and "the range of lights" not in left_out:
                left_out.append("the range of lights")
    left_out += [str(name)[:80] for name in entries(document, "extensionsUsed") if str(name).startswith(LIGHTS)][:5]
    return view | ({"lights": lights} if lights else {}), left_out


def _number(record: Record, key: str) -> Any:
    if key not in record:
        raise ValueError(f"cameras: missing {key}")
    if type(record[key]) not in (int, float):
        raise ValueError(f"cameras: {key}: expected a number, got {str(record[key])[:40]}")
    return record[key]


def _camera(camera: Record, placed: PlacedNode) -> Entry:
    kind = camera.get("type")
    if kind == "perspective":
        lens = record_in(camera, kind)
        entry = camera_entry(placed.matrix, fov=math.degrees(_number(lens, "yfov")))
        aspect = _number(lens, "aspectRatio") if "aspectRatio" in lens else 1
    elif kind == "orthographic":
        lens = record_in(camera, kind)
        width, height = abs(_number(lens, "xmag")), abs(_number(lens, "ymag"))
        entry, aspect = camera_entry(placed.matrix, height=2 * height), width / height if height else 1
    else:
        raise ValueError(f"cameras: expected the type perspective or orthographic, got {str(kind)[:40]}")
    if not aspect > 0:
        raise ValueError(f"cameras: expected a width over height > 0, got {aspect}")
    aspect = min(max(aspect, NARROW), 1 / NARROW)
    size = (LONGER, round(LONGER / aspect)) if aspect > 1 else (round(LONGER * aspect), LONGER)
    return {"camera": entry, "film": {"size": size}}


def _light(light: Record, placed: PlacedNode) -> Entry:
    kind = light.get("type")
    if kind not in ("point", "spot", "directional"):
        raise ValueError(f"lights: expected the type point, spot or directional, got {str(kind)[:40]}")
    level = numbers(light, "color", [1.0] * 3) * _value(light, "intensity", 1.0)
    cone = record_in(light, "spot") if kind == "spot" else {}
    inner, outer = _value(cone, "innerConeAngle", 0.0), _value(cone, "outerConeAngle", math.pi / 4)
    return light_entry(kind, placed.matrix, level, inner, outer)


def _value(record: Record, key: str, default: float) -> float:
    value = record.get(key, default)
    if type(value) not in (int, float):
        raise ValueError(f"lights: {key}: expected a number, got {str(value)[:40]}")
    return float(value)
