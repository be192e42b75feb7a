"""Direct light: the inverse square law in closed form, sides, and what is added to what; where shadow rays end."""

import mpmath
import numpy as np
import pytest

import exact_optics as exact
import rays
import raytrace as rt
from raytrace.accel.hit_points import ROUNDINGS
from raytrace.passes.light import SPAN, background, reflect_light, shadow_rays, triangles_at
from raytrace.records import Hits, Points, Shading, Shadows

pytestmark = pytest.mark.engine

PRECISIONS = ("float32", "float64")
QUIET = pytest.mark.filterwarnings("ignore::RuntimeWarning")
N = 32


def points(precision, p, ng, ns=None, offset=0.0, material=0):
    """N points, all arguments spread over them."""

    def flat(a):
        return np.broadcast_to(np.asarray(a, precision), (N, 3)).T.ravel().copy()

    ng = flat(ng)
    offsets = np.broadcast_to(np.asarray(offset, precision), N).copy()
    materials = np.broadcast_to(np.asarray(material, np.int32), N).copy()
    return Points(flat(p), ng, ng if ns is None else flat(ns), offsets, materials)


def shadows_of(surface, position):
    dtype = surface.p.dtype
    shadows = Shadows(
        np.empty(3 * N, dtype), np.empty(3 * N, dtype), np.empty(N, dtype), np.empty(N, dtype), np.zeros(N, bool)
    )
    return shadow_rays(surface, np.asarray(position, dtype), shadows), shadows


def rows(flat):
    return flat.reshape(3, -1).T


@pytest.mark.nojit
@QUIET
@pytest.mark.parametrize("precision", PRECISIONS)
def test_irradiance_falls_with_the_square_of_the_distance_and_the_cosine(precision):
    """Above a plane, at height h and r away: E = Phi cos / (4 pi r^2) = Phi h / (4 pi (h^2 + x^2)^(3/2))."""
    x, height = np.linspace(-8, 8, N), 1.75
    surface = points(precision, np.stack([x, 0 * x, 0 * x], axis=1), (0, 1, 0))
    sent, shadows = shadows_of(surface, (0, height, 0))
    assert sent == N
    x = rows(surface.p)[:, 0].astype(np.float64)
    expected = height / (4 * np.pi * (height**2 + x**2) ** 1.5)
    np.testing.assert_allclose(shadows.irradiance, expected, rtol=8 * np.finfo(precision).eps)
    assert (shadows.tmax == 1).all()
    np.testing.assert_allclose(
        rows(shadows.o) + rows(shadows.d), np.tile([0, height, 0], (N, 1)), atol=2 * np.finfo(precision).eps * 8
    )


