"""Meshes, mesh files and scenes of trimesh as scenes: what they have is used, and what they lack is added."""

import gzip
import math
import subprocess
import sys

import numpy as np
import pytest
import trimesh

import raytrace as rt
from gltf_files import File
from raytrace.cli.main import main
from raytrace.records import DIFFUSE
from raytrace.scene.mesh_scene import UNUSED_COLORS

BALL = trimesh.creation.icosphere(subdivisions=2)
QUAD = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]]
NEEDLE = [[0, 0, 0], [9, 9, 9], [9, 9, 9.1]], [[0, 1, 2]]
SPACE = trimesh.transformations


def in_view(scene):
    """Where the vertices lie in the image, from -1 to 1, and their distance along the axis."""
    camera = scene.camera
    ahead = (camera.look_at - camera.position) / np.linalg.norm(camera.look_at - camera.position)
    right = np.cross(ahead, camera.up) / np.linalg.norm(np.cross(ahead, camera.up))
    points = scene.mesh.vertices - camera.position
    depth = points @ ahead
    half = depth * math.tan(math.radians(camera.fov / 2))
    return points @ right / half, points @ np.cross(right, ahead) / half, depth


@pytest.mark.parametrize("mesh", [BALL, QUAD, NEEDLE, (1e3 + 1e-3 * BALL.vertices, BALL.faces)])
def test_a_mesh_is_seen_from_the_diagonal(mesh):
    scene = rt.load(mesh)
    camera = scene.camera
    offset = camera.position - camera.look_at
    np.testing.assert_allclose(offset / np.linalg.norm(offset), [3**-0.5] * 3, rtol=1e-9)
    assert camera.up.tolist() == [0, 1, 0]
    assert (camera.fov, camera.aperture, camera.height) == (40, 0, None)
    x, y, depth = in_view(scene)
    assert depth.min() > 0
    largest = max(np.abs(x).max(), np.abs(y).max())
    assert (0.5 if mesh is not NEEDLE else 0) < largest < 1


@pytest.mark.parametrize("size", [(100, 400), (300, 301), (400, 100)])
def test_everything_is_in_view_in_any_shape_of_the_image(size):
    origins, directions = rt.camera_rays(BALL, size=size)
    seen = rt.BVH(BALL).any_hit(origins.reshape(-1, 3), directions.reshape(-1, 3)).reshape(origins.shape[:2])
    rows, columns = np.nonzero(seen.any(axis=1))[0], np.nonzero(seen.any(axis=0))[0]
    assert rows[0] > 0
    assert columns[0] > 0
    shorter = min(size)
    assert 0.9 * shorter < max(np.ptp(rows), np.ptp(columns)) < shorter - 1


@pytest.mark.engine
def test_a_tall_image_has_the_hash_of_its_camera():
    scene = rt.load(BALL)
    tall = rt.render(scene, spp=1, size=(4, 8)).provenance["scene_sha256"]
    assert rt.render(scene, spp=1, size=(8, 8)).provenance["scene_sha256"] == scene.sha256
    assert tall != scene.sha256
    assert rt.render(BALL, spp=1, size=(4, 8)).provenance["scene_sha256"] == tall


def test_what_a_mesh_lacks_is_added():
    scene = rt.load(QUAD)
    assert scene.lights.environment.tolist() == [1, 1, 1]
    assert len(scene.lights.flux) == 0
    assert scene.materials.kind.tolist() == [DIFFUSE]
    assert scene.materials.albedo.tolist() == [[0.7] * 3]
    assert scene.materials.two_sided.tolist() == [True]
    assert scene.settings == rt.load("scenes/cornell-box.json").settings._replace(spp=16)
    assert scene.warnings == ()
    assert scene.source is None
    assert scene.sha256 == rt.load(trimesh.Trimesh(*QUAD, process=False)).sha256
    assert scene.sha256 != rt.load(BALL).sha256


