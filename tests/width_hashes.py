"""Hashes of hits and of images, and what kernels call, as JSON: ``test_widths`` runs it once for each lane width.

``python tests/width_hashes.py`` prints them for the width that ``RAYTRACE_LANES`` sets.
"""

import hashlib
import json
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import rays
import raytrace as rt
from raytrace.accel import lanes
from raytrace.jit import PLAIN, Kernel
from raytrace.native.symbols import undefined

SCENES = sorted((Path(__file__).parents[1] / "scenes").glob("*.json"))
SAMPLERS = ("sobol", "stratified", "independent")
PRECISIONS = ("float32", "float64")

Batch = tuple[NDArray[np.floating], NDArray[np.floating]]
LIGHTS = {  # that no shipped scene has
    "camera": {"position": [0, -4, 3], "look_at": [0, 0, 0.3], "fov": 40},
    "render": {"integrator": "path", "max_depth": 6},
    "background": [0.1, 0.2, 0.3],
    "lights": [
        {"type": "spot", "position": [1, 0, 2], "look_at": [0, 0, 0], "intensity": [9, 8, 7], "cutoff": 40},
        {"type": "directional", "direction": [1, 1, -2], "irradiance": [0.5, 0.6, 0.7]},
        {"type": "point", "position": [-1, 0, 2], "flux": [30, 40, 50]},
    ],
    "materials": {
        "white": {"type": "diffuse", "albedo": [0.6, 0.6, 0.6]},
        "lamp": {"type": "diffuse", "albedo": [0.2, 0.2, 0.2], "emission": [2, 1, 1]},
        "glass": {"type": "dielectric", "ior": 1.5, "shadows": "transparent"},
    },
    "objects": [
        {"rectangle": {}, "material": "white", "scale": 2},
        {"sphere": {"center": [0, 0, 0.6], "radius": 0.5, "tolerance": 0.1}, "material": "glass"},
        {"box": {}, "material": "lamp", "scale": 0.3, "translate": [-1.2, 0.5, 0.4]},
    ],
}


def digest(arrays: Iterable[NDArray]) -> str:
    content = hashlib.sha256()
    for array in arrays:
        array = np.ascontiguousarray(array)
        content.update(f"{array.dtype} {array.shape}".encode() + array.tobytes())
    return content.hexdigest()[:16]


def camera(width: float, n: int, axis: int) -> Batch:
    """Rays of n x n pixels that look along an axis: a pencil as wide as that at its end, so bundles are, too."""
    y, x = np.mgrid[0:n, 0:n] * (width / n) - width / 2
    d = np.roll(np.stack([x, y, np.full_like(x, -4)], -1).reshape(-1, 3), axis, axis=1)
    return np.tile(np.roll([0.011, 0.007, 4.0], axis), (len(d), 1)), d


def batches(mesh: rays.Mesh, precision: str) -> Iterator[tuple[str, Batch]]:
    """Rays that go through the tree in narrow bundles, wide bundles, packets and alone; and rays aimed at edges."""
    for axis in range(3):
        yield f"narrow{axis}", camera(0.05, 41, axis)
        yield f"middling{axis}", camera(0.5, 41, axis)
        yield f"wide{axis}", camera(6.0, 41, axis)
    yield "random", rays.anywhere(3001, 17)
    yield "aimed", rays.towards([[1.7, 0.4, -2.1], [0.01, 0.02, 0.03]], rays.edge_points(mesh, precision, 18)[::3])


def of_rays() -> Iterator[tuple[str, str]]:
    """Nearest hits and occlusion, with limits too."""
    meshes = {"soup": rays.soup(700, 5), "ball": rays.icosphere(3), "cube": rays.cube()}
    for (name, mesh), precision in ((item, precision) for item in meshes.items() for precision in PRECISIONS):
        bvh = rt.BVH(*mesh, precision)
        for kind, (o, d) in batches(mesh, precision):
            ends = np.random.default_rng(19).uniform(0.2, 2.0, len(d)).astype(precision)
            answers = [bvh.any_hit(o, d), bvh.any_hit(o, d, 0.1, ends)]
            for hits in (bvh.closest_hit(o, d), bvh.closest_hit(o, d, 0.1, ends), bvh.closest_hit(o, d, -ends)):
                answers += hits
            yield f"{name} {kind} {precision}", digest(answers)
        o, d = rays.anywhere(400, 20)
        paths = [column for hits in rays.all_paths(bvh, o.astype(precision), d.astype(precision)) for column in hits]
        yield f"{name} paths {precision}", digest(paths)
        yield f"{name} points {precision}", digest(bvh.closest_point(o))


def of_images() -> Iterator[tuple[str, str]]:
    """Colours and their errors of all shipped scenes; with every sampler and some layers of one of them."""
    for path in SCENES:
        samplers = SAMPLERS if path.stem == "glass-sphere" else SAMPLERS[:1]
        for precision, sampler in ((precision, sampler) for precision in PRECISIONS for sampler in samplers):
            image = rt.render(path, spp=2, size=(36, 28), precision=precision, sampler=sampler, progress=False)
            layers = [image.aov[name] for name in ("depth", "normal")] if len(samplers) > 1 else []
            yield f"{path.stem} {sampler} {precision}", digest([image.rgb, image.stderr, *layers])
    for precision in PRECISIONS:
        image = rt.render(LIGHTS, spp=2, size=(36, 28), precision=precision, progress=False)
        yield f"lights {precision}", digest([image.rgb, image.stderr])


def of_calls() -> Iterator[tuple[str, list[str]]]:
    """Names that the machine code of each kernel so far leaves to others: those of functions that it calls."""
    modules = [module for name, module in sorted(sys.modules.items()) if name.startswith("raytrace.")]
    kernels = {id(value): value for module in modules for value in vars(module).values() if isinstance(value, Kernel)}
    for kernel in kernels.values():
        codes = [kernel.stored(kinds) for kinds in kernel.code]
        yield kernel.function.__name__, sorted({name for code in codes for name in undefined(code.data)})


if __name__ == "__main__":
    found = {"bits": lanes.BITS, "rays": dict(of_rays()), "images": dict(of_images())}
    json.dump(found | {"calls": {} if PLAIN else dict(of_calls())}, sys.stdout, indent=1)
