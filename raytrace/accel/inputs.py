"""Check the arguments of ``BVH``, and convert them to the records that kernels read."""

import math
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.records import Columns, Rays

MAX_ROWS = 2**29  # vertices or faces of a mesh: twice as many nodes still have int32 numbers
KERNELS = "C_CONTIGUOUS", "ALIGNED", "ENSUREARRAY"  # requirements of kernels for arrays of several axes
REACH = 2**31  # elements from the first to the last that kernels read of an array: indices are int32


def one_of(name: str, value: str, allowed: Collection[str]) -> None:
    """Raise a ValueError for an unknown value of an option."""
    if value not in allowed:
        raise ValueError(f"{name}: expected one of {', '.join(allowed)}, got {value!r}")


def _numbers(name: str, value: ArrayLike, kinds: str = "fiu") -> NDArray[Any]:
    """Return an array of numbers of an allowed kind: f float, i and u integers."""
    if isinstance(value, np.ndarray) and type(value) is not np.ndarray and np.ma.is_masked(value):
        raise ValueError(f"{name}: some elements are masked: fill them, or remove their rows")
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: expected numbers: {error}") from None
    if array.size == 0:
        return np.empty(array.shape, kinds[0])  # the dtype of [] is arbitrary
    if array.dtype.kind not in kinds:
        raise ValueError(f"{name}: expected {'integers' if kinds == 'iu' else 'numbers'}, got dtype {array.dtype}")
    return array


def _rows(name: str, array: NDArray[Any]) -> NDArray[Any]:
    if array.shape == (0,):
        return array.reshape(0, 3)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{name}: expected an (n, 3) array, got shape {array.shape}")
    return array


# --- meshes ----------------------------------------------------------------------------------------------------------


class MeshLike(Protocol):
    """Any object that has the arrays of a mesh, such as a ``trimesh.Trimesh``."""

    vertices: ArrayLike  # (v, 3)
    faces: ArrayLike  # (m, 3)


def mesh_arrays(vertices: ArrayLike | MeshLike, faces: ArrayLike | None) -> tuple[ArrayLike, ArrayLike]:
    """Return vertices and faces, given as two arrays or as one mesh that has both."""
    has_both = hasattr(vertices, "vertices") and hasattr(vertices, "faces")
    if faces is not None:
        if has_both:
            raise ValueError("faces: the first argument is a mesh, which has its own faces; omit them")
        return vertices, faces
    if not has_both:
        kind = type(vertices).__name__
        raise ValueError(f"faces: missing; pass vertices and faces, or one mesh that has both, got a {kind} alone")
    return vertices.vertices, vertices.faces


def check_vertices(value: ArrayLike, dtype: np.dtype) -> NDArray[np.floating]:
    """Return vertices as a contiguous (v, 3) array of that dtype: all finite, and no area overflows or underflows."""
    given = _few("vertices", _rows("vertices", _numbers("vertices", value)))
    with np.errstate(over="ignore"):
        array = np.require(given, dtype, KERNELS)
    size = max(array.max(initial=0), -array.min(initial=0))
    cure = "use precision='float64', or other units" if dtype == np.float32 else "use other units"
    if not np.isfinite(size):
        bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
        row = given[bad[0]]
        cure = f": {cure}" if np.isfinite(row).all() else ""
        raise ValueError(f"vertices: row {bad[0]} is not finite in {dtype}: {row} ({len(bad)} such rows){cure}")
    smallest, largest = safe_sizes(dtype)
    if size > largest or 0 < size < smallest:
        raise ValueError(
            f"vertices: the largest coordinate is {size:.3g}, but in {dtype} it must lie between {smallest:.0e} and "
            f"{largest:.0e}, so that areas do not overflow or underflow: {cure}"
        )
    return array


def safe_sizes(dtype: np.dtype) -> tuple[float, float]:
    """Return the bounds between which the largest coordinate of a mesh must lie.

    The triangle test uses products of two differences. Terms that are smaller by a factor eps must still be normal
    numbers. Sums of six products must be finite, where a ray from as far away, and its shear, double each difference.
    """
    kind = np.finfo(dtype)
    return float(np.sqrt(kind.smallest_normal / kind.eps)), float(np.sqrt(kind.max)) / 16


