"""The goldens do their work: each planted bug turns the gate red, and an honest second renderer leaves it green.

The bugs are planted in the brute-force twin, which draws the scene "studio"; its golden is the pipeline's own. Each is
planted twice: under the golden's seed, where the picture must be the same, and under others, where it differs by noise.
"""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

import naive
import raytrace as rt
from naive_sampling import film_points
from raytrace.golden.check import Golden
from raytrace.golden.gates import Gates, judge
from raytrace.golden.noise import mean_of
from raytrace.golden.pixels import to_light
from raytrace.golden.store import GoldenImage
from raytrace.image import files
from small_scenes import studio

# what the bugs call where the monkeypatch put them in its place
REAL = {name: getattr(naive, name) for name in dir(naive) if callable(getattr(naive, name))}


def draw(scene):
    settings = scene.settings
    points = film_points(settings.sampler, settings.seed, settings.spp, (0, 0, *settings.size))
    return naive.render(scene, points)


@pytest.fixture
def approved(golden, tmp_path):
    """The goldens as they are, with default gates; what failures leave is thrown away."""
    return Golden(golden.location._replace(failures=tmp_path), {}, update=False)


def red(approved, picture, name="studio"):
    """The message of a gate that must fail."""
    with pytest.raises(AssertionError) as failure:
        approved.check(picture, name)
    return str(failure.value)


def seeded(scene, seed):
    return dataclasses.replace(scene, settings=scene.settings._replace(seed=seed))


@pytest.fixture(scope="module")
def noisy():
    """What other seeds say of the studio: the mean of many pictures of the pipeline, and how they differ."""
    return GoldenImage(*mean_of(lambda seed: rt.render(seeded(studio(), seed)), 64, to_light), 64)


def rejected(noisy, scene):
    """What the gates of noisy pictures say of a scene under a seed that the golden has not seen."""
    return judge(draw(seeded(scene, 100)), noisy, NOISY).broken


NOISY = Gates(min_ssim=None, max_outliers=None)


def test_twin_without_a_bug_passes(approved):
    assert approved.check(draw(studio()), "studio")


def test_twin_without_a_bug_passes_among_noise(noisy):
    """Each of three gates fails a right picture in about 1 % of cases: more than 2 of 20 by chance in about 2 %."""
    broken = [judge(draw(seeded(studio(), seed)), noisy, NOISY).broken for seed in range(100, 120)]
    assert sum(map(bool, broken)) <= 2, broken


# --- bugs in the code: the function that replaces one of the twin's --------------------------------------------------


def total_reflection_goes_straight(d, n):
    return d


def total_reflection_absorbs(d, n, eta):
    w, total = REAL["refract"](d, n, eta)
    return np.where(total[..., None], -d, w), total


def eta_inverted(d, n, eta):
    return REAL["refract"](d, n, 1 / eta)


def normal_not_turned(d, ng, ns, ior):
    return REAL["refract"](d, ns, np.where(REAL["dot"](d, ng) < 0, ior, 1 / ior))[0]


def always_entering(d, ng, ns, ior):
    n = np.where((REAL["dot"](d, ng) < 0)[:, None], ng, -ng)
    return REAL["refract"](d, n, ior)[0]


def falloff_forgets_the_sphere(flux, cos, r2):
    return flux * (cos / r2)[:, None]


def falloff_with_distance_only(flux, cos, r2):
    return flux * (cos / (4 * math.pi * np.sqrt(r2)))[:, None]


def cosine_dropped(flux, cos, r2):
    return REAL["irradiance"](flux, np.ones_like(cos), r2)


def offset_too_big(p, p_error, ng, d):
    return p + 1e-2 * np.where(REAL["dot"](d, ng) > 0, 1.0, -1.0)[:, None] * ng


def offset_forgotten(p, p_error, ng, d):
    return p


def offset_to_the_wrong_side(p, p_error, ng, d):
    return REAL["spawn"](p, p_error, ng, -d)


def no_shadows(scene, o, target):
    return np.zeros(len(o), bool)


def shadow_rays_never_end(scene, o, target):
    casts = ~scene.materials.transparent_shadow[scene.mesh.material_id]
    return naive.any_hit(scene.mesh.vertices, scene.mesh.faces[casts], o, target - o)


def half_a_pixel_off(camera, size, film_xy):
    return REAL["camera_rays"](camera, size, film_xy + 0.5)


def samples_at_pixel_corners(camera, size, film_xy):
    return REAL["camera_rays"](camera, size, np.floor(film_xy))


def upside_down(camera, size, film_xy):
    return REAL["camera_rays"](camera, size, film_xy * [1, -1] + [0, size[1]])


def mirrored(camera, size, film_xy):
    return REAL["camera_rays"](camera, size, film_xy * [-1, 1] + [size[0], 0])


def corners_in_wrong_order(corners, weights):
    return REAL["smooth_normal"](corners, np.roll(weights, 1, axis=1))


def normals_of_first_corner(corners, weights):
    return corners[:, 0]


