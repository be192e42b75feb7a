"""Compare the seconds to refit a tree to moved vertices with those to build a new one, interleaved in one run.

The vertices move at random by as much as an edge is long, and back. Speed of queries: rays from the camera of the mesh,
in the refitted tree and in a new one.
"""

import numpy as np
from harness import begin, finish, interleave, parser, show, table, times_faster
from workloads import MESHES, Mesh, ray_sets, soup

import raytrace as rt

MOVE = 0.01  # standard deviation of the motion: half an edge of the soups


def small_soup() -> Mesh:
    """Return a soup of 10,000 triangles."""
    return soup(10_000)._replace(name="soup of 10,000")


def main() -> None:
    options = parser(__doc__, rounds=7)
    options.add_argument("--precision", nargs="+", default=["float32", "float64"], choices=("float32", "float64"))
    options.add_argument("--queries", action="store_true", help="also the speed of queries, which takes longer")
    args = options.parse_args()
    found = begin()
    rows = []
    for mesh in (small_soup(), MESHES["sphere"](), MESHES["soup"]()):
        for precision in args.precision:
            rows.append(measure(mesh, precision, args.rounds, args.queries))
    show(
        "Seconds to refit and to build, all cores; expected cost of a ray over that in the tree as built, and over that"
    )
    show("in a new tree; speed of camera rays over that in a new tree:\n")
    table(list(rows[0]), (list(row.values()) for row in rows))
    finish(args, found, rows)


def measure(mesh: Mesh, precision: str, rounds: int, queries: bool) -> dict[str, object]:
    rest = mesh.vertices.astype(precision)
    moved = (rest + np.random.default_rng(7).normal(0, MOVE, rest.shape)).astype(precision)
    bvh, turn = rt.BVH(rest, mesh.faces, precision), [moved, rest]

    def refit() -> None:
        turn.reverse()
        bvh.refit(turn[1])

    seconds = interleave({"refit": refit, "build": lambda: rt.BVH(moved, mesh.faces, precision)}, rounds)
    bvh.refit(moved)
    new = rt.BVH(moved, mesh.faces, precision)
    row = {
        "mesh": mesh.name,
        "triangles": f"{len(mesh.faces):,}",
        "precision": precision,
        "refit": float(np.median(seconds["refit"])),
        "build": float(np.median(seconds["build"])),
        "times faster": times_faster(seconds["refit"], seconds["build"]),
        "cost / as built": bvh.stats.growth,
        "cost / new": bvh.stats.sah_cost / new.stats.sah_cost,
    }
    if queries:
        rays = ray_sets(mesh)[2]
        o, d = rays.o.astype(precision), rays.d.astype(precision)
        times = interleave({"refitted": lambda: bvh.closest_hit(o, d), "new": lambda: new.closest_hit(o, d)}, rounds)
        row["speed / new"] = times_faster(times["refitted"], times["new"])
    return row


if __name__ == "__main__":
    main()
