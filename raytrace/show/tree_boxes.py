"""``bvh``: the boxes of one level of the tree, drawn over its triangles."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.bvh import BVH
from raytrace.accel.grow import MAX_DEPTH
from raytrace.accel.layout import boxes_of, children_of, triangles_of
from raytrace.passes.camera import pinhole_directions
from raytrace.records import Tree, View
from raytrace.rendering.rendering import within
from raytrace.show.drawing import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION, YELLOW, Drawing, new_figure, show_image
from raytrace.show.prepared_scene import (
    LABELS,
    AnyScene,
    PreparedScene,
    pixel_centres,
    prepare_scene,
    tree_of,
)

SIDE = 1000  # pixels of the longer side of the image
FINE = 2  # FINE x FINE rays per pixel
CHUNK = 1 << 18  # rays traced together; limits the memory
LINE = 0.6  # pixels: half the width of the lines of a wireframe
FADED = 4.0  # pixels: height of a triangle at which its lines have half their strength; smaller ones fade out
SEGMENTS = 24  # segments per edge of a box; each is visible or hidden by the scene
VISIBLE = 0.995  # an edge is visible if nothing is hit before this share of the distance: it may touch a triangle
COLOURS = BLUE, ORANGE, GREEN, VERMILION, SKY, PURPLE, YELLOW


class Level(NamedTuple):
    """Boxes of one level of a tree, and of leaves at higher levels."""

    low: NDArray[np.floating]  # (k, 3) f, world units
    high: NDArray[np.floating]  # (k, 3) f, world units
    leaf: NDArray[np.bool_]  # (k,) bool: whether the box is a leaf
    box_of: NDArray[np.int64]  # (m,) i8: box of each triangle; -1: none, the triangle has no area


def bvh(scene: AnyScene, depth: int = 3, *, split: str = "sah") -> Drawing:
    """Draw the boxes of one level of the tree over a wireframe of the scene; triangles have the colour of their box.

    Parameters
    ----------
    scene : Scene, str, Path or dict
        A loaded scene, a scene file, or its content.
    depth : int
        Level: 0 is the box of the whole scene, 1 has the children of the root (at most eight), and so on. Leaves of
        higher levels are included.
    split : {"sah", "median"}
        Split method of the tree.

    Returns
    -------
    Drawing
        ``data``: "low" and "high", (k, 3), corners of the boxes, world units; "leaf", (k,) bool; "box_of", (m,): the
        box of each triangle, -1 for triangles without area.

    Raises
    ------
    SceneError, FileError
        As for ``load``.
    OptionError, ValueError
        An invalid depth or split.
    RaytraceError
        matplotlib isn't installed.

    Notes
    -----
    Edges of boxes are strong where they are visible, and faint behind the scene. The wireframe fades where triangles
    are only a few pixels high.

    Examples
    --------
    >>> import raytrace as rt
    >>> drawing = rt.show.bvh("scenes/cornell-box.json", depth=1)
    >>> len(drawing.data["low"]), bool(drawing.data["leaf"].all())
    (7, True)
    """
    depth = within("depth", depth, 0, MAX_DEPTH)
    prepared = _enlarged(prepare_scene(scene))
    tree = tree_of(prepared, split)
    level = level_of(tree.tree, len(tree.triangles), depth)
    about = f"{np.count_nonzero(~level.leaf)} nodes and {np.count_nonzero(level.leaf)} leaves of "
    about += (
        f"{tree.levels} levels; {np.count_nonzero(level.box_of >= 0):,} triangles; SAH cost {tree.stats.sah_cost:.1f}"
    )
    title = f"{prepared.name}: level {depth} of the {LABELS[split]} tree"
    width, height = prepared.settings.size
    with new_figure(9.0, 9.0 * height / width + 0.75) as figure:
        axes = figure.subplots()
        axes.set_title(title, fontsize=16, pad=26)
        axes.text(0.5, 1.012, about, transform=axes.transAxes, ha="center", va="bottom")
        show_image(axes, _surface(prepared, tree, level))
        axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
        _edges(axes, prepared, tree, level)
    return Drawing(title, level._asdict(), figure)


def _enlarged(prepared: PreparedScene) -> PreparedScene:
    width, height = prepared.settings.size
    scale = SIDE / max(width, height)
    return prepare_scene(prepared.scene, (max(round(width * scale), 1), max(round(height * scale), 1)))


def level_of(tree: Tree, count: int, depth: int) -> Level:
    """Boxes of one level of a tree with ``count`` triangles."""
    bounds, children = boxes_of(tree.nodes).transpose(0, 2, 1), children_of(tree.nodes)
    used = children[0] != 0
    low, high = bounds[0][used, :3].min(axis=0, keepdims=True), bounds[0][used, 3:].max(axis=0, keepdims=True)
    child = np.zeros(1, np.int64)
    for _ in range(depth):
        parents = child[child >= 0]
        slots = children[parents] != 0  # (k, 8)
        below, ended = bounds[parents][slots], child < 0
        low = np.concatenate([low[ended], below[:, :3]])
        high = np.concatenate([high[ended], below[:, 3:]])
        child = np.concatenate([child[ended], children[parents][slots].astype(np.int64)])
    return Level(low, high, child < 0, _boxes_of_triangles(tree, child, count))


def _boxes_of_triangles(tree: Tree, child: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Box of each triangle: descend from every box of a level to its triangles."""
    children, prims = children_of(tree.nodes), triangles_of(tree.leaves)
    box_of, box = np.full(count, -1), np.arange(len(child))
    while len(child):
        leaf = child < 0
        held = prims[~child[leaf]]
        box_of[held[held >= 0]] = np.repeat(box[leaf], (held >= 0).sum(axis=1))
        slots = children[child[~leaf]] != 0
        box = np.repeat(box[~leaf], slots.sum(axis=1))
        child = children[child[~leaf]][slots].astype(np.int64)
    return box_of


