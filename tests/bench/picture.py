"""Compare a Cornell box in a warm process with Mitsuba 3 (``direct``), same number of samples, interleaved."""

from collections.abc import Callable
from itertools import count
from typing import Any

import numpy as np
from harness import ROOT, begin, finish, interleave, parser, show, table, times_faster
from peer_pictures import peer_picture
from peers import Mitsuba, available

import raytrace as rt


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--scene", default=ROOT / "scenes/cornell-box.json", help="diffuse meshes and point lights")
    options.add_argument("--size", type=int, default=512, help="pixels: side of the film (%(default)s)")
    options.add_argument("--spp", type=int, default=64, help="samples per pixel (%(default)s)")
    args = options.parse_args()
    found = begin()
    scene = rt.load(args.scene)

    def ours(precision: str) -> Callable[[], Any]:
        return lambda: rt.render(scene, spp=args.spp, size=(args.size, args.size), precision=precision)

    calls: dict[str, Callable[[], Any]] = {name: ours(name) for name in ("float32", "float64")}
    peers, missing = available()
    if Mitsuba in peers:
        draw, seeds = peer_picture(scene, (args.size, args.size)), count()
        calls["Mitsuba"] = lambda: draw(args.spp, next(seeds))
        mean = [np.mean(np.asarray(calls[name]()), (0, 1)) for name in ("float32", "Mitsuba")]
        show(f"means: raytrace {mean[0]}, Mitsuba {mean[1]}\n")
    else:
        show(f"missing: Mitsuba: {missing['Mitsuba']}\n")
    seconds = interleave(calls, args.rounds)
    samples = args.size**2 * args.spp / 1e6
    ratio = {name: times_faster(seconds["float32"], times) for name, times in seconds.items()}
    table(["image", "seconds", "million samples/s", "seconds / float32"],
          ([name, float(np.median(times)), samples / float(np.median(times)), ratio[name]]
           for name, times in seconds.items()))  # fmt: skip
    stats = calls["float32"]().stats
    total = sum(stats["seconds_by_pass"].values())
    show("Seconds by pass, summed over the threads, of one image in float32:\n")
    table(["pass", "seconds", "share"], ([name, s, s / total] for name, s in stats["seconds_by_pass"].items()))
    finish(args, found, {"seconds": {name: times.tolist() for name, times in seconds.items()}, "ratio": ratio,
                         "passes": stats["seconds_by_pass"], "rays": stats["rays"]})  # fmt: skip


if __name__ == "__main__":
    main()
