"""Textures, environment images, rough surfaces, plastic, lenses: twelve scenes against Mitsuba 3, by t-tests.

    python tests/bench/mitsuba_appearance.py              # 3 minutes on two cores; needs mitsuba

Both render independent batches with independent samples. Set DRJIT_LIBLLVM_PATH to a libLLVM. Rows of Mitsuba's
environment images lie at v = j / (h - 1), ours at (j + 1/2) / h: Mitsuba gets 2 h + 1 rows, which have the same
interpolated radiance everywhere. Scenes of this repository lose their smooth normals and get a box filter.
"""

import itertools
import json
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from harness import ROOT, begin, interleave, parser, table
from mitsuba_light import peer

sys.path.append(str(ROOT / "tests"))
from mitsuba_scenes import compare_scenes

import raytrace as rt
from raytrace.texture_records import BILINEAR, EnvironmentImage, Texture

TIMED_SPP = 16
GOLD = {"type": "conductor", "metal": "gold"}
GLASS = {"type": "dielectric", "ior": 1.5}
GLAZE = {"type": "plastic", "albedo": [0.1, 0.3, 0.7], "ior": 1.5}
GREY = {"type": "diffuse", "albedo": [0.5, 0.5, 0.4]}
SKY = {"type": "environment", "radiance": [0.5, 0.6, 0.8]}
TURN = {"axis": [1, 2, -0.5], "angle": 70}
CAMERA = {"position": [0, 2.2, 7], "look_at": [0, 0.7, 0], "fov": 30}
LENS = {"aperture": 1.0, "focus": 5.0}
ORTHOGRAPHIC = {"type": "orthographic", "position": [3, 2.2, 7], "look_at": [0, 0.7, 0], "height": 3.7}


def boxes(
    first: dict[str, Any], second: dict[str, Any], camera: dict[str, Any] | None = None, **render: Any
) -> dict[str, Any]:
    """Two tilted boxes on a floor."""
    box = {"box": {}, "rotate": [{"axis": [0, 1, 0], "angle": 25}, {"axis": [1, 0, 0], "angle": 12}]}
    return {
        "camera": camera or CAMERA,
        "render": {"integrator": "path", "max_depth": 8, **render},
        "lights": [SKY],
        "materials": {"floor": GREY, "first": first, "second": second},
        "objects": [
            {"rectangle": {}, "material": "floor", "scale": 5, "rotate": {"axis": [1, 0, 0], "angle": -90}},
            {**box, "material": "first", "scale": [0.7, 0.5, 0.5], "translate": [-0.9, 0.9, 0]},
            {**box, "material": "second", "scale": [0.5, 0.6, 0.3], "translate": [0.9, 0.9, 0.4]},
        ],
    }


def sky(given: dict[str, Any], shape: tuple[int, int], seed: int, sun: tuple[int, int] | None = None) -> rt.Scene:
    """A scene under an image of random texels, one of them far brighter where there is a sun."""
    texels = np.random.default_rng(seed).uniform(0.1, 0.9, (*shape, 3)).astype(np.float32)
    if sun is not None:
        texels[sun] = 300.0
    turn = rt.load(given | {"objects": [{"rectangle": {}, "material": "floor", "rotate": TURN}]}).mesh
    x, y = turn.vertices[1] - turn.vertices[0], turn.vertices[3] - turn.vertices[0]
    x, y = (each / np.linalg.norm(each) for each in (x, y))
    scene = rt.load(given)
    made = Texture(BILINEAR, np.ascontiguousarray(texels[::-1]), None, (1.0, 1.0), texels.mean((0, 1)))
    image = EnvironmentImage(made, 0.8, np.stack([x, y, np.cross(x, y)], axis=1))
    return scene.__class__(**{**scene.__dict__, "lights": scene.lights._replace(image=image)})


def shipped(name: str) -> rt.Scene:
    """A scene of this repository without smooth normals, with a box filter."""
    path = ROOT / "scenes" / name
    given = json.loads(path.read_text())
    given["film"].pop("filter", None)
    for each in given["objects"]:
        each.pop("normals", None)
    flat = path.with_name(f"flat-{name}")
    try:
        flat.write_text(json.dumps(given))
        return rt.load(flat)
    finally:
        flat.unlink()


