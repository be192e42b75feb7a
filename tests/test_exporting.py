"""What the exports to all renderers share: meshes, names, backs, the folder, the command."""

import json
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import raytrace as rt
from export_scenes import CAMERA, LAMP, POINT, WHITE, made, triangles
from pbrt_grammar import parse
from raytrace.cli import main
from raytrace.errors import FileError
from raytrace.exporting.backs import back_may_be_seen, winding_number
from raytrace.exporting.common import unique_names
from raytrace.exporting.export import export_files, export_scene
from raytrace.exporting.images import look_up
from raytrace.exporting.meshes import bend, parts_of, ply_bytes
from raytrace.output_folder import write_new_folder

SCENES = Path(__file__).parent.parent / "scenes"
BALL = {"sphere": {"center": [0, 0, 0], "radius": 1, "tolerance": 0.05}, "material": "white"}


def with_objects(folder, *objects, **changes):
    return made(folder, {"white": WHITE, "lamp": LAMP}, objects=list(objects), **changes)


# Meshes ---------------------------------------------------------------------------------------------------------------


def test_parts_have_the_triangles_of_the_scene(tmp_path):
    box = {"box": {}, "material": "lamp", "rotate": {"axis": [1, 2, 3], "angle": 40}, "scale": [1, 2, -3]}
    scene = with_objects(tmp_path, BALL, box)
    corners = scene.mesh.vertices[scene.mesh.faces]
    for number, part in enumerate(parts_of(scene)):
        mine = scene.mesh.object_id == number
        np.testing.assert_array_equal(triangles(ply_bytes(part), tmp_path), corners[mine].astype(np.float32))
        assert scene.materials.name[part.material] == ("white", "lamp")[number]
        assert len(part.vertices) == (8 if number else len(np.unique(corners[mine].reshape(-1, 3), axis=0)))
    assert number == 1


def test_only_smooth_objects_have_normals(tmp_path):
    """In a scene with smooth objects, the flat ones have normals of corners, too: those of their triangles."""
    lamp = BALL | {"normals": "smooth", "material": "lamp"}
    objects = {"box": {}, "material": "white"}, BALL | {"normals": "smooth"}, lamp
    flat, smooth, lamp = parts_of(with_objects(tmp_path, *objects))
    assert lamp.normals is None  # emission depends on the geometric normal
    assert flat.normals is None
    np.testing.assert_allclose(smooth.normals, smooth.vertices, atol=2e-7)  # of a unit sphere
    header = ply_bytes(smooth).split(b"end_header")[0].decode()
    assert header.split("property float ")[1:][3].startswith("nx")


@pytest.mark.parametrize(("tolerance", "coarse"), [(0.05, True), (0.01, False)])
def test_coarse_smooth_meshes_are_named(tmp_path, tolerance, coarse):
    ball = BALL | {"normals": "smooth", "sphere": BALL["sphere"] | {"tolerance": tolerance}}
    scene = with_objects(tmp_path, ball, BALL)
    (smooth, flat) = parts_of(scene)
    n, c = smooth.normals[smooth.faces], smooth.vertices[smooth.faces]
    ng = np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])
    angles = np.degrees(np.arccos((n * ng[:, None]).sum(axis=2) / np.linalg.norm(ng, axis=1)[:, None]))
    assert angles.min() < bend(smooth) < angles.max()
    assert (bend(smooth) > 12) == coarse
    assert bend(flat) == 0
    found = export_files(scene, "mitsuba", approximate=True).warnings
    assert ["objects.sphere: Mitsuba shades silhouettes" in line for line in found] == [True] * coarse


def test_vertices_that_differ_in_uv_are_kept_apart(tmp_path):
    checks = WHITE | {"albedo": {"checkerboard": [[1, 1, 1], [0, 0, 0]]}}
    scene = made(tmp_path, {"checks": checks}, objects=[{"box": {}, "material": "checks"}])
    (part,) = parts_of(scene)
    assert 8 < len(part.vertices) <= 24
    np.testing.assert_array_equal(part.uv[part.faces], scene.mesh.uv.astype(np.float32))
    (tmp_path / "uv.ply").write_bytes(ply_bytes(part))
    content = {"camera": CAMERA, "materials": {"checks": checks}}
    (tmp_path / "uv.json").write_text(json.dumps(content | {"objects": [{"mesh": "uv.ply", "material": "checks"}]}))
    np.testing.assert_array_equal(rt.load(tmp_path / "uv.json").mesh.uv, scene.mesh.uv.astype(np.float32))


