"""The bounce: directions as Snell says, origins on the right side, rays side by side with their slots."""

import numpy as np
import pytest

import exact_optics
import naive
import rays
import raytrace as rt
from raytrace.passes.refraction import land, refract_rays
from raytrace.records import DIFFUSE, REFRACTIVE, Batch, Hits, Mesh, Shading

pytestmark = pytest.mark.engine

PRECISIONS = ("float32", "float64")
TOLERANCE = {"float32": 2e-6, "float64": 3e-14}
IOR = np.array([1.0, 1.5, 1 / 1.5, 1.0])  # material 0 is diffuse
QUIET = pytest.mark.filterwarnings("ignore::RuntimeWarning")


def batch(n, precision):
    hits = Hits(np.zeros(n, precision), np.zeros(n, np.int32), np.zeros(n, precision), np.zeros(n, precision))
    return Batch(np.full(3 * n, 7, precision), np.full(3 * n, 7, precision), np.full(n, -7, np.int32), hits)


def case(precision, smooth=False, n=2048):
    """A batch that hit a soup of four materials, the twin's scene, and what the kernel looks up of it."""
    vertices, faces = rays.soup(80, seed=1)
    bvh = rt.BVH(vertices, faces, precision)
    rng = np.random.default_rng(2)
    corners = bvh.vertices.astype(np.float64)[faces]
    flat = naive.unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    normals = naive.unit(flat[:, None] + 0.3 * rng.normal(size=(80, 3, 3))) if smooth else None
    material = rng.integers(0, len(IOR), 80).astype(np.int32)
    mesh = Mesh(bvh.vertices.astype(np.float64), faces, normals, material, np.zeros(80, np.int32))
    kind = np.where(np.arange(len(IOR)) == 0, DIFFUSE, REFRACTIVE)
    table = np.column_stack([np.ones((len(IOR), 3)), IOR, np.zeros(len(IOR)), kind])
    shading = Shading(bvh.triangles.ravel(), material, table.astype(precision).ravel())
    o, d = rays.anywhere(n, seed=3)
    o, d = o.astype(precision), naive.unit(d).astype(precision)
    t, prim_id, u, v = naive.closest_hit(mesh.vertices, faces, 0.7 * o, d)
    hits = Hits(t.astype(precision), prim_id, u.astype(precision), v.astype(precision))
    slot = rng.permutation(3 * n)[:n].astype(np.int32)
    return mesh, shading, Batch(o.T.ravel().copy(), d.T.ravel().copy(), slot, hits)


def send(mesh, shading, source, n):
    target = batch(len(source.slot), source.d.dtype)
    normals = None if mesh.normals is None else mesh.normals.astype(source.d.dtype).ravel()
    return refract_rays(shading, normals, source, n, target), target


def rows(flat):
    return flat.reshape(3, -1).T


def goes_on(mesh, source, n):
    """Numbers of the rays among the first n that met an interface."""
    prim = source.hits.prim_id[:n]
    return np.flatnonzero((prim >= 0) & (mesh.material_id[prim] != 0))


@pytest.mark.nojit
@QUIET
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("n", [0, 1, 100, 384])
def test_rays_that_met_an_interface_lie_side_by_side_with_their_slots(n, precision):
    mesh, shading, source = case(precision, n=384)
    expected = goes_on(mesh, source, n)
    sent, target = send(mesh, shading, source, n)
    assert sent == len(expected)
    assert np.array_equal(target.slot[:sent], source.slot[expected])
    assert (target.slot[sent:] == -7).all()
    for field in (target.o, target.d):
        assert (rows(field)[sent:] == 7).all()
        assert (rows(field)[:sent] != 7).all()


@pytest.mark.parametrize("precision", PRECISIONS)
def test_directions_are_those_of_the_public_function(precision):
    mesh, shading, source = case(precision)
    sent, target = send(mesh, shading, source, len(source.slot))
    met = goes_on(mesh, source, len(source.slot))
    prim, d, eps = source.hits.prim_id[met], rows(source.d)[met], np.finfo(precision).eps
    ng = shading.triangles.reshape(-1, 12)[prim, 9:]
    front = naive.dot(d, ng) < 0
    ior = IOR.astype(precision)[mesh.material_id[prim]]
    eta = np.where(front, ior, 1 / ior)
    ng = np.where(front[:, None], ng, -ng)
    expected, total = rt.refract(d, ng, eta)
    rest = 1 - (1 - naive.dot(d, ng).astype(np.float64) ** 2) / eta**2
    clear = np.abs(rest) > 32 * eps  # elsewhere, either may call it total
    assert 0.02 < total[clear].mean() < 0.5
    out = rows(target.d)[:sent]
    assert np.array_equal(naive.dot(out, ng)[clear] > 0, total[clear])
    # the sums are in another order: eps of 1 - sin^2, which its root divides by the cosine
    error = np.abs(out - expected).max(axis=1) * np.sqrt(np.abs(rest))
    assert error[clear].max() < 8 * eps
    same = (ior == 1) & clear
    assert same.any()
    assert rays.same_bits(out[same], d[same])


