"""Likely causes of a difference: simple changes of the expected image that give the actual one."""

from collections.abc import Iterator
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from raytrace.image.files import srgb_encode

Light = NDArray[np.float64]  # (h, w, 3): linear light
REMAINS = 0.2  # a cause is named if it leaves at most this share of the difference (root mean square)
EXACT = 1e-3  # no candidate is better than one that leaves this share
SIMPLER = 0.5  # of one kind, a later candidate is named if it leaves less than this share of what a simpler one leaves
AS_LIKELY = 0.02  # causes of several kinds are named if what they leave differs by less than this
FARTHEST = 2  # pixels: the largest shift that is tried
CLOSE = 0.01  # relative: a factor this close to a known one is named after it
FACTORS = {
    np.pi: "pi",
    1 / np.pi: "1 / pi",
    2 * np.pi: "2 pi",
    4 * np.pi: "4 pi",
    1 / (4 * np.pi): "1 / (4 pi)",
    255.0: "255, the range of 8 bits",
    1 / 255: "1 / 255, the range of 8 bits",
    2.25: "2.25 = 1.5^2, the index of glass squared",
    1 / 2.25: "1 / 2.25 = 1 / 1.5^2, the index of glass squared",
}
CHANNELS = "red", "green", "blue"
EVERYWHERE = slice(None), slice(None)
Codes = NDArray[np.float64]  # (h, w, 3): sRGB codes that are not clipped
Candidate = tuple[str, str, Codes, tuple[slice, slice]]  # kind, what was done, its codes, where in the actual image


def likely_causes(actual: Light, expected: Light) -> list[str]:
    """Sentences that name what was probably done to an image, the most likely first; empty: nothing simple.

    Parameters
    ----------
    actual, expected : (h, w, 3) array
        Linear light of the same size. Pixels that are not finite count as equal.

    Notes
    -----
    Each candidate changes the expected image. Its difference to the actual image is measured as root mean square of
    sRGB codes that are not clipped, which weighs dark and bright pixels similarly.

    Examples
    --------
    >>> ramp = np.linspace(0, 1, 12 * 16 * 3).reshape(12, 16, 3)
    >>> likely_causes(ramp[:, ::-1], ramp)
    ['it is flipped left to right']
    >>> likely_causes(1.25 * ramp, ramp)
    ['all light is multiplied by 1.25']
    >>> likely_causes(ramp, ramp)
    []
    """
    finite = np.isfinite(actual).all(axis=2, keepdims=True)
    actual = np.where(finite, actual, expected)
    shown, codes, best = _codes(actual), _codes(expected), dict[str, tuple[float, str]]()
    for kind, text, changed, (rows, columns) in _candidates(actual, expected, codes):
        before = _size(shown[rows, columns] - codes[rows, columns])
        share = max(_size(shown[rows, columns] - changed) / before, EXACT) if before else 1.0
        if share < SIMPLER * best.get(kind, (REMAINS / SIMPLER, ""))[0]:
            best[kind] = share, text
    scored = sorted(best.values(), key=lambda each: each[0])
    return [text for share, text in scored if share <= scored[0][0] + AS_LIKELY]


def _candidates(actual: Light, expected: Light, codes: Codes) -> Iterator[Candidate]:
    """Candidates, for each kind the simplest first; ``codes`` are those of the expected image."""
    yield "place", "it is flipped left to right", codes[:, ::-1], EVERYWHERE
    yield "place", "it is flipped upside down", codes[::-1], EVERYWHERE
    yield "place", "it is rotated by 180 degrees", codes[::-1, ::-1], EVERYWHERE
    if actual.shape[0] == actual.shape[1]:
        yield "place", "rows and columns are swapped", codes.transpose(1, 0, 2), EVERYWHERE
    for down, right in product(range(-FARTHEST, FARTHEST + 1), repeat=2):
        if (down, right) != (0, 0) and min(actual.shape[:2]) > 4 * FARTHEST:
            (to_rows, from_rows), (to_columns, from_columns) = _moved(down), _moved(right)
            yield "place", _shift(down, right), codes[from_rows, from_columns], (to_rows, to_columns)
    for order in list(permutations(range(3)))[1:]:
        yield "channels", _permuted(order), codes[..., order], EVERYWHERE
    text = "gamma is applied once too often, or not undone: sRGB codes are taken for linear light"
    yield "gamma", text, _codes(srgb_encode(expected)), EVERYWHERE
    text = "gamma is missing, or undone once too often: linear light is taken for sRGB codes"
    yield "gamma", text, np.clip(expected, 0.0, 1.0), EVERYWHERE
    yield from (("factor", text, _codes(light), EVERYWHERE) for text, light in _scaled(actual, expected))


def _scaled(actual: Light, expected: Light) -> Iterator[tuple[str, Light]]:
    """Factors and offsets, by least squares."""
    squares = (expected**2).sum(axis=(0, 1))
    if (squares == 0).all():
        return
    factor = float((actual * expected).sum() / squares.sum())
    yield f"all light is multiplied by {_named(factor)}", factor * expected
    offset = (actual - expected).mean(axis=(0, 1))
    yield f"{', '.join(f'{value:+.3g}' for value in offset)} is added to red, green, blue", expected + offset
    if (squares > 0).all():
        factors = (actual * expected).sum(axis=(0, 1)) / squares
        text = ", ".join(_named(float(value)) for value in factors)
        yield f"red, green, blue are multiplied by {text}", factors * expected


def _named(factor: float) -> str:
    """A factor as text, by its name if it has one.

    >>> _named(3.1416), _named(1.5)
    ('3.14 (pi)', '1.5')
    """
    names = [name for known, name in FACTORS.items() if abs(factor / known - 1) < CLOSE]
    return f"{factor:.3g}" + (f" ({names[0]})" if names else "")


def _permuted(order: tuple[int, ...]) -> str:
    moved = [k for k in range(3) if order[k] != k]
    if len(moved) == 2:
        return f"{CHANNELS[moved[0]]} and {CHANNELS[moved[1]]} are swapped"
    return f"the channels are permuted: red, green, blue are those of {', '.join(CHANNELS[k] for k in order)}"


def _moved(by: int) -> tuple[slice, slice]:
    """Pixels of an axis that stay in the image when it is moved: where they come to, and where they come from."""
    there, here = slice(max(by, 0), min(by, 0) or None), slice(max(-by, 0), min(-by, 0) or None)
    return there, here


def _shift(down: int, right: int) -> str:
    words = []
    for by, positive, negative in ((down, "down", "up"), (right, "right", "left")):
        if by:
            words.append(f"{abs(by)} pixel{'s' if abs(by) > 1 else ''} {positive if by > 0 else negative}")
    return f"it is shifted by {' and '.join(words)}"


def _codes(light: NDArray[np.floating]) -> NDArray[np.float64]:
    """SRGB codes that are not clipped; those of negative light are negative."""
    return np.sign(light) * srgb_encode(np.abs(light))


def _size(difference: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(difference**2))) if difference.size else 0.0
