"""Shipped scenes, exported to Mitsuba 3 and rendered there, against our images: t-tests of tiles.

    python tests/bench/mitsuba_export.py                  # minutes on two cores; needs mitsuba

Both render independent batches with independent samples; the variance of both between batches goes into each test.
Scenes that Mitsuba cannot express are listed with the reason. Set DRJIT_LIBLLVM_PATH to a libLLVM.
"""

import sys
from typing import Any

import numpy as np
from harness import ROOT, begin, finish, parser, show, table
from mitsuba_light import peer
from mitsuba_scenes import SIGNIFICANCE, verdict

sys.path.append(str(ROOT / "tests"))
import raytrace as rt
from light_techniques import sidak

TILE = 4  # pixels


def tiles(images: np.ndarray) -> np.ndarray:
    """Mean over tiles of images (n, h, w, 3); the sides are multiples of a tile."""
    n, height, width, _ = images.shape
    return images.reshape(n, height // TILE, TILE, width // TILE, TILE, 3).mean(axis=(2, 4))


def film(scene: rt.Scene, width: int) -> tuple[int, int]:
    """A film of this width with about the scene's shape, in whole tiles."""
    across, down = scene.settings.size
    return width, max(1, round(width * down / across / TILE)) * TILE


def exportable(names: list[str], only: str) -> tuple[dict[str, rt.Scene], list[list[str]]]:
    """Load scenes; return those that Mitsuba can express, and the reasons for the others."""
    found, others = dict[str, rt.Scene](), []
    for name in names:
        if only not in name:
            continue
        scene = rt.load(ROOT / "scenes" / name)
        try:
            peer(scene, (TILE, TILE))
        except rt.SceneError as error:
            others.append([name, "; ".join(line.split(": ", 2)[1] for line in error.problems)])
        else:
            found[name] = scene
    return found, others


def compare(scene: rt.Scene, args: Any) -> dict[str, Any]:
    """Render batches in both, and test their tiles."""
    size, seeds = film(scene, args.width), range(args.batches)
    render = peer(scene, size)
    theirs = np.array([render(args.spp, 1000 + seed) for seed in seeds])
    ours = [rt.render(scene, spp=args.spp, size=size, seed=seed, sampler="independent").rgb for seed in seeds]
    return verdict(tiles(np.array(ours, np.float64)), tiles(theirs))


def main() -> int:
    """Compare all scenes; 1 if one differs."""
    arguments = parser(__doc__ or "")
    arguments.add_argument("--batches", type=int, default=16, help="independent images of each (%(default)s)")
    arguments.add_argument("--spp", type=int, default=64, help="samples per pixel of a batch (%(default)s)")
    arguments.add_argument("--width", type=int, default=64, help="pixels of an image's width (%(default)s)")
    arguments.add_argument("--only", default="", help="scenes whose name contains this text")
    args = arguments.parse_args()
    machine = begin()
    names = sorted(path.relative_to(ROOT / "scenes").as_posix() for path in (ROOT / "scenes").rglob("*.json"))
    scenes, others = exportable(names, args.only)
    level, rows = sidak(SIGNIFICANCE, 2 * len(scenes)), []
    for name, scene in scenes.items():
        row = compare(scene, args)
        rows.append({"scene": name, **row, "holds": bool(min(row["p"], row["least p of a pixel"]) > level)})
        show(f"{name}: {row}")
    show(f"\nEach test at level {level:.2g}; least p of a tile after Sidak, over all tiles and channels")
    table(
        ["scene", "difference", "its error", "p", "least p of a tile", ""],
        (
            [row["scene"], f"{row['difference']:+.3%}", f"{row['error']:.3%}", row["p"], row["least p of a pixel"]]
            + ["" if row["holds"] else "DIFFERS"]
            for row in rows
        ),
    )
    table(["not exported", "because of"], others)
    finish(args, machine, rows)
    return 0 if all(row["holds"] for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
