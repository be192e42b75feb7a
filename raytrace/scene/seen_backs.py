"""Objects whose black back the camera sees: a coarse grid of camera rays in NumPy, without a tree and without a kernel.

The rays are the scene's own, through the centres of the cells of a grid over the film. Triangles are projected to the
film, and only those whose bounds there contain a ray are tested: the time is linear in the number of triangles. After a
render, this runs only if pixels are black. A scene whose surfaces look alike from both sides costs nothing.
"""

import warnings
from collections.abc import Iterator
from typing import Any, NamedTuple
from weakref import WeakSet

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import SceneWarning
from raytrace.records import DIFFUSE, PLASTIC, Camera, Mesh, Scene, View
from raytrace.scene.other_camera import base_of, in_view

GRID = 48  # most rays along a side of the film
MUCH = 0.25  # smallest share of the image for a warning in Python
OF_OBJECT, OF_IMAGE = 0.25, 0.02  # smallest shares: of the object's rays, and of all rays, that meet its back
MARGIN = 1e-3  # of a cell: more than rounding moves a projected vertex
MOST = 1 << 20  # pairs of rays and triangles that are tested at once

Vectors = NDArray[np.float64]

_asked: WeakSet[Scene] = WeakSet()  # scenes whose backs are not looked for after a render, or not again


class SeenBack(NamedTuple):
    """An object that shows a black back."""

    object_id: int
    of_object: float  # share of its rays that meet the back
    of_image: float  # share of all rays
    material: str

    def text(self, scene: Scene) -> str:
        """Return what is wrong, and how to fix it."""
        text = f"{100 * self.of_object:.0f} % of its pixels show its back, which is black"
        cure = f'use "flip": true, or "two_sided": true in its material "{self.material}"'
        where = f"{scene.source or 'scene'}: objects[{self.object_id}]"
        return f"{where}: {scene.objects[self.object_id]}: {text}; {cure}"


def back_warnings(scene: Scene, size: tuple[int, int] | None = None) -> list[str]:
    """Return one line for each object that shows much of a back that is black.

    Parameters
    ----------
    scene : Scene
    size : (width, height), pixels, optional
        Of the image. Default: the scene's.

    Returns
    -------
    list of str
        Objects of which the camera sees at least a quarter from behind, and these are at least 2 % of the image.
    """
    size = size or scene.settings.size
    return [back.text(scene) for back in seen_backs(in_view(scene, size), size)]


def back_warnings_of(scene: Scene, image: Any) -> list[str]:
    """Return the same for a scene and its ``Render``; no ray is traced if less than 2 % of the pixels are black."""
    if np.count_nonzero(image.rgb[..., 1] == 0) < OF_IMAGE * image.stderr.size:
        return []
    width, height = map(int, image.provenance["size"].split("x"))
    return back_warnings(scene, (width, height))


def expect_backs(scene: Scene) -> None:
    """Let no render warn of the backs of a scene: its user moves the camera, also behind walls."""
    _asked.add(base_of(scene))


def warn_of_backs(scene: Scene, image: Any, stacklevel: int) -> None:
    """Issue a ``SceneWarning`` where a quarter of an image is black and shows backs; once for all cameras."""
    if base_of(scene) in _asked or np.count_nonzero(image.rgb[..., 1] == 0) < MUCH * image.stderr.size:
        return
    expect_backs(scene)
    width, height = map(int, image.provenance["size"].split("x"))
    backs = seen_backs(scene, (width, height))
    if sum(back.of_image for back in backs) >= MUCH:
        for back in backs:
            warnings.warn(back.text(scene), SceneWarning, stacklevel=stacklevel + 1)


def seen_backs(scene: Scene, size: tuple[int, int]) -> list[SeenBack]:
    """Return the objects of which much is seen from behind, where that is black."""
    one_sided = black_behind(scene)
    if not one_sided.any():
        return []
    rays, prim_id, back = seen(scene.mesh, scene.camera, size)
    objects = scene.mesh.object_id[prim_id]
    behind = back & one_sided[scene.mesh.material_id[prim_id]]
    found = []
    for i in np.unique(objects[behind]).tolist():
        mine = objects == i
        number, all_of_it = int(np.count_nonzero(behind & mine)), int(np.count_nonzero(mine))
        if number >= OF_OBJECT * all_of_it and number >= OF_IMAGE * rays:
            material = scene.materials.name[int(scene.mesh.material_id[prim_id[behind & mine][0]])]
            found.append(SeenBack(i, number / all_of_it, number / rays, material))
    return found


def black_behind(scene: Scene) -> NDArray[np.bool_]:
    """Return which materials are black from behind, (k,): diffuse and plastic on one side only."""
    materials = scene.materials
    used = np.zeros(len(materials.kind), np.bool_)
    used[scene.mesh.material_id] = True
    return used & np.isin(materials.kind, (DIFFUSE, PLASTIC)) & ~materials.two_sided


