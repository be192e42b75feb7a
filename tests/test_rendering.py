"""``render``: the same bits whatever the threads, tiles and crop; options, cancel, time limit, statistics, memory."""

import dataclasses
import itertools
import subprocess
import sys
import threading
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

import raytrace as rt
from raytrace.image.files import srgb_encode
from raytrace.rendering import film_tiles, run
from raytrace.rendering.progress import Progress
from small_scenes import Part, glass, look, make_scene, quad, studio

ROOT = Path(__file__).parents[1]
BOX = ROOT / "scenes" / "cornell-box.json"
GLASS = ROOT / "scenes" / "cornell-box-glass.json"
SPHERE = ROOT / "scenes" / "glass-sphere.json"
SAMPLERS = ["sobol", "stratified", "independent"]
PRECISIONS = ["float32", "float64"]
TILE = film_tiles.TILE

FLOOR = quad((-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1))
WALL = quad((-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0))


@pytest.fixture(scope="module")
def box():
    return rt.load(BOX)


@pytest.fixture(scope="module")
def several():
    """Everything at once: glass, smooth normals, two lights, a tree of its own for shadows."""
    return studio()


def assert_same(picture, other):
    assert picture.rgb.tobytes() == other.rgb.tobytes()
    assert picture.stderr.tobytes() == other.stderr.tobytes()
    assert picture.aov["samples"].tobytes() == other.aov["samples"].tobytes()


# The same bits --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("sampler", SAMPLERS)
def test_threads_do_not_change_a_bit(several, sampler, precision):
    ask = {"size": (70, 45), "spp": 5, "seed": 9, "sampler": sampler, "precision": precision}
    one = rt.render(several, threads=1, **ask)
    assert_same(one, rt.render(several, threads=2, **ask))
    assert_same(one, rt.render(several, threads=3, **ask))


@pytest.mark.parametrize(("tile", "batch"), [(8, 8192), (32, 1), (32, 1000), (64, 8192), (64, 1 << 18)])
def test_tiles_and_batches_do_not_change_a_bit(several, tile, batch, monkeypatch):
    ask = {"size": (70, 45), "spp": 5, "seed": 9}
    before = rt.render(several, **ask)
    monkeypatch.setattr(film_tiles, "TILE", tile)
    monkeypatch.setattr(run, "BATCH", batch)
    assert_same(before, rt.render(several, **ask))


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("sampler", SAMPLERS)
def test_a_crop_is_that_part_of_the_picture(several, sampler, precision):
    ask = {"size": (70, 45), "spp": 4, "sampler": sampler, "precision": precision}
    whole = rt.render(several, **ask)
    for x, y, width, height in ((0, 0, 70, 45), (1, 1, 33, 17), (37, 11, 33, 34), (69, 44, 1, 1), (3, 0, 1, 45)):
        part = rt.render(several, crop=(x, y, width, height), **ask)
        here = np.s_[y : y + height, x : x + width]
        assert part.rgb.tobytes() == whole.rgb[here].tobytes()
        assert part.stderr.tobytes() == whole.stderr[here].tobytes()
        for name in ("depth", "normal", "albedo", "prim_id", "position"):
            np.testing.assert_array_equal(part.aov[name], whole.aov[name][here])
        assert part.provenance["size"] == "70x45"


@pytest.mark.filterwarnings("ignore::raytrace.errors.SceneWarning")  # of walls seen from behind
@pytest.mark.parametrize("size", [(1, 1), (33, 17), (1, 40), (40, 1), (TILE, TILE), (TILE + 1, TILE - 1)])
def test_a_film_may_have_any_size(several, size):
    picture = rt.render(several, size=size, spp=3)
    assert picture.rgb.shape == (*size[::-1], 3)
    assert picture.rgb.dtype == picture.stderr.dtype == np.float32
    assert picture.stderr.shape == size[::-1]
    assert np.isfinite(picture.rgb).all()
    assert (picture.aov["samples"] == 3).all()
    assert picture.stats["samples"] == 3 * size[0] * size[1]


