"""The demo: a small scene that comes with the package."""

from __future__ import annotations

import json
from contextlib import ExitStack
from importlib.resources import as_file, files

from raytrace.records import Scene
from raytrace.scene.load import load


def demo() -> Scene:
    """Load a small scene that comes with the package; it needs no file.

    Returns
    -------
    Scene
        640 x 480 pixels, 16 samples per pixel: an image takes a few seconds.

    Examples
    --------
    >>> import raytrace as rt
    >>> scene = rt.demo()
    >>> rt.render(scene).save("demo.png")  # doctest: +SKIP
    >>> scene.settings.size
    (640, 480)
    """
    folder = files("raytrace.scene") / "demo"
    scene = json.loads((folder / "demo.json").read_text("utf-8"))
    with ExitStack() as stack:  # a package in a zip has no files: its meshes become temporary ones
        paths = {name: stack.enter_context(as_file(folder / name)) for name in {o["mesh"] for o in scene["objects"]}}
        return load(scene | {"objects": [entry | {"mesh": paths[entry["mesh"]]} for entry in scene["objects"]]})
