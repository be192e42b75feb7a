"""A picture handed over: written where it was wanted, or where that can be done; and what is said of it."""

import contextlib
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from raytrace.checkpoint import SUFFIX, Checkpoint
from raytrace.errors import FileError
from raytrace.picture import Render
from raytrace.terminal import Event, speed

if TYPE_CHECKING:
    from distributed import Client


def checkpoint_of(path: Path, resume: bool, say: Callable[[str], None]) -> Checkpoint:
    """What keeps finished parts of a picture: a file beside it."""
    return Checkpoint(path.with_name(path.name + SUFFIX), resume, say)


@contextlib.contextmanager
def connected(address: str | None) -> Iterator["Client | None"]:
    """A client of the scheduler at an address, as long as it is needed; None where there is no address."""
    if address is None:
        yield None
        return
    from raytrace.cluster import connect

    with connect(address) as client:
        yield client


def deliver(image: Render, path: Path, exposure: float) -> tuple[Path, str]:
    """Write a picture; where it lies now, and what went wrong, if anything did.

    What could be written when the render began may be full, gone or read-only by now. Then the picture goes to a new
    folder for temporary files, in the home folder, or in the current one, whichever can be written first.

    Raises
    ------
    FileError
        It can be written nowhere.
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
            return written, f"{failure}; the picture is in {written}"
    raise FileError(f"{failure}; nor anywhere else{_kept(image, '; --resume goes on from {}')}")


def remarks(image: Render, last: Event | None, seconds: float, target: float | None) -> Iterator[str]:
    """What is worth saying of a picture.

    Parameters
    ----------
    image : Render
    last : Event or None
        The newest of its drawing.
    seconds : float
        That it took.
    target : float or None
        Error that was wanted.
    """
    if not image.complete:
        why = "interrupted" if image.interrupted else "time limit reached"
        yield f"{why}; the finished part is saved{_kept(image, '; --resume goes on from {}')}"
    if image.complete and target is not None and image.stats["target_reached"] is False:
        yield f"target error {target:g} not reached with {image.provenance['spp']} samples a pixel"
    if last:
        error = image.stats["estimated_error"]
        known = f"estimated error {error:.2g}" if error == error else "error unknown"  # of one sample a pixel
        yield f"{seconds:.2f} s, {speed(last)}, {known}"


def _kept(image: Render, words: str) -> str:
    """Words with the place of a checkpoint in them; none where there is none."""
    return words.format(image.checkpoint.path) if image.checkpoint and image.checkpoint.kept else ""
