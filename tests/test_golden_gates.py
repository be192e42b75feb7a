"""The gates go red for every planted defect, and stay green for rounding, or for noise where the golden knows it."""

import numpy as np
import pytest

from raytrace.golden.gates import Gates, judge
from raytrace.golden.noise import mean_of
from raytrace.golden.store import GoldenImage

NOISY = Gates(min_ssim=None, max_outliers=None)


def scene(shift=0.0):
    # a lit floor, a textured wall with hard edges and a dark corner; shift in pixels
    y, x = np.mgrid[0:48, 0:64] + 0.5
    x = x + shift
    wall = 0.3 + 0.15 * np.sin(0.7 * x) * np.cos(0.4 * y)
    light = np.where((x > 20) & (x < 45) & (y < 25), 0.8, wall) * np.exp(-(((x - 30) / 40) ** 2))
    return (light[:, :, None] * [1.0, 0.7, 0.4]).astype(np.float32)


def gate(actual, expected):
    return judge(np.asarray(actual, float), GoldenImage(np.asarray(expected, float), None, 1), Gates()).broken


def with_pixel(value):
    rgb = scene()
    rgb[20, 30] = value
    return rgb


def with_hole():
    rgb = scene()
    rgb[20:24, 30:34] = 0.0
    return rgb


def with_salt():
    rgb = scene()  # lone pixels 20 % up and down: the mean and the tiles hardly move
    rgb[5::11, 3::13] *= np.float32(1.2)
    rgb[9::11, 9::13] *= np.float32(0.8)
    return rgb


DEFECTS = {
    "5 % brighter": 1.05 * scene(),
    "0.2 % brighter": 1.002 * scene(),
    "blue 1 % darker": scene() * [1.0, 1.0, 0.99],
    "a black 4x4 hole": with_hole(),
    "a firefly": with_pixel(20.0),
    "a NaN": with_pixel(np.nan),
    "an inf": with_pixel(np.inf),
    "a half pixel shift": scene(shift=0.5),
    "salt and pepper": with_salt(),
    "upside down": scene()[::-1],
    "channels swapped": scene()[:, :, ::-1],
}


@pytest.mark.parametrize("actual", DEFECTS.values(), ids=DEFECTS.keys())
def test_a_planted_defect_turns_the_gate_red(actual):
    assert gate(actual, scene())


def only_seen_by():
    tiles = np.ones((48, 64, 1))
    tiles[8:16, 8:16], tiles[32:40, 48:56] = 1.01, 0.99
    checks = np.where(np.indices((48, 64)).sum(axis=0) % 2, 1.0, -1.0)[:, :, None]
    grey = np.full((48, 64, 3), 0.3)
    rough = np.where(np.indices((48, 64)).sum(axis=0) % 3, 0.1, 0.9)[:, :, None] * np.ones(3)
    salt = rough.copy()  # lone pixels at multiples of 3, where it is bright
    salt[6::18, 12::18] += 0.08
    salt[15::18, 3::18] -= 0.08
    return {
        "relative bias": (1.0015 * scene(), scene()),
        "worst tile": (grey * tiles, grey),
        "share of outliers": (salt, rough),
        "ssim": (grey * (1 + 0.02 * checks), grey * (1 - 0.02 * checks)),
    }


@pytest.mark.parametrize("name", ["relative bias", "worst tile", "share of outliers", "ssim"])
def test_each_gate_sees_a_defect_that_no_other_sees(name):
    lines = gate(*only_seen_by()[name])
    assert lines
    assert all(line.startswith(name) for line in lines)


@pytest.mark.parametrize("name", ["max_bias", "max_worst_tile", "max_outliers", "min_ssim"])
def test_a_gate_that_is_left_out_sees_nothing(name):
    seen = dict(zip(("max_bias", "max_worst_tile", "max_outliers", "min_ssim"), only_seen_by().values(), strict=True))
    actual, expected = (np.asarray(picture, float) for picture in seen[name])
    assert judge(actual, GoldenImage(expected, None, 1), Gates()._replace(**{name: None})).broken == ()


@pytest.mark.parametrize("direction", [np.inf, -np.inf])
def test_one_unit_in_the_last_place_passes(direction):
    assert gate(np.nextafter(scene(), np.float32(direction)), scene()) == ()


def test_one_late_sample_of_32_in_one_pixel_passes():
    assert gate(with_pixel(scene()[20, 30] * 31 / 32), scene()) == ()


