"""Six scenes whose light can be found by sampling lights and by sampling surfaces: no light in them is a point.

No lamp touches another surface, so the variance of each technique is finite.
"""

from typing import Any

import numpy as np

from light_cases import CUBE, GLASS, diffuse, environment, scene
from small_scenes import ball, box, quad

FLOOR = quad((-3, -1, 3), (3, -1, 3), (3, -1, -3), (-3, -1, -3))
LAMP = quad((-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1))  # faces down
VIEW = {"position": [0, 0.6, 4], "look_at": [0, -0.6, 0], "fov": 40}
MIRROR = {"type": "mirror", "reflectance": [0.8, 0.7, 0.6]}
COPPER = {"type": "conductor", "metal": "copper"}


def sided(material: dict[str, Any]) -> dict[str, Any]:
    return {**material, "two_sided": True}


def lamp_over_floor() -> dict[str, Any]:
    """A lamp of middle size over a floor and a block, direct light only."""
    block = box((-0.5, -1, -0.5), (0.5, -0.3, 0.5))
    parts = [(FLOOR, diffuse(0.6)), (block, diffuse(0.4)), (0.5 * LAMP + [0.2, 0.8, 0.3], diffuse(0.0, 4.0))]
    return scene(parts, VIEW, 1)


def large_lamp() -> dict[str, Any]:
    """A lamp near the floor and larger than what is seen: surface sampling is the better technique."""
    return scene([(FLOOR, diffuse(0.6)), (2.5 * LAMP + [0, 0.2, 0], sided(diffuse(0.3, 0.7)))], {**VIEW, "fov": 25}, 3)


def closed_room() -> dict[str, Any]:
    """A room whose lamp hangs free, with light of many surfaces."""
    parts = [(CUBE[:, ::-1], diffuse(0.6)), (0.4 * LAMP + [0, 0.7, 0], diffuse(0.2, 3.0))]
    parts.append((box((-0.6, -0.9, -0.6), (0.1, 0.1, 0.0)), diffuse(0.5)))
    return scene(parts, {"position": [0, 0, 0.95], "look_at": [0, -0.1, -1], "fov": 80}, 6)


def open_sky() -> dict[str, Any]:
    """A smooth ball on a floor, in a constant environment."""
    triangles, _ = ball(6)
    return scene([(FLOOR, diffuse(0.5)), (0.7 * triangles, diffuse(0.7))], VIEW, 4, lights=environment(0.6))


def glass_and_metal() -> dict[str, Any]:
    """Lamps seen through glass, in mirrors and in metal, and caustics; the lamps are large enough for those."""
    triangles, _ = ball(5)
    parts = [
        (FLOOR, diffuse(0.6)),
        (0.4 * triangles + [-0.6, -0.4, 0.3], GLASS),
        (0.4 * triangles + [0.5, -0.4, 0.4], COPPER),
        (box((-1.5, -0.9, -1.3), (1.5, 0.5, -1.1)), MIRROR),
        (LAMP + [0.3, 1.2, 0.4], diffuse(0.0, 1.5)),
    ]
    return scene(parts, VIEW, 6)


def many_lamps() -> dict[str, Any]:
    """Lamps of very different size and brightness, and a weak environment."""
    rng = np.random.default_rng(7)
    parts = [(FLOOR, sided(diffuse(0.6))), (box((-0.5, -0.9, -0.5), (0.5, -0.4, 0.5)), diffuse(0.5))]
    for k in range(6):
        place, size = [k % 3 - 1 + 0.1 * rng.random(), 0.6 + 0.2 * rng.random(), k // 3 - 0.5], 0.15 + 0.06 * k
        parts.append((size * LAMP + place, diffuse(0.3, 0.8 * (6 - k))))
    return scene(parts, VIEW, 3, lights=environment(0.1))


SCENES = {
    "lamp over a floor": lamp_over_floor,
    "large lamp": large_lamp,
    "closed room": closed_room,
    "open sky": open_sky,
    "glass and metal": glass_and_metal,
    "many lamps": many_lamps,
}
