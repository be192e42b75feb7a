"""Reads the uv of a loaded scene again, for the layer (AOV) ``uv``: loading reads only those that a material needs."""

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import FileError, SceneError
from raytrace.records import Mesh, RawMesh
from raytrace.scene.attributes import UV
from raytrace.scene.files import Reach
from raytrace.scene.meshes.given import MARK


class UvSource(NamedTuple):
    """The shapes of a loaded scene."""

    objects: list[Any]  # the entries of ``objects``, as ``read_format`` returns them
    reach: Reach  # the folders that may be read
    given: Mapping[str, Any]  # name -> mesh that a program gave, if it can have uv; None: it is in another process

    def __reduce__(self) -> Any:
        """Leave out meshes that a program gave, which may be of any type, when a scene is sent to another process."""
        return UvSource, (self.objects, self.reach, dict.fromkeys(self.given))

    def read(self, mesh: Mesh) -> NDArray[np.float64]:
        """Return the uv (m, 3, 2) of all triangles; NaN for objects that have none.

        Parameters
        ----------
        mesh : Mesh
            The mesh of the scene, with which the files must still agree.

        Raises
        ------
        FileError
            A file has changed, or can't be read any more.
        SceneError
            The uv of a file are wrong.
        """
        if any(value is None for value in self.given.values()):
            raise FileError("uv: a mesh that a program gave is not sent to other processes; load the scene there")
        numbers = [
            i
            for i, entry in enumerate(self.objects)
            if entry.mesh is None or not entry.mesh.startswith(MARK) or entry.mesh in self.given
        ]
        uv = np.full((len(mesh.faces), 3, 2), np.nan)
        for i, part in zip(numbers, self._place(numbers), strict=True):
            rows = np.flatnonzero(mesh.object_id == i)
            if not np.array_equal(part.vertices[part.faces], mesh.vertices[mesh.faces[rows]]):
                what = "a mesh file has changed since the scene was loaded, or its mesh was replaced; load it again"
                raise FileError(f"uv: {what}")
            if part.uv is not None:
                uv[rows] = part.uv
        return uv

    def _place(self, numbers: list[int]) -> list[RawMesh]:
        """Return the meshes of some objects in the world, with their uv."""
        from raytrace.scene.assemble import ShapeReader

        objects = [SimpleNamespace(**{**vars(self.objects[i]), "material": ""}) for i in numbers]
        scene = SimpleNamespace(objects=objects, materials={"": None})
        shapes = ShapeReader(scene, self.reach, self.given, {"": {UV}}, strict=False)
        shapes.place_all()
        if shapes.problems:
            first = shapes.problems[0]
            raise FileError(f"uv: {first.text}") if first.unreadable else SceneError([f"uv: {first.text}"])
        return [placed.mesh for placed in shapes.placed]


def with_uv(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the meshes that can have uv; the others need not be kept."""
    return {name: mesh for name, mesh in given.items() if hasattr(mesh, "visual")}
