"""Charts: the sphere of directions as a square, fine around an axis; and integrals over the cells of its grid."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import OptionError
from raytrace.record_display import displayed

F8 = NDArray[np.float64]
Function = Callable[[F8], F8]  # of unit directions (n, 3)


@displayed
class Chart(NamedTuple):
    """Coordinates (x, y) of [0, 1)^2 for directions.

    The tangent of half the angle to the axis is width sqrt(x / (1 - x)); y is the azimuth. With width 1 all cells of a
    grid have the same solid angle; a narrow lobe needs a width near its own.
    """

    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    width: float = 1.0
    side: int = 0  # 0: all directions; 1: those with z > 0; -1: those with z < 0

    def checked(self) -> Chart:
        """Return the chart with its axis made unit; an OptionError where it is none."""
        axis = np.asarray(self.axis, np.float64)
        length = np.linalg.norm(axis)
        if axis.shape != (3,) or not (np.isfinite(length) and length > 0):
            raise OptionError(f"charts: axis: expected three numbers that are not all 0, got {self.axis!r}")
        if not 0 < self.width < np.inf or self.side not in (-1, 0, 1):
            raise OptionError(f"charts: expected a width above 0 and a side of -1, 0 or 1, got {self[1:]!r}")
        return self._replace(axis=tuple((axis / length).tolist()))

    def frame(self) -> F8:
        """Two vectors across the axis, and the axis."""
        axis = np.asarray(self.axis)
        side = np.cross(axis, [1.0, 0, 0] if abs(axis[0]) < 0.5 else [0, 1.0, 0])
        side /= np.linalg.norm(side)
        return np.stack([side, np.cross(axis, side), axis])

    def directions(self, x: F8, y: F8) -> tuple[F8, F8]:
        """Directions, and the solid angle per area of the chart: 4 pi width^2 / ((1 - x) (1 + tan^2))^2."""
        tan2 = self.width**2 * x / (1 - x)
        sin, cos = 2 * np.sqrt(tan2) / (1 + tan2), (1 - tan2) / (1 + tan2)
        local = np.stack([sin * np.cos(2 * np.pi * y), sin * np.sin(2 * np.pi * y), cos], axis=-1)
        return local @ self.frame(), 4 * np.pi * self.width**2 / ((1 - x) * (1 + tan2)) ** 2

    def coordinates(self, directions: F8) -> tuple[F8, F8]:
        """Coordinates of unit directions."""
        local = directions @ self.frame().T
        tan2 = (local[:, 0] ** 2 + local[:, 1] ** 2) / (1 + np.maximum(local[:, 2], -1 + 1e-12)) ** 2
        return tan2 / (tan2 + self.width**2), np.arctan2(local[:, 1], local[:, 0]) / (2 * np.pi) % 1

    def horizon(self, y: F8) -> F8:
        """The x from which on directions lie on the other side of z = 0 than the axis."""
        frame = self.frame() * (1.0 if self.axis[2] > 0 else -1.0)
        slope = frame[0, 2] * np.cos(2 * np.pi * y) + frame[1, 2] * np.sin(2 * np.pi * y)
        tan2 = np.tan((np.arctan2(slope, frame[2, 2]) + np.pi / 2) / 2) ** 2
        return np.asarray(tan2 / (tan2 + self.width**2))


def counts(chart: Chart, directions: F8, bins: int) -> NDArray[np.int64]:
    """Number of unit directions in each cell of a grid of bins x bins; those of the other side are in none."""
    if chart.side:
        directions = directions[directions[:, 2] * chart.side > 0]
    x, y = chart.coordinates(directions)
    cell = np.minimum((x * bins).astype(int), bins - 1) * bins + np.minimum((y * bins).astype(int), bins - 1)
    return np.bincount(cell, minlength=bins**2)


def cell_integrals(function: Function, chart: Chart, bins: int, cells: NDArray[np.int64], fine: int) -> F8:
    """Integral of a function over cells of a grid of bins x bins.

    Gauss's quadrature with fine^2 nodes in each piece of a cell: in x it is cut at the horizon, where functions of
    surfaces jump.
    """
    nodes, weights = np.polynomial.legendre.leggauss(fine)
    nodes, weights = (nodes + 1) / 2, weights / 2
    start, y = (cells // bins)[:, None] / bins, ((cells % bins)[:, None] + nodes) / bins  # (c, 1), (c, fine)
    end = start + 1 / bins
    cut = np.clip(chart.horizon(y), start, end)
    before = chart.side == 0 or (chart.axis[2] > 0) == (chart.side > 0)
    pieces = [(np.broadcast_to(start, cut.shape), cut)] if before else []
    if chart.side == 0 or not before:
        pieces.append((cut, np.broadcast_to(end, cut.shape)))
    total = np.zeros(len(cells))
    for low, high in pieces:
        some = (high > low).any(axis=1)  # cells that this side has
        if not some.any():
            continue
        a, b, across = low[some], high[some], y[some]
        x = a[..., None] + (b - a)[..., None] * nodes  # (c, fine, fine)
        directions, angle = chart.directions(x.ravel(), np.broadcast_to(across[..., None], x.shape).ravel())
        inner = (function(directions) * angle).reshape(x.shape) @ weights * (b - a)
        total[some] += inner @ weights / bins
    return total


def expected_counts(function: Function, chart: Chart, bins: int, n: int, finest: int) -> F8:
    """Expected counts of n samples in all cells; those that n samples could tell from another grid's are refined."""
    cells, fine = np.arange(bins**2), 8
    expected = n * cell_integrals(function, chart, bins, cells, fine)
    while len(cells) and fine < finest:
        fine *= 2
        better = n * cell_integrals(function, chart, bins, cells, fine)
        unsure = np.abs(better - expected[cells]) > 0.03 * np.sqrt(np.maximum(better, 0)) + 1e-3
        expected[cells], cells = better, cells[unsure]
    return expected
