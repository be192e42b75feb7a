"""Last passes of a sample: direct light. Shadow rays to one point light, then the reflection of what arrives."""

import numpy as np

from raytrace.accel.hit_points import gamma
from raytrace.accel.lanes import count, load, packet, packet_width, select, splat, sqrt, store
from raytrace.accel.layout import boxes_of, children_of, triangles_of
from raytrace.accel.vectors import dot
from raytrace.jit import kernel
from raytrace.passes.surface import load3, spawn, store3, vector_of
from raytrace.records import Hits, Points, Shading, Shadows, Tree

FOUR_PI = 4.0 * np.pi
SPAN = 8  # times 3 roundings of the scene's extent: bound on the error of the end of a shadow ray


def triangles_at(tree: Tree, triangles, position):
    """Find the triangles on which a light lies, to within the rounding error of its shadow rays.

    Parameters
    ----------
    tree : Tree
    triangles : (m, 12) f array
        v0, v1, v2 and the unit normal of each.
    position : (3,) f array, world units

    Returns
    -------
    (k,) int array
        Numbers of triangles. In exact arithmetic a shadow ray meets them at its end, t = 1, which is not part of it.
        With rounding, it meets them just before or after.

    Notes
    -----
    A shadow ray may start anywhere in the scene. It measures the distance of the light from a plane with an error of at
    most gamma(24) times the extent of the scene, plus gamma(3) times the coordinates, which are themselves rounded
    [docs/numerics.md].
    """
    light, relative = position.astype(np.float64), gamma(np.finfo(triangles.dtype).eps)
    bounds, child = boxes_of(tree.nodes), children_of(tree.nodes)
    low, high = bounds[0, :3].min(axis=1), bounds[0, 3:].max(axis=1)
    extent = np.maximum(high, light) - np.minimum(low, light)
    margin = relative * (np.maximum(np.maximum(-low, high), 0.0) + np.abs(light) + SPAN * extent)
    near = child < 0
    for axis in range(3):
        near &= bounds[:, axis] <= light[axis] + margin[axis]
        near &= bounds[:, axis + 3] >= light[axis] - margin[axis]
    prims = triangles_of(tree.leaves)[~child[near]].ravel()
    prims = prims[prims >= 0]
    corners, normal = triangles[prims, :9].astype(np.float64).reshape(-1, 3, 3), triangles[prims, 9:]
    reach = relative * (np.abs(corners).max(axis=1) + np.abs(light) + SPAN * extent)
    on = np.abs(np.sum(normal * (light - corners[:, 0]), axis=1)) <= np.sum(np.abs(normal) * reach, axis=1)
    for k in range(3):
        inward = np.cross(normal, corners[:, (k + 1) % 3] - corners[:, k])
        on &= np.sum(inward * (light - corners[:, k]), axis=1) >= -np.sum(np.abs(inward) * reach, axis=1)
    return prims[on]


@kernel
def background(hits: Hits, radiance, colour):
    """Initialise the radiance of samples: the background where a ray left the scene, else 0."""
    like = packet(radiance)
    n = len(radiance) // 3
    for i in range(0, n, packet_width(radiance)):
        escaped = load(hits.prim_id, i, like) == np.int32(-1)
        for k in range(3):
            store(radiance, k * n + i, select(escaped, splat(colour[k], like), 0.0))


@kernel
def shadow_rays(points: Points, position, shadows: Shadows):
    """Make rays from points to a point light, with their irradiance per flux cos / (4 pi r^2); return their number."""
    like = packet(points.p)
    n = len(points.p) // 3
    sent = 0
    for i in range(0, n, packet_width(points.p)):
        offset = load(points.offset, i, like)
        ng, ns = load3(points.ng, i, n, like), load3(points.ns, i, n, like)
        o = spawn(load3(points.p, i, n, like), ng, offset)
        d = position[0] - o[0], position[1] - o[1], position[2] - o[2]
        r2 = dot(d, d)
        cosine = dot(d, ns)  # times r; r^3 would overflow long before r^2 does
        lit = (offset >= 0.0) & (dot(d, ng) > 0.0) & (cosine > 0.0)
        store3(shadows.o, i, n, o)
        store3(shadows.d, i, n, d)
        store(shadows.tmax, i, select(lit, splat(1.0, like), -1.0))
        store(shadows.irradiance, i, select(lit, cosine / sqrt(r2) / (FOUR_PI * r2), 0.0))
        sent += count(lit)
    return sent


@kernel
def reflect_light(shading: Shading, points: Points, shadows: Shadows, flux, radiance):
    """Add albedo / pi times the irradiance of the points that are not in shadow."""
    like = packet(radiance)
    n = len(radiance) // 3
    for i in range(0, n, packet_width(radiance)):
        material = load(points.material_id, i, like)
        occluded = load(shadows.occluded, i, like)
        arriving = select(occluded, 0.0, load(shadows.irradiance, i, like)) / np.pi
        albedo, old = vector_of(shading.materials, material, 6, 0), load3(radiance, i, n, like)
        store(radiance, i, old[0] + albedo[0] * flux[0] * arriving)
        store(radiance, n + i, old[1] + albedo[1] * flux[1] * arriving)
        store(radiance, 2 * n + i, old[2] + albedo[2] * flux[2] * arriving)