def test_another_seed_gives_other_noise(box):
    ask = {"size": (64, 64), "spp": 1}
    first, again, other = (rt.render(box, seed=seed, **ask).rgb for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert abs(first.mean() / other.mean() - 1) < 0.06  # four standard errors


def test_two_renders_at_once_do_not_disturb_each_other(several):
    ask = {"size": (64, 64), "spp": 8}
    alone = rt.render(several, **ask)
    fresh = studio()  # whose trees are built by whoever comes first
    pictures = {}

    def draw(name):
        pictures[name] = rt.render(fresh, **ask)

    threads = [threading.Thread(target=draw, args=(name,)) for name in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert_same(alone, pictures[0])
    assert_same(alone, pictures[1])
    assert pictures[0].stats["rays"] == pictures[1].stats["rays"] == alone.stats["rays"]


# Progress and cancel --------------------------------------------------------------------------------------------------


def test_progress_tells_of_building_and_of_every_finished_part():
    events = []
    picture = rt.render(studio(), size=(100, 70), spp=8, progress=events.append)
    assert all(isinstance(event, Progress) for event in events)
    stages = [stage for stage, _ in itertools.groupby(event.stage for event in events if event.stage != "compiling")]
    assert stages == ["building", "rendering"]
    drawn = [event for event in events if event.stage == "rendering"]
    pieces = -(-100 * 70 // (run.BATCH // 8))
    assert {event.total for event in drawn} == {pieces}
    for earlier, later in itertools.pairwise(drawn):
        assert earlier.done < later.done
        assert earlier.rays <= later.rays
        assert earlier.seconds <= later.seconds
    assert drawn[-1].done == pieces
    assert drawn[-1].rays == sum(picture.stats["rays"].values())
    assert 0 < drawn[-1].seconds <= picture.stats["seconds"]


def test_a_scene_that_was_drawn_before_is_not_built_again(several):
    rt.render(several, size=(8, 8), spp=1)
    events = []
    rt.render(several, size=(8, 8), spp=1, progress=events.append)
    assert {event.stage for event in events} == {"rendering"}


def interrupted_after(parts, scene, **ask):
    def progress(event):
        if event.stage == "rendering" and event.done >= parts:
            raise KeyboardInterrupt

    return rt.render(scene, progress=progress, threads=2, **ask)


def test_ctrl_c_before_anything_is_drawn_gives_an_empty_picture():
    def progress(event):
        if event.stage == "building":
            raise KeyboardInterrupt

    empty = rt.render(studio(), size=(16, 16), spp=2, progress=progress)
    assert (empty.complete, empty.interrupted) == (False, True)
    assert not empty.rgb.any()
    assert not empty.aov["samples"].any()
    assert np.isnan(empty.stderr).all()
    assert np.isnan(empty.stats["estimated_error"])
    assert empty._repr_png_().startswith(b"\x89PNG")


def test_ctrl_c_ends_a_tile_of_many_samples_at_once(box):
    def interrupt(event):
        if event.stage == "rendering":
            raise KeyboardInterrupt

    size = (TILE + 2, TILE)  # the second tile is a small one
    picture = rt.render(box, spp=65536, size=size, threads=2, progress=interrupt)
    assert picture.interrupted
    assert not picture.complete
    assert picture.stats["rays"]["camera"] < 65536 * size[0] * size[1]  # the first tile stopped between two samples


def test_a_render_after_an_interrupted_one_is_whole(box):
    ask = {"size": (4 * TILE, 2 * TILE), "spp": 4}
    interrupted_after(1, box, **ask)
    assert rt.render(box, **ask).complete


def test_an_error_in_the_progress_callback_is_the_caller_s(box):
    def progress(_event):
        raise RuntimeError("the caller's own")

    with pytest.raises(RuntimeError, match="the caller's own"):
        rt.render(box, size=(64, 64), spp=1, progress=progress)


def test_no_time_at_all_gives_an_empty_picture(box):
    picture = rt.render(box, size=(64, 64), spp=4, time_limit=0.0)
    assert (picture.complete, picture.interrupted) == (False, False)
    assert not picture.rgb.any()
    assert not picture.aov["samples"].any()
    assert picture.stats["samples"] == 0


def test_a_time_limit_ends_early_with_the_whole_film_covered(box):
    rt.render(box, size=(64, 64), spp=1)  # kernels are ready
    picture = rt.render(box, size=(256, 256), spp=65536, time_limit=1.0)
    assert (picture.complete, picture.interrupted) == (False, False)
    assert picture.stats["seconds"] < 60  # all of it would take minutes; the machine may be busy
    samples = picture.aov["samples"]
    reached = picture.provenance["samples"]
    assert (samples == reached).all()
    assert 1 <= reached < 65536
    assert reached & (reached - 1) == 0  # passes double
    reference = rt.render(box, size=(256, 256), spp=reached)
    assert np.array_equal(picture.rgb, reference.rgb)


@pytest.mark.parametrize("spp", [1, 2, 7, 16])
@pytest.mark.parametrize("sampler", SAMPLERS)
def test_a_time_limit_that_is_not_reached_changes_nothing(box, sampler, spp):
    ask = {"size": (8 * TILE, 2 * TILE), "spp": spp, "sampler": sampler, "threads": 1}
    assert_same(rt.render(box, **ask), rt.render(box, time_limit=1e6, **ask))


def test_a_time_limit_changes_nothing_where_tiles_are_fewer_than_threads_keep_busy(box):
    ask = {"size": (TILE, TILE), "spp": 256, "threads": 4}
    whole = rt.render(box, **ask)
    for _ in range(4):
        assert_same(whole, rt.render(box, time_limit=1e6, **ask))


# Statistics -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("spp", [1, 3])
def test_rays_are_counted_exactly_on_whole_tiles(box, spp):
    stats = rt.render(box, size=(2 * TILE, TILE), spp=spp).stats
    samples = 2 * TILE * TILE * spp
    assert stats["samples"] == samples
    assert stats["rays"]["camera"] == samples
    assert 0 < stats["rays"]["shadow"] <= samples
    assert "refraction" not in stats["rays"]


def test_a_shadow_ray_is_counted_for_each_light_that_is_in_front():
    above, below = ((0, 2, 0), (1, 1, 1)), ((0, -2, 0), (1, 1, 1))
    camera = look((0, 5, 0.001), (0, 0, 0), fov=10)  # sees nothing but the floor
    for lights, each in (([], 0), ([above], 1), ([above, below], 1), ([above, above, above], 3)):
        picture = rt.render(make_scene([Part(FLOOR)], lights, camera), size=(TILE, TILE), spp=2)
        assert picture.stats["rays"].get("shadow", 0) == each * 2 * TILE * TILE


def test_a_pane_that_fills_the_film_costs_one_refracted_ray_a_sample():
    camera = look((0, 0, 5), (0, 0, 0), fov=20)
    scene = make_scene([glass(WALL + [0, 0, 1], 1.5), Part(WALL)], [((0, 0, 0.5), (1, 1, 1))], camera)
    stats = rt.render(scene, size=(TILE, TILE), spp=2).stats
    assert stats["rays"] == {"camera": 2 * TILE * TILE, "refraction": 2 * TILE * TILE, "shadow": 2 * TILE * TILE}


def test_seconds_are_those_of_the_passes_that_ran(box):
    stats = rt.render(box, size=(128, 128), spp=8, threads=1).stats
    assert set(stats["seconds_by_pass"]) == {"camera", "closest hit", "surface", "light", "shadow", "film"}
    assert all(seconds > 0 for seconds in stats["seconds_by_pass"].values())
    assert sum(stats["seconds_by_pass"].values()) <= stats["seconds"]
    assert rt.render(SPHERE, size=(32, 32), spp=1).stats["seconds_by_pass"]["refraction"] > 0


# Physics that holds bit for bit, or to rounding -----------------------------------------------------------------------


def test_a_path_that_met_max_depth_surfaces_is_black():
    panes = [glass(WALL + [0, 0, z], 1.5) for z in (1.0, 2.0, 3.0)]
    scene = make_scene(panes, camera=look((0, 0, 5), (0, 0, 0), 20), background=(1, 2, 3))
    for depth, colour in ((1, 0), (3, 0), (4, 1), (16, 1)):
        limited = dataclasses.replace(scene, settings=scene.settings._replace(max_depth=depth))
        picture = rt.render(limited, size=(16, 16), spp=2)
        assert np.array_equal(picture.rgb, np.broadcast_to([colour, 2 * colour, 3 * colour], (16, 16, 3)))


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("path", [BOX, GLASS, SPHERE], ids=lambda path: path.stem)
def test_twice_the_size_and_four_times_the_light_is_the_same_picture(path, precision):
    scene = rt.load(path)
    camera = scene.camera._replace(position=2 * scene.camera.position, look_at=2 * scene.camera.look_at)
    lights = scene.lights._replace(position=2 * scene.lights.position, flux=4 * scene.lights.flux)
    mesh = scene.mesh._replace(vertices=2 * scene.mesh.vertices)
    twice = dataclasses.replace(scene, camera=camera, lights=lights, mesh=mesh)
    ask = {"size": (96, 80), "spp": 4, "precision": precision}
    assert_same(rt.render(scene, **ask), rt.render(twice, **ask))


@pytest.mark.parametrize("precision", PRECISIONS)
def test_the_light_of_several_lights_adds_up(precision):
    scene = rt.load(ROOT / "scenes" / "room.json")
    scene = dataclasses.replace(scene, background=np.zeros(3))
    ask = {"size": (80, 60), "spp": 4, "precision": precision}
    together = rt.render(scene, **ask).rgb
    alone = []
    for k in range(3):
        lights = scene.lights._replace(position=scene.lights.position[k, None], flux=scene.lights.flux[k, None])
        alone.append(rt.render(dataclasses.replace(scene, lights=lights), **ask).rgb.astype(np.float64))
    # each picture is rounded to float32 once; in float32 each of the three additions to a sample rounds as well
    np.testing.assert_allclose(together, sum(alone), rtol=4e-7 if precision == "float32" else 1.3e-7)
    assert min(picture.max() for picture in alone) > 0.01


@pytest.mark.parametrize("precision", PRECISIONS)
def test_the_order_of_materials_and_objects_does_not_show(precision):
    parts = [Part(FLOOR, albedo=(0.2, 0.5, 0.8)), Part(FLOOR * 0.3 + [0.0, 0.5, 0.0], albedo=(0.9, 0.1, 0.4))]
    pictures = [
        rt.render(make_scene(order, [((0.3, 2, 0.2), (5, 6, 7))], look((0, 3, 4), (0, 0, 0))), precision=precision,
                  size=(64, 64), spp=4)
        for order in (parts, parts[::-1])
    ]  # fmt: skip
    assert_same(*pictures)


# A wanted error -------------------------------------------------------------------------------------------------------

EDGES = {"size": (3 * TILE, 2 * TILE), "target_error": 2e-3}


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_threads_tiles_and_batches_do_not_change_where_samples_go(several, sampler, monkeypatch):
    one = rt.render(several, threads=1, sampler=sampler, **EDGES)
    assert len(np.unique(one.aov["samples"])) > 3
    assert_same(one, rt.render(several, threads=3, sampler=sampler, **EDGES))
    monkeypatch.setattr(film_tiles, "TILE", 8)
    monkeypatch.setattr(run, "BATCH", 1000)
    assert_same(one, rt.render(several, threads=2, sampler=sampler, **EDGES))


def test_samples_go_to_edges_and_a_pixel_keeps_its_first_ones(several):
    picture = rt.render(several, **EDGES)
    samples = picture.aov["samples"]
    assert picture.complete
    assert picture.stats["target_reached"]
    assert picture.stats["estimated_error"] <= 2e-3
    assert (samples.min(), samples.sum()) == (4, picture.stats["samples"])
    for spp in np.unique(samples)[:3].tolist():  # the same numbers as without a target
        uniform = rt.render(several, size=EDGES["size"], spp=spp)
        assert np.array_equal(picture.rgb[samples == spp], uniform.rgb[samples == spp])
    truth = srgb_encode(np.clip(rt.render(several, size=EDGES["size"], spp=1024, seed=1).rgb, 0, 1))
    first = srgb_encode(np.clip(rt.render(several, size=EDGES["size"], spp=4).rgb, 0, 1))
    wrong = np.abs(first - truth).max(axis=2) > 0.02
    assert samples[wrong].mean() > 2 * samples[~wrong].mean()
    actual = np.sqrt(np.mean((srgb_encode(np.clip(picture.rgb, 0, 1)) - truth) ** 2))
    assert actual < 1.3 * 2e-3


def test_a_target_is_met_with_fewer_samples_than_by_all_pixels_alike(box):
    ask = {"size": (128, 128)}
    picture = rt.render(box, target_error=4e-4, **ask)
    alike = rt.render(box, spp=64, **ask)
    truth = srgb_encode(np.clip(rt.render(box, spp=1024, seed=1, **ask).rgb, 0, 1))
    far, near = (np.mean((srgb_encode(np.clip(p.rgb, 0, 1)) - truth) ** 2) for p in (alike, picture))
    assert near < far
    assert picture.stats["samples"] < alike.stats["samples"] / 3


def test_the_cap_is_kept_and_told(several):
    picture = rt.render(several, size=(48, 48), spp=24, target_error=1e-5)
    samples = picture.aov["samples"]
    assert picture.complete
    assert picture.stats["target_reached"] is False
    assert picture.stats["estimated_error"] > 1e-5
    assert samples.max() == 24
    assert picture.provenance["spp"] == 24


def test_a_target_that_anything_meets_takes_the_first_samples_only(several):
    assert (rt.render(several, size=(16, 16), target_error=0.5).aov["samples"] == 4).all()
    assert (rt.render(several, size=(16, 16), target_error=0.5, spp=3).aov["samples"] == 3).all()


def test_ctrl_c_and_time_end_the_rounds_with_what_is_there(several):
    def progress(event):
        if event.total > tiles:
            raise KeyboardInterrupt

    tiles = 3 * 2
    part = rt.render(several, progress=progress, size=EDGES["size"], target_error=2e-4)
    assert (part.complete, part.interrupted) == (False, True)
    assert part.aov["samples"].min() == 4
    late = rt.render(several, size=EDGES["size"], target_error=1e-6, time_limit=0.3)
    assert not late.complete
    assert late.stats["target_reached"] is False


# Memory ---------------------------------------------------------------------------------------------------------------


def test_memory_does_not_grow_with_samples(box):
    def peak(spp):
        tracemalloc.start()
        rt.render(box, size=(256, 256), spp=spp, threads=2)
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    peak(8)  # whatever is kept from the first render on
    few, many = peak(8), peak(64)
    assert many < 1.1 * few
    assert many < 256 * 256 * 64 * 12 / 2  # the radiance of all samples alone would be 50 MB


# How far one has to read ----------------------------------------------------------------------------------------------

FEW_MODULES = 13  # outside the packages of the algorithm


MODULES_RUN = """
import sys, threading
from pathlib import Path
import raytrace as rt

seen = set()
note = lambda frame, event, _: seen.add(frame.f_code.co_filename) if event == "call" else None
threading.setprofile(note)  # before the first render, whose threads wait for the next

def modules_run_by(call):
    package = Path(rt.__file__).parent
    seen.clear()
    sys.setprofile(note)
    call()
    sys.setprofile(None)
    inside = {Path(name).relative_to(package) for name in seen if Path(name).is_relative_to(package)}
    return sorted(str(path) for path in inside if path.parts[0] not in ("accel", "passes", "scene"))

scene = rt.load(sys.argv[1])
rt.render(scene)  # kernels are ready
print(*modules_run_by(lambda: rt.render(scene)))
fresh = rt.load(sys.argv[1])
print(*modules_run_by(lambda: rt.render(fresh)))
"""


@pytest.mark.parametrize("path", [BOX, GLASS], ids=lambda path: path.stem)
def test_a_render_runs_few_modules(path):
    command = [sys.executable, "-c", MODULES_RUN, str(path)]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    again, first = map(str.split, said.splitlines())
    assert 0 < len(again) <= FEW_MODULES, again
    assert 0 < len(first) <= FEW_MODULES, first
