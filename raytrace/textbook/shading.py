"""What happens at a surface: the point and its normals, reflection, refraction, and direct light."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.record_display import displayed
from raytrace.records import Hits, Scene
from raytrace.textbook.camera import unit
from raytrace.textbook.tree import Tree, traverse

F8 = NDArray[np.floating]
EPSILON = 1e-9  # rays start this fraction of the scene's diagonal off a surface; the kernels derive a bound instead


def dot(a: F8, b: F8) -> F8:
    """Return dot products of vectors (..., 3), with a last axis of length 1."""
    return np.sum(a * b, axis=-1, keepdims=True)


@displayed
class Point(NamedTuple):
    """Points where rays met surfaces; one row per ray."""

    p: F8  # (n, 3) world units
    ng: F8  # (n, 3) unit geometric normal, on the front side
    ns: F8  # (n, 3) unit shading normal
    d: F8  # (n, 3) unit direction of the arriving ray
    material: NDArray[np.int32]  # (n,) row in the table of materials


def surface_at(scene: Scene, hits: Hits, d: F8) -> Point:
    """Return points p = (1 - u - v) v0 + u v1 + v v2 and normals of hits."""
    corners = scene.mesh.vertices[scene.mesh.faces[hits.prim_id]]
    weights = np.stack([1 - hits.u - hits.v, hits.u, hits.v], axis=1)[..., None]
    ng = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    smooth = scene.mesh.normals
    ns = ng if smooth is None else unit((weights * smooth[hits.prim_id]).sum(axis=1))
    return Point((weights * corners).sum(axis=1), ng, ns, d, scene.mesh.material_id[hits.prim_id])


def offset_origin(scene: Scene, p: F8, ng: F8, d: F8) -> F8:
    """Return origins of rays along d that leave points p: moved off the surface, so that they do not hit it again."""
    step = EPSILON * np.linalg.norm(np.ptp(scene.mesh.vertices, axis=0))
    return p + step * np.sign(dot(d, ng)) * ng


def reflect(d: F8, n: F8) -> F8:
    """Return directions d (..., 3) mirrored at surfaces of unit normal n.

    Examples
    --------
    >>> import numpy as np
    >>> reflect(np.array([1.0, -1.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    array([1., 1., 0.])
    """
    return d - 2 * dot(d, n) * n


def refract(d: F8, n: F8, eta: F8 | float) -> tuple[F8, NDArray[np.bool_]]:
    """Refract directions by Snell's law, sin(theta_t) = sin(theta_i) / eta. Reflect them where that exceeds 1.

    Parameters
    ----------
    d : (..., 3) array
        Unit directions, towards the surface.
    n : (..., 3) array
        Unit normals, on the side that d comes from.
    eta : float or (..., 1) array
        Index of refraction of the far side over that of the near side.

    Returns
    -------
    direction : (..., 3) array
    total : (...) array of bool
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
    return np.where(total, reflect(d, n), transmitted), total[..., 0]


def pass_interface(scene: Scene, point: Point) -> tuple[F8, F8]:
    """Return origins and directions of the rays that continue from refractive surfaces.

    The geometric normal distinguishes inside and outside. Snell's law uses the shading normal. Where that faces away
    from the ray, or sends it to the wrong side of the triangle, the geometric normal replaces it.
    """
    entering = dot(point.d, point.ng) < 0
    ior = scene.materials.ior[point.material][:, None]
    eta, sign = np.where(entering, ior, 1 / ior), np.where(entering, 1.0, -1.0)
    ng, ns = sign * point.ng, sign * point.ns  # on the side that the ray comes from
    d, total = refract(point.d, np.where(dot(point.d, ns) < 0, ns, ng), eta)
    wrong_side = (dot(d, ng) > 0) != total[:, None]
    d = np.where(wrong_side, refract(point.d, ng, eta)[0], d)
    return offset_origin(scene, point.p, point.ng, d), d


def irradiance(p: F8, n: F8, position: F8, flux: F8) -> F8:
    """Return the irradiance (m, 3) of points p with unit normals n from a point light: E = Phi cos(theta) / (4 pi r^2).

    E is 0 where the light is behind the surface.

    Examples
    --------
    >>> import numpy as np
    >>> p, up = np.zeros((1, 3)), np.array([[0.0, 1.0, 0.0]])
    >>> irradiance(p, up, np.array([0.0, 2.0, 0.0]), 16 * np.pi * np.ones(3)).round(6)
    array([[1., 1., 1.]])
    """
    to_light = position - p
    r2 = dot(to_light, to_light)
    cos = np.maximum(dot(to_light, n), 0) / np.sqrt(r2)
    return flux * cos / (4 * math.pi * r2)


def direct_light(scene: Scene, blockers: Tree | None, point: Point) -> F8:
    """Return the radiance (n, 3) that diffuse surfaces reflect: the sum over lights of albedo / pi * E * visibility.

    E is the irradiance from one light. A surface reflects light on its front only, unless it is two-sided. A shadow ray
    starts at the surface and ends at the light, where t = 1.
    """
    use_back = scene.materials.two_sided[point.material][:, None] & (dot(point.d, point.ng) > 0)
    ng, ns = np.where(use_back, -point.ng, point.ng), np.where(use_back, -point.ns, point.ns)
    albedo = scene.materials.albedo[point.material]
    radiance = np.zeros_like(point.p)
    for position, flux in zip(scene.lights.position, scene.lights.flux, strict=True):
        to_light = position - point.p
        lit = np.flatnonzero((dot(point.d, ng) < 0) & (dot(to_light, ng) > 0) & (dot(to_light, ns) > 0))
        if blockers is not None:
            o = offset_origin(scene, point.p[lit], ng[lit], to_light[lit])
            lit = lit[traverse(blockers, o, position - o, 1 - EPSILON).prim_id < 0]
        radiance[lit] += albedo[lit] / math.pi * irradiance(point.p[lit], ns[lit], position, flux)
    return radiance
