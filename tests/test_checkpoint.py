"""Checkpoints: the same bits however often a render is killed and goes on; torn, foreign and full files."""

import itertools
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import raytrace as rt
from raytrace.cli.delivery import deliver
from raytrace.errors import FileError
from raytrace.rendering import checkpoint, film_tiles
from raytrace.rendering.checkpoint import Checkpoint
from raytrace.rendering.journal import HEAD
from raytrace.rendering.run import Run
from same_pictures import assert_same
from signals import default_signals
from small_scenes import studio

ROOT = Path(__file__).parents[1]
BOX = ROOT / "scenes" / "cornell-box.json"
TILE = film_tiles.TILE
SIZE = (3 * TILE + 5, 2 * TILE + 3)
WAYS = {
    "uniform": {"spp": 64},
    "time limit": {"spp": 37, "time_limit": 1e6},
    "target error": {"target_error": 1e-3, "spp": 256},
    "target error and time limit": {"target_error": 2e-3, "time_limit": 1e6},
    "crop": {"spp": 64, "crop": (7, 9, 2 * TILE, TILE + 1)},
    "stratified": {"spp": 64, "sampler": "stratified"},
    "float32": {"spp": 64, "precision": "float32"},
    "path": {"spp": 16, "precision": "float32", "integrator": "path", "crop": (7, 9, 2 * TILE, TILE + 1)},
    "path, target error": {"target_error": 2e-2, "spp": 64, "precision": "float32", "integrator": "path"},
}


@pytest.fixture(scope="module")
def scene():
    return studio()


@pytest.fixture
def file(tmp_path):
    return tmp_path / "a.png.checkpoint"


@pytest.fixture(autouse=True)
def often(monkeypatch):
    monkeypatch.setattr(checkpoint, "EVERY", 0.0)
    monkeypatch.setattr(checkpoint, "SHARE", 1e9)


def stopping_after(count):
    """Progress that plays Ctrl-C once so many parts are drawn."""
    seen = 0

    def progress(event):
        nonlocal seen
        if event.stage == "rendering":
            seen += 1
            if seen >= count:
                raise KeyboardInterrupt

    return progress


# Going on -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("way", WAYS)
def test_a_picture_that_is_stopped_again_and_again_has_the_same_bits(scene, file, way):
    ask, draw = {"size": SIZE, **WAYS[way]}, random.Random(way)
    whole = rt.render(scene, **ask)
    for _ in range(50):
        picture = rt.render(
            scene, checkpoint=file, progress=stopping_after(draw.randint(1, 4)), threads=draw.randint(1, 3), **ask
        )
        if picture.complete:
            break
    assert_same(whole, picture)


def test_finished_parts_are_not_drawn_again(scene, file):
    ask = {"size": (16 * TILE, 8 * TILE), "spp": 16}  # many parts of a batch each: the second is by far not the last
    whole = rt.render(scene, **ask)
    part = rt.render(scene, checkpoint=file, progress=stopping_after(2), threads=1, **ask)
    rest = rt.render(scene, checkpoint=file, **ask)
    assert part.stats["rays"]["camera"] + rest.stats["rays"]["camera"] == whole.stats["rays"]["camera"]
    again = rt.render(scene, checkpoint=file, **ask)
    assert again.stats["rays"] == {}
    assert_same(whole, again)


def test_a_render_out_of_time_goes_on_with_or_without_a_limit(scene, file, monkeypatch):
    ask, taken = {"size": SIZE, "spp": 100}, []
    for _ in range(2):
        with monkeypatch.context() as patch:
            looks = itertools.count()
            patch.setattr(Run, "_over", lambda _run, looks=looks: next(looks) > 9)  # time is up
            picture = rt.render(scene, checkpoint=file, time_limit=1e6, threads=1, **ask)
        assert not picture.complete
        taken.append(picture.provenance["samples"])
    assert 0 < taken[0] < taken[1] < 100
    assert_same(rt.render(scene, **ask), rt.render(scene, checkpoint=file, **ask))


