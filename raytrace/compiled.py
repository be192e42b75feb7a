"""``raytrace.compiled``: ``closest_hit`` and ``any_hit`` for code that users compile with Numba.

They call the machine code of ``BVH.closest_hit`` and ``BVH.any_hit`` through its address. So the results are
bit-identical, Numba compiles only the call, and ``nogil``, ``parallel`` and ``cache`` work. In plain Python, and with
``NUMBA_DISABLE_JIT=1``, they give the same results.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numba.core import types
from numba.core.errors import TypingError
from numba.extending import overload
from numpy.typing import ArrayLike, NDArray

from raytrace.accel import query
from raytrace.accel.bvh import BVH
from raytrace.accel.inputs import check_rays, rays_of
from raytrace.accel.layout import aligned
from raytrace.jit import PLAIN
from raytrace.native.caller import (
    LAYOUT_NUMBER,
    LEAF_TYPE,
    LINE,
    SCRATCH,
    WORK,
    any_of_one,
    closest_of_one,
    of_many,
)
from raytrace.native.compiled_rays import check, gathered, ray
from raytrace.records import Columns, Hits, MollerTrumboreLeaves, Nodes, Rays, Tree, WatertightLeaves
from raytrace.work_records import Work

__all__ = ["Handle", "any_hit", "closest_hit", "handle"]

LEAVES = WatertightLeaves, MollerTrumboreLeaves
FAILED = "the machine code of the query reports an error"


class Handle(NamedTuple):
    """A tree as compiled code receives it: flat, since ``prange`` takes no nested tuples; made by ``handle``."""

    bounds: NDArray[np.floating]  # the arrays of Tree
    child: NDArray[np.integer]
    rows: NDArray[np.floating]
    prim_id: NDArray[Any]
    extent: NDArray[np.floating]
    closest: NDArray[np.int64]  # words for the call of closest_hit, see native/caller.py
    any: NDArray[np.int64]  # words for the call of any_hit


def handle(bvh: BVH) -> Handle:
    """Return a tree as an argument for functions that you compile with Numba.

    Parameters
    ----------
    bvh : BVH

    Returns
    -------
    Handle
        A named tuple of arrays. It keeps the memory of the tree alive. It holds addresses, so make it anew in each
        process, and after ``refit``.

    Raises
    ------
    RuntimeError
        The installed Numba or llvmlite cannot compile the queries into code of their own.

    Examples
    --------
    >>> import numpy as np
    >>> import raytrace as rt
    >>> from numba import njit
    >>> from raytrace import compiled
    >>> @njit(nogil=True)
    ... def depth(scene, origin, directions):
    ...     z = np.empty(len(directions), np.float32)
    ...     for i in range(len(directions)):
    ...         t, prim_id, u, v = compiled.closest_hit(scene, origin, directions[i])
    ...         z[i] = t
    ...     return z
    >>> bvh = rt.BVH([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> depth(compiled.handle(bvh), np.array([0.25, 0.25, 1]), np.array([[0, 0, -1.0], [0, 0, 1.0]]))
    array([ 1., inf], dtype=float32)
    """
    dtype, work = bvh.triangles.dtype, bvh.work()
    column, numbers = Columns(np.empty(8, dtype), 0, 0, 1), np.empty(1, np.int32)
    rays, hits = Rays(*[column] * 4), Hits(column.data, numbers, column.data, column.data)
    closest = _words(query.closest_hit, (bvh.tree, rays, hits, 1, work))
    occluded = _words(query.any_hit, (bvh.tree, rays, np.empty(1, np.bool_), 1, work))
    nodes, leaves = bvh.tree.nodes, bvh.tree.leaves
    return Handle(nodes.bounds, nodes.child, leaves.rows, leaves.prim_id, bvh.tree.extent, closest, occluded)


def _words(kernel: Any, args: tuple[Any, ...]) -> NDArray[np.int64]:
    """Return the words for calls of a kernel with such arguments, the last of which is scratch memory."""
    try:
        address = 0 if PLAIN else kernel.c_address(args)
    except RuntimeError as reason:
        raise RuntimeError(
            f"raytrace.compiled: {reason}; install a release of Numba that raytrace was tested with, or call "
            "BVH.closest_hit and BVH.any_hit from Python"
        ) from None
    offsets = np.cumsum([0, *(-(-array.nbytes // LINE) * LINE for array in args[-1])])
    work = [word for offset, array in zip(offsets[:-1], args[-1], strict=True) for word in (offset, array.size)]
    leaf_type = LEAVES.index(type(args[0].leaves))
    return np.array([address, LAYOUT_NUMBER, leaf_type, offsets[-1] + LINE, *_flat(args[:-1]), *work], np.int64)


def _flat(value: Any) -> Iterator[int]:
    """Yield the words of arguments: address and length of each array, and integers."""
    if isinstance(value, tuple):
        for field in value:
            yield from _flat(field)
    else:
        yield from (value.ctypes.data, value.size) if isinstance(value, np.ndarray) else (value,)


def closest_hit(
    scene: Handle, origin: ArrayLike, direction: ArrayLike, tmin: ArrayLike = 0.0, tmax: ArrayLike = np.inf
) -> tuple[Any, Any, Any, Any]:  # four numbers, or four arrays
    """Return the nearest hit of one ray, or of each of n rays; call it in code that you compile with Numba.

    Parameters
    ----------
    scene : Handle
        Of ``handle(bvh)``.
    origin, direction : (3,) array or tuple, or (n, 3) array, world units
        If either has n rows, the result is that of n rays. The other may be a single row, which all rays share.
    tmin, tmax : float, or (n,) array, units of the direction
        Open interval in which a hit counts.

    Returns
    -------
    t, prim_id, u, v
        Those of ``BVH.closest_hit``, bit for bit: four numbers for one ray, else four (n,) arrays.

    Raises
    ------
    ValueError
        Shapes that do not match.

    Examples
    --------
    >>> import raytrace as rt
    >>> from raytrace import compiled
    >>> scene = compiled.handle(rt.BVH([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    >>> t, prim_id, u, v = compiled.closest_hit(scene, (0.25, 0.25, 1), (0, 0, -1))
    >>> float(t), int(prim_id)
    (1.0, 0)
    """
    rays, n, one = _rays(scene, origin, direction, tmin, tmax)
    columns = np.empty((3, n), rays.o.data.dtype)
    hits = Hits(columns[0], np.empty(n, np.int32), columns[1], columns[2])
    query.closest_hit(_tree(scene), rays, hits, n, _work(scene))
    t, prim_id, u, v = (column[0] for column in hits) if one else hits
    return t, prim_id, u, v


def any_hit(
    scene: Handle, origin: ArrayLike, direction: ArrayLike, tmin: ArrayLike = 0.0, tmax: ArrayLike = np.inf
) -> Any:  # a bool, or an array
    """Return whether one ray, or each of n rays, hits anything; the parameters are those of ``closest_hit``.

    Returns
    -------
    bool, or (n,) bool array

    Examples
    --------
    >>> import raytrace as rt
    >>> from raytrace import compiled
    >>> scene = compiled.handle(rt.BVH([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    >>> bool(compiled.any_hit(scene, (0.25, 0.25, 1), (0, 0, -1), 0.0, 0.5))
    False
    """
    rays, n, one = _rays(scene, origin, direction, tmin, tmax)
    occluded = np.empty(n, np.bool_)
    query.any_hit(_tree(scene), rays, occluded, n, _work(scene))
    return occluded[0] if one else occluded


def _rays(
    scene: Handle, origin: ArrayLike, direction: ArrayLike, tmin: ArrayLike, tmax: ArrayLike
) -> tuple[Rays, int, bool]:
    """Return checked rays, their number, and whether they are given as one ray."""
    dtype = scene.extent.dtype
    fields, shape = check_rays(origin, direction, tmin, tmax, dtype)
    n = math.prod(shape)
    axes = np.ndim(origin), np.ndim(direction), np.ndim(tmin), np.ndim(tmax)
    return rays_of(fields, 0, n, dtype), n, axes == (1, 1, 0, 0)


def _tree(scene: Handle) -> Tree:
    """Return the tree of a handle."""
    leaves = LEAVES[scene.closest[LEAF_TYPE]](scene.rows, scene.prim_id)
    return Tree(Nodes(scene.bounds, scene.child), leaves, scene.extent)


def _work(scene: Handle) -> Work:
    """Allocate scratch memory for a call from Python."""
    dtype, lengths = scene.extent.dtype, scene.closest[-WORK + 1 :: 2]
    kinds = dtype.name, "int32", "int32", dtype.name, "int32", "int64"
    return Work(*(aligned(int(n), np.dtype(kind)) for n, kind in zip(lengths, kinds, strict=True)))


# --- the same for Numba ----------------------------------------------------------------------------------------------


def _is_one(scene: Any, origin: Any, direction: Any, tmin: Any, tmax: Any) -> bool:
    """Return whether arguments of these types are one ray."""
    if not isinstance(scene, types.NamedTuple) or scene.instance_class is not Handle:
        raise TypingError(f"scene: expected the result of raytrace.compiled.handle(bvh), got {scene}")
    limits = any(isinstance(value, types.Array) for value in (tmin, tmax))
    return not limits and not any(isinstance(value, types.Array) and value.ndim > 1 for value in (origin, direction))


@overload(closest_hit)
def _closest_hit(scene: Any, origin: Any, direction: Any, tmin: Any = 0.0, tmax: Any = np.inf) -> Any:
    def one(scene: Any, origin: Any, direction: Any, tmin: Any = 0.0, tmax: Any = np.inf) -> Any:
        check(scene.closest)
        one_ray, scratch = ray(origin, direction, tmin, tmax), np.empty(scene.closest[SCRATCH], np.uint8)
        status, t, prim_id, u, v = closest_of_one(scene.closest, scratch, one_ray, scene.extent)
        if status != 0:
            raise RuntimeError(FAILED)
        return t, prim_id, u, v

    def many(scene: Any, origin: Any, direction: Any, tmin: Any = 0.0, tmax: Any = np.inf) -> Any:
        check(scene.closest)
        fields, numbers = gathered(scene, origin, direction, tmin, tmax)
        n = numbers[4]
        t, u, v = np.empty(n, fields[0].dtype), np.empty(n, fields[0].dtype), np.empty(n, fields[0].dtype)
        prim_id = np.empty(n, np.int32)
        scratch = np.empty(scene.closest[SCRATCH], np.uint8)
        if of_many(scene.closest, scratch, fields, numbers, (t, prim_id, u, v)) != 0:
            raise RuntimeError(FAILED)
        return t, prim_id, u, v

    return one if _is_one(scene, origin, direction, tmin, tmax) else many


@overload(any_hit)
def _any_hit(scene: Any, origin: Any, direction: Any, tmin: Any = 0.0, tmax: Any = np.inf) -> Any:
    def one(scene: Any, origin: Any, direction: Any, tmin: Any = 0.0, tmax: Any = np.inf) -> Any:
        check(scene.any)
        one_ray, scratch = ray(origin, direction, tmin, tmax), np.empty(scene.any[SCRATCH], np.uint8)
        status, occluded = any_of_one(scene.any, scratch, one_ray, scene.extent)
        if status != 0:
            raise RuntimeError(FAILED)
        return occluded != 0

    def many(scene: Any, origin: Any, direction: Any, tmin: Any = 0.0, tmax: Any = np.inf) -> Any:
        check(scene.any)
        fields, numbers = gathered(scene, origin, direction, tmin, tmax)
        occluded = np.empty(numbers[4], np.bool_)
        scratch = np.empty(scene.any[SCRATCH], np.uint8)
        if of_many(scene.any, scratch, fields, numbers, (occluded,)) != 0:
            raise RuntimeError(FAILED)
        return occluded

    return one if _is_one(scene, origin, direction, tmin, tmax) else many
