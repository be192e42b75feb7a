"""Compare time against error with Mitsuba 3, interleaved in one run: a report, ratios, local slopes.

``docs/pictures/plots.py`` makes tables and a plot of docs/benchmarks.md from what ``--json`` writes.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from argparse import Namespace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from harness import ROOT, begin, finish, parser, show, table
from peer_pictures import peer_picture
from peers import Mitsuba, available

import raytrace as rt
from raytrace.output_folder import check_folder
from raytrace.records import Scene
from raytrace.reporting import measure, task
from raytrace.reporting.analysis import needed
from raytrace.reporting.configurations import SPP, Configuration, ConfiguredScene, steps_of
from raytrace.reporting.measure import Sweep
from raytrace.reporting.measurements import Point
from raytrace.reporting.reference import make_reference
from raytrace.reporting.sweep import written

PEER = "Mitsuba "  # prefix of the names of its samplers
PEER_SAMPLERS = "multijitter", "ldsampler", "orthogonal", "stratified", "independent"
ADAPTIVE, UNIFORM = Configuration("sobol", "float32", adaptive=True), Configuration("sobol", "float32")
ERRORS = 5e-3, 1e-3, 4e-4, 1.4e-4  # RMSE on a screen of the table: a preview, and three smaller ones
COUNTS = 16, 64, 256  # samples per pixel of the table of errors
COLD = """
import sys, mitsuba as mi
sys.path[:0] = [{bench!r}, {root!r}]
import raytrace as rt
from peer_pictures import peer_picture
mi.set_variant("llvm_ad_rgb")
peer_picture(rt.load({scene!r}), ({width}, {height}))(16, 0).numpy()
"""


class PeerSubject:
    """A scene that Mitsuba renders with one of its samplers."""

    table_bytes = 0  # its memory is not allocated by Python, and unknown

    def __init__(self, scene: Scene, way: Configuration, size: tuple[int, int]) -> None:
        self.configuration, self.size = way, size
        self._picture = peer_picture(scene, size, way.sampler.removeprefix(PEER))

    def render(self, step: float, seed: int) -> Any:
        """Render one image; return the fields of ``Render`` that are used here. Its rays are not counted."""
        spp = int(step)
        if self.configuration.sampler.endswith("orthogonal"):  # it needs the square of a prime
            spp = next(prime**2 for prime in (2, 3, 5, 7, 11, 13, 17, 19, 23) if prime**2 >= step)
        rgb = self._picture(spp, seed).numpy().reshape(*self.size[::-1], 3)
        stats = {"compile_seconds": 0.0, "rays": {}, "samples": spp * rgb.shape[0] * rgb.shape[1]}
        return SimpleNamespace(rgb=rgb, stderr=rgb[..., 0], stats=stats, interrupted=False)


def subject(scene: Scene, way: Configuration, size: tuple[int, int]) -> Any:
    return (PeerSubject if way.sampler.startswith(PEER) else ConfiguredScene)(scene, way, size)


def steps(way: Configuration) -> tuple[float, ...]:
    """Return the sample counts of a configuration: enough for the smallest error with every good sampler."""
    return steps_of(way) if way.adaptive else (*SPP, 2 * SPP[-1])


def sweep(scene: Scene, size: tuple[int, int], folder: Path, ways: list[Configuration]) -> list[Point]:
    """Measure all configurations in turn, and write a report."""
    began = time.perf_counter()
    truth = make_reference(scene, size, 600.0, lambda share, event: None)
    show(f"reference: {truth.spp} samples per pixel, its own error {truth.error:.1e}\n")
    check_folder(folder)
    found = Sweep(scene, size, truth, 1e9, lambda share, rays: None, subject).run(ways)
    report = written(scene, size, truth, found, folder, (1e9, time.perf_counter() - began))
    show(f"wrote {report.files[-1]}\n")
    return list(found.points)


def ratios(points: list[Point]) -> list[dict[str, Any]]:
    """Return, for each error, the least seconds of ours and of Mitsuba's best sampler, interpolated on log axes."""
    curves = {way: [p for p in points if p.configuration == way] for way in {p.configuration for p in points}}
    rows = []
    for error in ERRORS:
        found = {way: need for way, curve in curves.items() if (need := needed(curve, error))}
        peers = [way for way in found if way.sampler.startswith(PEER)]
        best = min(peers, key=lambda way: found[way][1], default=None)
        row: dict[str, Any] = {"error": error, "peer": best.sampler if best else None}
        three = {"peer": best, "uniform": UNIFORM, "adaptive": ADAPTIVE}
        times = {name: found[way][1] if way in found else np.nan for name, way in three.items()}
        row |= {f"{name} s": seconds for name, seconds in times.items()}
        for one, other in (("peer", "adaptive"), ("peer", "uniform"), ("uniform", "adaptive")):
            row[f"{one} / {other}"] = times[one] / times[other]
        row |= {f"{name} spp": found[way][0] if way in found else np.nan for name, way in three.items()}
        rows.append(row)
    return rows