def test_the_file_is_removed_when_the_whole_picture_is_written_and_not_before(scene, file, tmp_path):
    ask = {"size": SIZE, "spp": 512, "checkpoint": file}  # far from done when the first part is
    part = rt.render(scene, progress=stopping_after(1), threads=1, **ask)
    part.save(tmp_path / "a.png")
    assert file.exists()
    assert part.checkpoint.kept
    whole = rt.render(scene, **ask)
    assert file.exists()
    whole.save(tmp_path / "a.png")
    assert not file.exists()
    assert not whole.checkpoint.kept


# What is in the file --------------------------------------------------------------------------------------------------


def kept_part(scene, file, **ask):
    rt.render(scene, checkpoint=file, progress=stopping_after(3), threads=1, size=SIZE, **ask)
    return file.read_bytes()


def test_a_file_cut_anywhere_or_with_a_wrong_bit_gives_the_same_picture(scene, file):
    ask, draw = {"spp": 64}, random.Random(1)
    whole = rt.render(scene, size=SIZE, **ask)
    content = kept_part(scene, file, **ask)
    title = HEAD.size + HEAD.unpack(content[: HEAD.size])[2]
    for k in range(12):
        at = draw.randrange(title, len(content))
        wrong = bytearray(content)
        wrong[at] ^= 1 << draw.randrange(8)
        file.write_bytes(content[:at] if k % 2 else wrong)
        assert_same(whole, rt.render(scene, checkpoint=file, size=SIZE, **ask))


def test_a_record_that_lies_about_its_length_is_the_end(scene, file):
    content = kept_part(scene, file, spp=64)
    file.write_bytes(content + HEAD.pack(0, 5, 1 << 62) + b"few")
    assert_same(rt.render(scene, size=SIZE, spp=64), rt.render(scene, checkpoint=file, size=SIZE, spp=64))


@pytest.mark.parametrize(
    ("other", "told"),
    [
        ({"seed": 1}, "seed 0, not 1"),
        ({"spp": 32}, "spp 64, not 32"),
        ({"size": (64, 64)}, "size"),
        ({"crop": (0, 0, 8, 8)}, "crop"),
        ({"sampler": "independent"}, "sampler sobol, not independent"),
        ({"precision": "float32"}, "precision float64, not float32"),
        ({"target_error": 0.01}, "target_error None, not 0.01"),
    ],
)
def test_another_picture_is_refused_in_one_line(scene, file, other, told):
    content = kept_part(scene, file, spp=64)
    with pytest.raises(FileError, match="belongs to another image") as refused:
        rt.render(scene, checkpoint=file, **{"spp": 64, "size": SIZE, **other})
    assert told in str(refused.value)
    assert str(file) in str(refused.value)
    assert "\n" not in str(refused.value)
    assert file.read_bytes() == content


def test_another_scene_or_version_is_refused(scene, file, monkeypatch):
    kept_part(scene, file, spp=64)
    with pytest.raises(FileError, match="another scene"):
        rt.render(BOX, checkpoint=file, size=SIZE, spp=64, precision="float64")
    monkeypatch.setattr(rt, "__version__", "9.9")
    with pytest.raises(FileError, match=r"raytrace 0\.2\.0\S*, not 9\.9"):
        rt.render(scene, checkpoint=file, size=SIZE, spp=64)


def test_an_edit_of_a_mesh_is_another_scene(file, tmp_path):
    shutil.copytree(ROOT / "scenes" / "meshes", tmp_path / "meshes")
    own = tmp_path / "box.json"
    own.write_text(BOX.read_text())
    rt.render(own, checkpoint=file, size=SIZE, spp=16, progress=stopping_after(1))
    mesh = next(path for path in sorted((tmp_path / "meshes").glob("*.obj")) if path.name in own.read_text())
    lines = mesh.read_text().splitlines()
    row = next(k for k, line in enumerate(lines) if line.startswith("v "))
    lines[row] = " ".join(["v", *(str(float(number) * 0.999 + 1e-3) for number in lines[row].split()[1:4])])
    mesh.write_text("\n".join(lines) + "\n")
    with pytest.raises(FileError, match="another scene"):
        rt.render(own, checkpoint=file, size=SIZE, spp=16)


