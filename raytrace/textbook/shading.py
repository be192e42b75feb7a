"""What happens at a surface: the point and its normals, reflection, refraction, and light from the lamps."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.records import Hits, Scene
from raytrace.textbook.camera import unit
from raytrace.textbook.tree import Tree, traverse

F8 = NDArray[np.floating]
EPSILON = 1e-9  # of the scene's size: how far rays start from a surface; the kernels derive a bound instead


def dot(a: F8, b: F8) -> F8:
    """Dot products of vectors (..., 3), with a last axis of 1."""
    return np.sum(a * b, axis=-1, keepdims=True)


class Point(NamedTuple):
    """Points on surfaces that rays along d met, a row per ray."""

    p: F8  # (n, 3) world units
    ng: F8  # (n, 3) unit geometric normal, of the front
    ns: F8  # (n, 3) unit shading normal
    d: F8  # (n, 3) unit direction of the ray that came
    material: NDArray[np.int32]  # (n,) row of the materials


def surface_at(scene: Scene, hits: Hits, d: F8) -> Point:
    """Points p = (1 - u - v) v0 + u v1 + v v2 and normals of hits."""
    corners = scene.mesh.vertices[scene.mesh.faces[hits.prim_id]]
    weights = np.stack([1 - hits.u - hits.v, hits.u, hits.v], axis=1)[..., None]
    ng = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    smooth = scene.mesh.normals
    ns = ng if smooth is None else unit((weights * smooth[hits.prim_id]).sum(axis=1))
    return Point((weights * corners).sum(axis=1), ng, ns, d, scene.mesh.material_id[hits.prim_id])


def leave(scene: Scene, p: F8, ng: F8, d: F8) -> F8:
    """Origins of rays along d that leave points p: moved off the surface, so that it is not met again."""
    step = EPSILON * np.linalg.norm(np.ptp(scene.mesh.vertices, axis=0))
    return p + step * np.sign(dot(d, ng)) * ng


def reflect(d: F8, n: F8) -> F8:
    """Mirror directions d (n, 3) at surfaces of unit normal n.

    Examples
    --------
    >>> import numpy as np
    >>> reflect(np.array([1.0, -1.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    array([1., 1., 0.])
    """
    return d - 2 * dot(d, n) * n


def refract(d: F8, n: F8, eta: F8 | float) -> tuple[F8, NDArray[np.bool_]]:
    """Refract directions by Snell's law: sin(theta_t) = sin(theta_i) / eta; reflect where that exceeds 1.

    Parameters
    ----------
    d : (n, 3) array
        Unit directions, towards the surface.
    n : (n, 3) array
        Unit normals, on the side that d comes from.
    eta : float or (n, 1) array
        Index of refraction of the far side over that of the near side.

    Returns
    -------
    direction : (n, 3) array
    total : (n,) array of bool
        Where reflection is total.

    Examples
    --------
    >>> import numpy as np
    >>> d, n = np.array([[0.6, -0.8, 0.0]]), np.array([[0.0, 1.0, 0.0]])
    >>> refract(d, n, 1.5)[0].round(3)
    array([[ 0.4  , -0.917,  0.   ]])
    >>> refract(d, n, 0.5)[1]
    array([ True])
    """
    cos_i = -dot(d, n)
    sin2_t = (1 - cos_i**2) / eta**2
    total = sin2_t >= 1
    cos_t = np.sqrt(np.where(total, 0, 1 - sin2_t))
    transmitted = d / eta + (cos_i / eta - cos_t) * n  # [Pharr2023, 9.3]
    return np.where(total, reflect(d, n), transmitted), total[:, 0]


def pass_interface(scene: Scene, point: Point) -> tuple[F8, F8]:
    """Origins and directions of the rays that go on from refractive surfaces.

    The geometric normal tells inside from outside. Snell's law uses the shading normal, unless that faces away from
    the ray, or sends it to the wrong side of the triangle.
    """
    entering = dot(point.d, point.ng) < 0
    ior = scene.materials.ior[point.material][:, None]
    eta, side = np.where(entering, ior, 1 / ior), np.where(entering, 1.0, -1.0)
    ng, ns = side * point.ng, side * point.ns
    d, total = refract(point.d, np.where(dot(point.d, ns) < 0, ns, ng), eta)
    wrong = (dot(d, ng) > 0) != total[:, None]
    d = np.where(wrong, refract(point.d, ng, eta)[0], d)
    return leave(scene, point.p, point.ng, d), d


def direct_light(scene: Scene, blockers: Tree | None, point: Point) -> F8:
    """Radiance (n, 3) that diffuse surfaces reflect from all point lights: the sum of albedo / pi * E * visibility.

    E = Phi cos(theta) / (4 pi r^2) is the irradiance from a light of flux Phi at distance r. A surface shows and
    reflects light on its front only, unless it is two-sided. A shadow ray ends at the light, where t = 1.
    """
    turned = scene.materials.two_sided[point.material][:, None] & (dot(point.d, point.ng) > 0)
    ng, ns = np.where(turned, -point.ng, point.ng), np.where(turned, -point.ns, point.ns)
    albedo = scene.materials.albedo[point.material]
    radiance = np.zeros_like(point.p)
    for position, flux in zip(scene.lights.position, scene.lights.flux, strict=True):
        to_light = position - point.p
        r2 = dot(to_light, to_light)
        cos = dot(to_light, ns) / np.sqrt(r2)
        lit = np.flatnonzero((dot(point.d, ng) < 0) & (dot(to_light, ng) > 0) & (cos > 0))
        if blockers is not None:
            o = leave(scene, point.p[lit], ng[lit], to_light[lit])
            lit = lit[traverse(blockers, o, position - o, 1 - EPSILON).prim_id < 0]
        radiance[lit] += albedo[lit] / math.pi * flux * cos[lit] / (4 * math.pi * r2[lit])
    return radiance
