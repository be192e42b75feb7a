"""The conformance suite in Mitsuba 3: renders what the export can express, and judges it.

    DRJIT_LIBLLVM_PATH=... python tests/bench/conformance_mitsuba.py -o results.json

needs the extra ``bench``. With --renderer raytrace or textbook, these render the suite instead.
"""

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from harness import begin, finish, parser, show

import raytrace as rt
from raytrace.conformance.judging import judge, read_answers
from raytrace.conformance.page import text, write_judgement
from raytrace.conformance.writing import write_suite
from raytrace.image.files import save

MOST_TRIANGLES = 10_000  # for the textbook


def mitsuba_images(suite: Path, images: Path, seeds: int, variant: str) -> None:
    """Render the exported scenes, with several seeds."""
    import mitsuba

    mitsuba.set_variant(variant)
    for scene in read_answers(suite):
        files = list((suite / "mitsuba" / scene["name"]).glob("*.xml"))
        if not files:
            continue
        loaded = mitsuba.load_file(str(files[0]))
        for seed in range(seeds):
            image = np.array(mitsuba.render(loaded, spp=scene["samples"], seed=seed))[..., :3]
            save(images / f"{scene['name']}-{seed + 1}.exr", image)


def textbook_images(suite: Path, images: Path, most: int) -> None:
    """Render the scenes that raytrace.textbook has, with fewer samples: it takes one ray at a time through its tree."""
    for scene in read_answers(suite):
        path = suite / f"{scene['name']}.json"
        if len(rt.load(path).mesh.faces) > MOST_TRIANGLES:
            continue
        try:
            image = rt.textbook.render(path, spp=min(most, scene["samples"]))
        except rt.OptionError as error:
            show(f"{scene['name']}: {error}")
            continue
        save(images / f"{scene['name']}.npz", image)


def our_images(suite: Path, images: Path, seeds: int) -> None:
    """Render the scenes with raytrace, with several seeds."""
    for scene in read_answers(suite):
        loaded = rt.load(suite / f"{scene['name']}.json")
        for seed in range(seeds):
            rt.render(loaded, seed=seed).save(images / f"{scene['name']}-{seed + 1}.exr")


def main() -> int:
    arguments = parser(__doc__ or "")
    arguments.add_argument("--seeds", type=int, default=4, help="images per scene (%(default)s)")
    arguments.add_argument("--variant", default="llvm_ad_rgb", help="of Mitsuba (%(default)s)")
    arguments.add_argument("--renderer", default="mitsuba", choices=["mitsuba", "raytrace", "textbook"])
    arguments.add_argument("--spp", type=int, default=64, help="most samples of the textbook (%(default)s)")
    arguments.add_argument("--keep", type=Path, metavar="DIR", help="folder for the suite, the images and the page")
    args = arguments.parse_args()
    found = begin()
    with tempfile.TemporaryDirectory() as name:
        folder = args.keep or Path(name)
        suite, images = folder / "suite", folder / "images"
        write_suite(suite)
        images.mkdir(exist_ok=True)
        began = time.perf_counter()
        if args.renderer == "raytrace":
            our_images(suite, images, args.seeds)
        elif args.renderer == "textbook":
            textbook_images(suite, images, args.spp)
        else:
            mitsuba_images(suite, images, args.seeds, args.variant)
        show(f"rendered in {time.perf_counter() - began:.0f} s")
        judgement = judge(suite, images)
        write_judgement(judgement, images, folder)
    show(text(judgement))
    rows: list[dict[str, Any]] = [
        {"scene": scene.name, "verdict": scene.verdict, "error": scene.worst.error if scene.worst else None}
        for scene in judgement.scenes
    ]
    finish(args, found, {"scenes": rows})
    return 0 if judgement.ok else 1


if __name__ == "__main__":
    sys.exit(main())
