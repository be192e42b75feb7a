"""OBJ as other programs and people write it: white space, unused vertices, normals that are wrong."""

import numpy as np
import pytest

from raytrace.errors import SceneError
from raytrace.scene.load import load
from raytrace.scene.meshes.obj import ObjError, read_obj
from raytrace.scene.precision import choose_precision
from scene_files import scene

pytestmark = pytest.mark.nojit
POINTS = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
SQUARE = POINTS + "f 1 2 3 4\n"
CORNERS = [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]]


def corners(data):
    mesh = read_obj(data if isinstance(data, bytes) else data.encode())
    return mesh.vertices[mesh.faces].tolist()


def loaded(folder, text, normals="flat"):
    (folder / "a.obj").write_bytes(text if isinstance(text, bytes) else text.encode())
    return load(scene(objects=[{"mesh": folder / "a.obj", "material": "white", "normals": normals}]))


BLANKS = "\v\f\x1c\x1d\x1e\x1f\u00a0\u1680\u2000\u2003\u2009\u200a\u202f\u205f\u3000"


@pytest.mark.parametrize("blank", BLANKS, ids=lambda blank: f"{ord(blank):04x}")
def test_any_white_space_parts_words(blank):
    assert corners(SQUARE.replace(" ", blank)) == CORNERS
    assert corners(SQUARE.replace("\n", f"{blank}\n")) == CORNERS
    assert corners(SQUARE.replace("v ", f"{blank}v{blank} ")) == CORNERS
    assert corners(SQUARE.replace("v 0 0 0", f"v{blank}0 0 0", 1)) == CORNERS


@pytest.mark.parametrize("end", ["\n", "\r", "\r\n", "\x85", "\u2028", "\u2029", "\n\f", "\v", "\r ", "\r\n\t"])
def test_any_end_of_line_ends_a_statement(end):
    assert corners(SQUARE.rstrip().replace("\n", end)) == CORNERS
    assert corners((POINTS + "# f 4 3 2 1").replace("\n", end) + end + "f 1 2 3 4") == CORNERS


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff" + SQUARE,
        "\ufeff\n" + SQUARE,
        "\ufeff# Größe 10 µm\n" + SQUARE,
        POINTS + "\ufefff 1 2 3 4\n",  # two files that were joined
        SQUARE.replace("v 1", "v \u200b1"),
        SQUARE + "\0\0\0",
        SQUARE.rstrip() + "\x1a",
        POINTS + "f 1 2 3 4 \\",
        POINTS + "f 1 2 3 4\\\n",
        POINTS + "f 1 2 \\\n 3 4 \\\n\\\n",
        POINTS + "f 1 2 \\  \n 3 4 # \\",
        SQUARE + "# c:\\meshes\\",
        "g a_b\nusemtl wood_1\n" + SQUARE,
    ],
    ids=range(13),
)
def test_marks_at_the_begin_and_end_are_no_words(text):
    assert corners(text) == CORNERS


@pytest.mark.parametrize("comment", ["Gr\u00f6\u00dfe\u00a0in\u2003mm", "\u5927\u304d\u3055", "\u00c5\u0085"])
@pytest.mark.parametrize("encoding", ["utf-8", "latin-1", "gbk", "cp932"])
def test_names_and_comments_of_any_encoding_are_ignored(comment, encoding):
    data = f"# {comment}\no {comment}\n".encode(encoding, "ignore") + SQUARE.encode()
    assert corners(data) == CORNERS


def test_a_blank_of_latin_1_parts_words():
    assert corners(SQUARE.replace(" ", "\xa0").encode("latin-1")) == CORNERS


@pytest.mark.parametrize(
    ("text", "line", "told"),
    [
        (POINTS + "f 1 2 3 1_0\n" + "v 5 5 5\n" * 6, 5, "expected the index of a vertex, got '1_0'"),
        (SQUARE.replace("v 1 1 0", "v 1_0 1 0"), 3, "expected a number, got '1_0'"),
        (POINTS + "f 1//1 2//1_0 3//1\nvn 0 0 1", None, "normal"),
        (SQUARE.replace("v 1 1 0", "v"), 3, "expected 3 numbers, got 0"),
        (SQUARE + "f\n", 6, "expected a face of at least 3 corners, got 0"),
        (SQUARE.replace("v 1 1 0", "v 0,5 1 0"), 3, "expected a number, got '0,5'"),
        (SQUARE.replace("v 1 1 0", "v 1 -1.#IND 0"), 3, r"vertex 3 is not finite: \[1.0, nan, 0.0\]"),
        (SQUARE.replace("v 1 1 0", "v 1 -1.#INF 0"), 3, r"vertex 3 is not finite: \[1.0, -inf, 0.0\]"),
        (SQUARE.replace("v 1 1 0", "v 1 nan(ind) 0"), 3, r"vertex 3 is not finite: \[1.0, nan, 0.0\]"),
    ],
    ids=range(9),
)
def test_what_cannot_be_read_names_line_and_word(text, line, told):
    if line is None:
        assert "expected the index of a normal, got '1_0'" in read_obj(text.encode()).normals_fault
        return
    with pytest.raises(ObjError, match=told) as caught:
        read_obj(text.encode())
    assert caught.value.line == line


