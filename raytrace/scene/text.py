"""The text of a scene: reads it, parses it strictly, and finds the line and column of problems."""

import json
import math
import os
from collections.abc import Collection, Iterable, Mapping
from itertools import islice
from pathlib import Path
from typing import Any, NoReturn

from raytrace.errors import FileError, FileMemoryError, SceneError, printable, shortened
from raytrace.files import open_regular
from raytrace.limits import MAX_SCENE
from raytrace.misnamed import ENCODED, is_utf16, mistaken, other_than_scene
from raytrace.scene import positions
from raytrace.scene.comments import without_comments
from raytrace.scene.meshes.given import take_meshes
from raytrace.scene.problem_lines import problem_line
from raytrace.scene.problems import MAX_PROBLEMS, Problem, no_such_file, quote

MAX_NESTING = 100  # the format itself needs 5
TOO_DEEP = f"nested more than {MAX_NESTING} deep; no part of a scene is"
MAX_TEXT = 500  # characters of the message of a problem
LFS = b"version https://git-lfs.github.com/spec/"  # the beginning of a pointer file
SCENE_BEGINS = (b"{", b"/", b"[", b"")  # of a scene that may be valid, in most cases
MAX_DIGITS = 300  # of integers; the largest float64 has 309
SYNTAX = {  # message of the json module -> our message
    "Expecting value": "expected a value",
    "Expecting property name enclosed in double quotes": 'expected a key in double quotes; no comma before "}"',
    "Expecting ',' delimiter": "expected a comma or the closing bracket",
    "Expecting ':' delimiter": "expected a colon after the key",
    "Illegal trailing comma before end of object": 'no comma before "}"',
    "Illegal trailing comma before end of array": 'no comma before "]"',
    "Extra data": "expected nothing more after the scene's closing bracket",
    "Unterminated string starting at": "this string has no closing quote",
    "Invalid control character at": "a line break or control character in a string; write it as an escape",
    "Invalid \\escape": "unknown escape; write a backslash as two",
    "Invalid \\uXXXX escape": "expected four hexadecimal digits after \\u",
}


