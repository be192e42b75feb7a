"""The z-test of two images: how often it is wrong, what it finds, and what it says where it can't judge."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

import raytrace as rt
from raytrace.cli import main
from raytrace.errors import OptionError
from raytrace.image.files import save
from raytrace.image.significance import z_test

PAIRS = 300
SIZE = 24, 20


def image(rng, draw, deviation):
    """Mean of four batch means in each pixel and channel, and its estimated variance."""
    batches = 0.5 + deviation * draw(rng, (4, *SIZE, 3))
    return SimpleNamespace(rgb=batches.mean(axis=0), var=batches.var(axis=0, ddof=1) / 4)


NOISES = {
    "normal": lambda rng, shape: rng.normal(size=shape),
    "skewed": lambda rng, shape: rng.exponential(size=shape),
    "rare": lambda rng, shape: 10.0 * (rng.random(shape) < 0.02),
}


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("spread", ["even", "one pixel"])
def test_images_of_the_same_scene_are_rejected_as_rarely_as_alpha_says(noise, spread):
    rng, deviation = np.random.default_rng(5), np.full((*SIZE, 3), 0.02)
    if spread == "one pixel":  # its noise is that of its tile and of the image
        deviation[11, 5] = 1.0
    p = np.array([z_test(*(image(rng, NOISES[noise], deviation) for _ in range(2))).p for _ in range(PAIRS)])
    assert np.mean(p < 0.05) < 0.05 + 2.33 * np.sqrt(0.05 * 0.95 / PAIRS)  # 1 % one-sided
    if (noise, spread) == ("normal", "even"):
        assert np.mean(p < 0.05) > 0.01  # it is no test that never rejects
        assert 0.35 < np.median(p) < 0.7


@pytest.fixture(scope="module")
def renders():
    scene = rt.load("scenes/cornell-box.json")
    return [rt.render(scene, spp=16, size=(24, 24), seed=seed, sampler="independent") for seed in range(80)]


def test_renders_that_differ_in_their_seeds_pass(renders):
    rejected = [z_test(a, b, 0.05).passed is False for a, b in zip(renders[::2], renders[1::2], strict=True)]
    assert sum(rejected) <= 5  # of 40: more have a probability of 1.4 % at a rate of 5 %


def test_one_percent_of_light_is_found():
    a, b = (rt.render("scenes/cornell-box.json", spp=64, size=(48, 48), seed=seed) for seed in range(2))
    assert z_test(a, b).passed
    brighter = SimpleNamespace(rgb=1.01 * a.rgb, var=1.01**2 * a.var)
    found = z_test(brighter, b)
    assert not found.passed
    assert found.p < 1e-3
    assert max(found.whole_z) > 4
    assert "mean of" in found.reason


def test_one_tile_is_found():
    rng, deviation = np.random.default_rng(6), np.full((*SIZE, 3), 0.02)
    a, b = (image(rng, NOISES["normal"], deviation) for _ in range(2))
    assert z_test(a, b).passed
    a.rgb[8:16, 12:20, 2] += 0.012
    found = z_test(a, b)
    assert (found.tile_at, found.tile_channel, found.passed) == ((8, 12), "blue", False)
    assert "blue of the tile at row 8, column 12: z = +" in found.reason


def test_equal_images_pass_and_so_does_rounding_without_noise():
    light, none = np.linspace(0, 1, 16 * 16 * 3).reshape(16, 16, 3), np.zeros((16, 16, 3))
    a, b = SimpleNamespace(rgb=light, var=none), SimpleNamespace(rgb=light * (1 + 1e-6), var=none)
    assert z_test(a, a).p == z_test(a, a, 0.5).p == 1.0
    assert z_test(a, b).passed
    b.rgb = light + 0.01
    assert not z_test(a, b).passed
    black = SimpleNamespace(rgb=none, var=none)
    assert z_test(black, black).passed


def test_a_pixel_that_is_not_finite_is_left_out(renders):
    a, b = (SimpleNamespace(rgb=one.rgb.copy(), var=one.var.copy()) for one in renders[:2])
    a.rgb[3, 4, 1], a.var[3, 4, 1], b.rgb[9, 9] = np.nan, np.nan, np.inf
    found = z_test(a, b)
    assert found.passed
    assert np.isfinite([found.p, found.tile_z, found.pixel_z, *found.whole_z]).all()


def test_what_can_not_be_judged_is_an_error(renders):
    a = renders[0]
    with pytest.raises(OptionError, match=r"^z-test: reference: has no variance; render it"):
        z_test(a, a.rgb)
    one = rt.render("scenes/cornell-box.json", spp=1, size=(24, 24))
    with pytest.raises(OptionError, match="the variance of 576 pixels is unknown; use 2 or more samples per pixel"):
        z_test(one, a)
    with pytest.raises(OptionError, match=r"its variance has shape \(24, 24\) instead of \(24, 24, 3\)"):
        z_test(SimpleNamespace(rgb=a.rgb, var=a.var[..., 0]), a)
    with pytest.raises(ValueError, match="images of different size: 24x24 against 20x24"):
        z_test(a, SimpleNamespace(rgb=a.rgb[:, :20], var=a.var[:, :20]))
    with pytest.raises(ValueError, match="alpha: expected a number between 0 and 1, got 0"):
        z_test(a, a, alpha=0)


@pytest.mark.parametrize("kind", ["exr", "npz"])
def test_the_command_uses_the_variances_of_the_files(renders, kind, tmp_path, capsys):
    paths = [tmp_path / f"{k}.{kind}" for k in range(3)]
    for one, path in zip(renders, paths, strict=False):
        one.save(path)
    save(paths[2], renders[2].rgb * 1.02, var=renders[2].var)
    same, other = (["compare", str(paths[0]), str(path), "--z-test", "--no-flip"] for path in paths[1:])
    assert main.main(same) == 0
    assert "z_test.passed" in capsys.readouterr().out
    assert main.main([*other, "--json"]) == 5
    printed = capsys.readouterr()
    found = json.loads(printed.out)
    assert found["z_test"]["passed"] is False
    assert found["z_test"]["p"] == pytest.approx(z_test(paths[0], paths[2]).p)
    assert found["z_test"]["alpha"] == 0.01
    assert found["violations"] == printed.err.splitlines() == [z_test(paths[0], paths[2]).reason]
    assert main.main([*other, "--alpha", "1e-12"]) == 0
    assert main.main([*other[:3], "--alpha", "0.1"]) == 2


def test_the_command_says_which_file_has_no_variance(renders, tmp_path, capsys):
    renders[0].save(tmp_path / "a.exr")
    renders[1].save(tmp_path / "b.png")
    assert main.main(["compare", str(tmp_path / "a.exr"), str(tmp_path / "b.png"), "--z-test"]) == 2
    told = "b.png: has no variance; render it with raytrace to an .exr or .npz file\n"
    assert capsys.readouterr().err.endswith(told)
