"""Files that are something else than their names say, and names that are not quite those of files."""

import gzip
import json
import re

import pytest

import raytrace as rt
from raytrace.cli import main
from raytrace.errors import FileError, SceneError
from raytrace.misnamed import EXPECTED, is_utf16
from raytrace.scene.meshes.reading import read_mesh
from scene_files import CUBE, TRIANGLE, scene, write

POINTER = f"version https://git-lfs.github.com/spec/v1\noid sha256:{'0' * 64}\nsize 1\n".encode()
LFS = "a Git LFS pointer; fetch the file: git lfs pull"


@pytest.mark.parametrize("kind", ["obj", "ply", "stl", "glb", "obj.gz", "ply.gz", "stl.gz", "glb.gz"])
def test_a_pointer_in_place_of_a_mesh_is_named(tmp_path, kind):
    path = tmp_path / f"a.{kind}"
    contents = [POINTER, gzip.compress(POINTER)] if kind.endswith("gz") else [POINTER]
    for content in contents:
        path.write_bytes(content)
        with pytest.raises(FileError) as caught:
            read_mesh(path)
        assert str(caught.value) == f"{path}: {LFS}"


def test_a_pointer_in_place_of_a_scene_is_named(tmp_path, capsys):
    path = tmp_path / "a.json"
    path.write_bytes(POINTER)
    assert main.main(["check", str(path)]) == 4
    assert capsys.readouterr().err.strip().endswith(f"{path}: {LFS}")


def test_a_page_in_place_of_a_file_is_named(tmp_path):
    for name in ("a.obj", "a.glb", "a.json"):
        path = tmp_path / name
        path.write_text("\n<!DOCTYPE html>\n<html><body>v 0 0 0</body></html>")
        with pytest.raises(FileError, match="an HTML page; fetch the file itself"):
            rt.load(path) if name == "a.json" else read_mesh(path)


STL = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n"
PLY = "ply\nformat ascii 1.0\nelement vertex 0\nend_header\n"


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32"])
@pytest.mark.parametrize(("kind", "text"), [("obj", TRIANGLE), ("ply", PLY), ("stl", STL)])
def test_utf_16_is_named(tmp_path, kind, text, encoding):
    path = tmp_path / f"a.{kind}"
    if encoding == "utf-32":  # its mark begins as that of UTF-16
        text = "\ufeff" + text
    path.write_bytes(text.encode(encoding))
    with pytest.raises(SceneError) as caught:
        read_mesh(path)
    assert str(caught.value) == f"{path}: UTF-16 text; save it as UTF-8"


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_utf_16_of_a_scene_is_named(tmp_path, encoding):
    path = tmp_path / "a.json"
    path.write_bytes(json.dumps(scene()).encode(encoding))
    with pytest.raises(SceneError, match=r"a\.json:1:1: not UTF-8 but UTF-16 text; save it as UTF-8"):
        rt.load(path)


def test_a_binary_file_with_a_title_in_utf_16_is_read(tmp_path):
    triangle = bytes(12 + 36 + 2)
    (tmp_path / "a.stl").write_bytes("title".encode("utf-16-le").ljust(80) + (1).to_bytes(4, "little") + triangle)
    assert len(read_mesh(tmp_path / "a.stl").faces) == 1


@pytest.mark.parametrize("data", [b"", b"v", b"v 0 0 0\n", b"\0" * 20, b"glTF\2\0\0\0\1\0", b"a\0b\0c\0"])
def test_other_content_is_no_utf_16(data):
    assert not is_utf16(data)


def of(mesh):
    return scene(objects=[{"mesh": mesh, "material": "white"}])


def test_paths_as_windows_writes_them_are_found(tmp_path):
    (tmp_path / "meshes" / "old").mkdir(parents=True)
    (tmp_path / "meshes" / "cube.obj").write_text(CUBE)
    for mesh in (r"meshes\cube.obj", r".\meshes\cube.obj", r"meshes\old\..\cube.obj", r"meshes/old\../cube.obj"):
        assert len(rt.load(write(tmp_path, of(mesh))).mesh.faces) == 12
    with pytest.raises(FileError, match=r'meshes/cub\.obj: no such file; did you mean "cube\.obj"\?'):
        rt.load(write(tmp_path, of(r"meshes\cub.obj")))
    for mesh in (r"..\x.obj", r"meshes\..\..\x.obj", r"\etc\passwd"):
        with pytest.raises(SceneError, match="outside the scene's folder"):
            rt.load(write(tmp_path, of(mesh)))


def test_a_name_with_a_backslash_of_its_own_is_found_first(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "b.obj").write_text(CUBE)
    (tmp_path / r"a\b.obj").write_text(TRIANGLE)
    assert len(rt.load(write(tmp_path, of(r"a\b.obj"))).mesh.faces) == 1


