"""A golden is written, read, and fails with a page; by hand, without pytest around it."""

import re

import numpy as np
import pytest

from raytrace.errors import FileError
from raytrace.golden import store
from raytrace.golden.check import Golden
from raytrace.golden.locations import GoldenLocation
from raytrace.image import files, flip
from test_golden_gates import DEFECTS, noisy, scene
from test_page import Reader


@pytest.fixture
def location(tmp_path):
    return GoldenLocation(
        tmp_path / "tests" / "golden", tmp_path, tmp_path / "left", tmp_path, "tests/test_a.py::test_a"
    )


def write(location, picture, name="box", **more):
    return Golden(location, {}, update=True).check(picture, name, **more)


def check(location, picture, name="box", **more):
    return Golden(location, {}, update=False).check(picture, name, **more)


def names_in(folder):
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def test_a_missing_golden_fails_says_how_to_write_it_and_shows_the_picture(location):
    with pytest.raises(AssertionError) as failure:
        check(location, scene())
    assert str(failure.value) == (
        "golden 'box': there is no tests/golden/box.npz: look at the image, then write it: "
        "pytest --update-goldens tests/test_a.py::test_a; see left/tests/golden/box.html"
    )
    assert names_in(location.root) == ["left/tests/golden/box.actual.npz", "left/tests/golden/box.html"]


def test_update_writes_what_then_passes(location):
    assert write(location, scene())
    assert names_in(location.root) == ["tests/golden/box.npz", "tests/golden/box.png"]
    assert (files.load(location.folder / "box.npz").rgb == scene()).all()
    assert check(location, scene())
    assert names_in(location.root) == ["tests/golden/box.npz", "tests/golden/box.png"]


def test_a_name_may_have_folders(location):
    write(location, scene(), "shapes/round/box")
    assert names_in(location.folder) == ["shapes/round/box.npz", "shapes/round/box.png"]
    with pytest.raises(AssertionError, match=r"see left/tests/golden/shapes/round/box\.html"):
        check(location, 2 * scene(), "shapes/round/box")


@pytest.mark.parametrize("name", ["", ".", "/box", "../box", "a/../../box", "a//b", "a/./b", "a/"])
def test_a_name_that_leads_elsewhere_is_refused(location, name):
    with pytest.raises(ValueError, match="expected a name like 'box'"):
        write(location, scene(), name)
    assert names_in(location.root) == []


def test_update_refuses_a_picture_that_is_not_finite(location):
    with pytest.raises(AssertionError, match="finite"):
        write(location, DEFECTS["a NaN"])
    assert names_in(location.root) == []


@pytest.mark.parametrize("name", ["a firefly", "a NaN", "blue 1 % darker"])
def test_a_failure_leaves_a_page_and_tells_its_numbers_in_one_line(location, name):
    write(location, scene())
    before = (location.folder / "box.npz").read_bytes()
    with pytest.raises(AssertionError) as failure:
        check(location, DEFECTS[name])
    line = str(failure.value)
    assert re.fullmatch(
        r"golden 'box': .+ \(ssim .+, bias .+, worst tile .+, outliers .+\); see left/.+/box\.html", line
    )
    assert "\n" not in line
    page = (location.root / "left/tests/golden/box.html").read_text("utf-8")
    assert "<code>pytest --update-goldens tests/test_a.py::test_a</code>" in page
    reader = Reader()
    reader.feed(page)
    assert reader.open == []
    assert [re.sub(" <.*", "", part, flags=re.DOTALL) for part in page.split("<figcaption>")[1:]] == [
        "expected",
        "actual",
        "difference",
        "SSIM",
        *["FLIP"] * flip.available(),
        *["expected", "actual", "difference"] * page.count("<h2>"),
    ]
    assert 1 <= page.count("<h2>") <= 2
    assert len(reader.links) == 4 + flip.available() + 3 * page.count("<h2>")
    assert all(link.startswith("data:image/png") for link in reader.links)
    assert not re.findall(r"https?://|@import|url\(", page)
    assert ("magenta" in page) == (name == "a NaN")
    np.testing.assert_array_equal(
        files.load(location.root / "left/tests/golden/box.actual.npz").rgb, np.float32(DEFECTS[name])
    )
    assert (location.folder / "box.npz").read_bytes() == before  # only --update-goldens writes a golden

    check(location, scene())
    assert names_in(location.root / "left") == []  # nothing stale beside a pass


def test_another_size_is_told(location):
    write(location, scene())
    with pytest.raises(AssertionError, match="the size is 64x47 instead of 64x48; see"):
        check(location, scene()[1:])
    page = (location.root / "left/tests/golden/box.html").read_text("utf-8")
    assert "expected" in page
    assert "SSIM" not in page


