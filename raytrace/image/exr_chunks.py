"""Check that the pixels of an EXR file are complete: one scanline image, uncompressed or compressed by zlib.

OpenEXR writes messages about broken pixels directly to the stderr of the process, not through Python. A file that is
known to be complete needs no protection against that.
"""

import struct
import zlib

MAGIC, VERSION, LONG_NAMES = b"v/1\x01", 2, 0x4  # the flag is in the second byte after the magic number
LINES = {0: 1, 2: 1, 3: 16}  # lines per chunk: uncompressed, ZIPS, ZIP
PLAIN = 0
SIZES = {0: 4, 1: 2, 2: 4}  # bytes per value: UINT, HALF, FLOAT


def pixels_complete(data: bytes) -> bool:
    """Whether every chunk has the right position and size; False also for files that can't be checked here.

    >>> pixels_complete(b"hello")
    False
    """
    if data[:4] != MAGIC or data[4:5] != bytes([VERSION]) or any((data[5] & ~LONG_NAMES, *data[6:8])):
        return False  # tiles, several parts, deep pixels
    try:
        attributes, at = _attributes(data)
        compression, channels = attributes["compression", "compression"][0], attributes["channels", "chlist"]
        left, top, right, bottom = struct.unpack("<4i", attributes["dataWindow", "box2i"])
        if attributes["lineOrder", "lineOrder"] not in (b"\0", b"\1"):
            return False
        row, lines = (right - left + 1) * _bytes_of(channels), LINES[compression]
        height = bottom - top + 1
        offsets = struct.unpack_from(f"<{-(-height // lines)}Q", data, at)
        for k, offset in enumerate(offsets):
            y, size = struct.unpack_from("<ii", data, offset)
            full = row * min(lines, height - k * lines)
            if y != top + k * lines or not 0 < size <= full or offset + 8 + size > len(data):
                return False
            if size < full and (compression == PLAIN or not _inflates_to(data[offset + 8 : offset + 8 + size], full)):
                return False
    except (KeyError, IndexError, ValueError, OverflowError, struct.error, zlib.error):
        return False
    return bool(offsets)


def _attributes(data: bytes) -> tuple[dict[tuple[str, str], bytes], int]:
    """Attributes of the header, by name and type, and the offset of its end."""
    found: dict[tuple[str, str], bytes] = {}
    names, at = set[str](), 8
    while data[at]:
        name_end = data.index(0, at)
        type_end = data.index(0, name_end + 1)
        (size,) = struct.unpack_from("<i", data, type_end + 1)
        start = type_end + 5
        name, kind = data[at:name_end].decode("ascii"), data[name_end + 1 : type_end].decode("ascii")
        if size < 0 or start + size >= len(data) or name in names:
            raise ValueError("an attribute is truncated or duplicate")
        names.add(name)
        found[name, kind] = data[start : start + size]
        at = start + size
    return found, at + 1


def _bytes_of(channels: bytes) -> int:
    """Bytes per pixel; a ValueError for subsampled channels."""
    total, at = 0, 0
    while channels[at]:
        end = channels.index(0, at)
        channels[at:end].decode("ascii")  # OpenEXR can't read other names
        at = end + 1
        kind, _, across, down = struct.unpack_from("<iIii", channels, at)
        if (across, down) != (1, 1):
            raise ValueError("a subsampled channel")
        total, at = total + SIZES[kind], at + 16
    return total


def _inflates_to(packed: bytes, size: int) -> bool:
    """Whether a chunk is one zlib stream of this decompressed size."""
    stream = zlib.decompressobj()
    return len(stream.decompress(packed, size + 1)) == size and stream.eof and not stream.unused_data
