"""The images of a scene as files: textures as PNG or EXR copies, upright; environments resampled."""

from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import FileError
from raytrace.exporting.equal_area import square_to_sphere
from raytrace.image import png
from raytrace.image.texels import srgb_table
from raytrace.texture_records import EnvironmentImage, Texture

SAMPLES = 2  # per side of a texel, where an environment is resampled to a square
LEAST, MOST = 512, 4096  # texels per side of this square
BAND = 64  # rows that are resampled at a time


def is_srgb8(texture: Texture) -> bool:
    """Whether the texels of an image are sRGB codes of 8 bits, which a PNG holds without a change."""
    return texture.codes.dtype == np.uint8 and texture.table is not None and bool(texture.table[128] < 0.3)


def texture_file(texture: Texture) -> tuple[str, bytes]:
    """Return the suffix and the content of an image file with the texels of a texture, top row first."""
    if is_srgb8(texture) and np.array_equal(texture.table, srgb_table(8)):  # type: ignore[arg-type]
        return ".png", png.encode(np.ascontiguousarray(texture.codes[::-1]), {})
    return ".exr", exr_bytes(linear_texels(texture)[::-1])


def linear_texels(texture: Texture) -> NDArray[np.float32]:
    """Linear colours of an image, (h, w, 3), row 0 at the bottom."""
    values = np.empty((texture.codes.size // 3, 3), np.float32)
    texture.values(out=values)
    return values.reshape(texture.codes.shape)


def check_exr() -> None:
    """Raise a FileError if EXR files can't be written."""
    if find_spec("OpenEXR") is None:
        raise FileError("other renderers read images of light as EXR, which needs OpenEXR: pip install OpenEXR")


def exr_bytes(rgb: NDArray[Any]) -> bytes:
    """Return linear colours (h, w, 3) as an EXR file of float32; a FileError without OpenEXR."""
    import io

    check_exr()
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    planes = np.moveaxis(np.asarray(rgb, np.float32), 2, 0).copy()
    stream = io.BytesIO()
    with OpenEXR.File(header, dict(zip("RGB", planes, strict=True))) as file:
        file.write(stream)
    return stream.getvalue()


def radiance_of(image: EnvironmentImage) -> NDArray[np.float32]:
    """Radiance of the texels of an environment, (h, w, 3), row 0 up."""
    return linear_texels(image.texture)[::-1] * np.float32(image.scale)


def rows_at_ends(texels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Resample the rows of an environment for a renderer that has row j at v = j / (h - 1).

    Ours lie at v = (j + 1/2) / h. 2 h + 1 rows, at our centres and halfway between them, have the same interpolated
    radiance everywhere.
    """
    height = len(texels)
    rows = np.clip((np.arange(2 * height + 1) - 1) / 2, 0, height - 1)
    low, high = np.floor(rows).astype(int), np.ceil(rows).astype(int)
    return (texels[low] + texels[high]) / 2


def look_up(texels: NDArray[np.float32], directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bilinear radiance (n, 3) of a latitude-longitude image in unit directions (n, 3) of its own frame, y up."""
    height, width = texels.shape[:2]
    u = np.arctan2(directions[:, 0], -directions[:, 2]) / (2 * np.pi) % 1.0
    v = np.arccos(np.clip(directions[:, 1], -1.0, 1.0)) / np.pi
    x, y = u * width - 0.5, np.clip(v * height - 0.5, 0.0, height - 1.0)
    left, top = np.floor(x).astype(int), np.minimum(np.floor(y).astype(int), max(height - 2, 0))
    a, b = (x - left)[:, None], (y - top)[:, None]
    below, right = np.minimum(top + 1, height - 1), (left + 1) % width
    left %= width
    upper = (1 - a) * texels[top, left] + a * texels[top, right]
    lower = (1 - a) * texels[below, left] + a * texels[below, right]
    return np.asarray((1 - b) * upper + b * lower, np.float64)


def equal_area_square(image: EnvironmentImage, side: int | None = None) -> NDArray[np.float32]:
    """Resample an environment to the square of `square_to_sphere`, in world space: the mean over each texel.

    Parameters
    ----------
    image : EnvironmentImage
    side : int, optional
        Texels per side. Default: a power of two from `LEAST` to `MOST`, with four times the image's texels if it can.
    """
    texels = radiance_of(image)
    if side is None:
        wanted = 2 * np.sqrt(texels.shape[0] * texels.shape[1])
        side = min(max(LEAST, 1 << int(np.ceil(np.log2(wanted)))), MOST)
    found = np.empty((side, side, 3), np.float32)
    across = (np.arange(side * SAMPLES) + 0.5) / (side * SAMPLES)
    for top in range(0, side, BAND):
        count = min(BAND, side - top)
        down = across[top * SAMPLES : (top + count) * SAMPLES]
        x, y = (each.ravel() for each in np.meshgrid(across, down))
        values = look_up(texels, square_to_sphere(x, y) @ image.turn)
        found[top : top + count] = values.reshape(count, SAMPLES, side, SAMPLES, 3).mean(axis=(1, 3))
    return found
