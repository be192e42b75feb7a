"""Meshes in memory that a program gives in a scene: objects with ``vertices`` and ``faces``, or pairs of arrays.

NumPy is imported when such a mesh is read, since checking a scene that names files does not need it.
"""

import os
from typing import TYPE_CHECKING, Any

from raytrace.errors import SceneError
from raytrace.scene.attributes import NOTHING, Wanted

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from raytrace.records import RawMesh

MARK = "\0"  # begins the name of a given mesh; no file has such a name


def is_mesh(value: Any) -> bool:
    """Return whether a value is meant as a mesh, valid or not, and not as the path of one.

    Examples
    --------
    >>> is_mesh("box.obj"), is_mesh(([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    (False, True)
    """
    return not isinstance(value, str | os.PathLike | int | float | dict | None)


def take_meshes(scene: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Replace the meshes of a scene by names.

    Parameters
    ----------
    scene : dict
        It is not changed.

    Returns
    -------
    scene : dict
        With names; the same dict if all its meshes are paths.
    meshes : dict
        Name -> mesh; an object that is used several times has one name.

    Raises
    ------
    ValueError
        A mesh is a dict.
    """
    names, meshes, objects = dict[int, str](), dict[str, Any](), list[Any]()
    entries = scene.get("objects")
    for entry in entries if isinstance(entries, list | tuple) else ():
        mesh = entry.get("mesh") if isinstance(entry, dict) else None
        if isinstance(mesh, dict) and {"vertices", "faces"} <= mesh.keys():
            raise ValueError(f"objects[{len(objects)}].mesh: a dict; write (vertices, faces), two arrays")
        if is_mesh(mesh):
            name = names.setdefault(id(mesh), f"{MARK}mesh {len(names)}")
            meshes[name] = mesh
            entry = {**entry, "mesh": name}
        objects.append(entry)
    return ({**scene, "objects": objects} if meshes else scene), meshes


def read_given(mesh: Any, wanted: Wanted = NOTHING) -> "RawMesh":
    """Check a mesh, and return its triangles.

    Parameters
    ----------
    mesh : object or (vertices, faces)
        An object with both as attributes, such as a ``trimesh.Trimesh``, or a pair of arrays (v, 3) and (m, 3).
    wanted : set of {"uv", "color"}, optional
        Attributes that are read too, where it has them in ``visual``, as a ``trimesh.Trimesh`` may.

    Returns
    -------
    RawMesh
        It has no normals of its own.

    Raises
    ------
    SceneError
        What is wrong with it.

    Examples
    --------
    >>> read_given(([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])).faces.tolist()
    [[0, 1, 2]]
    """
    import numpy as np

    from raytrace.records import RawMesh

    if isinstance(mesh, tuple | list) and len(mesh) == 2:
        vertices, faces = mesh
    elif hasattr(mesh, "vertices") and hasattr(mesh, "faces"):
        vertices, faces = mesh.vertices, mesh.faces
    else:
        raise SceneError([f"expected a path, a mesh with vertices and faces, or (vertices, faces); got {_kind(mesh)}"])
    points = _array("vertices", vertices, "fiu").astype(np.float64, copy=False)
    rows = _array("faces", faces, "iu")
    if not len(rows):
        raise SceneError(["no triangles in it"])
    wrong = ((rows < 0) | (rows >= len(points))).any(axis=1)
    if wrong.any():
        row = int(np.argmax(wrong))
        text = f"row {row} is {rows[row].tolist()}, but there are {len(points)} vertices, numbered from 0"
        raise SceneError([f"faces: {text}"])
    rows, finite = rows.astype(np.int64, copy=False), np.asarray(np.isfinite(points).all(axis=1))
    raw = RawMesh(points, rows, None, None)
    if wanted and hasattr(mesh, "visual"):
        from raytrace.scene.meshes.visual import with_visual

        raw = with_visual(raw, mesh, wanted)
    if not finite.all():
        if (bad := rows[~finite[rows]]).size:
            raise SceneError([f"vertices: row {bad[0]} is not finite: {points[bad[0]].tolist()}"])
        # no triangle uses the others
        raw = raw._replace(vertices=points[finite], faces=(np.cumsum(finite) - 1)[rows])
    return raw


def _array(name: str, value: Any, kinds: str) -> "NDArray[Any]":
    """Return an (n, 3) array; kinds: the allowed kinds of dtype, f for float, i and u for integers."""
    import numpy as np

    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        raise SceneError([f"{name}: some elements are masked; fill them, or leave out their rows"])
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise SceneError([f"{name}: expected rows of 3 numbers: {error}"]) from None
    if array.ndim != 2 or array.shape[1] != 3:
        cure = "; split the quads into triangles" if name == "faces" and array.shape[1:] == (4,) else ""
        raise SceneError([f"{name}: expected an (n, 3) array, got shape {array.shape}{cure}"])
    if array.size and array.dtype.kind not in kinds:
        what = "integers" if kinds == "iu" else "numbers"
        raise SceneError([f"{name}: expected {what}, got dtype {array.dtype}"])
    return array


def _kind(value: Any) -> str:
    if isinstance(value, tuple | list):
        return f"a {type(value).__name__} of {len(value)}"
    hint = "; use scene.to_mesh()" if type(value).__module__.partition(".")[0] == "trimesh" else ""
    return f"a {type(value).__name__}{hint if type(value).__name__ == 'Scene' else ''}"
