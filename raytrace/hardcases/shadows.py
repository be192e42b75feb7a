"""Shadow rays that break ray tracers: lit surfaces that must not be in their own shadow, and thin walls."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from raytrace.hardcases.meshes import Doubles, Mesh, grid, icosphere, joined, turned, uniform

Reals = NDArray[np.floating]
RAYS, LIGHTS = 200, 5  # a case
GAP = 1e-4  # thickness of walls, in sizes of the scene


class LightQuery(NamedTuple):
    """Rays that find points on a mesh, and a light for each, in the numbers of one precision."""

    vertices: Reals  # (v, 3), world units
    faces: NDArray[np.int64]  # (m, 3)
    o: Reals  # (n, 3), world units
    d: Reals  # (n, 3): the point looked for is at t = 1
    light: Reals  # (n, 3), world units
    dark: bool  # whether a wall keeps the light from every point; if not, nothing is in its way


class ShadowCase(NamedTuple):
    """Points and lights, made for a precision."""

    name: str
    seed: int
    must: str  # what must hold
    make: Callable[[np.dtype, int], LightQuery]  # (precision, seed)

    def query(self, dtype: DTypeLike, step: int = 1) -> LightQuery:
        """Make the case, or every ``step``-th ray of it."""
        made = self.make(np.dtype(dtype), self.seed)
        return made._replace(o=made.o[::step], d=made.d[::step], light=made.light[::step])


class Place(NamedTuple):
    """Where a scene of unit size is put, turned."""

    size: float
    shift: float = 0.0
    share: float = 0.0  # in float32 the size is at least this share of the shift: what it can hold

    def put(self, points: ArrayLike, dtype: np.dtype) -> Reals:
        """Points of the scene there, in the numbers of a precision."""
        size = max(self.size, self.share * self.shift) if dtype == np.float32 else self.size
        return np.ascontiguousarray(turned(np.asarray(points, np.float64)) * size + self.shift, dtype)

    @property
    def name(self) -> str:
        """Words for it."""
        return f"moved by {self.shift:.0e}" if self.shift else f"scale {self.size:.0e}"


def placed(
    place: Place, mesh: Mesh, points: tuple[ArrayLike, ArrayLike, ArrayLike], dark: bool, dtype: np.dtype
) -> LightQuery:
    """A scene in its place: eyes, points looked at and lights are (n, 3) or (3,)."""
    eye, target, light = (place.put(a, dtype) for a in np.broadcast_arrays(*points))
    return LightQuery(place.put(mesh[0], dtype), mesh[1], eye, target - eye, light, dark)


def floor() -> Mesh:
    """Triangles over [-1, 1]^2 in the plane z = 0."""
    vertices, faces = grid(8)
    return vertices / 4 - [1.0, 1.0, 0.0], faces


def plate(z: float) -> Mesh:
    """Two triangles over [-2, 2]^2 in a plane of that height."""
    return np.array([[-2.0, -2, z], [2, -2, z], [2, 2, z], [-2, 2, z]]), np.array([[0, 1, 2], [0, 2, 3]])


def floor_points(seed: int) -> Doubles:
    """Half of them anywhere, half on edges and corners of the floor's triangles."""
    points: Doubles = np.column_stack([uniform(seed, RAYS, 2) * 0.85, np.zeros(RAYS)])
    points[::2, 0] = np.round(points[::2, 0] * 4) / 4
    points[::4, 1] = np.round(points[::4, 1] * 4) / 4
    return points


def lights(seed: int, spread: ArrayLike, middle: ArrayLike) -> Doubles:
    """A few positions about a middle, for each ray the next one."""
    return np.resize(uniform(seed + 2, LIGHTS, 3) * np.asarray(spread) + np.asarray(middle), (RAYS, 3))


def lit_floor(place: Place, dtype: np.dtype, seed: int) -> LightQuery:
    """Lights over a floor of squares."""
    light = lights(seed, [2, 2, 0.4], [0, 0, 0.6])
    return placed(place, floor(), ([0.3, -0.2, 2.0], floor_points(seed), light), False, dtype)


def lit_sphere(place: Place, dtype: np.dtype, seed: int) -> LightQuery:
    """Light from at least 0.2 rad over the horizon of every point."""
    points = uniform(seed, RAYS, 3) + np.array([1.2, 1.3, 1.4])
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    light = lights(seed, [0.5, 0.5, 0.5], [3.0, 3.0, 3.0])
    return placed(place, icosphere(2), (points * 3, points * 0.9, light), False, dtype)


def wide(wall: bool, dtype: np.dtype, seed: int) -> LightQuery:
    """Points near the origin of a floor of two triangles 200 wide, lit, or under a plate."""
    vertices, faces = plate(0.0)
    mesh = joined((vertices * 50, faces), *[(plate(200 * GAP)[0] * [50, 50, 1], faces)] * wall)
    points: Doubles = np.column_stack([uniform(seed, RAYS, 2), np.zeros(RAYS)])
    return placed(Place(1.0), mesh, ([0.3, -0.2, -2.0], points, [0.4, 0.5, 1.0]), wall, dtype)


def under_plate(place: Place, dtype: np.dtype, seed: int) -> LightQuery:
    """A plate close over a floor, which is seen from below."""
    light = lights(seed, [2, 2, 0.4], [0, 0, 0.6])
    return placed(place, joined(floor(), plate(GAP)), ([0.3, -0.2, -2.0], floor_points(seed), light), True, dtype)


def over_plate(place: Place, dtype: np.dtype, seed: int) -> LightQuery:
    """A light close over a plate, and a floor under it."""
    light = lights(seed, [0.5, 0.5, 0], [0, 0, 1 + GAP])
    return placed(place, joined(floor(), plate(1.0)), ([0.3, -0.2, 0.7], floor_points(seed), light), True, dtype)


def on_ceiling(place: Place, dtype: np.dtype, seed: int) -> LightQuery:
    """Lights in the plane of a ceiling, as nearly as numbers are."""
    light = lights(seed, [0.5, 0.5, 0], [0, 0, 1])
    return placed(place, joined(floor(), plate(1.0)), ([0.3, -0.2, 0.7], floor_points(seed), light), False, dtype)


def shadow_cases() -> Iterator[ShadowCase]:
    """All cases, in their order."""
    sizes = [Place(size) for size in (1e-12, 1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e9, 1e12)]
    lit, dark = "every point sees the light", "no point sees the light"
    for place in (*sizes, *(Place(1.0, shift, 1e-4) for shift in (1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7))):
        yield ShadowCase(f"lit floor, {place.name}", 200, lit, partial(lit_floor, place))
        yield ShadowCase(f"lit sphere, {place.name}", 210, lit, partial(lit_sphere, place))
    for place in (*sizes, *(Place(1.0, shift, 1e-1) for shift in (1e1, 1e4, 1e7))):
        wall = f"{dark}: a wall 1e-4 of the scene away"
        yield ShadowCase(f"wall at the floor, {place.name}", 220, f"{wall} from them", partial(under_plate, place))
        yield ShadowCase(f"wall at the light, {place.name}", 230, f"{wall} from it", partial(over_plate, place))
        yield ShadowCase(f"light on a ceiling, {place.name}", 240, lit, partial(on_ceiling, place))
    yield ShadowCase("lit floor 200 wide", 250, lit, partial(wide, False))
    yield ShadowCase("wall at a floor 200 wide", 251, dark, partial(wide, True))
