"""How far the sides of frusta must be moved out: hard rays that are lost behind them, by ``FRUSTUM_ROUNDINGS``."""

import json
import shutil
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
from harness import ROOT, begin, finish, parser, show, table

import raytrace as rt
from raytrace.accel.frustum import FRUSTUM_ROUNDINGS
from raytrace.hardcases import tracers
from raytrace.hardcases.rays import cases
from raytrace.hardcases.suite import _differs

TRIED = 0.0, 0.125, 0.25, 0.5, 1.0, FRUSTUM_ROUNDINGS


def lost(precision: str) -> dict[str, int]:
    """Rays whose nearest hit is not that of a ray alone, in a bundle of its own; and rays that end right behind it."""
    found = {"rays": 0, "nearest": 0, "ended": 0}
    for case in cases():
        query = case.query(np.dtype(precision))
        bvh = rt.BVH(query.vertices, query.faces, precision)
        closest, occluded = (partial(ask, bvh) for ask in (tracers.closest_as_given, tracers.any_as_given))
        hits, *others = (
            way(closest, query.o, query.d, query.tmin, query.tmax) for way in (tracers.alone, tracers.bundled)
        )
        torn = np.any([_differs(a, b) for a, b in zip(hits, others[0], strict=True)], axis=0)
        end = np.where(hits.prim_id >= 0, np.nextafter(hits.t, np.inf, dtype=precision), query.tmax)
        ended = [way(occluded, query.o, query.d, query.tmin, end) for way in (tracers.alone, tracers.bundled)]
        found["rays"] += len(torn)
        found["nearest"] += int(torn.sum())
        found["ended"] += int(np.sum(ended[0] != ended[1]))
    return found


def with_roundings(number: float, precision: str) -> dict[str, int]:
    """Ask a copy of the package in which the constant is another."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder, "raytrace")
        shutil.copytree(ROOT / "raytrace", copy, ignore=shutil.ignore_patterns("__pycache__"))
        source = copy / "accel/frustum.py"
        changed = source.read_text("utf-8").replace(
            f"FRUSTUM_ROUNDINGS = {FRUSTUM_ROUNDINGS}", f"FRUSTUM_ROUNDINGS = {number}"
        )
        source.write_text(changed, "utf-8")
        words = f"import sys; sys.path[:0] = [{folder!r}, {str(Path(__file__).parent)!r}]\n"
        words += f"import json, frusta; frusta.show(json.dumps(frusta.lost({precision!r})))"
        asked = subprocess.run([sys.executable, "-c", words], check=True, capture_output=True, text=True)
    found: dict[str, int] = json.loads(asked.stdout)
    return found


def main() -> None:
    args, found = parser(__doc__).parse_args(), begin()
    rows = [
        {"precision": precision, "FRUSTUM_ROUNDINGS": number} | with_roundings(number, precision)
        for precision in ("float32", "float64")
        for number in TRIED
    ]
    show("Hard rays, each in a bundle of its own, that get other hits than alone; and of those that end behind them:\n")
    table(list(rows[0]), (list(row.values()) for row in rows))
    finish(args, found, rows)


if __name__ == "__main__":
    main()