@pytest.mark.parametrize("content", [b"", b"short", b"something else altogether" * 9])
def test_a_file_that_is_no_checkpoint_is_left_alone(scene, file, content, monkeypatch):
    monkeypatch.setattr(checkpoint, "QUIET", 0.0)
    file.write_bytes(content)
    with pytest.raises(FileError, match="not a checkpoint"):
        rt.render(scene, checkpoint=file, size=SIZE, spp=1)
    said = []
    picture = rt.render(scene, checkpoint=Checkpoint(file, False, said.append), size=SIZE, spp=1)
    assert picture.complete
    assert said == [f"{file}: not a checkpoint; delete or rename it; the render continues without a checkpoint"]
    assert file.read_bytes() == content


@pytest.mark.skipif(os.name == "nt", reason="locks of POSIX")
def test_two_renders_do_not_write_one_file(scene, file):
    ask = {"size": SIZE, "spp": 16, "checkpoint": file}

    def progress(event):
        if event.stage == "rendering":
            with pytest.raises(FileError, match="another render is using it"):
                rt.render(scene, **ask)
            raise KeyboardInterrupt

    rt.render(scene, progress=progress, **ask)
    assert rt.render(scene, **ask).complete


# Without being asked --------------------------------------------------------------------------------------------------


def test_a_short_picture_leaves_no_trace(scene, file):
    picture = rt.render(scene, checkpoint=Checkpoint(file, False), size=SIZE, spp=4)
    assert not file.exists()
    assert not picture.checkpoint.kept


def test_a_long_one_is_kept_without_being_asked_and_gives_way_to_a_new_one(scene, file, monkeypatch):
    ask, said = {"size": SIZE, "spp": 16}, []
    monkeypatch.setattr(checkpoint, "QUIET", 0.0)
    part = rt.render(
        scene, checkpoint=Checkpoint(file, False, said.append), progress=stopping_after(2), threads=1, **ask
    )
    assert part.checkpoint.kept
    assert said == []
    before, inode = file.read_bytes(), file.stat().st_ino
    monkeypatch.setattr(checkpoint, "QUIET", 1e6)
    rt.render(scene, checkpoint=Checkpoint(file, False, said.append), progress=stopping_after(1), **ask)
    assert said == [f"{file}: a checkpoint of this image exists (use --resume); starting over"]
    assert file.read_bytes() == before  # until the new one has drawn for a while
    monkeypatch.setattr(checkpoint, "QUIET", 0.0)
    rt.render(scene, checkpoint=Checkpoint(file, False, said.append), progress=stopping_after(1), threads=1, **ask)
    assert file.stat().st_ino != inode  # the same parts may be in it
    assert_same(rt.render(scene, **ask), rt.render(scene, checkpoint=file, **ask))


# Disks ----------------------------------------------------------------------------------------------------------------


def test_a_full_disk_is_told_once_and_drawing_goes_on(scene, file, monkeypatch):
    said, room = [], 150_000
    ask = {"size": SIZE, "spp": 16}
    write = os.write

    def full(fd, content):
        nonlocal room
        if room <= 0:
            raise OSError(28, "No space left on device")
        done = write(fd, content[:room])
        room -= done
        return done

    monkeypatch.setattr(os, "write", full)
    picture = rt.render(scene, checkpoint=Checkpoint(file, True, said.append), threads=1, **ask)
    monkeypatch.setattr(os, "write", write)
    assert said == [f"{file}: can't be written: No space left on device; the render continues without a checkpoint"]
    whole = rt.render(scene, **ask)
    assert_same(whole, picture)
    rest = rt.render(scene, checkpoint=Checkpoint(file, True, said.append), **ask)
    assert len(said) == 2  # what the disk still held of it, perhaps nothing
    assert re.fullmatch(rf"{re.escape(str(file))}: resuming from \d+ finished work items", said[1])
    assert_same(whole, rest)


