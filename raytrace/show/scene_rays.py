"""What a drawing is of: a scene, on the very stage that ``render`` draws it on."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.bvh import BVH
from raytrace.errors import printable
from raytrace.passes.camera import make_view
from raytrace.records import Scene, Settings, View
from raytrace.rendering.compiled_scene import CompiledScene, compiled_of
from raytrace.rendering.rendering import override
from raytrace.scene.load import load
from raytrace.scene.plan import make_plan

LABELS = {"sah": "SAH", "median": "median"}  # of splits, in titles
AnyScene = Scene | str | Path | dict[str, Any]


class Subject(NamedTuple):
    """A scene, ready to be looked into."""

    name: str
    scene: Scene
    settings: Settings
    stage: CompiledScene
    view: View


def make_subject(scene: AnyScene, size: tuple[int, int] | None = None) -> Subject:
    """Load a scene if need be, and put it on its stage; size (width, height) of the film, else the scene's."""
    if not isinstance(scene, Scene):
        scene = load(scene)
    settings = override(scene.settings, None, size, None, None, None)
    plan = make_plan(scene)
    precision = plan.precision.name if settings.precision == "auto" else settings.precision
    view = make_view(scene.camera, settings.size, np.dtype(precision))
    name = printable(scene.source.stem) if scene.source else "scene"
    return Subject(name, scene, settings, compiled_of(scene, plan, precision), view)


def tree_of(subject: Subject, split: str) -> BVH:
    """The tree that ``render`` uses, or one built otherwise."""
    bvh, mesh = subject.stage.bvh, subject.scene.mesh
    return bvh if split == bvh.split else BVH(mesh.vertices, mesh.faces, bvh.precision, split)


def pixel_centres(size: tuple[int, int], fine: int = 1) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centres of pixels, each cut in fine x fine: x and y on the film, (h * fine * w * fine,), row after row."""
    width, height = size
    y, x = (np.mgrid[0 : height * fine, 0 : width * fine] + 0.5) / fine
    return x.ravel(), y.ravel()


def directions_through(view: View, x: NDArray[np.floating], y: NDArray[np.floating]) -> NDArray[np.floating]:
    """Unit directions through points of the film, in pixels: (n, 3)."""
    d = view.forward + (x - view.centre[0])[:, None] * view.right + (y - view.centre[1])[:, None] * view.down
    return (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(view.forward.dtype)