def _colours(count: int) -> NDArray[np.float64]:
    from matplotlib.colors import to_rgb

    table = np.array([to_rgb(colour) for colour in COLOURS])
    return table[np.arange(count) % len(table)]


def _surface(prepared: PreparedScene, bvh: BVH, level: Level) -> NDArray[np.float32]:
    """Image of the scene: pale colours of the boxes, shaded with a light at the camera, and the wireframe."""
    size = prepared.settings.size
    tints = (1 - 0.45 * (1 - _colours(len(level.low)))).astype(np.float32)
    x, y = pixel_centres(size, FINE)
    image = np.ones((len(x), 3), np.float32)
    for first in range(0, len(x), CHUNK):
        part = slice(first, first + CHUNK)
        d = pinhole_directions(prepared.view, x[part], y[part])
        hits = bvh.closest_hit(prepared.view.origin, d)
        seen = hits.prim_id >= 0
        prim = hits.prim_id[seen]
        facing = np.abs((bvh.triangles[prim, 9:] * d[seen]).sum(axis=1, keepdims=True))
        lines = _lines(
            prepared.view, bvh.triangles[prim, :9], (x[part][seen], y[part][seen]), hits.u[seen], hits.v[seen]
        )
        image[part][seen] = tints[level.box_of[prim]] * (0.6 + 0.4 * facing) * (1 - 0.6 * lines[:, None])
    width, height = size
    return image.reshape(height, FINE, width, FINE, 3).mean(axis=(1, 3))


def _lines(
    view: View,
    corners: NDArray[np.floating],
    at: tuple[NDArray[np.floating], NDArray[np.floating]],
    u: NDArray[np.floating],
    v: NDArray[np.floating],
) -> NDArray[np.floating]:
    """Strength of the wireframe, 0 .. 1, at points (u, v) of triangles (n, 9), which are seen at (x, y) on the film.

    The line through the projections of two corners a and b is a x b in homogeneous coordinates, also if one of them
    is behind the camera.
    """
    away = corners.reshape(-1, 3, 3).astype(np.float64) - view.origin
    seen = away @ np.stack([view.right, view.down, view.forward * (view.right @ view.right)], axis=1)
    line = np.cross(np.roll(seen, -1, axis=1), np.roll(seen, -2, axis=1))  # (n, 3, 3): edge opposite corner k
    point = np.stack([at[0] - view.centre[0], at[1] - view.centre[1], np.ones(len(u))], axis=1)
    distance = np.abs((line * point[:, None]).sum(axis=2)) / np.maximum(np.hypot(line[..., 0], line[..., 1]), 1e-300)
    weights = np.stack([1 - u - v, u, v], axis=1)
    height = (distance / np.maximum(weights, 1e-9)).min(axis=1) ** 2
    return (distance.min(axis=1) < LINE) * height / (height + FADED**2)


def _edges(axes: Any, prepared: PreparedScene, bvh: BVH, level: Level) -> None:
    """Draw edges of boxes in segments, strong where visible and faint where hidden."""
    from matplotlib.collections import LineCollection

    ends = box_edges(level.low, level.high)  # (k, 12, 2, 3)
    steps = np.linspace(0, 1, SEGMENTS + 1)[:, None]
    points = ends[:, :, None, 0] * (1 - steps) + ends[:, :, None, 1] * steps  # (k, 12, SEGMENTS + 1, 3)
    film, depth = project(prepared.view, points)
    middle = (points[:, :, 1:] + points[:, :, :-1]).reshape(-1, 3) / 2
    hidden = bvh.any_hit(prepared.view.origin, middle - prepared.view.origin, tmax=VISIBLE).reshape(
        len(ends), 12, SEGMENTS
    )
    front = np.minimum(depth[:, :, 1:], depth[:, :, :-1]) > 1e-3 * np.abs(depth).max()
    parts = np.stack([film[:, :, :-1], film[:, :, 1:]], axis=3)  # (k, 12, SEGMENTS, 2, 2)
    colours = np.broadcast_to(_colours(len(ends))[:, None, None], (*parts.shape[:3], 3))
    width = np.clip(24 / np.sqrt(len(ends)), 0.7, 2.6)
    for mask, alpha, style in ((front & hidden, 0.3, width / 2), (front & ~hidden, 1.0, width)):
        lines = LineCollection(parts[mask], colors=0.8 * colours[mask], alpha=alpha, linewidths=style)
        lines.set_capstyle("round")
        axes.add_collection(lines)


def box_edges(low: NDArray[np.floating], high: NDArray[np.floating]) -> NDArray[np.floating]:
    """The twelve edges of boxes: (k, 12, 2, 3), world units."""
    corner = np.indices((2, 2, 2)).reshape(3, 8).T.astype(bool)  # (8, 3): True: upper bound
    pairs = [(a, b) for a in range(8) for b in range(a) if (corner[a] ^ corner[b]).sum() == 1]
    points = np.where(corner, high[:, None], low[:, None])  # (k, 8, 3)
    return points[:, np.array(pairs)]


def project(view: View, points: NDArray[np.floating]) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Project points (..., 3): positions (..., 2) in the pixel coordinates of ``imshow``, and depths (...)."""
    away = points - view.origin
    depth = away @ view.forward
    pixel = view.right @ view.right
    with np.errstate(divide="ignore", invalid="ignore"):
        film = np.stack([away @ view.right, away @ view.down], axis=-1) / pixel / depth[..., None]
    return film + view.centre - 0.5, depth
