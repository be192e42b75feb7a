"""The scenes of the project, each loaded once for all tests."""

import functools
from pathlib import Path

import pytest

import raytrace as rt

SCENES = sorted((Path(__file__).parents[1] / "scenes").glob("*.json"))
each_scene = pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
load = functools.cache(rt.load)
