"""``BVH``: checks at the door, then the queries on as many threads as wanted."""

import ctypes

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.accel import query
from raytrace.accel.build import LEAVES, build
from raytrace.accel.grow import SPLITS
from raytrace.accel.lanes import NODE
from raytrace.parallel import run
from raytrace.records import Columns, Hits, Rays, Surface, Work

CHUNK = 1 << 14  # rays handed to a thread at a time
GAMMA = 16  # see passes/surface.py


class BVH:
    """Bounding volume hierarchy over a triangle mesh: nearest hits and occlusion for batches of rays.

    Parameters
    ----------
    vertices : (v, 3) array_like of float, world units
    faces : (m, 3) array_like of int
        Rows of ``vertices``, counter-clockwise seen from the front.
    precision : {"float32", "float64"}
        Of the tree, the rays and the answers.
    split : {"sah", "median"}
        How the tree is built: binned surface area heuristic [Wald2007]_, or halves by count.
    triangle : {"watertight", "moller-trumbore"}
        The triangle test: [Woop2013]_ with exact ties and distances from the plane, or [Moller1997]_ with the absolute
        threshold |det| < 1e-5 of a course framework, kept to compare with.

    Raises
    ------
    ValueError
        Wrong shapes, vertices that are not finite, indices out of range, unknown options.

    Notes
    -----
    A ray hits where t lies in the open interval (tmin, tmax). At equal t the lowest ``prim_id`` is returned, so that the
    answer never depends on the tree, the batch or the thread. Triangles without area are never hit. Rays that are not
    finite or have no direction hit nothing.

    Examples
    --------
    >>> import raytrace as rt
    >>> bvh = rt.BVH([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> bvh.closest_hit([[0.25, 0.25, 1]], [[0, 0, -2]])
    Hits(t=array([0.5], dtype=float32), prim_id=array([0], dtype=int32), u=array([0.25], dtype=float32), v=array([0.25], dtype=float32))
    """  # noqa: E501

    def __init__(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        precision: str = "float32",
        split: str = "sah",
        triangle: str = "watertight",
    ) -> None:
        _one_of("precision", precision, ("float32", "float64"))
        _one_of("split", split, SPLITS)
        _one_of("triangle", triangle, LEAVES)
        self.precision, self.split, self.triangle = precision, split, triangle
        self.vertices = _vertices(vertices, np.dtype(precision))
        self.faces = _faces(faces, len(self.vertices))
        self.tree, self.triangles, self.levels = build(self.vertices, self.faces, split, triangle)

    def __repr__(self) -> str:
        return f"<BVH of {len(self.faces)} triangles, {self.precision}, {self.split}, {self.triangle}>"

    def closest_hit(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        tmin: ArrayLike = 0.0,
        tmax: ArrayLike = np.inf,
        threads: int | None = None,
    ) -> Hits:
        """Nearest hit of each ray.

        Parameters
        ----------
        origins, directions : (n, 3) array_like, world units
            One of them may be a single row, which all rays share. Directions may have any length.
        tmin, tmax : float or (n,) array_like, units of the direction
            Open interval in which hits count.
        threads : int, optional
            Default: all cores of the process.

        Returns
        -------
        Hits
            ``t`` (inf for a miss), ``prim_id`` (-1), ``u``, ``v``: (n,) arrays, p = (1 - u - v) v0 + u v1 + v v2.

        Raises
        ------
        ValueError
            Shapes that do not go together.

        Examples
        --------
        >>> import raytrace as rt
        >>> bvh = rt.BVH([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        >>> bvh.closest_hit([0.25, 0.25, 1], [[0, 0, -1], [0, 0, 1]]).t
        array([ 1., inf], dtype=float32)
        """
        arrays, n = self._arrays(origins, directions, tmin, tmax)
        rays = Rays(*(_columns(array, n) for array in arrays))
        dtype = self.triangles.dtype
        hits = Hits(np.empty(n, dtype), np.empty(n, np.int32), np.empty(n, dtype), np.empty(n, dtype))

        def trace(begin: int) -> None:
            count = min(CHUNK, n - begin)
            part = Hits(*(column[begin : begin + count] for column in hits))
            query.closest_hit(self.tree, _from(rays, begin), part, count, self.work())

        run(trace, range(0, n, CHUNK), threads)
        return hits

    def any_hit(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        tmin: ArrayLike = 0.0,
        tmax: ArrayLike = np.inf,
        threads: int | None = None,
    ) -> NDArray[np.bool_]:
        """Whether each ray hits anything; parameters as of ``closest_hit``.

        Returns
        -------
        (n,) bool array

        Examples
        --------
        >>> import raytrace as rt
        >>> bvh = rt.BVH([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        >>> bvh.any_hit([0.25, 0.25, 1], [0, 0, -1], tmax=[0.5, 2])
        array([False,  True])
        """
        arrays, n = self._arrays(origins, directions, tmin, tmax)
        rays = Rays(*(_columns(array, n) for array in arrays))
        occluded = np.empty(n, np.bool_)

        def trace(begin: int) -> None:
            count = min(CHUNK, n - begin)
            query.any_hit(self.tree, _from(rays, begin), occluded[begin : begin + count], count, self.work())

        run(trace, range(0, n, CHUNK), threads)
        return occluded

    def surface(self, hits: Hits) -> Surface:
        """Points and normals of hits.

        Parameters
        ----------
        hits : Hits
            Of n rays.

        Returns
        -------
        Surface
            ``p`` (n, 3), ``p_error`` (n, 3): absolute bound on its rounding error, ``ng`` (n, 3): unit geometric normal
            (v1 - v0) x (v2 - v0) normalised. NaN in the rows of misses.

        Examples
        --------
        >>> import raytrace as rt
        >>> bvh = rt.BVH([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        >>> bvh.surface(bvh.closest_hit([[0.25, 0.25, 1]], [[0, 0, -1]])).p
        array([[0.25, 0.25, 0.  ]], dtype=float32)
        """
        prim_id = np.asarray(hits.prim_id)
        corners = self.triangles[np.maximum(prim_id, 0)]
        corners = np.where((prim_id >= 0)[:, None], corners, np.nan).astype(corners.dtype)
        v0, v1, v2, ng = corners[:, 0:3], corners[:, 3:6], corners[:, 6:9], corners[:, 9:12]
        u, v = np.asarray(hits.u)[:, None], np.asarray(hits.v)[:, None]
        unit = np.finfo(corners.dtype).eps / 2
        gamma = corners.dtype.type(GAMMA * unit / (1 - GAMMA * unit))
        largest = np.maximum(np.maximum(np.abs(v0), np.abs(v1)), np.abs(v2))
        return Surface((1 - u - v) * v0 + (u * v1 + v * v2), gamma * largest, ng)

    def work(self) -> Work:
        """Scratch memory for one thread."""
        room = (NODE - 1) * self.levels + 2
        return Work(np.empty(room, self.triangles.dtype), np.empty(room, np.int32), np.zeros(2, np.int64))

    def _arrays(self, *rays: ArrayLike) -> tuple[list[NDArray[np.floating]], int]:
        """Origins, directions, tmin, tmax in the precision of the tree, and the number of rays."""
        dtype = self.triangles.dtype
        names = "origins", "directions", "tmin", "tmax"
        arrays = [_points(name, value, dtype) for name, value in zip(names[:2], rays[:2], strict=True)]
        arrays += [_limits(name, value, dtype) for name, value in zip(names[2:], rays[2:], strict=True)]
        lengths = {name: len(array) for name, array in zip(names, arrays, strict=True) if array.ndim}
        several = {length for length in lengths.values() if length != 1}
        if len(several) > 1:
            raise ValueError(f"origins, directions, tmin, tmax: lengths do not go together: {lengths}")
        return [_whole_strides(array) for array in arrays], several.pop() if several else 1


