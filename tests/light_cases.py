"""Scenes whose light has a closed form: each with its answer and where that comes from."""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from small_scenes import ball, box, quad

DEEP = 200  # surfaces: all but 1e-6 of the light


class Case(NamedTuple):
    """A scene that shows one radiance everywhere, or on average over its film."""

    name: str
    scene: dict[str, Any]
    expected: float
    tolerance: float = 2e-6  # relative: of rounding and of what the mesh is not, beside noise


def mesh(triangles: Any, normals: Any = None) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (m, 3, 3) as vertices and faces."""
    corners = np.asarray(triangles, np.float64).reshape(-1, 3)
    return corners, np.arange(len(corners)).reshape(-1, 3)


def scene(objects: list[tuple[Any, dict[str, Any]]], camera: dict[str, Any], depth: int, **more: Any) -> dict[str, Any]:
    """A scene of triangles and their materials."""
    integrator = more.pop("integrator", "path")
    return {
        "camera": {"up": [0, 1, 0.001], **camera},
        "render": {"integrator": integrator, "max_depth": depth},
        "materials": {f"m{i}": material for i, (_, material) in enumerate(objects)},
        "objects": [{"mesh": mesh(triangles), "material": f"m{i}"} for i, (triangles, _) in enumerate(objects)],
        **more,
    }


def diffuse(albedo: float, emission: float = 0.0) -> dict[str, Any]:
    lamp = {"emission": [emission] * 3} if emission else {}
    return {"type": "diffuse", "albedo": [albedo] * 3, **lamp}


def environment(radiance: float) -> list[dict[str, Any]]:
    return [{"type": "environment", "radiance": [radiance] * 3}]


CUBE = box((-1, -1, -1), (1, 1, 1))
PLANE = quad((-1000, -1000, 0), (1000, -1000, 0), (1000, 1000, 0), (-1000, 1000, 0))
OUTSIDE = {"position": [0, 0, 4], "look_at": [0, 0, 0], "fov": 5}
ABOVE = {"position": [0, 0.01, 5], "look_at": [0, 0, 0], "fov": 0.1}
GLASS = {"type": "dielectric", "ior": 1.5}
SQUARE = quad((-0.5, -0.5, 0), (0.5, -0.5, 0), (0.5, 0.5, 0), (-0.5, 0.5, 0))


def furnaces() -> Iterator[Case]:
    """White furnaces: closed rooms, bodies and glass in the same light from everywhere."""
    inside = {"position": [0, 0, 0.5], "look_at": [0, 0.2, -1], "fov": 60}
    for depth in (1, 2, 5):  # L = Le (1 + rho + rho^2 ...): a geometric series
        room = scene([(CUBE[:, ::-1], diffuse(0.5, 0.25))], inside, depth)
        yield Case(f"room of albedo 1/2 that emits, depth {depth}", room, 0.25 * (1 - 0.5 ** (depth + 1)) / 0.5)
    for integrator in ("path", "direct"):  # a convex body sees nothing of itself
        body = scene([(CUBE, diffuse(0.6))], OUTSIDE, 4, lights=environment(0.5), integrator=integrator)
        yield Case(f"convex body in an environment, {integrator}", body, 0.3)
    white = scene([(CUBE, diffuse(1.0))], OUTSIDE, 4, lights=environment(0.5))
    yield Case("a white body cannot be seen", white, 0.5)
    triangles, _ = ball(30)
    glass = scene([(triangles, GLASS)], {**OUTSIDE, "fov": 20}, DEEP, lights=environment(0.5))
    yield Case("a glass ball cannot be seen", glass, 0.5)  # no light is lost, and radiance / n^2 is conserved
    sphere, _ = ball(120)
    lit = scene(
        [(sphere[:, ::-1], diffuse(0.5))],
        {"position": [0, 0, 0.5], "look_at": [0, 0.1, -1], "fov": 40},
        6,
        lights=[{"type": "point", "position": [0, 0, 0], "flux": [2 * math.pi**2] * 3}],
    )  # E = Phi / (4 pi R^2), then 1/2 at each reflection; the mesh lies up to 4e-4 inside the sphere
    yield Case("sphere with a point light at its centre, depth 6", lit, (1 - 2**-6) / 2, 1e-3)


def square_factor() -> float:
    """Form factor of two opposed squares at the distance of their sides [Howell C-11]."""
    return 2 / math.pi * (math.log(math.sqrt(4 / 3)) + 2 * math.sqrt(2) * math.atan(1 / math.sqrt(2)) - math.pi / 2)


def above_square() -> dict[str, Any]:
    """A camera that shows a square of side 1, and nothing else."""
    return {"position": [0, 0.0001, 0.5], "look_at": [0, 0, 0], "fov": 90}


def lights() -> Iterator[Case]:
    """One light over a plane, or over a square."""
    point = [{"type": "point", "position": [0, 0, 2], "flux": [100] * 3}]
    yield Case(
        "point light on a plane",
        scene([(PLANE, diffuse(0.5))], ABOVE, 1, lights=point),
        0.5 / math.pi * 100 / (16 * math.pi),
        1e-4,
    )
    angle = math.radians(15)
    aside = {"position": [2 * math.tan(angle), 0.001, 5], "look_at": [2 * math.tan(angle), 0, 0], "fov": 0.01}
    spot = [
        {"type": "spot", "position": [0, 0, 2], "look_at": [0, 0, 0], "intensity": [10] * 3, "cutoff": 30, "beam": 0}
    ]
    half = 0.5 / math.pi * 10 * 0.5 * math.cos(angle) / (2 / math.cos(angle)) ** 2  # half of its cutoff: half the light
    yield Case("spot light at half of its cutoff", scene([(PLANE, diffuse(0.5))], aside, 1, lights=spot), half, 2e-4)
    sun = [{"type": "directional", "direction": [0, math.sin(0.5), -math.cos(0.5)], "irradiance": [2] * 3}]
    yield Case(
        "directional light on a plane", scene([(PLANE, diffuse(0.5))], ABOVE, 1, lights=sun), math.cos(0.5) / math.pi
    )
    factor, above = square_factor(), above_square()
    for integrator in ("path", "direct"):  # [Howell C-11]
        squares = [(SQUARE, diffuse(0.8)), ((SQUARE + [0, 0, 1])[:, ::-1], diffuse(0.0, 2.0))]
        yield Case(f"two opposed squares, {integrator}", scene(squares, above, 1, integrator=integrator), 1.6 * factor)


def interfaces() -> Iterator[Case]:
    """Slabs of glass and mirrors: Fresnel's reflectance and the factor n^2 of radiance."""
    n = 1.5
    r = ((n - 1) / (n + 1)) ** 2
    within = {"position": [0, 0, 0], "look_at": [0, 0, 1], "fov": 0.01}
    for depth in (1, 2, 30):
        slab = box((-1e4, -1e4, -1), (1e4, 1e4, 1))
        inside = scene([(slab, GLASS)], within, depth, lights=environment(0.2))
        yield Case(f"inside of a slab, depth {depth}", inside, n * n * 0.2 * (1 - r**depth), 2e-5)
    for degrees in (0.0, 30.0, 60.0, 80.0, math.degrees(math.atan(n))):
        angle = math.radians(degrees)
        d = np.array([math.sin(angle), 0, -math.cos(angle)])
        cos_i, cos_t = math.cos(angle), math.sqrt(1 - (math.sin(angle) / n) ** 2)
        rs, rp = (cos_i - n * cos_t) / (cos_i + n * cos_t), (n * cos_i - cos_t) / (n * cos_i + cos_t)
        reflected = (rs**2 + rp**2) / 2
        slab = box((-1e3, -1e3, -1), (1e3, 1e3, 0))
        lamp = quad((-1e4, -1e4, -2), (1e4, -1e4, -2), (1e4, 1e4, -2), (-1e4, 1e4, -2))
        view = {"position": (-5 * d).tolist(), "look_at": [0, 0, 0], "fov": 0.01}
        through = scene([(slab, GLASS), (lamp, diffuse(0.0, 0.5))], view, 100)
        yield Case(f"through a slab at {degrees:.1f} degrees", through, 0.5 * (1 - reflected) / (1 + reflected), 1e-5)
    for reflectance in (0.2, 0.9, 1.0):
        metal = {"type": "conductor", "reflectance": [reflectance] * 3}
        yield Case(
            f"conductor of reflectance {reflectance}",
            scene([(PLANE, metal)], ABOVE, 3, lights=environment(0.5)),
            0.5 * reflectance,
            1e-5,
        )
    mirror = {"type": "mirror", "reflectance": [0.7] * 3}
    yield Case("mirror", scene([(PLANE, mirror)], ABOVE, 3, lights=environment(0.5)), 0.35)


def cases() -> list[Case]:
    return [*furnaces(), *lights(), *interfaces()]
