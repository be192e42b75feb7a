"""The records of a scene with a closed form, and helpers that make the content of scene files."""

from collections.abc import Sequence
from typing import Any, NamedTuple

SIZE, SAMPLES = (32, 32), 256
TOLERANCE = 0.01  # relative: five standard errors of a path tracer, and what textures and meshes are not
EXACT = 0.005  # where every sample has nearly the same value
DEEP = 48  # surfaces: all light but a part in 10^6

WEIGHTS = "weights of multiple importance sampling, densities of lamps and directions, the cosine at the surface"

Colour = tuple[float, float, float]


class Region(NamedTuple):
    """A part of the image, and its mean radiance."""

    name: str
    box: tuple[int, int, int, int]  # pixels: first column and row, and those after the last
    expected: Colour
    tolerance: float = TOLERANCE  # relative


class Cause(NamedTuple):
    """What the regions show where a renderer has a certain error."""

    text: str
    expected: tuple[Colour, ...]  # of each region


class Case(NamedTuple):
    """A scene and its answer."""

    name: str  # of its files
    about: str
    scene: dict[str, Any]  # content of the scene file
    regions: tuple[Region, ...]
    causes: tuple[Cause, ...] = ()
    section: str = ""  # of docs/closed-forms.md
    samples: int = SAMPLES
    suspect: str = ""  # what to look at where no cause fits
    approximate: tuple[str, ...] = ()  # formats whose approximation has the same answer here
    files: dict[str, bytes] = {}  # images and meshes, by their names beside the scene


def grey(value: float) -> Colour:
    """A colour of equal channels."""
    return (value, value, value)


def everywhere(
    expected: float | Colour, tolerance: float = TOLERANCE, size: tuple[int, int] = SIZE
) -> tuple[Region, ...]:
    """One region: the whole image."""
    colour = grey(expected) if isinstance(expected, float) else expected
    return (Region("whole image", (0, 0, *size), colour, tolerance),)


def told_apart(right: float, *given: tuple[str, float]) -> list[tuple[str, float]]:
    """Mistakes whose values are far enough from the right one to be seen."""
    return [(text, value) for text, value in given if abs(value / right - 1) > 2 * TOLERANCE]


def causes(*given: tuple[str, float | Colour]) -> tuple[Cause, ...]:
    """Causes for one region."""
    return tuple(Cause(text, (grey(v) if isinstance(v, float) else v,)) for text, v in given)


def diffuse(albedo: float, emission: float = 0.0) -> dict[str, Any]:
    """A diffuse material, that emits or not."""
    lamp = {"emission": list(grey(emission))} if emission else {}
    return {"type": "diffuse", "albedo": list(grey(albedo)), **lamp}


def view(position: Sequence[float], look_at: Sequence[float], fov: float) -> dict[str, Any]:
    """A pinhole camera, y up, that may look along y too."""
    return {"position": list(position), "look_at": list(look_at), "up": [0, 1, 0.001], "fov": fov}


def orthographic(position: Sequence[float], look_at: Sequence[float], height: float) -> dict[str, Any]:
    """An orthographic camera, y up."""
    camera = {"type": "orthographic", "position": list(position), "look_at": list(look_at), "height": height}
    return {**camera, "up": [0, 1, 0]}


def environment(radiance: float) -> dict[str, Any]:
    """An even environment."""
    return {"type": "environment", "radiance": list(grey(radiance))}


def scene(
    camera: dict[str, Any],
    objects: Sequence[tuple[dict[str, Any], dict[str, Any]]],
    lights: Sequence[dict[str, Any]] = (),
    *,
    depth: int = DEEP,
    size: tuple[int, int] = SIZE,
) -> dict[str, Any]:
    """The content of a scene file: shapes, each with its own material, and lights."""
    named = {f"material-{k}": material for k, (_, material) in enumerate(objects)}
    return {
        "camera": camera,
        "film": {"size": list(size), "filter": "box"},
        "render": {"integrator": "path", "max_depth": depth, "spp": SAMPLES},
        **({"lights": list(lights)} if lights else {}),
        "materials": named,
        "objects": [{**shape, "material": f"material-{k}"} for k, (shape, _) in enumerate(objects)],
    }


def floor(scale: float = 10.0, **more: Any) -> dict[str, Any]:
    """A large square at z = 0 that faces +z."""
    return {"rectangle": {}, "scale": scale, **more}
