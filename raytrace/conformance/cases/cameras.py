"""Cameras: where the pixels of pinhole and orthographic cameras are, and the blur of a lens."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from raytrace.conformance.case import Case, Cause, Colour, Region, diffuse, grey, orthographic, scene, view
from raytrace.conformance.formulas import blurred_edge

SIZE = 48, 32
COLOURS: dict[str, Colour] = {
    "upper left": (0.8, 0.2, 0.3),
    "upper right": (0.3, 0.8, 0.2),
    "lower left": (0.2, 0.3, 0.8),
    "lower right": (0.7, 0.7, 0.2),
}
EDGES = 3.75, 2.75, 42.5, 28.5  # pixels of the film where the four squares end: left, top, right, bottom
SHIFTS = {  # shares of the pixels at the edges that are covered: left, top, right, bottom
    "the image is half a pixel too far to the right": (0.0, 0.25, 1.0, 0.5),
    "the image is half a pixel too far to the left": (0.75, 0.25, 0.0, 0.5),
    "the image is half a pixel too low": (0.25, 0.0, 0.5, 1.0),
    "the image is half a pixel too high": (0.25, 0.75, 0.5, 0.0),
    "the image is half a pixel too far to the left and too high": (0.75, 0.75, 0.0, 0.0),
    "the image is half a pixel too far to the right and too low, or all samples are at the centres of pixels": (
        0.0,
        0.0,
        1.0,
        1.0,
    ),
}
SOFT = 0.1  # tolerance of single columns, whose pixels are black or bright by chance


def cases() -> Iterator[Case]:
    """Yield the cases."""
    pinhole = view([0, 0, 0], [0, 0, -1], 2 * math.degrees(math.atan(0.5)))
    yield _film("pinhole", "pinhole", {**pinhole, "up": [0, 1, 0]}, 1.0)
    yield _film("orthographic", "orthographic", orthographic([0, 0, 0], [0, 0, -1], 1.0), 1.0)
    yield _lens()


def _film(name: str, kind: str, camera: dict[str, Any], extent: float) -> Case:
    """Four squares of colour in the plane z = -1, where a pixel is 1 / 32 wide."""
    pixel, (width, height) = extent / SIZE[1], SIZE
    left, top, right, bottom = EDGES
    spans = {"left": (left, 24.0), "right": (24.0, right)}, {"upper": (top, 16.0), "lower": (16.0, bottom)}
    objects = []
    for text, colour in COLOURS.items():
        row, column = text.split()
        (x0, x1), (y0, y1) = spans[0][column], spans[1][row]
        shape = {"rectangle": {}, "scale": [(x1 - x0) / 2 * pixel, (y1 - y0) / 2 * pixel, 1]}
        shape["translate"] = [((x0 + x1) / 2 - width / 2) * pixel, (height / 2 - (y0 + y1) / 2) * pixel, -1]
        objects.append((shape, {"type": "diffuse", "albedo": [0, 0, 0], "emission": list(colour)}))
    boxes = {"upper left": (6, 5, 22, 14), "upper right": (26, 5, 40, 14)}
    boxes |= {"lower left": (6, 18, 22, 26), "lower right": (26, 18, 40, 26)}
    regions = [Region(text, boxes[text], COLOURS[text]) for text in COLOURS]
    regions.append(Region("left edge", (3, 5, 4, 14), _scaled(COLOURS["upper left"], 0.25), SOFT))
    regions.append(Region("top edge", (26, 2, 40, 3), _scaled(COLOURS["upper right"], 0.25), SOFT))
    regions.append(Region("right edge", (42, 18, 43, 26), _scaled(COLOURS["lower right"], 0.5), SOFT))
    regions.append(Region("bottom edge", (6, 28, 22, 29), _scaled(COLOURS["lower left"], 0.5), SOFT))
    at = ("upper left", "upper right", "lower right", "lower left")
    inner = tuple(COLOURS.values())
    wrong = [
        Cause(text, inner + tuple(_scaled(COLOURS[key], share) for key, share in zip(at, four, strict=True)))
        for text, four in SHIFTS.items()
    ]
    wrong.append(_fov(width, height))
    return Case(
        f"film-{name}",
        f"Four squares of colour before a {kind} camera; their edges lie within pixels.",
        scene(camera, objects, depth=1, size=SIZE),
        tuple(regions),
        tuple(wrong),
        "film",
        samples=1024,
    )


def _fov(width: int, height: int) -> Cause:
    """The field of view taken along the wider side: the image is larger by that ratio, and its edges are outside."""
    inner = tuple(COLOURS.values())
    at = ("upper left", "upper right", "lower right", "lower left")
    return Cause(
        "the field of view is taken along the width: it is that of the height",
        inner + tuple(COLOURS[key] for key in at),
    )


def _scaled(colour: Colour, share: float) -> Colour:
    return (share * colour[0], share * colour[1], share * colour[2])


def _lens() -> Case:
    """A lamp that fills x > 0 at half the distance in focus: its edge is blurred over a circle of 8 pixels' radius."""
    focus, distance, aperture, level = 2.0, 1.0, 0.25, 0.8
    camera = {**view([0, 0, 0], [0, 0, -1], 2 * math.degrees(math.atan(0.25))), "up": [0, 1, 0]}
    camera |= {"aperture": aperture, "focus": focus}
    lamp = {"rectangle": {}, "scale": 10, "translate": [10, 0, -distance]}
    radius = aperture * (focus / distance - 1) * 32  # pixels; the film shows 1 x 1 in the plane in focus

    def shown(blur: float, left: int) -> Colour:
        x = left + (np.arange(64) + 0.5) / 32 - 16  # pixels from the edge, over two columns
        return grey(level * float(blurred_edge(x / max(blur, 1e-9)).mean()))

    lefts = (9, 12, 15, 18, 21)
    regions = tuple(Region(f"columns {x} and {x + 1}", (x, 0, x + 2, 32), shown(radius, x), 0.03) for x in lefts)
    other = {
        "there is no lens: the edge is sharp": 0.0,
        "aperture is taken for the diameter": radius / 2,
        "the radius of the lens is doubled": radius * 2,
        "the circle of confusion is that of the plane of the lamp": radius / 2.0001,
    }
    wrong = tuple(Cause(text, tuple(shown(blur, x) for x in lefts)) for text, blur in other.items())
    return Case(
        "lens",
        "The edge of a lamp at half the distance that is in focus: its blur is the area of a circle cut by a line.",
        scene(camera, [(lamp, diffuse(0.0, level))], depth=1),
        regions,
        wrong,
        "lens",
        samples=1024,
    )