def check_faces(value: ArrayLike, vertex_count: int) -> NDArray[np.int32]:
    """Return faces as a contiguous (m, 3) array of numbers of existing vertices."""
    array = _few("faces", _rows("faces", _numbers("faces", value, "iu")))
    if len(array) and (array.min() < 0 or array.max() >= vertex_count):
        bad = np.flatnonzero(((array < 0) | (array >= vertex_count)).any(axis=1))
        raise ValueError(
            f"faces: row {bad[0]} is {array[bad[0]].tolist()}, but there are {vertex_count} vertices, numbered from 0"
        )
    return np.require(array, np.int32, KERNELS)


def _few(name: str, array: NDArray[Any]) -> NDArray[Any]:
    if len(array) > MAX_ROWS:
        raise ValueError(f"{name}: {len(array):,} rows are more than the limit of {MAX_ROWS:,}: split the mesh")
    return array


# --- rays ------------------------------------------------------------------------------------------------------------


class Pieces(NamedTuple):
    """An array that is converted in pieces, broadcast to the shape of the batch."""

    array: NDArray[Any]  # with the leading shape of the batch; a view
    axes: int  # of the leading shape


Field = Columns | Pieces  # origins, directions, tmin, tmax or points, for all rows of a batch


def check_rays(
    origins: ArrayLike, directions: ArrayLike, tmin: ArrayLike, tmax: ArrayLike, dtype: np.dtype
) -> tuple[list[Field], tuple[int, ...]]:
    """Return the checked fields of rays for a tree of that dtype, and their leading shape."""
    return check_batch({"origins": origins, "directions": directions}, {"tmin": tmin, "tmax": tmax}, dtype)


def check_batch(
    vectors: Mapping[str, ArrayLike], numbers: Mapping[str, ArrayLike], dtype: np.dtype
) -> tuple[list[Field], tuple[int, ...]]:
    """Check the arrays of a query, and broadcast them without the last axis of vectors.

    Parameters
    ----------
    vectors : mapping from names to (..., 3) array_like
    numbers : mapping from names to (...) array_like
    dtype : dtype
        Of the tree.

    Returns
    -------
    fields : list of Field
        Vectors, then numbers. ``columns_in`` gives kernels any range of their rows, which are in C order.
    shape : tuple of int
        The leading shape of the batch: that of the results. It is (1,) where all arrays are single rows.

    Raises
    ------
    ValueError
        What is not an array of numbers, and shapes that do not match, by name.
    """
    points = [_points(name, value) for name, value in vectors.items()]
    values = [_numbers(name, value) for name, value in numbers.items()]
    shapes = [array.shape[:-1] for array in points] + [array.shape for array in values]
    shape = _broadcast([*vectors, *numbers], shapes)
    with np.errstate(over="ignore"):
        fields = [_field(array, True, shape, dtype) for array in points]
        return fields + [_field(array, False, shape, dtype) for array in values], shape


def _broadcast(names: list[str], shapes: list[tuple[int, ...]]) -> tuple[int, ...]:
    """Return the shape that arrays of these names and shapes broadcast to; at least one axis."""
    several = {*shapes} - {(), (1,)}
    if len(several) < 2:  # the usual case, faster
        return several.pop() if several else (1,)
    try:
        return np.broadcast_shapes(*several)
    except ValueError:
        found = ", ".join(f"{name} {shape}" for name, shape in zip(names, shapes, strict=True) if shape)
        raise ValueError(
            f"{', '.join(names)}: shapes do not match, without the last axis of vectors: {found}; "
            "they must be equal, or follow NumPy's rules of broadcasting"
        ) from None


def _points(name: str, value: ArrayLike) -> NDArray[Any]:
    """Return an array of vectors: (..., 3) numbers of any dtype."""
    array = _numbers(name, value)
    if array.shape == (0,):
        return array.reshape(0, 3)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ValueError(f"{name}: expected an array of shape (3,), (n, 3) or (..., 3), got shape {array.shape}")
    return array


def check_points(value: ArrayLike) -> NDArray[Any]:
    """Return points: (..., 3) numbers of any dtype; a single one as (1, 3)."""
    array = _points("points", value)
    return array[None] if array.shape == (3,) else array


