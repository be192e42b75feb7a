"""Where the goldens of a test lie, where its failures go, and how messages name them."""

import os
import re
import shlex
from pathlib import Path
from typing import NamedTuple

from raytrace.errors import shortened

MAX_NAME = 180  # bytes of a part of a name: 255 that file systems allow, less endings and the names of temporary files
FORBIDDEN = re.compile(r'[\x00-\x1f\\<>:"|?*\x7f]|%(?=[0-9A-F]{2})')  # by some file system; % so that all stay apart
__tracebackhide__ = True  # as in check.py


class GoldenLocation(NamedTuple):
    """Where a test's goldens lie, and where its failures go."""

    folder: Path  # of goldens
    root: Path  # of the tests
    failures: Path
    here: Path  # where pytest was called: messages name files from there
    test: str  # its node id, from there too

    def golden(self, name: str) -> Path:
        """The file of a golden; the name may have folders."""
        plain = self.folder / f"{name}.npz"
        path = self.folder / f"{_file_name(name)}.npz"
        # named so before, where the file system allows it
        return plain if "\\" not in name and os.name != "nt" and plain.exists() else path

    def left(self, name: str, kind: str) -> Path:
        """A file that a failure leaves."""
        inside = self.folder.is_relative_to(self.root)
        folder = self.folder.relative_to(self.root) if inside else self.folder.name
        return self.failures / folder / f"{_file_name(name)}{kind}"

    @property
    def command(self) -> str:
        """What writes the goldens of the test."""
        return f"pytest --update-goldens {_quoted(self.test)}"

    def short(self, path: Path) -> str:
        """The way to a file of this project."""
        return relative(path, self.here) if path.is_relative_to(self.root) else str(path)


def relative(path: Path, start: Path) -> str:
    """The way from a folder to a file; the whole path, where there is none: on another drive of Windows."""
    try:
        return os.path.relpath(path, start)
    except ValueError:
        return str(path)


def _quoted(word: str) -> str:
    """A word as the shell of this system takes it."""
    if os.name != "nt":
        return shlex.quote(word)
    return f'"{word}"' if set(word) & set(" ()[]&^") else word


def _file_name(name: str) -> str:
    r"""The file of a name, without its ending; what no file system may have in a name is written as %5C.

    >>> _file_name("test_word[\\xe9-1:2]")
    'test_word[%5Cxe9-1%3A2]'
    """
    if not {"", ".", ".."}.isdisjoint(name.split("/")):  # they lead elsewhere, or to the file of another name
        text = "expected a name like 'box' or 'shapes/box', whose parts are neither empty nor '.' or '..'"
        raise ValueError(f"name: {text}; got {name!r}")
    written = FORBIDDEN.sub(lambda found: f"%{ord(found[0]):02X}", name)
    if any(len(os.fsencode(part)) > MAX_NAME for part in written.split("/")):
        raise ValueError(f"name: longer than a file's name may be ({MAX_NAME} bytes): {shortened(name)!r}")
    return written
