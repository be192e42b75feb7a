"""What users hand to ``BVH``: checked, and turned into what kernels read."""

import ctypes
from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.records import Columns, Rays


def one_of(name: str, value: str, allowed: Collection[str]) -> None:
    """Refuse an option that is not known."""
    if value not in allowed:
        raise ValueError(f"{name}: expected one of {', '.join(allowed)}, got {value!r}")


def _numbers(name: str, value: ArrayLike, kinds: str = "fiu") -> NDArray[Any]:
    """An array of numbers of any kind allowed: f float, i and u integers."""
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{name}: expected numbers: {error}") from None
    if array.size and array.dtype.kind not in kinds:
        raise ValueError(f"{name}: expected {'integers' if kinds == 'iu' else 'numbers'}, got dtype {array.dtype}")
    return array


def _rows(name: str, array: NDArray[Any]) -> NDArray[Any]:
    if array.shape == (0,):
        return array.reshape(0, 3)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{name}: expected an (n, 3) array, got shape {array.shape}")
    return array


def check_vertices(value: ArrayLike, dtype: np.dtype) -> NDArray[np.floating]:
    """Vertices as a contiguous (v, 3) array of that type, all finite."""
    array = _rows("vertices", _numbers("vertices", value))
    with np.errstate(over="ignore"):
        array = np.ascontiguousarray(array, dtype)
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if len(bad):
        raise ValueError(f"vertices: row {bad[0]} is not finite in {dtype}: {array[bad[0]]} ({len(bad)} such rows)")
    return array


def check_faces(value: ArrayLike, vertex_count: int) -> NDArray[np.int32]:
    """Faces as a contiguous (m, 3) array of rows that exist."""
    array = _rows("faces", _numbers("faces", value, "iu"))
    bad = np.flatnonzero(((array < 0) | (array >= vertex_count)).any(axis=1))
    if len(bad):
        raise ValueError(
            f"faces: row {bad[0]} is {array[bad[0]].tolist()}, but there are {vertex_count} vertices, numbered from 0"
        )
    return np.ascontiguousarray(array, np.int32)


def check_points(name: str, value: ArrayLike, dtype: np.dtype) -> NDArray[np.floating]:
    """Origins or directions as an (n, 3) array of that type."""
    array = _numbers(name, value)
    with np.errstate(over="ignore"):
        return np.asarray(_rows(name, array[None] if array.shape == (3,) else array), dtype)


def columns_of(array: NDArray[np.floating], n: int) -> Columns:
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


def whole_strides(array: NDArray[np.floating]) -> NDArray[np.floating]:
    """The array, or a copy where its elements do not lie a whole number of elements apart."""
    whole = array.flags.aligned and not any(stride % array.itemsize for stride in array.strides)
    return array if whole else array.copy()


def check_limits(name: str, value: ArrayLike, dtype: np.dtype) -> NDArray[np.floating]:
    """Limits of t as a number or an (n,) array of that type."""
    array = _numbers(name, value)
    if array.ndim > 1:
        raise ValueError(f"{name}: expected a number or an (n,) array, got shape {array.shape}")
    with np.errstate(over="ignore"):
        return np.asarray(array, dtype)


def rays_from(rays: Rays, begin: int) -> Rays:
    """The same rays from number ``begin`` on."""
    return Rays(*(column._replace(start=column.start + begin * column.row) for column in rays))
