"""Draw the figures of docs/rays.md: ``python docs/pictures/rays.py``; needs matplotlib (``pip install ".[report]"``).

Each function draws one figure. The sections are those of a vase with the plane z = Z, which no edge of
the mesh lies in: the surface is where the signed distance is 0.
"""

import io
import re
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray
from PIL import Image

import raytrace as rt

HERE = Path(__file__).parent
PAGE, MESH = HERE.parent / "rays.md", HERE.parents[1] / "scenes" / "meshes" / "vase.ply"
BLUE, RED, GREY, GREEN = "#1f6fb4", "#c8382b", "#999999", "#2a8a4a"
Z = 0.007
EYE = np.array([-1.1, 0.35, Z])
WIDE = -1.2, 1.2, -0.15, 1.65  # limits of x and y in the sections

Array = NDArray[Any]


def main() -> None:
    bvh = rt.BVH(rt.load(MESH).mesh)
    plt.rcParams.update({"font.size": 9, "axes.titlesize": 9})
    hits(bvh)
    crossings()
    points(bvh)
    surface(bvh)
    refit(bvh)
    camera(bvh)
    blocks()
    precision(bvh)
    recipes(bvh)


def panels(rows: int, columns: int, width: float, height: float) -> Any:
    figure, axes = plt.subplots(rows, columns, figsize=(width, height), squeeze=False, layout="constrained")
    return figure, axes.ravel()


def save(figure: Any, name: str) -> None:
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=110)
    Image.open(drawn).convert("RGB").quantize(128).save(HERE / f"rays-{name}.png", optimize=True)
    plt.close(figure)


def plane(n: int = 300) -> tuple[Array, Array, Array]:
    """Return x, y and points (n, n, 3) of the section."""
    x, y = np.meshgrid(np.linspace(*WIDE[:2], n), np.linspace(*WIDE[2:], n))
    return x, y, np.stack([x, y, np.full_like(x, Z)], axis=-1)


def section(axis: Any, bvh: rt.BVH, title: str = "") -> None:
    x, y, grid = plane()
    axis.contourf(x, y, bvh.signed_distance(grid), levels=[-9, 0], colors=["#e4d3bd"])
    axis.contour(x, y, bvh.signed_distance(grid), levels=[0], colors="#6b4a2b", linewidths=1)
    axis.set(title=title, aspect="equal", xlim=WIDE[:2], ylim=WIDE[2:], xticks=[], yticks=[])


def fan(n: int = 12) -> Array:
    """Return unit directions in the section, (n, 3)."""
    angle = np.linspace(-0.2, 0.62, n)
    return np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)


def lines(axis: Any, start: Array, end: Array, **style: Any) -> None:
    both = np.stack(np.broadcast_arrays(start, end), axis=1)[..., :2]
    for line in both:
        axis.plot(*line.T, **{"linewidth": 1, "zorder": 2} | style)


def dots(axis: Any, at: Array, color: Any, size: float = 16) -> None:
    axis.scatter(*at[:, :2].T, s=size, color=color, zorder=3)


def hits(bvh: rt.BVH) -> None:
    figure, (first, free, every) = panels(1, 3, 9, 2.7)
    d = fan()
    section(first, bvh, "closest_hit")
    found = bvh.closest_hit(EYE, d)
    lines(first, EYE, EYE + np.minimum(found.t, 4)[:, None] * d, color=BLUE)
    dots(first, (EYE + found.t[:, None] * d)[found.prim_id >= 0], RED)
    section(free, bvh, "any_hit, tmax = 0.7: green is free")
    for direction, blocked in zip(d, bvh.any_hit(EYE, d, tmax=0.7), strict=True):
        lines(free, EYE[None], EYE + 0.7 * direction[None], color=RED if blocked else GREEN)
    section(every, bvh, "all_hits, and count_hits at the ends")
    lines(every, EYE, EYE + 2.05 * d, color=BLUE)
    listed = bvh.all_hits(EYE, d)
    dots(every, EYE + listed.t[:, None] * np.repeat(d, np.diff(listed.start), axis=0), RED)
    for direction, count in zip(d, bvh.count_hits(EYE, d), strict=True):
        every.text(*(EYE + 2.13 * direction)[:2], str(count), ha="center", va="center", fontsize=7)
    save(figure, "hits")


def crossings() -> None:
    page = PAGE.read_text("utf-8")
    found = re.search(r"^corners = .*\nsides = .*$", page, re.MULTILINE)
    assert found
    space: dict[str, Any] = {}
    exec(found[0], space)
    box = rt.BVH(space["corners"], space["sides"])
    y, z = np.meshgrid((np.arange(24) - 3.5) / 16, (np.arange(24) - 3.5) / 16)
    origins = np.stack([-np.ones_like(y), y, z], axis=-1)
    figure, axes = panels(1, 2, 6.4, 2.9)
    for axis, option in zip(axes, (False, True), strict=True):
        counts = box.count_hits(origins, [1, 0, 0], crossings=option)
        shown = axis.imshow(counts, origin="lower", cmap=plt.get_cmap("viridis", 5), vmin=-0.5, vmax=4.5)
        axis.set(title="count_hits" + ", crossings=True" * option, xticks=[], yticks=[])
    figure.colorbar(shown, ax=axes, ticks=range(5), shrink=0.8)
    save(figure, "crossings")


