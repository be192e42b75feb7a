"""``Drawing``: a figure with the numbers that it shows."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from raytrace.errors import FileError, PackageError, printable
from raytrace.output_folder import check_folder, write
from raytrace.reporting.plots import without_glyphs

DPI = 160  # dots per inch of a PNG
SHOWN = 80  # pixels per inch in a notebook; the PNG has more, for screens with a high resolution
STYLE: Any = {
    "font.size": 13,
    "axes.titlesize": 14,
    "figure.titlesize": 16,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "svg.hashsalt": "raytrace",
    "text.parse_math": False,  # "$" in a name does not start a formula
}
# distinguishable for colour-blind readers   [Okabe2008]
BLACK, ORANGE, SKY, GREEN = "#000000", "#e69f00", "#56b4e9", "#009e73"
YELLOW, BLUE, VERMILION, PURPLE = "#f0e442", "#0072b2", "#d55e00", "#cc79a7"


class Drawing:
    """A figure and its data; the functions of ``rt.show`` return it.

    Attributes
    ----------
    title : str
        One line that says what it shows.
    data : dict of str to array
        The numbers in the figure; see the function that made it.
    figure : matplotlib.figure.Figure
        The figure; it can be changed before it is displayed or saved.

    Examples
    --------
    >>> import raytrace as rt
    >>> drawing = rt.show.samples("sobol", 16)
    >>> drawing
    <Drawing: sobol: 16 samples of pixel (1, 1), seed 0: points>
    >>> drawing.save("points.svg")  # doctest: +SKIP
    """

    def __init__(self, title: str, data: Mapping[str, NDArray[Any]], figure: Any) -> None:
        self.title, self.data, self.figure = title, dict(data), figure

    def __repr__(self) -> str:
        return f"<Drawing: {self.title}: {', '.join(self.data)}>"

    def save(self, path: str | Path) -> Path:
        """Write the drawing to a .png or .svg file, completely or not at all.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        Path

        Raises
        ------
        FileError
            Another extension, or a path that can't be written.

        Examples
        --------
        >>> import raytrace as rt
        >>> rt.show.samples("sobol", 16).save("points.svg").name  # doctest: +SKIP
        'points.svg'
        """
        path = Path(path)
        kind = path.suffix.lower()[1:]
        if kind not in ("png", "svg"):
            raise FileError(f"{printable(path)}: unknown kind of drawing {path.suffix!r}; use .png or .svg")
        check_folder(path.parent)
        return write(path.parent, {path.name: self.encode(kind)})[0]

    def encode(self, kind: str) -> bytes:
        """Content of a "png" or "svg" file; the same drawing gives the same bytes."""
        import matplotlib as mpl

        stream = io.BytesIO()
        metadata = {"Date": None} if kind == "svg" else {"Software": None}
        with mpl.rc_context(STYLE), without_glyphs():
            self.figure.savefig(stream, format=kind, dpi=DPI, metadata=metadata, facecolor="white")
        return stream.getvalue()

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        width, height = (round(SHOWN * inches) for inches in self.figure.get_size_inches())
        return self.encode("png"), {"width": width, "height": height}


@contextmanager
def new_figure(width: float, height: float) -> Iterator[Any]:
    """Context with an empty figure in the common style; width and height in inches.

    Raises
    ------
    RaytraceError
        matplotlib isn't installed.
    """
    try:
        import matplotlib as mpl
        from matplotlib.figure import Figure  # without pyplot: needs no window system
    except ImportError:
        raise PackageError("rt.show needs matplotlib: pip install matplotlib scikit-image") from None
    with mpl.rc_context(STYLE):
        yield Figure((width, height), layout="constrained")


def show_image(axes: Any, pixels: Any, **options: Any) -> Any:
    """Show an array on axes without ticks or interpolation; options as for matplotlib's ``imshow``."""
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set(visible=True, color="#aaaaaa", linewidth=0.6)
    return axes.imshow(pixels, interpolation="nearest", **options)
