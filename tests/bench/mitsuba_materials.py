"""Rough conductors, rough dielectrics and plastic against Mitsuba 3: six scenes, each pixel compared by a t-test.

    python tests/bench/mitsuba_materials.py               # 3 minutes on two cores; needs mitsuba

Both tracers render each scene with several seeds. The difference of the means of a pixel, over its standard error, is
Student's t with about 2 (seeds - 1) degrees of freedom where both have the same expectation. Mitsuba's ``plastic`` has
a fit for the diffuse reflectance from inside, 0.5968 in place of 0.5963: only far more samples show the difference.
"""

import argparse
import math
import sys
from typing import Any

import mpmath
import numpy as np
from mitsuba_light import peer
from peers import mitsuba

import raytrace as rt

METAL = {"type": "conductor", "metal": "gold"}
GLASS = {"type": "dielectric", "ior": 1.5}
PLASTIC_BLUE = {"type": "plastic", "albedo": [0.1, 0.3, 0.7], "ior": 1.5}


def scene(first: dict[str, Any], second: dict[str, Any], lights: str) -> dict[str, Any]:
    """Two tilted boxes on a floor, under a lamp, an environment, or a point light."""
    lamp = {"rectangle": {}, "material": "lamp", "rotate": {"axis": [1, 0, 0], "angle": 90}, "translate": [0, 3, 0]}
    box = {"box": {}, "rotate": [{"axis": [0, 1, 0], "angle": 25}, {"axis": [1, 0, 0], "angle": 12}]}
    given = {
        "lamp": [],
        "environment": [{"type": "environment", "radiance": [0.5, 0.6, 0.8]}],
        "point": [{"type": "point", "position": [1, 3, 2], "flux": [60, 60, 60]}],
    }
    return {
        "camera": {"position": [0, 2.2, 7], "look_at": [0, 0.7, 0], "fov": 30},
        "render": {"integrator": "path", "max_depth": 12},
        "lights": given[lights],
        "materials": {
            "floor": {"type": "diffuse", "albedo": [0.5, 0.5, 0.4]},
            "lamp": {"type": "diffuse", "albedo": [0, 0, 0], "emission": [8, 7, 6]},
            "first": first,
            "second": second,
        },
        "objects": [
            {"rectangle": {}, "material": "floor", "scale": 5, "rotate": {"axis": [1, 0, 0], "angle": -90}},
            {**box, "material": "first", "scale": [0.7, 0.5, 0.5], "translate": [-0.9, 0.9, 0]},
            {**box, "material": "second", "scale": [0.5, 0.6, 0.3], "translate": [0.9, 0.9, 0.4]},
            *([lamp] if lights == "lamp" else []),
        ],
    }


SCENES = {
    "nearly smooth metal, lamp": scene(METAL | {"alpha": 0.02}, METAL | {"alpha": 0.1}, "lamp"),
    "rough metal, environment": scene(METAL | {"alpha": 0.3}, METAL | {"alpha": 1.0}, "environment"),
    "rough glass, lamp": scene(GLASS | {"alpha": 0.2}, GLASS | {"alpha": 0.6}, "lamp"),
    "rough glass, environment": scene(GLASS | {"alpha": 0.1}, GLASS | {"alpha": 1.0}, "environment"),
    "plastic, point light": scene(PLASTIC_BLUE, PLASTIC_BLUE | {"albedo": [0.9, 0.9, 0.9]}, "point"),
    "plastic and rough metal, lamp": scene(PLASTIC_BLUE, METAL | {"alpha": 0.15}, "lamp"),
}


def compare(name: str, side: int, spp: int, seeds: int) -> tuple[float, str]:
    """p-value of the largest |t| of all pixels, and a line that says how the images differ."""
    ours = rt.load(SCENES[name])
    render = peer(ours, (side, side))
    a = np.array([rt.render(ours, size=(side, side), spp=spp, seed=k).rgb for k in range(seeds)], np.float64)
    b = np.array([render(spp, 1000 + k) for k in range(seeds)])
    error = np.sqrt((a.var(axis=0, ddof=1) + b.var(axis=0, ddof=1)) / seeds)
    t = (a.mean(axis=0) - b.mean(axis=0))[error > 0] / error[error > 0]
    freedom = 2 * (seeds - 1)
    worst = float(np.abs(t).max())
    tail = float(mpmath.betainc(freedom / 2, 0.5, 0, freedom / (freedom + worst**2), regularized=True))
    mean = a.mean(axis=(1, 2, 3)), b.mean(axis=(1, 2, 3))
    relative = mean[0].mean() / mean[1].mean() - 1
    spread = math.hypot(*(x.std(ddof=1) for x in mean)) / seeds**0.5 / mean[1].mean()
    p = 1 - (1 - tail) ** len(t)  # [Sidak1967]; channels are not independent, so it is too large if anything
    expected = freedom / (freedom - 2)
    line = f"mean {relative:+.2e} +- {spread:.1e}; mean of t^2 {np.mean(t**2):.3f}, expected {expected:.3f}"
    return p, f"{name}: {line}; largest |t| {worst:.2f} of {len(t)}, p = {p:.3g}"


def main() -> int:
    """Compare all scenes; 1 if one differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=int, default=32, help="pixels along a side of the images")
    parser.add_argument("--spp", type=int, default=256, help="samples per pixel and seed")
    parser.add_argument("--seeds", type=int, default=16, help="images of each tracer")
    args = parser.parse_args()
    sys.stdout.write(f"raytrace {rt.__version__}, mitsuba {mitsuba().__version__}\n")
    found = []
    for name in SCENES:
        p, line = compare(name, args.side, args.spp, args.seeds)
        found.append(p)
        sys.stdout.write(line + "\n")
        sys.stdout.flush()
    return int(min(found) < 1e-3)


if __name__ == "__main__":
    sys.exit(main())
