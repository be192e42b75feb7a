"""The text of a scene: read, parsed strictly, and able to say where in it a problem lies."""

import json
import math
import os
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any, NoReturn

from raytrace.errors import FileError, FileMemoryError, SceneError, printable, shortened
from raytrace.limits import MAX_SCENE
from raytrace.misnamed import ENCODED, is_utf16, mistaken
from raytrace.scene import positions
from raytrace.scene.given import take_meshes
from raytrace.scene.problems import MOST, Problem, no_such_file, quote

MAX_NESTING = 100  # the format itself needs 4
MAX_TEXT = 500  # characters of what is told of a problem
MAX_DIGITS = 300  # of whole numbers; the largest float64 has 309
SYNTAX = {  # what the json module says -> what to do
    "Expecting value": "expected a value; is there a comma too many?",
    "Expecting property name enclosed in double quotes": 'expected a key in double quotes; no comma before "}"',
    "Expecting ',' delimiter": "expected a comma or the closing bracket",
    "Expecting ':' delimiter": "expected a colon after the key",
    "Illegal trailing comma before end of object": 'no comma before "}"',
    "Illegal trailing comma before end of array": 'no comma before "]"',
    "Extra data": "expected nothing more after the scene's closing bracket",
    "Unterminated string starting at": "this string has no closing quote",
    "Invalid control character at": "a line break or control character in a string; write it as an escape",
    "Invalid \\escape": "no escape that JSON knows; write a backslash as two",
    "Invalid \\uXXXX escape": "expected four hexadecimal digits after \\u",
}


