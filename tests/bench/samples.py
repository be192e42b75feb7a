"""Experiments with samples on the Cornell box: several nets, one net for neighbours, and known edges."""

import sys
from collections import defaultdict
from collections.abc import Callable
from itertools import permutations
from typing import Any

import numpy as np
from harness import ROOT, begin, finish, parser, show, table

import raytrace as rt
from raytrace.image.metrics import screen
from raytrace.passes.camera import make_view

sys.path.append(str(ROOT / "tests"))
import naive_sampling as points

COUNTS = 4, 16, 64  # samples per pixel
BLURS = 1, 2, 4  # pixels: standard deviation of the Gaussian blur before the error is measured
GRID = 192  # points along the side of a pixel, by which the areas of its regions are measured


class Box:
    """The box with one light and no glass, shaded by ``rt.BVH`` at any film position."""

    def __init__(self, side: int) -> None:
        self.scene, self.side = rt.load(ROOT / "scenes/cornell-box.json"), side
        self.bvh = rt.BVH(self.scene.mesh.vertices, self.scene.mesh.faces, "float64")
        self.view = make_view(self.scene.camera, (side, side), np.dtype(np.float64))
        self.albedo = self.scene.materials.albedo[self.scene.mesh.material_id]
        self.light, self.flux = self.scene.lights.position[0], self.scene.lights.flux[0]

    def shade(self, film: np.ndarray) -> np.ndarray:
        """Radiance (..., 3) at film positions (..., 2), pixels."""
        q = film.reshape(-1, 2) - self.view.centre
        d = self.view.forward + q[:, :1] * self.view.right + q[:, 1:] * self.view.down
        hits = self.bvh.closest_hit(self.scene.camera.position, d)
        surface = self.bvh.surface(hits)
        away = self.light - surface.p
        height = (surface.ng * away).sum(axis=1)
        lit = np.flatnonzero((hits.prim_id >= 0) & ((surface.ng * d).sum(axis=1) < 0) & (height > 0))
        o = rt.spawn_ray(surface.p[lit], surface.p_error[lit], surface.ng[lit], away[lit])
        lit = lit[~self.bvh.any_hit(o, self.light - o, tmax=1 - 1e-9)]
        square = (away[lit] ** 2).sum(axis=1)
        radiance = np.zeros((len(q), 3))
        irradiance = height[lit] / np.sqrt(square) / (4 * np.pi * square)
        radiance[lit] = self.albedo[hits.prim_id[lit]] / np.pi * irradiance[:, None] * self.flux
        return radiance.reshape(*film.shape[:-1], 3)

    def truth(self) -> np.ndarray:
        ask = {"spp": 4096, "size": (self.side, self.side), "precision": "float64"}
        return screen(np.mean([rt.render(self.scene, seed=10**6 + k, **ask).rgb.astype(float) for k in (0, 1)], axis=0))


# --- mirrored pairs --------------------------------------------------------------------------------------------------


def apart(side: int, seed: int, spp: int) -> np.ndarray:
    """Return the samples of ``sobol``: pixels are independent."""
    return points.film_points("sobol", seed, spp, (0, 0, side, side))


def unmirrored(side: int, seed: int, spp: int) -> np.ndarray:
    """Return the same points, scrambled in the usual way, without mirrored pairs."""
    y, x, sample = np.meshgrid(*(np.arange(n, dtype=np.uint64) for n in (side, side, spp)), indexing="ij")
    bits = [points.owen_scramble(points.sobol_raw(sample, dim), points.key(seed, x, y, dim)) for dim in (0, 1)]
    return np.stack([x + points.to_unit(bits[0]), y + points.to_unit(bits[1])], axis=-1)


