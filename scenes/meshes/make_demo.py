"""Write the meshes of the demo, which the package ships: ``python scenes/meshes/make_demo.py [folder]``."""

import sys
from pathlib import Path

import numpy as np
from make import _cells, _snap, ball, ply

FOLDER = Path(__file__).parents[2] / "raytrace" / "scene" / "demo"
SIDE = 0.5  # of a square of the backdrop
BEND = 2.0  # radius where its floor turns into its wall
PIECES = 3  # of a square along the bend


def knot(n, sides, radius, tube):
    """Tie a trefoil: a tube around a curve on a torus about z of radius 1, whose own tube has `radius`."""
    t = 2 * np.pi * np.arange(n) / n
    out = np.column_stack([np.cos(3 * t) * np.cos(2 * t), np.cos(3 * t) * np.sin(2 * t), np.sin(3 * t)])  # of the torus
    ring = np.column_stack([np.cos(2 * t), np.sin(2 * t), 0 * t])
    around = np.column_stack([-np.sin(2 * t), np.cos(2 * t), 0 * t])
    along = np.column_stack([-np.sin(3 * t) * np.cos(2 * t), -np.sin(3 * t) * np.sin(2 * t), np.cos(3 * t)])
    tangent = 2 * (1 + radius * np.cos(3 * t))[:, None] * around + 3 * radius * along
    side = np.cross(tangent / np.linalg.norm(tangent, axis=1, keepdims=True), out)
    turn = 2 * np.pi * np.arange(sides) / sides
    normals = np.cos(turn)[None, :, None] * out[:, None] + np.sin(turn)[None, :, None] * side[:, None]
    vertices = (ring + radius * out)[:, None] + tube * normals
    i, j = np.meshgrid(np.arange(n), np.arange(sides), indexing="ij")
    faces = _cells(i, j, n, sides)[:, ::-1]
    return _snap(vertices.reshape(-1, 3), 16), faces, _snap(normals.reshape(-1, 3), 16)


def backdrop(columns, floor, wall, odd):
    """Every other square of a floor that bends up into a wall; `floor` and `wall` in squares, the bend between them."""
    bend = round(BEND * np.pi / 2 / SIDE)  # squares
    rows = np.arange((floor + bend + wall) * PIECES + 1) / PIECES
    flat, turned = np.minimum(rows, floor) * SIDE, np.clip(rows - floor, 0, bend) / bend * np.pi / 2
    up = np.maximum(rows - floor - bend, 0) * SIDE
    yz = np.column_stack([BEND * (1 - np.cos(turned)) + up, -flat - BEND * np.sin(turned)])
    normal = np.column_stack([0 * rows, np.cos(turned), np.sin(turned)])
    vertices, faces, normals = [], [], []
    for column in range(columns):
        x = (column - columns / 2 + np.arange(2)) * SIDE
        for row in range((column + odd) % 2, floor + bend + wall, 2):
            for k in range(row * PIECES, (row + 1) * PIECES):
                first = len(vertices)
                vertices += [(x[0], *yz[k]), (x[1], *yz[k]), (x[1], *yz[k + 1]), (x[0], *yz[k + 1])]
                normals += [normal[k], normal[k], normal[k + 1], normal[k + 1]]
                faces += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
    return _snap(np.array(vertices), 16), np.array(faces), _snap(np.array(normals), 16)


def files():
    """Map each file's name to its content."""
    return {
        "ball.ply": ply(*ball(12)),
        "knot.ply": ply(*knot(180, 18, 0.42, 0.26)),
        "light.ply": ply(*backdrop(22, 16, 6, 0)),
        "dark.ply": ply(*backdrop(22, 16, 6, 1)),
    }


def main():
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    for name, data in files().items():
        (folder / name).write_bytes(data)


if __name__ == "__main__":
    main()