class Text:
    """The JSON text of a scene.

    Parameters
    ----------
    name : str
        Begins the lines of its problems: the file as the user wrote it, or "scene".
    text : str
    in_file : bool
        Whether the text is that of a file, so that lines and columns make sense.
    trusted : set of str
        Paths that a program gave as ``pathlib.Path``.
    meshes : dict
        Name in the text -> mesh that a program gave in memory.
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
        self.changes: tuple[str, ...] = ()  # what ``--set`` has changed, as the user wrote it

    def lines(self, problems: Iterable[Problem], origins: positions.Origins) -> list[str]:
        """Return one line per problem, with its position, in the order of the text.

        Parameters
        ----------
        problems : iterable of Problem
        origins : dict
            Path of a problem -> path in this text, for translated parts; the longest match counts.

        Returns
        -------
        list of str
            ``file:line:column: path: what is wrong, and the fix``.
        """
        problems = list(problems)
        paths = []
        for problem in problems:
            cut = next((n for n in range(len(problem.path), 0, -1) if problem.path[:n] in origins), 0)
            paths.append((*origins.get(problem.path[:cut], problem.path[:cut]), *problem.path[cut:]))
        where = positions.find(self.text, paths)
        placed = []
        for problem, path in zip(problems, paths, strict=True):
            offset = where.key(path) if problem.at_key else where.value(path)
            placed.append((offset, self._line(where, offset, path, problem.text)))
        return list(dict.fromkeys(line for _, line in sorted(placed, key=lambda pair: pair[0])))

    def warn(self, warnings: list[Problem], origins: positions.Origins) -> tuple[str, ...]:
        """Return lines for the first `MAX_PROBLEMS` warnings, and one for the others."""
        lines = self.lines(warnings[:MAX_PROBLEMS], origins) if warnings else []
        if len(warnings) > MAX_PROBLEMS:
            lines.append(f"{self.name}: and {len(warnings) - MAX_PROBLEMS:,} more warnings")
        return tuple(lines)

    def error(self, problems: list[Problem], origins: positions.Origins) -> SceneError | FileError:
        """Return one error for all problems: a ``FileError`` if only files can't be read."""
        deep = positions.too_deep(self.text, MAX_NESTING)  # the parser accepts it, but the search for problems may not
        if deep >= 0:
            return SceneError([self._line(positions.Positions(self.text), deep, (), TOO_DEEP)])
        lines = self.lines(problems[:MAX_PROBLEMS], origins)
        if len(problems) > MAX_PROBLEMS:
            lines.append(self._more())
        if not all(problem.unreadable for problem in problems):
            return SceneError(lines)
        memory = all(problem.lacks_memory for problem in problems)
        error = FileMemoryError("\n".join(lines)) if memory else FileError("\n".join(lines))
        error.problems = lines
        return error

    def _more(self) -> str:
        return f"{self.name}: and more: these are the first {MAX_PROBLEMS}"

    def _line(self, where: positions.Positions, offset: int, path: positions.Path, text: str) -> str:
        position = where.line_column(offset) if self.in_file else None
        return problem_line(self.name, position, shortened(positions.show(path), 200), shortened(text, MAX_TEXT))

    def refuse(self, offset: int, text: str) -> NoReturn:
        """Raise the error of one problem at an offset."""
        raise SceneError([self._line(positions.Positions(self.text), offset, (), text)])

    def _refuse_half_characters(self) -> None:
        for token in positions.TOKEN.finditer(self.text):
            if token.lastgroup != "string":
                continue
            try:
                json.loads(token["string"]).encode()
            except UnicodeEncodeError:
                text = "half of a character (a lone \\ud...) in this string; write the whole character"
                self.refuse(token.start("string"), text)

    def _refuse_doubtful(self) -> NoReturn:
        where = positions.Positions(self.text)
        lines = []
        for offset, path, word in islice(positions.doubtful(self.text), MAX_PROBLEMS + 1):
            key = f"repeated key {quote(path[-1])}; keep one"
            text = f"expected a finite number, got {shortened(word)}" if word else key
            lines.append(self._line(where, offset, path, text))
        raise SceneError([*lines[:MAX_PROBLEMS], self._more()] if len(lines) > MAX_PROBLEMS else lines)

    def parse(self) -> dict[str, Any]:
        """Return the scene as JSON types.

        Raises
        ------
        SceneError
            The text is not JSON or not an object, or has repeated keys or numbers that are not finite.
        """
        doubtful = False  # found by the parser, which has no offset; a scan then finds it

        def join(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
            nonlocal doubtful
            joined = dict(pairs)
            doubtful = doubtful or len(joined) < len(pairs)
            return joined

        def number(word: str) -> float | int:
            nonlocal doubtful
            value = int(word) if len(word) <= MAX_DIGITS and word.lstrip("-").isdigit() else float(word)
            doubtful = doubtful or not math.isfinite(value)
            return value

        try:
            data = json.loads(
                self.text, object_pairs_hook=join, parse_float=number, parse_int=number, parse_constant=number
            )
        except json.JSONDecodeError as error:
            self.refuse(error.pos, f"no JSON: {_syntax(self.text, error)}")
        except RecursionError:
            self.refuse(positions.too_deep(self.text, MAX_NESTING), TOO_DEEP)
        if doubtful:
            self._refuse_doubtful()
        if "\\ud" in self.text.lower():
            self._refuse_half_characters()
        if not isinstance(data, dict):
            self.refuse(0, f"expected an object, got {quote(data)}")
        return data


def _syntax(text: str, error: json.JSONDecodeError) -> str:
    """Say what is wrong with a text that is not JSON."""
    found, before = text[error.pos : error.pos + 1], text[: error.pos].rstrip()
    if not text.strip():
        return "the file is empty; expected a value"
    if found == "#":
        return "comments begin with //, not with #"
    if found == "'":
        return "strings have double quotes, not single ones"
    hint = "; is there a comma too many?" if error.msg == "Expecting value" and before.endswith(",") else ""
    return SYNTAX.get(error.msg, error.msg) + hint


def _decode(name: str, data: bytes) -> str:
    if is_utf16(data):
        raise SceneError([f"{name}:1:1: not UTF-8 but {ENCODED}"])
    if text := mistaken(data):
        raise FileError(f"{name}: {text}")
    if data.lstrip()[:1] not in SCENE_BEGINS and (text := other_than_scene(data)):
        raise SceneError([f"{name}: {text}"])
    try:
        return data.decode("utf-8-sig")  # some editors write a byte order mark first
    except UnicodeDecodeError as error:
        good = data[: error.start].decode("utf-8-sig")
        line, column = positions.Positions(good).line_column(len(good))
        text = f"not UTF-8 text: byte 0x{data[error.start]:02x}; save it as UTF-8"
        raise SceneError([f"{name}:{line}:{column}: {text}"]) from None


def read_file(path: Path) -> Text:
    """Return the text of a scene file; its comments are replaced by blanks.

    Raises
    ------
    SceneError
        It is not UTF-8, or a comment has no end.
    FileError
        It is missing, no regular file, too large or can't be read.
    """
    name = printable(path)
    try:
        with open_regular(path, "a scene file") as file:
            data = file.read(MAX_SCENE + 1)
    except FileError:
        raise
    except (FileNotFoundError, NotADirectoryError):
        raise FileError(no_such_file(path)) from None
    except OSError as error:
        raise FileError(f"{name}: can't be read: {error.strerror or error}") from None
    if len(data) > MAX_SCENE:
        raise FileError(f"{name}: more than {MAX_SCENE} bytes; a scene file only names its meshes")
    if data.startswith(LFS):
        raise FileError(f"{name}: a Git LFS pointer; fetch the file: git lfs pull")
    content = without_comments(_decode(name, data))
    text = Text(name, content.text, in_file=True)
    if content.unclosed >= 0:
        text.refuse(content.unclosed, "this comment has no end; close it with */")
    return text


def from_dict(scene: dict[str, Any]) -> Text:
    """Return a dict as the text of a scene; it may contain tuples, NumPy arrays, paths and meshes.

    Raises
    ------
    SceneError
        It contains a value that JSON cannot express.

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
        mesh = hasattr(value, "vertices") and hasattr(value, "faces")
        cure = '; a mesh in memory is the "mesh" of an object: {"mesh": ..., "material": "white"}' if mesh else ""
        raise TypeError(f"a {type(value).__name__} cannot be written as JSON{cure}")

    try:
        scene, meshes = take_meshes(scene)
        return Text("scene", json.dumps(scene, default=plain), False, trusted, meshes)
    except RecursionError:
        raise SceneError([f"scene: {TOO_DEEP}"]) from None
    except (TypeError, ValueError) as error:
        raise SceneError([f"scene: {str(error)[:1].lower()}{str(error)[1:]}"]) from None
