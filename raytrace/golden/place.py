"""Where the goldens of a test lie, where its failures go, and how messages name them."""

import os
import shlex
from pathlib import Path
from typing import NamedTuple

__tracebackhide__ = True  # as in check.py


class Place(NamedTuple):
    """Where a test's goldens lie, and where its failures go."""

    folder: Path  # of goldens
    root: Path  # of the tests
    failures: Path
    here: Path  # where pytest was called: messages name files from there
    test: str  # its node id, from there too

    def golden(self, name: str) -> Path:
        """The file of a golden; the name may have folders."""
        parts = Path(name).parts
        if not parts or Path(name).is_absolute() or ".." in parts or "\\" in name:
            raise ValueError(f"name: expected a name like 'box' or 'shapes/box', got {name!r}")
        return self.folder / f"{name}.npz"

    def left(self, name: str, kind: str) -> Path:
        """A file that a failure leaves."""
        inside = self.folder.is_relative_to(self.root)
        return self.failures / (self.folder.relative_to(self.root) if inside else self.folder.name) / f"{name}{kind}"

    @property
    def command(self) -> str:
        """What writes the goldens of the test."""
        return f"pytest --update-goldens {shlex.quote(self.test)}"

    def short(self, path: Path) -> str:
        """The way to a file of this project."""
        return os.path.relpath(path, self.here) if path.is_relative_to(self.root) else str(path)
