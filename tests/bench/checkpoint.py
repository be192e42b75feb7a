"""Measure the cost of a checkpoint: the same images with and without one, interleaved in one run."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from harness import ROOT, begin, finish, interleave, parser, show, table, times_faster

import raytrace as rt

PICTURES: dict[str, dict[str, Any]] = {
    "512 x 512, 1024 samples": {"size": (512, 512), "spp": 1024},
    "2048 x 2048, 32 samples": {"size": (2048, 2048), "spp": 32},
    "512 x 512, 16 samples": {"size": (512, 512), "spp": 16},
    "1024 x 1024, to an error of 5e-5": {"size": (1024, 1024), "target_error": 5e-5},
}


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--scene", default=ROOT / "scenes/cornell-box.json")
    args = options.parse_args()
    found = begin()
    scene, rows, results = rt.load(args.scene), [], {}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "a.checkpoint"
        for name, ask in PICTURES.items():
            sizes: list[int] = []
            calls = {"without": without(scene, ask), "kept": kept(scene, ask, file, sizes)}
            seconds = interleave(calls, args.rounds)
            more = 1 / times_faster(seconds["kept"], seconds["without"]) - 1
            rows.append([name, float(np.median(seconds["without"])), f"{more:+.1%}", f"{sizes[-1] / 1e6:.1f} MB"])
            results[name] = {each: times.tolist() for each, times in seconds.items()} | {"bytes": sizes[-1]}
    table(["image", "seconds without", "additional with", "file"], rows)
    show("A checkpoint that isn't asked for keeps nothing of the first ten seconds of drawing.")
    finish(args, found, results)


def without(scene: rt.Scene, ask: dict[str, Any]) -> Callable[[], Any]:
    return lambda: rt.render(scene, **ask)


def kept(scene: rt.Scene, ask: dict[str, Any], file: Path, sizes: list[int]) -> Callable[[], Any]:
    def draw() -> None:
        rt.render(scene, checkpoint=file, **ask)
        sizes.append(file.stat().st_size)
        file.unlink()

    return draw


if __name__ == "__main__":
    main()
