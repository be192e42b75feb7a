"""Read PNG files as linear light: at most 8 bits per channel, sRGB, opaque; other files are errors   [PNG]."""

import io
import zlib
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.image.decoding import TRANSPARENT, RefusedError, check_size, from_texts
from raytrace.image.exposure import MAX_STOPS
from raytrace.image.files import Contents, checked, srgb_decode
from raytrace.image.png import SIGNATURE

PIXEL_BYTES = 40  # peak memory per pixel while reading
PIECE = 2**20  # bytes decompressed at a time
GREY, RGB, PALETTE, GREY_ALPHA, ALPHA = 0, 2, 3, 4, 6  # colour types
CHANNELS = {GREY: 1, RGB: 3, PALETTE: 1, GREY_ALPHA: 2, ALPHA: 4}
DEPTHS = {GREY: (1, 2, 4, 8, 16), RGB: (8, 16), PALETTE: (1, 2, 4, 8), GREY_ALPHA: (8, 16), ALPHA: (8, 16)}
CRITICAL, ONCE = (b"IHDR", b"PLTE", b"IDAT", b"IEND"), (b"IHDR", b"PLTE", b"tRNS")
NOT_INTERLACED = ((0, 0, 1, 1),)  # left, top, steps across and down
ADAM7 = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))
GAMMA = 45455  # of sRGB, in units of 1e-5
PRIMARIES = (31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000)  # white, red, green, blue of sRGB, in the same unit
TOLERANCE = 0.02  # for gamma (relative) and primaries (absolute) that count as sRGB
MAX_DEVIATION = 4  # of 255: largest difference between a profile and sRGB that is accepted
SRGB_CODE_POINTS = bytes([1, 13, 0, 1])  # cICP: Rec. 709 primaries, sRGB curve, RGB, full range


