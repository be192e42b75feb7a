"""The numbers of a binary PLY."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.scene.meshes.ply_text import Column

Array = NDArray[Any]
Integers = NDArray[np.int64]


class Bytes:
    """Numbers in binary form; the unit is a byte."""

    def __init__(self, body: memoryview, order: str) -> None:
        self.body, self.order, self.at, self.end = body, order, 0, len(body)

    def size(self, kind: str) -> int:  # noqa: D102
        return int(kind[1:])

    def length(self, kind: str) -> int:  # noqa: D102
        begin, self.at = self.at, self.at + self.size(kind)
        order: Any = "little" if self.order == "<" else "big"
        return int.from_bytes(self.body[begin : self.at], order, signed=kind[0] == "i")

    def table(self, columns: list[Column], rows: int) -> list[Array]:  # noqa: D102
        row = np.dtype([(f"{k}", self.order + column.kind, (column.many,)) for k, column in enumerate(columns)])
        table = np.frombuffer(self.body, row, rows, self.at)
        self.at += rows * row.itemsize
        return [table[name] for name in row.names or ()]

    def at_places(self, column: Column, places: Integers, rows: Integers) -> Array:  # noqa: D102
        parts = np.frombuffer(self.body, np.uint8)[places[:, None] + np.arange(self.size(column.kind))]
        return parts.ravel().view(self.order + column.kind)
