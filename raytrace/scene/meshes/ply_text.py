"""The numbers of a text PLY: words, one row per line or in any lines."""

from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.scene.meshes.words import WordError, number, to_array, whole

NEEDED = {"vertex": ("x", "y", "z"), "face": ("vertex_indices", "vertex_index"), "tristrips": ("vertex_indices",)}

Array = NDArray[Any]


class Column(NamedTuple):
    """Numbers of one property, equally many in each row."""

    element: str
    name: str
    kind: str
    many: int
    needed: bool  # whether a word that is not a number is an error

    def fault(self, row: int, word: bytes) -> str:
        """Return what is wrong with a word."""
        shown = repr(word[:60].decode("utf-8", "replace"))
        return f"row {row} of element {self.element}: expected a number as {self.name}, got {shown}"


class Property(NamedTuple):
    """One number of each row, or a list of them."""

    name: str
    kind: str
    length: str | None  # type of the number before a list, its length; None: no list


class Element(NamedTuple):
    """Rows of one kind."""

    name: str
    rows: int
    properties: list[Property]


class Text:
    """Numbers as words; the unit is a word.

    Words that are not numbers become NaN; ``faults`` has the position of the first one by property.
    """

    def __init__(self, words: list[bytes], odd: bool) -> None:
        self.words, self.at = words, 0
        self.odd = odd  # whether any may have a "_"
        self.end = len(words)
        self.faults: dict[tuple[str, str], str] = {}

    def size(self, kind: str) -> int:  # noqa: D102
        return 1

    def length(self, kind: str) -> int:  # noqa: D102
        self.at += 1
        try:
            return whole(self.words[self.at - 1])
        except ValueError:
            raise ValueError(f"expected the length of a list, got {self.words[self.at - 1][:60]!r}") from None

    def table(self, columns: list[Column], rows: int) -> list[Array]:  # noqa: D102
        ends = list(accumulate((column.many for column in columns), initial=0))
        begin, self.at = self.at, self.at + rows * ends[-1]
        words = self.words[begin : self.at]
        try:
            numbers = to_array(words, number, self.odd).reshape(rows, ends[-1])
        except WordError:
            return [
                self._column(words, column, a, b, ends[-1])
                for column, (a, b) in zip(columns, pairwise(ends), strict=True)
            ]
        return [numbers[:, a:b] for a, b in pairwise(ends)]

    def _column(self, words: list[bytes], column: Column, begin: int, end: int, stride: int) -> Array:
        found = [self.numbers(column, words[k::stride]) for k in range(begin, end)]
        return np.stack(found, axis=1) if found else np.empty((len(words) // stride, 0))

    def numbers(self, column: Column, words: Sequence[bytes], rows: Array | None = None) -> Array:
        """Return the numbers of a column, whatever its words are."""
        try:
            return to_array(words, number, self.odd)
        except WordError as error:
            row = error.place if rows is None else int(rows[error.place])
            fault = column.fault(row, error.word)
            if column.needed:
                raise ValueError(fault) from None
            self.faults.setdefault((column.element, column.name), fault)
            return np.array([_lenient(word) for word in words])

    def at_places(self, column: Column, places: NDArray[np.int64], rows: Array) -> Array:  # noqa: D102
        return self.numbers(column, [self.words[place] for place in places.tolist()], rows)


def _lenient(word: bytes) -> float:
    try:
        return number(word)
    except ValueError:
        return float("nan")


def words_by_lines(body: bytes, elements: list[Element]) -> list[bytes] | None:
    """Return the words of a file whose lines are its rows, without those that a line has too many.

    None: it has another number of lines, or a line has too few words.
    """
    lines = [words for line in body.splitlines() if (words := line.split())]
    if len(lines) != sum(element.rows for element in elements):
        return None
    found, rows = list[bytes](), iter(lines)
    for element in elements:
        for _ in range(element.rows):
            words = next(rows)
            needed = 0
            for prop in element.properties:
                if needed >= len(words):
                    return None
                needed += 1 + (_count(words[needed]) if prop.length else 0)
            if needed > len(words):
                return None
            found += words[:needed]
    return found


def _count(word: bytes) -> int:
    return int(word) if word.isdigit() and len(word) < 10 else 10**9
