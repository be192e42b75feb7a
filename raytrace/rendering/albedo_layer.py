"""The albedo of surfaces at hits, for the layer (AOV): of textures without a kernel."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.passes.textures import between, cell, colors_at, nearest_at, square_at, uv_at
from raytrace.records import Scene
from raytrace.texture_records import ATTRIBUTE, CHECKERBOARD, NEAREST, Texture

EPSILON = float(np.finfo(np.float64).eps)


def albedo_at(scene: Scene, prim_id: NDArray[np.integer], u: NDArray[Any], v: NDArray[Any]) -> NDArray[np.float64]:
    """Albedo or reflectance at points of triangles, (n, 3).

    Parameters
    ----------
    scene : Scene
    prim_id : (n,) int array
        Triangles.
    u, v : (n,) float arrays
        Barycentric weights of their second and third corners.
    """
    material = scene.mesh.material_id[prim_id]
    albedo = scene.materials.albedo[material]
    if scene.textures is None:
        return albedo
    numbers = scene.textures.reflectance[material]
    for number, texture in enumerate(scene.textures.table):
        rows = np.flatnonzero(numbers == number)
        if len(rows):
            point = prim_id[rows].astype(np.int32), u[rows].astype(np.float64), v[rows].astype(np.float64)
            with np.errstate(all="ignore"):  # coordinates that are not finite are looked up as 0
                albedo[rows] = np.stack(_colours(scene, texture, *point), axis=1)
    return albedo


def _colours(scene: Scene, texture: Texture, prim: NDArray[np.int32], u: NDArray[Any], v: NDArray[Any]) -> Any:
    """Colours of a texture: three arrays."""
    if texture.kind == ATTRIBUTE:
        assert scene.mesh.colors is not None
        return colors_at(scene.mesh.colors.reshape(-1), prim, u, v)
    assert scene.mesh.uv is not None
    s, t = uv_at(scene.mesh.uv.reshape(-1), prim, u, v)
    s, t = s * texture.scale[0], t * texture.scale[1]
    size = np.int32(texture.codes.shape[1]), np.int32(texture.codes.shape[0])
    flat = texture.codes.reshape(-1, 3)

    def colours(index: Any) -> Any:
        codes = flat[index]
        return (codes if texture.table is None else texture.table[codes]).astype(np.float64).T

    if texture.kind == CHECKERBOARD:
        return colours(square_at(np.int32(0), s, t, EPSILON))
    if texture.kind == NEAREST:
        return colours(nearest_at(np.int32(0), size, s, t, EPSILON))
    x0, x1, tx = cell(s, size[0], EPSILON)
    y0, y1, ty = cell(t, size[1], EPSILON)
    low, high = y0 * size[0], y1 * size[0]
    bottom = between(colours(low + x0), colours(low + x1), tx)
    return between(bottom, between(colours(high + x0), colours(high + x1), tx), ty)
