"""Draw a path on axes: rays, normals, step numbers and shadow rays."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.show.drawing import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION
from raytrace.show.path_steps import Steps

NORMAL = 0.25  # length of a normal, in half heights of the axes
ESCAPE = 20.0  # length of a ray that leaves the scene, in half heights: beyond the border of the axes
Projection = Callable[[NDArray[np.floating]], NDArray[np.float64]]  # points (..., 3) in the world to (..., 2) on axes


def draw_path(axes: Any, steps: Steps, project: Projection, half: float) -> None:
    """Draw the rays of a path, and the normal and step number at each hit."""
    colour = BLUE
    for number, step in enumerate(steps.path, 1):
        met = step.prim_id >= 0
        end = step.p if met else step.o + ESCAPE * half * step.d
        axes.plot(*np.stack([project(step.o), project(end)]).T, color=colour, linewidth=2.4, zorder=4)
        if met:
            _head(axes, project(step.o), project(end), half, colour)
            tip = project(step.p + NORMAL * half * step.ns)
            axes.annotate("", tip, project(step.p), arrowprops=_arrow(BLACK, 1.3), zorder=5, annotation_clip=True)
            _number(axes, number, project(step.p), tip - project(step.p), colour)
        colour = PURPLE if "reflected" in step.event else SKY if step.event in ("scatters", "lands") else GREEN


def _arrow(colour: str, width: float) -> dict[str, Any]:
    style = {"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0, "mutation_scale": 12}
    return style | {"color": colour, "linewidth": width}


def _head(axes: Any, start: NDArray[np.float64], end: NDArray[np.float64], half: float, colour: str) -> None:
    """Draw an arrow head on a ray shortly before its end, unless the ray is too short."""
    length = float(np.linalg.norm(end - start))
    if length > 0.2 * half:
        at = end - min(0.5 * length, 0.45 * half) / length * (end - start)
        back = at - 1e-3 * half / length * (end - start)
        axes.annotate(
            "", at, back, arrowprops=_arrow(colour, 2.0) | {"mutation_scale": 18}, zorder=4, annotation_clip=True
        )


def _number(axes: Any, number: int, at: NDArray[np.float64], normal: NDArray[np.float64], colour: str) -> None:
    """Draw the number of a step, on the side of the surface opposite to the normal."""
    size = float(np.linalg.norm(normal))
    away = np.array([0.8, -0.6]) if size == 0 else (-normal / size * [[0.8, 0.6], [-0.6, 0.8]]).sum(axis=1)
    box = {"boxstyle": "circle,pad=0.15", "facecolor": "white", "edgecolor": colour}
    style = {"ha": "center", "va": "center", "fontsize": 11, "zorder": 8, "annotation_clip": True}
    axes.annotate(str(number), at, 17 * away, textcoords="offset points", bbox=box, **style)


def draw_shadows(axes: Any, steps: Steps, project: Projection, half: float) -> None:
    """Draw the shadow rays, with a cross where they are blocked."""
    for ray in steps.shadows:
        if np.isnan(ray.t):
            continue
        blocked = ray.event == "blocked"
        stop = ray.o + min(ray.t, ESCAPE * half) * ray.d
        style: Any = {"color": VERMILION if blocked else ORANGE, "linewidth": 1.9, "zorder": 3}
        axes.plot(*np.stack([project(ray.o), project(stop)]).T, **style)
        if blocked:
            end = ray.o + (ESCAPE * half if ray.far else 1.0) * ray.d
            axes.plot(*np.stack([project(stop), project(end)]).T, linestyle=":", **style)
            axes.plot(*project(stop), "X", color=VERMILION, markersize=10, zorder=7)


def legend_handles(paths: bool = False) -> list[Any]:
    """Handles of a legend that explains the colours; paths: of path tracing."""
    from matplotlib.lines import Line2D

    entries: Any = (
        ("camera ray", BLUE, "-", 2.4, ""),
        ("refracted", GREEN, "-", 2.4, ""),
        ("reflected" if paths else "totally reflected", PURPLE, "-", 2.4, ""),
        *([("scattered", SKY, "-", 2.4, "")] if paths else []),
        ("shading normal", BLACK, "-", 1.3, ""),
        ("light reached", ORANGE, "-", 1.9, ""),
        ("light blocked", VERMILION, ":", 1.9, "X"),
    )
    return [Line2D([], [], color=c, linestyle=s, linewidth=w, marker=m, label=name) for name, c, s, w, m in entries]
