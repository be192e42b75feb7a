"""``PointQueries``: the queries of ``BVH`` about points."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.accel import nearest
from raytrace.accel.closest_exact import ROWS
from raytrace.accel.inputs import _numbers
from raytrace.accel.lanes import NODE
from raytrace.accel.layout import aligned
from raytrace.accel.point_order import PointOrder, make_point_order, sort_points
from raytrace.accel.ray_queries import RayQueries
from raytrace.parallel import MAX_RANGE, share_out
from raytrace.records import ClosestPoint, Columns


class PointQueries(RayQueries):
    """Queries about points; ``BVH`` adds the tree that they need."""

    def closest_point(self, points: ArrayLike, *, threads: int | None = None) -> ClosestPoint:
        dtype = self.triangles.dtype
        rows, shape = point_rows(points)
        n = len(rows)
        found = ClosestPoint(
            np.empty((n, 3), dtype), np.empty(n, dtype), np.empty(n, np.int32), np.empty(n, dtype), np.empty(n, dtype)
        )
        unused: list[tuple[PointOrder, nearest.PointWork]] = []

        def search(begin: int, end: int) -> None:
            scratch = unused.pop() if unused else (make_point_order(min(MAX_RANGE, n)), self.point_work())
            order, work = scratch
            with np.errstate(over="ignore"):
                flat = np.require(rows[begin:end], dtype, ["C", "A", "W"]).reshape(-1)
            row = sort_points(Columns(flat, 0, 3, 1), end - begin, self.grid, order)
            part = ClosestPoint(*(column[begin:end] for column in found))
            part = part._replace(p=part.p.reshape(-1))
            nearest.closest_points(self.tree, flat, order.numbers[row], part, end - begin, work)
            unused.append(scratch)

        share_out(search, n, threads)
        return ClosestPoint(found.p.reshape(*shape, 3), *(column.reshape(shape) for column in found[1:]))

    def point_work(self) -> nearest.PointWork:
        """Allocate scratch memory for one thread."""
        dtype, places = self.triangles.dtype, nearest.CANDIDATES + NODE
        return nearest.PointWork(
            self.work(),
            np.empty(places, dtype),
            np.empty(places, np.int32),
            np.zeros(1, np.int64),
            aligned(ROWS * NODE, np.dtype(np.float64)),
            np.empty(1, dtype),
            np.empty(6, dtype),
            np.empty(2, np.int32),
        )


def point_rows(points: ArrayLike) -> tuple[NDArray[np.number], tuple[int, ...]]:
    """Return points as (n, 3) rows of any dtype, and their leading shape."""
    array = _numbers("points", points)
    if array.shape == (0,):
        array = array.reshape(0, 3)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ValueError(f"points: expected an (..., 3) array, got shape {array.shape}")
    shape = array.shape[:-1] or (1,)
    return array.reshape(-1, 3), shape
