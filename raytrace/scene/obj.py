"""Wavefront OBJ text to arrays.

An own reader, because trimesh 5.2 takes 0.5 s to import, knows no line numbers, and passes over what should be an
error: index 0, faces of two corners, relative indices that don't count from the last vertex so far. 318 k triangles
take about 1 s with either. The text is worked on in bulk; a line is looked at alone only where it is irregular.
Materials, texture coordinates, groups, lines and points are passed over.
"""

from collections.abc import Callable
from itertools import chain, repeat
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import shortened
from raytrace.records import RawMesh

Words = list[bytes]
Integers = NDArray[np.int64]


class ObjError(ValueError):
    """Text that is no OBJ.

    Parameters
    ----------
    line : int
        Number of the line to blame, from 1.
    text : str
        What is wrong with it.
    """

    def __init__(self, line: int, text: str) -> None:
        self.line = line
        super().__init__(text)


class _Statements(NamedTuple):
    """The statements of one keyword: their words without it, and for each statement its line and number of words."""

    words: Words
    lines: Integers
    sizes: Integers


def _lines(data: bytes) -> Words:
    """Return the lines, made regular where one is not: no tabs, indents or comments; a continued one at its last."""
    lines = data.splitlines()
    comment_lines = data.count(b"\n#") + data.startswith(b"#")
    irregular = any(mark in b"\n" + data for mark in (b"\\", b"\t", b"\n "))
    if data.count(b"#") == comment_lines and not irregular:
        return lines
    begun: Words = []
    for i, line in enumerate(lines):
        begun += line.partition(b"#")[0].split()
        if begun and begun[-1].endswith(b"\\"):
            begun[-1], lines[i] = begun[-1][:-1], b""
        else:
            begun, lines[i] = [], b" ".join(begun)
    return lines


def _gather(lines: Words, key: bytes, most: int) -> _Statements:
    """Return the statements that begin with a key, cut to at most so many words."""
    start = key + b" "
    found = [i for i, line in enumerate(lines) if line.startswith(start)]
    words = b" ".join([lines[i] for i in found]).split()
    numbers = np.array(found, np.int64) + 1
    if len(words) == 4 * len(found) == 4 * words[::4].count(key):  # three words each: nearly always
        del words[::4]
        return _Statements(words, numbers, np.full(len(found), 3))
    rows = [lines[i].split()[1 : most + 1] for i in found]
    sizes = np.array([len(row) for row in rows])
    if sizes.min() < 3:
        short = int(np.argmin(sizes))
        what = "a face of at least 3 corners" if key == b"f" else "3 numbers"
        raise ObjError(int(numbers[short]), f"expected {what}, got {sizes[short]}")
    return _Statements(list(chain.from_iterable(rows)), numbers, sizes)


def _shown(word: bytes) -> str:
    return repr(shortened(word.decode("utf-8", "replace")))


def _convert(words: Words, kind: Callable[[bytes], Any], what: str, line_of: Callable[[int], int]) -> NDArray[Any]:
    """Turn words into an array, or blame the line of the first that won't."""
    dtype = np.dtype(np.float64 if kind is float else np.int64)
    try:
        return np.array(list(map(kind, words)), dtype)
    except (ValueError, OverflowError):
        for i, word in enumerate(words):
            try:
                dtype.type(kind(word))
            except (ValueError, OverflowError):
                raise ObjError(line_of(i), f"expected {what}, got {_shown(word)}") from None
        raise


def _numbers(rows: _Statements) -> NDArray[np.float64]:
    return _convert(rows.words, float, "a number", lambda i: int(rows.lines[i // 3])).reshape(-1, 3)


def _references(words: Words, lines: Integers, target: _Statements, what: str) -> Integers:
    """Return the row of the target that each corner refers to: from 1, or negative and counted back; 0 gives -1."""
    index = _convert(words, int, f"the index of a {what}", lambda i: int(lines[i]))
    count = len(target.lines)
    row = index - 1
    back = np.flatnonzero(index < 0)
    row[back] = index[back] + np.searchsorted(target.lines, lines[back])
    wrong = (row >= count) | ((row < 0) & ((index != 0) | (what == "vertex")))
    if wrong.any():
        first = int(np.argmax(wrong))
        text = f"{what} {index[first]} does not exist; the file has {count}, counted from 1"
        raise ObjError(int(lines[first]), text)
    return row


def _parts(corners: Words, lines: Integers) -> tuple[Words, Words]:
    """Return the words of vertices and normals in corners v, v/vt, v//vn or v/vt/vn; where there is none, 0."""
    slashes = list(map(bytes.count, corners, repeat(b"/")))
    if not any(slashes):
        return corners, [b"0"] * len(corners)
    if max(slashes) > 2:
        first = next(i for i, count in enumerate(slashes) if count > 2)
        text = f"expected a corner v, v/vt, v//vn or v/vt/vn, got {_shown(corners[first])}"
        raise ObjError(int(lines[first]), text)
    if slashes.count(2) < len(corners):
        corners = [corner + b"/" * (2 - count) for corner, count in zip(corners, slashes, strict=True)]
    parts = b"/".join(corners).split(b"/")  # thrice as fast as a split for each corner
    return parts[::3], [part or b"0" for part in parts[2::3]]


def fan(sizes: Integers) -> Integers:
    """Return the corners (m, 3) of the triangles that polygons fall into: a fan about each one's first corner."""
    triangles = sizes - 2
    first = np.repeat(np.cumsum(sizes) - sizes, triangles)
    step = np.arange(triangles.sum()) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    return np.stack([first, first + step + 1, first + step + 2], axis=1)


def read_obj(data: bytes) -> RawMesh:
    r"""Read all triangles and polygons of an OBJ file.

    Parameters
    ----------
    data : bytes
        The file's content.

    Returns
    -------
    RawMesh
        Its polygons as fans of triangles; no triangles and no vertices where the file has no faces.

    Raises
    ------
    ObjError
        What is wrong, and in which line.

    Examples
    --------
    >>> read_obj(b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4").faces.tolist()
    [[0, 1, 2], [0, 2, 3]]
    """
    text = _lines(data)
    points, directions, faces = _gather(text, b"v", 3), _gather(text, b"vn", 3), _gather(text, b"f", len(data))
    vertices, normals = _numbers(points), _numbers(directions)
    finite = np.isfinite(vertices).all(axis=1)
    if not finite.all():
        row = int(np.argmin(finite))
        raise ObjError(int(points.lines[row]), f"vertex {row + 1} is not finite: {vertices[row].tolist()}")
    lines = np.repeat(faces.lines, faces.sizes)
    triangles = fan(faces.sizes)
    vertex_words, normal_words = _parts(faces.words, lines)
    rows = _references(vertex_words, lines, points, "vertex")[triangles]
    if not len(normals):
        return RawMesh(vertices, rows, None, None)
    return RawMesh(vertices, rows, normals, _references(normal_words, lines, directions, "normal")[triangles])
