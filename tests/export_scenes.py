"""Small scenes for the tests of exports: each kind of material, light, texture and camera, with values to look for."""

import json
from pathlib import Path
from typing import Any

import numpy as np

import raytrace as rt
from raytrace.exporting.images import exr_bytes
from raytrace.image import png

SIZE = (12, 8)
CAMERA = {"position": [1, 2, 6], "look_at": [0.25, 0.5, -1], "up": [0.1, 1, 0], "fov": 35}
LENS = CAMERA | {"aperture": 0.05, "focus": 4.5}
PARALLEL = {"type": "orthographic", "position": [1, 2, 6], "look_at": [0.25, 0.5, -1], "height": 3}
PIXELS = np.random.default_rng(7).integers(0, 256, (3, 4, 3), np.uint8)  # row 0 at the top
SKY = np.random.default_rng(8).uniform(0.2, 2.0, (6, 12, 3)).astype(np.float32)
TURN = {"axis": [1, 2, -1], "angle": 50}
WHITE = {"type": "diffuse", "albedo": [0.7, 0.6, 0.5]}
LAMP = {"type": "diffuse", "albedo": [0, 0, 0], "emission": [3, 2, 1]}
CHECKS = {"checkerboard": [[0.9, 0.8, 0.7], [0.1, 0.2, 0.3]], "scale": [4, 6]}
IMAGE = {"image": "wood.png", "scale": [2, 3]}

POINT = {"type": "point", "position": [1, 4, 2], "flux": [40, 30, 20]}
SPOT = {"type": "spot", "position": [0, 3, 1], "look_at": [1, 0, 0], "intensity": [9, 8, 7], "cutoff": 40, "beam": 25}
SUN = {"type": "directional", "direction": [1, -3, 2], "irradiance": [1.5, 1.25, 1]}
SKY_LIGHT = {"type": "environment", "image": "sky.exr", "scale": 0.5, "rotate": TURN}
EVEN = {"type": "environment", "radiance": [0.5, 0.75, 1]}


def made(folder: Path, materials: dict[str, Any], **changes: Any) -> rt.Scene:
    """A scene with one rectangle per material, side by side, and the images beside it; changed keys."""
    folder.mkdir(exist_ok=True)
    (folder / "wood.png").write_bytes(png.encode(PIXELS, {}))
    (folder / "sky.exr").write_bytes(exr_bytes(SKY))
    objects = [{"rectangle": {}, "material": name, "translate": [3 * k, 0, 0]} for k, name in enumerate(materials)]
    content = {
        "camera": CAMERA,
        "film": {"size": list(SIZE)},
        "render": {"integrator": "path", "max_depth": 7, "spp": 9},
        "materials": materials,
        "objects": objects,
    }
    path = folder / "small.json"
    path.write_text(json.dumps(content | changes))
    return rt.load(path)


def looked_up(directions: np.ndarray) -> np.ndarray:
    """Radiance of `SKY_LIGHT` in world directions (n, 3), by the definition of the scene format."""
    axis = np.array(TURN["axis"]) / np.linalg.norm(TURN["axis"])
    cos, sin = np.cos(np.radians(-TURN["angle"])), np.sin(np.radians(-TURN["angle"]))  # back to the image
    along = (directions @ axis)[:, None] * axis
    d = along + cos * (directions - along) + sin * np.cross(axis, directions)
    height, width = SKY.shape[:2]
    x = (np.arctan2(d[:, 0], -d[:, 2]) / (2 * np.pi) % 1) * width - 0.5
    y = np.clip(np.arccos(d[:, 1]) / np.pi * height - 0.5, 0, height - 1)
    return 0.5 * bilinear(SKY, x, y)


def bilinear(texels: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Bilinear values at texel coordinates; columns wrap, rows are clamped."""
    height, width = texels.shape[:2]
    i, j = np.floor(x).astype(int), np.floor(y).astype(int)
    total = np.zeros((len(x), 3))
    for a, b in ((0, 0), (1, 0), (0, 1), (1, 1)):
        weight = np.where(a, x - i, 1 - (x - i)) * np.where(b, y - j, 1 - (y - j))
        total += weight[:, None] * texels[np.clip(j + b, 0, height - 1), (i + a) % width]
    return total


def directions(count: int) -> np.ndarray:
    """Random unit directions (count, 3)."""
    d = np.random.default_rng(9).normal(size=(count, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def triangles(data: bytes, folder: Path) -> np.ndarray:
    """Corners (m, 3, 3) of the triangles of a PLY file, as our reader has them."""
    (folder / "part.ply").write_bytes(data)
    content = {"camera": CAMERA, "materials": {"white": WHITE}, "objects": [{"mesh": "part.ply", "material": "white"}]}
    (folder / "part.json").write_text(json.dumps(content))
    mesh = rt.load(folder / "part.json").mesh
    return mesh.vertices[mesh.faces]
