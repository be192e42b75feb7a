"""Scenes that differ from another one only in their camera, and share with it what does not depend on the camera."""

import math
from dataclasses import replace
from typing import Any
from weakref import WeakKeyDictionary, WeakSet

from raytrace.errors import SceneError
from raytrace.records import Camera, Scene

_bases: WeakKeyDictionary[Scene, Scene] = WeakKeyDictionary()  # scene with another camera -> the scene it comes from

_roots: WeakKeyDictionary[Scene, Scene] = WeakKeyDictionary()  # scene -> the one whose trees it shares

_framed: WeakSet[Scene] = WeakSet()  # scenes without a camera of their own


def base_of(scene: Scene) -> Scene:
    """Return the scene whose trees and tables a scene shares: itself, unless it comes from ``with_camera``."""
    return _bases.get(scene, scene)


def root_of(scene: Scene) -> Scene:
    """Return the scene whose trees a scene shares, but not its tables: itself, unless it comes from ``share_trees``."""
    base = base_of(scene)
    return _roots.get(base, base)


def share_trees(other: Scene, scene: Scene) -> Scene:
    """Let a scene of the same triangles share the trees of a scene, which is kept alive; return it."""
    _roots[other] = root_of(scene)
    return other


def share_all(other: Scene, scene: Scene) -> Scene:
    """Let a scene that differs in its camera only share trees and tables of a scene, which is kept alive; return it."""
    _bases[other] = base_of(scene)
    return other


def with_camera(scene: Scene, camera: dict[str, Any] | Camera) -> Scene:
    """Return a scene seen by another camera.

    Parameters
    ----------
    scene : Scene
    camera : dict or Camera
        As ``camera`` in a scene file; it may contain NumPy arrays. Or one like ``scene.camera``.

    Returns
    -------
    Scene
        With a hash of its own. It shares the trees of ``scene``, and keeps it alive.

    Raises
    ------
    SceneError
        What is wrong with the camera, one line per problem.

    Examples
    --------
    >>> import raytrace as rt
    >>> scene = rt.load("scenes/cornell-box.json")
    >>> with_camera(scene, {"position": [0, 1, 4], "look_at": [0, 1, 0], "fov": 30}).camera.fov
    30.0
    >>> with_camera(scene, {"position": [0, 1, 4], "look_at": [0, 1, 0], "fov": -30})
    Traceback (most recent call last):
    raytrace.errors.SceneError: camera.fov: expected a number > 0, got -30
    """
    from raytrace.scene.assemble import camera_of
    from raytrace.scene.checks import check_camera
    from raytrace.scene.format import read_camera
    from raytrace.scene.text import Text, from_dict

    entry = entry_of(camera) if isinstance(camera, Camera) else camera
    try:
        text = Text("", from_dict({"camera": entry}).text, in_file=False)
    except SceneError as error:
        raise SceneError([f"camera: {line.removeprefix('scene: ')}" for line in error.problems]) from None
    data = text.parse()["camera"]
    view, problems = read_camera(data)
    if problems := problems + list(check_camera(data)):
        raise text.error(problems, {})
    return _sharing(scene, camera_of(view))


def entry_of(camera: Camera) -> dict[str, Any]:
    """Return a camera in the scene format."""
    entry: dict[str, Any] = {key: getattr(camera, key) for key in ("position", "look_at", "up")}
    if camera.height is not None:
        return entry | {"type": "orthographic", "height": camera.height}
    return entry | {"fov": camera.fov, "aperture": camera.aperture, "focus": camera.focus}


def _sharing(scene: Scene, camera: Camera) -> Scene:
    other = replace(scene, camera=camera)
    if "corner_uv" in vars(scene):  # read from files
        vars(other)["corner_uv"] = scene.corner_uv
    return share_all(other, scene)


def keep_framed(other: Scene, scene: Scene) -> None:
    """Note that the camera of a scene was chosen if that of another one was."""
    if scene in _framed:
        _framed.add(other)


def framed(scene: Scene) -> Scene:
    """Note that the camera of a scene was chosen so that everything is in view, and return the scene."""
    _framed.add(scene)
    return scene


def in_view(scene: Scene, size: tuple[int, int]) -> Scene:
    """Return a scene whose camera is far enough for an image of a size, if it was chosen so that everything is in view.

    Notes
    -----
    The bounding sphere touches the edges of an image with half the angle a at the distance r / sin a. In an image that
    is taller than wide, the horizontal angle counts: tan a' = tan a x width / height.
    """
    if size[0] >= size[1] or scene not in _framed:
        return scene
    camera = scene.camera
    half = math.radians(camera.fov / 2)
    factor = math.sin(half) / math.sin(math.atan(math.tan(half) * size[0] / size[1]))
    position = camera.look_at + factor * (camera.position - camera.look_at)
    return _sharing(scene, camera._replace(position=position, focus=factor * camera.focus))
