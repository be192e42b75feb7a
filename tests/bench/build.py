"""Compare the seconds to build a tree with Open3D and Mitsuba, for both splits, interleaved in one run.

"Whole" is the tree without divided triangles: its time is the same where none are divided.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from harness import begin, finish, interleave, parser, show, table, times_faster
from peers import Mitsuba, Open3D, Whole, available
from workloads import MESHES, Mesh, building, soup

import raytrace as rt

BUILT_AT_FIRST_USE = np.float32([[0, 0, 1e6, 0, 0, 1]])  # one ray: Open3D builds its tree at the first query
COLUMNS = "sah", "whole", "median", "Open3D", "Mitsuba"


def builds(mesh: Mesh, peers: list[type]) -> dict[str, Callable[[], Any]]:
    calls: dict[str, Callable[[], Any]] = {
        split: lambda split=split: rt.BVH(mesh.vertices, mesh.faces, split=split) for split in ("sah", "median")
    }

    calls["whole"] = lambda: Whole(mesh)
    if Mitsuba in peers:
        calls["Mitsuba"] = lambda: Mitsuba(mesh)

    def open3d() -> None:
        peer = Open3D(mesh)
        peer.scene.cast_rays(peer.tensor(BUILT_AT_FIRST_USE))

    return calls | ({"Open3D": open3d} if Open3D in peers else {})


def main() -> None:
    options = parser(__doc__, rounds=7)
    options.add_argument("--meshes", nargs="+", choices=MESHES, default=list(MESHES))
    options.add_argument("--soup", type=int, metavar="N", help="a soup of N triangles as well")
    options.add_argument("--building", type=int, metavar="N", help="a building of about N triangles as well")
    args = options.parse_args()
    found = begin()
    peers, missing = available()
    for name in {Open3D.name, Mitsuba.name} & missing.keys():
        show(f"missing: {name}: {missing[name]}\n")
    meshes = [MESHES[name]() for name in args.meshes]
    meshes += [soup(args.soup)._replace(name=f"soup of {args.soup:,}")] if args.soup else []
    meshes += [building(args.building)] if args.building else []
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
    table(["mesh", "triangles", *COLUMNS, "Open3D / sah", "Mitsuba / sah", "whole / sah"],
          ([row["mesh"], f"{row['triangles']:,}", *(row["seconds"].get(name) for name in COLUMNS),
            *(row["ratio"].get(name) for name in ("Open3D", "Mitsuba", "whole"))] for row in results))  # fmt: skip
    finish(args, found, results)


if __name__ == "__main__":
    main()
