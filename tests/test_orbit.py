"""A camera that turns around what it looks at."""

import numpy as np
import pytest

from raytrace.records import Camera
from raytrace.show.orbit import POLE, orbited

CAMERA = Camera(np.array([1.0, 2.0, 5.0]), np.array([0.5, 1.0, -0.5]), np.array([0.0, 3.0, 0.0]), 40.0)


def spherical(camera):
    """Azimuth, elevation and distance, from y up and z towards the viewer."""
    x, y, z = camera.position - camera.look_at
    return (
        np.degrees(np.arctan2(x, z)),
        np.degrees(np.arcsin(y / np.hypot(np.hypot(x, z), y))),
        np.sqrt(x * x + y * y + z * z),
    )


def test_untouched_it_is_the_same_camera():
    assert orbited(CAMERA, 0.0, 0.0, 1.0) is CAMERA


@pytest.mark.parametrize("knobs", [(30, 0, 1), (-200, 10, 2), (0, -40, 0.5), (90, 60, 1.5)])
def test_it_turns_by_what_is_asked_and_looks_at_the_same_point(knobs):
    before, after = np.array(spherical(CAMERA)), np.array(spherical(orbited(CAMERA, *knobs)))
    azimuth = (after[0] - before[0] - knobs[0] + 180) % 360 - 180
    np.testing.assert_allclose([azimuth, after[1] - before[1], after[2] / before[2]], [0, *knobs[1:]], atol=1e-12)
    assert orbited(CAMERA, *knobs).look_at is CAMERA.look_at
    assert orbited(CAMERA, *knobs).fov == CAMERA.fov


@pytest.mark.parametrize("elevation", [400, -400])
def test_it_never_goes_over_a_pole(elevation):
    camera = orbited(CAMERA, 20, elevation, 1)
    assert abs(spherical(camera)[1]) == pytest.approx(POLE)


def test_a_camera_that_begins_beyond_the_last_degree_stays_where_it_is():
    steep = CAMERA._replace(position=CAMERA.look_at + np.array([1e-3, 1.0, 0.0]))
    assert spherical(orbited(steep, 45, 30, 1))[1] == pytest.approx(spherical(steep)[1])


def test_up_may_be_any_direction():
    tilted = CAMERA._replace(up=np.array([1.0, 1.0, 0.0]))
    up = tilted.up / np.linalg.norm(tilted.up)
    offset = tilted.position - tilted.look_at
    other = orbited(tilted, 77, 0, 1).position - tilted.look_at
    assert other @ up == pytest.approx(offset @ up)
    assert np.linalg.norm(other) == pytest.approx(np.linalg.norm(offset))
