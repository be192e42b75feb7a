"""Text of pbrt-v4's scene format: directives and their parameters."""

from collections.abc import Iterable
from typing import Any

import numpy as np


def parameter(kind: str, name: str, *values: Any) -> str:
    """Return a parameter, such as ``"float fov" [ 40.0 ]``; numbers have as many digits as identify them.

    >>> parameter("rgb", "L", 1, 0.5, 0.1)
    '"rgb L" [ 1.0 0.5 0.1 ]'
    >>> parameter("string", "filename", "a.ply"), parameter("bool", "twosided", True)
    ('"string filename" [ "a.ply" ]', '"bool twosided" [ true ]')
    """
    texts = [_word(kind, value) for value in np.ravel(np.array(values, dtype=object))]
    return f'"{kind} {name}" [ {" ".join(texts)} ]'


def numbers(*values: Any) -> str:
    """Return numbers, separated by spaces."""
    return " ".join(repr(float(value)) for value in np.ravel(values))


def directive(name: str, kind: str, parameters: Iterable[str] = (), indent: str = "") -> str:
    """Return a directive such as ``Camera "perspective"`` with its parameters, one per line."""
    return "\n".join([f'{indent}{name} "{kind}"', *(f"{indent}    {each}" for each in parameters)])


def comment(text: str) -> str:
    """Return a text as one comment line."""
    return "# " + " ".join(text.split())


def _word(kind: str, value: Any) -> str:
    if kind in ("string", "texture", "spectrum"):
        return '"' + str(value).replace("\\", "\\\\").replace('"', '\\"') + '"'
    if kind == "bool":
        return "true" if value else "false"
    return str(int(value)) if kind == "integer" else repr(float(value))
