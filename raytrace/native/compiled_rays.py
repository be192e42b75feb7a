"""Rays that compiled code of a user passes to a query: their shapes, and their conversion to the tree's type."""

from typing import Any

import numpy as np
from numba.core import types
from numba.core.errors import TypingError
from numba.extending import overload, register_jitable

from raytrace.native.caller import LAYOUT, LAYOUT_NUMBER

OTHER = "compiled with another release of raytrace: delete Numba's cached files of this function (__pycache__/*.nbi)"


def _points(value: Any, like: Any) -> Any:
    """Return one point or direction, or n of them, as a flat array of the type of ``like``."""


def _limits(value: Any, like: Any) -> Any:
    """Return one limit of t, or n of them, as a flat array of the type of ``like``."""


@overload(_points)
def _points_of(value: Any, like: Any) -> Any:
    if isinstance(value, types.BaseTuple) and len(value) == 3:

        def row(value: Any, like: Any) -> Any:
            flat = np.empty(3, like.dtype)
            flat[0], flat[1], flat[2] = value
            return flat

        return row
    if not isinstance(value, types.Array) or value.ndim > 2:
        raise TypingError(f"origin, direction: expected 3 numbers or an (n, 3) array, got {value}")
    same = value.dtype == like.dtype and value.layout == "C"

    def rows(value: Any, like: Any) -> Any:
        if value.shape[-1] != 3:
            raise ValueError("origin, direction: expected 3 numbers or an (n, 3) array")
        return value.ravel() if same else value.astype(like.dtype).ravel()

    return rows


@overload(_limits)
def _limits_of(value: Any, like: Any) -> Any:
    def single(value: Any, like: Any) -> Any:
        return np.full(1, value, like.dtype)

    def several(value: Any, like: Any) -> Any:
        return value.astype(like.dtype)

    return several if isinstance(value, types.Array) else single


@register_jitable
def gathered(scene: Any, origin: Any, direction: Any, tmin: Any, tmax: Any) -> Any:
    """Return the fields of n rays as flat arrays; and the elements from one ray to the next in each, then n."""
    like = scene.extent
    o, d, low, high = _points(origin, like), _points(direction, like), _limits(tmin, like), _limits(tmax, like)
    counts = (len(o) // 3, len(d) // 3, len(low), len(high))
    n = 1
    for count in counts:
        n = count if n == 1 else n
    for count in counts:
        if count != 1 and count != n:
            raise ValueError("origin, direction, tmin, tmax: lengths do not match")
    o_row, d_row = 3 * (counts[0] == n), 3 * (counts[1] == n)
    return (o, d, low, high), (o_row, d_row, 1 * (counts[2] == n), 1 * (counts[3] == n), n)


@register_jitable
def check(words: Any) -> None:
    """Raise an error if ``words`` have another layout than the code that is compiled here writes."""
    if words[LAYOUT] != LAYOUT_NUMBER:
        raise RuntimeError(OTHER)


@register_jitable
def ray(origin: Any, direction: Any, tmin: Any, tmax: Any) -> Any:
    """Return the 8 numbers of one ray."""
    if len(origin) != 3 or len(direction) != 3:
        raise ValueError("origin, direction: expected 3 numbers or an (n, 3) array")
    return origin[0], origin[1], origin[2], direction[0], direction[1], direction[2], tmin, tmax
