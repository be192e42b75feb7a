"""Scenes for the brute-force twin of path tracing: all materials and all lights that a path can meet by chance."""

from typing import Any

import numpy as np

import naive_paths
import raytrace as rt
from light_cases import GLASS, diffuse, environment, scene
from light_scenes import COPPER, FLOOR, LAMP, MIRROR, VIEW, glass_and_metal, many_lamps, sided
from light_techniques import Images, compare
from raytrace.scene.load import load
from small_scenes import ball, box, quad

REFRACTIVE = {"type": "refractive", "ior": 1.4}


def smooth(given: dict[str, Any]) -> Any:
    """A loaded scene with smooth normals."""
    for each in given["objects"]:
        each["normals"] = "smooth"
    return load(given)


def nested_glass() -> Any:
    """Glass that is thinner than air in glass, in a constant environment, on a mirror."""
    triangles, _ = ball(4)
    bubble = {"type": "dielectric", "ior": 0.6}
    parts = [(0.9 * triangles, GLASS), (0.6 * triangles, bubble), (FLOOR, MIRROR)]
    return load(scene(parts, {**VIEW, "fov": 25}, 8, lights=environment(0.5)))


def transparent_shadows() -> Any:
    """Lamps and an environment behind panes and blocks that shadow rays pass."""
    pane = quad((-1.5, 0.3, -1.5), (-1.5, 0.3, 1.5), (1.5, 0.3, 1.5), (1.5, 0.3, -1.5))
    parts = [
        (FLOOR, diffuse(0.6)),
        (pane, {**REFRACTIVE, "shadows": "transparent"}),
        (box((-0.6, -0.95, -0.6), (0.2, -0.3, 0.4)), {**GLASS, "shadows": "transparent"}),
        (box((0.4, -0.9, -0.4), (0.9, -0.2, 0.4)), GLASS),
        (LAMP + [0.3, 1.2, 0.4], diffuse(0.3, 1.5)),
    ]
    return load(scene(parts, VIEW, 6, lights=environment(0.1)))


def smooth_and_two_sided() -> Any:
    """Smooth normals, surfaces seen from behind, metal, the course's interface, and a background."""
    triangles, _ = ball(4)
    wall = quad((-1.6, -0.9, -1.0), (-1.6, 1.0, -1.0), (1.0, 1.0, -1.4), (1.0, -0.9, -1.4))  # its back is seen
    parts = [
        (FLOOR, diffuse(0.6)),
        (0.5 * triangles + [-0.6, -0.4, 0.3], diffuse(0.7)),
        (0.4 * triangles + [0.5, -0.4, 0.4], COPPER),
        (0.3 * triangles + [0.0, 0.3, 0.8], REFRACTIVE),
        (wall, sided(diffuse(0.5))),
        (LAMP + [0.3, 1.2, 0.4], sided(diffuse(0.4, 1.5))),
    ]
    return smooth(scene(parts, VIEW, 5) | {"background": [0.2, 0.3, 0.5]})


def small_depth() -> Any:
    return load(glass_and_metal() | {"render": {"integrator": "path", "max_depth": 2}})


SCENES = {
    "glass and metal": lambda: load(glass_and_metal()),
    "many lamps": lambda: load(many_lamps()),
    "nested glass": nested_glass,
    "transparent shadows": transparent_shadows,
    "smooth and two-sided": smooth_and_two_sided,
    "small depth": small_depth,
}


def differences(scene: Any, size: tuple[int, int], seeds: int, spp: tuple[int, int], level: float) -> list[Any]:
    """For each channel, the verdict on the twin (spp[0]) and the renderer (spp[1] samples per pixel), and the mean."""
    theirs = np.array([naive_paths.render(scene, size, spp[0], seed) for seed in range(seeds)])
    ours = [rt.render(scene, spp=spp[1], size=size, seed=seed, sampler="independent").rgb for seed in range(seeds)]
    ours = np.array(ours, np.float64)
    pairs = [(Images(theirs[..., k], spp[0]), Images(ours[..., k], spp[1])) for k in range(3)]
    return [(compare(one, other, level), other.mean) for one, other in pairs]
