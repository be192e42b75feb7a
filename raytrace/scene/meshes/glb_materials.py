"""Materials of glTF files, for objects with ``"material": {"from": "file"}``   [glTF, 3.9].

Read are the base colour (factor, texture, vertex colours), metallic and roughness (factors, textures), and whether both
sides are seen. The rest is named in ``FileMaterial.left_out``.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.image.texels import suffix_of_content
from raytrace.records import RawMesh
from raytrace.scene.meshes.glb_accessors import Accessors
from raytrace.scene.meshes.glb_corners import colors_of, uv_of
from raytrace.scene.meshes.glb_json import Record, extension, item, numbers, record_in
from raytrace.texture_records import FileImage, FileMaterial

TRANSFORM = "KHR_texture_transform"
REPEAT, NEAREST = 10497, 9728  # of samplers
BASE, METAL = "baseColorTexture", "metallicRoughnessTexture"
MAPS = {"normalTexture": "normal map", "occlusionTexture": "occlusion map"}
WHITE, GREY = (1.0, 1.0, 1.0), (0.7, 0.7, 0.7)
Colors = NDArray[np.float64]  # (m, 3, 3)
GLOW = "KHR_materials_emissive_strength"


class _Use(NamedTuple):
    """A material, and what the part of a mesh that uses it has."""

    number: int | None  # index of the material; None: the part has none
    has_uv: bool
    repeats: bool  # whether uv leave 0 to 1
    has_colors: bool  # vertex colours that differ
    tint: tuple[float, ...] | None  # the vertex colour, where all are equal


class FileMaterials:
    """The materials of a file, each read once.

    Parameters
    ----------
    document : dict
        Its JSON.
    accessors : Accessors
    """

    def __init__(self, document: Record, accessors: Accessors) -> None:
        self._document, self._accessors = document, accessors
        self._made: dict[_Use, FileMaterial] = {}
        self._images: dict[int, FileImage | None] = {}

    def apply(self, mesh: RawMesh, primitive: Record, rows: NDArray[np.int64] | None) -> RawMesh:
        """Return the mesh of a part with its material, and the uv and colours that this needs.

        Parameters
        ----------
        mesh : RawMesh
            Its triangles may be turned round.
        primitive : dict
        rows : (n,) int64 or None
            Vertices of the primitive that the mesh has; None: all.
        """
        index = primitive.get("material")
        record = {} if index is None else item(self._document, "materials", index)
        texture = record_in(record_in(record, "pbrMetallicRoughness"), BASE)
        number = (extension(texture, TRANSFORM) or {}).get("texCoord", texture.get("texCoord", 0))
        uv = uv_of(mesh, primitive, self._accessors, rows, f"TEXCOORD_{number}") if texture else None
        if uv is not None:
            uv = _transformed(uv, extension(texture, TRANSFORM) or {})
        repeats = uv is not None and bool(((uv < 0) | (uv > 1)).any())
        colors, tint = _without_tint(colors_of(mesh, primitive, self._accessors, rows))
        use = _Use(index, uv is not None, repeats, colors is not None, tint)
        if use not in self._made:
            self._made[use] = self._material(use, record)
        made = self._made[use]
        if made.image is not None and uv is not None:
            uv[:, :, 1] = 1 - uv[:, :, 1]
            mesh = mesh._replace(uv=uv)
        if made.colors and colors is not None:
            mesh = mesh._replace(colors=colors * made.base_color)
        return mesh._replace(parts=np.zeros(len(mesh.faces), np.int32), materials=(made,))

    def _material(self, use: _Use, record: Record) -> FileMaterial:
        """Return a material as a part uses it."""
        if use.number is None:
            grey = use.tint or (WHITE if use.has_colors else GREY)
            return FileMaterial("no material", grey, None, use.has_colors, 0.0, 1.0, None, two_sided=True)
        pbr = record_in(record, "pbrMetallicRoughness")
        left_out = _left_out(record)
        image, sampler = (
            (self._texture(record_in(pbr, BASE)) if use.has_uv else None),
            self._sampler(record_in(pbr, BASE)),
        )
        if BASE in pbr and image is None:
            left_out.append("the texture of the base colour" + ("" if use.has_uv else " (the mesh has no uv)"))
        if image is not None and use.has_colors:
            left_out.append("vertex colours beside a texture")
        if image is not None and use.repeats and {sampler.get(wrap, REPEAT) for wrap in ("wrapS", "wrapT")} != {REPEAT}:
            left_out.append("clamped or mirrored textures (they repeat)")
        metallic, roughness = _factor(pbr, "metallicFactor"), _factor(pbr, "roughnessFactor")
        metal = self._texture(record_in(pbr, METAL)) if metallic >= 0.5 else None
        if METAL in pbr and metallic >= 0.5:
            left_out.append("the texture of metallic and roughness" + (" (its mean is used)" if metal else ""))
        base = np.clip(numbers(pbr, "baseColorFactor", [1.0] * 4)[:3], 0.0, 1.0) * (use.tint or WHITE)
        return FileMaterial(
            str(record.get("name") or f"materials[{use.number}]")[:80],
            tuple(base.tolist()),
            image,
            use.has_colors and image is None,
            metallic,
            roughness,
            metal,
            two_sided=record.get("doubleSided") is True,
            nearest=sampler.get("magFilter") == NEAREST,
            left_out=tuple(left_out),
        )

    def _texture(self, info: Record) -> FileImage | None:
        """Return the image of a texture; None where there is none that can be read."""
        if "index" not in info:
            return None
        source = item(self._document, "textures", info["index"]).get("source")
        if source is None:  # only in a format of an extension
            return None
        record = item(self._document, "images", source)
        if source not in self._images:
            data = self._accessors.image(record)
            known = suffix_of_content(data) in (".png", ".jpg")
            self._images[source] = FileImage(f"images[{source}]", data) if known else None
        return self._images[source]

    def _sampler(self, info: Record) -> Record:
        if "index" not in info:
            return {}
        texture = item(self._document, "textures", info["index"])
        return item(self._document, "samplers", texture["sampler"]) if "sampler" in texture else {}


def _without_tint(colors: Colors | None) -> tuple[Colors | None, tuple[float, ...] | None]:
    """Return vertex colours, if they differ, and otherwise their one colour: many programs write white ones."""
    if colors is None or not len(colors):
        return None, None
    first = colors[0, 0]
    if (colors == first).all() and ((first >= 0) & (first <= 1)).all():
        return None, tuple(first.tolist())
    return colors, None


def _left_out(record: Record) -> list[str]:
    """Return what a material has that is not read, but for its textures of the base colour, metallic and roughness."""
    left_out = []
    if numbers(record, "emissiveFactor", [0.0] * 3).any():
        left_out.append("emission")
    left_out += [name for key, name in MAPS.items() if key in record]
    if record.get("alphaMode", "OPAQUE") != "OPAQUE":
        left_out.append("transparency")
    return left_out + sorted(str(name)[:80] for name in record_in(record, "extensions") if name != GLOW)[:10]


def _factor(record: Record, key: str) -> float:
    """Return a factor from 0 to 1; by default 1."""
    value = record.get(key, 1.0)
    if type(value) not in (int, float):
        raise ValueError(f"{key}: expected a number, got {str(value)[:40]}")
    return float(min(max(value, 0.0), 1.0))


def _transformed(uv: NDArray[np.float64], transform: Record) -> NDArray[np.float64]:
    """Return uv, v downwards as in the file, scaled, turned counter-clockwise and moved   [KHR_texture_transform]."""
    if not transform:
        return uv
    scaled = uv * numbers(transform, "scale", [1.0, 1.0])
    angle = transform.get("rotation", 0.0)
    if type(angle) not in (int, float) or not math.isfinite(angle):
        raise ValueError(f"rotation: expected a number, got {str(angle)[:40]}")
    c, s = math.cos(angle), math.sin(angle)
    turned = np.stack([c * scaled[..., 0] + s * scaled[..., 1], c * scaled[..., 1] - s * scaled[..., 0]], axis=-1)
    return turned + numbers(transform, "offset", [0.0, 0.0])