class Text:
    """A scene's JSON text.

    Parameters
    ----------
    name : str
        What its problems are told under: the file as the user wrote it, or "scene".
    text : str
    in_file : bool
        Whether there is a file in which lines and columns mean something.
    trusted : set of str
        What a program gave as a path, and not as text.
    meshes : dict
        Name in the text -> what a program gave as a mesh, and not as a path.
    """

    def __init__(
        self,
        name: str,
        text: str,
        in_file: bool,
        trusted: Collection[str] = (),
        meshes: Mapping[str, Any] | None = None,
    ) -> None:
        self.name = name
        self.text = text
        self.in_file = in_file
        self.trusted = frozenset(trusted)
        self.meshes = meshes or {}

    def tell(self, problems: Iterable[Problem], origins: positions.Origins) -> list[str]:
        """Return the problems with their places, a line each, in the order of the text.

        Parameters
        ----------
        problems : iterable of Problem
        origins : dict
            Path of a problem -> path in this text, for parts that were translated; the longest that fits counts.

        Returns
        -------
        list of str
            ``file:line:column: path: what is wrong, and the fix``.
        """
        where = positions.scan(self.text)
        placed = []
        for problem in problems:
            cut = next((n for n in range(len(problem.path), 0, -1) if problem.path[:n] in origins), 0)
            path = (*origins.get(problem.path[:cut], problem.path[:cut]), *problem.path[cut:])
            offset = where.key(path) if problem.at_key else where.value(path)
            placed.append((offset, self._line(where, offset, path, problem.text)))
        return [line for _, line in sorted(placed, key=lambda pair: pair[0])]

    def error(self, problems: list[Problem], origins: positions.Origins) -> SceneError | FileError:
        """Make one error of all problems: one of files where nothing else is wrong."""
        lines = self.tell(problems[:MOST], origins)
        if len(problems) > MOST:
            lines.append(f"{self.name}: and more: these are the first {MOST}")
        if all(problem.lacks_memory for problem in problems):
            return FileMemoryError("\n".join(lines))
        if all(problem.unreadable for problem in problems):
            return FileError("\n".join(lines))
        return SceneError(lines)

    def _line(self, where: positions.Positions, offset: int, path: positions.Path, text: str) -> str:
        place = ":".join(map(str, (self.name, *where.line_column(offset)))) if self.in_file else self.name
        parts = place, shortened(positions.show(path), 200), shortened(text, MAX_TEXT)
        return printable(": ".join(part for part in parts if part))

    def _refuse(self, offset: int, text: str) -> NoReturn:
        raise SceneError([self._line(positions.Positions(self.text), offset, (), text)])

    def _refuse_half_characters(self) -> None:
        for token in positions.TOKEN.finditer(self.text):
            try:
                json.loads(token["string"] or '""').encode()
            except UnicodeEncodeError:
                text = "half of a character (a lone \\ud...) in this string; write the whole character"
                self._refuse(token.start("string"), text)

    def parse(self) -> dict[str, Any]:
        """Return the scene as JSON types.

        Raises
        ------
        SceneError
            The text is no JSON, or holds repeated keys or numbers that are not finite, or is no object.
        """
        doubtful: list[Any] = []  # what the parser can't place; the scan, run only then, can

        def join(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
            joined = dict(pairs)
            if len(joined) < len(pairs):
                doubtful.append(pairs)
            return joined

        def number(word: str) -> float | int:
            value = int(word) if len(word) <= MAX_DIGITS and word.lstrip("-").isdigit() else float(word)
            if not math.isfinite(value):
                doubtful.append(word)
            return value

        try:
            data = json.loads(
                self.text, object_pairs_hook=join, parse_float=number, parse_int=number, parse_constant=number
            )
        except json.JSONDecodeError as error:
            self._refuse(error.pos, f"no JSON: {SYNTAX.get(error.msg, error.msg)}")
        except RecursionError:
            deepest = max(positions.scan(self.text, MAX_NESTING).values.values())
            self._refuse(deepest, f"nested more than {MAX_NESTING} deep; no part of a scene is")
        if doubtful:
            where = positions.scan(self.text)
            problems = [Problem(path, f"repeated key {quote(path[-1])}; keep one", True) for path, _ in where.repeated]
            infinite = [(path, shortened(word)) for path, word in where.infinite]
            problems += [Problem(path, f"expected a finite number, got {word}") for path, word in infinite]
            raise self.error(problems, {})
        if "\\ud" in self.text.lower():
            self._refuse_half_characters()
        if not isinstance(data, dict):
            self._refuse(0, f"expected an object, got {quote(data)}")
        return data


def _decode(name: str, data: bytes) -> str:
    if is_utf16(data):
        raise SceneError([f"{name}:1:1: not UTF-8 but {ENCODED}"])
    if text := mistaken(data):
        raise FileError(f"{name}: {text}")
    try:
        return data.decode("utf-8-sig")  # some editors begin UTF-8 with a byte order mark
    except UnicodeDecodeError as error:
        good = data[: error.start].decode("utf-8-sig")
        line, column = positions.Positions(good).line_column(len(good))
        text = f"not UTF-8 text: byte 0x{data[error.start]:02x}; save it as UTF-8"
        raise SceneError([f"{name}:{line}:{column}: {text}"]) from None


def read_file(path: Path) -> Text:
    """Read a scene file.

    Raises
    ------
    SceneError
        It is not UTF-8.
    FileError
        It is missing, a directory, too large or can't be read.
    """
    name = printable(path)
    try:
        if path.is_dir():
            raise FileError(f"{name}: a directory; name a scene file in it")
        if not path.exists():
            raise FileError(no_such_file(path))
        if not path.is_file():
            raise FileError(f"{name}: no regular file; name a scene file")
        if path.stat().st_size > MAX_SCENE:
            raise FileError(f"{name}: more than {MAX_SCENE} bytes; a scene file only names its meshes")
        data = path.read_bytes()
    except FileError:
        raise
    except OSError as error:
        raise FileError(f"{name}: can't be read: {error.strerror or error}") from None
    return Text(name, _decode(name, data), in_file=True)


def from_dict(scene: dict[str, Any]) -> Text:
    """Write a dict, which may hold tuples, NumPy arrays, paths and meshes, as the text of a scene.

    Raises
    ------
    SceneError
        It holds what JSON can't.

    Examples
    --------
    >>> from_dict({"film": {"size": (4, 3)}}).text
    '{"film": {"size": [4, 3]}}'
    """
    trusted: set[str] = set()

    def plain(value: Any) -> Any:
        if hasattr(value, "tolist"):  # NumPy's arrays and scalars
            return value.tolist()
        if isinstance(value, os.PathLike):
            trusted.add(str(os.fspath(value)))
            return os.fspath(value)
        raise TypeError(f"a {type(value).__name__} has no form in JSON")

    try:
        scene, meshes = take_meshes(scene)
        return Text("scene", json.dumps(scene, default=plain), False, trusted, meshes)
    except RecursionError:
        raise SceneError([f"scene: nested more than {MAX_NESTING} deep; no part of a scene is"]) from None
    except (TypeError, ValueError) as error:
        raise SceneError([f"scene: {str(error)[:1].lower()}{str(error)[1:]}"]) from None
