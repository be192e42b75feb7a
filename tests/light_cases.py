"""Scenes whose light has a closed form: each with its answer and where that comes from."""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from raytrace.conformance.formulas import (
    fresnel,
    furnace,
    inside_slab,
    lit_sphere,
    opposed_squares,
    polygon_irradiance,
    slab_reflection,
    slab_transmission,
)
from small_scenes import ball, box, quad

DEEP = 200  # surfaces: all but 1e-6 of the light


class Case(NamedTuple):
    """A scene that shows one radiance everywhere, or on average over its film."""

    name: str
    scene: dict[str, Any]
    expected: float
    tolerance: float = 2e-6  # relative: of rounding and of what the mesh is not, beside noise
    chance: bool = False  # the answer is a Fresnel reflectance that each path chooses at random


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
    sphere, _ = ball(8)
    for name, shape in (("room", CUBE), ("sphere", sphere)):
        for depth in (1, 2, 5, DEEP):  # L = Le (1 + rho + rho^2 ...): a geometric series in any closed mesh
            room = scene([(shape[:, ::-1], diffuse(0.5, 0.25))], inside, depth)
            yield Case(f"{name} of albedo 1/2 that emits, depth {depth}", room, furnace(0.5, 0.25, depth))
    for integrator, depth in (("path", 1), ("path", 4), ("direct", 4)):  # a convex body sees nothing of itself
        body = scene([(CUBE, diffuse(0.6))], OUTSIDE, depth, lights=environment(0.5), integrator=integrator)
        yield Case(f"convex body in an environment, {integrator}, depth {depth}", body, 0.3)
    white = scene([(CUBE, diffuse(1.0))], OUTSIDE, 4, lights=environment(0.5))
    yield Case("a white body cannot be seen", white, 0.5)
    point = scene([(np.ones((1, 3, 3)), diffuse(1.0))], OUTSIDE, 1, lights=environment(0.5))
    yield Case("an environment around a mesh of one point", point, 0.5)
    triangles, _ = ball(30)
    glass = scene([(triangles, GLASS)], {**OUTSIDE, "fov": 20}, DEEP, lights=environment(0.5))
    yield Case("a glass ball cannot be seen", glass, 0.5)  # no light is lost, and radiance / n^2 is conserved
    yield point_in_sphere(120, 6)


def point_in_sphere(rings: int, depth: int) -> Case:
    """Inside of a sphere of albedo 1/2 with a point light at its centre: E = Phi / (4 pi), then 1/2 at each surface.

    A point of a facet sees the light at an angle of at most delta, the angular radius of the largest facet, and lies
    between cos(delta) and 1 from it. So its irradiance is between cos(delta)^3 and 1 / cos(delta)^2 times that of the
    sphere. The room is closed, so the light of all further surfaces is within the same factors.
    """
    triangles, _ = ball(rings)
    delta = math.pi / rings / math.sqrt(2)
    lit = scene(
        [(triangles[:, ::-1], diffuse(0.5))],
        {"position": [0, 0, 0.5], "look_at": [0, 0.1, -1], "fov": 40},
        depth,
        lights=[{"type": "point", "position": [0, 0, 0], "flux": [2 * math.pi**2] * 3}],
    )
    name = f"sphere of {len(triangles)} triangles with a point light at its centre, depth {depth}"
    return Case(name, lit, lit_sphere(2 * math.pi**2, 1, 0.5, depth), 1 / math.cos(delta) ** 3 - 1)


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
    full = 0.5 / math.pi * 10 * math.cos(angle) / (2 / math.cos(angle)) ** 2
    for name, beam, cutoff, share in (  # linear in the angle
        ("at half of its cutoff", 0, 30, 1 / 2),
        ("between beam and cutoff", 12, 24, 3 / 4),
        ("within its beam", 20, 30, 1),
        ("with a hard edge", 20, 20, 1),
    ):
        lamp = [{**spot[0], "beam": beam, "cutoff": cutoff}]
        yield Case(f"spot light {name}", scene([(PLANE, diffuse(0.5))], aside, 1, lights=lamp), share * full, 2e-4)
    sun = [{"type": "directional", "direction": [0, math.sin(0.5), -math.cos(0.5)], "irradiance": [2] * 3}]
    yield Case(
        "directional light on a plane", scene([(PLANE, diffuse(0.5))], ABOVE, 1, lights=sun), math.cos(0.5) / math.pi
    )
    factor, above = opposed_squares(), above_square()
    for integrator in ("path", "direct"):  # [Howell C-11]
        squares = [(SQUARE, diffuse(0.8)), ((SQUARE + [0, 0, 1])[:, ::-1], diffuse(0.0, 2.0))]
        yield Case(f"two opposed squares, {integrator}", scene(squares, above, 1, integrator=integrator), 1.6 * factor)
    plate = SQUARE[:, ::-1], {**diffuse(0.5, 0.4), "two_sided": True}
    behind = scene([plate], {**ABOVE, "fov": 2}, 2, lights=environment(0.6))
    yield Case("back of a lamp that reflects on both sides", behind, 0.3)
    corners = np.array([[0.5, -0.4, 1], [0.2, 0.9, 1.5], [1.4, 0.6, 0.8]])
    lamp = scene([(PLANE, diffuse(0.5)), (corners[None], diffuse(0.0, 6.0))], {**ABOVE, "fov": 0.01}, 1)
    yield Case("triangular lamp over a point", lamp, 0.5 / math.pi * 6 * polygon_irradiance(corners), 5e-4)
    turn = np.array([[math.cos(0.7), 0, -math.sin(0.7)], [0, 1, 0], [math.sin(0.7), 0, math.cos(0.7)]])
    small = (0.01 * SQUARE[:, ::-1]) @ turn  # at the origin of the coordinates, 100 above the floor
    aside = {"position": [50, 1, -30], "look_at": [0, 0, -100], "fov": 0.05}
    lamp = scene([(PLANE - [0, 0, 100], diffuse(0.5)), (small, diffuse(0.0, 3e8))], aside, 1)
    expected = 0.5 / math.pi * 3e8 * polygon_irradiance(np.array([*small[0], small[1, 0]]) + [0, 0, 100])
    yield Case("small tilted lamp far above a plane", lamp, expected, 1e-5)


