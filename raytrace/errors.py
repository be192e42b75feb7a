"""Errors that users can cause, each with its exit code of the command line; and text that fits on one line."""

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any


class RaytraceError(Exception):
    """Base of all errors that a user can fix; its text is the whole message, one line per problem."""

    exit_code = 1
    problems: Sequence[str] = ()  # one line per problem, where these are known one by one


class SceneError(RaytraceError, ValueError):
    """A scene or mesh whose content is wrong.

    Parameters
    ----------
    problems : list of str
        One line per problem: ``file:line:column: path: what is wrong, and the fix``.
    """

    exit_code = 3

    def __init__(self, problems: list[str]) -> None:
        self.problems = list(problems)
        super().__init__("\n".join(self.problems))


class FileError(RaytraceError, OSError):
    """A file that can't be read or written: ``path: what is wrong, and the fix``."""

    exit_code = 4


class OptionError(RaytraceError, ValueError):
    """An option of a call or of the command line that is not allowed: ``option: what is wrong``."""

    exit_code = 2


class PackageError(RaytraceError):
    """An optional package that is not installed: ``what needs which package: how to install it``."""

    exit_code = 2


class MemoryLimitError(OptionError):
    """Not enough memory: ``memory: what needs how much, and what to change``."""


class FileMemoryError(MemoryLimitError, FileError):
    """Not enough memory to read a file; with the exit code of ``MemoryLimitError``."""


class SceneWarning(UserWarning):
    """A scene that is valid, but whose image is probably not as intended, for example because surfaces coincide."""


@contextmanager
def without_scene_warnings() -> Iterator[None]:
    """Ignore every ``SceneWarning``, for callers that print a scene's warnings themselves."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        yield


def shortened(text: str, most: int = 60) -> str:
    """Shorten a long text.

    Examples
    --------
    >>> shortened("0.333333333333", 8)
    '0.333...'
    """
    return text if len(text) <= most else text[: most - 3] + "..."


def printable(text: Any) -> str:
    r"""Escape everything that can't be printed on one line, so that no text can control a terminal.

    Examples
    --------
    >>> printable("two\nlines")
    'two\\nlines'
    """
    text = str(text)
    return text if text.isprintable() else "".join(map(_printable, text))


def _printable(c: str) -> str:
    from unicodedata import category

    if c.isprintable() or category(c) == "Zs":  # spaces of other widths
        return c
    return c.encode("unicode_escape").decode()
