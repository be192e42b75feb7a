"""Picture files to arrays: PNG, EXR and NPZ, by readers that make nothing that a file only announces."""

import contextlib
import io
import json
import math
import os
import threading
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from raytrace.image import CHANNELS, KEY, PROVENANCE, Contents, checked, srgb_decode
from raytrace.limits import MAX_PIXELS
from raytrace.memory import Allowance

PIXEL, NUMBER = 90, 40  # bytes that are taken, while it is read, for a pixel of a PNG, a number of an EXR or NPZ
_mute = threading.Lock()  # held while stderr leads nowhere
if hasattr(os, "register_at_fork"):  # no child may begin in the midst of that
    os.register_at_fork(before=_mute.acquire, after_in_parent=_mute.release, after_in_child=_mute.release)


class RefusedError(ValueError):
    """A picture that there is no room for, or that is none."""


class NoMemoryError(RefusedError):
    """A picture that there is not enough memory for."""


def content(path: Path) -> bytes:
    """Content of a picture file, if it is one and not too large."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise RefusedError("no regular file; name a picture")
    _afford(1, path.stat().st_size)
    return path.read_bytes()


def _afford(pixels: int, each: float) -> None:
    """Refuse a picture that is too large, before anything is made of it; each: bytes a pixel."""
    if pixels > MAX_PIXELS:
        raise RefusedError(f"it has {pixels:,} pixels; at most {MAX_PIXELS:,}")
    if lacks := Allowance().lacks(pixels * each, "scale it down"):
        raise NoMemoryError(lacks.partition(", or ")[0])


def read_png(data: bytes) -> Contents:
    """Read a PNG of 8 bits a channel."""
    from PIL.PngImagePlugin import PngImageFile

    _afford(int.from_bytes(data[16:20], "big") * int.from_bytes(data[20:24], "big"), PIXEL)
    picture = PngImageFile(io.BytesIO(data))  # Image.open has a limit of its own, and warns
    if picture.mode.startswith("I"):
        raise ValueError("16 bits a channel; use 8 bits, .exr or .npz")
    code = np.asarray(picture.convert("RGB")) / 255.0
    provenance = _from_texts(picture.info)
    stops = float(provenance.pop("exposure", 0.0))
    return checked({"rgb": srgb_decode(code) * 2.0**-stops}), provenance


@contextlib.contextmanager
def _muted() -> Iterator[None]:
    """Keep what OpenEXR says of a broken file off the terminal: it writes past Python's streams."""
    with _mute, contextlib.redirect_stdout(None):
        stderr, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 2)
        try:
            yield
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
            os.close(nowhere)


def read_exr(data: bytes) -> Contents:
    """Read an EXR."""
    import OpenEXR

    with _muted():
        for part in OpenEXR.File(io.BytesIO(data), header_only=True).parts:
            low, high = (np.asarray(corner, np.int64) for corner in part.header["dataWindow"])
            _afford(int(np.prod(np.maximum(high - low + 1, 0))), NUMBER * len(part.header["channels"]))
        file = OpenEXR.File(io.BytesIO(data), separate_channels=True)
    if not file.parts:
        raise ValueError("broken, or cut short")
    planes = {name: channel.pixels for name, channel in file.channels().items()}
    arrays = {}
    for name, channels in CHANNELS.items():
        if planes.keys() >= set(channels):
            stack = np.stack([planes[channel] for channel in channels], axis=2)
            bits = stack.view(np.int32) if stack.dtype == np.uint32 else stack
            arrays[name] = bits if len(channels) == 3 else bits[:, :, 0]
    return checked(arrays), _from_texts(file.header())


def read_npz(data: bytes) -> Contents:
    """Read an NPZ."""
    with zipfile.ZipFile(io.BytesIO(data)) as file:
        known = [
            member for member in file.infolist() if member.filename.removesuffix(".npy") in (*CHANNELS, PROVENANCE)
        ]
        _afford(1, sum(member.file_size for member in known) * NUMBER / 4)
        for member in known:
            _check_member(file, member)
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        arrays = checked({name: file[name] for name in CHANNELS if name in file})
        return arrays, json.loads(str(file[PROVENANCE])) if PROVENANCE in file else {}


def _check_member(file: zipfile.ZipFile, member: zipfile.ZipInfo) -> None:
    """Refuse an array whose header announces more than its file holds: room for it would be made first."""
    with file.open(member) as stream:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(stream)
    if math.prod(shape) * dtype.itemsize > member.file_size:
        raise ValueError(f"{member.filename} announces {shape} of {dtype}, it has {member.file_size} bytes")


def _from_texts(texts: Mapping[Any, Any]) -> dict[str, Any]:
    ours = [key for key, text in texts.items() if isinstance(text, str) and str(key).startswith(KEY)]
    return {key.removeprefix(KEY): json.loads(texts[key]) for key in ours}
