"""Image files (PNG, EXR, NPZ) with provenance, and conversion between linear radiance and sRGB.

- ``.png``: 8-bit sRGB without layers; provenance in text chunks ``raytrace:<key>``.
- ``.exr``: float32 channels as in `CHANNELS`, ZIP; provenance in attributes ``raytrace:<key>``.
- ``.npz``: arrays ``rgb`` and one for each layer, under its name in `CHANNELS`; ``provenance`` is one JSON text.

A provenance value in a PNG or EXR is JSON, so texts and numbers keep their types. The integers ``prim_id`` and
``samples`` are UINT in an EXR, with the same bits: a miss, -1, is 4294967295 there. The same content always gives the
same bytes.
"""

import io
import json
import os
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.errors import FileError, FileMemoryError, printable, shortened
from raytrace.files import write_whole
from raytrace.image import png
from raytrace.image.exposure import Exposure, stops_of
from raytrace.image.paths import check_path, suffix_of

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # (3,) f8: Y of linear Rec. 709 and sRGB primaries   [ITU-R BT.709-6]
MAX_REASON = 300  # characters
ROWS = 64  # rows converted to sRGB at a time
PROVENANCE = "provenance"  # name of the array in an NPZ
KEY = "raytrace:"  # prefix of provenance keys in PNG and EXR files
NOTHING: Mapping[str, Any] = MappingProxyType({})
CHANNELS: dict[str, tuple[str, ...]] = {  # channels of an EXR, as <layer>.<channel>
    "rgb": ("R", "G", "B"),
    "stderr": ("stderr.Y",),
    "var": ("variance.R", "variance.G", "variance.B"),
    "depth": ("depth.Z",),
    "normal": ("normal.X", "normal.Y", "normal.Z"),
    "albedo": ("albedo.R", "albedo.G", "albedo.B"),
    "prim_id": ("prim_id.id",),
    "position": ("position.X", "position.Y", "position.Z"),
    "samples": ("samples.n",),
    "emission": ("emission.R", "emission.G", "emission.B"),
    "direct": ("direct.R", "direct.G", "direct.B"),
    "indirect": ("indirect.R", "indirect.G", "indirect.B"),
    "uv": ("uv.U", "uv.V"),
}
WHOLE = ("prim_id", "samples")  # int32; the others are float32
Contents = tuple[dict[str, NDArray[Any]], dict[str, Any]]  # arrays by name, provenance


class LoadedImage(NamedTuple):
    """Content of an image file."""

    rgb: NDArray[np.float32]  # (h, w, 3) f4, linear radiance, row 0 at the top
    stderr: NDArray[np.float32] | None  # (h, w) f4, standard error of the pixel's luminance; None: not in the file
    aov: dict[str, NDArray[Any]]  # by name: (h, w) or (h, w, 3), f4 or i4
    provenance: dict[str, Any]  # how the image was made: version, seed, spp, ...
    var: NDArray[np.float32] | None = None  # (h, w, 3) f4, variance of each channel's mean; None: not in the file


def srgb_encode(linear: ArrayLike) -> NDArray[np.float64]:
    """Encode linear light as sRGB codes; 0..1 maps to 0..1, and the linear part extends below 0.

    >>> srgb_encode([0.0, 0.5, 1.0]).round(4).tolist()
    [0.0, 0.7354, 1.0]
    """
    x = np.asarray(linear, np.float64)
    # 12.92 x, or 1.055 x^(1 / 2.4) - 0.055 above 0.0031308   [IEC 61966-2-1]
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 0.0) ** (1 / 2.4) - 0.055)


def srgb_decode(code: ArrayLike) -> NDArray[np.float64]:
    """Decode sRGB codes 0..1 to linear light; the inverse of `srgb_encode`."""
    x = np.asarray(code, np.float64)
    return np.where(x <= 0.04045, x / 12.92, ((np.maximum(x, 0.0) + 0.055) / 1.055) ** 2.4)


