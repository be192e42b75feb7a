"""One line about a problem of a scene: text for people, and its parts for programs."""

import re
from typing import NamedTuple

from raytrace.errors import printable


class Parts(NamedTuple):
    """What a line says, in parts."""

    file: str  # the scene file
    line: int | None  # counted from 1; None: the problem has no place in a file
    column: int | None  # counted from 1, in characters
    path: str  # of the value, such as "objects[0].mesh"; "" where there is none
    message: str  # what is wrong, and the fix


class ProblemLine(str):
    """A line of ``SceneError.problems`` or ``Scene.warnings``: a string that keeps its parts.

    Attributes
    ----------
    parts : Parts

    Examples
    --------
    >>> line = problem_line("a.json", (3, 7), "camera.fov", "expected a number")
    >>> line, line.parts.column
    ('a.json:3:7: camera.fov: expected a number', 7)
    """

    parts: Parts


def problem_line(file: str, position: tuple[int, int] | None, path: str, message: str) -> ProblemLine:
    """Return a line of its parts; position: line and column, both counted from 1."""
    place = ":".join(map(str, (file, *(position or ()))))
    line = ProblemLine(printable(": ".join(part for part in (place, path, message) if part)))
    row, column = position or (None, None)
    line.parts = Parts(file, row, column, path, message)
    return line


def parts_of(line: str, file: str) -> Parts:
    """Return the parts of a line about a file; of a plain string as far as they can be read.

    Examples
    --------
    >>> parts_of("a.json:3:7: this string has no closing quote", "a.json")
    Parts(file='a.json', line=3, column=7, path='', message='this string has no closing quote')
    >>> parts_of("box.obj: no such file", "box.obj")
    Parts(file='box.obj', line=None, column=None, path='', message='no such file')
    """
    if isinstance(line, ProblemLine):
        return line.parts
    place = re.match(rf"{re.escape(file)}(?::(\d+)(?::(\d+))?)?: ", line)
    if place is None:
        return Parts(file, None, None, "", line)
    row, column = (None if number is None else int(number) for number in place.groups())
    return Parts(file, row, column, "", line[place.end() :])
