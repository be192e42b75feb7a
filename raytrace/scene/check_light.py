"""What the keys of lights and materials must agree on."""

from collections.abc import Iterator
from typing import Any

from raytrace.limits import MIN_ALPHA
from raytrace.scene.problems import Problem

WAYS = "metal, eta with k, or reflectance"  # in which a conductor may be given


def check_lights(data: dict[str, Any]) -> Iterator[Problem]:
    """Find what the keys of lights disagree on, in a scene that need not be valid."""
    lights = data.get("lights")
    environments = 0
    for i, light in enumerate(lights if isinstance(lights, list) else []):
        if not isinstance(light, dict):
            continue
        kind, at = light.get("type"), ("lights", i)
        if kind == "spot":
            if light.get("position") == light.get("look_at") is not None:
                yield Problem((*at, "look_at"), "the spot light looks at its own position; move one of the two")
            cutoff, beam = light.get("cutoff"), light.get("beam")
            if isinstance(cutoff, int | float) and isinstance(beam, int | float) and beam > cutoff:
                yield Problem((*at, "beam"), f"expected at most cutoff, {cutoff:g}, got {beam:g}")
        if kind == "directional" and light.get("direction") in ([0, 0, 0], [0.0, 0.0, 0.0]):
            yield Problem((*at, "direction"), "the direction has no length; expected a vector other than 0")
        if kind == "environment":
            environments += 1
            if environments == 2:
                yield Problem(at, "a scene has at most one environment; remove this one, or the other")
            if environments == 1 and "background" in data:
                text = "a background beside an environment: the environment is what is seen; remove one of them"
                yield Problem(("background",), text, at_key=True)


def check_materials(data: dict[str, Any]) -> Iterator[Problem]:
    """Find what the keys of materials disagree on, in a scene that need not be valid."""
    materials = data.get("materials")
    for name, material in (materials if isinstance(materials, dict) else {}).items():
        if not isinstance(material, dict):
            continue
        alpha = material.get("alpha")
        rough = material.get("type") == "dielectric" and isinstance(alpha, int | float) and alpha >= MIN_ALPHA
        if rough and "shadows" in material:
            text = f"shadow rays cannot pass a rough surface; remove shadows, or use an alpha below {MIN_ALPHA:g}"
            yield Problem(("materials", name, "shadows"), text, at_key=True)
        if material.get("type") != "conductor":
            continue
        given = {key for key in ("metal", "eta", "k", "reflectance") if material.get(key) is not None}
        if given not in ({"metal"}, {"eta", "k"}, {"reflectance"}):
            found = f"got {' and '.join(sorted(given))}" if given else "got none of them"
            yield Problem(("materials", name), f"a conductor needs one of {WAYS}; {found}")


def emits(material: dict[str, Any]) -> bool:
    """Whether a material of a valid scene emits light."""
    emission = material.get("emission")
    return isinstance(emission, dict) or any(emission or ())
