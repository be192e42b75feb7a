"""Scenes in Mitsuba 3, as ``raytrace export`` writes them."""

import dataclasses
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from peers import mitsuba

from raytrace.exporting.export import export_scene
from raytrace.records import Scene


def peer(scene: Scene, size: tuple[int, int], approximate: bool = False) -> Callable[[int, int], np.ndarray]:
    """Return a function that renders an image (h, w, 3), given samples per pixel and a seed."""
    mi = mitsuba()
    sized = dataclasses.replace(scene, settings=scene.settings._replace(size=size))
    with tempfile.TemporaryDirectory() as folder:
        path, _ = export_scene(sized, "mitsuba", Path(folder) / "exported", approximate)
        loaded = mi.load_file(str(path))
    return lambda spp, seed: np.array(mi.render(loaded, spp=spp, seed=seed), np.float64)
