"""``chi_square``: whether directions have the density that a program states."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.errors import OptionError
from raytrace.record_display import displayed
from raytrace.testing.charts import F8, Chart, counts, expected_counts
from raytrace.testing.distributions import chi_square_tail, sidak
from raytrace.testing.outcome import StatisticalError, check_numbers, uniform

LEAST = 5.0  # expected samples per cell: cells with fewer are merged [Cochran1954]
STRAY = 40  # samples where none should be, of rounding and of quadrature that barely misses a cell


@displayed
class ChiSquare(NamedTuple):
    """Numbers of a chi-square test."""

    p_value: float  # probability of a statistic as large as this, if the samples have the density
    statistic: float
    degrees: int  # of freedom
    level: float  # below this p-value the test fails; corrected for the number of tests
    observed: NDArray[np.float64]  # (cells,): samples; cells that expect few are merged into the last one
    expected: NDArray[np.float64]  # (cells,)
    integral: float  # of the density over all directions: at most 1


def chi_square(
    sample: Callable[[F8], ArrayLike] | ArrayLike,
    pdf: Callable[[F8], ArrayLike],
    *,
    n: int = 100_000,
    dimensions: int = 2,
    charts: Sequence[Chart] = (Chart(),),
    bins: int = 12,
    finest: int = 64,
    level: float = 1e-3,
    tests: int = 1,
    seed: int = 0,
) -> ChiSquare:
    """Test whether sampled directions have a density, by Pearson's chi-square test on a grid of the sphere.

    Parameters
    ----------
    sample : callable or (n, 3) array-like
        From random numbers (n, dimensions) in [0, 1) to directions (n, 3) of any length; or such directions. A row of
        zeros or NaN is a sample that was rejected: the density then integrates to less than 1.
    pdf : callable
        From unit directions (m, 3) to densities (m,), 1 / sr.
    n : int
        Samples, where ``sample`` is a function.
    dimensions : int
        Random numbers per sample.
    charts : sequence of Chart
        Grids that cover the sphere without overlap. Default: one, of equal solid angles. A narrow lobe needs a chart
        about its axis with a width near its own: ``Chart((0, 0.6, 0.8), 0.05)``. Densities may jump at z = 0.
    bins : int
        Each grid has bins x bins cells.
    finest : int
        Quadrature nodes per side of a cell, at most.
    level : float
        Probability with which a right sampler may fail all ``tests`` together.
    tests : int
        Number of tests of this kind that you make; the level of each is corrected for it [Sidak1967].
    seed : int
        Of the random numbers.

    Returns
    -------
    ChiSquare

    Raises
    ------
    StatisticalError
        The p-value is below the corrected level; the error's ``result`` is the ChiSquare.
    OptionError
        An argument is not allowed, or a function returns arrays of the wrong shape.

    Examples
    --------
    A sampler of directions in proportion to the cosine, as many renderers have it:

    >>> import numpy as np, raytrace as rt
    >>> def sample(u):
    ...     r, phi = np.sqrt(u[:, 0]), 2 * np.pi * u[:, 1]
    ...     return np.stack([r * np.cos(phi), r * np.sin(phi), np.sqrt(1 - r * r)], axis=1)
    >>> rt.testing.chi_square(sample, lambda d: np.maximum(d[:, 2], 0) / np.pi).p_value > 0.001
    True
    >>> try:
    ...     rt.testing.chi_square(sample, lambda d: (d[:, 2] > 0) / (2 * np.pi))
    ... except AssertionError as error:
    ...     print(str(error)[:35])
    the samples do not have the density
    """
    drawn = callable(sample)
    directions = np.asarray(sample(uniform(n, dimensions, seed)) if callable(sample) else sample, np.float64)
    if directions.ndim != 2 or directions.shape[1] != 3 or (drawn and len(directions) != n):
        wanted = f"({n}, 3)" if drawn else "(n, 3)"
        raise OptionError(f"sample: expected directions of shape {wanted}, got {directions.shape}")
    check_numbers(len(directions), seed, level, tests)
    whole = [Chart(*chart).checked() for chart in charts]
    with np.errstate(invalid="ignore"):
        length = np.linalg.norm(directions, axis=1, keepdims=True)
        found = directions[length[:, 0] > 0] / length[length[:, 0] > 0]

    def density(at: F8) -> F8:
        values = np.asarray(pdf(at), np.float64)
        if values.shape != (len(at),):
            raise OptionError(f"pdf: expected {len(at)} densities, got shape {values.shape}")
        wrong = ~(np.isfinite(values) & (values >= 0))
        if wrong.any():
            k = int(np.argmax(wrong))
            raise OptionError(f"pdf: expected finite densities of at least 0, got {values[k]:g} at {at[k].tolist()}")
        return values

    expected = [expected_counts(density, chart, bins, len(directions), finest) for chart in whole]
    observed = [counts(chart, found, bins) for chart in whole]
    result = pearson(np.concatenate(observed), np.concatenate(expected), len(directions), sidak(level, tests))
    return _judged(result)


def _judged(result: ChiSquare) -> ChiSquare:
    if result.integral > 1.001:
        raise StatisticalError(f"the density integrates to {result.integral:.4f}: more than 1", result)
    if not result.p_value >= result.level:
        text = f"chi-square {result.statistic:.6g} with {result.degrees} degrees of freedom"
        chance = f"p = {result.p_value:.2g}, below {result.level:.2g}"
        raise StatisticalError(f"the samples do not have the density: {text}, {chance}", result)
    return result


def pearson(observed: ArrayLike, expected: ArrayLike, n: int, level: float = 1e-3) -> ChiSquare:
    """Numbers of Pearson's test of counts; what is in no cell is a cell of its own, and cells that expect few merge.

    Parameters
    ----------
    observed, expected : array-like
        Counts of the same cells.
    n : int
        Samples in all.
    level : float
        Kept in the record.

    Examples
    --------
    >>> round(pearson([30, 70], [50, 50], 100).p_value, 6)
    6.3e-05
    """
    seen, mean = np.ravel(observed).astype(np.float64), np.ravel(expected).astype(np.float64)
    integral = float(mean.sum() / n)
    seen, mean = np.append(seen, n - seen.sum()), np.append(mean, max(n - mean.sum(), 0.0))
    rare = mean < LEAST
    few, rest = float(seen[rare].sum()), float(mean[rare].sum())
    seen, mean = seen[~rare], mean[~rare]
    if rest >= LEAST:
        seen, mean = np.append(seen, few), np.append(mean, rest)
    elif few > STRAY:
        return ChiSquare(0.0, np.inf, max(len(mean), 1), level, np.append(seen, few), np.append(mean, rest), integral)
    statistic, degrees = float(((seen - mean) ** 2 / mean).sum()), max(len(mean) - 1, 0)
    return ChiSquare(chi_square_tail(statistic, degrees), statistic, degrees, level, seen, mean, integral)
