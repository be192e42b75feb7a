"""Scene files to scenes, and everything that can be wrong with one."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from raytrace.errors import FileError, SceneError
from raytrace.records import DIFFUSE, REFRACTIVE
from raytrace.scene.load import load
from raytrace.scene.meshes import reading
from scene_files import CUBE, scene, write


def problems(source) -> list[str]:
    with pytest.raises(SceneError) as caught:
        load(source)
    assert caught.value.exit_code == 3
    assert str(caught.value).count("\n") == len(caught.value.problems) - 1
    return caught.value.problems


def unreadable(source) -> str:
    with pytest.raises(FileError) as caught:
        load(source)
    assert caught.value.exit_code == 4
    return str(caught.value)


def test_everything_in_the_file_reaches_the_scene(tmp_path):
    content = scene(
        about="A test.",
        film={"size": [64, 48]},
        render={"spp": 4, "max_depth": 3, "sampler": "stratified", "precision": "float64", "seed": 7},
        materials={
            "white": {"type": "diffuse", "albedo": [0.1, 0.2, 0.3], "two_sided": True},
            "glass": {"type": "refractive", "ior": 1.5, "shadows": "transparent"},
        },
        objects=[
            {"mesh": "triangle.obj", "material": "glass"},
            {"mesh": "triangle.obj", "material": "white", "translate": [0, 0, 5]},
        ],
        background=[1, 2, 3],
    )
    loaded = load(write(tmp_path, content))
    assert loaded.source == tmp_path / "scene.json"
    assert loaded.about == "A test."
    assert loaded.settings == ((64, 48), 4, 3, "stratified", "float64", 7, "direct", "box")
    np.testing.assert_array_equal(loaded.camera.position, [0, 1, 6.8])
    np.testing.assert_array_equal(loaded.camera.up, [0, 1, 0])
    assert loaded.camera.fov == 19.5
    np.testing.assert_array_equal(loaded.lights.position, [[0, 1.5, 0.5]])
    np.testing.assert_array_equal(loaded.lights.flux, [[17, 12, 5]])
    materials = loaded.materials
    assert materials.name == ("white", "glass")
    assert materials.kind.tolist() == [DIFFUSE, REFRACTIVE]
    np.testing.assert_array_equal(materials.albedo, [[0.1, 0.2, 0.3], [1, 1, 1]])
    assert materials.ior.tolist() == [1, 1.5]
    assert materials.two_sided.tolist() == [True, False]
    assert materials.transparent_shadow.tolist() == [False, True]
    np.testing.assert_array_equal(loaded.background, [1, 2, 3])
    assert loaded.mesh.faces.tolist() == [[0, 1, 2], [3, 4, 5]]
    assert loaded.mesh.vertices[:, 2].tolist() == [0, 0, 0, 5, 5, 5]
    assert loaded.mesh.material_id.tolist() == [1, 0]
    assert loaded.mesh.object_id.tolist() == [0, 1]
    assert loaded.mesh.normals is None
    assert loaded.objects == ("triangle.obj", "triangle.obj (2)")
    assert loaded.warnings == ()


def test_arrays_have_the_types_that_the_records_state(tmp_path):
    loaded = load(write(tmp_path, scene(lights=[])))
    assert loaded.lights.position.shape == loaded.lights.flux.shape == (0, 3)
    assert loaded.materials.kind.dtype == np.int8
    assert loaded.materials.two_sided.dtype == loaded.materials.transparent_shadow.dtype == bool
    assert loaded.mesh.faces.dtype == np.int64
    assert loaded.mesh.material_id.dtype == loaded.mesh.object_id.dtype == np.int32
    lights = loaded.lights.position, loaded.lights.flux
    for array in (*loaded.camera[:3], *lights, loaded.materials.albedo, loaded.mesh.vertices, loaded.background):
        assert array.dtype == np.float64
        assert array.flags.c_contiguous
    assert loaded.mesh.faces.flags.c_contiguous


def test_all_problems_are_told_at_once_in_the_order_of_the_file(tmp_path):
    path = write(
        tmp_path,
        """{
  "abuot": "x",
  "camera": {"position": [0, 1], "look_at": [0, 1, 0], "fov": -1.5},
  "materials": {"white": {"type": "diffuse", "albeedo": [0.7, 0.7, 0.7]}, "glass": {"type": "refractive", "ior": 1.5}},
  "objects": [{"mesh": "triangle.obj", "material": "glas"},
              {"mesh": "triangel.obj", "material": "white", "rotate": {"axis": [0, 0, 0], "angle": 5}}]
}""",
    )
    missing = f'objects[1].mesh: {tmp_path}/triangel.obj: no such file; did you mean "triangle.obj"?'
    assert problems(path) == [
        f'{path}:2:3: abuot: unknown key "abuot"; did you mean "about"?',
        f"{path}:3:26: camera.position: expected a list of 3 numbers, got a list of 2",
        f"{path}:3:63: camera.fov: expected a number > 0, got -1.5",
        f'{path}:4:46: materials.white.albeedo: unknown key "albeedo"; did you mean "albedo"?',
        f'{path}:5:52: objects[0].material: unknown material "glas"; did you mean "glass"? (known: white, glass)',
        f"{path}:6:24: {missing}",
        f"{path}:6:80: objects[1].rotate.axis: the axis has no direction; expected a vector other than 0",
    ]


def test_a_dict_tells_no_line():
    assert problems(scene(camera={"position": [0, 1, 2], "look_at": [0, 1, 0]})) == [
        'scene: camera: missing key "fov", or "height" instead',
        "scene: objects[0].mesh: triangle.obj: no such file",
    ]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "1:1: no JSON: the file is empty; expected a value"),
        ("[]", "1:1: expected an object, got a list of 0"),
        ("7", "1:1: expected an object, got 7"),
        ('{"a": 1,}', "1:"),
        ('{\n "a": [1, 2,]}', "2:1"),
        ('{"a": 1', "1:8: no JSON: expected a comma or the closing bracket"),
        ('{"a" 1}', "1:6: no JSON: expected a colon after the key"),
        ("{} {}", "1:4: no JSON: expected nothing more"),
        ('{"a": "b', "1:7: no JSON: this string has no closing quote"),
        ('{"a": "\n"}', "1:8: no JSON: a line break or control character"),
        ('{"a": "\\x"}', "1:8: no JSON: unknown escape; write a backslash as two"),
        ('{"a": 1, # x\n}', "1:10: no JSON: comments begin with //, not with #"),
        ('{"a": [1,\n]}', "2:1: no JSON: expected a value; is there a comma too many?"),
        ("{'a': 1}", "1:2: no JSON: strings have double quotes, not single ones"),
        ('{"a": {"x": 1, "x": 2}}', '1:16: a.x: repeated key "x"; keep one'),
        ('{"a": NaN}', "1:7: a: expected a finite number, got NaN"),
        ('{"a": [1, -Infinity]}', "1:11: a[1]: expected a finite number, got -Infinity"),
        ('{"a": 1e999}', "1:7: a: expected a finite number, got 1e999"),
        ('{"a": 1' + "0" * 5000 + "}", "1:7: a: expected a finite number, got 10"),
        ("[" * 100_000, "1:101: nested more than 100 deep"),
        ('{"a":' * 100_000, "1:501: nested more than 100 deep"),
    ],
    ids=range(21),
)
def test_text_that_is_no_scene_is_one_line_with_its_place(tmp_path, text, problem):
    path = write(tmp_path, text)
    told = problems(path)
    assert len(told) == 1
    assert told[0].startswith(f"{path}:{problem}")


def test_repeated_keys_and_infinities_are_told_together(tmp_path):
    assert len(problems(write(tmp_path, '{"a": NaN, "b": 1, "b": Infinity}'))) == 3


def test_text_that_is_not_utf8_tells_where(tmp_path):
    path = tmp_path / "scene.json"
    path.write_bytes('{\n "about": "ä'.encode() + b"\xff")
    assert problems(path) == [f"{path}:2:13: not UTF-8 text: byte 0xff; save it as UTF-8"]
    path.write_bytes("{}".encode("utf-16"))
    assert problems(path) == [f"{path}:1:1: not UTF-8 but UTF-16 text; save it as UTF-8"]


def test_byte_order_mark_of_utf8_is_passed_over(tmp_path):
    path = write(tmp_path, scene())
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert load(path).sha256 == load(write(tmp_path, scene(), "plain.json")).sha256
    path.write_bytes(b"\xef\xbb\xbf{]")
    assert problems(path)[0].startswith(f"{path}:1:2: no JSON")


def test_scene_files_that_cannot_be_read_are_file_errors(tmp_path):
    write(tmp_path, scene())
    assert unreadable(tmp_path / "scene.jsn") == f'{tmp_path}/scene.jsn: no such file; did you mean "scene.json"?'
    assert "there is no folder" in unreadable(str(tmp_path / "x" / "scene.json"))
    assert "a directory" in unreadable(tmp_path)
    assert "no regular file" in unreadable("/dev/null")
    assert unreadable("a\0b\n.json").startswith(r"a\x00b\n.json: no such file")
    assert "can't be read" in unreadable("a" * 5000)


def test_missing_meshes_alone_are_a_file_error_that_names_all(tmp_path):
    entries = [{"mesh": name, "material": "white"} for name in ("cub.obj", "triangle.obj", ".", "a\0b.obj", "cub.obj")]
    path = write(tmp_path, scene(objects=entries))
    told = unreadable(path).split("\n")
    assert len(told) == 3  # a file that is used twice is told once
    assert told[0] == f'{path}:42:12: objects[0].mesh: {tmp_path}/cub.obj: no such file; did you mean "cube.obj"?'
    assert "objects[2].mesh: " in told[1]
    assert "a directory" in told[1]


def test_missing_and_broken_meshes_together_are_a_scene_error(tmp_path):
    (tmp_path / "bad.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n\nf 1 2 4\n")
    entries = [{"mesh": name, "material": "white"} for name in ("none.obj", "bad.obj")]
    told = problems(write(tmp_path, scene(objects=entries)))
    assert len(told) == 2
    assert told[1].endswith(
        f"objects[1].mesh: {tmp_path}/bad.obj:5: vertex 4 does not exist; the file has 3, counted from 1"
    )


def test_vast_film_is_one_line_and_nothing_is_allocated(tmp_path):
    path = write(tmp_path, scene(film={"size": [10**6, 10**6]}))
    told = problems(path)
    assert len(told) == 1
    assert "film.size: a film of 1000000 x 1000000 pixels is too large" in told[0]


@pytest.mark.parametrize("scale", [1e-300, 1e-8, 1, 1e8, 1e300])
def test_camera_checks_do_not_depend_on_the_scale(tmp_path, scale):
    write(tmp_path, "{}")

    def camera(look_at, up):
        return {"position": [scale, 0, 0], "look_at": (np.array(look_at) * scale).tolist(), "up": up, "fov": 40}

    objects = [{"mesh": tmp_path / "triangle.obj", "material": "white"}]
    at_itself = problems(scene(camera=camera([1, 0, 0], [0, 1, 0]), objects=objects))
    assert at_itself == ["scene: camera.look_at: the camera looks at its own position; move one of the two"]
    along = problems(scene(camera=camera([-1, 0, 0], [scale, 0, 0]), objects=objects))
    assert len(along) == 1
    assert along[0].startswith("scene: camera.up: up is parallel to the view direction")
    no_up = problems(scene(camera=camera([-1, 0, 0], [0, 0, 0]), objects=objects))
    assert no_up == ["scene: camera.up: up has no direction; expected a vector other than 0"]
    load(scene(camera=camera([-1, 0, 0], [scale, 1e-5 * scale, 0]), objects=objects))


def test_default_up_that_is_parallel_is_told_at_the_camera(tmp_path):
    content = scene(camera={"position": [0, 5, 0], "look_at": [0, 0, 0], "fov": 40})
    assert ": camera: up is parallel" in problems(write(tmp_path, content))[0]


def test_what_is_probably_not_meant_is_a_warning_with_its_place(tmp_path):
    (tmp_path / "sliver.obj").write_text("v 0 0 0\nv 1 1 1\nv 2 2 2\nv 0 1 0\nf 1 2 3\nf 1 1 4\nf 1 2 4\n")
    white = {"type": "diffuse", "albedo": [1, 1, 1]}
    objects = [{"mesh": "sliver.obj", "material": "white"}]
    path = write(tmp_path, scene(lights=[], materials={"white": white, "red": white}, objects=objects))
    warnings = load(path).warnings
    assert len(warnings) == 3
    assert any(w.endswith("lights: no lights: all surfaces will be black") for w in warnings)
    assert all(w.startswith(f"{path}:") for w in warnings)
    assert any(w.endswith("materials.red: no object uses this material") for w in warnings)
    assert any("objects[0].mesh: sliver.obj: 2 of 3 triangles have no area" in w for w in warnings)


def test_dict_may_hold_tuples_arrays_and_paths(tmp_path):
    path = write(tmp_path, scene())
    content = scene(objects=[{"mesh": tmp_path / "triangle.obj", "material": "white"}])
    content["camera"] = {"position": np.array([0, 1, 6.8]), "look_at": (0, 1, 0), "fov": np.float64(19.5)}
    loaded = load(content)
    assert loaded.source is None
    assert loaded.sha256 == load(path).sha256


def test_dict_that_has_no_form_in_json_is_one_line():
    assert problems({"about": {1, 2}}) == ["scene: a set cannot be written as JSON"]
    around: dict = {}
    around["about"] = around
    assert problems(around) == ["scene: circular reference detected"]
    deep: dict = {}
    for _ in range(100_000):
        deep = {"a": deep}
    assert problems(deep) == ["scene: nested more than 100 deep; no part of a scene is"]
    assert problems({"about": float("nan")}) == ["scene: about: expected a finite number, got NaN"]


def test_text_that_cannot_be_printed_is_escaped(tmp_path):
    path = write(tmp_path, scene(objects=[{"mesh": "a\nb.obj", "material": "c\td"}]))
    assert any(r'unknown material "c\td"' in line for line in problems(path))
    for text in ('{"\\ud800": 1}', '{"about": "\\uD800"}'):
        told = problems(write(tmp_path, text))
        assert len(told) == 1
        assert "half of a character" in told[0]
    assert load(write(tmp_path, scene(about="\N{GRINNING FACE}"))).about == "\N{GRINNING FACE}"


HASH_CHANGES = {
    "camera": {"position": [0, 1, 6.9], "look_at": [0, 1, 0], "fov": 19.5},
    "render": {"max_depth": 15},
    "lights": [{"type": "point", "position": [0, 1.5, 0.5], "flux": [17, 12, 6]}],
    "materials": {"white": {"type": "diffuse", "albedo": [0.7, 0.7, 0.8]}},
    "objects": [{"mesh": "triangle.obj", "material": "white", "normals": "smooth"}],
    "background": [0, 0, 1],
}
HASH_KEEPS = {
    "about": "Other words.",
    "film": {"size": [3, 4]},
    "render": {"spp": 7, "seed": 9, "sampler": "independent", "precision": "float64"},
    "materials": {"white": {"type": "diffuse", "albedo": [0.7, 0.7, 0.7], "two_sided": False}},
}


@pytest.mark.parametrize("key", HASH_CHANGES)
def test_hash_changes_with_the_content(tmp_path, key):
    plain = load(write(tmp_path, scene())).sha256
    assert load(write(tmp_path, scene(**{key: HASH_CHANGES[key]}))).sha256 != plain


@pytest.mark.parametrize("key", HASH_KEEPS)
def test_hash_does_not_change_with_the_sampling_or_the_words(tmp_path, key):
    plain = load(write(tmp_path, scene())).sha256
    assert load(write(tmp_path, scene(**{key: HASH_KEEPS[key]}))).sha256 == plain


def test_hash_does_not_depend_on_folder_names_or_format(tmp_path):
    (tmp_path / "other").mkdir()
    here = write(tmp_path, scene())
    there = write(tmp_path / "other", json.dumps(scene()).replace("white", "blanc"), "name.json")
    assert load(here).sha256 == load(there).sha256 == load(here).sha256


def test_each_mesh_file_is_read_once(tmp_path, monkeypatch):
    reads = []
    monkeypatch.setattr(reading, "read_bytes", lambda path, allowance: reads.append(path) or CUBE.encode())
    load(write(tmp_path, scene(objects=[{"mesh": "cube.obj", "material": "white"}] * 3)))
    assert len(reads) == 1


def test_overflow_of_the_world_is_a_problem_of_the_object(tmp_path):
    objects = [{"mesh": "triangle.obj", "material": "white", "scale": scale} for scale in (1e80, 1e308, 1)]
    objects[1]["translate"] = [1e308, 1e308, 1e308]
    told = problems(write(tmp_path, scene(objects=objects)))
    assert ["objects[0]: coordinates reach" in told[0], "objects[1]: coordinates reach" in told[1]] == [True, True]


def test_a_mesh_so_far_away_that_it_is_a_point_is_a_problem_of_the_object(tmp_path):
    objects = [{"mesh": "triangle.obj", "material": "white", **place} for place in ({"translate": [1e18] * 3}, {})]
    assert ["objects[0]: even in float64 all of it is one point" in line for line in
            problems(write(tmp_path, scene(objects=objects)))] == [True]  # fmt: skip


def mutations(text: str, rng: np.random.Generator, count: int):
    """Yield copies of a text with a piece removed, doubled or replaced."""
    pieces = ["", "null", "-1", "[]", "{}", '"x"', "1e400", ",", "}", '"', "NaN", "true", "\\", "\x00"]
    for _ in range(count):
        start, length = rng.integers(len(text)), rng.integers(1, 12)
        yield text[:start] + pieces[rng.integers(len(pieces))] + text[start + length :]


def test_no_mutation_of_a_scene_gives_anything_but_a_clear_line(tmp_path):
    text = json.dumps(scene(film={"size": [8, 8]}, background=[0, 0, 0]))
    wrong = 0
    for mutated in mutations(text, np.random.default_rng(1), 300):
        path = write(tmp_path, mutated)
        try:
            load(path)
        except (SceneError, FileError) as error:
            wrong += 1
            for line in str(error).split("\n"):
                assert line.startswith(f"{path}:")
    assert wrong > 250


COMMENTED = """// a scene
{
  "camera": {"position": [0, 0, 5], "look_at": [0, 0, 0], /* degrees */ "fov": 40},
  "about": "see http://example.org/*", // "fov": 1
  "materials": {"white": {"type": "diffuse", "albedo": [1, 1, 1]}}, /* one
  material */ "objects": [{"rectangle": {}, "material": "white"}]
}
"""


def test_comments_change_nothing_but_are_skipped(tmp_path):
    found = load(write(tmp_path, COMMENTED))
    assert found.about == "see http://example.org/*"
    assert found.sha256 == load({
        "camera": {"position": [0, 0, 5], "look_at": [0, 0, 0], "fov": 40},
        "materials": {"white": {"type": "diffuse", "albedo": [1, 1, 1]}},
        "objects": [{"rectangle": {}, "material": "white"}],
    }).sha256  # fmt: skip


def test_errors_of_a_scene_with_comments_have_the_right_lines_and_columns(tmp_path):
    path = write(tmp_path, COMMENTED.replace("40}", "200}").replace('"white"}]', '"whit"}]'))
    assert [line.removeprefix(f"{path}:").split(" ")[:2] for line in problems(path)] == [
        ["3:80:", "camera.fov:"],
        ["6:57:", "objects[0].material:"],
    ]


def test_a_comment_without_an_end_is_told_where_it_begins(tmp_path):
    path = write(tmp_path, COMMENTED + "/* more")
    assert problems(path) == [f"{path}:8:1: this comment has no end; close it with */"]


def test_importing_the_loader_imports_neither_numpy_nor_trimesh():
    code = "import sys, raytrace.scene.load as l; sys.exit(any(m in sys.modules for m in ('numpy', 'trimesh')))"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(__file__).parents[1])


def test_scene_of_obj_meshes_does_not_import_trimesh(tmp_path):
    path = write(tmp_path, scene())
    code = f"import sys; from raytrace.scene.load import load; load({str(path)!r}); sys.exit('trimesh' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(__file__).parents[1])


# Files that are no files ----------------------------------------------------------------------------------------------


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no FIFOs here")
def test_a_fifo_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "scene.json")
    (tmp_path / "link.json").symlink_to(tmp_path / "scene.json")
    for name in ("scene.json", "link.json"):
        with pytest.raises(FileError, match=f"{name}: a FIFO, no regular file; name a scene file"):
            load(tmp_path / name)


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="no /proc here")
@pytest.mark.parametrize("name", ["/proc/self/environ", "/dev/null", "/dev/fd/0"])
def test_what_the_system_makes_up_is_no_scene(name, tmp_path):
    with pytest.raises(FileError):
        load(name)


def test_a_pointer_of_git_lfs_says_how_to_get_the_file(tmp_path):
    path = tmp_path / "scene.json"
    path.write_text(f"version https://git-lfs.github.com/spec/v1\noid sha256:{'0' * 64}\nsize 1\n")
    with pytest.raises(FileError, match="a Git LFS pointer; fetch the file: git lfs pull"):
        load(path)


def test_a_file_below_a_file_is_not_there(tmp_path):
    (tmp_path / "a.json").touch()
    with pytest.raises(FileError, match=r"b\.json: no such file; there is no folder"):
        load(tmp_path / "a.json" / "b.json")
