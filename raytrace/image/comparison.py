"""``Comparison``: the errors of an image against a reference, and how terminals and notebooks show them."""

from __future__ import annotations

from typing import NamedTuple

MEANINGS = {  # of the fields, for people
    "rmse": "root of the mean squared error, linear light",
    "rmse_srgb": "the same for sRGB, 0 to 1, as on a screen",
    "relative_mse": "mean squared error relative to the reference",
    "bias": "mean difference of red, green, blue",
    "relative_bias": "the same, relative to the mean of the reference",
    "ssim": "structural similarity as on a screen; 1: equal",
    "worst_tile": "largest mean difference of an 8 x 8 tile, relative to the mean luminance",
    "worst_tile_at": "row and column of that tile's first pixel",
    "outliers": "share of pixels with a visible difference",
    "non_finite": "pixels with NaN or inf",
    "mrse": "mean relative squared error",
    "flip": "mean FLIP as on a screen; 0: equal",
    "hdr_flip": "mean FLIP over exposures; 0: equal",
}
SHORT = "rmse", "rmse_srgb", "ssim", "worst_tile", "outliers", "flip"  # in one line


class Comparison(NamedTuple):
    """Errors of an image a against a reference b, both in linear light; n values, L the mean |luminance| of b.

    A pixel that is not finite in a or b is counted in `non_finite`, and is equal for all other fields. If no pixel is
    finite, all other fields are NaN. The ratio 0 / 0 is 0, and x / 0 is inf. Constants are those of ``metrics``.
    """

    rmse: float  # radiance: sqrt(sum((a - b)^2) / n)
    rmse_srgb: float  # the same for sRGB codes in 0..1, with a and b clipped to 0..1; see `screen`
    relative_mse: float  # sum((a - b)^2 / (b^2 + RELATIVE_EPS)) / n
    bias: tuple[float, float, float]  # radiance, per channel: mean(a) - mean(b)
    relative_bias: tuple[float, float, float]  # per channel: (mean(a) - mean(b)) / mean(b)
    ssim: float  # structural similarity of the sRGB codes clipped to 0..1: -1..1, 1 if equal; see `ssim`
    worst_tile: float  # largest |mean of a - b over a tile| of all 8 x 8 tiles and channels, / L; see `worst_tile`
    worst_tile_at: tuple[int, int]  # row and column of the first pixel of that tile
    outliers: float  # share of pixels with |a - b| > OUTLIER (|b| + L) in any channel
    non_finite: int  # pixels with NaN or inf in a or in b
    mrse: float  # mean relative squared error: sum((a - b)^2 / (|b| + MRSE_OFFSET)^2) / n
    flip: float | None = None  # mean LDR-FLIP, 0..1, of the sRGB codes clipped to 0..1; None: not measured
    hdr_flip: float | None = None  # mean HDR-FLIP, 0..1, of the light from 0 on; None: not measured

    def __repr__(self) -> str:
        texts = _texts(self)
        shown = [f"{name} {texts[name]}" for name in SHORT if name in texts]
        if self.non_finite:
            shown.append(f"non_finite {self.non_finite}")
        return f"<Comparison: {', '.join(shown)}; print it>"

    def __str__(self) -> str:
        texts = _texts(self)
        width, wide = max(map(len, texts)), max(map(len, texts.values()))
        return "\n".join(f"{name:<{width}}  {text:<{wide}}  {MEANINGS[name]}" for name, text in texts.items())

    def _repr_html_(self) -> str:
        from raytrace.html_tables import html_table

        rows = [(name, text, MEANINGS[name]) for name, text in _texts(self).items()]
        return html_table("", ("measure", "value", "meaning"), rows)


def _texts(comparison: Comparison) -> dict[str, str]:
    """The measured fields, with four digits."""
    return {name: _text(value) for name, value in comparison._asdict().items() if value is not None}


def _text(value: float | tuple[float, ...]) -> str:
    if isinstance(value, tuple):
        return f"({', '.join(map(_text, value))})"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
