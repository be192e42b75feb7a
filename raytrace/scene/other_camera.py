"""Scenes that differ from another one only in their camera, and share with it what does not depend on the camera."""

from typing import Any
from weakref import WeakKeyDictionary

from raytrace.errors import SceneError
from raytrace.records import Scene

_bases: WeakKeyDictionary[Scene, Scene] = WeakKeyDictionary()  # scene with another camera -> the scene it comes from


def base_of(scene: Scene) -> Scene:
    """Return the scene whose trees and tables a scene shares: itself, unless it comes from ``with_camera``."""
    return _bases.get(scene, scene)


def with_camera(scene: Scene, camera: dict[str, Any]) -> Scene:
    """Return a scene seen by another camera.

    Parameters
    ----------
    scene : Scene
    camera : dict
        As ``camera`` in a scene file; it may contain NumPy arrays.

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
    from dataclasses import replace

    from raytrace.scene.assemble import camera_of
    from raytrace.scene.checks import check_camera
    from raytrace.scene.format import read_camera
    from raytrace.scene.text import Text, from_dict

    try:
        text = Text("", from_dict({"camera": camera}).text, in_file=False)
    except SceneError as error:
        raise SceneError([f"camera: {line.removeprefix('scene: ')}" for line in error.problems]) from None
    data = text.parse()["camera"]
    view, problems = read_camera(data)
    if problems := problems + list(check_camera(data)):
        raise text.error(problems, {})
    base = base_of(scene)
    other = replace(scene, camera=camera_of(view))
    if "corner_uv" in vars(scene):  # read from files
        vars(other)["corner_uv"] = scene.corner_uv
    _bases[other] = base
    return other
