"""The scenes of the project, each loaded once for all tests."""

import functools
from pathlib import Path

import pytest

import raytrace as rt

ALL = sorted((Path(__file__).parents[1] / "scenes").glob("*.json"))
PATH_TRACED = [path for path in ALL if '"integrator": "path"' in path.read_text("utf-8")]
SCENES = [path for path in ALL if path not in PATH_TRACED]
each_scene = pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
load = functools.cache(rt.load)
