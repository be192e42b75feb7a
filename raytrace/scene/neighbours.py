"""Finds objects of a mesh whose boxes meet, and their triangles that can be near each other."""

import math

import numpy as np

from raytrace.records import Mesh
from raytrace.scene.facets import Reals, Rows


class Objects:
    """The objects of a mesh; all coordinates are scaled by a power of two, so that the largest is about 1.

    Parameters
    ----------
    mesh : Mesh

    Attributes
    ----------
    first, end : (n,) int64
        Rows of the faces of each object: first <= row < end.
    low, high : (n, 3) float64
        Their boxes.
    largest : (n,) float64
        Their largest coordinates.
    scale : float
        World units of 1.
    """

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self.first = np.flatnonzero(np.diff(mesh.object_id, prepend=-1))
        self.end = np.append(self.first[1:], len(mesh.faces))
        lows, highs = [], []
        for k in range(3):
            corner = np.ascontiguousarray(mesh.vertices[mesh.faces[:, k]].T)
            lows.append(np.minimum.reduceat(corner, self.first, axis=1))
            highs.append(np.maximum.reduceat(corner, self.first, axis=1))
        low, high = np.minimum.reduce(lows).T, np.maximum.reduce(highs).T
        largest = max(float(np.abs(low).max()), float(np.abs(high).max()), np.finfo(np.float64).tiny)
        self.scale = 2.0 ** math.floor(math.log2(largest))
        self.low, self.high = low / self.scale, high / self.scale
        self.largest = np.maximum(np.abs(self.low), np.abs(self.high)).max(axis=1)

    def near(self, one: int, error: float) -> Rows:
        """Return the other objects whose boxes meet that of an object, within a relative error of each."""
        pad = error * np.maximum(self.largest, self.largest[one])[:, None]
        meets = ((self.high >= self.low[one] - pad) & (self.low <= self.high[one] + pad)).all(axis=1)
        meets[one] = False
        return np.flatnonzero(meets)

    def clipped(self, one: int, two: int, error: float) -> tuple[Rows, Rows]:
        """Return the faces of two objects that meet the intersection of their boxes, within a relative error."""
        pad = error * max(self.largest[one], self.largest[two])
        b, low, high = self._within(two, self.low[one] - pad, self.high[one] + pad)
        a, low, high = self._within(one, low - pad, high + pad)
        b, _, _ = self._within(two, low - pad, high + pad)
        return a, b

    def _within(self, one: int, low: Reals, high: Reals) -> tuple[Rows, Reals, Reals]:
        """Return the faces of an object that meet a box, and the part of the box that they reach."""
        rows = np.arange(self.first[one], self.end[one])
        if (self.low[one] >= low).all() and (self.high[one] <= high).all():
            return rows, self.low[one], self.high[one]
        corners = self.corners(rows)
        lows, highs = np.minimum.reduce(corners), np.maximum.reduce(corners)
        kept = ((highs >= low[:, None]) & (lows <= high[:, None])).all(axis=0)
        if not kept.any():
            return rows[:0], low, high
        low, high = np.maximum(low, lows[:, kept].min(axis=1)), np.minimum(high, highs[:, kept].max(axis=1))
        return rows[kept], low, high

    def corners(self, rows: Rows) -> Reals:
        """Return the corners of triangles, (3 corners, 3 axes, m)."""
        places = [np.ascontiguousarray(self.mesh.vertices[self.mesh.faces[rows, k]].T) for k in range(3)]
        return np.stack(places) / self.scale

    def doubled(self, one: int) -> tuple[Rows, Rows]:
        """Return pairs of triangles of one object that have the same corners: two layers."""
        rows = np.arange(self.first[one], self.end[one])
        faces = self.mesh.faces[rows]
        lowest = int(faces.min())
        points = self.mesh.vertices[lowest : int(faces.max()) + 1] + 0.0  # -0 and 0 are one position
        bits = points.view(np.uint64)
        number = np.zeros(len(points), np.uint64)
        for axis in range(3):
            number = (number ^ bits[:, axis]) * np.uint64(0x9E3779B97F4A7C15)
            number ^= number >> np.uint64(29)
        key = number[faces[:, 0] - lowest] + number[faces[:, 1] - lowest] + number[faces[:, 2] - lowest]
        order = np.argsort(key)
        same = np.flatnonzero(key[order][1:] == key[order][:-1])
        return rows[order[same]], rows[order[same + 1]]
