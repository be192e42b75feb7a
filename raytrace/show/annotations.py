"""The marks of a path on axes: rays, normals, numbers, shadow rays."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.show.drawing import BLACK, BLUE, GREEN, ORANGE, PURPLE, VERMILION
from raytrace.show.path_steps import Steps

NORMAL = 0.25  # length of a normal, in half heights of the drawing
WAY_OUT = 20.0  # length of a ray that leaves the scene, in the same: beyond the edge of the drawing
Seen = Callable[[NDArray[np.floating]], NDArray[np.float64]]  # points (..., 3) of the world to (..., 2) of the drawing


def draw_path(axes: Any, steps: Steps, seen: Seen, half: float) -> None:
    """Draw the rays of a path, the normals where they meet something, and its number there."""
    colour = BLUE
    for number, step in enumerate(steps.path, 1):
        met = step.prim_id >= 0
        end = step.p if met else step.o + WAY_OUT * half * step.d
        axes.plot(*np.stack([seen(step.o), seen(end)]).T, color=colour, linewidth=2.4, zorder=4)
        if met:
            _head(axes, seen(step.o), seen(end), half, colour)
            tip = seen(step.p + NORMAL * half * step.ns)
            axes.annotate("", tip, seen(step.p), arrowprops=_arrow(BLACK, 1.3), zorder=5, annotation_clip=True)
            _number(axes, number, seen(step.p), tip - seen(step.p), colour)
        colour = PURPLE if "totally" in step.event else GREEN


def _arrow(colour: str, width: float) -> dict[str, Any]:
    look = {"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0, "mutation_scale": 12}
    return look | {"color": colour, "linewidth": width}


def _head(axes: Any, start: NDArray[np.float64], end: NDArray[np.float64], half: float, colour: str) -> None:
    """An arrow head on a ray, a little before it ends, if there is room."""
    length = float(np.linalg.norm(end - start))
    if length > 0.2 * half:
        at = end - min(0.5 * length, 0.45 * half) / length * (end - start)
        back = at - 1e-3 * half / length * (end - start)
        axes.annotate(
            "", at, back, arrowprops=_arrow(colour, 2.0) | {"mutation_scale": 18}, zorder=4, annotation_clip=True
        )


def _number(axes: Any, number: int, at: NDArray[np.float64], normal: NDArray[np.float64], colour: str) -> None:
    """The number of a step, on the other side of the surface."""
    size = float(np.linalg.norm(normal))
    away = np.array([0.8, -0.6]) if size == 0 else (-normal / size * [[0.8, 0.6], [-0.6, 0.8]]).sum(axis=1)
    box = {"boxstyle": "circle,pad=0.15", "facecolor": "white", "edgecolor": colour}
    look = {"ha": "center", "va": "center", "fontsize": 11, "zorder": 8, "annotation_clip": True}
    axes.annotate(str(number), at, 17 * away, textcoords="offset points", bbox=box, **look)


def draw_shadows(axes: Any, steps: Steps, seen: Seen) -> None:
    """Draw the shadow rays, those that are blocked with a cross where they are."""
    for ray in steps.shadows:
        if ray.event == "faces away":
            continue
        blocked = ray.event == "blocked"
        stop = ray.o + ray.t * ray.d
        look: Any = {"color": VERMILION if blocked else ORANGE, "linewidth": 1.9, "zorder": 3}
        axes.plot(*np.stack([seen(ray.o), seen(stop)]).T, **look)
        if blocked:
            axes.plot(*np.stack([seen(stop), seen(ray.o + ray.d)]).T, linestyle=":", **look)
            axes.plot(*seen(stop), "X", color=VERMILION, markersize=10, zorder=7)


def keys() -> list[Any]:
    """What the colours mean, for a legend."""
    from matplotlib.lines import Line2D

    rows: Any = (
        ("camera ray", BLUE, "-", 2.4, ""),
        ("refracted", GREEN, "-", 2.4, ""),
        ("totally reflected", PURPLE, "-", 2.4, ""),
        ("shading normal", BLACK, "-", 1.3, ""),
        ("light reached", ORANGE, "-", 1.9, ""),
        ("light blocked", VERMILION, ":", 1.9, "X"),
    )
    return [Line2D([], [], color=c, linestyle=s, linewidth=w, marker=m, label=name) for name, c, s, w, m in rows]
