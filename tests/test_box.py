"""The slab test, seen from outside: a tree never loses what its triangles alone would hit."""

import numpy as np
import pytest

import rays
import raytrace as rt
from raytrace.accel.box import bounds_test, make_packet_bounds, make_slabs, slab_test
from raytrace.accel.lanes import packet_width
from raytrace.jit import interpreted as plain

pytestmark = pytest.mark.engine

PRECISIONS = ("float32", "float64")


def unboxed(vertices, faces, precision, o, d):
    """Nearest hits without a box in the way: leaves of six triangles, and two specks that make them huge."""
    far = 1e7 * np.array([[1.0, 1, 1], [-1, -1, -1]])
    specks = (far[:, None] + 1e3 * np.eye(3)).reshape(-1, 3)
    t, prim_id = np.full(len(d), np.inf, precision), np.full(len(d), -1)
    for first in range(0, len(faces), 6):
        some = faces[first : first + 6]
        corners = np.concatenate([some, len(vertices) + np.arange(6).reshape(2, 3)])
        bvh = rt.BVH(np.concatenate([vertices, specks]), corners, precision)
        assert bvh.stats.leaves == 1
        hits = bvh.closest_hit(o, d)
        nearer = (hits.t < t) & (hits.prim_id < len(some))
        t[nearer], prim_id[nearer] = hits.t[nearer], first + hits.prim_id[nearer]
    return t, prim_id


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("distance", [3.0, 300.0, 3e4])
@pytest.mark.parametrize("name", ["cube", "fan", "grid", "slanted grid"])
def test_boxes_lose_nothing_at_edges_and_vertices(name, distance, precision):
    """Seen from far, t is rounded by more than a box is large; where boxes end, any slip would be a lost hit."""
    vertices, faces = {"cube": rays.cube, "fan": lambda: rays.fan(20)}.get(name, lambda: rays.grid(5))()
    if name == "slanted grid":
        vertices = vertices + 0.3 * vertices[:, [1, 2, 0]] + 0.1
    rng = np.random.default_rng(1)
    targets = rays.edge_points((vertices, faces), precision, seed=2)
    targets = targets[rng.permutation(len(targets))[:200]]
    directions = np.concatenate([rng.normal(size=(4, 3)), np.eye(3) + 1e-3 * rng.normal(size=(3, 3))])
    o, d = rays.towards(distance * directions, targets)
    bvh = rt.BVH(vertices, faces, precision)
    t, prim_id = unboxed(vertices, faces, precision, o, d)
    assert np.mean(prim_id >= 0) > 0.5
    for hits in rays.all_paths(bvh, o, d):
        assert rays.same_bits(hits.t, t)
        assert np.array_equal(hits.prim_id, prim_id)


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_boxes_without_thickness_are_entered(axis, precision):
    """A grid at a height that no number holds exactly: its boxes are flat, and rays cross them at all angles."""
    vertices, faces = rays.grid(16)
    vertices = np.roll(vertices + [0, 0, 0.1], axis, axis=1)
    rng = np.random.default_rng(2)
    targets = np.roll(np.column_stack([rng.uniform(0.1, 15.9, (3000, 2)), np.full(3000, 0.1)]), axis, axis=1)
    o = targets + rng.normal(size=(3000, 3)) * 10.0 ** rng.uniform(-3, 3, (3000, 1))
    o, d = o.astype(precision), (targets - o).astype(precision)
    across = (2 + axis) % 3
    bvh = rt.BVH(vertices, faces, precision)
    crosses = d[:, across] != 0  # a rounding may leave o in the plane
    assert crosses.mean() > 0.99
    for hits in rays.all_paths(bvh, o[crosses], d[crosses]):
        assert (hits.prim_id >= 0).all()


