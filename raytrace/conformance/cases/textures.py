"""Textures on a plane that faces the camera: images, checkerboards, and their orientation."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from raytrace.conformance.case import Case, Cause, Colour, Region, environment, orthographic, scene
from raytrace.image import png
from raytrace.image.files import srgb_decode

LEVEL = 0.9  # radiance of the environment
CODES = np.array(  # of the texels, row 0 at the top: no symmetry
    [[[250, 120, 130], [140, 250, 120], [130, 140, 250]], [[220, 220, 110], [110, 220, 220], [220, 110, 200]]], np.uint8
)
SIZE = 24, 16
ENVIRONMENT = [environment(LEVEL)]


def cases() -> Iterator[Case]:
    """Yield the cases."""
    yield _image("srgb", {}, srgb_decode(CODES / 255.0))
    yield _image("linear", {"encoding": "linear"}, CODES / 255.0)
    yield _checkerboard()


def _plane(albedo: Any) -> dict[str, Any]:
    """An orthographic view of a rectangle of 3 x 2, and nothing else."""
    camera = orthographic([0, 0, 5], [0, 0, 0], 2.0)
    shape = {"rectangle": {}, "scale": [1.5, 1, 1]}
    return scene(camera, [(shape, {"type": "diffuse", "albedo": albedo})], ENVIRONMENT, depth=1, size=SIZE)


def _regions(values: np.ndarray) -> tuple[Region, ...]:
    """One region for each of 2 x 3 squares of 8 pixels."""
    found = []
    for row in range(2):
        for column in range(3):
            x, y = 8 * column, 8 * row
            colour: Colour = tuple(LEVEL * float(c) for c in values[row, column])  # type: ignore[assignment]
            found.append(Region(f"row {row}, column {column}", (x + 1, y + 1, x + 7, y + 7), colour))
    return tuple(found)


def _colours(values: np.ndarray) -> tuple[Colour, ...]:
    return tuple(region.expected for region in _regions(values))


def _image(name: str, how: dict[str, Any], values: np.ndarray) -> Case:
    file = f"texture-{name}.png"
    other = CODES / 255.0 if name == "srgb" else srgb_decode(CODES / 255.0)
    text = "the texture is not decoded from sRGB" if name == "srgb" else "the linear texture is decoded as sRGB"
    wrong = [
        (text, other),
        ("the texture is upside down: v = 0 is the bottom row", values[::-1]),
        ("the texture is mirrored: u = 0 is the left column", values[:, ::-1]),
        ("the texture is turned by 180 degrees", values[::-1, ::-1]),
    ]
    return Case(
        f"texture-{name}",
        f"Six texels of an image with {'sRGB' if name == 'srgb' else 'linear'} codes, on a plane in even light.",
        _plane({"image": file, "filter": "nearest", **how}),
        _regions(values),
        tuple(Cause(about, _colours(each)) for about, each in wrong),
        "texture",
        samples=1024,
        files={file: png.encode(CODES, {})},
    )


def _checkerboard() -> Case:
    a, b = np.array([0.8, 0.4, 0.3]), np.array([0.2, 0.5, 0.7])
    even = np.array([[(row + column) % 2 == 1 for column in range(3)] for row in range(2)])  # row 0 is the upper one
    values, swapped = (np.where((even ^ flip)[..., None], b, a) for flip in (True, False))
    board = {"checkerboard": [a.tolist(), b.tolist()], "scale": [3, 2]}
    return Case(
        "checkerboard",
        "A checkerboard of three by two squares on a plane in even light.",
        _plane(board),
        _regions(values),
        (Cause("the colours are swapped, or v runs down", _colours(swapped)),),
        "texture",
        samples=1024,
    )
