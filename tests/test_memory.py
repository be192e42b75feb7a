"""What memory there is, what is foretold, and that too much is refused before it is taken."""

import gc
import gzip
import json
import subprocess
import sys
import tracemalloc
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import raytrace as rt
from raytrace import memory
from raytrace.cli import main
from raytrace.errors import FileError, OptionError
from raytrace.jit import PLAIN
from raytrace.memory import Allowance, RenderSize, Trees, check_render, free, resident
from raytrace.scene import assemble
from scene_files import scene, triangle_glb, write

ROOT = Path(__file__).parents[1]
linux = pytest.mark.skipif(sys.platform != "linux", reason="looks at /proc")
BOX = ROOT / "scenes/cornell-box.json"


# what there is --------------------------------------------------------------------------------------------------------


def test_it_agrees_with_psutil():
    psutil = pytest.importorskip("psutil")
    assert resident() == pytest.approx(psutil.Process().memory_info().rss, rel=0.1)
    assert 0 < free() <= 1.1 * psutil.virtual_memory().available


def test_where_proc_is_not_psutil_is_asked(monkeypatch, tmp_path):
    pytest.importorskip("psutil")
    there = resident(), free()
    monkeypatch.setattr(memory, "PROC", tmp_path)
    assert resident() == pytest.approx(there[0], rel=0.1)
    assert free() > 0
    monkeypatch.setitem(sys.modules, "psutil", None)
    assert resident() == 0
    assert free() == float("inf")


def group(folder: Path, names: tuple[str, str], limit: object, usage: int, inactive: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / names[0]).write_text(f"{limit}\n")
    (folder / names[1]).write_text(f"{usage}\n")
    (folder / "memory.stat").write_text(f"anon 5\n{inactive}\nfile 7\n")


@linux
def test_a_container_of_version_2_counts_and_all_that_it_is_in(monkeypatch, tmp_path):
    proc, groups, names = tmp_path / "proc", tmp_path / "groups", ("memory.max", "memory.current")
    (proc / "self").mkdir(parents=True)
    (proc / "meminfo").write_text("MemTotal: 99999999 kB\nMemAvailable: 1000000 kB\n")
    (proc / "self/cgroup").write_text("0::/user/job\n")
    monkeypatch.setattr(memory, "PROC", proc)
    monkeypatch.setattr(memory, "CGROUPS", groups)
    assert free() == 1_024_000_000
    group(groups / "user/job", names, 5_000_000, 2_000_000, "inactive_file 500000")
    assert free() == 3_500_000
    group(groups / "user", names, "max", 9_000_000, "inactive_file 0")
    assert free() == 3_500_000
    group(groups, names, 3_000_000, 2_500_000, "inactive_file 0")
    assert free() == 500_000
    group(groups, names, 3_000_000, 4_000_000, "inactive_file 0")
    assert free() == 0


@linux
def test_a_container_of_version_1_counts(monkeypatch, tmp_path):
    proc, names = tmp_path / "proc", ("memory.limit_in_bytes", "memory.usage_in_bytes")
    (proc / "self").mkdir(parents=True)
    (proc / "meminfo").write_text("MemAvailable: 1000000 kB\n")
    (proc / "self/cgroup").write_text("9:name=systemd:/x\n4:cpu,memory:/job\n0::/\n")
    monkeypatch.setattr(memory, "PROC", proc)
    monkeypatch.setattr(memory, "CGROUPS", tmp_path / "groups")
    group(tmp_path / "groups/memory/job", names, 700_000, 100_000, "total_inactive_file 1")
    assert free() == 600_001


@linux
def test_a_limit_of_the_address_space_counts():
    resource = pytest.importorskip("resource")
    program = "import resource; from raytrace.memory import free; a = free();"
    program += "resource.setrlimit(resource.RLIMIT_AS, (2**30, 2**30)); print(a > 2**30, 2**28 < free() < 2**30)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.split()[1] == "True"
    assert resource.getrlimit(resource.RLIMIT_AS) == (resource.RLIM_INFINITY,) * 2  # of this process


# what is refused ------------------------------------------------------------------------------------------------------


@pytest.fixture
def nothing_taken(monkeypatch):
    """Count from nothing, so that what the tests before left does not matter."""
    monkeypatch.setattr(memory, "resident", lambda: 0)


counted = pytest.mark.usefixtures("nothing_taken")


