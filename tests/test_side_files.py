"""Files that a glTF file names: read where the scene may read, and nowhere else."""

import base64
import json
import os
from pathlib import Path

import pytest

import raytrace as rt
from gltf_files import SQUARE, File
from raytrace.errors import FileMemoryError
from raytrace.memory import Allowance
from raytrace.scene.files import Reach
from raytrace.scene.meshes.reading import read_mesh
from scene_files import scene, write


def gltf(folder, uri, name="a.gltf"):
    """Write the square as glTF whose numbers are in another file."""
    file = File()
    header = {"asset": {"version": "2.0"}, **file.header()}
    header["buffers"][0]["uri"] = uri
    (folder / name).write_text(json.dumps(header))
    return file.data


def loaded(folder, mesh="a.gltf", **options):
    return rt.load(write(folder, scene(objects=[{"mesh": mesh, "material": "white"}])), **options)


def test_buffers_of_gltf_lie_beside_it_or_in_it(tmp_path):
    (tmp_path / "parts").mkdir()
    data = gltf(tmp_path, "parts/the%20square.bin")
    (tmp_path / "parts" / "the square.bin").write_bytes(data)
    assert loaded(tmp_path).mesh.vertices.tolist() == SQUARE.tolist()
    gltf(tmp_path / "parts", "../b.bin")
    (tmp_path / "b.bin").write_bytes(data)
    assert loaded(tmp_path, "parts/a.gltf").mesh.vertices.tolist() == SQUARE.tolist()
    gltf(tmp_path, "data:application/octet-stream;base64," + base64.b64encode(data).decode())
    assert loaded(tmp_path).mesh.vertices.tolist() == SQUARE.tolist()


def test_buffers_of_gltf_are_read_in_the_scene_s_folder_only(tmp_path):
    folder = tmp_path / "scene"
    folder.mkdir()
    for uri in ("../secret.bin", f"{tmp_path}/secret.bin", "..%2Fsecret.bin", "link.bin", "C:\\secret.bin"):
        data = gltf(folder, uri)
        (tmp_path / "secret.bin").write_bytes(data)
        if uri == "link.bin":
            (folder / uri).symlink_to(tmp_path / "secret.bin")
        with pytest.raises(rt.SceneError, match=r"outside the scene's folder|a link out of the scene's folder"):
            loaded(folder)
        if "C:" not in uri:
            assert loaded(folder, root=tmp_path).mesh.vertices.tolist() == SQUARE.tolist()
    for uri in ("http://example.org/a.bin", "file:///etc/passwd", "HTTPS://example.org/a.bin"):
        gltf(folder, uri)
        with pytest.raises(rt.SceneError, match="a URI; name a file: nothing is downloaded"):
            loaded(folder, root=tmp_path)


def test_a_file_that_a_program_names_may_have_its_buffers_beside_it(tmp_path, monkeypatch):
    elsewhere, here = tmp_path / "elsewhere", tmp_path / "here"
    elsewhere.mkdir()
    here.mkdir()
    monkeypatch.chdir(here)
    (elsewhere / "b.bin").write_bytes(gltf(elsewhere, "b.bin"))
    content = scene(objects=[{"mesh": elsewhere / "a.gltf", "material": "white"}])
    assert len(rt.load(content).mesh.faces) == 2
    (tmp_path / "c.bin").write_bytes(gltf(elsewhere, "../c.bin"))
    with pytest.raises(rt.SceneError, match="outside the scene's folder"):
        rt.load(content)


def test_what_is_wrong_with_a_buffer_is_one_line(tmp_path):
    gltf(tmp_path, "b.bin")
    with pytest.raises(rt.FileError, match=r"a\.gltf: b\.bin: can't be read: No such file"):
        loaded(tmp_path)
    (tmp_path / "b.bin").mkdir()
    with pytest.raises(rt.FileError, match=r"b\.bin: (can't be read: Is a directory|no regular file)"):
        loaded(tmp_path)
    (tmp_path / "b.bin").rmdir()
    (tmp_path / "b.bin").write_bytes(b"short")
    with pytest.raises(rt.SceneError, match="a view of 12 bytes from 48 on leaves its buffer of 5 bytes"):
        loaded(tmp_path)
    gltf(tmp_path, "a\0b")
    with pytest.raises(rt.FileError, match="can't be read"):
        loaded(tmp_path)
    (tmp_path / "a.gltf").write_text("")
    with pytest.raises(rt.SceneError, match="not a complete GLTF file: Expecting value"):
        loaded(tmp_path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_a_pipe_is_no_buffer(tmp_path):
    gltf(tmp_path, "b.bin")
    os.mkfifo(tmp_path / "b.bin")
    with pytest.raises(rt.FileError, match="no regular file"):
        loaded(tmp_path)


def test_buffers_count_in_what_memory_there_is(tmp_path):
    (tmp_path / "b.bin").write_bytes(gltf(tmp_path, "b.bin"))
    with open(tmp_path / "b.bin", "r+b") as file:
        file.truncate(10_000_000)
    allowance = Allowance(0)
    allowance.left = 2e7
    with pytest.raises(
        FileMemoryError, match=r"^memory: .*a\.gltf: .*b\.bin: takes about 57 MiB of memory, 19 MiB are"
    ):
        read_mesh(tmp_path / "a.gltf", allowance)


def test_a_reach_is_that_of_the_scene():
    reach = Reach(Path("/scenes"), trusted=frozenset(["/meshes/a.gltf"]))
    assert reach.around("b.gltf") is reach
    assert reach.around("/meshes/a.gltf").folder == Path("/meshes")
