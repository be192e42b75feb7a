"""Lights that the viewer can move: their positions, and handles on the image."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import OptionError
from raytrace.passes.camera import make_view
from raytrace.records import Lights, Scene

FAR = 1e6  # largest coordinate of a moved light, world units


def positions_of(lights: Lights) -> NDArray[np.float64]:
    """Return the positions of point lights, then of spot lights, (k, 3)."""
    return lights.position if lights.spots is None else np.concatenate([lights.position, lights.spots.position])


def moved_lights(lights: Lights, positions: Sequence[Sequence[float]]) -> Lights:
    """Return lights at these positions, as ``positions_of`` orders them; spot lights keep their directions."""
    if not len(positions):
        return lights
    new, points = np.array(positions, np.float64), len(lights.position)
    spots = None if lights.spots is None else lights.spots._replace(position=new[points:])
    return lights._replace(position=new[:points], spots=spots)


def check_positions(value: Any, own: Sequence[Sequence[float]]) -> list[list[float]]:
    """Return positions of lights as lists of floats.

    Raises
    ------
    OptionError
        They are not as many positions as the scene has lights, or a coordinate is not a number from -1e6 to 1e6.
    """
    try:
        numbers = np.array(value, np.float64).reshape(-1, 3)
    except (TypeError, ValueError):
        numbers = np.full((0, 3), np.nan)
    if len(numbers) != len(own) or not (np.abs(numbers) <= FAR).all():
        raise OptionError(f"light_positions: expected {len(own)} positions [x, y, z] within {FAR:g}, got {value!r}")
    return [[float(number) for number in row] for row in numbers]


def light_handles(scene: Scene) -> list[dict[str, Any]]:
    """Return a handle for each point and spot light, for the page.

    "at": x and y on the image, as shares of its width and height; None: behind the camera. "right" and "down": vectors
    in the world that move it by the whole width and height of the image, in the plane through the light that is
    parallel to the image.
    """
    size = np.array(scene.settings.size)
    view = make_view(scene.camera, (int(size[0]), int(size[1])), np.dtype(np.float64))
    axes = np.stack([view.right, view.down])  # of one pixel, at distance 1
    handles = []
    for position in positions_of(scene.lights):
        offset = position - view.origin
        depth = float(offset @ view.forward) if scene.camera.height is None else 1.0
        if depth <= 0:
            handles.append({"at": None, "right": [0.0] * 3, "down": [0.0] * 3})
            continue
        pixel = (axes @ offset) / (axes**2).sum(axis=1) / depth + view.centre
        right, down = (depth * size[:, None] * axes).tolist()
        handles.append({"at": (pixel / size).tolist(), "right": right, "down": down})
    return handles
