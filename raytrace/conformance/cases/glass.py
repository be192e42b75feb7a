"""Plates of glass, seen from both sides and from inside."""

import math
from collections.abc import Iterator

from raytrace.conformance.case import (
    Case,
    causes,
    diffuse,
    environment,
    everywhere,
    floor,
    orthographic,
    scene,
    told_apart,
    view,
)
from raytrace.conformance.formulas import fresnel, inside_slab, slab_reflection, slab_transmission

IOR = 1.5
GLASS = {"type": "dielectric", "ior": IOR}
PLATE = {"box": {}, "scale": [1000, 1000, 0.5], "translate": [0, 0, -0.5]}
BREWSTER = math.degrees(math.atan(IOR))


def cases() -> Iterator[Case]:
    """Yield the cases."""
    for degrees in (0.0, 30.0, 60.0, 80.0):
        yield _through(degrees)
    for degrees in (0.0, 30.0, 60.0, 80.0, BREWSTER):
        yield _back(degrees)
    yield _cut()
    yield from _inside()
    yield _total()


def _camera(degrees: float) -> dict[str, object]:
    angle = math.radians(degrees)
    return view([5 * math.sin(angle), 0.0001, 5 * math.cos(angle)], [0, 0, 0], 0.01)


def _through(degrees: float) -> Case:
    r = fresnel(math.cos(math.radians(degrees)), IOR)
    right = slab_transmission(r)
    level = 0.5 / right
    lamp = floor(10000, translate=[0, 0, -2])
    return Case(
        f"slab-through-{degrees:.0f}",
        f"Light through a plate of glass, from the dark side, at {degrees:.0f} degrees.",
        scene(_camera(degrees), [(PLATE, GLASS), (lamp, diffuse(0.0, level))], depth=48),
        everywhere(0.5),
        causes(
            *told_apart(
                0.5,
                ("glass reflects nothing: Fresnel's reflectance is missing", level),
                ("light is not reflected more than once in the plate: (1 - r)^2", level * (1 - r) ** 2),
                ("one of two surfaces reflects: 1 - r", level * (1 - r)),
                ("n^2 is applied on one side only", 0.5 * IOR**2),
                ("n^2 is applied on one side only, and the wrong way", 0.5 / IOR**2),
            )
        ),
        "slab",
        samples=1024 if r > 0.1 else 256,
    )


def _back(degrees: float) -> Case:
    r = fresnel(math.cos(math.radians(degrees)), IOR)
    level = 0.3 / slab_reflection(r)
    dark = floor(10000, translate=[0, 0, -2])
    name = "brewster" if degrees == BREWSTER else f"{degrees:.0f}"
    schlick = 0.04 + 0.96 * (1 - math.cos(math.radians(degrees))) ** 5
    wrong = [
        ("only the first surface reflects: r", level * r),
        ("Schlick's approximation stands for Fresnel's equations", level * slab_reflection(schlick)),
        ("the reflectance does not depend on the angle", level * slab_reflection(0.04)),
        ("the polarised reflectance rs stands for the mean of rs and rp", level * slab_reflection(_polarised(degrees))),
    ]
    return Case(
        f"slab-back-{name}",
        f"What a plate of glass reflects before a black ground, at {degrees:.1f} degrees.",
        scene(_camera(degrees), [(PLATE, GLASS), (dark, diffuse(0.0))], [environment(level)], depth=48),
        everywhere(0.3),
        causes(*told_apart(0.3, *wrong)),
        "slab",
        samples=4096 if r < 0.1 else 1024,
    )


def _polarised(degrees: float) -> float:
    cosine = math.cos(math.radians(degrees))
    inner = math.sqrt(1 - (1 - cosine**2) / IOR**2)
    return ((cosine - IOR * inner) / (cosine + IOR * inner)) ** 2


def _cut() -> Case:
    r = fresnel(math.cos(math.radians(80)), IOR)
    level = 0.5 / slab_reflection(r, 3)
    dark = floor(10000, translate=[0, 0, -2])
    return Case(
        "slab-back-80-depth-3",
        "What a plate of glass reflects at 80 degrees, by paths of at most three surfaces.",
        scene(_camera(80), [(PLATE, GLASS), (dark, diffuse(0.0))], [environment(level)], depth=3),
        everywhere(0.5),
        causes(
            ("max_depth is one too small", level * slab_reflection(r, 2)),
            ("max_depth is one or more too large", level * slab_reflection(r, 5)),
        ),
        "slab",
        samples=1024,
    )


def _inside() -> Iterator[Case]:
    camera = orthographic([0, 0, -0.5], [0, 0, -0.9], 0.01)
    for depth in (1, 48):
        right = 0.2 * inside_slab(IOR, depth)
        wrong = [
            ("the eta^2 of radiance is missing", right / IOR**2),
            ("the eta^2 of radiance is the wrong way round", right / IOR**4),
            ("glass reflects nothing: Fresnel's reflectance is missing, or max_depth is one too large", 0.2 * IOR**2),
        ]
        yield Case(
            f"inside-slab-{depth}",
            f"An environment of 0.2 from inside of a plate of glass; at most {depth} surfaces.",
            scene(camera, [(PLATE, GLASS)], [environment(0.2)], depth=depth),
            everywhere(right),
            causes(*told_apart(right, *wrong)),
            "inside",
        )


def _total() -> Case:
    """Inside of a plate, beyond the critical angle: the surface is a mirror, in which a lamp in the glass is seen."""
    angle, sky, shown = math.radians(60), 0.1, 0.5
    across = math.tan(angle)  # per unit of height
    camera = orthographic([0, 0, -0.5], [0.5 * across, 0, 0], 0.01)
    lamp = {"rectangle": {}, "scale": 0.3, "translate": [1.3 * across, 0, -0.8]}
    return Case(
        "total-reflection",
        "A lamp in a plate of glass, seen from inside in its upper surface, at 60 degrees.",
        scene(camera, [(PLATE, GLASS), (lamp, diffuse(0.0, shown))], [environment(sky)], depth=1),
        everywhere(shown),
        causes(
            ("total reflection is missing: no light is reflected", 0.001),
            ("total reflection is missing: light leaves the glass", sky * IOR**2),
            ("total reflection is missing, and the eta^2 of radiance", sky),
            ("the eta^2 of radiance is applied where light is reflected", shown * IOR**2),
        ),
        "inside",
        suspect="total reflection",
    )
