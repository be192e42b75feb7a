"""Read NPZ files as linear light: arrays whose values fit the types of an image; other files are errors."""

import io
import math
import warnings
import zipfile
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from raytrace.image.decoding import RefusedError, check_size, from_json
from raytrace.image.files import CHANNELS, PROVENANCE, WHOLE, Contents, checked

VALUE_BYTES = 40  # peak memory per value while reading
MAX_HEADER = 10_000  # bytes of an array's header; NumPy has the same limit


def read_npz(data: bytes) -> Contents:
    """Arrays and provenance of an NPZ file."""
    with zipfile.ZipFile(io.BytesIO(data)) as file:
        names = {member.filename: member for member in file.infolist()}
        known = {name: names[f"{name}.npy"] for name in (*CHANNELS, PROVENANCE) if f"{name}.npy" in names}
        check_size(1, sum(member.file_size for member in known.values()) * VALUE_BYTES / 4)
        arrays = {name: _array(file, member) for name, member in known.items()}
    provenance = _provenance(arrays.pop(PROVENANCE, None))
    for name, array in arrays.items():
        _check_kind(name, array)
    return checked(arrays), provenance


def _array(file: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[Any]:
    """Read one array; an error, before memory is allocated, if its header announces more than the member has."""
    with file.open(member) as stream, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about files written by Python 2
        binary = cast(BinaryIO, stream)
        version = np.lib.format.read_magic(binary)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, dtype = read(binary, max_header_size=MAX_HEADER)
        if dtype.hasobject:
            raise RefusedError(f"{member.filename} contains Python objects (a pickle); save numbers")
        size = math.prod(shape) * dtype.itemsize
        if min(shape, default=0) < 0 or size > member.file_size:
            raise ValueError(f"{member.filename} announces {shape} of {dtype}, it has {member.file_size} bytes")
        content = stream.read()  # to the end, where the checksum is verified
    if len(content) < size:
        raise ValueError(f"{member.filename} is truncated")
    flat = np.frombuffer(content, dtype, math.prod(shape)).copy() if size else np.zeros(math.prod(shape), dtype)
    return flat.reshape(shape[::-1]).transpose() if fortran else flat.reshape(shape)


def _check_kind(name: str, array: NDArray[Any]) -> None:
    """Raise an error for types whose meaning is unclear."""
    kinds, expected = ("iu", "whole numbers") if name in WHOLE else ("f", "floats")
    if array.dtype.kind not in kinds:
        raise RefusedError(f"{name}: expected {expected}, got {array.dtype.name}")


def _provenance(text: NDArray[Any] | None) -> dict[str, Any]:
    if text is None:
        return {}
    if text.dtype.kind != "U" or text.ndim != 0:
        raise RefusedError(f"{PROVENANCE}: expected a text, got {text.dtype.name} of shape {text.shape}")
    held = from_json(str(text), PROVENANCE)
    if not isinstance(held, dict):
        raise RefusedError(f"{PROVENANCE}: expected a JSON object")
    return held
