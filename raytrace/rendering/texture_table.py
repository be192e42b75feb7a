"""The textures of a scene as kernels look them up, in one precision."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.passes.path_records import TextureTable
from raytrace.records import ATTRIBUTE, Scene, Texture


def make_texture_table(scene: Scene, dtype: Any) -> TextureTable | None:
    """Textures of a scene; None where it has none. An image that several textures share is stored once."""
    textures, mesh = scene.textures, scene.mesh
    if textures is None:
        return None
    layout, texels, total = list[tuple[int, int, int, int]](), list[NDArray[Any]](), 0
    known: dict[tuple[int, int], int] = {}
    for texture in textures.table:
        height, width = max(texture.codes.shape[0], 1), max(texture.codes.shape[1], 1)
        key = id(texture.codes), 0 if texture.table is None else hash(texture.table.tobytes())
        if key not in known:
            known[key] = total
            values = texture.values(dtype) if texture.codes.size else np.zeros((1, 3), dtype)
            texels.append(values)
            total += len(values)
        layout.append((texture.kind, known[key], width, height))
    kinds = {texture.kind for texture in textures.table}
    return TextureTable(
        textures.reflectance,
        textures.emission,
        np.array(layout, np.int32).ravel(),
        np.array([texture.scale for texture in textures.table], dtype).ravel(),
        np.concatenate(texels).ravel(),
        None if mesh.uv is None or kinds == {ATTRIBUTE} else mesh.uv.astype(dtype).ravel(),
        None if mesh.colors is None or ATTRIBUTE not in kinds else mesh.colors.astype(dtype).ravel(),
    )


def texture_bytes(textures: tuple[Texture, ...], width: int) -> int:
    """Bytes of the texels of textures; width: bytes of a float."""
    return sum({id(texture.codes): texture.codes.size for texture in textures}.values()) * width
