"""The integrator: rays through pixels, bounced until they end on a diffuse surface, and averaged."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.records import REFRACTIVE, Hits, Scene
from raytrace.scene.load import load
from raytrace.textbook.camera import pinhole_rays, stratified
from raytrace.textbook.path import path_trace
from raytrace.textbook.shading import Point, direct_light, pass_interface, surface_at
from raytrace.textbook.tree import Tree, median_split, traverse

F8 = NDArray[np.floating]
BATCH = 2**14  # rays at once, for memory


def integrate(scene: Scene, tree: Tree, blockers: Tree | None, o: F8, d: F8) -> F8:
    """Radiance (n, 3) that arrives along rays.

    Each turn of the loop takes all rays that are still under way to their next surface. Those that leave the scene see
    the background; those on diffuse surfaces see reflected light; the others pass an interface and go on.

    Parameters
    ----------
    scene : Scene
    tree, blockers : Tree
        All triangles, and those that stop shadow rays; None: there are none.
    o, d : (n, 3) arrays
        Origins and unit directions.
    """
    radiance = np.zeros_like(o)  # stays 0 for a path that met max_depth surfaces
    path = np.arange(len(o))  # the row of each ray that is under way
    for _ in range(scene.settings.max_depth):
        if not len(path):
            break
        hits = traverse(tree, o, d)
        radiance[path[hits.prim_id < 0]] = scene.background
        met = np.flatnonzero(hits.prim_id >= 0)
        path = path[met]
        point = surface_at(scene, Hits(hits.t[met], hits.prim_id[met], hits.u[met], hits.v[met]), d[met])
        refractive = scene.materials.kind[point.material] == REFRACTIVE
        diffuse = Point(*(a[~refractive] for a in point))
        radiance[path[~refractive]] = direct_light(scene, blockers, diffuse)
        path = path[refractive]
        o, d = pass_interface(scene, Point(*(a[refractive] for a in point)))
    return radiance


def render(
    scene: Scene | str | Path | dict[str, Any],
    spp: int | None = None,
    size: tuple[int, int] | None = None,
    seed: int = 0,
    *,
    positions: F8 | None = None,
) -> F8:
    """Render a scene, slowly.

    Parameters
    ----------
    scene : Scene, str, Path or dict
        As ``raytrace.render`` takes it.
    spp, size : optional
        Samples per pixel; film (width, height) in pixels. Default: what the scene says.
    seed : int
        Of the random positions of samples.
    positions : (h, w, spp, 2) array, pixels, optional
        Where the samples lie on the film, instead of random positions. They decide ``spp``.

    Returns
    -------
    (h, w, 3) array of float64
        Linear radiance: the mean over the samples of each pixel.

    Raises
    ------
    SceneError, FileError
        As ``raytrace.load`` does.

    Examples
    --------
    >>> import raytrace as rt
    >>> rt.textbook.render("scenes/cornell-box.json", spp=1, size=(8, 8)).shape
    (8, 8, 3)
    """
    if not isinstance(scene, Scene):
        scene = load(scene)
    size = size or scene.settings.size
    if positions is None:
        positions = stratified(size, spp or scene.settings.spp, seed)
    mesh, stops = scene.mesh, ~scene.materials.transparent_shadow[scene.mesh.material_id]
    tree = median_split(mesh.vertices, mesh.faces)
    blockers = tree if stops.all() else median_split(mesh.vertices, mesh.faces[stops]) if stops.any() else None
    o, d = pinhole_rays(scene.camera, size, positions.reshape(-1, 2))
    rng = np.random.default_rng([seed, 1])
    parts = []
    for k in range(0, len(o), BATCH):
        rays = o[k : k + BATCH], d[k : k + BATCH]
        if scene.settings.integrator == "path":
            parts.append(path_trace(scene, tree, blockers, *rays, rng))
        else:
            parts.append(integrate(scene, tree, blockers, *rays))
    return np.concatenate(parts).reshape(*positions.shape[:3], 3).mean(axis=2)
