"""A path in orthographic views from the side and from above: all lengths are true to scale."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.show.annotations import draw_path, draw_shadows
from raytrace.show.drawing import BLACK, ORANGE
from raytrace.show.mesh_outline import feature_lines
from raytrace.show.path_steps import Steps
from raytrace.show.prepared_scene import PreparedScene

MARGIN = 0.5  # largest margin around the path that shows the rest of the scene, relative to the path's extent


def draw_elevations(prepared: PreparedScene, steps: Steps, axes: Any) -> None:
    """Draw a path from the side and from above, on two axes; right is away from the camera."""
    view = prepared.view
    right, down = (vector / np.linalg.norm(vector) for vector in (view.right, view.down))
    frame = np.stack([view.forward, -down, -right]).astype(np.float64)  # away, up, left

    def project(points: NDArray[np.floating]) -> NDArray[np.float64]:
        return (np.asarray(points, np.float64) - view.origin) @ frame.T

    low, high = _limits(project(_points(prepared, steps)), project(prepared.scene.mesh.vertices))
    lights = project(_lights(prepared))
    for k, (name, up) in enumerate((("from the side", 1), ("from above", 2))):
        _scene(axes[k], project(feature_lines(prepared.scene.mesh, frame[3 - up]))[..., [0, up]], lights[:, [0, up]])
        half = (high[up] - low[up]) / 2
        draw_shadows(axes[k], steps, lambda points, up=up: project(points)[..., [0, up]], half)  # type: ignore[misc]
        draw_path(axes[k], steps, lambda points, up=up: project(points)[..., [0, up]], half)  # type: ignore[misc]
        axes[k].set(xlim=(low[0], high[0]), ylim=(low[up], high[up]), aspect="equal", ylabel=("up", "left")[k])
        axes[k].set_title(name, loc="left")
        axes[k].set_xlabel("away from the camera, world units")


def _points(prepared: PreparedScene, steps: Steps) -> NDArray[np.floating]:
    """Points that must be visible: camera, hits, lights, and points of lamps."""
    met = [step.p for step in steps.path if step.prim_id >= 0]
    met += [ray.o + ray.d for ray in steps.shadows if ray.light < 0 and not np.isnan(ray.t)]
    return np.concatenate([[prepared.view.origin], *([met] if met else []), _lights(prepared)])


def _lights(prepared: PreparedScene) -> NDArray[np.float64]:
    """Positions of point and spot lights."""
    lights = prepared.scene.lights
    return lights.position if lights.spots is None else np.concatenate([lights.position, lights.spots.position])


def _limits(points: NDArray[np.float64], mesh: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Corners of the visible region: the points, and the mesh up to `MARGIN` around them."""
    low, high = points.min(axis=0), points.max(axis=0)
    more = MARGIN * (high - low).max() or np.inf
    low = np.minimum(low, np.maximum(mesh.min(axis=0), low - more))
    high = np.maximum(high, np.minimum(mesh.max(axis=0), high + more))
    margin = 0.05 * (high - low).max()
    return low - margin, high + margin


def _scene(axes: Any, lines: NDArray[np.float64], lights: NDArray[np.float64]) -> None:
    from matplotlib.collections import LineCollection

    axes.add_collection(LineCollection(list(lines), colors="#b8b8b8", linewidths=0.7, zorder=1))
    axes.plot(0, 0, ">", color=BLACK, markersize=11, zorder=5)
    axes.plot(*lights.T, "*", color=ORANGE, markeredgecolor=BLACK, markersize=14, zorder=6, linestyle="")
