"""Shadow rays to lamps and to lights on surfaces: the surface at the end of a ray never hides the light.

A small plate, tilted and far from what it lights, is the hard case: the rounding error of a ray's distance from the
plate grows with the length of the ray, and that of a point on the plate does not.
"""

import math

import numpy as np
import pytest

import raytrace as rt

PRECISIONS = ("float32", "float64")
DISTANCE, ALBEDO = 10.0, 0.5


def turned(scale, z, flip=False):
    """A matrix that scales, moves along z, and turns about two axes, so that no plane is special."""
    (a, b), (c, s) = np.cos([0.3, 0.54]), np.sin([0.3, 0.54])
    turn = np.array([[a, 0, c], [0, 1, 0], [-c, 0, a]]) @ np.array([[1, 0, 0], [0, b, -s], [0, s, b]])
    sides = np.diag([1.0, -1.0, -1.0] if flip else [1.0, 1.0, 1.0])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn @ sides * scale, turn @ [0, 0, z]
    return matrix


def shown(size, precision, lamp, lights=(), spp=64):
    """Radiance of a plane below a plate at the origin that faces it, seen from beside the plate."""

    def place(x, z):
        return (turned(1, 0)[:3, :3] @ [x, 0, z]).tolist()

    scene = {
        "camera": {"position": place(-4, -4), "look_at": place(0, -DISTANCE), "fov": 0.01, "up": place(1, 0)},
        "render": {"integrator": "path", "max_depth": 1, "sampler": "independent"},
        "lights": list(lights),
        "materials": {"plane": {"type": "diffuse", "albedo": [ALBEDO] * 3}, "plate": lamp},
        "objects": [
            {"rectangle": {}, "material": "plane", "matrix": turned(3 * DISTANCE, -DISTANCE).tolist()},
            {"rectangle": {}, "material": "plate", "matrix": turned(size, 0, flip=True).tolist()},
        ],
    }
    return rt.render(scene, size=(8, 8), spp=spp, precision=precision, progress=False).rgb.astype(np.float64).mean()


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("size", [1e-1, 1e-3])
def test_a_small_lamp_does_not_hide_itself(size, precision):
    """A small lamp of area A at a distance h: L = rho / pi * Le A / h^2, to (size / h)^2."""
    area = 4 * size**2
    lamp = {"type": "diffuse", "albedo": [0, 0, 0], "emission": [DISTANCE**2 / area] * 3}
    assert shown(size, precision, lamp) == pytest.approx(ALBEDO / math.pi, rel=5e-4)


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("kind", ["point", "spot"])
def test_a_small_plate_does_not_hide_a_light_that_lies_on_it(kind, precision):
    """L = rho / pi * I / h^2."""
    light = {"type": "point", "position": [0, 0, 0], "flux": [4 * math.pi * DISTANCE**2] * 3}
    if kind == "spot":
        down = (turned(1, 0)[:3, :3] @ [0, 0, -1]).tolist()
        aim = {"look_at": down, "intensity": [DISTANCE**2] * 3, "cutoff": 60}
        light = {"type": "spot", "position": [0, 0, 0], **aim}
    dark = {"type": "diffuse", "albedo": [0, 0, 0]}
    assert shown(1e-2, precision, dark, [light], spp=4) == pytest.approx(ALBEDO / math.pi, rel=1e-4)
