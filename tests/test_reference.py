"""The truth that a report draws: how accurate it is, and what is kept of it."""

import numpy as np
import pytest

from raytrace.errors import FileError, OptionError
from raytrace.image import files
from raytrace.image.metrics import compare
from raytrace.native import store
from raytrace.records import Settings
from raytrace.rendering.rendering import render
from raytrace.reporting import reference
from raytrace.reporting.reference import Reference, make_reference, next_spp, read_reference
from small_scenes import Part, look, make_scene, quad

SIZE = (12, 10)


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """A lit square that is turned against the pixels, and an empty cache of references."""
    monkeypatch.setattr(reference, "cache_folder", lambda: tmp_path)
    square = quad((-1, -0.7, 0), (0.8, -1, 0), (1, 0.8, 0), (-0.7, 1, 0))
    settings = Settings(SIZE, 1, 16, "sobol", "float32", 0)
    return make_scene([Part(square)], [((0, 0, 3), (150, 150, 150))], look((0, 0, 5), (0, 0, 0)), settings)


def draw(scene, seconds=1e9):
    return make_reference(scene, SIZE, seconds, lambda _share, _event: None)


def known(spp=512, error=1e-4, pilot=2e-4, seconds=4.0):
    return Reference(np.zeros((1, 1, 3), np.float32), error, pilot, spp, seconds, "drawn")


def test_it_is_ten_times_as_accurate_as_what_it_judges(scene):
    truth = draw(scene)
    assert truth.enough
    errors = [compare(render(scene, reference.PILOT, seed=seed), truth.rgb).rmse_srgb for seed in range(4)]
    assert truth.error <= min(errors) / 5  # a tenth of what a pair of pictures said; four others scatter by a third


def test_its_error_is_what_another_one_says(scene):
    truth = draw(scene)
    others = [render(scene, truth.spp, seed=seed, precision="float64").rgb for seed in range(77, 81)]
    actual = compare(np.mean(others, axis=0), truth.rgb).rmse_srgb  # their mean is off by half as much itself
    assert truth.error / 2 < actual < truth.error * 2


def test_it_is_drawn_once_and_then_found(scene, monkeypatch):
    truth = draw(scene)
    monkeypatch.setattr(reference, "render", None)
    again = draw(scene)
    assert again.origin == "cache"
    assert again[1:5] == truth[1:5]
    np.testing.assert_array_equal(again.rgb, truth.rgb)


def test_one_that_time_cut_short_is_made_better_when_there_is_time(scene):
    short = draw(scene, 1e-9)
    assert (short.spp, short.enough) == (2 * reference.START, False)
    better = draw(scene)
    assert better.spp > short.spp
    assert better.enough


@pytest.mark.parametrize("damage", [b"", b"not a picture"])
def test_a_broken_file_in_the_cache_is_drawn_anew(scene, tmp_path, damage):
    draw(scene, 1e-9)
    (path,) = (tmp_path / "references").iterdir()
    path.write_bytes(damage)
    assert draw(scene, 1e-9).origin == "drawn"
    assert draw(scene, 1e-9).origin == "cache"


def test_without_a_place_to_keep_it_it_is_drawn_all_the_same(scene, tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setattr(reference, "cache_folder", lambda: tmp_path / "file")
    assert draw(scene, 1e-9).origin == "drawn"


def test_it_lies_beside_the_kernels_that_drew_it():
    assert reference.cache_folder is store.cache_folder


def test_the_pictures_that_it_judges_have_other_seeds(scene, monkeypatch):
    seeds = []

    def noted(*args, **options):
        seeds.append(args[3])
        return render(*args, **options)

    monkeypatch.setattr(reference, "render", noted)
    draw(scene, 1e-9)
    assert len(set(seeds)) == 2
    assert not set(seeds) & set(range(1000))


@pytest.mark.parametrize(
    ("before", "seconds", "expected"),
    [
        (known(32), 16.0, 64),  # half of 32, times four
        (known(32), 15.0, 0),
        (known(512), 1e9, 4096),  # five times as accurate: 256 * 5^(4 / 3) = 2189
        (known(512), 40.0, 2048),
        (known(512, error=2e-5), 1e9, 0),
        (known(512, error=1.0, pilot=1e-9), 1e9, 65536),
        (known(512, error=0.0, pilot=0.0), 1e9, 0),
    ],
)
def test_how_many_samples_come_next(before, seconds, expected):
    assert next_spp(before, seconds) == expected


def test_a_file_is_the_truth_if_its_size_fits(tmp_path):
    path = files.save(tmp_path / "truth.npz", np.full((4, 6, 3), 0.5, np.float32))
    truth = read_reference(path, (6, 4))
    assert (truth.origin, truth.spp) == (str(path), 0)
    assert np.isnan(truth.error)
    with pytest.raises(OptionError, match=r"has 6x4 pixels, the film 4x6"):
        read_reference(path, (4, 6))
    with pytest.raises(FileError, match=r"nowhere\.npz"):
        read_reference(tmp_path / "nowhere.npz", (6, 4))
