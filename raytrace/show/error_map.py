"""``error``: maps of the signed error of an image and of its structural similarity (SSIM) to a reference."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.image.files import LUMINANCE, srgb8
from raytrace.image.metrics import TILE, Comparison, compare, difference_scale, light_of, ssim_map
from raytrace.show.drawing import BLACK, Drawing, new_figure, show_image

SSIM_QUANTILE = 0.995  # share of the pixels within the grey scale of the SSIM map


def error(image: Any, reference: Any) -> Drawing:
    """Draw an image, a reference, the signed error of each pixel, and the SSIM map.

    Parameters
    ----------
    image, reference : Render, (h, w, 3) array of float, or path of an image
        As for ``compare``: linear radiance, equal size.

    Returns
    -------
    Drawing
        ``data``: "error", (h, w), luminance of image - reference, radiance; "ssim", (h, w), -1 .. 1, 1 where equal.

    Raises
    ------
    ValueError, FileError
        As for ``compare``.
    RaytraceError
        matplotlib or scikit-image isn't installed.

    Notes
    -----
    SSIM is that of [Wang2004]_, of sRGB codes clipped to 0..1, with the settings of ``compare``. The map is averaged
    over channels. It includes the margin of 5 pixels that the mean excludes. The frame is the worst 8 x 8 tile. Pixels
    that are not finite count as equal; the title gives their number. The colours of the error are scaled to the
    pixels with more than rounding error, so that a small defect in an otherwise equal image is visible.

    Examples
    --------
    >>> import raytrace as rt
    >>> coarse, fine = (rt.render("scenes/cornell-box.json", spp=spp, size=(32, 32)) for spp in (1, 64))
    >>> drawing = rt.show.error(coarse, fine)
    >>> drawing.data["error"].shape, bool(drawing.data["ssim"].max() <= 1)
    ((32, 32), True)
    """
    numbers = compare(image, reference, flip=False)
    a, b = light_of(image, "image"), light_of(reference, "reference")
    finite: NDArray[np.bool_] = np.all(np.isfinite(a) & np.isfinite(b), axis=2)
    a, b = np.where(finite[..., None], a, 0.0), np.where(finite[..., None], b, 0.0)
    data = {"error": (a - b) @ LUMINANCE, "ssim": ssim_map(a, b)}
    bias = ", ".join(f"{channel:+.2%}" for channel in numbers.relative_bias)
    title = f"RMSE {numbers.rmse:.3g}; bias of red, green, blue {bias}; SSIM {numbers.ssim:.4f}"
    title += f"; pixels that are not finite: {numbers.non_finite}" if numbers.non_finite else ""
    height, width = finite.shape
    with new_figure(14, 5.5 * height / width + 2.1) as figure:
        figure.suptitle(title)
        grid = figure.add_gridspec(2, 3, width_ratios=(1, 2, 2))
        for k, (name, light) in enumerate((("image", a), ("reference", b))):
            axes = figure.add_subplot(grid[k, 0])
            show_image(axes, srgb8(light))
            axes.set_title(name)
        top = difference_scale(data["error"], b) or 1.0
        _signed(figure, figure.add_subplot(grid[:, 1]), data["error"], top, numbers)
        _structure(figure, figure.add_subplot(grid[:, 2]), data["ssim"])
    return Drawing(title, data, figure)


def _signed(figure: Any, axes: Any, difference: NDArray[np.float64], top: float, numbers: Comparison) -> None:
    """Show the signed error; the colours reach from -top to top."""
    from matplotlib.patches import Rectangle

    largest = float(np.abs(difference).max())
    shown = show_image(axes, difference, cmap="PuOr_r", vmin=-top, vmax=top)
    axes.set_title(f"error: largest {largest:.3g}")
    extend = "both" if largest > top else "neither"
    look: Any = {"label": "image - reference: luminance, radiance", "format": "%.2g"}
    figure.colorbar(shown, ax=axes, location="bottom", extend=extend, ticks=top * np.linspace(-1, 1, 5), **look)
    if largest == 0:
        return
    row, column = numbers.worst_tile_at
    height, width = (min(TILE, extent) for extent in difference.shape)
    look = {"fill": False, "edgecolor": BLACK, "linewidth": 1.6, "label": "worst tile"}
    axes.add_patch(Rectangle((column - 0.5, row - 0.5), width, height, **look))
    axes.annotate("worst tile", (column, row), (0, 4), textcoords="offset points", fontsize=11)


def _structure(figure: Any, axes: Any, similarity: NDArray[np.float64]) -> None:
    """Show the SSIM map."""
    low = min(float(np.quantile(similarity, 1 - SSIM_QUANTILE)), 0.99)
    shown = show_image(axes, similarity, cmap="gray", vmin=low, vmax=1.0)
    axes.set_title(f"SSIM: smallest {similarity.min():.3g}")
    extend = "min" if similarity.min() < low else "neither"
    figure.colorbar(shown, ax=axes, location="bottom", label="structural similarity, 1 where equal", extend=extend)
