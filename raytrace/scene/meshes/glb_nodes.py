"""Nodes of a glTF file, and the parts of meshes that they place   [glTF, 3.5]."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.scene.meshes.errors import TooLargeError, UnsupportedError
from raytrace.scene.meshes.glb_accessors import BYTE, FLOAT, SHORT, Accessors
from raytrace.scene.meshes.glb_extensions import INSTANCING, VISIBILITY
from raytrace.scene.meshes.glb_json import Record, entries, extension, item, numbers, record_in
from raytrace.scene.meshes.raw_mesh import Matrix

MAX_PARTS = 2**16  # of meshes, each as often as nodes place it: a few seconds


class Part(NamedTuple):
    """A part of a mesh that a node places."""

    primitive: Record
    matrix: Matrix  # (4, 4), applied to columns; of a skinned part without meaning
    weights: list[Any]  # of the morph targets
    skin: Any  # index of the skin; None: it has none


def _local(shift: Matrix, turn: Matrix, scale: Matrix) -> Matrix:
    """Return the matrix (4, 4) of a translation, a quaternion x, y, z, w of any length, and a scale."""
    x, y, z, w = turn
    square = x * x + y * y + z * z + w * w
    if not 0 < square < np.inf:
        raise ValueError("rotation: expected a quaternion other than 0")
    s = 2.0 / square
    rotation = [
        [1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
        [s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)],
        [s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)],
    ]
    matrix = np.eye(4)
    matrix[:3, :3] = np.array(rotation) * scale
    matrix[:3, 3] = shift
    return matrix


def _matrix(node: Record) -> Matrix:
    """Return the transform of a node: its matrix, column after column, or translation, rotation and scale."""
    if "matrix" in node:
        return numbers(node, "matrix", [0.0] * 16).reshape(4, 4).T
    return _local(
        numbers(node, "translation", [0.0, 0.0, 0.0]),
        numbers(node, "rotation", [0.0, 0.0, 0.0, 1.0]),
        numbers(node, "scale", [1.0, 1.0, 1.0]),
    )


def product(first: Matrix, m: Matrix) -> Matrix:
    """Return the product of two matrices; written out, as in ``transform``."""
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is found later
        return first[:, :1] * m[0] + first[:, 1:2] * m[1] + first[:, 2:3] * m[2] + first[:, 3:] * m[3]


def _placed(above: Matrix, node: Record) -> Matrix:
    """Return the product of the transform of the nodes above and that of a node."""
    moves = node.keys() & {"matrix", "rotation", "scale", "translation"}
    return product(above, _matrix(node)) if moves else above


class PlacedNode(NamedTuple):
    """A visible node of the scene."""

    number: int  # its index
    node: Record
    matrix: Matrix  # (4, 4), applied to columns: to the world


def visible_nodes(document: Record) -> Iterator[PlacedNode]:
    """Yield the visible nodes of the scene, each after the one above it."""
    if not document.get("scenes"):
        raise UnsupportedError("it has no scene, only parts for one; export it with a scene")
    scene = item(document, "scenes", document.get("scene", 0))
    waiting = [(node, np.eye(4)) for node in entries(scene, "nodes")]
    met = set()
    while waiting:
        index, above = waiting.pop()
        node = item(document, "nodes", index)
        if index in met:
            raise ValueError(f"nodes[{index}] is in the scene twice; nodes must be a tree")
        met.add(index)
        if (extension(node, VISIBILITY) or {}).get("visible") is False:
            continue
        matrix = _placed(above, node)
        yield PlacedNode(index, node, matrix)
        waiting += [(child, matrix) for child in entries(node, "children")]


def parts(document: Record, accessors: Accessors, notes: dict[str, None]) -> Iterator[Part]:
    """Return the parts of meshes of all visible nodes of the scene.

    Parameters
    ----------
    document : dict
    accessors : Accessors
    notes : dict of str
        Collects what the user should know.
    """
    for _, node, matrix in visible_nodes(document):
        if "mesh" in node:
            yield from _of_node(document, accessors, node, matrix, notes)


def _of_node(
    document: Record, accessors: Accessors, node: Record, matrix: Matrix, notes: dict[str, None]
) -> Iterator[Part]:
    mesh = item(document, "meshes", node["mesh"])
    weights = entries(node if "weights" in node else mesh, "weights")
    skin, instancing = node.get("skin"), extension(node, INSTANCING)
    matrices = [matrix]
    if instancing is not None and skin is None:
        matrices = [product(matrix, local) for local in _instances(accessors, record_in(instancing, "attributes"))]
    elif instancing is not None:
        notes[f"{INSTANCING} of a mesh that has a skin is not supported; the mesh is placed once"] = None
    for primitive in entries(mesh, "primitives"):
        if not isinstance(primitive, dict):
            raise ValueError("primitives: expected objects")
        for place in matrices:
            yield Part(primitive, place, weights, skin)


def _instances(accessors: Accessors, attributes: Record) -> list[Matrix]:
    """Return the transforms of the instances of a node; a missing attribute has the default of a node."""
    read = {
        "TRANSLATION": ("VEC3", (FLOAT,), (0.0, 0.0, 0.0)),
        "ROTATION": ("VEC4", (FLOAT, BYTE, SHORT), (0.0, 0.0, 0.0, 1.0)),
        "SCALE": ("VEC3", (FLOAT,), (1.0, 1.0, 1.0)),
    }
    counts = {accessors.count(index) for index in attributes.values()}
    if not counts:
        return [np.eye(4)]
    if len(counts) > 1:
        raise ValueError(f"{INSTANCING}: the attributes have {' and '.join(map(str, sorted(counts)))} rows")
    count = counts.pop()
    if count > MAX_PARTS:
        raise TooLargeError(f"{INSTANCING}: {count:,} instances; at most {MAX_PARTS:,}")
    columns: list[NDArray[np.float64]] = []
    for name, (shape, kinds, default) in read.items():
        if name in attributes:
            columns.append(accessors.floats(attributes[name], shape, kinds))
        else:
            columns.append(np.broadcast_to(np.array(default), (count, len(default))))
    return [_local(*rows) for rows in zip(*columns, strict=True)]


class World:
    """Transforms of nodes from the root of their tree on, whether or not they belong to a scene."""

    def __init__(self, document: Record) -> None:
        self._document = document
        self._known: dict[Any, Matrix] = {}
        self._above: dict[Any, int] = {}
        for index, node in enumerate(entries(document, "nodes")):
            for child in entries(node, "children") if isinstance(node, dict) else ():
                if type(child) is int and self._above.setdefault(child, index) != index:
                    raise ValueError(f"nodes[{child}] has two parents; nodes must be a tree")

    def matrix(self, index: Any) -> Matrix:
        """Return the transform (4, 4) of a node."""
        chain = []
        while index is not None and index not in self._known:
            item(self._document, "nodes", index)
            chain.append(index)
            if len(chain) > len(self._above) + 1:
                raise ValueError(f"nodes[{index}] is below itself; nodes must be a tree")
            index = self._above.get(index)
        matrix = np.eye(4) if index is None else self._known[index]
        for step in reversed(chain):
            matrix = self._known[step] = _placed(matrix, item(self._document, "nodes", step))
        return matrix
