"""Measure whole processes, as a shell runs them: seconds, memory, time per step, compared with Mitsuba 3."""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from harness import ROOT, begin, finish, parser, show, table

SCENE = "scenes/cornell-box.json"
GLASS = "scenes/glass-sphere.json"
SECOND, MITSUBA = "render, second time", "the same image by Mitsuba 3, llvm_ad_rgb"
WARM = f"""
import json, statistics, time
import raytrace as rt
scene = rt.load({SCENE!r})
seconds = []
for _ in range(21):
    began = time.perf_counter()
    rt.render(scene, size=(256, 256), spp=4)
    seconds.append(time.perf_counter() - began)
print(json.dumps(statistics.median(seconds[1:])))
"""
STEPS = f"""
import json, sys, time
last, steps = time.perf_counter(), {{}}
def step(name):
    global last
    now = time.perf_counter()
    steps[name], last = now - last, now
import os
os.environ["OPENBLAS_NUM_THREADS"] = "1"  # as the command line has it
import raytrace, raytrace.cli.main, raytrace.image.paths, raytrace.scene.load
step("import the command line and the scene format")
import numpy
step("import NumPy")
scene = raytrace.load({SCENE!r})
step("load the scene and its meshes")
import llvmlite.binding
step("import llvmlite.binding")
import raytrace.rendering.rendering
step("import the renderer")
from raytrace.rendering.kernels import tracing
from raytrace.scene.plan import make_plan
from raytrace.passes.camera import make_view
from raytrace.passes.sampling import make_sampler
from raytrace.rendering.wavefront import Wavefront, compile_scene
from raytrace.rendering.compiled_scenes import set_compiled
stage = compile_scene(scene, make_plan(scene), "float32")
set_compiled(scene, stage)
step("plan and trees")
from raytrace.native import link, signatures, store
store.cache_folder()
step("hash the sources: which folder of the store")
view = make_view(scene.camera, (256, 256), numpy.dtype("float32"))
front = Wavefront(stage, view, make_sampler("sobol", 0, 4), 16)
raytrace.jit.load_all(tracing(front))
step("read and link 8 kernels")
image = raytrace.render(scene, size=(256, 256), spp=4)
step("render")
image.save(sys.argv[1])
step("write the PNG")
print(json.dumps(steps))
"""
PEER = f"""
import json, math, sys
import mitsuba as mi
mi.set_variant("llvm_ad_rgb")
scene = json.load(open({SCENE!r}))
view = scene["camera"]
look = mi.ScalarTransform4f().look_at(origin=view["position"], target=view["look_at"], up=view["up"])
film = {{"type": "hdrfilm", "width": 256, "height": 256, "pixel_format": "rgb", "rfilter": {{"type": "box"}}}}
content = {{
    "type": "scene",
    "integrator": {{"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}},
    "camera": {{"type": "perspective", "fov": view["fov"], "fov_axis": "y", "to_world": look, "film": film}},
}}
rgb = lambda values: {{"type": "rgb", "value": values}}
for k, light in enumerate(scene["lights"]):
    intensity = rgb([flux / (4 * math.pi) for flux in light["flux"]])
    content[f"light{{k}}"] = {{"type": "point", "position": light["position"], "intensity": intensity}}
for k, item in enumerate(scene["objects"]):
    albedo = rgb(scene["materials"][item["material"]]["albedo"])
    content[f"mesh{{k}}"] = {{
        "type": "obj", "filename": "scenes/" + item["mesh"], "face_normals": True,
        "bsdf": {{"type": "diffuse", "reflectance": albedo}},
    }}
mi.util.write_bitmap(sys.argv[1], mi.render(mi.load_dict(content), spp=4), write_async=False)
"""


class Outcome(NamedTuple):
    """What one process took."""

    seconds: float
    cpu: float | None  # seconds of its threads: steadier on a busy machine; None where the system does not tell
    peak_mb: float | None  # most memory it held; None where the system does not tell, or it is less than this process
    output: str


def run(*words: str, cache: Path, code: int = 0) -> Outcome:
    """A process of this Python, with a kernel cache of its own."""
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    environment = os.environ | {"RAYTRACE_CACHE": str(cache), "PYTHONPATH": path}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # sources are compiled when they are installed
    began = time.perf_counter()
    with tempfile.TemporaryFile("w+") as output, open(os.devnull, "w") as errors:
        process = subprocess.Popen([sys.executable, *words], cwd=ROOT, env=environment, stdout=output, stderr=errors)
        cpu, peak = wait(process)
        seconds = time.perf_counter() - began
        if process.returncode != code:
            raise SystemExit(f"{' '.join(words)}: exit code {process.returncode}, not {code}")
        output.seek(0)
        return Outcome(seconds, cpu, peak, output.read())