def test_a_picture_that_cannot_be_written_goes_elsewhere(scene, tmp_path, monkeypatch):
    home, gone = tmp_path / "home", tmp_path / "gone"
    home.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "no-such-folder"))
    monkeypatch.setattr(Path, "home", lambda: home)
    picture = rt.render(scene, size=(8, 8), spp=1)
    path, failure = deliver(picture, gone / "a.npz", 0.0)
    assert path.parent.parent == home
    assert failure.startswith(f"{gone / 'a.npz'}: there is no folder {gone}")
    assert failure.endswith(f"; the image is in {path}")
    assert np.array_equal(np.load(path)["rgb"], picture.rgb)
    monkeypatch.setattr(Path, "home", lambda: gone)
    monkeypatch.setattr(Path, "cwd", lambda: gone)
    with pytest.raises(FileError, match="nor anywhere else"):
        deliver(picture, gone / "a.npz", 0.0)


# Processes ------------------------------------------------------------------------------------------------------------

PROGRAM = """
import itertools, os, sys, time
from raytrace.rendering import checkpoint, run
from raytrace.cli.main import main
from raytrace.rendering.threads import RenderThreads
checkpoint.EVERY, checkpoint.SHARE = 0.0, 1e9
run.first_round = lambda spp, seconds: 1  # the film is drawn in passes, however quick the machine is
draw, parts = RenderThreads.draw, itertools.count()
def draw_or_wait(workers, tile, first, last, over=lambda: False):
    if next(parts) >= int(os.environ.get("PARTS", 1 << 30)):
        while not over() and not os.path.exists(os.environ["GATE"]):
            time.sleep(0.01)
    return draw(workers, tile, first, last, over)
RenderThreads.draw = draw_or_wait
sys.exit(main())
"""
LONG = ["--size", "256x256", "--spp", "256"]
PARTS = 60  # of 4, 32, 64 ...: the passes with 1 and 8 samples are complete
WAITING = {
    "PARTS": str(PARTS),
    "GATE": "no-such-file",
}  # after so many parts, until a signal comes or the file is there
posix = pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")


def start(*words, then=lambda: None, env=None, **options):
    command = [sys.executable, "-c", PROGRAM, str(BOX), *LONG, *words]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    if os.name != "nt":
        options["preexec_fn"] = lambda: (default_signals(), then())
    return subprocess.Popen(command, cwd=ROOT, text=True, env=os.environ | (env or {}), **pipes | options)


def wait_for_parts(path):
    """Wait until the passes that the process may complete are on disk, but the first: it is not kept."""
    file, end = path.with_name(path.name + checkpoint.SUFFIX), time.monotonic() + 60
    while not file.exists() or file.stat().st_size < 96 * 256**2:
        assert time.monotonic() < end
        time.sleep(0.005)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "a.npz"
    process = start("-o", str(path))
    assert process.wait(timeout=120) == 0, process.stderr.read()
    process.communicate()
    return dict(np.load(path))


def assert_is(path, arrays):
    picture = np.load(path)
    assert picture["rgb"].tobytes() == arrays["rgb"].tobytes()
    assert picture["stderr"].tobytes() == arrays["stderr"].tobytes()


def finish(path, undisturbed):
    process = start("-o", str(path), "--resume")
    _, said = process.communicate(timeout=120)
    assert process.returncode == 0, said
    assert_is(path, undisturbed)
    assert [each.name for each in path.parent.iterdir()] == [path.name]  # no checkpoint, no temporary file
    return said


@pytest.mark.parametrize("attempt", range(4))
def test_kill_at_any_moment_gives_the_same_picture(undisturbed, tmp_path, attempt):
    path, draw = tmp_path / "a.npz", random.Random(attempt)
    for _ in range(3):  # some before anything is drawn, some amid a write
        process = start("-o", str(path), "--resume")
        time.sleep(draw.uniform(0.2, 1.5))
        process.kill()
        process.communicate()
    finish(path, undisturbed)


@posix
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", None)])
def test_a_signal_to_end_saves_what_is_finished_and_says_how_to_go_on(undisturbed, tmp_path, number):
    path = tmp_path / "a.npz"
    process = start("-o", str(path), "--resume", env=WAITING)
    wait_for_parts(path)
    process.send_signal(number)
    out, said = process.communicate(timeout=60)
    assert (process.returncode, out) == (130, f"{path}\n")
    assert f"interrupted at 8 of 256 samples per pixel; --resume continues from {path}.checkpoint\n" in said
    assert np.array_equal(np.load(path)["rgb"], rt.render(BOX, size=(256, 256), spp=8).rgb)
    assert " finished work items\n" in finish(path, undisturbed)


