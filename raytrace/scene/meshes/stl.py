"""STL files to arrays, text and binary."""

import re

import numpy as np

from raytrace.records import RawMesh
from raytrace.scene.meshes.words import WordError, number, plain, to_array

HEAD, ROW = 84, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])  # bytes; a triangle
TEXT_BEGIN = re.compile(rb"(?:\xef\xbb\xbf)?\s*(?:solid|facet)[^\0]*", re.IGNORECASE)
SOLID = re.compile(rb"solid[^\n]*")  # with a name, which may be any words
PARTED = re.compile(rb"\bend\s+(facet|loop|solid)\b")


def is_binary(data: bytes) -> bool:
    """Return whether a file has exactly the length for the number of triangles in its binary header."""
    return len(data) >= HEAD and len(data) == HEAD + _announced(data) * ROW.itemsize


def is_text(data: bytes) -> bool:
    """Return whether a file begins like a text; the headers of many binary files begin with "solid" too."""
    begin = TEXT_BEGIN.match(data[:HEAD])
    return not is_binary(data) and begin is not None and begin.end() == len(data[:HEAD])


def _announced(data: bytes) -> int:
    return int.from_bytes(data[HEAD - 4 : HEAD], "little")


def read_stl(data: bytes) -> RawMesh | None:
    r"""Return the triangles of an STL file; each has three vertices of its own.

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
    if is_binary(data):
        corners = np.frombuffer(data, ROW, _announced(data), HEAD)["corners"].astype(np.float64)
    elif is_text(data):
        corners = _text(plain(data).replace(b"\r", b"\n").lower())
    else:
        raise ValueError(f"the header states {_announced(data)} triangles, the file has {len(data)} bytes")
    if not len(corners):
        return None
    return RawMesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), None, None)


def _statements(text: bytes) -> bytes:
    """Return the text without the names of its solids; "endsolid" is left where one ends."""
    pieces, kept = [], 0
    for match in SOLID.finditer(text):
        line = text.rfind(b"\n", 0, match.start()) + 1
        before = text[line : match.start()].strip()
        if before in (b"", b"end"):
            pieces += [text[kept:line], b"endsolid" if before else b""]
            kept = match.end()
    return b"".join([*pieces, text[kept:]])


def _one_a_line(statements: bytes) -> np.ndarray | None:
    """Return the corners of a valid text with one statement per line, as nearly all have; None for others."""
    count = 3 * statements.count(b"endfacet")
    ended = statements.rfind(b"endsolid") > statements.rfind(b"vertex")
    if not (count and ended and statements.count(b"vertex") == count):
        return None
    lines = statements.lstrip().split(b"\n")
    words = b" ".join(_third_to_fifth(lines, count)).split()
    if not len(words) == 4 * count == 4 * words[::4].count(b"vertex"):
        words = b" ".join([line for line in lines if b"vertex" in line]).split()
        if not len(words) == 4 * count == 4 * words[::4].count(b"vertex"):
            return None
    del words[::4]
    try:
        return to_array(words, number, b"_" in statements).reshape(-1, 3, 3)
    except WordError:
        return None


def _third_to_fifth(lines: list[bytes], count: int) -> list[bytes]:
    """So many of seven lines each: those of the vertices, where a facet has seven lines."""
    picked = [b""] * count
    if 7 * count <= 3 * len(lines):
        for k in range(3):
            picked[k::3] = lines[2 + k : 7 * count // 3 : 7]
    return picked


def _text(text: bytes) -> np.ndarray:
    """Return the corners (m, 3, 3) of the triangles of a lower-case text."""
    statements = _statements(text)
    numbers = _one_a_line(statements)
    if numbers is not None:
        return numbers
    if b"vertex" not in statements and b"vertex" in text:  # all of it is one line
        statements = text
    words = statements.split()
    if b"end" in words:
        words = PARTED.sub(rb"end\1", b" ".join(words)).split()
    begins = [i for i, word in enumerate(words) if word == b"vertex"]
    if b"endsolid" not in words[begins[-1] if begins else 0 :]:
        raise ValueError("the text ends before a solid does")
    if len(begins) != 3 * words.count(b"endfacet"):
        raise ValueError(f"{words.count(b'endfacet')} facets have {len(begins)} vertices; expected 3 of each")
    words += [b""] * 3
    try:
        return to_array([word for i in begins for word in words[i + 1 : i + 4]], number).reshape(-1, 3, 3)
    except WordError as error:
        raise ValueError(f"facet row {error.place // 9}: expected a number, got {error.word[:60]!r}") from None
