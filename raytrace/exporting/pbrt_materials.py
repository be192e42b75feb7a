"""Materials and textures for pbrt-v4."""

import numpy as np

from raytrace.exporting.backs import back_may_be_seen
from raytrace.exporting.common import Contents, unique_names, used_materials
from raytrace.exporting.differences import Differences
from raytrace.exporting.images import texture_file
from raytrace.exporting.meshes import Part, reflects_nothing
from raytrace.exporting.pbrt_text import directive, parameter
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

MOST_K = 1e4  # absorption index instead of an infinite one: the reflectance is 1 - 4e-8


class Materials:
    """The materials that a scene uses, as directives, and the images of their textures as files."""

    def __init__(self, scene: Scene, parts: list[Part], differences: Differences) -> None:
        self._scene, self._table, self._differences = scene, scene.materials, differences
        self._names = unique_names(scene.materials.name)
        self._paths: dict[int, str] = {}
        self._textures: dict[int, str] = {}  # directives by the number of a texture
        self.files: Contents = {}
        made = [self._material(k) for k in used_materials(scene)]
        self.directives = [*self._textures.values(), *made]
        for part in parts:
            self._check_back(part)

    def name_of(self, k: int) -> str:
        """Name of material k."""
        return self._names[k]

    def emission_of(self, k: int) -> list[str]:
        """Return the parameters of the emission of material k; none if it emits nothing."""
        emission = self._table.emission
        if emission is None or not emission[k].any():
            return []
        found = self._texture_of(k, emits=True)
        if found is None:
            return [parameter("rgb", "L", *emission[k])]
        number, texture = found
        where = f"materials.{self._table.name[k]}.emission"
        if texture.kind in (BILINEAR, NEAREST) and texture.scale == (1.0, 1.0):
            text = "pbrt has no emission by a texture that repeats, or is not interpolated"
            self._differences.add(where, text, "the image is interpolated, and not repeated beyond its border")
            return [parameter("string", "filename", self._path(number, texture))]
        text = "pbrt has no emission by a checkerboard, by vertex colours, or by an image with a scale of uv"
        self._differences.add(where, text, "the mean is used")
        return [parameter("rgb", "L", *emission[k])]

    def _texture_of(self, k: int, emits: bool = False) -> tuple[int, Texture] | None:
        """Texture of the reflectance or emission of material k, and its number."""
        textures = self._scene.textures
        if textures is None:
            return None
        row = int((textures.emission if emits else textures.reflectance)[k])
        return None if row < 0 else (row, textures.table[row])

    def _path(self, number: int, texture: Texture) -> str:
        """Write the image of a texture, once; return its path."""
        if number not in self._paths:
            suffix, data = texture_file(texture)
            self._paths[number] = f"textures/{number:03d}{suffix}"
            self.files[self._paths[number]] = data
        return self._paths[number]

    def _reflectance(self, k: int) -> str:
        """Return the parameter ``reflectance`` of material k, after the directive of its texture is made."""
        found = self._texture_of(k)
        if found is not None and found[1].kind == ATTRIBUTE:
            where = f"materials.{self._table.name[k]}"
            self._differences.add(where, "pbrt has no vertex colours", "their mean is used")
            found = None
        if found is None:
            return parameter("rgb", "reflectance", *self._table.albedo[k])
        number, texture = found
        name = f"texture-{number:03d}"
        u, v = texture.scale
        scale = [parameter("float", "uscale", u), parameter("float", "vscale", v)]
        if texture.kind == CHECKERBOARD:
            colours = [parameter("rgb", key, *texture.codes[0, j]) for j, key in enumerate(("tex1", "tex2"))]
            self._textures[number] = directive(f'Texture "{name}" "spectrum"', "checkerboard", colours + scale)
        else:
            image = [
                parameter("string", "filename", self._path(number, texture)),
                parameter("string", "filter", "point" if texture.kind == NEAREST else "bilinear"),
                parameter("string", "wrap", "repeat"),
            ]
            self._textures[number] = directive(f'Texture "{name}" "spectrum"', "imagemap", image + scale)
        return parameter("texture", "reflectance", name)

    def _material(self, k: int) -> str:
        table, kind = self._table, self._table.kind[k]
        if kind == DIFFUSE:
            return self._named(k, "diffuse", [self._reflectance(k)])
        if kind == PLASTIC:
            text = "pbrt has no smooth coat whose layers are summed in closed form"
            self._note(k, text, "it becomes a coateddiffuse, whose light between the layers is sampled")
            coat = [parameter("float", "eta", table.ior[k]), parameter("float", "roughness", 0.0)]
            return self._named(k, "coateddiffuse", [self._reflectance(k), *coat])
        if kind in (DIELECTRIC, ROUGH_DIELECTRIC, REFRACTIVE):
            eta = parameter("float", "eta", table.ior[k])
            return self._named(k, "dielectric", [eta, *self._roughness(k, kind == ROUGH_DIELECTRIC)])
        if kind == MIRROR:
            if self._texture_of(k) or not (table.albedo[k] == 1).all():
                text = "pbrt has no mirror whose reflectance is below 1 and the same at all angles"
                self._note(k, text, "it becomes a conductor with this reflectance at normal incidence")
            return self._named(k, "conductor", [self._reflectance(k)])
        assert kind in (CONDUCTOR, ROUGH_CONDUCTOR), f"a new kind of material: {kind}"
        rough = self._roughness(k, kind == ROUGH_CONDUCTOR)
        if self._texture_of(k):
            return self._named(k, "conductor", [self._reflectance(k), *rough])
        assert table.eta is not None
        assert table.k is not None
        index = [parameter("rgb", "eta", *table.eta[k]), parameter("rgb", "k", *np.minimum(table.k[k], MOST_K))]
        return self._named(k, "conductor", [*index, *rough])

    def _named(self, k: int, kind: str, parameters: list[str]) -> str:
        return directive("MakeNamedMaterial", self.name_of(k), [parameter("string", "type", kind), *parameters])

    def _note(self, k: int, what: str, instead: str) -> None:
        self._differences.add(f"materials.{self._table.name[k]}", what, instead)

    def _roughness(self, k: int, rough: bool) -> list[str]:
        """Return the GGX width, which pbrt would otherwise take the square of."""
        if not rough:
            return []
        assert self._table.alpha is not None
        text = "pbrt has no separable masking of microfacets, G1(i) G1(o)"
        self._note(k, text, "its height-correlated form is used, which is a little brighter at grazing angles")
        return [parameter("float", "roughness", self._table.alpha[k]), parameter("bool", "remaproughness", False)]

    def _check_back(self, part: Part) -> None:
        """Note a part whose back is black here, and reflects in pbrt, if it may be seen."""
        table, k = self._table, part.material
        if table.kind[k] not in (DIFFUSE, PLASTIC) or table.two_sided[k] or reflects_nothing(self._scene, k):
            return
        if back_may_be_seen(self._scene, part):
            text = "pbrt has no diffuse surface that is black from behind, and this back may be seen"
            self._differences.add(f"objects.{self._scene.objects[part.object_id]}", text, "it reflects on both sides")