def srgb8(rgb: ArrayLike, exposure: Exposure = 0.0) -> NDArray[np.uint8]:
    """Convert linear radiance to 8-bit sRGB: ``floor(255 encode(clip(rgb 2**exposure, 0, 1)) + 1/2)``.

    NaN becomes 0, inf 255. `rgb` has any shape; `exposure` is in stops, -100..100, or "auto" for an image; else a
    ValueError.

    >>> srgb8([0.0, 0.5, 2.0]).tolist()
    [0, 188, 255]
    """
    white = 2.0 ** -stops_of(exposure, rgb)
    linear = np.nan_to_num(np.clip(np.asarray(rgb, np.float64), 0.0, white) / white)  # NaN to 0
    return (255.0 * srgb_encode(linear) + 0.5).astype(np.uint8)


def png_bytes(rgb: ArrayLike, provenance: Mapping[str, Any] = NOTHING, exposure: Exposure = 0.0) -> bytes:
    """Encode (h, w, 3) linear radiance as an 8-bit PNG; `load` reverts the exposure, in stops or "auto".

    Raises
    ------
    ValueError
        The shape isn't (h, w, 3), or the exposure is out of range.
    """
    rows = checked({"rgb": rgb})["rgb"]
    exposure = stops_of(exposure, rows)
    code = np.empty(rows.shape, np.uint8)
    for top in range(0, len(rows), ROWS):  # float64 for the whole image would take eight times the memory
        code[top : top + ROWS] = srgb8(rows[top : top + ROWS], exposure)
    return png.encode(code, _to_texts({**provenance, "exposure": exposure}))


def save(
    path: str | os.PathLike[str],
    rgb: ArrayLike,
    *,
    stderr: ArrayLike | None = None,
    var: ArrayLike | None = None,
    aov: Mapping[str, ArrayLike] = NOTHING,
    provenance: Mapping[str, Any] = NOTHING,
    exposure: Exposure = 0.0,
) -> Path:
    """Write an image file, completely or not at all; the extension selects the format.

    Parameters
    ----------
    path : path
        Ends in .png, .exr or .npz.
    rgb : (h, w, 3) array of float
        Linear radiance, row 0 at the top; float32 in the file.
    stderr : (h, w) array of float, optional
        Standard error of the pixel's luminance.
    var : (h, w, 3) array of float, optional
        Variance of each channel's mean.
    aov : mapping of str to array
        ``depth prim_id samples`` (h, w), ``uv`` (h, w, 2), ``normal albedo position emission direct indirect``
        (h, w, 3).
    provenance : mapping of str to str, int or float
        How the image was made.
    exposure : float or "auto"
        Exposure of a PNG, in stops; "auto" chooses it (`raytrace.image.exposure.auto_exposure`), and the number stands
        in the provenance. The other formats store the radiance itself.

    Raises
    ------
    FileError
        The file can't be written; the message is one line.
    ValueError
        An array of the wrong shape, an unknown AOV, an exposure out of range.
    """
    path = check_path(path)
    errors = {name: array for name, array in (("stderr", stderr), ("var", var)) if array is not None}
    arrays = checked({"rgb": rgb, **errors, **aov})
    if path.suffix.lower() == ".png":
        write_whole(path, png_bytes(rgb, provenance, exposure))
    else:
        encode = _exr_bytes if path.suffix.lower() == ".exr" else _npz_bytes
        write_whole(path, encode(arrays, provenance))
    return path


