"""The bias of float32: the error that no number of samples removes, measured against float64 with the same samples."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.reporting.intervals import student

MOST = 8  # differences of images that are kept


class Floor(NamedTuple):
    """RMSE (sRGB) of float32 that remains with any number of samples."""

    rmse_srgb: float  # estimate; 0: the differences look like noise alone
    high: float  # one-sided upper limit at 97.5 %, the upper end of a 95 % interval; NaN: one render is not enough
    spp: float  # samples per pixel of the images
    renders: int

    @property
    def text(self) -> str:
        """A sentence on the floor."""
        basis = f"float32 against float64 with the same samples, {self.renders} renders of {self.spp:g} spp"
        if self.renders < 2:
            return f"The bias floor of float32 is unknown: it takes two renders of both precisions ({basis})."
        if self.rmse_srgb == 0.0:
            return f"The bias floor of float32 is below RMSE (sRGB) {self.high:.1e} ({basis})."
        return f"The bias floor of float32 is RMSE (sRGB) {self.rmse_srgb:.1e}, at most {self.high:.1e} ({basis})."


def floor_of(differences: Sequence[NDArray[np.floating]], spp: float) -> Floor:
    """Estimate the bias floor from differences of images in float32 and float64.

    Parameters
    ----------
    differences : sequence of (h, w, 3) arrays
        sRGB codes in float32 minus those in float64, with equal samples; each with another seed.
    spp : float
        Samples per pixel of the images.

    Returns
    -------
    Floor

    Notes
    -----
    Difference i is ``D_i = b + e_i``: the bias b of each pixel, and noise of mean 0, as from a ray that passes an
    edge on the other side. With k seeds, and <x, y> the mean of x y over pixels and channels,
    ``U = sum_(i != j) <D_i, D_j> / (k (k - 1))`` is an unbiased estimate of <b, b>, because e_i and e_j are
    independent: a U-statistic [Hoeffding1948]. The floor is sqrt(max(U, 0)). The jackknife [Efron1982] gives the
    standard error: ``s^2 = (k - 1) / k sum_i (U_(-i) - mean)^2``, U_(-i) without difference i. The upper limit is
    ``sqrt(max(U, 0) + t(k - 1) s)``. With two seeds, which leave no pair without one of them, it is the RMS of all
    differences, which is never below the floor on average: <b + e, b + e> = <b, b> + <e, e>.

    Examples
    --------
    >>> round(floor_of([np.full((2, 2, 3), 1e-3)] * 4, 256).rmse_srgb, 6)
    0.001
    """
    k = len(differences)
    flat = np.array([np.asarray(each, np.float64).ravel() for each in differences])
    gram = flat @ flat.T / flat.shape[1]
    whole = math.sqrt(max(float(np.trace(gram)) / k, 0.0))
    if k < 2:
        return Floor(whole, math.nan, spp, k)
    off = gram - np.diag(np.diag(gram))
    total = float(off.sum())
    squared = max(total / (k * (k - 1)), 0.0)
    if k == 2:
        return Floor(math.sqrt(squared), whole, spp, k)
    without = (total - 2 * off.sum(axis=1)) / ((k - 1) * (k - 2))
    error = math.sqrt((k - 1) / k * float(((without - without.mean()) ** 2).sum()))
    return Floor(math.sqrt(squared), math.sqrt(squared + student(k) * error), spp, k)


class PrecisionPairs:
    """Collects images of both precisions with the same samples, at the largest number of samples that both have."""

    def __init__(self) -> None:
        self.gaps: dict[int, float] = {}  # spp -> RMSE (sRGB) between the precisions, of the first render
        self._waiting: dict[tuple[int, int], tuple[str, NDArray[np.float64]]] = {}
        self._spp, self._differences = 0, list[NDArray[np.float32]]()

    def add(self, precision: str, spp: int, number: int, codes: NDArray[np.float64]) -> None:
        """Add render `number` in a precision; `codes` are its sRGB codes."""
        if number and (spp != self._spp or number >= MOST):
            return
        other = self._waiting.pop((spp, number), None)
        if other is None:
            self._waiting = {key: value for key, value in self._waiting.items() if key[0] == spp}
            self._waiting[spp, number] = precision, codes
            return
        sign = 1.0 if precision == "float32" else -1.0
        difference = sign * (codes - other[1])
        if number == 0:
            self.gaps[spp] = float(np.sqrt(np.mean(difference**2)))
            if spp < self._spp:
                return
            self._spp, self._differences = spp, []
        self._differences.append(difference.astype(np.float32))

    @property
    def floor(self) -> Floor | None:
        """The bias floor; None if there was no pair."""
        return floor_of(self._differences, self._spp) if self._differences else None
