"""The PLY reader against trimesh's, and on what that one can't read."""

import io
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest

from raytrace.scene.meshes.ply import read_ply

pytestmark = pytest.mark.nojit
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
VERTEX = [("x", "f4"), ("y", "f4"), ("z", "f4")]
NAMES = {
    "i1": "char",
    "u1": "uint8",
    "i2": "short",
    "u2": "uint16",
    "i4": "int",
    "u4": "uint",
    "f4": "float",
    "f8": "double",
}


def write(order, elements, end="\n"):
    """A PLY file of elements: (name, [(property, kind or (length kind, kind))], rows)."""
    header, body = ["ply", f"format {order} 1.0", "comment made for a test"], b""
    for name, properties, rows in elements:
        header.append(f"element {name} {len(rows)}")
        for prop, kind in properties:
            types = f"list {NAMES[kind[0]]} {NAMES[kind[1]]}" if isinstance(kind, tuple) else NAMES[kind]
            header.append(f"property {types} {prop}")
        for row in rows:
            numbers = []
            for (_, kind), value in zip(properties, row, strict=True):
                several = isinstance(kind, tuple)
                numbers += [(kind[0], len(value))] if several else []
                numbers += [(kind[1], x) for x in value] if several else [(kind, value)]
            if order == "ascii":
                body += " ".join(repr(x) for _, x in numbers).encode() + end.encode()
            else:
                body += b"".join(np.array(x, ORDERS[order] + kind).tobytes() for kind, x in numbers)
    return end.join([*header, "end_header", ""]).encode() + body


def points(n, normals=False):
    """Points in their order about a circle."""
    rows = np.random.default_rng(n).normal(size=(n, 6 if normals else 3)).astype("f4").astype("f8")
    angles = np.linspace(0, 6, n)
    rows[:, :3] = np.stack([np.cos(angles), np.sin(angles), 0.5 * np.cos(angles)], axis=1).astype("f4")
    rows = rows.tolist()
    return "vertex", VERTEX + [(f"n{axis}", "f8") for axis in "xyz"] * normals, rows


def faces(n, rows, name="vertex_indices", kinds=("u1", "i4")):
    """Convex polygons, where the points are those of ``points``."""
    rng = np.random.default_rng(9)
    return "face", [(name, kinds)], [[np.sort(rng.choice(n, size, replace=size > n)).tolist()] for size in rows]


def theirs(data):
    from trimesh.exchange.ply import load_ply

    return load_ply(io.BytesIO(data), fix_texture=False, skip_materials=True)


@pytest.mark.parametrize("name", ["vertex_indices", "vertex_index"])
@pytest.mark.parametrize("size", [3, 4])
@pytest.mark.parametrize("normals", [False, True])
@pytest.mark.parametrize(("order", "end"), [*product(ORDERS, ["\n"]), ("ascii", "\r\n")])
def test_it_agrees_with_trimesh(order, end, normals, size, name):
    kinds = ("u2", "u4") if size == 4 else ("u1", "i4")
    data = write(order, [points(20, normals), faces(20, [size] * 30, name, kinds)], end)
    ours, expected = read_ply(data), theirs(data)
    assert np.array_equal(ours.vertices, expected["vertices"])
    corners = np.asarray(expected["faces"])
    assert np.array_equal(ours.faces, corners if size == 3 else corners[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3))
    assert (ours.normals is None) == (not normals)
    if normals:
        assert np.array_equal(ours.normals, expected["vertex_normals"])
    assert (ours.vertices.dtype, ours.faces.dtype) == (np.float64, np.int64)


@pytest.mark.parametrize("order", ORDERS)
def test_polygons_of_any_size_become_fans(order):
    sizes = [3, 5, 3, 4, 9, 3]
    (_, _, rows) = element = faces(12, sizes)
    ours = read_ply(write(order, [points(12), element]))
    expected = [[row[0], a, b] for (row,) in rows for a, b in pairwise(row[1:])]
    assert ours.faces.tolist() == expected


@pytest.mark.parametrize("sizes", [[3, 3, 3], [3, 4, 3]])
@pytest.mark.parametrize("order", ORDERS)
def test_what_else_a_file_holds_is_passed_over(order, sizes):
    name, properties, rows = points(6)
    coloured = name, [*properties[:2], ("red", "u1"), ("weights", ("u1", "f4")), properties[2]], [
        [x, y, 200, [0.5] * (k % 3), z] for k, (x, y, z) in enumerate(rows)
    ]  # fmt: skip
    _, (corners,), indices = faces(6, sizes)
    textured = "face", [("flags", "i1"), corners, ("texcoord", ("u1", "f4"))], [
        [-1, row, [0.25] * 2 * len(row)] for (row,) in indices
    ]  # fmt: skip
    edges = "edge", [("vertex1", "i4"), ("vertex2", "i4")], [[0, 1], [1, 2]]
    plain = read_ply(write(order, [points(6), faces(6, sizes)]))
    for elements in ([edges, coloured, textured], [coloured, edges, textured], [textured, edges, coloured]):
        ours = read_ply(write(order, elements))
        assert np.array_equal(ours.vertices, plain.vertices)
        assert np.array_equal(ours.faces, plain.faces)


@pytest.mark.parametrize("order", ORDERS)
def test_without_faces_or_places_there_is_no_mesh(order):
    assert read_ply(write(order, [points(4)])) is None
    assert read_ply(write(order, [points(4), faces(4, [])])) is None
    assert read_ply(write(order, [("vertex", VERTEX[:2], [[0, 1]]), faces(1, [3])])) is None


@pytest.mark.parametrize("sizes", [[3] * 4, [3, 4, 5, 3]])
@pytest.mark.parametrize("order", ORDERS)
def test_a_file_cut_short_is_told_at_any_length(order, sizes):
    whole = write(order, [points(5), faces(5, sizes)])
    body = whole.index(b"end_header\n") + 11
    for length in range(len(whole) - 2):
        with pytest.raises(
            ValueError, match="ends before|no end" if order != "ascii" else "ends before|no end|invalid"
        ):
            read_ply(whole[:length])
        assert length < body or b"end_header" in whole[:length]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("ply\n", "plyer\n"), 'the first line is not "ply"'),
        (("format ascii 1.0\n", ""), "its header names no format"),
        (("format ascii 1.0", "format utf8 1.0"), "its header has a line of no known kind: format utf8 1.0"),
        (("element vertex 5", "element vertex -5"), "a line of no known kind: element vertex -5"),
        (("element vertex 5\n", ""), "a line of no known kind: property float x"),
        (("\n3 ", "\n-3 "), "row 0 of element face has a list of -3 numbers"),
    ],
)
def test_what_is_wrong_is_told(change, told):
    text = write("ascii", [points(5), faces(5, [3, 3])]).decode()
    assert change[0] in text
    with pytest.raises(ValueError, match=told.replace("(", r"\(")):
        read_ply(text.replace(*change, 1).encode())


def test_an_element_of_nothing_costs_nothing():
    text = write("ascii", [points(3), faces(3, [3])]).decode()
    assert read_ply(text.replace("element face", "element ghost 999999999999\nelement face").encode()) is not None


def test_the_shipped_files_are_read_as_trimesh_reads_them():
    import gzip

    for path in (Path(__file__).parents[1] / "scenes" / "meshes").glob("*.ply*"):
        data = gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()
        ours, expected = read_ply(data), theirs(data)
        assert np.array_equal(ours.vertices, expected["vertices"])
        assert np.array_equal(ours.faces, expected["faces"])
