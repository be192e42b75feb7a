"""Time to look for black backs, beside that of building the tree, for all shipped scenes; in one thread.

python tests/bench/seen_backs.py [--repeats 5]
"""

import argparse
import sys
import time
from pathlib import Path

import raytrace as rt
from raytrace.scene.seen_backs import back_warnings, seen


def best(call, repeats):
    """Return the shortest of a few times, seconds."""
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        call()
        times.append(time.perf_counter() - began)
    return min(times)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=5)
    repeats, out = parser.parse_args().repeats, sys.stdout.write
    out(f"{'scene':36}{'triangles':>10}{'backs, ms':>12}{'tree, ms':>12}\n")
    for path in sorted((Path(__file__).parents[2] / "scenes").rglob("*.json")):
        scene = rt.load(path)
        mesh = scene.mesh
        rt.BVH(mesh.vertices, mesh.faces)  # compiles
        backs = best(lambda scene=scene: seen(scene.mesh, scene.camera, scene.settings.size), repeats)
        tree = best(lambda mesh=mesh: rt.BVH(mesh.vertices, mesh.faces), repeats)
        out(f"{path.stem:36}{len(mesh.faces):10,}{1e3 * backs:12.1f}{1e3 * tree:12.1f}\n")
        out("".join(f"    {line}\n" for line in back_warnings(scene)))


if __name__ == "__main__":
    main()
