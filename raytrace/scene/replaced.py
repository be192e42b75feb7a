"""``Scene.replace``: a scene with other values, which shares with the first one what stays the same."""

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from raytrace.errors import SceneError, printable
from raytrace.scene.changes import Change, apply_change, parse_path
from raytrace.scene.checks import check
from raytrace.scene.content import Content, content_of, data_of
from raytrace.scene.format import read_format
from raytrace.scene.load import read_scene
from raytrace.scene.other_camera import keep_framed, share_all, share_trees
from raytrace.scene.problems import unknown_key
from raytrace.scene.text import Text, from_dict

if TYPE_CHECKING:
    from raytrace.records import Scene

SECTIONS = "camera", "film", "render", "lights", "materials", "objects", "background", "about"
VIEW = "camera", "film", "render", "background", "about", "$schema"  # sections without meshes and tables
SAMPLING = "size", "spp", "sampler", "seed", "precision"  # settings that no table depends on


def replaced_by_program(scene: "Scene", changes: Mapping[str, Any], sections: Mapping[str, Any]) -> "Scene":
    """Return a scene with other values; the arguments are those of ``Scene.replace``."""
    for key in sections:
        if key not in SECTIONS:
            raise SceneError([f"replace: {unknown_key(key, SECTIONS)}"])
    try:
        parsed = [Change(parse_path(path), value, path) for path, value in changes.items()]
    except ValueError as error:
        raise SceneError([f"replace: {error}"]) from None
    return replaced(scene, parsed, sections)


def replaced(
    scene: "Scene",
    changes: Iterable[Change],
    sections: Mapping[str, Any],
    *,
    label: Callable[[Change], str] = lambda change: change.word,
    text_of: Callable[[Text], Text] = lambda text: text,
) -> "Scene":
    """Return a scene with other sections and other values.

    Parameters
    ----------
    scene : Scene
    changes : iterable of Change
    sections : mapping
        Key of the scene -> its value; may contain arrays, paths and meshes.
    label : callable
        What a message calls a change.
    text_of : callable
        Returns a text whose problems are worded in another way.

    Raises
    ------
    SceneError, FileError
        As ``load`` does.
    """
    content, old = content_of(scene), data_of(scene)
    given = from_dict(_with_meshes(old, content.text.meshes) | dict(sections))
    data, trusted = given.parse(), content.reach.trusted | given.trusted
    name = printable(scene.source or "scene")
    for change in changes:
        value = from_dict({"value": change.value})  # arrays and paths, as JSON types
        try:
            apply_change(data, change._replace(value=value.parse()["value"]))
        except ValueError as error:
            raise SceneError([printable(f"{name}: {label(change)}: {error}")]) from None
        trusted |= value.trusted
    text = Text(name, json.dumps(data), False, trusted, given.meshes)
    text.changes = content.text.changes
    text = text_of(text)
    new = Content(text, content.reach._replace(trusted=trusted))
    rest = [{key: value for key, value in each.items() if key not in VIEW} for each in (data, old)]
    if rest[0] == rest[1] and _same_meshes(text.meshes, content.text.meshes):
        return _other_view(scene, data, new, same_camera=data["camera"] == old["camera"])
    return _sharing_triangles(read_scene(text, scene.source, new.reach), scene)


def _with_meshes(data: dict[str, Any], meshes: Mapping[str, Any]) -> dict[str, Any]:
    """Return a scene with its meshes in memory, in place of their names."""
    entries = [
        {**entry, "mesh": meshes[entry["mesh"]]} if entry.get("mesh") in meshes else entry for entry in data["objects"]
    ]
    return {**data, "objects": entries}


def _same_meshes(a: Mapping[str, Any], b: Mapping[str, Any]) -> bool:
    return a.keys() == b.keys() and all(a[name] is b[name] for name in a)


def _other_view(scene: "Scene", data: dict[str, Any], content: Content, *, same_camera: bool) -> "Scene":
    """Return a scene with another camera, other settings or another background; no mesh is read."""
    from raytrace.scene.assemble import camera_of, settings_of

    read, problems = read_format(data)
    if problems := problems + check(data):
        raise content.text.error(problems, {})
    assert read is not None
    settings, background = settings_of(read.film, read.render), np.array(read.background)
    other = replace(
        scene,
        about=read.about,
        camera=camera_of(read.camera),
        settings=settings,
        background=background,
        content=content,
    )
    if "corner_uv" in vars(scene):  # read from files
        vars(other)["corner_uv"] = scene.corner_uv
    if same_camera:
        keep_framed(other, scene)
    new, old = settings._asdict(), scene.settings._asdict()
    same_tables = all(new[key] == old[key] for key in new if key not in SAMPLING)
    if same_tables and np.array_equal(background, scene.background):
        return share_all(other, scene)
    return share_trees(other, scene)


def _sharing_triangles(other: "Scene", scene: "Scene") -> "Scene":
    """Return a scene that shares the trees of another one if its triangles are the same."""
    new, old = other.mesh, scene.mesh
    if not (np.array_equal(new.faces, old.faces) and np.array_equal(new.vertices, old.vertices)):
        return other
    mesh = new._replace(vertices=old.vertices, faces=old.faces)
    if np.array_equal(other.camera.position, scene.camera.position):
        keep_framed(other, scene)
    return share_trees(replace(other, mesh=mesh), scene)
