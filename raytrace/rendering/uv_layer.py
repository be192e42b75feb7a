"""The layer (AOV) ``uv``: texture coordinates at hits."""

import numpy as np
from numpy.typing import NDArray

from raytrace.passes.textures import uv_at
from raytrace.records import Hits, Scene


def uv_of(scene: Scene, hits: Hits) -> NDArray[np.float32]:
    """Return the texture coordinates at hits, (n, 2) float32; NaN for misses, and for meshes without uv."""
    uv = np.full((len(hits.t), 2), np.nan, np.float32)
    found, corners = np.flatnonzero(hits.prim_id >= 0), scene.corner_uv
    if corners is not None and len(found):
        point = (values[found].astype(np.float64) for values in (hits.u, hits.v))
        uv[found] = np.stack(uv_at(corners.reshape(-1), hits.prim_id[found], *point), axis=1)
    return uv
