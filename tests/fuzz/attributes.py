"""Meshes with uv, vertex colours and materials: what is mutated, and scenes that read all of it."""

import io
import json
import struct
from random import Random
from typing import Any

import mutations
import numpy as np
import seeds
from mill import Case

UV = seeds.POINTS[:, :2].astype("<f4")
COLOURS = np.array([[0, 128, 255], [255, 0, 0], [0, 255, 0], [64, 64, 64], [1, 2, 3]], "<u1")


def obj() -> bytes:
    """The house with uv and colours."""
    lines = [line for line in seeds.OBJ.splitlines() if not line.startswith(("v ", "vt", "f ", " 5"))]
    points = [" ".join(map(str, ["v", *p, *(c / 255)])) for p, c in zip(seeds.POINTS, COLOURS, strict=True)]
    lines += points + [f"vt {u} {v}" for u, v in UV.tolist()] + ["vt 0.5", "f 1/1/1 2/2/1 3/3/1 4/4/1"]
    return "\n".join([*lines, "f 4/-1 3/6 -1/1", "f 1/1 2/2 \\", " 5/5", ""]).encode()


def ply(order: str, wedges: bool = False) -> bytes:
    """The pyramid with uv of its vertices, or of its faces, and with colours."""
    head = ["ply", f"format {order} 1.0", f"element vertex {len(UV)}"]
    head += [f"property float {name}" for name in ("x", "y", "z", *(() if wedges else ("s", "t")))]
    head += [f"property uchar {name}" for name in ("red", "green", "blue")]
    head += [f"element face {len(seeds.FACES)}", "property list uchar int vertex_indices"]
    head += ["property list uchar float texcoord"] * wedges
    reals = seeds.POINTS if wedges else np.hstack([seeds.POINTS, UV])
    corners = [UV[face].ravel().tolist() if wedges else None for face in seeds.FACES]
    text, end = "\n".join([*head, "end_header", ""]).encode(), "<" if "little" in order else ">"
    if order == "ascii":
        rows = [[*p, *c] for p, c in zip(reals.tolist(), COLOURS.tolist(), strict=True)]
        rows += [[len(f), *f, *([len(uv), *uv] if uv else [])] for f, uv in zip(seeds.FACES, corners, strict=True)]
        return text + "\n".join(" ".join(map(str, row)) for row in rows).encode() + b"\n"
    for place, colour in zip(reals, COLOURS, strict=True):
        text += place.astype(end + "f4").tobytes() + colour.tobytes()
    for face, uv in zip(seeds.FACES, corners, strict=True):
        text += struct.pack(f"{end}B{len(face)}i", len(face), *face)
        text += struct.pack(f"{end}B{len(uv)}f", len(uv), *uv) if uv else b""
    return text


def png() -> bytes:
    """An image of 3 x 2 pixels."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(np.arange(18, dtype=np.uint8).reshape(2, 3, 3) * 14).save(stream, "PNG")
    return stream.getvalue()


def glb() -> bytes:
    """A GLB of two parts: one with an image, a transform of its uv and a metal; one with vertex colours."""
    arrays = [seeds.POINTS, np.array([0, 1, 2, 0, 2, 3], "<u2"), UV, COLOURS, np.frombuffer(png(), "<u1")]
    data, views = b"", list[dict[str, Any]]()
    for array in arrays:
        data += b"\0" * (-len(data) % 4)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        data += array.tobytes()
    kinds = [(5, "VEC3", 5126), (6, "SCALAR", 5123), (5, "VEC2", 5126), (5, "VEC3", 5121)]
    info = {"index": 0, "texCoord": 0}
    moved = {"KHR_texture_transform": {"offset": [0.25, 0.5], "rotation": 0.5, "scale": [2, 1]}}
    metal = {
        "baseColorTexture": {**info, "extensions": moved},
        "metallicRoughnessTexture": info,
        "roughnessFactor": 0.5,
    }
    matt = {"baseColorFactor": [1, 0.5, 0.25, 1], "metallicFactor": 0}
    content = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "scale": [-1, 1, 1]}],
        "meshes": [
            {
                "primitives": [
                    {"attributes": {"POSITION": 0, "TEXCOORD_0": 2, "COLOR_0": 3}, "indices": 1, "material": 0},
                    {"attributes": {"POSITION": 0, "TEXCOORD_0": 2, "COLOR_0": 3}, "mode": 5, "material": 1},
                ]
            }
        ],
        "materials": [
            {"name": "metal", "pbrMetallicRoughness": metal, "doubleSided": True},
            {"pbrMetallicRoughness": matt, "emissiveFactor": [1, 0, 0], "normalTexture": info, "alphaMode": "MASK"},
        ],
        "textures": [{"source": 0, "sampler": 0}],
        "samplers": [{"wrapS": 33071, "magFilter": 9728}],
        "images": [{"bufferView": 4, "mimeType": "image/png"}],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": views,
        "accessors": [
            {"bufferView": k, "count": count, "type": shape, "componentType": kind, "normalized": kind == 5121}
            for k, (count, shape, kind) in enumerate(kinds)
        ],
    }
    return seeds.glb(content, data)


def meshes() -> dict[str, bytes]:
    """Meshes by name."""
    return {
        "b.obj": obj(),
        "text.ply": ply("ascii"),
        "little.ply": ply("binary_little_endian"),
        "big.ply": ply("binary_big_endian"),
        "wedges.ply": ply("ascii", wedges=True),
        "wedges-big.ply": ply("binary_big_endian", wedges=True),
        "b.glb": glb(),
    }


MESHES = meshes()


def scene_of(name: str) -> dict[str, Any]:
    """A scene that reads all attributes of a mesh."""
    albedo = {"board": {"checkerboard": [[1, 1, 1], [0, 0, 0]]}}
    if not name.startswith("wedges"):
        albedo["baked"] = {"attribute": "color"}
    objects = [{"mesh": name, "material": material} for material in albedo]
    if name.endswith(".glb"):
        objects.append({"mesh": name, "material": {"from": "file"}})
    return {
        "camera": {"position": [0.4, 0.7, 6], "look_at": [0.5, 0.5, 0], "fov": 30},
        "lights": [{"type": "point", "position": [0, 1.5, 3], "flux": [17, 12, 5]}],
        "materials": {key: {"type": "diffuse", "albedo": value} for key, value in albedo.items()},
        "objects": objects,
    }


def case(name: str, data: bytes, about: str) -> Case:
    """A mesh that is loaded and not rendered, with all its attributes."""
    return Case({"scene.json": json.dumps(scene_of(name)).encode(), name: data}, ["explain", "scene.json"], about)


def attributes(seed: int, k: int) -> Case:
    """A mesh with attributes, mutated by bytes."""
    rng = Random(f"attributes {seed} {k}")
    name = rng.choice(list(MESHES))
    return case(name, mutations.mutate(name, MESHES[name], rng), f"attributes {seed} {k}")
