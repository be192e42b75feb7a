"""A path in its plane of incidence, with a section of the scene: angles and lengths are true to scale."""

from itertools import product, takewhile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.records import Mesh
from raytrace.show.annotations import draw_path
from raytrace.show.drawing import BLACK
from raytrace.show.path_steps import Step, Steps
from raytrace.show.prepared_scene import PreparedScene

AROUND = 0.7  # margin around the interfaces, relative to their extent
MIN_MARGIN = 0.12  # smallest margin, relative to the extent of the scene
ARCS = 4  # angles are drawn at this many interfaces
LABEL_BOX = {"boxstyle": "round,pad=0.05", "facecolor": "white", "edgecolor": "none"}
WIDE = 0.9  # cosine: an angle wider than this has room for its label
LABEL = np.array([0.26, 0.12])  # width and height of the label of an angle, in half heights of the axes
ARC = 0.16  # radius of an arc, in half heights of the axes


class Plane:
    """The plane of incidence of a step, seen with the ray going from left to right.

    Attributes
    ----------
    origin : (3,) array, world units
    frame : (3, 3) array
        Rows: right, up, and towards the viewer.
    """

    def __init__(self, step: Step, up: NDArray[np.floating]) -> None:
        d, n = step.d.astype(np.float64), step.ns.astype(np.float64)
        towards = np.cross(d, n)
        if np.linalg.norm(towards) < 1e-3:  # normal incidence: any plane through the ray
            towards = np.cross(d, up)
        towards = towards / np.linalg.norm(towards)
        right = d / np.linalg.norm(d)
        above = np.cross(towards, right)
        if above @ up < 0:
            towards, above = -towards, -above
        self.origin, self.frame = step.p.astype(np.float64), np.stack([right, above, towards])

    def project(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Coordinates (..., 2) in the plane of points (..., 3)."""
        return self.coordinates(points)[..., :2]

    def coordinates(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Coordinates in the plane and distance from it, (..., 3), of points (..., 3)."""
        return (np.asarray(points, np.float64) - self.origin) @ self.frame.T


def cut(mesh: Mesh, plane: Plane) -> NDArray[np.float64]:
    """Intersections of a plane with the triangles of a mesh: segments (k, 2, 2) in the plane."""
    corners = plane.coordinates(mesh.vertices)[mesh.faces]  # (m, 3, 3)
    above = corners[..., 2] > 0
    crossed = above.any(axis=1) & ~above.all(axis=1)
    corners, above = corners[crossed], above[crossed]
    single_above = above.sum(axis=1) == 1
    alone = np.where(single_above, above.argmax(axis=1), (~above).argmax(axis=1))  # the only vertex on its side
    rows = np.arange(len(corners))
    apex = corners[rows, alone][:, None]
    others = np.stack([corners[rows, (alone + k) % 3] for k in (1, 2)], axis=1)
    share = apex[..., 2:] / (apex[..., 2:] - others[..., 2:])
    return (apex + share * (others - apex))[..., :2]


def is_specular(step: Step) -> bool:
    """Whether a path is bent at a surface, and not scattered."""
    return not np.isnan(step.eta) or "reflected" in step.event


def draw_section(prepared: PreparedScene, steps: Steps, axes: Any) -> None:
    """Draw the interfaces at which a path begins, or else its first hit, in the plane of incidence of that."""
    met = [step for step in steps.path if step.prim_id >= 0]
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set(visible=True, color="#aaaaaa", linewidth=0.6)
    if not met:
        axes.set_title("the ray hits nothing", loc="left")
        return
    plane = Plane(met[0], -prepared.view.down)
    bent = list(takewhile(is_specular, met)) or met[:1]
    points = plane.project(np.array([step.p for step in bent]))
    low, high = points.min(axis=0), points.max(axis=0)
    mesh = prepared.scene.mesh
    margin = max(AROUND * (high - low).max(), MIN_MARGIN * float(np.ptp(mesh.vertices, axis=0).max()))
    middle, half = (low + high) / 2, (high - low).max() / 2 + margin
    _scene(axes, cut(mesh, plane))
    draw_path(axes, steps, plane.project, half)
    labels: list[NDArray[np.float64]] = []  # centres of the labels so far
    for step in bent[:ARCS]:
        _angles(axes, step, plane, ARC * half, labels)
    axes.set(
        xlim=(middle[0] - 1.6 * half, middle[0] + 1.6 * half), ylim=(middle[1] - half, middle[1] + half), aspect="equal"
    )
    off = float(np.abs(plane.coordinates(np.array([step.p for step in bent]))[:, 2]).max())
    note = "" if off < 0.01 * half else f"; the path leaves it by up to {off:.2g}"
    axes.set_title(f"cut along the plane of incidence at 1{note}", loc="left")
    _scale_bar(axes, middle, half)


def _scene(axes: Any, lines: NDArray[np.float64]) -> None:
    from matplotlib.collections import LineCollection

    axes.add_collection(LineCollection(list(lines), colors="#808080", linewidths=1.6, zorder=1))


def _angles(axes: Any, step: Step, plane: Plane, radius: float, labels: list[NDArray[np.float64]]) -> None:
    """Draw the normal on both sides, and arcs from it to the incoming and the outgoing ray."""
    from matplotlib.patches import Arc

    at = plane.project(step.p)
    n = plane.frame[:2] @ step.ns
    axes.plot(
        *np.stack([at - 2.4 * radius * n, at + 2.4 * radius * n]).T, color=BLACK, linewidth=0.9, linestyle=(0, (4, 3))
    )
    sides = [(n, -(plane.frame[:2] @ step.d), step.angle_in)]
    if step.onward is not None and is_specular(step):
        ray = plane.frame[:2] @ step.onward
        sides.append((n if ray @ n > 0 else -n, ray, step.angle_out))
    for normal, ray, angle in sides:
        ends = [float(np.degrees(np.arctan2(vector[1], vector[0]))) for vector in (normal, ray)]
        if (ends[1] - ends[0]) % 360 > 180:
            ends.reverse()
        axes.add_patch(
            Arc((at[0], at[1]), 2 * radius, 2 * radius, theta1=ends[0], theta2=ends[1], linewidth=1.4, zorder=6)
        )
        place = _free_place(at, radius * _beside(normal, ray), LABEL * radius / ARC, labels)
        style = {"ha": "center", "va": "center", "fontsize": 12, "zorder": 9, "annotation_clip": True}
        axes.annotate(f"{angle:.1f}\N{DEGREE SIGN}", place, bbox=LABEL_BOX, **style)


def _free_place(
    at: NDArray[np.float64], offset: NDArray[np.float64], size: NDArray[np.float64], labels: list[NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Return the centre of a label, turned and pushed until it overlaps no earlier one; it is added to them."""
    place = at + offset
    for push, degrees in product((1.0, 1.25, 1.5, 1.75), (0, 25, -25, 50, -50, 75, -75)):
        cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        place = at + push * (np.array([[cos, -sin], [sin, cos]]) @ offset)
        if all((np.abs(place - other) >= size).any() for other in labels):
            break
    labels.append(place)
    return place


def _beside(normal: NDArray[np.float64], ray: NDArray[np.float64]) -> NDArray[np.float64]:
    """Position of an angle's label, in radii of its arc: inside the angle, or beside the normal if it is narrow."""
    normal, ray = normal / np.linalg.norm(normal), ray / max(float(np.linalg.norm(ray)), 1e-9)
    if normal @ ray < WIDE:
        middle = normal + ray
        return 1.75 * middle / np.linalg.norm(middle)
    aside = np.array([-normal[1], normal[0]])
    return 2.4 * normal + (0.55 if aside @ ray <= 0 else -0.55) * aside


def _scale_bar(axes: Any, middle: NDArray[np.float64], half: float) -> None:
    """Draw a scale bar of a round length."""
    step = 10.0 ** np.floor(np.log10(half))
    length = max(k * step for k in (0.5, 1, 2, 5) if k * step <= 1.2 * half)
    x, y = middle[0] + 1.5 * half - length, middle[1] - 0.9 * half
    axes.plot([x, x + length], [y, y], color=BLACK, linewidth=4, solid_capstyle="butt", zorder=9)
    axes.text(
        x + length / 2,
        y + 0.04 * half,
        f"{length:g} world unit{'s' * int(length != 1)}",
        ha="center",
        va="bottom",
        fontsize=12,
        zorder=9,
    )
