"""Lamps: polygons over a plane, opposed squares, and the two sides of a lamp."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from raytrace.conformance.case import WEIGHTS, Case, causes, diffuse, environment, everywhere, floor, scene, view
from raytrace.conformance.formulas import opposed_squares, polygon_irradiance

TRIANGLE = np.array([[0.5, -0.4, 1], [0.2, 0.9, 1.5], [1.4, 0.6, 0.8]])
PI = "the diffuse scattering function lacks 1 / pi"
BOTH = "light sampling and surface sampling both count in full: their weights do not add up to 1"


def cases() -> Iterator[Case]:
    """Yield the cases."""
    yield _triangle()
    yield _squares()
    yield _large()
    yield _tilted()
    yield from _sides()
    yield _behind()


def _ply(vertices: np.ndarray, faces: list[list[int]]) -> bytes:
    """A text PLY."""
    head = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}", *(f"property double {c}" for c in "xyz")]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    rows = [" ".join(map(repr, row)) for row in vertices.tolist()]
    rows += [" ".join(map(str, [len(face), *face])) for face in faces]
    return "\n".join([*head, *rows, ""]).encode()


def _triangle() -> Case:
    emission = 0.4 / (0.5 / math.pi * polygon_irradiance(TRIANGLE))
    lamp: dict[str, Any] = {"mesh": "triangle-lamp.ply"}
    camera = view([0, 0.001, 5], [0, 0, 0], 0.01)
    return Case(
        "triangle-lamp",
        "A plane of albedo 1/2 under a triangular lamp, at one point.",
        scene(camera, [(floor(), diffuse(0.5)), (lamp, diffuse(0.0, emission))], depth=1),
        everywhere(0.4),
        causes((PI, 0.4 * math.pi), (BOTH, 0.8)),
        "polygon",
        suspect=WEIGHTS,
        files={"triangle-lamp.ply": _ply(TRIANGLE, [[0, 1, 2]])},
    )


def _squares() -> Case:
    factor = opposed_squares()
    square = {"rectangle": {}, "scale": 0.5}
    lamp = {"rectangle": {}, "scale": 0.5, "rotate": {"axis": [1, 0, 0], "angle": 180}, "translate": [0, 0, 1]}
    camera = view([0, 0.0001, 0.5], [0, 0, 0], 90)  # shows the square, and nothing else
    return Case(
        "opposed-squares",
        "A square of albedo 0.8 that faces an equal lamp at the distance of its sides; its mean.",
        scene(camera, [(square, diffuse(0.8)), (lamp, diffuse(0.0, 2.5))], depth=1),
        everywhere(2.0 * factor),
        causes((PI, 2.0 * factor * math.pi), (BOTH, 4.0 * factor)),
        "squares",
        suspect=WEIGHTS,
    )


def _large() -> Case:
    """A lamp so near that sampling of surfaces finds it as well as sampling of lights."""
    corners = np.array([[-1, -1, 0.5], [1, -1, 0.5], [1, 1, 0.5], [-1, 1, 0.5]])
    emission = 0.4 / (0.5 / math.pi * polygon_irradiance(corners))
    lamp = {"rectangle": {}, "rotate": {"axis": [1, 0, 0], "angle": 180}, "translate": [0, 0, 0.5]}
    return Case(
        "large-lamp",
        "A plane of albedo 1/2 close below a square lamp: both techniques of sampling matter.",
        scene(
            view([0, 0.0001, 0.3], [0, 0, 0], 0.1), [(floor(), diffuse(0.5)), (lamp, diffuse(0.0, emission))], depth=1
        ),
        everywhere(0.4),
        causes((PI, 0.4 * math.pi), (BOTH, 0.8)),
        "polygon",
        suspect=WEIGHTS,
    )


def _tilted() -> Case:
    """A small lamp, tilted and far: the cosine at the lamp counts."""
    angle = math.radians(65)
    c, s = math.cos(angle), math.sin(angle)
    flat = 0.05 * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])  # seen from below, counter-clockwise
    corners = flat @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) + [0, 0, 3]
    emission = 0.4 / (0.5 / math.pi * polygon_irradiance(corners))
    shape = {
        "rectangle": {},
        "scale": 0.05,
        "rotate": [{"axis": [1, 0, 0], "angle": 180}, {"axis": [0, 1, 0], "angle": 65}],
    }
    shape["translate"] = [0, 0, 3]
    return Case(
        "tilted-lamp",
        "A plane of albedo 1/2 under a small lamp that is turned by 65 degrees.",
        scene(
            view([0, 0.001, 1], [0, 0, 0], 0.01), [(floor(), diffuse(0.5)), (shape, diffuse(0.0, emission))], depth=1
        ),
        everywhere(0.4),
        causes(
            ("the cosine at the lamp is missing", 0.4 / c),
            ("the density of points on the lamp is not converted to solid angle: r^2 / cos is missing", 0.4 * 9 / c),
            ("the light of a lamp does not fall off with 1 / r^2", 0.4 * 9),
            ("the light of a lamp falls off with 1 / r instead of 1 / r^2", 0.4 * 3),
            (PI, 0.4 * math.pi),
        ),
        "polygon",
        suspect=WEIGHTS,
    )


def _sides() -> Iterator[Case]:
    plate = {"rectangle": {}, "rotate": {"axis": [1, 0, 0], "angle": 180}}
    material = {**diffuse(0.5, 0.4), "two_sided": True}
    yield Case(
        "lamp-back",
        "The back of a lamp that emits 0.4 and reflects on both sides, in an environment of 0.6.",
        scene(view([0, 0.001, 5], [0, 0, 0], 2), [(plate, material)], [environment(0.6)], depth=2),
        everywhere(0.3),
        causes(
            ("the lamp shines on both sides", 0.7),
            ("the back of a two-sided surface is black", 0.001),
            ("a surface that emits does not reflect, and shines on both sides", 0.4),
        ),
        "sides",
    )
    yield Case(
        "lamp-front",
        "The front of a lamp that emits 0.4 and has albedo 1/2, in an environment of 0.6.",
        scene(view([0, 0.001, -5], [0, 0, 0], 2), [(plate, material)], [environment(0.6)], depth=2),
        everywhere(0.7),
        causes(
            ("a surface that emits does not reflect", 0.4),
            ("emission that is seen directly does not count, or the lamp shines on its back only", 0.3),
            ("emission counts twice where it is seen directly", 1.1),
            (PI, 0.4 + 0.3 * math.pi),
        ),
        "sides",
    )


def _behind() -> Case:
    below = {"rectangle": {}, "translate": [0, 0, 1]}  # its front looks away from the plane
    return Case(
        "lamp-behind",
        "A plane of albedo 1/2 that emits 0.2, below the back of a black lamp that emits 0.8.",
        scene(
            view([0, 0.001, 0.5], [0, 0, 0], 1),
            [(floor(), diffuse(0.5, 0.2)), (below, diffuse(0.0, 0.8))],
            depth=1,
        ),
        everywhere(0.2),
        causes(
            (
                "the lamp shines on both sides",
                0.2 + 0.5 / math.pi * 0.8 * polygon_irradiance([[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]]),
            ),
        ),
        "sides",
    )
