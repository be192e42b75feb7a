"""A camera that turns around what it looks at."""

import numpy as np

from raytrace.records import Camera

POLE = 89.0  # degrees: how far above or below the horizon it may be turned; right and left swap beyond 90


def turned(camera: Camera, azimuth: float, elevation: float, distance: float) -> Camera:
    """Move a camera around the point that it looks at.

    Parameters
    ----------
    camera : Camera
    azimuth : float, degrees
        Around its up, counter-clockwise seen from above.
    elevation : float, degrees
        Towards its up, as far as the pole lets it.
    distance : float
        In distances that it has now.

    Examples
    --------
    >>> camera = Camera(np.array([0.0, 0, 2]), np.zeros(3), np.array([0.0, 1, 0]), 40.0)
    >>> turned(camera, 90, 0, 3).position.round(3).tolist()
    [6.0, 0.0, 0.0]
    """
    if (azimuth, elevation, distance) == (0.0, 0.0, 1.0):
        return camera  # to the last bit
    up, offset = camera.up / np.linalg.norm(camera.up), camera.position - camera.look_at
    radius = np.linalg.norm(offset)
    level = offset - (offset @ up) * up
    level /= np.linalg.norm(level)  # never 0: a scene whose camera looks along its up is refused
    turn, tilt = np.radians(azimuth), np.radians(_height(camera) + np.clip(elevation, *reach(camera)))
    level = np.cos(turn) * level + np.sin(turn) * np.cross(up, level)
    offset = distance * radius * (np.cos(tilt) * level + np.sin(tilt) * up)
    return camera._replace(position=camera.look_at + offset)


def reach(camera: Camera) -> tuple[float, float]:
    """How far a camera may be turned down, and up, degrees; no farther where it is beyond a pole's neighbourhood."""
    height = _height(camera)
    return min(-POLE - height, 0.0), max(POLE - height, 0.0)


def _height(camera: Camera) -> float:
    """Degrees above the horizon of what a camera looks at."""
    offset = camera.position - camera.look_at
    sine = offset @ camera.up / (np.linalg.norm(offset) * np.linalg.norm(camera.up))
    return float(np.degrees(np.arcsin(np.clip(sine, -1, 1))))
