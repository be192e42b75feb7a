"""Small scenes and meshes for tests, written to a folder."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
CUBE = "".join(f"v {x} {y} {z}\n" for x in (0, 1) for y in (0, 1) for z in (0, 1)) + (
    "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"  # outward
)


def scene(**changes: Any) -> dict[str, Any]:
    """Return a valid scene with one triangle, some of its keys replaced."""
    base: dict[str, Any] = {
        "camera": {"position": [0, 1, 6.8], "look_at": [0, 1, 0], "fov": 19.5},
        "lights": [{"type": "point", "position": [0, 1.5, 0.5], "flux": [17, 12, 5]}],
        "materials": {"white": {"type": "diffuse", "albedo": [0.7, 0.7, 0.7]}},
        "objects": [{"mesh": "triangle.obj", "material": "white"}],
    }
    return {key: value for key, value in {**base, **changes}.items() if value is not ...}


def write(folder: Path, content: dict[str, Any] | str, name: str = "scene.json") -> Path:
    """Write a scene beside the meshes ``triangle.obj`` and ``cube.obj``."""
    (folder / "triangle.obj").write_text(TRIANGLE)
    (folder / "cube.obj").write_text(CUBE)
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content, indent=1))
    return path


def glb(header: dict[str, Any], data: bytes) -> bytes:
    """Return a GLB file with one binary chunk."""
    text = json.dumps({"asset": {"version": "2.0"}, **header}).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def triangle_glb(nodes: list[dict[str, Any]], normals: bool = False, **header: Any) -> bytes:
    """Return a GLB file of a triangle that the nodes place; its root is node 0."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
    up = np.array([[0, 0, 1]] * 3, "<f4")
    corners = np.array([0, 1, 2], "<u4")
    data = points.tobytes() + up.tobytes() + corners.tobytes()
    attributes = {"POSITION": 0, "NORMAL": 1} if normals else {"POSITION": 0}
    vec3 = {"componentType": 5126, "count": 3, "type": "VEC3"}
    content = {
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 2}]}],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": offset, "byteLength": size} for offset, size in ((0, 36), (36, 36), (72, 12))
        ],
        "accessors": [
            {"bufferView": 0, **vec3, "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, **vec3},
            {"bufferView": 2, "componentType": 5125, "count": 3, "type": "SCALAR"},
        ],
    }
    return glb({**content, **header}, data)
