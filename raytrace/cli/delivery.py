"""Writes the image of a render, to another folder if necessary, and describes the result."""

import contextlib
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from raytrace.errors import FileError
from raytrace.rendering.checkpoint import SUFFIX, Checkpoint
from raytrace.rendering.progress import Progress, speed
from raytrace.rendering.result import Render, state_of

if TYPE_CHECKING:
    from distributed import Client

NOTED = 0.01  # seconds of compilation that are worth reporting
WHOLE = 0.95  # share of the time from which rendering counts as all of it


def checkpoint_of(path: Path, resume: bool, say: Callable[[str], None]) -> Checkpoint:
    """Return the checkpoint of an image: a file in the same folder."""
    return Checkpoint(path.with_name(path.name + SUFFIX), resume, say)


@contextlib.contextmanager
def connected(address: str | None) -> Iterator["Client | None"]:
    """Connect to the scheduler at an address for the time of the context; None without an address."""
    if address is None:
        yield None
        return
    from raytrace.rendering.cluster import connect

    with connect(address) as client:
        yield client


def path_of(image: Render, path: Path) -> Path:
    """Return the path to write an image to: an incomplete image does not replace an existing file.

    Parameters
    ----------
    image : Render
    path : Path
        The requested path.
    """
    if image.complete or not os.path.lexists(path):
        return path
    return path.with_name(f"{path.stem}.partial{path.suffix}")


def deliver(image: Render, path: Path, exposure: float) -> tuple[Path, str]:
    """Write an image; return its path, and what went wrong ("" if nothing).

    After a long render, the folder may be full, deleted or read-only. Then the image is written to a new folder: among
    the temporary files, else in the home folder, else in the current folder.

    Raises
    ------
    FileError
        The image can't be written to any of these.
    """
    try:
        return image.save(path, exposure=exposure), ""
    except FileError as error:
        failure = error
    for folder in (tempfile.gettempdir, Path.home, Path.cwd):
        with contextlib.suppress(OSError, RuntimeError):  # a FileError is an OSError; no home is a RuntimeError
            elsewhere = Path(tempfile.mkdtemp(prefix="raytrace-", dir=folder()))
            try:
                written = image.save(elsewhere / path.name, exposure=exposure)
            except FileError:
                os.rmdir(elsewhere)
                continue
            return written, f"{failure}; the image is in {written}"
    raise FileError(f"{failure}; nor anywhere else{_kept(image)}")


def nothing(image: Render) -> str:
    """The message for a render without a complete round of samples."""
    cure = "" if image.interrupted else "; use a longer --time-limit"
    return f"{state_of(image)}; nothing was saved{cure}{_kept(image)}"


def remarks(image: Render, last: Progress | None, seconds: float, target: float | None) -> Iterator[str]:
    """Yield the messages about a finished render, one per line.

    Parameters
    ----------
    image : Render
    last : Progress or None
        The last progress update of the rendering stage.
    seconds : float
        From the start of the command.
    target : float or None
        Target error.
    """
    if not image.complete:
        yield f"{state_of(image)}{_kept(image)}"
    if image.complete and target is not None and image.stats["target_reached"] is False:
        yield f"target error {target:g} not reached with {image.provenance['spp']} samples per pixel"
    if last:
        error = image.stats["estimated_error"]
        known = f"estimated error {error:.2g}" if error == error else "error unknown"  # NaN with one sample per pixel
        compiling = image.stats["compile_seconds"]
        parts = {"compiling": compiling} if compiling >= NOTED else {}
        if last.seconds < WHOLE * seconds:
            parts["rendering"] = last.seconds  # the time of the rays per second
        words = ", ".join(f"{part:.2f} s {name}" for name, part in parts.items())
        apart = f" ({words})" if parts else ""
        yield f"{seconds:.2f} s{apart}, {speed(last)}, {known}"


def _kept(image: Render) -> str:
    """The end of a message about the checkpoint; "" if there is none."""
    return f"; --resume continues from {image.checkpoint.path}" if image.checkpoint and image.checkpoint.kept else ""