def compare_pairs(box: Box, truth: np.ndarray, seeds: int) -> list[dict[str, Any]]:
    """Return the RMSE on a screen of all pixels, and of the half with the smaller errors."""
    rows = []
    for spp in COUNTS:
        for name, way in (("mirrored", apart), ("unmirrored", unmirrored)):
            off = [screen(box.shade(way(box.side, seed, spp)).mean(axis=2)) - truth for seed in range(seeds)]
            squares = np.sort(np.mean(np.square(off), axis=(0, 3)).ravel())
            rmse = [float(np.sqrt(part.mean())) for part in (squares, squares[: squares.size // 2])]
            rows.append({"spp": spp, "pairs": name, "RMSE": rmse[0], "of the better half": rmse[1]})
    return rows


# --- several nets for a pixel ----------------------------------------------------------------------------------------


def compare_several(box: Box, truth: np.ndarray, seeds: int) -> list[dict[str, Any]]:
    """Return the RMSE on a screen of the mean of several nets, relative to one net with the same number of samples."""
    rows = []
    for nets in (1, 2, 4, 8):
        row: dict[str, Any] = {"nets": nets}
        for spp in (16, 64, 256):
            squares = []
            for seed in range(seeds):
                ask = {"spp": spp // nets, "size": (box.side, box.side)}
                parts = [rt.render(box.scene, seed=nets * seed + k, **ask).rgb.astype(float) for k in range(nets)]
                squares.append(np.mean((screen(np.mean(parts, axis=0)) - truth) ** 2))
            row[f"{spp} spp"] = float(np.sqrt(np.mean(squares)))
        rows.append(row)
    return [{name: row[name] if name == "nets" else row[name] / rows[0][name] for name in row} for row in rows]


# --- one net for neighbours ------------------------------------------------------------------------------------------


def of_one_net(side: int, seed: int, spp: int) -> np.ndarray:
    """Return samples of one net for all pixels, along a scrambled Z curve: blue-noise error [Ahmed2020]."""
    y, x = np.meshgrid(*[np.arange(side, dtype=np.uint64)] * 2, indexing="ij")
    order, path = np.zeros((2, side, side), np.uint64)
    shuffles = np.array(list(permutations(range(4))), np.uint64)
    for bit in range(int(side - 1).bit_length() - 1, -1, -1):
        child = (x >> np.uint64(bit) & np.uint64(1)) | (y >> np.uint64(bit) & np.uint64(1)) << np.uint64(1)
        shuffle = points.mix(points.mix(path & np.uint64(points.MASK)) + np.uint64(977 * seed + bit)) % np.uint64(24)
        order = order * np.uint64(4) + shuffles[shuffle.astype(int), child.astype(int)]
        path = path * np.uint64(4) + child + np.uint64(1)
    return _in_pixels(order[..., None] * np.uint64(spp) + np.arange(spp, dtype=np.uint64), seed)


def alike(side: int, seed: int, spp: int) -> np.ndarray:
    """Return the same samples for every pixel."""
    return _in_pixels(np.arange(spp, dtype=np.uint64) + np.zeros((side, side, 1), np.uint64), seed)


def _in_pixels(sample: np.ndarray, seed: int) -> np.ndarray:
    keys = [np.uint64(points.key(seed, 0, 0, dim)) for dim in (0, 1)]
    place = [points.to_unit(points.owen_scramble(points.sobol_raw(sample, dim), key)) for dim, key in enumerate(keys)]
    corner = np.stack(np.meshgrid(*[np.arange(len(sample))] * 2), axis=-1)
    return corner[:, :, None] + np.stack(place, axis=-1)


def compare_nets(box: Box, truth: np.ndarray, seeds: int) -> list[dict[str, Any]]:
    """Return the RMSE on a screen, before and after blurs."""
    from scipy.ndimage import gaussian_filter

    rows = []
    ways: dict[str, Callable[[int, int, int], np.ndarray]] = {"apart": apart, "of one net": of_one_net, "alike": alike}
    for spp in COUNTS[:2]:
        for name, way in ways.items():
            off = [screen(box.shade(way(box.side, seed, spp)).mean(axis=2)) - truth for seed in range(seeds)]
            squares = [np.mean(np.square(off))]
            squares += [np.mean([gaussian_filter(d, (blur, blur, 0)) ** 2 for d in off]) for blur in BLURS]
            names = ["RMSE", *(f"after a blur of {blur}" for blur in BLURS)]
            rows.append({"spp": spp, "samples": name} | dict(zip(names, np.sqrt(squares).tolist(), strict=True)))
    return rows


# --- edges whose places are known ------------------------------------------------------------------------------------


def lines(box: Box) -> list[np.ndarray]:
    """Return edges of the box on the film, (2, 2) each, and edges of the shadows they might cast on any triangle."""
    mesh = box.scene.mesh
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    owners = defaultdict(list)
    for face, triangle in enumerate(corners.round(9).tolist()):
        for k in range(3):
            owners[tuple(sorted((tuple(triangle[k]), tuple(triangle[k - 1]))))].append(face)
    flat = [e for e, f in owners.items() if len(f) == 2 and abs(normals[f[0]] @ normals[f[1]]) > 1 - 1e-9]
    edges = [np.array(edge) for edge in owners if edge not in flat]
    found = list(edges)
    with np.errstate(divide="ignore", invalid="ignore"):
        for edge in edges:
            for triangle, normal in zip(corners, normals, strict=True):
                t = (triangle[0] - box.light) @ normal / ((edge - box.light) @ normal)
                if (t > 1 - 1e-6).all() and np.isfinite(t).all():
                    found.append(box.light + t[:, None] * (edge - box.light))
    d = np.array(found) - box.scene.camera.position
    depth = d @ box.view.forward
    across = [d @ v / (v @ v) / depth for v in (box.view.right, box.view.down)]
    return [line for line, z in zip(np.stack(across, -1) + box.view.centre, depth, strict=True) if (z > 0).all()]


def crossed(found: list[np.ndarray], side: int) -> dict[tuple[int, int], list[np.ndarray]]:
    """Return the lines that may cross each pixel (row, column)."""
    pixels = defaultdict(list)
    for line in found:
        steps = np.linspace(0, 1, int(4 * np.linalg.norm(line[1] - line[0])) + 2)[:, None]
        for x, y in set(map(tuple, np.floor(line[0] + steps * (line[1] - line[0])).astype(int).tolist())):
            if 0 <= x < side and 0 <= y < side:
                pixels[y, x].append(line)
    return pixels


def part_of(film: np.ndarray, cuts: list[np.ndarray]) -> np.ndarray:
    """Return the number of the region of each point (n, 2): lines divide the plane into regions."""
    number = np.zeros(len(film), np.int64)
    for (x, y), end in cuts:
        number = 2 * number + ((film[:, 0] - x) * (end[1] - y) > (film[:, 1] - y) * (end[0] - x))
    return number


def compare_edges(box: Box, truth: np.ndarray, seeds: int) -> tuple[list[dict[str, Any]], dict[str, float]]:
    """Return the RMSE on a screen with equal weights, and with each region of a pixel weighted by its exact area."""
    found = lines(box)
    pixels = crossed(found, box.side)
    grid = np.stack(np.meshgrid(*[(np.arange(GRID) + 0.5) / GRID] * 2), axis=-1).reshape(-1, 2)
    areas = {}
    for at, cuts in pixels.items():
        parts, counts = np.unique(part_of(grid + at[::-1], cuts), return_counts=True)
        areas[at] = dict(zip(parts.tolist(), (counts / len(grid)).tolist(), strict=True))
    rows = []
    for spp in COUNTS:
        squares = []
        for seed in range(seeds):
            film = apart(box.side, seed, spp)
            radiance = box.shade(film)
            plain = radiance.mean(axis=2)
            better = plain.copy()
            for at, cuts in pixels.items():
                parts, part, counts = np.unique(part_of(film[at], cuts), return_inverse=True, return_counts=True)
                share = (np.array([areas[at].get(number, 0.0) for number in parts.tolist()]) / counts)[part]
                better[at] = share @ radiance[at] / share.sum()
            squares.append([np.mean((screen(picture) - truth) ** 2) for picture in (plain, better)])
        rmse = np.sqrt(np.mean(squares, axis=0)).tolist()
        rows.append({"spp": spp, "RMSE": rmse[0], "by areas": rmse[1], "ratio": rmse[0] / rmse[1]})
    about = {
        "lines": len(found),
        "pixels": len(pixels),
        "lines a pixel": float(np.mean([len(c) for c in pixels.values()])),
    }
    return rows, about


def main() -> None:
    options = parser(__doc__, rounds=6)
    options.add_argument("--size", type=int, default=128, help="pixels: side of the film, a power of two (%(default)s)")
    args = options.parse_args()
    found, box = begin(), Box(args.size)
    truth = box.truth()
    pairs = compare_pairs(box, truth, args.rounds)
    show("Mirrored pairs: RMSE on a screen, of all pixels and of the half with the smaller errors:\n")
    table(list(pairs[0]), (list(row.values()) for row in pairs))
    several = compare_several(box, truth, args.rounds)
    show("Several nets per pixel instead of one: RMSE on a screen, relative to one net:\n")
    table(list(several[0]), (list(row.values()) for row in several))
    nets = compare_nets(box, truth, args.rounds)
    show("Samples of neighbours: RMSE on a screen, and after Gaussian blurs (pixels):\n")
    table(list(nets[0]), (list(row.values()) for row in nets))
    edges, about = compare_edges(box, truth, args.rounds)
    show(f"Regions of pixels weighted by their exact areas; {about}:\n")
    table(list(edges[0]), (list(row.values()) for row in edges))
    finish(args, found, {"pairs": pairs, "several": several, "nets": nets, "edges": edges, "lines": about})


if __name__ == "__main__":
    main()
