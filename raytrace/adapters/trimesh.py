"""``RayMeshIntersector``: the ray queries of trimesh, answered by ``BVH``.

trimesh has two classes of this name, in ``trimesh.ray.ray_triangle`` and in ``trimesh.ray.ray_pyembree``. This one has
the methods and arguments of both. It does not import trimesh.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.accel.bvh import BVH
from raytrace.accel.closed import point_numbers
from raytrace.accel.inputs import MeshLike
from raytrace.accel.inside import closure_of
from raytrace.records import Hits

# directions of the rays of contains_points where a mesh is open: the first is that of trimesh, the second is any other
DIRECTIONS = (0.4395064455, 0.617598629942, 0.652231566745), (-0.7391304348, 0.3127962085, 0.5965165877)
ON_EDGE = 4  # eps: a barycentric coordinate at most that large is one of the opposite edge


class RayMeshIntersector:
    """Ray queries for a ``trimesh.Trimesh``: ``mesh.ray = RayMeshIntersector(mesh)``.

    Parameters
    ----------
    mesh : trimesh.Trimesh
    scale_to_box : bool
        Has no effect: precision does not depend on the scale. It is accepted because trimesh's class has it.
    precision : {"float64", "float32"}
        Of the tree and the rays. The default is that of trimesh's arrays, so results are exact for the mesh as given.
    threads : int, optional
        Default: one per core that the process may use.

    Notes
    -----
    The tree is built at the first query, and again after vertices or faces have changed. ``mesh.copy()`` gives the copy
    trimesh's own object; assign this one again.

    A hit counts if it lies in front of the origin: t > 0. An origin that lies on a triangle does not hit it. Rays and
    directions have the shape (n, 3), and directions any length.

    Examples
    --------
    >>> import trimesh
    >>> from raytrace.adapters.trimesh import RayMeshIntersector
    >>> mesh = trimesh.creation.box()
    >>> mesh.ray = RayMeshIntersector(mesh)
    >>> mesh.contains([[0.1, 0.2, 0.3], [0.1, 0.2, 0.7]]).tolist()
    [True, False]
    >>> locations, index_ray, index_tri = mesh.ray.intersects_location([[0.1, 0.2, 2]], [[0, 0, -1]])
    >>> locations.round(12).tolist()
    [[0.1, 0.2, 0.5], [0.1, 0.2, -0.5]]
    """

    def __init__(
        self, mesh: MeshLike, scale_to_box: bool = True, precision: str = "float64", threads: int | None = None
    ) -> None:
        self.mesh, self.precision, self.threads = mesh, precision, threads
        self._scale_to_box = scale_to_box
        self._built: tuple[int, BVH] | None = None  # the hash of the mesh, and its tree

    def intersects_id(
        self,
        ray_origins: ArrayLike,
        ray_directions: ArrayLike,
        *,
        multiple_hits: bool = True,
        max_hits: int | None = None,
        return_locations: bool = False,
    ) -> tuple[NDArray[Any], ...]:
        """Return the triangles that rays hit.

        The options must be named: trimesh's two classes have them in different orders.

        Parameters
        ----------
        ray_origins, ray_directions : (n, 3) array_like
        multiple_hits : bool
            All hits of each ray, else the nearest.
        max_hits : int, optional
            The most hits that are returned for one ray, nearest first. Default: all.
        return_locations : bool
            Return the locations too. Then a location is returned once per ray, with the first of its triangles, where
            the ray meets an edge or vertex that several triangles share, or a triangle that the mesh has twice. Without
            locations, all these triangles are returned. That is the behaviour of ``trimesh.ray.ray_triangle``.

        Returns
        -------
        index_tri : (h,) int64 array
            Rows of ``mesh.faces``, sorted by ray and then by distance.
        index_ray : (h,) int64 array
        locations : (h, 3) float64 array
            Only if ``return_locations``.

        Raises
        ------
        ValueError
            Shapes that do not match; vertices that are not finite.
        """
        bvh = self._current()
        origins, directions = _rays(ray_origins, ray_directions)
        if multiple_hits:
            every = bvh.all_hits(origins, directions, threads=self.threads)
            hits = Hits(every.t, every.prim_id, every.u, every.v)
            index_ray = np.repeat(np.arange(len(origins)), np.diff(every.start))
        else:
            first = bvh.closest_hit(origins, directions, threads=self.threads)
            index_ray = np.flatnonzero(first.prim_id >= 0)
            hits = _some(first, index_ray)
        if return_locations and multiple_hits:
            kept = _unique_locations(hits, index_ray, bvh)
            hits, index_ray = _some(hits, kept), index_ray[kept]
        if max_hits is not None and multiple_hits:
            number = np.arange(len(index_ray)) - np.searchsorted(index_ray, index_ray)
            kept = number < max_hits
            hits, index_ray = _some(hits, kept), index_ray[kept]
        index_tri = hits.prim_id.astype(np.int64)
        if not return_locations:
            return index_tri, index_ray
        return index_tri, index_ray, bvh.surface(hits).p.astype(np.float64)

    def intersects_location(
        self,
        ray_origins: ArrayLike,
        ray_directions: ArrayLike,
        multiple_hits: bool = True,
        *,
        max_hits: int | None = None,
    ) -> tuple[NDArray[Any], ...]:
        """Return where rays hit the mesh; the parameters are those of ``intersects_id``.

        Returns
        -------
        locations : (h, 3) float64 array
        index_ray, index_tri : (h,) int64 arrays
        """
        index_tri, index_ray, locations = self.intersects_id(
            ray_origins, ray_directions, multiple_hits=multiple_hits, max_hits=max_hits, return_locations=True
        )
        return locations, index_ray, index_tri

    def intersects_first(self, ray_origins: ArrayLike, ray_directions: ArrayLike) -> NDArray[np.int64]:
        """Return the first triangle that each ray hits.

        Returns
        -------
        (n,) int64 array
            -1 for a miss.
        """
        hits = self._current().closest_hit(*_rays(ray_origins, ray_directions), threads=self.threads)
        return hits.prim_id.astype(np.int64)

    def intersects_any(self, ray_origins: ArrayLike, ray_directions: ArrayLike) -> NDArray[np.bool_]:
        """Return whether each ray hits anything.

        Returns
        -------
        (n,) bool array
        """
        return self._current().any_hit(*_rays(ray_origins, ray_directions), threads=self.threads)

    def contains_points(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return whether points lie inside the mesh.

        Parameters
        ----------
        points : (n, 3) array_like

        Returns
        -------
        (n,) bool array

        Notes
        -----
        For a closed mesh this is ``BVH.contains``: exact, and True on the surface.

        For an open mesh the answer is a convention, that of trimesh. Two opposite rays start at the point. If their
        numbers of crossings are both odd, the point is inside; if both are even, it is outside. If they differ, and one
        ray crosses nothing, it is outside. Else two rays along another line decide in the same way; if these differ
        too, the point is outside. The lines are fixed, so the answers never change. Points outside the bounding box are
        outside.
        """
        bvh = self._current()
        array = np.asarray(points)
        if array.size == 0:
            return np.zeros(0, np.bool_)
        if array.ndim != 2 or array.shape[1] != 3:
            raise ValueError(f"points: expected an (n, 3) array, got shape {array.shape}")
        if closure_of(bvh).edges.first is None:
            return bvh.contains(array, threads=self.threads)
        low, high = bvh.tree.extent[:3], bvh.tree.extent[3:6]
        inside = np.zeros(len(array), np.bool_)
        left = np.flatnonzero(((array >= low) & (array <= high)).all(axis=1))
        for direction in DIRECTIONS:
            if len(left) == 0:
                break
            origins, ahead = array[left], np.broadcast_to(direction, (len(left), 3))
            both = ahead, -ahead
            counts = [bvh.count_hits(origins, rays, crossings=True, threads=self.threads) for rays in both]
            odd = [count % 2 == 1 for count in counts]
            inside[left] = odd[0] & odd[1]
            left = left[(odd[0] != odd[1]) & (counts[0] > 0) & (counts[1] > 0)]
        return inside

    def _current(self) -> BVH:
        """Return the tree of the mesh as it is now."""
        key = hash(self.mesh)  # of the content of its vertices and faces; trimesh computes it after they have changed
        built = self._built
        if built is None or built[0] != key:
            self._built = built = key, BVH(self.mesh, precision=self.precision)
        return built[1]

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_built": None}  # as trimesh's: a copy builds its own tree

    def __copy__(self) -> RayMeshIntersector:
        return RayMeshIntersector(self.mesh, self._scale_to_box, self.precision, self.threads)

    def __deepcopy__(self, memo: dict[int, Any]) -> RayMeshIntersector:
        return self.__copy__()