def test_vertex_colours_are_written(tmp_path):
    colours = np.array([[0, 0.25, 1], [0.5, 0, 0], [1, 1, 0]], np.float32)
    corners = np.column_stack([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], colours])
    rows = "\n".join(" ".join(map(str, row)) for row in corners)
    names = "".join(f"property float {name}\n" for name in ("x", "y", "z", "red", "green", "blue"))
    header = f"ply\nformat ascii 1.0\nelement vertex 3\n{names}element face 1\nproperty list uchar int vertex_indices\n"
    (tmp_path / "own.ply").write_text(f"{header}end_header\n{rows}\n3 0 1 2\n")
    baked = {"baked": WHITE | {"albedo": {"attribute": "color"}}}
    scene = made(tmp_path, baked, objects=[{"mesh": "own.ply", "material": "baked"}])
    (part,) = parts_of(scene)
    np.testing.assert_array_equal(part.colors, colours)
    header, _, data = ply_bytes(part).partition(b"end_header\n")
    assert header.decode().split("property float ")[-3:][0].startswith("r")
    np.testing.assert_array_equal(np.frombuffer(data, "<f4", 18).reshape(3, 6)[:, 3:], colours)


def test_names_are_unique_and_simple():
    names = unique_names(("plate 1", "plate-1", "a/b", "ö", ""))
    assert len(set(names)) == 5
    assert all(name.replace("-", "").isalnum() and name.isascii() for name in names)


def test_bilinear_lookup_of_an_environment():
    texels = np.arange(24, dtype=np.float32).reshape(2, 4, 3)
    up, ahead = look_up(texels, np.array([[0.0, 1, 0], [0, 0, -1]]))
    assert (up >= texels[0].min(axis=0)).all()
    np.testing.assert_allclose(ahead, (texels[:, 0] + texels[:, -1]).mean(axis=0) / 2)  # u = 0: between columns


# Backs ----------------------------------------------------------------------------------------------------------------


def test_winding_numbers(tmp_path):
    (part,) = parts_of(with_objects(tmp_path, BALL))
    corners = part.vertices.astype(np.float64)[part.faces]
    for point, number in (([0, 0, 0], 1), ([0.5, -0.5, 0.5], 1), ([2, 0, 0], 0)):
        assert winding_number(corners, np.array(point)) == pytest.approx(number, abs=1e-9)
        assert winding_number(corners[:, ::-1], np.array(point)) == pytest.approx(-number, abs=1e-9)


WALL = {"rectangle": {}, "material": "white"}  # faces +z, towards the camera
BEHIND = {"rectangle": {}, "material": "lamp", "translate": [0, 0, -2]}
INSIDE = CAMERA | {"position": [0, 0, 0.2]}


@pytest.mark.parametrize(
    ("objects", "camera", "seen"),
    [
        ([WALL], CAMERA, False),
        ([WALL | {"flip": True}], CAMERA, True),
        ([WALL, BEHIND], CAMERA, True),  # a path goes from the other surface to the back
        ([BALL], CAMERA, False),
        ([BALL, BEHIND], CAMERA, False),
        ([BALL], INSIDE, True),
        ([BALL | {"flip": True}], INSIDE, False),  # a room
        ([BALL | {"flip": True}], CAMERA, True),
        ([WALL], CAMERA | {"type": "orthographic", "height": 4}, False),
        ([WALL], CAMERA | {"type": "orthographic", "height": 60}, True),  # its plane reaches behind the wall
        ([WALL | {"rotate": {"axis": [1, 0, 0], "angle": 30}}], CAMERA, False),
        ([WALL | {"rotate": {"axis": [1, 0, 0], "angle": 89}}], CAMERA | {"aperture": 3}, True),
    ],
)
def test_backs_that_may_be_seen(tmp_path, objects, camera, seen):
    camera = {key: value for key, value in camera.items() if not (key == "fov" and "height" in camera)}
    scene = with_objects(tmp_path, *objects, camera=camera)
    part = next(parts_of(scene))
    assert back_may_be_seen(scene, part) == seen


