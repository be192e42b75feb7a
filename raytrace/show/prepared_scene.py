"""``PreparedScene``: a scene for a drawing, with the same compiled scene that ``render`` uses."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.bvh import BVH
from raytrace.errors import OptionError, printable
from raytrace.passes.camera import make_view
from raytrace.records import Scene, Settings, View
from raytrace.rendering.compiled_scene import CompiledScene, compiled_of
from raytrace.rendering.rendering import override
from raytrace.scene.load import load
from raytrace.scene.plan import make_plan
from raytrace.scene.sources import Source

LABELS = {"sah": "SAH", "median": "median"}  # names of splits in titles
AnyScene = Scene | Source


class PreparedScene(NamedTuple):
    """A scene, its settings, and what is compiled from it."""

    name: str
    scene: Scene
    settings: Settings
    compiled: CompiledScene
    view: View


def prepare_scene(scene: AnyScene, size: tuple[int, int] | None = None, integrator: str | None = None) -> PreparedScene:
    """Load a scene if necessary, and compile it; ``size`` (width, height) replaces the size of its film."""
    if not isinstance(scene, Scene):
        scene = load(scene)
    settings = override(scene.settings, None, size, None, None, None, integrator=integrator)
    plan = make_plan(scene)
    precision = plan.precision.name if settings.precision == "auto" else settings.precision
    view = make_view(scene.camera, settings.size, np.dtype(precision))
    name = printable(scene.source.stem) if scene.source else "scene"
    return PreparedScene(name, scene, settings, compiled_of(scene, plan, precision), view)


def tree_of(prepared: PreparedScene, split: str) -> BVH:
    """The tree that ``render`` uses, or a new one if that has another split."""
    bvh, mesh = prepared.compiled.bvh, prepared.scene.mesh
    return bvh if split == bvh.split else BVH(mesh.vertices, mesh.faces, bvh.precision, split)


def check_pinhole(prepared: PreparedScene) -> None:
    """Refuse an orthographic camera, for drawings that trace rays from one point."""
    if prepared.scene.camera.height is not None:
        raise OptionError("this drawing needs a perspective camera; use rt.show.path for an orthographic one")


def pixel_centres(size: tuple[int, int], fine: int = 1) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Coordinates x and y of pixel centres on the film, (h * fine * w * fine,), row by row.

    Each pixel is divided into fine x fine cells; the centres are those of the cells.
    """
    width, height = size
    y, x = (np.mgrid[0 : height * fine, 0 : width * fine] + 0.5) / fine
    return x.ravel(), y.ravel()
