"""Textures the slow way, texel by texel, for tests; images of several kinds, and scenes that have textures."""

import io
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from naive_sampling import film_points

Colours = np.ndarray


def bilinear(image: Colours, u: float, v: float) -> Colours:
    """Colour of an image, row 0 at the top, between the centres of its four nearest texels; it repeats."""
    height, width = image.shape[:2]
    x, y = u * width - 0.5, v * height - 0.5
    i, j = math.floor(x), math.floor(y)
    total = np.zeros(3)
    for di, dj in ((0, 0), (1, 0), (0, 1), (1, 1)):
        weight = (1 - abs(x - (i + di))) * (1 - abs(y - (j + dj)))
        total += weight * image[height - 1 - (j + dj) % height, (i + di) % width]
    return total


def nearest(image: Colours, u: float, v: float) -> Colours:
    """Colour of the texel in which a point lies; row 0 of the image is at the top."""
    height, width = image.shape[:2]
    return image[height - 1 - math.floor(v * height) % height, math.floor(u * width) % width]


def checkerboard(colours: Colours, u: float, v: float) -> Colours:
    """The first colour where floor(u) + floor(v) is even."""
    return np.asarray(colours[(math.floor(u) + math.floor(v)) % 2])


def head_on(size: tuple[int, int], material: dict[str, Any], **render: Any) -> dict[str, Any]:
    """A square from -1 to 1, seen from its front by a film that shows -0.999 to 0.999 of its height."""
    return {
        "camera": {"position": [0, 0, 0.999 / math.tan(math.radians(20))], "look_at": [0, 0, 0], "fov": 40},
        "film": {"size": list(size)},
        "render": {"spp": 1, "sampler": "independent", "max_depth": 1, **render},
        "materials": {"a": material},
        "objects": [{"rectangle": {}, "material": "a"}],
    }


def uv_of_pixels(size: tuple[int, int], seed: int = 0) -> np.ndarray:
    """uv (h, w, 2) of the square where the only sample of each pixel of ``head_on`` meets it."""
    (width, height), points = size, film_points("independent", seed, 1, (0, 0, *size))[:, :, 0]
    x = (points[..., 0] - width / 2) / (height / 2) * 0.999
    y = (height / 2 - points[..., 1]) / (height / 2) * 0.999
    return np.stack([(x + 1) / 2, (y + 1) / 2], axis=-1)


def expected(lookup: Callable[[float, float], Colours], size: tuple[int, int], scale: tuple[float, float]) -> Colours:
    """The image of ``head_on``."""
    uv = uv_of_pixels(size) * scale
    return np.array([[lookup(u, v) for u, v in row] for row in uv.tolist()])


def save_png16(path: Path, codes: np.ndarray) -> None:
    """Write a PNG of 16 bits per channel, RGB."""
    path.write_bytes(png16(codes))


def png16(codes: np.ndarray) -> bytes:
    """A PNG of 16 bits per channel, with 1 to 4 channels."""
    import struct
    import zlib

    height, width, channels = codes.shape
    head = struct.pack(">IIBBBBB", width, height, 16, {1: 0, 2: 4, 3: 2, 4: 6}[channels], 0, 0, 0)
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in codes)
    parts = (b"IHDR", head), (b"IDAT", zlib.compress(rows)), (b"IEND", b"")
    chunks = (
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body)) for kind, body in parts
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def exr(rgb: np.ndarray, dtype: Any = np.float32) -> bytes:
    """An EXR file."""
    import OpenEXR

    stream = io.BytesIO()
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    with OpenEXR.File(header, {"RGB": np.ascontiguousarray(rgb, dtype)}) as file:
        file.write(stream)
    return stream.getvalue()


def save_png(path: Path, codes: np.ndarray) -> None:
    """Write a PNG of 8 bits per channel."""
    Image.fromarray(codes).save(path)