def points(bvh: rt.BVH) -> None:
    figure, (inside, closest, distance) = panels(1, 3, 9.4, 2.7)
    rng = np.random.default_rng(3)
    some = np.stack([rng.uniform(*WIDE[:2], 900), rng.uniform(*WIDE[2:], 900), np.full(900, Z)], axis=1)
    section(inside, bvh, "contains: blue is inside")
    within = bvh.contains(some)
    dots(inside, some[~within], GREY, 3)
    dots(inside, some[within], BLUE, 9)
    section(closest, bvh, "closest_point")
    few = some[:60]
    lines(closest, few, bvh.closest_point(few).p, color=BLUE)
    dots(closest, few, BLUE, 6)
    dots(closest, bvh.closest_point(few).p, RED, 6)
    x, y, grid = plane()
    found = bvh.signed_distance(grid)
    section(distance, bvh, "signed_distance")
    shown = distance.contourf(x, y, found, levels=np.linspace(-0.8, 0.8, 33), cmap="RdBu_r", extend="both")
    distance.contour(x, y, found, levels=[0], colors="black", linewidths=0.8)
    figure.colorbar(shown, ax=distance, shrink=0.8, ticks=[-0.8, -0.4, 0, 0.4, 0.8])
    save(figure, "points")


def surface(bvh: rt.BVH) -> None:
    figure, (axis,) = panels(1, 1, 4.6, 3.4)
    section(axis, bvh, "surface: normals (green); spawn_ray: reflected rays (red)")
    d = fan()
    found = bvh.closest_hit(EYE, d)
    d = d[found.prim_id >= 0]
    p, p_error, ng = (a[found.prim_id >= 0] for a in bvh.surface(found))
    away = rt.reflect(d, ng)
    start = rt.spawn_ray(p, p_error, ng, away)
    length = np.minimum(bvh.closest_hit(start, away).t, 0.6)
    lines(axis, EYE, p, color=BLUE)
    lines(axis, start, start + length[:, None] * away, color=RED)
    lines(axis, p, p + 0.15 * ng, color=GREEN, linewidth=2)
    save(figure, "surface")


def refit(bvh: rt.BVH) -> None:
    rest = bvh.vertices.astype(np.float64)
    bent = rest + 0.2 * np.sin(3 * rest[:, 1:2]) * [1, 0, 0]
    figure, axes = panels(1, 2, 6.2, 2.7)
    o = np.stack([np.full(9, -1.1), np.linspace(0.1, 1.3, 9), np.full(9, Z)], axis=1)
    for axis, vertices, title in zip(axes, (rest, bent), ("as built", "after refit(bent)"), strict=True):
        bvh.refit(vertices)
        section(axis, bvh, title)
        t = bvh.closest_hit(o, [1, 0, 0]).t[:, None]
        lines(axis, o, o + t * [1, 0, 0], color=BLUE)
        dots(axis, o + t * [1, 0, 0], RED)
    bvh.refit(rest)
    save(figure, "refit")


def camera(bvh: rt.BVH) -> None:
    figure, (film, above) = panels(1, 2, 7.4, 3.1)
    columns, rows = np.meshgrid(np.arange(6) + 0.5, np.arange(4) + 0.5)
    film.scatter(columns, rows, s=9, color=BLUE)
    film.plot(3, 2, "+", color=RED, markersize=12)
    film.text(3.12, 1.9, "(cx, cy)", color=RED)
    film.text(0.5, 0.32, "(1/2, 1/2)", ha="center", fontsize=7)
    film.set(title="film: size = (6, 4), K = [[f, 0, 3], [0, f, 2], [0, 0, 1]]", xlim=(0, 6), ylim=(4, 0))
    film.set(xticks=range(7), yticks=range(5), xlabel="x, right", ylabel="y, down", aspect="equal")
    film.grid(True, color="#bbbbbb")
    pose = [[1, 0, 0, 0], [0, -1, 0, 0.5], [0, 0, -1, 1.5], [0, 0, 0, 1]]
    origins, directions = rt.camera_rays(K=[[24, 0, 12], [0, 24, 0.5], [0, 0, 1]], pose=pose, size=(24, 1))
    t = bvh.closest_hit(origins, directions).t[0]
    ends = origins[0] + np.minimum(t, 2.3)[:, None] * directions[0]
    x, z = np.meshgrid(np.linspace(-1.3, 1.3, 300), np.linspace(-0.8, 1.6, 300))
    distance = bvh.signed_distance(np.stack([x, np.full_like(x, 0.5), z], axis=-1))
    above.contourf(z, x, distance, levels=[-9, 0], colors=["#e4d3bd"])
    above.contour(z, x, distance, levels=[0], colors="#6b4a2b", linewidths=1)
    lines(above, origins[0][:, [2, 0, 1]], ends[:, [2, 0, 1]], color=BLUE)
    dots(above, ends[np.isfinite(t)][:, [2, 0, 1]], RED)
    above.set(title="a row of 24 pixels, from above", aspect="equal", xlim=(1.6, -0.8), xticks=[], yticks=[])
    save(figure, "camera")


