"""Numbers of a glTF file: buffers, views and accessors, each compared with the bytes that exist   [glTF, 3.6]."""

import base64
import binascii
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.scene.meshes.errors import TooLargeError, UnsupportedError
from raytrace.scene.meshes.glb_extensions import MESHOPT
from raytrace.scene.meshes.glb_json import Record, extension, item, record_in, whole

Rows = NDArray[Any]  # (n, width), of the file's own type
BYTE, UBYTE, SHORT, USHORT, UINT, FLOAT = 5120, 5121, 5122, 5123, 5125, 5126
TYPES = {BYTE: "<i1", UBYTE: "<u1", SHORT: "<i2", USHORT: "<u2", UINT: "<u4", FLOAT: "<f4"}
INDEX = UBYTE, USHORT, UINT
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
MAX_WORK = 2**29  # numbers of morph targets and skins that are read: about ten seconds


def _in_the_file(uri: str) -> bytes:
    text = "nothing else is opened or fetched; export one file"
    raise UnsupportedError(f"a buffer in another file, {uri[:200]}; {text}")


class Accessors:
    """The accessors of a file.

    Parameters
    ----------
    document : dict
        Its JSON.
    chunk : memoryview
        The binary chunk of a GLB file; empty where there is none.
    other : callable
        Reads the content of another file that a buffer names by its URI. By default such a buffer is an error.
    """

    def __init__(self, document: Record, chunk: memoryview, other: Callable[[str], bytes] = _in_the_file) -> None:
        self._document, self._chunk, self._other = document, chunk, other
        self._read: dict[int, memoryview] = {}
        self._work = 0

    def count(self, index: Any) -> int:
        """Return the number of rows that an accessor states."""
        return whole(item(self._document, "accessors", index), "count")

    def shape(self, index: Any) -> Any:
        """Return the type of the rows that an accessor states, such as "VEC3"."""
        return item(self._document, "accessors", index).get("type")

    def has_data(self, index: Any) -> bool:
        """Return whether an accessor has numbers of its own; otherwise all are 0."""
        return bool(item(self._document, "accessors", index).keys() & {"bufferView", "sparse"})

    def spend(self, count: int) -> None:
        """Add to the count of numbers read, and refuse too many."""
        self._work += count
        if self._work > MAX_WORK:
            raise TooLargeError(f"its morph targets and skins take more than {MAX_WORK:,} numbers; apply them first")

    def rows(self, index: Any, shape: str, kinds: tuple[int, ...], rows: NDArray[np.int64] | None = None) -> Rows:
        """Return rows of an accessor as they are stored; all of them if none are named.

        Parameters
        ----------
        index : int
            Of the accessor.
        shape : {"SCALAR", "VEC2", "VEC3", "VEC4", "MAT4"}
        kinds : tuple of int
            Component types that it may have.
        rows : (m,) int64, optional
            Rows that exist, in order.
        """
        accessor, name = item(self._document, "accessors", index), f"accessors[{index}]"
        kind = accessor.get("componentType")
        if type(kind) is not int or kind not in kinds or accessor.get("type") != shape:
            raise ValueError(f"{name} does not have the type that its use needs")
        dtype, count, width = np.dtype(TYPES[kind]), whole(accessor, "count"), WIDTHS[shape]
        if "bufferView" in accessor:
            found = self._view(accessor, dtype, (count, width), name)
        else:
            found = np.broadcast_to(np.zeros(1, dtype), (count, width))
        if rows is not None:
            found = found[rows]
        if "sparse" in accessor:
            found = self._replace(found, record_in(accessor, "sparse"), (count, width), name, rows)
        return found

    def floats(
        self, index: Any, shape: str, kinds: tuple[int, ...], rows: NDArray[np.int64] | None = None
    ) -> NDArray[np.float64]:
        """Return rows as numbers; normalised integers are fractions   [glTF, 3.11]."""
        found = self.rows(index, shape, kinds, rows)
        values = found.astype(np.float64)
        if found.dtype.kind != "f" and item(self._document, "accessors", index).get("normalized") is True:
            values = np.maximum(values / np.iinfo(found.dtype).max, -1.0)
        return values

    def _replace(
        self, found: Rows, sparse: Record, shape: tuple[int, int], name: str, rows: NDArray[np.int64] | None
    ) -> Rows:
        """Insert the rows that a sparse accessor replaces."""
        places, values, most = record_in(sparse, "indices"), record_in(sparse, "values"), whole(sparse, "count")
        kind = places.get("componentType")
        if type(kind) is not int or kind not in INDEX or most > shape[0]:
            raise ValueError(f"{name}: sparse: expected indices of at most {shape[0]} rows")
        where = self._view(places, np.dtype(TYPES[kind]), (most, 1), f"{name}: sparse")[:, 0].astype(np.int64)
        new = self._view(values, found.dtype, (most, shape[1]), f"{name}: sparse")
        if most and ((np.diff(where) <= 0).any() or where[-1] >= shape[0]):
            raise ValueError(f"{name}: sparse: the indices do not increase, or reach {shape[0]}")
        found = np.array(found)
        if rows is None:
            found[where] = new
        elif most:
            at = np.minimum(np.searchsorted(where, rows), most - 1)
            meant = where[at] == rows
            found[meant] = new[at[meant]]
        return found

    def _view(self, record: Record, dtype: np.dtype, shape: tuple[int, int], name: str) -> Rows:
        """Return rows as a view of the bytes, from an offset on."""
        view = item(self._document, "bufferViews", record.get("bufferView"))
        data = self._bytes(view)
        (count, width), offset = shape, whole(record, "byteOffset", 0)
        row = width * dtype.itemsize
        stride = whole(view, "byteStride", row)
        if stride < row:
            raise ValueError(f"{name} has rows of {row} bytes every {stride} bytes")
        if count and offset + (count - 1) * stride + row > len(data):
            raise ValueError(f"{name} states {count} rows of {row} bytes, its view has {len(data)} bytes")
        return np.ndarray(shape, dtype, data, offset if count else 0, (stride, dtype.itemsize))

    def _bytes(self, view: Record) -> memoryview:
        index = view.get("buffer", -1)
        record = item(self._document, "buffers", index)
        buffer = self._buffer(index, record)
        offset, length = whole(view, "byteOffset", 0), whole(view, "byteLength")
        compressed = next((name for name in MESHOPT if extension(view, name) is not None), None)
        placeholder = "uri" not in record and any((extension(record, name) or {}).get("fallback") for name in MESHOPT)
        if compressed and (placeholder or offset + length > len(buffer)):
            raise UnsupportedError(f"a view is compressed by {compressed}, which is not supported; export it without")
        if offset + length > len(buffer):
            raise ValueError(f"a view of {length} bytes from {offset} on leaves its buffer of {len(buffer)} bytes")
        return buffer[offset : offset + length]

    def _buffer(self, index: int, buffer: Record) -> memoryview:
        uri = buffer.get("uri")
        if uri is None:
            return self._chunk if index == 0 else memoryview(b"")
        if index not in self._read:
            if str(uri)[:5].lower() != "data:":
                self._read[index] = memoryview(self._other(str(uri)))
                return self._read[index]
            try:
                self._read[index] = memoryview(base64.b64decode(str(uri).partition(";base64,")[2], validate=True))
            except (binascii.Error, ValueError):
                raise ValueError(f"buffers[{index}]: its data is not base64") from None
        return self._read[index]
