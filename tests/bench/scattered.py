"""Measure rays in random order, from random points of a displaced sphere in random directions, beside Mitsuba."""

from typing import Any

import numpy as np
from growth import bumpy
from harness import begin, finish, interleave, parser, show, table, times_faster
from peers import Mitsuba, Ours, available
from workloads import Mesh, RaySet

from rays import PAUSE
from raytrace.parallel import thread_count

SIZES = 20_000, 300_000, 5_000_000  # triangles
COUNT = 1 << 20  # rays


def random_rays(mesh: Mesh) -> RaySet:
    """Return rays that start a little above random triangles, in directions that are uniform on the sphere."""
    rng = np.random.default_rng(1)
    corners = mesh.vertices[mesh.faces[rng.integers(0, len(mesh.faces), COUNT)]]
    d = rng.normal(size=(COUNT, 3))
    d /= np.linalg.norm(d, axis=1)[:, None]
    return RaySet("random", False, (corners.mean(axis=1) * 1.001).astype("f4"), d.astype("f4"), np.inf)


def measure(triangles: int, rounds: int) -> dict[str, Any]:
    mesh = bumpy(triangles)
    rays = random_rays(mesh)
    tracers = [Ours(mesh), *([Mitsuba(mesh)] if Mitsuba in available()[0] else [])]
    calls = {name: call for tracer in tracers for name, call in tracer.calls(rays, thread_count(None)).items()}
    seconds = interleave(calls, rounds, PAUSE)
    ns = {name: 1e9 * float(np.median(times)) / COUNT for name, times in seconds.items()}
    ratios = [times_faster(seconds["raytrace"], times) for name, times in seconds.items() if name.startswith("Mitsuba")]
    return {"triangles": len(mesh.faces), "ns": ns, "ratio": min(ratios, default=None)}


def main() -> None:
    args = parser(__doc__, rounds=5).parse_args()
    found = begin()
    rows = [measure(triangles, args.rounds) for triangles in SIZES]
    show("Nanoseconds per ray, all cores (Mitsuba: its better setting):\n")
    header = ["triangles", "raytrace", "Mitsuba", "x Mitsuba"]
    table(
        header, ([f"{row['triangles']:,}", row["ns"]["raytrace"], mitsuba_ns(row["ns"]), row["ratio"]] for row in rows)
    )
    finish(args, found, rows)


def mitsuba_ns(ns: dict[str, float]) -> float | None:
    return min((value for name, value in ns.items() if name.startswith("Mitsuba")), default=None)


if __name__ == "__main__":
    main()
