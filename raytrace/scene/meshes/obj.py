"""Wavefront OBJ text to arrays.

Why trimesh does not read it is measured in docs/robustness.md. The text is processed in bulk; single lines are
processed only where they are irregular. Materials, groups, lines and points are ignored; texture coordinates and
colours are read where a scene needs them.
"""

from collections.abc import Callable
from itertools import chain, repeat
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import shortened
from raytrace.records import RawMesh
from raytrace.scene.attributes import COLOR, NOTHING, UV, Wanted
from raytrace.scene.meshes.polygons import PolygonError, triangulate
from raytrace.scene.meshes.words import INFINITE, NO_NUMBER, WordError, number, plain, to_array, whole

Words = list[bytes]
Integers = NDArray[np.int64]


class ObjError(ValueError):
    """The text is not valid OBJ.

    Parameters
    ----------
    line : int
        Number of the wrong line, from 1.
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
    odd: bool  # whether a word has a "_"


def _lines(data: bytes) -> Words:
    """Return the lines in regular form: no tabs, indents or comments; a continued line stands at its last one."""
    data = plain(data)
    lines = data.splitlines()
    comment_lines = data.count(b"\n#") + data.startswith(b"#")
    irregular = any(mark in b"\n" + data for mark in (b"\\", b"\t", b"\n ", b"\r "))
    if data.count(b"#") == comment_lines and not irregular:
        return lines
    if b"1.#" in data or b"1#" in data:  # no comments: what Microsoft's C library writes for NaN
        lines = INFINITE.sub(rb"\1inf", NO_NUMBER.sub(b"nan", data)).splitlines()
    begun: Words = []
    for i, line in enumerate(lines):
        begun += line.partition(b"#")[0].split()
        if begun and begun[-1].endswith(b"\\"):
            begun[-1], lines[i] = begun[-1][:-1], b""
        else:
            begun, lines[i] = [], b" ".join(begun)
    if begun:  # the last line is marked as continued
        lines[-1] = b" ".join(begun)
    return lines


def _gather(lines: Words, key: bytes, most: int, usual: int = 3, least: int = 3) -> _Statements:
    """Return the statements that begin with a key, cut to at most so many words."""
    start = key + b" "
    found = [i for i, line in enumerate(lines) if line.startswith(start)]
    if key in lines:  # a statement of the key alone is too short
        found = sorted([*found, *(i for i, line in enumerate(lines) if line == key)])
    joined = b" ".join([lines[i] for i in found])
    words, odd = joined.split(), b"_" in joined
    numbers = np.array(found, np.int64) + 1
    width = usual + 1
    if len(words) == width * len(found) == width * words[::width].count(key):  # nearly always
        del words[::width]
        return _Statements(words, numbers, np.full(len(found), usual), odd)
    rows = [lines[i].split()[1 : most + 1] for i in found]
    sizes = np.array([len(row) for row in rows])
    if sizes.min() < least:
        short = int(np.argmin(sizes))
        what = "a face of at least 3 corners" if key == b"f" else f"{least} number{'s' * (least > 1)}"
        raise ObjError(int(numbers[short]), f"expected {what}, got {sizes[short]}")
    return _Statements(list(chain.from_iterable(rows)), numbers, sizes, odd)


def _shown(word: bytes) -> str:
    return repr(shortened(word.decode("utf-8", "replace")))


def _convert(
    words: Words, odd: bool, kind: Callable[[bytes], Any], what: str, line_of: Callable[[int], int]
) -> NDArray[Any]:
    """Return words as an array, or report the line of the first that is not a number."""
    try:
        return to_array(words, kind, odd)
    except WordError as error:
        raise ObjError(line_of(error.place), f"expected {what}, got {_shown(error.word)}") from None


def _numbers(rows: _Statements) -> NDArray[np.float64]:
    return _convert(rows.words, rows.odd, number, "a number", lambda i: int(rows.lines[i // 3])).reshape(-1, 3)


def _padded(rows: _Statements, width: int, missing: float) -> NDArray[np.float64]:
    """Return the numbers (n, width) of statements that may have fewer."""
    found = _convert(rows.words, rows.odd, number, "a number", lambda i: int(np.repeat(rows.lines, rows.sizes)[i]))
    table = np.full((len(rows.lines), width), missing)
    table[np.arange(width) < rows.sizes[:, None]] = found
    return table


def _references(words: Words, odd: bool, lines: Integers, target: _Statements, what: str) -> Integers:
    """Return the row of the target that each corner refers to: from 1, or negative and counted back; 0 gives -1."""
    index = _convert(words, odd, whole, f"the index of a {what}", lambda i: int(lines[i]))
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


def _parts(corners: Words, lines: Integers) -> tuple[Words, Words, Words]:
    """Return the words of vertices, uv and normals in corners v, v/vt, v//vn or v/vt/vn; empty where there is none."""
    slashes = list(map(bytes.count, corners, repeat(b"/")))
    if not any(slashes):
        return corners, (none := [b""] * len(corners)), none
    if max(slashes) > 2:
        first = next(i for i, count in enumerate(slashes) if count > 2)
        text = f"expected a corner v, v/vt, v//vn or v/vt/vn, got {_shown(corners[first])}"
        raise ObjError(int(lines[first]), text)
    if slashes.count(2) < len(corners):
        corners = [corner + b"/" * (2 - count) for corner, count in zip(corners, slashes, strict=True)]
    parts = b"/".join(corners).split(b"/")  # three times as fast as a split for each corner
    return parts[::3], parts[1::3], parts[2::3]


