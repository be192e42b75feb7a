"""Check what many renders leave behind: ``PYTHONPATH=. python tests/bench/thousand.py [--renders N]``."""

import ctypes
import gc
import os
import tempfile
import threading
import time
from pathlib import Path

from harness import ROOT, begin, finish, parser, show, table

import raytrace as rt
from raytrace.image import files as pictures

SCENES = "cornell-box", "cornell-box-glass", "glass-sphere", "room"
SETTLED = 50  # renders before anything is counted


def resident() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def taken() -> tuple[int, int, int, int]:
    """Bytes of memory, with what the allocator keeps for later, and without; threads; open files."""
    gc.collect()
    kept = resident()
    ctypes.CDLL(None).malloc_trim(0)
    return kept, resident(), threading.active_count(), len(os.listdir("/proc/self/fd"))


def main() -> None:
    options = parser(__doc__ or "")
    options.add_argument("--renders", type=int, default=1000, help="(%(default)s)")
    args = options.parse_args()
    report = begin()
    kept = rt.load(ROOT / "scenes/room.json")
    samplers, suffixes, precisions = ("sobol", "stratified", "independent"), ("png", "npz"), ("float32", "float64")
    rows, first, began = [], taken(), time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        for k in range(SETTLED + args.renders + 1):
            if k == SETTLED:
                first = taken()
            if k >= SETTLED and (k - SETTLED) % max(args.renders // 5, 1) == 0:
                resting, memory, threads, files = taken()
                rows.append([k - SETTLED, (memory - first[1]) / 1e6, (resting - memory) / 1e6, threads, files])
            scene = kept if k % 2 else ROOT / f"scenes/{SCENES[k // 2 % 4]}.json"
            ask = {"seed": k, "sampler": samplers[k % 3], "precision": precisions[k // 3 % 2]}
            image = rt.render(scene, spp=2, size=(64 + k % 7, 48), aov=("depth",) if k % 5 == 0 else (), **ask)
            pictures.load(image.save(Path(folder) / f"a.{suffixes[k % 2]}"))
    show(f"{args.renders} renders in {time.perf_counter() - began:.0f} s")
    table(["renders", "grown, MB", "kept by the allocator, MB", "threads", "open files"], rows)
    finish(args, report, rows)


if __name__ == "__main__":
    main()
