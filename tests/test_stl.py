"""The STL reader against trimesh's, and on lying headers."""

import io
import struct

import numpy as np
import pytest

from raytrace.scene.meshes.stl import read_stl

FACET = "facet normal 0 0 1\n outer loop\n  vertex 0 0 0\n  vertex 1e0 0 0\n  vertex 0 1.5 -0\n endloop\nendfacet\n"
TEXT = f"solid a name with vertex in it\n{FACET}endsolid a\n".replace("vertex in", "vortex in")


def binary(triangles, announced=None, head=b""):
    rows = b"".join(np.array([[0, 0, 1], *t], "<f4").tobytes() + b"\0\0" for t in triangles)
    return head.ljust(80) + struct.pack("<I", len(triangles) if announced is None else announced) + rows


def theirs(data):
    from trimesh.exchange.stl import load_stl

    loaded = load_stl(io.BytesIO(data))
    return np.asarray(loaded["vertices"])[loaded["faces"]]


@pytest.mark.parametrize("head", [b"made for a test", b"solid but binary"])
def test_binary_files_are_read_as_trimesh_reads_them(head):
    data = binary(np.random.default_rng(1).normal(size=(20, 3, 3)), head=head)
    ours = read_stl(data)
    assert np.array_equal(ours.vertices[ours.faces], theirs(data))
    assert (ours.vertices.dtype, ours.faces.dtype, ours.normals) == (np.float64, np.int64, None)


@pytest.mark.parametrize("text", [TEXT, TEXT.upper(), TEXT.replace("\n", "\r\n"), f"  {TEXT}", TEXT * 3])
def test_texts_are_read(text):
    ours = read_stl(text.encode())
    one = [[0, 0, 0], [1, 0, 0], [0, 1.5, 0]]
    assert ours.vertices[ours.faces].tolist() == [one] * (len(text) // len(TEXT))


def test_files_without_triangles_hold_none():
    assert read_stl(binary([])) is None
    assert read_stl(b"solid x\nendsolid x\n") is None


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"", "the header states 0 triangles, the file has 0 bytes"),
        (binary(np.zeros((2, 3, 3)), 2_000_000_000), "states 2000000000 triangles, the file has 184 bytes"),
        (binary(np.zeros((2, 3, 3)), 1), "states 1 triangles, the file has 184 bytes"),
        (binary(np.zeros((2, 3, 3)))[:-1], "states 2 triangles, the file has 183 bytes"),
        (TEXT.encode()[:-30], "the text ends before a solid does"),
        (TEXT.replace("vertex 1e0 0 0\n", "").encode(), "1 facets have 2 vertices; expected 3 of each"),
        (TEXT.replace("1.5", "x").encode(), "facet row 0: expected a number, got b'x'"),
        (TEXT.replace("1e0 0 0", "1e0 0").encode(), "facet row 0: expected a number, got b'vertex'"),
        (TEXT.replace("endfacet", "").encode(), "0 facets have 3 vertices"),
    ],
)
def test_what_is_wrong_is_told(data, told):
    with pytest.raises(ValueError, match=told):
        read_stl(data)
