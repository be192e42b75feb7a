"""Time queries other than nearest hits against Open3D, libigl, and trimesh with embreex: equal threads, interleaved.

``python tests/bench/queries.py`` prints a table; ``--queries count_hits`` times one of them. To add a query, write a
function that returns calls by name, ours first, and put it into ``QUERIES``.
"""

from collections.abc import Callable
from importlib import metadata
from typing import Any

import numpy as np
from harness import begin, finish, interleave, parser, show, table, times_faster

import raytrace as rt
from raytrace.hardcases.meshes import Mesh, torus

Calls = dict[str, Callable[[], Any]]
MESHES = {"10^4": (100, 50), "10^6": (1000, 500)}  # rings and sides of a torus


class Task:
    """A mesh, and rays and points around it."""

    def __init__(self, mesh: Mesh, n: int, threads: int) -> None:
        rng = np.random.default_rng(1)
        self.vertices, self.faces = mesh[0].astype(np.float32), mesh[1].astype(np.int32)
        self.bvh, self.threads = rt.BVH(self.vertices, self.faces), threads
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        self.points = rng.uniform(low, high, (n, 3)).astype(np.float32)
        origins = rng.normal(size=(n, 3))
        self.o = (3 * origins / np.linalg.norm(origins, axis=1, keepdims=True)).astype(np.float32)
        self.d = self.points - self.o
        side = int(n**0.5)
        y, x = np.mgrid[0:side, 0:side] / side * 3 - 1.5
        self.image_d = np.stack([x, y, np.full_like(x, -3)], -1).reshape(-1, 3).astype(np.float32)
        self.image_o = np.tile(np.float32([0, 0, 3]), (len(self.image_d), 1))

    def open3d(self) -> Any:
        """The mesh in Open3D, and the function that makes its tensors."""
        import open3d as o3d

        scene = o3d.t.geometry.RaycastingScene(nthreads=self.threads)
        scene.add_triangles(o3d.core.Tensor(self.vertices), o3d.core.Tensor(self.faces.astype("u4")))
        return scene, o3d.core.Tensor

    def trimesh(self) -> Any:
        """The mesh in trimesh, whose rays embreex traces."""
        import trimesh

        mesh = trimesh.Trimesh(self.vertices, self.faces, process=False)
        if (
            "Embree" not in type(mesh.ray).__module__ + str(type(mesh.ray))
            and "embree" not in type(mesh.ray).__module__
        ):
            raise ImportError("trimesh does not use embreex")
        return mesh


def count_hits(task: Task) -> Calls:
    """Number of hits of rays in random order; then of an image in rows of pixels."""
    scene, tensor = task.open3d()
    random, image = (tensor(np.concatenate(pair, 1)) for pair in ((task.o, task.d), (task.image_o, task.image_d)))
    ask, threads = task.bvh.count_hits, task.threads
    return {
        "random/raytrace": lambda: ask(task.o, task.d, threads=threads),
        "random/raytrace, crossings": lambda: ask(task.o, task.d, crossings=True, threads=threads),
        "random/Open3D": lambda: scene.count_intersections(random, nthreads=threads),
        "image/raytrace": lambda: ask(task.image_o, task.image_d, threads=threads),
        "image/raytrace, crossings": lambda: ask(task.image_o, task.image_d, crossings=True, threads=threads),
        "image/Open3D": lambda: scene.count_intersections(image, nthreads=threads),
    }


def all_hits(task: Task) -> Calls:
    """All hits of rays in random order; then of an image in rows of pixels."""
    scene, tensor = task.open3d()
    random, image = (tensor(np.concatenate(pair, 1)) for pair in ((task.o, task.d), (task.image_o, task.image_d)))
    ask, threads = task.bvh.all_hits, task.threads
    calls: Calls = {
        "random/raytrace": lambda: ask(task.o, task.d, threads=threads),
        "random/raytrace, crossings": lambda: ask(task.o, task.d, crossings=True, threads=threads),
        "random/Open3D": lambda: scene.list_intersections(random, nthreads=threads),
        "image/raytrace": lambda: ask(task.image_o, task.image_d, threads=threads),
        "image/raytrace, crossings": lambda: ask(task.image_o, task.image_d, crossings=True, threads=threads),
        "image/Open3D": lambda: scene.list_intersections(image, nthreads=threads),
    }
    return calls


def contains(task: Task) -> Calls:
    """Points inside; also our own count along one direction, and trimesh, which runs on one thread."""
    scene, tensor = task.open3d()
    points, threads, bvh = tensor(task.points), task.threads, task.bvh
    up = np.float32([0.0137, 0.0071, 1])
    calls: Calls = {
        "points/raytrace": lambda: bvh.contains(task.points, threads=threads),
        "points/raytrace, count_hits": lambda: bvh.count_hits(task.points, up, threads=threads),
        "points/Open3D": lambda: scene.compute_occupancy(points, nthreads=threads),
    }
    mesh = task.trimesh()
    calls["points/raytrace, one thread"] = lambda: bvh.contains(task.points, threads=1)
    calls["points/trimesh, embreex"] = lambda: mesh.contains(task.points)
    return calls


QUERIES: dict[str, Callable[[Task], Calls]] = {"count_hits": count_hits, "all_hits": all_hits, "contains": contains}


def main() -> None:
    made = parser(__doc__, rounds=7)
    made.add_argument("-n", type=int, default=1_000_000, help="rays and points (%(default)s)")
    made.add_argument("--threads", type=int, default=2, help="of each library (%(default)s)")
    made.add_argument("--queries", nargs="*", choices=QUERIES, default=list(QUERIES), help="default: all")
    made.add_argument("--meshes", nargs="*", choices=MESHES, default=list(MESHES), help="default: all")
    args = made.parse_args()
    found, rows = begin(), []
    show(f"also trimesh {metadata.version('trimesh')}, libigl {metadata.version('libigl')}")
    for name in args.meshes:
        task = Task(torus(*MESHES[name]), args.n, args.threads)
        for query in args.queries:
            seconds = interleave(QUERIES[query](task), args.rounds)
            for call, times in seconds.items():
                group = call.split("/")[0]
                ours = seconds[next(other for other in seconds if other.split("/")[0] == group)]
                rows.append((name, query, call, float(np.median(times) * 1e3), times_faster(ours, times)))
                show(" ".join(map(str, rows[-1])))
    show()
    table(("triangles", "query", "call", "ms", "times ours"), rows)
    finish(args, found, rows)


if __name__ == "__main__":
    main()