def load(path: str | os.PathLike[str]) -> LoadedImage:
    """Read an image: PNG with up to 8 bits per channel, EXR with R, G and B, or NPZ as written by `save`.

    Raises
    ------
    FileError
        The file is missing or broken, or it has a feature that would be read incorrectly: 16 bits per channel, an alpha
        below 1, another colour space than sRGB, several images, a data window that is not the display window, or
        values out of range. The message is one line.
    """
    path = Path(path)
    suffix, name = suffix_of(path), printable(path)
    from raytrace.image import decoding, read_exr, read_npz, read_png

    read = {".png": read_png.read_png, ".exr": read_exr.read_exr, ".npz": read_npz.read_npz}[suffix]
    try:
        data = decoding.content(path)
    except FileError:
        raise
    except decoding.NoMemoryError as error:
        raise FileMemoryError(f"memory: {name}: {error}") from None
    except OSError as error:
        raise FileError(f"{name}: can't be read: {error.strerror or error}") from error
    except decoding.RefusedError as error:
        raise FileError(f"{name}: {error}") from None
    try:
        arrays, provenance = read(data)
    except decoding.NoMemoryError as error:
        raise FileMemoryError(f"memory: {name}: {error}") from None
    except decoding.RefusedError as error:
        raise FileError(f"{name}: {error}") from None
    except MemoryError as error:
        raise FileMemoryError(f"memory: {name}: takes more memory than there is; scale it down") from error
    except Exception as error:  # libraries raise various exceptions for broken files
        reason = shortened(printable(str(error).partition("\n")[0] or type(error).__name__), MAX_REASON)
        raise FileError(f"{name}: not a valid {suffix[1:].upper()} image: {reason}") from error
    rgb, stderr, var = arrays.pop("rgb"), arrays.pop("stderr", None), arrays.pop("var", None)
    return LoadedImage(rgb, stderr, arrays, provenance, var)


def checked(arrays: Mapping[str, ArrayLike]) -> dict[str, NDArray[Any]]:
    """Convert the arrays of an image to the types in files; a ValueError if their shapes do not match."""
    if unknown := arrays.keys() - CHANNELS.keys():
        raise ValueError(f"unknown layers {sorted(unknown)}; the known ones are {', '.join(CHANNELS)}")
    if "rgb" not in arrays:
        raise ValueError("no colour: an EXR has channels R, G and B, an NPZ an array rgb")
    size = np.shape(arrays["rgb"])[:2]
    checked = {name: _converted(name, array) for name, array in arrays.items()}
    for name, array in checked.items():
        count = len(CHANNELS[name])
        shape = (*size, count) if count > 1 else size
        if array.shape != shape or len(size) < 2 or array.size == 0:
            expected = "(height, width, 3)" if name == "rgb" else f"{shape}, as rgb has it"
            raise ValueError(f"{name}: expected shape {expected}, got {array.shape}")
    return checked


def _converted(name: str, values: ArrayLike) -> NDArray[Any]:
    """Values of a layer in the type of files; NaN and inf are kept."""
    array, target = np.asarray(values), np.dtype(np.int32 if name in WHOLE else np.float32)
    if array.dtype == target:
        return array
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name}: expected numbers, got {array.dtype.name}")
    with np.errstate(all="ignore"):
        converted = array.astype(target)
        same = converted == array if name in WHOLE else np.isfinite(converted) | ~np.isfinite(array)
    if not same.all():
        raise ValueError(f"{name}: values that {target.name} can't hold")
    return converted


def _to_texts(provenance: Mapping[str, Any]) -> dict[str, str]:
    return {KEY + key: json.dumps(value) for key, value in provenance.items()}


def _exr_bytes(arrays: Mapping[str, NDArray[Any]], provenance: Mapping[str, Any]) -> bytes:
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **_to_texts(provenance)}
    channels: dict[str, NDArray[Any]] = {}
    for name, array in arrays.items():
        planes = np.moveaxis(np.atleast_3d(array), 2, 0).copy()
        bits = np.uint32 if name in WHOLE else np.float32  # OpenEXR has no signed whole numbers
        channels.update(zip(CHANNELS[name], planes.view(bits), strict=True))
    stream = io.BytesIO()
    with OpenEXR.File(header, channels) as file:
        file.write(stream)
    return stream.getvalue()


def _npz_bytes(arrays: Mapping[str, NDArray[Any]], provenance: Mapping[str, Any]) -> bytes:
    stream = io.BytesIO()  # NumPy dates the members 1980-01-01: no clock in the bytes
    members: dict[str, Any] = {**arrays, PROVENANCE: np.array(json.dumps(dict(provenance)))}
    np.savez_compressed(stream, **members)
    return stream.getvalue()
