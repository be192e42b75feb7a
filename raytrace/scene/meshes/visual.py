"""Texture coordinates and colours of mesh objects that keep them as trimesh does, in ``visual``.

Colours are linear; of integers, the largest value of the type stands for 1. v = 0 is the bottom row of an image.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import SceneError
from raytrace.records import RawMesh
from raytrace.scene.attributes import COLOR, UV, Wanted


def with_visual(mesh: RawMesh, source: Any, wanted: Wanted) -> RawMesh:
    """Return a mesh with the uv and colours of an object, as far as they are wanted and it has them.

    Parameters
    ----------
    mesh : RawMesh
        Its faces refer to the vertices of the object.
    source : object
        Such as a ``trimesh.Trimesh``: ``visual.uv`` (v, 2); ``visual.vertex_colors`` (v, 3 or 4) or
        ``visual.face_colors`` (m, 3 or 4), where ``visual.kind`` says that they were set.
    wanted : set of {"uv", "color"}

    Raises
    ------
    SceneError
        They have another shape.

    Examples
    --------
    >>> import trimesh
    >>> box = trimesh.creation.box()
    >>> box.visual.vertex_colors = np.full((8, 4), 255, np.uint8)
    >>> with_visual(RawMesh(box.vertices, box.faces, None, None), box, frozenset({"color"})).colors.shape
    (12, 3, 3)
    """
    visual: Any = getattr(source, "visual", None)
    if UV in wanted and (uv := getattr(visual, "uv", None)) is not None:
        mesh = mesh._replace(uv=_rows("visual.uv", uv, len(mesh.vertices), 2)[mesh.faces])
    if COLOR in wanted:
        kind = getattr(visual, "kind", None)
        if kind == "vertex":
            colors = _rows("visual.vertex_colors", visual.vertex_colors, len(mesh.vertices), 3)[mesh.faces]
        elif kind == "face":
            colors = np.repeat(_rows("visual.face_colors", visual.face_colors, len(mesh.faces), 3)[:, None], 3, axis=1)
        else:
            found = (getattr(visual, "vertex_attributes", None) or {}).get("color")  # of a mesh with a texture
            if found is None:
                return mesh
            colors = _rows("visual.vertex_attributes['color']", found, len(mesh.vertices), 3)[mesh.faces]
        mesh = mesh._replace(colors=colors)
    return mesh


def _rows(name: str, value: Any, count: int, width: int) -> NDArray[np.float64]:
    """Return an array (count, width) of numbers; further columns are left out."""
    array = np.asarray(value)
    if array.ndim != 2 or len(array) != count or array.shape[1] < width or array.dtype.kind not in "fu":
        text = f"expected an array of {count} x {width} numbers, got shape {array.shape} of dtype {array.dtype}"
        raise SceneError([f"{name}: {text}"])
    largest = np.iinfo(array.dtype).max if array.dtype.kind == "u" else 1
    return array[:, :width].astype(np.float64) / largest
