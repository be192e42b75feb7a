"""The slow, obvious twin of the whole renderer: NumPy, float64, every ray against every triangle, no tree.

Only ``raytrace.records`` is shared with the package, so that an error there cannot hide here.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.records import REFRACTIVE, Camera, Hits, Mesh, Scene

F8 = NDArray[np.float64]
PAIRS = 2**14  # rays x triangles at once: 128 KiB a temporary; 1.5x faster than 2**17
UNIT_ROUNDOFF = 2.0**-53


def dot(a: F8, b: F8) -> F8:
    return np.sum(a * b, axis=-1)


def unit(a: F8) -> F8:
    return a / np.sqrt(dot(a, a))[..., None]


def gamma(n: int) -> float:
    """Bound on the relative error of n roundings [Higham2002, lemma 3.1]."""
    return n * UNIT_ROUNDOFF / (1 - n * UNIT_ROUNDOFF)


# --- nearest hit, every pair -----------------------------------------------------------------------------------------


def crossings(vertices: F8, faces: NDArray[np.int64], o: F8, d: F8, kz: int) -> tuple[NDArray[np.bool_], F8, F8, F8]:
    """Which triangles (m,) each line (n,) crosses, and its three edge functions; kz: the largest component of every d.

    [Woop2013]: shear the ray onto the axis kz and look at the signs of three 2D determinants. Two triangles get exactly
    opposite values on the edge that they share, and zero counts as inside: no gap between them.
    """
    kx, ky = (kz + 1) % 3, (kz + 2) % 3
    z = vertices[:, kz] - o[:, kz, None]
    x = (vertices[:, kx] - o[:, kx, None]) - (d[:, kx] / d[:, kz])[:, None] * z
    y = (vertices[:, ky] - o[:, ky, None]) - (d[:, ky] / d[:, kz])[:, None] * z
    (ax, bx, cx), (ay, by, cy) = ([c[:, corner] for corner in faces.T] for c in (x, y))
    e0, e1, e2 = cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax  # opposite to v0, v1, v2
    least, most = np.minimum(np.minimum(e0, e1), e2), np.maximum(np.maximum(e0, e1), e2)
    return (least >= 0) | (most <= 0), e0, e1, e2


def closest_hit(
    vertices: ArrayLike,
    faces: ArrayLike,
    origins: ArrayLike,
    directions: ArrayLike,
    tmin: ArrayLike = 0.0,
    tmax: ArrayLike = np.inf,
) -> Hits:
    """Nearest triangle with tmin < t < tmax of each ray; of equal t the lowest prim_id; a ray not finite misses."""
    v, f = np.asarray(vertices, np.float64), np.asarray(faces, np.int64)
    o, d = (np.atleast_2d(np.asarray(a, np.float64)) for a in (origins, directions))
    lo, hi = (np.broadcast_to(np.asarray(a, np.float64), len(o)) for a in (tmin, tmax))
    hits = Hits(np.full(len(o), np.inf), np.full(len(o), -1, np.int32), np.zeros(len(o)), np.zeros(len(o)))
    axis = np.argmax(np.abs(d), axis=1)
    rows_at_once = max(1, PAIRS // max(len(f), 1))
    for kz in range(3):
        rays = np.flatnonzero((axis == kz) & np.isfinite(o).all(axis=1) & np.isfinite(d).all(axis=1))
        for start in range(0, len(rays), rows_at_once):
            _nearest((v, f), (o, d, lo, hi), kz, rays[start : start + rows_at_once], hits)
    return hits


def _nearest(mesh: tuple[F8, NDArray[np.int64]], rays: tuple[F8, F8, F8, F8], kz: int, i: NDArray, hits: Hits) -> None:
    """Write the rows i of hits."""
    (v, f), (o, d, tmin, tmax) = mesh, (a[i] for a in rays)
    with np.errstate(all="ignore"):
        inside, *edges = crossings(v, f, o, d, kz)
        row, prim = np.nonzero(inside)
        weights = np.stack([e[row, prim] for e in edges])
        weights /= weights.sum(axis=0)  # 0 / 0: the triangle is seen edge on
        normal = np.cross(v[f[prim, 1]] - v[f[prim, 0]], v[f[prim, 2]] - v[f[prim, 0]])
        along = dot(normal, d[row])  # 0: no area, or the ray lies in the plane
        t = dot(normal, v[f[prim, 0]] - o[row]) / along
        keep = (along != 0) & np.isfinite(weights).all(axis=0) & (t > tmin[row]) & (t < tmax[row])  # NaN: a miss
    row, found = row[keep], (t[keep], prim[keep], weights[1, keep], weights[2, keep])
    order = np.lexsort((found[1], found[0], row))
    row, first = np.unique(row[order], return_index=True)
    for field, value in zip(hits, found, strict=True):
        field[i[row]] = value[order[first]]


def any_hit(
    vertices: ArrayLike,
    faces: ArrayLike,
    origins: ArrayLike,
    directions: ArrayLike,
    tmin: ArrayLike = 0.0,
    tmax: ArrayLike = np.inf,
) -> NDArray[np.bool_]:
    """Whether each ray meets anything with tmin < t < tmax."""
    return closest_hit(vertices, faces, origins, directions, tmin, tmax).prim_id >= 0


# --- optics ----------------------------------------------------------------------------------------------------------


def reflect(d: F8, n: F8) -> F8:
    """Mirror d at a surface of unit normal n."""
    return d - 2 * dot(d, n)[..., None] * n


def refract(d: F8, n: F8, eta: F8) -> tuple[F8, NDArray[np.bool_]]:
    """Snell: sin_t = sin_i / eta; n on the side of the ray, eta = transmitted / incident; reflects where total."""
    cos_i = -dot(d, n)
    sin2_t = (1 - cos_i**2) / eta**2
    total = sin2_t >= 1
    cos_t = np.sqrt(1 - np.where(total, 0, sin2_t))
    transmitted = unit(d / np.asarray(eta)[..., None] + (cos_i / eta - cos_t)[..., None] * n)
    return np.where(total[..., None], reflect(d, n), transmitted), total


def irradiance(flux: F8, cos: F8, r2: F8) -> F8:
    """Of a point light that sends its flux to all sides: Phi cos / (4 pi r^2)."""
    return flux * (cos / (4 * math.pi * r2))[:, None]


# --- camera ----------------------------------------------------------------------------------------------------------


def camera_rays(camera: Camera, size: tuple[int, int], film_xy: F8) -> tuple[F8, F8]:
    """Origins and unit directions through film points (n, 2): x right, y down; pixel (c, r) is [c, c+1) x [r, r+1)."""
    forward = unit(camera.look_at - camera.position)
    right = unit(np.cross(forward, camera.up))
    up = np.cross(right, forward)
    width, height = size
    half = math.tan(math.radians(camera.fov) / 2)  # half the film's height at distance 1
    x = (2 * film_xy[:, :1] - width) / height * half
    y = (height - 2 * film_xy[:, 1:]) / height * half
    d = unit(forward + x * right + y * up)
    return np.broadcast_to(camera.position, d.shape).copy(), d


# --- surfaces --------------------------------------------------------------------------------------------------------


def surface(mesh: Mesh, hits: Hits) -> tuple[F8, F8, F8, F8]:
    """Point, bound on its error, geometric and shading normal of each hit."""
    v0, v1, v2 = np.moveaxis(mesh.vertices[mesh.faces[hits.prim_id]], 1, 0)
    weights = np.stack([1 - hits.u - hits.v, hits.u, hits.v], axis=1)
    p = weights[:, :1] * v0 + weights[:, 1:2] * v1 + weights[:, 2:] * v2
    p_error = gamma(3) * (np.abs(p) + 4 * np.ptp([v0, v1, v2], axis=0))
    ng = unit(np.cross(v1 - v0, v2 - v0))
    return p, p_error, ng, ng if mesh.normals is None else smooth_normal(mesh.normals[hits.prim_id], weights)


def smooth_normal(corners: F8, weights: F8) -> F8:
    return unit(np.einsum("nk,nkc->nc", weights, corners))


def spawn(p: F8, p_error: F8, ng: F8, d: F8) -> F8:
    """Origin of a ray along d that leaves p: off the surface by the error bound along ng, to the side of d."""
    side = np.where(dot(d, ng) > 0, 1.0, -1.0)
    return p + (side * dot(np.abs(ng), p_error))[:, None] * ng


def bounce(d: F8, ng: F8, ns: F8, ior: F8) -> F8:
    """Where the light goes on at a refractive surface: ng tells inside from outside, ns is the normal of Snell's law.

    ng replaces ns where ns faces away from the ray, or would send it to the wrong side of the triangle.
    """
    entering = dot(d, ng) < 0
    eta = np.where(entering, ior, 1 / ior)
    side = np.where(entering, 1.0, -1.0)[:, None]
    ng, ns = side * ng, side * ns
    w, total = refract(d, np.where((dot(d, ns) < 0)[:, None], ns, ng), eta)
    wrong = np.where(total, dot(w, ng) <= 0, dot(w, ng) >= 0)
    return np.where(wrong[:, None], refract(d, ng, eta)[0], w)


# --- light -----------------------------------------------------------------------------------------------------------


def occluded(scene: Scene, o: F8, target: F8) -> NDArray[np.bool_]:
    """Whether anything that casts a shadow lies between o and the target."""
    casts = ~scene.materials.transparent_shadow[scene.mesh.material_id]
    return any_hit(scene.mesh.vertices, scene.mesh.faces[casts], o, target - o, 0.0, 1.0)


def direct_light(scene: Scene, d: F8, prim_id: NDArray[np.int32], point: tuple[F8, F8, F8, F8]) -> F8:
    """Radiance (n, 3) that diffuse points send back along d: the sum over lights of albedo / pi * E * visibility."""
    p, p_error, ng, ns = point
    material = scene.mesh.material_id[prim_id]
    turned = scene.materials.two_sided[material] & (dot(d, ng) > 0)
    side = np.where(turned, -1.0, 1.0)[:, None]
    ng, ns = side * ng, side * ns
    L = np.zeros_like(p)
    for position, flux in zip(scene.lights.position, scene.lights.flux, strict=True):
        to_light = position - p
        r2 = dot(to_light, to_light)
        wi = to_light / np.sqrt(r2)[:, None]
        lit = (dot(d, ng) < 0) & (dot(wi, ng) > 0) & (dot(wi, ns) > 0)
        i = np.flatnonzero(lit)
        i = i[~occluded(scene, spawn(p[i], p_error[i], ng[i], wi[i]), position)]
        E = irradiance(flux, dot(wi[i], ns[i]), r2[i])
        L[i] += scene.materials.albedo[material[i]] / math.pi * E
    return L


def radiance(scene: Scene, origins: F8, directions: F8, max_depth: int) -> F8:
    """Radiance (n, 3) that arrives along each ray; a path that met max_depth refractive surfaces brings none."""
    o, d = origins.copy(), directions.copy()
    L = np.zeros_like(o)
    path = np.arange(len(o))  # the row that each ray in flight belongs to
    for _ in range(max_depth):
        hits = closest_hit(scene.mesh.vertices, scene.mesh.faces, o, d)
        missed = hits.prim_id < 0
        L[path[missed]] = scene.background
        hits, path, d = Hits(*(field[~missed] for field in hits)), path[~missed], d[~missed]
        point = surface(scene.mesh, hits)
        material = scene.mesh.material_id[hits.prim_id]
        goes_on = scene.materials.kind[material] == REFRACTIVE
        landed = ~goes_on
        L[path[landed]] = direct_light(scene, d[landed], hits.prim_id[landed], tuple(a[landed] for a in point))
        p, p_error, ng, ns = (a[goes_on] for a in point)
        d = bounce(d[goes_on], ng, ns, scene.materials.ior[material[goes_on]])
        o, path = spawn(p, p_error, ng, d), path[goes_on]
    return L


def render(scene: Scene, film_xy: F8, size: tuple[int, int] | None = None, max_depth: int | None = None) -> F8:
    """Mean radiance (h, w, 3) over the film points (h, w, spp, 2); the film may be a crop of the camera's size."""
    o, d = camera_rays(scene.camera, size or scene.settings.size, film_xy.reshape(-1, 2))
    L = radiance(scene, o, d, scene.settings.max_depth if max_depth is None else max_depth)
    return L.reshape(*film_xy.shape[:3], 3).mean(axis=2)