def slopes(points: list[Point]) -> list[float]:
    """Return the slopes of log error against log samples between neighbouring counts of the table."""
    few = [point for point in points if point.step in COUNTS]
    return [float(np.log(b.rmse_srgb / a.rmse_srgb) / np.log(b.spp / a.spp)) for a, b in pairwise(few)]


def error_text(point: Point) -> str:
    """Return the error on a screen, with the samples per pixel where they differ from those requested."""
    return f"{point.rmse_srgb:.2e}" + (f" ({point.spp:g} spp)" if point.spp != point.step else "")


def cold(path: Path, size: tuple[int, int]) -> dict[str, list[float]]:
    """Return seconds of whole processes, one image of 16 spp each: with empty caches, then twice with full ones."""
    bench = Path(__file__).parent
    words = COLD.format(bench=str(bench), root=str(ROOT), scene=str(path), width=size[0], height=size[1])
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        ours = [sys.executable, "-m", "raytrace", str(path), "-o", f"{folder}/a.npz", "--spp", "16", "--quiet"]
        ours += ["--size", f"{size[0]}x{size[1]}"]
        home = os.environ | {"HOME": folder, "RAYTRACE_CACHE": folder, "PYTHONPATH": str(ROOT)}
        for name, command in (("raytrace", ours), ("Mitsuba", [sys.executable, "-c", words])):
            found[name] = []
            for _ in range(3):
                began = time.perf_counter()
                subprocess.run(command, check=True, env=home, cwd=ROOT, capture_output=True)
                found[name].append(time.perf_counter() - began)
    return found


def options() -> Namespace:
    made = parser(__doc__, rounds=5)
    boxes = [ROOT / f"scenes/{name}.json" for name in ("cornell-box", "cornell-box-glass")]
    about = "meshes, point lights, at most one index of refraction (the two Cornell boxes)"
    made.add_argument("--scenes", nargs="+", type=Path, default=boxes, help=about)
    made.add_argument("--size", type=int, default=256, help="pixels: side of the film (%(default)s)")
    made.add_argument("--peer-samplers", nargs="+", default=PEER_SAMPLERS, help="of Mitsuba (%(default)s)")
    made.add_argument("-o", "--output", type=Path, default=Path("out"), help="folder for the reports (%(default)s)")
    return made.parse_args()


def main() -> None:
    args, found = options(), begin()
    measure.steps_of = steps
    measure.renders_of = task.renders_of = lambda way, step: args.rounds
    peers, missing = available()
    samplers = args.peer_samplers if Mitsuba in peers else ()
    if not samplers:
        show(f"missing: Mitsuba: {missing['Mitsuba']}\n")
    ways = [UNIFORM, ADAPTIVE, Configuration("stratified", "float32"), Configuration("independent", "float32")]
    ways += [Configuration(f"{PEER}{sampler}", "float32") for sampler in samplers]
    results = {}
    for path in args.scenes:
        size, folder = (args.size, args.size), args.output / path.stem
        show(f"{path.stem}\n")
        points = sweep(rt.load(path), size, folder, ways)
        content = json.loads((folder / "report.json").read_text())
        rows = ratios(points)
        table(["way", *map(str, COUNTS)],
              ([way.name, *(error_text(p) for p in points if p.configuration == way and p.step in COUNTS)]
               for way in ways if not way.adaptive))  # fmt: skip
        table(list(rows[0]), (list(row.values()) for row in rows))
        show("Local slopes of log error against log samples (one line through all counts would hide the bend):\n")
        uniform = [way for way in ways if not way.adaptive]
        table(["way", *(f"{a} to {b}" for a, b in pairwise(COUNTS))],
              ([way.name, *slopes([p for p in points if p.configuration == way])] for way in uniform))  # fmt: skip
        starts = cold(path, size) if samplers else {}
        table(["whole process, 16 spp, seconds", "empty caches", "again", "again"],
              ([name, *seconds] for name, seconds in starts.items()))  # fmt: skip
        results[path.stem] = {"points": content["points"], "ratios": rows, "orders": content["orders"]}
        results[path.stem]["whole processes"] = starts
    finish(args, found, results)


if __name__ == "__main__":
    main()
