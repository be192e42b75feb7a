"""All lights of a scene in one table, drawn by power: point, spot and directional lights, lamps and the environment."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.bvh import BVH
from raytrace.accel.hit_points import gamma
from raytrace.passes.film import LUMINANCE
from raytrace.passes.light import SPAN, triangles_at
from raytrace.passes.lights import (
    AXIS,
    BEAM,
    COLUMNS,
    CUTOFF,
    DENSITY,
    DIRECTIONAL,
    ENVIRONMENT,
    NUDGE,
    PLACE,
    POINT,
    SPOT,
    TOWARDS,
    TRIANGLE,
)
from raytrace.passes.path_records import LightTable
from raytrace.records import Scene


class Rows(NamedTuple):
    """Lights of one kind."""

    kind: int
    power: NDArray[np.float64]  # (l,) W, luminance: what they are drawn by
    colour: NDArray[np.float64]  # (l, 3): radiance, intensity or irradiance
    columns: dict[int, NDArray[np.float64]]  # (l,) or (l, 3) by the first column of the table's numbers
    prim_id: NDArray[np.int64]  # (l,)


def make_light_table(scene: Scene, bvh: BVH) -> LightTable | None:
    """All lights that send out any light; None where there are none.

    A light's probability is its share of the power of all: pi A L for a lamp, Phi for a point light, the integral of
    its intensity for a spot, and pi R^2 E for light from infinitely far away, R the radius of the scene. The table
    holds the probability with which a kernel draws it, which differs a little: random numbers have a last bit.
    """
    dtype = bvh.triangles.dtype
    rows = [each for each in _rows(scene, bvh) if each.power.sum() > 0]
    if not rows:
        return None
    power = np.concatenate([each.power for each in rows])
    kept = power > 0
    keep, other = alias_table(power[kept] / power.sum())
    shares = np.zeros(len(power))
    shares[kept] = drawn(keep.astype(dtype), other)
    numbers = np.zeros((len(power), COLUMNS))
    begin = 0
    for each in rows:
        part = numbers[begin : begin + len(each.power)]
        part[:, :3] = each.colour
        for first, values in each.columns.items():
            part[:, first : first + (values.shape[1] if values.ndim == 2 else 1)] = values.reshape(len(part), -1)
        if each.kind in (TRIANGLE, ENVIRONMENT):
            part[:, DENSITY] *= shares[begin : begin + len(part)]
        begin += len(part)
    kinds = np.repeat([each.kind for each in rows], [len(each.power) for each in rows])
    prims = np.concatenate([each.prim_id for each in rows])
    return LightTable(
        shares[kept].astype(dtype),
        keep.astype(dtype),
        other.astype(np.int32),
        kinds[kept].astype(np.int32),
        prims[kept].astype(np.int32),
        numbers[kept].astype(dtype).ravel(),
    )


def alias_table(shares: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Probability that a row drawn evenly is kept, and the row that is taken instead [Walker1977, Vose1991].

    Examples
    --------
    >>> alias_table(np.array([0.5, 0.25, 0.25]))
    (array([1.  , 0.75, 0.75]), array([0, 0, 0]))
    """
    n = len(shares)
    keep, other = shares * n, np.arange(n)
    small, large = [*np.flatnonzero(keep < 1)[::-1]], [*np.flatnonzero(keep >= 1)[::-1]]
    while small and large:
        row, donor = small.pop(), large[-1]
        other[row] = donor
        keep[donor] -= 1 - keep[row]
        if keep[donor] < 1:
            small.append(large.pop())
    keep[[*small, *large]] = 1  # what rounding left
    return keep, other


