"""Mesh files of all formats that trimesh writes, read by us and by trimesh; and what goes wrong with them."""

import io
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
from gltf_files import SQUARE
from raytrace.errors import FileMemoryError
from raytrace.memory import Allowance
from raytrace.scene import files
from raytrace.scene.meshes import other_formats
from raytrace.scene.meshes.reading import read_mesh
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
        ("", "not a complete OFF file: trimesh can't read it: ValueError"),
        ("OFF\n9 9 9\n", "not a complete OFF file: trimesh can't read it: ValueError: cannot reshape"),
        (OFF.replace("3 0 2 3", "3 0 2 9"), "trimesh can't read it: ValueError: OFF file has a face index outside"),
        (OFF.replace("1 1 0", "1 x 0"), "trimesh can't read it: ValueError: could not convert string to float"),
        (OFF.replace("1 1 0", "1 nan 0"), "vertex row 2 is not finite"),
        ("OFF\n1 0 0\n0 0 0\n", "no triangles in it"),
        ("OFF\n\xff\xff", "not a complete OFF file: trimesh can't read it: ValueError"),
        (f"OFF\n{10**18} 1 0\n", "not a complete OFF file: trimesh can't read it"),
    ],
)
def test_a_broken_file_is_one_line_with_its_name(tmp_path, content, told):
    path = tmp_path / "a.off"
    path.write_text(content, "latin-1")
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
from raytrace.scene.meshes.reading import read_mesh
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


@pytest.mark.parametrize("faces", ["4 0 1 2 3\n", "# all\n4 0 1 2 3\n"])
def test_polygons_that_became_fans_are_a_warning(tmp_path, faces):
    (tmp_path / "a.off").write_text("OFF # of a square\n\n4 1 0\n" + "".join(OFF.splitlines(True)[2:6]) + faces)
    read = read_mesh(tmp_path / "a.off")
    assert len(read.faces) == 2
    assert read.warnings == (other_formats.FANS,)
    path = write(tmp_path, scene(objects=[{"mesh": "a.off", "material": "white"}]))
    assert rt.load(path).warnings[0].endswith(f"objects[0].mesh: a.off: {other_formats.FANS}")


def test_polygons_of_collada(tmp_path):
    pytest.importorskip("collada")
    text = trimesh.creation.box().export(file_type="dae")
    begin, end = text.index(b"<triangles"), text.index(b"</triangles>")
    old = text[begin : end + len(b"</triangles>")]
    assert old.count(b"<p>") == 1
    three = old.replace(b"triangles", b"polylist").replace(b"<p>", b"<vcount>" + b"3 " * 12 + b"</vcount><p>")
    four = three.replace(b"<vcount>3 3 3 3 ", b"<vcount>4 4 4 ")
    for name, new, warnings in (("a.dae", three, ()), ("b.dae", four, (other_formats.FANS,))):
        (tmp_path / name).write_bytes(text.replace(old, new))
        read = read_mesh(tmp_path / name)
        assert len(read.faces) >= 12
        assert read.warnings == warnings
    with zipfile.ZipFile(tmp_path / "c.zae", "w") as archive:
        archive.writestr("b.dae", (tmp_path / "b.dae").read_bytes())
    assert read_mesh(tmp_path / "c.zae").warnings == (other_formats.FANS,)


# ---- limits -------------------------------------------------------------------------------------------------------


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
    with pytest.raises(
        rt.SceneError, match=r"XML with a document type or entities is not read|UTF-16 text; save it as UTF-8"
    ):
        read_mesh(tmp_path / "a.dae")
    with zipfile.ZipFile(tmp_path / "a.zae", "w") as archive:
        archive.writestr("b.dae", text.encode(encoding))
    with pytest.raises(
        rt.SceneError, match=r"XML with a document type or entities is not read|UTF-16 text; save it as UTF-8"
    ):
        read_mesh(tmp_path / "a.zae")


def test_an_archive_that_unfolds_to_much_is_refused_before_it_is_read(tmp_path, monkeypatch):
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", bytes(20_000_000))
    (tmp_path / "a.3mf").write_bytes(packed.getvalue())
    monkeypatch.setattr(other_formats, "_load", None)
    allowance = Allowance(0)
    allowance.left = 1e8
    with pytest.raises(FileMemoryError, match=r"^memory: .*a\.3mf: takes about 381 MiB of memory, 95 MiB are"):
        read_mesh(tmp_path / "a.3mf", allowance)
    monkeypatch.setattr(other_formats, "MAX_MESH", 10_000_000)
    with pytest.raises(rt.FileError, match="it unpacks to 20,000,000 bytes; at most 10,000,000"):
        read_mesh(tmp_path / "a.3mf")
    (tmp_path / "a.3mf").write_bytes(packed.getvalue()[:-30])
    with pytest.raises(rt.SceneError, match="a broken archive, or one with a password"):
        read_mesh(tmp_path / "a.3mf")


def test_triangles_have_a_limit(tmp_path, monkeypatch):
    (tmp_path / "a.off").write_text(OFF)
    monkeypatch.setattr("raytrace.scene.meshes.reading.MAX_TRIANGLES", 1)
    with pytest.raises(rt.FileError, match=r"a\.off: it places 2 triangles; at most 1$"):
        read_mesh(tmp_path / "a.off")