@pytest.mark.nojit
@QUIET
@pytest.mark.parametrize("precision", PRECISIONS)
def test_smooth_directions_are_the_twins(precision):
    mesh, shading, source = case(precision, smooth=True, n=512)
    sent, target = send(mesh, shading, source, 512)
    met = goes_on(mesh, source, 512)
    hits = Hits(
        *(column[met].astype(np.float64) if column.dtype.kind == "f" else column[met] for column in source.hits)
    )
    _, _, ng, ns = naive.surface(mesh, hits)
    d = rows(source.d)[met].astype(np.float64)
    expected = naive.bounce(d, ng, ns, IOR[mesh.material_id[hits.prim_id]])
    flat = naive.bounce(d, ng, ng, IOR[mesh.material_id[hits.prim_id]])
    same = np.isclose(rows(target.d)[:sent], expected, atol=1e-3 if precision == "float32" else 1e-9).all(axis=1)
    assert same.mean() > 0.99  # where a cosine is about zero, either normal may have been taken
    assert (np.abs(flat - expected).max(axis=1) > 1e-2).mean() > 0.5  # and normals do matter
    # every ray goes to the side of the triangle on which it starts, whatever the shading normal says
    start = rows(target.o)[:sent] - mesh.vertices[mesh.faces[hits.prim_id, 0]]
    side = naive.dot(rows(target.d)[:sent].astype(np.float64), ng) * np.sign(naive.dot(start, ng))
    assert (side > 0).all()


@pytest.mark.parametrize("precision", PRECISIONS)
def test_origins_lie_off_the_surface_on_the_side_that_the_ray_goes(precision):
    mesh, shading, source = case(precision)
    sent, target = send(mesh, shading, source, len(source.slot))
    met = goes_on(mesh, source, len(source.slot))
    hits = Hits(*(column[met] for column in source.hits))
    corners = shading.triangles.reshape(-1, 12)[hits.prim_id]
    ng = corners[:, 9:].astype(np.float64)
    side = np.sign(naive.dot(rows(target.d)[:sent].astype(np.float64), ng))
    height = naive.dot(rows(target.o)[:sent].astype(np.float64) - corners[:, :3], ng) * side
    assert (height > 0).all()
    # gamma(3) of a coordinate up to 3 and 4 extents up to 6, on three axes; more than a point itself is off
    assert (height < 1.5 * (3 + 4 * 6) * 3 * np.finfo(precision).eps).all()
    for k in range(0, sent, 7):  # and so they never meet the triangle that they left
        one = rt.BVH(corners[k, :9].reshape(3, 3), [[0, 1, 2]], precision)
        assert not one.any_hit(rows(target.o)[k], rows(target.d)[k])[0]


@pytest.mark.nojit
@QUIET
@pytest.mark.parametrize("precision", PRECISIONS)
def test_what_has_landed_is_copied_to_its_sample(precision):
    rng = np.random.default_rng(4)
    n, count = 64, 20
    source, landed = batch(n, precision), batch(n, precision)
    for field in (source.d, source.hits.t, source.hits.u, source.hits.v):
        field[:] = rng.normal(size=len(field))
    source.hits.prim_id[:] = rng.integers(0, 99, n)
    source.slot[:] = rng.permutation(n)
    land(source, count, landed)
    slot = source.slot[:count]
    others = np.setdiff1d(np.arange(n), slot)
    for got, sent in zip(landed.hits, source.hits, strict=True):
        assert np.array_equal(got[slot], sent[:count])
        assert (got[others] == 0).all()
    assert np.array_equal(rows(landed.d)[slot], rows(source.d)[:count])
    assert (rows(landed.d)[others] == 7).all()


def interfaces(normals, precision):
    """Rows (n, 12) of triangles with about these normals: corners, and the unit normals as kernels read them."""
    u = naive.unit(np.cross(normals, np.roll(normals, 1, axis=1)))
    v = np.cross(normals, u)
    corners = np.stack([normals + u, normals - u + v, normals - u - v], axis=1)
    bvh = rt.BVH(corners.reshape(-1, 3), np.arange(3 * len(normals)).reshape(-1, 3), precision)
    return bvh.triangles


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("ior", exact_optics.INDICES)
@pytest.mark.parametrize("where", exact_optics.WHERE)
def test_directions_agree_with_fifty_digits(where, ior, precision):
    n, ior = 32, np.array(ior, precision)
    d, normals = exact_optics.at_angles(exact_optics.angles(where, float(ior), n, seed=5), 6, "float64")
    triangles = interfaces(normals, precision)
    d, normals = d.astype(precision), triangles[:, 9:]
    shading = Shading(triangles.ravel(), np.zeros(n, np.int32), np.array([1, 1, 1, ior, 0, REFRACTIVE], precision))
    source, target = batch(n, precision), batch(n, precision)
    source.d[:] = d.T.ravel()
    source.hits.prim_id[:], source.hits.u[:], source.hits.v[:] = np.arange(n), 0.25, 0.25
    source.slot[:] = np.arange(n)
    assert refract_rays(shading, None, source, n, target) == n
    out = rows(target.d)
    total = naive.dot(out.astype(np.float64), normals) > 0
    for k in range(n):
        assert exact_optics.agrees(out[k], total[k], (d[k], normals[k], ior), TOLERANCE[precision]), (d[k], normals[k])
