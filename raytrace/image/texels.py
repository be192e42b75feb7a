"""Reads the images of textures: PNG with up to 16 bits per channel, JPEG, and EXR; other files are errors.

An alpha channel is ignored, with a warning where it is below 1. Sizes are checked before anything is decoded.
"""

import io
import struct
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import FileError, FileMemoryError, SceneError, printable, shortened
from raytrace.image import read_png
from raytrace.image.decoding import NoMemoryError, RefusedError, check_size, content
from raytrace.image.read_png import ALPHA, GREY, GREY_ALPHA, PALETTE, RGB

SUFFIXES = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG", ".exr": "EXR"}
SIGNATURES = {b"\x89PNG": ".png", b"\xff\xd8\xff": ".jpg", b"v/1\x01": ".exr"}
JPEG_BYTES = 24  # peak memory per pixel while reading
MOST_PIXELS = 1024  # per byte of a JPEG: one bit for each block of 64, and less than that in progressive ones
MAX_SCANS = 100  # of a progressive JPEG; each one takes the time of a whole image
MAX_REASON = 200  # characters of a library's message
IGNORED = "its alpha is below 1 in places, and is ignored"
ENCODED = 'or set "encoding": "linear"'


class Texels(NamedTuple):
    """The pixels of an image file, row 0 at the top."""

    codes: NDArray[Any]  # (h, w, 3): u1 or u2 codes of PNG and JPEG; f4 linear values of EXR
    warning: str = ""  # what is ignored


def read_texels(path: Path, srgb: bool, max_memory: int | None = None) -> Texels:
    """Read an image file.

    Parameters
    ----------
    path : Path
        Its extension selects the format.
    srgb : bool
        Whether its codes are sRGB. Then a file that says otherwise is an error.
    max_memory : int, bytes, optional
        Memory that the process may use in total. Default: the free memory.

    Raises
    ------
    FileError
        The file can't be read, or there is not enough memory for it.
    SceneError
        Its content is wrong, or of a kind that is not supported.
    """
    name, suffix = printable(path), path.suffix.lower()
    if suffix == ".exr" and find_spec("OpenEXR") is None:
        raise FileError(f"{name}: EXR needs OpenEXR: pip install OpenEXR; or use .png")
    try:
        data = content(path, max_memory)
    except FileError:
        raise
    except NoMemoryError as error:
        raise FileMemoryError(f"memory: {name}: {error}") from None
    except OSError as error:
        raise FileError(f"{name}: can't be read: {error.strerror or error}") from error
    except RefusedError as error:
        raise FileError(f"{name}: {error}") from None
    return decode_texels(data, suffix, srgb, name, max_memory)


def decode_texels(data: bytes, suffix: str, srgb: bool, name: str, max_memory: int | None = None) -> Texels:
    """Decode the content of an image file; ``name`` begins the message of an error.

    Raises
    ------
    FileMemoryError
        There is not enough memory for it.
    SceneError
        Its content is wrong, or of a kind that is not supported.
    """
    decode: Callable[[bytes, bool, int | None], Texels] = {"PNG": _png, "JPEG": _jpeg, "EXR": _exr}[SUFFIXES[suffix]]
    try:
        return decode(data, srgb, max_memory)
    except NoMemoryError as error:
        raise FileMemoryError(f"memory: {name}: {error}") from None
    except RefusedError as error:
        raise SceneError([f"{name}: {error}"]) from None
    except MemoryError as error:
        raise FileMemoryError(f"memory: {name}: takes more memory than there is; scale it down") from error
    except Exception as error:  # libraries raise various exceptions for broken files
        reason = shortened(printable(str(error).partition("\n")[0] or type(error).__name__), MAX_REASON)
        raise SceneError([f"{name}: not a valid {SUFFIXES[suffix]} image: {reason}"]) from error


def suffix_of_content(data: bytes) -> str:
    """Return the extension that belongs to the first bytes of an image file; "" if they are of no known format.

    >>> suffix_of_content(bytes([255, 216, 255, 224]))
    '.jpg'
    """
    return next((suffix for signature, suffix in SIGNATURES.items() if data.startswith(signature)), "")


def srgb_table(bits: int) -> NDArray[np.float64]:
    """Linear values of the sRGB codes of 8 or 16 bits: the same numbers on every machine.

    ((c + 0.055) / 1.055)^2.4 is x^2 times the fifth root of x^2, by Newton's method [IEC 61966-2-1]. Functions that
    raise to a power are not the same in all C libraries; sums, products, quotients and square roots are.

    >>> srgb_table(8)[[0, 128, 255]].round(4).tolist()
    [0.0, 0.2159, 1.0]
    """
    codes = np.arange(2**bits) / (2**bits - 1)
    x = np.minimum((codes + 0.055) / 1.055, 1.0)
    square = x * x
    root = np.sqrt(x)
    for _ in range(8):
        power = root * root
        root = root - (root - square / (power * power)) / 5
    return np.where(codes <= 0.04045, codes / 12.92, square * root)


# PNG ------------------------------------------------------------------------------------------------------------------