def srgb_in_the_film(scene, film_xy):
    return files.srgb_encode(REAL["render"](scene, film_xy))


CODE_BUGS = [
    ("reflect", total_reflection_goes_straight),
    ("refract", total_reflection_absorbs),
    ("refract", eta_inverted),
    ("bounce", normal_not_turned),
    ("bounce", always_entering),
    ("irradiance", falloff_forgets_the_sphere),
    ("irradiance", falloff_with_distance_only),
    ("irradiance", cosine_dropped),
    ("spawn", offset_too_big),
    ("spawn", offset_forgotten),
    ("spawn", offset_to_the_wrong_side),
    ("occluded", no_shadows),
    ("occluded", shadow_rays_never_end),
    ("camera_rays", half_a_pixel_off),
    ("camera_rays", samples_at_pixel_corners),
    ("camera_rays", upside_down),
    ("camera_rays", mirrored),
    ("smooth_normal", corners_in_wrong_order),
    ("smooth_normal", normals_of_first_corner),
    ("render", srgb_in_the_film),
]


@pytest.mark.parametrize(("name", "bug"), CODE_BUGS, ids=[bug.__name__ for _, bug in CODE_BUGS])
def test_bug_in_the_code_turns_the_gate_red(name, bug, monkeypatch, approved, noisy):
    monkeypatch.setattr(naive, name, bug)
    with np.errstate(all="ignore"):
        assert "studio" in red(approved, draw(studio()))
        assert rejected(noisy, studio())


# --- bugs in what reaches the code -----------------------------------------------------------------------------------


def materials(scene, **change):
    return dataclasses.replace(scene, materials=scene.materials._replace(**change))


def mesh(scene, **change):
    return dataclasses.replace(scene, mesh=scene.mesh._replace(**change))


def settings(scene, **change):
    return dataclasses.replace(scene, settings=scene.settings._replace(**change))


def lights(scene, keep=slice(None), flux=1.0):
    position, light_flux = scene.lights.position, scene.lights.flux
    return dataclasses.replace(
        scene, lights=scene.lights._replace(position=position[keep], flux=flux * light_flux[keep])
    )


INPUT_BUGS = {
    "light 3 % brighter": lambda s: lights(s, flux=1.03),
    "light 0.5 % brighter": lambda s: lights(s, flux=1.005),
    "last light forgotten": lambda s: lights(s, keep=slice(-1)),
    "a depth less": lambda s: settings(s, max_depth=s.settings.max_depth - 1),
    "both sides of everything shine": lambda s: materials(s, two_sided=s.materials.two_sided | True),
    "two_sided ignored": lambda s: materials(s, two_sided=s.materials.two_sided & False),
    "glass casts no shadow": lambda s: materials(s, transparent_shadow=s.materials.kind == 1),
    "transparent shadows ignored": lambda s: materials(s, transparent_shadow=s.materials.kind == 2),
    "material of the neighbour": lambda s: mesh(s, material_id=np.roll(s.mesh.material_id, 1)),
    "winding turned": lambda s: mesh(s, faces=s.mesh.faces[:, ::-1]),
    "normals forgotten": lambda s: mesh(s, normals=None),
    "red and blue exchanged": lambda s: materials(s, albedo=s.materials.albedo[:, ::-1]),
    "background forgotten": lambda s: dataclasses.replace(s, background=0 * s.background),
    "field of view 1 % wider": lambda s: dataclasses.replace(s, camera=s.camera._replace(fov=1.01 * s.camera.fov)),
    "all samples one": lambda s: settings(s, spp=1),
    "another seed": lambda s: settings(s, seed=1),
}


@pytest.mark.parametrize("bug", INPUT_BUGS.values(), ids=INPUT_BUGS.keys())
def test_bug_in_the_input_turns_the_gate_red(bug, approved, noisy):
    assert "studio" in red(approved, draw(bug(studio())))
    if bug is not INPUT_BUGS["another seed"]:
        assert rejected(noisy, bug(studio()))


# --- every golden, not just the studio's -----------------------------------------------------------------------------


def tile_lost(rgb):
    y, x = (extent // 2 for extent in rgb.shape[:2])
    broken = rgb.copy()
    broken[y - 4 : y + 4, x - 4 : x + 4] = 0
    return broken


PICTURE_BUGS = {
    "3 % brighter": lambda rgb: 1.03 * rgb,
    "half a pixel off": lambda rgb: (rgb + np.roll(rgb, 1, axis=1)) / 2,
    "upside down": lambda rgb: rgb[::-1],
    "sRGB in the film": files.srgb_encode,
    "a tile lost": tile_lost,
}


@pytest.mark.parametrize("stored", sorted((Path(__file__).parent / "golden").glob("*.npz")), ids=lambda path: path.stem)
@pytest.mark.parametrize("bug", PICTURE_BUGS.values(), ids=PICTURE_BUGS.keys())
def test_bug_in_the_picture_turns_every_gate_red(stored, bug, approved):
    red(approved, bug(files.load(stored).rgb), stored.stem)
