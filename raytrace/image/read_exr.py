"""Read EXR files as linear light: one flat, opaque RGB image that fills its window; other files are errors."""

import contextlib
import io
import os
import threading
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.image.decoding import TRANSPARENT, RefusedError, check_size, from_texts
from raytrace.image.exr_chunks import pixels_complete
from raytrace.image.files import CHANNELS, WHOLE, Contents, checked

VALUE_BYTES = 40  # peak memory per value while reading
ALPHAS = {"A", "AR", "AG", "AB"}
PRIMARIES = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)  # red, green, blue, white   [ITU-R BT.709-6]
TOLERANCE = 0.01  # primaries within this distance count as equal
_mute = threading.Lock()  # held while stderr is redirected
if hasattr(os, "register_at_fork"):  # no fork during the redirection
    os.register_at_fork(before=_mute.acquire, after_in_parent=_mute.release, after_in_child=_mute.release)


def read_exr(data: bytes) -> Contents:
    """Arrays and provenance of an EXR file."""
    planes, header = _planes(data)
    if not _opaque(planes):
        raise RefusedError(TRANSPARENT)
    return checked(_layers(planes)), from_texts(header)


def read_colours(data: bytes, max_memory: int | None = None) -> tuple[NDArray[np.float32], bool]:
    """Colours of an EXR file, (h, w, 3), and whether every pixel is opaque."""
    planes, _ = _planes(data, max_memory)
    colours = {name: planes[name] for name in CHANNELS["rgb"]}
    return _layers(colours)["rgb"].astype(np.float32), _opaque(planes)


def _opaque(planes: Mapping[str, NDArray[Any]]) -> bool:
    return all((planes[name] == 1).all() for name in ALPHAS & planes.keys())


def _planes(data: bytes, max_memory: int | None = None) -> tuple[dict[str, NDArray[Any]], Mapping[str, Any]]:
    """Channels by name, and the header."""
    import OpenEXR

    try:
        headers = [part.header for part in OpenEXR.File(io.BytesIO(data), header_only=True).parts]
    except RuntimeError as error:  # its reason names a file that the library makes up
        raise ValueError("its header is broken or truncated") from error
    for header in headers:
        low, high = _corners(header["dataWindow"])
        pixels, size = int(np.prod(np.maximum(high - low + 1, 0))), VALUE_BYTES * len(header["channels"])
        check_size(pixels, size, max_memory)
    part = _colour_part(headers)
    _check_header(headers[part])
    with contextlib.nullcontext() if pixels_complete(data) else _muted():
        file = OpenEXR.File(io.BytesIO(data), separate_channels=True)
    if len(file.parts) != len(headers):
        raise ValueError("broken or truncated")
    return {name: channel.pixels for name, channel in file.channels(part).items()}, file.header(part)


def _colour_part(headers: list[dict[str, Any]]) -> int:
    """Index of the part with channels R, G and B."""
    names = [{channel.name for channel in header["channels"]} for header in headers]
    found = [k for k, known in enumerate(names) if known >= set(CHANNELS["rgb"])]
    if not found:
        raise RefusedError("no colour: an EXR has channels R, G and B")
    if len(found) > 1:
        raise RefusedError(f"{len(found)} parts with channels R, G and B; save one of them")
    return found[0]


def _check_header(header: Mapping[str, Any]) -> None:
    """Raise an error for features that would be read incorrectly."""
    import OpenEXR

    if header.get("type") not in (None, OpenEXR.scanlineimage, OpenEXR.tiledimage):
        raise RefusedError("deep pixels; flatten it")
    if any((channel.xSampling, channel.ySampling) != (1, 1) for channel in header["channels"]):
        raise RefusedError("subsampled channels; save all channels at full size")
    (low, high), (left, right) = _corners(header["dataWindow"]), _corners(header["displayWindow"])
    if (low != left).any() or (high != right).any():
        data, display = (f"({a[0]}, {a[1]})-({b[0]}, {b[1]})" for a, b in ((low, high), (left, right)))
        raise RefusedError(f"its data window {data} is not its display window {display}; crop or pad it to that")
    primaries = header.get("chromaticities")
    if primaries is not None and not np.allclose(np.ravel(primaries), PRIMARIES, rtol=0, atol=TOLERANCE):
        raise RefusedError("its primaries are not those of sRGB (chromaticities); convert it to linear sRGB")


def _corners(window: Any) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    low, high = (np.asarray(corner, np.int64) for corner in window)
    return low, high


def _layers(planes: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    arrays = {}
    for name, channels in CHANNELS.items():
        if planes.keys() >= set(channels):
            types = {planes[channel].dtype for channel in channels}
            if (np.dtype(np.uint32) in types) != (name in WHOLE):
                expected = "UINT" if name in WHOLE else "HALF or FLOAT"
                raise RefusedError(f"{name}: expected channels of type {expected}")
            stack = np.stack([planes[channel] for channel in channels], axis=2)
            bits = stack.view(np.int32) if name in WHOLE else stack
            arrays[name] = bits if len(channels) > 1 else bits[:, :, 0]
    return arrays


@contextlib.contextmanager
def _muted() -> Iterator[None]:
    """Suppress messages of OpenEXR about broken files: it does not write through Python's streams.

    This silences the whole process, so it is only used for files that are not known to be complete.
    """
    with _mute, contextlib.redirect_stdout(None):
        stderr, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 2)
        try:
            yield
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
            os.close(nowhere)
