"""White furnaces: closed rooms, bodies in even light, and glass that cannot be seen."""

import math
from collections.abc import Iterator

from raytrace.conformance.case import (
    DEEP,
    WEIGHTS,
    Case,
    causes,
    diffuse,
    environment,
    everywhere,
    scene,
    told_apart,
    view,
)
from raytrace.conformance.formulas import furnace, lit_sphere, lossy_furnace

INSIDE = view([0, 0, 0.5], [0, 0.2, -1], 60)
OUTSIDE = view([0, 0, 4], [0, 0, 0], 5)
COARSE, FINE = 1e-4, 2e-5  # tolerances of spheres with a point light: 70,000 and 350,000 triangles
LOSSY = "Russian roulette does not divide by the probability of going on (from surface {} on)"


def cases() -> Iterator[Case]:
    """Yield the cases."""
    yield from _rooms()
    yield from _lit_spheres()
    yield from _bodies()


def _rooms() -> Iterator[Case]:
    albedo, emission = 0.75, 0.125
    for depth in (1, 3, DEEP):
        room = scene(INSIDE, [({"box": {}, "flip": True}, diffuse(albedo, emission))], depth=depth)
        wrong = [(f"max_depth is off by {k:+d}", furnace(albedo, emission, depth + k)) for k in (-1, 1) if depth < DEEP]
        if depth == DEEP:
            wrong += [(LOSSY.format(first), lossy_furnace(albedo, emission, first)) for first in range(2, 8)]
            wrong += [
                (
                    f"paths end after {d} surfaces, whatever max_depth is, or Russian roulette loses light",
                    furnace(albedo, emission, d),
                )
                for d in (1, 2, 4, 8)
            ]
        else:
            wrong.append(("max_depth is ignored", furnace(albedo, emission, DEEP)))
        wrong.append(
            (
                "the emission of a surface that is hit counts, and is sampled too",
                2 * furnace(albedo, emission, depth) - emission,
            )
        )
        yield Case(
            f"furnace-room-{depth}",
            f"A closed room whose walls have albedo {albedo} and emit {emission}; at most {depth} surfaces.",
            room,
            everywhere(furnace(albedo, emission, depth)),
            causes(*wrong),
            "furnace",
            suspect=f"{WEIGHTS}; Russian roulette",
        )
    ball = {"sphere": {"center": [0, 0, 0], "radius": 1}, "flip": True}
    yield Case(
        "furnace-sphere",
        "Inside of a sphere of albedo 1/2 that emits 1/4.",
        scene(INSIDE, [(ball, diffuse(0.5, 0.25))]),
        everywhere(0.5),
        causes(("only what the walls emit is seen", 0.25), ("light is scattered once only", 0.375)),
        "furnace",
    )


def _lit_spheres() -> Iterator[Case]:
    camera, flux = view([0, 0, 1], [0, 0.2, -2], 40), 2 * math.pi**2 * 4
    for depth, tolerance in ((2, COARSE), (DEEP, FINE)):
        ball = {"sphere": {"center": [0, 0, 0], "radius": 2, "tolerance": tolerance}, "flip": True}
        lamp = {"type": "point", "position": [0, 0, 0], "flux": [flux] * 3}
        right = lit_sphere(flux, 2, 0.5, depth)
        yield Case(
            f"point-in-sphere-{depth}",
            f"Inside of a sphere of albedo 1/2 with a point light at its centre; at most {depth} surfaces.",
            scene(camera, [(ball, diffuse(0.5))], [lamp], depth=depth),
            everywhere(right),
            causes(
                *told_apart(
                    right,
                    ("max_depth is one too small", lit_sphere(flux, 2, 0.5, depth - 1)),
                    ("max_depth is one too large", lit_sphere(flux, 2, 0.5, depth + 1)),
                ),
                ("the light of a point falls off with 1 / r instead of 1 / r^2", 2 * right),
                ("the light of a point does not fall off", 4 * right),
                ("flux is taken for intensity: 4 pi is missing", 4 * math.pi * right),
            ),
            "sphere",
        )


def _bodies() -> Iterator[Case]:
    slanted = {"box": {}, "rotate": {"axis": [1, 2, 0], "angle": 25}}
    for name, albedo, about in (("body", 0.6, "A box of albedo 0.6"), ("white-body", 1.0, "A white box")):
        yield Case(
            f"furnace-{name}",
            f"{about} in an even environment of 1/2{'; it cannot be seen' if albedo == 1 else ''}.",
            scene(OUTSIDE, [(slanted, diffuse(albedo))], [environment(0.5)], depth=4),
            everywhere(0.5 * albedo),
            causes(
                ("light sampling and surface sampling both count in full: their weights do not add up to 1", albedo),
                ("the environment is not sampled where surfaces scatter, or its weight is halved", 0.25 * albedo),
                ("the diffuse scattering function lacks 1 / pi", 0.5 * albedo * math.pi),
                ("directions are uniform, but weighted as if by the cosine", 0.5 * albedo * 4 / 3),
            ),
            "furnace",
            suspect=WEIGHTS,
        )
    ball = {"sphere": {"center": [0, 0, 0], "radius": 1}}
    yield Case(
        "furnace-glass",
        "A ball of glass in an even environment of 1/2; it cannot be seen.",
        scene(view([0, 0, 4], [0, 0, 0], 20), [(ball, {"type": "dielectric", "ior": 1.5})], [environment(0.5)]),
        everywhere(0.5, 0.003),
        (),
        "furnace",
    )
