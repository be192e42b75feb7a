"""Orbit a camera around the point that it looks at."""

import numpy as np

from raytrace.records import Camera

POLE = 89.0  # degrees: largest elevation above or below the horizon; beyond 90, right and left would swap


def orbited(camera: Camera, azimuth: float, elevation: float, distance: float) -> Camera:
    """Move a camera around the point that it looks at.

    Parameters
    ----------
    camera : Camera
    azimuth : float, degrees
        Rotation about the up vector, counter-clockwise seen from above.
    elevation : float, degrees
        Rotation towards the up vector, limited to `POLE`.
    distance : float
        Factor for the distance to the point; also for that of the plane in focus, and for an orthographic height.

    Examples
    --------
    >>> camera = Camera(np.array([0.0, 0, 2]), np.zeros(3), np.array([0.0, 1, 0]), 40.0)
    >>> orbited(camera, 90, 0, 3).position.round(3).tolist()
    [6.0, 0.0, 0.0]
    """
    if (azimuth, elevation, distance) == (0.0, 0.0, 1.0):
        return camera  # bit-identical
    up, offset = camera.up / np.linalg.norm(camera.up), camera.position - camera.look_at
    radius = np.linalg.norm(offset)
    level = offset - (offset @ up) * up
    level /= np.linalg.norm(level)  # never 0: a scene whose camera looks along its up is refused
    turn, tilt = np.radians(azimuth), np.radians(_height(camera) + np.clip(elevation, *elevation_limits(camera)))
    level = np.cos(turn) * level + np.sin(turn) * np.cross(up, level)
    offset = distance * radius * (np.cos(tilt) * level + np.sin(tilt) * up)
    height = None if camera.height is None else distance * camera.height
    return camera._replace(position=camera.look_at + offset, focus=distance * camera.focus, height=height)


def elevation_limits(camera: Camera) -> tuple[float, float]:
    """Limits of the rotation down and up, degrees; 0 where the camera is already beyond `POLE`."""
    height = _height(camera)
    return min(-POLE - height, 0.0), max(POLE - height, 0.0)


def _height(camera: Camera) -> float:
    """Elevation of a camera above the horizon of the point that it looks at, degrees."""
    offset = camera.position - camera.look_at
    sine = offset @ camera.up / (np.linalg.norm(offset) * np.linalg.norm(camera.up))
    return float(np.degrees(np.arcsin(np.clip(sine, -1, 1))))
