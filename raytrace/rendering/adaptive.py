"""Where the next samples go, so that the error of the picture falls below a target with as few as possible."""

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.lanes import PACKET
from raytrace.passes.edges import edges, weigh
from raytrace.passes.estimate import Model
from raytrace.passes.film import BINS, Film
from raytrace.records import Window
from raytrace.rendering.work_items import WorkItem, grown, inverse

FIRST = 4  # samples of every pixel before any decision
CAP = 4096  # samples of a pixel unless the caller says how many
LEAP = 2  # doublings of a pixel's samples that are risked at a time
LUCK = 0.5  # contrasts that what the neighbours foretell of a pixel counts for: its own alone are too often lucky
EDGE = 0.2  # what they foretell: variance of one sample, where an edge runs between neighbours so far apart; measured
AIM = 0.9  # of the squared error that is left: what falls short by a little costs a round
MEMORY = 7.0  # contrasts that what is known of a pixel counts for at most when a round adds three
EIGHTHS = 49  # bits of a float64 below its exponent and three binary digits: eight bins an octave
OCTAVES = 64  # of ratios that are told apart: what is smaller counts for nothing


class AdaptiveSampler:
    """What is known of the error of every pixel, and where samples go next.

    Parameters
    ----------
    film : Film
        Of the pixels ``at``.
    at : (m,) array of int
        Their places in the window, row after row.
    window : Window
    model : Model
        Of the sampler.
    target : float
        Error of the picture that is wanted.
    cap : int
        Samples that no pixel exceeds.

    Attributes
    ----------
    error : float
        Estimated RMSE of the picture as shown; NaN before anything is known.
    """

    def __init__(
        self, film: Film, at: NDArray[np.int64], window: Window, model: Model, target: float, cap: int
    ) -> None:
        self.film, self.model, self.target, self.cap, self.error = film, model, target, cap, float("nan")
        self._at, self._place, self._width = at, inverse(at), window.width
        self._columns = -(-(window.width + 2) // PACKET) * PACKET
        y, x = np.divmod(at, window.width)
        self._spot = (y + 2) * self._columns + x + 1
        size = (window.height + 4) * self._columns
        self._picture, self._edges = np.zeros((3, size)), np.zeros((3, size))
        self._samples = np.zeros(len(at), np.int32)
        self._scale, self._told = np.zeros((2, len(at)))  # error ~ scale samples^-order, and contrasts that said so
        self._known = np.zeros((3, len(at) + PACKET))  # error, and by what neighbours' differences count
        self._error = np.zeros(len(at) + PACKET)
        self._new: NDArray[np.int64] | slice = np.s_[:]

    def show(self, pixels: NDArray[np.int64] | slice, shown: NDArray[np.float64]) -> None:
        """Take in means of pixels of the film as shown, (3, m)."""
        spot = self._spot[pixels]
        for channel, values in zip(self._picture, shown, strict=True):
            channel[spot] = values[: len(spot)]

    def parts(self, at_least: int = 0) -> list[WorkItem]:
        """Take in what the last round found; what to draw next, or nothing if the target is met or none may have more.

        A part has at least so many pixels, where so many want the same.

        All sums are over pixels in the order of the picture, so that they do not depend on that of the film.
        """
        self._take_in(self._new)
        self._mark()
        weigh(self._edges.reshape(-1), self._columns, self._known.reshape(-1), self._width, self._error)
        error = self._error[: len(self._at)]
        self.error = float(np.sqrt(error.mean()))
        doublings = choose(error, self._samples, self.target, self.cap, self.model.order)
        self._new = new = np.flatnonzero(doublings)
        chosen = np.sort(self._place[new])
        before, times = self.film.samples[chosen], doublings[self._at[chosen]]
        return list(grown(chosen, before, np.minimum(before << times, self.cap), at_least))

    def _take_in(self, new: NDArray[np.int64] | slice) -> None:
        """What is known of pixels of the picture that were drawn again: the mean of all rounds, but for the oldest."""
        place = self._place[new]
        self._samples[new] = n = self.film.samples[place]
        n = n[: 1 if (n == n[0]).all() else None].astype(np.float64)  # the same arithmetic on fewer numbers
        rises, before, told = n**self.model.order, self._told[new], np.where(n < BINS * self.model.block, 1.0, 3.0)
        scale = (before * self._scale[new] + told * self.film.error[place] * rises) / (before + told)
        told = np.minimum(before + told, MEMORY)
        self._scale[new], self._told[new] = scale, told
        share = 1 / (rises * (told + LUCK))
        own, between, step = self._known[:, : len(self._at)]
        own[new], between[new], step[new] = told * scale * share, LUCK * EDGE * share, 1 / (9 * n**3)

    def _mark(self) -> None:
        """Note where the picture has edges: the largest differences of pixels from their neighbours, in any round.

        All squared and summed over the channels. A pixel that lies half on either side of an edge is not bent, but its
        neighbours are.
        """
        rows = self._picture.reshape(3, -1, self._columns)[..., : self._width + 2]
        _extend(rows.transpose(2, 0, 1)[:, :, 2:-2])
        _extend(rows.transpose(1, 0, 2)[1:-1])
        edges(self._picture.reshape(-1), self._columns, *self._edges)
        bends = self._edges[1].reshape(-1, self._columns)
        bends[:, 0] = bends[:, self._width + 1] = 0.0  # beside the picture


def _extend(rows: NDArray[np.float64]) -> None:
    """Give the first and the last row what an even slope would have there."""
    for edge, inner, further in ((0, 1, 2), (-1, -2, -3)):
        rows[edge] = 2 * rows[inner] - rows[further if len(rows) > 3 else inner]


def choose(
    error: NDArray[np.float64], samples: NDArray[np.int32], target: float, cap: int, order: float
) -> NDArray[np.int32]:
    """How many times the samples of each pixel are doubled next; nowhere if the target is met, or none may have more.

    Parameters
    ----------
    error : (m,) array
        Estimated squared error of each pixel, ~ samples^-order.
    samples : (m,) array
    target : float
        Root of the mean squared error that is wanted.
    cap : int
        Samples that no pixel exceeds. Where pixels at the cap spoil the mean, the others are to meet the target alone.
    order : float

    Notes
    -----
    The fewest samples n whose sum of error meets a bound have the same gain per sample everywhere, error / n = level
    with the error at n (Lagrange). Where that is so at n = samples (error / samples / level)^(1 / (order + 1)), n is
    rounded to doublings, and judged anew when they are drawn; at last only as many are doubled as suffice. The level is
    found from sums over pixels whose error / samples are equal to an eighth of an octave.
    """
    able = samples < cap
    left, budget = error, target**2 * len(error)
    if not able.all():
        left = np.where(able, error, 0.0)
        budget -= float((error - left).sum())
    if budget <= 0:
        budget = target**2 * max(int(able.sum()), 1)
    if not left.sum() > budget:  # nor where nothing is known
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
    often = level * 2.0 ** ((order + 1) * (np.arange(LEAP) + 0.5))  # from where on n is nearer to one more doubling
    enough = np.flatnonzero(2.0**-order * np.cumsum(sums) + rest <= budget)
    first = float(lowest[enough[0]]) if len(enough) else 0.0
    often = np.maximum(often, first)
    if often[0] > ratio.max():
        often[0] = first
    doublings = np.zeros(len(error), np.int32)
    for least_ratio in often:
        doublings += able & (ratio >= least_ratio)
    return doublings