def wait(process: subprocess.Popen) -> tuple[float | None, float | None]:
    """CPU seconds and peak memory of a process, at its end."""
    if not hasattr(os, "wait4"):
        process.wait()
        return None, None
    import resource

    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # a child is counted with its parent's until it starts
    unit = 1 << 20 if sys.platform == "darwin" else 1 << 10
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / unit if usage.ru_maxrss > own else None


def drawing(spp: int, folder: Path, scene: str = SCENE) -> list[str]:
    return ["-m", "raytrace", scene, "--size", "256x256", "--spp", f"{spp}", "--quiet", "-o", f"{folder}/box.png"]


def mistaken(folder: Path) -> Path:
    """A scene with a misspelt key."""
    path = folder / "mistake.json"
    path.write_text((ROOT / SCENE).read_text("utf-8").replace('"fov"', '"fow"'), "utf-8")
    return path


def processes(folder: Path) -> dict[str, list[str]]:
    """What is run again and again."""
    words = {SECOND: drawing(4, folder)}
    if find_spec("mitsuba"):
        words[MITSUBA] = ["-c", PEER, f"{folder}/peer.png"]
    else:
        show('missing: Mitsuba: pip install ".[bench]"\n')
    return words | {
        "render at 64 spp": drawing(64, folder),
        "explain": ["-m", "raytrace", "explain", SCENE],
        "a scene error": ["-m", "raytrace", str(mistaken(folder))],
        "a scene that is not there": ["-m", "raytrace", "nowhere.json"],
        "--help": ["-m", "raytrace", "--help"],
        "import raytrace": ["-c", "import raytrace"],
        "import numpy": ["-c", "import numpy"],
        "python alone": ["-c", ""],
    }


CODES = {"a scene error": 3, "a scene that is not there": 4}


def main() -> None:
    options = parser(__doc__, rounds=11)
    options.add_argument("--firsts", type=int, default=3, help="processes that begin with an empty store (%(default)s)")
    args = options.parse_args()
    found = begin()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        cache = folder / "kernels"
        repeated = processes(folder)
        outcomes: dict[str, list[Outcome]] = {}
        for scene in (SCENE, GLASS):
            firsts = [
                run(*drawing(4, folder, scene), cache=folder / f"empty{k}{Path(scene).stem}")
                for k in range(args.firsts)
            ]
            outcomes[f"render {Path(scene).stem}, empty store"] = firsts
        outcomes["warmup, empty store"] = [run("-m", "raytrace", "warmup", cache=folder / "warm")]
        outcomes |= {name: [] for name in repeated}
        steps = []
        for k in range(args.rounds + 1):
            for name, words in repeated.items():
                outcome = run(*words, cache=cache, code=CODES.get(name, 0))
                outcomes[name] += [outcome] if k else []  # the first round fills caches
            steps += [json.loads(run("-c", STEPS, f"{folder}/box.png", cache=cache).output)][: 1 if k else 0]
        warm = json.loads(run("-c", WARM, cache=cache).output)
    show(f"{SCENE}, 256 x 256, 4 spp unless it says otherwise; medians of processes:\n")
    rows = [
        [name, *(middle(column) for column in list(zip(*all_, strict=True))[:3])] for name, all_ in outcomes.items()
    ]
    rows.append(["render in a warm process", warm, None, None])
    table(["process", "seconds", "CPU seconds", "peak MB"], rows)
    if MITSUBA in outcomes:
        pairs = zip(outcomes[SECOND], outcomes[MITSUBA], strict=True)
        ratio = statistics.median(ours.seconds / theirs.seconds for ours, theirs in pairs)
        show(f"The second image takes {ratio:.2f} times as long as Mitsuba's, the median of the repetitions.\n")
    show("Where the time of the second image goes; medians of processes:\n")
    python = statistics.median(outcome.seconds for outcome in outcomes["python alone"])
    parts = {"start Python": python} | {name: statistics.median(step[name] for step in steps) for name in steps[0]}
    table(["step", "milliseconds"], [[name, 1000 * seconds] for name, seconds in parts.items()])
    names = "process", "seconds", "cpu_seconds", "peak_mb"
    finish(args, found, [dict(zip(names, row, strict=True)) for row in rows] + [parts])


def middle(values: tuple[float | None, ...]) -> float | None:
    return None if None in values else statistics.median(values)


if __name__ == "__main__":
    main()
