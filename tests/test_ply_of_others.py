"""PLY as other programs write it: strips, odd headers, words that are no numbers, rows that are too long."""

import re

import numpy as np
import pytest

from raytrace.errors import SceneError
from raytrace.scene.load import load
from raytrace.scene.meshes.ply import read_ply
from scene_files import scene

pytestmark = pytest.mark.nojit
POINTS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
CORNERS = [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]]
FACES = "element face {}\nproperty list uchar int vertex_indices\n"


def ply(rows, faces="4 0 1 2 3\n", properties="", face_header=None, count=None):
    """A text; rows of the square's vertices have what is given behind them."""
    head = (
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n" + properties
    )
    head += (face_header or FACES).format(count or faces.count("\n")) + "end_header\n"
    rows = [rows] * 4 if isinstance(rows, str) else rows
    return head + "".join(" ".join([*map(str, p), r]) + "\n" for p, r in zip(POINTS, rows, strict=True)) + faces


def binary(order="little", end="\n", types=("float", "uchar", "int"), extra=""):
    sign = {"little": "<", "big": ">"}[order]
    kinds = {
        "float": "f4",
        "double": "f8",
        "half": "f2",
        "float16": "f2",
        "uchar": "u1",
        "int": "i4",
        "int64": "i8",
        "uint64": "u8",
    }
    head = f"ply\nformat binary_{order}_endian 1.0\nelement vertex 4\n" + "".join(
        f"property {types[0]} {a}\n" for a in "xyz"
    )
    head += f"element face 1\nproperty list {types[1]} {types[2]} vertex_indices\n{extra}end_header{end}"
    point, length, corner = (sign + kinds[name] for name in types)
    return (
        head.encode()
        + np.array(POINTS, point).tobytes()
        + np.array([4], length).tobytes()
        + np.arange(4).astype(corner).tobytes()
    )


def corners(data):
    mesh = read_ply(data if isinstance(data, bytes) else data.encode())
    return mesh.vertices[mesh.faces].tolist()


def loaded(folder, text, normals="flat"):
    (folder / "a.ply").write_bytes(text.encode())
    return load(scene(objects=[{"mesh": folder / "a.ply", "material": "white", "normals": normals}]))


@pytest.mark.parametrize(
    "word", ["-1.#IND", "1.#QNAN", "nan", "-nan(ind)", "inf", "red", "#ff0000", "1_0", "0x10", "1,5", "-"]
)
def test_what_is_no_position_may_be_any_word(word):
    for rows in (word, ["0.5", word, "1", word]):
        assert corners(ply(rows, properties="property float quality\n")) == CORNERS
        assert corners(ply(rows, properties="property string name\n")) == CORNERS
        assert corners(ply("1 " + word, properties="property list uchar float weights\n")) == CORNERS
    faces = FACES + "property float quality\n"
    assert corners(ply("", f"3 0 1 2 {word}\n3 0 2 3 {word}\n", face_header=faces)) == CORNERS
    assert corners(ply("", f"3 0 1 2 {word}\n4 0 2 3 3 1\n", face_header=faces))[0] == CORNERS[0]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("1 1 0", "1 x 0"), "row 2 of element vertex: expected a number as y, got 'x'"),
        (("1 1 0", "1 1_0 0"), "row 2 of element vertex: expected a number as y, got '1_0'"),
        (("4 0 1 2 3", "4 0 1 two 3"), "row 0 of element face: expected a number as vertex_indices, got 'two'"),
        (("4 0 1 2 3", "4 0 1 2.5 3"), "face row 0 has the corner 2.5; expected the row of a vertex"),
        (("4 0 1 2 3", "4 0 1 nan 3"), "face row 0 has the corner nan; expected the row of a vertex"),
        (("4 0 1 2 3", "four 0 1 2 3"), "expected the length of a list, got b'four'"),
        (("4 0 1 2 3", "4.0 0 1 2 3"), "expected the length of a list, got b'4.0'"),
    ],
)
def test_a_position_or_index_that_is_no_number_is_named_with_its_row(change, told):
    text = ply("")
    assert change[0] in text
    with pytest.raises(ValueError, match=f"^{re.escape(told)}$"):
        read_ply(text.replace(*change).encode())


