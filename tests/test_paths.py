"""Whole paths through glass, by the kernels, against fifty digits; and what becomes of them when depth is spent."""

import dataclasses

import numpy as np
import pytest

import exact_optics
import naive
import raytrace as rt
from raytrace.accel import query
from raytrace.passes.refraction import refract_rays
from raytrace.records import Batch, Columns, Hits, Rays
from raytrace.rendering.compiled_scene import compile_scene
from raytrace.scene.plan import make_plan
from small_scenes import ball, box, glass, look, make_scene

pytestmark = pytest.mark.engine

PRECISIONS = ("float32", "float64")
DIRECTION = {"float32": 2e-6, "float64": 3e-14}  # error of a direction
PACKET = 16  # rays of a packet on any machine


def batch(n, dtype):
    hits = Hits(np.empty(n, dtype), np.empty(n, np.int32), np.empty(n, dtype), np.empty(n, dtype))
    return Batch(np.empty(3 * n, dtype), np.empty(3 * n, dtype), np.arange(n, dtype=np.int32), hits)


def trace(scene, o, d, count, precision):
    """Rays (n, 3) as they are after ``count`` interfaces: origins, directions; and the triangles met, (count, n)."""
    compiled, n, dtype = compile_scene(scene, make_plan(scene), precision), len(d), np.dtype(precision)
    source, target, met = batch(n, dtype), batch(n, dtype), []
    source.o[:], source.d[:] = o.T.ravel(), d.T.ravel()
    tmin, tmax = (Columns(np.array([limit], dtype), 0, 0, 0) for limit in (0, np.inf))
    for _ in range(count):
        rays = Rays(Columns(source.o, 0, 1, n), Columns(source.d, 0, 1, n), tmin, tmax)
        query.closest_hit(compiled.bvh.tree, rays, source.hits, n, compiled.bvh.work())
        met.append(source.hits.prim_id.copy())
        assert refract_rays(compiled.shading, compiled.normals, source, n, target) == n
        source, target = target, source
    return source.o.reshape(3, n).T, source.d.reshape(3, n).T, np.array(met)


def worst_errors(scene, o, d, count, precision):
    """Largest error of a direction and of an origin after ``count`` interfaces, against the exact path."""
    dtype = np.dtype(precision)
    o, d = o.astype(dtype), naive.unit(d).astype(dtype)
    ends, ways, met = trace(scene, o, d, count, precision)
    corners = scene.mesh.vertices.astype(dtype)[scene.mesh.faces]
    normals = None if scene.mesh.normals is None else scene.mesh.normals.astype(dtype)
    ior = scene.materials.ior.astype(dtype)[scene.mesh.material_id]
    errors = np.zeros(2)
    for k in range(len(d)):
        path = [exact_optics.Triangle(corners[i], None if normals is None else normals[i], ior[i]) for i in met[:, k]]
        end, way = exact_optics.follow(o[k], d[k], path)
        errors = np.maximum(errors, [exact_optics.distance(ways[k], way), exact_optics.distance(ends[k], end)])
    return errors


def turned(triangles):
    """Triangles turned about two axes, so that no plane is special."""
    a, b = np.cos([0.3, 0.7]), np.sin([0.3, 0.7])
    first = np.array([[a[0], -b[0], 0], [b[0], a[0], 0], [0, 0, 1]])
    return np.asarray(triangles) @ first.T @ np.array([[1, 0, 0], [0, a[1], -b[1]], [0, b[1], a[1]]]).T


def towards(low, high, seed):
    """A packet of rays from one side, to points of the square [low, high]^2 in the plane z = 0, turned."""
    rng = np.random.default_rng(seed)
    target = np.column_stack([rng.uniform(low, high, (PACKET, 2)), np.zeros(PACKET)])
    o = np.column_stack([rng.uniform(-1, 1, (PACKET, 2)), np.full(PACKET, 3.0)])
    return turned(o), turned(target) - turned(o)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_nested_slabs(precision):
    iors = (1.5, 1.33 / 1.5, 2.4 / 1.33)
    slabs = [glass(turned(box((-9, -9, -h), (9, 9, h))), ior) for h, ior in zip((0.9, 0.6, 0.25), iors, strict=True)]
    o, d = towards(-0.5, 0.5, seed=1)
    direction, origin = worst_errors(make_scene(slabs), o, d, 6, precision)
    assert direction < DIRECTION[precision]
    limit = 1.5 * np.finfo(precision).eps * (9 + 4 * 18) * 3**0.5  # gamma(3) of coordinates and 4 extents, an interface
    assert origin < 6 * limit


@pytest.mark.parametrize("precision", PRECISIONS)
def test_ball_lens(precision):
    triangles, normals = ball(8)
    scene = make_scene([glass(turned(triangles), 1.5, normals=turned(normals))])
    o, d = towards(-0.6, 0.6, seed=2)
    direction, origin = worst_errors(scene, o, d, 2, precision)
    assert direction < DIRECTION[precision]
    assert origin < 2 * 1.5 * np.finfo(precision).eps * (1 + 4 * 2) * 3**0.5


@pytest.mark.parametrize("precision", PRECISIONS)
def test_a_thousand_total_reflections_keep_length_angles_and_box(precision):
    """In a cube a direction only changes signs; steeper than 42 degrees to all sides, it never gets out."""
    rng, eps = np.random.default_rng(3), np.finfo(precision).eps
    o = turned(rng.uniform(-0.9, 0.9, (PACKET, 3))).astype(precision)
    d = turned(naive.unit(1 + 0.05 * rng.normal(size=(PACKET, 3)))).astype(precision)
    ends, ways, _ = trace(make_scene([glass(turned(box((-1, -1, -1), (1, 1, 1))), 1.5)]), o, d, 1000, precision)
    back = turned(np.eye(3))
    np.testing.assert_allclose(np.linalg.norm(ways.astype(np.float64), axis=1), 1, rtol=0, atol=2 * eps)
    np.testing.assert_allclose(np.abs(ways @ back.T), np.abs(d @ back.T), rtol=0, atol=1000 * eps)
    assert (np.abs(ends @ back.T) < 1).all()


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize(("max_depth", "seen"), [(1001, 0.0), (1002, 1.0)])
def test_a_light_guide_ends_after_a_thousand_reflections_unless_the_depth_does(max_depth, seen, precision):
    """A rod of width 1: a ray climbs 3 across for 4 along, is reflected 1000 times, and gets out at the far end."""
    start, across = np.array([0.1, 0.05, 0.5]), 1000.5 - 0.6
    rod = box((-0.5, -0.5, 0), (0.5, 0.5, start[2] + across * 4 / 3))
    camera = look(start, start + [0.6, 0, 0.8], fov=1e-4)
    scene = make_scene([glass(rod, 1.5)], camera=camera, background=(1, 1, 1))
    settings = scene.settings._replace(max_depth=max_depth, precision=precision, size=(4, 4))
    assert (rt.render(dataclasses.replace(scene, settings=settings)).rgb == seen).all()
