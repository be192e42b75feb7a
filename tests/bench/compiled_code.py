"""Measure queries that a user's compiled code makes, one ray at a time and together, beside calls from Python."""

import time

import numpy as np
import trimesh
from harness import begin, finish, interleave, parser, show, table
from numba import njit, prange

import raytrace as rt
from raytrace import compiled

N = 20000


@njit(nogil=True)
def one_by_one(scene, o, d):
    total = 0.0
    for i in range(len(o)):
        t, _, _, _ = compiled.closest_hit(scene, o[i], d[i])
        total += min(t, 9.0)
    return total


@njit(nogil=True)
def together(scene, o, d):
    return compiled.closest_hit(scene, o, d)


@njit(parallel=True)
def in_parallel(scene, o, d):
    t = np.empty(len(o))
    for i in prange(len(o)):
        t[i] = compiled.closest_hit(scene, o[i], d[i])[0]
    return t


def main() -> None:
    args = parser(__doc__).parse_args()
    found = begin()
    mesh = trimesh.creation.icosphere(subdivisions=5)
    rng = np.random.default_rng(1)
    o = rng.normal(size=(N, 3))
    o *= 2 / np.linalg.norm(o, axis=1)[:, None]
    d = rng.normal(size=(N, 3)) - o
    rows = []
    for precision in ("float32", "float64"):
        bvh = rt.BVH(mesh, precision=precision)
        scene = compiled.handle(bvh)
        first = {}
        for function in (one_by_one, together, in_parallel):
            began = time.perf_counter()
            function(scene, o[:1], d[:1])
            first[function.__name__] = time.perf_counter() - began
        calls = {
            "one_by_one": lambda scene=scene: one_by_one(scene, o, d),
            "together": lambda scene=scene: together(scene, o, d),
            "in_parallel": lambda scene=scene: in_parallel(scene, o, d),
            "BVH.closest_hit, 1 thread": lambda bvh=bvh: bvh.closest_hit(o, d, threads=1),
            "BVH.closest_hit, one ray per call": lambda bvh=bvh: [bvh.closest_hit(o[i], d[i]) for i in range(200)],
        }
        for name, times in interleave(calls, args.rounds).items():
            rays = 200 if "per call" in name else N
            rows.append([precision, name, float(np.median(times)) / rays * 1e9, first.get(name, 0.0)])
    show("Random rays at a sphere of 20480 triangles; seconds to compile are those of the first call:\n")
    header = ["precision", "call", "ns per ray", "compile s"]
    table(header, rows)
    finish(args, found, [dict(zip(header, row, strict=True)) for row in rows])


if __name__ == "__main__":
    main()
