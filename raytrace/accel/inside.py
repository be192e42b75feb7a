"""Points inside a closed mesh: from each, a ray counts the crossings of the surface."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.accel.closed import OpenEdges, open_edges
from raytrace.accel.hit_lists import HitTracer, count_all
from raytrace.accel.hit_work import MARKED
from raytrace.accel.inputs import check_points, check_rays

if TYPE_CHECKING:
    from raytrace.accel.ray_queries import RayQueries

TILT = 0.0137, 0.0071  # of the direction from its axis: few meshes have edges or faces along it, which would be slower


class Closure(NamedTuple):
    """What is known of a mesh once a query has asked whether points are inside it."""

    vertices: NDArray[np.floating]  # those for which it holds
    edges: OpenEdges
    direction: NDArray[np.float64]  # (3,): along which few triangles are crossed


def closure_of(bvh: "RayQueries") -> Closure:
    """Return the open edges of a mesh and the direction for rays; computed once for its vertices."""
    known = bvh._closure
    if known is None or known.vertices is not bvh.vertices:
        known = Closure(bvh.vertices, open_edges(bvh.vertices, bvh.faces), few_crossings(bvh))
        bvh._closure = known
    return known


def few_crossings(bvh: "RayQueries") -> NDArray[np.float64]:
    """Direction close to the axis along which a line crosses the fewest triangles on average."""
    corners = bvh.triangles[:, :9].reshape(-1, 3, 3).astype(np.float64)
    low, high = np.float64(bvh.tree.extent[:3]), np.float64(bvh.tree.extent[3:6])
    with np.errstate(all="ignore"):
        areas = np.abs(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])).sum(axis=0)
        across = np.prod(high - low) / (high - low)
        crossings = np.where(across > 0, areas / across, np.inf)
    return np.roll([*TILT, 1.0], int(np.argmin(crossings)) - 2)


def check_closed(bvh: "RayQueries", what: str) -> None:
    """Raise a ValueError if a mesh is not closed; ``what`` is the name of the query that needs it."""
    edges = closure_of(bvh).edges
    if edges.first is None:
        return
    several = f"{edges.count:,} edges are" if edges.count > 1 else "1 edge is"
    start, end = (f"({', '.join(f'{float(x):.9g}' for x in point)})" for point in edges.first)
    raise ValueError(
        f"{what}: the mesh is not closed: {several} a side of an odd number of triangles; the first is the edge from "
        f"{start} to {end} of triangle {edges.triangle}; fill the holes first"
    )


def inside(bvh: "RayQueries", points: ArrayLike, threads: int | None) -> NDArray[np.bool_]:
    """Return for each point whether it lies in the interior or on the surface of a closed mesh."""
    return locate(bvh, points, threads)[0]


def locate(bvh: "RayQueries", points: ArrayLike, threads: int | None) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return for each point whether it lies in the interior or on the surface, and whether on the surface."""
    given = check_points(points)
    shape = given.shape[:-1]
    if len(bvh.faces) == 0:
        return np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)
    with np.errstate(over="ignore"):
        rows = given.reshape(-1, 3).astype(bvh.triangles.dtype, copy=False)
    low, high = bvh.tree.extent[:3], bvh.tree.extent[3:6]
    near = np.ones(len(rows), np.bool_)
    for axis in range(3):
        near &= (rows[:, axis] >= low[axis]) & (rows[:, axis] <= high[axis])  # False where a coordinate is NaN
    within, on = np.zeros((2, len(rows)), np.bool_)
    chosen = rows if near.all() else rows[near]
    if len(chosen) > 0:
        count = len(chosen)
        fields, _ = check_rays(chosen, closure_of(bvh).direction, 0.0, np.inf, bvh.triangles.dtype)
        counts = count_all(HitTracer(bvh, fields, count, crossings=True, surface=True), count, threads)
        within[near], on[near] = (counts & (1 | MARKED)) != 0, (counts & MARKED) != 0
    return within.reshape(shape), on.reshape(shape)