def test_the_inside_of_an_open_box_may_be_seen(tmp_path):
    """Half of a ball does not enclose anything, though its winding number rounds to 0 outside."""
    scene = with_objects(tmp_path, BALL)
    part = next(parts_of(scene))
    assert not back_may_be_seen(scene, part)
    front = part.vertices[part.faces].mean(axis=1)[:, 2] > 0
    assert back_may_be_seen(scene, part._replace(faces=part.faces[~front]))


def test_backs_are_named_for_pbrt_only(tmp_path):
    scene = with_objects(tmp_path, WALL | {"flip": True}, lights=[POINT])
    export_files(scene, "mitsuba")
    with pytest.raises(rt.SceneError, match=r"objects\.rectangle: pbrt has no diffuse surface that is black from beh"):
        export_files(scene, "pbrt")
    assert len(export_files(scene, "pbrt", approximate=True).warnings) == 1


# The folder -----------------------------------------------------------------------------------------------------------


def test_a_folder_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    folder = tmp_path / "out"
    write_new_folder(folder, {"a.txt": b"1", "b/c.txt": b"2"})
    write_new_folder(folder, {"a.txt": b"3", "b/c.txt": b"4"})
    assert (folder / "b" / "c.txt").read_bytes() == b"4"
    with pytest.raises(FileError, match=r"out: has other files \(b/c\.txt\); choose"):
        write_new_folder(folder, {"a.txt": b"5"})
    real = Path.write_bytes
    monkeypatch.setattr(Path, "write_bytes", lambda path, data: real(path, data) if path.name == "a.txt" else 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_new_folder(folder, {"a.txt": b"5", "b/c.txt": b"6"})
    assert (folder / "a.txt").read_bytes() == b"3"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_folder_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "out").write_text("mine")
    with pytest.raises(FileError, match="exists, and is no folder"):
        write_new_folder(tmp_path / "out", {"a.txt": b"1"})


def test_nothing_is_written_when_the_scene_cannot_be_expressed(tmp_path):
    scene = made(tmp_path / "scene", {"white": WHITE}, background=[1, 1, 1])
    with pytest.raises(rt.SceneError):
        export_scene(scene, "mitsuba", tmp_path / "out")
    assert not (tmp_path / "out").exists()
    path, warnings = export_scene(scene, "mitsuba", tmp_path / "out", approximate=True)
    assert path == tmp_path / "out" / "small.xml"
    assert len(warnings) == 1


def test_an_unknown_renderer_is_refused(tmp_path):
    with pytest.raises(rt.OptionError, match="to: expected one of mitsuba, pbrt, got 'povray'"):
        export_files(made(tmp_path, {"white": WHITE}), "povray")


@pytest.mark.parametrize("to", ["mitsuba", "pbrt"])
def test_exports_are_deterministic(tmp_path, to):
    scene = rt.load(SCENES / "textures.json")
    assert export_files(scene, to, approximate=True) == export_files(scene, to, approximate=True)


@pytest.mark.parametrize("name", ["cornell-box", "caustic", "mirrors", "textures", "veach-mis", "metals", "prism"])
def test_shipped_scenes_are_well_formed(name):
    scene = rt.load(SCENES / f"{name}.json")
    pbrt, mitsuba = (export_files(scene, to, approximate=True) for to in ("pbrt", "mitsuba"))
    shapes = [each for each in parse(pbrt.files[pbrt.scene].decode()) if each.name == "Shape"]
    assert len(shapes) == len(ET.fromstring(mitsuba.files[mitsuba.scene]).findall("shape")) == len(scene.objects)
    assert len(mitsuba.warnings) == {"prism": 2}.get(name, 0)


# The command ----------------------------------------------------------------------------------------------------------


def test_command(tmp_path, capsys):
    made(tmp_path / "scene", {"white": WHITE}, background=[1, 1, 1])
    words = ["export", str(tmp_path / "scene" / "small.json"), "--to", "mitsuba", "-o", str(tmp_path / "out")]
    assert main.main(words) == 3
    assert "background: Mitsuba has no background" in capsys.readouterr().err
    assert main.main([*words, "--approximate"]) == 0
    text = capsys.readouterr()
    assert text.out == f"{tmp_path / 'out' / 'small.xml'}\n"
    assert text.err.startswith("warning: ")
    (tmp_path / "out" / "mine.txt").write_text("mine")
    assert main.main([*words, "--approximate"]) == 4
    assert (tmp_path / "out" / "mine.txt").read_text() == "mine"