def seen(mesh: Mesh, camera: Camera, size: tuple[int, int]) -> tuple[int, NDArray[np.int64], NDArray[np.bool_]]:
    """Find what a camera sees, on a coarse grid.

    Returns
    -------
    rays : int
        Number of rays.
    prim_id : (n,) int64
        The triangle of each ray that meets one.
    back : (n,) bool
        Whether it meets its back.
    """
    view = _view(camera, size)
    columns, rows = (min(GRID, side) for side in size)
    x, y = np.meshgrid((np.arange(columns) + 0.5) * size[0] / columns, (np.arange(rows) + 0.5) * size[1] / rows)
    parallel = camera.height is not None
    right, down = ((film.ravel() - c)[:, None] for film, c in zip((x, y), view.centre, strict=True))
    across = right * view.right + down * view.down
    o, d = (view.origin + across, view.forward) if parallel else (view.origin, view.forward + across)
    o, d = np.broadcast_to(o, across.shape), np.broadcast_to(d, across.shape)
    nearest, found = np.full(len(d), np.inf), np.full(len(d), -1, np.int64)
    back = np.zeros(len(d), np.bool_)
    bounds = _bounds(
        mesh, _projected(mesh.vertices, view, (columns / size[0], rows / size[1]), parallel), (columns, rows)
    )
    with np.errstate(all="ignore"):  # degenerate triangles, and the largest coordinates
        for triangle, ray in _pairs(*bounds, columns):
            t, facing = _meet(mesh.vertices[mesh.faces[triangle]], o[ray], d[ray])
            np.minimum.at(nearest, ray, t)
            first = (t == nearest[ray]) & np.isfinite(t)
            found[ray[first]], back[ray[first]] = triangle[first], facing[first] > 0
    hit = found >= 0
    return len(d), found[hit], back[hit]


def _view(camera: Camera, size: tuple[int, int]) -> View:
    """Return the view of a camera, as ``make_view`` of the passes does, which imports the compiler."""
    ahead, up = camera.look_at / 2 - camera.position / 2, camera.up / np.abs(camera.up).max()
    ahead = ahead / np.abs(ahead).max()
    forward = ahead / np.linalg.norm(ahead)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    height = 2.0 * np.tan(np.radians(camera.fov) / 2.0) if camera.height is None else camera.height
    pixel = height / size[1]
    return View(camera.position, forward, pixel * right, pixel * np.cross(forward, right), np.array(size) / 2.0)


def _projected(points: Vectors, view: View, cells: tuple[float, float], parallel: bool) -> list[Vectors]:
    """Return columns and rows of points on the film, in cells from the centre of the first; NaN: behind the pinhole."""
    found = []
    with np.errstate(all="ignore"):
        offset = points - view.origin
        depth = offset @ view.forward
        behind = None if parallel else ~(depth > 0)
        for axis, centre, scale in zip((view.right, view.down), view.centre, cells, strict=True):
            film = offset @ (axis * (scale / (axis @ axis)))
            if behind is not None:
                film /= depth
                film[behind] = np.nan
            film += centre * scale - 0.5
            found.append(film)
    return found


def _bounds(mesh: Mesh, film: list[Vectors], grid: tuple[int, int]) -> tuple[Any, Any, Any]:
    """Return triangles that can contain a ray, and the first and last cell of each, (n, 2).

    A triangle that reaches behind the pinhole may project to any cell; one that lies behind it to none.
    """
    corners = [np.ascontiguousarray(mesh.faces[:, k]) for k in range(3)]
    chosen, low, high = np.ones(len(mesh.faces), np.bool_), [], []
    for values, count in zip(film, grid, strict=True):
        a, b, c = (values[corner] for corner in corners)
        first = np.ceil(np.minimum(np.minimum(a, b), c) - MARGIN)  # NaN stays NaN
        last = np.floor(np.maximum(np.maximum(a, b), c) + MARGIN)
        rows = np.flatnonzero(np.isnan(first))
        first[rows], last[rows] = 0, count - 1
        last[rows[np.isnan(a[rows]) & np.isnan(b[rows]) & np.isnan(c[rows])]] = -1  # all of it lies behind
        chosen &= (last >= np.maximum(first, 0)) & (first < count)
        low.append(first)
        high.append(last)
    rows = np.flatnonzero(chosen)
    ends = [np.stack([each[rows] for each in bounds], axis=1).clip(0, np.array(grid) - 1) for bounds in (low, high)]
    return rows, ends[0].astype(np.int64), ends[1].astype(np.int64)


def _pairs(triangles: Any, low: Any, high: Any, columns: int) -> Iterator[tuple[Any, Any]]:
    """Yield pairs of triangles and rays, in parts."""
    width = high[:, 0] - low[:, 0] + 1
    counts = width * (high[:, 1] - low[:, 1] + 1)
    ends = np.cumsum(counts)
    begin = 0
    while begin < len(triangles):
        before = ends[begin - 1] if begin else 0
        end = max(begin + 1, int(np.searchsorted(ends, before + MOST, "right")))
        part = slice(begin, end)
        row = np.repeat(np.arange(begin, end), counts[part])
        number = np.arange(len(row)) - np.repeat(ends[part] - counts[part] - before, counts[part])
        x, y = low[row, 0] + number % width[row], low[row, 1] + number // width[row]
        yield triangles[row], y * columns + x
        begin = end


def _meet(corners: Vectors, o: Vectors, d: Vectors) -> tuple[Vectors, Vectors]:
    """Return t of each pair, inf for a miss, and a number that is positive for a back   [Moller1997]."""
    a, b, c = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(b, c)
    facing = np.einsum("ij,ij->i", normal, d)
    q = np.cross(o - a, d)
    u, v = -np.einsum("ij,ij->i", c, q) / facing, np.einsum("ij,ij->i", b, q) / facing
    t = np.einsum("ij,ij->i", normal, a - o) / facing
    inside = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
    return np.where(inside, t, np.inf), facing
