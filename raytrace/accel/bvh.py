"""``BVH``: the public class: a mesh, its tree, and statistics; its queries about rays are in ``ray_queries``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from raytrace.accel import reorder
from raytrace.accel.build import LEAVES, SMALL_MESH, build
from raytrace.accel.grow import SPLITS
from raytrace.accel.hit_points import blend, error_scale, gamma
from raytrace.accel.inputs import MeshLike, check_faces, check_vertices, mesh_arrays, one_of
from raytrace.accel.point_queries import PointQueries
from raytrace.accel.validate import TreeStats, tree_problems, tree_stats
from raytrace.records import Hits, Surface

if TYPE_CHECKING:
    from raytrace.accel.refit import Built


class BVH(PointQueries):
    """Bounding volume hierarchy over a triangle mesh: nearest hits and occlusion for batches of rays.

    Parameters
    ----------
    vertices : (v, 3) array_like of float, world units
        Or a mesh: any object with ``vertices`` and ``faces``, such as a ``trimesh.Trimesh``. Then omit ``faces``.
    faces : (m, 3) array_like of int
        Rows of ``vertices``, counter-clockwise seen from the front.
    precision : {"float32", "float64"}
        Precision of the tree, the rays and the results.
    split : {"sah", "median"}
        How the tree is built: by the binned surface area heuristic [Wald2007]_, or by halves of equal count.
    triangle : {"watertight", "moller-trumbore"}
        The triangle test: [Woop2013]_ with exact ties and distances from the plane, or [Moller1997]_ with the absolute
        threshold |det| < 1e-5 of a course framework, kept for comparison.

    Raises
    ------
    ValueError
        Wrong shapes, vertices that are not finite, indices out of range, or unknown options.

    Notes
    -----
    A hit counts if its t lies in the open interval (tmin, tmax). At equal t the lowest ``prim_id`` is returned, so that
    the result never depends on the tree, the batch or the thread. Triangles without area are never hit. Rays that are
    not finite or have no direction hit nothing.

    Areas and their rounding errors must be normal numbers. So the largest coordinate of a mesh must lie between 3e-16
    and 1e18 in float32, or between 1e-146 and 8e152 in float64; other meshes raise a ``ValueError``.

    Rays may be arrays of any type and layout. Arrays of the tree's type are read in place. Others are converted in
    pieces, so that no memory for a second copy is needed. A ``BVH`` can be shared by threads, copied, pickled and used
    after a fork. Ctrl-C ends a query without a result.

    Examples
    --------
    >>> import raytrace as rt
    >>> bvh = rt.BVH([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> bvh.closest_hit([[0.25, 0.25, 1]], [[0, 0, -2]])
    Hits(t=array([0.5], dtype=float32), prim_id=array([0], dtype=int32), u=array([0.25], dtype=float32), v=array([0.25], dtype=float32))
    """  # noqa: E501

    _as_built: Built | None = None  # what ``refit`` keeps of the tree

    def __init__(
        self,
        vertices: ArrayLike | MeshLike,
        faces: ArrayLike | None = None,
        precision: str = "float32",
        split: str = "sah",
        triangle: str = "watertight",
    ) -> None:
        one_of("precision", precision, ("float32", "float64"))
        one_of("split", split, SPLITS)
        one_of("triangle", triangle, LEAVES)
        self.precision, self.split, self.triangle = precision, split, triangle
        points, corners = mesh_arrays(vertices, faces)
        self.vertices = check_vertices(points, np.dtype(precision))
        self.faces = check_faces(corners, len(self.vertices))
        self.tree, self.triangles, self.levels, self.divided = build(self.vertices, self.faces, split, triangle)
        self.grid = reorder.make_grid(self.tree)

    def __repr__(self) -> str:
        return f"<BVH of {len(self.faces)} triangles, {self.precision}, {self.split}, {self.triangle}>"

    def refit(self, vertices: ArrayLike) -> None:
        """Move the vertices: the same faces and the same tree, with new boxes. Much faster than a new ``BVH``.

        Parameters
        ----------
        vertices : (v, 3) array_like of float, world units
            As many as the mesh has, in the same order.

        Raises
        ------
        ValueError
            As for a new ``BVH``, or another number of vertices. The tree is unchanged then.

        Notes
        -----
        The answers of all queries are bit-identical to those of a new tree of the moved mesh, because they do not
        depend on the tree. Only the time does: where parts of the mesh move apart, boxes grow and overlap.
        ``stats.growth`` is the factor by which the expected cost of a ray has grown since the tree was built. Build a
        new tree where it exceeds about 1.5 and many rays follow; see [Wald2007]_ for the cost.

        Triangles without area are not in the tree. If a triangle of the mesh had no area when the tree was built, and
        now has one, the tree is built anew. So is that of a mesh of at most 64 triangles.

        Do not refit while another thread queries the tree. Nothing is written to the arrays of the old tree, so
        shallow copies of the ``BVH`` keep it.

        Examples
        --------
        >>> import raytrace as rt
        >>> bvh = rt.BVH([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        >>> bvh.refit([[0, 0, -3], [1, 0, -3], [0, 1, -3]])
        >>> bvh.closest_hit([0.25, 0.25, 1], [0, 0, -1]).t
        array([4.], dtype=float32)
        """
        points = check_vertices(vertices, self.vertices.dtype)
        if len(points) != len(self.vertices):
            raise ValueError(
                f"vertices: expected {len(self.vertices)} rows, as many as the mesh has, got {len(points)}; "
                "for another mesh, make a new BVH"
            )
        as_built, levels, moved, divided = self._as_built, self.levels, None, False
        if len(self.faces) > SMALL_MESH:
            from raytrace.accel import refit  # not needed where nothing moves

            if self.divided:
                *moved, levels, as_built = refit.built_whole(self.tree, points, self.faces)
            else:
                as_built = as_built or refit.built(self.tree, len(self.faces))
                moved = refit.refit(self.tree, as_built, points, self.faces)
        if moved is None:
            *moved, levels, divided = build(points, self.faces, self.split, self.triangle)
            as_built = None
        grid = reorder.make_grid(moved[0])
        self.vertices, (self.tree, self.triangles), self.levels, self.grid = points, moved, levels, grid
        self._as_built, self.divided = as_built, divided
        self.__dict__.pop("_closure", None)

    def surface(self, hits: Hits) -> Surface:
        """Return points and normals of hits.

        Parameters
        ----------
        hits : Hits
            Of rays of any shape (...).

        Returns
        -------
        Surface
            ``p`` (..., 3): points. ``p_error`` (..., 3): absolute bound on their rounding error, and on that of the
            test of a ray from there against the same triangle. ``ng`` (..., 3): unit geometric normals,
            (v1 - v0) x (v2 - v0) normalised. The rows of misses are NaN.

        Examples
        --------
        >>> import raytrace as rt
        >>> bvh = rt.BVH([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        >>> bvh.surface(bvh.closest_hit([[0.25, 0.25, 1]], [[0, 0, -1]])).p
        array([[0.25, 0.25, 0.  ]], dtype=float32)
        """
        prim_id = np.asarray(hits.prim_id)
        corners = self.triangles[np.maximum(prim_id, 0)]
        corners = np.where((prim_id >= 0)[..., None], corners, np.nan).astype(corners.dtype)
        v0, v1, v2, ng = corners[..., 0:3], corners[..., 3:6], corners[..., 6:9], corners[..., 9:12]
        u, v = np.asarray(hits.u)[..., None], np.asarray(hits.v)[..., None]
        relative = corners.dtype.type(gamma(np.finfo(corners.dtype).eps))
        p = blend(v0, v1, v2, u, v)
        return Surface(p, relative * error_scale(p, v0, v1, v2), ng)

    @property
    def stats(self) -> TreeStats:
        """Statistics: triangles, nodes, leaves, levels, fill, SAH cost, bytes per triangle, growth, references.

        Examples
        --------
        >>> import raytrace as rt
        >>> rt.BVH([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).stats.leaves
        1
        """
        number = int(np.isfinite(self.triangles[:, 9]).sum()) if self.divided else None
        return tree_stats(self.tree, self.levels, self._as_built and self._as_built.sah_cost, number)

    def validate(self) -> None:
        """Check that every triangle lies in a leaf, boxes contain what is below them, and all links are valid.

        Raises
        ------
        ValueError
            What is wrong, one line each.

        Examples
        --------
        >>> import raytrace as rt
        >>> rt.BVH([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).validate()
        """
        problems = tree_problems(self.tree, self.triangles, self.divided)
        if problems:
            raise ValueError("\n".join(problems))
