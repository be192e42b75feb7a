"""Write every mesh of the shipped scenes: ``python scenes/meshes/make.py [folder of scenes]``.

A scene reads files below its own folder only, so the hard ones have meshes of their own: the same, compressed if large.

Y is up; faces are counter-clockwise seen from the front. A mesh here is a tuple (vertices, faces, normals): (v, 3)
floats, (m, 3) indices from 0, and a unit normal a vertex or None. Coordinates are rounded before they are written, so
that the last bits of ``sin`` and ``cos``, which differ between machines, never reach a file.
"""

import gzip
import io
import json
import struct
import sys
from itertools import combinations
from pathlib import Path

import numpy as np

QUAD = np.array([[0, 1, 2], [0, 2, 3]])
GOLDEN_RATIO = (1 + 5**0.5) / 2

# The Cornell box: corners of each wall and (x, z) of the floor corners of each block.
WALLS = {
    "floor": [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)],
    "ceiling": [(-1, 2, -1), (1, 2, -1), (1, 2, 1), (-1, 2, 1)],
    "back": [(-1, 0, -1), (1, 0, -1), (1, 2, -1), (-1, 2, -1)],
    "left": [(-1, 0, 1), (-1, 0, -1), (-1, 2, -1), (-1, 2, 1)],
    "right": [(1, 0, -1), (1, 0, 1), (1, 2, 1), (1, 2, -1)],
}
SHORT = [(-0.74607, 0.026993), (-0.575747, 0.596896), (0.003337, 0.423823), (-0.166991, -0.146079)]
TALL = [(0.7495656, -0.391052), (0.176014, -0.5906493), (-0.020444, -0.026118), (0.553108, 0.173479)]
BLOCK_FLOOR = 1e-4  # the blocks stand this high, so that their undersides do not coincide with the floor

# The vase: control points (radius, y) up the outside, over the lip and down the inside.
VASE = [(0, 0), (0.26, 0), (0.3, 0.02), (0.3, 0.06), (0.55, 0.45), (0.4, 0.85), (0.14, 1.0), (0.16, 1.2), (0.32, 1.38)]
VASE += [(0.3, 1.4), (0.27, 1.38), (0.12, 1.2), (0.1, 1.0), (0.36, 0.82), (0.5, 0.45), (0.25, 0.08), (0, 0.06)]

HARD = [f"{name}.obj" for name in (*WALLS, "short", "tall", "pane", "box")]  # what the hard scenes have too
HARD_LARGE = ["ball.obj", "torus.glb"]

# ---- shapes -------------------------------------------------------------------------------------------------------


def quads(corners):
    """Make separate quadrilaterals from an (n, 4, 3) list of corners."""
    corners = np.asarray(corners, dtype=float)
    faces = QUAD + 4 * np.arange(len(corners))[:, None, None]
    return corners.reshape(-1, 3), faces.reshape(-1, 3), None


def extrusion(outline, bottom, top):
    """Raise a closed prism over a convex outline of (x, z), counter-clockwise seen from above."""
    xz = np.array(outline, dtype=float)
    n = len(xz)
    rings = [np.column_stack([xz[:, 0], np.full(n, y), xz[:, 1]]) for y in (bottom, top)]
    i, j = np.arange(n), np.roll(np.arange(n), -1)
    sides = [np.column_stack([i, j, j + n]), np.column_stack([i, j + n, i + n])]
    fan = np.column_stack([np.zeros(n - 2, int), i[1:-1], i[2:]])
    return np.vstack(rings), np.vstack([fan[:, ::-1], fan + n, *sides]), None


def disc(sides, radius, centre):
    """Cut a flat disc that faces +z."""
    angle = 2 * np.pi * np.arange(sides) / sides
    rim = radius * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    i = np.arange(1, sides + 1)
    faces = np.column_stack([0 * i, i, np.roll(i, -1)])
    return np.vstack([np.zeros(3), rim]) + centre, faces, None


def tiles(n, fill):
    """Lay n x n squares in the unit square about the origin, facing +z; ``fill`` is side over pitch."""
    pitch = (np.arange(n) + 0.5) / n - 0.5
    centre = np.stack([*np.meshgrid(pitch, pitch, indexing="ij"), np.zeros((n, n))], axis=-1).reshape(-1, 1, 3)
    corner = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) * fill / (2 * n)
    return quads(centre + corner)


