"""``heatmap``: nodes visited and triangles tested by the ray of each pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.accel import query
from raytrace.accel.bundle import unbundled
from raytrace.accel.bvh import BVH
from raytrace.passes.camera import pinhole_directions
from raytrace.records import Columns, Hits, Rays
from raytrace.show.drawing import Drawing, new_figure, show_image
from raytrace.show.prepared_scene import LABELS, AnyScene, check_pinhole, pixel_centres, prepare_scene, tree_of

SCALE_QUANTILE = (
    0.999  # quantile at the top of the colour scale: otherwise a few rays along an edge would darken the rest
)


def heatmap(scene: AnyScene, size: tuple[int, int] | None = None, *, split: str = "sah") -> Drawing:
    """Draw how many nodes the ray of each pixel visits, and how many triangles it is tested against.

    Parameters
    ----------
    scene : Scene, str, Path or dict
        A loaded scene, a scene file, or its content.
    size : (width, height), pixels, optional
        Image size; default: the scene's. A quarter of a million pixels take about two seconds.
    split : {"sah", "median"}
        Split method of the tree.

    Returns
    -------
    Drawing
        ``data``: "nodes" and "triangles", (h, w) int64.

    Raises
    ------
    SceneError, FileError
        As for ``load``.
    OptionError, ValueError
        An invalid size or split.
    RaytraceError
        matplotlib isn't installed.

    Notes
    -----
    Each ray goes through the centre of its pixel to the nearest hit. It is traced alone; ``render`` traces packets of
    rays, which share visits. To visit a node, a ray tests its eight boxes at once; to visit a leaf, it tests its
    eight triangles at once. Empty slots of a leaf are counted, because they cost the same. Shadow rays are not counted.

    Examples
    --------
    >>> import raytrace as rt
    >>> costs = rt.show.heatmap("scenes/cornell-box.json", (16, 16))
    >>> int(costs.data["nodes"].max()), int(costs.data["triangles"].min())
    (1, 8)
    """
    prepared = prepare_scene(scene, size)
    check_pinhole(prepared)
    width, height = prepared.settings.size
    tree = tree_of(prepared, split)
    directions = pinhole_directions(prepared.view, *pixel_centres(prepared.settings.size))
    counts = count_work(tree, prepared.view.origin, directions)
    data = {name: counts[:, k].reshape(height, width) for k, name in enumerate(("nodes", "triangles"))}
    title = f"{prepared.name}: cost of each pixel's ray in the {LABELS[split]} tree"
    with new_figure(12, 5.8 * height / width + 2.0) as figure:
        figure.suptitle(title)
        _show(figure, data)
    return Drawing(title, data, figure)


def _show(figure: Any, data: dict[str, NDArray[np.int64]]) -> None:
    from matplotlib.ticker import MaxNLocator

    words = {"nodes": "nodes visited", "triangles": "triangles tested, eight at a time"}
    for axes, (name, counts) in zip(figure.subplots(1, 2), data.items(), strict=True):
        top = max(int(np.ceil(np.quantile(counts, SCALE_QUANTILE))), 1)
        shown = show_image(axes, counts, cmap="inferno", vmin=0, vmax=top)
        axes.set_title(f"{words[name]}: mean {counts.mean():.1f}, maximum {counts.max()}")
        beyond = "max" if counts.max() > top else "neither"
        ticks = MaxNLocator(8, integer=True)
        figure.colorbar(shown, ax=axes, location="bottom", label=f"{name} per ray", ticks=ticks, extend=beyond)


def count_work(bvh: BVH, origin: NDArray[np.floating], directions: NDArray[np.floating]) -> NDArray[np.int64]:
    """Numbers of nodes visited and triangles tested by each ray, traced alone: (n, 2).

    Parameters
    ----------
    bvh : BVH
    origin : (3,) f array, world units
        Origin of all rays.
    directions : (n, 3) f array
    """
    dtype, n = bvh.triangles.dtype, len(directions)
    hit = Hits(np.empty(1, dtype), np.empty(1, np.int32), np.empty(1, dtype), np.empty(1, dtype))
    o, d = Columns(np.array(origin, dtype), 0, 0, 1), np.array(directions, dtype).ravel()
    tmin, tmax = Columns(np.zeros(1, dtype), 0, 0, 0), Columns(np.full(1, np.inf, dtype), 0, 0, 0)
    tree, work, counts = unbundled(bvh.tree), bvh.work(), np.empty((n, 2), np.int64)
    for k in range(n):  # 8 microseconds per ray, most of it for the call
        work.counts[:] = 0
        query.closest_hit(tree, Rays(o, Columns(d, 3 * k, 3, 1), tmin, tmax), hit, 1, work)
        counts[k] = work.counts
    return counts
