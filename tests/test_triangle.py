"""The triangle test: the course's against its twin, the watertight one against exact arithmetic."""

from fractions import Fraction

import numpy as np
import pytest

import exact
import naive
import rays
import raytrace as rt

pytestmark = pytest.mark.engine

PRECISIONS = ("float32", "float64")
MESHES = {"soup": lambda: rays.soup(200, seed=1), "torus": lambda: rays.torus(16, 8)}


def moller_trumbore(mesh, o, d):
    """Twin of the course's test: t and prim_id of rays."""
    v0, v1, v2 = np.moveaxis(mesh[0][mesh[1]], 1, 0)
    e1, e2 = v1 - v0, v2 - v0
    p = np.cross(d[:, None], e2)
    det = naive.dot(p, e1)
    with np.errstate(all="ignore"):
        s = o[:, None] - v0
        q = np.cross(s, np.broadcast_to(e1, s.shape))
        u, v, t = naive.dot(s, p) / det, naive.dot(q, d[:, None]) / det, naive.dot(q, e2) / det
        hit = (np.abs(det) >= 1e-5) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
    t = np.where(hit, t, np.inf)
    prim = np.argmin(t, axis=1)
    nearest = t[np.arange(len(o)), prim]
    return nearest, np.where(nearest < np.inf, prim, -1)


@pytest.mark.parametrize("split", ["sah", "median"])
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize(("name", "scale"), [("soup", 0.01), ("torus", 0.03)])  # determinants about the threshold
def test_moller_trumbore_is_the_twins(name, scale, precision, split):
    vertices, faces = MESHES[name]()
    o, d = rays.anywhere(2000, seed=4)
    vertices, o, d = rays.rounded(precision, scale * vertices, scale * o, d)
    mesh, eps = (vertices, faces), np.finfo(precision).eps
    weight, cosine, det = rays.condition(mesh, o, d)
    unsure = (weight * cosine < 1e4 * eps) | (np.abs(det - 1e-5) < 1e4 * eps * det)
    t, prim = moller_trumbore(mesh, o, d)
    hits = rt.BVH(vertices, faces, precision, split, "moller-trumbore").closest_hit(o, d)
    clear = ~unsure.any(axis=1)
    assert (clear & (prim >= 0)).sum() > 20
    assert (prim != naive.closest_hit(vertices, faces, o, d).prim_id).any()  # the threshold does lose hits
    close = np.isfinite(hits.t) & np.isclose(hits.t, t, rtol=100 * eps, atol=0)
    assert ((hits.prim_id == prim) | close)[clear].all()
    found = clear & (hits.prim_id == prim) & (prim >= 0)
    np.testing.assert_allclose(hits.t[found], t[found], rtol=1e-2 if precision == "float32" else 1e-10)


def hits_of(corners, o, d, precision="float32", **options):
    return rt.BVH(corners, [[0, 1, 2]], precision, **options).closest_hit(o, d)


@pytest.mark.nojit
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_weights_belong_to_the_corners():
    triangle = [[0, 0, 0], [4, 0, 0], [0, 8, 0]]
    for test in ("watertight", "moller-trumbore"):
        hits = hits_of(
            triangle,
            [[1, 4, 2], [1, 4, -2], [3, 1, 4], [0.5, 1, 1]],
            [[0, 0, -1], [0, 0, 1], [0, 0, -8], [0, 0, -2]],
            triangle=test,
        )
        assert hits.t.tolist() == [2, 2, 0.5, 0.5]
        assert hits.u.tolist() == [0.25, 0.25, 0.75, 0.125]
        assert hits.v.tolist() == [0.5, 0.5, 0.125, 0.125]


