"""RMSE of the samplers in path-traced images of the Cornell box with an area light."""

import argparse
import sys
from pathlib import Path

import numpy as np

import raytrace as rt

SCENE = Path(__file__).parents[2] / "scenes" / "cornell-box-area.json"


def shown(rgb: np.ndarray) -> np.ndarray:
    """SRGB, clipped to 0..1."""
    x = np.clip(rgb.astype(np.float64), 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=64, help="side of the image, pixels")
    parser.add_argument("--seeds", type=int, default=4, help="images per number")
    parser.add_argument("--spp", type=int, nargs="+", default=[4, 16, 64], help="samples per pixel")
    args = parser.parse_args()
    scene, size = rt.load(SCENE), (args.size, args.size)
    reference = np.mean([rt.render(scene, spp=2048, size=size, seed=100 + k).rgb for k in range(3)], axis=0)
    sys.stdout.write("samples per pixel | independent | stratified | sobol\n")
    for spp in args.spp:
        row = []
        for sampler in ("independent", "stratified", "sobol"):
            images = [rt.render(scene, spp=spp, size=size, seed=k, sampler=sampler).rgb for k in range(args.seeds)]
            row.append(np.sqrt(np.mean([(shown(image) - shown(reference)) ** 2 for image in images])))
        sys.stdout.write(f"{spp} | {row[0]:.4f} | {row[1]:.4f} | {row[2]:.4f}\n")


if __name__ == "__main__":
    main()
