"""Where things stand in a JSON text: the line and column of every path. Run only after a problem was found.

The scanner keeps its own stack, so that a text nested deeper than Python's recursion limit can be walked too.
"""

import json
import math
import re
from dataclasses import dataclass, field

Path = tuple[str | int, ...]  # ("objects", 1, "mesh"): keys and indices from the root
Origins = dict[Path, Path]  # of parts that were translated -> where they stand in the text

TOKEN = re.compile(
    r'[ \t\r\n]*(?:(?P<string>"[^"\\]*(?:\\.[^"\\]*)*")|(?P<mark>[{}\[\],:])|(?P<word>[^ \t\r\n"{}\[\],:]+))'
)


@dataclass
class Positions:
    """Offsets of the parts of a JSON text, and what only the text can tell."""

    text: str
    values: dict[Path, int] = field(default_factory=dict)  # path -> offset of its value
    keys: dict[Path, int] = field(default_factory=dict)  # path -> offset of its key, the last one if repeated
    repeated: list[tuple[Path, int]] = field(default_factory=list)  # keys that stood there before, with their offset
    infinite: list[tuple[Path, str]] = field(default_factory=list)  # numbers that are NaN or no finite float64

    def value(self, path: Path) -> int:
        """Return the offset of the value at a path, or of the nearest container that is there."""
        while path and path not in self.values:
            path = path[:-1]
        return self.values.get(path, 0)

    def key(self, path: Path) -> int:
        """Return the offset of the key that a path ends in, or where there is none, of its value."""
        return self.keys.get(path, self.value(path))

    def line_column(self, offset: int) -> tuple[int, int]:
        """Return the line and the column of an offset, both counted from 1, the column in characters."""
        return self.text.count("\n", 0, offset) + 1, offset - self.text.rfind("\n", 0, offset)


def _is_finite(word: str) -> bool:
    if word in ("true", "false", "null"):
        return True
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False


def scan(text: str, max_depth: int = 1000) -> Positions:
    r"""Find where everything in a JSON text stands.

    Parameters
    ----------
    text : str
        JSON that ``json.loads`` accepts, or would accept if it were nested less deeply.
    max_depth : int
        What lies deeper than this is not looked at.

    Returns
    -------
    Positions

    Examples
    --------
    >>> where = scan('{"a": [1,\n 2]}')
    >>> where.line_column(where.value(("a", 1)))
    (2, 2)
    """
    found = Positions(text)
    steps: list[str | int] = []  # one a container that is open: the key or index that it has come to
    at_key = False
    for token in TOKEN.finditer(text):
        kind, word = token.lastgroup or "", token[token.lastgroup or 0]
        offset = token.start(kind)
        if at_key and kind == "string":
            steps[-1] = json.loads(word)
            path = tuple(steps)
            if path in found.keys:
                found.repeated.append((path, offset))
            found.keys[path] = offset
            at_key = False
        elif word == ",":
            last = steps[-1]
            at_key = isinstance(last, str)
            steps[-1] = last if isinstance(last, str) else last + 1
        elif word in ("}", "]"):
            steps.pop()
            at_key = False
        elif word != ":":
            path = tuple(steps)
            found.values[path] = offset
            if kind == "word" and not _is_finite(word):
                found.infinite.append((path, word))
            if word in ("{", "["):
                if len(steps) == max_depth:
                    break
                steps.append("" if word == "{" else 0)
                at_key = word == "{"
    return found


def show(path: Path) -> str:
    """Write a path the way people do.

    Examples
    --------
    >>> show(("objects", 1, "mesh")), show(("materials", "red wall", "albedo"))
    ('objects[1].mesh', 'materials["red wall"].albedo')
    """
    text = ""
    for step in path:
        if isinstance(step, str) and step.isidentifier():
            text += f".{step}"
        else:
            text += f"[{json.dumps(step, ensure_ascii=False)}]"
    return text.removeprefix(".")
