"""Records of path tracing. Fields give shape, dtype, unit and meaning; f is float32 or float64."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.records import Batch


class Paths(NamedTuple):
    """One thread's paths in flight, structure of arrays, a row per path; see passes/paths.py for what begins them."""

    rays: Batch  # origins, unit directions, the sample (slot) that each path belongs to, and hits
    throughput: NDArray[np.floating]  # (3n,) f: product of f cos / pdf at all surfaces so far
    scale: NDArray[np.floating]  # (n,) f: its factors (n_from / n_to)^2 of transmissions, which roulette leaves out
    pdf: NDArray[np.floating]  # (n,) f, 1 / sr: density of the direction; inf: a camera ray, or perfectly specular
    key: NDArray[np.uint32]  # (n,) u4: hash of seed and pixel
    sample: NDArray[np.uint32]  # (n,) u4: number of the sample in its pixel
    state: NDArray[np.int32]  # (n,) i4: SPECULAR_ONLY while no surface has scattered; ENDING after the last surface


class Vertices(NamedTuple):
    """Where paths meet surfaces, seen from the side that they come from."""

    p: NDArray[np.floating]  # (3n,) f, world units
    ng: NDArray[np.floating]  # (3n,) f: unit geometric normal on the side of the ray
    ns: NDArray[np.floating]  # (3n,) f: unit shading normal on that side; the same array as ng if all is flat
    offset: NDArray[np.floating]  # (n,) f, world units: how far along ng a ray must start
    front: NDArray[np.bool_]  # (n,) bool: whether the ray met the front
    material_id: NDArray[np.int32]  # (n,) i4; -1: no surface, or the path has ended


class Incident(NamedTuple):
    """Light that may arrive at vertices from a sampled point of a light, and the shadow ray towards it."""

    light: NDArray[np.int32]  # (n,) i4: row of the lights
    o: NDArray[np.floating]  # (3n,) f, world units
    d: NDArray[np.floating]  # (3n,) f: to the light; unit length only where tmax is inf
    tmax: NDArray[np.floating]  # (n,) f: 1 for lights at a distance, inf for those that are infinitely far; -1: no ray
    wi: NDArray[np.floating]  # (3n,) f: unit direction to the light
    radiance: NDArray[np.floating]  # (3n,) f: radiance / pdf, or irradiance on a plane that faces a light of no size
    pdf: NDArray[np.floating]  # (n,) f, 1 / sr: density of wi, the choice of the light included; inf: no size
    occluded: NDArray[np.bool_]  # (n,) bool


class LightTable(NamedTuple):
    """All lights as they are sampled: a row per light, and per emitting triangle; drawn by an alias table."""

    share: NDArray[np.floating]  # (l,) f: probability of a row
    keep: NDArray[np.floating]  # (l,) f: probability that a row that was drawn evenly is kept
    other: NDArray[np.int32]  # (l,) i4: the row that is taken instead
    kind: NDArray[np.int32]  # (l,) i4: TRIANGLE, POINT, SPOT, DIRECTIONAL or ENVIRONMENT
    prim_id: NDArray[np.int32]  # (l,) i4: the triangle; 0 where it is none
    numbers: NDArray[np.floating]  # (l * 16,) f: see passes/lights.py, by kind


class Surfaces(NamedTuple):
    """What path tracing looks up of materials; flat arrays, a row per material."""

    kind: NDArray[np.int32]  # (k,) i4
    reflectance: NDArray[np.floating]  # (k * 3,) f: albedo, or reflectance of a mirror
    emission: NDArray[np.floating]  # (k * 3,) f, W / (sr m2): radiance of the front
    density: NDArray[np.floating]  # (k,) f, 1 / m2: of a point on a lamp of this material, when lights are sampled
    eta: NDArray[np.floating]  # (k * 3,) f: index of refraction; of a dielectric three times the same
    k: NDArray[np.floating]  # (k * 3,) f: absorption index of a conductor; inf: it reflects everything
    two_sided: NDArray[np.int32]  # (k,) i4: 0 or 1; 1 where rough, because both sides reflect
    transparent_shadow: NDArray[np.int32]  # (k,) i4: 0 or 1
    scatters: NDArray[np.int32]  # (k,) i4: 0 or 1; 0: perfectly specular
    alpha: NDArray[np.floating]  # (k,) f: GGX width
    escape: NDArray[np.floating]  # (k,) f: share of diffuse light from inside that leaves a coat; 1 without a coat


class Order(NamedTuple):
    """Scratch memory for sorting paths."""

    keys: NDArray[np.int32]  # (n,) i4: of octant, dominant axis and cell
    numbers: NDArray[np.int32]  # (n,) i4: paths in the order of their keys
    counts: NDArray[np.int32]  # (k,) i4: paths of each key
