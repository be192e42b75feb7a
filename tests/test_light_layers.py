"""The layers emission, direct and indirect: their sum, their meaning, their files, and renders that are cut up."""

import numpy as np
import pytest

import raytrace as rt
from raytrace.cli import main
from raytrace.image import files
from raytrace.limits import LAYERS, LIGHT_LAYERS
from raytrace.rendering import checkpoint, run
from raytrace.rendering.checkpoint import Checkpoint
from raytrace.rendering.threads import RenderThreads
from same_pictures import assert_same

SIZE = (40, 36)
DOWN = {"axis": [1, 0, 0], "angle": 90}
ROOM = {
    "camera": {"position": [0, 1.2, 5], "look_at": [0, 0.8, 0], "fov": 40},
    "film": {"size": SIZE},
    "render": {"integrator": "path", "max_depth": 8},
    "lights": [
        {"type": "point", "position": [1, 2, 1.5], "flux": [9, 8, 7]},
        {"type": "environment", "radiance": [0.1, 0.2, 0.3]},
    ],
    "materials": {
        "white": {"type": "diffuse", "albedo": [0.7, 0.7, 0.7], "two_sided": True},
        "lamp": {"type": "diffuse", "albedo": [0.5, 0.2, 0.1], "emission": [2, 1.5, 1]},
        "mirror": {"type": "mirror", "reflectance": [0.9, 0.9, 0.9]},
        "glass": {"type": "dielectric", "ior": 1.5, "shadows": "transparent"},
    },
    "objects": [
        {"rectangle": {}, "material": "white", "scale": 3, "rotate": {"axis": [1, 0, 0], "angle": -90}},
        {"rectangle": {}, "material": "white", "scale": 3, "translate": [0, 0, -1.5]},
        {"box": {}, "material": "mirror", "scale": 0.4, "translate": [-0.8, 0.45, 0.3]},
        {"box": {}, "material": "glass", "scale": 0.3, "translate": [0.7, 0.7, 0.9]},
        {"rectangle": {}, "material": "lamp", "scale": 0.4, "rotate": DOWN, "translate": [0, 2, 0]},
    ],
}


def parts(image):
    """The three layers, (3, h, w, 3) in float64."""
    return np.array([image.aov[name] for name in LIGHT_LAYERS], np.float64)


@pytest.fixture(scope="module")
def scene():
    return rt.load(ROOM)


@pytest.fixture(scope="module")
def image(scene):
    return rt.render(scene, spp=16, aov=LIGHT_LAYERS)


# What they are --------------------------------------------------------------------------------------------------------


def test_they_add_up_to_the_image_and_change_no_bit_of_it(scene, image):
    """A sample adds at most two terms per surface, and one more, to its radiance and to its layers."""
    plain = rt.render(scene, spp=16)
    assert_same(image, plain)
    assert plain.stats["rays"] == image.stats["rays"]
    layers = parts(image)
    assert (layers >= 0).all()
    assert (layers.mean(axis=(1, 2, 3)) > 0.01).all()
    terms = 2 * ROOM["render"]["max_depth"] + 1
    bound = (2 * terms + 2) * 2.0**-24 * image.rgb  # 2: the image and the layers are rounded to float32
    assert (np.abs(layers.sum(axis=0) - image.rgb) <= bound).all()


def test_emission_and_direct_have_the_expectation_of_the_integrator_direct(scene):
    """A t-test over 16 seeds, of eight groups of columns; indirect light is a tenth of the direct, and more."""
    blocks = []
    for seed in range(16):
        image = rt.render(scene, spp=16, seed=seed, aov=["direct"], threads=1)
        emission, direct, indirect = parts(image)
        other = rt.render(scene, spp=16, seed=seed + 1000, integrator="direct", threads=1).rgb.astype(np.float64)
        assert indirect.mean() > 0.1 * direct.mean()
        blocks.append([each[:, k::8].mean() for k in range(8) for each in (emission + direct - other, direct)])
    off, direct = np.moveaxis(np.reshape(blocks, (16, 8, 2)), 2, 0)
    t = off.mean(axis=0) / (off.std(axis=0, ddof=1) / 4)
    assert np.abs(t).max() < 5.2  # Student's t, 15 degrees of freedom: 1e-3 for all eight
    assert (off.std(axis=0, ddof=1) / 4 < 0.02 * direct.mean(axis=0)).all()


