"""The shipped scenes and their meshes."""

import gzip
import io
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from raytrace.image.texels import read_texels
from raytrace.scene.load import load

SCENES = Path(__file__).parents[1] / "scenes"
MESHES = SCENES / "meshes"
NAMES = sorted(path.stem for path in SCENES.glob("*.json"))
FOLDERS = [SCENES, SCENES / "hard"]
CLOSED = ["short.obj", "tall.obj", "box.obj", "prism.obj", "ball.obj", "torus.glb", "vase.ply", "bumpy.ply.gz"]


def plain(path: Path) -> bytes:
    """Content of a file, decompressed: zlib builds differ in how they compress, not in what."""
    return gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()


def mesh(name: str) -> trimesh.Trimesh:
    kind = name.removesuffix(".gz").rpartition(".")[2]
    return trimesh.load_mesh(io.BytesIO(plain(MESHES / name)), file_type=kind, process=False)


def smooth(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Corners (m, 3, 3) of a mesh and its shading normals there, as a scene sees them."""
    white = {"type": "diffuse", "albedo": [1, 1, 1]}
    item = {"mesh": MESHES / name, "material": "white", "normals": "smooth"}
    camera = {"position": [0, 0, 5], "look_at": [0, 0, 0], "fov": 30}
    loaded = load({"camera": camera, "materials": {"white": white}, "objects": [item]}).mesh
    return loaded.vertices[loaded.faces], loaded.normals


def described(name: str) -> dict:
    return json.loads((SCENES / f"{name}.json").read_text(encoding="utf-8"))


def test_all_scenes_are_shipped():
    promised = {"cornell-box", "cornell-box-glass", "glass-sphere", "glass-slab", "prism", "bumpy", "room"}
    assert promised <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_a_scene_loads_without_warnings_and_says_what_it_shows(name):
    scene = load(SCENES / f"{name}.json")
    assert scene.about.endswith(".")
    assert scene.warnings == ()


def files_in(folder: Path) -> set[Path]:
    """Mesh files of all scenes, as paths below the folder of scenes."""
    return {path.relative_to(folder) for path in folder.glob("**/meshes/*") if path.is_file() and path.suffix != ".py"}


def test_make_reproduces_the_committed_meshes(tmp_path):
    subprocess.run([sys.executable, MESHES / "make.py", tmp_path], check=True)
    assert files_in(tmp_path) == files_in(SCENES)
    assert [name for name in files_in(SCENES) if plain(tmp_path / name) != plain(SCENES / name)] == []


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda path: path.name)
def test_every_mesh_is_used(folder):
    scenes = [json.loads(path.read_text(encoding="utf-8")) for path in folder.glob("*.json")]
    used = {folder / item["mesh"] for scene in scenes for item in scene["objects"] if "mesh" in item}
    used = {path for path in used if path.parent.name == "meshes"}
    assert used == {path for path in (folder / "meshes").iterdir() if path.suffix != ".py" and path.is_file()}


def test_meshes_of_the_hard_scenes_are_small():
    assert sum(path.stat().st_size for path in (SCENES / "hard/meshes").iterdir()) < 100_000


@pytest.mark.parametrize("name", CLOSED)
def test_a_closed_mesh_is_watertight_with_its_front_outside(name):
    closed = mesh(name)
    assert closed.is_watertight
    assert closed.is_winding_consistent
    assert closed.volume > 0
    assert closed.area_faces.min() > 0


@pytest.mark.parametrize("name", ["ball.obj", "torus.glb", "vase.ply", "bumpy.ply.gz"])
def test_smooth_normals_are_unit_and_point_to_the_front(name):
    corners, normals = smooth(name)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=2), 1, atol=1e-12)
    front = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.einsum("fkx,fx->fk", normals, front).min() > 0


def test_the_ball_is_a_sphere_with_the_normals_of_a_sphere():
    corners, normals = smooth("ball.obj")
    np.testing.assert_allclose(np.linalg.norm(corners, axis=2), 1, atol=1e-7)  # stored to seven decimals
    np.testing.assert_allclose(normals, corners, atol=1e-7)


def test_the_torus_has_the_normals_of_a_torus():
    corners, normals = smooth("torus.glb")
    ring = corners * [1, 0, 1] / np.linalg.norm(corners * [1, 0, 1], axis=2, keepdims=True)
    np.testing.assert_allclose(normals, (corners - ring) / 0.38, atol=1e-4)  # stored to 2**-16


@pytest.mark.parametrize(
    ("name", "normal", "low", "high"),
    [
        ("floor.obj", (0, 1, 0), (-1, 0, -1), (1, 0, 1)),
        ("ceiling.obj", (0, -1, 0), (-1, 2, -1), (1, 2, 1)),
        ("back.obj", (0, 0, 1), (-1, 0, -1), (1, 2, -1)),
        ("left.obj", (1, 0, 0), (-1, 0, -1), (-1, 2, 1)),
        ("right.obj", (-1, 0, 0), (1, 0, -1), (1, 2, 1)),
    ],
)
def test_the_walls_bound_the_cornell_box_and_face_into_it(name, normal, low, high):
    wall = mesh(name)
    np.testing.assert_array_equal(wall.face_normals, [normal, normal])
    np.testing.assert_array_equal(wall.bounds, [low, high])
    assert wall.area == 4


@pytest.mark.parametrize(
    ("name", "height", "corners"),
    [
        ("short", 0.6, [(-0.74607, 0.026993), (-0.575747, 0.596896), (0.003337, 0.423823), (-0.166991, -0.146079)]),
        ("tall", 1.2, [(0.7495656, -0.391052), (0.176014, -0.5906493), (-0.020444, -0.026118), (0.553108, 0.173479)]),
    ],
)
def test_the_blocks_stand_on_their_corners(name, height, corners):
    block = {tuple(vertex) for vertex in mesh(f"{name}.obj").vertices.tolist()}
    assert block == {(x, y, z) for x, z in corners for y in (1e-4, height)}


def test_the_pane_is_a_disc_of_32_sides_that_faces_the_camera():
    pane = mesh("pane.obj")
    radius = np.linalg.norm(pane.vertices - [0, 1, 1], axis=1)
    np.testing.assert_allclose(np.sort(radius), [0] + [0.5] * 32, atol=2e-7)  # stored to seven decimals
    np.testing.assert_array_equal(pane.vertices[:, 2], 1)
    assert pane.face_normals[:, 2].min() > 0


def test_the_cornell_boxes_keep_their_numbers():
    box, glass = described("cornell-box"), described("cornell-box-glass")
    assert box["camera"] == {"position": [0, 1, 6.8], "look_at": [0, 1, 0], "up": [0, 1, 0], "fov": 19.5}
    assert box["lights"] == [{"type": "point", "position": [0, 1.5, 0.5], "flux": [17, 12, 5]}]
    albedo = {name: material["albedo"] for name, material in box["materials"].items()}
    assert albedo == {"grey": [0.725, 0.71, 0.68], "red": [0.63, 0.065, 0.05], "green": [0.14, 0.45, 0.091]}
    assert [glass[key] for key in ("camera", "film", "render", "lights")] == [
        box[key] for key in ("camera", "film", "render", "lights")
    ]
    assert glass["objects"] == [*box["objects"], {"mesh": "meshes/pane.obj", "material": "pane"}]


def test_the_glass_spheres_differ_only_in_their_shadows():
    opaque, transparent = described("glass-sphere"), described("glass-sphere-transparent-shadow")
    for name in ("glass", "air"):
        assert transparent["materials"][name].pop("shadows") == "transparent"
    del opaque["about"], transparent["about"]
    assert opaque == transparent


def test_the_prism_is_a_right_angle_past_the_critical_angle():
    normals = {tuple(np.round(normal, 12)) for normal in mesh("prism.obj").face_normals.tolist()}
    slope = round(0.5**0.5, 12)
    assert normals == {(0, 1, 0), (0, -1, 0), (0, 0, 1), (-1, 0, 0), (slope, 0, -slope)}
    assert described("prism")["materials"]["glass"]["ior"] > 2**0.5  # total reflection at 45 degrees


def test_the_bumpy_mesh_is_large_to_trace_and_small_to_store():
    assert len(mesh("bumpy.ply.gz").faces) > 300_000
    assert (MESHES / "bumpy.ply.gz").stat().st_size < 3e6


def test_the_room_shows_every_mesh_format_and_both_kinds_of_normals():
    room = described("room")
    assert {Path(item["mesh"]).suffix for item in room["objects"]} == {".obj", ".ply", ".glb"}
    assert {item.get("normals", "flat") for item in room["objects"]} == {"flat", "smooth"}
    assert len(room["lights"]) > 1


def test_make_reproduces_the_committed_textures(tmp_path):
    for script in ("make.py", "make_sky.py"):
        subprocess.run([sys.executable, SCENES / "textures" / script, tmp_path], check=True)
    made = {path.name for path in tmp_path.iterdir()}
    assert made == {path.name for path in (SCENES / "textures").iterdir() if path.suffix not in (".py", "")}
    for name in made:
        if (
            name == "sky.png"
        ):  # 16 bits, which Pillow does not keep; functions of C libraries may round a code differently
            new, old = (
                read_texels(folder / name, True).codes.astype(int) for folder in (tmp_path, SCENES / "textures")
            )
            assert abs(new - old).max() <= 1
        elif name.endswith(".png"):  # zlib builds differ in how they compress, not in what
            with Image.open(tmp_path / name) as new, Image.open(SCENES / "textures" / name) as old:
                np.testing.assert_array_equal(np.asarray(new), np.asarray(old))
        else:
            assert (tmp_path / name).read_bytes() == (SCENES / "textures" / name).read_bytes()
