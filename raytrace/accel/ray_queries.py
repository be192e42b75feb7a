"""``RayQueries``: the queries of ``BVH`` about rays; they check their arguments and run on several threads."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.accel import reorder
from raytrace.accel.batches import Pixels, image_width, whole_blocks
from raytrace.accel.bundle import BUNDLE
from raytrace.accel.inputs import check_rays, rays_of
from raytrace.accel.lanes import NODE, PACKET
from raytrace.accel.layout import aligned
from raytrace.accel.scratch import ROWS
from raytrace.parallel import MAX_RANGE, share_out
from raytrace.records import Hits, Tree, Work


class RayQueries:
    """Queries about rays; ``BVH`` adds the tree that they need."""

    tree: Tree
    triangles: NDArray[np.floating]  # (m, 12) f: v0, v1, v2 and the unit normal of each face
    levels: int
    grid: reorder.Grid

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
        n, width = math.prod(shape), image_width(shape, MAX_RANGE)
        size = dtype.itemsize
        memory = np.empty(n * (3 * size + 4), np.uint8)  # one block, which the allocator can reuse without new pages
        t, u, v = memory[: 3 * n * size].view(dtype).reshape(3, n)
        hits = Hits(t, memory[3 * n * size :].view(np.int32), u, v)
        unused: list[reorder.SortScratch] = []
        tree, grid = self.tree, self.grid  # of the whole query, even if another thread refits

        def trace(begin: int, end: int) -> None:
            part = Hits(*(column[begin:end] for column in hits))
            scratch = unused.pop() if unused else reorder.make_sort_scratch(min(MAX_RANGE, n), dtype, self.work())
            batch = Pixels(width, (end - begin) // width) if width else end - begin
            reorder.closest_hit(tree, grid, rays_of(rays, begin, end, dtype), part, batch, scratch)
            unused.append(scratch)

        share_out(trace, n, threads, whole_blocks(width))
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
        n, width = math.prod(shape), image_width(shape, MAX_RANGE)
        occluded = np.empty(n, np.bool_)
        unused: list[reorder.SortScratch] = []
        tree, grid = self.tree, self.grid  # of the whole query, even if another thread refits

        def trace(begin: int, end: int) -> None:
            part = occluded[begin:end]
            scratch = unused.pop() if unused else reorder.make_sort_scratch(min(MAX_RANGE, n), dtype, self.work())
            batch = Pixels(width, (end - begin) // width) if width else end - begin
            reorder.any_hit(tree, grid, rays_of(rays, begin, end, dtype), part, batch, scratch)
            unused.append(scratch)

        share_out(trace, n, threads, whole_blocks(width))
        return occluded.reshape(shape)

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