def test_each_layer_by_scenes_that_have_one_kind_of_light(scene):
    """A camera that sees lamps and environment only; a lit plane that no light leaves again; a plane lit by a wall."""
    lamps = {
        **ROOM,
        "lights": ROOM["lights"][1:],
        "materials": {"lamp": {**ROOM["materials"]["lamp"], "albedo": [0, 0, 0]}},
    }
    lamps["objects"] = [{"box": {}, "material": "lamp", "scale": 0.5}]
    emission, direct, indirect = parts(rt.render(rt.load(lamps), spp=4, size=(16, 16), aov=["emission"]))
    assert emission.min() > 0
    assert not direct.any()
    assert not indirect.any()
    plane = {**ROOM, "lights": [*ROOM["lights"][:1]], "objects": ROOM["objects"][:1]}
    emission, direct, indirect = parts(rt.render(rt.load(plane), spp=4, size=(16, 16), aov=["emission"]))
    assert not emission.any()
    assert direct.max() > 0.01
    assert not indirect.any()  # a plane does not light itself
    ball = {
        **plane,
        "objects": [
            {"sphere": {"center": [0, 0, 0], "radius": 1, "tolerance": 0.2}, "normals": "smooth", "material": "white"}
        ],
    }
    emission, direct, _ = parts(rt.render(rt.load(ball), spp=16, size=(16, 16), aov=["emission"]))
    assert not emission.any()  # not where the sampled direction ends behind the surface, either
    assert direct.max() > 0.01
    closed = {**plane, "objects": ROOM["objects"][:2], "render": {"integrator": "path", "max_depth": 1}}
    assert not parts(rt.render(rt.load(closed), spp=4, size=(16, 16), aov=["emission"]))[2].any()
    closed["render"] = {"integrator": "path", "max_depth": 2}
    assert parts(rt.render(rt.load(closed), spp=4, size=(16, 16), aov=["emission"]))[2].max() > 0.001


# Renders that are cut up ----------------------------------------------------------------------------------------------


def test_crop_and_rounds_and_threads_change_no_bit(scene, image, monkeypatch):
    crop = rt.render(scene, spp=16, crop=(3, 5, 20, 17), aov=["emission"])
    assert np.array_equal(parts(crop), parts(image)[:, 5:22, 3:23])
    monkeypatch.setattr(run, "first_round", lambda spp, seconds: 1)
    assert np.array_equal(parts(rt.render(scene, spp=16, threads=3, aov=["emission"])), parts(image))


def test_pixels_of_a_target_error_have_the_layers_of_their_samples(scene):
    image = rt.render(scene, target_error=0.03, spp=64, aov=["indirect"])
    numbers = image.aov["samples"]
    assert len(np.unique(numbers)) > 1
    for n in np.unique(numbers):
        alone = rt.render(scene, spp=int(n), aov=["indirect"])
        assert np.array_equal(parts(image)[:, numbers == n], parts(alone)[:, numbers == n])


def test_an_image_that_is_ended_early_has_those_of_its_last_round(scene, monkeypatch):
    looks = iter(range(1000))
    monkeypatch.setattr(run.Run, "_over", lambda _run: next(looks) > 14)
    monkeypatch.setattr(run, "first_round", lambda spp, seconds: 1)
    image = rt.render(scene, spp=64, threads=1, aov=["direct"])
    monkeypatch.undo()
    n = image.provenance["samples"]
    assert 0 < n < 64
    assert image.aov["samples"].max() == n
    alone = rt.render(scene, spp=n, aov=["direct"])
    assert np.array_equal(parts(image), parts(alone))
    assert np.array_equal(image.var, alone.var, equal_nan=True)
    assert np.array_equal(image.stderr, alone.stderr, equal_nan=True)
    nothing = rt.render(scene, spp=64, time_limit=0, aov=["direct"])
    assert not parts(nothing).any()


