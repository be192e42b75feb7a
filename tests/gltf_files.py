"""Small glTF files for tests, built part by part."""

from typing import Any

import numpy as np

from raytrace.records import RawMesh
from raytrace.scene.meshes.glb import read_glb
from raytrace.scene.meshes.raw_mesh import concatenate
from scene_files import glb

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4")
CORNERS = np.array([0, 1, 2, 0, 2, 3], "<u2")
KINDS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
SHAPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class File:
    """A file that grows: accessors are added as arrays, the rest is its JSON.

    It begins as the unit square on node 0, of the scene's only root.
    """

    def __init__(self, points: Any = SQUARE, corners: Any = CORNERS) -> None:
        self.data = b""
        self.json: dict[str, Any] = {"scene": 0, "accessors": [], "bufferViews": []}
        self.primitive: dict[str, Any] = {"attributes": {"POSITION": self.add(points)}, "indices": self.add(corners)}
        self.attributes: dict[str, Any] = self.primitive["attributes"]
        self.mesh: dict[str, Any] = {"primitives": [self.primitive]}
        self.node: dict[str, Any] = {"mesh": 0}
        self.json |= {"scenes": [{"nodes": [0]}], "nodes": [self.node], "meshes": [self.mesh]}

    def view(self, array: Any) -> int:
        """Add bytes, and return the index of their view."""
        self.data += b"\0" * (-len(self.data) % 4)
        content = np.ascontiguousarray(array).tobytes()
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(content)})
        self.data += content
        return len(self.json["bufferViews"]) - 1

    def add(self, array: Any, **more: Any) -> int:
        """Add an accessor, and return its index."""
        array = np.asarray(array)
        rows = array.reshape(len(array), -1)
        accessor = {"componentType": KINDS[array.dtype.str[1:]], "count": len(rows), "type": SHAPES[rows.shape[1]]}
        return self.accessor({"bufferView": self.view(array), **accessor, **more})

    def accessor(self, record: dict[str, Any]) -> int:
        """Add an accessor as it is, and return its index."""
        self.json["accessors"].append(record)
        return len(self.json["accessors"]) - 1

    def header(self) -> dict[str, Any]:
        """Return the JSON with its one buffer."""
        return {**self.json, "buffers": [{"byteLength": len(self.data)}]}

    def glb(self) -> bytes:
        """Return the file as GLB."""
        return glb(self.header(), self.data)


FIRST = np.array([0, 0, 0, 0], "u1"), np.array([1, 0, 0, 0], "<f4")


def read(file: File) -> RawMesh:
    """Return all triangles of a file as one mesh."""
    return concatenate(read_glb(file.glb()))


def triangles(file: File) -> Any:
    """Return the corners (m, 3, 3) of all triangles."""
    mesh = read(file)
    return mesh.vertices[mesh.faces]


def area(file: File) -> float:
    """Return the area of all triangles."""
    a, b, c = triangles(file).swapaxes(0, 1)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def skinned(joints: Any, weights: Any, *nodes: dict[str, Any], binds: Any = None) -> File:
    """Return the square with joints and weights, on nodes after node 0, all of them roots."""
    file = File()
    joints, weights = np.atleast_2d(joints), np.atleast_2d(weights)
    file.attributes["JOINTS_0"] = file.add(np.broadcast_to(joints, (4, 4)))
    file.attributes["WEIGHTS_0"] = file.add(np.broadcast_to(weights, (4, 4)))
    file.node["skin"] = 0
    file.json["nodes"] += nodes
    file.json["scenes"][0]["nodes"] = list(range(1 + len(nodes)))
    file.json["skins"] = [{"joints": list(range(1, 1 + len(nodes)))}]
    if binds is not None:  # columns one after the other
        file.json["skins"][0]["inverseBindMatrices"] = file.add(np.array(binds, "<f4").swapaxes(1, 2).reshape(-1, 16))
    return file
