"""The integrator: it follows rays until they end on a diffuse surface, and averages them per pixel."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import OptionError
from raytrace.records import REFRACTIVE, Hits, Scene
from raytrace.scene.load import load
from raytrace.scene.path_plan import needs_lens
from raytrace.textbook.camera import pinhole_rays, stratified
from raytrace.textbook.path import path_trace
from raytrace.textbook.shading import Point, direct_light, pass_interface, surface_at
from raytrace.textbook.tree import Tree, median_split, traverse

F8 = NDArray[np.floating]
BATCH = 2**14  # rays traced at a time, to limit memory


def integrate(scene: Scene, tree: Tree, blockers: Tree | None, o: F8, d: F8) -> F8:
    """Return the radiance (n, 3) that arrives along rays.

    Each iteration traces all active rays to their next surface. A ray that leaves the scene gets the background. A ray
    that hits a diffuse surface gets the light that this reflects. The others pass an interface and stay active.

    Parameters
    ----------
    scene : Scene
    tree, blockers : Tree
        All triangles, and those that block shadow rays. None: no triangle blocks them.
    o, d : (n, 3) arrays
        Origins and unit directions.

    Raises
    ------
    OptionError
        The scene has textures, a lens, an orthographic camera, or a filter that is no box.
    """
    if scene.textures is not None:
        raise OptionError("raytrace.textbook does not have textures; use raytrace.render")
    if needs_lens(scene):
        raise OptionError("raytrace.textbook has a pinhole and a box filter only; use raytrace.render")
    radiance = np.zeros_like(o)  # stays 0 for a path of max_depth interfaces
    path = np.arange(len(o))  # rows of the active rays in radiance
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


def build_trees(scene: Scene) -> tuple[Tree, Tree | None]:
    """Return the tree of all triangles, and the tree of those that block shadow rays, None if there are none."""
    vertices, faces = scene.mesh.vertices, scene.mesh.faces
    tree = median_split(vertices, faces)
    blocks = ~scene.materials.transparent_shadow[scene.mesh.material_id]
    if blocks.all():
        return tree, tree
    return tree, median_split(vertices, faces[blocks]) if blocks.any() else None


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
        The same as for ``raytrace.render``.
    spp, size : optional
        Samples per pixel; width and height of the image in pixels. Default: the settings of the scene.
    seed : int
        Seed of the random sample positions.
    positions : (h, w, spp, 2) array, pixels, optional
        Sample positions on the film, instead of random ones. Their shape sets ``spp``.

    Returns
    -------
    (h, w, 3) array of float64
        Linear radiance, averaged over the samples of each pixel.

    Raises
    ------
    SceneError, FileError
        The same as for ``raytrace.load``.

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
    tree, blockers = build_trees(scene)
    o, d = pinhole_rays(scene.camera, size, positions.reshape(-1, 2))
    batches = [slice(k, k + BATCH) for k in range(0, len(o), BATCH)]
    if scene.settings.integrator == "path":
        rng = np.random.default_rng([seed, 1])
        found = [path_trace(scene, tree, blockers, o[batch], d[batch], rng) for batch in batches]
    else:
        found = [integrate(scene, tree, blockers, o[batch], d[batch]) for batch in batches]
    return np.concatenate(found).reshape(*positions.shape[:3], 3).mean(axis=2)
