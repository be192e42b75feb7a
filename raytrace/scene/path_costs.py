"""What path tracing costs, as bounds on the rays of a sample; and which light it finds badly."""

from typing import NamedTuple

import numpy as np

from raytrace.errors import printable
from raytrace.records import DIFFUSE, MIRROR, SCATTERING, Scene

ROULETTE_FROM, SURVIVE = 5, 0.05  # as in passes/paths.py
SMALL = 1e-3  # area of a lamp over that of the sphere around the scene: a smaller one is found by chance only


class MostRays(NamedTuple):
    """Bounds on the expected number of rays of a sample."""

    closest: float  # camera rays included
    shadow: float


def most_rays(scene: Scene) -> MostRays:
    """Bound the expected number of rays of a sample; reached where all surfaces reflect alike and no path gets out.

    Notes
    -----
    Let r be the largest reflectance of all surfaces. Each surface up to number 4 sends every path on. At surface
    number 5 the throughput is at most r^5, so that a share of at most max(r^5, 0.05) survives; survivors are divided by
    it, which brings their throughput to at most 1, so that at each surface after that at most max(r, 0.05) survive.

    Examples
    --------
    >>> import raytrace as rt
    >>> most_rays(rt.load("scenes/cornell-box-area.json"))
    MostRays(closest=5.7..., shadow=5.7...)
    """
    used = np.flatnonzero(np.bincount(scene.mesh.material_id))
    kinds, depth, path = scene.materials.kind[used], scene.settings.max_depth, scene.settings.integrator == "path"
    ends = np.array([kind in SCATTERING for kind in kinds.tolist()])
    scatters, finds = bool(ends.any()), meets_light(scene)
    fixed = (kinds == DIFFUSE) | (kinds == MIRROR)
    if scene.textures is not None:  # the table has the mean of a texture
        fixed &= scene.textures.reflectance[used] < 0
    reflectance = np.where(fixed[:, None], scene.materials.albedo[used], 1.0)
    if not path:  # only what is perfectly specular sends paths on, but for one ray that looks for light
        reflectance[ends] = 0.0
    alive = _alive(depth, float(reflectance.max()))
    if not path:
        most = min(sum(alive) + float(finds and scatters), depth + 1.0)
        return MostRays(most, float(scatters))
    return MostRays(sum(alive if finds else alive[:-1]), sum(alive[:-1]) if scatters else 0.0)


def _alive(depth: int, reflectance: float) -> list[float]:
    """Bound the expected number of rays to surface number 1, 2, ... of a sample, to depth + 1 in all."""
    alive = [1.0]
    for surface in range(1, depth + 1):
        chance = min(reflectance, 1.0)
        if surface < ROULETTE_FROM:
            chance = float(reflectance > 0)
        elif surface == ROULETTE_FROM:
            chance = reflectance**ROULETTE_FROM
        alive.append(alive[-1] * (max(chance, SURVIVE) if reflectance > 0 else 0.0))
    return alive


def meets_light(scene: Scene) -> bool:
    """Whether a path can meet light: a lamp or the environment."""
    return scene.materials.emission is not None or scene.lights.environment is not None


def light_warnings(scene: Scene) -> tuple[str, ...]:
    """What of the light is not physical, or is found badly; one line each."""
    materials, lights = scene.materials, scene.lights
    used = np.flatnonzero(np.bincount(scene.mesh.material_id))
    lines = []
    if materials.transparent_shadow[used].any():
        names = _names(scene, used[materials.transparent_shadow[used]])
        lines.append(f'{names}: "shadows": "transparent" is not physical: light passes unbent, and casts no caustic')
    kinds = set(materials.kind[used].tolist())
    if scene.settings.integrator != "path" or kinds.isdisjoint(SCATTERING) or kinds <= set(SCATTERING):
        return tuple(lines)
    if len(lights.flux) or lights.spots is not None or lights.directions is not None:
        lines.append(
            "point, spot and directional lights cast no caustics: no path can meet them, and shadow rays stop at "
            "mirrors, metals and glass; a lamp, even a small one, does"
        )
    if small := _small_lamps(scene):
        lines.append(
            f"{_names(scene, small)}: caustics of so small a lamp converge slowly, and at few samples the estimated "
            "error is too small; a larger lamp with less emission is easier"
        )
    return tuple(lines)


def _names(scene: Scene, rows: "np.ndarray | list[int]") -> str:
    return ", ".join(printable(scene.materials.name[row]) for row in rows)


def _small_lamps(scene: Scene) -> list[int]:
    """Materials of lamps that few paths meet: those with a small area in all."""
    emission, mesh = scene.materials.emission, scene.mesh
    if emission is None:
        return []
    sphere = np.pi * float((np.ptp(mesh.vertices, axis=0) ** 2).sum())  # 4 pi R^2, R half the diagonal of the box
    small = []
    for row in np.flatnonzero(emission.any(axis=1)):
        corners = mesh.vertices[mesh.faces[mesh.material_id == row]]
        sides = corners[:, 1:] - corners[:, :1]
        area = 0.5 * float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum())
        if 0 < area < SMALL * sphere:
            small.append(int(row))
    return small
