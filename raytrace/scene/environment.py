"""Reads the image of an environment light."""

from typing import Any

import numpy as np

from raytrace.errors import SceneError
from raytrace.image.texels import read_texels
from raytrace.limits import MAX_RADIANCE, MAX_TEXELS
from raytrace.scene.files import Reach, locate_image
from raytrace.scene.textures import check_values, image_texture, is_srgb
from raytrace.scene.transforms import rotation
from raytrace.texture_records import EnvironmentImage


def read_environment(light: Any, reach: Reach) -> EnvironmentImage:
    """Read the image of an environment light.

    Parameters
    ----------
    light : types.SimpleNamespace
        As the format reads it, with an ``image``.
    reach : Reach
        The folders that may be read, and the memory that may be used.

    Raises
    ------
    SceneError, FileError, ValueError
        What is wrong with the file.
    """
    file = reach.find(light.image)
    locate_image(file)
    srgb = is_srgb(light.image, None)
    codes = read_texels(file, srgb, reach.max_memory).codes
    if codes.size // 3 > MAX_TEXELS:
        raise SceneError([f"{light.image}: {codes.size // 3:,} texels; at most {MAX_TEXELS:,}"])
    check_values(codes, True, f"{light.image}: ", "texels")
    brightest = light.scale * (float(codes.max()) if codes.dtype.kind == "f" else 1.0)
    if brightest > MAX_RADIANCE:
        text = f"with scale {light.scale:g} its radiance is up to {brightest:.3g}; at most {MAX_RADIANCE:g}"
        raise SceneError([f"{light.image}: {text}"])
    turn = np.eye(3)
    for each in light.rotate:
        turn = rotation(each.axis, each.angle) @ turn
    texture = image_texture(np.ascontiguousarray(codes[::-1]), srgb, False, (1.0, 1.0))
    return EnvironmentImage(texture, light.scale, turn)
