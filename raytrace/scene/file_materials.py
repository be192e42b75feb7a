"""Materials of mesh files as materials of a scene, for objects with ``"material": {"from": "file"}``."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.records import RawMesh
from raytrace.scene.format import read_material
from raytrace.scene.problems import Problem
from raytrace.texture_records import FileImage, FileMaterial

WHITE = (1.0, 1.0, 1.0)
METAL = 0.5  # metallic from which on a material is a conductor


class GivenImage(NamedTuple):
    """An image that a texture names, and that is no file of its own."""

    image: FileImage
    factor: tuple[float, ...]  # linear colours are multiplied by it


class SceneFileMaterials:
    """Adds the materials of mesh files to those of a scene.

    Parameters
    ----------
    materials : dict
        Name -> material, as the format reads it; more are added.
    max_memory : int or None, bytes
        Memory that the process may use in total.
    """

    def __init__(self, materials: dict[str, Any], max_memory: int | None) -> None:
        self._materials, self._max_memory = materials, max_memory
        self._rows: dict[str, NDArray[np.int32]] = {}  # by mesh
        self._means: dict[str, NDArray[np.float64]] = {}  # of images of metallic and roughness
        self._objects: dict[str, int] = {}  # name of a material -> the first object that has it
        self.images: dict[str, GivenImage] = {}  # by the names that textures have for them
        self.left_out: dict[str, tuple[str, ...]] = {}  # by mesh
        self.textured = False  # whether any has an image or vertex colours

    def rows(self, i: int, mesh: str, raw: RawMesh) -> NDArray[np.int32]:
        """Return the row of the scene's materials for each triangle of a mesh.

        Parameters
        ----------
        i : int
            The object, for messages.
        mesh : str
            Name of the mesh in the scene.
        raw : RawMesh
            Read with its materials.

        Raises
        ------
        SceneError, FileError
            An image of metallic and roughness can't be read.
        """
        if mesh not in self._rows:
            rows = [self._add(i, mesh, material) for material in raw.materials]
            self._rows[mesh] = np.array(rows, np.int32)
            self.left_out[mesh] = tuple(dict.fromkeys(text for m in raw.materials for text in m.left_out))
        assert raw.parts is not None
        return self._rows[mesh][raw.parts]

    def used(self) -> Iterator[str]:
        """Yield the names of the materials that were added."""
        yield from self._objects

    def at_object(self, problem: Problem) -> Problem:
        """Return a problem of such a material as one of the object that has it, since no file names the material."""
        name = problem.path[1] if len(problem.path) > 1 and problem.path[0] == "materials" else None
        if name not in self._objects:
            return problem
        return problem._replace(path=("objects", self._objects[str(name)], "material"), at_key=False)

    def _add(self, i: int, mesh: str, material: FileMaterial) -> int:
        """Add a material, and return its row."""
        name = base = f"{Path(mesh).name}: {material.name}"
        while name in self._materials:
            name = f"{base} ({len(self._materials)})"
        metallic, roughness = material.metallic, material.roughness
        if material.metal_image is not None:
            mean = self._mean(material.metal_image, mesh)
            metallic, roughness = metallic * mean[2], roughness * mean[1]
        color: Any = list(material.base_color)
        if material.image is not None:
            tint = "" if material.base_color == WHITE else f" times {material.base_color}"
            color = {"image": f"{mesh}: {material.image.name}{tint}", "encoding": "srgb"}
            color["filter"] = "nearest" if material.nearest else "bilinear"
            self.images[color["image"]] = GivenImage(material.image, material.base_color)
        elif material.colors:
            color = {"attribute": "color"}
        self.textured |= isinstance(color, dict)
        data = {"type": "diffuse", "albedo": color, "two_sided": material.two_sided}
        if metallic >= METAL:
            data = {"type": "conductor", "reflectance": color, "alpha": float(roughness * roughness)}
        self._materials[name], self._objects[name] = read_material(data), i
        return len(self._materials) - 1

    def _mean(self, image: FileImage, mesh: str) -> NDArray[np.float64]:
        """Return the mean of an image whose numbers are linear."""
        from raytrace.image.texels import decode_texels, suffix_of_content

        name = f"{mesh}: {image.name}"
        if name not in self._means:
            codes = decode_texels(image.data, suffix_of_content(image.data), False, name, self._max_memory).codes
            self._means[name] = codes.reshape(-1, 3).mean(axis=0, dtype=np.float64) / np.iinfo(codes.dtype).max
        return self._means[name]
