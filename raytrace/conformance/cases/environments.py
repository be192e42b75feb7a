"""Environments given as images: where they are seen, and how much light one texel brings."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from raytrace.conformance.case import Case, Cause, Region, causes, diffuse, everywhere, scene, view
from raytrace.conformance.formulas import bright_texel, texel_direction
from raytrace.image import png
from raytrace.image.files import srgb_decode

HEIGHT, ROW, COLUMN = 128, 40, 70  # of the bright texel
# codes of the blocks of an image, 4 to a row: the upper and the lower half of the sky
BLOCKS = np.array(
    [
        [[230, 120, 120], [120, 230, 120], [120, 120, 230], [230, 230, 120]],
        [[200, 160, 110], [110, 200, 160], [160, 110, 200], [180, 180, 180]],
    ],
    np.uint8,
)


def cases() -> Iterator[Case]:
    """Yield the cases."""
    yield _texel()
    yield from _seen()


def _sky(name: str, codes: np.ndarray, scale: float = 1.0) -> tuple[dict[str, Any], dict[str, bytes]]:
    return {"type": "environment", "image": name, "scale": scale}, {name: png.encode(codes, {})}


def _texel() -> Case:
    codes = np.zeros((HEIGHT, 2 * HEIGHT, 3), np.uint8)
    codes[ROW, COLUMN] = 255
    d = texel_direction(HEIGHT, ROW, COLUMN)
    sky, files = _sky("one-texel.png", codes, 0.4 / (0.5 / math.pi * bright_texel(HEIGHT, ROW)))
    side = np.cross([0.0, 1.0, 0.0], d)
    side /= np.linalg.norm(side)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([side, np.cross(d, side), d], axis=1)  # its front faces the texel
    wrong = []
    for text, x, y, z in (
        ("the environment is mirrored left to right", -1, 1, 1),
        ("the environment is upside down", 1, -1, 1),
        ("the environment is mirrored front to back", 1, 1, -1),
        ("the environment is turned by 180 degrees", -1, 1, -1),
    ):
        wrong.append((text, 0.4 * max(float(d @ (d * [x, y, z])), 1e-3)))
    for sign in (-1, 1):
        turned = np.array([sign * d[2], d[1], -sign * d[0]])
        wrong.append((f"the environment is turned by {90 * sign:+d} degrees", 0.4 * max(float(d @ turned), 1e-3)))
    wrong.append(
        ("sin(theta) is missing: texels near the poles count too much", 0.4 / math.sin(math.pi * (ROW + 0.5) / HEIGHT))
    )
    camera = view((4 * d + 0.001 * side).tolist(), [0, 0, 0], 0.1)
    return Case(
        "environment-texel",
        "A plane of albedo 1/2 that faces the only bright texel of an environment.",
        scene(camera, [({"rectangle": {}, "matrix": matrix.tolist()}, diffuse(0.5))], [sky], depth=1),
        everywhere(0.4),
        causes(*wrong),
        "texel",
        files=files,
    )


def _seen() -> Iterator[Case]:
    codes = np.repeat(np.repeat(BLOCKS, 16, axis=0), 16, axis=1)  # 32 x 64 texels
    light = srgb_decode(BLOCKS / 255.0)
    regions = {"upper left": (2, 2, 14, 14), "upper right": (18, 2, 30, 14)}
    regions |= {"lower left": (2, 18, 14, 30), "lower right": (18, 18, 30, 30)}
    behind = {"box": {}, "scale": 0.01, "translate": [-5, 0, 0]}  # a scene has an object

    def seen(left: int, upside: bool = False, mirrored: bool = False) -> list[tuple[float, float, float]]:
        columns = ((left + 1) % 4, left) if mirrored else (left, (left + 1) % 4)
        rows = (1, 0) if upside else (0, 1)
        return [tuple(map(float, light[row, column])) for row in rows for column in columns]  # type: ignore[misc]

    for name, turn, left in (("", 0.0, 0), ("-turned", 90.0, 1)):
        sky, files = _sky(f"sky-blocks{name}.png", codes)
        if turn:
            sky["rotate"] = {"axis": [0, 1, 0], "angle": turn}
        given = zip(regions.items(), seen(left), strict=True)
        wrong = [
            Cause(f"the environment is turned by {90 * k} degrees", tuple(seen((left + k) % 4))) for k in (1, 2, 3)
        ]
        wrong.append(Cause("the environment is mirrored left to right", tuple(seen(left, mirrored=True))))
        wrong.append(Cause("the environment is upside down", tuple(seen(left, upside=True))))
        about = "An environment of eight blocks of colour, seen towards +x"
        yield Case(
            f"environment-seen{name}",
            f"{about}{f'; turned by {turn:g} degrees about y' if turn else ''}.",
            scene(view([0, 0, 0], [1, 0, 0], 50), [(behind, diffuse(0.5))], [sky], depth=2),
            tuple(Region(text, box, colour) for (text, box), colour in given),
            tuple(wrong),
            "sky",
            files=files,
        )
