"""STL as other programs write it: texts with odd names and ends, binary files that begin as a text."""

import re
import struct

import numpy as np
import pytest

from raytrace.scene.meshes.stl import read_stl

pytestmark = pytest.mark.nojit
FACET = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
TEXT = f"solid a\n{FACET}endsolid a\n"
CORNERS = [[[0, 0, 0], [1, 0, 0], [0, 1, 0]]]


def corners(data):
    mesh = read_stl(data if isinstance(data, bytes) else data.encode())
    return mesh.vertices[mesh.faces].tolist()


def binary(head=b"", count=1, extra=b""):
    row = np.array([[0, 0, 1], *CORNERS[0]], "<f4").tobytes() + b"\0\0"
    return head.ljust(80)[:80] + struct.pack("<I", count) + row + extra


@pytest.mark.parametrize(
    "text",
    [
        TEXT.replace("endsolid", "end solid"),
        TEXT.replace("endfacet", "end facet"),
        TEXT.replace("endloop", "end loop"),
        TEXT.replace("endfacet", "END  FACET").replace("endsolid", "End\tSolid"),
        "\ufeff" + TEXT,
        "\ufeff\r\n" + TEXT.replace("\n", "\r\n"),
        TEXT.replace("\n", "\r"),
        TEXT.replace(" 0 1 0", "\u00a00\v1\u20030"),
        TEXT.replace("\n", " "),
        TEXT.replace("\n", " ").replace("endsolid", "end solid"),
        TEXT.replace(" a\n", "\n"),
        TEXT.rstrip(),
        TEXT + "\0\0\x1a",
        TEXT.replace("normal 0 0 1", "normal -1.#IND nan up"),
        TEXT.replace("facet normal 0 0 1", "facet"),
        FACET + "endsolid\n",
        "\n\n   " + TEXT,
        TEXT.replace("solid a", "solid_a"),
        TEXT.replace("solid a\n", "solid a\ncolor 0.5 0.5 0.5\n", 1),
    ],
    ids=range(19),
)
def test_texts_of_other_programs_are_read(text):
    assert corners(text) == CORNERS


NAMES = [
    "a vertex and a facet",
    "vertex 1 2 3",
    "endfacet",
    "endsolid",
    "end solid",
    "solid facet outer loop vertex",
    "end facet",
    "facet normal 0 0 1",
    "Gr\u00f6\u00dfe",
    "",
]


@pytest.mark.parametrize("name", NAMES)
def test_names_may_be_any_words(name):
    text = TEXT.replace(" a\n", f" {name}\n")
    for changed in (text, text.upper(), text.replace("endsolid", "end solid")):
        assert corners(changed) == CORNERS
        assert corners(changed * 3) == CORNERS * 3
    with pytest.raises(ValueError, match="the text ends before a solid does"):
        read_stl((text + f"solid {name}\n" + FACET).encode())


@pytest.mark.parametrize(
    "head", [b"solid part", b"solid", b"SOLID a\nfacet", b"facet", b"\xef\xbb\xbfsolid", b"solidworks", b"solid\n" * 13]
)
def test_a_binary_file_that_begins_as_a_text_is_binary(head):
    assert corners(binary(head)) == CORNERS
    for count, extra, length in ((1, b"\0", 135), (2, b"", 134), (70_000, b"endsolid", 142)):
        with pytest.raises(ValueError, match=f"the header states {count} triangles, the file has {length} bytes"):
            read_stl(binary(head, count, extra))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("endsolid a", ""), "the text ends before a solid does"),
        (("endfacet\nendsolid a\n", ""), "the text ends before a solid does"),
        (("vertex 0 1 0\n", ""), "1 facets have 2 vertices; expected 3 of each"),
        (("endloop", "vertex 1 1 0\nendloop"), "1 facets have 4 vertices; expected 3 of each"),
        (("0 1 0", "0 1_0 0"), "facet row 0: expected a number, got b'1_0'"),
        (("0 1 0", "0 1"), "facet row 0: expected a number, got b'endloop'"),
        (("endfacet\nendsolid a\n", "endfacet endsolid\nendsolid vertex"), None),
    ],
    ids=range(7),
)
def test_what_is_wrong_is_named(change, told):
    text = TEXT.replace(*change)
    if told is None:
        assert corners(text) == CORNERS
        return
    with pytest.raises(ValueError, match=f"^{re.escape(told)}$"):
        read_stl(text.encode())


@pytest.mark.parametrize("word", ["vertex", "vertex 0", "vertex endfacet", "vertex vertex vertex endfacet"])
def test_numbers_that_the_end_of_the_text_cuts_off_are_an_error(word):
    for end in ("endsolid", "endsolid a", ""):
        with pytest.raises(ValueError, match=r"expected|before"):
            read_stl(f"solid\n{word}\n{end}\n{word} {end}".encode())


def test_positions_that_are_no_numbers_are_read_as_such():
    mesh = read_stl(TEXT.replace("vertex 0 1 0", "vertex 0 -1.#IND 0").encode())
    assert np.isnan(mesh.vertices[2, 1])  # the caller refuses it, and names the row