UNUSED = [
    "nan nan nan",
    "nan 0 0",
    "inf 0 0",
    "1e999 0 0",
    "1e80 0 0",
    "-1e80 1e80 0",
    "1e9 0 0",
    "1e30 0 0",
    "-1.#IND 0 0",
]


@pytest.mark.parametrize("vertex", UNUSED)
@pytest.mark.parametrize("first", [False, True])
@pytest.mark.parametrize("normals", ["flat", "smooth"])
def test_unused_vertices_decide_nothing(tmp_path, vertex, first, normals):
    plain = loaded(tmp_path, SQUARE, normals)
    text = f"v {vertex}\n{POINTS}f 2 3 4 5\n" if first else f"{POINTS}v {vertex}\nf 1 2 3 4\n"
    with_unused = loaded(tmp_path, text, normals)
    for got, expected in zip(with_unused.mesh[1:], plain.mesh[1:], strict=True):
        if expected is not plain.mesh.faces:
            np.testing.assert_array_equal(got, expected)
    meshes = (with_unused.mesh, plain.mesh)
    np.testing.assert_array_equal(*(mesh.vertices[mesh.faces] for mesh in meshes))
    assert choose_precision(with_unused) == choose_precision(plain)
    assert np.abs(with_unused.mesh.vertices).max() == 1


def test_unused_vertices_within_the_mesh_stay_as_they_are(tmp_path):
    mesh = loaded(tmp_path, POINTS + "v 0.5 0.25 0\nf 1 2 3 4\n").mesh
    assert mesh.vertices[4].tolist() == [0.5, 0.25, 0]


WRONG = {
    "vn 0 0 1\nf 1//1 2//2 3//1 4//1": ":6: normal 2 does not exist; the file has 1, counted from 1",
    "vn 0 0\nf 1//1 2//1 3//1 4//1": ":5: expected 3 numbers, got 2",
    "vn 0 0 up\nf 1//1 2//1 3//1 4//1": ":5: expected a number, got 'up'",
    "vn 0 0 1\nf 1//1 2//x 3//1 4//1": ":6: expected the index of a normal, got 'x'",
}


@pytest.mark.parametrize("end", WRONG)
def test_wrong_normals_are_an_error_where_they_are_used(tmp_path, end):
    mesh = loaded(tmp_path, POINTS + end).mesh
    assert mesh.vertices[mesh.faces].tolist() == CORNERS
    with pytest.raises(SceneError) as caught:
        loaded(tmp_path, POINTS + end, "smooth")
    (line,) = caught.value.problems
    assert line.endswith(f'a.obj{WRONG[end]}; correct the normals, or use "normals": "flat"')


@pytest.mark.parametrize(
    "word", ["-1.#IND", "1.#QNAN", "1.#IND00", "-1.#INF", "nan", "-nan(ind)", "nan(0x8000)", "1.#INF00"]
)
def test_normals_that_are_no_numbers_give_way_to_those_of_the_face(tmp_path, word):
    text = POINTS + f"vn {word} {word} {word}\nvn 0 0 1\nf 1//1 2//2 3//2 4//1"
    assert len(loaded(tmp_path, text).mesh.faces) == 2
    np.testing.assert_array_equal(loaded(tmp_path, text, "smooth").mesh.normals, np.tile([0.0, 0, 1], (2, 3, 1)))


def test_wrong_normals_of_one_object_leave_the_others_alone(tmp_path):
    (tmp_path / "a.obj").write_text(POINTS + next(iter(WRONG)))
    objects = [
        {"mesh": tmp_path / "a.obj", "material": "white", "normals": kind} for kind in ("flat", "smooth", "flat")
    ]
    with pytest.raises(SceneError) as caught:
        load(scene(objects=objects))
    assert [line.split(": ")[1] for line in caught.value.problems] == ["objects[1].mesh"]