@pytest.mark.parametrize("mesh", ["meshes/cube.obj", "MESHES/CUBE.OBJ", "Meshes/cube.OBJ", r"meshes\cube.obj"])
def test_a_file_in_another_case_is_named(tmp_path, mesh):
    (tmp_path / "Meshes").mkdir()
    (tmp_path / "Meshes" / "Cube.obj").write_text(CUBE)
    if (tmp_path / "meshes").exists():
        pytest.skip("the file system does not tell upper from lower case")
    with pytest.raises(FileError) as caught:
        rt.load(write(tmp_path, of(mesh)))
    there = "Cube.obj" if mesh.startswith("Meshes") else "Meshes/Cube.obj"
    assert f'{mesh.replace(chr(92), "/")}: no such file, but there is "{there}"; upper and lower' in str(caught.value)


@pytest.mark.parametrize("name", ["teapot", "nurbs", "box", "frame", "room"])
def test_a_backslash_that_json_took_for_an_escape_is_explained(tmp_path, name):
    path = write(tmp_path, '{"mesh": 0}')
    path.write_text(json.dumps(of("@")).replace("@", rf"meshes\{name}.obj"))
    with pytest.raises(FileError) as caught:
        rt.load(path)
    told = f'meshes\\{name}.obj: no such file; write "/" between folders: '
    told += '"\\t" and the like are control characters in JSON'
    assert told.replace("\\box", "\\x08ox").replace("\\frame", "\\x0crame") in str(caught.value)


def test_a_scene_named_with_backslashes_is_found_out(tmp_path, monkeypatch):
    (tmp_path / "scenes").mkdir()
    write(tmp_path / "scenes", of("triangle.obj"))
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileError, match=r'no such file; did you mean "scenes/scene\.json"\?'):
        rt.load(r"scenes\scene.json")


def test_a_scene_in_another_case_and_other_accents_are_named(tmp_path):
    write(tmp_path, of("triangle.obj"), "Caf\u00e9.json")
    if (tmp_path / "caf\u00e9.json").exists():
        pytest.skip("the file system does not tell upper from lower case")
    for name in ("caf\u00e9.json", "Cafe\u0301.JSON"):
        with pytest.raises(FileError, match=re.escape('but there is "Caf\u00e9.json"')):
            rt.load(tmp_path / name)


def test_deep_paths_that_lead_nowhere_are_no_such_files(tmp_path):
    for mesh in ("a/" * 1900 + "b.obj", "triangle.obj/b.obj", "../" + tmp_path.name + "/TRIANGLES.obj"):
        with pytest.raises(FileError, match=r"no such file|can't be read"):
            rt.load(write(tmp_path, of(mesh)))


def test_of_many_missing_files_no_more_are_sought_than_reported(tmp_path, monkeypatch):
    looked = []
    real = rt.scene.problems.no_such_file
    monkeypatch.setattr("raytrace.scene.files.no_such_file", lambda path: looked.append(path) or real(path))
    objects = [{"mesh": f"none{k}.obj", "material": "white"} for k in range(3000)]
    for changes in ({}, {"film": {"size": [0, 0]}}):
        looked.clear()
        with pytest.raises((FileError, SceneError), match="these are the first 100"):
            rt.load(write(tmp_path, scene(objects=objects, **changes)))
        assert len(looked) == 101


# In place of a scene --------------------------------------------------------------------------------------------------


def binary_stl():
    return b"exported".ljust(80) + (1).to_bytes(4, "little") + bytes(50)


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (CUBE.encode(), "an OBJ mesh; rename it to .obj"),
        (b"# of a program\n\nmtllib a.mtl\n", "an OBJ mesh; rename it to .obj"),
        (PLY.encode(), "a PLY mesh; rename it to .ply"),
        (STL.encode(), "an STL mesh; rename it to .stl"),
        (binary_stl(), "an STL mesh; rename it to .stl"),
        (b"glTF\2\0\0\0", "a GLB mesh; rename it to .glb"),
        (b"\x89PNG\r\n\x1a\n", f"a PNG image; {EXPECTED}"),
        (b'<scene version="3.0.0"/>', f"XML, such as a scene of Mitsuba; {EXPECTED}"),
        (b"# a scene\nLookAt 0 0 1  0 0 0  0 1 0\n", f"a scene of pbrt; {EXPECTED}"),
    ],
    ids=range(9),
)
def test_another_file_in_place_of_a_scene_is_named(tmp_path, capsys, content, what):
    path = tmp_path / "a.txt"
    path.write_bytes(content)
    assert main.main(["check", str(path)]) == 3
    assert capsys.readouterr().err == f"{path}: {what}\n"


def test_a_long_run_of_blanks_is_searched_once(tmp_path):
    path = tmp_path / "a.json"
    path.write_text("x" + " " * 200_000 + "\n#" * 50_000)
    with pytest.raises(SceneError, match="no JSON: expected a value"):
        rt.load(path)


def test_a_scene_in_place_of_a_mesh_is_named(tmp_path):
    write(tmp_path, scene(objects=[{"mesh": "scene.json", "material": "white"}]))
    with pytest.raises(SceneError, match=r"not a known mesh format .*; a scene cannot be a part of another"):
        rt.load(tmp_path / "scene.json")
