"""``live``: a scene in the hand, in a notebook."""

from typing import TYPE_CHECKING

from raytrace.errors import RaytraceError
from raytrace.limits import MAX_SPP
from raytrace.records import Scene
from raytrace.rendering.rendering import within
from raytrace.scene.load import load
from raytrace.show.scene_rays import AnyScene, make_subject

if TYPE_CHECKING:
    from raytrace.show.widget import Viewer

SIDE = 256  # pixels of the longer side, unless asked for otherwise


def live(scene: AnyScene, *, size: tuple[int, int] | None = None, spp: int = 64) -> "Viewer":
    """Take a scene in the hand: turn it, change its light and its glass, and follow the ray behind a pixel.

    Parameters
    ----------
    scene : Scene, str, Path or dict
        A loaded scene, a scene file, or its content.
    size : (width, height), pixels, optional
        Of the film; default: the scene's own, made smaller until its longer side has 256.
    spp : int
        Samples per pixel when the hand rests.

    Returns
    -------
    Viewer
        It shows itself in a notebook: as the last line of a cell, or by ``display``.

    Raises
    ------
    SceneError, FileError
        As ``load`` does.
    OptionError
        A size or a number of samples that can't be met.
    RaytraceError
        anywidget isn't installed.

    Notes
    -----
    Trees are built once: they depend neither on the camera, nor on fluxes, nor on indices of refraction. The picture
    at rest has the bits of ``rt.render(viewer.scene)``.

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
        raise RaytraceError("rt.show.live needs anywidget: pip install anywidget") from None
    if not isinstance(scene, Scene):
        scene = load(scene)
    if size is None:
        width, height = scene.settings.size
        scale = min(SIDE / max(width, height), 1.0)
        size = max(round(scale * width), 1), max(round(scale * height), 1)
    return Viewer(make_subject(scene, size), within("spp", spp, 1, MAX_SPP))
