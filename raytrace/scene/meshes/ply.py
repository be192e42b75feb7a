"""PLY files to arrays.

Rows of equal length, the usual case, are read all at once; others one by one.
Edges and all other data are ignored; texture coordinates and colours are read where a scene needs them.
"""

import re
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from raytrace.records import RawMesh
from raytrace.scene.attributes import NOTHING, Wanted
from raytrace.scene.meshes.ply_binary import Bytes
from raytrace.scene.meshes.ply_text import NEEDED, Column, Element, Property, Text, words_by_lines
from raytrace.scene.meshes.polygons import PolygonError, triangulate
from raytrace.scene.meshes.words import BOM, plain

TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4"}
TYPES |= {"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4"}
TYPES |= {"double": "f8", "float64": "f8", "int64": "i8", "uint64": "u8", "half": "f2", "float16": "f2"}
UNKNOWN = "?"  # an unknown type, allowed only in a text, where every number is a word
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
CORNERS = NEEDED["face"]  # names of the list of a face's corners
END = re.compile(rb"(?:^|[\r\n])end_header[ \t]*(\r\n|\n|\r|$)")
MAX_HEADER = 2**20  # bytes

Array = NDArray[Any]
Integers = NDArray[np.int64]
Numbers = dict[str, tuple[Integers, Array]]  # by property: how many in each row, and all of them


class Source(Protocol):
    """The numbers of a file, and the position of the next one, in units of the source."""

    at: int
    end: int

    def size(self, kind: str) -> int:
        """Return how many units a number takes."""

    def length(self, kind: str) -> int:
        """Return the number before a list."""

    def table(self, columns: list[Column], rows: int) -> list[Array]:
        """Return rows of numbers: for each column an array (rows, numbers per row)."""

    def at_places(self, column: Column, places: Integers, rows: Integers) -> Array:
        """Return numbers at any positions, of the given rows."""


def _header(data: bytes) -> tuple[str, list[Element], bytes | memoryview]:
    """Return the byte order (none: text), the elements, and the rest of the data."""
    end = END.search(data, 0, MAX_HEADER)
    if end is None:
        raise ValueError(f"the header has no end in the first {MAX_HEADER} bytes")
    lines = [line.split() for line in data[: end.start()].removeprefix(BOM).splitlines()]
    if lines[:1] != [[b"ply"]]:
        raise ValueError('the first line is not "ply"')
    order, elements = "?", list[Element]()
    for words in lines[1:]:
        line = " ".join(word.decode("utf-8", "replace") for word in words)
        match line.split(" "):
            case ["format", name, *_] if name in ORDERS:
                order = ORDERS[name]
            case ["element", name, rows] if rows.isascii() and rows.isdigit():
                elements.append(Element(name, int(rows), []))
            case ["property", "list", length, kind, name] if elements:
                elements[-1].properties.append(Property(name, _kind(kind), _kind(length)))
            case ["property", kind, name] if elements:
                elements[-1].properties.append(Property(name, _kind(kind), None))
            case ["comment" | "obj_info", *_] | [""]:
                pass
            case _:
                raise ValueError(f"its header has a line of no known kind: {line[:60]}")
    if order == "?":
        raise ValueError("its header names no format")
    if order:
        _check_types(elements)
        return order, elements, memoryview(data)[end.end() :]
    return order, elements, plain(data[end.end() :])


def _kind(name: str) -> str:
    return TYPES.get(name.lower(), f"{UNKNOWN}{name}")


def _check_types(elements: list[Element]) -> None:
    """Refuse numbers of unknown size."""
    known = ", ".join(TYPES)
    for element in elements:
        for prop in element.properties:
            if prop.length and prop.length[0] in "f":
                raise ValueError(
                    f"property {prop.name} of element {element.name}: the length of a list is no whole number"
                )
            for kind in (prop.kind, prop.length or ""):
                if kind.startswith(UNKNOWN):
                    text = f"property {prop.name} of element {element.name} has the unknown type {kind[1:61]}"
                    raise ValueError(f"{text} (known: {known})")


