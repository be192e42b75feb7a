"""``RayQueries``: the queries of ``BVH`` about rays; they check their arguments and run on several threads."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.accel import reorder, runs
from raytrace.accel.batches import Pixels, image_width, whole_blocks
from raytrace.accel.bundle import BUNDLE
from raytrace.accel.hit_lists import HitTracer, count_all, list_all
from raytrace.accel.inputs import Field, check_rays, rays_of
from raytrace.accel.inside import Closure, check_closed, inside
from raytrace.accel.lanes import NODE, PACKET
from raytrace.accel.layout import aligned
from raytrace.accel.pool_scratch import make_pool
from raytrace.accel.raster import field_in_rows, width_of_list
from raytrace.accel.scratch import ROWS
from raytrace.parallel import MAX_RANGE, share_out
from raytrace.records import AllHits, Hits, Tree
from raytrace.work_records import PoolWork, Work


class RayQueries:
    """Queries about rays; ``BVH`` adds the tree that they need."""

    tree: Tree
    triangles: NDArray[np.floating]  # (m, 12) f: v0, v1, v2 and the unit normal of each face
    vertices: NDArray[np.floating]  # (v, 3) f
    faces: NDArray[np.int32]  # (m, 3)
    levels: int
    divided: bool  # whether large triangles lie in several leaves
    grid: reorder.Grid
    _closure: Closure | None = None  # what ``contains`` knows of the mesh

    def closest_hit(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        tmin: ArrayLike = 0.0,
        tmax: ArrayLike = np.inf,
        threads: int | None = None,
    ) -> Hits:
        """Return the nearest hit of each ray.

        Parameters
        ----------
        origins, directions : (..., 3) array_like, world units
            Directions may have any length.
        tmin, tmax : (...) array_like, units of the direction
            Open interval in which a hit counts.
        threads : int, optional
            Default: one per core that the process may use.

        Returns
        -------
        Hits
            ``t`` (inf for a miss), ``prim_id`` (-1), ``u``, ``v``: (...) arrays, p = (1 - u - v) v0 + u v1 + v v2.

        Raises
        ------
        ValueError
            Shapes that do not match.

        Notes
        -----
        The shapes ``...`` broadcast by NumPy's rules: (h, w, 3) directions, one (3,) origin and a tmax of
        shape (w,) give (h, w) hits. Single rows (3,) alone give hits of shape (1,).

        Examples
        --------
        >>> import raytrace as rt
        >>> bvh = rt.BVH([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        >>> bvh.closest_hit([0.25, 0.25, 1], [[0, 0, -1], [0, 0, 1]]).t
        array([ 1., inf], dtype=float32)
        """
        dtype = self.triangles.dtype
        rays, shape = check_rays(origins, directions, tmin, tmax, dtype)
        n, (width, field) = math.prod(shape), self._order(rays, shape)
        size = dtype.itemsize
        memory = np.empty(n * (3 * size + 4), np.uint8)  # one block, which the allocator can reuse without new pages
        t, u, v = memory[: 3 * n * size].view(dtype).reshape(3, n)
        hits = Hits(t, memory[3 * n * size :].view(np.int32), u, v)
        unused: list[reorder.SortScratch] = []
        tree, grid = self.tree, self.grid  # of the whole query, even if another thread refits

        def trace(begin: int, end: int) -> None:
            part = Hits(*(column[begin:end] for column in hits))
            scratch = unused.pop() if unused else self._scratch(n)
            taken = rays_of(rays, begin, end, dtype)
            if field is None:
                batch = Pixels(width, (end - begin) // width) if width else end - begin
                reorder.closest_hit(tree, grid, taken, part, batch, scratch)
            else:
                runs.closest_hit(tree, grid, taken, part, runs.Runs(end - begin, field), scratch)
            unused.append(scratch)

        share_out(trace, n, threads, whole_blocks(width))
        reorder.return_sort_scratch(dtype, unused)
        return Hits(*(column.reshape(shape) for column in hits))

    def any_hit(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        tmin: ArrayLike = 0.0,
        tmax: ArrayLike = np.inf,
        threads: int | None = None,
    ) -> NDArray[np.bool_]:
        """Return whether each ray hits anything; the parameters are those of ``closest_hit``.

        Returns
        -------
        (...) bool array

        Examples
        --------
        >>> import raytrace as rt
        >>> bvh = rt.BVH([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        >>> bvh.any_hit([0.25, 0.25, 1], [0, 0, -1], tmax=[0.5, 2])
        array([False,  True])
        """
        dtype = self.triangles.dtype
        rays, shape = check_rays(origins, directions, tmin, tmax, dtype)
        n, (width, field) = math.prod(shape), self._order(rays, shape)
        occluded = np.empty(n, np.bool_)
        unused: list[reorder.SortScratch] = []
        tree, grid = self.tree, self.grid  # of the whole query, even if another thread refits

        def trace(begin: int, end: int) -> None:
            part = occluded[begin:end]
            scratch = unused.pop() if unused else self._scratch(n)
            taken = rays_of(rays, begin, end, dtype)
            if field is None:
                batch = Pixels(width, (end - begin) // width) if width else end - begin
                reorder.any_hit(tree, grid, taken, part, batch, scratch)
            else:
                runs.any_hit(tree, grid, taken, part, runs.Runs(end - begin, field), scratch)
            unused.append(scratch)

        share_out(trace, n, threads, whole_blocks(width))
        reorder.return_sort_scratch(dtype, unused)
        return occluded.reshape(shape)

    def all_hits(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        tmin: ArrayLike = 0.0,
        tmax: ArrayLike = np.inf,
        *,
        crossings: bool = False,
        threads: int | None = None,
    ) -> AllHits:
        """Return all hits of each ray, sorted by t, then by ``prim_id``.

        Parameters
        ----------
        origins, directions, tmin, tmax, threads
            Those of ``closest_hit``. The interval is tested on the rounded t.
        crossings : bool
            False: every triangle that holds a point of the ray is reported, also at its edges and corners, so a ray
            through an edge hits two triangles there. The first hit is that of ``closest_hit``.
            True: every crossing of a closed surface counts once, whichever edges and vertices the ray meets, so that
            the parity of their number is exact: odd if the origin is inside. Where the surface folds over the ray,
            any number of the right parity may be reported. With ``tmin=0``, whether a crossing lies beyond the origin
            is decided exactly. If the mesh is not closed, the parity means nothing.

        Returns
        -------
        AllHits
            ``t``, ``prim_id``, ``u``, ``v``: (k,) arrays; ``start``: (n + 1,) int64. The hits of ray i, in C
            order, are rows ``start[i]`` to ``start[i + 1]``.

        Raises
        ------
        ValueError
            Shapes that do not match.
        MemoryLimitError
            There is no memory for so many hits; the message has their number. It is a ``ValueError`` too.

        Examples
        --------
        >>> import raytrace as rt
        >>> bvh = rt.BVH([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]], [[0, 1, 2], [3, 4, 5]])
        >>> hits = bvh.all_hits([[0.25, 0.25, 2], [0.25, 0.25, 0.5], [2, 2, 2]], [0, 0, -1])
        >>> hits.start.tolist(), hits.prim_id.tolist(), hits.t.tolist()
        ([0, 2, 3, 3], [1, 0, 0], [1.0, 2.0, 0.5])
        """
        rays, shape = check_rays(origins, directions, tmin, tmax, self.triangles.dtype)
        n = math.prod(shape)
        return list_all(HitTracer(self, rays, n, crossings), n, threads)

    def count_hits(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        tmin: ArrayLike = 0.0,
        tmax: ArrayLike = np.inf,
        *,
        crossings: bool = False,
        threads: int | None = None,
    ) -> NDArray[np.int32]:
        """Return how many hits each ray has; the parameters are those of ``all_hits``.

        Returns
        -------
        (...) int32 array

        Examples
        --------
        >>> import raytrace as rt
        >>> bvh = rt.BVH([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
        >>> bvh.count_hits([0.5, 0.5, 1], [0, 0, -1])  # through the edge that both share
        array([2], dtype=int32)
        >>> bvh.count_hits([0.5, 0.5, 1], [0, 0, -1], crossings=True)
        array([1], dtype=int32)
        """
        rays, shape = check_rays(origins, directions, tmin, tmax, self.triangles.dtype)
        n = math.prod(shape)
        return count_all(HitTracer(self, rays, n, crossings), n, threads).reshape(shape)

    def contains(self, points: ArrayLike, threads: int | None = None) -> NDArray[np.bool_]:
        """Return whether each point lies inside a closed mesh, or on its surface.

        A point is inside if a ray from it crosses the surface an odd number of times. The number is exact, also where
        the ray meets edges and vertices. The orientation of the triangles does not matter. Where closed bodies overlap,
        a point in two of them is outside.

        Parameters
        ----------
        points : (..., 3) array_like, world units
            Rounded to the precision of the tree. Points that are not finite are outside.
        threads : int, optional
            Default: one per core that the process may use.

        Returns
        -------
        (...) bool array

        Raises
        ------
        ValueError
            The mesh is not closed; the message counts the open edges and names the first. A mesh is closed if every
            edge whose two ends differ is a side of an even number of triangles. Edges are matched by the exact
            positions of their ends, so meshes with duplicate vertices, as from STL files, are closed too.

        Examples
        --------
        >>> import raytrace as rt
        >>> corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
        >>> bvh = rt.BVH(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
        >>> bvh.contains([[0.1, 0.1, 0.1], [0.5, 0.5, 0.5], [0.5, 0.5, 0]])
        array([ True, False,  True])
        """
        check_closed(self, "contains")
        return inside(self, points, threads)

    def _order(self, rays: list[Field], shape: tuple[int, ...]) -> tuple[int, int | None]:
        """Return the width of the image whose rays are to be traced in blocks, or 0; and the field to sort runs by."""
        if len(shape) > 1:
            return image_width(shape, MAX_RANGE), None
        width = width_of_list(self.tree, rays, shape[0], MAX_RANGE)
        return width, None if width else field_in_rows(self.tree, rays, shape[0])

    def _scratch(self, n: int) -> reorder.SortScratch:
        """Return scratch memory for one thread, which traces up to n rays in ranges."""
        return reorder.borrow_sort_scratch(min(MAX_RANGE, n), self.triangles.dtype, self.pool_work())

    def work(self) -> Work:
        """Allocate scratch memory for one thread."""
        height = (NODE - 1) * self.levels + 2
        dtype = self.triangles.dtype
        stack = np.empty(height, dtype), np.empty(height, np.int32), np.empty(height, np.int32)
        return Work(
            *stack,
            aligned((BUNDLE + 1) * ROWS * PACKET, dtype),
            aligned((BUNDLE + 1) * PACKET, np.dtype(np.int32)),
            np.zeros(2, np.int64),
        )

    def pool_work(self) -> PoolWork:
        """Allocate scratch memory for one thread and rays that may be scattered."""
        return PoolWork(*self.work(), *make_pool((NODE - 1) * self.levels + 2, self.triangles.dtype))
