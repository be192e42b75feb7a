"""Lights of the course dialect: point lights of the integrator, and objects that are lamps."""

from typing import TYPE_CHECKING, Any

from raytrace.scene.problems import HINTED, quote, unknown_name

if TYPE_CHECKING:
    from raytrace.scene.rdr import Json, Translation


def has_lamps(data: "Json") -> bool:
    """Whether a scene has objects with a light."""
    objects = data.get("objects")
    return any(isinstance(entry, dict) and "light" in entry for entry in (objects if isinstance(objects, list) else []))


def point_lights(t: "Translation", integrator: "Json") -> "list[Json]":
    """The lights of an integrator: a position and a flux, or lists of them; or ``point_lights``."""
    keys = {"point_light_position": "position", "point_light_flux": "flux"}
    here, found = ("integrator",), list[dict[str, Any]]()
    values = [integrator[key] for key in keys if key in integrator]
    several = [isinstance(value, list) and bool(value) and isinstance(value[0], list) for value in values]
    if any(several):
        if len(values) == 2 and (not all(several) or len(values[0]) != len(values[1])):
            text = "expected as many positions as fluxes: lists of as many lists of 3 numbers"
            t.report((*here, "point_light_flux"), text)
        elif len(values) == 2:
            for k in range(len(values[0])):
                t.origins.update({("lights", k, new): (*here, old, k) for old, new in keys.items()})
                found.append({"type": "point", "position": values[0][k], "flux": values[1][k]})
    elif values:
        t.origins["lights", 0] = here
        found.append({"type": "point", **t.copy(here, ("lights", 0), keys)})
    entries = integrator.get("point_lights", [])
    if not isinstance(entries, list):
        t.report((*here, "point_lights"), f"expected a list, got {quote(entries)}")
        return found
    for k, entry in enumerate(entries):
        t.section((*here, "point_lights", k), entry, ("position", "flux"))
        place = ("lights", len(found))
        t.origins[place] = (*here, "point_lights", k)
        light = t.copy((*here, "point_lights", k), place, {"position": "position", "flux": "flux"})
        found.append({"type": "point", **light})
    return found


def make_lamp(t: "Translation", i: int, entry: "Json") -> str:
    """Name of a material for an object with a light: that of the object, or a black one, with emission."""
    here, light = ("objects", i, "light"), entry["light"]
    kind = light.get("type") if isinstance(light, dict) else None
    if kind is not None and kind != "area":
        t.report((*here, "type"), f"light {quote(kind)} is not supported (supported: area)")
    else:
        t.section(here, light, ("type", "radiance"))
    name, black = entry.get("material_name"), {"type": "diffuse", "albedo": [0, 0, 0]}
    materials = t.scene["materials"]
    if "material_name" in entry and (not isinstance(name, str) or name not in materials):
        text = unknown_name("material", name, materials, len(t.problems) < HINTED)
        t.report(("objects", i, "material_name"), text)
    base = materials.get(name, black) if isinstance(name, str) else black
    if base["type"] != "diffuse":
        kind = t.data["materials"][name]["type"]
        t.report(here, f"only a diffuse material can have a light; {quote(name)} is {quote(kind)}")
        base = black
    lamp = f"{name} with the light of objects[{i}]" if base is not black else f"light of objects[{i}]"
    t.origins["materials", lamp] = here
    t.origins["materials", lamp, "albedo"] = t.origins.get(("materials", str(name), "albedo"), here)
    materials[lamp] = base | t.copy(here, ("materials", lamp), {"radiance": "emission"})
    return lamp


def drop_copied(t: "Translation", objects: "list[Json]") -> None:
    """Drop materials that only lamps have: each lamp has a copy."""
    used = {str(entry.get("material")) for entry in objects}
    lamps = (entry for entry in t.data["objects"] if isinstance(entry, dict) and "light" in entry)
    for name in {str(entry.get("material_name")) for entry in lamps} - used:
        t.scene["materials"].pop(name, None)
