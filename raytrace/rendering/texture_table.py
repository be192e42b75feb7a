"""The textures of a scene as kernels look them up, in one precision."""

from typing import Any

import numpy as np

from raytrace.passes.path_records import TextureTable
from raytrace.records import Scene
from raytrace.texture_records import ATTRIBUTE, Texture


def make_texture_table(scene: Scene, dtype: Any) -> TextureTable | None:
    """Textures of a scene; None where it has none. An image that several textures share is stored once."""
    textures, mesh = scene.textures, scene.mesh
    if textures is None:
        return None
    first, total = dict[Any, int](), 0
    for texture in textures.table:
        if _key(texture) not in first:
            first[_key(texture)] = total
            total += _texels(texture)
    texels = np.zeros((total, 3), dtype)
    for texture in textures.table:
        at = first[_key(texture)]
        texture.values(out=texels[at : at + texture.codes.size // 3])
    layout = [(each.kind, first[_key(each)], *np.maximum(each.codes.shape[1::-1], 1)) for each in textures.table]
    kinds = {texture.kind for texture in textures.table}
    with np.errstate(over="ignore"):  # coordinates that are infinite in this precision are looked up as 0
        uv = None if mesh.uv is None or kinds == {ATTRIBUTE} else mesh.uv.astype(dtype).ravel()
    return TextureTable(
        textures.reflectance,
        textures.emission,
        np.array(layout, np.int32).ravel(),
        np.array([texture.scale for texture in textures.table], dtype).ravel(),
        texels.ravel(),
        uv,
        None if mesh.colors is None or ATTRIBUTE not in kinds else mesh.colors.astype(dtype).ravel(),
    )


def _key(texture: Texture) -> tuple[int, int, float]:
    """What images have in common that are stored once: their codes, and what the codes mean."""
    table = texture.table
    return id(texture.codes), 0 if table is None else len(table), 0.0 if table is None else float(table[1])


def _texels(texture: Texture) -> int:
    return max(texture.codes.size // 3, 1)


def texture_bytes(scene: Scene, width: int) -> int:
    """Bytes of the tables of the textures of a scene, and of its environment image; width: bytes of a float."""
    image = 0 if scene.lights.image is None else 7 * scene.lights.image.texture.codes.size // 3 * 8  # while it is made
    if scene.textures is None:
        return image
    texels = sum({_key(texture): _texels(texture) for texture in scene.textures.table}.values())
    corners = sum(array.size for array in (scene.mesh.uv, scene.mesh.colors) if array is not None)
    return image + (3 * texels + corners) * width
