"""Attributes of meshes that materials need: uv for images and checkerboards, vertex colours for ``attribute``."""

from typing import TYPE_CHECKING, Any

from raytrace.errors import SceneError

if TYPE_CHECKING:
    from raytrace.records import RawMesh

TEXTURED = "albedo", "reflectance", "emission"  # keys of materials that may be a texture
UV, COLOR, MATERIAL = "uv", "color", "material"
FROM_FILE = "\0file"  # stands for the materials of the file, in the ``material`` of an object
Wanted = frozenset[str]  # {UV, COLOR} or a part of it, or {MATERIAL}: what is read from a mesh beside its triangles
NOTHING = Wanted()
WORDS = {  # attribute -> its name, and what to do where it is missing
    UV: ("texture coordinates (uv)", "export the mesh with them, or use a material without image and checkerboard"),
    COLOR: ("vertex colours", "use a mesh that has them, or a material without attribute"),
}
NEEDS = {"image": "uv", "checkerboard": "uv", "attribute": "color"}  # key of a texture -> what it looks up


def needed(data: dict[str, Any]) -> dict[str, set[str]]:
    """Return which attributes of meshes each material of a scene needs.

    Parameters
    ----------
    data : dict
        A scene as JSON types, in the format's own keys; it need not be valid.

    Returns
    -------
    dict of str
        Name of a material -> {"uv", "color"} or a part of it. Materials that need none are absent.

    Examples
    --------
    >>> needed({"materials": {
    ...     "floor": {"type": "diffuse", "albedo": {"checkerboard": [[1, 1, 1], [0, 0, 0]]}},
    ...     "white": {"type": "diffuse", "albedo": [0.7, 0.7, 0.7]},
    ... }})
    {'floor': {'uv'}}
    """
    materials = data.get("materials")
    found = dict[str, set[str]]()
    for name, material in (materials if isinstance(materials, dict) else {}).items():
        textures = [material.get(key) for key in TEXTURED] if isinstance(material, dict) else []
        kinds = {kind for texture in textures if isinstance(texture, dict) for kind in NEEDS if kind in texture}
        if kinds:
            found[name] = {NEEDS[kind] for kind in kinds}
    return found


def wanted_of(objects: list[Any], needs: dict[str, set[str]]) -> dict[str, Wanted]:
    """Return which attributes of each mesh the materials of its objects need.

    Parameters
    ----------
    objects : list of types.SimpleNamespace
        The objects of a valid scene.
    needs : dict of str
        As ``needed`` returns it.

    Returns
    -------
    dict of str
        Name of a mesh -> attributes. Meshes of which none are needed are absent.
    """
    wanted = dict[str, Wanted]()
    for entry in objects:
        if entry.mesh is not None and entry.material in needs and entry.material != FROM_FILE:
            wanted[entry.mesh] = wanted.get(entry.mesh, NOTHING) | needs[entry.material]
    return wanted


def check_attributes(mesh: "RawMesh", needs: set[str], name: str, material: str) -> None:
    """Refuse a mesh that lacks what its material needs.

    Parameters
    ----------
    mesh : RawMesh
    needs : set of {"uv", "color"}
    name : str
        Of the mesh, for the message.
    material : str

    Raises
    ------
    SceneError
        One line that names mesh, material and what is missing.

    Examples
    --------
    >>> from raytrace.scene.shapes import rectangle
    >>> check_attributes(rectangle(), {"color"}, "rectangle", "baked")
    Traceback (most recent call last):
    raytrace.errors.SceneError: rectangle: no vertex colours, which the material "baked" needs; ...
    """
    import numpy as np

    for need, values in ((UV, mesh.uv), (COLOR, mesh.colors)):
        if need not in needs:
            continue
        what, cure = WORDS[need]
        bad = len(mesh.faces) if values is None else int((~np.isfinite(values)).any(axis=(1, 2)).sum())
        if bad:
            some = "" if bad == len(mesh.faces) else f" for {bad:,} of {len(mesh.faces):,} triangles"
            text = f'{name}: no {what}{some}, which the material "{material}" needs; {cure}'
            raise SceneError([text])