@pytest.mark.parametrize("precision", PRECISIONS)
def test_all_flux_arrives_on_a_sphere_about_the_light(precision):
    """The mean of E over a sphere of radius r, times its area, is the flux."""
    directions = np.random.default_rng(1).normal(size=(N, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for radius in (0.5, 3.0, 100.0):
        _, shadows = shadows_of(points(precision, radius * directions + 1, -directions), (1, 1, 1))
        np.testing.assert_allclose(
            shadows.irradiance * 4 * np.pi * radius**2, 1, rtol=1e-5 if precision == "float32" else 1e-13
        )


@pytest.mark.nojit
@QUIET
@pytest.mark.parametrize("precision", PRECISIONS)
def test_only_what_faces_the_light_by_both_normals_is_lit(precision):
    up, down, slanted = (0, 1, 0), (0, -1, 0), (0.8, 0.6, 0)
    light = (-3.0, 2.0, 0)  # above the plane, behind what is slanted
    cases = [
        (up, up, 0, True),
        (down, down, 0, False),
        (up, slanted, 0, False),
        (slanted, up, 0, False),
        (up, up, -1, False),
    ]
    for ng, ns, offset, lit in cases:
        sent, shadows = shadows_of(points(precision, (0, 0, 0), ng, ns, offset), light)
        assert sent == N * lit
        assert (shadows.tmax == (1 if lit else -1)).all()
        assert ((shadows.irradiance > 0) == lit).all()
        assert (shadows.irradiance[~np.full(N, lit)] == 0).all()


@pytest.mark.parametrize("precision", PRECISIONS)
def test_a_light_in_the_plane_or_in_the_point_gives_nothing(precision):
    surface = points(precision, (1, 0, 2), (0, 1, 0))
    for light in ((4, 0, 2), (1, 0, 2)):
        sent, shadows = shadows_of(surface, light)
        assert sent == 0
        assert (shadows.irradiance == 0).all()


@pytest.mark.parametrize("precision", PRECISIONS)
def test_rays_start_off_the_surface(precision):
    offset = np.linspace(0, 0.5, N)
    surface = points(precision, (1, 2, 3), (0, 0.6, 0.8), offset=offset)
    _, shadows = shadows_of(surface, (1, 9, 9))
    expected = np.array([1, 2, 3]) + offset[:, None] * [0, 0.6, 0.8]
    np.testing.assert_allclose(rows(shadows.o), expected, rtol=4 * np.finfo(precision).eps)


@pytest.mark.nojit
@QUIET
@pytest.mark.parametrize("precision", PRECISIONS)
def test_reflected_light_is_added_where_nothing_stopped_it(precision):
    rng = np.random.default_rng(2)
    albedo = np.array([[0.2, 0.5, 0.8], [1.0, 0.0, 0.3]])
    table = np.column_stack([albedo, np.ones(2), np.zeros(2), np.zeros(2)]).astype(precision)
    material = rng.integers(0, 2, N)
    surface = points(precision, (0, 0, 0), (0, 1, 0), material=material)
    _, shadows = shadows_of(surface, (0, 2, 0))
    shadows.irradiance[:] = rng.uniform(0, 3, N)
    shadows.occluded[:] = rng.random(N) < 0.4
    shading = Shading(np.zeros(12, precision), np.zeros(1, np.int32), table.ravel())
    before = rng.uniform(0, 1, (N, 3)).astype(precision)
    radiance, flux = before.T.ravel().copy(), np.array([3, 7, 11], precision)
    reflect_light(shading, surface, shadows, flux, radiance)
    arriving = np.where(shadows.occluded, 0, shadows.irradiance.astype(np.float64))[:, None]
    expected = before + albedo[material] / np.pi * flux * arriving
    np.testing.assert_allclose(rows(radiance), expected, rtol=8 * np.finfo(precision).eps)
    assert rays.same_bits(rows(radiance)[shadows.occluded], before[shadows.occluded])


@pytest.mark.nojit
@QUIET
@pytest.mark.parametrize("precision", PRECISIONS)
def test_only_rays_that_left_the_scene_see_the_background(precision):
    prim_id = np.array([-1, 0, 5, -2] * (N // 4), np.int32)  # -2: a path cut short
    zeros = np.zeros(N, precision)
    radiance = np.full(3 * N, np.nan, precision)
    colour = np.array([0.25, 3.0, 1e-3], precision)
    background(Hits(zeros, prim_id, zeros, zeros), radiance, colour)
    assert np.array_equal(rows(radiance), np.where(prim_id[:, None] == -1, colour, 0))


@pytest.mark.nojit
@QUIET
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("scale", [1e-13, 1e13])
def test_irradiance_keeps_its_digits_at_distances_whose_cubes_are_no_numbers(scale, precision):
    surface = points(precision, (0, 0, 0), (0, 1, 0))
    _, shadows = shadows_of(surface, (0, 2 * scale, 0))
    np.testing.assert_allclose(shadows.irradiance, 1 / (16 * np.pi * scale**2), rtol=1e-6)


# --- lights on surfaces ----------------------------------------------------------------------------------------------

ROOF = np.array([[0, 1, 0], [2, 1, 0], [2, 1, 2], [0, 1, 2], [0, 0, 0], [2, 0, 0]], np.float64)
FACES = np.array(
    [[0, 2, 1], [0, 3, 2], [0, 1, 5], [0, 5, 4]]
)  # two of a roof, two of a wall; they meet in the edge 0 1


def held_at(precision, light, shift=0.0, faces=FACES):
    bvh = rt.BVH(ROOF + shift, faces, precision)
    return sorted(triangles_at(bvh.tree, bvh.triangles, (np.asarray(light) + shift).astype(precision)).tolist())


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("shift", [0.0, 100.0])
@pytest.mark.parametrize(
    ("light", "held"),
    [
        ((1.5, 1, 0.5), [0]),
        ((1, 1, 1), [0, 1]),  # the diagonal
        ((1, 1, 0), [0, 2]),  # the edge of roof and wall
        ((0, 1, 0), [0, 1, 2, 3]),
        ((1, 0.999, 1), []),
        ((1, 1.001, 1), []),
        ((2.001, 1, 1), []),  # in the plane, beyond the edge
        ((-1, 1, -1), []),
        ((9, 9, 9), []),
    ],
)
def test_a_light_lies_on_the_triangles_that_hold_it(light, held, shift, precision):
    assert held_at(precision, light, shift) == held


@pytest.mark.parametrize("precision", PRECISIONS)
def test_no_light_lies_on_what_has_no_area_or_is_not_there(precision):
    assert held_at(precision, (1, 1, 0), faces=np.array([[0, 1, 1], [0, 1, 5]])) == [1]
    assert held_at(precision, (1, 1, 0), faces=np.zeros((0, 3), np.int64)) == []


@pytest.mark.parametrize("precision", PRECISIONS)
def test_in_a_large_mesh_it_lies_on_the_same_triangles_as_by_looking_at_each(precision):
    bvh = rt.BVH(*rays.torus(40, 20), precision)
    corners = bvh.triangles[:, :9].reshape(-1, 3, 3)
    for k in range(0, len(corners), 97):
        assert triangles_at(bvh.tree, bvh.triangles, corners[k].mean(axis=0)).tolist() == [k]
        around = (corners == corners[k, 0]).all(axis=-1).any(axis=-1)
        assert sorted(triangles_at(bvh.tree, bvh.triangles, corners[k, 0])) == np.flatnonzero(around).tolist()


@pytest.mark.parametrize("precision", PRECISIONS)
def test_off_the_triangles_that_hold_it_a_shadow_ray_knows_on_which_side_a_light_is(precision):
    """Lights at exactly the margin of a triangle, on both sides; rays to them from all over a larger scene."""
    rng, unit = np.random.default_rng(7), np.finfo(precision).eps / 2
    tried = 0
    for _ in range(40):
        shift = rng.choice([0, 1, 30]) * rng.normal(size=3)
        corners = (rng.normal(size=(3, 3)) + shift).astype(precision)
        low, high = corners.min(axis=0) - 5.0, corners.max(axis=0) + 5.0  # the scene
        normal = np.cross(*(corners[1:].astype(np.float64) - corners[0]))
        normal /= np.linalg.norm(normal)
        margin = ROUNDINGS * unit * (2 * np.abs(corners).max(axis=0) + SPAN * (high - low))
        bvh = rt.BVH(corners, [[0, 1, 2]], precision)
        for side in (-1, 1):
            light = (corners.mean(axis=0) + side * (np.abs(normal) @ margin) * normal).astype(precision)
            o = rng.uniform(low, high, (20, 3)).astype(precision)
            blocked = bvh.any_hit(o, light - o, 0.0, 1.0)
            with mpmath.workdps(exact.DIGITS):
                a, b, c = (exact.vector(corner) for corner in corners)
                n = exact.cross(exact.plus(b, -1, a), exact.plus(c, -1, a))
                heights = [float(exact.dot(n, exact.plus(exact.vector(p), -1, a))) for p in (light, *o)]
            # the light is over the middle: what comes at more than 1e-3 to the plane crosses it inside the triangle
            slope = np.abs((light - o) @ normal) / np.linalg.norm(light - o, axis=1)
            between = np.sign(heights[0]) != np.sign(heights[1:])
            assert (blocked == between)[slope > 1e-3].all()
            tried += np.count_nonzero(slope > 1e-3)
    assert tried > 1500
