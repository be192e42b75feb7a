"""Two workers of one thread against one, and how many bytes a part moves: a scheduler and workers on this machine.

One and two workers take turns, so that what else the machine does falls on both. Bytes are those that the loopback
device carried meanwhile (Linux), with all that the scheduler and the workers say to each other.
"""

import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from distributed import Client
from harness import ROOT, begin, finish, interleave, parser, show, table

import raytrace as rt

QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": ROOT}


@contextmanager
def workers(count: int) -> Iterator[Client]:
    """A scheduler with so many workers of one thread, each a process, as a terminal starts them."""
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder) / "scheduler.json")
        run, known = [sys.executable, "-m"], ["--scheduler-file", file, "--no-dashboard"]
        scheduler = [*run, "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", *known]
        worker = [*run, "distributed.cli.dask_worker", "--nthreads", "1", "--no-nanny", *known]
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
    options.add_argument("--spp", type=int, default=2048, help="samples per pixel (%(default)s)")
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
    pixels = args.size**2
    show(f"{parts[-1]} parts, {moved / parts[-1] / 1e3:.0f} kB each, {moved / pixels:.0f} bytes a pixel")
    results = {"seconds": {name: times.tolist() for name, times in seconds.items()}, "ratios": ratios}
    finish(args, found, results | {"parts": parts[-1], "bytes": moved, "same": bool(same)})


def drawing(scene: rt.Scene, client: Client, ask: dict[str, Any]) -> Callable[[], Any]:
    return lambda: rt.render(scene, client=client, **ask)


if __name__ == "__main__":
    main()
