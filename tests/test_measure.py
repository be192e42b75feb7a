"""Rounds, budget and bookkeeping of a sweep; never its clock."""

import itertools

import numpy as np
import pytest

from raytrace.image.metrics import compare
from raytrace.records import Settings
from raytrace.rendering.rendering import render
from raytrace.reporting import configurations, measure
from raytrace.reporting.configurations import Configuration, ConfiguredScene, renders_of, steps_of
from raytrace.reporting.measure import Sweep
from raytrace.reporting.reference import Reference
from small_scenes import Part, look, make_scene, quad

SIZE = (12, 10)
ADAPTIVE = Configuration("sobol", "float32", adaptive=True)
SOBOL, DOUBLE, MEDIAN = (
    Configuration("sobol", "float32"),
    Configuration("sobol", "float64"),
    Configuration("sobol", "float32", tree="median"),
)


@pytest.fixture
def scene():
    square = quad((-1, -0.7, 0), (0.8, -1, 0), (1, 0.8, 0), (-0.7, 1, 0))
    settings = Settings(SIZE, 1, 16, "sobol", "float32", 4)
    return make_scene([Part(square)], [((0, 0, 3), (150, 150, 150))], look((0, 0, 5), (0, 0, 0)), settings)


def truth(scene, error=1e-9):
    return Reference(render(scene, 1024, SIZE, 99, "float64").rgb, error, 1e-3, 1024, 0.0, "drawn")


def sweep(scene, ways=(SOBOL,), seconds=1e9, reference=None):
    return Sweep(scene, SIZE, reference or truth(scene), seconds, lambda _share, _rays: None).run(list(ways))


def test_every_point_is_measured_in_every_round(scene):
    found = sweep(scene, [SOBOL, MEDIAN])
    assert [(p.configuration, p.step) for p in found.points] == [
        (way, n) for way in (SOBOL, MEDIAN) for n in steps_of(way)
    ]
    assert all(len(p.times) == len(p.squares) == renders_of(p.configuration, p.step) for p in found.points)
    assert all(p.spp == p.step for p in found.points)
    assert found.left_out == ()
    assert not found.interrupted


def test_rounds_go_over_all_points_and_have_seeds_of_their_own(scene, monkeypatch):
    drawn = []
    draw = ConfiguredScene.render

    def noted(self, step, seed):
        drawn.append((self.configuration, step, seed))
        return draw(self, step, seed)

    monkeypatch.setattr(ConfiguredScene, "render", noted)
    sweep(scene, [SOBOL, MEDIAN])
    rounds = [[call for call in drawn if call[2] == 4 + number] for number in range(8)]  # the scene's seed is 4
    for number, calls in enumerate(rounds[1:], 1):
        steps = [(way, n) for way, n, _ in calls]
        assert sorted(steps) == sorted(
            (w, n) for w in (SOBOL, MEDIAN) for n in steps_of(w) if number < renders_of(w, n)
        )
    later = [seed for *_, seed in drawn if seed != 4]
    assert later == sorted(later)
    same = [i for i, (_, step, _) in enumerate(rounds[1]) if step == 16]
    assert [rounds[1][i][0] for i in same] == [SOBOL, MEDIAN]
    assert same[1] == same[0] + 1  # what is compared is measured one after the other


def test_errors_are_those_of_the_pictures(scene):
    reference = truth(scene)
    (point,) = (p for p in sweep(scene, reference=reference).points if p.step == 4)
    each = [compare(render(scene, 4, SIZE, 4 + k, "float32", "sobol"), reference.rgb) for k in range(8)]
    assert point.squares == pytest.approx([e.rmse_srgb**2 for e in each])
    assert point.rmse == pytest.approx(np.sqrt(np.mean([e.rmse**2 for e in each])))
    assert point.rmse_srgb == pytest.approx(np.sqrt(np.mean([e.rmse_srgb**2 for e in each])))
    assert point.relative_mse == each[0].relative_mse
    assert point.bias == each[0].bias
    assert point.worst_tile == each[0].worst_tile
    assert point.ssim == each[0].ssim


def test_two_sweeps_differ_in_their_clocks_alone(scene):
    def without_clock(found):
        return [p._replace(times=(), peak_bytes=0) for p in found.points], found.gaps, [s.name for s in found.shown]

    reference = truth(scene)
    assert without_clock(sweep(scene, [SOBOL, DOUBLE], reference=reference)) == without_clock(
        sweep(scene, [SOBOL, DOUBLE], reference=reference)
    )


def test_rays_of_all_kinds_are_counted(scene):
    (point,) = (p for p in sweep(scene).points if p.step == 4)
    assert point.rays == sum(render(scene, 4, SIZE, 4, "float32", "sobol").stats["rays"].values())


