"""Compare two workers of one thread with one, and count bytes per work item: scheduler and workers on this machine.

One and two workers take turns, so other work on the machine affects both. On a machine with two cores, the caller and
the scheduler take time from the workers. So in a second table, workers sleep for `NAP` per work item instead of
rendering, as if each had its own machine: this shows only the time they wait. Bytes are those of the loopback device
meanwhile (Linux), including the messages between scheduler and workers.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from distributed import Client
from harness import ROOT, begin, finish, interleave, parser, show, table

import raytrace as rt

NAP = 0.2  # seconds
ASLEEP = f"""
import time
from collections import Counter
import numpy as np
from raytrace.rendering import cluster_worker as worker
def nap(scene, order, x, y, samples, sums):
    time.sleep({NAP})
    return worker.Drawn(np.zeros((12, len(x))), Counter(), {{"nap": {NAP}}})
worker._draw = nap
"""
QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": ROOT}


@contextmanager
def workers(count: int, preload: str = "") -> Iterator[Client]:
    """A scheduler with so many workers of one thread, each a process, as a terminal starts them."""
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder) / "scheduler.json")
        run, known = [sys.executable, "-m"], ["--scheduler-file", file, "--no-dashboard"]
        scheduler = [*run, "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", *known]
        worker = [*run, "distributed.cli.dask_worker", "--nthreads", "1", "--no-nanny", *known]
        if preload:
            (Path(folder) / "preload.py").write_text(preload)
            worker += ["--preload", str(Path(folder) / "preload.py")]
        processes = [subprocess.Popen(command, **QUIET) for command in (scheduler, *[worker] * count)]
        try:
            with Client(scheduler_file=file, set_as_default=False) as client:
                client.wait_for_workers(count)
                yield client
        finally:
            for process in processes[::-1]:
                process.terminate()
                process.wait()


def carried() -> int:
    """Bytes that the loopback device has received."""
    lines = Path("/proc/net/dev").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.strip().startswith("lo:"))


def main() -> None:
    options = parser(__doc__, rounds=5)
    options.add_argument("--scene", default=ROOT / "scenes/cornell-box.json")
    options.add_argument("--size", type=int, default=512, help="pixels: side of the film (%(default)s)")
    options.add_argument("--spp", type=int, default=1024, help="samples per pixel (%(default)s)")
    args = options.parse_args()
    found = begin()
    scene, ask = rt.load(args.scene), {"size": (args.size, args.size), "spp": args.spp}
    with workers(1) as one, workers(2) as two:
        draw = {name: drawing(scene, client, ask) for name, client in (("1 worker", one), ("2 workers", two))}
        draw["1 thread here"] = lambda: rt.render(scene, threads=1, **ask)
        draw["2 threads here"] = lambda: rt.render(scene, threads=2, **ask)
        seconds = interleave(draw, args.rounds)
        parts: list[int] = []
        before = carried()
        picture = rt.render(scene, client=two, progress=lambda event: parts.append(event.total), **ask)
        moved = carried() - before
        same = np.array_equal(picture.rgb, rt.render(scene, **ask).rgb)
    show(f"same bits: {same}\n")
    ratios = {name: np.median(seconds["1 worker"] / times) for name, times in seconds.items()}
    table(["", "seconds", "times as fast as 1 worker"],
          ([name, float(np.median(times)), float(ratios[name])] for name, times in seconds.items()))  # fmt: skip
    waits = {name: asleep(scene, count, ask) for name, count in (("1 worker", 1), ("2 workers", 2))}
    show(f"\nWorkers that sleep {NAP:g} s a part:\n")
    table(["", "parts", "seconds", "share of it that each sleeps", "parts a second, of 1 worker"],
          ([name, count, wall, share, (count / wall) / (waits["1 worker"][0] / waits["1 worker"][1])]
           for name, (count, wall, share) in waits.items()))  # fmt: skip
    pixels = args.size**2
    show(f"{parts[-1]} parts, {moved / parts[-1] / 1e3:.0f} kB each, {moved / pixels:.0f} bytes a pixel")
    results = {"seconds": {name: times.tolist() for name, times in seconds.items()}, "ratios": ratios}
    results["asleep"] = waits
    finish(args, found, results | {"parts": parts[-1], "bytes": moved, "same": bool(same)})


def asleep(scene: rt.Scene, count: int, ask: dict[str, Any]) -> tuple[int, float, float]:
    """Parts, seconds, and the share of these that each of so many workers sleeps; medians of two."""
    with workers(count, ASLEEP) as client:
        walls, parts = [], [0]
        for _ in range(3):
            began = time.perf_counter()
            rt.render(scene, client=client, progress=lambda event: parts.append(event.total), **ask)
            walls.append(time.perf_counter() - began)
    wall = float(np.median(walls[1:]))
    return parts[-1], wall, parts[-1] * NAP / count / wall


def drawing(scene: rt.Scene, client: Client, ask: dict[str, Any]) -> Callable[[], Any]:
    return lambda: rt.render(scene, client=client, **ask)


if __name__ == "__main__":
    main()