def blocks() -> None:
    figure, axes = panels(1, 2, 7.4, 2.7)
    r, c = np.mgrid[0:8, 0:12]
    as_list = 12 * r + c
    as_image = 16 * (3 * (r // 4) + c // 4) + 4 * (r % 4) + c % 4
    for axis, order, title in zip(
        axes, (as_list, as_image), ("(96, 3): in their order", "(8, 12, 3): in blocks"), strict=True
    ):
        axis.imshow(order // 16, cmap="Set2", vmax=7)
        for row, column in np.ndindex(order.shape):
            axis.text(column, row, str(order[row, column]), ha="center", va="center", fontsize=7)
        axis.set(title=f"{title}; one colour: 16 rays together", xticks=[], yticks=[])
    save(figure, "blocks")


def precision(bvh: rt.BVH) -> None:
    rng = np.random.default_rng(0)
    o, d = rng.normal(size=(5000, 3)) * 0.01 + [-2, 0.7, 0], np.array([1.0, 0.0, 0.0])
    rest = 0.98765 * bvh.vertices.astype(np.float64)  # numbers that need all the digits of float64
    faces, powers = bvh.faces, np.arange(0, 31, 2)
    exact = rt.BVH(rest, faces, "float64").closest_hit(o, d).t
    figure, (axis,) = panels(1, 1, 5.4, 3.0)
    for kind, color in (("float32", RED), ("float64", BLUE)):
        error = []
        for power in powers:
            moved = rt.BVH(rest + 2.0**power, faces, kind).closest_hit(o + 2.0**power, d).t
            error.append(np.abs(np.where(np.isfinite(moved), moved, 0) - exact).max())
        axis.loglog(2.0**powers, error, "o-", color=color, label=kind, markersize=3)
    axis.axhline(0.05, color=GREY, linewidth=0.8)
    axis.text(1, 0.065, "wall of the vase", color="#666666", fontsize=8)
    axis.set(xlabel="distance from the origin (height of the vase: 1.4)", ylabel="largest error of t")
    axis.legend(loc="lower right")
    save(figure, "precision")


def recipes(bvh: rt.BVH) -> None:
    """Run the programs of the page, and draw their arrays."""
    page = PAGE.read_text("utf-8").replace('"scenes/', f'"{HERE.parents[1].as_posix()}/scenes/')
    programs = re.findall(r"^<!-- tested: rays -->\n```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    space: dict[str, Any] = {}
    exec("\n".join(programs), space)
    figure, axes = panels(2, 3, 7.4, 6.4)
    seen, found = space["seen"], space["pixels"]
    shape = seen.shape
    light = space["ambient_occlusion"](bvh, *(space[name] for name in ("p_seen", "error_seen", "ng_seen")), samples=64)

    def image(values: Array) -> Array:
        whole = np.full(shape, np.nan)
        whole[seen] = values
        return whole[20:300]

    show(axes[0], image(space["depth"][seen]), "depth", "magma_r")
    show(axes[1], image(light), "ambient occlusion", "gray", vmin=0, vmax=1)
    show(axes[2], image(space["thickness"][found.prim_id[seen]]), "wall thickness", "viridis", vmax=0.1)
    p, p_error, ng = bvh.surface(found)
    lamp = np.array([0.75, 1.9, 0.9])
    towards = lamp - p[seen]
    lit = ~bvh.any_hit(rt.spawn_ray(p[seen], p_error[seen], ng[seen], towards), towards, tmax=1)
    show(axes[3], image(lit & (np.sum(ng[seen] * towards, axis=1) > 0)), "visible from one point", "cividis")
    solid = space["solid"]
    axes[4].imshow(solid[:, :, solid.shape[2] // 2].T, origin="lower", cmap="Blues")
    axes[4].set(title="voxels: one slice", xticks=[], yticks=[])
    scan, distance = space["scan"], space["distance"]
    front = scan[:, 2] > 0
    axes[5].scatter(*scan[front, :2].T, c=distance[front], s=1, cmap="coolwarm", vmin=-0.01, vmax=0.01)
    axes[5].set(title="scan: signed distance", xticks=[], yticks=[], aspect="equal")
    save(figure, "recipes")


def show(axis: Any, values: Array, title: str, colours: str, **limits: Any) -> None:
    axis.imshow(values, cmap=plt.get_cmap(colours).with_extremes(bad="#cfe0ee"), **limits)
    axis.set(title=title, xticks=[], yticks=[])


if __name__ == "__main__":
    main()
