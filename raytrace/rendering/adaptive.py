"""Adaptive sampling: choose where the next samples go, to reach a target error with as few samples as possible."""

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.lanes import PACKET
from raytrace.passes.edges import edges, weigh
from raytrace.passes.estimate import Model
from raytrace.passes.film import BINS, Film
from raytrace.records import Window
from raytrace.rendering.film_tiles import WorkItem, grown, inverse

FIRST = 4  # samples of every pixel before any decision
CAP = 4096  # most samples of a pixel by default
LEAP = 2  # most doublings of a pixel's samples in one round
LUCK = 0.5  # weight of the neighbours' prediction, in contrasts: a pixel's own are too often small by luck
EDGE = 0.2  # predicted variance of one sample over the squared difference of the neighbours; measured
AIM = 0.9  # of the squared error that is allowed: missing the target by a little would cost one more round
MEMORY = 7.0  # cap on the weight of past rounds, in contrasts; one round adds three
EIGHTHS = 49  # bits of a float64 below its exponent and three binary digits: eight bins per octave
OCTAVES = 64  # of ratios that are distinguished: smaller ones count as the smallest


class AdaptiveSampler:
    """Estimates the error of every pixel, and chooses the pixels that get more samples.

    Parameters
    ----------
    film : Film
    at : (m,) array of int
        Position of each pixel of the film in the window, row by row.
    window : Window
    model : Model
        Error model of the sampler.
    target : float
        Target error of the image.
    cap : int
        Most samples of a pixel.

    Attributes
    ----------
    error : float
        Estimated RMSE of the image as shown; NaN before the first round.
    """

    def __init__(
        self, film: Film, at: NDArray[np.int64], window: Window, model: Model, target: float, cap: int
    ) -> None:
        self.film, self.model, self.target, self.cap, self.error = film, model, target, cap, float("nan")
        self._at, self._index, self._width = at, inverse(at), window.width
        self._columns = -(-(window.width + 2) // PACKET) * PACKET
        y, x = np.divmod(at, window.width)
        self._padded = (y + 2) * self._columns + x + 1
        size = (window.height + 4) * self._columns
        self._image, self._edges = np.zeros((3, size)), np.zeros((3, size))
        self._samples = np.zeros(len(at), np.int32)
        self._scale, self._weight = np.zeros((2, len(at)))  # error ~ scale samples^-order; its weight, in contrasts
        self._terms = np.zeros((3, len(at) + PACKET))  # the pixel's own error, and factors of neighbours' differences
        self._error = np.zeros(len(at) + PACKET)
        self._new: NDArray[np.int64] | slice = np.s_[:]

    def show(self, pixels: NDArray[np.int64] | slice, shown: NDArray[np.float64]) -> None:
        """Receive means of pixels of the film as shown, (3, m)."""
        padded = self._padded[pixels]
        for channel, values in zip(self._image, shown, strict=True):
            channel[padded] = values[: len(padded)]

    def work_items(self, at_least: int = 0) -> list[WorkItem]:
        """Update the estimates after a round; return the next work items.

        There are none if the target is met, or if every pixel that needs more samples has reached the cap. A work item
        has at least so many pixels, where so many get the same samples. All sums are over pixels in the order of the
        image, so that they do not depend on their order in the film.
        """
        self._update(self._new)
        self._find_edges()
        weigh(self._edges.reshape(-1), self._columns, self._terms.reshape(-1), self._width, self._error)
        error = self._error[: len(self._at)]
        self.error = float(np.sqrt(error.mean()))
        doublings = choose(error, self._samples, self.target, self.cap, self.model.order)
        self._new = new = np.flatnonzero(doublings)
        chosen = np.sort(self._index[new])
        before, times = self.film.samples[chosen], doublings[self._at[chosen]]
        return list(grown(chosen, before, np.minimum(before << times, self.cap), at_least))

    def _update(self, new: NDArray[np.int64] | slice) -> None:
        """Update the estimates of pixels that got more samples: averages over all rounds but the oldest."""
        index = self._index[new]
        self._samples[new] = n = self.film.samples[index]
        n = n[: 1 if (n == n[0]).all() else None].astype(np.float64)  # the same arithmetic on fewer numbers
        growth, before, added = n**self.model.order, self._weight[new], np.where(n < BINS * self.model.block, 1.0, 3.0)
        scale = (before * self._scale[new] + added * self.film.error[index] * growth) / (before + added)
        weight = np.minimum(before + added, MEMORY)
        self._scale[new], self._weight[new] = scale, weight
        share = 1 / (growth * (weight + LUCK))
        own, between, step = self._terms[:, : len(self._at)]
        own[new], between[new], step[new] = weight * scale * share, LUCK * EDGE * share, 1 / (9 * n**3)

    def _find_edges(self) -> None:
        """Update the edges of the image: the largest differences of pixels from their neighbours in any round.

        They are squared and summed over the channels. A pixel that an edge cuts in half has no second difference, but
        its neighbours have one.
        """
        rows = self._image.reshape(3, -1, self._columns)[..., : self._width + 2]
        _extend(rows.transpose(2, 0, 1)[:, :, 2:-2])
        _extend(rows.transpose(1, 0, 2)[1:-1])
        edges(self._image.reshape(-1), self._columns, *self._edges)
        bends = self._edges[1].reshape(-1, self._columns)
        bends[:, 0] = bends[:, self._width + 1] = 0.0  # outside the image


def _extend(rows: NDArray[np.float64]) -> None:
    """Fill the first and the last row by linear extrapolation."""
    for edge, inner, further in ((0, 1, 2), (-1, -2, -3)):
        rows[edge] = 2 * rows[inner] - rows[further if len(rows) > 3 else inner]


def choose(
    error: NDArray[np.float64], samples: NDArray[np.int32], target: float, cap: int, order: float
) -> NDArray[np.int32]:
    """Choose how many times the samples of each pixel are doubled next: 0 if the target is met or all are at the cap.

    Parameters
    ----------
    error : (m,) array
        Estimated squared error of each pixel, ~ samples^-order.
    samples : (m,) array
    target : float
        Target of the root mean squared error.
    cap : int
        Most samples of a pixel. Where pixels at the cap alone exceed the target, the other pixels must meet it without
        them.
    order : float

    Notes
    -----
    With the fewest samples n for a given sum of errors, the gain per sample is the same everywhere: error / n = level,
    with the error at n (Lagrange). This holds at n = samples (error / samples / level)^(1 / (order + 1)). Each n is
    rounded to doublings, and the next round starts again from the new estimates. In the last round only as many pixels
    are doubled as are needed. The level comes from sums over pixels whose error / samples are equal to an eighth of an
    octave.
    """
    able = samples < cap
    left, budget = error, target**2 * len(error)
    if not able.all():
        left = np.where(able, error, 0.0)
        budget -= float((error - left).sum())
    if budget <= 0:
        budget = target**2 * max(int(able.sum()), 1)
    if not left.sum() > budget:  # also where errors are unknown (NaN)
        return np.zeros(len(error), np.int32)
    budget *= AIM
    ratio = left / samples
    bins = ratio.view(np.int64) >> EIGHTHS
    least = max(int(bins.max()) - 8 * OCTAVES, 0)
    bins -= least
    sums = np.bincount(np.maximum(bins, 0, out=bins), left)[::-1]  # of the largest ratios first
    lowest = ((np.arange(len(sums))[::-1] + least) << EIGHTHS).view(np.float64)
    middle = lowest * (1 + 1 / 16)
    rest = float(sums.sum()) - np.cumsum(sums)  # of all smaller ratios
    share = order / (order + 1)
    taken = np.cumsum(sums * middle**-share)  # of these and all larger ratios, at the level 1
    met = np.flatnonzero(taken * middle**share + rest <= budget)
    last = max(int(met[0]) - 1, 0) if len(met) else len(sums) - 1
    level = (max(budget - rest[last], np.finfo(float).tiny) / taken[last]) ** (1 / share)
    # above the k-th of these ratios, n is nearer to k + 1 doublings
    limits = level * 2.0 ** ((order + 1) * (np.arange(LEAP) + 0.5))
    enough = np.flatnonzero(2.0**-order * np.cumsum(sums) + rest <= budget)
    first = float(lowest[enough[0]]) if len(enough) else 0.0
    limits = np.maximum(limits, first)
    if limits[0] > ratio.max():
        limits[0] = first
    doublings = np.zeros(len(error), np.int32)
    for least_ratio in limits:
        doublings += able & (ratio >= least_ratio)
    return doublings
