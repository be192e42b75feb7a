"""Texture coordinates and colours of PLY files, for the corners of the triangles.

Colours are linear. Of integers, the largest value of the type stands for 1.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.records import RawMesh
from raytrace.scene.attributes import COLOR, UV, Wanted
from raytrace.scene.meshes.ply_text import Element

UV_NAMES: tuple[tuple[str, ...], ...] = ("u", "v"), ("s", "t"), ("texture_u", "texture_v"), ("texture_s", "texture_t")
COLOR_NAMES: tuple[tuple[str, ...], ...] = ("red", "green", "blue"), ("r", "g", "b")
LARGEST = {"u1": 255, "u2": 65535}  # integers that stand for 1
WEDGES = "texcoord"  # a list of each face: u and v of its corners, as MeshLab writes them

Numbers = Mapping[str, tuple[NDArray[np.int64], NDArray[Any]]]  # by property: how many in each row, and all of them
Faults = Mapping[tuple[str, str], str]  # what is wrong with words, by element and property


def with_attributes(
    mesh: RawMesh,
    read: Mapping[str, Numbers],
    elements: list[Element],
    places: NDArray[np.int64],
    wanted: Wanted,
    *,
    faults: Faults,
) -> RawMesh:
    """Return a mesh with its uv and colours, as far as they are wanted and the file has them.

    Parameters
    ----------
    mesh : RawMesh
    read : dict of str
        The numbers of each element.
    elements : list of Element
    places : (n, 3) int64
        Of the first n triangles, which come from polygons: the positions of the corners in the list of all corners.
    wanted : set of {"uv", "color"}
    faults : dict
        What is wrong with the words of a text, by element and property.

    Raises
    ------
    ValueError
        An attribute has words that are not numbers, or numbers of a type that has no meaning here.
    """
    vertex, face = read.get("vertex", {}), read.get("face", {})
    if UV in wanted:
        names = next((names for names in UV_NAMES if vertex.keys() >= set(names)), None)
        if names:
            mesh = mesh._replace(uv=_columns("vertex", vertex, names, faults)[mesh.faces])
        elif WEDGES in face:
            mesh = mesh._replace(uv=_wedges(face, places, len(mesh.faces), faults))
    if COLOR in wanted and (names := next((names for names in COLOR_NAMES if vertex.keys() >= set(names)), None)):
        kinds = {
            prop.name: prop.kind for element in elements if element.name == "vertex" for prop in element.properties
        }
        scales = [1 / _largest(name, kinds[name]) for name in names]
        mesh = mesh._replace(colors=(_columns("vertex", vertex, names, faults) * scales)[mesh.faces])
    return mesh


def _columns(element: str, numbers: Numbers, names: tuple[str, ...], faults: Faults) -> NDArray[np.float64]:
    """Return properties as the columns of an array."""
    for name in names:
        if fault := faults.get((element, name)):
            raise ValueError(fault)
        if (numbers[name][0] != 1).any():
            raise ValueError(f"property {name} of element {element} is a list; expected one number")
    return np.stack([numbers[name][1] for name in names], axis=1).astype(np.float64)


def _largest(name: str, kind: str) -> int:
    """Return the number that stands for 1 in a colour of this type."""
    if kind[0] in "iu" and kind not in LARGEST:
        raise ValueError(f"property {name} of element vertex: expected the type uchar, ushort or float")
    return LARGEST.get(kind, 1)


def _wedges(face: Numbers, places: NDArray[np.int64], triangles: int, faults: Faults) -> NDArray[np.float64]:
    """Return uv that the faces themselves have; NaN for triangles of strips, and where a face has none."""
    if fault := faults.get(("face", WEDGES)):
        raise ValueError(fault)
    sizes = next(face[name][0] for name in ("vertex_indices", "vertex_index") if name in face)
    counts, numbers = face[WEDGES]
    wrong = (counts != 2 * sizes) & (counts != 0)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise ValueError(f"face row {row} has {sizes[row]} corners and {counts[row]} numbers of {WEDGES}")
    uv, corners = np.full((triangles, 3, 2), np.nan), np.full((int(sizes.sum()), 2), np.nan)
    corners[np.repeat(counts > 0, sizes)] = numbers.astype(np.float64).reshape(-1, 2)
    uv[: len(places)] = corners[places]
    return uv
