"""PLY files to arrays.

Rows of equal length, nearly always the case, are read all at once, others one by one.
Colours, texture coordinates, edges and whatever else a file may hold are passed over.
"""

from itertools import accumulate, pairwise
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from raytrace.records import RawMesh
from raytrace.scene.obj import fan

TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4"}
TYPES |= {"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4"}
TYPES |= {"double": "f8", "float64": "f8"}
WHOLE = [name for name, kind in TYPES.items() if kind[0] != "f"]
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
CORNERS = "vertex_indices", "vertex_index"  # names of the list of a face's corners
END = b"end_header"
MAX_HEADER = 2**20  # bytes

Column = NDArray[Any]
Numbers = dict[str, tuple[NDArray[np.int64], Column]]  # by property: how many in each row, and all of them


class Property(NamedTuple):
    """One number of each row, or a list of them."""

    name: str
    kind: str
    length: str | None  # type of the number before a list that says how long it is; None: no list


class Element(NamedTuple):
    """Rows of one kind."""

    name: str
    rows: int
    properties: list[Property]


class Source(Protocol):
    """The numbers of a file, and the place that is read next, in units of its own."""

    at: int
    end: int

    def size(self, kind: str) -> int:
        """How many units a number takes."""

    def length(self, kind: str) -> int:
        """Read the number before a list."""

    def table(self, columns: list[tuple[str, int]], rows: int) -> list[Column]:
        """Read rows of numbers; a column holds so many of one type from each row, and is (rows, many)."""

    def numbers(self, kind: str, places: NDArray[np.int64]) -> Column:
        """Numbers at any places."""


class Text:
    """Numbers as words; the unit is a word."""

    def __init__(self, body: bytes) -> None:
        self.words, self.at = body.split(), 0
        self.end = len(self.words)

    def size(self, kind: str) -> int:  # noqa: D102
        return 1

    def length(self, kind: str) -> int:  # noqa: D102
        self.at += 1
        return int(self.words[self.at - 1])

    def table(self, columns: list[tuple[str, int]], rows: int) -> list[Column]:  # noqa: D102
        ends = list(accumulate((many for _, many in columns), initial=0))
        begin, self.at = self.at, self.at + rows * ends[-1]
        numbers = np.array(list(map(float, self.words[begin : self.at]))).reshape(rows, ends[-1])
        return [numbers[:, a:b] for a, b in pairwise(ends)]

    def numbers(self, kind: str, places: NDArray[np.int64]) -> Column:  # noqa: D102
        return np.array([float(self.words[place]) for place in places.tolist()])


class Bytes:
    """Numbers as a processor has them; the unit is a byte."""

    def __init__(self, body: memoryview, order: str) -> None:
        self.body, self.order, self.at, self.end = body, order, 0, len(body)

    def size(self, kind: str) -> int:  # noqa: D102
        return int(kind[1:])

    def length(self, kind: str) -> int:  # noqa: D102
        begin, self.at = self.at, self.at + self.size(kind)
        order: Any = "little" if self.order == "<" else "big"
        return int.from_bytes(self.body[begin : self.at], order, signed=kind[0] == "i")

    def table(self, columns: list[tuple[str, int]], rows: int) -> list[Column]:  # noqa: D102
        row = np.dtype([(f"{k}", self.order + kind, (many,)) for k, (kind, many) in enumerate(columns)])
        table = np.frombuffer(self.body, row, rows, self.at)
        self.at += rows * row.itemsize
        return [table[name] for name in row.names or ()]

    def numbers(self, kind: str, places: NDArray[np.int64]) -> Column:  # noqa: D102
        parts = np.frombuffer(self.body, np.uint8)[places[:, None] + np.arange(self.size(kind))]
        return parts.ravel().view(self.order + kind)


