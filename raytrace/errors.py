"""The mistakes a user can make, each with the exit code that the command line gives it; texts that fit in a line."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


class RaytraceError(Exception):
    """Base of every error that is the user's to mend; its text is the whole message, one line a problem."""

    exit_code = 1


class SceneError(RaytraceError, ValueError):
    """A scene or mesh whose content is wrong.

    Parameters
    ----------
    problems : list of str
        One line a problem: ``file:line:column: path: what is wrong, and the fix``.
    """

    exit_code = 3

    def __init__(self, problems: list[str]) -> None:
        self.problems = list(problems)
        super().__init__("\n".join(self.problems))


class FileError(RaytraceError, OSError):
    """A file that can't be read or written: ``path: what is wrong, and the fix``."""

    exit_code = 4


class OptionError(RaytraceError, ValueError):
    """An option of a call or of the command line that can't be met: ``option: what is wrong``."""

    exit_code = 2


class MemoryLimitError(OptionError):
    """More memory than there is: ``memory: what takes how much, and what to change``."""


class FileMemoryError(MemoryLimitError, FileError):
    """A file that takes more memory to read than there is. It has the exit code of every lack of memory."""


class SceneWarning(UserWarning):
    """A scene that is legal, but whose image is probably not what was meant: two of its surfaces coincide, say."""


@contextmanager
def without_scene_warnings() -> Iterator[None]:
    """Ignore every ``SceneWarning``, for callers that print a scene's warnings themselves."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        yield


def shortened(text: str, most: int = 60) -> str:
    """Cut a text that is long.

    Examples
    --------
    >>> shortened("0.333333333333", 8)
    '0.333...'
    """
    return text if len(text) <= most else text[: most - 3] + "..."


def printable(text: Any) -> str:
    r"""Write what can't be printed in one line as escapes, so that a terminal obeys no text.

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
