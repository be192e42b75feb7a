"""Whether a mesh file has vertex colours, by its first lines alone."""

import zlib
from pathlib import Path

from raytrace.files import open_regular
from raytrace.scene.files import format_of
from raytrace.scene.meshes.ply_corners import COLOR_NAMES

FIRST = 1 << 16  # bytes that are read
GZIP = zlib.MAX_WBITS | 16  # the format of gzip files


def has_vertex_colors(path: Path) -> bool:
    """Return whether a PLY or OBJ file has vertex colours; False for a file that can't be read."""
    kind = format_of(path)
    if kind not in (".ply", ".obj"):
        return False
    try:
        with open_regular(path) as stream:
            data = stream.read(FIRST)
        if path.suffix.lower() == ".gz":
            data = zlib.decompressobj(GZIP).decompress(data, FIRST)
    except (OSError, zlib.error):  # reported when the mesh is read
        return False
    lines = [line.split() for line in data.splitlines()]
    if kind == ".obj":
        return next((len(words) >= 7 for words in lines if words[:1] == [b"v"]), False)
    names, element = set(), b""
    for words in lines:
        if words[:1] == [b"end_header"]:
            break
        element = words[1] if words[:1] == [b"element"] and len(words) > 1 else element
        if words[:1] == [b"property"] and element == b"vertex":
            names.add(words[-1].decode("latin-1"))
    return any(names >= set(each) for each in COLOR_NAMES)