def _header(data: bytes) -> tuple[str, list[Element], memoryview]:
    """Byte order (none: text), elements, and what follows."""
    end = data.find(END, 0, MAX_HEADER)
    if end < 0:
        raise ValueError(f"the header has no end in the first {MAX_HEADER} bytes")
    lines = [line.split() for line in data[:end].decode("latin-1").splitlines()]
    if lines[:1] != [["ply"]]:
        raise ValueError('the first line is not "ply"')
    order, elements = "?", list[Element]()
    for words in lines[1:]:
        match words:
            case ["format", name, _] if name in ORDERS:
                order = ORDERS[name]
            case ["element", name, rows] if rows.isdigit():
                elements.append(Element(name, int(rows), []))
            case ["property", "list", length, kind, name] if elements and length in WHOLE and kind in TYPES:
                elements[-1].properties.append(Property(name, TYPES[kind], TYPES[length]))
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1].properties.append(Property(name, TYPES[kind], None))
            case ["comment" | "obj_info", *_] | []:
                pass
            case _:
                raise ValueError(f"its header has a line that no reader knows: {' '.join(words)[:60]}")
    if order == "?":
        raise ValueError("its header names no format")
    end += len(END)
    return order, elements, memoryview(data)[end + (2 if data[end : end + 2] == b"\r\n" else 1) :]


def _step(source: Source, element: Element, row: int, prop: Property) -> tuple[int, int]:
    """Pass over one property of one row: how many numbers, and where they begin."""
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


def _even(source: Source, element: Element) -> Numbers | None:
    """All numbers of an element whose rows are as long as the first one; None: they are not."""
    start = source.at
    counts = [_step(source, element, 0, prop)[0] for prop in element.properties]
    columns = list[tuple[str, int]]()
    for prop, count in zip(element.properties, counts, strict=True):
        columns += [(prop.length, 1), (prop.kind, count)] if prop.length else [(prop.kind, count)]
    length, source.at = source.at - start, start
    if start + element.rows * length > source.end:
        return None
    table, found = iter(source.table(columns, element.rows)), Numbers()
    for prop, count in zip(element.properties, counts, strict=True):
        if prop.length and (next(table) != count).any():
            source.at = start
            return None
        found[prop.name] = np.broadcast_to(count, element.rows), next(table).ravel()
    return found


def _uneven(source: Source, element: Element) -> Numbers:
    """All numbers of an element, row by row."""
    if element.rows > source.end - source.at:  # a row has a unit at least: nothing is made of more
        raise ValueError(f"the file ends before the {element.rows} rows of element {element.name} do")
    steps = np.empty((2, len(element.properties), element.rows), np.int64)
    for row in range(element.rows):
        for k, prop in enumerate(element.properties):
            steps[:, k, row] = _step(source, element, row, prop)
    found = {}
    for prop, counts, begins in zip(element.properties, *steps, strict=True):
        within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        places = np.repeat(begins, counts) + within * source.size(prop.kind)
        found[prop.name] = counts, source.numbers(prop.kind, places)
    return found


def read_ply(data: bytes) -> RawMesh | None:
    r"""Read the triangles and polygons of a PLY file; polygons become fans of triangles.

    Parameters
    ----------
    data : bytes
        The file's content, text or binary.

    Returns
    -------
    RawMesh or None
        None: it has no faces.

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
    source = Bytes(body, order) if order else Text(bytes(body))
    read = {e.name: _even(source, e) or _uneven(source, e) for e in elements if e.rows and e.properties}
    vertex, face = read.get("vertex", {}), read.get("face", {})
    corners = next((face[name] for name in CORNERS if name in face), None)
    if corners is None or not {"x", "y", "z"} <= vertex.keys():
        return None
    vertices = np.stack([vertex[axis][1] for axis in "xyz"], axis=1).astype(np.float64)
    sizes, numbers = corners
    if (sizes < 3).any():
        raise ValueError(f"face row {int(np.argmax(sizes < 3))} has {int(sizes.min())} corners")
    faces = numbers.astype(np.int64)[fan(sizes)]
    if not {"nx", "ny", "nz"} <= vertex.keys():
        return RawMesh(vertices, faces, None, None)
    normals = np.stack([vertex[axis][1] for axis in ("nx", "ny", "nz")], axis=1).astype(np.float64)
    return RawMesh(vertices, faces, normals, faces)