@pytest.mark.parametrize("precision", PRECISIONS)
def test_origins_on_faces_edges_and_corners_of_boxes_see_the_other_side(precision):
    vertices, faces = rays.cube()
    steps = np.array(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3)).reshape(3, -1).T
    on_box = steps[(np.abs(steps) == 1).any(axis=1)]  # of the cube, which is the box of its tree
    o, to = (a.reshape(-1, 3) for a in np.broadcast_arrays(on_box[:, None], 0.9 * steps))
    bvh = rt.BVH(vertices, faces, precision)
    d = to - o
    for hits in rays.all_paths(bvh, o.astype(precision), d.astype(precision)):
        assert (hits.prim_id >= 0).all()  # from the wall inwards: the wall itself at t = 0 is not in the open interval
        assert (hits.t > 0.9).all()


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("distance", [1e2, 1e4, 1e6])
def test_far_origins_lose_nothing(distance, precision):
    """The error of t in units of a small box grows with the distance: the slabs must grow with it."""
    vertices, faces = rays.icosphere(2)
    rng = np.random.default_rng(3)
    away = rng.normal(size=(2000, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    targets = 0.5 * rng.normal(size=(2000, 3)) / 3
    o = (distance * away).astype(precision)
    d = (targets - o).astype(precision)
    aimed = (
        np.linalg.norm(np.cross(o.astype(np.float64), d), axis=1) / np.linalg.norm(d.astype(np.float64), axis=1) < 0.9
    )
    assert aimed.mean() > 0.8
    bvh = rt.BVH(vertices, faces, precision)
    for hits in rays.all_paths(bvh, o[aimed], d[aimed]):
        # v - o is rounded to eps times the distance, and a mesh that is smaller than that may be missed
        if distance * np.finfo(precision).eps < 0.05:
            assert (hits.prim_id >= 0).all()


@pytest.mark.nojit
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("precision", PRECISIONS)
def test_zeros_of_both_signs_in_directions_are_alike(precision):
    bvh = rt.BVH(*rays.cube(), precision)
    for d in rays.signed_axes():
        assert bvh.closest_hit([0, 0, 0], d).t[0] == 1
        assert bvh.closest_hit([1, 1, 1] * np.abs(d) * -2 * d + 0.5 * (d == 0), d).t[0] == 1


@pytest.mark.parametrize("precision", PRECISIONS)
def test_components_next_to_nothing_are_like_zeros(precision):
    bvh = rt.BVH(*rays.cube(), precision)
    tiny = float(np.finfo(precision).smallest_subnormal)
    for small in (tiny, -tiny, 1e-38, -1e-38, 1e-30, -1e-20):
        d = np.array([[1, small, 0], [small, -1, small], [0, small, 1], [-1, small, -small]], precision)
        for hits in rays.all_paths(bvh, np.zeros_like(d), d):
            assert (hits.t == 1).all()
        outside = bvh.closest_hit(np.array([[-2, 1.5, 0]] * 4, precision), d)
        assert (outside.prim_id == -1).all()


@pytest.mark.parametrize("precision", PRECISIONS)
def test_packet_bounds_meet_every_box_that_one_of_the_rays_meets(precision):
    """Intervals may only be too wide: of rays aimed at the corners and sides of boxes, none is lost."""
    rng = np.random.default_rng(8)
    width, eps, lost, culled = packet_width(np.empty(0, precision)), np.finfo(precision).eps, 0, 0
    for _ in range(300):
        low = rng.uniform(-1, 1, (8, 3)).astype(precision)
        high = low + rng.choice([0.0, 0.01, 0.5], (8, 3)).astype(precision)
        target = np.where(rng.random((width, 3)) < 0.5, low[rng.integers(8)], high[rng.integers(8)])
        signs = rng.choice([-1, 1], 3)
        o = (target - signs * (rng.uniform(0.5, 3, 3) + 0.1 * rng.random((width, 3)))).astype(precision)
        d = (signs * np.abs(target - o)).astype(precision)
        near, far = np.where(signs > 0, low, high).T, np.where(signs > 0, high, low).T
        slabs = plain(make_slabs)(tuple(o.T), tuple(d.T), eps)
        tmin, tmax = np.zeros(width, precision), np.full(width, 1.5, precision)
        alive = rng.random(width) < 0.8
        alive[0] = True
        bounds = plain(make_packet_bounds)(tuple(o.T), slabs, tmin, alive, eps)
        met = plain(bounds_test)(bounds, near, far, tmax.max())
        entered = [plain(slab_test)(slabs, near[:, k], far[:, k], tmin, tmax)[1][alive].any() for k in range(8)]
        lost += np.count_nonzero(entered & ~met)
        culled += np.count_nonzero(~met)
    assert lost == 0
    assert culled > 300