@counted
def test_words_for_what_lacks_say_how_much_and_the_cure():
    assert Allowance(2**62).lacks(2**40, "") == ""
    told = Allowance(2**31).lacks(2**33, "use less")
    assert "takes about 8.0 GiB of memory, 2.0 GiB are allowed; use less, or allow more by --max-memory" in told
    assert " are free; " in Allowance().lacks(2**60, "x")
    assert Allowance(0).left == 0
    full = (
        "takes about 1 MiB of memory, and the process has already reached its memory limit; allow more by --max-memory"
    )
    assert full in Allowance(0).lacks(2**20, "use less")


@counted
@pytest.mark.parametrize(
    ("drawing", "trees", "cure"),
    [
        (RenderSize(2**28, False, False, 4, 2**15), Trees(36, 1, 4, False, True), "a smaller film by --size"),
        (
            RenderSize(2**10, False, False, 4, 2**15),
            Trees(2**27, 1, 8, False, True),
            "simplify the meshes",
        ),
        (RenderSize(2**10, False, False, 4, 2**26), Trees(2**10, 1, 8, True, True), "fewer --threads"),
    ],
)
def test_what_takes_most_is_what_to_lower(drawing, trees, cure):
    with pytest.raises(OptionError, match=cure):
        check_render(drawing, trees, 2**30)
    check_render(drawing, trees, 2**50)


@counted
def test_a_film_is_refused_before_it_is_made(monkeypatch):
    loaded = rt.load(BOX)
    monkeypatch.setattr("raytrace.rendering.rendering.Run", None)
    with pytest.raises(OptionError, match=r"^memory: the image, with .* for 268,435,456 pixels, .*--size"):
        rt.render(loaded, size=(16384, 16384), max_memory=2**32)
    monkeypatch.setattr(memory, "free", lambda: 2.0**20)
    with pytest.raises(OptionError, match="are free"):
        rt.render(loaded, size=(16, 16))


def test_what_was_built_is_not_counted_again():
    triangles = rt.load(BOX)
    ask = {"spp": 1, "size": (16, 16), "precision": "float32"}
    from raytrace.rendering.compiled_scene import trees_of
    from raytrace.scene.plan import make_plan

    plan = make_plan(triangles)
    assert trees_of(triangles, plan, "float32") == Trees(34, 1, 4, False, True)
    rt.render(triangles, **ask)
    assert trees_of(triangles, plan, "float32").triangles == 0
    assert trees_of(triangles, plan, "float64") == Trees(34, 1, 8, False, True)


def test_trees_for_lights_on_surfaces_are_refused_one_by_one(monkeypatch):
    content = json.loads(BOX.read_text("utf-8"))
    content["objects"] = [entry | {"mesh": BOX.parent / entry["mesh"]} for entry in content["objects"]]
    content["lights"] += [{"type": "point", "position": [x, 0, 0.9], "flux": [1, 1, 1]} for x in (-0.5, 0.5)]
    asked = []
    monkeypatch.setattr("raytrace.rendering.compiled_scene.check_tree", lambda *args: asked.append(args))
    rt.render(content, spp=1, size=(8, 8), precision="float64")
    assert asked == [(34, 8)] * 2
    monkeypatch.undo()
    monkeypatch.setattr(memory, "free", lambda: 1000.0)
    with pytest.raises(
        OptionError, match=r"^memory: one more tree, .* are free; move lights off the surfaces that they"
    ):
        memory.check_tree(34, 8)


@counted
@pytest.mark.parametrize("name", ["large.obj", "large.ply", "large.stl", "large.glb", "large.obj.gz"])
def test_a_mesh_file_is_refused_before_it_is_read(tmp_path, monkeypatch, name):
    path = write(tmp_path, scene(objects=[{"mesh": name, "material": "white"}]))
    data = b"x" * 2_000_000
    (tmp_path / name).write_bytes(gzip.compress(data) if name.endswith("gz") else data)
    monkeypatch.setattr("raytrace.scene.meshes.reading.READERS", {})
    with pytest.raises(FileError, match=r"objects\[0\]\.mesh: .*/large.* takes about .* MiB are allowed; split it or"):
        rt.load(path, max_memory=2**20)


@counted
def test_words_of_a_text_count(tmp_path):
    path = write(tmp_path, scene(objects=[{"mesh": "words.obj", "material": "white"}]))
    (tmp_path / "words.obj").write_bytes(b"v 0 0 0\n" * 100_000)
    with pytest.raises(FileError, match="takes about 35 MiB"):
        rt.load(path, max_memory=2**23)


