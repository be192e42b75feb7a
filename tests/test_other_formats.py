"""Mesh files of all formats that trimesh writes, read by us and by trimesh; and what goes wrong with them."""

import base64
import io
import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh
from trimesh.exchange.export import _mesh_exporters
from trimesh.exchange.load import mesh_loaders

import raytrace as rt
from gltf_files import SQUARE, File
from raytrace.errors import MemoryLimitError
from raytrace.memory import Allowance
from raytrace.scene import files, other_formats
from raytrace.scene.files import Reach
from raytrace.scene.meshes import read_mesh
from scene_files import scene, write

ROOT = Path(__file__).parents[1]
WRITTEN = sorted(set(_mesh_exporters) - {"dict", "dict64", "xyz"})  # the last is of points
SCENES = {"3mf", "glb", "gltf"}  # formats that place several meshes
NEEDS = {"3mf": ("lxml", "networkx"), "dae": ("lxml", "collada")}
OFF = "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"


def several():
    """Meshes of several kinds, one of them twice, turned and mirrored."""
    ball, box = trimesh.creation.icosphere(1), trimesh.creation.box()
    whole = trimesh.Scene({"ball": ball})
    whole.add_geometry(box, transform=trimesh.transformations.translation_matrix([3, 1, 0]))
    turned = trimesh.transformations.rotation_matrix(0.5, [0, 1, 1]) @ np.diag([1.0, -1, 1, 1])
    whole.add_geometry(box, transform=turned)
    return whole


def save(folder, kind):
    """Write a file as trimesh does, and return its path."""
    for packages in NEEDS.get(kind, ()):
        pytest.importorskip(packages)
    whole = several()
    data = whole.export(file_type=kind) if kind in SCENES else whole.to_mesh().export(file_type=kind)
    path = folder / ("model.gltf" if kind == "gltf" else "ascii.stl" if kind == "stl_ascii" else f"model.{kind}")
    for name, content in data.items() if isinstance(data, dict) else {path.name: data}.items():
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def in_order(triangles):
    """The triangles as sets of corners, each from its smallest one on, sorted."""
    triangles = np.array([np.roll(t, -min(range(3), key=lambda k: tuple(t[k].round(5))), axis=0) for t in triangles])
    return triangles[np.lexsort(triangles.reshape(-1, 9).round(5).T)]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # trimesh's reader of 3MF
@pytest.mark.parametrize("kind", WRITTEN)
def test_every_format_that_trimesh_writes_is_read_as_trimesh_reads_it(tmp_path, kind):
    path = save(tmp_path, kind)
    ours = read_mesh(path)
    theirs = trimesh.load_scene(path).to_mesh().triangles
    found, expected = in_order(ours.vertices[ours.faces]), in_order(np.asarray(theirs))
    assert len(found) == len(several().to_mesh().faces) == 104
    np.testing.assert_allclose(found, expected, atol=1e-6)
    np.testing.assert_allclose(found, in_order(several().to_mesh().triangles), atol=1e-6)
    assert ours.warnings == ()


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_ply_of_text():
    text = several().to_mesh().export(file_type="ply", encoding="ascii")
    assert b"format ascii" in text[:100]


def test_every_format_that_trimesh_reads_is_known():
    points = {"xyz"}
    assert {f".{kind}" for kind in mesh_loaders} - {".stl_ascii"} - {f".{kind}" for kind in points} == {
        *files.FORMATS,
        *files.OTHERS,
    }
    assert set(other_formats.PACKAGES) == set(files.OTHERS) - {".off"}


