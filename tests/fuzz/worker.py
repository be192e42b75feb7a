"""A process that runs commands of raytrace, one after the other, with little memory, and tells what each of them did.

``python worker.py ROOM`` reads a task from each line of stdin, and answers by a JSON object. ROOM is how many bytes its
address space may grow after everything is loaded. What is written past Python's own streams goes to stderr.
"""

import contextlib
import io
import json
import os
import resource
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
REACH = 1e4  # world units: up to where the slow way is right
sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(ROOT / "tests/fuzz")]

import textures  # noqa: E402


def status(key: str) -> int:
    """A number of bytes in ``/proc/self/status``."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(key))


def run(words: list[str]) -> dict[str, Any]:
    """Run one command; what it said, its exit code, seconds, and bytes that its memory grew by at most."""
    from raytrace.cli import main

    out, err = io.StringIO(), io.StringIO()
    Path("/proc/self/clear_refs").write_text("5")  # forget the peak of the resident set
    resident, began = status("VmRSS"), time.perf_counter()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code: Any = main.main(words)
        except SystemExit as error:  # argparse
            code = error.code
        except BaseException as error:  # noqa: BLE001  (a find)
            code = f"raised {type(error).__name__}: {error}"
    seconds, grown = time.perf_counter() - began, status("VmHWM") - resident
    return {"code": code, "out": out.getvalue(), "err": err.getvalue(), "seconds": seconds, "grown": grown}


def right(words: list[str]) -> str:
    """Draw what was drawn the slow way; "": alike, or not worth the time; else what differs."""
    import numpy as np

    import naive
    import naive_sampling
    import raytrace as rt

    if words[0] == textures.SCENE:
        return textures.right(words)
    scene = rt.load(words[0])
    path = words[words.index("-o") + 1]
    rgb = rt.image.files.load(path).rgb
    if not (np.isfinite(rgb).all() and (rgb >= 0).all()):
        return "the picture is not finite, or negative"
    places = scene.mesh.vertices, scene.lights.position, *scene.camera[:3]
    reach = max(np.abs(place).max(initial=0.0) for place in places)
    large = len(scene.mesh.faces) * len(scene.lights.position) > 300 or scene.settings.max_depth > 20
    if large or reach > REACH or np.abs(scene.camera.up).max() < 1 / REACH:
        return ""
    settings = scene.settings
    size, spp = rgb.shape[1::-1], 2
    points = naive_sampling.film_points(settings.sampler, settings.seed, spp, (0, 0, *size))
    with np.errstate(all="ignore"):
        slow = np.minimum(naive.render(scene, points, size), np.finfo(np.float32).max)
    near = np.isclose(rgb, slow, rtol=1e-3, atol=1e-6 * np.abs(slow).max()).all(axis=-1)
    return "" if near.mean() >= 0.9 else f"{(~near).sum()} of {near.size} pixels differ from the slow way"


def warm() -> None:
    """Load whatever commands need, and have it compiled."""
    import trimesh  # noqa: F401

    import naive_sampling  # noqa: F401
    import raytrace as rt

    for name in ("cornell-box-glass", "room", "glass-sphere"):
        scene = rt.load(ROOT / f"scenes/{name}.json")
        for sampler in ("sobol", "stratified", "independent"):
            rt.render(scene, spp=2, size=(8, 8), precision="float64", sampler=sampler, threads=1)
    box = rt.render(ROOT / "scenes/cornell-box.json", spp=2, size=(8, 8), precision="float64")
    rt.compare(box, box)
    with contextlib.suppress(ImportError):
        import OpenEXR  # noqa: F401
        import PIL.Image
        import PIL.ImageCms
        import PIL.JpegImagePlugin  # noqa: F401
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "wide.png")
        path.write_bytes(textures.wide_pngs()["wide2.png"])
        rt.render(textures.scene_of(path, None), threads=1)


def main() -> None:
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    warm()
    exec(sys.argv[2])
    limit = status("VmSize") + int(sys.argv[1])
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    answers.write("ready\n")
    answers.flush()
    for line in sys.stdin:
        task = json.loads(line)
        os.chdir(task["folder"])
        answer = run(task["words"])
        if task["judge"] and answer["code"] == 0:
            answer["wrong"] = right(task["words"])
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