def _field(array: NDArray[Any], vector: bool, shape: tuple[int, ...], dtype: np.dtype) -> Field:
    """Return an array as kernels read it, if that needs no copy or all rows are the same; else to convert in pieces."""
    last = (3,) if vector else ()
    if array.size == (3 if vector else 1):
        return Columns(np.array(array, dtype).ravel(), 0, 0, 1)
    whole = array if array.shape == shape + last else np.broadcast_to(array, shape + last)
    rows = _merged(whole, len(shape))
    if rows is None:
        return Pieces(whole, len(shape))
    return columns_of(rows, len(rows)) if rows.dtype == dtype and _readable(rows) else Pieces(rows, 1)


def _merged(array: NDArray[Any], axes: int) -> NDArray[Any] | None:
    """Return a view whose first axis is the first ``axes`` of an array, or None if that needs a copy."""
    if axes == 1:
        return array
    try:
        return array.reshape(-1 if array.size else 0, *array.shape[axes:], copy=False)
    except ValueError:
        return None


def _readable(array: NDArray[Any]) -> bool:
    """Return whether kernels can read an array in place: it is aligned, and not too far spread in memory."""
    whole = array.flags.c_contiguous or array.flags.f_contiguous
    return array.flags.aligned and (array.size if whole else _span(array)[1]) < REACH


def rays_of(fields: list[Field], begin: int, end: int, dtype: np.dtype) -> Rays:
    """Return rays ``begin`` to ``end`` as kernels read them; numbers beyond the dtype become infinite, so they miss."""
    return Rays(*columns_in(fields, begin, end, dtype))


def columns_in(fields: list[Field], begin: int, end: int, dtype: np.dtype) -> list[Columns]:
    """Return rows ``begin`` to ``end`` of the fields of a batch, in C order, as kernels read them."""
    columns = []
    for field in fields:
        if isinstance(field, Columns):
            columns.append(Columns(field.data, field.start + begin * field.row, field.row, field.axis))
        else:
            part = np.empty((end - begin, *field.array.shape[field.axes :]), dtype)
            with np.errstate(over="ignore"):
                _copy_rows(field.array, field.axes, begin, part)
            columns.append(columns_of(part, end - begin))
    return columns


def _copy_rows(array: NDArray[Any], axes: int, begin: int, out: NDArray[Any]) -> None:
    """Copy rows from ``begin`` on to ``out``; the rows are the first ``axes`` of an array, in C order."""
    if len(out) == 0:
        return
    if axes == 1:
        out[...] = array[begin : begin + len(out)]
        return
    inner = math.prod(array.shape[1:axes])
    whole, first = -(-begin // inner), min(-begin % inner, len(out))  # the first whole one, and the rows before it
    _copy_rows(array[begin // inner], axes - 1, begin % inner, out[:first])
    count = (len(out) - first) // inner
    out[first : first + count * inner].reshape(count, *array.shape[1:])[...] = array[whole : whole + count]
    if first + count * inner < len(out):
        _copy_rows(array[whole + count], axes - 1, 0, out[first + count * inner :])


def columns_of(array: NDArray[np.floating], n: int) -> Columns:
    """Return an array whose strides are whole elements as kernels read it, without a copy.

    Kernels see flat writable memory, whatever the array's layout and flags, so they are compiled only once.
    """
    steps = [stride // array.itemsize for stride in array.strides]
    row = 0 if array.ndim == 0 or len(array) == 1 < n else steps[0]
    axis = steps[1] if array.ndim == 2 else 0
    flags = array.flags
    if flags.writeable and (flags.c_contiguous or flags.f_contiguous):
        return Columns(array.ravel(order="K"), 0, row, axis)
    low, span = _span(array)
    return Columns(np.asarray(_Memory(array, low, span)), -low, row, axis)


def _span(array: NDArray[Any]) -> tuple[int, int]:
    """Offset of the lowest element of an array from its first one, and the number of elements that its memory spans."""
    if array.size == 0:
        return 0, 0
    ends = [stride // array.itemsize * (count - 1) for stride, count in zip(array.strides, array.shape, strict=True)]
    low = sum(end for end in ends if end < 0)
    return low, sum(ends) - 2 * low + 1


class _Memory:
    """The memory of an array, exposed by NumPy's array interface; it keeps the array alive as long as it is used."""

    def __init__(self, array: NDArray[Any], low: int, span: int) -> None:
        address = array.__array_interface__["data"][0] + low * array.itemsize
        self.__array_interface__ = {
            "version": 3,
            "data": (address, False),
            "shape": (span,),
            "typestr": array.dtype.str,
        }
        self.array = array