def test_a_verdict_is_true_if_all_is_well_and_tells_its_numbers():
    expected = GoldenImage(scene().astype(float), None, 1)
    assert judge(expected.rgb, expected, Gates())
    verdict = judge(1.05 * expected.rgb, expected, Gates())
    assert not verdict
    assert "bias +0.05, +0.05, +0.05" in str(verdict)
    assert "rejected" not in str(verdict)


# --- noise -----------------------------------------------------------------------------------------------------------


def noisy(seed, picture=None):
    """A picture with noise of a tenth of its light, brighter where it is bright."""
    rgb = scene().astype(float) if picture is None else picture
    return rgb * (1 + 0.1 * np.random.default_rng(seed).standard_normal((48, 64, 1)))


@pytest.fixture(scope="module")
def golden():
    return GoldenImage(*mean_of(noisy, 64, np.asarray), 64)


def test_false_alarms_are_as_rare_as_alpha_says(golden):
    alarms = sum(not judge(noisy(seed), golden, NOISY) for seed in range(1000, 1400))
    assert alarms <= 10  # at 1 %, more than 10 of 400 come in 0.3 % of cases


def test_exact_gates_would_fail_for_noise(golden):
    assert gate(noisy(1000), golden.rgb)


NOISY_DEFECTS = {
    "2 % brighter": lambda seed: 1.02 * noisy(seed),
    "a tile 15 % brighter": lambda seed: (
        noisy(seed) * (1 + 0.15 * np.pad(np.ones((8, 8, 1)), ((8, 32), (16, 40), (0, 0))))
    ),
    "blue 2 % darker": lambda seed: noisy(seed) * [1.0, 1.0, 0.98],
    "a half pixel shift": lambda seed: noisy(seed, scene(shift=0.5).astype(float)),
    "twice the noise": lambda seed: 2 * noisy(seed) - scene(),
    "a black 4x4 hole": lambda seed: noisy(seed, with_hole().astype(float)),
    "a NaN": lambda seed: noisy(seed, with_pixel(np.nan).astype(float)),
    "upside down": lambda seed: noisy(seed)[::-1],
}


@pytest.mark.parametrize("name", NOISY_DEFECTS)
def test_a_defect_among_noise_turns_the_gate_red(golden, name):
    for seed in range(1000, 1005):
        assert judge(NOISY_DEFECTS[name](seed), golden, NOISY).broken, seed


def test_noise_of_a_picture_that_has_none_leaves_room_for_rounding():
    golden = GoldenImage(*mean_of(lambda seed: scene(), 8, lambda rgb: np.asarray(rgb, float)), 8)
    assert not golden.stderr.any()
    assert judge(np.nextafter(scene(), np.float32(1)).astype(float), golden, NOISY)
    assert not judge(1.003 * golden.rgb, golden, NOISY)


def test_without_alpha_the_z_test_is_left_out(golden):
    verdict = judge(noisy(1000), golden, Gates(None, None, None, None, alpha=None))
    assert verdict
    assert verdict.worst_z > 1


def noisy_golden(rgb, stderr=0.0, pictures=4):
    return GoldenImage(rgb, np.full(rgb.shape[:2], stderr), pictures)


@pytest.mark.parametrize("level", [0.0, -0.5, 1e-30])
def test_a_noisy_picture_may_be_black_or_negative(level):
    picture = np.full((16, 16, 3), level)
    with np.errstate(all="raise", under="ignore"):
        verdict = judge(picture.copy(), noisy_golden(picture), Gates(min_ssim=None, max_outliers=None))
        assert (verdict.broken, verdict.rejected, verdict.worst_z) == ((), 0.0, 0.0)
        other = picture.copy()
        other[3, 4] += 1.0
        verdict = judge(other, noisy_golden(picture), Gates(min_ssim=None, max_outliers=None))
        assert any("worst tile, at row 0, column 0" in line for line in verdict.broken)
        assert any("fail the z-test" in line for line in verdict.broken)
        assert judge(other, noisy_golden(picture), Gates(alpha=None)).worst_z > 100


def test_noise_explains_as_much_of_negative_light():
    rng = np.random.default_rng(0)
    base, off = np.full((16, 16, 3), 0.5), 0.01 * rng.standard_normal((16, 16, 1))
    for sign in (1, -1):
        golden = noisy_golden(sign * base, 0.01, 32)
        assert judge(sign * (base + off), golden, Gates(min_ssim=None, max_outliers=None))
        assert not judge(sign * (base + off + 0.1), golden, Gates(min_ssim=None, max_outliers=None))
