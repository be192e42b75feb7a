"""Where the next samples go, so that the error of the picture falls below a target with as few as possible."""

import numpy as np
from numpy.typing import NDArray

FIRST = 4  # samples of every pixel before any decision: one in each bin of the film
CAP = 4096  # samples of a pixel unless the caller says how many
MEMORY = 0.7  # of what is known of a pixel is kept when a round adds to it: three contrasts alone are too often lucky


def hidden(picture: NDArray[np.floating], samples: NDArray[np.int32]) -> NDArray[np.float64]:
    """Squared error that n samples may hide though they agree, (h, w): (largest step to a neighbour)^2 / (3 n^3).

    An edge that enters the pixel by an area a is missed by n evenly spread samples if a < 1 / n. With areas evenly
    distributed that has the probability 1 / n, and (a step)^2 is then step^2 / (3 n^2) on average. Whatever is near
    can be seen in the neighbours: edges of shapes, of shadows and of what glass shows.

    Parameters
    ----------
    picture : (h, w, 3) float32 array
        As shown: sRGB, 0..1.
    samples : (h, w) array
    """
    padded = np.pad(picture, ((1, 1), (1, 1), (0, 0)), "edge")
    step = np.maximum(_around(padded, np.maximum) - picture, picture - _around(padded, np.minimum))
    step *= step
    return (step[..., 0] + step[..., 1] + step[..., 2]) / (9.0 * samples.astype(np.float64) ** 3)


def _around(padded: NDArray[np.floating], extreme: np.ufunc) -> NDArray[np.floating]:
    """Extreme of the 3 x 3 pixels around each."""
    rows = extreme(extreme(padded[:-2], padded[1:-1]), padded[2:])
    return extreme(extreme(rows[:, :-2], rows[:, 1:-1]), rows[:, 2:])


def choose(
    error: NDArray[np.float64], samples: NDArray[np.int32], target: float, cap: int, order: float
) -> NDArray[np.int64]:
    """Pixels whose samples are doubled next; none where the target is met, or no pixel may have more.

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
    The fewest samples n whose sum of error meets a bound have the same gain per sample everywhere, error n^-1 = level
    with error taken at n (Lagrange). A pixel is at n = samples (error / samples / level)^(1 / (order + 1)) then;
    where that is nearer to twice than to what it has, it is doubled and judged anew; at last only as many as suffice.
    """
    able = np.flatnonzero((samples < cap) & (error > 0))
    budget = target**2 * len(error) - error[samples >= cap].sum()
    if budget <= 0:
        budget = target**2 * max(int((samples < cap).sum()), 1)
    if error[able].sum() <= budget:
        return able[:0]
    growth = np.log(error[able] / samples[able]) / (order + 1)  # of the logarithm of samples, minus that of the level
    by_growth = np.argsort(-growth, kind="stable")
    able, growth = able[by_growth], growth[by_growth]
    error = error[able]
    grown = np.cumsum(error * np.exp(-order * growth))  # of the first k pixels, all taken to the level 1
    rest = error.sum() - np.cumsum(error)
    met = np.flatnonzero(grown * np.exp(order * growth) + rest <= budget)
    last = max(met[0] - 1, 0) if len(met) else len(able) - 1
    level = np.log(max(budget - rest[last], np.finfo(float).tiny) / grown[last]) / order
    many = int((growth > level + np.log(2.0) / 2).sum()) or len(able)
    enough = np.flatnonzero(2.0**-order * np.cumsum(error) + rest <= budget)
    return able[: min(many, enough[0] + 1) if len(enough) else many]
