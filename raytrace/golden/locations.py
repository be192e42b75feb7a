"""Paths of the golden images and failure files of a test, and their form in messages."""

import os
import re
import shlex
from pathlib import Path
from typing import NamedTuple

from raytrace.errors import shortened

MAX_NAME = 180  # bytes of a part of a name: file systems allow 255; extensions and temporary names need the rest
FORBIDDEN = re.compile(
    r'[\x00-\x1f\\<>:"|?*\x7f]|%(?=[0-9A-F]{2})'
)  # forbidden by some file system; % is included so that names stay distinct
__tracebackhide__ = True  # as in check.py


class GoldenLocation(NamedTuple):
    """Folders of a test's golden images and failure files."""

    folder: Path  # of golden images
    root: Path  # of the tests
    failures: Path  # folder of failure files
    here: Path  # working folder of pytest: paths in messages are relative to it
    test: str  # node id of the test, relative to it too

    def golden(self, name: str) -> Path:
        """Path of a golden image; the name may contain folders."""
        plain = self.folder / f"{name}.npz"
        path = self.folder / f"{_file_name(name)}.npz"
        # the name in earlier versions
        return plain if "\\" not in name and os.name != "nt" and plain.exists() else path

    def failure_file(self, name: str, extension: str) -> Path:
        """Path of a file that is written for a failure."""
        inside = self.folder.is_relative_to(self.root)
        folder = self.folder.relative_to(self.root) if inside else self.folder.name
        return self.failures / folder / f"{_file_name(name)}{extension}"

    @property
    def command(self) -> str:
        """Command that writes the golden images of the test."""
        return f"pytest --update-goldens {_quoted(self.test)}"

    def short(self, path: Path) -> str:
        """Path for messages: relative to ``here`` for a file of this project."""
        return relative(path, self.here) if path.is_relative_to(self.root) else str(path)


def relative(path: Path, start: Path) -> str:
    """Path of a file relative to a folder; the whole path if there is none (another drive on Windows)."""
    try:
        return os.path.relpath(path, start)
    except ValueError:
        return str(path)


def _quoted(word: str) -> str:
    """Quote a word for the shell of this system."""
    if os.name != "nt":
        return shlex.quote(word)
    return f'"{word}"' if set(word) & set(" ()[]&^") else word


def _file_name(name: str) -> str:
    r"""File name for a name, without extension; characters that a file system may forbid are written as %5C.

    >>> _file_name("test_word[\\xe9-1:2]")
    'test_word[%5Cxe9-1%3A2]'
    """
    if not {"", ".", ".."}.isdisjoint(name.split("/")):  # they refer to another folder, or to the file of another name
        text = "expected a name like 'box' or 'shapes/box', whose parts are neither empty nor '.' or '..'"
        raise ValueError(f"name: {text}; got {name!r}")
    written = FORBIDDEN.sub(lambda found: f"%{ord(found[0]):02X}", name)
    if any(len(os.fsencode(part)) > MAX_NAME for part in written.split("/")):
        raise ValueError(f"name: longer than {MAX_NAME} bytes: {shortened(name)!r}")
    return written
