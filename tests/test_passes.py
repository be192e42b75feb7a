"""Long renders work in passes over the whole film: what an interrupt leaves is the whole image, with fewer samples."""

import itertools

import numpy as np
import pytest

import raytrace as rt
from raytrace.jit import PLAIN
from raytrace.records import Window
from raytrace.rendering import checkpoint, film_tiles, run, threads
from raytrace.rendering.checkpoint import Checkpoint
from raytrace.rendering.film_tiles import TILE, first_round, pieces, rounds
from raytrace.rendering.job import Job
from raytrace.rendering.progress import ProgressListener
from raytrace.rendering.run import Run
from raytrace.rendering.threads import RenderThreads
from raytrace.scene.plan import make_plan
from same_pictures import assert_same
from small_scenes import studio

SIZE = (3 * TILE + 5, 2 * TILE + 3)
SPP = 24
ITEM = 1 << 14  # samples of a work item: small, so that the film has several
ENDS = (2, 8, 16, 24)  # of passes, where the first has two samples


@pytest.fixture(scope="module")
def scene():
    return studio()


@pytest.fixture(autouse=True)
def _small_items(monkeypatch):
    monkeypatch.setattr(run, "BATCH", ITEM)


@pytest.fixture
def passes(monkeypatch):
    """The film is drawn in passes, however quick the machine is."""
    monkeypatch.setattr(run, "first_round", lambda spp, seconds: 2)


