"""PNG files to linear light: 8 bits a channel or less, sRGB, opaque; all else is refused by name   [PNG]."""

import io
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.decoding import TRANSPARENT, RefusedError, afford, from_texts
from raytrace.image import MAX_STOPS, Contents, checked, srgb_decode
from raytrace.png import SIGNATURE

PIXEL = 40  # bytes that are taken for a pixel while it is read
GREY, RGB, PALETTE = 0, 2, 3  # colour types
GAMMA = 45455  # of sRGB, in units of 1e-5
PRIMARIES = (31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000)  # white, red, green, blue of sRGB, likewise
NEAR = 0.02  # a gamma as near to that of sRGB, relative, and primaries as near, absolute, are taken as sRGB's
CODES = 4  # of 255: colours of a profile that differ by less from sRGB's are the same
SRGB_CODE_POINTS = bytes([1, 13, 0, 1])  # cICP: Rec. 709 primaries, sRGB curve, RGB, full range


def read_png(data: bytes) -> Contents:
    """Read a PNG."""
    from PIL.PngImagePlugin import PngImageFile

    chunks = _chunks(data)
    width, height, depth, kind = _check_header(chunks.get(b"IHDR", b""))
    afford(width * height, PIXEL)
    _check_frames(chunks)
    picture = PngImageFile(io.BytesIO(data))  # Image.open has a limit of its own, and warns
    _check_colour(chunks, picture)
    codes = _opaque(picture, depth, kind, chunks.get(b"tRNS"))
    provenance = from_texts(picture.info)
    light = srgb_decode(np.arange(256) / 255.0) * 2.0 ** -_exposure(provenance)
    return checked({"rgb": light.astype(np.float32)[codes]}), provenance


def _chunks(data: bytes) -> dict[bytes, bytes]:
    """The first chunk of each type; Pillow does not check all checksums."""
    if not data.startswith(SIGNATURE):
        raise ValueError("it does not begin as a PNG does")
    found: dict[bytes, bytes] = {}
    at = len(SIGNATURE)
    while b"IEND" not in found:
        length, kind = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        end = at + 8 + length
        if end + 4 > len(data):
            raise ValueError("it is cut short")
        body = memoryview(data)[at + 8 : end]
        if zlib.crc32(body, zlib.crc32(kind)) != int.from_bytes(data[end : end + 4], "big"):
            raise ValueError(f"the checksum of its chunk {kind.decode('ascii', 'replace')} is wrong")
        if kind not in found:
            found[kind] = b"" if kind == b"IDAT" else bytes(body)
        at = end + 4
    return found


def _check_header(header: bytes) -> tuple[int, int, int, int]:
    """Width, height, bits a channel, colour type."""
    if len(header) != 13:
        raise ValueError("it has no header")
    width, height = int.from_bytes(header[:4], "big"), int.from_bytes(header[4:8], "big")
    if header[8] == 16:
        raise RefusedError("16 bits a channel; use 8 bits, .exr or .npz")
    return width, height, header[8], header[9]


def _check_frames(chunks: dict[bytes, bytes]) -> None:
    if b"acTL" in chunks and (frames := int.from_bytes(chunks[b"acTL"][:4], "big")) != 1:
        raise RefusedError(f"an animation of {frames} images; save one of them")


def _opaque(picture: Any, depth: int, kind: int, key: bytes | None) -> NDArray[np.uint8]:
    """Codes of the colours, (h, w, 3), if all are opaque."""
    if kind in (GREY, RGB):
        picture.info.pop("transparency", None)  # one colour; Pillow does not scale that of fewer than 8 bits
        codes = np.asarray(picture.convert("RGB"))
        if key is not None:
            most = 2**depth - 1
            hidden = np.frombuffer(key[: 2 if kind == GREY else 6], ">u2").astype(np.int64) % (most + 1) * 255 // most
            if (codes == hidden).all(axis=2).any():
                raise RefusedError(TRANSPARENT)
        return codes
    four = np.asarray(picture.convert("RGBA"))
    if (four[:, :, 3] != 255).any():
        raise RefusedError(TRANSPARENT)
    return four[:, :, :3]


def _exposure(provenance: dict[str, Any]) -> float:
    """Stops that the light was multiplied by; they leave the provenance."""
    stops = provenance.pop("exposure", 0.0)
    number = isinstance(stops, int | float) and not isinstance(stops, bool)
    if not number or not -MAX_STOPS <= stops <= MAX_STOPS:
        raise RefusedError(f"its text raytrace:exposure is no number from {-MAX_STOPS:g} to {MAX_STOPS:g}; remove it")
    return float(stops)


# Colour: what says that the codes are sRGB's, the strongest first   [PNG, 4.3] ----------------------------------------


def _check_colour(chunks: dict[bytes, bytes], picture: Any) -> None:
    """Refuse codes that are not sRGB's: they would be taken for other colours."""
    if b"cICP" in chunks:
        if chunks[b"cICP"] != SRGB_CODE_POINTS:
            raise RefusedError("its colours are not sRGB's (cICP); convert it to sRGB")
    elif b"iCCP" in chunks:
        check_profile(picture)
    elif b"sRGB" not in chunks:
        _check_gamma(chunks.get(b"gAMA"), chunks.get(b"cHRM"))


def _check_gamma(gamma: bytes | None, primaries: bytes | None) -> None:
    if gamma is not None:
        value = int.from_bytes(gamma[:4], "big")
        if abs(value - GAMMA) > NEAR * GAMMA:
            raise RefusedError(f"its gamma is {value / 1e5:g}, that of sRGB {GAMMA / 1e5:g}; convert it to sRGB")
    if primaries is not None:
        values = np.frombuffer(primaries.ljust(32, b"\0")[:32], ">u4")
        if np.abs(values - np.array(PRIMARIES, np.float64)).max() > NEAR * 1e5:
            raise RefusedError("its primaries are not those of sRGB (cHRM); convert it to sRGB")


def check_profile(picture: Any) -> None:
    """Refuse an image of Pillow with a colour profile that is not nearly sRGB."""
    from PIL import Image, ImageCms

    grey = picture.mode in ("1", "L", "LA")
    steps = np.linspace(0, 255, 6).round().astype(np.uint8)
    cube = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(1, -1, 3)
    given = Image.fromarray(np.ascontiguousarray(cube[:, :, 0] if grey else cube))
    try:
        profile = ImageCms.ImageCmsProfile(io.BytesIO(picture.info["icc_profile"]))
        shown = ImageCms.profileToProfile(
            given,
            profile,
            ImageCms.createProfile("sRGB"),
            renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC,
            outputMode="RGB",
        )
    except (KeyError, OSError, ValueError, ImageCms.PyCMSError):
        raise RefusedError("its colour profile can't be read; convert it to sRGB") from None
    off = np.abs(np.asarray(shown).astype(int) - np.asarray(given.convert("RGB")).astype(int)).max()
    if off > CODES:
        raise RefusedError("its colour profile is not that of sRGB; convert it to sRGB")