def test_normals_that_are_no_numbers_matter_only_where_they_are_used(tmp_path):
    properties = "".join(f"property float n{axis}\n" for axis in "xyz")
    for word in ("nan", "-1.#IND", "inf"):
        text = ply(["0 0 1", f"{word} 0 0", "0 0 2", "0 0 0"], properties=properties)
        np.testing.assert_array_equal(loaded(tmp_path, text, "smooth").mesh.normals, np.tile([0.0, 0, 1], (2, 3, 1)))
        assert len(loaded(tmp_path, text).mesh.faces) == 2
    text = ply(["0 0 1", "0 up 0", "0 0 2", "0 0 0"], properties=properties)
    assert len(loaded(tmp_path, text).mesh.faces) == 2
    with pytest.raises(
        SceneError, match=r"a\.ply: row 1 of element vertex: expected a number as ny, got 'up'; correct"
    ):
        loaded(tmp_path, text, "smooth")
    assert read_ply(ply("0 1", properties=properties[: properties.index("property float nz")]).encode()).normals is None


@pytest.mark.parametrize("vertex", ["nan nan nan", "-1.#IND 0 0", "1e80 0 0", "1e9 0 0"])
def test_unused_vertices_decide_nothing(tmp_path, vertex):
    text = ply("").replace("element vertex 4", "element vertex 5").replace("0 1 0 \n", f"0 1 0 \n{vertex}\n")
    mesh = loaded(tmp_path, text).mesh
    assert mesh.vertices[mesh.faces].tolist() == CORNERS
    assert np.abs(mesh.vertices).max() == 1


def test_rows_longer_than_the_header_says_are_read_line_by_line():
    faces = FACES + "property list uchar float texcoord\nproperty uchar red\n"
    rows = "3 0 1 2 2 0.5 0.25 3 1 1 1\n3 0 2 3 2 0.5 0.25 3 1 1 1\n"
    assert corners(ply("", rows, face_header=faces)) == CORNERS
    assert corners(ply("", rows.replace("\n", "\r\n\r\n"), face_header=faces, count=2)) == CORNERS
    assert corners(ply("255 0 0", "3 0 1 2 9 9\n3 0 2 3 9\n")) == CORNERS  # colours that the header leaves out
    assert corners(ply(["7", "", "", ""], "4 0 1 2 3\n")) == CORNERS
    assert corners(ply("", "4 0 1 2 3 255 0 0\n")) == CORNERS


def test_rows_that_are_no_lines_are_read_word_by_word():
    text = ply("", "3 0 1 2\n3 0 2 3\n")
    head, body = text.split("end_header\n")
    for layout in (body.replace("\n", " "), body.replace(" ", "\n"), body + "\n\n9 9\n"):
        assert corners(f"{head}end_header\n{layout}") == CORNERS


@pytest.mark.parametrize("length", [0, 1, 7, 12])
def test_a_row_that_is_too_short_is_an_error(length):
    text = ply("", "3 0 1 2\n3 0 2 3\n")
    with pytest.raises(ValueError, match="the file ends before row"):
        read_ply(text[: len(text) - 2 - length].encode())


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", " \n", "\t \n", "  \r\n"])
@pytest.mark.parametrize("order", ["little", "big"])
def test_blanks_after_the_header_are_no_content(order, end):
    assert corners(binary(order, end)) == CORNERS
    assert corners(ply("").replace("end_header\n", f"end_header{end}")) == CORNERS


@pytest.mark.parametrize(
    "comment", ["the end_header follows", "end_header", "\u00c5ngstr\u00f6m \u00e0 b", "a\x1cb", "\u2028"]
)
def test_comments_hold_anything(comment):
    line = f"comment {comment}\nobj_info {comment}\n"
    assert corners(ply("").replace("element face", f"{line}element face")) == CORNERS
    assert corners(binary(extra=line)) == CORNERS


def test_a_mark_at_the_beginning_and_other_line_ends_are_read():
    assert corners("\ufeff" + ply("")) == CORNERS
    assert corners(ply("").replace("\n", "\r")) == CORNERS
    assert corners(ply("").replace("\n", "\r\n")) == CORNERS
    assert corners(ply("") + "\0\0\x1a") == CORNERS
    assert corners(ply("").replace("0 1 0", "0\u00a01\v0")) == CORNERS
    assert corners(b"\xef\xbb\xbf" + binary()) == CORNERS


