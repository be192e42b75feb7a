"""The errors that path-traced images state: intervals, target errors, time limits, checkpoints, reports.

``tests/bench/path_calibration.py`` measures the intervals of more and larger images.
"""

from pathlib import Path

import numpy as np
import pytest

import raytrace as rt
from raytrace.image.metrics import screen
from raytrace.passes.film import LUMINANCE
from raytrace.rendering import checkpoint, run
from raytrace.rendering.threads import RenderThreads
from raytrace.reporting.configurations import Configuration, ConfiguredScene
from same_pictures import assert_same

BOX = Path(__file__).parents[1] / "scenes" / "cornell-box-area.json"
SIZE = (24, 24)
T3 = 3.182  # Student's t, 3 degrees of freedom, 97.5 %


@pytest.fixture(scope="module")
def scene():
    return rt.load(BOX)


@pytest.fixture(scope="module")
def truth(scene):
    return rt.render(scene, spp=4096, size=SIZE, seed=10**6).rgb.astype(np.float64)


@pytest.mark.parametrize("sampler", ["sobol", "independent"])
def test_intervals_hold_the_truth(scene, truth, sampler):
    """Of pixels whose samples are not all equal; and the error of the image is what it claims."""
    held, squares = [], []
    for seed in range(16):
        image = rt.render(scene, spp=64, size=SIZE, seed=seed, sampler=sampler)
        noisy = image.stderr > 0
        held.append(np.mean((np.abs((image.rgb - truth) @ LUMINANCE) <= T3 * image.stderr)[noisy]))
        squares.append([image.stats["estimated_error"] ** 2, np.mean((screen(image.rgb) - screen(truth)) ** 2)])
    stated, actual = np.mean(squares, axis=0)
    assert 0.93 < np.mean(held) < 0.97
    assert 0.9 < np.sqrt(stated / actual) < 1.15


@pytest.mark.parametrize("target", [0.03, 0.015])
def test_a_target_error_is_met_by_the_actual_error(scene, truth, target):
    images = [rt.render(scene, target_error=target, size=SIZE, seed=seed) for seed in range(4)]
    assert all(image.stats["target_reached"] for image in images)
    assert all(image.stats["estimated_error"] <= target for image in images)
    actual = np.sqrt(np.mean([(screen(image.rgb) - screen(truth)) ** 2 for image in images]))
    assert actual < 1.15 * target
    assert len(np.unique(images[0].aov["samples"])) > 1


def test_a_time_limit_leaves_the_last_complete_round(scene, monkeypatch):
    looks = iter(range(10**6))
    with monkeypatch.context() as patch:
        patch.setattr(run.Run, "_over", lambda _run: next(looks) > 10)
        image = rt.render(scene, spp=256, size=SIZE, threads=1, time_limit=1e6)
    n = image.provenance["samples"]
    assert not image.complete
    assert 0 < n < 256
    alone = rt.render(scene, spp=n, size=SIZE)
    for name in ("rgb", "stderr", "var"):
        assert np.array_equal(getattr(image, name), getattr(alone, name), equal_nan=True)


@pytest.mark.parametrize("ask", [{"spp": 32}, {"target_error": 0.04}, {"spp": 16, "crop": (3, 2, 19, 20)}])
def test_a_resumed_render_is_the_same(scene, ask, monkeypatch, tmp_path):
    monkeypatch.setattr(checkpoint, "EVERY", 0.0)
    monkeypatch.setattr(checkpoint, "SHARE", 1e9)
    monkeypatch.setattr(run, "first_round", lambda spp, seconds: 2)
    file, ask = tmp_path / "a.checkpoint", {"size": SIZE, "threads": 1, **ask}
    draw, numbers = RenderThreads.draw, iter(range(1000))

    def stop(*args):
        if next(numbers) == 2:
            raise KeyboardInterrupt
        return draw(*args)

    with monkeypatch.context() as patch:
        patch.setattr(RenderThreads, "draw", stop)
        assert not rt.render(scene, checkpoint=file, **ask).complete
    assert_same(rt.render(scene, checkpoint=file, **ask), rt.render(scene, **ask))


@pytest.mark.parametrize("tree", ["median", "none"])
def test_a_report_renders_the_same_image_with_every_tree(scene, tree):
    plain = ConfiguredScene(scene, Configuration("sobol", "float32"), SIZE).render(4, seed=3)
    assert plain.provenance["integrator"] == "path"
    assert_same(plain, ConfiguredScene(scene, Configuration("sobol", "float32", tree=tree), SIZE).render(4, seed=3))