def nested() -> rt.Scene:
    """Rough glass in rough glass, under a lamp; ``ior`` is inside over outside at each surface."""
    given = boxes(GLASS | {"alpha": 0.15}, {"type": "dielectric", "ior": 1.2, "alpha": 0.4}, max_depth=12)
    given["lights"] = []
    given["objects"][2] |= {"scale": [0.3, 0.2, 0.2], "translate": [-0.9, 0.9, 0]}
    given["materials"]["lamp"] = {"type": "diffuse", "albedo": [0, 0, 0], "emission": [8, 7, 6]}
    turn = {"axis": [1, 0, 0], "angle": 90}
    given["objects"].append({"rectangle": {}, "material": "lamp", "rotate": turn, "translate": [0, 3, 0]})
    return rt.load(given)


SCENES = {
    "image, diffuse and mirror": lambda: sky(boxes(GREY, {"type": "mirror", "reflectance": [1, 1, 1]}), (6, 11), 1),
    "image, rough metal and plastic": lambda: sky(boxes(GOLD | {"alpha": 0.2}, GLAZE), (5, 8), 2),
    "image, rough glass": lambda: sky(boxes(GLASS | {"alpha": 0.1}, GLASS | {"alpha": 0.5}), (4, 4), 3),
    "rough glass in rough glass": nested,
    "nearly smooth, nearly no glass": lambda: sky(
        boxes(GLASS | {"ior": 1.01, "alpha": 0.002}, GOLD | {"alpha": 0.002}), (6, 9), 5
    ),
    "image with a sun": lambda: sky(boxes(GREY, GOLD | {"alpha": 0.3}), (16, 32), 4, (3, 0)),
    "thin lens": lambda: rt.load(boxes(GREY, GLAZE, CAMERA | LENS)),
    "orthographic": lambda: rt.load(boxes(GLASS, GOLD | {"alpha": 0.05}, ORTHOGRAPHIC)),
    "textures.json": lambda: shipped("textures.json"),
    "sky-image.json": lambda: shipped("sky-image.json"),
    "lens.json": lambda: shipped("lens.json"),
    "still-life.json": lambda: shipped("still-life.json"),
}


def time_samples(rounds: int) -> None:
    """Print nanoseconds per sample of three shipped scenes, two threads each, interleaved, and the ratio."""
    rows = []
    for name in ("textures.json", "lens.json", "sky-image.json"):
        scene = shipped(name)
        width, height = scene.settings.size
        size, seeds = (width // 2, height // 2), itertools.count()
        draw, samples = peer(scene, size), width // 2 * (height // 2) * TIMED_SPP
        calls: dict[str, Callable[[], Any]] = {
            "ours": lambda scene=scene, size=size, seeds=seeds: rt.render(
                scene, spp=TIMED_SPP, size=size, seed=next(seeds), threads=2
            ),
            "Mitsuba": lambda draw=draw, seeds=seeds: draw(TIMED_SPP, next(seeds)),
        }
        for call in calls.values():
            call()
        seconds = interleave(calls, rounds)
        ratios = np.sort(seconds["Mitsuba"] / seconds["ours"])
        spread = f"{np.median(ratios):.2f} [{ratios[0]:.2f}, {ratios[-1]:.2f}]"
        rows.append([name, *(float(np.median(times)) / samples * 1e9 for times in seconds.values()), spread])
    table(["scene", "ours, ns per sample", "Mitsuba", "Mitsuba / ours [least, most]"], rows)


def main() -> int:
    """Compare all scenes; 1 if one differs."""
    arguments = parser(__doc__ or "")
    arguments.add_argument("--batches", type=int, default=16, help="independent images of each (%(default)s)")
    arguments.add_argument("--spp", type=int, default=256, help="samples per pixel of a batch (%(default)s)")
    arguments.add_argument("--only", default="", help="scenes whose name contains this text")
    arguments.add_argument("--time", action="store_true", help="only time per sample, of three scenes")
    args = arguments.parse_args()
    if args.time:
        begin()
        time_samples(args.rounds)
        return 0
    return compare_scenes(args, SCENES, (24, 16))


if __name__ == "__main__":
    sys.exit(main())