def drawn(keep: NDArray[np.floating], other: NDArray[np.int64]) -> NDArray[np.float64]:
    """Probability of each row as kernels draw it: by 32 random bits for the row, and 24 for whether it is kept.

    Row k has the 32 bits h with h n / 2^32 in [k, k + 1). It is kept by those multiples of 2^-24 that are below keep.

    Examples
    --------
    >>> drawn(np.array([1.0, 1e-9]), np.array([0, 0]))[1] * 2**25
    np.float64(1.0)
    """
    n = len(keep)
    of_rows = np.diff(-(-(np.arange(n + 1, dtype=np.int64) << 32) // n)) / 2.0**32
    kept = np.ceil(keep.astype(np.float64) * 2.0**24) / 2.0**24
    return of_rows * kept + np.bincount(other, of_rows * (1 - kept), minlength=n)


def _rows(scene: Scene, bvh: BVH) -> list[Rows]:
    lights = scene.lights
    luminance = np.array(LUMINANCE)
    rows = []
    if len(lights.flux):
        power, nudge = lights.flux @ luminance, _nudges(bvh, lights.position)
        intensity = lights.flux / (4 * np.pi)
        rows.append(Rows(POINT, power, intensity, {PLACE: lights.position, NUDGE: nudge}, _zeros(power)))
    if lights.spots is not None:
        spots = lights.spots
        power = spots.intensity @ luminance * spot_angle(spots.cutoff, spots.beam)
        columns = {PLACE: spots.position, AXIS: spots.axis, CUTOFF: spots.cutoff, BEAM: spots.beam}
        columns[NUDGE] = _nudges(bvh, spots.position)
        rows.append(Rows(SPOT, power, spots.intensity, columns, _zeros(power)))
    disc = np.pi * _radius(scene) ** 2
    if lights.directions is not None:
        power = disc * (lights.directions.irradiance @ luminance)
        columns = {TOWARDS: -lights.directions.direction}
        rows.append(Rows(DIRECTIONAL, power, lights.directions.irradiance, columns, _zeros(power)))
    if lights.environment is not None:
        power = np.array([disc * np.pi * (lights.environment @ luminance)])
        columns = {DENSITY: np.array([1 / (4 * np.pi)])}
        rows.append(Rows(ENVIRONMENT, power, lights.environment[None], columns, _zeros(power)))
    if scene.materials.emission is not None:
        prims, area = emitting(scene, bvh)
        colour = scene.materials.emission[scene.mesh.material_id[prims]]
        rows.append(Rows(TRIANGLE, np.pi * area * (colour @ luminance), colour, {DENSITY: 1 / area}, prims))
    return rows


def _zeros(power: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.zeros(len(power), np.int64)


def emitting(scene: Scene, bvh: BVH) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Triangles that emit and have an area in the precision of the tree, and their areas."""
    assert scene.materials.emission is not None
    emits = np.any(scene.materials.emission > 0, axis=1)
    lamps = emits.take(scene.mesh.material_id) & np.isfinite(bvh.triangles[:, 9])
    prims = np.flatnonzero(lamps)
    corners = bvh.triangles[prims, :9].astype(np.float64).reshape(-1, 3, 3)
    edges = corners[:, 1:] - corners[:, :1]
    return prims, 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)


def spot_angle(cutoff: NDArray[np.float64], beam: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solid angle of a spot, weighted by its falloff, sr.

    2 pi times the integral of sin(a) f(a), f = 1 up to b and (c - a) / (c - b) from b to c: the second part by parts is
    cos b - (sin c - sin b) / (c - b).
    """
    wide = cutoff - beam
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = np.where(wide > 0, (np.sin(cutoff) - np.sin(beam)) / wide, np.cos(cutoff))
    return 2 * np.pi * (1 - slope)


def _radius(scene: Scene) -> float:
    """Half the diagonal of the scene's bounding box, world units; 1 for a single point, which the sky lights too."""
    return float(np.linalg.norm(np.ptp(scene.mesh.vertices, axis=0))) / 2 or 1.0


def _nudges(bvh: BVH, positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far lights that lie on a surface are moved off it: twice the distance at which ``triangles_at`` finds it.

    The light may lie that far behind the surface, and must then lie as far in front of it [docs/numerics.md].
    """
    nudges = np.zeros((len(positions), 3))
    roundings = 2 * gamma(np.finfo(bvh.triangles.dtype).eps)
    for row, position in enumerate(positions.astype(bvh.triangles.dtype)):
        for prim in triangles_at(bvh.tree, bvh.triangles, position)[:1]:
            normal = bvh.triangles[prim, 9:].astype(np.float64)
            extent = np.ptp(np.append(bvh.triangles[:, :9].ravel(), position).reshape(-1, 3), axis=0)
            largest = np.abs(bvh.triangles[prim, :9].reshape(3, 3)).max(axis=0)
            nudges[row] = normal * (roundings * np.abs(normal) @ (largest + np.abs(position) + SPAN * extent))
    return nudges
