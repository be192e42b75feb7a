"""How often the z-test of two images rejects images of the same scene, and how often it detects a change of brightness.

    python tests/bench/z_test.py [--pairs 200] [--scenes cornell-box,room]

Renders pairs of images of each scene with different seeds, and tests each pair. The share of rejections should be alpha
at most; and 100 % for the same pairs with one image 1 % brighter, where the noise is small enough. Prints a Markdown
table, with 95 % intervals (Wilson).
"""

import argparse
import sys
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import numpy as np

import raytrace as rt
from raytrace.image.significance import z_test

SCENES = Path(__file__).parents[2] / "scenes"
PLAN = (  # scene, integrator
    ("cornell-box", "direct"),
    ("room", "direct"),
    ("glass-sphere", "direct"),
    ("cornell-box-area", "path"),
    ("sky", "path"),
    ("veach-lights", "path"),
    ("caustic", "path"),
)
ALPHAS = 0.05, 0.01


def wilson(k, n, z=1.96):
    """95 % interval of a share."""
    p = k / n
    middle, half = p + z * z / (2 * n), z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return max((middle - half) / (1 + z * z / n), 0.0), (middle + half) / (1 + z * z / n)


def share(rejected):
    low, high = wilson(int(np.sum(rejected)), len(rejected))
    return f"{100 * np.mean(rejected):.1f} % ({100 * low:.1f} to {100 * high:.1f})"


def measure(name, integrator, sampler, spp, pairs, size):
    scene = rt.load(SCENES / f"{name}.json")
    p, brighter = [], []
    for k in range(pairs):
        a, b = (
            rt.render(scene, integrator=integrator, sampler=sampler, spp=spp, size=(size, size), seed=1000 + 2 * k + j)
            for j in range(2)
        )
        p.append(z_test(a, b).p)
        bright = SimpleNamespace(rgb=1.01 * a.rgb, var=1.01**2 * a.var)
        brighter.append(z_test(bright, b).p)
    p, brighter = np.array(p), np.array(brighter)
    cells = [f"{name}, {integrator}", sampler, str(spp), *(share(p < alpha) for alpha in ALPHAS)]
    return [*cells, f"{100 * np.mean(brighter < 0.01):.0f} %"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=200)
    parser.add_argument("--size", type=int, default=48)
    parser.add_argument("--samplers", default="sobol,independent")
    parser.add_argument("--spp", default="16,64")
    parser.add_argument("--scenes", default=",".join(name for name, _ in PLAN))
    args = parser.parse_args()
    header = ["scene", "sampler", "spp", *(f"alpha {alpha:g}" for alpha in ALPHAS), "1 % brighter, alpha 0.01"]
    sys.stdout.write("| " + " | ".join(header) + " |\n|" + "---|" * len(header) + "\n")
    chosen = [each for each in PLAN if each[0] in args.scenes.split(",")]
    spps = [int(text) for text in args.spp.split(",")]
    for (name, integrator), sampler, spp in product(chosen, args.samplers.split(","), spps):
        sys.stdout.write("| " + " | ".join(measure(name, integrator, sampler, spp, args.pairs, args.size)) + " |\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
