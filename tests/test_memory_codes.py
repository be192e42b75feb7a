"""One reason, one code: where memory is lacking, the exit code is 2 and the line says memory, wherever it is found."""

import gzip

import numpy as np
import pytest

import raytrace as rt
from gltf_files import File
from raytrace import memory
from raytrace.cli import main
from raytrace.errors import FileMemoryError
from raytrace.image import files
from raytrace.rendering import rendering
from scene_files import scene, write

FREE = {  # what is too much -> a mesh, bytes that are allowed or free
    "a file": ("large.obj", 2**20),
    "a packed file": ("large.obj.gz", 2**20),
    "words of a text": ("words.obj", 2**23),
    "what nodes place": ("shared.glb", 2**21),
    "what an archive holds": ("large.3mf", 2**23),
    "all objects": ("cube.obj", 50_000),
}


def shared() -> bytes:
    """300 nodes that share one mesh."""
    rng = np.random.default_rng(0)
    file = File(rng.normal(size=(100, 3)).astype("<f4"), rng.integers(0, 100, 600).astype("<u2"))
    file.json["nodes"] = [{"children": list(range(1, 301))}] + [{"mesh": 0}] * 300
    return file.glb()


def archive() -> bytes:
    import io
    import zipfile

    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("3D/3dmodel.model", bytes(3_000_000))
    return packed.getvalue()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "large.obj").write_bytes(b"x" * 2_000_000)
    (tmp_path / "large.obj.gz").write_bytes(gzip.compress(b"x" * 2_000_000))
    (tmp_path / "words.obj").write_bytes(b"v 0 0 0\n" * 100_000)
    (tmp_path / "shared.glb").write_bytes(shared())
    (tmp_path / "large.3mf").write_bytes(archive())
    monkeypatch.setattr(memory, "resident", lambda: 0)
    return tmp_path


@pytest.mark.parametrize("what", FREE)
def test_meshes_that_take_too_much(folder, what, capsys):
    mesh, allowed = FREE[what]
    path = write(folder, scene(objects=[{"mesh": mesh, "material": "white"}] * 200))
    for command in ([str(path)], ["check", str(path)], ["explain", str(path)]):
        assert main.main([*command, f"--max-memory={allowed}"]) == 2
        for line in capsys.readouterr().err.splitlines():
            assert ".mesh: memory: " in line
            assert "no complete" not in line
            assert "allow more by --max-memory (max_memory=)" in line
    with pytest.raises(FileMemoryError) as caught:
        rt.load(path, max_memory=allowed)
    assert isinstance(caught.value, rt.FileError)  # as what a file lacks
    assert isinstance(caught.value, rt.OptionError)


def test_a_picture_that_takes_too_much(folder, capsys, monkeypatch):
    path = str(write(folder, scene()))
    assert main.main([path, "--max-memory=1M", "--size", "4096x4096", "-o", str(folder / "a.png")]) == 2
    assert capsys.readouterr().err.startswith("memory: the image, ")

    def full(*_args, **_more):
        raise MemoryError

    monkeypatch.setattr(rendering, "check_render", full)
    assert main.main([path, "-o", str(folder / "a.png")]) == 2
    assert capsys.readouterr().err.startswith("memory: not enough; use ")


def test_a_picture_to_compare_with(folder, capsys, monkeypatch):
    files.save(folder / "a.npz", np.zeros((40, 50, 3)))
    monkeypatch.setattr(memory, "free", lambda: 1000.0)
    assert main.main(["compare", str(folder / "a.npz"), str(folder / "a.npz")]) == 2
    assert capsys.readouterr().err.startswith(f"memory: {folder / 'a.npz'}: takes about ")


def test_what_else_is_wrong_decides_the_code(folder, capsys):
    objects = [{"mesh": name, "material": "white"} for name in ("large.obj", "nowhere.obj")]
    assert main.main(["check", str(write(folder, scene(objects=objects))), "--max-memory=1M"]) == 4
    objects[0]["mesh"] = "broken.stl"
    (folder / "broken.stl").write_text("")
    objects.append({"mesh": "large.obj", "material": "white"})
    assert main.main(["check", str(write(folder, scene(objects=objects))), "--max-memory=1M"]) == 3
    capsys.readouterr()


def test_limits_are_no_lack_of_memory(folder, capsys, monkeypatch):
    monkeypatch.setattr("raytrace.scene.meshes.reading.MAX_TRIANGLES", 1000)
    path = write(folder, scene(objects=[{"mesh": "shared.glb", "material": "white"}]))
    assert main.main(["check", str(path)]) == 4
    assert "shared.glb: it places 60,000 triangles; at most 1,000" in capsys.readouterr().err
