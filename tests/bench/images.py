"""Compare rays of an image, (h, w, 3), with the same rays as rows in blocks of 4 x 4 pixels, and as rows of pixels.

Camera rays, and shadow rays of their hits; shadow rays of misses have no direction. Interleaved in one run.
"""

from typing import Any

import numpy as np
from harness import begin, finish, interleave, parser, show, table, times_faster
from workloads import BLOCK, MESHES, Mesh, camera_rays

import raytrace as rt


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--threads", type=int, default=2)
    options.add_argument(
        "--width", type=int, default=1024, help="of the image, whose height is as large, a multiple of 4"
    )
    options.add_argument("--meshes", nargs="+", choices=MESHES, default=["box", "sphere", "soup"])
    options.add_argument("--precision", nargs="+", default=["float32", "float64"], choices=("float32", "float64"))
    args = options.parse_args()
    found = begin()
    rows = []
    for name in args.meshes:
        mesh = MESHES[name]()
        for precision in args.precision:
            for kind in ("camera", "shadow"):
                rows.append(measure(mesh, precision, kind, args))
    show("Millions of rays per second; speed of images over that of blocks, and of rows over that of blocks:\n")
    table(list(rows[0]), (list(row.values()) for row in rows))
    finish(args, found, rows)


def measure(mesh: Mesh, precision: str, kind: str, args: Any) -> dict[str, object]:
    n = args.width
    bvh = rt.BVH(mesh.vertices, mesh.faces, precision)
    o, d = (a.astype(precision) for a in camera_rays(mesh, np.arange(n * n), n))
    ask, tmax = bvh.closest_hit, np.inf
    if kind == "shadow":
        hits = bvh.closest_hit(o, d)
        hit, surface = (hits.prim_id >= 0)[:, None], bvh.surface(hits)
        ng = surface.ng * -np.sign(np.sum(surface.ng * d, 1, keepdims=True))
        o = np.where(hit, surface.p + np.asarray(1e-4, precision) * ng, 0)
        d = np.where(hit, np.asarray(mesh.light, precision) - o, 0)
        ask, tmax = bvh.any_hit, 1.0
    order = np.arange(n * n).reshape(n // BLOCK, BLOCK, n // BLOCK, BLOCK).swapaxes(1, 2).ravel()
    given = {"blocks": (o[order], d[order]), "image": (o.reshape(n, n, 3), d.reshape(n, n, 3)), "rows": (o, d)}
    calls = {name: lambda rays=rays: ask(*rays, tmax=tmax, threads=args.threads) for name, rays in given.items()}
    seconds = interleave(calls, args.rounds)
    return {
        "mesh": mesh.name,
        "precision": precision,
        "rays": kind,
        **{name: n * n / 1e6 / float(np.median(times)) for name, times in seconds.items()},
        "image / blocks": times_faster(seconds["image"], seconds["blocks"]),
        "rows / blocks": times_faster(seconds["rows"], seconds["blocks"]),
    }


if __name__ == "__main__":
    main()
