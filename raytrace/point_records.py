"""The record that queries about points return. Its comments are like those of ``records``; f is float32 or float64."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.record_display import displayed


@displayed
class ClosestPoint(NamedTuple):
    """Closest points of a mesh, one row per query point: p = (1 - u - v) v0 + u v1 + v v2, but for rounding."""

    p: NDArray[np.floating]  # (..., 3) f, world units; NaN: there is none
    distance: NDArray[np.floating]  # (...) f, world units; inf: no triangle has an area; NaN: the point is not finite
    prim_id: NDArray[np.int32]  # (...) i4: row of the faces; -1: there is none
    u: NDArray[np.floating]  # (...) f, 0..1: barycentric weight of v1; NaN: there is none
    v: NDArray[np.floating]  # (...) f, 0..1: barycentric weight of v2; NaN: there is none
