"""Tables in HTML for notebooks. They set no colours, so that they suit light and dark themes."""

from collections.abc import Iterable, Sequence
from html import escape
from typing import NamedTuple

import numpy as np

CELL = "text-align: left; vertical-align: top; padding: 0.15em 0.8em"
TITLE = "text-align: left; caption-side: top; padding: 0.4em 0.8em"
SWATCH = "display: inline-block; width: 0.9em; height: 0.9em; margin-right: 0.5em; border: 1px solid currentColor"


class Colour(NamedTuple):
    """Linear RGB, shown as a swatch and as numbers."""

    rgb: Sequence[float]


Cell = str | Colour


def html_table(title: str, header: Sequence[str], rows: Iterable[Sequence[Cell]], style: str = CELL) -> str:
    """Return a table; all text is escaped.

    Parameters
    ----------
    title : str
        Its caption; "": none.
    header : sequence of str
        Heads of the columns; empty: none.
    rows : iterable of sequences of str or Colour
    style : str
        CSS of each cell.

    Examples
    --------
    >>> html_table("", ["name"], [["a < b"]], style="")
    '<table><thead><tr><th style="">name</th></tr></thead><tbody><tr><td style="">a &lt; b</td></tr></tbody></table>'
    """
    caption = f'<caption style="{TITLE}">{escape(title)}</caption>' if title else ""
    head = "".join(f'<th style="{style}">{escape(cell)}</th>' for cell in header)
    body = "".join("<tr>" + "".join(f'<td style="{style}">{_cell(c)}</td>' for c in row) + "</tr>" for row in rows)
    head = f"<thead><tr>{head}</tr></thead>" if header else ""
    return f"<table>{caption}{head}<tbody>{body}</tbody></table>"


def numbers(values: Iterable[float], digits: int = 4) -> str:
    """Format numbers with some significant digits, separated by commas.

    >>> numbers([0.1 + 0.2, 2.0])
    '0.3, 2'
    """
    return ", ".join(f"{value + 0.0:.{digits}g}" for value in values)


def _cell(cell: Cell) -> str:
    if not isinstance(cell, Colour):
        return escape(cell)
    from raytrace.image.files import srgb8

    red, green, blue = srgb8(np.array(cell.rgb, np.float64).reshape(1, 1, 3)).ravel().tolist()
    return f'<span style="{SWATCH}; background: rgb({red}, {green}, {blue})"></span>{escape(numbers(cell.rgb))}'
