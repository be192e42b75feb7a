"""Hard shadow rays for ray tracers: lit surfaces that must not shadow themselves, and thin walls."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from raytrace.hardcases.meshes import Doubles, Mesh, grid, icosphere, joined, turned, uniform

Reals = NDArray[np.floating]
RAYS, LIGHTS = 200, 5  # per case
GAP = 1e-4  # distance of walls from points or lights, relative to the size of the scene


class LightQuery(NamedTuple):
    """Camera rays that hit points on a mesh, and a light for each point, rounded to one precision."""

    vertices: Reals  # (v, 3), world units
    faces: NDArray[np.int64]  # (m, 3)
    o: Reals  # (n, 3), world units
    d: Reals  # (n, 3): the point is at t = 1
    light: Reals  # (n, 3), world units
    dark: bool  # True: a wall blocks the light of every point; False: nothing blocks it


class ShadowCase(NamedTuple):
    """Points and lights, rounded to a precision."""

    name: str
    seed: int
    must: str  # condition that must hold
    make: Callable[[np.dtype, int], LightQuery]  # (precision, seed)

    def query(self, dtype: DTypeLike, step: int = 1) -> LightQuery:
        """Make the query of this case, with every ``step``-th ray."""
        query = self.make(np.dtype(dtype), self.seed)
        return query._replace(o=query.o[::step], d=query.d[::step], light=query.light[::step])


class Placement(NamedTuple):
    """Scale and translation of a scene of unit size, which is rotated first."""

    size: float
    shift: float = 0.0
    share: float = 0.0  # in float32 the size is at least this share of the shift: smaller ones cannot be represented

    def put(self, points: ArrayLike, dtype: np.dtype) -> Reals:
        """Transform points and round them to a precision."""
        size = max(self.size, self.share * self.shift) if dtype == np.float32 else self.size
        return np.ascontiguousarray(turned(np.asarray(points, np.float64)) * size + self.shift, dtype)

    @property
    def name(self) -> str:
        """Short description, part of the name of a case."""
        return f"moved by {self.shift:.0e}" if self.shift else f"scale {self.size:.0e}"


class Aim(NamedTuple):
    """Positions before the placement, each (n, 3) or (3,)."""

    eye: ArrayLike
    target: ArrayLike  # the point on the mesh
    light: ArrayLike


def placed(placement: Placement, mesh: Mesh, aim: Aim, dark: bool, dtype: np.dtype) -> LightQuery:
    """Make the query of a scene at its placement."""
    eye, target, light = (placement.put(a, dtype) for a in np.broadcast_arrays(*aim))
    return LightQuery(placement.put(mesh[0], dtype), mesh[1], eye, target - eye, light, dark)


def floor() -> Mesh:
    """A floor of 128 triangles over [-1, 1]^2 in the plane z = 0."""
    vertices, faces = grid(8)
    return vertices / 4 - [1.0, 1.0, 0.0], faces


def plate(z: float) -> Mesh:
    """A plate of two triangles over [-2, 2]^2 at height z."""
    return np.array([[-2.0, -2, z], [2, -2, z], [2, 2, z], [-2, 2, z]]), np.array([[0, 1, 2], [0, 2, 3]])


def floor_points(seed: int) -> Doubles:
    """Points on the floor: half at random, half on edges and corners of its triangles."""
    points: Doubles = np.column_stack([uniform(seed, RAYS, 2) * 0.85, np.zeros(RAYS)])
    points[::2, 0] = np.round(points[::2, 0] * 4) / 4
    points[::4, 1] = np.round(points[::4, 1] * 4) / 4
    return points


def lights(seed: int, spread: ArrayLike, middle: ArrayLike) -> Doubles:
    """Positions of a few lights around a middle; the rays use them in turn."""
    return np.resize(uniform(seed + 2, LIGHTS, 3) * np.asarray(spread) + np.asarray(middle), (RAYS, 3))


def lit_floor(placement: Placement, dtype: np.dtype, seed: int) -> LightQuery:
    """Lights above a floor of squares."""
    light = lights(seed, [2, 2, 0.4], [0, 0, 0.6])
    return placed(placement, floor(), Aim([0.3, -0.2, 2.0], floor_points(seed), light), False, dtype)


def lit_sphere(placement: Placement, dtype: np.dtype, seed: int) -> LightQuery:
    """A sphere with lights at least 0.2 rad above the horizon of every point."""
    points = uniform(seed, RAYS, 3) + np.array([1.2, 1.3, 1.4])
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    light = lights(seed, [0.5, 0.5, 0.5], [3.0, 3.0, 3.0])
    return placed(placement, icosphere(2), Aim(points * 3, points * 0.9, light), False, dtype)


def wide(wall: bool, dtype: np.dtype, seed: int) -> LightQuery:
    """Points near the origin of a floor of two triangles, 200 wide; lit, or under a plate."""
    vertices, faces = plate(0.0)
    mesh = joined((vertices * 50, faces), *[(plate(200 * GAP)[0] * [50, 50, 1], faces)] * wall)
    points: Doubles = np.column_stack([uniform(seed, RAYS, 2), np.zeros(RAYS)])
    return placed(Placement(1.0), mesh, Aim([0.3, -0.2, -2.0], points, [0.4, 0.5, 1.0]), wall, dtype)


def under_plate(placement: Placement, dtype: np.dtype, seed: int) -> LightQuery:
    """A plate close above a floor; the camera is below the floor."""
    light = lights(seed, [2, 2, 0.4], [0, 0, 0.6])
    return placed(
        placement, joined(floor(), plate(GAP)), Aim([0.3, -0.2, -2.0], floor_points(seed), light), True, dtype
    )


def over_plate(placement: Placement, dtype: np.dtype, seed: int) -> LightQuery:
    """A light close above a plate, and a floor below the plate."""
    light = lights(seed, [0.5, 0.5, 0], [0, 0, 1 + GAP])
    return placed(placement, joined(floor(), plate(1.0)), Aim([0.3, -0.2, 0.7], floor_points(seed), light), True, dtype)


def on_ceiling(placement: Placement, dtype: np.dtype, seed: int) -> LightQuery:
    """Lights in the plane of a ceiling, up to rounding."""
    light = lights(seed, [0.5, 0.5, 0], [0, 0, 1])
    return placed(
        placement, joined(floor(), plate(1.0)), Aim([0.3, -0.2, 0.7], floor_points(seed), light), False, dtype
    )


def shadow_cases() -> Iterator[ShadowCase]:
    """All cases of shadow rays, in a fixed order."""
    sizes = [Placement(size) for size in (1e-12, 1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e9, 1e12)]
    lit, dark = "every point is lit", "no point is lit"
    for placement in (*sizes, *(Placement(1.0, shift, 1e-4) for shift in (1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7))):
        yield ShadowCase(f"lit floor, {placement.name}", 200, lit, partial(lit_floor, placement))
        yield ShadowCase(f"lit sphere, {placement.name}", 210, lit, partial(lit_sphere, placement))
    for placement in (*sizes, *(Placement(1.0, shift, 1e-1) for shift in (1e1, 1e4, 1e7))):
        wall = f"{dark}: a wall 1e-4 of the scene away"
        yield ShadowCase(
            f"wall at the floor, {placement.name}", 220, f"{wall} from them", partial(under_plate, placement)
        )
        yield ShadowCase(f"wall at the light, {placement.name}", 230, f"{wall} from it", partial(over_plate, placement))
        yield ShadowCase(f"light on a ceiling, {placement.name}", 240, lit, partial(on_ceiling, placement))
    yield ShadowCase("lit floor 200 wide", 250, lit, partial(wide, False))
    yield ShadowCase("wall at a floor 200 wide", 251, dark, partial(wide, True))