def test_a_resumed_render_has_the_same_bits(scene, image, monkeypatch, tmp_path):
    monkeypatch.setattr(checkpoint, "EVERY", 0.0)
    monkeypatch.setattr(checkpoint, "SHARE", 1e9)
    monkeypatch.setattr(run, "first_round", lambda spp, seconds: 4)
    path, ask = tmp_path / "a.checkpoint", {"spp": 16, "aov": ["direct"], "threads": 1}
    draw, numbers = RenderThreads.draw, iter(range(1000))

    def stop(*args):
        if next(numbers) == 2:
            raise KeyboardInterrupt
        return draw(*args)

    with monkeypatch.context() as patch:
        patch.setattr(RenderThreads, "draw", stop)
        assert not rt.render(scene, checkpoint=path, **ask).complete
    with pytest.raises(rt.FileError, match=r"belongs to another image \(light_layers True, not False\)"):
        rt.render(scene, checkpoint=path, spp=16)
    lines = []
    resumed = rt.render(scene, checkpoint=Checkpoint(path, say=lines.append), **ask)
    assert lines[0].startswith(f"{path}: resuming from ")
    assert not lines[0].startswith(f"{path}: resuming from 0 ")
    assert_same(resumed, image)
    assert np.array_equal(parts(resumed), parts(image))


# How they are asked for -----------------------------------------------------------------------------------------------


def test_they_are_there_only_if_asked_for_and_all_three_if_one_is(scene, image):
    plain = rt.render(scene, spp=1, size=(8, 8))
    assert tuple(plain.aov) == LAYERS
    assert "direct" not in plain.aov
    with pytest.raises(KeyError, match=r"direct.*: not kept; ask for it before the render: rt\.render"):
        plain.aov["direct"]
    one = rt.render(scene, spp=1, size=(8, 8), aov="indirect")
    assert tuple(one.aov) == LAYERS + LIGHT_LAYERS
    assert len(one.aov) == len(LAYERS) + 3
    assert list(one.aov.computed) == ["indirect"]
    assert one.aov["emission"].shape == (8, 8, 3)
    assert one.aov["emission"].dtype == np.float32


def test_another_integrator_is_refused(scene):
    with pytest.raises(
        rt.OptionError, match="aov: direct needs the integrator path, not direct; add --integrator path"
    ):
        rt.render(scene, integrator="direct", aov=["depth", "direct"])
    with pytest.raises(rt.OptionError, match=r"expected any of depth, .*, indirect$"):
        rt.render(scene, aov=["caustics"])


@pytest.mark.parametrize("suffix", ["exr", "npz"])
def test_files_have_those_that_were_asked_for(scene, suffix, tmp_path):
    if suffix == "exr":
        pytest.importorskip("OpenEXR")
    image = rt.render(scene, spp=1, size=(8, 8), aov=["emission", "indirect"])
    kept = files.load(image.save(tmp_path / f"a.{suffix}"))
    assert set(kept.aov) == {"emission", "indirect"}
    for name, layer in kept.aov.items():
        assert np.array_equal(layer, image.aov[name])


def test_the_command_line_has_them(tmp_path, capsys):
    box = "scenes/cornell-box-area.json"
    ask = ["--size", "8x8", "--spp", "1", "--quiet", "--aov", "emission,direct", "-o", str(tmp_path / "a.npz")]
    assert main.main([box, *ask]) == 0
    assert set(files.load(tmp_path / "a.npz").aov) == {"emission", "direct"}
    assert main.main([box, *ask, "--integrator", "direct"]) == 2
    assert "aov: emission needs the integrator path, not direct; add --integrator path" in capsys.readouterr().err