@pytest.mark.parametrize("precision", PRECISIONS)
def test_distance_and_weights_are_near_the_exact_ones(precision):
    rng = np.random.default_rng(2)
    eps = float(np.finfo(precision).eps)
    worst_t = worst_p = 0.0
    for _ in range(100):
        # from needles to well shaped, seen from all sides
        triangle = (rng.normal(size=(3, 3)) * 10 ** rng.uniform(-3, 0, 3)).astype(precision)
        o = (3 * rng.normal(size=(8, 3))).astype(precision)
        d = (rng.dirichlet([1] * 3, 8) @ triangle - o).astype(precision)
        hits = hits_of(triangle, o, d, precision)
        normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0]).astype(np.float64)
        for i in np.flatnonzero(hits.prim_id == 0):
            crossing = exact.classify(triangle, o[i], d[i])
            if crossing.t is None:
                continue
            assert hits.u[i] >= 0
            assert hits.v[i] >= 0
            assert hits.u[i] + hits.v[i] <= 1 + eps
            cosine = abs(normal @ d[i]) / np.linalg.norm(normal) / np.linalg.norm(d[i])
            reach = np.abs(triangle - o[i]).max()
            error = abs(float(Fraction(float(hits.t[i])) - crossing.t)) * np.linalg.norm(d[i])
            worst_t = max(worst_t, error * cosine / reach / eps)
            weights = [float(1 - crossing.u - crossing.v), float(crossing.u), float(crossing.v)]
            shift = (np.array([1 - float(hits.u[i]) - float(hits.v[i]), hits.u[i], hits.v[i]]) - weights) @ triangle
            worst_p = max(worst_p, np.abs(shift).max() * cosine / reach / eps)
    # in units of eps * |v - o| / cosine, which the rounding of v - o alone costs
    assert worst_t < 8
    assert worst_p < 16


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("scale", [1e-15, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e15])
def test_no_size_is_too_small_or_too_large(scale, precision):
    vertices, faces = rays.torus(12, 8)
    o, d = rays.anywhere(500, seed=3)
    factor = 2.0 ** round(np.log2(scale))  # a power of two: nothing else is rounded
    hits = rt.BVH(vertices, faces, precision).closest_hit(o, d)
    scaled = rt.BVH(vertices.astype(precision) * factor, faces, precision).closest_hit(o.astype(precision) * factor, d)
    assert 0.05 < np.mean(hits.prim_id >= 0) < 0.9
    assert rays.same_hits(scaled, hits._replace(t=hits.t * np.array(factor, precision)))


@pytest.mark.parametrize("precision", PRECISIONS)
def test_only_moller_trumbore_loses_what_is_small(precision):
    small = [[0, 0, 0], [1e-3, 0, 0], [0, 1e-3, 0]]
    ray = [2e-4, 2e-4, 1], [0, 0, -1]
    assert hits_of(small, *ray, precision).prim_id[0] == 0
    assert hits_of(small, *ray, precision, triangle="moller-trumbore").prim_id[0] == -1
    assert hits_of(small, ray[0], [0, 0, -100], precision, triangle="moller-trumbore").prim_id[0] == 0  # |det| 1e-4


@pytest.mark.nojit
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize(
    "triangle",
    [
        [[0, 0, 0], [0, 0, 0], [0, 0, 0]],
        [[0, 0, 0], [1, 0, 0], [1, 0, 0]],
        [[0, 0, 0], [1, 1, 0], [2, 2, 0]],
        [[0.1, 0.1, 0.1], [0.2, 0.2, 0.2], [0.3, 0.3, 0.3]],
        [[1, 2, 3], [1e-30, 1e-30, 0], [1, 2, 3]],
    ],
)
def test_triangles_without_area_are_never_hit(triangle, precision):
    middle = np.mean(triangle, axis=0)
    directions = np.array([[0, 0, -1], [0, -1, 0], [1, 0, 0], [1, 1, 0], [1, -1, 0.5], [-1, -1, -1]])
    targets = np.concatenate([np.tile(point, (6, 1)) for point in (*triangle, middle)])
    d = np.tile(directions, (4, 1))
    hits = hits_of(triangle, targets - d, d, precision)
    assert (hits.prim_id == -1).all()
    assert (hits.t == np.inf).all()