def parts_of_passes(spp=SPP, first=2):
    """How many parts there are up to the end of each pass."""
    pixels = -(-SIZE[0] * SIZE[1] // 16) * 16
    counts = [len(pieces(pixels, ITEM // (last - begin))) for begin, last in rounds(spp, first, film_tiles.LEAP)]
    return list(itertools.accumulate(counts))


def ended_at(monkeypatch, part, act):
    """Have something done before a part is drawn; the part before it is drawn but half."""
    draw, drawn = RenderThreads.draw, itertools.count()

    def drawing(workers, tile, first, last, over=lambda: False):
        k = next(drawn)
        if k == part - 1:
            last = max(first, (first + last) // 2)
        if k >= part:
            act()
            return first
        return draw(workers, tile, first, last, over)

    monkeypatch.setattr(RenderThreads, "draw", drawing)


def interrupt():
    raise KeyboardInterrupt


def job_of(scene, spp):
    settings = scene.settings._replace(size=SIZE, spp=spp)
    return Job(scene, make_plan(scene), settings, Window(0, 0, *SIZE), settings.precision, None, spp)


def keep_all(monkeypatch):
    """All parts are kept, however quick they are drawn."""
    monkeypatch.setattr(checkpoint, "SHARE", 1e9)
    monkeypatch.setattr(checkpoint, "EVERY", 0.0)


def reached(whole_parts):
    """Samples of the last pass that is complete when so many parts are drawn."""
    return max((end for end, parts in zip(ENDS, parts_of_passes(), strict=True) if parts <= whole_parts), default=0)


# The image ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("way", [{}, {"sampler": "independent"}, {"precision": "float32"}, {"crop": (7, 9, 64, 33)}])
def test_passes_change_no_bit(scene, passes, way, monkeypatch):
    ask = {"size": SIZE, "spp": SPP, **way}
    several = [rt.render(scene, threads=threads, **ask) for threads in (1, 3)]
    monkeypatch.setattr(run, "first_round", lambda spp, seconds: 0)
    for picture in several:
        assert_same(rt.render(scene, **ask), picture)


@pytest.mark.parametrize("part", range(1, parts_of_passes()[-1] + 1, 3))
def test_ctrl_c_leaves_the_whole_image_after_the_last_complete_pass(scene, passes, monkeypatch, part):
    with monkeypatch.context() as patch:
        ended_at(patch, part, interrupt)
        image = rt.render(scene, size=SIZE, spp=SPP, threads=1)
    n = reached(part - 1)
    assert (image.complete, image.provenance["samples"]) == (False, n)
    assert (image.aov["samples"] == n).all()
    assert image.stats["samples"] == n * SIZE[0] * SIZE[1]
    if n:
        alone = rt.render(scene, size=SIZE, spp=n)
        assert np.array_equal(image.rgb, alone.rgb)
        assert np.array_equal(image.stderr, alone.stderr, equal_nan=True)
        assert np.array_equal(image.var, alone.var, equal_nan=True)
        assert image.stats["estimated_error"] == alone.stats["estimated_error"]
        assert f", {n} of {SPP} spp, " in repr(image)
    else:
        assert not image.rgb.any()
        assert np.isnan(image.stderr).all()
        assert np.isnan(image.stats["estimated_error"])
        assert ", 0 of 24 spp, " in repr(image)
        assert repr(image).endswith("error unknown, incomplete>")


def test_all_that_ends_a_render_leaves_the_same(scene, passes, monkeypatch, tmp_path):
    part, said = parts_of_passes()[1] + 3, []

    class Told(ProgressListener):
        def end(self, state):
            said.append(state)

    images = []
    for act in (interrupt, None):
        with monkeypatch.context() as patch:
            over = []
            patch.setattr(Run, "_over", lambda _run, over=over: bool(over))
            ended_at(patch, part, act or (lambda over=over: over.append(True)))
            images.append(rt.render(scene, size=SIZE, spp=SPP, threads=1, progress=Told(lambda _: None)))
    keep_all(monkeypatch)
    for k in (part, 1):
        with monkeypatch.context() as patch:
            ended_at(patch, k, interrupt)
            resumed = rt.render(scene, size=SIZE, spp=SPP, threads=1, checkpoint=tmp_path / "a.checkpoint")
    images.append(resumed)
    assert [image.interrupted for image in images] == [True, False, True]
    for image in images:
        assert image.provenance["samples"] == 8
        assert np.array_equal(images[0].rgb, image.rgb)
        assert np.array_equal(images[0].stderr, image.stderr)
    words = "at 8 of 24 samples per pixel"
    assert said == [f"interrupted {words}", f"time limit reached {words}"]


def test_an_adaptive_image_that_is_interrupted_has_the_error_of_its_complete_rounds(scene, monkeypatch):
    ask = {"size": SIZE, "spp": 256, "target_error": 5e-4, "threads": 1}
    errors, search = [], run.adaptive.AdaptiveSampler.work_items

    def parts(self, at_least=0):
        found = search(self, at_least)
        errors.append(self.error)
        if len(errors) == 3:
            raise KeyboardInterrupt
        return found

    monkeypatch.setattr(run.adaptive.AdaptiveSampler, "work_items", parts)
    image = rt.render(scene, **ask)
    assert image.provenance["samples"] >= 4
    assert (image.rgb > 0).any()
    assert image.stats["estimated_error"] == errors[-1]
    assert 5e-4 < errors[-1] < errors[0]
    assert "of at most 256 spp" in repr(image)


def test_an_adaptive_image_is_interrupted_in_its_first_round(scene, monkeypatch):
    ended_at(monkeypatch, 2, interrupt)
    image = rt.render(scene, size=SIZE, target_error=1e-3, threads=1)
    assert image.provenance["samples"] == 0
    assert np.isnan(image.stats["estimated_error"])
    assert image.stats["target_reached"] is False


def test_the_repr_shows_the_samples_that_were_taken(scene):
    assert ", 3 spp, " in repr(rt.render(scene, size=(16, 16), spp=3))
    assert "error unknown>" in repr(rt.render(scene, size=(16, 16), spp=1))
    assert ", 4 of at most 4096 spp, " in repr(rt.render(scene, size=(16, 16), target_error=0.5))


@pytest.mark.parametrize("stop", [2, 9, 20, 41])
def test_passes_go_on_from_a_checkpoint_in_the_same_passes(scene, tmp_path, monkeypatch, passes, stop):
    file, ask = tmp_path / "a.checkpoint", {"size": SIZE, "spp": SPP}
    with monkeypatch.context() as patch:
        ended_at(patch, stop, interrupt)
        rt.render(scene, checkpoint=file, threads=1, **ask)
    monkeypatch.setattr(run, "first_round", lambda spp, seconds: 0)  # as another machine may find
    events, said = [], []
    rest = rt.render(scene, checkpoint=Checkpoint(file, True, said.append), progress=events.append, **ask)
    assert events[-1].total == parts_of_passes()[-1]
    assert said[0].startswith(f"{file}: resuming from ")
    assert_same(rt.render(scene, **ask), rest)


def test_the_passes_that_tests_speak_of():
    assert tuple(last for _, last in rounds(SPP, 2, film_tiles.LEAP)) == ENDS


def test_passes_before_one_that_is_kept_are_neither_kept_nor_drawn_again(scene, tmp_path, monkeypatch):
    keep_all(monkeypatch)
    monkeypatch.setattr(run, "first_round", lambda spp, seconds: 1)
    file, ask = tmp_path / "a.checkpoint", {"size": SIZE, "spp": 256}
    whole, ends = rt.render(scene, **ask), parts_of_passes(256, 1)
    assert_same(whole, rt.render(scene, checkpoint=file, threads=1, **ask))
    places = Checkpoint(file)
    places.begin(job_of(scene, 256))
    kept = [number for number in range(ends[-1]) if places.has(number)]
    places.close(True)
    assert kept == list(range(ends[0], ends[-1]))  # but for the first, which is less than a 64th of all
    again = rt.render(scene, checkpoint=file, **ask)
    assert again.stats["rays"] == {}
    assert_same(whole, again)
    reads, find = [], Checkpoint.find
    monkeypatch.setattr(Checkpoint, "find", lambda self, number: reads.append(number) or find(self, number))
    rt.render(scene, checkpoint=file, **ask)
    assert reads == list(range(ends[-2], ends[-1]))


def test_a_part_that_cannot_be_read_after_passes_that_were_left_out_is_drawn_whole(
    scene, tmp_path, monkeypatch, passes
):
    keep_all(monkeypatch)
    file, ask = tmp_path / "a.checkpoint", {"size": SIZE, "spp": SPP}
    whole = rt.render(scene, checkpoint=file, threads=1, **ask)
    find, lost = Checkpoint.find, parts_of_passes()[-1] - 2
    monkeypatch.setattr(Checkpoint, "find", lambda self, number: None if number == lost else find(self, number))
    rest = rt.render(scene, checkpoint=file, **ask)
    assert rest.stats["rays"]["camera"] < whole.stats["rays"]["camera"]
    assert_same(whole, rest)


# When -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seconds", [0.0, 1.0, film_tiles.LONG])
def test_a_short_render_is_drawn_in_one_pass(seconds):
    assert first_round(1024, seconds) == 0


@pytest.mark.parametrize("seconds", [2.1, 5.0, 60.0, 3600.0, 1e6])
@pytest.mark.parametrize("spp", [1, 7, 64, 1000, 65536])
def test_the_first_pass_of_a_long_render_is_short_and_passes_double(spp, seconds):
    first = first_round(spp, seconds)
    assert first & (first - 1) == 0
    assert first == 1 or film_tiles.FIRST <= seconds * first / spp < 2 * film_tiles.FIRST
    assert 1 <= first < max(spp, 2)


def test_a_render_that_is_expected_to_take_long_has_passes(scene, monkeypatch):
    monkeypatch.setattr(RenderThreads, "expected", lambda *_: 4.0)
    events = []
    rt.render(scene, size=SIZE, spp=32, progress=events.append)
    assert events[-1].total == parts_of_passes(32, 2)[-1]
    monkeypatch.setattr(RenderThreads, "expected", lambda *_: 1.9)
    rt.render(scene, size=SIZE, spp=32, progress=events.append)
    assert events[-1].total == len(pieces(-(-SIZE[0] * SIZE[1] // 16) * 16, ITEM // 32))


def test_nothing_is_drawn_to_see_how_long_a_small_image_takes(scene, monkeypatch):
    monkeypatch.setattr(RenderThreads, "_timed", None)
    rt.render(scene, size=SIZE, spp=64)


@pytest.mark.parametrize("spp", [1, 3, 64])
def test_no_more_samples_are_drawn_for_that_than_there_are(scene, monkeypatch, spp):
    ranges, draw = [], RenderThreads.draw

    def drawing(workers, tile, first, last, over=None):
        if over is None:
            ranges.append((first, last))
            return draw(workers, tile, first, last)
        return draw(workers, tile, first, last, over)

    monkeypatch.setattr(RenderThreads, "draw", drawing)
    monkeypatch.setattr(threads, "LEAST", 1)
    rt.render(scene, size=SIZE, spp=spp, sampler="stratified")
    assert set(ranges) == {(0, min(spp, threads.SAMPLES))}


@pytest.mark.skipif(PLAIN, reason="a million samples")
@pytest.mark.parametrize("size", [(16, 16), SIZE])
def test_what_is_drawn_to_see_how_long_it_takes_does_not_count(scene, monkeypatch, size):
    seen, expected = [], RenderThreads.expected
    monkeypatch.setattr(RenderThreads, "expected", lambda *words: seen.append(expected(*words)) or 0.0)
    spp = threads.LEAST // (size[0] * size[1]) + 1
    probed = rt.render(scene, size=size, spp=spp, threads=1)
    monkeypatch.setattr(RenderThreads, "expected", lambda *_: 0.0)
    plain = rt.render(scene, size=size, spp=spp, threads=1)
    assert seen[0] > 0
    assert probed.stats["rays"] == plain.stats["rays"]
    assert_same(plain, probed)


def test_passes_take_no_more_memory_for_samples_in_flight(scene, monkeypatch):
    fronts = []
    monkeypatch.setattr(run, "first_round", lambda spp, seconds: 1)
    rest = RenderThreads.rest
    monkeypatch.setattr(RenderThreads, "rest", lambda workers: (rest(workers), fronts.append(len(workers._wavefronts))))
    rt.render(scene, size=SIZE, spp=256, threads=2)
    assert len(fronts) == len(rounds(256, 1, film_tiles.LEAP)) > 4
    assert fronts[-1] <= 3  # of the caller's thread, and of two others; each pass has new threads
