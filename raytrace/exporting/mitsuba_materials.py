"""Materials and textures for Mitsuba 3."""

import numpy as np
from numpy.typing import NDArray

from raytrace.exporting.common import Contents, unique_names, used_materials
from raytrace.exporting.differences import Differences
from raytrace.exporting.images import exr_bytes, linear_texels, texture_file
from raytrace.exporting.xml import Element, plugin, put, transform
from raytrace.records import (
    CONDUCTOR,
    DIELECTRIC,
    DIFFUSE,
    MIRROR,
    PLASTIC,
    REFRACTIVE,
    ROUGH_CONDUCTOR,
    ROUGH_DIELECTRIC,
    Scene,
)  # fmt: skip
from raytrace.texture_records import ATTRIBUTE, BILINEAR, CHECKERBOARD, NEAREST, Texture

ABOVE_1 = "radiance", "k"  # parameters whose textures may have values above 1
MOST_K = 1e4  # absorption index instead of an infinite one: the reflectance is 1 - 4e-8


class Materials:
    """The materials that a scene uses, as elements with an id, and the images of their textures as files."""

    def __init__(self, scene: Scene, differences: Differences) -> None:
        self._scene, self._table, self._differences = scene, scene.materials, differences
        self._names = unique_names(scene.materials.name)
        self._files: dict[tuple[int, str], str] = {}
        self.files: Contents = {}
        self.elements = []
        for k in used_materials(scene):
            element = self._bsdf(k)
            element.set("id", self.name_of(k))
            self.elements.append(element)

    def name_of(self, k: int) -> str:
        """Id of material k."""
        return f"material-{self._names[k]}"

    def emission_of(self, k: int) -> Element | None:
        """Radiance of material k; None if it emits nothing."""
        emission = self._table.emission
        if emission is None or not emission[k].any():
            return None
        texture = self._texture_of(k, emits=True)
        return put("rgb", "radiance", emission[k]) if texture is None else self._texture("radiance", texture)

    def _texture_of(self, k: int, emits: bool = False) -> tuple[int, Texture] | None:
        """Texture of the reflectance or emission of material k, and its number."""
        textures = self._scene.textures
        if textures is None:
            return None
        row = int((textures.emission if emits else textures.reflectance)[k])
        return None if row < 0 else (row, textures.table[row])

    def _colour(self, name: str, k: int) -> Element:
        """Reflectance of material k."""
        texture = self._texture_of(k)
        return put("rgb", name, self._table.albedo[k]) if texture is None else self._texture(name, texture)

    def _texture(self, name: str, numbered: tuple[int, Texture]) -> Element:
        """Return a texture of a reflectance, of radiance, or of the absorption index k that a reflectance has."""
        number, texture = numbered
        u, v = texture.scale
        if texture.kind == ATTRIBUTE:
            return plugin("texture", "mesh_attribute", [put("string", "name", "vertex_color")], name=name)
        checks = texture.kind == CHECKERBOARD
        if checks and name not in ABOVE_1:
            scale = transform("to_uv", ("scale", {"x": u / 2, "y": v / 2}))
            both = [put("rgb", f"color{j}", texture.codes[0, j]) for j in range(2)]
            return plugin("texture", "checkerboard", [*both, scale], name=name)
        if checks:  # an image of two by two texels, because colours of a checkerboard are at most 1
            texture = texture._replace(codes=np.concatenate([texture.codes, texture.codes[:, ::-1]]))
        path = self._file(number, texture, name)
        children = [
            put("string", "filename", path),
            put("boolean", "raw", path.endswith(".exr")),
            put("string", "filter_type", "nearest" if checks or texture.kind == NEAREST else "bilinear"),
            transform("to_uv", ("scale", {"x": u / 2 if checks else u, "y": -v / 2 if checks else -v})),
        ]
        return plugin("texture", "bitmap", children, name=name)

    def _file(self, number: int, texture: Texture, name: str) -> str:
        """Write the image of a texture, once; return its path."""
        use = "k" if name == "k" else ""
        if (number, use) not in self._files:
            suffix, data = texture_file(texture)
            if use:
                suffix, data = ".exr", exr_bytes(absorption_of(linear_texels(texture)[::-1]))
            path = self._files[number, use] = f"textures/{number:03d}{use}{suffix}"
            self.files[path] = data
        return self._files[number, use]

    def _bsdf(self, k: int) -> Element:
        """Return material k; diffuse and plastic are black from behind, as ours are without ``two_sided``."""
        table, kind = self._table, self._table.kind[k]
        if kind in (DIFFUSE, PLASTIC):
            inner = plugin("bsdf", "diffuse", [self._colour("reflectance", k)])
            if kind == PLASTIC:
                coat = [put("float", "int_ior", table.ior[k]), put("float", "ext_ior", 1.0)]
                inner = plugin(
                    "bsdf",
                    "plastic",
                    [*coat, put("boolean", "nonlinear", True), self._colour("diffuse_reflectance", k)],
                )
            return plugin("bsdf", "twosided", [inner]) if table.two_sided[k] else inner
        if kind in (DIELECTRIC, ROUGH_DIELECTRIC, REFRACTIVE):
            indices = [put("float", "int_ior", table.ior[k]), put("float", "ext_ior", 1.0)]
            rough = self._roughness(k) if kind == ROUGH_DIELECTRIC else []
            return plugin("bsdf", "roughdielectric" if rough else "dielectric", [*indices, *rough])
        if kind == MIRROR:
            ideal = [put("string", "material", "none"), self._colour("specular_reflectance", k)]
            return plugin("bsdf", "twosided", [plugin("bsdf", "conductor", ideal)])
        assert kind in (CONDUCTOR, ROUGH_CONDUCTOR), f"a new kind of material: {kind}"
        rough = self._roughness(k) if kind == ROUGH_CONDUCTOR else []
        inner = plugin("bsdf", "roughconductor" if rough else "conductor", [*self._index(k), *rough])
        return plugin("bsdf", "twosided", [inner])

    def _roughness(self, k: int) -> list[Element]:
        assert self._table.alpha is not None
        return [put("string", "distribution", "ggx"), put("float", "alpha", self._table.alpha[k])]

    def _index(self, k: int) -> list[Element]:
        """Complex index of conductor k, maybe of its texture."""
        table, texture = self._table, self._texture_of(k)
        assert table.eta is not None
        assert table.k is not None
        if texture is None:
            return [put("rgb", "eta", table.eta[k]), put("rgb", "k", np.minimum(table.k[k], MOST_K))]
        one = put("rgb", "eta", [1.0, 1.0, 1.0])
        where = f"materials.{table.name[k]}.reflectance"
        if texture[1].kind == ATTRIBUTE:
            text = "Mitsuba has no conductor with the reflectance of vertex colours"
            self._differences.add(where, text, "their mean is used")
            return [one, put("rgb", "k", absorption_of(table.albedo[k]))]
        if texture[1].kind == BILINEAR:
            text = "Mitsuba has no conductor with the reflectance of an image, only with its absorption index"
            self._differences.add(where, text, "the absorption index is interpolated between the texels")
        return [one, self._texture("k", texture)]


def absorption_of(reflectance: NDArray[np.floating]) -> NDArray[np.float64]:
    """Absorption index k of conductors with eta = 1: k = 2 sqrt(r / (1 - r)), at most `MOST_K`.

    >>> absorption_of(np.array([0.5, 1.0])).tolist()
    [2.0, 10000.0]
    """
    r = np.asarray(reflectance, np.float64)
    with np.errstate(divide="ignore"):
        return np.minimum(2 * np.sqrt(r / (1 - r)), MOST_K)