def ball(n):
    """Blow an icosahedron of n x n triangles a face up to the unit sphere; the normals are the sphere's."""
    g = GOLDEN_RATIO
    corners = np.array([(s, t * g, 0) for s in (-1, 1) for t in (-1, 1)])
    corners = np.vstack([np.roll(corners, k, axis=1) for k in range(3)])
    gap = np.linalg.norm(corners[:, None] - corners, axis=2)
    near = (gap > 1) & (gap < 2.1)  # edges have length 2
    triples = [list(t) for t in combinations(range(12), 3) if near[np.ix_(t, t)].sum() == 6]
    points = np.vstack([_face_points(corners[t], n) for t in triples])
    faces = np.vstack([_face_triangles(n) + k * (n + 1) * (n + 2) // 2 for k in range(len(triples))])

    key = np.rint(points * 2**30).astype(np.int64)  # welds the edges
    _, first, inverse = np.unique(key, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)  # vertices in the order of their first use compress well
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    unit = points[first[order]]
    return unit, rank[inverse.reshape(-1)][faces], unit


def _face_points(corners, n):
    """Find the (n + 1)(n + 2) / 2 points of a subdivided face on the unit sphere, row by row."""
    if np.linalg.det(corners) < 0:
        corners = corners[::-1]
    i, j = np.array([(i, j) for i in range(n + 1) for j in range(i + 1)]).T
    flat = np.column_stack([n - i, i - j, j]) @ corners
    return flat / np.linalg.norm(flat, axis=1, keepdims=True)


def _face_triangles(n):
    """List the n x n triangles of a subdivided face."""
    start = [i * (i + 1) // 2 for i in range(n + 1)]
    up = [(start[i] + j, start[i + 1] + j, start[i + 1] + j + 1) for i in range(n) for j in range(i + 1)]
    down = [(start[i] + j, start[i + 1] + j + 1, start[i] + j + 1) for i in range(n) for j in range(i)]
    return np.array(up + down)


def bumpy(n):
    """Give the ball a smooth relief of waves and craters, on a coarse grid so that it compresses."""
    unit, faces, _ = ball(n)
    height = np.zeros(len(unit))
    for k in range(24):  # waves along directions spread over the sphere, each shorter and lower than the last
        frequency = 2.0 * 1.14**k
        height += 0.15 / frequency * np.sin(frequency * (unit @ _spread(7 * k % 24, 24)) + 2.4 * k)
    for k in range(60):
        width = 0.06 + 0.24 * (k * GOLDEN_RATIO % 1) ** 3  # of a crater: a bowl with a soft rim
        angle = np.arccos(np.clip(unit @ _spread(k, 60), -1, 1)) / width
        height += 0.28 * width * (angle**2 - 1) * np.exp(-(angle**2))
    return _snap(unit * (1 + height)[:, None], 13), faces, None


def _spread(k, n):
    """Return the k-th of n unit vectors spread evenly over the sphere (a Fibonacci lattice)."""
    y = 1 - (2 * k + 1) / n
    angle = 2 * np.pi * k / GOLDEN_RATIO
    return np.array([np.cos(angle) * (1 - y * y) ** 0.5, y, np.sin(angle) * (1 - y * y) ** 0.5])


def torus(n, sides, tube):
    """Bend a tube into a ring of radius 1 about y."""
    angles = 2 * np.pi * np.arange(sides) / sides, 2 * np.pi * np.arange(n) / n
    across, around = np.meshgrid(*angles, indexing="ij")
    normals = np.stack([np.cos(across) * np.cos(around), np.sin(across), np.cos(across) * np.sin(around)], axis=-1)
    centre = np.stack([np.cos(around), 0 * around, np.sin(around)], axis=-1)
    i, j = np.meshgrid(np.arange(sides), np.arange(n), indexing="ij")
    vertices = centre + tube * normals
    return _snap(vertices.reshape(-1, 3), 16), _cells(i, j, sides, n), _snap(normals.reshape(-1, 3), 16)


def lathe(profile, n, rounds):
    """Turn a profile about y; it runs up from the axis and back to it, and its corners are cut off."""
    for _ in range(rounds):  # Chaikin: a quarter and three quarters of every side
        p = np.asarray(profile, dtype=float)
        cut = np.stack([0.75 * p[:-1] + 0.25 * p[1:], 0.25 * p[:-1] + 0.75 * p[1:]], axis=1).reshape(-1, 2)
        profile = np.vstack([p[0], cut, p[-1]])
    tangent = np.gradient(profile, axis=0)
    tangent[[0, -1], 1] = 0  # level where it meets the axis
    out = np.column_stack([tangent[:, 1], -tangent[:, 0]]) / np.linalg.norm(tangent, axis=1, keepdims=True)
    spin = 2 * np.pi * np.arange(n) / n

    def turn(curve):
        rings = [np.column_stack([r * np.cos(spin), y + 0 * spin, r * np.sin(spin)]) for r, y in curve[1:-1]]
        return _snap(np.vstack([[0, curve[0, 1], 0], *rings, [0, curve[-1, 1], 0]]), 16)

    rows = len(profile) - 2
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(n), indexing="ij")
    a, b, last = np.arange(n), np.roll(np.arange(n), -1), rows * n + 1
    caps = [np.column_stack([0 * a, a + 1, b + 1]), np.column_stack([0 * a + last, b + last - n, a + last - n])]
    return turn(profile), np.vstack([caps[0], _cells(i, j, rows, n) + 1, caps[1]]), turn(out)


def _cells(i, j, rows, columns):
    """Make two triangles of each cell (i, j) of a grid of vertices that wraps round."""
    a, b = i * columns + j, i * columns + (j + 1) % columns
    c, d = (i + 1) % rows * columns + (j + 1) % columns, (i + 1) % rows * columns + j
    return np.stack([a, d, c, a, c, b], axis=-1).reshape(-1, 3)


def _snap(x, bits):
    """Round to multiples of 2**-bits: exact in float32."""
    return np.rint(x * 2**bits) / 2**bits + 0.0


# ---- files --------------------------------------------------------------------------------------------------------


def obj(vertices, faces, normals):
    """Encode as OBJ text of at most seven decimals."""

    def rows(key, table):
        return [" ".join([key, *(f"{round(x, 7) + 0.0:.8g}" for x in row)]) for row in table.tolist()]

    corner = "{0}" if normals is None else "{0}//{0}"
    lines = rows("v", vertices) + ([] if normals is None else rows("vn", normals))
    lines += [" ".join(["f", *(corner.format(k) for k in row)]) for row in (faces + 1).tolist()]
    return ("\n".join(lines) + "\n").encode()


def ply(vertices, faces, normals):
    """Encode as binary PLY of float32."""
    names = ["x", "y", "z"] + ([] if normals is None else ["nx", "ny", "nz"])
    table = vertices if normals is None else np.hstack([vertices, normals])
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header\n"]
    rows = np.empty(len(faces), dtype=[("count", "u1"), ("index", "<i4", 3)])
    rows["count"], rows["index"] = 3, faces
    return "\n".join(header).encode() + table.astype("<f4").tobytes() + rows.tobytes()


def glb(vertices, faces, normals):
    """Encode as binary glTF 2.0: a node with one mesh."""
    parts = [vertices.astype("<f4"), normals.astype("<f4"), faces.astype("<u4")]
    offsets = np.cumsum([0] + [p.nbytes for p in parts]).tolist()
    kinds = [(5126, "VEC3", len(vertices)), (5126, "VEC3", len(normals)), (5125, "SCALAR", faces.size)]
    accessors = [{"bufferView": k, "componentType": c, "type": t, "count": n} for k, (c, t, n) in enumerate(kinds)]
    accessors[0] |= {"min": vertices.min(axis=0).tolist(), "max": vertices.max(axis=0).tolist()}
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2}]}],
        "accessors": accessors,
        "bufferViews": [
            {"buffer": 0, "byteOffset": o, "byteLength": p.nbytes} for o, p in zip(offsets[:-1], parts, strict=True)
        ],
        "buffers": [{"byteLength": offsets[-1]}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    body = b"".join(p.tobytes() for p in parts)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(body), b"BIN\0") + body
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def gz(data):
    """Compress without a name or a time."""
    out = io.BytesIO()
    with gzip.GzipFile(filename="", mode="wb", fileobj=out, mtime=0) as file:
        file.write(data)
    return out.getvalue()


