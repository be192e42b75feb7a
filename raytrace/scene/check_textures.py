"""What the keys of textures must agree on."""

from collections.abc import Iterator
from typing import Any

from raytrace.scene.attributes import TEXTURED
from raytrace.scene.positions import Path
from raytrace.scene.problems import Problem


def check_textures(data: dict[str, Any]) -> Iterator[Problem]:
    """Find what the keys of textures disagree on, in a scene that need not be valid."""
    for path, texture in textures_in(data):
        name, board = texture.get("image"), texture.get("checkerboard")
        if path[0] == "lights":  # no key of theirs needs another
            continue
        if isinstance(name, str) and name.lower().endswith(".exr") and texture.get("encoding") == "srgb":
            yield Problem((*path, "encoding"), 'the values of an EXR are linear; remove "encoding"')
        if path[-1] != "emission" and isinstance(board, list):
            for i, colour in enumerate(board):
                for k, value in enumerate(colour if isinstance(colour, list) else []):
                    if type(value) in (int, float) and value > 1:
                        where = (*path, "checkerboard", i, k)
                        yield Problem(where, f"expected a number <= 1, got {value:.6g}")


def textures_in(data: dict[str, Any]) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Yield the path and the keys of each texture, and of an environment."""
    lights = data.get("lights")
    for i, light in enumerate(lights if isinstance(lights, list) else []):
        if isinstance(light, dict) and light.get("type") == "environment":
            yield ("lights", i), light
    materials = data.get("materials")
    for name, material in (materials if isinstance(materials, dict) else {}).items():
        for key in TEXTURED if isinstance(material, dict) else ():
            if isinstance(material.get(key), dict):
                yield ("materials", name, key), material[key]
