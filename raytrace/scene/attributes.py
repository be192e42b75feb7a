"""Attributes of meshes that materials need: uv for images and checkerboards, vertex colours for ``attribute``."""

from typing import Any

TEXTURED = "albedo", "reflectance", "emission"  # keys of materials that may be a texture
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