def test_limits_come_from_the_configuration_and_then_from_the_call(location):
    write(location, scene())
    brighter = 1.0015 * scene()
    with pytest.raises(AssertionError, match="relative bias of red"):
        check(location, brighter)
    assert check(location, brighter, max_bias=0.01)
    assert check(location, brighter, max_bias=None)
    assert Golden(location, {"max_bias": 0.01}, update=False).check(brighter, "box")
    with pytest.raises(AssertionError, match=r"is above 0\.001"):
        Golden(location, {"max_bias": 0.01}, update=False).check(brighter, "box", max_bias=0.001)
    with pytest.raises(ValueError, match="unknown gates min_sim; the gates are min_ssim, max_bias, "):
        check(location, brighter, min_sim=0.5)


def test_bytes_and_files_are_goldens_too(location, tmp_path):
    codes = files.srgb8(scene())
    write(location, codes)
    verdict = check(location, codes)
    assert verdict.comparison.rmse < 1e-8  # of float32
    files.save(tmp_path / "a.png", scene())
    assert check(location, tmp_path / "a.png")
    with pytest.raises(AssertionError, match="bias"):
        check(location, codes, encoding="linear")


def test_a_function_of_a_seed_is_tested_against_the_noise_of_others(location):
    seeds = []

    def draw(seed):
        seeds.append(seed)
        return noisy(seed)

    write(location, draw, pictures=32)
    assert sorted(set(seeds)) == list(range(33))
    held = store.read(location.folder / "box.npz")
    assert held.pictures == 32
    assert held.stderr.mean() == pytest.approx(0.1 * (scene() @ [0.2126, 0.7152, 0.0722]).mean() / np.sqrt(32), rel=0.1)
    seeds.clear()
    verdict = check(location, draw)
    assert seeds == [0]
    assert verdict.rejected <= 0.0025
    assert check(location, noisy(99))  # a picture that was drawn elsewhere
    with pytest.raises(AssertionError, match=r"bias .*, rejected .*, worst z .*; see"):
        check(location, lambda seed: 1.02 * noisy(seed))
    page = (location.root / "left/tests/golden/box.html").read_text("utf-8")
    assert "difference in standard deviations" in page
    with pytest.raises(AssertionError, match="ssim"):
        check(location, draw, min_ssim=0.999)  # because it is asked for


def test_a_variance_needs_two_pictures(location):
    with pytest.raises(ValueError, match="pictures: expected 2 or more"):
        write(location, noisy, pictures=1)
    assert names_in(location.root) == []


@pytest.mark.parametrize("noise", [False, True])
def test_a_picture_that_is_black_is_a_picture(location, noise):
    black = np.zeros((16, 16, 3))
    write(location, (lambda seed: black) if noise else black, **({"pictures": 4} if noise else {}))
    assert check(location, black)
    with pytest.raises(AssertionError, match="worst tile"):
        check(location, black + 0.01)


@pytest.mark.filterwarnings("error")
def test_light_that_a_file_cannot_hold_is_no_golden_and_fails_in_words(location):
    with pytest.raises(AssertionError, match="can't save an image with pixels that are not finite in float32"):
        write(location, 1e39 * scene().astype(np.float64))
    write(location, scene())
    with pytest.raises(AssertionError, match="relative bias"):
        check(location, 1e39 * scene().astype(np.float64))
    assert np.isinf(files.load(location.root / "left/tests/golden/box.actual.npz").rgb).any()


@pytest.mark.parametrize("pictures", ["four", 0, -1, 2.5, [3], None, True, 10**30, float("nan")])
def test_a_golden_of_no_number_of_pictures_is_one_line(location, pictures):
    path = files.save(location.root / "box.npz", scene(), stderr=scene()[:, :, 0], provenance={"pictures": pictures})
    with pytest.raises(FileError, match="its provenance has no valid integer 'pictures'; write it again"):
        store.read(path)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -1.0])
def test_a_golden_of_broken_numbers_is_one_line(location, wrong):
    stderr = np.abs(scene()[:, :, 0])
    stderr[2, 3] = wrong
    path = files.save(location.root / "box.npz", scene(), stderr=stderr, provenance={"pictures": 4})
    with pytest.raises(FileError, match="has invalid standard errors; write it again"):
        store.read(path)
    if not np.isfinite(wrong):
        broken = scene()
        broken[2, 3] = wrong
        path = files.save(location.root / "other.npz", broken)
        with pytest.raises(FileError, match="has pixels that are not finite; write it again"):
            store.read(path)
