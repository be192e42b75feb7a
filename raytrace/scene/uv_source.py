"""Reads the uv of a loaded scene again, for the layer (AOV) ``uv``: loading reads only those that a material needs."""

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import FileError, SceneError
from raytrace.records import Mesh
from raytrace.scene.attributes import UV
from raytrace.scene.files import Reach
from raytrace.scene.meshes.given import MARK


class UvSource(NamedTuple):
    """The shapes of a loaded scene."""

    objects: list[Any]  # the entries of ``objects``, as ``read_format`` returns them
    reach: Reach  # the folders that may be read
    given: Mapping[str, Any]  # name -> mesh that a program gave

    def __reduce__(self) -> Any:
        """Leave out meshes that a program gave, which may be of any type, when a scene is sent to another process."""
        return UvSource, (self.objects, self.reach, {})

    def read(self, mesh: Mesh) -> NDArray[np.float64] | None:
        """Return the uv (m, 3, 2) of all triangles; NaN for objects that have none; None if none has.

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
        from raytrace.scene.assemble import ShapeReader
        from raytrace.scene.meshes.raw_mesh import join_corners

        if any(
            entry.mesh is not None and MARK in entry.mesh and entry.mesh not in self.given for entry in self.objects
        ):
            raise FileError("uv: a mesh that a program gave is not sent to other processes; load the scene there")
        objects = [SimpleNamespace(**{**vars(entry), "material": ""}) for entry in self.objects]
        scene = SimpleNamespace(objects=objects, materials={"": None})
        shapes = ShapeReader(scene, self.reach, self.given, {"": {UV}}, strict=False)
        shapes.place_all()
        if shapes.problems:
            first = shapes.problems[0]
            raise FileError(f"uv: {first.text}") if first.unreadable else SceneError([f"uv: {first.text}"])
        parts = [placed.mesh for placed in shapes.placed]
        faces, vertices = sum(len(part.faces) for part in parts), sum(len(part.vertices) for part in parts)
        before, same = 0, (faces, vertices) == (len(mesh.faces), len(mesh.vertices))
        for part in parts if same else ():
            same &= np.array_equal(part.vertices, mesh.vertices[before : before + len(part.vertices)])
            before += len(part.vertices)
        if not same:
            raise FileError(
                "uv: a mesh file has changed since the scene was loaded, or its mesh was replaced; load it again"
            )
        return join_corners([part.uv for part in parts], [len(part.faces) for part in parts])
