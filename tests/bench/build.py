"""Compare the seconds to build a tree with Open3D, for both splits, interleaved in one run."""

from collections.abc import Callable
from typing import Any

import numpy as np
from harness import begin, finish, interleave, parser, show, table, times_faster
from peers import Open3D, available
from workloads import MESHES, Mesh, soup

import raytrace as rt

BUILT_AT_FIRST_USE = np.float32([[0, 0, 1e6, 0, 0, 1]])  # one ray: Open3D builds its tree at the first query


def builds(mesh: Mesh, peers: list[type]) -> dict[str, Callable[[], Any]]:
    calls: dict[str, Callable[[], Any]] = {
        split: lambda split=split: rt.BVH(mesh.vertices, mesh.faces, split=split) for split in ("sah", "median")
    }

    def open3d() -> None:
        peer = Open3D(mesh)
        peer.scene.cast_rays(peer.tensor(BUILT_AT_FIRST_USE))

    return calls | ({"Open3D": open3d} if Open3D in peers else {})


def main() -> None:
    options = parser(__doc__, rounds=7)
    options.add_argument("--meshes", nargs="+", choices=MESHES, default=list(MESHES))
    options.add_argument("--soup", type=int, metavar="N", help="a soup of N triangles as well")
    args = options.parse_args()
    found = begin()
    peers, missing = available()
    if Open3D.name in missing:
        show(f"missing: Open3D: {missing[Open3D.name]}\n")
    meshes = [MESHES[name]() for name in args.meshes]
    meshes += [soup(args.soup)._replace(name=f"soup of {args.soup:,}")] if args.soup else []
    results = []
    for mesh in meshes:
        seconds = interleave(builds(mesh, peers), args.rounds)
        results.append({
            "mesh": mesh.name,
            "triangles": len(mesh.faces),
            "seconds": {name: float(np.median(times)) for name, times in seconds.items()},
            "ratio": {name: times_faster(seconds["sah"], times) for name, times in seconds.items()},
        })  # fmt: skip
    show("Seconds to build, all cores:\n")
    table(["mesh", "triangles", "sah", "median", "Open3D", "Open3D / sah"],
          ([row["mesh"], f"{row['triangles']:,}", *(row["seconds"].get(name) for name in ("sah", "median", "Open3D")),
            row["ratio"].get("Open3D")] for row in results))  # fmt: skip
    finish(args, found, results)


if __name__ == "__main__":
    main()