def interfaces() -> Iterator[Case]:
    """Slabs of glass and mirrors: Fresnel's reflectance and the factor n^2 of radiance."""
    n = 1.5
    within = {"position": [0, 0, 0], "look_at": [0, 0, 1], "fov": 0.01}
    for depth in (1, 2, 30):
        slab = box((-1e4, -1e4, -1), (1e4, 1e4, 1))
        inside = scene([(slab, GLASS)], within, depth, lights=environment(0.2))
        yield Case(f"inside of a slab, depth {depth}", inside, 0.2 * inside_slab(n, depth), 2e-5)
    for degrees in (0.0, 30.0, 60.0, 80.0, math.degrees(math.atan(n))):
        yield from slabs(degrees, n)
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
    yield from corridors()


def slabs(degrees: float, n: float) -> Iterator[Case]:
    """A slab of glass with light on one side, seen from either side; r^2 of the light that is inside stays there."""
    angle = math.radians(degrees)
    d = np.array([math.sin(angle), 0, -math.cos(angle)])
    r = fresnel(math.cos(angle), n)
    glass = box((-1e3, -1e3, -1), (1e3, 1e3, 0)), GLASS
    below = quad((-1e4, -1e4, -2), (1e4, -1e4, -2), (1e4, 1e4, -2), (-1e4, 1e4, -2))
    view = {"position": (-5 * d).tolist(), "look_at": [0, 0, 0], "fov": 0.01}
    for depth in (100, 4):
        through = scene([glass, (below, diffuse(0.0, 0.5))], view, depth)
        yield Case(
            f"through a slab at {degrees:.1f} degrees, depth {depth}",
            through,
            0.5 * slab_transmission(r, depth),
            1e-5,
            True,
        )
    for depth in (100, 3):
        back = scene([glass, (below, diffuse(0.0))], view, depth, lights=environment(0.2 / r))
        yield Case(
            f"in a slab at {degrees:.1f} degrees, depth {depth}", back, 0.2 / r * slab_reflection(r, depth), 1e-5, True
        )


def corridors() -> Iterator[Case]:
    """Parallel mirrors: geometric series."""
    wall = quad((-1, -1e3, -20), (-1, 1e3, -20), (-1, 1e3, 20), (-1, -1e3, 20))
    end = quad((-1, -1e3, -10), (1, -1e3, -10), (1, 1e3, -10), (-1, 1e3, -10))
    walls = np.concatenate([wall, wall * [-1, 1, 1]]), {"type": "mirror", "reflectance": [0.9] * 3}
    # the plane of the film is unfolded: a ray of slope x/z meets ceil((10 x/z - 1) / 2) mirrors, and slopes are uniform
    view = {"position": [0, 0, 0], "look_at": [0, 0, -1], "fov": 2 * math.degrees(math.atan(1.5))}
    for depth in (4, 7):
        series = (1 + 2 * sum(0.9**k for k in range(1, depth + 1))) / 15
        hall = scene([walls, (end, diffuse(0.0, 1.0))], view, depth)
        yield Case(f"corridor of two mirrors, depth {depth}", hall, series, 1e-5)
    plate = quad((-1e4, -1e4, 0), (1e4, -1e4, 0), (1e4, 1e4, 0), (-1e4, 1e4, 0))
    mirror = {"type": "mirror", "reflectance": [0.8] * 3}
    view = {"position": [0, 0, 0.5], "look_at": [0, 0, 0], "fov": 20}
    for depth in (1, 2, 5, DEEP):  # each further term takes a mirror and the plate
        shine = scene([(plate, diffuse(0.5, 0.3)), ((plate + [0, 0, 1])[:, ::-1], mirror)], view, depth)
        expected = 0.3 * (1 - 0.4 ** (depth // 2 + 1)) / 0.6
        yield Case(f"lamp below a mirror, depth {depth}", shine, expected, 1e-5)


def large() -> Iterator[Case]:
    """What is too large for every day: spheres of 300,000 triangles."""
    for depth in (6, DEEP):
        yield point_in_sphere(275, depth)
    triangles, _ = ball(275)
    inside = {"position": [0, 0, 0.5], "look_at": [0, 0.2, -1], "fov": 60}
    shining = scene([(triangles[:, ::-1], diffuse(0.5, 0.25))], inside, DEEP)
    yield Case(f"sphere of {len(triangles)} triangles that emit", shining, 0.5)


def cases() -> list[Case]:
    return [*furnaces(), *lights(), *interfaces()]