@pytest.mark.engine
def test_a_convex_body_in_the_environment_shows_its_albedo():
    image = rt.render(BALL, size=(8, 8), spp=64)
    np.testing.assert_allclose(image.rgb[3:5, 3:5], 0.7, atol=0.03)
    np.testing.assert_array_equal(image.rgb[0, 0], 1)


def test_everything_that_takes_a_scene_takes_a_mesh(tmp_path):
    assert "1 environment" in str(rt.explain(BALL))
    origins, _ = rt.camera_rays(BALL, size=(2, 2))
    np.testing.assert_array_equal(origins[0, 0], rt.load(BALL).camera.position)
    scene = rt.load({**BOX, "objects": [{"mesh": BALL, "material": "white"}]})
    assert len(scene.mesh.faces) == len(BALL.faces)


BOX = {
    "camera": {"position": [0, 0, 5], "look_at": [0, 0, 0], "fov": 40},
    "materials": {"white": {"type": "diffuse", "albedo": [1, 1, 1]}},
}
NO_MESHES = {
    "nan": ((np.full((3, 3), np.nan), [[0, 1, 2]]), "mesh: vertices: row 0 is not finite"),
    "no faces": ((np.zeros((3, 3)), np.zeros((0, 3), int)), "mesh: no triangles in it"),
    "empty": (trimesh.Trimesh(), "mesh: no triangles in it"),
    "numbers": (([[0, 0, 0]], [[0, 1, 2]]), "mesh: faces: row 0 is"),
    "number": (5, "scene: expected a path, a dict or a mesh, got int"),
    "None": (None, "scene: expected a path, a dict or a mesh, got NoneType"),
    "list": ([1, 2, 3], "mesh: expected a path, a mesh with vertices and faces"),
    "cloud": (trimesh.PointCloud(np.zeros((3, 3))), "mesh: expected a path, a mesh with vertices and faces"),
    "empty scene": (trimesh.Scene(), "scene: a trimesh.Scene without a mesh"),
}


@pytest.mark.parametrize("name", NO_MESHES)
def test_what_is_no_mesh_gets_one_line(name):
    mesh, text = NO_MESHES[name]
    with pytest.raises(rt.SceneError) as caught:
        rt.load(mesh)
    assert str(caught.value).startswith(text)
    assert "\n" not in str(caught.value)


# Files ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "off", "glb"])
def test_a_mesh_file_is_a_scene(tmp_path, suffix):
    path = tmp_path / f"ball.{suffix}"
    BALL.export(path)
    scene = rt.load(path)
    assert len(scene.mesh.faces) == len(BALL.faces)
    assert scene.source == path
    np.testing.assert_allclose(scene.camera.position, rt.load(BALL).camera.position, rtol=1e-5)
    assert scene.materials.albedo.tolist() == [[0.7] * 3]
    packed = tmp_path / f"packed.{suffix}.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    assert rt.load(str(packed)).sha256 == scene.sha256


def test_a_file_that_the_user_names_may_lie_anywhere(tmp_path, monkeypatch):
    (tmp_path / "there").mkdir()
    (tmp_path / "here").mkdir()
    BALL.export(tmp_path / "there" / "ball.obj")
    (tmp_path / "here" / "link.obj").symlink_to(tmp_path / "there" / "ball.obj")
    monkeypatch.chdir(tmp_path / "here")
    assert len({rt.load(name).sha256 for name in ("link.obj", "../there/ball.obj")}) == 1


