"""Words of text meshes: all kinds of white space, and numbers as C libraries write them."""

import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

BOM = b"\xef\xbb\xbf"  # some editors begin UTF-8 with a byte order mark
END = b"\0\x1a"  # padding, and the end of a text under CP/M and DOS
# white space that is neither a blank, a tab nor a line break: of ASCII, and of Unicode in UTF-8
RARE = b"\v\f\x1c\x1d\x1e\x1f"
BLANKS = re.compile(rb"\xc2\xa0|\xe1\x9a\x80|\xe2\x80[\x80-\x8a\xaf]|\xe2\x81\x9f|\xe3\x80\x80|(?<![\x80-\xff])\xa0")
BREAKS = re.compile(rb"\xc2\x85|\xe2\x80[\xa8\xa9]")
PAGE = re.compile(rb"[\v\f][ \t]*(?=(?:vn?|vt|[flpgos]|usemtl|mtllib)[ \t])")  # before a statement of OBJ: a line break
NOTHING = re.compile(rb"\xef\xbb\xbf|\xe2\x80[\x8b-\x8f]|\xe2\x81\xa0")  # of zero width
# NaN as Microsoft's C library wrote it, by kind
NO_NUMBER = re.compile(rb"[+-]?(?:1\.?#(?:IND|QNAN|SNAN)\w*|nan\(\w*\))", re.IGNORECASE)
INFINITE = re.compile(rb"([+-]?)1\.?#INF\w*", re.IGNORECASE)


def plain(data: bytes) -> bytes:
    r"""Return a text whose only white space is blanks, tabs and line breaks, as most texts have already.

    Examples
    --------
    >>> plain("\ufeffv\v1\u00a02\u20283".encode())
    b'v 1 2\n3'
    """
    data = data.removeprefix(BOM).rstrip(END)
    if not data.isascii():
        data = NOTHING.sub(b"", BREAKS.sub(b"\n", BLANKS.sub(b" ", data)))
    if any(code in data for code in RARE):
        data = PAGE.sub(b"\n", data)
        data = data.translate(bytes.maketrans(RARE, b" " * len(RARE)))
    return data


def number(word: bytes) -> float:
    """Return the number of a word, also NaN and infinity as C libraries write them.

    Examples
    --------
    >>> number(b"-1.5e3"), number(b"-1.#IND"), number(b"1.#INF")
    (-1500.0, nan, inf)
    """
    if b"_" in word:  # Python's own separator of digits
        raise ValueError
    if NO_NUMBER.fullmatch(word):
        return float("nan")
    if infinite := INFINITE.fullmatch(word):
        return float(infinite[1] + b"inf")
    return float(word)


def whole(word: bytes) -> int:
    """Return the integer of a word."""
    if b"_" in word:
        raise ValueError
    return int(word)


class WordError(ValueError):
    """A word is not a number: its position among the words, and the word itself."""

    def __init__(self, place: int, word: bytes) -> None:
        self.place, self.word = place, word
        super().__init__(repr(word))


def to_array(words: Sequence[bytes], kind: Callable[[bytes], Any], odd: bool = True) -> NDArray[Any]:
    """Return words as an array, converted all at once where that is possible.

    Parameters
    ----------
    words : sequence of bytes
    kind : ``number`` or ``whole``
        float64 or int64.
    odd : bool
        Whether any may have a "_", which Python accepts between digits.

    Raises
    ------
    WordError
        The first word that is not such a number.
    """
    dtype = np.dtype(np.float64 if kind is number else np.int64)
    if not odd or b"_" not in b"".join(words):
        try:
            return np.array(list(map(float if kind is number else int, words)), dtype)
        except (ValueError, OverflowError):
            pass
    array = np.empty(len(words), dtype)
    for i, word in enumerate(words):
        try:
            array[i] = kind(word)
        except (ValueError, OverflowError):
            raise WordError(i, word) from None
    return array
