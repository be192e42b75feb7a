"""What a program may give where a scene is expected, as types."""

from pathlib import Path
from typing import Any, Protocol


class HasTriangles(Protocol):
    """A mesh, such as a ``trimesh.Trimesh``."""

    @property
    def vertices(self) -> Any:
        """Points, (v, 3)."""

    @property
    def faces(self) -> Any:
        """Rows of vertices, (m, 3)."""


class HasGraph(Protocol):
    """A scene of meshes, such as a ``trimesh.Scene``."""

    @property
    def geometry(self) -> Any:
        """Name -> mesh."""

    @property
    def graph(self) -> Any:
        """Nodes, each with a transform and the name of a mesh."""


Arrays = tuple[Any, Any]  # vertices and faces
Source = str | Path | dict[str, Any] | HasTriangles | HasGraph | Arrays