def _rays(origins: ArrayLike, directions: ArrayLike) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return origins and directions of equal shapes."""
    both = np.asarray(origins), np.asarray(directions)
    if both[0].shape != both[1].shape:
        raise ValueError(f"ray_origins and ray_directions have different shapes: {both[0].shape} and {both[1].shape}")
    if both[0].size and (both[0].ndim != 2 or both[0].shape[1] != 3):
        raise ValueError(f"ray_origins, ray_directions: expected (n, 3) arrays, got shape {both[0].shape}")
    return both[0].reshape(-1, 3), both[1].reshape(-1, 3)


def _some(hits: Hits, which: NDArray[Any]) -> Hits:
    """Return some of the hits: by number, or by mask."""
    return Hits(hits.t[which], hits.prim_id[which], hits.u[which], hits.v[which])


def _unique_locations(hits: Hits, index_ray: NDArray[np.int64], bvh: BVH) -> NDArray[np.bool_]:
    """Return which hits are the first ones of their ray at their location.

    Hits of one ray are at one location if they lie on the same vertex, on the same edge, or in triangles with the same
    vertices. Vertices at one position are the same. So no tolerance of length is needed, at any scale.
    """
    kept = np.ones(len(index_ray), np.bool_)
    eps = ON_EDGE * np.finfo(hits.u.dtype).eps
    weights = np.stack([1 - hits.u - hits.v, hits.u, hits.v], axis=1)
    on_edge = (weights <= eps).any(axis=1)
    near = (index_ray[1:] == index_ray[:-1]) & (np.diff(hits.t) <= 1e-6 * np.abs(hits.t[1:]))
    which = np.flatnonzero(on_edge | np.append(near, False) | np.append(False, near))
    if len(which) == 0:
        return kept
    faces = bvh.faces[hits.prim_id[which]]
    same = point_numbers(bvh.vertices[faces].reshape(-1, 3)).reshape(-1, 3)
    corners = np.sort(np.where(weights[which] <= eps, -1, same), axis=1)
    keys = np.column_stack([index_ray[which], corners])
    _, first = np.unique(keys, axis=0, return_index=True)
    kept[which] = False
    kept[which[first]] = True
    return kept