def test_uv_of_a_mesh_file_are_read_where_they_are_asked_for(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n")
    assert rt.load(path).corner_uv.tolist() == [[[0, 0], [1, 0], [0, 1]]]


BAD = {
    "a.obj": (b"v 1 2 x\n", 3, "{}:1: expected a number, got 'x'"),
    "a.stl": (b"solid a\nendsolid a\n", 3, "{}: no triangles in it"),
    "a.glb": (b"glTF123", 3, "{}: not a complete GLB file: the header states 0 bytes, the file has 7"),
    "a.gltf": (b"{", 3, "{}: not a complete GLTF file: Expecting property name"),
    "a.ply": (None, 4, "{}: no such file"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_mesh_file_gets_one_line(name, tmp_path, capsys):
    content, code, text = BAD[name]
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    assert main([str(path), "-o", str(tmp_path / "a.png")]) == code
    said = capsys.readouterr().err
    assert said.startswith(text.format(path)), said
    assert said.count("\n") == 1


def test_the_command_line_takes_a_mesh(tmp_path, monkeypatch, capsys):
    BALL.export(tmp_path / "ball.glb")
    monkeypatch.chdir(tmp_path)
    assert main(["ball.glb", "--spp", "1", "--size", "8x8", "--quiet"]) == 0
    assert (tmp_path / "ball.png").exists()
    assert main(["check", "ball.glb"]) == 0
    assert main(["explain", "ball.glb"]) == 0
    out = capsys.readouterr().out
    assert "ball.glb: ok" in out
    assert "1 environment" in out


def test_trimesh_is_not_imported_for_it(tmp_path):
    (tmp_path / "a.glb").write_bytes(File().glb())
    program = (
        "import sys, raytrace as rt; rt.load(sys.argv[1]); rt.load(([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))"
    )
    program += "; sys.exit('trimesh' in sys.modules)"
    subprocess.run([sys.executable, "-c", program, tmp_path / "a.glb"], check=True, timeout=600)


# glTF -----------------------------------------------------------------------------------------------------------------

PUNCTUAL = "KHR_lights_punctual"
TURN = {"rotation": [0, math.sqrt(0.5), 0, math.sqrt(0.5)]}  # a quarter about y: -z becomes -x
PERSPECTIVE = {"type": "perspective", "perspective": {"yfov": math.pi / 6, "znear": 0.1}}


def gltf(cameras=(), lights=(), nodes=(), **more):
    """The unit square with cameras, lights, and nodes below a turned one at (5, 0, 0), scaled by 2."""
    file = File()
    file.json["nodes"] += [{"translation": [5, 0, 0], "scale": [2, 2, 2], **TURN}, *nodes]
    file.json["nodes"][1]["children"] = list(range(2, 2 + len(nodes)))
    file.json["scenes"][0]["nodes"] = [0, 1]
    file.json |= {"cameras": list(cameras), "extensions": {PUNCTUAL: {"lights": list(lights)}}, **more}
    return file


def lit(index):
    return {"extensions": {PUNCTUAL: {"light": index}}}


@pytest.fixture
def load(tmp_path):
    """Load a glTF file that grows."""

    def write(file):
        path = tmp_path / "a.glb"
        path.write_bytes(file.glb())
        return rt.load(path)

    return write


def test_the_first_camera_of_a_file_is_used(load):
    other = {"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}
    scene = load(gltf([other, PERSPECTIVE], nodes=[{"camera": 1, "translation": [1, 2, 3]}, {"camera": 0}]))
    camera = scene.camera
    np.testing.assert_allclose(camera.position, [5 + 2 * 3, 4, -2], atol=1e-12)
    np.testing.assert_allclose(camera.look_at, [0.5, 4, -2], atol=1e-12)  # before the middle of the square
    np.testing.assert_allclose(camera.up, [0, 1, 0], atol=1e-12)
    assert camera.fov == pytest.approx(30)
    assert scene.settings.size == (512, 512)
    assert [line.partition(": ")[2] for line in scene.warnings] == ["left out: all cameras but the first"]
    assert scene.lights.environment is not None


@pytest.mark.parametrize(("aspect", "size"), [(2, (512, 256)), (0.5, (256, 512)), (1e-9, (32, 512))])
def test_a_camera_states_the_shape_of_the_film(load, aspect, size):
    lens = {**PERSPECTIVE["perspective"], "aspectRatio": aspect}
    assert load(gltf([{**PERSPECTIVE, "perspective": lens}], nodes=[{"camera": 0}])).settings.size == size


def test_an_orthographic_camera_has_twice_its_magnification_as_height(load):
    lens = {"xmag": 3, "ymag": 1.5, "znear": 0, "zfar": 9}
    scene = load(gltf([{"type": "orthographic", "orthographic": lens}], nodes=[{"camera": 0}]))
    assert scene.camera.height == 3
    assert scene.settings.size == (512, 256)


def test_lights_of_a_file_are_used(load):
    lights = [
        {"type": "point", "intensity": 5, "color": [1, 0.5, 0]},
        {"type": "spot", "intensity": 2, "range": 3, "spot": {"innerConeAngle": 0.25, "outerConeAngle": 0.5}},
        {"type": "directional", "intensity": 7},
        {"type": "spot", "range": 4},
    ]
    nodes = [{**lit(k), "translation": [0, 0, k]} for k in range(4)]
    used = ["EXT_lights_image_based", PUNCTUAL]
    scene = load(gltf(lights=lights, nodes=nodes, extensionsUsed=used))
    found = scene.lights
    assert found.environment is None
    np.testing.assert_allclose(found.position, [[5, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(found.flux, [[20 * math.pi, 10 * math.pi, 0]])
    np.testing.assert_allclose(found.spots.position, [[7, 0, 0], [11, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(found.spots.axis, [[-1, 0, 0]] * 2, atol=1e-12)
    np.testing.assert_allclose(found.spots.intensity, [[2] * 3, [1] * 3])
    np.testing.assert_allclose(found.spots.cutoff, [0.5, math.pi / 4])
    np.testing.assert_allclose(found.spots.beam, [0.25, 0], atol=1e-15)
    np.testing.assert_allclose(found.directions.direction, [[-1, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(found.directions.irradiance, [[7] * 3])
    left_out = [line.partition(": ")[2] for line in scene.warnings]
    assert left_out == ["left out: the range of lights, EXT_lights_image_based"]
    np.testing.assert_allclose(scene.camera.look_at, [0.5, 0.5, 0])  # a camera is still added


def test_lights_of_hidden_nodes_are_out(load):
    hidden = {**lit(0), "extensions": {PUNCTUAL: {"light": 0}, "KHR_node_visibility": {"visible": False}}}
    assert load(gltf(lights=[{"type": "point"}], nodes=[hidden])).lights.environment is not None


@pytest.mark.engine
def test_candela_are_watt_per_steradian(load):
    """I / r^2 is the irradiance of a surface that faces the light, and albedo / pi of it the radiance."""
    looking = {"camera": 0, "translation": [0.25, 0.25, 4]}
    file = gltf([PERSPECTIVE], [{"type": "point", "intensity": 20}])
    file.json["nodes"] += [looking, {**lit(0), "translation": [0.25, 0.25, 2]}]
    file.json["scenes"][0]["nodes"] += [2, 3]
    image = rt.render(load(file), size=(63, 63), spp=4)
    np.testing.assert_allclose(image.rgb[31, 31], 0.7 / math.pi * 20 / 4, rtol=1e-3)


def test_with_a_metal_all_the_light_is_rendered(load):
    file = gltf(materials=[{}])
    file.primitive["material"] = 0  # metallic is 1 by default
    assert load(file).settings.integrator == "path"
    file.json["materials"] = [{"pbrMetallicRoughness": {"metallicFactor": 0}}]
    assert load(file).settings.integrator == "direct"


WRONG = {
    "fov": (
        [{"type": "perspective", "perspective": {"yfov": -1}}],
        [],
        {"camera": 0},
        "camera.fov: expected a number > 0",
    ),
    "no fov": ([{"type": "perspective"}], [], {"camera": 0}, "cameras: missing yfov"),
    "camera": ([], [], {"camera": 0}, "cameras[0] does not exist"),
    "kind": ([{"type": "fisheye"}], [], {"camera": 0}, "cameras: expected the type"),
    "words": ([{**PERSPECTIVE, "perspective": {"yfov": "x"}}], [], {"camera": 0}, "cameras: yfov: expected a number"),
    "light": ([], [], lit(0), "lights[0] does not exist"),
    "lamp": ([], [{"type": "area"}], lit(0), "lights: expected the type"),
    "cones": (
        [],
        [{"type": "spot", "spot": {"innerConeAngle": 0.5, "outerConeAngle": 0.4}}],
        lit(0),
        "lights[0].beam: ",
    ),
    "wide": (
        [],
        [{"type": "spot", "spot": {"outerConeAngle": 2}}],
        lit(0),
        "lights[0].cutoff: expected a number <= 90",
    ),
    "negative": ([], [{"type": "point", "intensity": -1}], lit(0), "lights[0].flux[0]: expected a number >= 0"),
    "flat": ([PERSPECTIVE], [], {"camera": 0, "scale": [0, 0, 0]}, "camera.look_at: the camera looks at its own"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_in_a_file_is_named(load, tmp_path, name):
    cameras, lights, node, text = WRONG[name]
    with pytest.raises(rt.SceneError) as caught:
        load(gltf(cameras, lights, [node]))
    assert str(caught.value).startswith(f"{tmp_path / 'a.glb'}: {text}"), caught.value


# trimesh --------------------------------------------------------------------------------------------------------------


def trimesh_scene():
    scene = trimesh.Scene()
    scene.add_geometry(BALL, geom_name="ball")
    scene.add_geometry(BALL, transform=SPACE.translation_matrix([0, 5, 0]) @ np.diag([2, 2, 2, 1]))
    scene.add_geometry(trimesh.creation.box(), geom_name="box", transform=SPACE.rotation_matrix(0.5, [1, 2, 3]))
    return scene


def test_a_scene_of_trimesh_keeps_its_transforms():
    source = trimesh_scene()
    scene = rt.load(source)
    expected = source.to_mesh()
    np.testing.assert_allclose(
        scene.mesh.vertices[scene.mesh.faces], expected.vertices[expected.faces], atol=1e-12, rtol=0
    )
    assert scene.materials.name == ("no material",)
    assert scene.warnings == ()
    assert scene.lights.environment is not None
    assert not source.has_camera  # neither was made on the way
    assert getattr(source, "_lights", None) is None


def test_the_camera_and_the_lights_that_were_set_are_used():
    source = trimesh_scene()
    source.camera = trimesh.scene.Camera(name="eye", resolution=(40, 30), fov=(40, 2 * math.degrees(math.atan(
        0.75 * math.tan(math.radians(20))))))  # fmt: skip
    source.camera_transform = SPACE.translation_matrix([1, 2, 30])
    sun = trimesh.scene.lighting.DirectionalLight(name="sun", color=[255, 0, 51, 255], intensity=3)
    lamp = trimesh.scene.lighting.SpotLight(
        name="lamp", color=[255] * 4, intensity=2, radius=9, innerConeAngle=0.1, outerConeAngle=0.2
    )
    bulb = trimesh.scene.lighting.PointLight(name="bulb", color=[255] * 4, intensity=1)
    source.lights = [sun, lamp, bulb]
    source.graph["sun"] = SPACE.rotation_matrix(math.pi / 2, [0, 1, 0])
    source.graph["lamp"] = SPACE.translation_matrix([0, 0, 8])
    scene = rt.load(source)
    assert scene.settings.size == (40, 30)
    assert scene.camera.position.tolist() == [1, 2, 30]
    np.testing.assert_allclose(scene.camera.look_at[:2], [1, 2])
    assert scene.camera.fov == pytest.approx(2 * math.degrees(math.atan(0.75 * math.tan(math.radians(20)))))
    assert scene.lights.environment is None
    np.testing.assert_allclose(scene.lights.directions.direction, [[-1, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(scene.lights.directions.irradiance, [[3, 0, 0.6]])
    np.testing.assert_allclose(scene.lights.spots.position, [[0, 0, 8]])
    np.testing.assert_allclose(scene.lights.spots.axis, [[0, 0, -1]])
    np.testing.assert_allclose(scene.lights.spots.cutoff, [0.2])
    np.testing.assert_allclose(scene.lights.flux, [[4 * math.pi] * 3])
    assert scene.lights.position.tolist() == [[0, 0, 0]]  # it has no node
    assert scene.warnings == ("trimesh.Scene: left out: the radius of lights",)


def test_rays_of_the_camera_are_those_of_trimesh():
    source = trimesh_scene()
    across = 2 * math.degrees(math.atan(math.tan(math.radians(20)) * 4 / 3))
    source.camera = trimesh.scene.Camera(resolution=(12, 9), fov=(across, 40))
    source.camera_transform = SPACE.rotation_matrix(0.7, [1, 2, 3]) @ SPACE.translation_matrix([0.2, 0.3, 5])
    theirs = source.camera_rays()
    origins, directions = rt.camera_rays(source)
    x, y = theirs[2].T
    np.testing.assert_allclose(theirs[0], origins[8 - y, x], atol=1e-14)  # it counts rows from the bottom
    np.testing.assert_allclose(theirs[1], directions[8 - y, x], atol=1e-14)


def test_what_trimesh_has_and_a_scene_has_not_is_named():
    source = trimesh_scene()
    source.add_geometry(trimesh.PointCloud(np.zeros((3, 3))), geom_name="cloud")
    colored = trimesh.creation.box()
    colored.visual.vertex_colors = np.full((8, 4), 255, np.uint8)
    source.add_geometry(colored)
    source.camera = trimesh.scene.Camera(resolution=(40, 30), fov=(60, 20))
    (line,) = rt.load(source).warnings
    text = (
        "cloud (a PointCloud), the horizontal field of view (pixels are square), the colours and materials of trimesh"
    )
    assert line == f"trimesh.Scene: left out: {text}"


def test_a_broken_mesh_of_a_trimesh_scene_is_named():
    source = trimesh_scene()
    broken = BALL.copy()
    broken.vertices[7] = np.nan
    source.add_geometry(broken, geom_name="broken")
    with pytest.raises(rt.SceneError, match=r"^trimesh\.Scene: broken: vertices: row 7 is not finite"):
        rt.load(source)


@pytest.mark.parametrize("suffix", ["", ".gz"])
@pytest.mark.parametrize("kind", [".ply", ".obj"])
def test_vertex_colours_that_are_not_used_are_named(tmp_path, kind, suffix):
    plain = {
        ".obj": "v 0 0 0{}\nv 1 0 0{}\nv 0 1 0{}\nf 1 2 3\n",
        ".ply": "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n{}"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0{}\n1 0 0{}\n0 1 0{}\n3 0 1 2\n",
    }[kind]
    header = "property uchar red\nproperty uchar green\nproperty uchar blue\n"
    colours = [" 1 0 0"] * 3 if kind == ".obj" else [header, *[" 9 8 7"] * 3]
    for name, parts in (("plain", [""] * len(colours)), ("coloured", colours)):
        data = plain.format(*parts).encode()
        (tmp_path / f"{name}{kind}{suffix}").write_bytes(gzip.compress(data) if suffix else data)
    assert rt.load(tmp_path / f"plain{kind}{suffix}").warnings == ()
    path = tmp_path / f"coloured{kind}{suffix}"
    assert rt.load(path).warnings == (f"{path}: {UNUSED_COLORS}",)
    assert '"albedo": {"attribute": "color"}' in UNUSED_COLORS
