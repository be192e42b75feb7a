"""STL files to arrays, text and binary."""

import numpy as np

from raytrace.records import RawMesh

HEAD, ROW = 84, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])  # bytes; a triangle


def read_stl(data: bytes) -> RawMesh | None:
    r"""Read the triangles of an STL file; each has three vertices of its own.

    Parameters
    ----------
    data : bytes
        The file's content.

    Returns
    -------
    RawMesh or None
        None: it has no triangles.

    Raises
    ------
    ValueError
        What is wrong with it.

    Examples
    --------
    >>> facet = b"facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    >>> read_stl(b"solid\n" + facet + b"endsolid\n").vertices.tolist()
    [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    """
    announced = int.from_bytes(data[HEAD - 4 : HEAD], "little")
    if len(data) >= HEAD and len(data) == HEAD + announced * ROW.itemsize:  # some begin with "solid" too
        corners = np.frombuffer(data, ROW, announced, HEAD)["corners"].astype(np.float64)
    elif data[:80].lstrip()[:5].lower() == b"solid":
        corners = _text(data)
    else:
        raise ValueError(f"the header announces {announced} triangles, the file has {len(data)} bytes")
    if not len(corners):
        return None
    return RawMesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), None, None)


def _text(data: bytes) -> np.ndarray:
    """Corners (m, 3, 3) of the triangles of a text."""
    words = data.lower().split()
    if b"endsolid" not in words[-80:]:
        raise ValueError("the text ends before a solid does")
    begins = [i for i, word in enumerate(words) if word == b"vertex"]
    if len(begins) != 3 * words.count(b"endfacet"):
        raise ValueError(f"{words.count(b'endfacet')} facets have {len(begins)} vertices; expected 3 of each")
    numbers = [float(word) for i in begins for word in words[i + 1 : i + 4]]
    return np.array(numbers).reshape(-1, 3, 3)
