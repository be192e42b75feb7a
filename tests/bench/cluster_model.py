"""Model how many work items an image should have on a cluster: a simulation of scheduler, workers and link.

The simulation has one scheduler, which needs the same time for every task; workers of one thread, some of them slow,
each with one work item in progress and one waiting; work items of different cost; and one link, through which all
results reach the caller one after the other. Efficiency is work / (speed of all workers x seconds). A model in one line
approximates it:

    seconds = max(work / (workers speed), parts task, bytes / link) + 2 work / (parts slowest) + latency

The last column is what `raytrace.rendering.cluster.part_pixels` chooses. Nothing here is measured: it needs no cluster.
"""

import heapq
import json
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from harness import show, table

from raytrace.rendering.cluster import RATE, part_pixels

BYTES = 96  # of a pixel: twelve sums of eight bytes


class Cluster(NamedTuple):
    """What is assumed."""

    task: float = 1e-3  # seconds of the scheduler for a task
    latency: float = 5e-3  # seconds from a result to the next decision
    link: float = 125e6 / 2  # bytes a second: a gigabit, which results pass twice, to the scheduler and from there
    slow: float = 0.05  # share of the workers that are slow
    speed: float = 1 / 3  # of those
    uneven: float = 0.5  # standard deviation of the logarithm of parts' work


def speeds(cluster: Cluster, workers: int, draw: np.random.Generator) -> np.ndarray:
    """Of each worker, 1 being usual; as many slow ones as there should be, rounded by chance."""
    return np.where(draw.random(workers) < cluster.slow, cluster.speed, 1.0)


def simulate(cluster: Cluster, speed: np.ndarray, works: np.ndarray, size: float) -> float:
    """Seconds until the last result has come.

    Parameters
    ----------
    cluster : Cluster
    speed : (n,) array
        Of the workers.
    works : (p,) array
        Seconds that parts take at speed 1.
    size : float
        Bytes of a part's result.
    """
    scheduler = link = 0.0  # when they are free again
    free = np.zeros(len(speed))  # when workers are
    asking = [
        (0.0, slot % len(speed)) for slot in range(2 * len(speed))
    ]  # when a worker wants one more part, and which
    heapq.heapify(asking)
    results = []
    for work in works:
        at, worker = heapq.heappop(asking)
        scheduler = max(scheduler, at) + cluster.task
        free[worker] = max(free[worker], scheduler + cluster.latency) + work / speed[worker]
        results.append(free[worker])
        heapq.heappush(asking, (free[worker] + cluster.latency, worker))
    for done in sorted(results):
        link = max(link, done) + size / cluster.link
    return link + cluster.latency


def model(cluster: Cluster, speed: np.ndarray, work: float, parts: int, size: float) -> float:
    """The same in one line."""
    busy = max(work / speed.sum(), parts * cluster.task, parts * size / cluster.link)
    return busy + 2 * work / parts / speed.min() + 2 * cluster.latency


def main() -> None:
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, nargs="+", default=[10.0, 60.0], help="of work a worker (%(default)s)")
    parser.add_argument(
        "--parts", type=int, nargs="+", default=[2, 4, 8, 16, 32, 64, 128], help="a worker (%(default)s)"
    )
    parser.add_argument("--pixels", type=int, default=1 << 22, help="of the film (%(default)s)")
    parser.add_argument("--rounds", type=int, default=9, help="medians are taken of so many clusters (%(default)s)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all numbers there too")
    args = parser.parse_args()
    cluster, found = Cluster(), []
    show(f"{cluster}\n")
    for seconds in args.seconds:
        show(f"Efficiency with {seconds:g} s of work a worker, simulated; below, what the model says:\n")
        rows = []
        for workers in (1, 10, 100, 1000):
            samples = int(seconds * workers * RATE / args.pixels)
            chosen = args.pixels / part_pixels(args.pixels, samples, workers) / workers
            pairs = [efficiency(cluster, args, workers, each, seconds) for each in (*args.parts, chosen)]
            rows.append([workers, *(f"{simulated:.0%}" for simulated, _ in pairs)])
            rows[-1][-1] += f" ({chosen:.3g} each)"
            rows.append(["", *(f"{modelled:.0%}" for _, modelled in pairs)])
            found += [{"seconds": seconds, "workers": workers, "parts": each, "simulated": simulated, "model": modelled}
                      for each, (simulated, modelled) in zip((*args.parts, chosen), pairs, strict=True)]  # fmt: skip
        table(["workers", *(f"{each} parts each" for each in args.parts), "chosen"], rows)
    if args.json:
        args.json.write_text(json.dumps(found, indent=1) + "\n")


def efficiency(cluster: Cluster, args: Namespace, workers: int, each: float, seconds: float) -> tuple[float, float]:
    """Medians of what is simulated and what the model says."""
    work, parts = seconds * workers, max(round(each * workers), 1)
    size, pairs = args.pixels / parts * BYTES, []
    for k in range(args.rounds if workers < 1000 else 3):
        draw = np.random.default_rng([workers, parts, k])
        speed, uneven = speeds(cluster, workers, draw), draw.lognormal(sigma=cluster.uneven, size=parts)
        works = uneven * work / uneven.sum()
        best = work / speed.sum()
        pairs.append((best / simulate(cluster, speed, works, size), best / model(cluster, speed, work, parts, size)))
    simulated, modelled = np.median(pairs, axis=0)
    return float(simulated), float(modelled)


if __name__ == "__main__":
    main()
