"""The quick reading of valid scenes takes what the models take, gives what they give, and doubts all else."""

import copy
import json
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError

from raytrace.scene import schema_text
from raytrace.scene.conform import UNDERSTOOD, conform
from raytrace.scene.schema import MAX_PIXELS, MAX_SIDE, SceneFile

pytestmark = pytest.mark.nojit
SCENES = sorted((Path(__file__).parents[1] / "scenes").glob("*.json"))
WHOLE = {
    "$schema": "https://example.org",
    "about": "All that the format has.",
    "camera": {"position": [0, 1, 6.8], "look_at": [0, 1, 0], "up": [0, 2, 0], "fov": 20},
    "film": {"size": [4, 3]},
    "render": {"spp": 2, "max_depth": 3, "sampler": "stratified", "precision": "float64", "seed": 7},
    "lights": [{"type": "point", "position": [0, 1, 2], "flux": [1, 0, 2.5]}],
    "materials": {
        "white": {"type": "diffuse", "albedo": [0, 1, 0.5], "two_sided": True},
        "glass": {"type": "refractive", "ior": 1.5, "shadows": "transparent"},
    },
    "objects": [
        {"mesh": "a.obj", "material": "white", "scale": 2, "normals": "smooth"},
        {"mesh": "b.obj", "material": "glass", "scale": [1, -1, 2], "rotate": {"axis": [0, 1, 0], "angle": 30}},
        {"mesh": "c.obj", "material": "glass", "rotate": None, "translate": [1, 2, 3]},
    ],
    "background": [1, 2, 3],
}
VALUES = [None, True, False, 0, 1, -1, 2, 0.5, 1e300, 10**20, 10**299, 65537, "", "a", "diffuse", "sobol", "flat"]
VALUES += [[], {}, [0, 0, 0], [1, 2], [1, 2, 3, 4], [1, 2, "3"], [True, 1, 1], {"type": "point"}, {"type": "diffuse"}]


def plain(value):
    """Models and namespaces as dicts, with their types."""
    if isinstance(value, BaseModel):
        fields = {field.alias or name: name for name, field in type(value).model_fields.items()}
        return {key: plain(getattr(value, name)) for key, name in fields.items()}
    if isinstance(value, SimpleNamespace):
        value = vars(value)
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(map(plain, value))
    return type(value), value


def judged(data):
    """What the models make of a scene; None: it is not valid."""
    try:
        return plain(SceneFile.model_validate(data))
    except ValidationError:
        return None


def places(value, path=()):
    """Paths of all values of a scene, the whole one included."""
    yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from places(item, (*path, key))


def put(path, value):
    """The whole scene with another value at a place."""
    scene = copy.deepcopy(WHOLE)
    *steps, last = path
    place = scene
    for step in steps:
        place = place[step]
    place[last] = value
    return scene


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_shipped_scenes_are_read_quickly_and_rightly(path):
    data = json.loads(path.read_text("utf-8"))
    assert plain(conform(data)) == judged(data)


def test_a_scene_with_everything_and_one_with_the_least_are_read_rightly():
    least = {key: WHOLE[key] for key in ("camera", "materials", "objects")}
    for data in (WHOLE, least):
        assert plain(conform(data)) == judged(data) is not None


PLACES = [path for path in places(WHOLE) if path]


@settings(max_examples=600, deadline=None)
@given(st.sampled_from(PLACES), st.sampled_from(VALUES))
def test_any_change_is_judged_as_the_models_judge_it(path, value):
    data = put(path, value)
    found = conform(data)
    assert (None if found is None else plain(found)) == judged(data)


@pytest.mark.parametrize("path", [path for path in PLACES if isinstance(path[-1], str)])
def test_a_missing_and_an_unknown_key_are_judged_as_the_models_judge_them(path):
    without, more = copy.deepcopy(WHOLE), copy.deepcopy(WHOLE)
    for scene, change in ((without, lambda place: place.pop(path[-1])), (more, lambda place: place.update(lense=1))):
        place = scene
        for step in path[:-1]:
            place = place[step]
        change(place)
        found = conform(scene)
        assert (None if found is None else plain(found)) == judged(scene)


@pytest.mark.parametrize("size", [[MAX_SIDE, MAX_PIXELS // MAX_SIDE], [MAX_SIDE, MAX_PIXELS // MAX_SIDE + 1]])
def test_a_film_has_its_limit(size):
    data = put(("film", "size"), size)
    found = conform(data)
    assert (None if found is None else plain(found)) == judged(data)


def test_a_schema_that_says_more_than_is_understood_is_left_to_the_models(monkeypatch):
    schema = json.loads(schema_text())
    schema["$defs"]["Camera"]["properties"]["fov"]["multipleOf"] = 7
    assert "multipleOf" not in UNDERSTOOD
    monkeypatch.setattr("raytrace.scene.conform.schema_text", lambda: json.dumps(schema))
    assert conform(WHOLE) is None
