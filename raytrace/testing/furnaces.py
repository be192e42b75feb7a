"""``furnace``: whether a scattering function, its sampling and its density agree, and create no energy."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.errors import OptionError
from raytrace.record_display import displayed
from raytrace.testing.distributions import sidak, student_tails
from raytrace.testing.outcome import StatisticalError, check_numbers, uniform

CLOSE = 1e-5  # relative: weight times pdf against eval times cosine
CHECKS = 4  # statistical ones, for each angle and channel


class Scattering(Protocol):
    """A scattering function in the frame of its surface: z is the normal, directions point away from it."""

    def eval(self, wo: Any, wi: Any) -> ArrayLike:
        """Return f(wo, wi), (n,) or (n, 3), without the cosine."""

    def pdf(self, wo: Any, wi: Any) -> ArrayLike:
        """Return the density (n,) of ``sample``, 1 / sr."""

    def sample(self, wo: Any, u: Any) -> tuple[ArrayLike, ArrayLike, ArrayLike]:
        """Return directions (n, 3), weights f cos / pdf, and densities (n,), from random numbers (n, 3)."""


@displayed
class Furnace(NamedTuple):
    """Share of even light that a surface sends to the viewer, at each angle."""

    degrees: tuple[float, ...]  # of the viewer from the normal
    sampled: NDArray[np.float64]  # (angles, channels): mean weight of samples
    evaluated: NDArray[np.float64]  # (angles, channels): integral of f cos; without perfectly specular parts
    stderr: NDArray[np.float64]  # (2, angles, channels): of both
    integral: NDArray[np.float64]  # (angles,): of the density
    level: float  # of each of the tests


class Material:
    """A material of a scene as a scattering function."""

    def __init__(self, material: dict[str, Any]) -> None:
        from raytrace import bsdf

        self._material, self._bsdf = material, bsdf

    def eval(self, wo: Any, wi: Any) -> ArrayLike:
        """Return f(wo, wi)."""
        return self._bsdf.eval(self._material, wo, wi)

    def pdf(self, wo: Any, wi: Any) -> ArrayLike:
        """Return the density."""
        return self._bsdf.pdf(self._material, wo, wi)

    def sample(self, wo: Any, u: Any) -> tuple[ArrayLike, ArrayLike, ArrayLike]:
        """Return directions, weights and densities."""
        return self._bsdf.sample(self._material, wo, u)


def furnace(
    scattering: Scattering | dict[str, Any],
    *,
    degrees: ArrayLike = (0.0, 30.0, 60.0, 80.0),
    expected: ArrayLike | None = None,
    most: float = 1.0,
    n: int = 100_000,
    level: float = 1e-3,
    tests: int = 1,
    seed: int = 0,
) -> Furnace:
    """Put a surface into even light, and test its scattering function, its sampling and its density.

    For each angle of the viewer: the mean weight of samples, and the integral of f cos by uniform directions, agree; no
    more light leaves than arrives; the density integrates to 1 at most; weight times density is f cos.

    Parameters
    ----------
    scattering : object or dict
        With methods ``eval``, ``pdf`` and ``sample`` as those of ``rt.bsdf``, without the material; or a material as in
        a scene. Perfectly specular samples have the density inf, and are in the mean weight only.
    degrees : array-like
        Angles of the viewer from the normal, below 90.
    expected : array-like, optional
        The share of light that must leave, such as the albedo: for all angles, or (angles,) or (angles, channels).
    most : float
        The most that may leave. Behind an interface to a denser medium radiance is larger: n^2.
    n : int
        Samples for each angle, and as many uniform directions.
    level, tests, seed
        As for ``chi_square``.

    Returns
    -------
    Furnace

    Raises
    ------
    StatisticalError
        Names the first thing that is wrong, with the angle.
    OptionError
        An argument is not allowed.

    Examples
    --------
    >>> import raytrace as rt
    >>> found = rt.testing.furnace({"type": "diffuse", "albedo": [0.2, 0.5, 0.8]}, expected=[[0.2, 0.5, 0.8]])
    >>> found.sampled[0].round(6)
    array([0.2, 0.5, 0.8])
    """
    check_numbers(n, seed, level, tests)
    surface = Material(scattering) if isinstance(scattering, dict) else scattering
    if missing := [name for name in ("eval", "pdf", "sample") if not callable(getattr(surface, name, None))]:
        raise OptionError(f"scattering: expected a material or an object with eval, pdf and sample; no {missing[0]}")
    angles = np.atleast_1d(np.asarray(degrees, np.float64))
    if angles.ndim != 1 or not ((angles >= 0) & (angles < 90)).all() or not angles.size:
        raise OptionError(f"degrees: expected angles from 0 to below 90, got {degrees!r}")
    measured = [_measure(surface, angle, n, seed + k) for k, angle in enumerate(angles)]
    values, variances, integrals = (np.array([each[k] for each in measured]) for k in (0, 1, 2))
    corrected = sidak(level, tests * CHECKS * values[:, 0].size)
    result = Furnace(
        tuple(angles.tolist()),
        values[:, 0] + values[:, 2],
        values[:, 1],
        np.sqrt(np.stack([variances[:, 0], variances[:, 1]])),
        integrals[:, 0],
        corrected,
    )
    _check(result, values, variances, integrals, most)
    if expected is not None:
        right = np.asarray(expected, np.float64)
        right = right[:, None] if right.ndim == 1 and right.size == len(angles) else right
        error = result.sampled - right
        _reject(result, error, result.stderr[0] + 1e-9, "the share of light that leaves is not the expected one")
    return result


def _measure(surface: Scattering, angle: float, n: int, seed: int) -> tuple[Any, Any, Any]:
    """Return means, (3, channels): sampled, evaluated, specular; their variances; and integral of the density."""
    a = np.radians(angle)
    wo = np.broadcast_to([np.sin(a) * np.cos(0.7), np.sin(a) * np.sin(0.7), np.cos(a)], (n, 3))
    wi, weight, density = (np.asarray(each, np.float64) for each in surface.sample(wo, uniform(n, 3, seed)))
    weight = weight.reshape(n, -1)
    specular = np.isinf(density)
    usual = ~specular & (density > 0)
    f = np.asarray(surface.eval(wo, wi), np.float64).reshape(n, -1)[usual]
    product, right = weight[usual] * density[usual, None], f * np.abs(wi[usual, 2:])
    if not np.allclose(product, right, rtol=CLOSE, atol=1e-9):
        text = f"at {angle:g} degrees: weight times pdf is not f cos; the largest ratio is {_ratio(product, right):.4g}"
        raise StatisticalError(text, None)
    u = uniform(n, 2, seed ^ 0x55555555)
    z, phi = 1 - 2 * u[:, 0], 2 * np.pi * u[:, 1]
    s = np.sqrt(1 - z * z)
    even = np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=1)
    light = np.asarray(surface.eval(wo, even), np.float64).reshape(n, -1) * np.abs(even[:, 2:]) * 4 * np.pi
    spread = np.asarray(surface.pdf(wo, even), np.float64) * 4 * np.pi
    parts = weight * ~specular[:, None], light, weight * specular[:, None]
    whole = (weight.var(axis=0) / n, light.var(axis=0) / n, parts[0].var(axis=0) / n)
    return [part.mean(axis=0) for part in parts], whole, (spread.mean(), spread.var() / n)


def _ratio(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = a / b
    return float(ratio[np.isfinite(ratio)].max(initial=0))


def _check(result: Furnace, values: Any, variances: Any, integrals: Any, most: float) -> None:
    """Raise where sampling and evaluation disagree, or too much light leaves."""
    both = np.sqrt(variances[:, 2] + variances[:, 1]) + 1e-9
    _reject(
        result, values[:, 0] - values[:, 1], both, "sampling and eval disagree: mean weight minus integral of f cos"
    )
    rest = np.sqrt(variances[:, 0]) + 1e-9
    _reject(
        result, np.maximum(result.sampled - most - 1e-6, 0), rest, f"more light leaves than arrives, beyond {most:g}"
    )
    more = np.maximum(integrals[:, :1] - 1, 0)
    _reject(result, more, np.sqrt(integrals[:, 1:]) + 1e-9, "the density integrates to more than 1")


def _reject(result: Furnace, error: Any, stderr: Any, text: str) -> None:
    t = np.abs(error) / stderr
    at = np.unravel_index(int(np.argmax(t)), t.shape)
    p = student_tails(float(t[at]), np.inf)
    if not p >= result.level:
        numbers = f"{error[at]:+.4g}, {t[at]:.1f} standard errors; p = {p:.2g}, below {result.level:.2g}"
        raise StatisticalError(f"at {result.degrees[at[0]]:g} degrees: {text}: {numbers}", result)