def _png(data: bytes, srgb: bool, max_memory: int | None) -> Texels:
    from PIL.PngImagePlugin import PngImageFile

    chunks, pixels = read_png.chunks_of(data)
    header = read_png.header_of(chunks.get(b"IHDR", b""))
    check_size(header.width * header.height, read_png.PIXEL_BYTES, max_memory)
    read_png.check_frames(chunks)
    read_png.check_length(pixels, header.length())
    image = PngImageFile(io.BytesIO(data))  # Image.open has its own size limit, and warns
    if srgb:
        try:
            read_png.check_colour(chunks, image)
        except RefusedError as error:
            raise RefusedError(f"{error}, {ENCODED}") from None
    if header.depth == 16:
        planes = _planes16(pixels, header)
    elif header.kind == PALETTE:
        read_png.check_palette(image, chunks)
        planes = np.asarray(image.convert("RGBA"))
    else:
        image.info.pop("transparency", None)  # one colour; Pillow does not scale it for less than 8 bits
        planes = np.asarray(image.convert("RGBA"))
    opaque = np.iinfo(planes.dtype).max
    clear = header.kind in (PALETTE, GREY_ALPHA, ALPHA) and bool((planes[:, :, 3] != opaque).any())
    if header.kind in (GREY, RGB) and b"tRNS" in chunks:
        key = read_png.transparent_code(chunks[b"tRNS"], header)
        clear = bool((planes[:, :, :3] == key).all(axis=2).any())
    return Texels(np.ascontiguousarray(planes[:, :, :3]), IGNORED if clear else "")


def _planes16(pixels: list[memoryview], header: read_png.Header) -> NDArray[np.uint16]:
    """Codes of 16 bits, (h, w, 4).

    Pillow keeps 8 bits of each number. It is asked for the high ones and for the low ones, as modes of 8 bits whose
    pixels have the same number of bytes, so that the rows' filters are undone alike.
    """
    from PIL import Image

    size, packed = (header.width, header.height), b"".join(pixels)
    modes = {
        GREY: ("LA", ("LA",)),
        GREY_ALPHA: ("RGBA", ("RGBA",)),
        RGB: ("RGB", ("RGB;16B", "RGB;16L")),
        ALPHA: ("RGBA", ("RGBA;16B", "RGBA;16L")),
    }
    mode, raw = modes[header.kind]
    parts = [
        np.asarray(Image.frombytes(mode, size, packed, "zip", name, int(header.interlaced))).astype(np.uint16)
        for name in raw
    ]
    high, low = (parts[0][:, :, 0::2], parts[0][:, :, 1::2]) if len(parts) == 1 else parts
    codes = high << 8 | low
    planes = np.full((header.height, header.width, 4), 65535, np.uint16)
    planes[:, :, :3] = codes[:, :, : 3 if codes.shape[2] > 2 else 1]
    if header.kind in (GREY_ALPHA, ALPHA):
        planes[:, :, 3] = codes[:, :, -1]
    return planes


# JPEG and EXR ---------------------------------------------------------------------------------------------------------


def _jpeg(data: bytes, srgb: bool, max_memory: int | None) -> Texels:
    from PIL.JpegImagePlugin import JpegImageFile

    image = JpegImageFile(io.BytesIO(data))
    check_size(image.width * image.height, JPEG_BYTES, max_memory)
    if image.width * image.height > MOST_PIXELS * len(data):  # before memory is taken for them
        raise ValueError("it is truncated")
    if data.count(b"\xff\xda") > MAX_SCANS:
        raise RefusedError(f"more than {MAX_SCANS} scans; save it again")
    if image.mode not in ("L", "RGB"):
        raise RefusedError(f"its colours are {image.mode}; convert it to RGB")
    if srgb and "icc_profile" in image.info:
        try:
            read_png.check_profile(image)
        except RefusedError as error:
            raise RefusedError(f"{error}, {ENCODED}") from None
    turned = _orientation(image.info.get("exif", b"")) != 1
    codes = np.asarray(image.convert("RGB"))
    return Texels(np.ascontiguousarray(codes), "its orientation (EXIF) is ignored" if turned else "")


def _orientation(exif: bytes) -> int:
    """Tag "orientation" of EXIF data; 1, as it is, where that is missing or broken."""
    tiff = exif.removeprefix(b"Exif\0\0")
    order = {b"II": "<", b"MM": ">"}.get(tiff[:2])
    try:
        (at,) = struct.unpack_from(f"{order}I", tiff, 4)
        (count,) = struct.unpack_from(f"{order}H", tiff, at)
        for entry in range(at + 2, at + 2 + 12 * count, 12):
            tag, _, _, value = struct.unpack_from(f"{order}HHIH", tiff, entry)
            if tag == 0x0112:
                return int(value)
    except struct.error:
        return 1
    return 1


def _exr(data: bytes, srgb: bool, max_memory: int | None) -> Texels:
    from raytrace.image.read_exr import read_colours

    codes, opaque = read_colours(data, max_memory)
    return Texels(codes, "" if opaque else IGNORED)
