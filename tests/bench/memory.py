"""Peak memory against what is foretold: ``PYTHONPATH=. python tests/bench/memory.py``; a process for each case.

Both are counted from what the process takes when its kernels are loaded. What is foretold is the least ``max_memory``
that would not be refused.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from growth import bumpy
from harness import begin, finish, parser, show, table

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "scenes/meshes"))
PROGRAM = r"""
import json, sys
from pathlib import Path
import raytrace as rt
from raytrace import memory

def status(key):
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(key))

class Watched(memory.Allowance):  # notes what is foretold
    foretold = 0
    def __init__(self, max_memory=None):
        super().__init__(max_memory)
        self.resident, self.first = status("VmRSS"), self.left
    def lacks(self, needed, cure):
        Watched.foretold = max(Watched.foretold, self.resident + needed + self.first - self.left)
        return super().lacks(needed, cure)

def step(name, call):
    Watched.foretold = 0
    Path("/proc/self/clear_refs").write_text("5")
    made = call()
    found[name] = [Watched.foretold - base, status("VmHWM") - base]
    return made

scene, options, picture = json.loads(sys.argv[1])
if not isinstance(scene, str):
    scene["objects"] = [entry | {"mesh": Path(entry["mesh"])} for entry in scene["objects"]]
for name in ("cornell-box", "room"):
    rt.render(f"scenes/{name}.json", **options | {"size": (64, 64), "spp": 2}).save(picture)
from raytrace.rendering import rendering  # noqa
from raytrace.scene import assemble, meshes
memory.Allowance = assemble.Allowance = meshes.Allowance = Watched
base, found = status("VmRSS"), {}
loaded = step("load", lambda: rt.load(scene))
image = step("draw", lambda: rt.render(loaded, **options))
step("save", lambda: image.save(picture))
print(json.dumps(found))
"""


def scene_of(mesh: Path, normals: str) -> dict[str, Any]:
    return {
        "camera": {"position": [0, 0, 3], "look_at": [0, 0, 0], "fov": 40},
        "lights": [{"type": "point", "position": [3, 3, 3], "flux": [100, 100, 100]}],
        "materials": {"white": {"type": "diffuse", "albedo": [1, 1, 1]}},
        "objects": [{"mesh": str(mesh), "material": "white", "normals": normals}],
    }


def run(scene: Any, options: dict[str, Any], picture: Path) -> dict[str, list[int]]:
    words = [sys.executable, "-c", PROGRAM, json.dumps([scene, options, str(picture)])]
    done = subprocess.run(words, capture_output=True, text=True, cwd=ROOT, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr[-2000:])
    return json.loads(done.stdout)


def main() -> None:
    options = parser(__doc__ or "")
    options.add_argument("--side", type=int, default=4096, help="of the film (%(default)s)")
    options.add_argument("--triangles", type=int, default=10_000_000, help="(%(default)s)")
    args = options.parse_args()
    report, rows, found = begin(), [], {}

    def add(name: str, *task: Any) -> None:
        for step, (foretold, measured) in run(*task).items():
            if measured > 2**26 or foretold > 2**26:  # of less, what the allocator keeps is most
                ratio = None if foretold < 0 else foretold / measured
                rows.append([name, step, foretold / 2**20 if ratio else None, measured / 2**20, ratio])
                found[f"{name}, {step}"] = foretold, measured
                show(f"{name}, {step}: {ratio}")

    with tempfile.TemporaryDirectory() as folder:
        place, size = Path(folder), (args.side, args.side)
        layers = ["depth", "normal", "albedo", "prim_id", "position"]
        film = f"film of {args.side} x {args.side}"
        for spp in (1, 16):
            add(f"{film}, {spp} spp", "scenes/cornell-box.json", {"size": size, "spp": spp}, place / "a.png")
        add(f"{film}, layers", "scenes/cornell-box.json", {"size": size, "spp": 1, "aov": layers}, place / "a.exr")
        wanted = {"size": size, "target_error": 0.05}
        add(f"{film}, wanted error", "scenes/cornell-box.json", wanted, place / "a.npz")
        import make

        mesh = bumpy(args.triangles)
        count = f"{len(mesh.faces):,} triangles"
        for kind, normals, precision in (
            ("ply", "flat", "float32"),
            ("ply", "flat", "float64"),
            ("ply", "smooth", "float32"),
            ("obj", "flat", "float32"),
        ):
            path = place / f"mesh.{kind}"
            if not path.exists():
                path.write_bytes(getattr(make, kind)(np.asarray(mesh.vertices, float), mesh.faces, None))
            few = {"size": (256, 256), "spp": 1, "precision": precision}
            add(f"{count}, {kind}, {normals}, {precision}", scene_of(path, normals), few, place / "b.png")
    show()
    table(["case", "step", "foretold, MiB", "measured, MiB", "ratio"], rows)
    finish(args, report, {"cases": found})


if __name__ == "__main__":
    main()
