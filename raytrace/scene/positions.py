"""Finds the line and column of a path in a JSON text. Used only after a problem was found.

Each function takes time and memory linear in the size of the text.
"""

import json
import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

Path = tuple[str | int, ...]  # ("objects", 1, "mesh"): keys and indices from the root
Origins = dict[Path, Path]  # path of a translated part -> its path in the text

STRING = r'"[^"\\]*(?:\\.[^"\\]*)*"'
SPACE = re.compile(r"[ \t\r\n]*")
# blanks are a token of their own: as an optional prefix, a long run of them would be tried from each position
TOKEN = re.compile(rf'[ \t\r\n]+|(?P<string>{STRING})|(?P<mark>[{{}}\[\],:])|(?P<word>[^ \t\r\n"{{}}\[\],:]+)')
BRACKET = re.compile(rf"{STRING}|(?P<open>[{{\[])|(?P<close>[}}\]])")
LONGEST_STEP = 200  # characters of a key that are shown


@dataclass
class Positions:
    """Offsets of parts of a JSON text."""

    text: str
    values: dict[Path, int] = field(default_factory=dict)  # path -> offset of its value
    keys: dict[Path, int] = field(default_factory=dict)  # path -> offset of its key, the last one if repeated

    def value(self, path: Path) -> int:
        """Return the offset of the value at a path, or of the nearest container that exists."""
        while path and path not in self.values:
            path = path[:-1]
        return self.values.get(path, 0)

    def key(self, path: Path) -> int:
        """Return the offset of the key at the end of a path, or of its value where there is no key."""
        return self.keys.get(path, self.value(path))

    def line_column(self, offset: int) -> tuple[int, int]:
        """Return the line and the column of an offset, both counted from 1, the column in characters."""
        return self.text.count("\n", 0, offset) + 1, offset - self.text.rfind("\n", 0, offset)


def find(text: str, paths: Iterable[Path]) -> Positions:
    r"""Return the positions of parts of a JSON text, and of the containers around them.

    Parameters
    ----------
    text : str
        JSON that ``json.loads`` accepts.
    paths : iterable of tuple
        Parts to find; those that do not exist are left out.

    Returns
    -------
    Positions

    Examples
    --------
    >>> where = find('{"a": [1,\n 2]}', [("a", 1)])
    >>> where.line_column(where.value(("a", 1)))
    (2, 2)
    """
    wanted: dict[str | int, Any] = {}  # a tree of steps
    for path in paths:
        node = wanted
        for step in path:
            node = node.setdefault(step, {})
    finder = _Finder(text)
    finder.walk(finder.after_space(0), (), wanted)
    return finder.found


class _Finder:
    """Walks to the requested parts of a text; the json module, which is fast, skips the others."""

    def __init__(self, text: str) -> None:
        self.found = Positions(text)
        self._text = text
        # numbers become their lengths: a whole number of many digits would be refused
        decoder = json.JSONDecoder(object_pairs_hook=len, parse_float=len, parse_int=len, parse_constant=len)
        self._decode = decoder.raw_decode

    def after_space(self, offset: int) -> int:
        """Skip white space."""
        return SPACE.match(self._text, offset).end()  # type: ignore[union-attr]  # it also matches an empty string

    def walk(self, offset: int, path: Path, wanted: dict[str | int, Any]) -> int:
        """Record the offsets of a value and of its requested parts; return the offset after it."""
        self.found.values[path] = offset
        kind = self._text[offset]
        if not wanted or kind not in "{[":
            return self._decode(self._text, offset)[1]
        offset = self.after_space(offset + 1)
        index = -1
        while self._text[offset] not in "}]":
            index, start = index + 1, offset
            step: str | int = index
            if kind == "{":
                step, offset = self._decode(self._text, offset)
                offset = self.after_space(self.after_space(offset) + 1)  # the colon
            if step in wanted:
                inner = (*path, step)
                if kind == "{":
                    self.found.keys[inner] = start
                offset = self.walk(offset, inner, wanted[step])
            else:
                offset = self._decode(self._text, offset)[1]
            offset = self.after_space(offset)
            if self._text[offset] == ",":
                offset = self.after_space(offset + 1)
        return offset + 1


def doubtful(text: str) -> Iterator[tuple[int, Path, str]]:
    """Yield repeated keys of objects, and numbers that are NaN or not finite in float64.

    Parameters
    ----------
    text : str
        JSON that ``json.loads`` accepts.

    Yields
    ------
    offset : int
    path : tuple
    word : str
        The number; "" for a key.

    Examples
    --------
    >>> list(doubtful('{"a": NaN, "a": 1}'))
    [(6, ('a',), 'NaN'), (11, ('a',), '')]
    """
    steps: list[str | int] = []  # for each open container its current key or index
    seen: list[set[str]] = []  # and its keys so far
    at_key = False
    for token in TOKEN.finditer(text):
        kind = token.lastgroup
        if kind is None:  # white space
            continue
        word = token[kind]
        if at_key and kind == "string":
            steps[-1] = key = json.loads(word)
            if key in seen[-1]:
                yield token.start(), tuple(steps), ""
            seen[-1].add(key)
            at_key = False
        elif word == ",":
            last = steps[-1]
            at_key = isinstance(last, str)
            steps[-1] = last if isinstance(last, str) else last + 1
        elif word in ("}", "]"):
            steps.pop()
            seen.pop()
            at_key = False
        elif word in ("{", "["):
            steps.append("" if word == "{" else 0)
            seen.append(set())
            at_key = word == "{"
        elif kind == "word" and not _is_finite(word):
            yield token.start(), tuple(steps), word


def _is_finite(word: str) -> bool:
    if word in ("true", "false", "null"):
        return True
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False


def too_deep(text: str, most: int) -> int:
    """Return the offset of the first list or object nested more than `most` deep, or -1.

    Examples
    --------
    >>> too_deep('["[", [0]]', 2), too_deep('["[", [0]]', 1)
    (-1, 6)
    """
    depth = 0
    for bracket in BRACKET.finditer(text):
        if bracket.lastgroup == "open":
            if depth == most:
                return bracket.start()
            depth += 1
        elif bracket.lastgroup == "close":
            depth -= 1
    return -1


def show(path: Path) -> str:
    """Return a path as Python writes it.

    Examples
    --------
    >>> show(("objects", 1, "mesh")), show(("materials", "red wall", "albedo"))
    ('objects[1].mesh', 'materials["red wall"].albedo')
    """
    text = ""
    for step in path:
        if isinstance(step, str):
            step = step[:LONGEST_STEP]
        if isinstance(step, str) and step.isidentifier():
            text += f".{step}"
        else:
            text += f"[{json.dumps(step, ensure_ascii=False)}]"
        if len(text) > LONGEST_STEP:
            break
    return text.removeprefix(".")