def _step(source: Source, element: Element, row: int, prop: Property) -> tuple[int, int]:
    """Skip one property of one row; return how many numbers it has, and where they begin."""
    lacking = ValueError(f"the file ends before row {row} of element {element.name} does")
    if prop.length and source.at + source.size(prop.length) > source.end:
        raise lacking
    count = source.length(prop.length) if prop.length else 1
    if count < 0:
        raise ValueError(f"row {row} of element {element.name} has a list of {count} numbers")
    begin = source.at
    source.at += count * source.size(prop.kind)
    if source.at > source.end:
        raise lacking
    return count, begin


def _column(element: Element, prop: Property, many: int) -> Column:
    return Column(element.name, prop.name, prop.kind, many, prop.name in NEEDED.get(element.name, ()))


def _even(source: Source, element: Element) -> Numbers | None:
    """Return all numbers of an element whose rows have equal lengths; None if they have not."""
    start = source.at
    counts = [_step(source, element, 0, prop)[0] for prop in element.properties]
    columns = list[Column]()
    for prop, count in zip(element.properties, counts, strict=True):
        if prop.length:
            columns.append(Column(element.name, f"length of {prop.name}", prop.length, 1, True))
        columns.append(_column(element, prop, count))
    length, source.at = source.at - start, start
    if start + element.rows * length > source.end:
        return None
    try:
        table, found = iter(source.table(columns, element.rows)), Numbers()
    except ValueError:  # rows of other lengths, or words that are not numbers: reading row by row decides
        source.at = start
        return None
    for prop, count in zip(element.properties, counts, strict=True):
        if prop.length and (next(table) != count).any():
            source.at = start
            return None
        found[prop.name] = np.broadcast_to(count, element.rows), next(table).ravel()
    return found


def _uneven(source: Source, element: Element) -> Numbers:
    """Return all numbers of an element, read row by row."""
    if element.rows * len(element.properties) > source.end - source.at:  # of at least one unit each
        raise ValueError(f"the file ends before the {element.rows} rows of element {element.name} do")
    steps = np.empty((2, len(element.properties), element.rows), np.int64)
    for row in range(element.rows):
        for k, prop in enumerate(element.properties):
            steps[:, k, row] = _step(source, element, row, prop)
    found = {}
    for prop, counts, begins in zip(element.properties, *steps, strict=True):
        within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        places = np.repeat(begins, counts) + within * source.size(prop.kind)
        rows = np.repeat(np.arange(element.rows), counts)
        found[prop.name] = counts, source.at_places(_column(element, prop, 1), places, rows)
    return found


def _read(source: Source, elements: list[Element]) -> dict[str, Numbers]:
    return {e.name: _even(source, e) or _uneven(source, e) for e in elements}


def _read_text(body: bytes, elements: list[Element]) -> tuple[dict[str, Numbers], dict[tuple[str, str], str]]:
    """Read a text as a stream of words; where that fails, row by row if its lines are the rows.

    With what is wrong with its words, by element and property.
    """
    source, misfit = Text(body.split(), b"_" in body), None
    try:
        read = _read(source, elements)
    except ValueError as error:
        misfit = error
    if source.at < source.end or misfit:
        words = words_by_lines(body, elements)
        if words is not None:
            source = Text(words, b"_" in body)
            read, misfit = _read(source, elements), None
    if misfit:
        raise misfit
    return read, source.faults


