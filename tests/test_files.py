"""Which files a scene may read: those below its own folder, and where its user allows it."""

import json
import os

import numpy as np
import pytest

import raytrace as rt
from raytrace.cli import main
from raytrace.errors import FileError, SceneError
from raytrace.scene.files import Reach
from scene_files import CUBE, TRIANGLE, scene, triangle_glb, write


def of(mesh) -> dict:
    return scene(objects=[{"mesh": mesh, "material": "white"}])


def refusal(source, **options) -> str:
    with pytest.raises(SceneError) as caught:
        rt.load(source, **options)
    assert len(caught.value.problems) == 1
    return caught.value.problems[0]


@pytest.fixture
def outside(tmp_path):
    """A folder with a scene, beside a folder with a mesh."""
    (tmp_path / "scene").mkdir()
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "cube.obj").write_text(CUBE)
    return tmp_path


@pytest.mark.parametrize(
    "mesh",
    [
        "../outside/cube.obj",
        "../outside/not-there.obj",  # whether it is there is not told
        "{}/outside/cube.obj",
        "a/../../outside/cube.obj",
        "./../scene2/cube.obj",
        "/etc/passwd",
        "/dev/stdin",
        "..",
        "/",
        "C:/outside/cube.obj",
        "c:cube.obj",
        r"C:\outside\cube.obj",
        r"\\server\share\cube.obj",
        "//server/share/cube.obj",
        r"\\?\C:\cube.obj",
        r"\\.\pipe\cube.obj",
    ],
)
def test_a_path_out_of_the_folder_is_refused_by_name(outside, mesh):
    mesh = mesh.format(outside)
    told = refusal(write(outside / "scene", of(mesh)))
    assert told.startswith(f"{outside}/scene/scene.json:")
    assert f"objects[0].mesh: {mesh}: outside the scene's folder; " in told
    assert "--root DIR, in Python load(..., root=DIR)" in told


@pytest.mark.parametrize(
    "mesh",
    ["file:///etc/passwd", "FILE:cube.obj", "http://localhost/cube.obj", "https://[::1]/a.glb", "data:,v", "s3:/a.obj"],
)
def test_a_uri_is_refused_by_name(tmp_path, mesh):
    assert f"objects[0].mesh: {mesh}: a URI; name a file: nothing is downloaded" in refusal(write(tmp_path, of(mesh)))


def test_a_link_out_of_the_folder_is_refused_by_name(outside):
    folder = outside / "scene"
    (folder / "link.obj").symlink_to(outside / "outside" / "cube.obj")
    (folder / "way").symlink_to(outside / "outside")
    for mesh in ("link.obj", "way/cube.obj", "way/../outside/cube.obj"):
        told = refusal(write(folder, of(mesh)))
        assert f"objects[0].mesh: {mesh}: a link out of the scene's folder, to {outside}/outside/cube.obj; " in told


def test_a_link_to_itself_is_no_file(tmp_path):
    (tmp_path / "loop.obj").symlink_to("loop.obj")
    with pytest.raises(FileError, match=r"objects\[0\]\.mesh: .*loop\.obj: "):
        rt.load(write(tmp_path, of("loop.obj")))


def test_a_folder_above_may_be_a_link(outside):
    """The scene's folder is where its file lies; what leads there is the user's choice."""
    write(outside / "scene", of("triangle.obj"))
    (outside / "way").symlink_to(outside)
    assert len(rt.load(outside / "way" / "scene" / "scene.json").mesh.faces) == 1
    assert "outside the scene's folder" in refusal(write(outside / "way" / "scene", of("../outside/cube.obj")))
    assert len(rt.load(outside / "way" / "scene" / "scene.json", root=outside / "way" / "outside").mesh.faces) == 12


def test_a_refused_file_is_not_touched(outside, monkeypatch):
    path = write(outside / "scene", of("../outside/cube.obj"))
    looked = []
    for name in ("stat", "lstat", "open", "listdir", "scandir", "readlink"):
        real = getattr(os, name)
        monkeypatch.setattr(os, name, lambda at, *a, real=real, **k: looked.append(str(at)) or real(at, *a, **k))
    refusal(path)
    assert looked  # the scene's own folder
    assert not [at for at in looked if "outside/" in at]


def test_paths_and_links_that_stay_below_the_folder_are_read(tmp_path):
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "a" / "link.obj").symlink_to("b/triangle.obj")
    (tmp_path / "a" / "b" / "triangle.obj").write_text(TRIANGLE)
    meshes = ["a/b/triangle.obj", "./a/b/../link.obj", "a/link.obj", str(tmp_path / "a" / "b" / "triangle.obj")]
    meshes += ["odd:name.obj", "cc:d.obj", "..obj.obj"]
    for name in meshes[-3:]:
        (tmp_path / name).write_text(TRIANGLE)
    assert [len(rt.load(write(tmp_path, of(mesh))).mesh.faces) for mesh in meshes] == [1] * len(meshes)


