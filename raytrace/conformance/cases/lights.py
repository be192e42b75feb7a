"""Point, spot and directional lights on a plane, alone and together, and the shadow of one."""

import math
from collections.abc import Iterator

from raytrace.conformance.case import (
    EXACT,
    Case,
    Cause,
    Region,
    causes,
    diffuse,
    environment,
    everywhere,
    floor,
    grey,
    orthographic,
    scene,
    view,
)

ABOVE = view([0, 0.001, 5], [0, 0, 0], 0.1)
HEIGHT = 1.7  # of lights above the plane
ALBEDO = 0.5


def cases() -> Iterator[Case]:
    """Yield the cases."""
    yield _point()
    yield _directional()
    yield from _spots()
    yield _shadow()
    yield _all()


def _point() -> Case:
    angle = math.radians(40)
    cosine, distance = math.cos(angle), HEIGHT / math.cos(angle)
    flux = 0.5 / (ALBEDO / math.pi * cosine / (4 * math.pi * distance**2))
    lamp = {"type": "point", "position": [HEIGHT * math.tan(angle), 0, HEIGHT], "flux": [flux] * 3}
    return Case(
        "point-light",
        "A plane of albedo 1/2 under a point light, at 40 degrees.",
        scene(ABOVE, [(floor(), diffuse(ALBEDO))], [lamp], depth=2),
        everywhere(0.5, EXACT),
        causes(
            ("the cosine at the surface is missing", 0.5 / cosine),
            ("the cosine at the surface counts twice", 0.5 * cosine),
            ("the light of a point falls off with 1 / r instead of 1 / r^2", 0.5 * distance),
            ("the light of a point does not fall off", 0.5 * distance**2),
            ("the diffuse scattering function lacks 1 / pi", 0.5 * math.pi),
            ("flux is taken for intensity: 4 pi is missing", 0.5 * 4 * math.pi),
        ),
        "lights",
    )


def _directional() -> Case:
    angle = math.radians(50)
    sun = {
        "type": "directional",
        "direction": [math.sin(angle), 0, -math.cos(angle)],
        "irradiance": [math.pi / math.cos(angle)] * 3,
    }
    return Case(
        "directional-light",
        "A plane of albedo 1/2 under a directional light, at 50 degrees.",
        scene(ABOVE, [(floor(), diffuse(ALBEDO))], [sun], depth=2),
        everywhere(0.5, EXACT),
        causes(
            ("the cosine at the surface is missing", 0.5 / math.cos(angle)),
            ("the cosine at the surface counts twice", 0.5 * math.cos(angle)),
            ("the sine stands for the cosine", 0.5 * math.tan(angle)),
            ("the diffuse scattering function lacks 1 / pi", 0.5 * math.pi),
        ),
        "lights",
    )


def _spots() -> Iterator[Case]:
    angle = math.radians(15)
    distance = HEIGHT / math.cos(angle)
    full = math.pi * distance**2 / math.cos(angle)  # intensity for a radiance of ALBEDO
    aside = view([HEIGHT * math.tan(angle), 0.001, 5], [HEIGHT * math.tan(angle), 0, 0], 0.01)
    sun = {"type": "directional", "direction": [0, 0, -1], "irradiance": [0.2 * math.pi / ALBEDO] * 3}
    for name, beam, cutoff, share in (("in-beam", 20, 30, 1.0), ("falloff", 12, 24, 3 / 4), ("outside", 5, 12, 0.0)):
        c, b, at = (math.cos(math.radians(x)) for x in (cutoff, beam, 15))
        smooth = min(max((at - c) / (b - c), 0), 1)
        spot = {"type": "spot", "position": [0, 0, HEIGHT], "look_at": [0, 0, 0], "cutoff": cutoff, "beam": beam}
        spot["intensity"] = [0.8 * full] * 3
        right = 0.2 + 0.8 * ALBEDO * share
        other = [
            ("the spot has no falloff: full up to its cutoff", 1.0),
            ("cutoff and beam are taken for full angles", max(min((cutoff / 2 - 15) / (cutoff - beam) * 2, 1.0), 0.0)),
            ("the falloff is linear in the cosine", smooth),
            ("the falloff is a smooth step of the cosine", smooth**2 * (3 - 2 * smooth)),
            ("the falloff is squared", share**2),
            ("the spot is black", 0.0),
            ("the light of a spot falls off with 1 / r instead of 1 / r^2", share * distance),
            ("the spot's own cosine counts", share * math.cos(angle)),
        ]
        wrong = [(text, 0.2 + 0.8 * ALBEDO * value) for text, value in other if abs(value - share) > 0.01]
        yield Case(
            f"spot-{name}",
            f"A plane at 15 degrees from the axis of a spot of beam {beam} and cutoff {cutoff} degrees, and a sun.",
            scene(aside, [(floor(1), diffuse(ALBEDO))], [spot, sun], depth=2),
            everywhere(right, EXACT),
            causes(*wrong),
            "lights",
            approximate=() if name == "falloff" else ("pbrt",),  # it differs between beam and cutoff only
        )


def _shadow() -> Case:
    flux = 0.5 / (ALBEDO / math.pi / (16 * math.pi))
    lamp = {"type": "point", "position": [0, 0, 2], "flux": [flux] * 3}
    blocker = {"rectangle": {}, "scale": 50, "translate": [50, 0, 1]}
    camera = orthographic([0, 0, 0.5], [0, 0, 0], 0.04)
    regions = (
        Region("lit", (2, 2, 15, 30), grey(0.7), EXACT),
        Region("shadow", (17, 2, 30, 30), grey(0.2), EXACT),
    )
    objects = [(floor(0.05), diffuse(ALBEDO, 0.2)), (blocker, diffuse(0.0))]
    other = {
        "the light of a point falls off with 1 / r instead of 1 / r^2": 2.0,
        "the light of a point does not fall off": 4.0,
        "the diffuse scattering function lacks 1 / pi": math.pi,
    }
    return Case(
        "shadow",
        "The edge of the shadow of a black sheet under a point light, on a plane that emits 0.2.",
        scene(camera, objects, [lamp], depth=1),
        regions,
        (Cause("shadow rays find nothing: no shadow", (grey(0.7), grey(0.7))),
         Cause("surfaces shadow themselves: all is shadow", (grey(0.2), grey(0.2))),
         *(Cause(text, (grey(0.2 + 0.5 * factor), grey(0.2))) for text, factor in other.items())),
        "lights",
    )  # fmt: skip


def _all() -> Case:
    """A plane under a point light, a sun and an environment: shares 0.35, 0.05, 0.1."""
    point = {"type": "point", "position": [0, 0, 2], "flux": [0.35 / (ALBEDO / math.pi / (16 * math.pi))] * 3}
    sun = {"type": "directional", "direction": [0, 0, -1], "irradiance": [0.05 * math.pi / ALBEDO] * 3}
    parts = {"point light": 0.35, "directional light": 0.05, "environment": 0.1}
    wrong = [(f"the {name} is missing where there are others", 0.5 - part) for name, part in parts.items()]
    wrong += [("the light of a point falls off with 1 / r instead of 1 / r^2", 0.5 + parts["point light"])]
    wrong += [("each light has the same weight: its probability is not divided by", 0.5 / 3)]
    return Case(
        "lights-add-up",
        "A plane of albedo 1/2 under a point light, a weak directional light, and an environment.",
        scene(ABOVE, [(floor(1), diffuse(ALBEDO))], [point, sun, environment(0.2)], depth=2),
        everywhere(0.5),
        causes(*wrong),
        "lights",
    )