def read_ply(data: bytes, wanted: Wanted = NOTHING) -> RawMesh | None:
    r"""Read the triangles, polygons and strips of a PLY file; polygons become triangles.

    Parameters
    ----------
    data : bytes
        The file's content, text or binary.
    wanted : set of {"uv", "color"}
        Attributes that are read too, if the file has them.

    Returns
    -------
    RawMesh or None
        None if it has no faces of at least three corners.

    Raises
    ------
    ValueError
        What is wrong with it.

    Examples
    --------
    >>> header = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    >>> faces = b"element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    >>> read_ply(header + faces + b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n").faces.tolist()
    [[0, 1, 2]]
    """
    order, elements, body = _header(data)
    elements = [element for element in elements if element.rows and element.properties]
    if order:
        read, faults = _read(Bytes(memoryview(body), order), elements), dict[tuple[str, str], str]()
    else:
        read, faults = _read_text(bytes(body), elements)
    vertex = read.get("vertex", {})
    if not {"x", "y", "z"} <= vertex.keys():
        return None
    vertices = np.stack([vertex[axis][1] for axis in "xyz"], axis=1).astype(np.float64)
    polygons, places = _polygons(read.get("face", {}), vertices)
    faces = np.concatenate([polygons, _strips(read.get("tristrips", {}))])
    if not len(faces):
        return None
    mesh = RawMesh(vertices, faces, None, None)
    if wanted and _in_range(faces, vertices):
        from raytrace.scene.meshes.ply_corners import with_attributes  # few scenes need it

        mesh = with_attributes(mesh, read, elements, places, wanted, faults=faults)
    if not {"nx", "ny", "nz"} <= vertex.keys():
        return mesh
    for axis in ("nx", "ny", "nz"):
        if fault := faults.get(("vertex", axis)):
            return mesh._replace(normals_fault=f": {fault}")
    normals = np.stack([vertex[axis][1] for axis in ("nx", "ny", "nz")], axis=1).astype(np.float64)
    return mesh._replace(normals=normals, normal_faces=faces)


def _in_range(faces: Integers, vertices: Array) -> bool:
    """Return whether all vertices of the faces exist; the reader of the mesh reports what does not."""
    return bool(faces.min() >= 0 and faces.max() < len(vertices))


def _rows_of(what: str, numbers: Array, sizes: Integers) -> Integers:
    """Return indices of vertices as integers."""
    if numbers.dtype.kind == "f":
        numbers = numbers.astype(np.float64)
        wrong = ~(abs(numbers) < 2.0**62) | (numbers != np.floor(numbers))
        if wrong.any():
            k = int(np.argmax(wrong))
            row = int(np.searchsorted(np.cumsum(sizes), k, side="right"))
            raise ValueError(f"{what} row {row} has the corner {numbers[k]}; expected the row of a vertex")
    return numbers.astype(np.int64)


def _polygons(face: Numbers, vertices: Array) -> tuple[Integers, Integers]:
    """Return the triangles of the polygons, and for each of their corners its position in the list of all corners."""
    corners = next((face[name] for name in CORNERS if name in face), None)
    if corners is None:
        return np.empty((0, 3), np.int64), np.empty((0, 3), np.int64)
    sizes, numbers = corners
    rows = _rows_of("face", numbers, sizes)
    whole = None
    if (sizes < 3).any():  # points and edges
        whole = np.flatnonzero(np.repeat(sizes >= 3, sizes))
        rows, kept = rows[whole], np.flatnonzero(sizes >= 3)
    else:
        kept = np.arange(len(sizes))
    try:
        places = triangulate(vertices, rows, sizes[kept])
        return rows[places], places if whole is None else whole[places]
    except PolygonError as error:
        raise ValueError(f"face row {kept[error.polygon]}: {error}") from None


def _strips(element: Numbers) -> Integers:
    """Return the triangles of strips; each strip ends at -1, and every second triangle has the other orientation."""
    if "vertex_indices" not in element:
        return np.empty((0, 3), np.int64)
    sizes, numbers = element["vertex_indices"]
    rows = _rows_of("tristrips", numbers, sizes)
    starts = np.zeros(len(rows) + 1, bool)  # whether a strip begins here, or something ends
    starts[np.cumsum(sizes) - sizes] = True
    starts[1:] |= rows == -1
    begin = np.maximum.accumulate(np.where(starts[:-1], np.arange(len(rows)), 0))
    first = np.arange(max(len(rows) - 2, 0))
    odd = (first - begin[:-2]) % 2 == 1
    a, b, c = rows[:-2], rows[1:-1], rows[2:]
    one = (begin[2:] == begin[:-2]) & (c != -1)
    whole = one & (a != b) & (b != c) & (c != a)  # repeated corners join strips
    return np.stack([np.where(odd, b, a), np.where(odd, a, b), c], axis=1)[whole]