def test_memory_is_that_of_the_film_and_the_threads(scene):
    for point in sweep(scene, [SOBOL, DOUBLE]).points:
        assert SIZE[0] * SIZE[1] * 3 * 4 < point.peak_bytes < 100e6


def test_without_time_nothing_is_measured_and_all_is_named(scene):
    found = sweep(scene, [SOBOL, MEDIAN], seconds=-1.0)
    assert found.points == ()
    assert [what for what, _ in found.left_out] == [
        "sobol, float32: 1 spp, 2 spp, 4 spp, 8 spp, 16 spp, 32 spp, 64 spp, 128 spp, 256 spp",
        "sobol, float32, median split: 4 spp, 16 spp, 64 spp",
    ]
    assert all("budget" in why for _, why in found.left_out)


def test_what_would_not_be_done_in_time_is_not_begun(scene, monkeypatch):
    """With a clock by which every sample takes a second, and comparisons take no time."""
    now = [0.0]
    draw = ConfiguredScene.render

    def slow(self, step, seed):
        now[0] += step
        return draw(self, step, seed)

    monkeypatch.setattr(ConfiguredScene, "render", slow)
    monkeypatch.setattr(measure.time, "perf_counter", lambda: now[0])
    reference = truth(scene)
    now[0] = 0.0
    # two first pictures of 8 spp, then 8 (1 + 2 + 4 + 8) + 6 x 16 = 216: there is no time for 6 x 32 more
    found = Sweep(scene, SIZE, reference, 300.0, lambda _share, _rays: None).run([SOBOL])
    assert [p.step for p in found.points] == [1, 2, 4, 8, 16]
    assert [what for what, _ in found.left_out] == ["sobol, float32: 32 spp, 64 spp, 128 spp, 256 spp"]


def test_what_a_reference_cannot_judge_is_left_out_by_name(scene):
    reference = truth(scene)
    errors = {p.step: p.rmse_srgb for p in sweep(scene, reference=reference).points}
    found = sweep(scene, reference=reference._replace(error=errors[16] / 2.5))
    assert max(p.step for p in found.points) <= 8
    (what, why), = found.left_out  # fmt: skip
    assert what.endswith("16 spp, 32 spp, 64 spp, 128 spp, 256 spp")
    assert "too close to that of the reference" in why


def test_an_interrupt_keeps_what_was_measured(scene, monkeypatch):
    calls = itertools.count()
    draw = ConfiguredScene.render

    def interrupted(self, step, seed):
        if next(calls) == 2 + 4:  # after two first pictures and four points
            raise KeyboardInterrupt
        return draw(self, step, seed)

    monkeypatch.setattr(ConfiguredScene, "render", interrupted)
    found = sweep(scene)
    assert found.interrupted
    assert [p.step for p in found.points] == [1, 2, 4, 8]


def test_both_precisions_are_compared_where_they_drew_the_same_samples(scene):
    found = sweep(scene, [SOBOL, DOUBLE, MEDIAN])
    assert list(found.gaps) == list(steps_of(SOBOL))
    assert (found.floor.spp, found.floor.renders) == (256, 6)
    assert found.floor.rmse_srgb < found.floor.high < 1e-5
    single, double = (render(scene, 16, SIZE, 4, precision, "sobol").rgb for precision in ("float32", "float64"))
    assert found.gaps[16] == pytest.approx(compare(single, double).rmse_srgb, abs=1e-12)


def test_a_few_pictures_are_kept_to_be_looked_at(scene):
    found = sweep(scene, [SOBOL, MEDIAN])
    names = [f"sobol, float32, {n} spp" for n in (1, 16, 256)]
    assert sorted(s.name for s in found.shown) == sorted([*names, "sobol, float32, median split, 16 spp"])
    assert {s.rgb8.shape for s in found.shown} == {(10, 12, 3)}
    worst = {s.name: s.error.max() for s in found.shown}
    assert worst[names[0]] > worst[names[2]] > 0


def test_of_errors_that_one_picture_meets_the_smallest_counts(scene, monkeypatch):
    monkeypatch.setattr(configurations, "TARGETS", (0.5, 0.4, 0.01))  # four samples a pixel meet the first two
    found = sweep(scene, [ADAPTIVE])
    assert [p.step for p in found.points] == [0.4, 0.01]
    assert [s.name.rsplit(" ", 1)[1] for s in found.shown] == ["0.4", "0.01"]
    assert found.points[1].spp > found.points[0].spp == 4


def test_progress_never_goes_back_and_ends(scene):
    told = []
    track = Sweep(scene, SIZE, truth(scene), 1e9, lambda share, rays: told.append((share, rays)))
    track.run([SOBOL, MEDIAN, ADAPTIVE])
    assert told == sorted(told)
    assert told[-1][0] == 1.0
    assert told[-1][1] > 0