def _or_0(words: Words) -> Words:
    return [word or b"0" for word in words]


def read_obj(data: bytes, wanted: Wanted = NOTHING) -> RawMesh:
    r"""Read all triangles and polygons of an OBJ file.

    Parameters
    ----------
    data : bytes
        The file's content.
    wanted : set of {"uv", "color"}
        Attributes that are read too, if the file has them.

    Returns
    -------
    RawMesh
        Its polygons as triangles; no triangles where the file has no faces.

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
    points, faces = _gather(text, b"v", 3), _gather(text, b"f", len(data))
    vertices, lines = _numbers(points), np.repeat(faces.lines, faces.sizes)
    vertex_words, uv_words, normal_words = _parts(faces.words, lines)
    rows = _references(vertex_words, faces.odd, lines, points, "vertex")
    _check_finite(vertices, rows, points.lines)
    try:
        triangles = triangulate(vertices, rows, faces.sizes)
    except PolygonError as error:
        raise ObjError(int(faces.lines[error.polygon]), str(error)) from None
    mesh = RawMesh(vertices, rows[triangles], None, None)
    if UV in wanted and len((places := _gather(text, b"vt", 2, 2, 1)).lines):
        uv = np.append(_padded(places, 2, 0.0), [[np.nan, np.nan]], axis=0)  # the last row, -1, is that of none
        mesh = mesh._replace(
            uv=uv[_references(_or_0(uv_words), faces.odd, lines, places, "texture coordinate")[triangles]]
        )
    if COLOR in wanted:
        colored = _gather(text, b"v", 6, 6)
        colors = np.where(colored.sizes[:, None] == 6, _padded(colored, 6, np.nan)[:, 3:], np.nan)
        mesh = mesh._replace(colors=None if np.isnan(colors).all() else colors[mesh.faces])
    try:  # faults of normals matter only where the normals are used
        directions = _gather(text, b"vn", 3)
        normals = _numbers(directions)
        if not len(normals):
            return mesh
        normal_rows = _references(_or_0(normal_words), faces.odd, lines, directions, "normal")
    except ObjError as error:
        return mesh._replace(normals_fault=f":{error.line}: {error}")
    return mesh._replace(normals=normals, normal_faces=normal_rows[triangles])


def _check_finite(vertices: NDArray[np.float64], rows: Integers, lines: Integers) -> None:
    """Report the line of the first vertex that is used and not finite."""
    finite = np.isfinite(vertices).all(axis=1)
    if not finite.all():
        bad = np.intersect1d(np.flatnonzero(~finite), rows)
        if len(bad):
            row = int(bad[0])
            raise ObjError(int(lines[row]), f"vertex {row + 1} is not finite: {vertices[row].tolist()}")