@pytest.mark.parametrize(
    "types", [("half", "uchar", "int64"), ("float16", "int", "uint64"), ("double", "uchar", "half")]
)
def test_less_common_types_are_read(types):
    assert corners(binary(types=types)) == CORNERS


def test_unknown_types_are_words_in_a_text_and_refused_by_name_in_binary():
    assert corners(ply("7", properties="property long id\n")) == CORNERS
    assert corners(ply("").replace("property float x", "property real x")) == CORNERS
    assert corners(ply("").replace("list uchar int", "list float index")) == CORNERS
    for line in ("property long id\n", "property list uchar long ids\n"):
        with pytest.raises(
            ValueError, match=r"property ids? of element face has the unknown type long \(known: char, "
        ):
            read_ply(binary(extra=line))
    with pytest.raises(ValueError, match="property ids of element face has the unknown type string"):
        read_ply(binary(extra="property list string int ids\n"))
    with pytest.raises(ValueError, match="property ids of element face: the length of a list is no whole number"):
        read_ply(binary(extra="property list float int ids\n"))


def test_faces_of_fewer_than_three_corners_are_none():
    rows = "2 0 1\n3 0 1 2\n1 3\n0\n3 0 2 3\n2 1 2\n"
    assert corners(ply("", rows)) == CORNERS
    assert read_ply(ply("", "2 0 1\n2 1 2\n").encode()) is None


STRIP = "element tristrips {}\nproperty list int int vertex_indices\n"


@pytest.mark.parametrize(
    ("strips", "faces"),
    [
        ("5 0 1 3 2 -1\n", [[0, 1, 3], [3, 1, 2]]),
        ("4 0 1 3 2\n", [[0, 1, 3], [3, 1, 2]]),
        ("8 0 1 3 -1 1 2 3 -1\n", [[0, 1, 3], [1, 2, 3]]),
        ("9 -1 -1 0 1 3 -1 1 2 3\n", [[0, 1, 3], [1, 2, 3]]),
        ("3 0 1 3\n4 1 2 3 -1\n", [[0, 1, 3], [1, 2, 3]]),
        ("8 0 1 3 3 1 1 2 3\n", [[0, 1, 3], [2, 1, 3]]),  # joined by corners that are repeated
        ("2 0 1\n", []),
        ("3 0 1 -1\n", []),
        ("0\n", []),
    ],
    ids=range(9),
)
def test_strips_of_triangles_are_read(strips, faces):
    mesh = read_ply(ply("", strips, face_header=STRIP).encode())
    assert ([] if mesh is None else mesh.faces.tolist()) == faces


def test_strips_agree_with_a_plain_loop():
    rng = np.random.default_rng(5)
    for _ in range(200):
        rows = [rng.integers(-1, 4, rng.integers(0, 12)).tolist() for _ in range(rng.integers(1, 4))]
        expected, strip = [], []
        for row in rows:
            for index in [*row, -1]:
                strip = [] if index == -1 else [*strip, index]
                if len(set(strip[-3:])) == 3:
                    a, b, c = strip[-3:]
                    expected.append([b, a, c] if len(strip) % 2 == 0 else [a, b, c])
            strip = []
        text = "".join(" ".join(map(str, [len(row), *row])) + "\n" for row in rows)
        mesh = read_ply(ply("", text, face_header=STRIP).encode())
        assert ([] if mesh is None else mesh.faces.tolist()) == expected


def test_faces_and_strips_are_read_together():
    text = ply("", "3 0 1 2\n", face_header=FACES + STRIP.format(1), count=1) + "4 -1 0 2 3\n"
    assert corners(text) == CORNERS


def test_a_header_of_many_properties_takes_no_more_than_the_file():
    names = "".join(f"property uchar p{k}\n" for k in range(30_000))
    text = ply("").replace("element face", f"element ghost 100000000\n{names}element face")
    with pytest.raises(ValueError, match="the file ends before"):
        read_ply(text.encode())
