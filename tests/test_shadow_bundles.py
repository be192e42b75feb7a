"""Shadow rays in bundles skip triangles before their origins and beyond their ends, but never one that they hit."""

import numpy as np
import pytest

import rays
import raytrace as rt

SIDE = 16


def bundles(rng, precision):
    """Rays from a small square tilted at random to a point, or from it: (256, 3) origins and directions."""
    x, y = (a.ravel() for a in np.meshgrid(*2 * [np.linspace(-1, 1, SIDE) * 10.0 ** rng.uniform(-4, -1)]))
    u, v = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2]
    square, point = rng.uniform(-1, 1, 3) + x[:, None] * u + y[:, None] * v, rng.uniform(-3, 3, 3)
    o, d = (square, point - square) if rng.uniform() < 0.5 else (np.tile(point, (len(x), 1)), square - point)
    return o.astype(precision), d.astype(precision)


def flat_soup(seed):
    """Random triangles, each at one height x, y or z: so rays begin and end at the height of a whole triangle."""
    vertices, faces = rays.soup(60, seed=seed, size=0.5)
    corners = vertices[faces].copy()
    for axis in range(3):
        corners[axis::3, :, axis] = corners[axis::3, :1, axis]
    return corners.reshape(-1, 3), np.arange(corners.shape[0] * 3).reshape(-1, 3)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_rays_that_begin_or_end_right_at_a_triangle_hit_as_nearest_hits_do(precision):
    rng = np.random.default_rng(7)
    ended = hit = 0
    for seed in range(30):
        bvh = rt.BVH(*flat_soup(seed), precision)
        for _ in range(6):
            o, d = bundles(rng, precision)
            t = bvh.closest_hit(o, d, threads=1).t
            found = np.isfinite(t)
            end, inf = np.where(found, t, 1).astype(precision), np.array(np.inf, precision)
            assert bvh.any_hit(o, d, tmax=np.nextafter(end, inf), threads=1)[found].all()
            assert bvh.any_hit(o, d, tmin=np.nextafter(end, -inf), threads=1)[found].all()
            assert not bvh.any_hit(o, d, tmax=end, threads=1)[found].any()
            at = (o + d * (end * np.array(1 - 4 * np.finfo(precision).eps, precision))[:, None]).astype(precision)
            again = bvh.closest_hit(at, d, tmax=1, threads=1).prim_id >= 0  # from the surfaces, to rounding
            np.testing.assert_array_equal(bvh.any_hit(at, d, tmax=1, threads=1), again)
            ended, hit = ended + found.sum(), hit + again.sum()
    assert ended > 4000
    assert hit > 4000