def test_a_scene_of_an_off_file_and_of_a_packed_one(tmp_path):
    import gzip

    (tmp_path / "a.off").write_text(OFF)
    (tmp_path / "B.OFF.gz").write_bytes(gzip.compress(OFF.encode()))
    path = write(tmp_path, scene(objects=[{"mesh": name, "material": "white"} for name in ("a.off", "B.OFF.gz")]))
    loaded = rt.load(path)
    assert len(loaded.mesh.faces) == 4
    assert loaded.mesh.vertices[:4].tolist() == SQUARE.tolist()


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("", "no complete OFF file: trimesh can't read it: ValueError"),
        ("OFF\n9 9 9\n", "no complete OFF file: trimesh can't read it: ValueError: cannot reshape"),
        (OFF.replace("3 0 2 3", "3 0 2 9"), "trimesh can't read it: ValueError: OFF file has a face index outside"),
        (OFF.replace("1 1 0", "1 x 0"), "trimesh can't read it: ValueError: could not convert string to float"),
        (OFF.replace("1 1 0", "1 nan 0"), "vertex row 2 is not finite"),
        ("OFF\n1 0 0\n0 0 0\n", "no triangles in it"),
        (f"OFF\n{10**18} 1 0\n", "no complete OFF file: trimesh can't read it"),
    ],
)
def test_a_broken_file_is_one_line_with_its_name(tmp_path, content, told):
    path = tmp_path / "a.off"
    path.write_text(content)
    with pytest.raises(rt.SceneError) as caught:
        read_mesh(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", sorted(other_formats.PACKAGES))
def test_what_a_format_needs_is_named(tmp_path, kind):
    (tmp_path / f"a{kind}").write_bytes(b"<x/>")
    names = [{"pycollada": "collada", "pillow": "PIL"}.get(name, name) for name in other_formats.PACKAGES[kind].split()]
    program = f"""
import sys
sys.modules |= dict.fromkeys({names!r})
from pathlib import Path
from raytrace.errors import FileError
from raytrace.scene.meshes import read_mesh
try:
    read_mesh(Path("a{kind}"))
except FileError as error:
    print(error)
"""
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
        timeout=120,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    expected = (
        f"a{kind}: to read {kind} files, trimesh needs further packages: pip install {other_formats.PACKAGES[kind]}"
    )
    assert done.stdout.startswith(expected)


# ---- limits and confinement ----------------------------------------------------------------------------------------


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
        with pytest.raises(rt.SceneError, match="a URI; name a file: nothing is fetched"):
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
    with pytest.raises(rt.SceneError, match="no complete GLTF file: Expecting value"):
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
        MemoryLimitError, match=r"^memory: .*a\.gltf: .*b\.bin: takes about 57 MiB of memory, 19 MiB are"
    ):
        read_mesh(tmp_path / "a.gltf", allowance)


def test_trimesh_opens_no_other_file(tmp_path):
    pytest.importorskip("collada")
    mesh = trimesh.creation.box()
    image = pytest.importorskip("PIL.Image").new("RGB", (2, 2))
    mesh.visual = trimesh.visual.TextureVisuals(np.zeros((8, 2)), image=image)
    text = mesh.export(file_type="dae")
    (tmp_path / "a.dae").write_bytes(text)
    opened = []
    hook = lambda event, args: opened.append(str(args[0])) if event == "open" else None  # noqa: E731
    sys.addaudithook(lambda event, args: hook(event, args))
    read_mesh(tmp_path / "a.dae")  # imports
    opened.clear()
    assert len(read_mesh(tmp_path / "a.dae").faces) == 12
    hook = lambda event, args: None  # noqa: E731
    assert [
        name for name in opened if not name.endswith((".py", ".pyc", ".so")) and name[:5] not in ("/proc", "/sys/")
    ] == [str(tmp_path / "a.dae")]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_xml_declares_nothing(tmp_path, encoding):
    text = '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]><a>&b;</a>'
    (tmp_path / "a.dae").write_bytes(text.encode(encoding))
    with pytest.raises(rt.SceneError, match="XML with a document type or entities is not read"):
        read_mesh(tmp_path / "a.dae")
    with zipfile.ZipFile(tmp_path / "a.zae", "w") as archive:
        archive.writestr("b.dae", text.encode(encoding))
    with pytest.raises(rt.SceneError, match="XML with a document type or entities is not read"):
        read_mesh(tmp_path / "a.zae")


def test_an_archive_that_unfolds_to_much_is_refused_before_it_is_read(tmp_path, monkeypatch):
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", bytes(20_000_000))
    (tmp_path / "a.3mf").write_bytes(packed.getvalue())
    monkeypatch.setattr(other_formats, "_load", None)
    allowance = Allowance(0)
    allowance.left = 1e8
    with pytest.raises(MemoryLimitError, match=r"^memory: .*a\.3mf: takes about 572 MiB of memory, 95 MiB are"):
        read_mesh(tmp_path / "a.3mf", allowance)
    monkeypatch.setattr(other_formats, "MAX_MESH", 10_000_000)
    with pytest.raises(rt.FileError, match="it unfolds to 20,000,000 bytes; at most 10,000,000"):
        read_mesh(tmp_path / "a.3mf")
    (tmp_path / "a.3mf").write_bytes(packed.getvalue()[:-30])
    with pytest.raises(rt.SceneError, match="a broken archive, or one with a password"):
        read_mesh(tmp_path / "a.3mf")


def test_triangles_have_a_limit(tmp_path, monkeypatch):
    (tmp_path / "a.off").write_text(OFF)
    monkeypatch.setattr("raytrace.scene.meshes.MAX_TRIANGLES", 1)
    with pytest.raises(rt.FileError, match=r"a\.off: it places 2 triangles; at most 1$"):
        read_mesh(tmp_path / "a.off")


def test_a_reach_is_that_of_the_scene():
    reach = Reach(Path("/scenes"), trusted=frozenset(["/meshes/a.gltf"]))
    assert reach.around("b.gltf") is reach
    assert reach.around("/meshes/a.gltf").folder == Path("/meshes")