@pytest.mark.parametrize("precision", PRECISIONS)
def test_rays_in_the_plane_of_a_triangle_miss(precision):
    rng = np.random.default_rng(4)
    triangle = np.array([[-4, -4, 2], [5, -3, 2], [0, 6, 2]])
    for axis in range(3):  # the plane is exactly representable, and so are its rays
        o = np.column_stack([rng.integers(-9, 9, (300, 2)), np.full(300, 2.0)])
        d = np.column_stack([rng.integers(-9, 9, (300, 2)), np.zeros(300)])
        hits = hits_of(np.roll(triangle, axis, axis=1), np.roll(o, axis, axis=1), np.roll(d, axis, axis=1), precision)
        assert (hits.prim_id == -1).all()


@pytest.mark.parametrize("precision", PRECISIONS)
def test_grazing_rays_are_hit_within_the_triangle(precision):
    """However flat the ray, a hit lies no farther along its main axis than the triangle reaches."""
    rng = np.random.default_rng(5)
    eps = np.finfo(precision).eps
    for _ in range(50):
        triangle = rng.normal(size=(3, 3)).astype(precision)
        a, b = (rng.dirichlet([1] * 3, 20) @ triangle for _ in range(2))
        normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
        o = (a + 10 ** rng.uniform(-9, -2, (20, 1)) * normal + 3 * (a - b)).astype(precision)
        d = (b - o).astype(precision)
        hits = hits_of(triangle, o, d, precision)
        found = np.flatnonzero(hits.prim_id == 0)
        axis = np.argmax(np.abs(d[found]), axis=1)
        p = (o[found] + hits.t[found, None].astype(np.float64) * d[found])[np.arange(len(found)), axis]
        low, high = triangle.min(axis=0)[axis], triangle.max(axis=0)[axis]
        slack = 4 * eps * (1 + np.abs(o[found, axis]))  # v - o is rounded, and so is t
        assert (p > low - slack).all()
        assert (p < high + slack).all()


@pytest.mark.parametrize("precision", PRECISIONS)
def test_a_ray_leaves_a_plane_that_contains_its_origin(precision):
    """Also at a grazing angle, and from beside the edge that two triangles of this plane share."""
    rng = np.random.default_rng(6)
    square = np.array([[-1, -1, 2], [1, -1, 2], [1, 1, 2], [-1, 1, 2]])
    along = rng.uniform(-1, 1, 2000)
    beside = along + rng.normal(0, np.finfo(precision).eps / 8, 2000)
    cosine, angle = rng.uniform(0, 0.1, 2000), rng.uniform(0, 2 * np.pi, 2000)
    o = np.column_stack([along, beside, np.full(2000, 2.0)])
    d = np.column_stack([np.cos(angle), np.sin(angle), cosine])
    for axis in range(3):
        bvh = rt.BVH(np.roll(square, axis, axis=1), [[0, 1, 2], [0, 2, 3]], precision=precision)
        assert not bvh.any_hit(np.roll(o, axis, axis=1), np.roll(d, axis, axis=1)).any()


@pytest.mark.parametrize("precision", PRECISIONS)
def test_inclusion_is_exact_where_products_of_an_edge_are_rounded_to_the_same(precision):
    """Fibonacci numbers: F(n)^2 and F(n-1) F(n+1) differ by 1, which their products in floats can't show."""
    fibonacci = [1, 1]
    while fibonacci[-1] < 2 ** np.finfo(precision).nmant:
        fibonacci.append(fibonacci[-1] + fibonacci[-2])
    answers = set()
    for n in range(len(fibonacci) - 6, len(fibonacci) - 2):
        p, q = (fibonacci[n], fibonacci[n + 1]), (-fibonacci[n - 1], -fibonacci[n])
        for side in (1, -1):
            third = (-side * fibonacci[n], side * fibonacci[n - 1])
            for order in ((0, 1, 2), (1, 0, 2), (2, 0, 1)):
                for axis in range(3):
                    corners = np.array([(*p, 0), (*q, 0), (*third, 0)], precision)[list(order)]
                    corners, o, d = (np.roll(a, axis, axis=-1) for a in (corners, [0, 0, 5], [0, 0, -1]))
                    expected = exact.classify(corners, o, d).kind
                    answers.add(expected)
                    assert hits_of(corners, o, d, precision).prim_id[0] == (0 if expected == "interior" else -1)
    assert answers == {"interior", "miss"}