@posix
def test_the_command_line_refuses_another_picture_in_one_line(tmp_path):
    path = tmp_path / "a.npz"
    process = start("-o", str(path), "--resume", env=WAITING)
    wait_for_parts(path)
    process.kill()
    process.communicate()
    process = start("-o", str(path), "--resume", "--seed", "1")
    out, said = process.communicate(timeout=60)
    assert (process.returncode, out) == (4, "")
    assert said == f"{path}.checkpoint: belongs to another image (seed 0, not 1); delete it to start this one\n"
    assert not path.exists()


@posix
def test_ctrl_c_twice_loses_what_was_not_yet_on_disk_and_no_more(undisturbed, tmp_path):
    path = tmp_path / "a.npz"
    process = start("-o", str(path), "--resume", env=WAITING)
    wait_for_parts(path)
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)
    assert process.returncode == 130
    finish(path, undisturbed)


@posix
def test_a_closed_terminal_loses_nothing(undisturbed, tmp_path):
    import fcntl
    import termios

    path, (terminal, theirs) = tmp_path / "a.npz", os.openpty()
    process = start(
        "-o", str(path), "--resume", stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True,
        then=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0), env=WAITING,
    )  # fmt: skip
    os.close(theirs)
    wait_for_parts(path)
    os.close(terminal)  # the kernel sends SIGHUP, and nothing can be printed any more
    assert process.wait(timeout=60) in (130, 4)
    assert path.exists()
    finish(path, undisturbed)


@posix
def test_a_process_that_sleeps_for_a_while_goes_on(undisturbed, tmp_path):
    path = tmp_path / "a.npz"
    gate = tmp_path / "gate"
    process = start("-o", str(path), "--resume", "--time-limit", "1000", env=WAITING | {"GATE": str(gate)})
    wait_for_parts(path)
    process.send_signal(signal.SIGSTOP)
    time.sleep(0.5)
    gate.touch()
    process.send_signal(signal.SIGCONT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 0, said
    assert_is(path, undisturbed)


@posix
def test_a_folder_that_is_removed_midway_loses_nothing(undisturbed, tmp_path):
    folder, elsewhere = tmp_path / "gone", tmp_path / "elsewhere"
    folder.mkdir()
    elsewhere.mkdir()
    gate = tmp_path / "gate"
    process = start(
        "-o", str(folder / "a.npz"), "--resume", env=WAITING | {"TMPDIR": str(elsewhere), "GATE": str(gate)}
    )
    wait_for_parts(folder / "a.npz")
    shutil.rmtree(folder)
    gate.touch()
    out, said = process.communicate(timeout=60)
    assert process.returncode == 4
    path = Path(out.strip())
    assert path.parent.parent == elsewhere
    assert said.splitlines()[-1].endswith(f"there is no folder {folder}; create it first; the image is in {path}")
    assert_is(path, undisturbed)


@posix
def test_a_file_system_that_is_full_loses_nothing(undisturbed, tmp_path):
    import resource

    path = tmp_path / "a.npz"
    limit = 24 * 96 * TILE**2  # of a file's size: the picture fits, the checkpoint doesn't
    process = start("-o", str(path), "--resume", then=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)))
    _, said = process.communicate(timeout=60)
    assert process.returncode == 0, said
    assert f"{path}.checkpoint: can't be written: File too large; the render continues without a checkpoint\n" in said
    assert_is(path, undisturbed)
    assert [each.name for each in tmp_path.iterdir()] == ["a.npz"]


@posix
def test_a_reader_that_has_gone_loses_nothing(undisturbed, tmp_path):
    path = tmp_path / "a.npz"
    process = start("-o", str(path))
    process.stdout.close()
    process.stderr.close()
    assert process.wait(timeout=60) == 0
    assert_is(path, undisturbed)
