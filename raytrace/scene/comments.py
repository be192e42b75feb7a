"""Comments of scene files: replaced by blanks, so that every other character keeps its line and column."""

import re
from typing import NamedTuple

# every alternative matches whatever follows its first character, so that the search takes linear time
PIECE = re.compile(r'"[^"\\]*(?:\\.[^"\\]*)*(?:"|\\?\Z)|(?P<comment>//[^\r\n]*|/\*.*?(?:\*/|\Z))', re.DOTALL)
CHARACTER = re.compile(r"[^\r\n]")


class Uncommented(NamedTuple):
    """A text without its comments."""

    text: str  # as long as the original; line breaks within comments are kept
    unclosed: int  # offset of a comment that has no end, or -1


def without_comments(text: str) -> Uncommented:
    """Replace comments, ``// ...`` and ``/* ... */``, by blanks; strings that contain such characters are kept.

    Parameters
    ----------
    text : str
        JSON with comments; it need not be valid.

    Returns
    -------
    Uncommented

    Examples
    --------
    >>> without_comments('{"a": "//", /* b */ "c": 1} // d').text
    '{"a": "//",         "c": 1}     '
    """
    if "//" not in text and "/*" not in text:
        return Uncommented(text, -1)
    unclosed = -1

    def blank(piece: re.Match[str]) -> str:
        nonlocal unclosed
        comment = piece["comment"]
        if comment is None:
            return piece[0]
        if comment.startswith("/*") and (len(comment) < 4 or not comment.endswith("*/")):
            unclosed = piece.start()
        return CHARACTER.sub(" ", comment)

    return Uncommented(PIECE.sub(blank, text), unclosed)