def files():
    """Map each file's path below the folder of scenes to its content."""
    half = [(-0.5, 0.5), (0.5, 0.5), (0.5, -0.5), (-0.5, -0.5)]
    meshes = {name: quads([corners]) for name, corners in WALLS.items()}
    meshes |= {"short": extrusion(SHORT, BLOCK_FLOOR, 0.6), "tall": extrusion(TALL, BLOCK_FLOOR, 1.2)}
    meshes |= {"pane": disc(32, 0.5, (0, 1, 1)), "tiles": tiles(12, 0.94), "square": tiles(1, 1)}
    meshes |= {"box": extrusion(half, -0.5, 0.5), "prism": extrusion(half[:2] + half[3:], 0, 1), "ball": ball(12)}
    data = {f"{name}.obj": obj(*mesh) for name, mesh in meshes.items()} | {
        "vase.ply": ply(*lathe(VASE, 48, 2)),
        "torus.glb": glb(*torus(60, 24, 0.38)),
        "bumpy.ply.gz": gz(ply(*bumpy(128))),
    }
    hard = {f"hard/meshes/{name}": data[name] for name in HARD}
    hard |= {f"hard/meshes/{name}.gz": gz(data[name]) for name in HARD_LARGE}
    return {f"meshes/{name}": content for name, content in data.items()} | hard


def main():
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1]
    for name, data in files().items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)


if __name__ == "__main__":
    main()
