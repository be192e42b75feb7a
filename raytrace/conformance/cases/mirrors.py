"""Mirrors and metals: geometric series, Fresnel's equations, and what one scattering of a rough metal loses."""

import math
from collections.abc import Iterator

from raytrace.conformance.case import (
    EXACT,
    Case,
    Cause,
    Colour,
    Region,
    causes,
    diffuse,
    environment,
    everywhere,
    floor,
    grey,
    scene,
    told_apart,
    view,
)
from raytrace.conformance.formulas import conductor, plastic_albedo, rough_albedo

GOLD = (0.143, 0.375, 1.442), (3.983, 2.386, 1.603)  # eta and k of red, green and blue: near those of gold


def cases() -> Iterator[Case]:
    """Yield the cases."""
    yield _corridor()
    yield from _lamp_below()
    yield from _conductors()
    yield _rough()
    yield _plastic()


def _corridor() -> Case:
    """A pixel sees the end of the corridor after as many mirrors as borders of the unfolded corridor lie between."""
    walls = [
        {
            "rectangle": {},
            "scale": [30, 1000, 1],
            "rotate": {"axis": [0, 1, 0], "angle": 90 * side},
            "translate": [-side, 0, 0],
        }
        for side in (1, -1)
    ]
    end = {"rectangle": {}, "scale": [1, 1000, 1], "translate": [0, 0, -10]}
    mirror = {"type": "mirror", "reflectance": [0.9] * 3}
    size = 60, 30
    camera = view([0, 0, 0], [0, 0, -1], 2 * math.degrees(math.atan(0.75)))
    regions, edges = [], []
    for count in range(8):
        for side in (1, -1) if count else (1,):
            first = 28 + 4 * side * count
            regions.append(
                Region(
                    f"{count} mirrors{', left' if side < 0 else ''}",
                    (first + 1, 0, first + 3, 30),
                    grey(0.8 * 0.9**count),
                    0.02,
                )
            )
            edges.append(count)
    wrong = (
        ("mirrors have no reflectance: all light is reflected", [0.8 for _ in edges]),
        ("the reflectance of mirrors counts twice", [0.8 * 0.81**k for k in edges]),
    )
    return Case(
        "corridor",
        "The end of a corridor of two mirrors of reflectance 0.9: 0.8 times 0.9 to the number of mirrors.",
        scene(camera, [*((wall, mirror) for wall in walls), (end, diffuse(0.0, 0.8))], depth=16, size=size),
        tuple(regions),
        tuple(Cause(text, tuple(map(grey, values))) for text, values in wrong),
        "corridor",
        samples=1024,
    )


def _lamp_below() -> Iterator[Case]:
    """Each further term takes a mirror and the plate."""
    mirror = {"rectangle": {}, "scale": 10000, "rotate": {"axis": [1, 0, 0], "angle": 180}, "translate": [0, 0, 1]}
    for depth in (2, 48):
        terms = depth // 2 + 1
        right = 0.3 * (1 - 0.4**terms) / 0.6
        less, more = (0.3 * (1 - 0.4 ** (terms + k)) / 0.6 for k in (-1, 1))
        objects = [(floor(10000), diffuse(0.5, 0.3)), (mirror, {"type": "mirror", "reflectance": [0.8] * 3})]
        yield Case(
            f"lamp-below-mirror-{depth}",
            f"A plane of albedo 1/2 that emits 0.3 below a mirror of reflectance 0.8; at most {depth} surfaces.",
            scene(view([0, 0.0001, 0.5], [0, 0, 0], 20), objects, depth=depth),
            everywhere(right),
            causes(
                *told_apart(right, ("max_depth is one too small", less), ("max_depth is one too large", more)),
                ("light that a mirror brings to a diffuse surface is lost: no caustics", 0.3),
                *told_apart(
                    right,
                    (
                        "the diffuse scattering function lacks 1 / pi",
                        0.3 * sum((0.4 * math.pi) ** k for k in range(terms)),
                    ),
                ),
            ),
            "corridor",
        )


def _conductors() -> Iterator[Case]:
    for degrees in (0, 75):
        cosine = math.cos(math.radians(degrees))
        eta, k = GOLD
        right = tuple(0.7 * conductor(cosine, n, kk) for n, kk in zip(eta, k, strict=True))
        flat = tuple(0.7 * conductor(1.0, n, kk) for n, kk in zip(eta, k, strict=True))
        schlick = tuple(r + (0.7 - r) * (1 - cosine) ** 5 for r in flat)
        camera = view([5 * math.sin(math.radians(degrees)), 0.0001, 5 * cosine], [0, 0, 0], 0.01)
        wrong: list[tuple[str, Colour]] = [
            ("the metal reflects all light: Fresnel's reflectance is missing", grey(0.7))
        ]
        if degrees:
            wrong.append(("the reflectance does not depend on the angle: Fresnel's equations are missing", flat))  # type: ignore[arg-type]
            wrong.append(("Schlick's approximation stands for Fresnel's equations", schlick))  # type: ignore[arg-type]
        yield Case(
            f"conductor-{degrees}",
            f"A smooth metal in an environment of 0.7, seen at {degrees} degrees.",
            scene(
                camera, [(floor(), {"type": "conductor", "eta": list(eta), "k": list(k)})], [environment(0.7)], depth=4
            ),
            everywhere(right, EXACT),  # type: ignore[arg-type]
            causes(*wrong),
            "conductor",
        )


def _rough() -> Case:
    alpha, level = 0.5, 0.9
    metal = {"type": "conductor", "reflectance": [1, 1, 1], "alpha": alpha}
    return Case(
        "rough-metal",
        "A rough white metal of alpha 1/2 in an environment of 0.9, seen at right angles.",
        scene(view([0, 0.0001, 5], [0, 0, 0], 0.01), [(floor(), metal)], [environment(level)], depth=1),
        everywhere(level * rough_albedo(alpha)),
        causes(
            ("the metal loses nothing: masking is missing, or energy is compensated", level),
            ("alpha is squared: the renderer takes it for a roughness", level * rough_albedo(alpha**2)),
            ("alpha is the root of what it should be", level * rough_albedo(math.sqrt(alpha))),
        ),
        "rough",
        approximate=("pbrt",),  # at right angles both forms of masking are the same
    )


def _plastic() -> Case:
    degrees, albedo = 60, 0.5
    cosine = math.cos(math.radians(degrees))
    camera = view([5 * math.sin(math.radians(degrees)), 0.0001, 5 * cosine], [0, 0, 0], 0.01)
    coat = {"type": "plastic", "albedo": list(grey(albedo)), "ior": 1.5}
    return Case(
        "plastic",
        "A diffuse base of albedo 1/2 under a smooth coat of index 1.5 in an environment of 0.9, seen at 60 degrees.",
        scene(camera, [(floor(), coat)], [environment(0.9)], depth=1),
        everywhere(0.9 * plastic_albedo(cosine, albedo, 1.5)),
        causes(
            ("the coat does nothing", 0.9 * albedo),
            ("the coat is as at right angles: Fresnel's equations are missing", 0.9 * plastic_albedo(1.0, albedo, 1.5)),
        ),
        "plastic",
    )
