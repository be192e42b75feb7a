"""Small files that are right, one of each kind that a scene or ``compare`` may read: what is mutated."""

import base64
import gzip
import io
import json
import struct
import zipfile
from typing import Any

import numpy as np

OBJ = """# a house
mtllib house.mtl
o walls
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0.5 1.5 0.25
vn 0 0 1
vn 0 0.6 0.8
vt 0 0
usemtl plaster
f 1//1 2//1 3//1 4//1
f 4/1/2 3/1/2 -1/1/2
f 1 2 \\
 5
"""
MTL = "newmtl plaster\nKd 0.5 0.5 0.5\nmap_Kd ../../../../etc/passwd\n"
POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1]], "<f4")
NORMALS = np.array([[0, 0, 1]] * 5, "<f4")
FACES = [[0, 1, 2, 3], [0, 1, 4], [2, 3, 4]]


def ply(order: str, normals: bool = True) -> bytes:
    """A pyramid without two of its sides: a square and two triangles."""
    table = np.hstack([POINTS, NORMALS]) if normals else POINTS
    names = ["x", "y", "z", "nx", "ny", "nz"][: table.shape[1]]
    head = ["ply", f"format {order} 1.0", "comment a pyramid", f"element vertex {len(POINTS)}"]
    head += [f"property float {name}" for name in names]
    head += [f"element face {len(FACES)}", "property list uchar int vertex_indices", "property uchar red", "end_header"]
    if order == "ascii":
        rows = [" ".join(map(str, row)) for row in table.tolist()] + [
            " ".join(map(str, [len(f), *f, 7])) for f in FACES
        ]
        return "\n".join([*head, *rows, ""]).encode()
    end = "<" if "little" in order else ">"
    body = table.astype(end + "f4").tobytes()
    body += b"".join(struct.pack(f"{end}B{len(f)}iB", len(f), *f, 7) for f in FACES)
    return "\n".join([*head, ""]).encode() + body


def stl(binary: bool) -> bytes:
    """Two triangles."""
    triangles = POINTS[[[0, 1, 2], [2, 3, 4]]]
    if binary:
        rows = [struct.pack("<12fH", 0, 0, 1, *corners.ravel(), 0) for corners in triangles]
        return b"a pyramid".ljust(80) + struct.pack("<I", len(rows)) + b"".join(rows)
    facets = [
        "facet normal 0 0 1\nouter loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in corners.tolist())
        for corners in triangles
    ]
    return (
        "solid pyramid\n" + "".join(f"{facet}endloop\nendfacet\n" for facet in facets) + "endsolid pyramid\n"
    ).encode()