@counted
def test_objects_are_refused_before_they_are_placed(tmp_path, monkeypatch):
    path = write(tmp_path, scene(objects=[{"mesh": "cube.obj", "material": "white"}] * 200))
    placed = []
    real = assemble.place
    monkeypatch.setattr(assemble, "place", lambda *args: placed.append(1) or real(*args))
    monkeypatch.setattr(assemble, "MAX_TRIANGLES", 1000)
    with pytest.raises(
        FileError, match=r"objects\[83\]\.mesh: with this object there are 1,008 triangles; at most 1,000"
    ):
        rt.load(path)
    assert len(placed) == 83
    monkeypatch.setattr(assemble, "MAX_TRIANGLES", 10**9)
    with pytest.raises(FileError, match=r"the scene, of \d+ triangles with this object, takes about 0 MiB"):
        rt.load(path, max_memory=50_000)


@counted
def test_nodes_of_a_glb_place_only_what_there_is_memory_for(tmp_path):
    nodes = [{"children": list(range(1, 1000))}] + [{"mesh": 0}] * 999
    (tmp_path / "many.glb").write_bytes(triangle_glb(nodes))
    path = write(tmp_path, scene(objects=[{"mesh": "many.glb", "material": "white"}]))
    assert len(rt.load(path).mesh.faces) == 999
    small = len((tmp_path / "many.glb").read_bytes()) * 6 + 100_000
    with pytest.raises((FileError, rt.SceneError), match=r"its nodes place more than \d+ triangles|takes about"):
        rt.load(path, max_memory=small)


@counted
def test_the_command_line_takes_sizes(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main.main([str(BOX), "--max-memory", "4G", "--size", "8000x8000"]) == 2
    told = capsys.readouterr().err
    assert told.startswith("memory: the image, with 11.3 GiB for 64,000,000 pixels")
    assert told.count("\n") == 1
    assert main.main([str(BOX), "--max-memory", "64G", "--size", "8x8", "--spp", "1", "--quiet"]) == 0
    for text in ("-1", "0", "x", "1Q", "nan", "inf", ""):
        with pytest.raises(SystemExit):
            main.main([str(BOX), f"--max-memory={text}"])
    assert list(tmp_path.iterdir()) == [tmp_path / "cornell-box.png"]


# what is foretold -----------------------------------------------------------------------------------------------------


def test_from_four_on_the_number_of_samples_does_not_count(monkeypatch):
    asked = []

    def ask(drawing, *_):
        asked.append(drawing)
        raise KeyError

    monkeypatch.setattr("raytrace.rendering.rendering.check_render", ask)
    for spp in (1, 3, 4, 16, 65536):
        with pytest.raises(KeyError):
            rt.render(BOX, spp=spp, size=(512, 512))
    assert asked[2] == asked[3] == asked[4] == asked[0]._replace(bins=4) == asked[1]._replace(bins=4)


def test_a_small_picture_takes_little_for_any_number_of_threads():
    rt.render(BOX, spp=1, size=(16, 16), threads=4096, max_memory=memory.resident() + 2**27)


def test_a_picture_keeps_its_pixels_and_not_the_film():
    rt.render(BOX, spp=4, size=(16, 16))
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        image = rt.render(BOX, spp=4, size=(400, 300), aov=["samples"])
        gc.collect()
        kept = (tracemalloc.get_traced_memory()[0] - before) / (400 * 300)
    finally:
        tracemalloc.stop()
    assert 32 <= kept < 42  # bytes per pixel: colour and variance, error, number of samples; the film has 100 more
    assert image.aov["depth"].shape == (300, 400)


@linux
@pytest.mark.skipif(PLAIN, reason="kernels are plain functions")
@pytest.mark.parametrize("what", ["film", "triangles"])
def test_the_peak_is_as_foretold(what, tmp_path, monkeypatch):
    """Within a quarter; ``tests/bench/memory.py`` does it for larger films and meshes."""
    for folder in ("tests/bench", "scenes/meshes"):
        monkeypatch.syspath_prepend(ROOT / folder)
    bench, meshes = import_module("memory"), import_module("make")
    if what == "film":
        found = bench.run("scenes/cornell-box.json", {"size": (1500, 1500), "spp": 4}, tmp_path / "a.png")
    else:
        mesh = bench.bumpy(400_000)
        (tmp_path / "a.ply").write_bytes(meshes.ply(np.asarray(mesh.vertices, float), mesh.faces, None))
        found = bench.run(bench.scene_of(tmp_path / "a.ply", "flat"), {"size": (64, 64), "spp": 1}, tmp_path / "a.png")
    foretold, measured = found["draw"]
    assert 0.75 * measured < foretold < 1.25 * measured + memory.FIXED, json.dumps(found)
