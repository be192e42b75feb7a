"""``PointQueries``: the queries of ``BVH`` about points."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.accel import nearest
from raytrace.accel.closest_exact import ROWS
from raytrace.accel.inputs import check_points
from raytrace.accel.inside import check_closed, locate
from raytrace.accel.lanes import NODE
from raytrace.accel.layout import aligned
from raytrace.accel.point_order import PointOrder, make_point_order, sort_points
from raytrace.accel.ray_queries import RayQueries
from raytrace.parallel import MAX_RANGE, share_out
from raytrace.point_records import ClosestPoint
from raytrace.records import Columns


class PointQueries(RayQueries):
    """Queries about points; ``BVH`` adds the tree that they need."""

    def closest_point(self, points: ArrayLike, *, threads: int | None = None) -> ClosestPoint:
        """Return the point of the mesh that is closest to each point.

        Parameters
        ----------
        points : (..., 3) array_like, world units
            Rounded to the precision of the tree first. A single row (3,) gives answers of shape (1,).
        threads : int, optional
            Default: one per core that the process may use.

        Returns
        -------
        ClosestPoint
            ``p`` (..., 3), ``distance``, ``prim_id``, ``u``, ``v`` (...): p = (1 - u - v) v0 + u v1 + v v2. Where there
            is no closest point, ``prim_id`` is -1, ``p``, ``u`` and ``v`` are NaN; the distance is inf if no triangle
            has an area, and NaN if the point is not finite.

        Raises
        ------
        ValueError
            The last axis does not have length 3.

        Notes
        -----
        The distance is within 4 eps R of the exact one, where R is the largest distance from the point to a corner of
        the triangle, and p is within 4 eps R of the closest point of that triangle, before its coordinates are rounded.
        In nearly all cases both are the exact values, rounded once (docs/numerics.md). Of triangles at the same rounded
        distance, the one with the lowest ``prim_id`` is returned. The answer does not depend on the tree, the order of
        the points, or the number of threads. Triangles without area are ignored, as they are by rays; in a closed mesh
        their edges belong to other triangles too.

        Branch and bound over the tree, nearest box first, with certain bounds on every distance; the remaining
        triangles are computed in twice the precision of float64. Regions of a triangle are those of [Ericson2004]_.

        Examples
        --------
        >>> import raytrace as rt
        >>> bvh = rt.BVH([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        >>> found = bvh.closest_point([[0.25, 0.25, 2], [3, 0, 0]])
        >>> found.distance, found.p[1]
        (array([2., 2.], dtype=float32), array([1., 0., 0.], dtype=float32))
        """
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

    def signed_distance(self, points: ArrayLike, *, threads: int | None = None) -> NDArray[np.floating]:
        """Return the distance of each point from a closed mesh: negative inside, 0 on the surface, positive outside.

        Parameters
        ----------
        points : (..., 3) array_like, world units
            Rounded to the precision of the tree first. A single row (3,) gives an answer of shape (1,).
        threads : int, optional
            Default: one per core that the process may use.

        Returns
        -------
        (...) float array, world units
            The distance of ``closest_point``, with the sign of ``contains``. It is 0 only on the surface: where the
            distance of another point rounds to 0, the smallest normal number replaces it.

        Raises
        ------
        ValueError
            The mesh is not closed, or the last axis does not have length 3.

        Notes
        -----
        The sign comes from exact parity. So it is right however small the distance is, and needs no consistent
        orientation of the triangles. The scalar product with a pseudo-normal [Baerentzen2005]_ would cost less, but it
        needs a consistent orientation, and rounding decides its sign near the surface.

        Examples
        --------
        >>> import raytrace as rt
        >>> corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
        >>> bvh = rt.BVH(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
        >>> bvh.signed_distance([[0.125, 0.25, 0.25], [0.25, 0.25, -1], [0.5, 0.25, 0]])
        array([-0.125,  1.   ,  0.   ], dtype=float32)
        """
        rows, shape = point_rows(points)
        check_closed(self, "signed_distance")
        within, on = locate(self, rows, threads)
        distance = self.closest_point(rows, threads=threads).distance
        distance[(distance == 0) & ~on] = np.finfo(distance.dtype).smallest_normal
        distance[on] = 0
        return np.where(within & ~on, -distance, distance).reshape(shape)

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
    array = check_points(points)
    return array.reshape(-1, 3), array.shape[:-1]