def document(uri: str | None = None) -> dict[str, Any]:
    """The JSON of a GLB of three parts, placed by a tree of nodes."""
    corners = np.array([0, 1, 2, 0, 2, 3], "<u2")
    vec3 = {"componentType": 5126, "count": 5, "type": "VEC3"}
    attributes = {"POSITION": 0, "NORMAL": 1}
    buffer = {"byteLength": 120 + corners.nbytes} | ({} if uri is None else {"uri": uri})
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"mesh": 0, "children": [1, 2], "translation": [0, 0, 0.5]},
            {"mesh": 1, "rotation": [0, 0.6, 0, 0.8], "scale": [1, 2, 1]},
            {"mesh": 1, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 2, 0, 0, 1]},
        ],
        "meshes": [
            {"primitives": [{"attributes": attributes, "indices": 2, "mode": 4, "material": 0}]},
            {"primitives": [{"attributes": {"POSITION": 0}, "mode": 5}, {"attributes": attributes, "mode": 6}]},
        ],
        "materials": [{}],
        "buffers": [buffer],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 60},
            {"buffer": 0, "byteOffset": 60, "byteLength": 60, "byteStride": 12},
            {"buffer": 0, "byteOffset": 120, "byteLength": corners.nbytes},
        ],
        "accessors": [
            {"bufferView": 0, **vec3, "min": [0, 0, 0], "max": [1, 1, 1]},
            {"bufferView": 1, "byteOffset": 0, **vec3},
            {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
    }


def posed() -> bytes:
    """A GLB of a skin, a morph target in sparse numbers, and instances."""
    data, views = b"", list[dict[str, Any]]()
    arrays = [
        POINTS,
        np.array([0, 1, 2, 0, 2, 3], "<u2"),
        np.array([[0, 1, 0, 0]] * 5, "<u1"),
        np.array([[0.5, 0.5, 0, 0]] * 5, "<f4"),
        np.array([np.eye(4).ravel()] * 2, "<f4"),
        np.array([1, 3], "<u2"),
        np.array([[0, 0, 1]] * 2, "<f4"),
    ]
    for array in arrays:
        data += b"\0" * (-len(data) % 4)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        data += array.tobytes()
    rows = [(5, "VEC3", 5126), (6, "SCALAR", 5123), (5, "VEC4", 5121), (5, "VEC4", 5126), (2, "MAT4", 5126)]
    accessors: list[dict[str, Any]] = [
        {"bufferView": k, "count": count, "type": shape, "componentType": kind}
        for k, (count, shape, kind) in enumerate(rows)
    ]
    places = {"bufferView": 5, "componentType": 5123}
    sparse = {"count": 2, "indices": places, "values": {"bufferView": 6}}
    accessors.append({"count": 5, "type": "VEC3", "componentType": 5126, "sparse": sparse})
    accessors.append({"bufferView": 6, "count": 2, "type": "VEC3", "componentType": 5126})
    part = {"attributes": {"POSITION": 0, "JOINTS_0": 2, "WEIGHTS_0": 3}, "indices": 1, "targets": [{"POSITION": 5}]}
    instances = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 6}}}
    content = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["EXT_mesh_gpu_instancing"],
        "scenes": [{"nodes": [0, 1, 3]}],
        "nodes": [
            {"mesh": 0, "skin": 0},
            {"translation": [0.5, 0, 0], "children": [2]},
            {"rotation": [0, 0.6, 0, 0.8]},
            {"mesh": 0, "extensions": instances, "weights": [0.5]},
        ],
        "skins": [{"joints": [1, 2], "inverseBindMatrices": 4}],
        "meshes": [{"primitives": [part], "weights": [1]}],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": views,
        "accessors": accessors,
    }
    return glb(content, data)


def off() -> bytes:
    """An OFF file of the pyramid."""
    rows = [" ".join(map(str, row)) for row in POINTS.tolist()]
    rows += [" ".join(map(str, [len(face), *face])) for face in FACES]
    return "\n".join(["OFF", f"{len(POINTS)} {len(FACES)} 0", *rows, ""]).encode()


def glb(content: dict[str, Any], data: bytes) -> bytes:
    """A GLB file."""
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def meshes() -> dict[str, bytes]:
    """Meshes by name."""
    data = POINTS.tobytes() + NORMALS.tobytes() + np.array([0, 1, 2, 0, 2, 3], "<u2").tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    files = {
        "a.obj": OBJ.encode(),
        "text.ply": ply("ascii"),
        "little.ply": ply("binary_little_endian"),
        "big.ply": ply("binary_big_endian", normals=False),
        "text.stl": stl(binary=False),
        "binary.stl": stl(binary=True),
        "a.glb": glb(document(), data),
        "inside.glb": glb(document(uri), b""),
        "posed.glb": posed(),
        "text.gltf": json.dumps(document(uri)).encode(),
        "a.off": off(),
    }
    return files | {f"{name}.gz": gzip.compress(files[name], mtime=0) for name in ("a.obj", "little.ply", "a.glb")}


def npz(**arrays: Any) -> bytes:
    """An NPZ file."""
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def pictures() -> dict[str, bytes]:
    """Pictures of 6 x 4 pixels by name."""
    from raytrace.image import files

    rgb = np.linspace(0, 1, 72, dtype=np.float32).reshape(4, 6, 3)
    provenance = {"version": "1", "spp": 4}
    arrays = {"rgb": rgb, "stderr": rgb[:, :, 0], "depth": rgb[:, :, 1], "samples": np.ones((4, 6), np.int32)}
    return {
        "a.png": files.png_bytes(rgb, provenance),
        "a.exr": files._exr_bytes(arrays, provenance),
        "a.npz": npz(**arrays, provenance=np.array(json.dumps(provenance))),
        "plain.npz": npz(rgb=rgb),
    }


def members(data: bytes) -> dict[str, bytes]:
    """Files in a ZIP file, by name."""
    with zipfile.ZipFile(io.BytesIO(data)) as file:
        return {name: file.read(name) for name in file.namelist()}