class Header(NamedTuple):
    """Content of the chunk IHDR."""

    width: int
    height: int
    depth: int  # bits per channel
    kind: int  # colour type
    interlaced: bool

    def length(self) -> int:
        """Bytes of all rows, with one filter byte per row."""
        bits, total = self.depth * CHANNELS[self.kind], 0
        for left, top, across, down in ADAM7 if self.interlaced else NOT_INTERLACED:
            columns, rows = -((left - self.width) // across), -((top - self.height) // down)
            total += max(rows, 0) * (1 + (bits * columns + 7) // 8) if columns > 0 else 0
        return total


def read_png(data: bytes) -> Contents:
    """Arrays and provenance of a PNG file."""
    from PIL.PngImagePlugin import PngImageFile

    chunks, pixels = chunks_of(data)
    header = header_of(chunks.get(b"IHDR", b""))
    if header.depth == 16:
        raise RefusedError("16 bits per channel; use 8 bits, .exr or .npz")
    check_size(header.width * header.height, PIXEL_BYTES)
    check_frames(chunks)
    check_length(pixels, header.length())
    image = PngImageFile(io.BytesIO(data))  # Image.open has its own size limit, and warns
    check_colour(chunks, image)
    codes = _opaque(image, header, chunks)
    provenance = from_texts(image.info)
    light = srgb_decode(np.arange(256) / 255.0) * 2.0 ** -_exposure(provenance)
    return checked({"rgb": light.astype(np.float32)[codes]}), provenance


def chunks_of(data: bytes) -> tuple[dict[bytes, bytes], list[memoryview]]:
    """First chunk of each type, and all pixel chunks; checked here, because Pillow accepts many broken files."""
    if not data.startswith(SIGNATURE):
        raise ValueError("it does not begin with the PNG signature")
    found, pixels, before = dict[bytes, bytes](), list[memoryview](), b""
    at = len(SIGNATURE)
    if data[at + 4 : at + 8] != b"IHDR":
        raise ValueError("it does not begin with a header")
    while before != b"IEND":
        length, kind = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        end = at + 8 + length
        if end + 4 > len(data):
            raise ValueError("it is truncated")
        body, name = memoryview(data)[at + 8 : end], kind.decode("ascii", "replace")
        if zlib.crc32(body, zlib.crc32(kind)) != int.from_bytes(data[end : end + 4], "big"):
            raise ValueError(f"the checksum of its chunk {name} is wrong")
        if kind[:1].isupper() and kind not in CRITICAL:
            raise ValueError(f"its chunk {name} is not known")
        if kind in ONCE and (kind in found or pixels):
            raise ValueError(f"its chunk {name} appears twice or too late")
        if kind == b"IDAT":
            if pixels and before != kind:
                raise ValueError("its pixels are interrupted")
            pixels.append(body)
        elif kind not in found:
            found[kind] = bytes(body)
        at, before = end + 4, kind
    return found, pixels


def header_of(header: bytes) -> Header:
    """Content of the chunk IHDR; a ValueError if it is invalid."""
    if len(header) != 13:
        raise ValueError("it has no header")
    width, height = int.from_bytes(header[:4], "big"), int.from_bytes(header[4:8], "big")
    depth, kind, compression, filters, interlaced = header[8:]
    if not width or not height or depth not in DEPTHS.get(kind, ()) or compression or filters or interlaced > 1:
        raise ValueError("its header is invalid")
    return Header(width, height, depth, kind, bool(interlaced))


def check_frames(chunks: Mapping[bytes, bytes]) -> None:
    """Raise an error for an animation."""
    if b"acTL" in chunks and (frames := int.from_bytes(chunks[b"acTL"][:4], "big")) != 1:
        raise RefusedError(f"an animation of {frames} images; save one of them")


def check_length(pixels: list[memoryview], length: int) -> None:
    """Raise an error for fewer pixels than the header announces: Pillow would make the others black."""
    stream, found = zlib.decompressobj(), 0
    for body in pixels:
        rest: bytes | memoryview = body
        while rest and found < length:
            found += len(stream.decompress(rest, PIECE))
            rest = stream.unconsumed_tail
    while found < length and (piece := stream.decompress(stream.unconsumed_tail, PIECE)):
        found += len(piece)
    if found < length:
        raise ValueError(f"its pixels end after {found} of {length} bytes")


def _opaque(image: Any, header: Header, chunks: Mapping[bytes, bytes]) -> NDArray[np.uint8]:
    """Codes of the colours, (h, w, 3); an error if a pixel is not opaque."""
    if header.kind in (GREY, RGB):
        image.info.pop("transparency", None)  # one colour; Pillow does not scale it for less than 8 bits
        codes = np.asarray(image.convert("RGB"))
        if b"tRNS" in chunks and (codes == transparent_code(chunks[b"tRNS"], header)).all(axis=2).any():
            raise RefusedError(TRANSPARENT)
        return codes
    if header.kind == PALETTE:
        check_palette(image, chunks)
    four = np.asarray(image.convert("RGBA"))
    if (four[:, :, 3] != 255).any():
        raise RefusedError(TRANSPARENT)
    return four[:, :, :3]


def transparent_code(chunk: bytes, header: Header) -> NDArray[np.int64]:
    """Code of the colour that the chunk tRNS makes transparent, (1,) or (3,), as the pixels are decoded."""
    key, highest = chunk[: 2 if header.kind == GREY else 6], 2**header.depth - 1
    return np.frombuffer(key, ">u2").astype(np.int64) % (highest + 1) * max(255, highest) // highest


def check_palette(image: Any, chunks: Mapping[bytes, bytes]) -> None:
    """Raise an error for pixels without a colour."""
    if np.asarray(image).max() >= len(chunks.get(b"PLTE", b"")) // 3:
        raise ValueError("pixels with colours that its palette does not have")


def _exposure(provenance: dict[str, Any]) -> float:
    """Remove the exposure, in stops, from the provenance, and return it."""
    stops = provenance.pop("exposure", 0.0)
    number = isinstance(stops, int | float) and not isinstance(stops, bool)
    if not number or not -MAX_STOPS <= stops <= MAX_STOPS:
        raise RefusedError(
            f"its text raytrace:exposure is not a number from {-MAX_STOPS:g} to {MAX_STOPS:g}; remove it"
        )
    return float(stops)


# Colour: the chunks that define the colour space, in order of priority   [PNG, 4.3] -----------------------------------


def check_colour(chunks: Mapping[bytes, bytes], image: Any) -> None:
    """Raise an error for codes that are not sRGB: they would be read as other colours."""
    if b"cICP" in chunks:
        if chunks[b"cICP"] != SRGB_CODE_POINTS:
            raise RefusedError("its colours are not sRGB's (cICP); convert it to sRGB")
    elif b"iCCP" in chunks:
        check_profile(image)
    elif b"sRGB" not in chunks:
        _check_gamma(chunks.get(b"gAMA"), chunks.get(b"cHRM"))


def _check_gamma(gamma: bytes | None, primaries: bytes | None) -> None:
    if gamma is not None:
        value = int.from_bytes(gamma[:4], "big")
        if abs(value - GAMMA) > TOLERANCE * GAMMA:
            raise RefusedError(f"its gamma is {value / 1e5:g}, that of sRGB {GAMMA / 1e5:g}; convert it to sRGB")
    if primaries is not None:
        values = np.frombuffer(primaries.ljust(32, b"\0")[:32], ">u4")
        if np.abs(values - np.array(PRIMARIES, np.float64)).max() > TOLERANCE * 1e5:
            raise RefusedError("its primaries are not those of sRGB (cHRM); convert it to sRGB")


def check_profile(image: Any) -> None:
    """Raise an error for a Pillow image with a colour profile that is not sRGB within a tolerance."""
    from PIL import Image, ImageCms

    grey = image.mode in ("1", "L", "LA", "I;16")
    steps = np.linspace(0, 255, 6).round().astype(np.uint8)
    cube = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(1, -1, 3)
    given = Image.fromarray(np.ascontiguousarray(cube[:, :, 0] if grey else cube))
    try:
        profile = ImageCms.ImageCmsProfile(io.BytesIO(image.info["icc_profile"]))
        shown = ImageCms.profileToProfile(
            given,
            profile,
            ImageCms.createProfile("sRGB"),
            renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC,
            outputMode="RGB",
        )
    except (KeyError, OSError, ValueError, ImportError, ImageCms.PyCMSError):
        raise RefusedError("its colour profile can't be applied; convert it to sRGB") from None
    deviation = np.abs(np.asarray(shown).astype(int) - np.asarray(given.convert("RGB")).astype(int)).max()
    if deviation > MAX_DEVIATION:
        raise RefusedError("its colour profile is not that of sRGB; convert it to sRGB")
