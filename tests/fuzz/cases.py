"""Cases of all kinds, each from a seed and a number."""

import json
from functools import cache
from random import Random
from typing import Any

import images
import mutations
import seeds
import textures
from mill import DIFFERENT, DONE, FILE, TRIANGLE, Case

SIZE = ["--size", "8x8", "--spp", "2", "--threads", "1", "--precision", "float64", "--quiet"]
PICTURE = "picture.npz"
CUBE = "".join(f"v {x} {y} {z}\n" for x in (0, 1) for y in (0, 1) for z in (0, 1)) + (
    "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"
)
MESHES = seeds.meshes()
BESIDE = MESHES | {"triangle.obj": TRIANGLE.encode(), "cube.obj": CUBE.encode(), "house.mtl": seeds.MTL.encode()}


def scene_of(mesh: str) -> dict[str, Any]:
    """A scene with one mesh."""
    return {
        "camera": {"position": [0.4, 0.7, 6], "look_at": [0.5, 0.5, 0], "fov": 30},
        "lights": [{"type": "point", "position": [0, 1.5, 3], "flux": [17, 12, 5]}],
        "materials": {"white": {"type": "diffuse", "albedo": [0.7, 0.7, 0.7], "two_sided": True}},
        "objects": [{"mesh": mesh, "material": "white", "normals": "smooth"}],
        "background": [0.25, 0.5, 1],
    }


def mesh(seed: int, k: int, name: str = "") -> Case:
    """A mesh mutated by bytes."""
    rng = Random(f"mesh {seed} {k}")
    name = name or rng.choice(list(MESHES))
    data = mutations.mutate(name, MESHES[name], rng)
    files = {"scene.json": json.dumps(scene_of(name)).encode(), name: data, "house.mtl": seeds.MTL.encode()}
    return Case(files, ["scene.json", "-o", PICTURE, *SIZE], f"mesh {seed} {k}", True, output=PICTURE)


def scene_text(text: bytes, about: str) -> Case:
    """A scene beside all meshes."""
    return Case(BESIDE | {"scene.json": text}, ["scene.json", "-o", PICTURE, *SIZE], about, True, output=PICTURE)


WHOLE = scene_of("a.obj") | {
    "$schema": "https://example.org",
    "film": {"size": [4, 3]},
    "render": {"spp": 2, "max_depth": 3, "sampler": "stratified", "precision": "float64", "seed": 7},
    "about": "Ä scene.",
}
DIALECT = {
    "integrator": {"type": "intersection_test", "spp": 2},
    "camera": {"transform": {"lookat": {"position": [0, 1, 5], "look_at": [0, 1, 0], "ref_up": [0, 1, 0]}}, "fov": 30},
}


def scene_bytes(seed: int, k: int) -> Case:
    """A scene mutated by bytes."""
    rng = Random(f"scene {seed} {k}")
    text = json.dumps(WHOLE, indent=rng.choice([None, 1]), ensure_ascii=rng.random() < 0.5).encode()
    return scene_text(mutations.mutate("scene.json", text, rng), f"scene {seed} {k}")


@cache
def pictures() -> tuple[dict[str, bytes], dict[str, bytes]]:
    """Pictures that are right, and ones that are refused as they are."""
    return seeds.pictures() | images.right(), images.odd()


def picture(seed: int, k: int, name: str = "") -> Case:
    """A picture mutated by its parts, by bytes, or both; compared with a right one."""
    rng = Random(f"picture {seed} {k}")
    right, odd = pictures()
    name = name or rng.choice([*right, *odd])
    data = images.mutate(name, (right | odd)[name], rng)
    other = name if name in right else f"a{name[-4:]}"
    files = {f"wrong-{name}": data, f"right-{other}": right[other]}
    return Case(files, ["compare", *files], f"picture {seed} {k}", codes=(DONE, FILE, DIFFERENT))


@cache
def texture_files() -> dict[str, bytes]:
    """Textures that are right, and some that are refused."""
    return textures.files()


def texture(seed: int, k: int) -> Case:
    """A mutated texture of a lamp, compared with a second decoder."""
    return textures.texture(seed, k, texture_files())
