"""``live``: an interactive viewer for notebooks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from raytrace.errors import PackageError
from raytrace.limits import MAX_SPP
from raytrace.records import Scene
from raytrace.rendering.rendering import within
from raytrace.scene.load import load
from raytrace.show.prepared_scene import AnyScene, prepare_scene

if TYPE_CHECKING:
    from raytrace.show.widget import Viewer

SIDE = 256  # default pixels of the longer side


def live(scene: AnyScene, *, size: tuple[int, int] | None = None, spp: int = 64) -> Viewer:
    """Open an interactive viewer: turn the camera, change lights and glass, and show the path of a pixel.

    Parameters
    ----------
    scene : Scene, str, Path or dict
        A loaded scene, a scene file, or its content.
    size : (width, height), pixels, optional
        Size of the image while the scene moves; default: the scene's, reduced so that its longer side has at most 256
        pixels. At rest, the image has a multiple of this size: a pixel for each of the screen.
    spp : int
        Samples per pixel of the final image, after the last change.

    Returns
    -------
    Viewer
        A widget; a notebook displays it as the last line of a cell, or by ``display``.

    Raises
    ------
    SceneError, FileError
        As for ``load``.
    OptionError
        An invalid size or number of samples.
    RaytraceError
        anywidget isn't installed.

    Notes
    -----
    Trees are built once, because they do not depend on the camera, the fluxes or the indices of refraction. The final
    image is bit-identical to ``rt.render(viewer.scene)``.

    Examples
    --------
    >>> import raytrace as rt
    >>> viewer = rt.show.live("scenes/cornell-box-glass.json")
    >>> viewer.power, viewer.ior = 2.0, {"pane": 0.7}
    >>> viewer.scene.materials.ior.tolist()
    [1.0, 1.0, 1.0, 0.7]
    """
    try:
        from raytrace.show.widget import Viewer
    except ImportError:
        raise PackageError("rt.show.live needs anywidget: pip install anywidget") from None
    if not isinstance(scene, Scene):
        scene = load(scene)
    if size is None:
        width, height = scene.settings.size
        scale = min(SIDE / max(width, height), 1.0)
        size = max(round(scale * width), 1), max(round(scale * height), 1)
    return Viewer(prepare_scene(scene, size), within("spp", spp, 1, MAX_SPP))
