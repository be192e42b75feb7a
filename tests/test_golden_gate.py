"""The gate goes red for every planted defect, and stays green for rounding."""

import numpy as np
import pytest

from golden_gate import GOLDEN, check_golden, gate
from raytrace import image


def scene(shift=0.0):
    # a lit floor, a textured wall with hard edges and a dark corner; shift in pixels
    y, x = np.mgrid[0:48, 0:64] + 0.5
    x = x + shift
    wall = 0.3 + 0.15 * np.sin(0.7 * x) * np.cos(0.4 * y)
    light = np.where((x > 20) & (x < 45) & (y < 25), 0.8, wall) * np.exp(-(((x - 30) / 40) ** 2))
    return (light[:, :, None] * [1.0, 0.7, 0.4]).astype(np.float32)


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
    "another size": scene()[:-1],
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


@pytest.mark.parametrize("direction", [np.inf, -np.inf])
def test_one_unit_in_the_last_place_passes(direction):
    assert gate(np.nextafter(scene(), np.float32(direction)), scene()) == []


def test_one_late_sample_of_32_in_one_pixel_passes():
    assert gate(with_pixel(scene()[20, 30] * 31 / 32), scene()) == []


def test_a_missing_golden_fails(tmp_path):
    with pytest.raises(AssertionError, match=r"no golden .*--update-golden"):
        check_golden("absent", scene(), golden=tmp_path, failures=tmp_path / "failures")
    assert list(tmp_path.iterdir()) == []


def test_update_writes_what_then_passes(tmp_path):
    check_golden("new", scene(), update=True, golden=tmp_path, failures=tmp_path / "failures")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new.npz", "new.png"]
    assert (image.load(tmp_path / "new.npz").rgb == scene()).all()
    check_golden("new", scene(), golden=tmp_path, failures=tmp_path / "failures")
    assert not (tmp_path / "failures").exists()


def test_update_refuses_a_picture_that_is_not_finite(tmp_path):
    with pytest.raises(AssertionError, match="finite"):
        check_golden("new", with_pixel(np.nan), update=True, golden=tmp_path, failures=tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("actual", [DEFECTS["a firefly"], DEFECTS["a NaN"]], ids=["firefly", "NaN"])
def test_a_failure_leaves_pictures_and_a_report_and_names_their_folder(tmp_path, actual):
    check_golden("box", scene(), update=True, golden=tmp_path, failures=tmp_path / "failures")
    before = (tmp_path / "box.npz").read_bytes()
    with pytest.raises(AssertionError) as failure:
        check_golden("box", actual, golden=tmp_path, failures=tmp_path / "failures")
    folder = tmp_path / "failures" / "box"
    assert str(folder) in str(failure.value)
    wanted = {"actual.npz", "actual.png", "expected.npz", "expected.png", "difference.png", "report.txt"}
    assert {path.name for path in folder.iterdir()} == wanted
    assert "ssim = " in (folder / "report.txt").read_text()
    assert image.load(folder / "difference.png").rgb[20, 30].max() == 1.0
    assert (tmp_path / "box.npz").read_bytes() == before  # only --update-golden writes a golden

    check_golden("box", scene(), golden=tmp_path, failures=tmp_path / "failures")
    assert not folder.exists()  # nothing stale beside a pass


def test_another_size_is_reported_without_a_difference(tmp_path):
    check_golden("box", scene(), update=True, golden=tmp_path, failures=tmp_path / "failures")
    with pytest.raises(AssertionError, match="shape"):
        check_golden("box", scene()[1:], golden=tmp_path, failures=tmp_path / "failures")
    assert not (tmp_path / "failures" / "box" / "difference.png").exists()


def test_the_fixture_reads_the_goldens_of_the_repository(golden, request):
    assert golden.func is check_golden
    assert golden.keywords == {"update": request.config.getoption("--update-golden")}
    assert GOLDEN.name == "golden"
