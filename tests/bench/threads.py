"""Measure what a second thread costs and gains: waking one that waits, starting one, and calls with 1 and 2 threads."""

import threading
from itertools import product

import numpy as np
from harness import begin, finish, interleave, parser, show, table, times_faster
from workloads import MESHES, ray_sets

import raytrace as rt
from raytrace import thread_pool

PAUSES = 0.0, 0.02  # seconds
SIZES = 1 << 12, 1 << 14, 1 << 16, 1 << 18, 1 << 20  # rays


def main() -> None:
    args = parser(__doc__, rounds=21).parse_args()
    found = begin()
    seconds = interleave({"wake": wake, "start": start}, args.rounds)
    show("Microseconds to call an empty function in another thread, and wait for it (median, largest):\n")
    table(
        ["thread", "median", "largest"], ([k, *(f(t) * 1e6 for f in (np.median, np.max))] for k, t in seconds.items())
    )
    rows = [row for name in ("box", "sphere") for row in gains(name, args.rounds)]
    show("Calls with two threads, times as fast as with one, at once after the last call and after a pause:\n")
    table(["mesh", "rays", "number", "pause, s", "ms with 1", "ms with 2", "times faster"], rows)
    finish(args, found, {"call": {name: times.tolist() for name, times in seconds.items()}, "gain": rows})


def nothing() -> None:
    pass


def wake() -> None:
    for job in thread_pool.start(nothing, 1, busy=False):
        job.done.acquire()


def start() -> None:
    thread = threading.Thread(target=nothing)
    thread.start()
    thread.join()


def gains(name: str, rounds: int):
    mesh = MESHES[name]()
    bvh = rt.BVH(mesh.vertices, mesh.faces)
    rays = next(found for found in ray_sets(mesh) if found.name == "camera, blocks")
    for size, pause in product(SIZES, PAUSES):
        d = rays.d[:size]
        o = rays.o[:size] if len(rays.o) == len(rays.d) else rays.o
        calls = {k: lambda o=o, d=d, k=k: bvh.closest_hit(o, d, threads=k) for k in (1, 2)}
        seconds = interleave(calls, rounds, pause)
        both = (float(np.median(seconds[k])) * 1e3 for k in (1, 2))
        yield name, rays.name, size, pause, *both, times_faster(seconds[2], seconds[1])


if __name__ == "__main__":
    main()