def _one_of(name: str, value: str, allowed: object) -> None:
    if value not in allowed:  # type: ignore[operator]
        raise ValueError(f"{name}: expected one of {', '.join(allowed)}, got {value!r}")  # type: ignore[call-overload]


def _array(name: str, value: ArrayLike) -> NDArray[np.generic]:
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{name}: expected an (n, 3) array of numbers: {error}") from None
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{name}: expected an (n, 3) array, got shape {array.shape}")
    return array


def _vertices(value: ArrayLike, dtype: np.dtype) -> NDArray[np.floating]:
    array = _array("vertices", value)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"vertices: expected numbers, got dtype {array.dtype}")
    with np.errstate(over="ignore"):
        array = np.ascontiguousarray(array, dtype)
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if len(bad):
        raise ValueError(f"vertices: row {bad[0]} is not finite in {dtype}: {array[bad[0]]} ({len(bad)} such rows)")
    return array


def _faces(value: ArrayLike, vertex_count: int) -> NDArray[np.int32]:
    array = np.asarray(value)
    if array.size == 0:
        array = np.empty((0, 3), np.int32)
    array = _array("faces", array)
    if array.dtype.kind not in "iu":
        raise ValueError(f"faces: expected integers, got dtype {array.dtype}")
    bad = np.flatnonzero(((array < 0) | (array >= vertex_count)).any(axis=1))
    if len(bad):
        raise ValueError(
            f"faces: row {bad[0]} is {array[bad[0]].tolist()}, but there are {vertex_count} vertices, numbered from 0"
        )
    return np.ascontiguousarray(array, np.int32)


def _points(name: str, value: ArrayLike, dtype: np.dtype) -> NDArray[np.floating]:
    array = np.asarray(value)
    array = _array(name, array[None] if array.shape == (3,) else array)
    with np.errstate(over="ignore"):
        return np.asarray(array, dtype)


def _columns(array: NDArray[np.floating], n: int) -> Columns:
    """An array of any strides as kernels read it, without a copy where strides are whole elements.

    Kernels see flat writable memory, whatever the array's layout and flags, and so are compiled but once. The caller
    keeps the array alive.
    """
    size = array.itemsize
    steps = [stride // size for stride in array.strides]
    low = sum(min(0, step * (count - 1)) for step, count in zip(steps, array.shape, strict=True))
    span = sum(abs(step) * (count - 1) for step, count in zip(steps, array.shape, strict=True)) + 1 if array.size else 0
    memory = (ctypes.c_char * (span * size)).from_address(array.ctypes.data + low * size)
    row = 0 if array.ndim == 0 or len(array) == 1 < n else steps[0]
    return Columns(np.frombuffer(memory, array.dtype), -low, row, steps[1] if array.ndim == 2 else 0)


def _whole_strides(array: NDArray[np.floating]) -> NDArray[np.floating]:
    """The array, or a copy where its elements do not lie a whole number of elements apart."""
    whole = array.flags.aligned and not any(stride % array.itemsize for stride in array.strides)
    return array if whole else array.copy()


def _limits(name: str, value: ArrayLike, dtype: np.dtype) -> NDArray[np.floating]:
    array = np.asarray(value, dtype)
    if array.ndim > 1:
        raise ValueError(f"{name}: expected a number or an (n,) array, got shape {array.shape}")
    return array


def _from(rays: Rays, begin: int) -> Rays:
    """The same rays from number ``begin`` on."""
    return Rays(*(column._replace(start=column.start + begin * column.row) for column in rays))
