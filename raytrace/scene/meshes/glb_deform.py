"""Morph targets and skins of glTF meshes, in the pose of the file   [glTF, 3.7.2.2 and 3.7.3]."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.records import RawMesh
from raytrace.scene.meshes.glb_accessors import BYTE, FLOAT, SHORT, UBYTE, USHORT, Accessors
from raytrace.scene.meshes.glb_json import Record, entries, item, record_in
from raytrace.scene.meshes.glb_nodes import World, product
from raytrace.scene.meshes.raw_mesh import Matrix

Ints = NDArray[np.int64]
OFFSETS = FLOAT, BYTE, UBYTE, SHORT, USHORT
CHUNK = 2**16  # vertices at a time


def morph(
    values: Matrix, name: str, primitive: Record, weights: list[Any], accessors: Accessors, rows: Ints | None
) -> Matrix:
    """Return positions or normals with the offsets of the morph targets added.

    Parameters
    ----------
    values : (n, 3) float64
    name : {"POSITION", "NORMAL"}
    primitive : dict
    weights : list of float
        One for each target; targets beyond have none.
    accessors : Accessors
    rows : (n,) int64 or None
        Vertices of the primitive that the values are of; None: all.
    """
    for target, weight in zip(entries(primitive, "targets"), weights, strict=False):
        if type(weight) not in (int, float):
            raise ValueError(f"weights: expected numbers, got {str(weight)[:40]}")
        if not isinstance(target, dict):
            raise ValueError("targets: expected objects")
        if weight == 0 or name not in target:
            continue
        whole = accessors.count(record_in(primitive, "attributes")[name])
        if accessors.count(target[name]) != whole:
            raise ValueError(f"{whole} vertices have {accessors.count(target[name])} offsets of a morph target")
        accessors.spend(3 * len(values))
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is found later
            values = values + float(weight) * accessors.floats(target[name], "VEC3", OFFSETS, rows)
    return values


class Skins:
    """Applies the skins of a file."""

    def __init__(self, document: Record, accessors: Accessors, notes: dict[str, None]) -> None:
        self._document, self._accessors, self._notes = document, accessors, notes
        self._world: World | None = None

    def apply(self, mesh: RawMesh, attributes: Record, index: Any, rows: Ints | None) -> RawMesh:
        """Return a mesh in the pose of its joints, in the space of the scene.

        Parameters
        ----------
        mesh : RawMesh
            Its normals, if any, are those of its vertices.
        attributes : dict
            Of its primitive.
        index : int
            Of the skin.
        rows : (n,) int64 or None
            Vertices of the primitive that it has; None: all.

        Notes
        -----
        A vertex is moved by the mean of the matrices of its joints, weighted, each the joint's transform in the scene
        times its inverse bind matrix. The transform of the node that has the mesh does not count. Where the matrices
        of a triangle mirror, it is turned round, so that its front stays outside.
        """
        joints, weights = self._influences(attributes, len(mesh.vertices), rows)
        used = distinct(joints[weights != 0])
        matrices = self._matrices(index, used)
        joints = np.where(weights != 0, np.minimum(np.searchsorted(used, joints), len(used) - 1), 0)
        vertices, normals = np.empty_like(mesh.vertices), None if mesh.normals is None else np.empty_like(mesh.vertices)
        mirrors = np.empty(len(vertices))
        for begin in range(0, len(vertices), CHUNK):
            part = slice(begin, begin + CHUNK)
            with np.errstate(all="ignore"):  # what is not finite is found later
                blend = _blend(matrices, joints[part], weights[part])
                vertices[part] = _product(blend, mesh.vertices[part]) + blend[:, :, 3]
                cofactors, mirrors[part] = _cofactors(blend[:, :, :3])
                if mesh.normals is not None and normals is not None:
                    normals[part] = mirrors[part, None] * _product(cofactors, mesh.normals[part])
        turned = mirrors[mesh.faces].sum(axis=1) < 0
        faces = np.where(turned[:, None], mesh.faces[:, [0, 2, 1]], mesh.faces)
        return RawMesh(vertices, faces, normals, None if normals is None else faces)

    def _influences(self, attributes: Record, count: int, rows: Ints | None) -> tuple[Ints, Matrix]:
        """Return the joints (n, k) of each vertex, and their weights, of sum 1."""
        joints, weights, k = list[Ints](), list[Matrix](), 0
        while f"JOINTS_{k}" in attributes and f"WEIGHTS_{k}" in attributes:
            pair = attributes[f"JOINTS_{k}"], attributes[f"WEIGHTS_{k}"]
            whole = self._accessors.count(attributes["POSITION"])
            if any(self._accessors.count(index) != whole for index in pair):
                raise ValueError(f"{whole} vertices have another number of joints or weights")
            self._accessors.spend(4 * 12 * count)
            joints.append(self._accessors.rows(pair[0], "VEC4", (UBYTE, USHORT), rows).astype(np.int64))
            weights.append(self._accessors.floats(pair[1], "VEC4", (FLOAT, UBYTE, USHORT), rows))
            k += 1
        every, share = np.concatenate(joints, axis=1), np.concatenate(weights, axis=1)
        total = share.sum(axis=1)
        if (none := total == 0).any():
            self._notes["some vertices of a skin have no weights; they follow the first of their joints"] = None
            share[none] = np.eye(1, share.shape[1])
            total[none] = 1.0
        return every, share / total[:, None]

    def _matrices(self, index: Any, used: Ints) -> Matrix:
        """Return the matrices (m, 3, 4) of the joints with these numbers."""
        skin = item(self._document, "skins", index)
        joints = entries(skin, "joints")
        if used[-1] >= len(joints):
            raise ValueError(f"skins[{index}] has {len(joints)} joints, a vertex has joint {used[-1]}, counted from 0")
        self._world = self._world or World(self._document)
        binds = np.broadcast_to(np.eye(4), (len(used), 4, 4))
        if "inverseBindMatrices" in skin:
            place = skin["inverseBindMatrices"]
            if (count := self._accessors.count(place)) <= used[-1]:
                raise ValueError(f"skins[{index}] has {len(joints)} joints and {count} inverse bind matrices")
            columns = self._accessors.floats(place, "MAT4", (FLOAT,), used)
            binds = columns.reshape(-1, 4, 4).transpose(0, 2, 1)
        worlds = [self._world.matrix(joints[number]) for number in used.tolist()]
        return np.array([product(world, bind)[:3] for world, bind in zip(worlds, binds, strict=True)])


def distinct(values: Ints) -> Ints:
    """Return the sorted distinct values; np.unique would import numpy.ma."""
    values = np.sort(values, axis=None)
    return values[np.flatnonzero(np.diff(values, prepend=-1))]


def _blend(matrices: Matrix, joints: Ints, weights: Matrix) -> Matrix:
    """Return the mean (n, 3, 4) of the matrices of joints; summed in order, for the same last bit everywhere."""
    blend = np.zeros((len(joints), 3, 4))
    for k in range(joints.shape[1]):
        blend += weights[:, k, None, None] * matrices[joints[:, k]]
    return blend


def _product(matrices: Matrix, rows: Matrix) -> Matrix:
    """Return the products (n, 3) of matrices (n, 3, >= 3) and columns, of which the first three count."""
    return matrices[:, :, 0] * rows[:, :1] + matrices[:, :, 1] * rows[:, 1:2] + matrices[:, :, 2] * rows[:, 2:]


def _cofactors(linear: Matrix) -> tuple[Matrix, Matrix]:
    """Return the cofactors (n, 3, 3) of matrices up to a factor, and the sign of each determinant."""
    scaled = linear / np.maximum(np.abs(linear).max(axis=(1, 2), keepdims=True), np.finfo(float).tiny)
    cofactors = np.cross(np.roll(scaled, -1, axis=1), np.roll(scaled, -2, axis=1))
    row = scaled[:, 0] * cofactors[:, 0]
    return cofactors, np.where(row[:, 0] + row[:, 1] + row[:, 2] < 0, -1.0, 1.0)
