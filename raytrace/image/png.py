"""Write PNG files with zlib only: to import a library takes longer than to encode a small image   [PNG]."""

import struct
import zlib
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

SIGNATURE = b"\x89PNG\r\n\x1a\n"
RGB, SUB = 2, 1  # colour type; filter: differences from the pixel to the left
PERCEPTUAL, GAMMA = (
    0,
    45455,
)  # rendering intent of sRGB; gamma 1 / 2.2 in units of 1e-5, for readers without sRGB   [11.3.2]


def encode(pixels: NDArray[np.uint8], texts: Mapping[str, str], level: int = -1) -> bytes:
    r"""Encode an image as PNG, without loss.

    Parameters
    ----------
    pixels : (h, w, 3) uint8 array
        sRGB.
    texts : mapping of str to str
        Text chunks; Latin-1, keys of at most 79 characters.
    level : int
        Compression level from 1 (fast) to 9; -1: zlib's default.

    Examples
    --------
    >>> encode(np.zeros((1, 1, 3), np.uint8), {})[:4]
    b'\x89PNG'
    """
    height, width, _ = pixels.shape
    rows = np.empty((height, 1 + 3 * width), np.uint8)
    rows[:, 0], rows[:, 1:4] = SUB, pixels[:, 0]
    rows[:, 4:] = (pixels[:, 1:] - pixels[:, :-1]).reshape(height, -1)  # modulo 256
    chunks = [
        _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, RGB, 0, 0, 0)),
        _chunk(b"sRGB", struct.pack(">B", PERCEPTUAL)),
        _chunk(b"gAMA", struct.pack(">I", GAMMA)),
        *(_chunk(b"tEXt", f"{key}\0{text}".encode("latin-1")) for key, text in texts.items()),
        _chunk(b"IDAT", zlib.compress(rows.tobytes(), level)),
        _chunk(b"IEND", b""),
    ]
    return b"".join([SIGNATURE, *chunks])


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