def test_a_scene_behind_a_link_reads_what_lies_below_either_name(outside):
    write(outside / "scene", of("triangle.obj"))
    (outside / "other").symlink_to(outside / "scene")
    assert len(rt.load(outside / "other" / "scene.json").mesh.faces) == 1
    absolute = write(outside / "other", of(str(outside / "scene" / "triangle.obj")))
    assert len(rt.load(absolute).mesh.faces) == 1


def test_a_root_is_allowed_beside_the_own_folder(outside):
    path = write(outside / "scene", of("../outside/cube.obj"))
    assert len(rt.load(path, root=outside / "outside").mesh.faces) == len(rt.load(path, root=str(outside)).mesh.faces)
    assert len(rt.load(write(outside / "scene", of("triangle.obj")), root=outside / "outside").mesh.faces) == 1
    assert "outside the scene's folder" in refusal(
        write(outside / "scene", of("../cube.obj")), root=outside / "outside"
    )
    (outside / "outside" / "link.obj").symlink_to("/etc/hostname")
    assert "a link out of" in refusal(write(outside / "scene", of("../outside/link.obj")), root=outside / "outside")
    with pytest.raises(FileError, match=r"^root: .*nowhere: no such folder$"):
        rt.load(path, root=outside / "nowhere")


def test_the_command_line_allows_a_root(outside, capsys):
    path = str(write(outside / "scene", of("../outside/cube.obj")))
    assert main.main(["check", path]) == 3
    assert "--root DIR" in capsys.readouterr().err
    for verb in ("check", "explain"):
        assert main.main([verb, path, "--root", str(outside)]) == 0
    assert main.main(["check", path, "--root", str(outside / "nowhere")]) == 4


def test_a_dict_reads_below_the_current_folder_and_what_a_program_names_by_a_path(outside, monkeypatch):
    (outside / "scene" / "triangle.obj").write_text(TRIANGLE)
    monkeypatch.chdir(outside / "scene")
    cube = outside / "outside" / "cube.obj"
    assert len(rt.load(of("triangle.obj")).mesh.faces) == 1
    assert "outside the scene's folder" in refusal(of(str(cube)))
    assert len(rt.load(of(cube)).mesh.faces) == 12
    assert len(rt.load(of(str(cube)), root=outside).mesh.faces) == 12
    assert "outside the scene's folder" in refusal(json.loads(json.dumps(of(str(cube)))))


def test_what_is_no_regular_file_is_not_opened(tmp_path):
    os.mkfifo(tmp_path / "pipe.obj")
    with pytest.raises(FileError, match=r"pipe\.obj: a FIFO, no regular file"):
        rt.load(write(tmp_path, of("pipe.obj")))


def test_a_name_with_a_zero_byte_is_not_found(tmp_path):
    with pytest.raises(FileError, match=r"a\\x00b\.obj: no such file"):
        rt.load(write(tmp_path, of("a\0b.obj")))


def test_a_place_is_judged_the_same_wherever_the_process_stands(tmp_path, monkeypatch):
    (tmp_path / "scene").mkdir()
    monkeypatch.chdir(tmp_path)
    reach = Reach(tmp_path.__class__("scene"))
    assert str(reach.find("a.obj")) == "scene/a.obj"
    with pytest.raises(SceneError):
        reach.find("../a.obj")


@pytest.mark.parametrize(
    "uri",
    [
        "file:///etc/passwd",
        "FILE:a.bin",
        "../secret.bin",
        r"\\server\a.bin",
        "a.bin",
        "/etc/passwd",
        "http://localhost/a.bin",
    ],
)
def test_a_glb_reads_no_other_file(tmp_path, uri):
    (tmp_path / "a.glb").write_bytes(triangle_glb([{"mesh": 0}], buffers=[{"uri": uri, "byteLength": 84}]))
    told = refusal(write(tmp_path, of("a.glb")))
    assert f"objects[0].mesh: {tmp_path}/a.glb: " in told
    assert f"a buffer in another file, {uri}; " in told


def test_the_materials_that_an_obj_names_are_not_looked_at(tmp_path, monkeypatch):
    write(tmp_path, of("a.obj"))
    (tmp_path / "a.obj").write_text("mtllib file:///etc/passwd\nmtllib ../../etc/passwd\nusemtl x\n" + TRIANGLE)
    opened = []
    real = os.open
    monkeypatch.setattr(os, "open", lambda at, *a, **k: opened.append(str(at)) or real(at, *a, **k))
    assert len(rt.load(tmp_path / "scene.json").mesh.faces) == 1
    assert not [at for at in opened if "passwd" in at]


def test_pickles_are_never_read(tmp_path):
    np.savez(tmp_path / "a.npz", rgb=np.array([[{"a": 1}]], dtype=object))
    with pytest.raises(FileError, match="a pickle"):
        rt.compare(tmp_path / "a.npz", tmp_path / "a.npz")
